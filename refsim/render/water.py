"""Clear water in a picture: refraction, absorption by thickness and reflection, at every pixel (parallel projection).

A closed surface is drawn to all its crossings along each pixel's ray. The first one gives the normal. The sum of the
distances with their signs gives the length of the ray in water, up to the first opaque body behind it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from refsim.render.looks import liquid_colour

Array = NDArray[np.float64]

INDEX = 1.333  # of refraction
ABSORPTION = np.array([9.5, 3.2, 1.5])  # of red, green and blue by the first liquid [1/height of the picture]
LACKS = 1.25  # less the share of a colour in a liquid: how much of it another liquid absorbs
SCATTER = 0.55  # share of the absorbed light that comes back with the liquid's own colour
BEND = 0.5  # share of the thickness over which a refracted ray is moved aside
SMOOTH = 0.012  # of the picture's height, over which the thickness is smoothed for that
EDGE = 0.4  # share of the light behind that a surface seen from its side bends away
ASIDE = 1.2345e-4, 2.7183e-4  # pixels by which facets are shifted, so that no common edge meets a pixel's centre
LARGEST = 32  # pixels along a facet; larger ones are divided
LOW_SKY, HIGH_SKY, FLOOR = np.array([0.52, 0.60, 0.67]), np.array([0.96, 0.985, 1.0]), np.array([0.62, 0.66, 0.69])


@dataclass
class Crossings:
    """Where rays through the pixels cross closed surfaces, one entry for each crossing.

    pixel   flat number in the picture
    depth   distance from the viewer, from any origin [m]
    facet   number of the facet; weight: (k, 3) of its corners
    enters  whether the ray enters the body there
    """

    pixel: NDArray[np.int64]
    depth: Array
    facet: NDArray[np.int64]
    weight: Array
    enters: NDArray[np.bool_]


def crossings(place: Array, depth: Array, facets: NDArray, shape: tuple[int, int]) -> Crossings:
    """All crossings of the rays through the centres of a picture's pixels with facets (f, 3).

    place  (v, 2) of the vertices in pixels, column and row downwards; depth: (v,) away from the viewer [m]
    shape  height and width in pixels
    """
    height, width = shape
    corner, away = (place + ASIDE)[facets], depth[facets]
    number, weights = np.arange(len(facets)), np.broadcast_to(np.eye(3), (len(facets), 3, 3))
    while True:  # divide what is large: the corners' weights in the original facet go along
        large = np.ptp(corner, axis=1).max(1) > LARGEST if len(corner) else np.zeros(0, bool)
        if not large.any():
            break
        parts = []
        for values in (corner, away, weights):
            a, b, c = (values[large][:, k] for k in range(3))
            ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
            four = [np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
            parts.append(np.concatenate([values[~large], *four]))
        corner, away, weights = parts
        number = np.concatenate([number[~large], *[number[large]] * 4])
    first = np.maximum(np.ceil(corner.min(1) - 0.5), 0).astype(np.int64)
    last = np.minimum(np.floor(corner.max(1) - 0.5), (width - 1, height - 1)).astype(np.int64)
    span = last - first + 1
    edge_1, edge_2 = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    area = edge_1[:, 0] * edge_2[:, 1] - edge_1[:, 1] * edge_2[:, 0]
    seen = np.flatnonzero((span > 0).all(1) & (area != 0))
    found: list[tuple[NDArray, ...]] = []
    for row in range(int(span[seen, 1].max(initial=0))):
        in_row = seen[span[seen, 1] > row]
        for column in range(int(span[in_row, 0].max(initial=0))):
            own = in_row[span[in_row, 0] > column]
            x, y = first[own, 0] + column, first[own, 1] + row
            dx, dy = x + 0.5 - corner[own, 0, 0], y + 0.5 - corner[own, 0, 1]
            w1 = (dx * edge_2[own, 1] - dy * edge_2[own, 0]) / area[own]
            w2 = (edge_1[own, 0] * dy - edge_1[own, 1] * dx) / area[own]
            inside = (w1 >= 0) & (w2 >= 0) & (w1 + w2 <= 1)
            own, w1, w2 = own[inside], w1[inside], w2[inside]
            found.append((y[inside] * width + x[inside], own, w1, w2))
    if not found:
        nothing = np.zeros(0, np.int64)
        return Crossings(nothing, np.zeros(0), nothing, np.zeros((0, 3)), np.zeros(0, bool))
    pixel, own, w1, w2 = (np.concatenate(parts) for parts in zip(*found))
    share = np.stack([1.0 - w1 - w2, w1, w2], axis=1)
    # rows run downwards, so that a facet that faces the viewer has a negative area
    return Crossings(
        pixel, (share * away[own]).sum(1), number[own], (share[:, :, None] * weights[own]).sum(1), area[own] < 0
    )


def in_water(found: Crossings, behind: Array) -> tuple[Array, NDArray[np.int64]]:
    """Length [m] of each pixel's ray in the bodies, up to `behind` (pixels,), and its first crossing, -1 for none."""
    sign = np.where(found.enters, -1.0, 1.0)
    length = np.bincount(found.pixel, sign * np.minimum(found.depth, behind[found.pixel]), len(behind))
    nearest, farthest = np.full(len(behind), np.inf), np.full(len(behind), -np.inf)
    np.minimum.at(nearest, found.pixel, found.depth)
    np.maximum.at(farthest, found.pixel, found.depth)
    first = np.full(len(behind), -1, np.int64)
    is_first = (found.depth == nearest[found.pixel]) & (found.depth < behind[found.pixel])
    first[found.pixel[is_first]] = np.flatnonzero(is_first)
    most = np.where(first >= 0, np.minimum(farthest, behind) - nearest, 0.0)
    return np.clip(length, 0.0, most), first


