"""Drops without gravity under every model of surface tension: pressure jump, frequency, rest.

Lengths in spacings, rho0 = 1 and the nominal sigma = 1, so that every measured tension is a share of the nominal one.
The stiffness S = sigma/(rho0 c^2 d) stands for the coefficient: at the same sound speed a larger coefficient is a
larger S. `points` lists what is measured; `python -m validation measure drops` measures it on many cores and keeps the
rows.
"""

import itertools
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from refsim import InputError, RunStopped, Simulation
from refsim.scene.scene import Scene
from refsim.study.panels.drops import (
    BALLS,
    INNER,
    PER_PERIOD,
    PERIODS,
    RAYLEIGH,
    SNAPSHOTS,
    THIN,
    fit_oscillation,
    inner_pressure,
    inside,
    radius_of,
)
from refsim.surface_tension.calibration import BASE, BESIDE, SETTINGS
from validation.measure.stirring import (
    AVERAGED,
    CALM,
    FLOW,
    KICK,
    LAMB,
    RELAXED,
    SETTLED,
    followed,
    free_drop,
    lasting_amplitude,
    relaxed,
    shifted_ball,
)
from validation.running import run_to

FITTED_FROM = 3.0  # support radii: drops that are smaller are not fitted against 1/R
# omega = omega_0 (1 - s A^2) at amplitude A: 3D after Tsamopoulos & Brown 1983, 2D of a plane drop's potential flow
SOFTENING = {2: 0.773, 3: 34409 / 58800}
# Random kicks tear them, and they need none: their forces act at the surface only, and no stresses freeze.
UNSTIRRED = ("csf", "mpm")
# The first two have no drop at BASE: it flies apart. The iteration of the third wants few neighbours.
OTHER_BASE: dict[str, dict[str, Any]] = {
    "csf": {"kernels": "wendland"}, "he": {"kernels": "wendland"}, "akinci_iisph": {"support": 2.0},
}  # fmt: skip

MODELS = {name: (label, partial(effect, 1.0)) for name, (label, effect) in SETTINGS.items()}  # of nominal sigma = 1


@dataclass(frozen=True)
class Point:
    """One drop.

    support    h in spacings
    radius     R in spacings
    stiffness  S = sigma/(rho0 c^2 d) of the nominal sigma
    kernels, liquid  `kernels` and `density` of weakly_compressible
    kicked     whether it is set into oscillation at the end
    """

    model: str
    dim: Any = 3
    support: float = 2.6
    radius: float = 10.0
    stiffness: float = 0.01
    kernels: Any = "mueller"
    seed: int = 1
    kicked: bool = True
    dtype: Any = "float32"
    liquid: Any = "summation"

    @property
    def key(self) -> str:
        """Name of the point's row."""
        size = f"h{self.support:g}.R{self.radius:g}.S{self.stiffness:g}"
        return f"{self.model}.{self.dim}d.{self.kernels}.{size}.{self.seed}{liquid_key(self.liquid)}"

    def tension(self) -> tuple[Any, ...]:
        """The effect of its nominal tension, and those that it needs beside it."""
        return SETTINGS[self.model][1](1.0), *BESIDE.get(self.model, ())

    def cost(self) -> float:
        """About the seconds that it takes on one core."""
        particles = self.radius**self.dim * (4.2 if self.dim == 3 else math.pi)
        steps = self.radius**1.5 * math.sqrt(0.01 / self.stiffness) * (130 if self.kicked else 90)
        solver = 3.0 if self.model in BESIDE else 1.0
        return (
            1e-6 * solver * particles * steps * (2.6 if self.dim == 3 else 0.8) * (self.support / 2.6) ** (self.dim - 1)
        )


def liquid_key(density: str) -> str:
    """What the name of a row ends with: nothing for a summed density."""
    return "" if density == "summation" else f".{density}"


