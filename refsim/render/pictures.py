"""Pictures and films of a run: what is shown of each frame, its labels, and the files."""

import errno
import logging
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim.core.errors import InputError
from refsim.core.stopping import held_back
from refsim.core.terminal import Bar, wanted
from refsim.core.writing import made_by, output_path, replaced_at_the_end, write_file, writing
from refsim.io.results import RunFrame
from refsim.isosurface import Mesh
from refsim.render import looks, space
from refsim.render.plane import add_area, add_discs, add_line
from refsim.render.saved_run import USUAL, SavedRun, chosen_frames, open_run, usual_range
from refsim.render.surfaces import CELL, surface_around

SIZE = (1280, 960)
STILL = 0.02  # spacings
PER_SECOND = 25  # pictures of a film
LEAST_FREE = 1 << 20  # bytes of a disk below which it counts as full
FORMATS = {".png": "png", ".webp": "webp", ".jpg": "jpeg"}
INK = "#1f2933"
CLEAR = 0.6  # share of white in the area of water in 2D
WET_LINE = 0.6  # brightness of the line of its free surface, of the liquid's colour
BACKGROUNDS = {"paper": "white", "water": "#e9eef2", "particles": "white"}


@dataclass(frozen=True)
class Look:
    """How a run is drawn."""

    style: str = "paper"  # opaque surfaces; "water", clear ones; or "particles"
    colour: str | None = None  # quantity of the run that colours liquid and solids; None: the parts' own colours
    limits: tuple[float, float] | None = None  # of the colour bar; None: 0.5 % of a frame may lie beyond either
    camera: str | None = None  # "azimuth,elevation[,zoom]" [degrees]
    cut: str | None = None  # "x=0" leaves away the viewer's side of that plane [m]
    size: tuple[int, int] = SIZE  # of a picture in pixels, width and height

    def check(self) -> None:
        """Raise InputError for a look that does not exist."""
        if self.style not in looks.STYLES:
            raise InputError(f"--style {self.style!r} is unknown; choose one of {', '.join(looks.STYLES)}.")
        if min(self.size) < 64 or max(self.size) > 8192:
            raise InputError(f"--size {self.size[0]}x{self.size[1]} is not possible; give 64 to 8192 pixels.")
        if self.limits is not None and not (np.isfinite(self.limits).all() and self.limits[0] < self.limits[1]):
            raise InputError(f"--limits {self.limits[0]},{self.limits[1]} is no range; give a smaller number first.")


