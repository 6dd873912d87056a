"""What one neighbour and one particle do in Dong, Zhang & Chen 2016."""

from refsim.backends.compile import kernel
from refsim.backends.tuples import added, difference, scaled
from refsim.neighbours.forces import force
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.neighbours.rows import first_lane
from refsim.smoothing.formulas import kernel_slope, kernel_value, safe_distance
from refsim.sph.kernels import own_share, wall_pressure, wall_sum, with_momentum
from refsim.surface_tension.dong_2016 import formulas


@pair
def number_pair(r, smoothing):
    """W_ij [1/m^dim]."""
    return kernel_value(r, smoothing)


@kernel(lanes=True)
def density(i, lane, position, mass, neighbours, walls, smoothing, fluid, number_density, density):
    """D(3) rho_i = m_i sum_j W_ij, self included [kg/m^dim]; number density sum_j W_ij where requested [1/m^dim]."""
    number = neighbour_sum(number_pair, i, lane, neighbours, position, None, smoothing) + own_share(smoothing)
    if walls is not None:
        number += fluid.rest_density * wall_sum(i, lane, position, walls, smoothing, None) / mass[i]
    if first_lane(lane):
        density[i] = mass[i] * number
        if number_density is not None:
            number_density[i] = number


@pair
def momentum_pair(
    r, x_ij, velocity_i, velocity_j, mass_i, mass_j, density_i, density_j, pressure_i, pressure_j, smoothing, viscosity
):
    """D(4) -(V_i^2 p_i + V_j^2 p_j) W'(r) e_ij and, unless `viscosity` is None, D(5): force on the particle [N].

    D(5) is mu (V_i^2 + V_j^2) W'(r)/r (v_i - v_j): for one liquid 2 mu_i mu_j/(mu_i + mu_j) is mu.
    """
    volume_i, volume_j = mass_i / density_i, mass_j / density_j
    squared_i, squared_j = volume_i * volume_i, volume_j * volume_j
    apart = safe_distance(r, smoothing)
    slope = kernel_slope(r, smoothing)
    a = scaled(x_ij, -(squared_i * pressure_i + squared_j * pressure_j) * slope / apart)
    if viscosity is not None:
        g = viscosity.coefficient * (squared_i + squared_j) * slope / apart
        a = added(a, scaled(difference(velocity_i, velocity_j), g))
    return a[0], a[1], a[2]


momentum = force(momentum_pair, divided="mass", walled=wall_pressure)


@pair
def tension_pair(
    r, x_ij, mass_j, density_i, density_j, surface_normal_i, surface_normal_j, smoothing, molecular_force,
    normal_correction,
):  # fmt: skip
    """D(6) with D(7), and D(9) with D(11), each unless None [m/s^2]."""
    real = type(r)
    a = real(0), real(0), real(0)
    if molecular_force is not None:
        shape = formulas.force_shape(r * smoothing.inverse_radius, molecular_force)
        cohesion = mass_j * (molecular_force.stiffness * shape)
        a = added(a, scaled(x_ij, cohesion / safe_distance(r, smoothing)))
    if normal_correction is not None:
        g = formulas.correction_pair(mass_j, density_i, density_j, kernel_value(r, smoothing), normal_correction)
        a = added(a, scaled(difference(surface_normal_i, surface_normal_j), g))
    return a[0], a[1], a[2]


tension = force(tension_pair)


tension_and_momentum_pair, tension_and_momentum, tension_and_central_momentum_pair, tension_and_central_momentum = (
    with_momentum(tension_pair)
)