RADII = {2: (8.0, 11.0, 16.0, 24.0), 3: (5.0, 7.0, 8.5, 10.0, 12.0, 14.0)}
ADVANCED = {2: (8.0, 11.0, 16.0, 24.0), 3: (8.5, 10.0, 12.0)}  # radii of the drops of an advanced density
SWINGING = (8.0, 16.0, 32.0)  # radii in 3D of drops beside the map, whose frequency is held against Lamb's
SEEDED = {2: 16.0, 3: 10.0}  # radius at which three seeds are run, and from which on drops are kicked
LARGE = 10.0  # radius in 3D beyond which drops are measured at the base only: they take minutes
LARGE_IMPLICIT = 10.0  # the same of implicit pressure, each step of which is an iteration
SEEDED_MODELS = ("akinci", "dong")  # with three seeds along the axes, too
AXES: dict[str, tuple[Any, ...]] = {
    "support": (2.0, 2.3, 2.6, 3.0), "stiffness": (0.003, 0.01, 0.03), "kernels": ("mueller", "wendland"),
}  # fmt: skip


def base(model: str) -> dict[str, Any]:
    """The setting at which the axes of a model cross."""
    return BASE | OTHER_BASE.get(model, {})


def at_base(model: str, setting: Mapping[str, Any]) -> bool:
    """Whether a point, row or map entry of the model stands where its axes cross, with a summed density."""
    return summed(setting) and all(setting[name] == value for name, value in base(model).items())


def summed(setting: Mapping[str, Any]) -> bool:
    """Whether a point, row or map entry is of a summed density."""
    return setting.get("liquid", "summation") == "summation"


def points(models: tuple[str, ...] = tuple(MODELS), dims: tuple[int, ...] = (2, 3)) -> Iterator[Point]:
    """The map: all radii and three seeds at the base point, and each axis on its own through it at four radii.

    Akinci 2013 has three seeds at every radius from 10 spacings on, with both sets of kernels. Implicit pressure knows
    no sound speed, and so no stiffness. Drops of an advanced density are those of ADVANCED; those of SWINGING follow.
    """
    for model, dim in itertools.product(models, dims):
        for radius in ADVANCED[dim] if model not in BESIDE else ():
            given = {"radius": radius, "kicked": dim == 3 or radius >= SEEDED[dim], "kernels": "wendland"}
            for seed in (1, 2, 3) if radius == SEEDED[dim] else (1,):
                yield Point(model, dim, seed=seed, liquid="continuity", **given)
    if SEEDED_MODELS[0] in models and 3 in dims:
        for liquid, radius, seed in itertools.product(("summation", "continuity"), SWINGING, (1, 2, 3)):
            yield Point(SEEDED_MODELS[0], radius=radius, seed=seed, kernels="wendland", liquid=liquid)
    for model, dim in itertools.product(models, dims):
        centre = base(model)
        axes = {name: values for name, values in AXES.items() if name != "stiffness" or model not in BESIDE}
        crossing = [centre | {name: value} for name, values in axes.items() for value in values]
        settings = {tuple(sorted(setting.items())) for setting in crossing}
        for setting in sorted(settings, key=str):
            based = at_base(model, dict(setting))
            leading = model == SEEDED_MODELS[0] and at_base(model, dict(setting) | {"kernels": base(model)["kernels"]})
            for radius in RADII[dim]:
                if radius > LARGE and dim == 3 and not (based or leading):
                    continue
                if radius > LARGE_IMPLICIT and dim == 3 and model in BESIDE:
                    continue
                three = radius == SEEDED[dim] and (based or model in SEEDED_MODELS)
                three |= leading and dim == 3 and radius >= LARGE
                kicked = radius >= SEEDED[dim] or (based and dim == 3)
                for seed in (1, 2, 3) if three else (1,):
                    yield Point(model, dim, radius=radius, seed=seed, kicked=kicked, **dict(setting))


def start(point: Point) -> NDArray:
    """Particles of a ball (disc) cut from the lattice, shifted at random."""
    return shifted_ball(point.dim, point.radius, np.random.default_rng(point.seed), point.support)


