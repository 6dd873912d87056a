"""What one neighbour and one particle do in the viscous forces."""

from refsim.neighbours.forces import force
from refsim.neighbours.pairs import pair
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


artificial = force(artificial_pair, period=True)


@pair
def laminar_pair(r, velocity_i, velocity_j, mass_j, density_j, smoothing, laminar_viscosity):
    """Viscous force density [N/m^3], Morris, Fox & Zhu 1997."""
    f = formulas.laminar_pair(r, mass_j / density_j, gradient_factor(r, smoothing), laminar_viscosity)
    return f * (velocity_i[0] - velocity_j[0]), f * (velocity_i[1] - velocity_j[1]), f * (velocity_i[2] - velocity_j[2])


laminar = force(laminar_pair, divided="density", period=True)
