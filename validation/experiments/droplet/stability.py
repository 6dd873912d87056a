"""Hard cases of a drop, and the largest stable step, tension and area coefficient in every pair mode."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from refsim import Scene, Simulation
from refsim.core.errors import InputError, RunStopped
from refsim.scene.plan import make_plan
from refsim.surface_tension.jiang_zhu_2023 import kirkwood_buff_sigma
from validation.experiments.droplet.scene import droplet_scene, particles
from validation.metrics.droplet import nearest_neighbour_distance, radius_variation
from validation.metrics.shapes import lattice_ball
from validation.results import Result
from validation.running import Context, momenta
from validation.trials import Cell, StabilityMap, Trial, largest_stable, silent_up_to

SPACING = 1.0 / 17.0  # of the films and filaments, as in the droplet
CAPILLARY = 0.49  # s: sqrt(rho0 R^3/sigma) of the drop with the volume of a 1 m cube, rho0 = sigma = 1
OHNESORGE = 0.13 / 0.1  # of that drop, over its viscosity [1/(Pa s)]
RELEASED = 6.0 - 4.836  # J: surface energy of a 1 m cube less that of its ball, sigma = 1 N/m
BOILS = 0.1  # of the peak: kinetic energy of a drop that should have come to rest

MODES: dict[str, dict[str, Any]] = {
    "all, balanced": {},
    "all, not balanced": {"balance_pressure": False},
    "soft": {"pair_mode": "soft"},
    "one_sided": {"pair_mode": "one_sided"},
    "either": {"pair_mode": "either"},
    "both": {"pair_mode": "both"},
}
MUELLER = {"kernels": "mueller", "support": 2.6}
WENDLAND = {"kernels": "wendland", "support": 2.7}
CUBIC = {"kernels": "cubic_spline", "support": 2.6}


class Drop(NamedTuple):
    """What became of a drop."""

    stopped: str  # reason, or ""
    peak: float  # kinetic energy [J]
    late: float  # mean kinetic energy of the last fifth [J]
    moving: float  # peak of sum m |v| [kg m/s]
    thrown: int  # particles that are not of the largest piece
    radius: float  # largest distance from the centre, over R
    roughness: float
    near: float  # nearest neighbour, 5th percentile [d]


def pieces(position: NDArray, reach: float) -> NDArray[np.int64]:
    """Sizes of the pieces of a cloud (n, 3) whose particles are nearer than `reach` [m], the largest first."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    pairs = cKDTree(position).query_pairs(reach, output_type="ndarray")
    n = len(position)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    _, label = connected_components(graph, directed=False)
    return np.sort(np.bincount(label))[::-1]


def settle(context: Context, backend: str, scene: Any, until: float) -> Drop:
    """Let a drop move to `until` [s]; a stop is an answer."""
    simulation = context.simulation(scene, backend)
    spacing, energy, moving, stopped = simulation.plan.grid.spacing, [0.0], [0.0], ""
    try:
        for at in np.linspace(0.0, until, 61)[1:]:
            while simulation.time < at:
                simulation.step()
            now = momenta(simulation)
            energy.append(now["kinetic_energy"])
            moving.append(now["momentum_scale"])
    except RunStopped as stop:
        stopped = stop.reason
    x = simulation.field("position").astype(float)
    if not np.isfinite(x).all():
        return Drop(stopped or "non_finite", math.inf, math.inf, math.inf, len(x), math.inf, math.nan, math.nan)
    radius = spacing * (3 * len(x) / (4 * math.pi)) ** (1 / 3)
    return Drop(
        stopped=stopped,
        peak=max(energy),
        late=float(np.mean(energy[-12:])),
        moving=max(moving),
        thrown=len(x) - int(pieces(x, 2.0 * spacing)[0]),
        radius=float(np.linalg.norm(x - x.mean(0), axis=1).max()) / radius,
        roughness=radius_variation(x),
        near=float(np.quantile(nearest_neighbour_distance(x), 0.05)) / spacing,
    )


