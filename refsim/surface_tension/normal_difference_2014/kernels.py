"""What one neighbour and one particle do for the tension by normal differences, patent CN104318598A."""

from refsim.backends.compile import kernel
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.neighbours.rows import add_vector
from refsim.surface_tension.normal_difference_2014.formulas import normal_difference_pair


@pair
def difference_pair(mass_i, mass_j, surface_normal_i, surface_normal_j, smoothing, normal_tension):
    """Patent P7 [m/s^2]."""
    f = normal_difference_pair(mass_i, mass_j, normal_tension)
    x = f * (surface_normal_i[0] - surface_normal_j[0])
    y = f * (surface_normal_i[1] - surface_normal_j[1])
    z = f * (surface_normal_i[2] - surface_normal_j[2])
    return x, y, z


@kernel(lanes=True)
def tension(i, lane, position, mass, surface_normal, neighbours, smoothing, normal_tension, acceleration):
    """Patent P7; added to the acceleration [m/s^2]."""
    ax, ay, az = neighbour_sum(
        difference_pair, i, lane, neighbours, position, None, mass, surface_normal, smoothing, normal_tension
    )
    add_vector(acceleration, i, lane, ax, ay, az)
