"""What is measured of a body of liquid with a surface: shape, pressure, ledgers, frequency, contact angle."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim import Simulation
from validation.experiments.mpm_droplet.scene import lattice, turned

Array = NDArray[np.float64]


def mesh_size(
    vertices: Array, facets: NDArray[np.integer], dim: int, origin: Array | None = None
) -> tuple[float, float]:
    """(area, volume) of a closed mesh with outward facets; length and area in the plane.

    origin  (3,) a place in the plane that closes a mesh which ends on one
    """
    corner = np.asarray(vertices, dtype=float)[facets]
    corner = corner - (corner[0, 0] if origin is None else origin)
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


def anisotropy(position: Array, dim: int) -> float:
    """Range of the principal second moments of the particles over their mean."""
    offset = (position - position.mean(0))[:, :dim]
    moments = np.linalg.eigvalsh(offset.T @ offset)
    return float((moments[-1] - moments[0]) / moments.mean())


def anisotropy_of_chance(count: int, dim: int, draws: int = 200) -> float:
    """Mean anisotropy of `count` particles placed at random in a ball (disc): what their number alone makes."""
    random = np.random.default_rng(0)
    found = []
    for _ in range(draws):
        place = random.normal(size=(count, dim))
        place *= (random.uniform(size=count) ** (1 / dim) / np.linalg.norm(place, axis=1))[:, None]
        found.append(anisotropy(place, dim))
    return float(np.mean(found))


def anisotropy_of_cut(radius: float, dim: int, per: int = 2, draws: int = 40) -> float:
    """Mean anisotropy of the sites of a lattice, turned at random, within a ball (disc) of `radius` cells: what the
    distance of the particles alone leaves to a round body."""
    random = np.random.default_rng(0)
    found = []
    for seed in range(draws):
        site = turned(lattice(0.5 * per * radius + 1, dim, random.uniform(-0.25, 0.25, 3)), seed) * 2 / per
        found.append(anisotropy(site[(site**2).sum(1) < radius**2], dim))
    return float(np.mean(found))


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
    return run._shared["surface"].latest


class Ledger:
    """Series of all that is kept or lost, from the start of a run on."""

    def __init__(self, run: Simulation) -> None:
        self.run, self.dim = run, run.plan.grid.dim
        liquid = run.plan.effects["mpm_liquid"]
        self.h, self.modulus = liquid.cell(run.plan.grid), liquid.bulk_modulus
        surface = run.plan.effects["surface_energy"]
        self.tension = surface.surface_tension
        self.wet = surface.wets(run.plan.effects)  # on a floor at y = 0
        self.pull = surface.contact_pull()
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
        surface = surface_of(run)
        there = run.backend
        mesh = surface.inset_mesh
        floor = np.zeros(3) if self.wet else None
        area, volume = mesh_size(there.host(mesh.vertices), there.host(mesh.facets), dim, floor)
        self.fastest = max(self.fastest, float(np.sqrt((v**2).sum(1).max())))
        v0 = self.volume / len(x)
        kinetic = 0.5 * float((mass * (v**2).sum(1)).sum())
        bulk = 0.5 * self.modulus * v0 * float(((ratio - 1) ** 2).sum())
        pulled = self.tension * float(there.host(surface.samples.area).sum(dtype=float))
        if self.wet:  # k A - k cos(theta) A_wet; by the divergence theorem the edge's lines give (d - 1) A_wet
            held = run._shared["surface"]
            place, line = there.host(held.sample_position), there.host(held.sample_line)
            pulled -= self.pull * float((place * line).sum(dtype=float)) / (dim - 1)
        # volume-weighted: the plain mean of lambda (1 - J) is too large by lambda times the variance of J
        pressure = -self.modulus * float(((ratio - 1) * ratio).sum() / ratio.sum())
        row = {
            "time": run.time, "kinetic": kinetic, "bulk": bulk, "surface": pulled, "energy": kinetic + bulk + pulled,
            "area": area / self.round_area, "volume": volume / self.volume, "sphericity": sphericity(area, volume, dim),
            "pressure": pressure * self.radius / ((dim - 1) * self.tension) if self.tension else 0.0,
            "momentum": float(np.abs(mass @ v).max()),
            "angular": float(np.abs(self._turning(x, v)).max()),
            "centre": float(np.abs(x.mean(0) - self.centre).max() / self.h),
            "anisotropy": body_anisotropy(there.host(mesh.vertices), there.host(mesh.facets), dim),
            "particle_anisotropy": anisotropy(x, dim), "least_ratio": float(ratio.min()),
            "greatest_ratio": float(ratio.max()),
        }  # fmt: skip
        for name, value in row.items():
            self.series.setdefault(name, []).append(value)

    def _turning(self, x: Array, v: Array) -> Array:
        """Angular momentum about the first centre: sum m (x cross v), and what the affine matrices carry, A D."""
        turning = (self.mass[:, None] * np.cross(x - self.centre, v)).sum(0)
        if "inverse_spread" not in self.run.fields:
            return turning
        moment = self.run.field("affine").reshape(-1, 3, 3).astype(float) @ spreads(self.run)
        moment = (self.mass[:, None, None] * moment).sum(0)
        return turning + [moment[2, 1] - moment[1, 2], moment[0, 2] - moment[2, 0], moment[1, 0] - moment[0, 1]]

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


def evenness(run: Simulation, depth: float = 2.0) -> dict[str, float]:
    """How evenly particles fill a round body, and whether J knows: rho J/rho0 of those `depth` cells and more below its
    surface.

    rho is the grid's: masses through the spline to the nodes, over the cell's volume, and back. mean and deviation over
    the particles; range: of the means over the octants (quadrants)
    """
    dim, liquid = run.plan.grid.dim, run.plan.effects["mpm_liquid"]
    h = liquid.cell(run.plan.grid)
    x, mass, ratio = (run.field(name).astype(float) for name in ("position", "mass", "volume_ratio"))
    place = x[:, :dim] / h
    base = np.floor(place - 0.5).astype(int)
    f = place - base
    weight = np.stack([0.5 * (1.5 - f) ** 2, 0.75 - (f - 1) ** 2, 0.5 * (f - 0.5) ** 2])
    base -= base.min(0)
    nodes = np.zeros(base.max(0) + 3)
    density = np.zeros(len(x))
    stencil = [np.array(offset) for offset in np.ndindex(*[3] * dim)]
    shares = [np.prod([weight[offset[c], :, c] for c in range(dim)], axis=0) for offset in stencil]
    for offset, share in zip(stencil, shares):
        np.add.at(nodes, tuple((base + offset).T), mass * share)
    for offset, share in zip(stencil, shares):
        density += share * nodes[tuple((base + offset).T)] / h**dim
    away = (x - x.mean(0))[:, :dim]
    volume = float((mass * ratio).sum()) / liquid.rest_density
    radius = math.sqrt(volume / math.pi) if dim == 2 else (3 * volume / (4 * math.pi)) ** (1 / 3)
    deep = np.linalg.norm(away, axis=1) < radius - depth * h
    if not deep.any():
        return dict.fromkeys(("mean", "deviation", "range"), float("nan"))
    share = (density * ratio)[deep] / liquid.rest_density
    side = (away[deep] > 0) @ (1 << np.arange(dim))
    means = [share[side == k].mean() for k in range(2**dim) if (side == k).any()]
    return {"mean": float(share.mean()), "deviation": float(share.std()), "range": float(np.ptp(means))}


def deformation(position: Array, dim: int) -> float:
    """Mode 2 about x: (<x^2> - <y^2>)/(<x^2> + <y^2>), in space with the mean of y and z."""
    offset = position - position.mean(0)
    along = float((offset[:, 0] ** 2).mean())
    across = float((offset[:, 1:dim] ** 2).mean())
    return (along - across) / (along + across)


def damped_cosine(time: Array, value: Array, guess: float) -> dict[str, float]:
    """Fit of a exp(-g t) cos(w t + p) + c: undamped frequency sqrt(w^2 + g^2) [1/s], its standard error, damping."""
    from scipy.optimize import curve_fit

    def curve(t: Array, a: float, w: float, g: float, p: float, c: float) -> Array:
        return a * np.exp(-g * t) * np.cos(w * t + p) + c

    fits = []
    for share in (0.94, 0.98, 1.02):
        try:
            found, spread = curve_fit(curve, time, value, p0=[value[0], share * guess, 0.1, 0.0, 0.0], maxfev=20000)
        except RuntimeError:
            continue
        fits.append((float(((curve(time, *found) - value) ** 2).mean()), found, spread))
    if not fits:
        return dict.fromkeys(("frequency", "error", "damping", "amplitude", "misfit"), float("nan"))
    misfit, found, spread = min(fits, key=lambda f: f[0])
    return {
        "frequency": float(math.hypot(found[1], found[2])), "error": float(math.sqrt(spread[1, 1])),
        "damping": float(found[2]), "amplitude": float(abs(found[0])), "misfit": math.sqrt(misfit),
    }  # fmt: skip


def rayleigh(radius: float, dim: int, tension: float = 1.0, density: float = 1.0) -> float:
    """Frequency of mode 2 [rad/s]: sqrt(6 k/(rho R^3)) in the plane, sqrt(8 k/(rho R^3)) in space (Rayleigh 1879)."""
    return math.sqrt((6 if dim == 2 else 8) * tension / (density * radius**3))


def compressible(radius: float, dim: int, modulus: float, tension: float = 1.0, density: float = 1.0) -> float:
    """Frequency of mode 2 of a liquid with sound speed sqrt(lambda/rho), over Rayleigh's.

    Inside, the pressure is a Bessel function of q r, q = w/c; with the outer condition of Rayleigh's drop the frequency
    obeys w^2 = w_R^2 q R f'(q R)/(2 f(q R)), f = J_2 in the plane, j_2 in space.
    """
    from scipy.special import jv, jvp, spherical_jn

    first = rayleigh(radius, dim, tension, density)
    frequency, sound = first, math.sqrt(modulus / density)
    for _ in range(50):
        z = frequency * radius / sound
        if dim == 2:
            share = z * jvp(2, z) / (2 * jv(2, z))
        else:
            share = z * spherical_jn(2, z, derivative=True) / (2 * spherical_jn(2, z))
        frequency = first * math.sqrt(share)
    return frequency / first


def spreads(run: Simulation) -> Array:
    """D of each particle's cluster (n, 3, 3) [m^2], h^2/4 along an axis without embedded points."""
    packed = run.field("inverse_spread").astype(float)
    inverse = packed[:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
    return run.plan.effects["mpm_liquid"].cell(run.plan.grid) ** 2 / 4 * np.linalg.inv(inverse)


def inertia_share(run: Simulation) -> float:
    """What the grid sees of the inertia of a linear field, over the particles': 1 + sum m tr D/sum m |x|^2.

    A particle brings its spread D to the grid (h^2/4 along each axis, more in a cluster) beside its place.
    """
    dim = run.plan.grid.dim
    spread = np.trace(spreads(run)[:, :dim, :dim], axis1=1, axis2=2)
    offset = run.field("position").astype(float)
    offset = (offset - offset.mean(0))[:, :dim]
    mass = run.field("mass").astype(float)
    return float(1 + (mass * spread).sum() / (mass * (offset**2).sum(1)).sum())


def contact(position: Array, floor: float, h: float, dim: int) -> dict[str, float]:
    """Ball (circle) through the free surface of a drop on a floor, and its angle with the floor [degrees].

    position  (s, dim) of surface samples [m], y upwards; those nearer to the floor than 1.5 cells, where the
              reconstruction rounds the edge, are left out
    """
    points = position[position[:, 1] > floor + 1.5 * h][:, :dim]
    if len(points) < 8:
        return dict.fromkeys(("angle", "radius", "roughness"), float("nan"))
    matrix = np.column_stack([2 * points, np.ones(len(points))])
    found, *_ = np.linalg.lstsq(matrix, (points**2).sum(1), rcond=None)
    centre = found[:dim]
    radius = math.sqrt(found[dim] + float(centre @ centre))
    away = np.linalg.norm(points - centre, axis=1)
    angle = math.degrees(math.acos(min(1.0, max(-1.0, (floor - centre[1]) / radius))))
    return {"angle": angle, "radius": radius / h, "roughness": float(away.std() / radius)}


def angle_of_mass(height: float, volume: float, dim: int) -> float:
    """Contact angle [degrees] of the cap of this volume [m^dim] whose centre of mass stands so high over its floor [m].

    Unlike `contact` it uses the particles, not the reconstructed surface.
    """
    from scipy.optimize import brentq

    def above(angle: float) -> float:
        c, s = math.cos(angle), math.sin(angle)
        if dim == 2:  # segment of the unit circle
            size, moment = angle - s * c, 2 * s**3 / 3
        else:
            size, moment = math.pi * (2 - 3 * c + c**3) / 3, math.pi * s**4 / 4
        return (volume / size) ** (1 / dim) * (moment / size - c) - height

    return math.degrees(brentq(above, math.radians(5), math.radians(175)))
