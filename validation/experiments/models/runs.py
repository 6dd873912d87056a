"""Runs of the models: the droplet's cube to a ball."""

import math
import time
from collections.abc import Callable, Mapping
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from refsim import Akinci2013, Cloud, Dong2016, ImplicitPressure, Scene, Simulation, WeaklyCompressible
from refsim.core.effect import Effect
from refsim.core.errors import InputError, RunStopped
from refsim.scene.plan import make_plan
from validation.checks import Checks
from validation.experiment import Experiment, Measure, Options, Results, RunSpec, each, every
from validation.experiments.droplet.runs import BOILS, CALM, pieces, relaxed
from validation.experiments.droplet.scene import droplet_scene, particles
from validation.experiments.models.scene import EQUAL, MODELS
from validation.measure.drops import MODELS as SETTINGS
from validation.measure.drops import OTHER_BASE
from validation.metrics.droplet import near_of, surface
from validation.metrics.shapes import LATTICES, lattice_ball, lattice_cube
from validation.results import Result, floats, real
from validation.running import Context, momenta
from validation.trials import Cell, Trial, hard_case, largest_stable, silent_up_to


def relax(context: Context, model: str, shape: str, count: int, backend: str, seed: int = 1) -> Result:
    """From a cube to rest under one model; also when it came to rest, round or not, and what its surface is like.

    At rest from: the first sample from which on the kinetic energy stays below 1e-3 of its peak.
    """
    chosen = (MODELS | EQUAL)[model]
    result = relaxed(context, chosen.words, chosen.changes, shape, count, backend, seed=seed)
    values = dict(result.values)
    energy = floats(values["series"]["kinetic_energy"])
    busy = np.flatnonzero(~(energy <= CALM * energy.max()))
    first = int(busy.max(initial=-1)) + 1
    still = not values["stopped"] and first < len(energy)
    values["rest"] = {k: values["series"][k][first] for k in ("time", "wall", "steps")} if still else None
    values["surface"] = {"end": surface(result.arrays["position"][-1], values["spacing"], values["radius"])}
    return Result(values, result.arrays)


# What Jiang & Zhu 2023 say of the models that they compare with (figure 6 and table 1), measured on their drops.
#
# Starts are the lattice cube of 4,913 particles and cubes of 5,039 cut from turned lattices.


ROUND = 1.005  # area over that of a ball up to which a drop at rest is one
STARTS = {
    "cube": ("cube", 4913, 1), "cut": ("cut", 5039, 1), "cut_2": ("cut", 5039, 2), "cut_3": ("cut", 5039, 3),
    "cut_4": ("cut", 5039, 4),
}  # fmt: skip
SIDES = (9, 10, 11, 12, 13)  # of the cubes on which models are compared at equal settings
SMALL = {f"cube_{side}": ("cube", side**3, 1) for side in SIDES}


def drop(options: Options, model: str, start: str) -> RunSpec:
    """A run of the experiment, or the same from another rotation."""
    shape, count, seed = (STARTS | SMALL)[start]
    parameters = {"model": model, "shape": shape, "count": count, "backend": options.backend}
    if seed != 1:
        parameters["seed"] = seed
    return RunSpec(f"{start}_{model}", relax, parameters, estimate=40.0 if start in STARTS else 8.0)


def measured(
    value: Callable[[Mapping], float], *models: str, timed: bool = False, starts: Mapping[str, Any] = STARTS
) -> Measure:
    """The value of a model's drop, or of a first model's over that of a second's, start by start.

    Infinite where the first is (never at rest), whether or not the second is.
    """

    def planned(options: Options) -> list[RunSpec]:
        return [drop(options, model, start) for start in starts for model in models]

    def values(results: Results) -> list[float]:
        measured_values = []
        for start in starts:
            parts = [value(results[f"{start}_{model}"].values) for model in models]
            measured_values.append(parts[0] if len(parts) == 1 or math.isinf(parts[0]) else parts[0] / parts[1])
        return measured_values

    return Measure(planned, values, quick=False, timed=timed)


def nearest(values: Mapping) -> float:
    """Nearest neighbour, 5th percentile [d]."""
    return real(values["end"]["nn_5"])


