"""Viscous forces of other SPH codes, for the contract; no effect has them."""

from typing import NamedTuple

from refsim.sph.viscosities import operations as operations


class ArtificialViscosity(NamedTuple):
    """Monaghan's artificial viscosity as kernels take it."""

    alpha: float  # [-]
    beta: float  # [-]
    sound_speed: float  # c [m/s]
    smoothing_length: float  # h_s [m]: half of the support radius for most kernels, a third for some


class LaminarViscosity(NamedTuple):
    """Viscosity of Morris, Fox & Zhu as kernels take it."""

    dynamic_viscosity: float  # mu [Pa s]
    smoothing_length: float  # h_s [m]: half of the support radius for most kernels, a third for some
