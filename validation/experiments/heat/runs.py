"""Runs of heat conduction: orders in a slab, claims and ranges. The panel `melt_front` holds Stefan's problem.

Everywhere k = rho = c = 1 (SI units), h = 2.5 d; `number` is k dt/(rho c d^2)."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from refsim import Box, HeatConduction, Scene, Simulation
from refsim.core.errors import InputError, RunStopped
from refsim.engine.conserved_totals import conserved_totals
from refsim.heat import kernels
from refsim.scene.plan import Plan, make_plan
from validation.checks import Checks, Quantities
from validation.experiment import Experiment, Measure, Options, Results, RunSpec, each
from validation.experiments.melting.scene import SCALE
from validation.experiments.melting.scene import STEP as PAPER_STEP
from validation.metrics import heat as exact
from validation.metrics.heat import Conductor, cosine_slab
from validation.results import Result, real
from validation.running import Context, take_steps
from validation.trials import Cell, Trial, hard_case, largest_stable, unguarded

SPACING, LENGTH, END = 0.2, 40, 6.4  # of the slab: [m], spacings along x, [s]


# A cosine in an insulated slab, periodic across


def slab_of(scheme: str, cells: int = LENGTH, spacing: float = SPACING, **options: Any) -> tuple[Conductor, np.ndarray]:
    """The slab at its start, and the depth x of its particles [m]."""
    return cosine_slab(scheme, cells, 6, spacing, **options)


def rms(values: np.ndarray) -> float:
    """Root of the mean square; infinite where something has blown up."""
    root = float(np.sqrt((np.asarray(values, dtype=float) ** 2).mean()))
    return root if root < 1e6 else math.inf


# Orders of convergence


def order_in_spacing(context: Context, cells: tuple[int, ...] = (10, 20, 40, 80)) -> Result:
    """Error of the slab's cosine over the spacing, RKL2 with steps so short that they cost no accuracy."""
    length, rows = 8.0, []
    for n in cells:
        slab, x = slab_of("runge_kutta_legendre", n, length / n)
        steps = math.ceil(END / (2.0 * (length / n) ** 2))
        slab.run(END, steps)
        rows.append({"size": length / n, "error": rms(slab.temperature - exact.cosine(x, length, END))})
    return Result({"rows": rows})


STEPS = {
    "explicit": (0.03125, 0.0625, 0.125, 0.25), "one_sided": (0.03125, 0.0625, 0.125, 0.25),
    "implicit": (1.0, 2.0, 4.0, 8.0), "runge_kutta_legendre": (1.0, 2.0, 4.0, 8.0),
}  # fmt: skip


