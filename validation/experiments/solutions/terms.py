"""Density, pressure and viscous acceleration beside those of SPlisHSPlasH, on the same cloud in 3D.

Both take the cubic spline, a support radius of two spacings, and p = c^2 max(rho - rho0, 0).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim import Cloud, Scene, WeaklyCompressible
from refsim.neighbours.reference import pair_blocks
from refsim.smoothing import smoothing
from refsim.smoothing.reference import kernel_slope
from validation.peers import splishsplash_terms
from validation.results import Result
from validation.running import Context

DENSITY, SOUND, VISCOSITY, SPACING = 1000.0, 10.0, 0.01, 0.1  # kg/m^3, m/s, m^2/s, m
DENSE, SHAKEN = 0.85, 0.1  # distances over the lattice's; displacement over the spacing
TERMS = ("density", "pressure", "viscous")


def compare(context: Context, side: int, seed: int, threads: int) -> Result:
    """side^3 particles of a compressed, shaken lattice with random velocities.

    <term>            root mean square difference between the programs over the root mean square of refsim's
    <term>.explained  the same after that program's own formulas have been put in place of refsim's, on refsim's density
    Raises RuntimeError where the other program does not run.
    """
    random = np.random.default_rng(seed)
    lattice = (np.indices((side,) * 3).reshape(3, -1).T + 0.5) * SPACING
    position = DENSE * lattice + SHAKEN * SPACING * random.uniform(-1, 1, lattice.shape)
    velocity = random.normal(size=lattice.shape)
    position, velocity = (a.astype(np.float32).astype(float) for a in (position, velocity))
    theirs = splishsplash_terms.run(
        position, velocity, threads,
        spacing=SPACING, density=DENSITY, stiffness=DENSITY * SOUND**2, viscosity=VISCOSITY,
    )  # fmt: skip
    if "missing" in theirs:
        raise RuntimeError(theirs["missing"])
    mass, support = float(theirs["mass"]), float(theirs["support"])
    made = {nu: _fields(context, position, velocity, mass, support, nu) for nu in (0.0, VISCOSITY)}
    density = made[0.0]["density"]
    ours = {
        "density": np.maximum(density, DENSITY),
        "pressure": made[0.0]["acceleration"],
        "viscous": made[VISCOSITY]["acceleration"] - made[0.0]["acceleration"],
    }
    own = {"density": ours["density"], **_formulas(position, velocity, density, mass, support)}
    values: dict[str, Any] = {"particles": len(position), "version": theirs["version"]}
    values["compressed"] = float((density > DENSITY).mean())
    for name in TERMS:
        scale = np.linalg.norm(ours[name])
        values[name] = float(np.linalg.norm(theirs[name] - ours[name]) / scale)
        values[f"{name}.explained"] = float(np.linalg.norm(theirs[name] - own[name]) / scale)
    return Result(values)


def _fields(
    context: Context, position: NDArray, velocity: NDArray, mass: float, support: float, viscosity: float
) -> dict[str, NDArray]:
    """Density and acceleration in refsim, with the viscosity along the line of centres."""
    liquid = WeaklyCompressible(
        rest_density=DENSITY,
        sound_speed=SOUND,
        dynamic_viscosity=DENSITY * viscosity,
        viscosity="central",
        kernels="cubic_spline",
    )
    cloud = Cloud(position=position, velocity=velocity, mass=np.full(len(position), mass))
    scene = Scene(spacing=SPACING, support_radius=support, dtype="float64", fluid=(cloud,), effects=(liquid,))
    simulation = context.simulation(scene, "cpu")
    simulation.evaluate()
    return {name: simulation.field(name) for name in ("density", "acceleration")}


def _formulas(
    position: NDArray, velocity: NDArray, density: NDArray, mass: float, support: float
) -> dict[str, NDArray]:
    """The other program's sums, all pairs: m (p_i/rho_i^2 + p_j/rho_j^2) grad W, and Monaghan's viscosity with the
    kernel of the density: 2 (dim + 2) nu m_j/rho_j v_ij.x_ij/(r^2 + 0.01 h^2) grad W."""
    kernel = smoothing("cubic_spline", support, 3)
    raised = np.maximum(density, DENSITY)
    share = SOUND**2 * (raised - DENSITY) / raised**2
    found = {name: np.zeros_like(position) for name in ("pressure", "viscous")}
    for i, apart, distance in pair_blocks(position, position):
        slope = np.where(distance > 0, kernel_slope(distance, kernel) / np.where(distance > 0, distance, 1.0), 0.0)
        pushed = (share[i, None] + share[None, :]) * mass * slope
        found["pressure"][i] -= (pushed[..., None] * apart).sum(1)
        along = ((velocity[i, None, :] - velocity[None, :, :]) * apart).sum(-1)
        factor = 10 * VISCOSITY * mass / density[None, :] * along / (distance**2 + 0.01 * support**2) * slope
        found["viscous"][i] += (factor[..., None] * apart).sum(1)
    return found
