"""Scalar formula of particle shifting after Sun et al. 2017."""

from refsim.backends.compile import formula

SMALLEST_NORMAL = 0.05  # shorter colour gradients J(19) have no direction


@formula
def shifting_pair(volume_j, kernel, slope, shifting):
    """Sun et al. 2017 (7) for one neighbour: factor of x_ij in the gradient [1/m^2]; `slope` = W'(r)/r.

    V_j (1 + 0.2 (W_ij/W(d))^4) W'(r)/r.
    """
    real = type(slope)
    ratio = kernel * shifting.inverse_neighbour
    return volume_j * (real(1) + real(0.2) * ratio**4) * slope
