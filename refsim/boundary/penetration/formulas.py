"""Scalar formulas of the penetration correction: patent CN104318598A, equation P8."""

from refsim.compile import formula

MIXED = 0x7FFFFFFF


@formula
def rebound(identity, count, penetration):
    """D_r of P8, a share of the depth in [0, rebound): a hash of the particle and of its corrections so far (E28)."""
    real = type(penetration.rebound)
    a = (int(identity) * 1_000_003 + int(count) * 7_919 + 12_345) & MIXED
    a = ((a ^ (a >> 15)) * 73_856_093) & MIXED
    a = ((a ^ (a >> 13)) * 19_349_663) & MIXED
    a = (a ^ (a >> 16)) & 0xFFFF
    return penetration.rebound * real(a) / real(0x10000)


@formula
def reflected(along, penetration):
    """P8, velocity: factor of the normal that is added, -(1 + c_r) v.n [m/s]; only against it (E27)."""
    real = type(penetration.restitution)
    if along < real(0) or penetration.printed:
        return -(real(1) + penetration.restitution) * along
    return real(0)


@formula
def pushed(depth, share):
    """P8, place: way along the normal [m], (1 + D_r) |s|."""
    return (type(depth)(1) + share) * abs(depth)
