"""NumPy oracle of implicit incompressible SPH: all pairs, float64.

Each function returns {output: (value, scale)}; scale is the sum of the absolute terms behind the value.
Arrays: position, velocity, acceleration, displacements (n, 3); the others (n,); SI units. `rows` picks particles.
"""

import numpy as np

from refsim.neighbours.reference import pair_blocks
from refsim.smoothing.reference import kernel_slope


def _own(count, rows):
    return np.arange(count) if rows is None else np.asarray(rows)


def _gradients(position, source, smoothing, rows):
    """Yield (place, grad W_ij (b, m, 3)) for blocks of particles."""
    for place, separation, distance in pair_blocks(position, source, rows):
        apart = distance + 1e-9 * float(smoothing.support_radius)
        yield place, (kernel_slope(distance, smoothing) / apart)[..., None] * separation


def _wall(position, walls, smoothing, fluid, rows):
    """(sum_b rho0 V_b grad W_ib, sum of moduli), each (n, 3)."""
    count = len(position) if rows is None else len(rows)
    value, size = np.zeros((count, 3)), np.zeros((count, 3))
    if walls is not None:
        mass = float(fluid.rest_density) * np.asarray(walls.volume, dtype=float)
        for place, gradient in _gradients(position, walls.position, smoothing, rows):
            value[place] += (mass[None, :, None] * gradient).sum(1)
            size[place] += np.abs(mass[None, :, None] * gradient).sum(1)
    return value, size


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
    own = _own(len(m), rows)
    total, size = _wall(position, walls, smoothing, fluid, rows)
    flow, flow_size = (total * v[own]).sum(1), (size * v_size[own]).sum(1)
    squares = np.zeros(len(own))
    for place, gradient in _gradients(position, position, smoothing, rows):
        i = own[place]
        terms = m[None, :, None] * gradient
        total[place] += terms.sum(1)
        size[place] += np.abs(terms).sum(1)
        squares[place] += (m[None, :] * (gradient**2).sum(-1)).sum(1)
        flow[place] += (terms * (v[i, None, :] - v[None, :, :])).sum((1, 2))
        flow_size[place] += (np.abs(terms) * (v_size[i, None, :] + v_size[None, :, :])).sum((1, 2))
    share = kick * drift / rho[own] ** 2
    return {
        "own_displacement": (-share[:, None] * total, share[:, None] * size),
        "diagonal": (
            -share * ((total**2).sum(1) + m[own] * squares),
            share * (2 * (size**2).sum(1) + m[own] * squares),
        ),
        "advected_density": (rho[own] + drift * flow, rho[own] + abs(drift) * flow_size),
    }


def displace(position, mass, density, pressure, smoothing, timestep, rows=None):
    """s_i = sum_j d_ij p_j = -s sum_j (m_j p_j/rho_j^2) grad W_ij [m]."""
    square = float(timestep[0]) * float(timestep[1])
    weight = np.asarray(mass, dtype=float) * np.asarray(pressure, dtype=float) / np.asarray(density, dtype=float) ** 2
    own = _own(len(weight), rows)
    value, scale = np.zeros((len(own), 3)), np.zeros((len(own), 3))
    for place, gradient in _gradients(position, position, smoothing, rows):
        terms = -square * weight[None, :, None] * gradient
        value[place] += terms.sum(1)
        scale[place] += np.abs(terms).sum(1)
    return {"pair_displacement": (value, scale)}


def relax(
    position, mass, density, pressure, own_displacement, pair_displacement, diagonal, advected_density, walls,
    smoothing, fluid, implicit, timestep, rows=None,
):  # fmt: skip
    """One Jacobi step: new pressures [Pa] and the compression [kg/m^dim] that those of before leave.

    L_i = sum_j m_j (s_i - d_jj p_j - s_j + d_ji p_i).grad W_ij + sum_b rho0 V_b s_i.grad W_ib;
    p <- max(0, (1 - w) p + (w/a_ii) (rho0 - rho_adv - L_i)), 0 where -a_ii <= 1e-6 of the lattice's;
    error = max(0, rho_adv + a_ii p_i + L_i - rho0).
    """
    square = float(timestep[0]) * float(timestep[1])
    m, rho, p = (np.asarray(a, dtype=float) for a in (mass, density, pressure))
    d, s = np.asarray(own_displacement, dtype=float), np.asarray(pair_displacement, dtype=float)
    own = _own(len(m), rows)
    a, advected = np.asarray(diagonal, dtype=float)[own], np.asarray(advected_density, dtype=float)[own]
    wall, wall_size = _wall(position, walls, smoothing, fluid, rows)
    total, size = (wall * s[own]).sum(1), (wall_size * np.abs(s[own])).sum(1)
    for place, gradient in _gradients(position, position, smoothing, rows):
        i = own[place]
        back = (square * m * p / rho**2)[i, None, None] * gradient
        moved = s[i, None, :] - (d * p[:, None])[None, :, :] - s[None, :, :] + back
        moduli = np.abs(s)[i, None, :] + np.abs(d * p[:, None])[None, :, :] + np.abs(s)[None, :, :] + np.abs(back)
        total[place] += (m[None, :] * (moved * gradient).sum(-1)).sum(1)
        size[place] += (m[None, :] * (moduli * np.abs(gradient)).sum(-1)).sum(1)
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


