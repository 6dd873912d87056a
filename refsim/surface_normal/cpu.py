"""CPU kernels of surface normals."""

from refsim.backends.compile import cpu_kernel, prange
from refsim.neighbours.rows import cpu_row
from refsim.sph.kernels import wall_sum
from refsim.surface_normal import particle


@cpu_kernel
def color_gradient(
    position, mass, density, candidates, neighbours, walls, gradient_smoothing, normal_term, surface_normal
):
    """J(19); zero where a particle is no candidate."""
    for i in prange(surface_normal.shape[0]):
        real = type(gradient_smoothing.support_radius)
        nx, ny, nz = real(0), real(0), real(0)
        if candidates is None or candidates[i] != 0:
            nx, ny, nz = particle.color_gradient(
                i, cpu_row(neighbours, i), position, mass, density, neighbours.entries, gradient_smoothing, normal_term
            )
            if walls is not None:
                bx, by, bz = particle.wall_color_gradient(i, cpu_row(walls, i), position, walls, gradient_smoothing)
                nx += bx
                ny += by
                nz += bz
        surface_normal[i, 0] = nx
        surface_normal[i, 1] = ny
        surface_normal[i, 2] = nz


@cpu_kernel
def corrected(
    position,
    mass,
    density,
    number_density,
    candidates,
    neighbours,
    walls,
    smoothing,
    gradient_smoothing,
    normal_term,
    corrected_normal,
):
    """J(20); zero where a particle is no candidate."""
    for i in prange(corrected_normal.shape[0]):
        real = type(smoothing.support_radius)
        nx, ny, nz, filled = real(0), real(0), real(0), real(1)
        if candidates is None or candidates[i] != 0:
            nx, ny, nz, filled = particle.corrected_sums(
                i,
                cpu_row(neighbours, i),
                position,
                mass,
                density,
                number_density,
                neighbours.entries,
                smoothing,
                gradient_smoothing,
                normal_term,
            )
            if walls is not None:
                filled += wall_sum(i, position, walls, smoothing)
        corrected_normal[i, 0] = nx / filled
        corrected_normal[i, 1] = ny / filled
        corrected_normal[i, 2] = nz / filled
