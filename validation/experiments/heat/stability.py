"""Hard cases of heat conduction, and the largest stable step of every scheme."""

from __future__ import annotations

import dataclasses
from typing import Any

import msgspec
import numpy as np

from refsim import Box, HeatConduction, Scene, Simulation
from refsim.core.errors import InputError, RunStopped
from refsim.engine.stock import stock
from refsim.scene.plan import make_plan
from validation.results import Result
from validation.running import Context
from validation.trials import Cell, StabilityMap, Trial, largest_stable

SPACING, DENSITY, CAPACITY = 0.1, 1000.0, 1000.0  # [m], [kg/m^3], [J/(kg K)]; the conductivity is 1 W/(m K)
UNIT = SPACING**2 * DENSITY * CAPACITY  # [s]: the step of k dt/(rho c d^2) = 1
WARM, COLD, LATENT = 50.0, -10.0, 3e4  # [deg C], [deg C], [J/kg]
ICE = {"melting_point": 0.0, "latent_heat": LATENT}
BOUNDED_ICE = {"single_pass": 1e-12, "nonlinear_jacobi": 1e-12, "implicit": 1e-3}
KEEPING = ("single_pass", "pair_exchange", "conjugate_gradient", "implicit", "runge_kutta_legendre")
BOUNDED = {  # share of the range by which a scheme may leave it: what its solve leaves, or rounding
    "single_pass": 1e-12, "pair_exchange": 1e-12, "one_sided": 1e-12, "conjugate_gradient": 1e-3, "implicit": 1e-3,
}  # fmt: skip
BOUNDED_ICE = {"single_pass": 1e-12, "nonlinear_jacobi": 1e-12, "implicit": 1e-3}
KEEPING = ("single_pass", "pair_exchange", "conjugate_gradient", "implicit", "runge_kutta_legendre")
KEPT = 1e-12


def halves(number: float, scheme: str, cells: tuple[int, int, int] = (8, 4, 4), **options: Any) -> Scene:
    """A warm half beside a cold one, in steps of k dt/(rho c d^2) = `number`."""
    given = {
        "temperature": (WARM, COLD), "conductivity": 1.0, "heat_capacity": CAPACITY, "largest_number": 1e9,
        "largest_drift": 0.0, **options,  # each scheme's own promise is checked
    }  # fmt: skip
    fluid = (Box(cells=cells), Box(lower=(cells[0] * SPACING, 0.0, 0.0), cells=cells))
    return Scene(
        spacing=SPACING, support_radius=2.5 * SPACING, fluid=fluid, step=number * UNIT, dtype="float64",
        effects=(HeatConduction(scheme=scheme, **given),),
    )  # fmt: skip


def heat(simulation: Simulation) -> float:
    """The ledger's heat [J]."""
    return stock(simulation)["effects"]["heat_conduction"]["heat"]


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
    size = CAPACITY * float((mass * max(abs(low), abs(high))).sum()) + effect.melts * LATENT * float(mass.sum())
    words = f"{effect.scheme}{', ice' if effect.melts else ''}"
    for _ in range(steps):
        simulation.step()
        now = simulation.field("temperature")
        out = max(float(now.max()) - high, low - float(now.min()), 0.0) / extent
        if beyond is not None:
            trial.check(f"{words}: beyond the range", out, at_most=beyond)
        else:
            trial.show(f"{words}: beyond the range", max(out, trial.shown.get(f"{words}: beyond the range", 0.0)))
    change = abs(heat(simulation) - before) / size
    if effect.scheme in KEEPING and not effect.held:
        trial.check(f"{words}: heat", change, at_most=KEPT)
    elif not effect.held:
        trial.show(f"{words}: heat", change)
    return simulation


def each_scheme(context: Context, backend: str, what: str, number: float, steps: int) -> Result:
    """Every scheme with volumes 100 : 1, with conductivities 1000 : 1, or with neither, in long steps."""
    trial = Trial(context, backend)
    count = 2 * 8 * 4 * 4
    random = np.random.default_rng(5)
    options: dict[str, Any] = {}
    volume = None
    if what == "volumes":
        volume = SPACING**3 * random.choice([1.0, 0.01], count)
    if what == "conductivities":
        options["conductivity"] = tuple(random.choice([1.0, 1e-3], count).tolist())
    with trial.ending():
        for scheme, beyond in BOUNDED.items():
            watched(trial, halves(number, scheme, **options), steps, volume, beyond)
        watched(trial, halves(number, "runge_kutta_legendre", **options), steps, volume)
        for scheme, beyond in BOUNDED_ICE.items():
            watched(trial, halves(number, scheme, **options, **ICE), steps, volume, beyond)
    return trial.result()


