"""What one neighbour and one particle do in He et al. 2014."""

from refsim.backends.compile import kernel
from refsim.backends.tuples import dot, over
from refsim.neighbours.forces import force
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.neighbours.rows import first_lane
from refsim.smoothing.formulas import kernel_slope, kernel_value, safe_distance
from refsim.sph.kernels import own_share, wall_sum, with_momentum


@pair
def color_pair(r, mass_j, density_j, smoothing):
    """V_j W_ij, dimensionless."""
    return mass_j / density_j * kernel_value(r, smoothing)


@kernel(lanes=True)
def color(i, lane, position, mass, density, neighbours, walls, smoothing, color):
    """c_i = sum_j V_j W_ij + sum_b V_b W_ib, self included; dimensionless."""
    total = neighbour_sum(color_pair, i, lane, neighbours, position, None, mass, density, smoothing)
    total += mass[i] / density[i] * own_share(smoothing)
    if walls is not None:
        total += wall_sum(i, lane, position, walls, smoothing, None)
    if first_lane(lane):
        color[i] = total


@pair
def gradient_pair(r, x_ij, mass_j, density_j, color_j, gradient_smoothing):
    """c_i grad c_i = sum_j V_j c_j W'(r) e_ij for one neighbour [1/m]."""
    slope = kernel_slope(r, gradient_smoothing)
    f = mass_j / density_j * color_j * slope / safe_distance(r, gradient_smoothing)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


@kernel(lanes=True)
def squared_gradient(i, lane, position, mass, density, color, neighbours, gradient_smoothing, color_gradient_squared):
    """|grad c_i|^2 with grad c_i = (1/c_i) sum_j V_j c_j grad W_ij [1/m^2]."""
    g = neighbour_sum(gradient_pair, i, lane, neighbours, position, None, mass, density, color, gradient_smoothing)
    g = over(g, color[i])
    if first_lane(lane):
        color_gradient_squared[i] = dot(g, g)


@pair
def tension_pair(
    r, x_ij, mass_j, density_j, color_gradient_squared_i, color_gradient_squared_j, gradient_smoothing,
    gradient_energy, air_pressure,
):  # fmt: skip
    """rho_i a_i = sum_j V_j ((kappa/4) (|grad c_i|^2 + |grad c_j|^2) + p_atm) W'(r) e_ij for one neighbour [N/m^3].

    Gradient energy and air pressure, each unless None.
    """
    slope = kernel_slope(r, gradient_smoothing)
    volume = mass_j / density_j
    f = type(r)(0)
    if gradient_energy is not None:
        f += gradient_energy.quarter * volume * (color_gradient_squared_i + color_gradient_squared_j) * slope
    if air_pressure is not None:
        f += air_pressure.pressure * volume * slope
    f /= safe_distance(r, gradient_smoothing)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


tension = force(tension_pair, divided="density")


tension_and_momentum_pair, tension_and_momentum, tension_and_central_momentum_pair, tension_and_central_momentum = (
    with_momentum(tension_pair, per_volume=True)
)
