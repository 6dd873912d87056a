"""Coefficients for a surface tension and for a contact angle: the measured maps and their inverses.

`sigma_map.json` has tensions measured on drops at rest and in oscillation, divided by the nominal one, for each model,
dimension, support radius h/d, stiffness S = sigma/(rho0 c^2 d) of the nominal tension, set of smoothing kernels, and
density where it is not summed (`python -m validation measure drops`, condensed by `validation/measure/sigma_map.py`).
`wetting_map.json` has contact angles of sessile drops of Akinci 2013 on a plane against b = beta/gamma, the coefficient
of adhesion over that of cohesion (`python -m validation measure sessile`, `validation/measure/wetting.py`).
"""

import functools
import itertools
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from refsim.core.checked import plainly
from refsim.core.effect import Discretisation, Effect
from refsim.core.errors import InputError
from refsim.core.reading import GREATEST
from refsim.sph import LIQUID, WeaklyCompressible
from refsim.sph.iisph import ImplicitPressure
from refsim.surface_tension.akinci_2013 import Akinci2013
from refsim.surface_tension.becker_teschner_2007 import BeckerTeschner2007
from refsim.surface_tension.cohesion import PairCohesion
from refsim.surface_tension.csf_wang_2019 import CsfWang2019
from refsim.surface_tension.dong_2016 import Dong2016
from refsim.surface_tension.he_2014 import He2014
from refsim.surface_tension.jiang_zhu_2023 import JiangZhu2023
from refsim.surface_tension.tartakovsky_meakin_2005 import TartakovskyMeakin2005

MAP = Path(__file__).with_name("sigma_map.json")
BASE: dict[str, Any] = {"support": 2.6, "stiffness": 0.01, "kernels": "mueller"}  # common to all lines
MOST_UNCERTAIN = 0.5  # largest relative uncertainty of a calibration
ONE_SEED = 0.1  # relative uncertainty assumed for a drop measured with one seed only
SAME = 1e-6  # relative difference of settings that count as equal

# Models with the settings in which they were measured: name, and effect for a nominal tension [N/m].
SETTINGS: dict[str, tuple[str, Callable[[float], Effect]]] = {
    "jiang_zhu": ("Jiang & Zhu 2023", lambda sigma: JiangZhu2023(surface_tension=sigma, area_ratio=0.012)),
    "akinci": ("Akinci 2013", lambda sigma: Akinci2013(surface_tension=sigma)),
    "akinci_cohesion": (
        "Akinci 2013, cohesion alone",
        lambda sigma: Akinci2013(surface_tension=sigma, area_acceleration=0.0),
    ),
    "dong": ("Dong 2016", lambda sigma: Dong2016(surface_tension=sigma)),
    "dong_cohesion": ("Dong 2016, cohesion alone", lambda sigma: Dong2016(surface_tension=sigma, correction=0.0)),
    "becker_teschner": ("Becker & Teschner 2007", lambda sigma: BeckerTeschner2007(surface_tension=sigma)),
    "tartakovsky_meakin": ("Tartakovsky & Meakin 2005", lambda sigma: TartakovskyMeakin2005(surface_tension=sigma)),
    "he": ("He 2014, surface energy", lambda sigma: He2014(surface_tension=sigma)),
    "jiang_zhu_soft": (
        "Jiang & Zhu 2023, soft surface weight",
        lambda sigma: JiangZhu2023(surface_tension=sigma, pair_mode="soft", area_ratio=0.01),
    ),
    "csf": ("continuum surface force", lambda sigma: CsfWang2019(surface_tension=sigma)),
    "akinci_iisph": ("Akinci 2013 on IISPH", lambda sigma: Akinci2013(surface_tension=sigma)),
}
BESIDE: dict[str, tuple[Effect, ...]] = {"akinci_iisph": (ImplicitPressure(),)}  # further effects that a model needs