def explicit_long(context: Context, backend: str) -> Result:
    """An explicit step of 20 in k dt/(rho c d^2) is refused: 0.29 is stable."""
    trial = Trial(context, backend)
    with trial.ending():
        trial.start(halves(20.0, "explicit"))
    return trial.result()


def explicit_forced(context: Context, backend: str, number: float = 2.0) -> Result:
    """The explicit scheme made to take steps of 2 all the same, and the others with the same steps."""
    trial = Trial(context, backend)
    with trial.ending():
        for scheme, beyond in BOUNDED.items():
            watched(trial, halves(number, scheme), 50, beyond=beyond)
        watched(trial, halves(number, "runge_kutta_legendre"), 50, beyond=1e-3)
        simulation = trial.start(forced(number))
        while simulation.steps < 2000:
            simulation.step()
    return trial.result()


def forced(number: float) -> Any:
    """A plan of the explicit scheme with a step that a scene would refuse."""
    plan = make_plan(halves(0.1, "explicit"))
    return dataclasses.replace(plan, scene=msgspec.structs.replace(plan.scene, step=number * UNIT))


def at_melting_point(context: Context, backend: str) -> Result:
    """Everything exactly at the melting point, as ice: nothing moves, nothing melts, to the last bit."""
    trial = Trial(context, backend)
    with trial.ending():
        for scheme in ("runge_kutta_legendre", "implicit", "single_pass", "nonlinear_jacobi"):
            scene = halves(2.0, scheme, temperature=(0.0, 0.0), **ICE)
            simulation = watched(trial, scene, 5)
            off = float(abs(simulation.field("temperature")).max() + abs(simulation.field("enthalpy")).max())
            trial.check(f"{scheme}: temperature and enthalpy of ice at 0", off, equals=0)
            scene = halves(2.0, scheme, temperature=(0.0, COLD), **ICE)
            cooled = watched(trial, scene, 20)
            trial.check(f"{scheme}: melted beside colder ice", float(cooled.field("enthalpy").max()), at_most=1e-9)
    return trial.result()


def nothing_melts(context: Context, backend: str) -> Result:
    """Ice of two temperatures below its melting point: no enthalpy rises above 0, and heat evens out."""
    trial = Trial(context, backend)
    with trial.ending():
        for scheme in ("runge_kutta_legendre", "implicit", "single_pass", "nonlinear_jacobi"):
            simulation = watched(trial, halves(2.0, scheme, temperature=(-1.0, COLD), **ICE), 40)
            trial.check(f"{scheme}: highest enthalpy", float(simulation.field("enthalpy").max()), at_most=0.0)
            spread = float(np.ptp(simulation.field("temperature"))) / 9.0
            trial.check(f"{scheme}: spread of temperatures left", spread, at_most=0.99)
    return trial.result()


def everything_melts(context: Context, backend: str) -> Result:
    """A block of ice beside one that is held at 50 deg C melts to the last particle and becomes as warm."""
    trial = Trial(context, backend)
    with trial.ending():
        for scheme in ("runge_kutta_legendre", "implicit", "nonlinear_jacobi"):
            scene = halves(3.0, scheme, cells=(4, 4, 4), held=(0,), **ICE)
            simulation = watched(trial, scene, 160, beyond=1e-3)
            inner = slice(64, None)
            least = float(simulation.field("enthalpy")[inner].min()) / LATENT
            trial.check(f"{scheme}: least enthalpy over the latent heat", least, at_least=1.0)
            trial.check(f"{scheme}: coldest", float(simulation.field("temperature")[inner].min()), at_least=45.0)
            trial.check(f"{scheme}: warmest", float(simulation.field("temperature").max()), at_most=WARM * (1 + 1e-3))
    return trial.result()


