"""NumPy oracle of walls after Adami, Hu & Adams 2012: all pairs, float64."""

import numpy as np

from refsim.core.operation import SYMMETRY, operations
from refsim.neighbours.reference import Sums, pair_blocks
from refsim.smoothing.reference import kernel_gradient, kernel_value
from refsim.sph.operations import symmetric

operation = operations(paper="Adami, Hu & Adams 2012")
_CORRECTION = "correction_diagonal correction_mixed"


@operation(
    "(27)", outputs="wall_pressure", entrywise=True, optional="phase wet period",
    variants=("phase wet period", "phase wet", "phase period", "period"), tolerance=16.0,
    reason="one rounding in each of distance, kernel, head, product and sum, and those of the quotient",
)  # fmt: skip
def extrapolation(position, density, pressure, phase, wet, walls, smoothing, lean, fluid, period=None):
    """Pressure of each wall particle [Pa]; 0 where neither liquid nor a wet solid is within reach.

    (27) p_w = sum_j W_wj s_j p_wj / sum_j W_wj s_j, over liquid p_wj = p_j + rho_j (g - a_w).(x_w - x_j), s_j = 1; over
    solids (`phase` not 0) p_wj = max(0, p_j + rho0 (g - a_w).(x_w - x_j)), s_j = wet_j/1000: where no liquid is within
    reach, a film carries their pressure.
    """
    rho, p = np.asarray(density, dtype=float), np.asarray(pressure, dtype=float)
    liquid = np.ones(len(p)) if phase is None else np.asarray(phase) == 0
    film = np.zeros(len(p)) if wet is None else 1e-3 * np.asarray(wet, dtype=float)
    share, heavy = np.where(liquid, 1.0, film), np.where(liquid, rho, float(fluid.rest_density))
    upward, least = np.array([float(part) for part in lean]), np.where(liquid, -np.inf, 0.0)
    count = len(walls.position)
    sums, weights, terms = Sums(count), np.zeros(count), np.zeros(count)
    for place, separation, distance in pair_blocks(walls.position, position, None, period):
        w = kernel_value(distance, smoothing) * share
        weights[place] += w.sum(1)
        terms[place] += (w > 0).sum(1)
        pressures = np.maximum(p[None, :] + heavy[None, :] * (separation @ upward), least)
        largest = np.abs(p)[None, :] + heavy[None, :] * (np.abs(separation) @ np.abs(upward))
        sums.add(place, w * pressures, w * largest)
    near = np.where(weights > 0, weights, 1.0)
    return {"wall_pressure": (sums.value / near, (1 + terms) * sums.scale / near)}


@operation(
    "adjoint of (27)", paper="this project", outputs="wall_strain", entrywise=True, optional="phase period",
    tolerance=16.0, reason="one rounding in each of distance, slope, volume, projection, product and sum, and those of"
    " the quotient",
)  # fmt: skip
def strain(position, velocity, mass, advanced_excess, phase, walls, smoothing, fluid, period=None):
    """What `sph.continuity` takes from each wall particle [m^(2 dim)/s]; 0 where no liquid is within reach.

    s_w = V_w sum_f V_f v_f.grad_f W_fw / sum_f W_fw, V_f = m_f/rho_f. With it the density does the work that p_w of
    (27) does on the liquid. Walls move along themselves alone, which is no strain: with v_f - v_w a
    lid drives noise into the density, and a cavity of 25 cells is 0.16 off Ghia's in place of 0.07.
    """
    x, wall_volume = np.asarray(walls.position, dtype=float), np.asarray(walls.volume, dtype=float)
    v, count = np.asarray(velocity, dtype=float), len(x)
    volume = np.asarray(mass, dtype=float) / (float(fluid.rest_density) + np.asarray(advanced_excess, dtype=float))
    liquid = np.ones(len(v)) if phase is None else np.asarray(phase) == 0
    sums, weights, terms = Sums(count), np.zeros(count), np.zeros(count)
    for place, separation, distance in pair_blocks(x, position, None, period):
        w = kernel_value(distance, smoothing) * liquid
        weights[place] += w.sum(1)
        terms[place] += (w > 0).sum(1)
        gradient = -kernel_gradient(separation, distance, smoothing)  # with respect to the liquid's position
        share = (volume * liquid)[None, :]
        size = (np.abs(gradient) * np.abs(v)[None, :, :]).sum(-1)
        sums.add(place, share * (gradient * v[None, :, :]).sum(-1), share * size)
    near = np.where(weights > 0, weights, np.inf)
    return {"wall_strain": (wall_volume * sums.value / near, (1 + terms) * wall_volume * sums.scale / near)}


@operation(
    "J(10) with wall particles", paper="Adami, Hu & Adams 2012; Jiang & Zhu 2023", adds="acceleration",
    optional=f"{_CORRECTION} period", tolerance=8.0, variants=(f"{_CORRECTION} period", _CORRECTION, "period"),
    invariants=SYMMETRY, broken={1: "rotation", 2: "rotation"},
)  # fmt: skip
def wall_force(
    position, density, pressure, wall_pressure, correction_diagonal, correction_mixed, walls, smoothing, period=None,
    rows=None,
):  # fmt: skip
    """Acceleration [m/s^2] of liquid and solids a_i = -(1/rho_i) B_i sum_w V_w (p_i + p_w) grad W_iw.

    B_i = I without a correction, which has its diagonal (xx, yy, zz) and the rest (xy, xz, yz).
    """
    pick = slice(None) if rows is None else np.asarray(rows)
    rho, p = np.asarray(density, dtype=float)[pick], np.asarray(pressure, dtype=float)[pick]
    of_wall, volume = np.asarray(wall_pressure, dtype=float), np.asarray(walls.volume, dtype=float)
    sums = Sums(len(rho), 3)
    for place, separation, distance in pair_blocks(position, walls.position, rows, period):
        gradient = kernel_gradient(separation, distance, smoothing)
        both = volume[None, :] * (p[place, None] + of_wall[None, :]) / rho[place, None]
        size = volume[None, :] * (np.abs(p)[place, None] + np.abs(of_wall)[None, :]) / rho[place, None]
        sums.add(place, -both[..., None] * gradient, size[..., None] * np.abs(gradient))
    if correction_diagonal is not None:
        matrix = symmetric(correction_diagonal, correction_mixed)[pick]
        sums.value = np.einsum("nab,nb->na", matrix, sums.value)
        sums.scale = np.einsum("nab,nb->na", np.abs(matrix), sums.scale)
    return {"acceleration": sums.total()}