def trouble_of(drop: Drop) -> str:
    """Why a drop is not whole and at rest; "" if it is."""
    if drop.stopped:
        return f"stopped: {drop.stopped}"
    if drop.thrown:
        return f"{drop.thrown} particles thrown off"
    if drop.late > BOILS * drop.peak:
        return f"boils: {100 * drop.late / drop.peak:.0f} % of the peak's kinetic energy at the end"
    return ""


# Hard cases


def long_step(context: Context, backend: str, factor: float, count: int = 729, until: float = 0.6) -> Result:
    """The default drop with a fixed step of `factor` times the first stable one."""
    trial = Trial(context, backend)
    position, spacing, _ = particles("cube", count)
    scene = droplet_scene(position, spacing)
    first = trial.start(scene).step()
    _watched(trial, msgspec.structs.replace(scene, step=factor * first.length), until)
    return trial.result()


def factor_above_one(context: Context, backend: str) -> Result:
    """A step_factor above 1 is refused."""
    trial = Trial(context, backend)
    position, spacing, _ = particles("cube", 27)
    with trial.ending():
        trial.start(droplet_scene(position, spacing, step_factor=4.0))
    trial.check("the sentence names the largest", "at most 1" in trial.message, equals=1)
    return trial.result()


def hundredfold(context: Context, backend: str, fixed: bool, count: int = 729) -> Result:
    """A hundred times the tension: with the step that suits the simple one, or with the runner's own."""
    trial = Trial(context, backend)
    position, spacing, _ = particles("cube", count)
    scene = droplet_scene(position, spacing, surface_tension=100.0)
    if fixed:
        first = trial.start(droplet_scene(position, spacing)).step()
        scene = msgspec.structs.replace(scene, step=first.length)
    _watched(trial, scene, 3.0 * CAPILLARY / 10.0, tension=100.0)
    return trial.result()


def film(context: Context, backend: str, layers: int, side: int = 15, until: float = 0.4) -> Result:
    """A flat film of one or more layers draws in."""
    trial = Trial(context, backend)
    axes = [np.arange(n) - 0.5 * (n - 1) for n in (side, side, layers)]
    position = SPACING * np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    simulation = _watched(trial, droplet_scene(position, SPACING), until, area=2 * (side * SPACING) ** 2)
    if simulation is not None:
        x = simulation.field("position").astype(float)
        trial.show("extent at the end over the start's", float(np.ptp(x[:, 0]) / np.ptp(position[:, 0])))
        trial.show("pieces", len(pieces(x, 2 * SPACING)))
    return trial.result(position=np.zeros((0, 3)) if simulation is None else x)


def filament(
    context: Context, backend: str, radius: float = 3.0, wave: float = 27.0, waves: int = 6, until: float = 1.2
) -> Result:
    """A thread of liquid whose thickness swells and wanes by a quarter, at the wavelength of 9 radii that grows fastest
    (Rayleigh), breaks into drops."""
    trial = Trial(context, backend)
    reach, length = math.ceil(1.25 * radius), round(wave * waves)
    axes = [np.arange(-reach, reach + 1)] * 2 + [np.arange(length) - 0.5 * (length - 1)]
    lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    local = radius * (1 + 0.25 * np.cos(2 * math.pi * lattice[:, 2] / wave))
    position = SPACING * lattice[np.hypot(lattice[:, 0], lattice[:, 1]) <= local]
    area = 2 * math.pi * radius * length * SPACING**2
    simulation = _watched(trial, droplet_scene(position, SPACING), until, area=area)
    x = np.zeros((0, 3))
    if simulation is not None:
        x = simulation.field("position").astype(float)
        found = pieces(x, 2 * SPACING)
        trial.show("pieces", found.tolist())
        trial.check("drops of more than 100 particles", int((found > 100).sum()), at_least=3)
        trial.check("particles in crumbs of fewer than 5, share", float(found[found < 5].sum()) / len(x), at_most=0.01)
    return trial.result(position=x)


