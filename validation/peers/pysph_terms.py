"""PySPH's density and accelerations of a given cloud: its equations, evaluated once.

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
    """Density (n,) and accelerations (n, 3) [m/s^2] of the particles, and "version"; or {"missing"}.

    position, velocity  (n, 3)
    settings  "support" radius, "mass" of a particle, "density" at rest, "sound" speed, kinematic "viscosity"; SI units

    "pressure"  `MomentumEquationPressureGradientMorris`, from p = c^2 max(rho - rho0, 0)
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
    from pysph.sph.wc import viscosity as friction
    from pysph.tools.sph_evaluator import SPHEvaluator

    columns = {name: np.ascontiguousarray(position[:, k]) for k, name in enumerate("xyz")}
    columns |= {name: np.ascontiguousarray(velocity[:, k]) for k, name in enumerate("uvw")}
    columns |= {"m": np.full(len(position), mass), "h": np.full(len(position), 0.5 * support)}  # its kernel ends at 2 h
    zeros = dict.fromkeys(("au", "av", "aw", "cs", "dt_cfl", "dt_force"), 0.0)

    def particles(name: str, **more: Any) -> Any:
        return get_particle_array(name=name, **columns, **zeros, **more)

    liquid = particles("liquid")
    state = [
        Group([basic_equations.SummationDensity("liquid", ["liquid"])]),
        Group([basic_equations.IsothermalEOS("liquid", ["liquid"], rho0=density, c0=sound, p0=0.0)]),
    ]
    SPHEvaluator([liquid], state, dim=3, kernel=CubicSpline(dim=3)).evaluate()
    liquid.p[:] = np.maximum(liquid.p, 0.0)

    # One cloud for each equation: all add to the acceleration of their particles.
    of = ["liquid"]
    equations = {
        "pressure": surface_tension.MomentumEquationPressureGradientMorris("pressure", of),
        "morris": friction.LaminarViscosity("morris", of, nu=viscosity),
    }
    clouds = {name: particles(name, rho=liquid.rho, p=liquid.p) for name in equations}
    every = [liquid, *clouds.values()]
    SPHEvaluator(every, [Group(list(equations.values()))], dim=3, kernel=CubicSpline(dim=3)).evaluate()

    accelerations = {name: np.stack([own.au, own.av, own.aw], axis=1) for name, own in clouds.items()}
    return {"density": np.array(liquid.rho), **accelerations}
