"""NumPy oracle of sums over the liquid at points: all pairs, float64."""

import numpy as np

from refsim.core.operation import operation
from refsim.neighbours.reference import Sums, pair_blocks
from refsim.smoothing.reference import kernel_value


@operation(
    "SPH interpolation", paper="standard", outputs="fill flow", entrywise=True, optional="period", tolerance=8.0,
    reason="one rounding in each of distance, kernel, volume, two products and the sum",
)  # fmt: skip
def sample(position, velocity, mass, density, walls, smoothing, period=None):
    """Liquid at points, which come as `walls`: fill [-] and flow [m/s] = sum_j V_j (1, v_j) W(x - x_j).

    V_j = m_j/rho_j. position, velocity (n, 3) [m], [m/s]; mass [kg], density [kg/m^3] (n,), that at rest for volumes
    that do not grow at surfaces. Returns (value, scale).
    """
    v = np.asarray(velocity, dtype=float)
    volume = np.asarray(mass, dtype=float) / np.asarray(density, dtype=float)
    count = len(walls.position)
    fill, flow, terms = Sums(count), Sums(count, 3), np.zeros(count)
    for place, _, distance in pair_blocks(walls.position, position, None, period):
        weight = volume[None, :] * kernel_value(distance, smoothing)
        terms[place] += (weight > 0).sum(1)
        fill.add(place, weight)
        flow.add(place, weight[..., None] * v[None, :, :])
    return {"fill": (fill.value, (1 + terms) * fill.scale), "flow": (flow.value, (1 + terms)[:, None] * flow.scale)}
