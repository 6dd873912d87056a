"""Sessile drops on a plane under Akinci's cohesion and adhesion: the contact angle against the adhesion's coefficient.

Lengths in spacings, rho0 = 1 and the nominal sigma = 1, as in `validation.measure.drops`. The coefficient is the ratio
b = beta/gamma of adhesion to cohesion. `points` lists what is measured, `python -m validation measure sessile` measures
it, and `measure wetting_map` condenses the rows (`data/wetting.json`) into the table of
`refsim.calibrate_contact_angle`.
"""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from refsim.scene.scene import Scene
from refsim.scene.shapes import Cloud
from refsim.study.panels.drops import SNAPSHOTS_ON_PLANE as SNAPSHOTS
from refsim.study.panels.drops import angle_by_lift
from refsim.surface_tension.calibration import WETTING_MAP as PACKAGED
from refsim.surface_tension.calibration import calibrate_contact_angle
from validation.measure.drops import SEED, liquid_key, row_of
from validation.measure.sigma_map import setting_of, write_settings
from validation.measure.stirring import ON_PLANE, STIRRED, cap, relaxed, sessile
from validation.running import run_to

ROWS = Path(__file__).resolve().parent.parent / "data" / "wetting.json"
RELAXED, AVERAGED = ON_PLANE
NEAR_PLANE, NARROW = 1.5, 2.5  # [d] slices below the one, or with smaller radii than the other, are not fitted
DETACHED, FILM = 170.0, 15.0  # degrees beyond which there is no cap to speak of
SHAPELESS = 15.0  # degrees by which the two angles of a cap differ at most
SHARES = {2: (2.0, 5.0, 8.0, 12.0, 16.0, 20.0, 25.0), 3: (3.0, 4.0, 5.0, 7.0, 10.0, 13.0, 16.0, 20.0, 24.0)}
BEYOND = (0.0, 50.0)  # where no cap is expected
ADVANCED = (0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0)  # of an advanced density, which its walls pull themselves
MODELS = ("akinci",)
AXES = ("dim", "support", "stiffness", "kernels", "liquid")


@dataclass(frozen=True)
class Point:
    """One sessile drop.

    share   b = beta/gamma
    radius  of the half ball (half disc) that it has the volume of [d]
    begin   contact angle of the cap from which it starts [degrees]
    """

    share: float
    dim: Any = 3
    support: float = 2.6
    radius: float = 8.0
    stiffness: float = 0.01
    kernels: Any = "mueller"
    seed: int = 1
    begin: float = 90.0
    model: str = "akinci"
    liquid: Any = "summation"

    @property
    def key(self) -> str:
        """Name of the point's row."""
        size = f"h{self.support:g}.R{self.radius:g}.S{self.stiffness:g}"
        begun = f"from{self.begin:g}.{self.seed}{liquid_key(self.liquid)}"
        return f"{self.model}.{self.dim}d.{self.kernels}.{size}.b{self.share:g}.{begun}"

    def cost(self) -> float:
        """About the seconds that it takes on one core."""
        return 0.4 * (0.5 * self.radius**self.dim * math.pi) ** (1 + 1.5 / self.dim) / 1e4 * (3 if self.dim == 2 else 5)


SIZE = {2: 16.0, 3: 8.0}
LARGER = {2: 24.0, 3: 11.0}


