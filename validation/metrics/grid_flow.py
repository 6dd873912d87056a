"""A dam break of an inviscid, incompressible liquid on a grid: another program than refsim's particles.

Velocities travel with particles (APIC, Jiang et al., ACM Trans. Graph. 34 (2015) 51), the pressure is solved for on the
grid, to first order at the surface. Air has none, walls let liquid slip.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import spsolve

BESIDE = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]])
CORNERS = np.array([(0, 0), (1, 0), (0, 1), (1, 1)])
FACES = np.array([[0.0, 0.5], [0.5, 0.0]])  # where each component of the velocity stands in a cell


def _around(x: NDArray, axis: int, shape: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Flat numbers (n, 4) of the nodes of a component around each particle, weights, displacements to them [cells]."""
    at = x - FACES[axis]
    node = np.floor(at).astype(int)[:, None] + CORNERS
    away = node - at[:, None]
    node = np.clip(node, 0, shape - 1)
    return node[..., 0] * shape[1] + node[..., 1], np.prod(1 - np.abs(away), axis=2), away


def _pressure(wet: NDArray, source: NDArray) -> NDArray:
    """p of wet cells from -lap p = source, in cells; 0 in others, no slope at walls, the top is open."""
    number = np.where(wet, np.cumsum(wet).reshape(wet.shape) - 1, -1)
    pairs = [(number[:-1], number[1:]), (number[:, :-1], number[:, 1:])]
    first, second = (np.concatenate([pair[k].ravel() for pair in pairs]) for k in range(2))
    both = (first >= 0) & (second >= 0)
    rows, columns = np.concatenate([first[both], second[both]]), np.concatenate([second[both], first[both]])
    faces = convolve(np.ones(wet.shape), BESIDE, mode="constant")
    faces[:, -1] += 1
    size = int(wet.sum())
    matrix = diags_array(faces[wet]) - coo_array((np.ones(len(rows)), (rows, columns)), (size, size))
    p = np.zeros(wet.shape)
    p[wet] = spsolve(matrix.tocsc(), source[wet], permc_spec="MMD_AT_PLUS_A")
    return p


def _extended(values: NDArray, known: NDArray) -> NDArray:
    """Values, beyond the surface means of known neighbours three times over."""
    values = np.where(known, values, 0.0)
    for _ in range(3):
        count = convolve(known.astype(int), BESIDE, mode="constant")
        new = ~known & (count > 0)
        values[new] = (convolve(values, BESIDE, mode="constant") / np.maximum(count, 1))[new]
        known = known | new
    return values


def wall_pressure(
    cells: int, column: tuple[float, float], tank: tuple[float, float], gravity: float, until: float,
    patches: tuple[tuple[float, float], ...],
) -> tuple[NDArray, NDArray]:  # fmt: skip
    """Times (k,) [s] and mean pressures over rho [m^2/s^2] on patches (from, to) [m] of the wall at x = tank[0].

    column, tank  width and height [m]; cells  of the column's height
    """
    d, time = column[1] / cells, 0.0
    shape = np.array([round(tank[0] / d), round(tank[1] / d)])
    nodes = (shape + [1, 0], shape + [0, 1])
    x = (np.indices((round(2 * column[0] / d), 2 * cells)).reshape(2, -1).T + 0.5) / 2  # in cells
    flow = np.zeros((2, len(x), 3))  # by component the velocity and its gradient along x and y
    low = np.arange(shape[1]) * d
    share = [np.clip(np.minimum(low + d, b) - np.maximum(low, a), 0, None) / (b - a) for a, b in patches]
    series = []
    while time < until:
        step = min(0.5 * d / max(0.3, float(np.abs(flow[..., 0]).max())), 0.004)
        around = [_around(x, axis, nodes[axis]) for axis in range(2)]
        speed = []
        for (node, weight, away), (n, m), own in zip(around, nodes, flow):
            values = own[:, None, 0] + (away * own[:, None, 1:]).sum(2)
            total = np.bincount(node.ravel(), weight.ravel(), n * m)
            mean = np.bincount(node.ravel(), (weight * values).ravel(), n * m) / np.maximum(total, 1e-12)
            speed.append(mean.reshape(n, m) - step * gravity * (len(speed) == 1) * (total > 0).reshape(n, m))
        speed[0][[0, -1]], speed[1][:, 0] = 0, 0
        wet = np.zeros(shape, bool)
        wet[tuple(np.minimum(x.astype(int), shape - 1).T)] = True
        p = _pressure(wet, -(np.diff(speed[0], axis=0) + np.diff(speed[1], axis=1)) * d / step)
        for axis in range(2):
            inner = (slice(1, -1), slice(None)) if axis == 0 else (slice(None), slice(1, -1))
            known = np.ones(nodes[axis], bool)
            known[inner] = np.diff(wet.astype(int), axis=axis) != 0
            known[inner] |= wet[1:] if axis == 0 else wet[:, 1:]
            speed[axis][inner] -= step / d * np.diff(p, axis=axis)
            speed[axis] = _extended(speed[axis], known)
        speed[0][[0, -1]], speed[1][:, 0] = 0, 0
        for (node, weight, away), values, own in zip(around, speed, flow):
            found, near = values.ravel()[node], 1 - np.abs(away)
            own[:, 0] = (weight * found).sum(1)
            own[:, 1] = (found * (2 * CORNERS[:, 0] - 1) * near[..., 1]).sum(1)
            own[:, 2] = (found * (2 * CORNERS[:, 1] - 1) * near[..., 0]).sum(1)
        middle = x
        for part in (0.5, 1.0):  # midpoint rule
            places = [_around(middle, axis, nodes[axis]) for axis in range(2)]
            v = np.stack([(w * u.ravel()[n]).sum(1) for (n, w, _), u in zip(places, speed)], axis=1)
            middle = np.clip(x + part * step / d * v, 1e-6, shape - 1e-6)
        x, time = middle, time + step
        series.append((time, *(float(part @ p[-1]) for part in share)))
    found = np.array(series)
    return found[:, 0], found[:, 1:]
