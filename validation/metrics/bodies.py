"""What is measured of a body of MPM liquid with a surface: shape, pressure, ledgers, frequency."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim import Simulation
from refsim.mpm.operations import SYMMETRIC
from validation.metrics.droplet import inertia_anisotropy
from validation.running import note

Array = NDArray[np.float64]


def mesh_size(vertices: Array, facets: NDArray[np.integer], dim: int) -> tuple[float, float]:
    """(area, volume) of a closed mesh with outward facets; length and area in the plane."""
    corner = np.asarray(vertices, dtype=float)[facets]
    corner = corner - corner[0, 0]
    if dim == 2:
        a, b = corner[:, 0], corner[:, 1]
        return float(np.linalg.norm(b - a, axis=1).sum()), float(abs((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()) / 2)
    a, b, c = (corner[:, k] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    return float(area), float(abs((a * np.cross(b, c)).sum()) / 6)


def sphericity(area: float, volume: float, dim: int) -> float:
    """Wadell's: area of the ball (disc) of the same volume over the area."""
    if dim == 2:
        return 2 * math.sqrt(math.pi * volume) / area
    return math.pi ** (1 / 3) * (6 * volume) ** (2 / 3) / area


def body_anisotropy(vertices: Array, facets: NDArray[np.integer], dim: int) -> float:
    """Range over mean of the principal second moments of the even body within a closed mesh.

    Each facet makes a simplex with the first vertex: its moment is det/(d + 2)! (sum a a^T + s s^T), s = sum a.
    """
    corner = np.asarray(vertices, dtype=float)[facets][:, :, :dim]
    corner = corner - corner[0, 0]
    sign = np.linalg.det(corner)
    total = corner.sum(1)
    second = np.einsum("f,fka,fkb->ab", sign, corner, corner) + np.einsum("f,fa,fb->ab", sign, total, total)
    volume, first = sign.sum() / math.factorial(dim), sign @ total / math.factorial(dim + 1)
    moments = np.linalg.eigvalsh(second / math.factorial(dim + 2) - np.outer(first, first) / volume)
    return float((moments.max() - moments.min()) / abs(moments.mean()))


def surface_of(run: Simulation) -> Any:
    """The surface that the latest step reconstructed, at its beginning."""
    return run.shared["surface"].latest


class Ledger:
    """Series of all that is kept or lost, from the start of a run on."""

    def __init__(self, run: Simulation) -> None:
        self.run, self.dim = run, run.plan.grid.dim
        liquid = run.plan.effects["mpm_liquid"]
        self.h, self.modulus = liquid.cell(run.plan.grid), liquid.bulk_modulus
        surface = run.plan.effects["surface_energy"]
        self.tension = surface.surface_tension
        self.mass = run.field("mass").astype(float)
        self.volume = float(self.mass.sum() / liquid.rest_density)
        flat = self.dim == 2
        self.radius = math.sqrt(self.volume / math.pi) if flat else (3 * self.volume / (4 * math.pi)) ** (1 / 3)
        self.round_area = 2 * math.pi * self.radius if flat else 4 * math.pi * self.radius**2
        self.centre = self.run.field("position").astype(float).mean(0)
        self.series: dict[str, list[float]] = {}
        self.fastest = 0.0

    def note(self) -> None:
        """One more row. Energies in J, the rest relative; momenta over m v R with the fastest particle so far."""
        run, dim, mass = self.run, self.dim, self.mass
        x, v, ratio = (run.field(name).astype(float) for name in ("position", "velocity", "volume_ratio"))
        affine = run.field("affine").astype(float)
        spread = spreads(run) if "inverse_spread" in run.fields else np.zeros((1, 3, 3))
        surface = surface_of(run)
        there = run.backend
        mesh = surface.inset_mesh
        area, volume = mesh_size(there.host(mesh.vertices), there.host(mesh.facets), dim)
        self.fastest = max(self.fastest, float(np.sqrt((v**2).sum(1).max())))
        v0 = self.volume / len(x)
        kinetic = 0.5 * float((mass * (v**2).sum(1)).sum())
        bulk = 0.5 * self.modulus * v0 * float(((ratio - 1) ** 2).sum())
        pulled = self.tension * float(there.host(surface.samples.area).sum(dtype=float))
        # volume-weighted: the plain mean of lambda (1 - J) is too large by lambda times the variance of J
        pressure = -self.modulus * float(((ratio - 1) * ratio).sum() / ratio.sum())
        row = {
            "time": run.time, "kinetic": kinetic, "bulk": bulk, "surface": pulled, "energy": kinetic + bulk + pulled,
            "area": area / self.round_area, "volume": volume / self.volume, "sphericity": sphericity(area, volume, dim),
            "pressure": pressure * self.radius / ((dim - 1) * self.tension) if self.tension else 0.0,
            "momentum": float(np.abs(mass @ v).max()),
            "angular": float(np.abs(turning(mass, (x, v, affine), spread, self.centre)).max()),
            "centre": float(np.abs(x.mean(0) - self.centre).max() / self.h),
            "anisotropy": body_anisotropy(there.host(mesh.vertices), there.host(mesh.facets), dim),
            "particle_anisotropy": inertia_anisotropy(x[:, :dim]), "least_ratio": float(ratio.min()),
            "greatest_ratio": float(ratio.max()),
        }  # fmt: skip
        note(self.series, row)

    def summary(self) -> dict[str, Any]:
        """Drifts over the whole run, and the last values."""
        s = self.series
        scale = float(self.mass.sum()) * self.fastest or 1.0  # where nothing moves momenta are zero
        late = len(s["time"]) // 2
        return {
            "momentum": max(s["momentum"]) / scale, "angular": max(s["angular"]) / (scale * self.radius),
            "centre": max(s["centre"]), "energy_rise": max(s["energy"]) / s["energy"][0] - 1,
            "least_ratio": min(s["least_ratio"]), "greatest_ratio": max(s["greatest_ratio"]),
            "pressure": float(np.mean(s["pressure"][late:])), "area": float(np.mean(s["area"][late:])),
            "kinetic": float(np.mean(s["kinetic"][late:])) / (self.tension * self.round_area),
            "volume": s["volume"][-1], "sphericity": s["sphericity"][-1], "anisotropy": s["anisotropy"][-1],
            "particle_anisotropy": s["particle_anisotropy"][-1],
            "radius_in_cells": self.radius / self.h, "particles": len(self.mass),
        }  # fmt: skip


