"""Scalar formulas of the penetration correction: patent CN104318598A, equation P8."""

from refsim.backends.compile import formula

MIXED = 0x7FFFFFFF


@formula
def rebound(identity, count, penetration):
    """P8: D_r = rebound hash(identity, corrections so far), a share of the depth (E28), dimensionless."""
    real = type(penetration.rebound)
    a = (int(identity) * 1_000_003 + int(count) * 7_919 + 12_345) & MIXED
    a = ((a ^ (a >> 15)) * 73_856_093) & MIXED
    a = ((a ^ (a >> 13)) * 19_349_663) & MIXED
    a = (a ^ (a >> 16)) & 0xFFFF
    return penetration.rebound * real(a) / real(0x10000)


@formula
def reflected(along, penetration):
    """P8: dv = -(1 + c_r) v.n, the factor of the normal in the change of velocity [m/s]; only where v.n < 0 (E27)."""
    real = type(penetration.restitution)
    if along < real(0) or penetration.printed:
        return -(real(1) + penetration.restitution) * along
    return real(0)


@formula
def pushed(depth, steep, share):
    """P8: dx = (1 + D_r) |s|/|grad phi|, the way along the normal [m].

    Over edges the interpolated distance is less steep than 1, and |s| alone ends inside; no more than 2 |s| is taken.
    """
    real = type(depth)
    return (real(1) + share) * abs(depth) / min(max(steep, real(0.5)), real(1))
