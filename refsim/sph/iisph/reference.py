"""NumPy oracle of implicit incompressible SPH: all pairs, float64.

Each function returns {output: (value, scale)}; scale is the sum of the absolute terms behind the value.
Arrays: position, velocity, acceleration, displacements (n, 3); the others (n,); SI units. `rows` picks particles.
"""

import numpy as np

from refsim.core.operation import SYMMETRY, operations
from refsim.neighbours.reference import pair_blocks
from refsim.smoothing.reference import kernel_slope

operation = operations(paper="Ihmsen et al. 2014")


class _Pairs:
    """Gradients of all pairs that have one: rows i of `own`, neighbours j, grad W_ij (k, 3)."""

    def __init__(self, position, source, smoothing, rows=None):
        count = len(position)
        self.own = np.arange(count) if rows is None else np.asarray(rows)
        found = [(np.zeros(0, int), np.zeros(0, int), np.zeros((0, 3)))]
        for place, separation, distance in pair_blocks(position, source, rows):
            slope = kernel_slope(distance, smoothing)
            row, j = np.nonzero(slope)
            apart = np.where(distance[row, j] > 0, distance[row, j], 1.0)
            found.append((place.start + row, j, (slope[row, j] / apart)[:, None] * separation[row, j]))
        self.row, self.j, self.gradient = (np.concatenate(parts) for parts in zip(*found))
        self.i = self.own[self.row]

    def sums(self, terms):
        """Sums over each row's pairs of (k,) or (k, 3) terms."""
        count = len(self.own)
        if terms.ndim == 1:
            return np.bincount(self.row, terms, count)
        return np.stack([np.bincount(self.row, terms[:, c], count) for c in range(3)], axis=1)


def _wall(position, walls, smoothing, fluid, rows):
    """(sum_b rho0 V_b grad W_ib, sum of moduli), each (n, 3)."""
    if walls is None:
        count = len(position) if rows is None else len(rows)
        return np.zeros((count, 3)), np.zeros((count, 3))
    near = _Pairs(position, walls.position, smoothing, rows)
    terms = float(fluid.rest_density) * np.asarray(walls.volume, dtype=float)[near.j, None] * near.gradient
    return near.sums(terms), near.sums(np.abs(terms))


@operation(
    "d_ii, a_ii, rho_adv", outputs="own_displacement diagonal advected_density", optional="walls", tolerance=12.0,
    reason="distance, slope, mass, two velocities and their kicks in each term, and a square", invariants=SYMMETRY,
)  # fmt: skip
def predict(position, velocity, mass, density, acceleration, walls, smoothing, fluid, timestep, rows=None):
    """Coefficients of the pressure equation, with t the kick and dt the drift in place of dt and dt (s = t dt).

    d_ii = -(s/rho_i^2) sum_j m_j grad W_ij [m/Pa];
    a_ii = -(s/rho_i^2) (|sum_j m_j grad W_ij|^2 + m_i sum_j m_j |grad W_ij|^2) [kg/(m^dim Pa)];
    rho_adv = rho_i + dt sum_j m_j (v_i - v_j).grad W_ij [kg/m^dim], v with the kick t a; walls m_j -> rho0 V_b.
    """
    kick, drift = (float(t) for t in timestep)
    m, rho = np.asarray(mass, dtype=float), np.asarray(density, dtype=float)
    v = np.asarray(velocity, dtype=float) + kick * np.asarray(acceleration, dtype=float)
    v_size = np.abs(np.asarray(velocity, dtype=float)) + np.abs(kick * np.asarray(acceleration, dtype=float))
    near = _Pairs(position, position, smoothing, rows)
    own, i, j = near.own, near.i, near.j
    total, size = _wall(position, walls, smoothing, fluid, rows)
    flow, flow_size = (total * v[own]).sum(1), (size * v_size[own]).sum(1)
    terms = m[j, None] * near.gradient
    total, size = total + near.sums(terms), size + near.sums(np.abs(terms))
    squares = near.sums(m[j] * (near.gradient**2).sum(1))
    flow += near.sums((terms * (v[i] - v[j])).sum(1))
    flow_size += near.sums((np.abs(terms) * (v_size[i] + v_size[j])).sum(1))
    share = kick * drift / rho[own] ** 2
    return {
        "own_displacement": (-share[:, None] * total, share[:, None] * size),
        "diagonal": (
            -share * ((total**2).sum(1) + m[own] * squares),
            share * (2 * (size**2).sum(1) + m[own] * squares),
        ),
        "advected_density": (rho[own] + drift * flow, rho[own] + abs(drift) * flow_size),
    }


