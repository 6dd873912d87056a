"""CUDA kernels of the continuum surface force."""

from refsim.backends.compile import cuda, cuda_kernel
from refsim.neighbours.rows import cuda_row
from refsim.sph.kernels import wall_sum
from refsim.surface_tension.csf_wang_2019 import particle


@cuda_kernel
def normal(position, mass, density, neighbours, walls, smoothing, gradient_smoothing, interface_normal):
    """n_i by the corrected kernel, inward."""
    i = cuda.grid(1)
    if i < interface_normal.shape[0]:
        nx, ny, nz, filled = particle.normal_sums(
            i, cuda_row(neighbours, i), position, mass, density, neighbours.entries, smoothing, gradient_smoothing
        )
        if walls is not None:
            bx, by, bz = particle.wall_normal(i, cuda_row(walls, i), position, walls, gradient_smoothing)
            nx += bx
            ny += by
            nz += bz
            filled += wall_sum(i, position, walls, smoothing)
        interface_normal[i, 0] = nx / filled
        interface_normal[i, 1] = ny / filled
        interface_normal[i, 2] = nz / filled


@cuda_kernel
def curvature(position, mass, density, interface_normal, neighbours, gradient_smoothing, continuum, curvature):
    """kappa_i over the active neighbours."""
    i = cuda.grid(1)
    if i < curvature.shape[0]:
        curvature[i] = particle.curvature(
            i, cuda_row(neighbours, i), position, mass, density, interface_normal, neighbours.entries,
            gradient_smoothing, continuum,
        )  # fmt: skip


@cuda_kernel
def force(
    position, mass, density, interface_normal, curvature, neighbours, gradient_smoothing, continuum, marangoni,
    acceleration,
):  # fmt: skip
    """Normal and tangential force; added to the acceleration."""
    i = cuda.grid(1)
    if i < acceleration.shape[0]:
        ax, ay, az = particle.force(
            i, cuda_row(neighbours, i), position, mass, density, interface_normal, curvature, neighbours.entries,
            gradient_smoothing, continuum, marangoni,
        )  # fmt: skip
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az
