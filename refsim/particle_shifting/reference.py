"""NumPy oracle of particle shifting after Sun et al. 2017: all pairs, float64."""

import numpy as np

from refsim.core.operation import operation, without
from refsim.neighbours.reference import Sums, pair_blocks
from refsim.smoothing.reference import kernel_slope, kernel_value

_NEAR = "near_surface surface_normal"


@operation(
    "(7), tangential at the surface", paper="Sun et al. 2017", outputs="shift",
    optional=f"{_NEAR} walls period", tolerance=24.0,
    reason="one rounding in each of distance, kernel and slope, four in the power, and those of the projection",
    variants=tuple(
        without(names, extremes="moving")
        for names in (f"{_NEAR} walls period", "walls period", "period", f"{_NEAR} walls")
    ),
    invariants="translation reordering", packed="crowding_pair",
)  # fmt: skip
def shift(
    position, mass, density, near_surface, surface_normal, walls, smoothing, shifting, period, extremes, timestep,
    rows=None,
):  # fmt: skip
    """Displacement [m] of a step beside dt v, no longer than `largest` v_max dt.

    s_i = -A v_max dt 2 h_s sum_j V_j (1 + 0.2 (W_ij/W(d))^4) grad W_ij, over liquid and walls; near the surface less
    its part along the normal, and zero where that is shorter than 0.05. `extremes` has v_max^2 first,
    `timestep` dt second.
    """
    volume = np.asarray(mass, dtype=float) / np.asarray(density, dtype=float)
    count = len(volume) if rows is None else len(rows)
    sums = Sums(count, 3)

    def add(places, volumes):
        for place, separation, distance in pair_blocks(position, places, rows, period):
            apart = np.where(distance > 0, distance, 1.0)
            ratio = kernel_value(distance, smoothing) * float(shifting.inverse_neighbour)
            factor = volumes[None, :] * (1 + 0.2 * ratio**4) * kernel_slope(distance, smoothing) / apart
            sums.add(place, factor[..., None] * separation)

    add(position, volume)
    if walls is not None:
        add(walls.position, np.asarray(walls.volume, dtype=float))
    longest = np.sqrt(float(extremes[0])) * float(timestep[1])
    value, scale = -float(shifting.length) * longest * sums.value, float(shifting.length) * longest * sums.scale
    if near_surface is not None:
        pick = slice(None) if rows is None else np.asarray(rows)
        near, normal = np.asarray(near_surface)[pick] != 0, np.asarray(surface_normal, dtype=float)[pick]
        length = np.linalg.norm(normal, axis=1)
        unit = normal / np.where(length > 0, length, 1.0)[:, None]
        tangential = value - (value * unit).sum(1)[:, None] * unit
        tangential[length < 0.05] = 0.0
        value = np.where(near[:, None], tangential, value)
        scale = np.where(near[:, None], scale + scale.sum(1)[:, None], scale)
    size = np.linalg.norm(value, axis=1)
    most = float(shifting.largest) * longest
    factor = np.where(size > most, most / np.where(size > 0, size, 1.0), 1.0)
    return {"shift": (value * factor[:, None], np.minimum(scale, np.maximum(scale * factor[:, None], most)))}