def low_viscosity(context: Context, backend: str, ohnesorge: float, shape: str, count: int = 1331) -> Result:
    """A drop at a low Ohnesorge number mu/sqrt(rho0 sigma R), from a cube's or from a ball's shape."""
    trial = Trial(context, backend)
    with trial.ending():
        position, spacing = start(shape, count)
        scene = droplet_scene(position, spacing, viscosity=ohnesorge / OHNESORGE)
        drop = settle(context, backend, scene, 3 * CAPILLARY)
        if drop.stopped:
            raise RunStopped(drop.stopped, f"The drop stops: {drop.stopped}.")
        simulation = context.started[-1][1]
        trial.show("momentum scale", drop.moving)
        trial.account(simulation, isolated=True)
        for what, value, bound in (
            ("particles thrown off", drop.thrown, {"equals": 0}),
            ("kinetic energy over the surface energy that a cube releases", drop.peak / RELEASED, {"at_most": 1.0}),
            ("nearest neighbour, 5th percentile [d]", drop.near, {"at_least": 0.5}),
        ):
            trial.check_unless_noted(simulation, "viscosity", what, value, **bound)
        trial.show("roughness", drop.roughness)
        trial.show("kinetic energy at the end over the peak's", drop.late / drop.peak)
    return trial.result()


def start(shape: str, count: int) -> tuple[NDArray, float]:
    """Positions [m] and spacing [m] of a drop with the volume of a 1 m cube: "cube", "cut" or "ball"."""
    if shape == "ball":
        spacing = count ** (-1.0 / 3.0)
        return lattice_ball(count, spacing), spacing
    position, spacing, _ = particles(shape, count)
    return position, spacing


def _watched(trial: Trial, scene: Scene, until: float, tension: float = 1.0, area: float = 6.0) -> Simulation | None:
    """Run an isolated drop; kinetic energy is held against its surface energy. None where it does not end."""
    simulation = None
    with trial.ending():
        running = trial.start(scene)
        peak, scale = [0.0], [0.0]

        def watch(simulation: Simulation) -> None:
            now = momenta(simulation)
            peak.append(now["kinetic_energy"])
            scale.append(now["momentum_scale"])

        trial.advance(running, until=until, watch=watch, every=8)
        trial.show("momentum scale", max(scale))
        trial.account(running, isolated=True)
        trial.check("kinetic energy over the start's surface energy", max(peak) / (tension * area), at_most=1.0)
        near = nearest_neighbour_distance(running.field("position").astype(float)) / scene.spacing
        trial.check("nearest neighbour, 5th percentile [d]", float(np.quantile(near, 0.05)), at_least=0.4)
        simulation = running
    return simulation


# Maps


def step_cell(
    context: Context, backend: str, mode: str, scene: Mapping[str, Any], count: int = 1000, until: float = 1.0
) -> Result:
    """The largest multiple of the runner's own step with which a drop moves as it does with half of it."""
    position, spacing, _ = particles("cut", count)
    made = droplet_scene(position, spacing, tension=MODES[mode], **scene)
    plan = make_plan(made)
    limiter = {}

    def run(factor: float) -> Drop:
        # A scene refuses a factor above 1, a plan does not.
        forced = dataclasses.replace(plan, scene=msgspec.structs.replace(made, step_factor=factor))
        drop = settle(context, backend, forced, until)
        limiter[factor] = max(context.started[-1][1].limiters.items(), key=lambda item: item[1], default=("", 0))[0]
        context.started[:-1] = []  # the state of what has been judged is not needed
        return drop

    reference = run(0.5)

    def trouble(factor: float) -> str:
        drop = run(factor)
        if drop.stopped:
            return f"stopped: {drop.stopped}"
        if drop.thrown > reference.thrown + 0.01 * len(position):
            return f"{drop.thrown} particles thrown off"
        if drop.peak > 1.5 * reference.peak:
            return f"{drop.peak / reference.peak:.1f} times the kinetic energy"
        if drop.late > max(3.0 * reference.late, BOILS * reference.peak):
            return f"does not come to rest: {drop.late / max(reference.late, 1e-300):.0f} times the energy at the end"
        return ""

    return largest_stable(trouble, 1.0, 0.25, 16.0).result(1.0, limiter=limiter.get(1.0, ""))


