"""How pictures look and where they and their data are kept, and two small renderers: balls and a lit surface, both by
depth buffer."""

from __future__ import annotations

import contextlib
import gzip
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from refsim.core.errors import InputError
from validation.results import finite, read_json

if TYPE_CHECKING:
    from validation.experiment import Picture

# Okabe & Ito's palette, distinct for every kind of colour vision; red and blue where a paper uses them.
BLACK, ORANGE, SKY, GREEN, YELLOW, BLUE, VERMILION, PURPLE = (
    "#000000", "#E69F00", "#56B4E9", "#009E73", "#F0E442", "#0072B2", "#D55E00", "#CC79A7",
)  # fmt: skip
SURFACE_RED, INTERIOR_BLUE = "#D62728", "#4A7FC1"
WATER = (0.16, 0.50, 0.80)  # of lit balls and surfaces
GREY = "#666666"
DOTS_PER_INCH = 160
LARGEST_PICTURE = 300_000  # bytes
LONG_DATA = 10_000  # bytes of a picture's data above which its file is compressed
WEBP = ((1.0, 78), (1.0, 65), (0.8, 75), (0.65, 75), (0.5, 75))  # share of the size, quality: the first that fits


def save_picture(figure: Any, path: Path) -> None:
    """Write a figure as a PNG with at most 256 colours, or as WebP, by the ending of `path`.

    Raises ValueError where no quality and size give a file of at most LARGEST_PICTURE bytes.
    """
    from PIL import Image

    drawn = io.BytesIO()
    figure.savefig(drawn, format="png", dpi=DOTS_PER_INCH)
    image = Image.open(drawn).convert("RGB")
    for share, quality in WEBP if path.suffix == ".webp" else ((1.0, 0),):
        coded = io.BytesIO()
        if quality:
            size = round(share * image.width), round(share * image.height)
            image.resize(size, Image.Resampling.LANCZOS).save(coded, "WEBP", quality=quality, method=6)
        else:
            palette = image.quantize(256, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
            palette.save(coded, "PNG", optimize=True)
        if coded.tell() <= LARGEST_PICTURE:
            path.write_bytes(coded.getvalue())
            return
    raise ValueError(
        f"{path.name} takes {coded.tell()} bytes, more than {LARGEST_PICTURE}: draw less, or mark it shaded."
    )


def write_data(picture: Picture, results: Mapping[str, Any], folder: Path) -> Path:
    """Write the data of a picture, one key a line, in place of the file that is there; compressed (.json.gz) above
    LONG_DATA bytes."""
    name, data = picture.name, finite(picture.collect(results))
    lines = [f"{json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in data.items()]
    text = "{\n" + ",\n".join(lines) + "\n}\n"
    folder.mkdir(parents=True, exist_ok=True)
    short, long = folder / f"{name}.json", folder / f"{name}.json.gz"
    compressed = len(text) > LONG_DATA
    path, other = (long, short) if compressed else (short, long)
    path.write_bytes(gzip.compress(text.encode(), 9, mtime=0) if compressed else text.encode())
    other.unlink(missing_ok=True)
    return path


def read_data(folder: Path, name: str) -> Any:
    """Data of a picture. Raises OSError or ValueError where there is no such file, or another."""
    long = folder / f"{name}.json.gz"
    return read_json(long if long.exists() else folder / f"{name}.json")


def redraw(picture: Picture, folder: Path) -> Path:
    """Draw a picture from its data file. Raises InputError where that is missing."""
    try:
        data = read_data(folder, picture.name)
    except (OSError, ValueError) as error:
        raise InputError(f"There is no data to draw {picture.name} from ({error}); run the experiment first.") from None
    path = folder / picture.file
    with style():
        figure = picture.draw(data)
        save_picture(figure, path)
        import matplotlib.pyplot as plt

        plt.close(figure)
    return path


@contextlib.contextmanager
def style() -> Iterator[None]:
    """Matplotlib without a screen, in the project's style."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    with plt.rc_context(
        {
            "font.size": 9.5,
            "axes.titlesize": 10.5,
            "axes.titleweight": "bold",
            "axes.titlelocation": "left",
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.edgecolor": "#444444",
            "axes.labelcolor": "#222222",
            "axes.axisbelow": True,
            "grid.color": "#dddddd",
            "grid.linewidth": 0.7,
            "lines.linewidth": 1.8,
            "legend.frameon": False,
            "legend.fontsize": 8.5,
            "figure.constrained_layout.use": True,
            "figure.facecolor": "white",
        }
    ):
        yield


def view_matrix(azimuth: float, elevation: float) -> NDArray[np.float64]:
    """Rows: to the right, up, and towards the viewer, who stands at these angles [degrees]."""
    a, e = np.radians([azimuth, elevation])
    towards = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    return np.stack((right, np.cross(towards, right), towards))


def _frontmost(
    position: ArrayLike, radius: float, view: NDArray, extent: float, pixels: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Which ball each pixel shows (pixels, pixels), -1 for none; and the balls' centres in pixels (n, 2)."""
    seen = np.asarray(position, dtype=float) @ view.T
    scale = pixels / (2.0 * extent)
    reach = int(np.ceil(radius * scale)) + 1
    depth = np.full((pixels, pixels), -np.inf)
    owner = np.full((pixels, pixels), -1)
    offset = np.arange(-reach, reach + 1)
    centre = np.stack(((seen[:, 0] + extent) * scale, (extent - seen[:, 1]) * scale), axis=1)
    for i, (column, row) in enumerate(np.rint(centre).astype(int)):
        if min(column, row) < reach or max(column, row) >= pixels - reach:
            continue  # outside the picture
        dx = (column + offset)[None, :] - centre[i, 0]
        dy = (row + offset)[:, None] - centre[i, 1]
        rest = (radius * scale) ** 2 - dx**2 - dy**2
        height = np.where(rest > 0, seen[i, 2] * scale + np.sqrt(np.maximum(rest, 0.0)), -np.inf)
        window = slice(row - reach, row + reach + 1), slice(column - reach, column + reach + 1)
        nearer = height > depth[window]
        depth[window] = np.where(nearer, height, depth[window])
        owner[window] = np.where(nearer, i, owner[window])
    return owner, centre


def visible_balls(
    position: ArrayLike, radius: float, view: NDArray, extent: float, pixels: int = 640
) -> NDArray[np.int64]:
    """Numbers of the balls that `ball_picture` shows any part of."""
    owner, _ = _frontmost(position, radius, view, extent, pixels)
    return np.unique(owner[owner >= 0])


def ball_picture(
    position: ArrayLike, radius: float, colour: ArrayLike, view: NDArray, extent: float, pixels: int = 640
) -> NDArray[np.float64]:
    """Balls seen in parallel projection, lit from the upper left: an image (pixels, pixels, 4) with clear ground.

    position (n, 3), radius and half width `extent` in one unit; colour (n, 3) in 0..1.
    """
    owner, centre = _frontmost(position, radius, view, extent, pixels)
    size = radius * pixels / (2.0 * extent)
    rows, columns = np.nonzero(owner >= 0)
    who = owner[rows, columns]
    normal = np.empty((len(who), 3))
    normal[:, 0] = (columns - centre[who, 0]) / size
    normal[:, 1] = -(rows - centre[who, 1]) / size
    normal[:, 2] = np.sqrt(np.maximum(1.0 - normal[:, 0] ** 2 - normal[:, 1] ** 2, 0.0))
    image = np.zeros((pixels, pixels, 4))
    image[rows, columns, :3] = _lit(normal, np.asarray(colour, dtype=float)[who], gloss=0.25)
    image[rows, columns, 3] = 1.0
    return image


def surface_picture(
    vertices: ArrayLike, faces: ArrayLike, colour: ArrayLike, view: NDArray, extent: float, pixels: int = 640
) -> NDArray[np.float64]:
    """A closed mesh seen in parallel projection with smooth normals: an image (pixels, pixels, 4) with clear ground.

    vertices (v, 3), faces (f, 3) with outward normals, half width `extent` in the vertices' unit; colour (3,).
    Lit by matplotlib's LightSource from the upper left.
    """
    points, corner = np.asarray(vertices, dtype=float), np.asarray(faces)
    a, b, c = points[corner[:, 0]], points[corner[:, 1]], points[corner[:, 2]]
    facet = np.cross(b - a, c - a)
    normals = np.zeros_like(points)
    for k in range(3):
        np.add.at(normals, corner[:, k], facet)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True).clip(min=1e-300)
    seen, turned = points @ view.T, normals @ view.T
    scale = pixels / (2.0 * extent)
    flat = np.stack(((seen[:, 0] + extent) * scale, (extent - seen[:, 1]) * scale), axis=1)
    depth = np.full((pixels, pixels), -np.inf)
    image_normal = np.zeros((pixels, pixels, 3))
    facing = (facet @ view[2]) > 0
    for face in corner[facing]:
        p = flat[face]
        low = np.maximum(np.floor(p.min(0)).astype(int), 0)
        high = np.minimum(np.ceil(p.max(0)).astype(int) + 1, pixels)
        if (high <= low).any():
            continue
        x, y = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
        area = (p[1, 0] - p[0, 0]) * (p[2, 1] - p[0, 1]) - (p[2, 0] - p[0, 0]) * (p[1, 1] - p[0, 1])
        if area == 0.0:
            continue
        u = ((x - p[0, 0]) * (p[2, 1] - p[0, 1]) - (p[2, 0] - p[0, 0]) * (y - p[0, 1])) / area
        v = ((p[1, 0] - p[0, 0]) * (y - p[0, 1]) - (x - p[0, 0]) * (p[1, 1] - p[0, 1])) / area
        inside = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1.0 + 1e-9)
        z = seen[face[0], 2] * (1 - u - v) + seen[face[1], 2] * u + seen[face[2], 2] * v
        window = slice(low[1], high[1]), slice(low[0], high[0])
        nearer = inside & (z > depth[window])
        depth[window] = np.where(nearer, z, depth[window])
        n = turned[face]
        blend = n[0] * (1 - u - v)[..., None] + n[1] * u[..., None] + n[2] * v[..., None]
        image_normal[window] = np.where(nearer[..., None], blend, image_normal[window])
    filled = np.isfinite(depth)
    image = np.zeros((pixels, pixels, 4))
    unit = image_normal[filled]
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    image[filled, :3] = _lit(unit, np.broadcast_to(np.asarray(colour, dtype=float), unit.shape), gloss=0.55)
    image[filled, 3] = 1.0
    return image