@dataclass(frozen=True)
class Calibration:
    """Coefficients that give a surface tension."""

    effect: Effect  # for the scene, with the coefficient that gives the required tension in a liquid of this density
    nominal: float  # the nominal tension [N/m] of that coefficient
    nominal_error: float  # its uncertainty [N/m]
    ratio: float  # measured over nominal tension
    laplace: float  # measured tension over the nominal one, by the jump of the pressure at rest
    rayleigh: float  # the same by the frequency of n = 2
    uncertainty: float  # relative, of the resulting tension
    sound_speed: float  # for weakly_compressible [m/s]
    stiffness: float  # S = nominal/(rho0 c^2 d)
    beside: tuple[Effect, ...] = ()  # further effects for the scene, such as an implicit pressure


@functools.cache
def sigma_map() -> tuple[Mapping[str, Any], ...]:
    """The measured settings, one mapping each: model, dim, support, stiffness, kernels, laplace, rayleigh, ..."""
    return tuple(json.loads(MAP.read_text(encoding="utf-8"))["settings"])


@plainly
def calibrate(
    sigma: float, model: str = "akinci", *, spacing: float, rest_density: float, dim: int = 3,
    support_radius: float | None = None, sound_speed: float | None = None, kernels: str = "mueller",
    radius: float | None = None, density: str = "summation", settings: Sequence[Mapping[str, Any]] | None = None,
) -> Calibration:  # fmt: skip
    """Coefficients of `model` that give the surface tension `sigma`, by the measured map.

    sigma           required tension [N/m]
    model           a name in SETTINGS
    spacing         d [m]
    rest_density    rho0 [kg/m^3; kg/m^2 in 2D]
    support_radius  h [m]; left out, 2.6 d
    sound_speed     of weakly_compressible [m/s]; left out, the one with which S = 0.01
    kernels, density  of weakly_compressible
    radius          of the drops to use [m]; left out, all measured radii
    settings        a map instead of the published one

    The ratio is the mean of the tensions from pressure jump and frequency of the same drops; its uncertainty comprises
    half their difference and the deviation over seeds. It is interpolated between measured settings along one axis of
    the map, with the others at BASE. Raises InputError outside the map, and if the two tensions disagree by too much.
    """
    entries = sigma_map() if settings is None else settings
    given = {"sigma": sigma, "spacing": spacing, "rest_density": rest_density}
    check_given("calibrate", **given, support_radius=support_radius, sound_speed=sound_speed, radius=radius)
    if model not in SETTINGS:
        raise InputError(f"calibrate: there is no model {model!r}; choose from {', '.join(SETTINGS)}.")
    chosen = _entries(entries, model=model, dim=dim, kernels=kernels, liquid=density)
    if not chosen:
        raise InputError(
            f"calibrate: the map has no drops of {model} in {dim}D with {kernels} kernels and density = {density!r}."
        )
    support = BASE["support"] if support_radius is None else support_radius / spacing
    line = [_judged(entry, None if radius is None else radius / spacing) for entry in chosen]
    if sound_speed is None:
        measured = _at(line, support, BASE["stiffness"], model)
    else:
        measured = _at_sound_speed(line, support, sigma / (rest_density * sound_speed**2 * spacing), model)
    if measured["uncertainty"] > MOST_UNCERTAIN:
        why = "no drop both stayed whole and oscillated"
        if math.isfinite(measured["ratio"]):
            of = {name: f"{measured[name]:.3g}" for name in ("laplace", "rayleigh")}
            why = f"Laplace's law gives {of['laplace']} and Rayleigh's {of['rayleigh']} of the nominal one"
        raise InputError(
            f"calibrate: {model} has no one surface tension at h = {support:.3g} d and S = {measured['stiffness']:.3g}:"
            f" {why}; choose another model or setting."
        )
    ratio, nominal = measured["ratio"], sigma / measured["ratio"]
    speed = sound_speed or math.sqrt(nominal / (rest_density * spacing * measured["stiffness"]))
    grid = Discretisation(dim, "float64", spacing, support * spacing, 0)
    options: Any = {"kernels": kernels, "density": density}
    liquid = WeaklyCompressible(rest_density=rest_density, sound_speed=speed, **options)
    effect: Any = SETTINGS[model][1](nominal)
    if isinstance(effect, PairCohesion) and effect.coefficient_name:  # which means the same in every scene
        coefficient = {effect.coefficient_name: effect.coefficient(grid, {LIQUID: liquid})}
        effect = msgspec.structs.replace(effect, surface_tension=None, **coefficient)
    return Calibration(
        effect=effect, nominal=nominal, nominal_error=nominal * measured["uncertainty"], ratio=ratio,
        laplace=measured["laplace"], rayleigh=measured["rayleigh"], uncertainty=measured["uncertainty"],
        sound_speed=speed, stiffness=measured["stiffness"], beside=BESIDE.get(model, ()),
    )  # fmt: skip


