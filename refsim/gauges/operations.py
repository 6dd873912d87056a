"""The operation of gauges: sums over the liquid at points."""

import numpy as np

from refsim.core.operation import operation
from refsim.core.terms import Terms
from refsim.gauges import reference as ref
from refsim.neighbours.sums import Fields, neighbours


@operation(
    "SPH interpolation", paper="standard", outputs="fill flow", entrywise=True, optional="period", tolerance=8.0,
    reason="one rounding in each of distance, kernel, volume, two products and the sum",
)  # fmt: skip
def sample(position, velocity, mass, density, walls, smoothing, period=None):
    """Fill [-] and flow [m/s] of the liquid at points, which come as `walls`.

    `density` [kg/m^dim] is that at rest for volumes that do not grow at surfaces.
    """
    j = Fields(position=position, velocity=velocity, mass=mass, density=density)
    around = neighbours(Fields(position=walls.position), j, smoothing, period=period)
    return {"fill": in_each(around(ref.fill), around, ref.fill), "flow": in_each(around(ref.flow), around, ref.fill)}


def in_each(total, around, weight):
    """Sums with a size for a bound of each entry [its unit]: times one more than the pairs that have a weight."""
    count = 1 + around(lambda i, j, ij: Terms(weight(i, j, ij).value > 0)).value
    return Terms(total.value, total.size * np.expand_dims(count, tuple(range(-total.rank, 0))), total.rank)