class Series:
    """Pictures of some frames of a run: one camera, one range of colours.

    per_second  pictures of a second of film, whose pace the label of the time tells; None for single pictures

    Raises InputError for a look that does not exist or that the run cannot have.
    """

    def __init__(self, run: SavedRun, look: Look, chosen: Sequence[int], per_second: float | None = None) -> None:
        look.check()
        self.run, self.look, self.chosen = run, look, list(chosen)
        self.camera = looks.camera_of(look.camera)
        towards = self.camera.axes(run.up)[2]
        self.cut = looks.cut_of(look.cut, towards, run.dim, run.plan.grid.origin)
        self.low, self.high = run.seen(self.chosen)
        self.wall = run.wall_distance()
        self.limits = self._limits(look.colour) if look.colour is not None and look.limits is None else look.limits
        apart = np.diff(run.files.times[self.chosen])
        self.pace = "" if per_second is None or not len(apart) else pace(per_second * float(np.median(apart)))
        self.stage = self._stage(space.SUPERSAMPLING if per_second is None else 1)

    def _limits(self, colour: str) -> tuple[float, float]:
        ends = usual_range(self.run.values(f, colour) for f in self.run.frames(self.chosen))
        if ends is None:
            raise InputError(f"{colour!r} has no finite value in these frames; colour by another quantity.")
        low, high = ends
        return (low, high) if low < high else (low - 0.5 * (abs(low) or 1.0), high + 0.5 * (abs(high) or 1.0))

    def __iter__(self) -> Iterator[tuple[int, NDArray[np.uint8]]]:
        """(number of the frame, picture (height, width, 3)), one after another."""
        with nullcontext() if self.run.dim == 2 else self.stage.kept():
            for number, frame in zip(self.chosen, self.run.frames(self.chosen)):
                yield number, self.picture(frame)

    def picture(self, frame: RunFrame) -> NDArray[np.uint8]:
        """The picture (height, width, 3) of one frame."""
        if self.run.dim == 2:
            return self._in_plane(frame)
        return self._labelled(self.stage.draw(list(self._bodies(frame))), frame)

    # What is seen

    def _paint(self, frame: RunFrame) -> NDArray[np.float64]:
        """Of the particles: places (n, 1) on the colour bar, 0 to 1, or colours (n, 3) where there is none."""
        if self.look.colour is not None:
            assert self.limits is not None
            values = self.run.values(frame, self.look.colour)
            share = (values - self.limits[0]) / (self.limits[1] - self.limits[0])
            return np.nan_to_num(share.clip(0, 1))[:, None]
        part, solid = self.run.part(frame), self.run.solid_body(frame) >= 0
        melting = self.run.plan.effects.get("melting")
        as_water = getattr(melting, "bookkeeping", "") == "water"
        result = np.zeros((len(part), 3))
        for number in np.unique(part):
            inside = part == number
            if number >= self.run.solids:
                result[inside] = looks.liquid_colour(int(number) - self.run.solids)
            else:
                result[inside & solid] = looks.solid_colour(int(number))
                result[inside & ~solid] = looks.liquid_colour(0) if as_water else looks.melt_colour(int(number))
        return result

    def _colours(self, paint: NDArray) -> NDArray[np.float64]:
        """(n, 3) colours of what `_paint` gives."""
        if paint.shape[1] == 3:
            return paint
        import matplotlib

        return matplotlib.colormaps[looks.MAP](paint[:, 0])[:, :3]

    def _shown(self, frame: RunFrame) -> tuple[NDArray, NDArray, NDArray]:
        """Places, paint and bodies of the particles that are drawn: before the cut, and not far beside the picture."""
        position, far = self.run.position(frame), float((self.high - self.low).max()) / min(self.camera.zoom, 1.0)
        seen = np.asarray(((position > self.low - far) & (position < self.high + far)).all(1))
        if self.cut is not None and self.look.style == "particles":
            seen &= self.cut(position) <= 0
        return position[seen], self._paint(frame)[seen], self.run.solid_body(frame)[seen]

    def _surface(self, points: NDArray, liquid: bool) -> Mesh:
        cell, solid = CELL if self.run.dim == 3 else 0.5 * CELL, self.run.mesh
        around = (None if solid is None else solid.distance, self.run.closed_box) if liquid else ()
        return surface_around(points, self.run.spacing, self.run.dim, cell, *around)

    def _bodies(self, frame: RunFrame) -> Iterator[space.Body]:
        x, paint, body = self._shown(frame)
        light = space.SHADED if self.look.colour is None else space.MILD
        if self.look.style == "particles":
            gloss = 0.3 if light == space.SHADED else 0.0
            yield space.Body(x, None, self._colours(paint), radius=0.5 * self.run.spacing, light=light, gloss=gloss)
        else:
            for number in np.unique(body):
                members = body == number
                mesh = self._surface(x[members], number < 0)
                if not len(mesh.facets):
                    continue
                points, facets = self._cut(space.smoothed(mesh.vertices, mesh.facets), mesh.facets)
                shade = self._colours(_from_particles(points, x[members], paint[members], self.run.spacing))
                if light == space.SHADED:
                    clear, gloss = self.look.style == "water" and number < 0, 0.45 if number < 0 else 0.15
                    yield space.Body(points, facets, shade, water=clear, gloss=gloss, edges=self.cut is not None)
                    continue
                on_cut = np.zeros(len(facets), bool)
                if self.cut is not None:
                    on_cut = (np.abs(self.cut(points)) < 1e-3 * self.run.spacing)[facets].all(1)
                for part, its in ((facets[~on_cut], space.MILD), (facets[on_cut], space.FLAT)):
                    if len(part):
                        yield space.Body(points, part, shade, gloss=0.0, light=its)
        solid = self.run.mesh
        if solid is not None:
            points, facets = self._cut(solid.mesh.vertices + solid.mesh.origin, solid.mesh.faces)
            yield space.Body(points, facets, looks.OBSTACLE, gloss=0.1, edges=True)

    def _cut(self, points: NDArray, facets: NDArray) -> tuple[NDArray, NDArray]:
        if self.cut is None or not (self.cut(points) > 0).any():
            return points, facets
        return space.cut_closed(points, facets, self.cut, self.run.spacing)

    # Drawing

    def _stage(self, finer: int) -> space.Stage:
        """What pictures in 3D share."""
        run, box = self.run, self.run.box
        tank = None if box is None else (np.maximum(box[0], self.low), np.minimum(box[1], self.high))
        sky = BACKGROUNDS[self.look.style]
        return space.Stage(self.low, self.high, run.up, self.camera, self.look.size, tank, background=sky, finer=finer)

    def _labelled(self, image: NDArray, frame: RunFrame) -> NDArray[np.uint8]:
        """The image with time, scale bar and colour bar on it."""
        figure, time = self.labels
        time.set_text(self._time(frame))
        over = _drawn(figure)
        at = over[..., 3] > 0
        share = over[at][:, 3:] / 255.0
        result = image.copy()
        result[at] = np.rint((1.0 - share) * image[at] + share * over[at][:, :3])
        return result

    @cached_property
    def labels(self) -> tuple[Any, Any]:
        """Of a picture in 3D: a figure of its labels on nothing, and the text of the time in it."""
        figure, axes = self._sheet()
        figure.patch.set_alpha(0.0)
        metres_a_pixel = 2.0 * self.stage.frame()[1] / self.stage.size[1]
        return figure, self._labels(figure, axes, metres_a_pixel)

    def _in_plane(self, frame: RunFrame) -> NDArray[np.uint8]:
        figure, axes = self._sheet()
        width, height = self.look.size
        size = self.high - self.low
        inner = width * (1 - 2 * space.SIDES), height * (1 - space.BOTTOM - space.TOP)
        metres = max(size[0] / inner[0], size[1] / inner[1]) / self.camera.zoom
        middle = 0.5 * (self.low + self.high)
        at = middle[:2] - 0.5 * metres * np.array([width, height * (1 + space.BOTTOM - space.TOP)])

        def pixels(points: NDArray) -> NDArray[np.float64]:
            return np.pad((np.asarray(points, dtype=float)[:, :2] - at) / metres, ((0, 0), (0, 1)))

        (x, paint, body), radius = self._shown(frame), 0.5 * self.run.spacing / metres
        if self.look.style == "particles":
            add_discs(axes, pixels(x), radius, self._colours(paint))
        else:
            for number in np.unique(body):
                self._area(axes, x[body == number], paint[body == number], number < 0, pixels, radius)
            if self.cut is not None:
                self._cover(axes, float(pixels(np.full((1, 3), self.cut.place))[0, self.cut.axis]))
        if self.run.box is not None:
            self._tank(axes, pixels)
        axes.set(xlim=(0, width), ylim=(0, height))
        self._labels(figure, axes, metres).set_text(self._time(frame))
        return _drawn(figure)[..., :3].copy()

    def _area(
        self, axes: Any, x: NDArray, paint: NDArray, liquid: bool, pixels: Callable[[NDArray], NDArray], radius: float
    ) -> None:
        """A body of particles at x (n, 3) [m], `radius` pixels each: its area and outline."""
        mesh, places = self._surface(x, liquid), pixels(x)
        vertices, facets = pixels(mesh.vertices), mesh.facets
        water, one = self.look.style == "water" and liquid, bool((paint == paint[0]).all())

        def colours(at: NDArray) -> NDArray[np.float64]:
            painted = self._colours(_from_particles(at, places, paint, 2.0 * radius))
            return painted + CLEAR * (1.0 - painted) if water and self.look.colour is None else painted

        add_area(axes, vertices, facets, colours(places[:1])[0] if one else colours, 0.75 * radius)
        line = (WET_LINE if water else 0.7) * self._colours(paint[:1])[0] if one or water else np.full(3, 0.2)
        if water and self.wall is not None and len(facets):
            middle = mesh.vertices[facets].mean(1, dtype=float)
            facets = facets[self.wall(middle) > 0.5 * self.run.spacing]
        add_line(axes, vertices, facets, line, 2.4 if water else 1.0)

    def _cover(self, axes: Any, place: float) -> None:
        """Hide what lies on the side of the cut, at `place` in pixels, that is left away."""
        assert self.cut is not None
        span, end = (axes.axvspan, axes.axhspan)[self.cut.axis], float(self.look.size[self.cut.axis])
        low, high = (place, end) if self.cut.side > 0 else (0.0, place)
        span(low, high, facecolor=axes.figure.get_facecolor(), zorder=2)

    def _tank(self, axes: Any, pixels: Callable[[NDArray], NDArray]) -> None:
        box = np.asarray(self.run.box)
        corners = box.clip(self.low, self.high)
        (x0, y0, _), (x1, y1, _) = pixels(corners)
        ends = (((x0, x0), (y0, y1)), ((x0, x1), (y0, y0)), ((x1, x1), (y0, y1)), ((x0, x1), (y1, y1)))
        seen = (corners == box)[:, :2].ravel()
        for face, line, shown in zip(("-x", "-y", "+x", "+y"), ends, seen):
            if shown and face not in self.run.walls.open_faces:
                axes.plot(*line, color="#6b7178", linewidth=2.0, solid_capstyle="projecting")

    def _sheet(self) -> tuple[Any, Any]:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        width, height = self.look.size
        dots = height / 6.4
        figure = Figure(figsize=(width / dots, height / dots), dpi=dots, facecolor=BACKGROUNDS[self.look.style])
        FigureCanvasAgg(figure)
        axes = figure.add_axes((0, 0, 1, 1))
        axes.set_axis_off()
        return figure, axes

    def _time(self, frame: RunFrame) -> str:
        return f"t = {frame.time:.4g} s{self.pace}"

    def _labels(self, figure: Any, axes: Any, metres: float) -> Any:
        """Draw the scale bar and the colour bar; returns the text for the time."""
        width, height = self.look.size
        length = space.bar_length(metres * width)
        x, y, long = 0.04 * width, 0.04 * height, length / metres
        axes.plot([x, x + long], [y, y], color=INK, linewidth=3.0, solid_capstyle="butt")
        axes.text(x + 0.5 * long, y + 0.012 * height, _metric(length), color=INK, ha="center", va="bottom", fontsize=13)
        time = axes.text(x, 0.97 * height, "", color=INK, ha="left", va="top", fontsize=14)
        axes.set(xlim=(0, width), ylim=(0, height))
        if self.look.colour is None or self.limits is None:
            return time
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import Normalize

        unit = self.run.unit(self.look.colour)
        place = figure.add_axes((0.60, 0.055, 0.35, 0.022))
        title = self.run.label(self.look.colour) + (f" [{unit}]" if unit else "")
        bar = figure.colorbar(
            ScalarMappable(Normalize(*self.limits), looks.MAP), cax=place, orientation="horizontal", extend="both"
        )
        bar.outline.set_visible(False)
        bar.ax.tick_params(labelsize=13, colors=INK)
        bar.ax.set_title(title, fontsize=14, color=INK, pad=5)
        return time


