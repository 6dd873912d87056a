"""Scalar formulas of the penetration correction: patent CN104318598A, equation P8 (patent P8)."""

from refsim.backends.compile import formula

MIXED = 0x7FFFFFFF


@formula
def rebound(identity, count, penetration):
    """Patent P8 with E28: D_r = rebound hash(identity, corrections so far), a fraction of the depth, dimensionless."""
    real = type(penetration.rebound)
    a = (int(identity) * 1_000_003 + int(count) * 7_919 + 12_345) & MIXED
    a = ((a ^ (a >> 15)) * 73_856_093) & MIXED
    a = ((a ^ (a >> 13)) * 19_349_663) & MIXED
    a = (a ^ (a >> 16)) & 0xFFFF
    return penetration.rebound * real(a) / real(0x10000)


@formula
def reflected(along, penetration):
    """Patent P8 with E27: dv = -(1 + c_r) v.n if v.n < 0, else 0: change of velocity along the normal [m/s]."""
    real = type(penetration.restitution)
    if along < real(0) or penetration.printed:
        return -(real(1) + penetration.restitution) * along
    return real(0)


@formula
def pushed(depth, steep, share):
    """Patent P8: dx = (1 + D_r) |phi|/|grad phi|, displacement along the normal [m], at most 2 (1 + D_r) |phi|.

    Near edges the slope of the interpolated distance is below 1, so that a displacement of |phi| would end inside.
    """
    real = type(depth)
    return (real(1) + share) * abs(depth) / min(max(steep, real(0.5)), real(1))
