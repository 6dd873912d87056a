"""The gradient of the color field on CUDA, over packed places and masses."""

from refsim.sph.packed_cuda import places_with_masses
from refsim.surface_normal import kernels


def color_gradient(
    position, mass, density, candidates, neighbours, walls, gradient_smoothing, normal_term, scratch, surface_normal
):
    """J(19) n_i = h sum_j V_j grad W_ij, walls included; dimensionless. Zero for a particle that is no candidate."""
    placed = places_with_masses(position, mass, scratch)
    kernels.color_gradient(
        placed, None, density, candidates, neighbours, walls, gradient_smoothing, normal_term, surface_normal
    )