def spreads(run: Simulation) -> Array:
    """D of each particle's cluster (n, 3, 3) [m^2], h^2/4 along an axis without embedded points."""
    even = run.plan.effects["mpm_liquid"].cell(run.plan.grid) ** 2 / 4
    if not run.steps or "inverse_spread" not in run.fields:
        return np.broadcast_to(even * np.eye(3), (run.count, 3, 3))
    return even * np.linalg.inv(run.field("inverse_spread").astype(float)[:, SYMMETRIC])


def turning(mass: Array, state: tuple[Array, ...], spread: Array, centre: Array) -> Array:
    """Angular momentum (3,) about a place [kg m^2/s], with what the affine matrices A carry: that of A D.

    state  position, velocity (n, 3) and affine matrices; spread: D of each particle (n, 3, 3) [m^2]
    """
    position, velocity, affine = state
    moment = affine.reshape(-1, 3, 3) @ spread
    vector = np.stack([moment[:, c - 1, c - 2] - moment[:, c - 2, c - 1] for c in range(3)], axis=1)
    return (mass[:, None] * (np.cross(position - centre, velocity) + vector)).sum(0)


def late(series: Mapping[str, Sequence[float]], share: float = 0.25) -> dict[str, dict[str, float]]:
    """Least, mean and largest of the shape's measures over the last quarter of a run."""
    begin = int((1 - share) * len(series["time"]))
    made = {}
    for name in ("volume", "sphericity", "anisotropy", "particle_anisotropy", "pressure", "area"):
        values = np.array(series[name][begin:])
        made[name] = {"least": float(values.min()), "mean": float(values.mean()), "largest": float(values.max())}
    return made


class FreeLedger:
    """What a free body must keep: seen along a run, checked at its end."""

    def __init__(self) -> None:
        self.rows: list[dict[str, float]] = []

    def __call__(self, run: Simulation) -> None:
        """Take down the state."""
        x, v, m, ratio = (run.field(name) for name in ("position", "velocity", "mass", "volume_ratio"))
        surface = run.shared.get("surface")
        area = float(surface.sample_area.sum()) if surface is not None and surface.latest is not None else math.nan
        centre = (m[:, None] * x).sum(0) / m.sum()
        angular = turning_about_centre(m, (x, v, run.field("affine")), spreads(run))
        liquid, tension = run.plan.effects["mpm_liquid"], run.plan.effects.get("surface_energy")
        kinetic = 0.5 * float(m @ (v**2).sum(1))
        bulk = 0.5 * liquid.bulk_modulus / liquid.rest_density * float(m @ (ratio - 1) ** 2)
        self.rows.append({
            "momentum": float(np.abs(m @ v).max()), "speed": float(np.sqrt((v**2).sum(1).max())),
            "angular": angular, "kinetic": kinetic, "ratio": float(ratio.min()),
            "energy": kinetic + bulk + (tension.surface_tension if tension else 0.0) * area,
            "extent": float(np.ptp(x, axis=0).max()), "size": float(np.linalg.norm(x - centre, axis=1).max()),
            "mass": float(m.sum()), "steps": run.steps,
            "samples": float(np.unique(run.backend.host(surface.latest.samples.nearest), return_counts=True)[1].max())
            if area == area else 0.0,
        })  # fmt: skip

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
        spread = spreads(run)
        total = turning_about_centre(mass, now, spread)
        if self.before is not None:
            began = turning_about_centre(mass, self.before, spread)
            self.in_steps += total - began
            self.remade += began - self.total
            for name in self.greatest:
                self.greatest[name] = max(self.greatest[name], abs(getattr(self, name)))
        self.before, self.total = now, total


def turning_about_centre(mass: Array, state: tuple[Array, ...], spread: Array) -> float:
    """The same about the centre of mass, about z."""
    return float(turning(mass, state, spread, (mass[:, None] * state[0]).sum(0) / mass.sum())[2])
