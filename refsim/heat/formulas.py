"""Scalar formulas of heat conduction: Shao & Song 2017, equation (4), as M(4), and what completes it."""

from refsim.backends.compile import formula
from refsim.heat.shapes import MUELLER, SPIKY


@formula
def laplacian_shape(q, conduction):
    """L_ij = scale * l(q) of M(4), q = r/h < 1: (1 - q)^2/max(q, 1/10) spiky, 1 - q Mueller; dimensionless.

    Below a tenth of h the quotient stays constant, so that one close pair does not make the whole system stiff.
    The true Laplacian of poly6, 4 q^2 (1 - q^2) - dim (1 - q^2)^2, is negative for small q (Shao & Song M5 as printed).
    """
    real = type(q)
    a = real(1) - q
    if conduction.laplacian == SPIKY:
        return a * a / max(q, real(0.1))
    if conduction.laplacian == MUELLER:
        return a
    a = real(1) - q * q
    return real(4) * q * q * a - real(conduction.dim) * a * a


@formula
def mean_conductivity(conductivity_i, conductivity_j, conduction):
    """2 k_ij = k_i + k_j as in M(4), or 4 k_i k_j/(k_i + k_j), twice the harmonic mean [W/(m K)]."""
    real = type(conductivity_i)
    both = conductivity_i + conductivity_j
    if conduction.harmonic and both > real(0):
        return real(4) * (conductivity_i / both) * conductivity_j
    return both


@formula
def pair_weight(q, volume_i, volume_j, conductivity_i, conductivity_j, seconds, conduction):
    """g = dt G_ij = dt V_i V_j 2 k_ij L_ij [J/K], the heat that a pair exchanges for each kelvin of difference.

    Volumes are taken in units of the spacing's, so that no power of a length exceeds the range of float32.
    """
    volumes = (volume_i * conduction.inverse_volume) * (volume_j * conduction.inverse_volume)
    mean = mean_conductivity(conductivity_i, conductivity_j, conduction)
    return volumes * mean * laplacian_shape(q, conduction) * (conduction.scale * seconds)


@formula
def pair_share(weight, inverse_i, inverse_j):
    """M(4): g/(1 + g (1/C_i + 1/C_j)) [J/K], the backward Euler exchange of a pair that is alone."""
    return weight / (type(weight)(1) + weight * (inverse_i + inverse_j))


@formula
def single_pass_share(weight, sum_i, sum_j):
    """NPX: g/(1 + s_i + s_j) [J/K]; of a pair that is alone it is M(4)."""
    return weight / (type(weight)(1) + sum_i + sum_j)


@formula
def temperature_of(enthalpy, heat_capacity, melting_point, latent_heat):
    """T = Tm + H/c for H < 0, Tm up to the latent heat L, Tm + (H - L)/c above [degrees C]; H = 0 is solid at Tm."""
    beyond = enthalpy
    if enthalpy >= type(enthalpy)(0):
        beyond = enthalpy - latent_heat
        if enthalpy <= latent_heat:  # false for NaN, which minima and maxima would hide on a GPU
            beyond = type(enthalpy)(0)
    return melting_point + beyond / heat_capacity


@formula
def melted(load, exchange_sum, latent_heat):
    """H [J/kg] from its own equation H + s c (T(H) - Tm) = y [J/kg]: y/(1 + s), y, or (y + s L)/(1 + s)."""
    real = type(load)
    if load < real(0):
        return load / (real(1) + exchange_sum)
    if load <= latent_heat:
        return load
    return (load + exchange_sum * latent_heat) / (real(1) + exchange_sum)