def pace(seconds: float) -> str:
    """What a label of the time says of a film that shows so many simulated seconds in one; "" at their own pace."""
    slower = max(seconds, 1 / seconds)
    return f", {slower:.2g} times {'faster' if seconds > 1 else 'slower'}" if slower > 1.05 else ""


def moving(run: SavedRun, chosen: Sequence[int]) -> list[int]:
    """The chosen frames without those in which, since the last one that is kept, at most 0.5 % of the particles moved
    by a share STILL of their spacing; the first one is kept, and so is the last if nothing moves at all.
    """
    kept: list[int] = []
    last = np.zeros(0)
    for number, frame in zip(chosen, run.frames(chosen)):
        x = frame.sorted().position
        if last.shape != x.shape or np.quantile(((x - last) ** 2).sum(1), USUAL[1]) > (STILL * run.spacing) ** 2:
            kept.append(number)
            last = x
    return kept if len(kept) > 1 else [chosen[0], chosen[-1]]


def _metric(length: float) -> str:
    for unit, factor in (("km", 1e-3), ("m", 1.0), ("cm", 1e2), ("mm", 1e3)):
        if length * factor >= 0.999:
            return f"{length * factor:.4g} {unit}"
    return f"{length * 1e6:.4g} µm"


def _drawn(figure: Any) -> NDArray[np.uint8]:
    """(height, width, 4) pixels of a figure."""
    figure.canvas.draw()
    return np.asarray(figure.canvas.buffer_rgba())


