"""SPlisHSPlasH's density and accelerations of a given cloud: the first step of its WCSPH.

In a process of its own. Cubic spline throughout (its vector code sums with no other kernel), a support
radius of two spacings, its standard viscosity, its surface tension of Akinci et al. 2013.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from validation.peers.splishsplash import WCSPH, coefficients, launched, scene, simulator

STEP = 1e-6  # s: fields of the beginning of the first step are read, so that its length does not matter


def run(position: NDArray, velocity: NDArray, threads: int, **settings: float) -> dict[str, Any]:
    """Fields in the particles' order, "mass", "support" and "version"; or {"missing"}.

    position, velocity  (n, 3); n is a cube of a whole number
    settings  "spacing", "density" at rest, "stiffness" rho0 c^2 (exponent 1), "viscosity" (kinematic), "tension" (its
              one coefficient of cohesion and area term; 0 for none); SI units

    Accelerations (n, 3) [m/s^2] are "pressure", and "other": viscosity and tension. "normal" (n, 3) is that of the area
    term, zero without tension. "mass" and "support" radius are its choice. After viscosity and tension it raises
    densities below the rest density to that; "density" (n,) is what it has then.
    """
    given = {"position": position, "velocity": velocity, **settings}
    return launched("splishsplash_terms", given, threads, 120.0)


def work(
    position: NDArray, velocity: NDArray, spacing: float, density: float, stiffness: float, viscosity: float,
    tension: float,
) -> Mapping[str, Any]:  # fmt: skip
    """Take the step in this process."""
    import pysplishsplash as peer

    side = round(len(position) ** (1 / 3))
    block = {"start": [0.0] * 3, "end": [(side + 1) * spacing] * 3}
    given = {"stopAt": 0.5 * STEP, "enableZSort": False}
    base = simulator(peer, scene(spacing, WCSPH | {"timeStepSize": STEP} | given, block, tension > 0, density))
    base.initSimulation()
    simulation = peer.Simulation.getCurrent()
    fluid = coefficients(peer, viscosity, tension, stiffness)
    count = int(fluid.numActiveParticles())
    if count != len(position):
        raise ValueError(f"it made {count} particles of {len(position)}")
    for i in range(count):
        fluid.setPosition(i, position[i].astype(np.float32))
        fluid.setVelocity(i, velocity[i].astype(np.float32))
    base.runSimulation()

    def field(name: str) -> NDArray:
        return np.array(fluid.getFieldBuffer(name))[:count].astype(float)

    pressure = field("pressure acceleration")
    normal = np.zeros_like(pressure)
    if tension:
        normal[:] = [fluid.getSurfaceTensionBase().getNormal(i) for i in range(count)]
    both = np.array([fluid.getAcceleration(i) for i in range(count)], dtype=float)  # after the step: the sum of all
    return {
        "density": field("density"), "pressure": pressure, "other": both - pressure, "normal": normal,
        "support": float(simulation.getSupportRadius()), "mass": density * float(fluid.getVolume(0)),
    }  # fmt: skip
