"""Hard cases of MPM with surface tension, outcomes of the printed readings, largest stable step of each embedding.

Units: rho0 = k = 1, lambda = 1000, cells of 1/64 m in the plane and 1/32 m in space.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from refsim import Cloud, Gravity, MpmLiquid, Scene, Simulation, SurfaceEnergy
from refsim.core.errors import InputError, RunStopped
from refsim.mpm.limits import FARTHEST
from refsim.mpm.reference import SYMMETRIC
from refsim.scene.plan import make_plan
from validation.results import Result
from validation.running import Context
from validation.trials import Cell, StabilityMap, Trial, largest_stable

CELLS = {2: 1 / 64, 3: 1 / 32}
DENSITY, TENSION, MODULUS = 1.0, 1.0, 1000.0
MOMENTUM = 1e-10  # of m v_max: the project's bar in float64
ANGULAR = 1e-4  # of m v_max R: the project's bar
REMADE = 1e-3  # of m v_max R: what surfaces made anew may change, see `Turning`
SPIN = 20.0  # rad/s


def block(cells: tuple[int, ...], shift: tuple[float, float, float] = (0.13, -0.21, 0.37)) -> NDArray:
    """A block of 2^dim particles to a cell (n, 3), in cells, off the nodes by `shift`."""
    axes = [np.arange(2 * n) * 0.5 + 0.25 for n in cells]
    place = np.array(list(itertools.product(*axes)))
    return np.pad(place, ((0, 0), (0, 3 - len(cells)))) + np.array(shift) * (np.arange(3) < len(cells))


def disc(radius: float, dim: int = 2) -> NDArray:
    """Particles of a lattice within `radius` cells of the origin (n, 3), in cells."""
    place = block((2 * math.ceil(radius) + 2,) * dim, (-math.ceil(radius) - 1.13,) * 3)
    return place[np.linalg.norm(place, axis=1) < radius]


def liquid(
    place: NDArray, dim: int = 2, velocity: Any = None, modulus: float = MODULUS, tension: float = TENSION,
    step: float = 0.0, printed: tuple[str, ...] = (), extra: tuple[Any, ...] = (), **surface: Any,
) -> Scene:  # fmt: skip
    """Particles at `place` [cells] under surface tension; `printed` readings of the liquid, no surface where k < 0."""
    h = CELLS[dim]
    effects = (MpmLiquid(rest_density=DENSITY, bulk_modulus=modulus, literal=printed),)
    effects += (SurfaceEnergy(surface_tension=tension, **surface),) if tension >= 0 else ()
    cloud = Cloud(position=h * place, **({} if velocity is None else {"velocity": velocity}))
    return Scene(
        spacing=h / 2, support_radius=1.5 * h, dim=dim, dtype="float64", step=step, fluid=(cloud,),
        effects=(*effects, *extra),
    )  # fmt: skip


class Ledger:
    """What a free body must keep: seen along a run, checked at its end."""

    def __init__(self) -> None:
        self.rows: list[dict[str, float]] = []

    def __call__(self, run: Simulation) -> None:
        """Take down the state."""
        x, v, m, ratio = (run.field(name) for name in ("position", "velocity", "mass", "volume_ratio"))
        surface = run._shared.get("surface")
        area = float(surface.sample_area.sum()) if surface is not None and surface.latest is not None else math.nan
        centre = (m[:, None] * x).sum(0) / m.sum()
        angular = _turning(m, (x, v, run.field("affine")), _spread(run))
        liquid, tension = run.plan.effects["mpm_liquid"], run.plan.effects.get("surface_energy")
        kinetic = 0.5 * float(m @ (v**2).sum(1))
        bulk = 0.5 * liquid.bulk_modulus / liquid.rest_density * float(m @ (ratio - 1) ** 2)
        self.rows.append(
            {
                "momentum": float(np.abs(m @ v).max()), "speed": float(np.sqrt((v**2).sum(1).max())),
                "angular": angular, "kinetic": kinetic, "ratio": float(ratio.min()),
                "energy": kinetic + bulk + (tension.surface_tension if tension else 0.0) * area,
                "extent": float(np.ptp(x, axis=0).max()), "size": float(np.linalg.norm(x - centre, axis=1).max()),
                "mass": float(m.sum()), "steps": run.steps,
                "samples": float(surface.latest.samples.count.max()) if area == area else 0.0,
            }
        )  # fmt: skip

    def last(self, name: str) -> float:
        """The latest value."""
        return self.rows[-1][name]

    def drift(self, name: str = "momentum") -> float:
        """Largest change of a momentum over m v_max (times the body's size for the angular one)."""
        scale = self.scale(name)
        return max(abs(row[name] - self.rows[0][name]) for row in self.rows) / scale if scale > 0 else 0.0

    def scale(self, name: str) -> float:
        """m v_max, times the body's size for the angular one."""
        scale = self.last("mass") * max(row["speed"] for row in self.rows)
        return scale * self.rows[0]["size"] if name == "angular" else scale


class Turning:
    """Angular momentum of a free body about its centre [kg m^2/s], and where it changes.

    A cluster's second moment D is made anew with the surface, between two steps, and the affine matrix A stays, so that
    affine fields are kept: what A D carries is another number then. Transfers and forces themselves keep it.

    in_steps   what all steps have changed
    remade     what all surfaces made anew have changed
    """

    def __init__(self) -> None:
        self.in_steps = self.remade = self.total = 0.0
        self.before: tuple[NDArray, NDArray, NDArray] | None = None
        self.greatest = {"in_steps": 0.0, "remade": 0.0}

    def __call__(self, run: Simulation) -> None:
        """Look at the state after every step, and before the first."""
        mass, now = run.field("mass"), tuple(run.field(name) for name in ("position", "velocity", "affine"))
        spread = _spread(run)
        total = _turning(mass, now, spread)
        if self.before is not None:
            began = _turning(mass, self.before, spread)
            self.in_steps += total - began
            self.remade += began - self.total
            for name in self.greatest:
                self.greatest[name] = max(self.greatest[name], abs(getattr(self, name)))
        self.before, self.total = now, total


def free_body(
    trial: Trial, scene: Scene, until: float, momentum: float = MOMENTUM, angular: float = ANGULAR, every: int = 10,
    in_steps: float = MOMENTUM,
) -> Ledger:  # fmt: skip
    """Run a body that nothing holds: no particle is lost, momenta stay, and J stays possible.

    angular   bound of the whole drift of angular momentum, over m v_max R; in_steps: of what steps change of it
    """
    ledger, turning = Ledger(), Turning()

    def watch(run: Simulation) -> None:
        turning(run)
        if run.steps % every == 0 or run.time >= until:
            ledger(run)

    trial.advance(trial.start(scene), until=until, watch=watch)
    scale = ledger.scale("angular")
    trial.check("linear momentum over m v_max", ledger.drift(), at_most=momentum)
    trial.check("angular momentum over m v_max R", ledger.drift("angular"), at_most=angular)
    trial.check("angular momentum that steps change, over m v_max R", turning.greatest["in_steps"] / scale,
                at_most=in_steps)  # fmt: skip
    trial.show("angular momentum that surfaces made anew change, over m v_max R", turning.greatest["remade"] / scale)
    trial.check("least J", min(row["ratio"] for row in ledger.rows), at_least=0.2)
    trial.show("steps", ledger.last("steps"))
    return ledger


def _spread(run: Simulation) -> NDArray:
    """D of each particle (n, 3, 3) [m^2]."""
    unit = CELLS[run.plan.grid.dim] ** 2 / 4
    if run.steps and "inverse_spread" in run.fields:
        return unit * np.linalg.inv(run.field("inverse_spread")[:, SYMMETRIC])
    return np.broadcast_to(unit * np.eye(3), (run.count, 3, 3))


def _own_spin(affine: NDArray, spread: NDArray) -> NDArray:
    """Angular momentum over mass (n, 3) [m^2/s] of each particle about itself: that of A D."""
    moment = affine.reshape(-1, 3, 3) @ spread
    return np.stack([moment[:, c - 1, c - 2] - moment[:, c - 2, c - 1] for c in range(3)], axis=1)


def _turning(mass: NDArray, state: tuple[NDArray, ...], spread: NDArray) -> float:
    """Angular momentum about the centre of mass, about z [kg m^2/s]; `state` is position, velocity, affine matrix."""
    position, velocity, affine = state
    centre = (mass[:, None] * position).sum(0) / mass.sum()
    spin = np.cross(position - centre, velocity) + _own_spin(affine, spread)
    return float((mass[:, None] * spin).sum(0)[2])


# Hard cases


def isolated(context: Context, backend: str, smallest: int) -> Result:
    """Sixty particles without neighbours fly apart; with smallest = 1 surface tension acts on each."""
    trial = Trial(context, backend)
    random = np.random.default_rng(7)
    place = 8.0 * np.array(list(itertools.product(range(10), range(6), [0.0]))) + [0.3, 0.1, 0.0]
    velocity = np.pad(random.normal(size=(60, 2)), ((0, 0), (0, 1)))
    with trial.ending():
        run = trial.start(liquid(place, velocity=velocity, smallest=smallest))
        start = run.field("position")
        trial.advance(run, until=0.01)
        displacement = np.abs(run.field("position") - start - run.time * velocity).max()
        trial.check("displacement less v t [h]", displacement / CELLS[2], at_most=1e-9)
        trial.check("area under tension", float(run._shared["surface"].sample_area.sum()), equals=0)
    return trial.result()


def filament(context: Context, backend: str, tension: float = TENSION) -> Result:
    """A row of particles one particle wide."""
    trial = Trial(context, backend)
    place = np.zeros((80, 3))
    place[:, 0] = 0.5 * np.arange(80) + 0.13
    place[:, 1] = 0.41
    with trial.ending():
        run = trial.start(liquid(place, tension=tension))
        run.evaluate()
        trial.check("inner particles recognised as a filament", int((run.field("extent") == 1).sum()), at_least=76)
        trial.advance(run, until=0.5)
    return trial.result()


def sheet(context: Context, backend: str) -> Result:
    """A sheet of 40 by 1 cells, two particles thick, draws in."""
    trial = Trial(context, backend)
    with trial.ending():
        ledger = free_body(trial, liquid(block((40, 1)), tension=0.1), 0.3)
        trial.check("extent over the start's", ledger.last("extent") / ledger.rows[0]["extent"], at_most=0.95)
    return trial.result()


def close_drops(context: Context, backend: str, gap: float) -> Result:
    """Two drops nearer than 2 r share one surface, and run together."""
    trial = Trial(context, backend)
    one = disc(6.0)
    with trial.ending():
        place = np.vstack([one, one + [12.0 + gap, 0.37, 0.0]])
        ledger = free_body(trial, liquid(place), 0.2, angular=REMADE)
        size = context.started[-1][1]._shared["surface"].latest.component_size
        trial.check("particles in one component", float(np.asarray(size).min()), equals=len(place))
        trial.check("extent over the start's", ledger.last("extent") / ledger.rows[0]["extent"], at_most=0.98)
    return trial.result()


def cavity(context: Context, backend: str) -> Result:
    """A hole narrower than 2 r has no surface: without tension it closes only as the liquid around it moves."""
    trial = Trial(context, backend)
    place = disc(9.0)
    place = place[np.linalg.norm(place, axis=1) > 1.1]
    with trial.ending():
        free_body(trial, liquid(place), 0.1)
        sample = context.started[-1][1]._shared["surface"].sample_position / CELLS[2]
        trial.check("samples in the hole", int((np.linalg.norm(sample, axis=1) < 3).sum()), equals=0)
    return trial.result()


def far_end(context: Context, backend: str, cells: float, velocity: float) -> Result:
    """A drop `cells` before the last cell of the grid; with a velocity [m/s] it flies over it."""
    trial = Trial(context, backend)
    with trial.ending():
        place = disc(3.0) + [FARTHEST - cells, -FARTHEST + cells, 0.0]
        free_body(trial, liquid(place, velocity=(velocity, 0.0, 0.0)), 0.02)
    return trial.result()


def on_nodes(context: Context, backend: str) -> Result:
    """A square whose particles stand on nodes and in the middle between them: every floor is a tie."""
    trial = Trial(context, backend)
    with trial.ending():
        place = block((8, 8), (-0.25, -0.25, 0.0))
        assert not np.any((2 * place) % 1)
        free_body(trial, liquid(place), 0.1)
    return trial.result()


def spin(context: Context, backend: str) -> Result:
    """A disc of radius 8 h turns with 20 rad/s."""
    trial = Trial(context, backend)
    place = disc(8.0)
    centre = place.mean(0)
    velocity = SPIN * CELLS[2] * np.cross([0, 0, 1], place - centre)
    with trial.ending():
        ledger = free_body(trial, liquid(place, velocity=velocity), 0.2, angular=REMADE)
        share = min(row["kinetic"] for row in ledger.rows) / ledger.rows[0]["kinetic"]
        trial.check("least kinetic energy over the start's", share, at_least=0.9)
    return trial.result()


def square(context: Context, backend: str, tension: float, modulus: float, cells: int = 10) -> Result:
    """A square becomes a disc under another tension or stiffness."""
    trial = Trial(context, backend)
    with trial.ending():
        free_body(trial, liquid(block((cells, cells)), tension=tension, modulus=modulus), 0.1, angular=REMADE)
    return trial.result()


def many_samples(context: Context, backend: str) -> Result:
    """A ball whose surface stays at r: some particles are the nearest of more than ten samples."""
    trial = Trial(context, backend)
    with trial.ending():
        ledger = free_body(trial, liquid(block((4, 4, 4)), 3, inset=-1.0), 0.01, every=1, angular=REMADE)
        trial.check("largest C_p", max(row["samples"] for row in ledger.rows), at_least=11)
    return trial.result()


def no_particle(context: Context, backend: str) -> Result:
    """A scene without particles."""
    trial = Trial(context, backend)
    with trial.ending():
        trial.start(liquid(np.zeros((0, 3))))
    trial.check("the sentence says what to add", "add a fluid" in trial.message, equals=1)
    return trial.result()


def one(context: Context, backend: str, tension: float) -> Result:
    """One particle: plain liquid falls freely; with surface tension the scene is refused."""
    trial = Trial(context, backend)
    with trial.ending():
        pull = np.array([0.3, -9.81, 0.0])
        made = liquid(np.array([[0.3, 0.1, 0.0]]), tension=tension, extra=(Gravity(acceleration=tuple(pull)),))
        run = trial.start(made)
        start, v, displacement = run.field("position"), np.zeros(3), np.zeros(3)
        for _ in range(50):
            length = run.step().length
            v = v + length * pull
            displacement = displacement + length * v
        trial.account(run)
        error = np.abs(run.field("position") - start - displacement).max() / np.abs(displacement).max()
        trial.check("displacement against free fall, relative", error, at_most=1e-12)
    return trial.result()


def as_printed(
    context: Context, backend: str, dim: int, embedding: str, step: float, sign: bool, within: int, cells: int,
    halved_within: int = 0,
) -> Result:  # fmt: skip
    """The source's scheme, with its own sign or with the sign alone corrected, until it ends.

    halved_within  steps within which a J falls below 1/2; a run is then taken for
                   failed; its block then stands on the grid's nodes, and samples are the source's, Poisson disks
    """
    trial = Trial(context, backend)
    place = block((cells,) * dim, *([(0.0, 0.0, 0.0)] if halved_within else []))
    made = liquid(
        place, dim, step=step, embedding=embedding, literal=("M31",) if sign else ("M1", "M31"),
        **({"quadrature": "poisson"} if halved_within else {}),
    )  # fmt: skip
    run, halved = None, 0
    with trial.ending():
        run = context.simulation(unguarded(made, step), backend)
        while run.steps < within:
            run.step()
            if not halved and run.field("volume_ratio").min() < 0.5:
                halved = run.steps
    trial.check("ended by itself", trial.ended.startswith("stopped"), equals=1)
    if halved_within:
        trial.check("a J falls below 1/2", halved, at_least=1)
        trial.check("step in which it first does", halved, at_most=halved_within)
    trial.show("step in which J first falls below 1/2", halved)
    if run is not None:
        trial.check("steps", run.steps, at_most=within)
        trial.check("places that are finite", int(np.isfinite(run.field("position")).all()), equals=1)
    return trial.result()


def unguarded(made: Scene, step: float) -> Any:
    """A plan with a fixed step [s], however long: a scene refuses one beyond what is stable."""
    plan = make_plan(msgspec.structs.replace(made, step=1e-9))
    return dataclasses.replace(plan, scene=msgspec.structs.replace(made, step=step))


# The largest stable step


def natural(dim: int, modulus: float, tension: float) -> float:
    """min(h/c, sqrt(rho0 h^3/(2 pi k))) [s]."""
    h = CELLS[dim]
    return min(h / math.sqrt(modulus / DENSITY), math.sqrt(DENSITY * h**3 / (2 * math.pi * tension)))


def step_cell(
    context: Context, backend: str, dim: int, cells: int, until: float, modulus: float, tension: float,
    embedding: str, inset: float,
) -> Result:  # fmt: skip
    """The largest step, over min(acoustic, capillary), with which a square or a cube rounds off."""
    made = liquid(
        block((cells,) * dim), dim, modulus=modulus, tension=tension, embedding=embedding, inset=inset,
    )  # fmt: skip
    unit = natural(dim, modulus, tension)
    try:
        own, refused = context.simulation(made, backend).step().length / unit, False
    except InputError:
        own, refused = 0.0, True

    def trouble(number: float) -> str:
        run = context.simulation(unguarded(made, number * unit), backend)
        context.started[:-1] = []
        ledger = Ledger()
        try:
            run.step()
            ledger(run)
            while run.time < until:
                run.step()
                if run.steps % 25 == 0:
                    ledger(run)
            ledger(run)
        except RunStopped as stop:
            return f"stopped: {stop.reason} in step {run.steps}"
        most = max(row["energy"] for row in ledger.rows) / ledger.rows[0]["energy"]
        return f"{most:.2f} times the energy" if most > ENERGY else ""

    return largest_stable(trouble, 0.5, LEAST, 4.0, factor=1.15).result(own, refused=refused)


LEAST = 0.01  # of the natural step: the smallest that is tried
ENERGY = 1.02  # times the energy after the first step, which a stable run never exceeds
READINGS = {
    "cluster": ("cluster", 0.25), "cluster, no inset": ("cluster", -1.0),
    "none": ("none", 0.25), "none, no inset": ("none", -1.0),
    "gradient-corrected": ("gradient_corrected", 0.25),
    "gradient-corrected, no inset": ("gradient_corrected", -1.0),
    "thesis (4.14)": ("thesis", 0.25), "thesis (4.14), no inset": ("thesis", -1.0),
}  # fmt: skip
LIQUIDS: Mapping[str, dict[str, Any]] = {
    "square, lambda 1000, k 1": {"modulus": 1000.0, "tension": 1.0},
    "square, lambda 100, k 1": {"modulus": 100.0, "tension": 1.0},
    "square, lambda 10,000, k 1": {"modulus": 10000.0, "tension": 1.0},
    "square, lambda 1000, k 0.1": {"modulus": 1000.0, "tension": 0.1},
    # as many capillary times sqrt(rho0 R^3/k) as 0.1 s at k = 1
    "square, lambda 1000, k 10": {"modulus": 1000.0, "tension": 10.0, "until": 0.03},
    "cube, lambda 1000, k 1": {"modulus": 1000.0, "tension": 1.0, "dim": 3, "cells": 10, "until": 0.04},
}
PLANE = {"dim": 2, "cells": 20, "until": 0.1}
STEPS = StabilityMap(
    name="stability_mpm_step",
    title="The longest stable step of each embedding, over min(h/c, sqrt(rho0 h^3/(2 pi k)))",
    quantity="step over min(acoustic, capillary)",
    criterion="a square of 20 cells rounds off for 0.1 s (0.03 s with k = 10), or a cube of 10 cells for 0.04 s,"
    " without a stop and without gaining 2 % of energy.",
    advice="Take the cluster with its inset and the runner's own step.",
    cells=tuple(
        Cell(
            row, column, step_cell, {**PLANE, **given, "embedding": reading, "inset": inset},
            100.0 if inset < 0 and given["tension"] / given["modulus"] >= 0.01 else 25.0,
        )
        for row, (reading, inset) in READINGS.items()
        for column, given in LIQUIDS.items()
    ),
)  # fmt: skip
MAPS = (STEPS,)
