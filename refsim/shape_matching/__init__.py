"""Lattice shape matching: solids whose regions are drawn back to their shape (Shao & Song 2017; Rivers & James 2007).

Tables have a row for each node of a solid, in the particles' first order: every build of the neighbour list sorts the
particles anew, and nodes keep their numbers. Field `place` is the row of a node's particle.
"""

import functools
import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from refsim.core.capabilities import HasErrata, Inspects, JudgesStart
from refsim.core.checked import Printed, Share
from refsim.core.effect import (
    PLACE,
    Discretisation,
    Effect,
    Extremes,
    Field,
    InitialState,
    Lattice,
    Nodes,
    Others,
    Pass,
    StepLimit,
    int32,
)
from refsim.core.errors import InputError
from refsim.core.walls import WallParticles
from refsim.scene.solids import cell_key
from refsim.shape_matching.boxes import boxes_of
from refsim.shape_matching.phases import FLUID, SURFACE

PHASE = Field("phase", "-", "0 liquid, 1 solid at its body's surface, 2 solid inside", dtype="int32", state=True)


def _table(name: str, unit: str, meaning: str, components: int = 1, dtype: str = "real", state: bool = False) -> Field:
    return Field(name, unit, meaning, components, dtype, state, rows="solids")


DIRECT = _table("direct", "-", "arrayN: direct neighbours of a node", 27, "int32")
REGION_COUNT = _table("region_count", "-", "members of a node's region", dtype="int32")
REGION_SHARE = _table("region_share", "kg", "m_k/cnt_k: a node's share in each region")
SOLID_POSITION = _table("solid_position", "m", "position of a node's particle", 3)
ROTATION = _table("rotation", "-", "quaternion of a region's best rotation", 4, state=True)
REGION_CENTER = _table("region_center", "m", "c_r - x_r: center of mass of a region, from its node", 3)
REGION_ANCHOR = _table("region_anchor", "m", "displacement of a region's own node to its goal in that region", 3)
SOLID_VELOCITY = _table("solid_velocity", "m/s", "velocity of a node's particle after the kick", 3)
REGION_VELOCITY = _table("region_velocity", "m/s", "v_c: mean velocity of a region", 3)
REGION_SPIN = _table("region_spin", "1/s", "omega: angular velocity of a region", 3)
WIDEST = 4  # half-width up to which regions are tested
STRETCH = 0.005  # share by which its own spin may stretch a body in the mean; it breathes by as much about that
OFF = 0.1  # share by which neighbours of a body may be nearer or farther than a spacing in the mean without a note
LOST = 2.0  # times farther at which a body has lost its shape; one that is pressed together comes back to it


class Matching(NamedTuple):
    """Shape matching as the kernels take it."""

    half_width: int  # w of the regions [cells]
    spacing: float  # d [m]
    stiffness: float  # alpha
    damping: float  # beta
    twist_floor: float  # weight of the previous rotation in an undetermined twist
    inertia_floor: float  # share of the trace that is added to the inertia
    precision: float = 1e-17  # of Newton's steps: their square is the last one's
    eps: float = 2.220446049250313e-16  # of the positions


