"""How pictures look, where they and their data are kept, and views of balls and surfaces in 3D by `refsim.render`."""

import base64
import contextlib
import functools
import importlib.util
import io
import re
import sys
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from refsim.core.writing import made_by, write_file
from refsim.render.looks import Camera
from refsim.render.space import Body, Stage
from validation.results import read_json

# Okabe & Ito's palette, distinct for every kind of colour vision; red and blue where a paper uses them.
BLACK, ORANGE, SKY, GREEN, YELLOW, BLUE, VERMILION, PURPLE = (
    "#000000", "#E69F00", "#56B4E9", "#009E73", "#F0E442", "#0072B2", "#D55E00", "#CC79A7",
)  # fmt: skip
SURFACE_RED, INTERIOR_BLUE = "#D62728", "#4A7FC1"
WATER = (0.16, 0.50, 0.80)  # of lit balls and surfaces
GREY = "#666666"
UP = np.array([0.0, 0.0, 1.0])
DOTS_PER_INCH = 160
LARGEST_PICTURE = 200_000  # bytes
COLUMN = 900  # pixels, of a picture on a page of the site that is 1,280 wide
LETTERS = 9.0  # pixels there, the least size of words
DIGITS = 9
MEASURED = "measured"
LONG_DATA = 10_000  # bytes of a picture's data above which its file is compressed
COLOURS = 128  # of a PNG
WEBP = ((1.0, 62), (0.8, 70), (0.65, 75), (0.5, 75))  # share of the size, quality: the first that fits


def enlarge_words(figure: Any) -> None:
    """Give words of a figure that would be smaller than LETTERS on the site that size."""
    from matplotlib.text import Text

    least = LETTERS / COLUMN * 72 * figure.get_figwidth()  # points
    for axes in figure.axes:
        for name, axis in (("x", axes.xaxis), ("y", axes.yaxis)):
            if any(text.get_fontsize() < least for text in axis.get_ticklabels()):
                axes.tick_params(axis=name, labelsize=least)
    for text in figure.findobj(Text):
        text.set_fontsize(max(text.get_fontsize(), least))


