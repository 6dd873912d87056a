"""A finished run read back: its frames, and what its scene says about its particles."""

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim.boundary.one_way_coupling import MeshBoundary
from refsim.boundary.one_way_coupling.placing import PlacedSolid
from refsim.core.errors import InputError
from refsim.io.results import Run, RunFrame
from refsim.render.surfaces import Distance, depth
from refsim.scene.plan import Plan, make_plan
from refsim.sph import acceleration_of

NO_QUANTITY = ("position", "identity", "place")  # the last two are numbers of particles
COMPONENTS = "xyz"
USUAL = 0.005, 0.995  # shares of a frame's particles below the ends of the colour bar, and of what a picture shows
BESIDE = 0.25  # of the largest edge of what is shown: particles so near beside it are shown too


@dataclass(frozen=True)
class SavedRun:
    """A finished run. All places that it gives are relative to the plan's origin."""

    files: Run
    plan: Plan  # of its scene

    @property
    def dim(self) -> int:
        return self.plan.grid.dim

    @property
    def spacing(self) -> float:
        """Distance d of the particles at the start [m]."""
        return self.plan.grid.spacing

    @property
    def up(self) -> NDArray[np.float64]:
        """(3,) unit vector against gravity; z in space and y in the plane where there is none."""
        pull = -np.array(acceleration_of(self.plan.effects))
        length = float(np.linalg.norm(pull))
        return pull / length if length > 0 else np.array([0.0, 0.0, 1.0] if self.dim == 3 else [0.0, 1.0, 0.0])

    @property
    def walls(self) -> Any:
        """The effect of the box of walls around the particles, relative to the origin; None without walls."""
        container = self.plan.effects.get("box_walls") or self.plan.effects.get("mpm_walls")
        return None if container is None else container.local(self.plan.grid)

    @property
    def box(self) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Corners (3,), (3,) [m] of that box, flat in the plane; None without walls."""
        walls, axes = self.walls, np.arange(3) < self.dim
        return None if walls is None else (np.where(axes, walls.lower, 0.0), np.where(axes, walls.upper, 0.0))

    @property
    def closed_box(self) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """The same with open faces at infinity."""
        return None if self.walls is None else self.walls.domain(self.plan.grid)

    def seen(self, chosen: Sequence[int]) -> tuple[NDArray, NDArray]:
        """Corners of what is seen in the chosen frames: no strays, and the tank as high as the particles reach."""
        low, high = self.bounds(chosen, strays=False)
        if self.box is None:
            return low, high
        floor, top = self.box
        up = int(np.abs(self.up).argmax())
        if self.up[up] > 0:
            top[up] = high[up]
        else:
            floor[up] = low[up]
        return np.minimum(floor, low), np.maximum(top, high)

    def wall_distance(self) -> Distance | None:
        """Signed distance (k,) [m] of points (k, 3) [m] from walls and solid at rest, negative in them; else None."""
        mesh, box = self.mesh, self.closed_box
        parts: list[Distance] = [] if mesh is None else [mesh.distance]
        if box is not None:
            parts.append(lambda points: depth(points, *box))
        return (lambda points: np.minimum.reduce([part(points) for part in parts])) if parts else None

    @property
    def mesh(self) -> PlacedSolid | None:
        """The solid at rest that the liquid flows around; None without one."""
        for effect in self.plan.effects.values():
            if isinstance(effect, MeshBoundary):
                return effect.local(self.plan.grid).placed(self.plan.grid)
        return None

    @property
    def solids(self) -> int:
        """Number of the scene's solid bodies; their particles come before those of the fluid."""
        return len(self.plan.scene.solid)

    def quantities(self) -> tuple[str, ...]:
        """Names that `values` takes, without components of vectors."""
        return (*(name for name in sorted(self.files.fields) if name not in NO_QUANTITY), "part")

    def unit(self, name: str) -> str:
        """Unit of a quantity; "" if it has none."""
        base = name.partition(".")[0]
        unit = self.plan.fields[base].unit_in(self.dim) if base in self.plan.fields else ""
        return "" if unit == "-" else unit

    def label(self, name: str) -> str:
        """What a quantity is called in a picture."""
        return "speed" if name == "velocity" else name.replace("_", " ")

    def values(self, frame: RunFrame, name: str) -> NDArray[np.float64]:
        """(n,) values of a quantity: a field, the length of a vector, a component ("velocity.x"), or "part".

        Raises InputError for a quantity that the run does not have.
        """
        base, _, component = name.partition(".")
        if name == "part":
            return self.part(frame).astype(float)
        if base not in self.files.fields or base in NO_QUANTITY:
            raise InputError(f"{self.files.folder} has no field {base!r}; give one of {', '.join(self.quantities())}.")
        field = np.asarray(frame[base], dtype=float)
        if component:
            if field.ndim != 2 or field.shape[1] != 3 or component not in tuple(COMPONENTS):
                raise InputError(f"{name!r} is no component; only a vector has components, x, y and z.")
            return field[:, COMPONENTS.index(component)]
        return field if field.ndim == 1 else np.sqrt((field**2).sum(1))

    def part(self, frame: RunFrame) -> NDArray[np.int64]:
        """(n,) part of the scene to which each particle belongs: its solids first, then the parts of its fluid."""
        ends = np.cumsum(self.plan.state.sizes)
        return np.searchsorted(ends, frame["identity"], side="right").clip(max=len(ends) - 1)

    def solid_body(self, frame: RunFrame) -> NDArray[np.int64]:
        """(n,) number of the solid body of each particle; -1 for liquid and for melt."""
        part = self.part(frame)
        solid = part < self.solids
        if "phase" in frame.fields:
            solid &= frame["phase"] > 0
        return np.where(solid, part, -1)

    def frames(self, chosen: Iterable[int]) -> Iterator[RunFrame]:
        """The chosen frames."""
        return map(self.files.__getitem__, chosen)

    def position(self, frame: RunFrame) -> NDArray[np.float64]:
        """Positions (n, 3) [m] relative to the plan's origin."""
        return self.plan.grid.local(frame.position)

    def bounds(self, chosen: Sequence[int], strays: bool = True) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Corners (3,), (3,) [m] of the box that holds the particles of the chosen frames, and the solid at rest.

        strays  whether it also holds those far beside the box of 99 % of a frame's particles
        """
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for frame in self.frames(chosen):
            if len(frame):
                x = self.position(frame) if strays else without_strays(self.position(frame))
                low, high = np.minimum(low, x.min(0)), np.maximum(high, x.max(0))
        if self.mesh is not None:
            place = self.mesh.mesh.vertices + self.mesh.mesh.origin
            low, high = np.minimum(low, place.min(0)), np.maximum(high, place.max(0))
        if not np.isfinite(low).all() or not np.isfinite(high).all():
            raise InputError(
                f"{self.files.folder} has frames with no particle, or with one at no finite place; choose others."
            )
        half = 0.5 * self.spacing * (np.arange(3) < self.dim)
        return low - half, high + half


def open_run(path: str | os.PathLike[str]) -> SavedRun:
    """The run in a folder that `refsim run` or `simulate` has written. Raises InputError where there is none."""
    files = Run(Path(path), check=True)
    return SavedRun(files, make_plan(files.scene))


def without_strays(position: NDArray) -> NDArray[np.float64]:
    """Those of the places (n, 3) [m] that lie in the box of 99 % of them along each axis, or near beside it."""
    low = np.quantile(position, USUAL[0], axis=0, method="higher")
    high = np.quantile(position, USUAL[1], axis=0, method="lower")
    reach = BESIDE * (high - low).max()
    return position[((position >= low - reach) & (position <= high + reach)).all(1)]


def usual_range(rows: Iterable[NDArray]) -> tuple[float, float] | None:
    """Ends between which the USUAL values of each of the rows lie; None where no value is finite."""
    ends = [np.quantile(row, USUAL) for values in rows if len(row := values[np.isfinite(values)])]
    return (float(np.min(ends)), float(np.max(ends))) if ends else None


def chosen_frames(words: str | None, count: int) -> list[int]:
    """Numbers of frames from "last", "all", or a list such as "0,5,10:20:2,-1"; the last one for None.

    Raises InputError for anything else, and for a number that the run does not reach.
    """
    chosen: list[int] = []
    for word in ("last" if words is None else words).split(","):
        try:
            numbers = [int(n) if n else None for n in {"last": "-1", "all": ":"}.get(word, word).split(":")]
        except ValueError:
            numbers = []
        number = numbers[0] if len(numbers) == 1 else None
        if len(numbers) in (2, 3) and numbers[2:] != [0]:
            chosen += range(count)[slice(*numbers)]
        elif number is None:
            raise InputError(f"--frames {words!r} is no list of frames; give for example 0,5,-1 or 0:100:10 or all.")
        elif -count <= number < count:
            chosen.append(number % count)
        else:
            raise InputError(f"--frames {words!r}: the run has {count} frames; give numbers from 0 to {count - 1}.")
    if not chosen:
        raise InputError(f"--frames {words!r} chooses none of the run's {count} frames; give other numbers.")
    return sorted(set(chosen))
