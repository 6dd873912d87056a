"""The density on CUDA, over packed places and masses."""

from refsim.sph import kernels
from refsim.sph.packed_cuda import places_with_masses


def density(position, mass, neighbours, walls, smoothing, fluid, scratch, number_density, asymmetry, density):
    """J(7) [kg/m^dim]; J(8) where `number_density` is requested, |sum W_ij x_ij| where `asymmetry` is."""
    placed = places_with_masses(position, mass, scratch)
    kernels.density(placed, None, neighbours, walls, smoothing, fluid, number_density, asymmetry, density)