def _entries(entries: Sequence[Mapping[str, Any]], **place: Any) -> list[Mapping[str, Any]]:
    """Those of a map with these values; an entry without a name has a summed density."""
    return [e for e in entries if all(e.get(name, "summation") == value for name, value in place.items())]


def _judged(entry: Mapping[str, Any], radius: float | None) -> dict[str, Any]:
    """One measured setting at a radius [d]: both tensions, their mean, its relative uncertainty."""
    drops = entry["drops_by_radius"]
    made = {"support": entry["support"], "stiffness": entry["stiffness"], "uncertainty": math.inf, "reach": ""}
    nothing = {**made, **dict.fromkeys(("ratio", "laplace", "rayleigh"), math.nan)}
    if not drops:
        return nothing
    if radius is not None:
        low, high = drops[0]["radius"], drops[-1]["radius"]
        if not low * (1 - SAME) <= radius <= high * (1 + SAME):
            return {**nothing, "reach": f"{low:g}" if low == high else f"{low:g} to {high:g}"}
        nearest = sorted(drops, key=lambda d: abs(d["radius"] - radius))[:2]
        drops = nearest[:1] if same(nearest[0]["radius"], radius) else nearest
    laplace, rayleigh = (sum(d[name] for d in drops) / len(drops) for name in ("laplace", "rayleigh"))
    ratio = 0.5 * (laplace + rayleigh)
    result = {**made, "ratio": ratio, "laplace": laplace, "rayleigh": rayleigh}
    if min(laplace, rayleigh) <= 0:
        return result
    parts = [0.5 * (laplace - rayleigh)]
    for d in drops:  # each drop's distance from the mean of all, and its deviation over the seeds
        spread = 0.5 * math.hypot(d["laplace_spread"], d["rayleigh_spread"]) if d["seeds"] > 1 else ONE_SEED * ratio
        errors = 0.5 * (d["laplace"] + d["rayleigh"]) - ratio, spread
        parts += [part / math.sqrt(len(drops)) for part in errors]
    return {**result, "uncertainty": math.sqrt(sum(part**2 for part in parts)) / ratio}


def check_given(owner: str, **given: float | None) -> None:
    """Raise InputError, naming the owner and the number, for one that is not positive or beyond all SI units."""
    for name, value in given.items():
        if value is not None and not 1 / GREATEST <= value <= GREATEST:
            raise InputError(f"{owner}: {name} = {value} is not a positive number that can be meant in SI units.")


def same(value: float, other: float) -> bool:
    """Whether two settings are one, but for rounding."""
    return math.isclose(value, other, rel_tol=SAME)