def tension_cell(
    context: Context, backend: str, mode: str, scene: Mapping[str, Any], count: int = 1000, dtype: str = "float32"
) -> Result:
    """The largest tension at a fixed sound speed and Ohnesorge number with which a cut cube becomes a drop at rest.

    As P_int/(rho0 c^2), the share of the bulk modulus that the pair force between all particles would take.
    """
    position, spacing, _ = particles("cut", count)

    def made(number: float) -> Scene:
        sigma = number * _modulus(spacing, scene)
        viscosity = 0.1 * math.sqrt(sigma)
        return droplet_scene(
            position,
            spacing,
            **{**scene, "surface_tension": sigma, "viscosity": viscosity},
            tension={**MODES[mode], "area_ratio": 0.005},
        )

    def trouble(number: float) -> str:
        sigma = number * _modulus(spacing, scene)
        try:
            drop = settle(context, backend, made(number), 4 * CAPILLARY / math.sqrt(sigma))
        except InputError:
            return "refused"
        context.started[:-1] = []
        return trouble_of(drop)

    found = largest_stable(trouble, 0.02, 1e-3, 4.0)
    return found.result(silent_up_to(made, 1e-3, 4.0, but=("viscosity",)))


def _modulus(spacing: float, scene: Mapping[str, Any]) -> float:
    """sigma [N/m] for which P_int = rho0 c^2, with rho0 = 1 kg/m^3, c = 40 m/s."""
    from refsim.surface_tension.jiang_zhu_2023 import kirkwood_buff_pressure

    h = scene["support"] * spacing
    return 40.0**2 * kirkwood_buff_sigma(1.0, 1.0, h, 3) / kirkwood_buff_pressure(1.0, 1.0, h, 3)


def area_cell(
    context: Context,
    backend: str,
    mode: str,
    scene: Mapping[str, Any],
    term: str,
    share_of_step: float = 1.0,
    count: int = 1000,
) -> Result:
    """The largest coefficient of the area term with which a cut cube becomes a drop at rest.

    term  "corrected": area_ratio of J(21); "color": eps'/(gamma rho0) of J(18)
    """
    position, spacing, _ = particles("cut", count)
    gamma = 1.0 / kirkwood_buff_sigma(1.0, 1.0, scene["support"] * spacing, 3)

    def made(value: float) -> Scene:
        if term == "corrected":
            area = {"area_term": "corrected", "area_ratio": value}
        else:
            area = {"area_term": "color", "area_acceleration": value * gamma}
        return droplet_scene(position, spacing, tension={**MODES[mode], **area}, step_factor=share_of_step, **scene)

    def trouble(value: float) -> str:
        drop = settle(context, backend, made(value), 4 * CAPILLARY)
        context.started[:-1] = []
        return trouble_of(drop)

    least, first, most = (1e-3, 0.01, 1.0) if term == "corrected" else (1e-4, 1e-3, 0.1)
    return largest_stable(trouble, first, least, most).result(silent_up_to(made, least, most, but=("viscosity",)))


def inertia_cell(
    context: Context, backend: str, mode: str, scene: Mapping[str, Any], shape: str, count: int = 1331
) -> Result:
    """The largest 1/Oh with which a start becomes a drop in one piece."""
    position, spacing = start(shape, count)

    def trouble(inverse: float) -> str:
        drop = settle(context, backend, made(inverse), 3 * CAPILLARY)
        context.started[:-1] = []
        if drop.stopped:
            return f"stopped: {drop.stopped}"
        if drop.thrown:
            return f"{drop.thrown} particles thrown off"
        return f"kinetic energy {drop.peak / RELEASED:.1f} times that released" if drop.peak > RELEASED else ""

    def made(inverse: float) -> Scene:
        return droplet_scene(position, spacing, tension=MODES[mode], viscosity=1 / (OHNESORGE * inverse), **scene)

    return largest_stable(trouble, 4.0, 1.0, 512.0, factor=1.2).result(silent_up_to(made, 1.0, 512.0))