def order_in_step(context: Context, scheme: str) -> Result:
    """Error of half a slab over the step, against the same particles with a step that costs no accuracy.

    What the step does is apart from what the spacing does; linear solves are taken to the end.
    """
    best, _ = slab_of("runge_kutta_legendre", LENGTH // 2)
    best.run(END / 4, 640)
    limit = best.temperature.reshape(LENGTH // 2, -1).mean(1)
    rows = []
    for number in STEPS[scheme]:
        slab, _ = slab_of(scheme, LENGTH // 2, tolerance=1e-9)
        slab.run(END / 4, round(END / 4 / (number * SPACING**2)))
        rows.append({"size": number, "error": rms(slab.temperature.reshape(LENGTH // 2, -1) - limit[:, None])})
    return Result({"scheme": scheme, "rows": rows})


# What the paper on melting claims of its conduction of heat, equation (4), measured on a cosine in a slab.
#
# Read literally (R1: each particle by itself). K of the figures is read in hundredths of a m^2/s, as in the scenes of
# melting (`validation.experiments.melting.scene.SCALE`).


CELLS, ACROSS, CLAIM_SPACING, UNTIL = 20, 10, 0.2, 1.6  # [1], [1], [m], [s]
LARGE = (1.0, 2.0, 4.0, 8.75, 35.0)  # k dt/(rho c d^2) of steps that are long for an explicit scheme
CLAIM_NUMBERS = (2.0, 3.0, 4.0, 6.0, 8.75)  # k dt/(rho c d^2) of long steps; the paper's are 100 times smaller
LONG = (8.75, 100.0, 1e3, 1e5, 3e6)
SEEDS = (1, 2, 3, 4, 5)
PASSES = (1, 2, 4, 8)


def column(scheme: str, seed: int | None = None) -> tuple[Conductor, np.ndarray]:
    """The slab of all claims, and the depth of its particles [m]."""
    return cosine_slab(scheme, CELLS, ACROSS, CLAIM_SPACING, seed)


def swept(made: Conductor, seconds: float, passes: int, reverse: bool) -> None:
    """One step of M(4) in so many passes of equal parts; every second one backwards, or none."""
    t = made.temperature
    exchanges, inverse, *_ = made.weighed(seconds / passes)
    for k in range(passes):
        kernels.sweep(exchanges, inverse, made.conduction, np.int32(reverse and k % 2), t.copy(), t)


def reversal(context: Context, scheme: str, number: float) -> Result:
    """rms error [% of the range] after 1, 2, 4 and 8 passes a step, all forward, and every second one backwards."""
    steps = max(1, round(UNTIL / (number * CLAIM_SPACING**2)))
    errors: dict[str, list[float]] = {"forward": [], "reversed": []}
    for words, reverse in (("forward", False), ("reversed", True)):
        for passes in PASSES:
            made, x = column(scheme)
            for _ in range(steps):
                swept(made, UNTIL / steps, passes, reverse)
            error = made.temperature - exact.cosine(x, CELLS * CLAIM_SPACING, UNTIL)
            errors[words].append(float(np.sqrt((error**2).mean())))
        context.progress(0.5)
    return Result({"passes": PASSES, **errors})


def long_steps(context: Context, scheme: str, number: float) -> Result:
    """How far 20 steps on a jump leave the range of the start, over it; 1e6 where they blow up."""
    made, x = column(scheme)
    made.temperature[...] = np.where(x > CELLS * CLAIM_SPACING / 2, 100.0, 0.0)
    beyond = 0.0
    for _ in range(20):
        made.step(number * CLAIM_SPACING**2)
        beyond = max(beyond, float(made.temperature.max()) / 100 - 1, -float(made.temperature.min()) / 100)
    return Result({"beyond": min(beyond, 1e6) if math.isfinite(beyond) else 1e6})


def numbering(context: Context, scheme: str, seed: int, number: float = 2.0) -> Result:
    """rms difference [% of the range] of a slab whose particles are numbered otherwise."""
    steps, errors = round(UNTIL / (number * CLAIM_SPACING**2)), []
    for order in (None, seed):
        made, x = column(scheme, order)
        made.run(UNTIL, steps)
        depth = np.rint(x / CLAIM_SPACING - 0.5).astype(int)
        errors.append(np.bincount(depth, made.temperature) / np.bincount(depth))
    return Result({"difference": float(np.sqrt(((errors[0] - errors[1]) ** 2).mean()))})


def delivered(context: Context, scheme: str, seed: int | None = None) -> Result:
    """Diffusivity that the cosine's decay shows, over that of the particles, for K of figures 4 to 6.

    d = 0.2, h = 0.5, dt = 0.005 as in table 1; the printed form conducts with 2 K (Shao & Song M6), so that K stands
    for a number of 2 K dt/d^2. With a `seed` the particles are numbered otherwise.
    """
    rows = []
    for diffusivity in (SCALE * k for k in (10.0, 30.0, 50.0, 70.0)):
        number, steps = 2 * diffusivity * PAPER_STEP / CLAIM_SPACING**2, 8
        made, x = column(scheme, seed)
        seconds = number * CLAIM_SPACING**2
        made.run(steps * seconds, steps)
        mode = np.cos(math.pi * x / (CELLS * CLAIM_SPACING))
        left = float((made.temperature - 50) @ mode / (50 * mode @ mode))
        rate = -math.log(left) / ((math.pi / (CELLS * CLAIM_SPACING)) ** 2 * steps * seconds)
        rows.append({"K": diffusivity, "delivered": rate * 2 * diffusivity})
    return Result({"rows": rows})


def _runs(key: str, function: Callable[..., Result], parameters: list[dict[str, Any]], **shared: Any
          ) -> Callable[[Options], list[RunSpec]]:  # fmt: skip
    return lambda options: [
        RunSpec(f"claim_{key}_{k}", function, {**own, **shared}, estimate=20.0) for k, own in enumerate(parameters)
    ]


def _reversed(passes: int) -> Measure:
    """Error of so many passes of which every second one runs backwards, over that of passes forwards."""
    at = PASSES.index(passes)
    runs = _runs("reversal_one_sided", reversal, [{"number": number} for number in CLAIM_NUMBERS], scheme="one_sided")
    return Measure(runs, each(lambda v: real(v["reversed"][at]) / real(v["forward"][at])))


CLAIMS = {f"heat_reversed_single_{passes}": _reversed(passes) for passes in PASSES[1:]}
HEAT_LONG_STEPS_HOLD = Measure(
    _runs("long", long_steps, [{"number": number} for number in LONG], scheme="one_sided"), each("beyond")
)
HEAT_EXPLICIT_BREAKS = Measure(
    _runs("explicit", long_steps, [{"number": number} for number in LARGE], scheme="explicit"), each("beyond")
)
HEAT_ORDER_MATTERS = Measure(
    _runs("order", numbering, [{"seed": seed} for seed in SEEDS], scheme="one_sided"), each("difference")
)


HEAT_MATERIAL_COUNTS_SINGLE = Measure(  # diffusivity that K = 70 delivers over that of K = 10, over seven
    _runs("material_one_sided", delivered, [{"seed": seed} for seed in SEEDS], scheme="one_sided"),
    each(lambda v: real(v["rows"][-1]["delivered"]) / real(v["rows"][0]["delivered"]) / 7),
)

# Null models


def _other_scheme(measure: Measure, scheme: str, number: float) -> list[float]:
    """What another scheme does with a long step on the same jump."""
    return measure.of({"": dict(long_steps(Context(), scheme, number).values)})


def _same_numbering(measure: Measure) -> list[float]:
    """Explicit conduction, which takes all temperatures of the step before."""
    return measure.of({"": dict(numbering(Context(), "explicit", 1, 0.1).values)})


# Hard cases of heat conduction, and the largest stable step of every scheme.


HARD_SPACING, DENSITY, CAPACITY = 0.1, 1000.0, 1000.0  # [m], [kg/m^3], [J/(kg K)]; the conductivity is 1 W/(m K)
UNIT = HARD_SPACING**2 * DENSITY * CAPACITY  # [s]: the step of k dt/(rho c d^2) = 1
WARM, COLD, HARD_LATENT = 50.0, -10.0, 3e4  # [deg C], [deg C], [J/kg]
ICE = {"melting_point": 0.0, "latent_heat": HARD_LATENT}
MELTING = ("runge_kutta_legendre", "implicit")  # which also keep the heat
# Share of the range by which a scheme may leave it: what its solve leaves, or rounding
BOUNDED = {"one_sided": 1e-12, "implicit": 1e-3}
KEPT = 1e-12


def halves(number: float, scheme: str, cells: tuple[int, int, int] = (8, 4, 4), **options: Any) -> Scene:
    """A warm half beside a cold one, in steps of k dt/(rho c d^2) = `number`."""
    given = {
        "temperature": (WARM, COLD), "conductivity": 1.0, "heat_capacity": CAPACITY, "largest_number": 1e9,
        "largest_drift": 0.0, **options,  # each scheme's own promise is checked
    }  # fmt: skip
    fluid = (Box(cells=cells), Box(lower=(cells[0] * HARD_SPACING, 0.0, 0.0), cells=cells))
    return Scene(
        spacing=HARD_SPACING, support_radius=2.5 * HARD_SPACING, fluid=fluid, step=number * UNIT, dtype="float64",
        effects=(HeatConduction(scheme=scheme, **given),),
    )  # fmt: skip


def heat(simulation: Simulation) -> float:
    """The ledger's heat [J]."""
    return conserved_totals(simulation)["effects"]["heat_conduction"]["heat"]


def watched(
    trial: Trial, scene: Scene, steps: int, volume: np.ndarray | None = None, beyond: float | None = None
) -> Simulation:
    """Steps of a scene; what its scheme promises is checked: the range, and the heat."""
    simulation = trial.start(scene)
    if volume is not None:
        for name, factor in (("volume", 1.0), ("mass", DENSITY)):
            simulation.fields[name][...] = simulation.backend.asarray(factor * volume)
    (effect,) = scene.effects
    start = simulation.field("temperature")
    low, high = float(start.min()), float(start.max())
    extent = max(high - low, 1e-300)
    mass, before = simulation.field("mass").astype(float), heat(simulation)
    size = CAPACITY * float((mass * max(abs(low), abs(high))).sum()) + effect.melts * HARD_LATENT * float(mass.sum())
    label = f"{effect.scheme}{', ice' if effect.melts else ''}"
    for _ in range(steps):
        simulation.step()
        now = simulation.field("temperature")
        out = max(float(now.max()) - high, low - float(now.min()), 0.0) / extent
        if beyond is not None:
            trial.check(f"{label}: beyond the range", out, at_most=beyond)
        else:
            trial.show(f"{label}: beyond the range", max(out, trial.shown.get(f"{label}: beyond the range", 0.0)))
    change = abs(heat(simulation) - before) / size
    if effect.scheme in MELTING and not effect.held:
        trial.check(f"{label}: heat", change, at_most=KEPT)
    elif not effect.held:
        trial.show(f"{label}: heat", change)
    return simulation


@hard_case
def each_scheme(trial: Trial, what: str, number: float, steps: int) -> None:
    """Every scheme with volumes 100 : 1, with conductivities 1000 : 1, or with neither, in long steps."""
    count = 2 * 8 * 4 * 4
    random = np.random.default_rng(5)
    options: dict[str, Any] = {}
    volume = None
    if what == "volumes":
        volume = HARD_SPACING**3 * random.choice([1.0, 0.01], count)
    if what == "conductivities":
        options["conductivity"] = tuple(random.choice([1.0, 1e-3], count).tolist())
    for scheme, beyond in BOUNDED.items():
        watched(trial, halves(number, scheme, **options), steps, volume, beyond)
    watched(trial, halves(number, "runge_kutta_legendre", **options), steps, volume)
    watched(trial, halves(number, "implicit", **options, **ICE), steps, volume, BOUNDED["implicit"])


@hard_case
def explicit_long(trial: Trial) -> None:
    """An explicit step of 20 in k dt/(rho c d^2) is refused: 0.29 is stable."""
    trial.start(halves(20.0, "explicit"))


@hard_case
def explicit_forced(trial: Trial, number: float = 2.0) -> None:
    """The explicit scheme made to take steps of 2 all the same, and the others with the same steps."""
    for scheme, beyond in BOUNDED.items():
        watched(trial, halves(number, scheme), 50, beyond=beyond)
    watched(trial, halves(number, "runge_kutta_legendre"), 50, beyond=1e-3)
    simulation = trial.start(forced(number))
    take_steps(simulation, 2000)


def forced(number: float) -> Plan:
    """A plan of the explicit scheme with a step that a scene would refuse."""
    return unguarded(halves(number, "explicit"), 0.1 * UNIT)


@hard_case
def at_melting_point(trial: Trial) -> None:
    """Everything exactly at the melting point, as ice: nothing moves, nothing melts, to the last bit."""
    for scheme in MELTING:
        scene = halves(2.0, scheme, temperature=(0.0, 0.0), **ICE)
        simulation = watched(trial, scene, 5)
        off = float(abs(simulation.field("temperature")).max() + abs(simulation.field("enthalpy")).max())
        trial.check(f"{scheme}: temperature and enthalpy of ice at 0", off, equals=0)
        scene = halves(2.0, scheme, temperature=(0.0, COLD), **ICE)
        cooled = watched(trial, scene, 20)
        trial.check(f"{scheme}: melted beside colder ice", float(cooled.field("enthalpy").max()), at_most=1e-9)


@hard_case
def nothing_melts(trial: Trial) -> None:
    """Ice of two temperatures below its melting point: no enthalpy rises above 0, and heat evens out."""
    for scheme in MELTING:
        simulation = watched(trial, halves(2.0, scheme, temperature=(-1.0, COLD), **ICE), 40)
        trial.check(f"{scheme}: highest enthalpy", float(simulation.field("enthalpy").max()), at_most=0.0)
        spread = float(np.ptp(simulation.field("temperature"))) / 9.0
        trial.check(f"{scheme}: spread of temperatures left", spread, at_most=0.99)


@hard_case
def everything_melts(trial: Trial) -> None:
    """A block of ice beside one that is held at 50 deg C melts to the last particle and becomes as warm."""
    for scheme in MELTING:
        scene = halves(3.0, scheme, cells=(4, 4, 4), held=(0,), **ICE)
        simulation = watched(trial, scene, 160, beyond=1e-3)
        inner = slice(64, None)
        least = float(simulation.field("enthalpy")[inner].min()) / HARD_LATENT
        trial.check(f"{scheme}: least enthalpy over the latent heat", least, at_least=1.0)
        trial.check(f"{scheme}: coldest", float(simulation.field("temperature")[inner].min()), at_least=45.0)
        trial.check(f"{scheme}: warmest", float(simulation.field("temperature").max()), at_most=WARM * (1 + 1e-3))


@hard_case
def layer_at_once(trial: Trial) -> None:
    """A step so long that the ice's whole first layer melts in it: no particle of the layer is left behind."""
    latent = 3e3  # 3 K
    for scheme in MELTING:
        scene = halves(2.0, scheme, temperature=(WARM, -0.5), melting_point=0.0, latent_heat=latent)
        simulation = watched(trial, scene, 1)
        first = np.isclose(simulation.field("position")[:, 0], 8.5 * HARD_SPACING)
        share = simulation.field("enthalpy")[first] / latent
        trial.check(f"{scheme}: least molten share in the layer", float(share.min()), at_least=1.0)
        x, there = simulation.field("position"), simulation.field("enthalpy")
        turned = np.lexsort((x[:, 2], 4 * HARD_SPACING - x[:, 1], x[:, 0]))
        mirrored = there[np.lexsort((x[:, 2], x[:, 1], x[:, 0]))]
        off = float(abs(there[turned] - mirrored).max()) / latent
        trial.check(f"{scheme}: difference from its mirror image", off, at_most=1e-9)


@hard_case
def giant_step(trial: Trial, number: float = 3e6) -> None:
    """One step of s_max = 1e7: backward Euler ends at the mean temperature."""
    mean = 0.5 * (WARM + COLD)
    for scheme, beyond in BOUNDED.items():
        simulation = watched(trial, halves(number, scheme), 1, beyond=beyond)
        off = float(abs(simulation.field("temperature") - mean).max()) / (WARM - COLD)
        if scheme == "implicit":
            trial.check(f"{scheme}: distance from the mean", off, at_most=0.01)
        else:
            trial.show(f"{scheme}: distance from the mean", off)
    watched(trial, halves(number, "implicit", **ICE), 1, beyond=BOUNDED["implicit"])


# The map


def step_cell(context: Context, backend: str, scheme: str, melts: bool, steps: int = 20) -> Result:
    """The largest k dt/(rho c d^2) in which a warm and a cold half stay within their range, to a thousandth.

    With latent heat the cold half is ice and the warm one a reservoir.
    """
    options: dict[str, Any] = {**ICE, "held": (0,)} if melts else {}

    def trouble(number: float) -> str:
        scene: Scene | Plan = forced(number) if scheme == "explicit" else halves(number, scheme, **options)
        beyond = 0.0
        try:
            simulation = context.simulation(scene, backend)
            context.started[:] = []
            for _ in range(steps):
                simulation.step()
                now = simulation.field("temperature")
                over, under = float(now.max()) - WARM, COLD - float(now.min())
                beyond = max(beyond, over / (WARM - COLD), under / (WARM - COLD))
        except RunStopped as stop:
            return f"stopped: {stop.reason}"
        except InputError:
            return "refused"
        return f"{100 * beyond:.2g} % beyond the range" if not beyond <= 1e-3 else ""

    plan = make_plan(halves(0.1, scheme, largest_number=HeatConduction().largest_number, **options))
    limit = plan.effects["heat_conduction"].step_limits(plan.grid, plan.effects)["conduction"]
    return largest_stable(trouble, 0.25, 0.05, 1e4, factor=1.2).result(limit.length / UNIT)


PLAIN = ("explicit", *MELTING, "one_sided")

MAPS = {
    "stability_heat_step": tuple(
        Cell(name, column, step_cell, {"scheme": name, "melts": names is MELTING}, 5.0)
        for column, names in (("no latent heat", PLAIN), ("latent heat", MELTING))
        for name in names
    )
}


# Heat conduction: orders of every scheme.


def planned(options: Options) -> list[RunSpec]:
    """The runs under the options."""
    slow = "takes minutes with the others; run without --quick" if options.quick else ""
    steps = (RunSpec(f"step_{name}", order_in_step, {"scheme": name}, 5.0, slow) for name in STEPS)
    return [*steps, RunSpec("spacing", order_in_spacing, {}, 4.0)]


def order_of(rows: list[dict[str, Any]]) -> float:
    """Slope of log error against log size, by least squares; NaN for fewer than three sizes with an error above 0."""
    pairs = [(real(row["size"]), real(row["error"])) for row in rows]
    pairs = [(size, error) for size, error in pairs if math.isfinite(error) and error > 0]
    return float(np.polyfit(*np.log(pairs).T, 1)[0]) if len(pairs) >= 3 else math.nan


def checks(results: Results, check: Checks) -> None:
    """What each bar is held against."""
    check.run(results, "spacing", {"order_in_spacing": lambda v: order_of(v["rows"])})
    for name in STEPS:
        order: Quantities = {f"order_{name}": lambda v: order_of(v["rows"])}
        check.run(results, f"step_{name}", order)


EXPERIMENT = Experiment(
    name="heat", title="conduction of heat: orders of every scheme", runs=planned, checks=checks,
)  # fmt: skip