def measure(point: Point, backend: str = "cpu") -> dict[str, Any]:
    """Relax the drop, average its pressure, kick it, and fit its frequency. A run that stops is a row, too.

    laplace    sigma = P R/(dim - 1) from the virial pressure, mean over balls of 0.4 to 0.7 R and over 40 snapshots
    rayleigh   sigma = rho R^3 (omega^2 + beta^2)/k from the damped frequency, k = 8 in 3D and 6 in 2D; omega for
               small amplitudes, by SOFTENING
    steps      of all stages together
    spurious   rms speed at rest over sqrt(sigma/(rho R))
    """
    return row_of(point, lambda point, row: _measure(point, row, backend))


def row_of(point: Any, observe: Callable[[Any, dict[str, Any]], None]) -> dict[str, Any]:
    """The row that `observe(point, row)` fills; with the reason where it stops."""
    began = time.perf_counter()
    row: dict[str, Any] = {**asdict(point), "key": point.key, "stopped": ""}
    try:
        observe(point, row)
    except RunStopped as stop:
        row["stopped"] = stop.reason
    except InputError:  # of the drop as it stands: two particles at one place
        row["stopped"] = "clumped"
    except Dispersed:
        row["stopped"] = "dispersed"
    row["seconds"] = round(time.perf_counter() - began, 2)
    return row


class Dispersed(Exception):
    """Nothing is left where the drop was."""


def at_rest(point: Point, backend: str) -> tuple[Scene, Simulation]:
    """(the drop with the viscosity of a measurement, the run in which it was stirred and has relaxed)."""
    made, look = free_drop(point, start(point), None, CALM), partial(_together, point=point)
    calm = relaxed(point, made, RELAXED, backend, point.model not in UNSTIRRED, look)
    return free_drop(point, calm.field("position").astype(float), None, THIN), calm


def averaged(thin: Simulation, point: Point, snapshots: int = SNAPSHOTS) -> dict[str, float]:
    """Means of what is seen of a drop at rest."""
    unit, samples = math.sqrt(point.radius**3), []
    run_to(thin, SETTLED * unit)
    for k in range(snapshots):
        run_to(thin, (SETTLED + AVERAGED * (k + 1) / snapshots) * unit)
        thin.evaluate()
        samples.append(_rest(thin, point))
    return {name: float(np.mean([s[name] for s in samples])) for name in samples[0]}


def swinging(point: Point, thin: Simulation, radius: float, laplace: float) -> tuple[Scene, float]:
    """(the drop kicked into its mode n = 2, the frequency that is expected of it [1/s])."""
    nominal = math.sqrt(RAYLEIGH[point.dim] / radius**3)
    x, v = thin.field("position").astype(float), thin.field("velocity").astype(float)
    x = x - x.mean(0)
    made = free_drop(point, x, v - v.mean(0) + KICK * nominal * FLOW[point.dim] * x, THIN)
    return made, nominal * math.sqrt(max(laplace, 0.25) if math.isfinite(laplace) else 1.0)