def roughness(values: Mapping) -> float:
    """Radius variation at the end; infinite where the drop is torn."""
    variation = real(values["end"]["radius_variation"])
    return math.inf if math.isnan(variation) else variation


def area(values: Mapping) -> float:
    """Area of the surface over that of a ball of the same volume; infinite where the drop is torn."""
    area_at_end = real(values["surface"]["end"]["area"])
    return math.inf if math.isnan(area_at_end) else area_at_end


def whole_area(values: Mapping) -> float:
    """Area of the drop's surface and of the thrown particles, each a ball, over that of one ball of all liquid."""
    surface, count = values["surface"]["end"], values["particles"]
    thrown = surface["thrown"]
    return area(values) * (1 - thrown / count) ** (2 / 3) + thrown / count ** (2 / 3)


def gap(values: Mapping) -> float:
    """Distance from the surface to the nearest particle, 99th percentile [d]."""
    return real(values["surface"]["end"]["gap"])


def expansion(values: Mapping) -> float:
    """Growth of the distance of the farthest particle from the middle over the last third of the time."""
    extent = values["series"]["extent"]
    return real(extent[-1]) / real(extent[2 * (len(extent) - 1) // 3]) - 1


def rest(values: Mapping, of: str = "wall") -> float:
    """Wall seconds until at rest as a ball, or `of` "time" those simulated; infinite where that never comes, as for a
    star that has frozen."""
    return real(values["rest"][of]) if values["rest"] is not None and whole_area(values) <= ROUND else math.inf


def rest_time(values: Mapping) -> float:
    """Simulated seconds until at rest as a ball."""
    return rest(values, "time")


RIVAL_CSF_UNEVEN = measured(nearest, "csf")
RIVAL_CSF_GAPS = measured(gap, "csf", "jiang_zhu")
RIVAL_CSF_EXPANDS = measured(expansion, "csf")
RIVAL_CSF_AREA = measured(whole_area, "csf")
RIVAL_CSF_ROUGH = measured(roughness, "csf", "jiang_zhu")
RIVAL_BECKER_CLUSTERS = measured(nearest, "becker_teschner_printed")
RIVAL_BECKER_AREA = measured(whole_area, "becker_teschner")
RIVAL_BECKER_ROUGH = measured(roughness, "becker_teschner", "jiang_zhu")
RIVAL_AKINCI_ROUGH = measured(roughness, "akinci", "jiang_zhu")
RIVAL_AKINCI_AREA = measured(whole_area, "akinci")
RIVAL_IISPH_AREA = measured(whole_area, "akinci_iisph")
RIVAL_IISPH_ROUGH = measured(roughness, "akinci_iisph", "jiang_zhu")
OWN_DROP_ROUND = measured(whole_area, "jiang_zhu")
SOONER_THAN_CSF = measured(rest, "jiang_zhu", "csf", timed=True)
SOONER_THAN_BECKER = measured(rest, "jiang_zhu", "becker_teschner", timed=True)
SOONER_THAN_AKINCI = measured(rest, "jiang_zhu", "akinci", timed=True)
SOONER_THAN_IISPH = measured(rest, "jiang_zhu", "akinci_iisph", timed=True)

# Cubes of 9^3 to 13^3: the paper's own choices (pairs with one particle in S, J(10) and J(9) as printed), refsim's
# default, and Akinci at its own best settings and at those of Jiang & Zhu.

CLUSTERS_PAPER = measured(nearest, "jiang_zhu_paper", starts=SMALL)
CLUSTERS_CLAMPED = measured(nearest, "jiang_zhu_clamped", starts=SMALL)
CLUSTERS_EITHER = measured(nearest, "jiang_zhu_either", starts=SMALL)
CLUSTERS_DEFAULT = measured(nearest, "jiang_zhu", starts=SMALL)
CLUSTERS_BESIDE_AKINCI = measured(nearest, "jiang_zhu_paper", "akinci_equal", starts=SMALL)
AKINCI_ROUGH_EQUAL = measured(roughness, "akinci_equal", "jiang_zhu_paper", starts=SMALL)
PAPER_DROP_ROUND = measured(whole_area, "jiang_zhu_paper", starts=SMALL)
SOONER_PAPER = measured(rest_time, "jiang_zhu_paper", "akinci_equal", starts=SMALL)
SOONER_BEST = measured(rest_time, "jiang_zhu", "akinci", starts=SMALL)
SOONER_EQUAL = measured(rest_time, "jiang_zhu", "akinci_equal", starts=SMALL)


def step_cost(context: Context, side: int, backend: str, turns: int = 24) -> Result:
    """Processor seconds of a step on one thread at the start of a cube, by model: lower quartile of `turns` readings.

    The models take turns.
    """
    position, spacing, _ = particles("cube", side**3)
    made = {
        name: context.simulation(droplet_scene(position, spacing, **(MODELS | EQUAL)[name].changes), backend, 1)
        for name in ("jiang_zhu", "jiang_zhu_paper", "jiang_zhu_either", "akinci", "akinci_equal")
    }
    spent: dict[str, list[float]] = {name: [] for name in made}
    for turn in range(turns + 2):  # what the first ones compile does not count
        for name, simulation in made.items():
            began = time.process_time()
            for _ in range(4):
                simulation.step()
            if turn > 1:
                spent[name].append((time.process_time() - began) / 4)
    return Result({name: float(np.quantile(taken, 0.25)) for name, taken in spent.items()})


def cost(own: str, over: str) -> Measure:
    """Processor seconds of a step of one model over those of another."""
    runs = {f"claim_step_{side}": {"side": side} for side in SIDES}
    return Measure(every(step_cost, runs, 6.0), each(own, over), timed=True)


STEP_ON_SURFACE = cost("jiang_zhu_paper", "jiang_zhu")
STEP_EITHER = cost("jiang_zhu_either", "jiang_zhu")
STEP_BEST = cost("jiang_zhu", "akinci")
STEP_EQUAL = cost("jiang_zhu", "akinci_equal")

# Null models


def _lattice(measure: Measure, shape: str, side: int) -> list[float]:
    """What `surface` and nearest neighbours are of particles at rest on a lattice, with spacing 1."""
    place = LATTICES[shape](side).astype(float)
    end = surface(place, 1.0, radius_of(place))
    return measure.of({"": {"surface": {"end": end}, "particles": len(place), "end": {"nn_5": near_of(place)}}})


# Hard cases of a drop under every model of surface tension, and their largest stable coefficients.
#
# Lengths in spacings, rho0 = 1 and the nominal sigma = 1, as in `validation.measure.drops`: t_sigma =
# sqrt(rho R^3/sigma) and Oh = mu/sqrt(rho sigma R) are those of the nominal tension. h = 2.6 d and
# S = sigma/(rho0 c^2 d) = 0.01 unless said.


HARD_MODELS = ("jiang_zhu", "akinci", "akinci_iisph", "dong", "becker_teschner", "tartakovsky_meakin", "he", "csf")
STIFFNESS = 0.01
UNBOUND = 1e6  # of the density: the maps ask which tensions end in a drop, however dense it was on the way
HARD_CALM = 0.3  # Ohnesorge number
TOGETHER = "the drop stays together"
# What the models' own notes say of drops, at some settings or at all.
FORESEEN = {
    "he": "gather in pairs", "csf": "gather in pairs", "akinci_iisph": "tremble at rest",
    "dong": "freeze in the shape they have",
}  # fmt: skip
KEPT = "momentum gained over the largest sum of m |v|"  # rounding of float32 over some hundred steps leaves 1e-5


def words_of(model: str) -> str:
    """A model in words."""
    return "Akinci 2013 on IISPH" if model == "akinci_iisph" else SETTINGS[model][0]


def effects_of(model: str) -> tuple[Effect, ...]:
    """The model with its nominal tension of 1, at the settings of the sigma map."""
    if model == "akinci_iisph":
        return (Akinci2013(surface_tension=1.0), ImplicitPressure())
    return (SETTINGS[model][1](),)


def drop_scene(
    model: str, position: NDArray, velocity: NDArray | None = None, *, viscosity: float = 0.0, support: float = 2.6,
    stiffness: float = STIFFNESS, effects: tuple[Effect, ...] | None = None, dtype: str = "float32",
    form: Any = "laplacian",
) -> Scene:  # fmt: skip
    """Liquid of the given particles (n, 3) [d] without gravity."""
    fluid = WeaklyCompressible(
        rest_density=1.0, sound_speed=1 / math.sqrt(stiffness), dynamic_viscosity=viscosity, density_bound=UNBOUND,
        kernels=OTHER_BASE.get(model, {}).get("kernels", "mueller"), density="summation", viscosity=form,
    )  # fmt: skip
    return Scene(
        name=model, spacing=1.0, support_radius=support, dtype=dtype,  # type: ignore[arg-type]
        fluid=(Cloud(position=position, velocity=np.zeros(3) if velocity is None else velocity),),
        effects=(fluid, *(effects_of(model) if effects is None else effects)),
    )  # fmt: skip


def radius_of(position: NDArray) -> float:
    """Radius of the ball that so many particles would fill [d]."""
    return (3 * len(position) / (4 * math.pi)) ** (1 / 3)


def thrown_of(position: NDArray) -> int:
    """Particles that are not of the largest piece; all of them where one is nowhere."""
    finite = np.isfinite(position).all()
    return len(position) - int(pieces(position, 2.0)[0]) if finite else len(position)


def ball(count: int, jitter: float = 0.05, seed: int = 1) -> NDArray:
    """A lattice ball of about `count` particles, shifted a little at random, about its centre."""
    position = lattice_ball(count, 1.0)
    position = position + jitter * np.random.default_rng(seed).uniform(-1, 1, position.shape)
    return position - position.mean(0)


class Gone(Exception):
    """Half of the particles have left for good."""


class Watch:
    """Kinetic energy and sum of m |v| of a run; raises Gone once half of the particles are four extents off.

    reach  how many extents
    """

    def __init__(self, reach: float = 4.0) -> None:
        self.reach = reach
        self.energy: list[float] = []
        self.scale: list[float] = []
        self.extent = math.inf

    def __call__(self, simulation: Simulation) -> None:
        x = simulation.field("position").astype(float)
        away = np.linalg.norm(x - x.mean(0), axis=1)
        self.extent = min(self.extent, float(away.max()))
        if np.median(away) > self.reach * self.extent:
            raise Gone
        now = momenta(simulation)
        self.energy.append(now["kinetic_energy"])
        self.scale.append(now["momentum_scale"])

    @property
    def late(self) -> float:
        """Mean kinetic energy of the last fifth, over the largest."""
        last = self.energy[-max(1, len(self.energy) // 5) :]
        return float(np.mean(last)) / max(*self.energy, 1e-300)


def _check(trial: Trial, simulation: Simulation, what: str, value: float, **bound: float) -> None:
    """Check a number that may miss its bound where the run's notes foresaw what the model does."""
    if word := FORESEEN.get(simulation.plan.scene.name, ""):
        trial.check_unless_noted(simulation, word, what, value, **bound)
    else:
        trial.check(what, value, **bound)


def _run(trial: Trial, scene: Scene, until: float, every: int = 8, reach: float = 4.0) -> tuple[Simulation, Watch]:
    """Run an isolated scene to `until`, with the checks of every run."""
    simulation, watch = trial.start(scene), Watch(reach)
    before = momenta(simulation)["momentum"]
    try:
        trial.advance(simulation, until=until, watch=watch, every=every)
    except Gone:
        _check(trial, simulation, TOGETHER, 0, equals=1)
        trial.account(simulation)
    drift = float(np.linalg.norm(momenta(simulation)["momentum"] - before)) / max(*watch.scale, 1e-300)
    # The continuum force is no pair's own: it keeps no momentum, which its page says and the claims measure.
    if any(effect.name == "csf_wang_2019" for effect in scene.effects):
        trial.show(KEPT, drift)
    else:
        trial.check(KEPT, drift, at_most=1e-4)
    return simulation, watch


def _whole(trial: Trial, simulation: Simulation, share: float = 1.0) -> NDArray:
    """One piece and no clumps; returns the places."""
    x = simulation.field("position").astype(float)
    largest = float(pieces(x, 2.0)[0]) / len(x)
    _check(trial, simulation, "largest piece, share of the particles", largest, at_least=share)
    near = near_of(x)
    _check(trial, simulation, "nearest neighbour, 5th percentile [d]", near, at_least=0.4)
    return x


@hard_case
def at_rest(trial: Trial, model: str, count: int, support: float = 2.6) -> None:
    """A small drop, or one whose support hardly reaches its neighbours, comes to rest in one piece."""
    position = ball(count)
    radius = radius_of(position)
    scene = drop_scene(model, position, viscosity=HARD_CALM * math.sqrt(radius), support=support)
    simulation, watch = _run(trial, scene, 6 * radius**1.5)
    _whole(trial, simulation)
    _check(trial, simulation, "kinetic energy at the end over the peak's", watch.late, at_most=BOILS)


@hard_case
def spray(trial: Trial, model: str) -> None:
    """60 lone particles fly straight; 20 pairs and 10 triples keep their momentum and stay finite."""
    random = np.random.default_rng(3)
    places = 40.0 * np.stack(np.meshgrid(*[np.arange(5)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)[:90]
    sizes = [1] * 60 + [2] * 20 + [3] * 10
    shapes = np.array([[0.0, 0.0, 0.0], [1.2, 0.0, 0.0], [0.5, 1.1, 0.0]])
    position = np.concatenate([place + shapes[:n] for place, n in zip(places, sizes)])
    group = np.repeat(random.uniform(-0.15, 0.15, (90, 3)), sizes, axis=0)
    until = 10.0
    simulation, _ = _run(trial, drop_scene(model, position, group), until)
    x = simulation.field("position")
    straight = position[:60] + group[:60] * simulation.time
    off = float(np.abs(x[:60] - straight).max())
    _check(trial, simulation, "lone particles off their straight path [d]", off, at_most=1e-3)
    centre = [np.abs(x[k].mean(0) - (position + group * simulation.time)[k].mean(0)).max() for k in _groups(sizes)]
    if model != "csf":
        trial.check("centres of pairs and triples off theirs [d]", float(max(centre)), at_most=1e-3)
    apart = max(float(np.linalg.norm(x[k] - x[k].mean(0), axis=1).max()) for k in _groups(sizes))
    trial.show("farthest of a pair or triple from its centre [d]", apart)


def _groups(sizes: list[int]) -> list[NDArray]:
    ends = np.cumsum(sizes)
    return [np.arange(end - n, end) for n, end in zip(sizes, ends) if n > 1]


@hard_case
def spinning(trial: Trial, model: str, turns: float = 2.0) -> None:
    """A drop that has come to rest is spun; without viscosity, which brakes rotation, it keeps its angular momentum."""
    position = ball(389)
    radius = radius_of(position)
    calm = trial.start(drop_scene(model, position, viscosity=HARD_CALM * math.sqrt(radius), dtype="float64"))
    trial.advance(calm, until=3 * radius**1.5)
    position = calm.field("position") - calm.field("position").mean(0)
    rate = 1.0 / radius**1.5
    velocity = np.cross([0.0, 0.0, rate], position)
    simulation = trial.start(drop_scene(model, position, velocity, dtype="float64"))
    first = momenta(simulation)["angular_momentum"]
    try:
        trial.advance(simulation, until=turns * 2 * math.pi / rate, watch=Watch(), every=32)
    except Gone:
        trial.check_unless_noted(simulation, "kinetic energy may grow", TOGETHER, 0, equals=1)
    lost = np.linalg.norm(momenta(simulation)["angular_momentum"] - first) / np.linalg.norm(first)
    trial.show("steps", simulation.steps)
    # A drop that flies apart or pairs up loses it, too; the terms that do not act along a pair say so themselves.
    word = "does not act along the pair" if model != "csf" else FORESEEN["csf"]
    trial.check_unless_noted(simulation, word, "angular momentum gone, share", float(lost), at_most=1e-3)


@hard_case
def collision(
    trial: Trial, model: str, offset: float, weber: float = 4.0, form: str = "laplacian", **changed: Any
) -> None:
    """Two drops meet at a Weber number rho v^2 D/sigma (nominal) and become one.

    offset  distance between their paths, over the radius; with the default viscosity, the central form, the angular
            momentum is judged
    changed parameters of the model
    """
    one = ball(257)
    radius = radius_of(one)
    shift = np.array([radius + 1.5, 0.5 * offset * radius, 0.0])
    speed = 0.5 * math.sqrt(weber / (2 * radius))
    position = np.concatenate([one - shift, one + shift])
    velocity = np.repeat([[speed, 0.0, 0.0], [-speed, 0.0, 0.0]], len(one), axis=0)
    effects = tuple(msgspec.structs.replace(effect, **changed) for effect in effects_of(model))
    calm = HARD_CALM * math.sqrt(radius)
    scene = drop_scene(model, position, velocity, viscosity=calm, form=form, effects=effects)
    began = 0.5 * len(position) * speed**2
    simulation, watch = _run(trial, scene, 8 * radius**1.5)
    _whole(trial, simulation, share=0.99)
    _check(trial, simulation, "kinetic energy at the end over the start's", watch.energy[-1] / began, at_most=0.5)
    if form == "central":
        first = simulation.field("mass") @ np.cross(position, velocity)
        lost = momenta(simulation)["angular_momentum"] - first
        share = float(np.linalg.norm(lost) / np.linalg.norm(first))
        word = "does not act along the pair"
        trial.check_unless_noted(simulation, word, "angular momentum gone, share", share, at_most=1e-3)


@hard_case
def torn(trial: Trial, model: str) -> None:
    """A shear tears a drop: rate 12 sqrt(sigma/(rho R^3)) of the nominal tension, hardly any viscosity."""
    position = ball(925)
    radius = radius_of(position)
    rate = 12.0 / radius**1.5
    velocity = np.stack([rate * position[:, 2], np.zeros(len(position)), np.zeros(len(position))], axis=1)
    scene = drop_scene(model, position, velocity, viscosity=0.05 * math.sqrt(radius))
    began = 0.5 * float((velocity**2).sum())
    simulation, watch = _run(trial, scene, 3 * radius**1.5, reach=math.inf)
    x = simulation.field("position").astype(float)
    sizes = pieces(x, 2.0)
    _check(trial, simulation, "kinetic energy over the start's", max(watch.energy) / began, at_most=1.1)
    trial.check("extent over the start's", float(np.ptp(x[:, 0]) / np.ptp(position[:, 0])), at_least=3.0)
    trial.show("pieces of five or more", int((sizes >= 5).sum()))
    trial.show("lone particles", int((sizes == 1).sum()))


# Maps


def trouble_of(context: Context, backend: str, scene: Scene, until: float) -> str:
    """Why a cube is not a drop in one piece at rest; "" if it is."""
    try:
        simulation, watch = context.simulation(scene, backend), Watch()
        for at in np.linspace(0, until, 41)[1:]:
            while simulation.time < at:
                simulation.step()
            watch(simulation)
    except InputError:
        return "refused"
    except Gone:
        return "flies apart"
    except RunStopped as stop:
        return f"stopped: {stop.reason}"
    finally:
        context.started[:-1] = []
    x = simulation.field("position").astype(float)
    if not np.isfinite(x).all():
        return "not finite"
    if thrown := thrown_of(x):
        return f"{thrown} particles thrown off"
    return f"boils: {100 * watch.late:.0f} % of the peak's kinetic energy at the end" if watch.late > BOILS else ""


def area_cell(context: Context, backend: str, model: str, support: float, count: int = 552) -> Result:
    """The largest coefficient of the area term with which a ball cut from the lattice comes to rest.

    As the runner counts it: eps N/(gamma rho0) of Akinci, lambda rho0 d/sigma of Dong.
    """
    position = ball(count)
    radius = radius_of(position)
    plain = drop_scene(model, position, support=support)
    plan = make_plan(plain)
    near = 4 * math.pi / 3 * support**3

    def made(value: float) -> Scene:
        if model == "akinci":
            gamma = Akinci2013(surface_tension=1.0).coefficient(plan.grid, plan.effects)
            effect: Effect = Akinci2013(surface_tension=1.0, area_acceleration=value * gamma / near)
        else:
            effect = Dong2016(surface_tension=1.0, correction=value)
        return drop_scene(model, position, viscosity=HARD_CALM * math.sqrt(radius), support=support, effects=(effect,))

    least, first, most = (0.01, 0.1, 4.0) if model == "akinci" else (1.0, 12.0, 400.0)
    trouble = lambda value: trouble_of(context, backend, made(value), 6 * radius**1.5)  # noqa: E731
    largest = largest_stable(trouble, first, least, most, factor=1.2)
    return largest.result(silent_up_to(made, least, most, but=("viscosity", *FORESEEN.values())))


def stiffness_cell(context: Context, backend: str, model: str, side: int = 8) -> Result:
    """The largest S = sigma/(rho0 c^2 d) at which a cube becomes a drop at rest, its cohesion balanced."""
    position = lattice_cube(side, 1.0)
    radius = radius_of(position)

    def made(value: float) -> Scene:
        viscosity = HARD_CALM * math.sqrt(radius)
        return drop_scene(model, position - position.mean(0), viscosity=viscosity, stiffness=value)

    trouble = lambda value: trouble_of(context, backend, made(value), 6 * radius**1.5)  # noqa: E731
    largest = largest_stable(trouble, 0.01, 1e-3, 0.3, factor=1.3)
    return largest.result(silent_up_to(made, 1e-3, 0.3, but=("viscosity", *FORESEEN.values())))


def inertia_cell(context: Context, backend: str, model: str, side: int = 8) -> Result:
    """The largest 1/Oh with which a cube becomes a drop in one piece, with no more energy than its surface holds."""
    position = lattice_cube(side, 1.0)
    radius = radius_of(position)
    held = 4.5 * (6 * side**2 - 4 * math.pi * radius**2)

    def made(inverse: float) -> Scene:
        return drop_scene(model, position - position.mean(0), viscosity=math.sqrt(radius) / inverse)

    def trouble(inverse: float) -> str:
        watch = Watch()
        try:
            simulation = context.simulation(made(inverse), backend)
            while simulation.time < 4 * radius**1.5:
                simulation.step()
                if simulation.steps % 8 == 0:
                    watch(simulation)
        except RunStopped as stop:
            return f"stopped: {stop.reason}"
        finally:
            context.started[:-1] = []
        if thrown := thrown_of(simulation.field("position").astype(float)):
            return f"{thrown} particles thrown off"
        share = max(watch.energy) / held
        return f"kinetic energy {share:.1f} times that released" if share > 1 else ""

    largest = largest_stable(trouble, 4.0, 1.0, 256.0, factor=1.1)
    return largest.result(silent_up_to(made, 1.0, 256.0, but=tuple(FORESEEN.values())))


MAPS = {
    "stability_models_area": tuple(
        Cell(f"h = {support:g} d", column, area_cell, {"model": model, "support": support}, seconds=25.0)
        for model, column in (("akinci", "Akinci, eps N/(gamma rho0)"), ("dong", "Dong, lambda rho0 d/sigma"))
        for support in (2.0, 2.6)
    ),
    "stability_models_coefficient": tuple(
        Cell(words_of(model), "cube", stiffness_cell, {"model": model}, seconds=20.0) for model in HARD_MODELS
    ),
    "stability_models_inertia": tuple(
        Cell(words_of(model), "cube", inertia_cell, {"model": model}, seconds=20.0) for model in HARD_MODELS
    ),
}


# The models of surface tension side by side (Jiang & Zhu, figures 3 and 6 and table 1; Dong, figure 1).


def planned(options: Options) -> list[RunSpec]:
    """Every model from the cube of 17^3 and from a cube of 5,039 cut from a turned lattice."""
    reason = "takes minutes; run without --quick" if options.quick else ""
    return [
        RunSpec(f"{shape}_{model}", relax, {"model": model, "shape": shape, "count": count, "backend": options.backend},
                20.0, reason, timed=True)
        for shape, count in (("cube", 4913), ("cut", 5039)) for model in MODELS
    ]  # fmt: skip


def checks(results: Results, check: Checks) -> None:
    """Shape, neighbours, rest and momenta of each model at its end; nothing is judged but shown."""
    for key, result in results.items():
        values, label = result.values, f"{result.values['words']}, {result.values['particles']:,} particles"
        for name in ("radius_variation", "nn_5", "kinetic_share", "momentum", "angular_momentum", "bulk_error"):
            check(name, values["end"][name], key, label)
        rest = values["rest"]
        check("rest_time", float("nan") if rest is None else rest["time"], key, label)
        check("rest_seconds", float("nan") if rest is None else rest["wall"], key, label)


EXPERIMENT = Experiment(
    name="models", title="all models of surface tension: force curves, from a cube to a ball, seconds to rest",
    runs=planned, checks=checks,
)  # fmt: skip