REGIMES: dict[str, dict[str, Any]] = {
    "acoustic (c = 40, mu = 0.1)": {**MUELLER, "sound_speed": 40.0, "viscosity": 0.1},
    "viscous (c = 40, mu = 2)": {**MUELLER, "sound_speed": 40.0, "viscosity": 2.0},
    "capillary (c = 12, mu = 0.1)": {**MUELLER, "sound_speed": 12.0, "viscosity": 0.1},
}
AREAS: dict[str, dict[str, Any]] = {
    "J(21), Mueller set, 2.6 d": {"scene": MUELLER, "term": "corrected"},
    "the same, a third of the step": {"scene": MUELLER, "term": "corrected", "share_of_step": 1 / 3},
    "J(21), Mueller set, 3.0 d": {"scene": {**MUELLER, "support": 3.0}, "term": "corrected"},
    "J(21), Wendland, 2.7 d": {"scene": WENDLAND, "term": "corrected"},
    "J(21), Wendland, 2.2 d": {"scene": {**WENDLAND, "support": 2.2}, "term": "corrected"},
    "J(18), Mueller set, 2.6 d": {"scene": MUELLER, "term": "color"},
    "J(18), Wendland, 2.7 d": {"scene": WENDLAND, "term": "color"},
    "J(21), cubic spline, 2.6 d": {"scene": CUBIC, "term": "corrected"},
    "J(18), cubic spline, 2.6 d": {"scene": CUBIC, "term": "color"},
}
MAPS = (
    StabilityMap(
        name="stability_drop_step",
        title="Largest stable step of a drop (cut cube of 1,000 particles)",
        quantity="step over the runner's own",
        criterion="no stop, at most 1.5 times the kinetic energy met with half the step, and as much rest at the end.",
        advice="Keep step_factor at 1: the reserve is about two steps, and a fixed step may use no more than that.",
        cells=tuple(
            Cell(mode, column, step_cell, {"mode": mode, "scene": scene}, seconds=30.0)
            for mode in MODES
            for column, scene in REGIMES.items()
        ),
    ),
    StabilityMap(
        name="stability_drop_tension",
        title="Largest tension of a drop at a given sound speed (cut cube of 1,000 particles)",
        quantity="P_int/(rho0 c^2) of the nominal tension, Ohnesorge number 0.13",
        criterion="no stop, one piece, less than a tenth of the peak's kinetic energy after 4 capillary times.",
        advice="Choose the sound speed so that P_int is about 3 % of rho0 c^2.",
        cells=tuple(
            Cell(mode, column, tension_cell, {"mode": mode, "scene": scene}, seconds=30.0)
            for mode in MODES
            for column, scene in (("Mueller set, 2.6 d", MUELLER), ("Wendland, 2.7 d", WENDLAND))
        ),
    ),
    StabilityMap(
        name="stability_drop_area",
        title="Largest area coefficient of a drop (cut cube of 1,000 particles)",
        quantity="eps_r of J(21), or eps'/(gamma rho0) of J(18)",
        criterion="no stop, one piece, less than a tenth of the peak's kinetic energy after 4 capillary times.",
        advice="Bound the coefficient, not the step: a third of the step moves the limit by nothing that matters.",
        cells=tuple(
            Cell(mode, column, area_cell, {"mode": mode, **parameters}, seconds=40.0)
            for mode in MODES
            for column, parameters in AREAS.items()
        ),
    ),
    StabilityMap(
        name="stability_drop_inertia",
        title="Lowest Ohnesorge number of a start (1,331 particles)",
        quantity="1/Oh",
        criterion="no stop, one piece after 3 capillary times, kinetic energy within what a cube's surface releases.",
        advice="Give a drop an Ohnesorge number of 0.2 at least, whatever it starts from: below, it heats itself.",
        cells=tuple(
            Cell(mode, f"{shape} start", inertia_cell, {"mode": mode, "scene": MUELLER, "shape": shape}, seconds=30.0)
            for mode in ("all, balanced", "all, not balanced", "soft")
            for shape in ("cube", "cut", "ball")
        ),
    ),
)
