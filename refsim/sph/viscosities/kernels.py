"""What one neighbour and one particle do in the viscous forces."""

from refsim.backends.compile import kernel
from refsim.backends.tuples import over
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.neighbours.rows import add_vector
from refsim.smoothing.formulas import gradient_factor
from refsim.sph.viscosities import formulas


@pair
def artificial_pair(r, x_ij, velocity_i, velocity_j, mass_j, density_i, density_j, smoothing, artificial_viscosity):
    """-m_j Pi_ij grad W_ij [m/s^2], Monaghan 1992."""
    approach = (velocity_i[0] - velocity_j[0]) * x_ij[0]
    approach += (velocity_i[1] - velocity_j[1]) * x_ij[1]
    approach += (velocity_i[2] - velocity_j[2]) * x_ij[2]
    density = type(r)(0.5) * (density_i + density_j)
    slope = gradient_factor(r, smoothing)
    f = formulas.artificial_pair(r, approach, mass_j, density, slope, artificial_viscosity)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


@kernel(lanes=True)
def artificial(
    i, lane, position, velocity, mass, density, neighbours, smoothing, artificial_viscosity, period, acceleration
):  # fmt: skip
    """Artificial viscosity; added to the acceleration [m/s^2]."""
    a = neighbour_sum(
        artificial_pair, i, lane, neighbours, position, period, velocity, mass, density, smoothing,
        artificial_viscosity,
    )  # fmt: skip
    add_vector(acceleration, i, lane, a)


@pair
def laminar_pair(r, velocity_i, velocity_j, mass_j, density_j, smoothing, laminar_viscosity):
    """Viscous force density [N/m^3], Morris, Fox & Zhu 1997."""
    f = formulas.laminar_pair(r, mass_j / density_j, gradient_factor(r, smoothing), laminar_viscosity)
    return f * (velocity_i[0] - velocity_j[0]), f * (velocity_i[1] - velocity_j[1]), f * (velocity_i[2] - velocity_j[2])


@kernel(lanes=True)
def laminar(i, lane, position, velocity, mass, density, neighbours, smoothing, laminar_viscosity, period, acceleration):
    """Laminar viscosity; added to the acceleration [m/s^2]."""
    force = neighbour_sum(
        laminar_pair, i, lane, neighbours, position, period, velocity, mass, density, smoothing, laminar_viscosity
    )
    add_vector(acceleration, i, lane, over(force, density[i]))
