"""Sessile drops on a plane under Akinci's cohesion and adhesion: the contact angle against the adhesion's coefficient.

Lengths in spacings, rho0 = 1 and the nominal sigma = 1, as in `validation.measure.drops`. The coefficient is the ratio
b = beta/gamma of adhesion to cohesion. `points` lists what is measured, `python -m validation measure sessile` measures
it, and `measure wetting_map` condenses the rows (`data/wetting.json`) into the table of
`refsim.calibrate_contact_angle`.
"""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim import Akinci2013, BoxWalls, Cloud, Gravity, Scene, Simulation, WeaklyCompressible
from refsim.core.effect import Discretisation
from refsim.surface_tension.calibration import BASE
from refsim.surface_tension.contact_angle import WETTING_MAP as PACKAGED
from validation.measure.drops import CALM, STIRRED, row_of, stir
from validation.measure.motion import JITTER, run_to
from validation.measure.sigma_map import write_settings

ROWS = Path(__file__).resolve().parent.parent / "data" / "wetting.json"
BOND = 0.2  # rho g R^2/sigma of the nominal tension: weight that keeps a drop by the plane
RELAXED, AVERAGED, SNAPSHOTS = 1.5, 3.0, 45  # stages in t_sigma = sqrt(rho R^3/sigma)
NEAR_PLANE, NARROW = 1.5, 2.5  # [d] slices below the one, or with smaller radii than the other, are not fitted
DETACHED, FILM = 170.0, 15.0  # degrees beyond which there is no cap to speak of
SHAPELESS = 15.0  # degrees by which the two angles of a cap differ at most
FLOOR = 3.2  # half width of the plane, in R
SHARES = {2: (2.0, 5.0, 8.0, 12.0, 16.0, 20.0, 25.0), 3: (3.0, 4.0, 5.0, 7.0, 10.0, 13.0, 16.0, 20.0, 24.0)}
BEYOND = (0.0, 50.0)  # where no cap is expected
MODELS = ("akinci",)
AXES = ("dim", "support", "stiffness", "kernels")


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

    @property
    def key(self) -> str:
        """Name of the point's row."""
        size = f"h{self.support:g}.R{self.radius:g}.S{self.stiffness:g}"
        return f"{self.model}.{self.dim}d.{self.kernels}.{size}.b{self.share:g}.from{self.begin:g}.{self.seed}"

    def cost(self) -> float:
        """About the seconds that it takes on one core."""
        return 0.4 * (0.5 * self.radius**self.dim * math.pi) ** (1 + 1.5 / self.dim) / 1e4 * (3 if self.dim == 2 else 5)

    def urgency(self) -> int:
        """0 for the base setting at one radius, 1 for another radius and other starts, 2 along the axes."""
        away = any(getattr(self, name) != value for name, value in BASE.items())
        return 2 if away else int(self.radius != SIZE[self.dim] or self.begin != 90.0)


SIZE = {2: 16.0, 3: 8.0}
LARGER = {2: 24.0, 3: 11.0}


def points(models: tuple[str, ...] = MODELS, dims: tuple[int, ...] = (2, 3)) -> Iterator[Point]:
    """The map at its base with three seeds, a larger size and two other starts; along h/d and S with one."""
    for dim in dims if "akinci" in models else ():
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


# The shape of a cap, per radius of its circle


def cap_volume(angle: float, dim: int) -> float:
    """Volume (area in 2D) of a spherical cap of radius 1 with a contact angle [rad]."""
    c = math.cos(angle)
    return math.pi / 3 * (2 + c) * (1 - c) ** 2 if dim == 3 else angle - math.sin(angle) * c


@functools.cache
def _lifts(dim: int) -> tuple[NDArray, NDArray]:
    """Contact angles [degrees] and the height of the centre of mass over volume^(1/dim) of each cap."""
    angles, lifts = np.linspace(2.0, 178.0, 353), []
    for angle in np.radians(angles):
        z = np.linspace(0.0, 1 - math.cos(angle), 801)
        across = np.maximum(1 - (z + math.cos(angle)) ** 2, 0) ** (1.0 if dim == 3 else 0.5)
        centre = np.trapezoid(z * across, z) / np.trapezoid(across, z)
        lifts.append(centre / cap_volume(float(angle), dim) ** (1 / dim))
    return angles, np.array(lifts)