def shaded(
    images: Sequence[NDArray[np.floating]], thickness: Array, normal: Array, colour: Array, wet: NDArray[np.bool_],
    axes: tuple[Array, Array, Array], up: Array, light: Array, metres: float, movable: NDArray[np.bool_],
) -> list[NDArray[np.floating]]:  # fmt: skip
    """Each image (height, width, 3), 0 to 1, of what is opaque, seen through the water before it.

    thickness  (height, width) of the water at each pixel [m]
    normal     (height, width, 3) of its first surface, outward; colour: of the liquid
    wet        pixels with water; movable: those whose image may be seen at another place by refraction
    axes       right, upwards and towards the viewer; up, light: unit vectors against gravity and to the light
    metres     length of a pixel [m]
    """
    from scipy.ndimage import map_coordinates

    height = len(wet)
    right, upward, towards = axes
    n, tau, base = normal[wet], thickness[wet], colour[wet]
    facing = n @ towards
    n = np.where((facing < 0)[:, None], n - 2 * facing[:, None] * towards, n)
    cosine = np.abs(facing).clip(1e-3, 1.0)
    fresnel = 0.02 + 0.98 * (1.0 - cosine) ** 5

    ratio = 1.0 / INDEX
    inner = np.sqrt(1.0 - ratio**2 * (1.0 - cosine**2))
    bent = -ratio * towards + (ratio * cosine - inner)[:, None] * n
    aside = bent + (bent @ towards)[:, None] * -towards
    rows, columns = np.nonzero(wet)
    # the thickness jumps at the outlines of what is behind
    share, even = (_smooth(values, SMOOTH * height, rows, columns) for values in (wet, thickness))
    even /= share.clip(1e-6)
    reach = np.minimum(even, 0.15 * height * metres) * BEND / metres
    r = rows - reach * (aside @ upward) / inner
    c = columns + reach * (aside @ right) / inner
    allowed = map_coordinates(movable.astype(float), (r, c), order=1, mode="nearest") > 0.999
    r, c = np.where(allowed, r, rows), np.where(allowed, c, columns)
    usual = np.array(liquid_colour(0))
    absorbed = ABSORPTION * (LACKS - base / base.max(1, keepdims=True).clip(1e-9)) / (LACKS - usual / usual.max())
    passed = np.exp(-absorbed * (tau / (height * metres))[:, None])
    lit = 0.62 + 0.38 * np.clip(n @ light, -1.0, 1.0)
    passed_edge = passed * (1.0 - EDGE * (1.0 - cosine) ** 2)[:, None]
    scattered = SCATTER * (1.0 - passed) * base * lit[:, None]

    mirrored = 2.0 * cosine[:, None] * n - towards
    climb = mirrored @ up
    sky = np.clip((climb + 0.1) / 0.8, 0.0, 1.0)[:, None]
    around = np.where((climb < -0.1)[:, None], FLOOR, LOW_SKY + (HIGH_SKY - LOW_SKY) * sky**0.8)
    shine = np.clip(mirrored @ light, 0.0, 1.0)
    window = np.clip((shine - 0.955) / 0.015, 0.0, 1.0) + 0.25 * shine**24
    added = fresnel[:, None] * around + (0.75 * window)[:, None]
    results = []
    for image in images:
        seen = np.stack([map_coordinates(image[..., k], (r, c), order=1, mode="nearest") for k in range(3)], axis=1)
        result = image.copy()
        result[wet] = ((passed_edge * seen + scattered) * (1.0 - fresnel[:, None]) + added).clip(0.0, 1.0)
        results.append(result)
    return results


def _smooth(values: NDArray, sigma: float, rows: NDArray, columns: NDArray) -> Array:
    """(k,) what a Gaussian filter of `sigma` pixels makes of an image (height, width) at those of its pixels."""
    from scipy.ndimage import gaussian_filter, map_coordinates

    by = max(1, round(sigma / 4))  # the filter is smooth over so many pixels
    height, width = values.shape
    padded = np.zeros((-(-height // by) * by, -(-width // by) * by), np.float32)
    padded[:height, :width] = values
    coarse = padded.reshape(len(padded) // by, by, -1, by).mean((1, 3))
    at = (rows + 0.5) / by - 0.5, (columns + 0.5) / by - 0.5
    return map_coordinates(gaussian_filter(coarse, sigma / by), at, order=1, mode="nearest", output=np.float64)
