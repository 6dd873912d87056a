"""What one neighbour and one particle do for the surface normal."""

from refsim.backends.compile import kernel
from refsim.backends.tuples import added
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.neighbours.rows import set_vector
from refsim.smoothing.formulas import gradient_factor, kernel_slope, kernel_value, safe_distance
from refsim.sph.kernels import own_share, wall_gradient, wall_sum
from refsim.surface_normal.formulas import neighbour_volume


@pair
def normal_pair(r, x_ij, mass_j, density_i, density_j, gradient_smoothing, normal_term):
    """J(19), h V_j grad W_ij; dimensionless."""
    volume = neighbour_volume(mass_j, density_i, density_j, normal_term.own_density)
    f = gradient_smoothing.support_radius * volume * gradient_factor(r, gradient_smoothing)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


@kernel(lanes=True)
def color_gradient(
    i, lane, position, mass, density, candidates, neighbours, walls, gradient_smoothing, normal_term, surface_normal
):  # fmt: skip
    """J(19) n_i = h sum_j V_j grad W_ij, walls included; dimensionless. Zero for a particle that is no candidate."""
    h = gradient_smoothing.support_radius
    real = type(h)
    n = real(0), real(0), real(0)
    if candidates is None or candidates[i] != 0:
        n = neighbour_sum(
            normal_pair, i, lane, neighbours, position, None, mass, density, gradient_smoothing, normal_term
        )
        if walls is not None:
            n = added(n, wall_gradient(i, lane, position, walls, gradient_smoothing, h, None))
    set_vector(surface_normal, i, lane, n)


@pair
def corrected_normal_pair(
    r, x_ij, mass_j, density_i, density_j, number_density_i, number_density_j, gradient_smoothing, smoothing,
    normal_term,
):  # fmt: skip
    """J(20) before division, (delta_j - delta_i)/delta0 V_j grad W_ij [1/m], and V_j W_ij."""
    volume = neighbour_volume(mass_j, density_i, density_j, normal_term.own_density)
    f = (number_density_j - number_density_i) / normal_term.rest_number_density * volume
    f = f * kernel_slope(r, gradient_smoothing) / safe_distance(r, gradient_smoothing)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2], mass_j / density_j * kernel_value(r, smoothing)


@kernel(lanes=True)
def corrected(
    i, lane, position, mass, density, number_density, candidates, neighbours, walls, smoothing, gradient_smoothing,
    normal_term, corrected_normal,
):  # fmt: skip
    """J(20) over sum_k V_k W_ik of particles, the own one and walls [1/m]; zero for one that is no candidate."""
    real = type(smoothing.support_radius)
    nx, ny, nz, filled = real(0), real(0), real(0), real(1)
    if candidates is None or candidates[i] != 0:
        nx, ny, nz, filled = neighbour_sum(
            corrected_normal_pair, i, lane, neighbours, position, None, mass, density, number_density,
            gradient_smoothing, smoothing, normal_term,
        )  # fmt: skip
        filled += mass[i] / density[i] * own_share(smoothing)
        if walls is not None:
            filled += wall_sum(i, lane, position, walls, smoothing, None)
    set_vector(corrected_normal, i, lane, (nx / filled, ny / filled, nz / filled))