def layer_at_once(context: Context, backend: str) -> Result:
    """A step so long that the ice's whole first layer melts in it: no particle of the layer is left behind."""
    trial = Trial(context, backend)
    latent = 3e3  # 3 K
    with trial.ending():
        for scheme in ("runge_kutta_legendre", "implicit", "nonlinear_jacobi", "single_pass"):
            scene = halves(2.0, scheme, temperature=(WARM, -0.5), melting_point=0.0, latent_heat=latent)
            simulation = watched(trial, scene, 1)
            first = np.isclose(simulation.field("position")[:, 0], 8.5 * SPACING)
            share = simulation.field("enthalpy")[first] / latent
            trial.check(f"{scheme}: least molten share in the layer", float(share.min()), at_least=1.0)
            x, there = simulation.field("position"), simulation.field("enthalpy")
            turned = np.lexsort((x[:, 2], 4 * SPACING - x[:, 1], x[:, 0]))
            mirrored = there[np.lexsort((x[:, 2], x[:, 1], x[:, 0]))]
            off = float(abs(there[turned] - mirrored).max()) / latent
            trial.check(f"{scheme}: difference from its mirror image", off, at_most=1e-9)
    return trial.result()


def giant_step(context: Context, backend: str, number: float = 3e6) -> Result:
    """One step of s_max = 1e7: backward Euler ends at the mean temperature."""
    trial = Trial(context, backend)
    mean = 0.5 * (WARM + COLD)
    with trial.ending():
        for scheme, beyond in BOUNDED.items():
            simulation = watched(trial, halves(number, scheme), 1, beyond=beyond)
            off = float(abs(simulation.field("temperature") - mean).max()) / (WARM - COLD)
            if scheme in ("implicit", "conjugate_gradient"):
                trial.check(f"{scheme}: distance from the mean", off, at_most=0.01)
            else:
                trial.show(f"{scheme}: distance from the mean", off)
        for scheme, beyond in BOUNDED_ICE.items():
            watched(trial, halves(number, scheme, **ICE), 1, beyond=beyond)
    return trial.result()


# The map


def step_cell(context: Context, backend: str, scheme: str, melts: bool, steps: int = 20) -> Result:
    """The largest k dt/(rho c d^2) in which a warm and a cold half stay within their range, to a thousandth.

    With latent heat the cold half is ice and the warm one a reservoir.
    """

    def trouble(number: float) -> str:
        options: dict[str, Any] = {**ICE, "held": (0,)} if melts else {}
        scene: Any = forced(number) if scheme == "explicit" else halves(number, scheme, **options)
        beyond = 0.0
        try:
            simulation = context.simulation(scene, backend)
            context.started[:] = []
            for _ in range(steps):
                simulation.step()
                now = simulation.field("temperature")
                beyond = max(
                    beyond, (float(now.max()) - WARM) / (WARM - COLD), (COLD - float(now.min())) / (WARM - COLD)
                )
        except RunStopped as stop:
            return f"stopped: {stop.reason}"
        except InputError:
            return "refused"
        return f"{100 * beyond:.2g} % beyond the range" if not beyond <= 1e-3 else ""

    options = {**ICE, "held": (0,)} if melts else {}
    plan = make_plan(halves(0.1, scheme, largest_number=HeatConduction().largest_number, **options))
    limit = plan.effects["heat_conduction"].step_limits(plan.grid, plan.effects)["conduction"]
    return largest_stable(trouble, 0.25, 0.05, 1e4, factor=1.2).result(limit.length / UNIT)


PLAIN = (
    "explicit", "runge_kutta_legendre", "implicit", "conjugate_gradient", "single_pass", "pair_exchange", "one_sided",
)  # fmt: skip
MELTING = ("runge_kutta_legendre", "implicit", "conjugate_gradient", "single_pass", "nonlinear_jacobi")

MAPS = (
    StabilityMap(
        name="stability_heat_step",
        title="Largest stable step of conduction",
        quantity="k dt/(rho c d^2)",
        criterion="no temperature of a warm and a cold half (with latent heat: of ice beside a reservoir) leaves"
        " their range by more than 0.1 % in 20 steps.",
        advice="Take any scheme but the explicit one up to the default limit of 10; RKL with latent heat keeps its"
        " range up to 3, and limits its steps to that.",
        cells=tuple(
            Cell(name, column, step_cell, {"scheme": name, "melts": names is MELTING}, 5.0)
            for column, names in (("no latent heat", PLAIN), ("latent heat", MELTING))
            for name in names
        ),
    ),
)  # fmt: skip
