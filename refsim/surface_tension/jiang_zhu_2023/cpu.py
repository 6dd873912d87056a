"""CPU kernels of Jiang & Zhu 2023."""

from refsim.backends.compile import cpu_kernel, prange
from refsim.neighbours.rows import cpu_row
from refsim.sph.kernels import wall_sum
from refsim.surface_tension.jiang_zhu_2023 import formulas, particle


@cpu_kernel
def corrected_density(position, mass, density, near_surface, neighbours, walls, smoothing, fluid, corrected_density):
    """J(14), J(15) on the near-surface particles (on all without that set); the others keep their density."""
    for i in prange(corrected_density.shape[0]):
        rho = density[i]
        if near_surface is None or near_surface[i] != 0:
            mass_sum, volume_sum = particle.density_sums(
                i, cpu_row(neighbours, i), position, mass, density, neighbours.entries, smoothing
            )
            if walls is not None:
                filled = fluid.rest_density * wall_sum(i, position, walls, smoothing)
                mass_sum += filled
                volume_sum += filled / rho
            rho = formulas.normalised_density(mass_sum, volume_sum)
        corrected_density[i] = rho


@cpu_kernel
def replace_density(corrected_density, density):
    """rho <- rho*, so that everything that follows reads the corrected density."""
    for i in prange(density.shape[0]):
        density[i] = corrected_density[i]


@cpu_kernel
def soft_weight(surface_normal, soft, surface_weight):
    """Soft surface weight (E9), from J(19)."""
    for i in prange(surface_weight.shape[0]):
        surface_weight[i] = particle.soft_weight(i, surface_normal, soft)


@cpu_kernel
def tension(
    position, mass, density, surface_weight, surface, area_normal, neighbours, smoothing, pairs, cohesion, area,
    acceleration,
):  # fmt: skip
    """J(16), J(17) and J(21) or J(18); added to the acceleration."""
    for i in prange(acceleration.shape[0]):
        ax, ay, az = particle.tension(
            i, cpu_row(neighbours, i), position, mass, density, surface_weight, surface, area_normal,
            neighbours.entries, smoothing, pairs, cohesion, area,
        )  # fmt: skip
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az