def _at(measured: Sequence[Mapping[str, Any]], support: float, stiffness: float, model: str) -> dict[str, Any]:
    """The map at (h/d, S), one of which is the base's."""
    based = same(stiffness, BASE["stiffness"])
    if not based and not same(support, BASE["support"]):
        raise InputError(
            f"calibrate: the map has S = {stiffness:.3g} at h = {BASE['support']:g} d only; for h = {support:.3g} d"
            " leave sound_speed out."
        )
    axis, place = ("support", support) if based else ("stiffness", stiffness)
    fixed = "stiffness" if based else "support"
    line = sorted((e for e in measured if same(e[fixed], BASE[fixed])), key=lambda e: e[axis])
    quantity, unit = ("h", " d") if based else ("S", "")
    if not line:
        raise InputError(f"calibrate: the map has no drops of {model} with {quantity} = {place:.3g}{unit}.")
    below = [e for e in line if e[axis] <= place * (1 + SAME)]
    above = [e for e in line if e[axis] >= place * (1 - SAME)]
    if not below or not above:
        low, high = line[0][axis], line[-1][axis]
        reach = f"{quantity} = {low:g}{unit} alone" if low == high else f"{quantity} from {low:g} to {high:g}{unit}"
        raise InputError(f"calibrate: {quantity} = {place:.3g}{unit} is outside the map of {model}, which has {reach}.")
    first, last = below[-1], above[0]
    for end in (first, last):
        if end["reach"]:
            raise InputError(
                f"calibrate: the radius is outside the drops of {model} that were measured at h = {end['support']:g} d"
                f" and S = {end['stiffness']:g}, {end['reach']} spacings."
            )
    if same(first[axis], last[axis]):
        return {**first, "stiffness": stiffness}
    share = (math.log(place) - math.log(first[axis])) / (math.log(last[axis]) - math.log(first[axis]))
    mixed = {name: (1 - share) * first[name] + share * last[name] for name in ("ratio", "laplace", "rayleigh")}
    # The error of linear interpolation is taken as a quarter of the difference between its ends.
    bend = 0.25 * abs(first["ratio"] - last["ratio"]) / mixed["ratio"]
    uncertainty = math.hypot(max(first["uncertainty"], last["uncertainty"]), bend)
    return {**mixed, "stiffness": stiffness, "uncertainty": uncertainty}


def _at_sound_speed(measured: Sequence[Mapping[str, Any]], support: float, wanted: float, model: str) -> dict[str, Any]:
    """The map where S of the nominal tension times the ratio is `wanted` = sigma/(rho0 c^2 d)."""
    measured = [e for e in measured if not e["reach"] and math.isfinite(e["ratio"])]
    line = [BASE["stiffness"]]
    if same(support, BASE["support"]):
        line = sorted({e["stiffness"] for e in measured if same(e["support"], support)})
    reached = [(s, s * _at(measured, support, s, model)["ratio"]) for s in line]
    for stiffness, product in reached:
        if same(product, wanted):
            return _at(measured, support, stiffness, model)
    for (low, at_low), (high, at_high) in itertools.pairwise(reached):
        if at_low <= wanted <= at_high:
            for _ in range(60):  # by bisection: the product grows with S
                middle = math.sqrt(low * high)
                if middle * _at(measured, support, middle, model)["ratio"] < wanted:
                    low = middle
                else:
                    high = middle
            return _at(measured, support, math.sqrt(low * high), model)
    span = " to ".join(f"{p:.3g}" for p in sorted({reached[0][1], reached[-1][1]})) if reached else "nothing"
    raise InputError(
        f"calibrate: sigma/(rho0 c^2 d) = {wanted:.3g} is outside the map of {model}, which has {span} at h ="
        f" {support:.3g} d; leave sound_speed out, or change it."
    )


WETTING_MAP = Path(__file__).with_name("wetting_map.json")
ONE_DROP = 5.0  # uncertainty assumed for an angle measured on one drop only [degrees]


@dataclass(frozen=True)
class ContactAngle:
    """Coefficients that give a surface tension and a contact angle."""

    effect: Akinci2013  # for the scene
    adhesion: float  # beta [m^4/(kg s^2)], the effect's `adhesion`
    share: float  # b = beta/gamma
    uncertainty: float  # of the angle [degrees]
    tension: Calibration  # result of `calibrate` for the surface tension; its sound speed is that of the scene


@functools.cache
def wetting_map() -> tuple[Mapping[str, Any], ...]:
    """The measured settings, one mapping each: dim, support, stiffness, kernels, and the drops by coefficient."""
    return tuple(json.loads(WETTING_MAP.read_text(encoding="utf-8"))["settings"])