def _lit(normal: NDArray, colour: NDArray, gloss: float) -> NDArray[np.float64]:
    """Colours (k, 3) of surface points with unit normals (k, 3) in (right, up, towards the viewer)."""
    from matplotlib.colors import LightSource

    light = LightSource(azdeg=315, altdeg=50)
    diffuse = np.clip(normal @ light.direction, 0.0, 1.0)  # its x is right, its y up, its z towards the viewer
    half = light.direction + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half)
    shine = gloss * np.clip(normal @ half, 0.0, 1.0) ** 40
    rim = 0.25 * (1.0 - np.clip(normal[:, 2], 0.0, 1.0)) ** 3
    shade = (0.36 + 0.66 * diffuse - 0.3 * rim)[:, None]
    return np.clip(colour * shade + shine[:, None], 0.0, 1.0)


def show_image(axes: Any, image: NDArray, extent: float) -> None:
    """Put a rendered image on axes without frame."""
    axes.imshow(image, extent=(-extent, extent, -extent, extent), interpolation="antialiased")
    axes.set_axis_off()


class Layer(NamedTuple):
    """A mesh to be seen with others: vertices (v, 3), triangles (f, 3) with outward normals, colour, opacity."""

    vertices: NDArray
    triangles: NDArray
    colour: tuple[float, float, float]
    opacity: float = 1.0


