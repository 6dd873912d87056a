"""CUDA kernels of Jiang & Zhu 2023."""

from refsim.backends.compile import cuda, cuda_kernel
from refsim.neighbours.rows import cuda_lane, cuda_lane_row, cuda_row, lanes_sum
from refsim.sph.kernels import wall_pressure, wall_sum
from refsim.surface_tension.jiang_zhu_2023 import formulas, particle


@cuda_kernel
def corrected_density(position, mass, density, near_surface, neighbours, walls, smoothing, fluid, corrected_density):
    """J(14), J(15) on the near-surface particles (on all without that set); the others keep their density."""
    i = cuda.grid(1)
    if i < corrected_density.shape[0]:
        rho = density[i]
        if near_surface is None or near_surface[i] != 0:
            mass_sum, volume_sum = particle.density_sums(
                i, cuda_row(neighbours, i), position, mass, density, neighbours.entries, smoothing
            )
            if walls is not None:
                filled = fluid.rest_density * wall_sum(i, position, walls, smoothing)
                mass_sum += filled
                volume_sum += filled / rho
            rho = formulas.normalised_density(mass_sum, volume_sum)
        corrected_density[i] = rho


@cuda_kernel
def replace_density(corrected_density, density):
    """rho <- rho*, so that everything that follows reads the corrected density."""
    i = cuda.grid(1)
    if i < density.shape[0]:
        density[i] = corrected_density[i]


@cuda_kernel
def soft_weight(surface_normal, soft, surface_weight):
    """Soft surface weight (E9), from J(19)."""
    i = cuda.grid(1)
    if i < surface_weight.shape[0]:
        surface_weight[i] = particle.soft_weight(i, surface_normal, soft)


@cuda_kernel(lanes=True)
def tension(
    position, mass, density, surface_weight, surface, area_normal, neighbours, smoothing, pairs, cohesion, area,
    acceleration,
):  # fmt: skip
    """J(16), J(17) and J(21) or J(18); added to the acceleration."""
    i, lane = cuda_lane(cuda.grid(1), neighbours)
    if i < acceleration.shape[0]:
        ax, ay, az = particle.tension(
            i, cuda_lane_row(neighbours, i, lane), position, mass, density, surface_weight, surface, area_normal,
            neighbours.entries, smoothing, pairs, cohesion, area,
        )  # fmt: skip
        ax, ay, az = lanes_sum(ax, lane, neighbours), lanes_sum(ay, lane, neighbours), lanes_sum(az, lane, neighbours)
        if lane == 0:
            acceleration[i, 0] += ax
            acceleration[i, 1] += ay
            acceleration[i, 2] += az


@cuda_kernel(lanes=True)
def momentum(
    position, velocity, mass, density, pressure, area_normal, neighbours, walls, gradient_smoothing, fluid, viscosity,
    cohesion, area, acceleration,
):  # fmt: skip
    """J(16) between all pairs, J(21) or J(18), J(10), J(11), walls after Akinci 2012; added to the acceleration."""
    i, lane = cuda_lane(cuda.grid(1), neighbours)
    if i < acceleration.shape[0]:
        ax, ay, az = particle.momentum(
            i, cuda_lane_row(neighbours, i, lane), position, velocity, mass, density, pressure, area_normal,
            neighbours.entries, gradient_smoothing, fluid, viscosity, cohesion, area,
        )  # fmt: skip
        if walls is not None:
            share = lane, len(neighbours.lanes)
            bx, by, bz = wall_pressure(i, position, density, pressure, walls, gradient_smoothing, fluid, share)
            ax += bx
            ay += by
            az += bz
        ax, ay, az = lanes_sum(ax, lane, neighbours), lanes_sum(ay, lane, neighbours), lanes_sum(az, lane, neighbours)
        if lane == 0:
            acceleration[i, 0] += ax
            acceleration[i, 1] += ay
            acceleration[i, 2] += az