def angle_by_lift(lift: float, dim: int) -> float:
    """Contact angle [degrees] of the cap whose centre of mass stands at `lift` = height/volume^(1/dim)."""
    angles, lifts = _lifts(dim)
    return float(np.interp(lift, lifts, angles))


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


def start(point: Point) -> NDArray:
    """Particles of a cap on the plane z = 0 (y = 0 in 2D), cut from the lattice and shifted at random."""
    angle = math.radians(point.begin)
    radius = point.radius * (cap_volume(math.pi / 2, point.dim) / cap_volume(angle, point.dim)) ** (1 / point.dim)
    reach = math.ceil(2 * radius)
    axes = [np.arange(-reach, reach) + 0.5] * (point.dim - 1) + [np.arange(reach) + 0.5]
    lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, point.dim)
    centre = np.zeros(point.dim)
    centre[-1] = -radius * math.cos(angle)
    lattice = lattice[((lattice - centre) ** 2).sum(1) < radius**2]
    position = np.zeros((len(lattice), 3))
    position[:, : point.dim] = lattice
    random = np.random.default_rng(point.seed)
    position[:, : point.dim] += JITTER * random.uniform(-1, 1, lattice.shape)
    return position


def scene(point: Point, position: NDArray) -> Scene:
    """The drop over the plane."""
    fluid = WeaklyCompressible(
        rest_density=1.0, sound_speed=1 / math.sqrt(point.stiffness),
        dynamic_viscosity=CALM * math.sqrt(point.radius), kernels=point.kernels, density="summation",
    )  # fmt: skip
    grid = Discretisation(point.dim, "float64", 1.0, point.support, 0)
    gamma = Akinci2013(surface_tension=1.0).coefficient(grid, {"weakly_compressible": fluid})
    up, width = point.dim - 1, float(math.ceil(FLOOR * point.radius))
    lower, weight = [-width] * 3, [0.0] * 3
    lower[up], weight[up] = 0.0, -BOND / point.radius**2
    sides: Any = tuple(face for face in ("-x", "+x", "-y", "+y", "-z", "+z") if face != "-" + "xyz"[up])
    floor = BoxWalls(lower=tuple(lower), upper=(width,) * 3, open_faces=sides)
    tension = Akinci2013(surface_tension=1.0, adhesion=point.share * gamma)
    return Scene(
        name=point.key, spacing=1.0, support_radius=point.support, dim=point.dim, fluid=(Cloud(position=position),),
        effects=(fluid, tension, floor, Gravity(acceleration=tuple(weight))),
    )  # fmt: skip


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
    position = start(point)
    row["particles"] = len(position)
    simulation = Simulation(scene(point, position), backend)
    stir(simulation, point, STIRRED * capillary_time)
    run_to(simulation, (STIRRED + RELAXED) * capillary_time)
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
        groups.setdefault(tuple(row[name] for name in AXES), []).append(row)
    return [
        {**dict(zip(AXES, key)), "drops": [_of_share(own, share) for share in sorted({r["share"] for r in own})]}
        for key, own in sorted(groups.items(), key=str)
    ]


def fate(row: Mapping[str, Any]) -> str:
    """What became of a drop: "cap", "no cap" where a second angle is missing or too far off for one, and so on."""
    if row["stopped"] or row["fate"] != "cap":
        return row["stopped"] or row["fate"]
    return "cap" if abs(row["angle"] - row["circle"]) <= SHAPELESS else "no cap"


def _of_share(rows: Sequence[Mapping[str, Any]], share: float) -> dict[str, Any]:
    own = [r for r in rows if r["share"] == share]
    caps = [r for r in own if fate(r) == "cap"]
    caps = caps if 2 * len(caps) > len(own) else []
    angles, circles = [r["angle"] for r in caps], [r["circle"] for r in caps if math.isfinite(r["circle"])]
    return {
        "share": share, "angle": round(float(np.mean(angles)), 2) if angles else None,
        "spread": round(float(np.std(angles, ddof=1)), 2) if len(angles) > 1 else None,
        "circle": round(float(np.mean(circles)), 2) if circles else None, "drops": len(own),
        "fates": dict(sorted(Counter(map(fate, own)).items())),
    }  # fmt: skip


def write(rows: Iterable[Mapping[str, Any]], path: Path = PACKAGED) -> int:
    """Write the map; returns how many settings it has."""
    return write_settings(condensed(rows), path)