def _from_particles(places: NDArray, position: NDArray, values: NDArray, spacing: float) -> NDArray[np.float64]:
    """(k, c) values at `places` (k, 3): the mean of those (n, c) of the particles around each."""
    from scipy.spatial import cKDTree

    if not len(places) or (values == values[0]).all():
        return np.broadcast_to(values[0], (len(places), values.shape[1]))
    number = min(8, len(position))
    distance, near = cKDTree(position).query(places, k=number)
    distance, near = distance.reshape(-1, number), near.reshape(-1, number)
    weight = np.exp(-(distance**2 - distance[:, :1] ** 2) / (0.5 * spacing**2))
    return (weight[..., None] * values[near]).sum(1) / weight.sum(1)[:, None]


def write_pictures(
    run: str | os.PathLike[str], look: Look, frames: str | None = None, output: str | os.PathLike[str] = "picture.png"
) -> list[Path]:
    """Write a picture for each chosen frame: `output`, or with several frames NAME_0012.png for frame 12.

    Raises InputError for a run, look or path that is not possible.
    """
    path = output_path(output, "picture", *FORMATS)
    from PIL import Image

    saved = open_run(run)
    series = Series(saved, look, chosen_frames(frames, len(saved.files)))
    written = []
    for number, image in series:
        each = path if len(series.chosen) == 1 else path.with_stem(f"{path.stem}_{number:04d}")
        drawn = made_by(Image.fromarray(image).save, format=FORMATS[path.suffix])
        write_file(each, drawn, "picture", "pictures before it are whole")
        written.append(each)
    return written


