"""NumPy oracle of particle shifting after Sun et al. 2017: all pairs, float64."""

import numpy as np

from refsim.core.operation import Program, operations, without
from refsim.neighbours.reference import Sums, pair_blocks, rows_of
from refsim.smoothing.reference import kernel_slope, kernel_value

operation = operations(paper="Sun et al. 2017")
_NEAR = "near_surface surface_normal"


@operation(
    "(7), gradient of the concentration", outputs="concentration_gradient", optional="walls period", tolerance=16.0,
    reason="one rounding in each of distance, kernel and slope, and four in the power",
    variants=("walls period", "period", ""), invariants="translation reordering",
    programs={
        "cuda:fused": Program(
            "kernels", "crowding_and_momentum", packed="fused_pair", also=("sph.central_momentum",),
            names={"smoothing": "gradient_smoothing"}, variants=("walls period", "walls", "period"),
        )
    },
    packed="crowding_pair",
)  # fmt: skip
def crowding(position, mass, density, walls, smoothing, shifting, period, rows=None):
    """Gradient [1/m] g_i = sum_j V_j (1 + 0.2 (W_ij/W(d))^4) grad W_ij, over liquid and walls."""
    volume = np.asarray(mass, dtype=float) / np.asarray(density, dtype=float)
    sums = Sums(len(volume) if rows is None else len(rows), 3)

    def add(places, volumes):
        for place, separation, distance in pair_blocks(position, places, rows, period):
            apart = np.where(distance > 0, distance, 1.0)
            ratio = kernel_value(distance, smoothing) * float(shifting.inverse_neighbour)
            factor = volumes[None, :] * (1 + 0.2 * ratio**4) * kernel_slope(distance, smoothing) / apart
            sums.add(place, factor[..., None] * separation)

    add(position, volume)
    if walls is not None:
        add(walls.position, np.asarray(walls.volume, dtype=float))
    return {"concentration_gradient": sums.total()}


@operation(
    "(7), tangential at the surface", outputs="shift", optional=_NEAR, tolerance=12.0,
    reason="one rounding in each of a root, a length, products and sums of the projection, and the bound",
    variants=tuple(without(names, extremes="moving") for names in (_NEAR, "")), invariants="reordering",
)  # fmt: skip
def shift(concentration_gradient, near_surface, surface_normal, shifting, extremes, timestep, rows=None):
    """Displacement [m] of a step beside dt v, no longer than `largest` v_max dt.

    s_i = -A v_max dt 2 h_s g_i of the gradient g_i (n, 3) [1/m] of the concentration; near the surface less its part
    along the normal, and zero where that is shorter than 0.05. `extremes` has v_max^2 first, `timestep` dt second.
    """
    gradient = rows_of(concentration_gradient, rows)
    longest = np.sqrt(float(extremes[0])) * float(timestep[1])
    value = -float(shifting.length) * longest * gradient
    scale = np.abs(value)
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