def _measure(point: Point, row: dict[str, Any], backend: str) -> None:
    made, calm = at_rest(point, backend)
    row["particles"] = calm.count
    thin = Simulation(made, backend)
    # a large drop has more pairs to average
    mean = averaged(thin, point, SNAPSHOTS if point.radius < 2 * LARGE else SNAPSHOTS // 4)
    radius = mean["radius"]
    row |= {
        "steps": calm.steps + thin.steps, "effective_radius": radius, "pressure": mean["pressure"],
        "laplace": mean["pressure"] * radius / (point.dim - 1), "bulk_error": mean["density"] - 1,
        "spurious": mean["rms"] * math.sqrt(radius),
    }  # fmt: skip
    if point.kicked:
        _oscillate(point, thin, radius, row, backend)


def _together(simulation: Simulation, point: Point) -> None:
    """Raise Dispersed where half of the particles have left the drop: the rest would tell of no drop."""
    x = simulation.field("position").astype(float)
    if np.median(np.linalg.norm(x - x.mean(0), axis=1)) > 2 * point.radius:
        raise Dispersed


def _rest(simulation: Simulation, point: Point) -> dict[str, float]:
    """One snapshot: pressure, density and radius, speeds."""
    x, v = simulation.field("position").astype(float), simulation.field("velocity").astype(float)
    away = np.linalg.norm(x - x.mean(0), axis=1)
    if away.min() > INNER * point.radius or away.max() > 10 * point.radius:
        raise Dispersed
    rms = math.sqrt(((v - v.mean(0)) ** 2).sum(1).mean())
    if point.model == "mpm":  # volumes J of particles, which have the pressure (1 - J)/S
        ratio = simulation.field("volume_ratio").astype(float)
        pressure = ((1 - ratio) * ratio).sum() / (ratio.sum() * point.stiffness)
        radius = radius_of(ratio.sum(), point.dim)
        return {"pressure": pressure, "density": 1 / ratio.mean(), "radius": radius, "rms": rms}
    density, radius = inside(simulation, point.radius)
    return {"pressure": inner_pressure(simulation, BALLS * radius), "density": density, "radius": radius, "rms": rms}


def _oscillate(point: Point, thin: Simulation, radius: float, row: dict[str, Any], backend: str) -> None:
    """Kick the mode n = 2 and fit its damped frequency."""
    made, expected = swinging(point, thin, radius, row["laplace"])
    kicked = Simulation(made, backend)
    until, count = PERIODS * 2 * math.pi / expected, round(PERIODS * PER_PERIOD)
    times, moments = followed(kicked, point.dim, (until * (k + 1) / count for k in range(count)))
    omega, damping, misfit, amplitude = fit_oscillation(times, moments, expected)
    lasting = lasting_amplitude(times, damping, amplitude)
    squared = (omega / (1 - SOFTENING[point.dim] * min(lasting, 0.6) ** 2)) ** 2 + damping**2
    row["steps"] += kicked.steps
    row |= {
        "omega": omega, "amplitude": lasting, "damping": damping, "misfit": misfit,
        "rayleigh": squared * radius**3 / RAYLEIGH[point.dim],
        "lamb": float(LAMB[point.dim]) * THIN * math.sqrt(point.radius) / radius**2,
    }  # fmt: skip


def fit_laplace(rows: Sequence[Mapping[str, Any]]) -> tuple[float, float, float]:
    """(sigma, its standard error, intercept P0) from P = (dim - 1) sigma/R + P0 over the radii; NaN below three.

    Of drops with R >= 3 h: a smaller one has no bulk, since the surface reaches a support radius deep.
    """
    lasting = [r for r in rows if not r["stopped"] and math.isfinite(r["pressure"])]
    use = [r for r in lasting if r["radius"] >= FITTED_FROM * r["support"]]
    curvature = np.array([(r["dim"] - 1) / r["effective_radius"] for r in use])
    if len(set(np.round(curvature, 3))) < 3:
        return math.nan, math.nan, math.nan
    (slope, intercept), covariance = np.polyfit(curvature, [r["pressure"] for r in use], 1, cov=True)
    return float(slope), float(math.sqrt(covariance[0, 0])), float(intercept)


# Scenes of panels, by what a setting is and the number of a reading

SEED = 10  # of the first drop of a panel: the maps of tension and adhesion hold seeds 1 to 3


def _of_panel(given: Mapping[str, Any], seed: int) -> Point:
    return Point(given["model"], 2, radius=given["radius"], seed=SEED + seed, dtype=given["dtype"])


def surface_tension_jump(given: Mapping[str, Any], seed: int) -> Scene:
    """A disc that was stirred and has relaxed, and comes to rest with less viscosity."""
    point = _of_panel(given, seed)
    made, _ = at_rest(point, given["backend"])
    return msgspec.structs.replace(made, end_time=(SETTLED + AVERAGED) * math.sqrt(point.radius**3))


def surface_tension_frequency(given: Mapping[str, Any], seed: int) -> Scene:
    """The same disc at rest, kicked into its mode 2."""
    point, thin = _of_panel(given, seed), Simulation(surface_tension_jump(given, seed), given["backend"])
    mean = averaged(thin, point)
    made, expected = swinging(point, thin, mean["radius"], mean["pressure"] * mean["radius"])
    return msgspec.structs.replace(made, end_time=PERIODS * 2 * math.pi / expected)
