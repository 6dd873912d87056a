"""From particles to the surface around them, as pictures need it: closed, smooth, the same grid for every frame.

Zhu & Bridson 2005: phi(x) = |x - xbar(x)| - r with the weighted mean xbar of the particles around x; here with Gaussian
weights, so that it is a few filters of a grid. VTK extracts the surface phi = 0 in space, `refsim.isosurface` the
line in the plane.
"""

import importlib.util
import itertools
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from refsim.backends.arrays import Backend
from refsim.core.errors import InputError
from refsim.isosurface import Mesh, extract
from refsim.render.space import pyvista

CELL = 0.5  # of the grid [spacings]
WIDTH = 0.75  # standard deviation of the Gaussian weights [spacings]
RADIUS = 0.62  # r [spacings]: the surface of a lattice lies half a spacing outside of its outermost particles
THIN = 0.05, 0.12  # weights, of that inside a lattice, between which the surface fades; a particle alone has 0.16
MARGIN = 4  # spacings of grid around the particles
CONTACT = 0.6  # spacings by which the surface is moved outwards at a solid, less with the distance from it
CONTACT_RANGE = 1.2  # spacings from the solid at which it is not moved
MIRRORED = 3.0  # spacings from a plane up to which particles are mirrored in it
SUNK = 0.08  # spacings by which it reaches into the solid, so that no gap is seen
MOST_NODES = 300_000_000
AT_ONCE = 50_000  # nodes whose distance from a solid is computed
Distance = Callable[[NDArray[np.float64]], NDArray[np.float64]]  # signed, (k,) [m], of points (k, 3) [m]


def surface_around(
    position: ArrayLike, spacing: float, dim: int = 3, cell: float = CELL, solid: Distance | None = None,
    box: tuple[NDArray, NDArray] | None = None,
) -> Mesh:  # fmt: skip
    """The surface around particles at `position` (n, 3) [m] that stand about `spacing` [m] apart.

    cell   of the grid [spacings]
    solid  distance from a solid, negative inside; the surface reaches to it where it is near, although the liquid's
           outermost particles stand up to a spacing off, and not beyond
    box    corners of the walls [m], infinite at open faces, which the surface does not cross: particles are mirrored in
           its planes, to keep a level flat

    Raises InputError where the particles are so far apart that the grid would have more than MOST_NODES nodes.
    """
    points = np.asarray(position, dtype=float)[:, :dim]
    size = cell * spacing
    for axis, end in itertools.product(range(dim), box or ()):
        images = points[np.abs(points[:, axis] - end[axis]) < MIRRORED * spacing]
        images[:, axis] = 2 * end[axis] - images[:, axis]
        points = np.concatenate([points, images])
    if not len(points):
        return Mesh(np.zeros((0, 3), np.float32), np.zeros((0, dim), np.int32))
    first, phi, held = distances(points, spacing, size, box)

    in_space = (0, 0), (0, 3 - dim)  # zeros that make places of `dim` coordinates places of three

    def place(nodes: NDArray) -> NDArray[np.float64]:
        return np.pad((nodes + first) * size, in_space)

    if solid is not None:
        for near in _parts(np.abs(phi) < 1.5 * spacing):
            places, at = place(near), tuple(near.T)
            off, planes = solid(places), np.inf if box is None else depth(places, *box)
            share = np.where(off < planes, np.clip(1.0 - off / (CONTACT_RANGE * spacing), 0.0, 1.0), 0.0)
            phi[at] -= CONTACT * spacing * share * held[at]
        for inside in _parts(phi < spacing):
            at = tuple(inside.T)
            phi[at] = np.maximum(phi[at], -solid(place(inside)) - SUNK * spacing)
    if box is not None:
        for axis, grid in enumerate(np.ogrid[tuple(slice(n) for n in phi.shape)]):
            x = (grid + first[axis]) * size
            beyond = np.maximum(box[0][axis] - x, x - box[1][axis]) - SUNK * spacing
            np.maximum(phi, beyond.astype(np.float32), out=phi)
    if dim == 3 and importlib.util.find_spec("pyvista") is not None:  # validation draws without it, too
        return _in_space(phi, first, size)
    from scipy.ndimage import binary_dilation

    within, beside = phi < 0, np.ones((3,) * dim, bool)
    crossed = binary_dilation(within, beside) & binary_dilation(~within, beside)
    nodes = np.argwhere(binary_dilation(crossed, beside))  # of cells that the surface crosses, and those beside them
    return extract(Backend("cpu"), np.pad(nodes + first, in_space), phi[tuple(nodes.T)].astype(np.float32), size, dim)


