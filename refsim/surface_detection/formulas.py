"""Scalar formulas of surface detection: Jiang & Zhu 2023, equation (13)."""

from refsim.backends.compile import formula


@formula
def in_scan_region(squared, along, fan_scan):
    """J(13) for one particle: |x_ij|^2 [m^2] and n_hat . x_ij [m], n inward: distance along the outward axis.

    For |x_ij| >= sqrt2 s a ball of radius s around x_i - s n_hat; nearer, a cone of total opening pi/2. Both lines are
    squared to avoid the root. Jiang & Zhu E5: the printed "<" of the second line describes the outside of the cone.
    """
    real = type(squared)
    s = fan_scan.radius
    if squared >= real(2) * s * s:
        return squared < real(2) * s * along
    if fan_scan.printed:
        return along < real(0) or real(2) * along * along < squared
    return along > real(0) and real(2) * along * along > squared
