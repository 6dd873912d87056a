"""Neighbour search: cell sort and one shared list with a skin, in unbounded space or a periodic box.

The list holds every pair nearer than `radius + skin` at the moment it is built and stays valid until some
particle has moved half the skin. Rows follow the particles' cell order, so the answer repeats bit for bit.
Reference: all pairs (`refsim.neighbours.reference`).
"""

import math
from collections import namedtuple
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from refsim.backends.arrays import Backend
from refsim.core.errors import InputError, RunStopped
from refsim.core.period import Period
from refsim.neighbours.limits import MOST_NEIGHBOURS as MOST_NEIGHBOURS

AUDITED_ROWS = 8
AUDIT_MARGIN = 1e-5  # share of the radius left out of the audit: positions are stepped back with rounding
ROUNDING = 0.01  # share of the allowed displacement held back where displacements are found ahead


@dataclass
class SearchLog:
    """What the search did during a run."""

    rebuilds: int = 0
    audited_rows: int = 0
    missed_neighbours: int = 0
    most_neighbours: int = 0
    list_bytes: int = 0


# What moves the particles: positions now and when the list was built [m], velocities [m/s], (kick, step) [s]
Particles = namedtuple("Particles", "position build_position velocity timestep")
# Rows of the list: one out of each share of them, another one after every build
AuditedRows = namedtuple("AuditedRows", "share number")