@operation(
    "sum_j d_ij p_j", outputs="pair_displacement", tolerance=12.0,
    reason="distance, slope, mass, pressure, density twice, direction, product, sum", invariants=SYMMETRY,
)  # fmt: skip
def displace(position, mass, density, pressure, smoothing, timestep, rows=None):
    """s_i = sum_j d_ij p_j = -s sum_j (m_j p_j/rho_j^2) grad W_ij [m]."""
    return _displaced(_Pairs(position, position, smoothing, rows), mass, density, pressure, timestep)


def _displaced(near, mass, density, pressure, timestep):
    square = float(timestep[0]) * float(timestep[1])
    weight = np.asarray(mass, dtype=float) * np.asarray(pressure, dtype=float) / np.asarray(density, dtype=float) ** 2
    terms = -square * weight[near.j, None] * near.gradient
    return {"pair_displacement": (near.sums(terms), near.sums(np.abs(terms)))}


@operation(
    "pressure update", outputs="density_error new_pressure", optional="walls", tolerance=16.0,
    reason="four displacements, slope, direction and mass in each term, and the quotient by a_ii", invariants=SYMMETRY,
)  # fmt: skip
def relax(
    position, mass, density, pressure, own_displacement, pair_displacement, diagonal, advected_density, walls,
    smoothing, fluid, implicit, timestep, rows=None,
):  # fmt: skip
    """One Jacobi step: new pressures [Pa] and the compression [kg/m^dim] that those of before leave.

    L_i = sum_j m_j (s_i - d_jj p_j - s_j + d_ji p_i).grad W_ij + sum_b rho0 V_b s_i.grad W_ib;
    p <- max(0, (1 - w) p + (w/a_ii) (rho0 - rho_adv - L_i)), 0 where -a_ii <= 1e-6 of the lattice's;
    error = max(0, rho_adv + a_ii p_i + L_i - rho0).
    """
    near, wall = _Pairs(position, position, smoothing, rows), _wall(position, walls, smoothing, fluid, rows)
    liquid, displacements = (mass, density, pressure), (own_displacement, pair_displacement)
    return _relaxed(near, wall, liquid, displacements, diagonal, advected_density, fluid, implicit, timestep)


def _relaxed(near, wall, liquid, displacements, diagonal, advected_density, fluid, implicit, timestep):
    square = float(timestep[0]) * float(timestep[1])
    m, rho, p = (np.asarray(a, dtype=float) for a in liquid)
    d, s = (np.asarray(a, dtype=float) for a in displacements)
    own, i, j = near.own, near.i, near.j
    a, advected = np.asarray(diagonal, dtype=float)[own], np.asarray(advected_density, dtype=float)[own]
    total, size = (wall[0] * s[own]).sum(1), (wall[1] * np.abs(s[own])).sum(1)
    back = (square * m * p / rho**2)[i, None] * near.gradient
    moved = s[i] - (d * p[:, None])[j] - s[j] + back
    moduli = np.abs(s)[i] + np.abs(d * p[:, None])[j] + np.abs(s)[j] + np.abs(back)
    total += near.sums(m[j] * (moved * near.gradient).sum(1))
    size += near.sums(m[j] * (moduli * np.abs(near.gradient)).sum(1))
    missing = float(fluid.rest_density) - advected
    relaxation = float(implicit.relaxation)
    solved = ~(-a <= float(implicit.least_diagonal) * square)
    safe = np.where(solved, a, -1.0)
    value = (1 - relaxation) * p[own] + relaxation * (missing - total) / safe
    sums = float(fluid.rest_density) + np.abs(advected) + size
    error = advected + a * p[own] + total - float(fluid.rest_density)
    return {
        "new_pressure": (
            np.where(solved, np.maximum(value, 0), 0.0),
            np.where(solved, (1 - relaxation) * p[own] + relaxation * sums / np.abs(safe), 0.0),
        ),
        "density_error": (np.maximum(error, 0), sums + np.abs(a * p[own])),
    }


