"""Density and accelerations beside those of other programs, term by term on the same cloud in 3D.

Support radius of two spacings. With SPlisHSPlasH and PySPH the cubic spline and p = c^2 max(rho - rho0, 0); with the
SPH example of NVIDIA Warp the kernels of Mueller et al. 2003 and p = c^2 (rho - rho0).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from refsim import Akinci2013, Cloud, Scene, WeaklyCompressible
from refsim.neighbours.reference import pair_blocks
from refsim.smoothing import smoothing
from refsim.smoothing.reference import kernel_slope
from validation.peers import pysph_terms, splishsplash_terms, warp_terms
from validation.results import Result
from validation.running import Context

DENSITY, SOUND, VISCOSITY, SPACING = 1000.0, 10.0, 0.01, 0.1  # kg/m^3, m/s, m^2/s, m
TENSION = 1.0  # gamma [m^4/(kg s^2)] of the cohesion, and eps [m/s^2] of the area term
LIGHT = 1.0  # second rest density [kg/m^3], at which the area term outweighs the cohesion
SUPPORT, MASS = 2 * SPACING, DENSITY * SPACING**3  # m, kg; SPlisHSPlasH chooses its own mass
DENSE, SHAKEN = 0.85, 0.1  # distances over the lattice's; displacement over the spacing
WIDE = 1.25  # distances over the lattice's, for a cloud without a pair closer than h/2
THREADS = 1
TERMS = {  # by program
    "splishsplash": ("density", "pressure", "viscous", "normal", "cohesion", "far_cohesion", "area"),
    "pysph": ("density", "pressure", "morris"),
    "warp": ("density", "pressure", "viscous"),
}
EQUAL = {  # terms for which the program has refsim's formula
    "splishsplash": ("density", "normal", "far_cohesion", "area"),
    "pysph": ("density", "pressure"),
    "warp": ("density", "viscous"),
}
DOUBLE = ("pysph",)  # programs in double precision
PEERS = {"splishsplash": "splishsplash_terms", "pysph": "pysph_terms", "warp": "warp_terms"}  # modules
Fields = dict[str, NDArray]


def splishsplash(context: Context, side: int, seed: int) -> Result:
    """SPlisHSPlasH, single precision: values as in `_compared`."""
    position, velocity = cloud(side, seed)
    flow = _step(position, velocity, stiffness=DENSITY * SOUND**2, viscosity=VISCOSITY)
    theirs = _tension(position, velocity)
    theirs |= {"density": flow["density"], "pressure": flow["pressure"], "viscous": flow["other"]}
    liquid = Liquid(context, position, velocity, float(flow["mass"]), float(flow["support"]))
    plain, area = liquid.evaluate(), liquid.evaluate(area=TENSION)
    ours = {
        "density": np.maximum(plain["density"], DENSITY),
        "pressure": plain["acceleration"],
        "viscous": liquid.evaluate(viscosity="central")["acceleration"] - plain["acceleration"],
        "normal": area["surface_normal"],
        "cohesion": liquid.evaluate(gamma=TENSION)["acceleration"] - plain["acceleration"],
        "area": area["acceleration"] - plain["acceleration"],
    }
    sums = Sums(position, velocity, plain["density"], liquid.mass, liquid.support)
    own = ours | {
        "pressure": sums.pressure(),
        "viscous": sums.central(0.01 * sums.support**2),
        "cohesion": sums.cohesion(),
    }

    position, velocity = cloud(side, seed, WIDE)
    theirs["far_cohesion"] = _tension(position, velocity)["cohesion"]
    wide = Liquid(context, position, velocity, liquid.mass, liquid.support)
    far = wide.evaluate(gamma=TENSION)["acceleration"] - wide.evaluate()["acceleration"]
    ours["far_cohesion"] = own["far_cohesion"] = far
    return _compared("splishsplash", ours, own, theirs, flow["version"])


def _step(position: NDArray, velocity: NDArray, **changed: float) -> dict[str, Any]:
    """Fields of SPlisHSPlasH without pressure, viscosity and tension, but for what is `changed`."""
    rest = {"spacing": SPACING, "density": DENSITY, "stiffness": 0.0, "viscosity": 0.0, "tension": 0.0}
    return _present(splishsplash_terms.run(position, velocity, THREADS, **(rest | changed)))


def _tension(position: NDArray, velocity: NDArray) -> Fields:
    """Normal, cohesion and area term of SPlisHSPlasH.

    Its one coefficient k of the tension makes a = k (rho0 C + N), cohesion and area term, with C and N independent of
    the rest density rho0: two runs at different rho0 give both.
    """
    heavy = _step(position, velocity, tension=TENSION)
    light = _step(position, velocity, tension=TENSION, density=LIGHT)
    cohesion = (heavy["other"] - light["other"]) / (1 - LIGHT / DENSITY)
    return {"normal": heavy["normal"], "cohesion": cohesion, "area": heavy["other"] - cohesion}


def pysph(context: Context, side: int, seed: int) -> Result:
    """PySPH, double precision: values as in `_compared`."""
    position, velocity = cloud(side, seed)
    theirs = _present(pysph_terms.run(
        position, velocity, THREADS,
        support=SUPPORT, mass=MASS, density=DENSITY, sound=SOUND, viscosity=VISCOSITY,
    ))  # fmt: skip
    liquid = Liquid(context, position, velocity, MASS, SUPPORT)
    plain = liquid.evaluate()
    ours = {
        "density": plain["density"], "pressure": plain["acceleration"],
        "morris": liquid.evaluate(viscosity="laplacian")["acceleration"] - plain["acceleration"],
    }  # fmt: skip
    sums = Sums(position, velocity, plain["density"], MASS, SUPPORT)
    own = ours | {"pressure": sums.mixed_pressure(), "morris": sums.morris(0.01 * (0.5 * SUPPORT) ** 2)}
    return _compared("pysph", ours, own, theirs, theirs["version"])


def warp(context: Context, side: int, seed: int) -> Result:
    """The SPH example of NVIDIA Warp, single precision: values as in `_compared`."""
    position, velocity = cloud(side, seed)
    theirs = _present(warp_terms.run(
        position, velocity,
        support=SUPPORT, mass=MASS, density=DENSITY, sound=SOUND, viscosity=DENSITY * VISCOSITY,
    ))  # fmt: skip
    liquid = Liquid(context, position, velocity, MASS, SUPPORT, kernels="mueller")
    plain = liquid.evaluate()
    ours = {
        "density": plain["density"],
        "pressure": plain["acceleration"],
        "viscous": liquid.evaluate(viscosity="laplacian")["acceleration"] - plain["acceleration"],
    }
    return _compared("warp", ours, ours | {"pressure": -0.5 * ours["pressure"]}, theirs, theirs["version"])


def cloud(side: int, seed: int, distances: float = DENSE) -> tuple[NDArray, NDArray]:
    """Positions [m] and velocities [m/s] (side^3, 3): a strained, shaken lattice; exact in single precision."""
    random = np.random.default_rng(seed)
    lattice = (np.indices((side,) * 3).reshape(3, -1).T + 0.5) * SPACING
    position = distances * lattice + SHAKEN * SPACING * random.uniform(-1, 1, lattice.shape)
    velocity = random.normal(size=lattice.shape)
    return position.astype(np.float32).astype(float), velocity.astype(np.float32).astype(float)


def _present(answer: dict[str, Any]) -> dict[str, Any]:
    """The answer of a program; raises RuntimeError where it did not run."""
    if "missing" in answer:
        raise RuntimeError(answer["missing"])
    return answer


def _compared(program: str, ours: Fields, own: Fields, theirs: Mapping[str, Any], version: str) -> Result:
    """Differences to another program.

    <term>            root mean square difference between the programs over the root mean square of refsim's
    <term>.explained  the same after that program's formulas have been put in place of refsim's, on refsim's density
    """
    density = ours["density"]
    values: dict[str, Any] = {"particles": len(density), "version": version}
    values["compressed"] = float((density > DENSITY).mean())
    for name in TERMS[program]:
        scale = np.linalg.norm(ours[name])
        values[name] = float(np.linalg.norm(theirs[name] - ours[name]) / scale)
        values[f"{name}.explained"] = float(np.linalg.norm(theirs[name] - own[name]) / scale)
    return Result(values)


@dataclass(frozen=True)
class Liquid:
    """The cloud in refsim, in double precision; SI units."""

    context: Context
    position: NDArray
    velocity: NDArray
    mass: float
    support: float
    kernels: Literal["cubic_spline", "mueller"] = "cubic_spline"

    def evaluate(
        self, viscosity: Literal["", "laplacian", "central"] = "", gamma: float = 0.0, area: float = 0.0
    ) -> Fields:
        """Fields "density", "acceleration", and "surface_normal" with the area term."""
        liquid = WeaklyCompressible(
            rest_density=DENSITY, sound_speed=SOUND, kernels=self.kernels,
            dynamic_viscosity=DENSITY * VISCOSITY if viscosity else 0.0, viscosity=viscosity or "laplacian",
            clamp_pressure=self.kernels == "cubic_spline", density="summation",
        )  # fmt: skip
        tension = Akinci2013(gamma=gamma, area_acceleration=area, balance_pressure=False)
        given = Cloud(position=self.position, velocity=self.velocity, mass=np.full(len(self.position), self.mass))
        simulation = self.context.simulation(
            Scene(spacing=SPACING, support_radius=self.support, dtype="float64", fluid=(given,),
                  effects=(liquid, tension) if gamma or area else (liquid,)),
            "cpu",
        )  # fmt: skip
        simulation.evaluate()
        names = ("density", "acceleration", "surface_normal")
        return {name: simulation.field(name) for name in names[: 3 if area else 2]}


COMPARED: dict[str, Callable[..., Result]] = {"splishsplash": splishsplash, "pysph": pysph, "warp": warp}


@dataclass(frozen=True)
class Sums:
    """Sums of the other programs over all pairs, cubic spline; SI units. `support` is the radius h of the kernel."""

    position: NDArray
    velocity: NDArray
    density: NDArray
    mass: float
    support: float

    def pressure(self) -> NDArray:
        """-sum_j m (p_i/rho_i^2 + p_j/rho_j^2) grad W."""
        share = self._pressure() / self.density**2
        return self._sum(lambda i, apart, square, slope: -self.mass * _along(share[i, None] + share, slope, apart))

    def mixed_pressure(self) -> NDArray:
        """-sum_j m (p_i + p_j)/(rho_i rho_j) grad W."""
        p, rho = self._pressure(), self.density

        def term(i: NDArray, apart: NDArray, square: NDArray, slope: NDArray) -> NDArray:
            return -self.mass * _along((p[i, None] + p) / (rho[i, None] * rho), slope, apart)

        return self._sum(term)

    def cohesion(self) -> NDArray:
        """-gamma sum_j m K_ij C(r) x_ij/r, where the factor 32/(pi h^9) of C(r) is missing at h^6/64 for r <= h/2."""
        h, rho = self.support, self.density

        def term(i: NDArray, apart: NDArray, square: NDArray, slope: NDArray) -> NDArray:
            r = np.sqrt(square)
            shape = 32 / (np.pi * h**9) * np.maximum(h - r, 0.0) ** 3 * r**3
            spline = np.where(r > 0.5 * h, shape, 2 * shape - h**6 / 64)
            factor = -TENSION * self.mass * 2 * DENSITY / (rho[i, None] + rho) * spline
            return _along(factor, np.divide(1.0, r, out=np.zeros_like(r), where=r > 0), apart)

        return self._sum(term)

    def central(self, softening: float) -> NDArray:
        """2 (dim + 2) nu sum_j m/rho_j v_ij.x_ij/(r^2 + softening) grad W."""

        def term(i: NDArray, apart: NDArray, square: NDArray, slope: NDArray) -> NDArray:
            speed = ((self.velocity[i, None, :] - self.velocity) * apart).sum(-1)
            share = 10 * VISCOSITY * self.mass / self.density
            return _along(share * speed / (square + softening), slope, apart)

        return self._sum(term)

    def morris(self, softening: float) -> NDArray:
        """4 nu sum_j m/(rho_i + rho_j) x_ij.grad W/(r^2 + softening) v_ij."""

        def term(i: NDArray, apart: NDArray, square: NDArray, slope: NDArray) -> NDArray:
            share = 4 * VISCOSITY * self.mass / (self.density[i, None] + self.density)
            return _along(share * square / (square + softening), slope, self.velocity[i, None, :] - self.velocity)

        return self._sum(term)

    def _pressure(self) -> NDArray:
        return SOUND**2 * np.maximum(self.density - DENSITY, 0.0)

    def _sum(self, term: Callable[[NDArray, NDArray, NDArray, NDArray], NDArray]) -> NDArray:
        """Sum over j of term(i, x_i - x_j, r^2, W'/r), for blocks of particles i."""
        kernel = smoothing("cubic_spline", self.support, 3)
        found = np.zeros_like(self.position)
        for i, apart, distance in pair_blocks(self.position, self.position):
            met = distance > 0
            slope = np.where(met, kernel_slope(distance, kernel) / np.where(met, distance, 1.0), 0.0)
            found[i] = term(i, apart, distance**2, slope).sum(1)
        return found


def _along(factor: NDArray, slope: NDArray, direction: NDArray) -> NDArray:
    """Vectors (block, n, 3)."""
    return (factor * slope)[..., None] * direction
