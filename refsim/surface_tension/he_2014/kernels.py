"""What one neighbour and one particle do in He et al. 2014."""

from refsim.backends.compile import kernel
from refsim.backends.tuples import added, over
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.neighbours.rows import add_vector, first_lane
from refsim.smoothing.formulas import kernel_slope, kernel_value, safe_distance
from refsim.sph.kernels import momentum_pair, own_share, wall_pressure, wall_sum


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
    gx, gy, gz = neighbour_sum(
        gradient_pair, i, lane, neighbours, position, None, mass, density, color, gradient_smoothing
    )
    c = color[i]
    gx, gy, gz = gx / c, gy / c, gz / c
    if first_lane(lane):
        color_gradient_squared[i] = gx * gx + gy * gy + gz * gz


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


@kernel(lanes=True)
def tension(
    i, lane, position, mass, density, color_gradient_squared, neighbours, gradient_smoothing, gradient_energy,
    air_pressure, acceleration,
):  # fmt: skip
    """Gradient energy and air pressure, each unless None; added to the acceleration [m/s^2]."""
    force = neighbour_sum(
        tension_pair, i, lane, neighbours, position, None, mass, density, color_gradient_squared, gradient_smoothing,
        gradient_energy, air_pressure,
    )  # fmt: skip
    add_vector(acceleration, i, lane, over(force, density[i]))


@pair
def fused_pair(
    r, x_ij, velocity_i, velocity_j, mass_j, density_j, pressure_i, pressure_j, color_gradient_squared_i,
    color_gradient_squared_j, gradient_smoothing, fluid, viscosity, gradient_energy, air_pressure,
):  # fmt: skip
    """Gradient energy and air pressure, each unless None, with J(10) and J(11) [N/m^3]."""
    px, py, pz = momentum_pair(
        r, x_ij, velocity_i, velocity_j, mass_j, density_j, pressure_i, pressure_j, gradient_smoothing, fluid,
        viscosity,
    )  # fmt: skip
    tx, ty, tz = tension_pair(
        r, x_ij, mass_j, density_j, color_gradient_squared_i, color_gradient_squared_j, gradient_smoothing,
        gradient_energy, air_pressure,
    )  # fmt: skip
    return px + tx, py + ty, pz + tz


@kernel(lanes=True)
def tension_and_momentum(
    i, lane, position, velocity, mass, density, pressure, color_gradient_squared, neighbours, walls,
    gradient_smoothing, fluid, viscosity, gradient_energy, air_pressure, acceleration,
):  # fmt: skip
    """Gradient energy and air pressure, each unless None, with J(10) and J(11), walls after Akinci 2012.

    Added to the acceleration [m/s^2].
    """
    force = neighbour_sum(
        fused_pair, i, lane, neighbours, position, None, velocity, mass, density, pressure, color_gradient_squared,
        gradient_smoothing, fluid, viscosity, gradient_energy, air_pressure,
    )  # fmt: skip
    a = over(force, density[i])
    if walls is not None:
        a = added(a, wall_pressure(i, lane, position, density, pressure, walls, gradient_smoothing, fluid, None))
    add_vector(acceleration, i, lane, a)