def push(position, mass, density, pressure, walls, smoothing, fluid, rows=None):
    """Acceleration [m/s^2] a_i = -sum_j m_j (p_i/rho_i^2 + p_j/rho_j^2) grad W_ij; walls m_j -> rho0 V_b, p_j -> 0."""
    m = np.asarray(mass, dtype=float)
    ratio = np.asarray(pressure, dtype=float) / np.asarray(density, dtype=float) ** 2
    own = _own(len(m), rows)
    wall, wall_size = _wall(position, walls, smoothing, fluid, rows)
    value, scale = -ratio[own, None] * wall, np.abs(ratio[own, None]) * wall_size
    for place, gradient in _gradients(position, position, smoothing, rows):
        i = own[place]
        terms = -(m[None, :] * (ratio[i, None] + ratio[None, :]))[..., None] * gradient
        sizes = (m[None, :] * (np.abs(ratio)[i, None] + np.abs(ratio)[None, :]))[..., None] * np.abs(gradient)
        value[place] += terms.sum(1)
        scale[place] += sizes.sum(1)
    return {"acceleration": (value, scale)}


def halve(pressure, rows=None):
    """p <- p/2 [Pa]."""
    value = np.asarray(pressure, dtype=float)
    value = (value if rows is None else value[rows]) / 2
    return {"pressure": (value, np.abs(value))}


def keep(new_pressure, rows=None):
    """p <- the relaxed p [Pa]."""
    value = np.asarray(new_pressure, dtype=float)
    value = value if rows is None else value[rows]
    return {"pressure": (value, np.abs(value))}


def solve(position, velocity, mass, density, walls, smoothing, fluid, implicit, timestep, pressure, acceleration):
    """All steps of a solution, in turn; p = 0.5 p(before) at first [Pa], a_i = push [m/s^2].

    The scales carry the roundings of earlier steps on: those of each pressure enter the sums of the next.
    """
    given = (position, mass, density)
    ready = predict(position, velocity, mass, density, acceleration, walls, smoothing, fluid, timestep)
    d, a, advected = (ready[n] for n in ("own_displacement", "diagonal", "advected_density"))
    p, p_size = (np.array(part, dtype=float) for part in halve(pressure)["pressure"])
    relative = np.divide(a[1], np.abs(a[0]), out=np.zeros_like(a[1]), where=a[0] != 0)
    for count in range(1, int(implicit.most) + 1):
        s = displace(*given, p, smoothing, timestep)["pair_displacement"]
        s_size = displace(*given, p_size, smoothing, timestep)["pair_displacement"][1]
        step = relax(*given, p, d[0], s[0], a[0], advected[0], walls, smoothing, fluid, implicit, timestep)
        sizes = relax(*given, p_size, d[1], s_size, a[0], advected[1], walls, smoothing, fluid, implicit, timestep)
        p = step["new_pressure"][0]
        p_size = sizes["new_pressure"][1] * (1 + relative)
        left = step["density_error"][0].mean() if len(p) else 0.0
        if count >= int(implicit.least) and not left > float(implicit.tolerance) * float(fluid.rest_density):
            break
    pushed = push(*given, p, walls, smoothing, fluid)["acceleration"]
    push_size = push(*given, p_size, walls, smoothing, fluid)["acceleration"][1]
    return {
        "own_displacement": d,
        "diagonal": a,
        "advected_density": advected,
        "pair_displacement": (s[0], s_size),
        "density_error": (step["density_error"][0], sizes["density_error"][1] * (1 + relative)),
        "new_pressure": (p, p_size),
        "pressure": (p, p_size),
        "acceleration": (pushed[0], push_size),
    }