class ShapeMatching(Effect, HasErrata, Inspects, JudgesStart, frozen=True, kw_only=True):
    """Holds the scene's solids together: every region of a lattice is drawn to its best rigid motion.

    half_width  w of the regions [cells], 1 to 4: stiffness and cost grow with it
    stiffness   alpha, share of the displacement to the goal in a step, up to 1
    damping     beta, share of the difference to the regions' rigid motion that a step removes, up to 1; 0 leaves it out
    summation   how regions are summed: "gather" or "reduction" (member by member; threads of a GPU share a region, as
                in the paper) or "fast" (boxes of cells, one axis after the other; a GPU sums by reduction)
    literal     "paper" for the choice of Shao & Song: no damping (M25)
    """

    name: ClassVar[str] = "shape_matching"
    source: ClassVar[str] = "Shao & Song"
    paper: ClassVar[Mapping[str, Any]] = {"damping": 0.0}

    half_width: int = 2
    stiffness: Share = 1.0
    damping: Share = 0.1
    summation: Literal["gather", "reduction", "fast"] = "fast"
    literal: Printed = ()

    def check(self, grid: Discretisation, others: Others) -> None:
        if not (isinstance(self.half_width, int) and 1 <= self.half_width <= WIDEST):
            raise InputError(f"{self.name}: half_width = {self.half_width} is not possible; give 1 to {WIDEST}.")

    def holds(self) -> bool:
        """Whether it acts on the solids; if not, only their particles and surfaces are found."""
        return self.stiffness > 0 or self.damping > 0

    def fields(self, others: Others) -> tuple[Field, ...]:
        members = (2 * self.half_width + 1) ** 3
        table = _table("region", "-", "arrayR: members of a node's region", members, "int32")
        found, regions = (PHASE, PLACE, DIRECT), (table, REGION_COUNT)
        if not self.holds():
            return (*found, *regions) if "melting" in others else found
        matched = (REGION_SHARE, SOLID_POSITION, ROTATION, REGION_CENTER, REGION_ANCHOR, SOLID_VELOCITY)
        return (*found, *regions, *matched, *((REGION_VELOCITY, REGION_SPIN) if self.damping > 0 else ()))

    def initial(self, grid: Discretisation, state: InitialState, others: Others) -> Mapping[str, np.ndarray]:
        nodes = len(self._lattice(grid).key)
        phase = np.full(grid.count, FLUID, np.int32)
        phase[:nodes] = SURFACE
        rotation = {"rotation": np.tile([1.0, 0.0, 0.0, 0.0], (nodes, 1))} if self.holds() else {}
        return {"phase": phase, **rotation}

    def passes(self, others: Others) -> tuple[Pass, ...]:
        regions = ("region", "region_count")
        start = (
            Pass("shape_matching.direct_neighbours", writes=("direct",), stage="start"),
            Pass("shape_matching.regions", writes=regions, stage="start", names={"rebuild": None}),
            Pass("shape_matching.classify", updates=("phase",), stage="start"),
        )
        if not self.holds():
            return tuple(p for p in start if p.operation != "shape_matching.regions" or "melting" in others)
        matched, moved, pull = ("region_center", "region_anchor"), ("region_velocity", "region_spin"), ("acceleration",)
        summed = functools.partial(Pass, algorithm=self.summation)
        held = (
            *start,
            Pass("shape_matching.gather", writes=("region_share", "solid_position")),
            summed("shape_matching.match", writes=matched, updates=("rotation",)),
            summed("shape_matching.pull", writes=("solid_velocity",), updates=pull, stage="motion"),
        )
        if self.damping == 0:
            return held
        return (
            *held,
            summed("shape_matching.region_motion", writes=moved, stage="motion"),
            summed("shape_matching.damp", updates=pull, stage="motion"),
        )

    def notes(self, grid: Discretisation, others: Others) -> tuple[str, ...]:
        if self.summation != "reduction" or not self.holds():
            return ()
        return (f"{self.name}: summation = 'reduction' is a GPU's; on a CPU regions are summed as with 'gather'",)

    def notes_on_start(
        self, grid: Discretisation, state: InitialState, walls: WallParticles | None, others: Others
    ) -> Iterator[str]:
        """A note on a fixed step in which solids move farther than their spin allows."""
        speed = float(np.linalg.norm(state.velocity[: len(self._lattice(grid).key)], axis=1).max())
        longest = min((limit.at(Extremes(speed, 0.0)) for limit in self.step_limits(grid, others).values()), default=0)
        if grid.step > longest > 0:
            yield (
                f"{self.name}: step = {grid.step:g} s is {grid.step / longest:.3g} times the {longest:.3g} s up to"
                f" which solids of {speed:.3g} m/s that turn keep their size to {200 * STRETCH:g} %, and the stretch"
                " grows with its square: take a shorter step"
            )

    def step_limits(self, grid: Discretisation, others: Others) -> dict[str, StepLimit]:
        """The step in which the fastest particle moves as far as a body's spin may stretch it by STRETCH."""
        if self.stiffness == 0 or grid.solids is None:
            return {}
        stretch = widest_stretch(grid.solids, self.half_width)
        return {"solids": StepLimit.crossing(math.sqrt(STRETCH * self.stiffness / stretch))} if stretch > 0 else {}

    def inspected(self, grid: Discretisation, field: Callable[[str], np.ndarray]) -> tuple[str, str] | None:
        """(reason, sentence) where neighbours of a body's lattice are too near or too far; without reason, a note."""
        if self.stiffness == 0 or grid.solids is None:
            return None
        place = field("place")[: len(grid.solids.lattice.key)]
        solid = field("phase")[place] != FLUID
        mean = apart(grid.solids, field("position")[place].astype(float), solid)
        worst = int(np.argmax(np.maximum(mean, 1 / np.maximum(mean, 1e-30))))
        ratio = float(mean[worst])
        if abs(ratio - 1) <= OFF:
            return None
        message = (
            f"neighbours in [[solid]] number {worst + 1} are {ratio:.3g} spacings apart in the mean: take a shorter"
            " step, or a larger half_width or stiffness of shape_matching"
        )
        return ("shape_lost" if ratio > LOST else ""), message

    def shares(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        return {} if grid.solids is None else {"lattice": grid.solids.lattice}

    def prepare(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        lattice, groups = self._lattice(grid), {"matching": self.matching(grid)}
        by_boxes = self.summation == "fast" and self.holds()
        return groups | ({"boxes": boxes_of(lattice, self.half_width)} if by_boxes else {})

    def matching(self, grid: Discretisation) -> Matching:
        """Its numbers in the run's dtype."""
        eps = float(np.finfo(grid.dtype).eps)
        numbers = grid.spacing, self.stiffness, self.damping, 1e-6, 1e-9 if grid.dtype == "float64" else 1e-5
        return Matching(int32(self.half_width), *map(grid.real, (*numbers, 0.05 * eps, eps)))

    def _lattice(self, grid: Discretisation) -> Lattice:
        if grid.solids is None:
            raise InputError(f"{self.name}: the scene has no solids to hold together; add a [[solid]] or remove it.")
        return grid.solids.lattice


# Shapes of bodies that turn, and how far apart their particles stand, on the host


SAMPLE = 1000  # nodes of a body whose neighbours are looked at


def widest_stretch(solids: Nodes, half_width: int) -> float:
    """Largest S [1/m^2] of the bodies: one that turns is stretched by S (v dt)^2/alpha, v of its fastest particle.

    A body in one region, with a particle at a distance r from its axis, is pulled back by alpha (r - r0) in a step:
    2 (1 - cos(omega dt)) r = alpha (r - r0), about (v dt/r)^2/alpha. In a wider one the goals average over regions, of
    a variance w (w + 1) d^2/3 along each axis: a longitudinal wave goes sqrt(alpha w (w + 1)/3) d in a step, and spin
    stretches a bar by (v/c)^2/3. Regions at surfaces are smaller, so that thin bars stretch up to twice as far.
    S = 1/r^2 + 2/(w (w + 1) d^2), about the axis in which r is least. 0 for particles that stand alone.
    """
    stretch = 0.0
    for begin, end in itertools.pairwise(solids.lattice.first):
        place = solids.lattice.cell[begin:end] - solids.lattice.cell[begin]
        place = solids.spacing * (place - place.mean(0))
        moment = place.T @ place
        # what is as wide along all axes has those of the lattice, which rounding does not turn
        _, axes = np.linalg.eigh(np.where(np.abs(moment) > 1e-9 * np.trace(moment), moment, 0.0))
        squared = (place**2).sum(1)
        arms = [math.sqrt((squared - (place @ axis) ** 2).max()) for axis in axes.T]
        arms = [arm for arm in arms if arm > 0.25 * solids.spacing]
        if arms:
            wide = 2 / (half_width * (half_width + 1) * solids.spacing**2)
            stretch = max(stretch, 1 / min(arms) ** 2 + wide)
    return stretch


def apart(solids: Nodes, position: np.ndarray, solid: np.ndarray) -> np.ndarray:
    """Mean distance [spacings] of neighbours along the lattice's axes in each body; 1 where it has none.

    position  of each node (S, 3) [m]; solid (S,) whether it still belongs to its body
    """
    lattice, mean = solids.lattice, []
    for begin, end in itertools.pairwise(lattice.first):
        some = np.unique(np.linspace(begin, end - 1, SAMPLE).astype(int))
        distance = [np.zeros(0)]
        for axis in np.eye(3, dtype=lattice.cell.dtype):
            key = cell_key(lattice.cell[some] + axis)
            other = np.minimum(begin + np.searchsorted(lattice.key[begin:end], key), end - 1)
            pair = (lattice.key[other] == key) & solid[some] & solid[other]
            distance.append(np.linalg.norm(position[other[pair]] - position[some[pair]], axis=1))
        together = np.concatenate(distance)
        mean.append(together.mean() / solids.spacing if len(together) else 1.0)
    return np.array(mean)
