"""Scalar formula of particle shifting after Sun et al. 2017."""

from refsim.backends.compile import formula

THIN, FULL = 0.97, 1.0  # filling up to which nothing of its gradient is left, and from which on all is


@formula
def near_share(filling, empty, full):
    """f = (full - s)/(full - empty) in 0 to 1 [-] of the filling s: how near a surface is; a lattice's outermost layer
    has s = 0.69 to 0.88, the next one 0.96 and more."""
    real = type(filling)
    share = (real(full) - filling) / (real(full) - real(empty))
    if share < real(0):
        return real(0)
    return real(1) if share > real(1) else share  # NaN stays: a GPU's min and max drop it


@formula
def shifting_pair(volume_j, kernel, slope, shifting):
    """Sun et al. 2017 (7) for one neighbour: factor of x_ij in the gradient [1/m^2]; `slope` = W'(r)/r.

    V_j (1 + 0.2 (W_ij/W(d))^4) W'(r)/r.
    """
    real = type(slope)
    ratio = kernel * shifting.inverse_neighbour
    return volume_j * slope * (real(1) + real(0.2) * ratio**4)
