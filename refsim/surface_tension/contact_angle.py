"""Adhesion for a contact angle: the measured wetting map and its inverse.

The map (`wetting_map.json`) holds the contact angles of sessile drops of Akinci 2013 on a plane against b = beta/gamma,
the coefficient of adhesion over that of cohesion. `python -m validation measure sessile` measures it and
`validation/measure/wetting.py` condenses it.
"""

import functools
import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from refsim.core.checked import plainly
from refsim.core.effect import Discretisation
from refsim.core.errors import InputError
from refsim.sph import LIQUID, WeaklyCompressible
from refsim.surface_tension.akinci_2013 import Akinci2013
from refsim.surface_tension.calibration import BASE, Calibration, calibrate, check_given, same

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
    support = float(BASE["support"]) if support_radius is None else support_radius / spacing
    stiffness = float(BASE["stiffness"])
    measured = [
        entry
        for entry in (wetting_map() if settings is None else settings)
        if entry["dim"] == dim
        and entry["kernels"] == kernels
        and same(entry["stiffness"], stiffness)
        and entry.get("liquid", "summation") == density
    ]
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
    fluid = WeaklyCompressible(
        rest_density=rest_density, sound_speed=tension.sound_speed, density=density,  # type: ignore[arg-type]
        kernels=kernels,  # type: ignore[arg-type]
    )  # fmt: skip
    grid = Discretisation(dim, "float64", spacing, support * spacing, 0)
    effect: Any = tension.effect
    adhesion = share * effect.coefficient(grid, {LIQUID: fluid})
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