def points(models: tuple[str, ...] = MODELS, dims: tuple[int, ...] = (2, 3)) -> Iterator[Point]:
    """The map at its base with three seeds, a larger size and two other starts; along h/d and S with one."""
    for dim in dims if "akinci" in models else ():
        for share in ADVANCED if dim == 3 else ():
            for seed in (1, 2, 3):
                yield Point(share, dim, radius=SIZE[dim], seed=seed, kernels="wendland", liquid="continuity")
        for share in (*SHARES[dim], *BEYOND):
            for seed in (1, 2, 3):
                yield Point(share, dim, radius=SIZE[dim], seed=seed)
        for share in SHARES[dim]:
            yield Point(share, dim, radius=LARGER[dim])
        middle = SHARES[dim][len(SHARES[dim]) // 2]
        for begin in (50.0, 140.0):
            yield Point(middle, dim, radius=SIZE[dim], begin=begin)
        for axis, values in (("support", (2.3, 3.0)), ("stiffness", (0.003, 0.03)), ("kernels", ("wendland",))):
            for value in values:
                for share in SHARES[dim]:
                    yield Point(share, dim, radius=SIZE[dim], **{axis: value})  # type: ignore[arg-type]


def slices(height: NDArray, density: float, snapshots: int, dim: int) -> tuple[NDArray, NDArray]:
    """Heights z [d] and mean radii r [d] of slices one spacing thick: n pi r^2 d particles each (2 n r d in 2D)."""
    edges = np.arange(0.0, float(height.max()) + 1.0)
    count = np.histogram(height, edges)[0] / snapshots / density
    return 0.5 * (edges[1:] + edges[:-1]), np.sqrt(count / math.pi) if dim == 3 else count / 2


def angle_by_circle(height: NDArray, density: float, snapshots: int, dim: int) -> tuple[float, float]:
    """(contact angle [degrees], residual) of the circle through the mean radii of slices.

    r^2 + z^2 = 2 z_c z + (R^2 - z_c^2) is a straight line. Slices near the plane, where particles stand in layers, and
    narrow ones at the top are left out. NaN below three slices. The residual is the rms of what is left, over R^2.
    """
    z, radius = slices(height, density, snapshots, dim)
    use = (z > NEAR_PLANE) & (radius > NARROW)
    if use.sum() < 3:
        return math.nan, math.nan
    line = np.stack([2 * z, np.ones_like(z)], axis=1)[use]
    wanted = (radius**2 + z**2)[use]
    (centre, rest), *_ = np.linalg.lstsq(line, wanted, rcond=None)
    square = rest + centre**2
    if square <= 0:
        return math.nan, math.nan
    cosine = -centre / math.sqrt(square)
    return math.degrees(math.acos(min(1.0, max(-1.0, cosine)))), float(np.std(line @ (centre, rest) - wanted) / square)


# One drop


def measure(point: Point, backend: str = "cpu") -> dict[str, Any]:
    """Stir and relax the drop, then observe it. A run that stops is a row, too.

    angle    contact angle [degrees] of the spherical cap with the drop's volume and height of centre of mass
    circle   the same by the circle through the mean radii of slices; `residual` of that fit
    profile  mean radius of each slice, from the plane up [d]
    drift    change of the angle from the first to the last third of the watched time [degrees]
    fate     "cap", "film" (flat as a layer) or "detached"
    """
    return row_of(point, lambda point, row: _measure(point, row, backend))


def _measure(point: Point, row: dict[str, Any], backend: str) -> None:
    capillary_time, up = math.sqrt(point.radius**3), point.dim - 1
    simulation = relaxed(point, sessile(point, cap(point)), STIRRED + RELAXED, backend)
    row["particles"] = simulation.count
    heights, densities, angles, lowest = [], [], [], []
    for k in range(SNAPSHOTS):
        run_to(simulation, (STIRRED + RELAXED + AVERAGED * (k + 1) / SNAPSHOTS) * capillary_time)
        simulation.evaluate()
        z = simulation.field("position").astype(float)[:, up]
        heights.append(z)
        densities.append(float(np.median(simulation.field("density"))))
        lowest.append(float(z.min()))
        angles.append(angle_by_lift(float(z.mean()) / (len(z) / densities[-1]) ** (1 / point.dim), point.dim))
    row["steps"] = simulation.steps
    height, density = np.concatenate(heights), float(np.mean(densities))
    circle, residual = angle_by_circle(height, density, len(heights), point.dim)
    angle, third = float(np.mean(angles)), SNAPSHOTS // 3
    away = angle > DETACHED or min(lowest) > 1.0
    row |= {
        "angle": angle, "circle": circle, "residual": residual,
        "drift": float(np.mean(angles[-third:]) - np.mean(angles[:third])), "density": density,
        "fate": "detached" if away else "film" if angle < FILM else "cap",
        "profile": slices(height, density, len(heights), point.dim)[1].round(2).tolist(),
        "through": int((simulation.field("position")[:, up] < 0).sum()),
    }  # fmt: skip


def contact_angle(given: Mapping[str, Any], seed: int) -> Scene:
    """Of a panel: a half disc on a plane that asks for 90 degrees; it was stirred and rests."""
    share = calibrate_contact_angle(90.0, 1.0, spacing=1.0, rest_density=1.0, dim=2).share
    point = Point(share, 2, radius=given["radius"], seed=SEED + seed)
    calm = relaxed(point, sessile(point, cap(point)), STIRRED + RELAXED, given["backend"])
    place, velocity = (calm.field(name).astype(float) for name in ("position", "velocity"))
    made = sessile(point, place)
    fluid = (Cloud(position=place, velocity=velocity),)
    return msgspec.structs.replace(made, fluid=fluid, end_time=AVERAGED * math.sqrt(point.radius**3))


# The map


def condensed(rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """One entry for each setting: dim, support, stiffness, kernels, and `drops`, one for each coefficient.

    A coefficient has an angle where more than half of its drops are caps.

    share           b = beta/gamma
    angle, spread   mean and standard deviation of the contact angle over seeds, sizes and starts [degrees]
    circle          mean of the angle by the circle
    drops, fates    how many, and what became of them
    """
    groups: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault(setting_of(row, AXES), []).append(row)
    return [
        {**dict(key), "drops": [_of_share(rows, share) for share in sorted({r["share"] for r in rows})]}
        for key, rows in sorted(groups.items(), key=str)
    ]


def fate(row: Mapping[str, Any]) -> str:
    """What became of a drop: "cap", "no cap" where a second angle is missing or too far off for one, and so on."""
    if row["stopped"] or row["fate"] != "cap":
        return row["stopped"] or row["fate"]
    return "cap" if abs(row["angle"] - row["circle"]) <= SHAPELESS else "no cap"


def _of_share(rows: Sequence[Mapping[str, Any]], share: float) -> dict[str, Any]:
    of_share = [r for r in rows if r["share"] == share]
    caps = [r for r in of_share if fate(r) == "cap"]
    caps = caps if 2 * len(caps) > len(of_share) else []
    angles, circles = [r["angle"] for r in caps], [r["circle"] for r in caps if math.isfinite(r["circle"])]
    return {
        "share": share, "angle": round(float(np.mean(angles)), 2) if angles else None,
        "spread": round(float(np.std(angles, ddof=1)), 2) if len(angles) > 1 else None,
        "circle": round(float(np.mean(circles)), 2) if circles else None, "drops": len(of_share),
        "fates": dict(sorted(Counter(map(fate, of_share)).items())),
    }  # fmt: skip


def write(rows: Iterable[Mapping[str, Any]], path: Path = PACKAGED) -> int:
    """Write the map; returns how many settings it has."""
    return write_settings(condensed(rows), path)
