"""A run as one page for the browser: particles as lit balls, turned, played, coloured and clipped, without a server."""

import base64
import gzip
import html
import json
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim.core.errors import InputError
from refsim.core.writing import write_file
from refsim.render.looks import MAP, OBSTACLE, level_axes, liquid_colour, solid_colour
from refsim.render.saved_run import SavedRun, chosen_frames, open_run, usual_range

PAGE = Path(__file__).with_name("page.html")
FIELDS = 8  # shown where the caller names none, so that 60,000 particles over 50 frames take less than 60 MB
FIRST = ("velocity", "part", "pressure", "density", "temperature", "surface", "volume_ratio", "phase")
STEPS = 65535  # of the grid on which places are stored
LEVELS = 255  # of a field's values
HEIGHT = 560  # of the page inside of a notebook [pixels]


@dataclass(frozen=True)
class View:
    """A page that shows a run. In a notebook, the last value of a cell shows it there."""

    html: str  # the page
    left_out: tuple[str, ...] = ()  # fields of the run that it does not hold

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the page to a file. Raises as `refsim.core.writing.write_file` does."""
        write_file(path, self.html, "page")
        return Path(path)

    def _repr_html_(self) -> str:
        page = html.escape(self.html)
        return f'<iframe srcdoc="{page}" style="width: 100%; height: {HEIGHT}px; border: 0"></iframe>'


def view(run: str | os.PathLike[str], frames: str | None = None, fields: Sequence[str] | None = None) -> View:
    """The page of a run in the folder `run`.

    frames  such as "0:100:2"; all by default
    fields  quantities by which it can be coloured; the eight that matter most by default

    Raises InputError where there is no such run, frame or field.
    """
    saved = open_run(run)
    chosen = chosen_frames(frames or "all", len(saved.files))
    names, left_out = _fields(saved, fields)
    loaded = [frame.sorted() for frame in saved.frames(chosen)]  # each particle keeps its place from frame to frame
    counts = set(map(len, loaded))
    if len(counts) > 1 or counts == {0}:
        raise InputError(f"{saved.files.folder} has frames of {sorted(counts)} particles; show frames of one number.")
    low, high = saved.bounds(chosen)
    if saved.dim == 2:
        low[2], high[2] = -0.5 * saved.spacing, 0.5 * saved.spacing
    blobs = {"places": _packed_places(list(map(saved.position, loaded)), low, high)}
    shown: list[dict[str, Any]] = []
    for name in names:
        values = np.array([saved.values(frame, name) for frame in loaded])
        ends = _ends(values, name)
        if ends is None and fields is None:
            continue  # one value everywhere
        ends = ends or (float(values.flat[0]), float(values.flat[0]))
        blobs[f"field{len(shown)}"] = _packed_values(values, *ends)
        words = {"name": name, "label": saved.label(name), "unit": saved.unit(name)}
        shown.append(words | {"low": ends[0], "high": ends[1]})
    head = _head(saved, chosen, len(loaded[0]), low, high) | {"fields": shown}
    if saved.mesh is not None:
        import trimesh

        mesh = saved.mesh.mesh
        normals = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).vertex_normals
        corners = (mesh.vertices + mesh.origin)[mesh.faces]
        blobs["mesh"] = np.stack([corners, normals[mesh.faces]]).astype("<f4").tobytes()
    return View(_page(saved.plan.scene.name, head, blobs), left_out)


def _page(title: str, head: dict[str, Any], blobs: dict[str, bytes]) -> str:
    """The page with what its marks stand for, each escaped; marks inside of that are text."""
    data = "\n".join(
        f'<script id="{name}" type="text/plain">{base64.b64encode(gzip.compress(blob, 6, mtime=0)).decode()}</script>'
        for name, blob in blobs.items()
    )
    head_json = json.dumps(head, allow_nan=False).replace("<", "\\u003c")
    marks = {"@TITLE@": html.escape(title), "@HEAD@": head_json, "@DATA@": data}
    return re.sub("|".join(marks), lambda mark: marks[mark[0]], PAGE.read_text(encoding="utf-8"))


def _fields(run: SavedRun, wanted: Sequence[str] | None) -> tuple[list[str], tuple[str, ...]]:
    """Names of the fields that are shown, and of those that are left out."""
    known = run.quantities()
    if wanted is not None:
        unknown = [name for name in wanted if name.partition(".")[0] not in known]
        if unknown or not wanted:
            raise InputError(
                f"{run.files.folder} has no field {', '.join(map(repr, unknown)) or 'of no name'}; give some of"
                f" {', '.join(known)}."
            )
        return list(wanted), ()
    usual = [name for name in known if name == "part" or run.files.fields[name].components in (1, 3)]
    usual.sort(key=lambda name: (FIRST.index(name) if name in FIRST else len(FIRST), name))
    return usual[:FIELDS], tuple(usual[FIELDS:])


def _packed_places(positions: Sequence[NDArray], low: NDArray, high: NDArray) -> bytes:
    """16 bits for each coordinate: zigzag codes of the changes since the last frame, high bytes first, then low."""
    shares = (np.array(positions, dtype=np.float64) - low) / np.where(high > low, high - low, 1.0)
    grid = np.rint(shares.clip(0, 1) * STEPS).astype(np.uint16)
    change = np.diff(grid, axis=0, prepend=np.zeros_like(grid[:1])).view(np.int16)  # modulo 2^16
    code = ((change.astype(np.int32) << 1) ^ (change.astype(np.int32) >> 15)).astype(np.uint16).reshape(-1)
    return (code >> 8).astype(np.uint8).tobytes() + (code & 255).astype(np.uint8).tobytes()


def _packed_values(values: NDArray, low: float, high: float) -> bytes:
    """8 bits for each value: the change since the last frame, modulo 256."""
    share = np.nan_to_num((values - low) / (high - low if high > low else 1.0))
    level = np.rint(share.clip(0, 1) * LEVELS).astype(np.uint8)
    return np.diff(level, axis=0, prepend=np.zeros_like(level[:1])).tobytes()


def _ends(values: NDArray, name: str) -> tuple[float, float] | None:
    """Ends of the colour bar; None for one value everywhere."""
    if name == "part":
        return (0.0, float(LEVELS))
    ends = usual_range(values)
    return ends if ends is not None and ends[0] < ends[1] else None


def _head(run: SavedRun, chosen: Sequence[int], count: int, low: NDArray, high: NDArray) -> dict[str, Any]:
    """What the page needs to know beside the arrays."""
    import matplotlib

    east, north = level_axes(run.up)
    parts = [solid_colour(k) for k in range(run.solids)]
    parts += [liquid_colour(k) for k in range(len(run.plan.state.sizes) - run.solids)]
    palette = [[round(255 * c) for c in parts[min(k, len(parts) - 1)]] for k in range(LEVELS + 1)]
    ramp = (255 * matplotlib.colormaps[MAP](np.linspace(0, 1, LEVELS + 1))[:, :3]).round().astype(int).tolist()
    seen = run.seen(chosen)
    box = None if run.box is None else np.clip(run.box, *seen)  # as high as the particles reach
    places = {"low": low, "extent": high - low, "up": run.up, "east": east, "north": north, "box": box}
    places |= {"seen": seen, "tint": OBSTACLE}
    head = {name: None if place is None else np.array(place).tolist() for name, place in places.items()}
    head |= {"title": run.plan.scene.name, "particles": count, "times": run.files.times[chosen].tolist()}
    head |= {"spacing": run.spacing, "flat": run.dim == 2, "mesh": run.mesh is not None}
    return head | {"ramp": ramp, "parts": palette}