@plainly
def calibrate_contact_angle(
    angle: float, sigma: float, *, spacing: float, rest_density: float, dim: int = 3,
    support_radius: float | None = None, kernels: str = "mueller", density: str = "summation",
    settings: Sequence[Mapping[str, Any]] | None = None,
) -> ContactAngle:  # fmt: skip
    """Coefficients of Akinci 2013 for a contact angle `angle` of liquid of tension `sigma` on a plane wall.

    angle           required contact angle, through the liquid [degrees]
    sigma           required surface tension [N/m]
    spacing         d [m]
    rest_density    rho0 [kg/m^3; kg/m^2 in 2D]
    support_radius  h [m]; left out, 2.6 d
    kernels, density  of weakly_compressible
    settings        a wetting map instead of the published one

    For walls of `box_walls` and S = sigma/(rho0 c^2 d) = 0.01 of the nominal tension, which sets the sound speed. The
    cosine is interpolated between measured coefficients; the uncertainty comprises half the difference
    between two measurements of the angle, the deviation over drops, and a quarter of the difference between the two
    measured angles. Raises InputError outside the measured range.
    """
    this = "calibrate_contact_angle"
    given = {"angle": angle, "sigma": sigma, "spacing": spacing, "rest_density": rest_density}
    check_given(this, **given, support_radius=support_radius)
    support = BASE["support"] if support_radius is None else support_radius / spacing
    entries = _entries(wetting_map() if settings is None else settings, dim=dim, kernels=kernels, liquid=density)
    measured = [entry for entry in entries if same(entry["stiffness"], BASE["stiffness"])]
    there = [entry for entry in measured if same(entry["support"], support)]
    if not there:
        known = ", ".join(f"{entry['support']:g}" for entry in measured) or "none"
        raise InputError(
            f"{this}: the map has no sessile drops in {dim}D with {kernels} kernels at h = {support:.3g} d and"
            f" density = {density!r}; it has h/d = {known}."
        )
    share, uncertainty = _share_of(angle, there[0], this, support)
    lengths = {"spacing": spacing, "rest_density": rest_density, "dim": dim, "kernels": kernels, "density": density}
    tension = calibrate(sigma, "akinci", support_radius=support * spacing, **lengths)  # type: ignore[arg-type]
    effect: Any = tension.effect
    adhesion = share * effect.gamma
    return ContactAngle(
        effect=msgspec.structs.replace(effect, adhesion=adhesion), adhesion=adhesion, share=share,
        uncertainty=uncertainty, tension=tension,
    )  # fmt: skip


def _share_of(angle: float, entry: Mapping[str, Any], this: str, support: float) -> tuple[float, float]:
    """(b, uncertainty of the angle [degrees]) from the measured cosines by linear interpolation."""
    caps = [drop for drop in entry["drops"] if drop["angle"] is not None]
    for low, high in itertools.pairwise(caps):  # by growing coefficient: the angle falls
        if high["angle"] <= angle <= low["angle"]:
            ends = [math.cos(math.radians(drop["angle"])) for drop in (low, high)]
            wanted = math.cos(math.radians(angle))
            part = (wanted - ends[0]) / (ends[1] - ends[0]) if ends[1] > ends[0] else 0.0
            bend = 0.25 * (low["angle"] - high["angle"]) * min(1.0, 4 * part * (1 - part))
            share = (1 - part) * low["share"] + part * high["share"]
            return share, math.hypot(max(_uncertain(low), _uncertain(high)), bend)
    if not caps:
        raise InputError(f"{this}: no drop at h = {support:.3g} d came to rest as a cap.")
    low, high = min(drop["angle"] for drop in caps), max(drop["angle"] for drop in caps)
    raise InputError(
        f"{this}: {angle:g} degrees is outside the map at h = {support:.3g} d, which has {low:.0f} to {high:.0f}"
        " degrees; beyond it drops spread to a film or detach from the plane."
    )


def _uncertain(drop: Mapping[str, Any]) -> float:
    spread = ONE_DROP if drop["spread"] is None else drop["spread"]
    return math.hypot(spread, 0.5 * (drop["angle"] - drop["circle"]) if drop["circle"] is not None else 0.0)
