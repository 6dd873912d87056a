"""What a point takes from the liquid around it."""

from refsim.backends.compile import kernel
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.smoothing.formulas import kernel_value


@pair
def sample_pair(r, velocity_j, mass_j, density_j, smoothing):
    """V_j W, dimensionless, and V_j W v_j [m/s]."""
    share = mass_j / density_j * kernel_value(r, smoothing)
    return share, share * velocity_j[0], share * velocity_j[1], share * velocity_j[2]


@kernel
def sample(i, velocity, mass, density, liquid_near_walls, walls, smoothing, period, fill, flow):
    """Liquid at point i: fill [-] and flow [m/s]."""
    share, x, y, z = neighbour_sum(
        sample_pair, i, None, liquid_near_walls, walls.position, period, velocity, mass, density, smoothing
    )
    fill[i] = share
    flow[i, 0] = x
    flow[i, 1] = y
    flow[i, 2] = z