def save_picture(figure: Any, path: Path) -> None:
    """Write a figure as a PNG with at most COLOURS colours, or as WebP, by the ending of `path`; its words are legible.

    Raises ValueError where no quality and size give a file of at most LARGEST_PICTURE bytes.
    """
    from PIL import Image

    write_signs(figure)
    enlarge_words(figure)
    drawn = made_by(figure.savefig, format="png", dpi=DOTS_PER_INCH)
    image = Image.open(io.BytesIO(drawn)).convert("RGB")
    for share, quality in WEBP if path.suffix == ".webp" else ((1.0, 0),):
        if quality:
            size = round(share * image.width), round(share * image.height)
            smaller = image.resize(size, Image.Resampling.LANCZOS)
            coded = made_by(smaller.save, "WEBP", quality=quality, method=6)
        else:
            palette = image.quantize(COLOURS, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
            coded = made_by(palette.save, "PNG", optimize=True)
        if len(coded) <= LARGEST_PICTURE:
            write_file(path, coded, "picture")
            return
    raise ValueError(
        f"{path.name} takes {len(coded)} bytes, more than {LARGEST_PICTURE}: draw less, or mark it shaded."
    )


SIGNS = {
    "rho0": "\N{GREEK SMALL LETTER RHO}\N{SUBSCRIPT ZERO}", "rho": "\N{GREEK SMALL LETTER RHO}",
    "alpha": "\N{GREEK SMALL LETTER ALPHA}", "beta": "\N{GREEK SMALL LETTER BETA}",
    "sigma": "\N{GREEK SMALL LETTER SIGMA}", "gamma": "\N{GREEK SMALL LETTER GAMMA}",
    "lambda": "\N{GREEK SMALL LETTER LAMDA}", "mu": "\N{GREEK SMALL LETTER MU}", "nu": "\N{GREEK SMALL LETTER NU}",
    "eps": "\N{GREEK SMALL LETTER EPSILON}", "pi": "\N{GREEK SMALL LETTER PI}", "^2": "\N{SUPERSCRIPT TWO}",
    "^3": "\N{SUPERSCRIPT THREE}",
}  # fmt: skip
SPELT = re.compile("|".join(rf"\b{word}(?![A-Za-z])" if word.isalnum() else re.escape(word) for word in SIGNS))


def write_signs(figure: Any) -> None:
    """Write signs in all words of a figure but those of its ticks, which the axes write themselves."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        text.set_text(signs(text.get_text()))


def signs(text: str) -> str:
    """Words with Greek letters and superscripts in place of their names, if they hold no formula."""
    return text if "$" in text else SPELT.sub(lambda spelt: SIGNS[spelt[0]], text)


def shortened(value: Any) -> Any:
    """Plain values with DIGITS significant digits: more are not seen, and do not compress."""
    if isinstance(value, dict):
        return {key: shortened(each) for key, each in value.items()}
    if isinstance(value, list):
        return [shortened(each) for each in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def packed(values: NDArray) -> str:
    """Whole numbers (n,) or (n, c) as text: differences from row to row, compressed."""
    rows = np.diff(values, axis=0, prepend=np.zeros_like(values[:1]))
    return base64.b64encode(zlib.compress(np.ascontiguousarray(rows.T).tobytes(), 9)).decode()


def unpacked(text: str, dtype: str, columns: int = 1) -> NDArray:
    """What was packed: (n,), or (n, columns)."""
    rows = np.frombuffer(zlib.decompress(base64.b64decode(text)), dtype).reshape(columns, -1).T
    values = np.cumsum(rows, axis=0, dtype=dtype)
    return values if columns > 1 else values[:, 0]


def read_data(folder: Path, name: str) -> Any:
    """Data of a picture. Raises OSError or ValueError where there is no such file, or another."""
    data = _read(folder, name)
    data.pop(MEASURED, None)
    return data


def read_origin(folder: Path, name: str) -> Mapping[str, Any]:
    """Date, commit, machine and command of a picture's data. Raises OSError or ValueError as `read_data`."""
    return _read(folder, name).get(MEASURED, {})


def _read(folder: Path, name: str) -> Any:
    long = folder / f"{name}.json.gz"
    return read_json(long if long.exists() else folder / f"{name}.json")


@contextlib.contextmanager
def style() -> Iterator[None]:
    """Matplotlib without a screen, in the project's style."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    with plt.rc_context({
        "font.size": 9.5, "axes.titlesize": 10.5, "axes.titleweight": "bold", "axes.titlelocation": "left",
        "axes.spines.top": False, "axes.spines.right": False, "axes.edgecolor": "#444444",
        "axes.labelcolor": "#222222", "axes.axisbelow": True, "grid.color": "#dddddd", "grid.linewidth": 0.7,
        "lines.linewidth": 1.8, "legend.frameon": False, "legend.fontsize": 8.5,
        "figure.constrained_layout.use": True, "figure.facecolor": "white",
    }):  # fmt: skip
        yield


def view_matrix(azimuth: float, elevation: float) -> NDArray[np.float64]:
    """Rows: to the right, up, and towards the viewer, who stands at these angles [degrees]."""
    return np.stack(Camera(azimuth, elevation).axes(UP))


def ball_picture(
    position: ArrayLike, radius: float, colour: ArrayLike, view: NDArray, extent: float, pixels: int = 640
) -> NDArray[np.float64]:
    """Balls seen in parallel projection: an image (pixels, pixels, 4) with clear ground.

    position (n, 3), radius and half width `extent` in one unit; colour (n, 3) in 0..1.
    """
    balls = Body(np.asarray(position, dtype=float), None, np.asarray(colour, dtype=float), radius=radius)
    return body_picture([balls], view, extent, pixels)


def surface_picture(
    vertices: ArrayLike, facets: ArrayLike, colour: ArrayLike, view: NDArray, extent: float, pixels: int = 640
) -> NDArray[np.float64]:
    """A closed mesh seen in parallel projection: an image (pixels, pixels, 4) with clear ground.

    vertices (v, 3), facets (f, 3) with outward normals, half width `extent` in the vertices' unit; colour (3,).
    """
    mesh = Body(np.asarray(vertices, dtype=float), np.asarray(facets), np.asarray(colour, dtype=float), gloss=0.5)
    return body_picture([mesh], view, extent, pixels)


def body_picture(bodies: Sequence[Body], view: NDArray, extent: float, pixels: int = 640) -> NDArray[np.float64]:
    """Bodies seen together in parallel projection: an image (pixels, pixels, 4) with clear ground.

    Without PyVista they are drawn plainly, and standard error says so once.
    """
    if importlib.util.find_spec("pyvista") is None:
        _say_plain()
        return _plain_picture(bodies, view, extent, pixels)
    right, _, towards = view
    azimuth, elevation = np.degrees([np.arctan2(-right[0], right[1]), np.arcsin(np.clip(towards[2], -1.0, 1.0))])
    corner = np.full(3, extent)
    stage = Stage(-corner, corner, UP, Camera(azimuth, elevation), (pixels, pixels), half_height=extent)
    return stage.draw_clear(bodies)


@functools.cache
def _say_plain() -> None:
    print(
        "PyVista is not installed: pictures in 3D are drawn without smooth shading; pip install pyvista draws them with"
        " it.",
        file=sys.stderr,
    )


def _plain_picture(bodies: Sequence[Body], view: NDArray, extent: float, pixels: int) -> NDArray[np.float64]:
    """The bodies as flat facets and discs, the farthest first."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure

    turn = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    disc = np.stack((np.cos(turn), np.sin(turn)), axis=1)
    outlines: list[NDArray] = []
    depths, colours = [], []
    for body in bodies:
        seen = body.points @ view.T
        colour = np.broadcast_to(np.asarray(body.colour, dtype=float), (len(seen), 3))
        if body.facets is None:
            outlines += list(seen[:, None, :2] + body.radius * disc)
            depths.append(seen[:, 2])
            colours.append(0.75 * colour + 0.25 * (seen[:, 2:] / extent).clip(-1, 1))  # nearer balls are lighter
            continue
        corners = seen[body.facets]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True).clip(min=1e-300)
        light = 0.35 + 0.65 * (normal @ (-0.37, 0.46, 0.81)).clip(0, 1)
        outlines += list(corners[..., :2])
        depths.append(corners[..., 2].mean(axis=1))
        colours.append(light[:, None] * colour[body.facets[:, 0]])
    order = np.argsort(np.concatenate(depths))
    faces = np.concatenate(colours)[order].clip(0, 1)
    drawn = PolyCollection([outlines[k] for k in order], facecolors=faces, edgecolors=0.8 * faces, linewidths=0.2)
    figure = Figure(figsize=(1, 1), dpi=pixels, layout="none")
    figure.patch.set_alpha(0.0)
    axes = figure.add_axes((0, 0, 1, 1), xlim=(-extent, extent), ylim=(-extent, extent))
    axes.set_axis_off()
    axes.add_collection(drawn)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba(), dtype=float) / 255.0


