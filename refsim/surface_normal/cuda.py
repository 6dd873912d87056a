"""CUDA kernels of surface normals."""

from refsim.backends.compile import cuda, cuda_kernel
from refsim.neighbours.rows import cuda_lane, cuda_lane_row, cuda_row, cuda_share_row, lanes_sum
from refsim.sph.kernels import wall_sum
from refsim.surface_normal import particle


@cuda_kernel(lanes=True)
def color_gradient(
    position, mass, density, candidates, neighbours, walls, gradient_smoothing, normal_term, surface_normal
):
    """J(19); zero where a particle is no candidate."""
    i, lane = cuda_lane(cuda.grid(1), neighbours)
    if i < surface_normal.shape[0]:
        real = type(gradient_smoothing.support_radius)
        nx, ny, nz = real(0), real(0), real(0)
        if candidates is None or candidates[i] != 0:
            row = cuda_lane_row(neighbours, i, lane)
            nx, ny, nz = particle.color_gradient(
                i, row, position, mass, density, neighbours.entries, gradient_smoothing, normal_term
            )
            if walls is not None:
                row = cuda_share_row(walls, i, lane, len(neighbours.lanes))
                bx, by, bz = particle.wall_color_gradient(i, row, position, walls, gradient_smoothing)
                nx += bx
                ny += by
                nz += bz
            nx = lanes_sum(nx, lane, neighbours)
            ny = lanes_sum(ny, lane, neighbours)
            nz = lanes_sum(nz, lane, neighbours)
        if lane == 0:
            surface_normal[i, 0] = nx
            surface_normal[i, 1] = ny
            surface_normal[i, 2] = nz


@cuda_kernel
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
    i = cuda.grid(1)
    if i < corrected_normal.shape[0]:
        real = type(smoothing.support_radius)
        nx, ny, nz, filled = real(0), real(0), real(0), real(1)
        if candidates is None or candidates[i] != 0:
            nx, ny, nz, filled = particle.corrected_sums(
                i,
                cuda_row(neighbours, i),
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