def _in_space(phi: NDArray[np.float32], first: NDArray[np.int64], size: float) -> Mesh:
    """The surface phi = 0 of a grid by VTK, which pictures in space load anyway: Numba would take 116 MiB more."""
    grid = pyvista().ImageData(dimensions=phi.shape[::-1])  # its first axis varies fastest
    grid.point_data["phi"] = phi.reshape(-1)
    mesh = grid.contour([0.0], "phi", compute_normals=False, compute_scalars=False, method="flying_edges")
    vertices = (np.asarray(mesh.points, dtype=float)[:, ::-1] + first) * size
    return Mesh(vertices.astype(np.float32), mesh.regular_faces.astype(np.int32))


def distances(
    points: NDArray, spacing: float, size: float, box: tuple[NDArray, NDArray] | None = None
) -> tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.float32]]:
    """Integer coordinates of the grid's first node; at its nodes, `size` [m] apart, phi [m] and a factor from 0 to 1.

    box  corners [m] beyond which the grid ends after two cells

    The factor multiplies r: without it, the mean of far particles would make shreds of surface between them.
    """
    from scipy.ndimage import gaussian_filter

    dim, sigma = points.shape[1], WIDTH * spacing / size
    margin = round(MARGIN * spacing / size)
    low, high = np.floor(points.min(0) / size) - margin, np.floor(points.max(0) / size) + margin + 1
    first, last = low, high  # of the kept nodes; those beyond them hold particles that the filter reaches
    if box is not None:
        first, last = np.floor(box[0][:dim] / size) - 2, np.ceil(box[1][:dim] / size) + 2
        reach = int(4.0 * sigma + 0.5)
        low, high = np.maximum(low, first - reach), np.minimum(high, last + reach)
    extent = np.maximum(high - low + 1, 0)
    if not np.isfinite(extent).all() or extent.prod() > MOST_NODES:
        raise InputError(
            f"the surface's grid would have more than {MOST_NODES:,} nodes, because particles are far apart; draw"
            " particles (--style particles), or choose frames before they fly away."
        )
    shape, origin = tuple(extent.astype(int).tolist()), low.astype(np.int64)
    starts, ends = ((n - low).clip(0, extent).astype(int).tolist() for n in (first, last + 1))
    kept = tuple(slice(*each) for each in zip(starts, ends))
    # from here in cells, from the first node
    place = points / size - origin
    base = np.floor(place).astype(np.int64)
    inside = ((base >= 0) & (base < extent - 1)).all(1)
    base, share = base[inside], (place - base)[inside]
    weight = np.zeros(shape, np.float32).reshape(-1)
    moment = np.zeros((dim, weight.size), np.float32)
    strides = np.array([int(np.prod(shape[axis + 1 :])) for axis in range(dim)])
    flat = base @ strides
    for corner in np.ndindex(*(2,) * dim):
        part = np.where(corner, share, 1.0 - share).prod(1)
        node = flat + np.array(corner) @ strides
        np.add.at(weight, node, part.astype(np.float32))
        for axis in range(dim):  # of the particle's place relative to the node
            np.add.at(moment[axis], node, (part * (share[:, axis] - corner[axis])).astype(np.float32))
    grids = [grid.astype(np.float32) for grid in np.ogrid[tuple(slice(n) for n in shape)]]
    total = gaussian_filter(weight.reshape(shape), sigma, mode="constant")[kept] * (spacing / size) ** dim
    held = np.clip((total - THIN[0]) / (THIN[1] - THIN[0]), 0.0, 1.0)
    there = held > 0
    squared = np.zeros_like(total)
    for axis, grid in enumerate(grids):
        mean = moment[axis].reshape(shape) + weight.reshape(shape) * grid
        summed = gaussian_filter(mean, sigma, mode="constant")[kept] * (spacing / size) ** dim
        away = np.divide(summed, total, where=there, out=np.zeros_like(total))
        squared += np.where(there, away - np.broadcast_to(grid, shape)[kept], 0.0) ** 2
    phi = np.sqrt(squared) * size - RADIUS * spacing * held
    phi[~there] = spacing
    return origin + starts, phi, held


def depth(points: NDArray, low: NDArray, high: NDArray) -> NDArray[np.float64]:
    """(k,) distance [m] of points (k, 3) inside of a box from its nearest face."""
    return np.minimum.reduce([part for x, a, b in zip(points.T, low, high) for part in (x - a, b - x)])


def _parts(chosen: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    """(k, dim) nodes that are chosen, some at a time."""
    nodes = np.argwhere(chosen)
    return np.array_split(nodes, 1 + len(nodes) // AT_ONCE)
