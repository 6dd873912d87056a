"""PySPH's density, normals and accelerations of a given cloud: its equations, evaluated once.

In a process of its own, in double precision; the equations are compiled at the first call (a C++ compiler is needed).
Cubic spline throughout.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from validation.peers import launch


def run(position: NDArray, velocity: NDArray, threads: int, **settings: float) -> dict[str, Any]:
    """Density (n,), "normal" and accelerations (n, 3) [m/s^2] of the particles, and "version"; or {"missing"}.

    position, velocity  (n, 3)
    settings  "support" radius, "mass" of a particle, "density" at rest, "sound" speed, kinematic "viscosity"; SI units

    "normal"    sum_j V_j grad W [1/m]: `MorrisColorGradient` between a cloud of colour 0 and the same of colour 1
    "pressure"  `MomentumEquationPressureGradientMorris`, from p = c^2 max(rho - rho0, 0)
    "momentum"  `MomentumEquation` without artificial viscosity, the same pressure
    "central"   `LaminarViscosityDeltaSPH`, along the line of centres
    "morris"    `LaminarViscosity`, along the difference of velocities
    """
    given = {"position": position, "velocity": velocity, **settings}
    return launch("pysph_terms", given, {"OMP_NUM_THREADS": str(threads)}, 400.0)


def work(
    position: NDArray, velocity: NDArray, support: float, mass: float, density: float, sound: float, viscosity: float
) -> Mapping[str, Any]:
    """Evaluate the equations in this process."""
    from pysph.base.kernels import CubicSpline
    from pysph.base.utils import get_particle_array
    from pysph.sph import basic_equations, surface_tension
    from pysph.sph.equation import Group
    from pysph.sph.wc import basic
    from pysph.sph.wc import viscosity as friction
    from pysph.tools.sph_evaluator import SPHEvaluator

    columns = {name: np.ascontiguousarray(position[:, k]) for k, name in enumerate("xyz")}
    columns |= {name: np.ascontiguousarray(velocity[:, k]) for k, name in enumerate("uvw")}
    columns |= {"m": np.full(len(position), mass), "h": np.full(len(position), 0.5 * support)}  # its kernel ends at 2 h
    zeros = dict.fromkeys(
        ("au", "av", "aw", "cs", "dt_cfl", "dt_force", "scolor", "cx", "cy", "cz", "nx", "ny", "nz", "ddelta", "N"), 0.0
    )

    def particles(name: str, **more: Any) -> Any:
        return get_particle_array(name=name, **columns, **zeros, **more)

    liquid = particles("liquid")
    liquid.scolor[:] = 1.0
    state = [
        Group([basic_equations.SummationDensity("liquid", ["liquid"])]),
        Group([basic_equations.IsothermalEOS("liquid", ["liquid"], rho0=density, c0=sound, p0=0.0)]),
    ]
    SPHEvaluator([liquid], state, dim=3, kernel=CubicSpline(dim=3)).evaluate()
    liquid.p[:] = np.maximum(liquid.p, 0.0)

    # One cloud for each equation: all add to the acceleration of their particles.
    of = ["liquid"]
    equations = {
        "normal": surface_tension.MorrisColorGradient("normal", of),
        "pressure": surface_tension.MomentumEquationPressureGradientMorris("pressure", of),
        "momentum": basic.MomentumEquation("momentum", of, c0=sound, alpha=0.0, beta=0.0),
        "central": friction.LaminarViscosityDeltaSPH("central", of, dim=3, rho0=density, nu=viscosity),
        "morris": friction.LaminarViscosity("morris", of, nu=viscosity),
    }
    clouds = {name: particles(name, rho=liquid.rho, p=liquid.p) for name in equations}
    every = [liquid, *clouds.values()]
    SPHEvaluator(every, [Group(list(equations.values()))], dim=3, kernel=CubicSpline(dim=3)).evaluate()

    def vectors(name: str, *parts: str) -> NDArray:
        return np.stack([getattr(clouds[name], part) for part in parts], axis=1)

    accelerations = {name: vectors(name, "au", "av", "aw") for name in equations if name != "normal"}
    return {"density": np.array(liquid.rho), "normal": vectors("normal", "cx", "cy", "cz"), **accelerations}
