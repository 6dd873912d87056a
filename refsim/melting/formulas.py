"""Scalar formulas of melting: Shao & Song 2017, section 2."""

from refsim.backends.compile import formula


@formula
def melts(temperature, melting_point):
    """Shao & Song, section 2: T_i >= Tm_i, both in [deg C]; at the melting point a surface particle melts."""
    return temperature >= melting_point