@operation(
    "symmetric pressure force p_i/rho_i^2 + p_j/rho_j^2", adds="acceleration", optional="walls", tolerance=12.0,
    reason="distance, slope, two ratios, direction, product, sum",
    invariants=f"{SYMMETRY} linear_momentum angular_momentum",
)  # fmt: skip
def push(position, mass, density, pressure, walls, smoothing, fluid, rows=None):
    """Acceleration [m/s^2] a_i = -sum_j m_j (p_i/rho_i^2 + p_j/rho_j^2) grad W_ij; walls m_j -> rho0 V_b, p_j -> 0."""
    near, wall = _Pairs(position, position, smoothing, rows), _wall(position, walls, smoothing, fluid, rows)
    return _pushed(near, wall, mass, density, pressure)


def _pushed(near, wall, mass, density, pressure):
    m = np.asarray(mass, dtype=float)
    ratio = np.asarray(pressure, dtype=float) / np.asarray(density, dtype=float) ** 2
    own, i, j = near.own, near.i, near.j
    terms = (m[j] * (ratio[i] + ratio[j]))[:, None] * near.gradient
    sizes = (m[j] * (np.abs(ratio)[i] + np.abs(ratio)[j]))[:, None] * np.abs(near.gradient)
    value = -ratio[own, None] * wall[0] - near.sums(terms)
    return {"acceleration": (value, np.abs(ratio[own, None]) * wall[1] + near.sums(sizes))}


@operation(
    "p = 0.5 p(before)", outputs="pressure", tolerance=0.0, reason="half of a number is exact", invariants="reordering"
)
def halve(pressure, rows=None):
    """p <- p/2 [Pa]."""
    value = np.asarray(pressure, dtype=float)
    value = (value if rows is None else value[rows]) / 2
    return {"pressure": (value, np.abs(value))}


@operation("p <- the relaxed p", outputs="pressure", tolerance=0.0, reason="a copy", invariants="reordering")
def keep(new_pressure, rows=None):
    """p <- the relaxed p [Pa]."""
    value = np.asarray(new_pressure, dtype=float)
    value = value if rows is None else value[rows]
    return {"pressure": (value, np.abs(value))}


@operation(
    "all steps of one solution",
    outputs="own_displacement diagonal advected_density pair_displacement density_error new_pressure pressure"
    " acceleration", adds="acceleration", reach=8, optional="walls", tolerance=32.0,
    reason="the roundings of every step, which the scale carries on", invariants=SYMMETRY,
    programs={"cpu": "iteration", "cuda": "iteration"},
)  # fmt: skip
def solve(position, velocity, mass, density, walls, smoothing, fluid, implicit, timestep, pressure, acceleration):
    """All steps of a solution, in turn; p = 0.5 p(before) at first [Pa], a_i = push [m/s^2].

    The scales carry the roundings of earlier steps on: those of each pressure enter the sums of the next.
    """
    ready = predict(position, velocity, mass, density, acceleration, walls, smoothing, fluid, timestep)
    near, wall = _Pairs(position, position, smoothing), _wall(position, walls, smoothing, fluid, None)
    d, a, advected = (ready[n] for n in ("own_displacement", "diagonal", "advected_density"))
    p, p_size = (np.array(part, dtype=float) for part in halve(pressure)["pressure"])
    relative = np.divide(a[1], np.abs(a[0]), out=np.zeros_like(a[1]), where=a[0] != 0)
    for count in range(1, int(implicit.most) + 1):
        s = _displaced(near, mass, density, p, timestep)["pair_displacement"]
        s_size = _displaced(near, mass, density, p_size, timestep)["pair_displacement"][1]
        rest = fluid, implicit, timestep
        step = _relaxed(near, wall, (mass, density, p), (d[0], s[0]), a[0], advected[0], *rest)
        sizes = _relaxed(near, wall, (mass, density, p_size), (d[1], s_size), a[0], advected[1], *rest)
        p = step["new_pressure"][0]
        p_size = sizes["new_pressure"][1] * (1 + relative)
        left = step["density_error"][0].mean() if len(p) else 0.0
        if count >= int(implicit.least) and not left > float(implicit.tolerance) * float(fluid.rest_density):
            break
    pushed = _pushed(near, wall, mass, density, p)["acceleration"]
    push_size = _pushed(near, wall, mass, density, p_size)["acceleration"][1]
    return {
        "own_displacement": d, "diagonal": a, "advected_density": advected, "pair_displacement": (s[0], s_size),
        "density_error": (step["density_error"][0], sizes["density_error"][1] * (1 + relative)),
        "new_pressure": (p, p_size), "pressure": (p, p_size), "acceleration": (pushed[0], push_size),
    }  # fmt: skip
