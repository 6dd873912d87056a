"""Equations of melting: Shao & Song 2017, section 2 and figure 3."""

import numpy as np

FLUID, SURFACE = 0, 1
EMPTY = -1


def melts(phase, temperature, melting_point):
    """Section 2: a particle at a body's surface melts where T_i >= Tm_i [degrees C]; a flag."""
    return (phase == SURFACE) & (temperature >= melting_point)


def has_taken_up(enthalpy, latent_heat):
    """M12: with latent heat where H_i >= Lh_i [J/kg], too; a flag."""
    return enthalpy >= latent_heat


def detached(direct, melted):
    """M16: direct = -1 in every slot of a melted node and in every slot that holds one; dimensionless."""
    left = np.where(melted[direct] & (direct != EMPTY), EMPTY, direct)
    return np.where(melted[:, None], EMPTY, left)


def rebuilt(region, melted):
    """M17: rebuild = 1 where any node of the old region has melted; a flag."""
    return (melted[region] & (region != EMPTY)).any(1)