def show_image(axes: Any, image: NDArray, extent: float) -> None:
    """Put a rendered image on axes without frame."""
    axes.imshow(image, extent=(-extent, extent, -extent, extent), interpolation="antialiased")
    axes.set_axis_off()


def show_balls(
    axes: Any, position: ArrayLike, spacing: float, colour: ArrayLike, view: NDArray, extent: float, pixels: int
) -> None:
    """Balls one spacing thick on axes without frame."""
    x = np.asarray(position, dtype=float)
    show_image(axes, ball_picture(x, 0.5 * spacing, np.broadcast_to(colour, x.shape), view, extent, pixels), extent)


def thousandths(position: NDArray) -> NDArray[np.int64]:
    """Places in thousandths of their unit."""
    return np.rint(1000 * position).astype(int)


def plain_title(axes: Any, title: str, **look: Any) -> None:
    """A title in the middle, not bold."""
    axes.set_title(title, loc="center", fontweight="normal", **look)


def caption(axes: Any, text: str, **look: Any) -> None:
    """Words under the middle of a panel."""
    look = {"x": 0.5, "y": -0.02, "ha": "center", "va": "top", "fontsize": 8, "color": GREY} | look
    axes.text(s=text, transform=axes.transAxes, **look)


def headline(figure: Any, text: str, fontsize: float = 11) -> None:
    """What a picture shows, above its panels, from the left."""
    figure.suptitle(text, fontweight="bold", x=0.01, ha="left", fontsize=fontsize)


def shared_legend(figure: Any, panels: Iterable[Any], more: Mapping[str, Any] | None = None, **look: Any) -> None:
    """One legend under all panels, each label once."""
    handles: dict[str, Any] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels()):
            handles.setdefault(label, handle)
    handles |= more or {}
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", **look)


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
