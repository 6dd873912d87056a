"""Scalar formulas of surface detection: Jiang & Zhu 2023, equation (13), and thin features."""

from refsim.backends.compile import formula
from refsim.backends.tuples import over


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


@formula
def is_thin(weight, first, second, thin_feature):
    """Least eigenvalue of the second moment about the mean, C = <u u^T> - <u><u>^T, at most the limit; dimensionless.

    weight, first (3), second (xx, xy, xz, yy, yz, zz): sums of w, w u and w u u^T over the neighbourhood, u = x_ij/h.
    C less the limit times 1 has a positive determinant in every leading block (Sylvester) if all eigenvalues are
    above the limit.
    """
    real = type(weight)
    mx, my, mz = over(first, weight)
    xx, xy, xz, yy, yz, zz = over(second, weight)
    a = xx - mx * mx - thin_feature.variance
    b = yy - my * my - thin_feature.variance
    d = xy - mx * my
    block = a * b - d * d
    if not (a > real(0) and block > real(0)):
        return True
    if thin_feature.dim == 2:
        return False
    c = zz - mz * mz - thin_feature.variance
    e, f = xz - mx * mz, yz - my * mz
    return not c * block - a * f * f - b * e * e + real(2) * d * e * f > real(0)