def layered_picture(layers: list[Layer], view: NDArray, extent: float, pixels: int = 640) -> NDArray[np.float64]:
    """Lit meshes seen together in parallel projection: an image (pixels, pixels, 4) with clear ground.

    Opaque layers hide each other; the others lie over them with their front, more opaque where it is seen edge-on.
    """
    depth = np.full(pixels * pixels, -np.inf)
    image = np.zeros((pixels * pixels, 4))
    for layer in sorted(layers, key=lambda layer: -layer.opacity):
        where, height, normal = _front(layer, view, extent, pixels)
        seen = height > depth[where]
        where, height, normal = where[seen], height[seen], normal[seen]
        solid = layer.opacity >= 1
        colour = _lit(normal, np.broadcast_to(np.array(layer.colour), normal.shape), gloss=0.35 if solid else 0.55)
        if solid:
            depth[where] = height
            image[where] = np.column_stack([colour, np.ones(len(where))])
        else:
            edge = (1 - np.clip(normal[:, 2], 0, 1)) ** 2
            own = np.clip(layer.opacity + 0.45 * edge, 0, 1)[:, None]
            under = image[where]
            alpha = own + under[:, 3:] * (1 - own)
            mixed = (colour * own + under[:, :3] * under[:, 3:] * (1 - own)) / alpha
            image[where] = np.column_stack([mixed, alpha])
    return image.reshape(pixels, pixels, 4)