@dataclass
class NeighbourSearch:
    """The shared list of one particle set, and its lists against static sets (walls).

    radius  distance [m] up to which neighbours are wanted
    skin    share of the radius by which the list reaches further
    period  lengths of a periodic box, longer than twice what the list reaches; None for none
    widest  the largest that the skin may become (`reach_further`), for which cells are made; 0 where it stays
    """

    backend: Backend
    dim: int
    dtype: str
    radius: float
    skin: float = 0.1
    period: Period | None = None
    widest: float = 0.0
    log: SearchLog = field(default_factory=SearchLog)

    def __post_init__(self) -> None:
        if not self.skin >= 0.0:
            raise InputError(f"skin = {self.skin} is not possible; give zero or a positive share of the radius.")
        self.reach = self.radius * (1 + max(self.skin, self.widest))
        if self.backend.name == "cuda":
            from refsim.neighbours import cell_list_cuda as programs
        else:
            from refsim.neighbours import cell_list as programs  # type: ignore[no-redef]
        self.programs: Any = programs.CellSearch(self.backend, self.dim, self.reach, self.log, self.period)
        self.reach_further(self.skin)

    def reach_further(self, skin: float) -> None:
        """Have the next lists reach further than the radius by this share of it."""
        self.skin, self.allowed_displacement = skin, 0.5 * skin * self.radius
        self.programs.listed = self.radius * (1 + skin)

    def order(self, position: Any) -> Any:
        """Permutation that puts the particles into cell order (stable)."""
        return self.programs.order(position)

    def sort(
        self, position: Any, arrays: list[Any], sorted_position: Any, before_build: bool = False,
        behind: Callable[[], None] | None = None,
    ) -> list[Any]:  # fmt: skip
        """The arrays in the cell order of `position`, which is among them; its values also go to `sorted_position`.

        On the GPU they are the same arrays with their rows moved, and the host waits for them, unless a build follows
        (`before_build`), which waits itself. What `behind` launches stands behind the moves there, in the same graph.
        """
        if not self.looks_ahead:
            return self.programs.sort(position, arrays, sorted_position)
        moved = self.programs.sort(position, arrays, sorted_position, behind)
        if not before_build:
            self.programs.finish_sort()
        return moved

    def build(self, position: Any) -> Any:
        """List of the particles, which stand in cell order; raises RunStopped where a clump has collapsed.

        The same object as before where the same arrays hold the new list.
        """
        self.log.rebuilds += 1
        return self._checked(self.programs.build(position))

    def build_against(self, position: Any, static: "StaticSet") -> Any:
        """List of the static particles (walls) near each particle."""
        return self._checked(self.programs.build_against(position, static.prepared))

    def build_around(self, position: Any, static: "StaticSet", name: str = "around") -> Any:
        """List of the particles, which stand in cell order and have been listed, near each static particle.

        name  of the list; one of the same name as before takes its place
        """
        return self._checked(self.programs.build_around(position, static.prepared, name))

    def static_set(self, position: np.ndarray) -> "StaticSet":
        """Static particles, sorted by cell once; `order` says how their other arrays must be sorted."""
        return StaticSet(*self.programs.static_set(np.asarray(position, dtype=self.dtype)))

    def reorder(self, array: Any, order: Any) -> Any:
        """array[order], as a new array."""
        return self.programs.reorder(array, order)

    def margins(self, particles: Particles, largest: Sequence[float], walls: bool) -> list[float]:
        """How much further [m] any two particles may move relative to each other before the list could lack a pair.

        On a GPU a second number says how much is left after `ahead` [s] with the velocities of now. `largest` [m] are
        the largest displacements since the list was built, now and then.

        Particles that move together need no new list: displacements relative to each other count, of particles that
        could come near. On the CPU blocks of cells that touch are compared by the boxes of their particles'
        displacements, on a GPU cells up to two apart; other particles were two cells apart. Walls stand still: with
        `walls` the largest displacement counts, too, on a GPU in cells near walls. Zero in a periodic box, whose cells
        touch across its borders.
        """
        if self.period is not None:
            return [0.0]
        held_back = ROUNDING if self.looks_ahead else AUDIT_MARGIN
        allowed, far = 2 * self.allowed_displacement * (1 - held_back), 2 * self.reach - self.radius
        at_walls = far if self.looks_ahead else allowed
        return [
            min(allowed - near, far - anywhere, at_walls - way if walls else math.inf)
            for (near, anywhere), way in zip(self.programs.relative_displacements(*particles), largest)
        ]

    @property
    def looks_ahead(self) -> bool:
        """Whether displacements are compared ahead of the present, behind a step for which the host waits: on a GPU."""
        return bool(self.programs.looks_ahead)

    def ahead(self, length: float) -> float:
        """How far [s] displacements are compared ahead after a step of this length [s]."""
        return float(self.programs.steps_ahead * length)

    def look_ahead(self, particles: Particles, wanted: bool) -> None:
        """Forget what was compared before the particles moved; with `wanted`, compare what `margins` needs."""
        self.programs.look_ahead(particles, wanted and self.period is None)

    def audit(
        self, position: Any, velocity: Any, timestep: Any, neighbours: Any, bounds: Any = None, shift: Any = None
    ) -> None:  # fmt: skip
        """Compare sampled rows of the list with all pairs, where it was last used: before the latest step.

        position (n, 3) [m], velocity (n, 3) [m/s], timestep (2,) with dt [s] second; shift: None, or the shifts beside
        dt v as `sph.kick_drift` takes them, (way (n, 3) [-], longest_shift (bodies,) [m], body (n,) or None). Misses
        stand in the log after the next build; a GPU takes the audit along with the sorting or build that follows. Pairs
        with a particle that stands on a plane of `bounds` [m], which may just have stopped it, do not count.
        """
        n = position.shape[0]
        rows = AuditedRows(max(n // AUDITED_ROWS, 1), min(AUDITED_ROWS, n))
        self.log.audited_rows += rows.number
        radius = self.radius * (1 - AUDIT_MARGIN)
        self.programs.audit(position, velocity, timestep, neighbours, rows, radius, bounds, shift)

    def _checked(self, result: tuple[Any, int]) -> Any:
        neighbours, most = result
        self.log.missed_neighbours = self.programs.missed
        self.log.most_neighbours = max(self.log.most_neighbours, most)
        if most > MOST_NEIGHBOURS:
            raise RunStopped(
                "collapsed",
                f"A particle has {most} neighbours: particles have collapsed into a clump; take a smaller step or"
                " a smaller cohesion, or a larger sound speed.",
            )
        return neighbours


@dataclass(frozen=True)
class StaticSet:
    """Particles that never move: the search's own data and the order in which it keeps them."""

    prepared: Any
    order: np.ndarray
    position: Any

    def in_first_order(self, values: np.ndarray) -> np.ndarray:
        """A table of these particles in the order in which they were given."""
        return values[np.argsort(self.order)]


def coincident_pairs(position: np.ndarray) -> list[tuple[int, int]]:
    """Pairs of particles at exactly the same place; position (n, 3) [m]."""
    word = np.uint32 if position.dtype.itemsize == 4 else np.uint64
    key = np.zeros(len(position), np.uint64)  # equal where places are, and rarely elsewhere
    for axis in range(3):
        key *= np.uint64(0x9E3779B97F4A7C15)
        key ^= (position[:, axis] + 0.0).view(word)  # without -0
        key ^= key >> np.uint64(29)
    ordered = np.sort(key)
    twice = ordered[1:][ordered[1:] == ordered[:-1]]
    if not len(twice):
        return []
    rows = np.flatnonzero(np.isin(key, twice))
    order = rows[np.lexsort(position[rows].T)]
    same = (np.diff(position[order], axis=0) == 0).all(1)
    return [(int(min(a, b)), int(max(a, b))) for a, b in zip(order[:-1][same], order[1:][same])]
