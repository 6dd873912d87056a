"""Density and accelerations of a given cloud by the SPH example of NVIDIA Warp, after Mueller et al. 2003.

In a process of its own, on the CPU, in single precision: its kernels poly6, spiky and that of the viscosity.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from validation.peers import launch


def run(position: NDArray, velocity: NDArray, **settings: float) -> dict[str, Any]:
    """{"density" (n,), "pressure", "viscous" (n, 3) [m/s^2], "version"} of the particles, or {"missing"}.

    position, velocity  (n, 3)
    settings  "support" radius, "mass" of a particle, "density" at rest, "sound" speed, dynamic "viscosity"; SI units

    The pressure c^2 (rho - rho0) may be negative.
    """
    return launch("warp_terms", {"position": position, "velocity": velocity, **settings})


def work(
    position: NDArray, velocity: NDArray, support: float, mass: float, density: float, sound: float, viscosity: float
) -> Mapping[str, Any]:
    """Launch the example's kernels in this process."""
    import warp
    from warp.examples.core import example_sph as example

    warp.init()
    device, count = "cpu", len(position)
    x, v = (warp.array(a.astype(np.float32), dtype=warp.vec3, device=device) for a in (position, velocity))
    rho = warp.zeros(count, dtype=float, device=device)
    grid = warp.HashGrid(32, 32, 32, device=device)
    grid.build(x, support)
    with warp.ScopedDevice(device):
        own = example.Example(stage_path=None)  # for the factors of its sums, at its own mass and support
    length = own.smoothing_length
    poly6 = own.density_normalization * length**9 / own.particle_mass * mass / support**9
    spiky = own.pressure_normalization * length**6 / own.particle_mass * mass / support**6
    friction = own.viscous_normalization * length**6 / (own.particle_mass * own.dynamic_visc)
    warp.launch(example.compute_density, dim=count, inputs=[grid.id, x, rho, poly6, support], device=device)

    def acceleration(of_pressure: float, of_velocity: float) -> NDArray:
        found = warp.zeros(count, dtype=warp.vec3, device=device)
        scalars = [sound**2, density, 0.0, of_pressure, of_velocity, support]
        warp.launch(example.get_acceleration, dim=count, inputs=[grid.id, x, v, rho, found, *scalars], device=device)
        return found.numpy().astype(float)

    return {
        "density": rho.numpy().astype(float),
        "pressure": acceleration(spiky, 0.0),
        "viscous": acceleration(0.0, friction * viscosity * mass / support**6),
    }
