"""A finished run read back: its frames, and what its scene says about its particles."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim.boundary.one_way_coupling import MeshBoundary
from refsim.boundary.one_way_coupling.placing import PlacedSolid
from refsim.core.errors import InputError
from refsim.engine.checkpoints import load_checkpoint
from refsim.engine.driver import PARTICLES
from refsim.io.frames import Frame, particle_table, read_particles
from refsim.scene.plan import Plan
from refsim.sph import gravity_of

READ_AT_ONCE = 256_000_000  # bytes of frames
NO_QUANTITY = ("identity", "place")  # numbers of particles
COMPONENTS = "xyz"


@dataclass(frozen=True)
class SavedRun:
    """A finished run. All places that it gives are relative to the plan's origin.

    path    the particle file
    plan    of its scene
    times   of its frames [s]
    stored  fields in the file: components by name
    """

    path: Path
    plan: Plan
    times: tuple[float, ...]
    stored: dict[str, int]

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
        gravity = gravity_of(self.plan.effects)
        pull = np.zeros(3) if gravity is None else -np.array(gravity.acceleration, dtype=float)
        length = float(np.linalg.norm(pull))
        return pull / length if length > 0 else np.array([0.0, 0.0, 1.0] if self.dim == 3 else [0.0, 1.0, 0.0])

    @property
    def box(self) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Corners (3,), (3,) [m] of the box of walls around the particles; None without walls."""
        for name in ("box_walls", "mpm_walls"):
            walls: Any = self.plan.effects.get(name)
            if walls is not None:
                walls = walls.local(self.plan.grid)
                return np.array(walls.lower, dtype=float), np.array(walls.upper, dtype=float)
        return None

    @property
    def closed_box(self) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """The same with open faces at infinity."""
        if self.box is None:
            return None
        low, high = self.box
        walls = self.plan.effects.get("box_walls") or self.plan.effects["mpm_walls"]
        for axis, letter in enumerate(COMPONENTS):
            if "-" + letter in walls.open_faces or axis >= self.dim:  # type: ignore[attr-defined]
                low[axis] = -np.inf
            if "+" + letter in walls.open_faces or axis >= self.dim:  # type: ignore[attr-defined]
                high[axis] = np.inf
        return low, high

    def wall_distance(self) -> Callable[[NDArray], NDArray] | None:
        """Signed distance (k,) [m] of points (k, 3) [m] from walls and solid at rest, negative in them; else None."""
        mesh, box = self.mesh, self.closed_box

        def distance(points: NDArray) -> NDArray[np.float64]:
            found = np.full(len(points), np.inf)
            if mesh is not None:
                found = mesh.distance(points)
            if box is not None:
                found = np.minimum(found, np.minimum(points - box[0], box[1] - points).min(1))
            return found

        return None if mesh is None and box is None else distance

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
        return (*(name for name in sorted(self.stored) if name not in NO_QUANTITY), "part")

    def unit(self, name: str) -> str:
        """Unit of a quantity; "" if it has none."""
        base = name.partition(".")[0]
        unit = self.plan.fields[base].unit if base in self.plan.fields else ""
        return "" if unit == "-" else unit.partition(" (")[0] if self.dim == 3 else _unit_in_2d(unit)

    def values(self, frame: Frame, name: str) -> NDArray[np.float64]:
        """(n,) values of a quantity: a field, the length of a vector, a component ("velocity.x"), or "part".

        Raises InputError for a quantity that the run does not have.
        """
        base, _, component = name.partition(".")
        if name == "part":
            return self.part(frame).astype(float)
        if base not in self.stored or base in NO_QUANTITY:
            raise InputError(f"{self.path} has no field {base!r}; give one of {', '.join(self.quantities())}.")
        field = np.asarray(frame.fields[base], dtype=float)
        if component:
            if field.ndim != 2 or field.shape[1] != 3 or component not in tuple(COMPONENTS):
                raise InputError(f"{name!r} is no component; only a vector has components, x, y and z.")
            return field[:, COMPONENTS.index(component)]
        return field if field.ndim == 1 else np.sqrt((field**2).sum(1))

    def part(self, frame: Frame) -> NDArray[np.int64]:
        """(n,) part of the scene to which each particle belongs: its solids first, then the parts of its fluid."""
        ends = np.cumsum(self.plan.state.sizes)
        return np.searchsorted(ends, frame.fields["identity"], side="right").clip(max=len(ends) - 1)

    def solid_body(self, frame: Frame) -> NDArray[np.int64]:
        """(n,) number of the solid body of each particle; -1 for liquid and for melt."""
        part = self.part(frame)
        solid = part < self.solids
        if "phase" in frame.fields:
            solid &= frame.fields["phase"] > 0
        return np.where(solid, part, -1)

    def frames(self, chosen: Sequence[int], fields: Collection[str] | None = None) -> Iterator[Frame]:
        """The chosen frames, a few at a time; `fields` beside identity and phase, all by default."""
        wanted = None if fields is None else {"identity", "phase", *(f.partition(".")[0] for f in fields)}
        kept = [c for name, c in self.stored.items() if wanted is None or name in wanted]
        at_once = max(1, READ_AT_ONCE // (8 * max(1, sum(self.plan.state.sizes)) * (3 + sum(kept))))
        for first in range(0, len(chosen), at_once):
            for frame in read_particles(self.path, chosen[first : first + at_once], wanted):
                yield Frame(frame.time, self.plan.grid.local(frame.position), frame.fields)

    def bounds(self, chosen: Sequence[int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Corners (3,), (3,) [m] of the box that holds all particles of the chosen frames, and the solid at rest."""
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for frame in self.frames(chosen, ()):
            low = np.minimum(low, frame.position.min(0, initial=np.inf))
            high = np.maximum(high, frame.position.max(0, initial=-np.inf))
        if self.mesh is not None:
            place = self.mesh.mesh.vertices + self.mesh.mesh.origin
            low, high = np.minimum(low, place.min(0)), np.maximum(high, place.max(0))
        if not np.isfinite(low).all() or not np.isfinite(high).all():
            raise InputError(f"{self.path} has frames with no particle, or with one at no finite place; choose others.")
        half = 0.5 * self.spacing * (np.arange(3) < self.dim)
        return low - half, high + half


def _unit_in_2d(unit: str) -> str:
    """ "kg (kg/m in 2D)" -> "kg/m"."""
    first, _, rest = unit.partition(" (")
    return rest.partition(" in 2D")[0] if rest else first


def open_run(path: str | os.PathLike[str]) -> SavedRun:
    """The run in a folder that `refsim run` or `simulate` has written. Raises InputError where there is none."""
    folder = Path(path)
    if folder.name == PARTICLES:
        folder = folder.parent
    if not folder.is_dir():
        raise InputError(f"there is no run in {os.fspath(path)!r}; give the folder that `refsim run` has written.")
    particles = folder / PARTICLES
    times, fields = particle_table(particles)
    if not times:
        raise InputError(f"{particles} holds no frame; run the scene again.")
    plan = load_checkpoint(folder).plan
    return SavedRun(particles, plan, tuple(times), {name: components for name, (components, _) in fields.items()})


def chosen_frames(words: str | None, count: int) -> list[int]:
    """Numbers of frames from "last", "all", or a list such as "0,5,10:20:2,-1"; the last one for None.

    Raises InputError for anything else, and for a number that the run does not reach.
    """
    chosen: list[int] = []
    for word in ("last" if words is None else words).split(","):
        if word == "last":
            chosen.append(count - 1)
            continue
        try:
            numbers = [int(n) if n else None for n in ("" if word == "all" else word).split(":")]
        except ValueError:
            numbers = [None] * 4
        if word == "all":
            numbers = [None, None]
        if len(numbers) > 3 or (len(numbers) == 1 and numbers[0] is None) or (len(numbers) == 3 and numbers[2] == 0):
            raise InputError(f"--frames {words!r} is no list of frames; give for example 0,5,-1 or 0:100:10 or all.")
        if len(numbers) > 1:
            chosen += range(count)[slice(*numbers)]
        elif -count <= numbers[0] < count:  # type: ignore[operator]
            chosen.append(numbers[0] % count)  # type: ignore[operator]
        else:
            raise InputError(f"--frames {words!r}: the run has {count} frames; give numbers from 0 to {count - 1}.")
    if not chosen:
        raise InputError(f"--frames {words!r} chooses none of the run's {count} frames; give other numbers.")
    return sorted(set(chosen))