def _front(layer: Layer, view: NDArray, extent: float, pixels: int) -> tuple[NDArray, NDArray, NDArray]:
    """Pixels (k,) that a mesh covers, how near its front is there (k,), and its unit normals there (k, 3)."""
    if not len(layer.triangles):
        return np.zeros(0, int), np.zeros(0), np.zeros((0, 3))
    seen = np.asarray(layer.vertices, dtype=float) @ view.T
    corner = seen[layer.triangles]
    facet = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normals = np.zeros_like(seen)
    for k in range(3):
        np.add.at(normals, layer.triangles[:, k], facet)
    scale = pixels / (2.0 * extent)
    front = facet[:, 2] > 0
    corner, turned = corner[front], normals[layer.triangles[front]]
    size = scale * np.ptp(corner[:, :, :2], axis=1).max(1, initial=0.0)
    steps = max(2, int(np.ceil(2.0 * np.quantile(size, 0.999)))) if len(size) else 2
    where, height, normal = [], [], []
    for a in range(steps + 1):
        for b in range(steps + 1 - a):
            share = np.array([steps - a - b, a, b]) / steps
            point = np.einsum("k,fkc->fc", share, corner)
            column = np.floor((point[:, 0] + extent) * scale).astype(int)
            row = np.floor((extent - point[:, 1]) * scale).astype(int)
            held = (np.minimum(column, row) >= 0) & (np.maximum(column, row) < pixels)
            where.append((row * pixels + column)[held])
            height.append(point[held, 2])
            normal.append(np.einsum("k,fkc->fc", share, turned)[held])
    flat, near, blend = np.concatenate(where), np.concatenate(height), np.concatenate(normal)
    order = np.argsort(near, kind="stable")
    nearest = np.full(pixels * pixels, -1)
    nearest[flat[order]] = order  # the last one written is the nearest
    covered = np.flatnonzero(nearest >= 0)
    chosen = nearest[covered]
    unit = blend[chosen] / np.linalg.norm(blend[chosen], axis=1, keepdims=True).clip(min=1e-300)
    return covered, near[chosen], unit


def stacked_bars(
    axes: Any, rows: Sequence[Mapping[str, float]], colours: Mapping[str, str], places: Sequence[float] = (),
    height: float = 0.7, **look: Any,
) -> list[float]:  # fmt: skip
    """A horizontal bar for each row, of its parts in the order of `colours`; where the bars end.

    places  of the bars along the vertical axis, 0, 1, ... by default
    """
    ends = []
    for k, (place, row) in enumerate(zip(places or range(len(rows)), rows, strict=True)):
        left = 0.0
        for name, colour in colours.items():
            width, label = row.get(name, 0.0), name if k == 0 else None
            axes.barh(place, width, left=left, color=colour, label=label, height=height, **look)
            left += width
        ends.append(left)
    return ends