def write_film(
    run: str | os.PathLike[str], look: Look, frames: str | None = None, output: str | os.PathLike[str] = "film.mp4",
    per_second: float = PER_SECOND,
) -> Path:  # fmt: skip
    """Write a film (H.264) of the chosen frames, by default of those in which something moves, `per_second` a second.

    Raises InputError where imageio-ffmpeg is not installed, and for a run, look or path that is not possible.
    """
    path = output_path(output, "film", ".mp4")
    if not 0.1 <= per_second <= 240:
        raise InputError(f"--per-second {per_second:g} is not possible; give 0.1 to 240 pictures a second.")
    try:
        import imageio_ffmpeg

        imageio_ffmpeg.get_ffmpeg_exe()
    except (ImportError, RuntimeError):  # RuntimeError: the package is there and its program is not
        raise InputError('films need imageio-ffmpeg, which is not installed; `pip install "refsim[view]"`.') from None
    saved = open_run(run)
    width, height = (n - n % 2 for n in look.size)
    every = chosen_frames(frames or "all", len(saved.files))
    series = Series(saved, look, every if frames else moving(saved, every), per_second)
    kept = writing("film", path, "what was there is untouched")
    with kept, replaced_at_the_end(path) as beside, ExitStack() as at_the_end:
        logging.getLogger("imageio_ffmpeg").setLevel(logging.ERROR)  # it warns of a film that is stopped
        film = imageio_ffmpeg.write_frames(
            str(beside), (width, height), fps=per_second, codec="libx264", quality=None, macro_block_size=2,
            ffmpeg_log_level="quiet",  # what it refuses is told in one sentence
            output_params=[
                *("-crf", "20", "-preset", "medium", "-threads", "1"), *("-x264-params", "rc-lookahead=3"),  # memory
                *("-movflags", "+faststart", "-f", "mp4"),
            ],
        )  # fmt: skip
        at_the_end.callback(film.close)
        with held_back():
            film.send(None)
        bar = Bar(len(series.chosen), shown=wanted())
        at_the_end.callback(bar.close)
        for number, (_, image) in enumerate(series, 1):
            try:
                film.send(np.ascontiguousarray(image[:height, :width]))
            except OSError:
                raise _refused_by_ffmpeg(path) from None
            bar.to(number, f"{number} of {len(series.chosen)} pictures")
        film.close()
        try:
            frames_written, _ = imageio_ffmpeg.count_frames_and_secs(str(beside))
        except (OSError, RuntimeError):
            frames_written = 0
        if frames_written != len(series.chosen):
            raise _refused_by_ffmpeg(path)
    return path


def _refused_by_ffmpeg(path: Path) -> OSError:
    """The error where ffmpeg, which gives no number of the system, could not write a film."""
    number = errno.ENOSPC if shutil.disk_usage(path.parent).free < LEAST_FREE else errno.EIO
    return OSError(number, os.strerror(number))
