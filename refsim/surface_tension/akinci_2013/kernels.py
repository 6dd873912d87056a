"""What one neighbour and one particle do in Akinci et al. 2013."""

from refsim.backends.tuples import added, difference, scaled
from refsim.neighbours.forces import force
from refsim.neighbours.pairs import pair
from refsim.smoothing.formulas import safe_distance
from refsim.sph.kernels import with_momentum
from refsim.surface_normal.formulas import axial_part
from refsim.surface_tension.akinci_2013 import formulas


@pair
def tension_pair(
    r, x_ij, mass_j, density_i, density_j, area_normal_i, area_normal_j, smoothing, fluid, spline, area_term, axial
):
    """K_ij (-gamma m_j C(r) e_ij - eps (n_i - n_j)), each term unless None, K_ij = 2 rho0/(rho_i + rho_j) [m/s^2]."""
    real = type(r)
    a = real(0), real(0), real(0)
    share = (fluid.rest_density + fluid.rest_density) / (density_i + density_j)
    if spline is not None:
        cohesion = -mass_j * (spline.amplitude * formulas.force_shape(r * smoothing.inverse_radius))
        f = share * cohesion / safe_distance(r, smoothing)
        a = added(a, scaled(x_ij, f))
    if area_term is not None:
        g = share * area_term.coefficient
        n_ij = difference(area_normal_i, area_normal_j)
        if axial is not None:
            n_ij = axial_part(n_ij, x_ij, r, smoothing, axial)
        a = difference(a, scaled(n_ij, g))
    return a[0], a[1], a[2]


tension = force(tension_pair)


tension_and_momentum_pair, tension_and_momentum, tension_and_central_momentum_pair, tension_and_central_momentum = (
    with_momentum(tension_pair, {"smoothing": "gradient_smoothing"})
)


@pair
def adhesion_pair(r, x_ij, volume_j, smoothing, fluid, adhesion):
    """Adhesion to a wall particle [m/s^2]."""
    wall_mass = fluid.rest_density * volume_j
    f = formulas.adhesion_pair(wall_mass, r * smoothing.inverse_radius, adhesion) / safe_distance(r, smoothing)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


adhesion = force(adhesion_pair, around="walls")
