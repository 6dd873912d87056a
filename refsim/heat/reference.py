"""NumPy oracle of heat conduction: all pairs, float64.

Each function returns {output: (value, scale)}; the scale holds the size of the temperatures for every pass over the
neighbours, and the exchanges that the pairs' weights bring with their own rounding.
Arrays: position (n, 3) [m]; volume [m^3; m^2 in 2D], mass [kg; kg/m], heat_capacity [J/(kg K)], conductivity
[W/(m K)], temperature and melting_point [degrees C], enthalpy and latent_heat [J/kg] (n,); reservoir (n,) uint8 or
None; timestep [kick, drift] [s].
"""

import math
from typing import Any, NamedTuple

import numpy as np

from refsim.core.operation import SYMMETRY, operations, without
from refsim.neighbours.reference import nearest_image, pair_blocks

_STEEP = "steep_volumes steep_conductivities"
_REASON = "the scale counts the temperatures once for each pass; the few roundings of one exchange"
_MELTS, _MADE_UP = "melting_point latent_heat enthalpy", "compensation_x compensation_rest"
operation = operations(
    paper="standard", cases=_STEEP, optional=f"reservoir period {_MADE_UP}",
    variants=(f"reservoir period {_MADE_UP}", "reservoir", f"period {_MADE_UP}"), invariants=SYMMETRY,
    broken={1: "rotation"},
)  # fmt: skip
_scheme = operations(
    paper="standard", cases=_STEEP, outputs="enthalpy temperature", reach=0,
    optional=f"reservoir period {_MELTS} {_MADE_UP}",
    variants=(
        f"reservoir period {_MELTS} {_MADE_UP}", f"reservoir {_MELTS}", f"period {_MELTS} {_MADE_UP}",
        f"reservoir period {_MADE_UP}",
    ),
    tolerance=1.0, reason=_REASON, invariants=SYMMETRY, broken={1: "rotation"},
    programs={"cpu": "schemes", "cuda": "schemes"},
)  # fmt: skip
_SOLID = {
    "optional": f"reservoir period {_MADE_UP}",
    "variants": (f"reservoir period {_MADE_UP}", "reservoir", f"period {_MADE_UP}"),
}

SPIKY, MUELLER, POLY6 = range(3)


class Body(NamedTuple):
    """Particles that conduct heat."""

    position: Any
    mass: Any
    volume: Any
    heat_capacity: Any
    conductivity: Any
    reservoir: Any
    compensation_x: Any  # (n, 3) xx, xy, xz of A, or None
    compensation_rest: Any  # (n, 3) yy, yz, zz


class Melting(NamedTuple):
    """Where particles melt; twice None without latent heat."""

    melting_point: Any
    latent_heat: Any


class Step(NamedTuple):
    """The step, the parameters of conduction, and the periodic box."""

    timestep: Any
    conduction: Any
    period: Any


# The pairs


def laplacian(distance, conduction):
    """L_ij of M(4) [1/m^(dim+2)] at a distance [m], before the calibration.

    Spiky: -W'(r)/max(r, h/10) (Shao & Song M5). Mueller: (h - r) 45/(pi h^6) in 3D and 40/(pi h^5) in 2D, halved
    (Shao & Song M6) or as printed. Poly6: its true Laplacian, negative near the particle (Shao & Song M5 as printed).
    """
    h, dim = float(conduction.support_radius), int(conduction.dim)
    r = np.asarray(distance, dtype=float)
    q = r / h
    if conduction.laplacian == SPIKY:
        w0 = {2: 10 / math.pi, 3: 15 / math.pi}[dim] / h**dim
        return 3 * w0 / h * (1 - q) ** 2 / np.maximum(r, h / 10)
    if conduction.laplacian == MUELLER:
        return {2: 40 / math.pi, 3: 45 / math.pi}[dim] / h ** (dim + 3) * (h - r)
    w0 = {2: 4 / math.pi, 3: 315 / (64 * math.pi)}[dim] / h**dim
    return w0 / h**2 * (24 * q**2 * (1 - q**2) - 6 * dim * (1 - q**2) ** 2)


def pairs(position, volume, conductivity, timestep, conduction, period):
    """(i, j, g): both directions of every pair within h, in the order of i, then j; g = dt G_ij [J/K].

    G_ij = f V_i V_j 2 k_ij L_ij, k_ij the harmonic or the arithmetic mean; f the calibration, or Shao & Song M6.
    """
    v, k = np.asarray(volume, dtype=float), np.asarray(conductivity, dtype=float)
    h = float(conduction.support_radius)
    found = []
    for place, _, distance in pair_blocks(position, position, period=period):
        row, j = np.nonzero((distance < h) & (distance > 0))
        i = row + place.start
        if conduction.harmonic:
            with np.errstate(invalid="ignore"):
                mean = 2 * k[i] * k[j] / (k[i] + k[j])
            mean = np.where((k[i] == 0) & (k[j] == 0), 0.0, mean)
        else:
            mean = (k[i] + k[j]) / 2
        weight = float(conduction.factor) * v[i] * v[j] * 2 * mean * laplacian(distance[row, j], conduction)
        found.append((i, j, float(timestep[1]) * weight))
    return tuple(np.concatenate(parts) for parts in zip(*found)) if found else (np.zeros(0, int),) * 2 + (np.zeros(0),)


def capacities(mass, volume, heat_capacity, reservoir, conduction):
    """1/C_i [K/J], C_i = m_i c_i, or V_i if the conductivity is a diffusivity (Shao & Song M11); 0 for reservoirs."""
    one = np.asarray(volume if conduction.unit_capacity else mass, dtype=float)
    c = 1.0 if conduction.unit_capacity else np.asarray(heat_capacity, dtype=float)
    inverse = 1 / (one * c)
    return inverse if reservoir is None else np.where(np.asarray(reservoir) != 0, 0.0, inverse)


def exchanges(body, step):
    """(i, j, g) of `pairs` with the factors f_ij, and 1/C_i [K/J]."""
    i, j, g = pairs(body.position, body.volume, body.conductivity, *step)
    if body.compensation_x is not None:
        a = tensors(body.compensation_x, body.compensation_rest)
        g = g * factors(i, separations(body.position, i, j, step.period)[0], j, a)
    return i, j, g, capacities(body.mass, body.volume, body.heat_capacity, body.reservoir, step.conduction)


def tensors(x, rest):
    """Symmetric matrices (n, 3, 3) of (xx, xy, xz) and (yy, yz, zz)."""
    both = np.concatenate((np.asarray(x, dtype=float), np.asarray(rest, dtype=float)), axis=1)
    return both[:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]


def separations(position, i, j, period):
    """(e, r): unit vectors (pairs, 3) along x_i - x_j and distances [m], to the nearest image."""
    x = np.asarray(position, dtype=float)
    away = x[i] - x[j] if period is None else nearest_image(x[i] - x[j], period)
    r = np.linalg.norm(away, axis=1)
    return away / r[:, None], r


def factors(i, e, j, a):
    """f_ij = e.(A_i + A_j).e/2 within 1/10 and 10, dimensionless."""
    return np.clip(np.einsum("pa,pab,pb->p", e, (a[i] + a[j]) / 2, e), 0.1, 10)


@operation(
    "S_i = sum_j V_j L_ij f_ij x_ij x_ij^T = I, f_ij = e.(A_i + A_j).e/2 (Shao & Song M26)",
    optional="reservoir period", outputs="compensation_x compensation_rest", variants=("reservoir period", ""),
    reach=0, broken={}, tolerance=4.0,
    invariants="translation reordering", programs={"cpu": "schemes", "cuda": "schemes"},
    reason="the scale counts the moments once for each round, over the square of the least eigenvalue that is inverted",
)  # fmt: skip
def compensation(position, velocity, volume, reservoir, conduction, period, compensation_x, compensation_rest):
    """A of each particle, with which its moment S_i is nearly I where the neighbours allow it; dimensionless.

    A round: A += w ((P (I - S) + (I - S) P)/2 - (A - P)/100), P = 1.05 (M + 0.05 I)^-1 with M the moment for f = 1, and
    A = P where it was 0. One with w = 3/2 if a particle moves. If some A is 0, four more, of Chebyshev's iteration for
    eigenvalues from 0.3 to 1 (Saad 2003, section 12.3). Reservoirs have A = I.
    """
    n, a = len(volume), tensors(compensation_x, compensation_rest)
    i, j, g = pairs(position, volume, np.ones(n), (0.0, 0.5), conduction, period)
    e, r = separations(position, i, j, period)
    share = g / np.asarray(volume, dtype=float)[i] * r**2

    def moment(f):
        s = np.zeros((n, 3, 3))
        np.add.at(s, i, (share * f)[:, None, None] * e[:, :, None] * e[:, None, :])
        return s

    p = 1.05 * np.linalg.inv(moment(1.0) + 0.05 * np.eye(3))
    new = a[:, 0, 0] == 0
    weights = [1.5] if new.any() or np.any(np.asarray(velocity) != 0) else []
    if new.any():
        weights += [1 / (0.65 + 0.35 * math.cos(k * math.pi / 8)) for k in (1, 3, 5, 7)]
    scale = 1.0
    for weight in weights:
        left = np.eye(3) - moment(factors(i, e, j, a))
        change = (p @ left + left @ p) / 2 - (a - p) / 100
        a = np.where((a[:, 0, 0] == 0)[:, None, None], p, a + weight * change)
        if reservoir is not None:
            a[np.asarray(reservoir) != 0] = np.eye(3)
        scale = max(scale, np.abs(a).max(initial=0))
    size = np.bincount(i, np.abs(share), n).max(initial=0)
    scale += 4 * (1 + np.abs(p).max(initial=0)) ** 2 * (1 + size)
    whole = np.full((n, 3), scale)
    return {"compensation_x": (a[:, 0], whole), "compensation_rest": (a[:, [1, 1, 2], [1, 2, 2]], whole)}


def flow(i, j, g, temperature):
    """dt Q_i = sum_j dt G_ij (T_j - T_i) [J]."""
    return np.bincount(i, g * (temperature[j] - temperature[i]), len(temperature))


def exchange_sums(i, j, g, inverse):
    """s_i = dt/C_i sum_j G_ij, dimensionless."""
    return inverse * np.bincount(i, g, len(inverse))


@operation(
    "s_i/dt = sum_j |G_ij|/C_i of (4)", outputs="exchange_rate", tolerance=8.0,
    reason="a few roundings in each of distance, shape, mean conductivity, products and sum",
)  # fmt: skip
def exchange_rate(
    position, mass, volume, heat_capacity, conductivity, reservoir, compensation_x, compensation_rest, conduction,
    period,
):  # fmt: skip
    """s_i/dt = sum_j |G_ij|/C_i [1/s], 0 for reservoirs: explicit steps keep the range up to dt = 1/(the largest)."""
    body = Body(position, mass, volume, heat_capacity, conductivity, reservoir, compensation_x, compensation_rest)
    i, j, g, inverse = exchanges(body, Step((0.0, 1.0), conduction, period))
    rate = exchange_sums(i, j, np.abs(g), inverse)
    return {"exchange_rate": (rate, rate)}


def _scale(i, j, g, inverse, temperatures, passes=1):
    """Size of the temperatures, once for each pass, and of the largest exchange at any of them, for every particle."""
    n = len(inverse)
    size = max((np.abs(t).max(initial=0) for t in temperatures), default=0.0) * (2 + passes)
    moved = 0.0
    for t in temperatures:
        moved = max(moved, (inverse * np.bincount(i, np.abs(g) * np.abs(t[j] - t[i]), n)).max(initial=0))
    return np.full(n, size + moved)


# Temperature and enthalpy


def temperature_of(enthalpy, heat_capacity, melting_point, latent_heat):
    """T(H) [degrees C]: Tm + H/c below 0, Tm from 0 to the latent heat, Tm + (H - L)/c above."""
    h, c = np.asarray(enthalpy, dtype=float), np.asarray(heat_capacity, dtype=float)
    beyond = h - np.asarray(latent_heat, dtype=float)
    return np.asarray(melting_point, dtype=float) + np.where(h < 0, h, np.where(beyond > 0, beyond, 0.0)) / c


def _floats(*arrays):
    return tuple(None if a is None else np.array(a, dtype=float) for a in arrays)


def _both(t, h, scale, heat_capacity, latent_heat):
    if h is None:
        return {"temperature": (t, scale)}
    return {
        "temperature": (t, scale + latent_heat / heat_capacity),
        "enthalpy": (h, scale * heat_capacity + latent_heat),
    }


def _gained(change, start, scale, enthalpy, heat_capacity, melting):
    """T + dT, or with latent heat H + c dT and T = T(H)."""
    h, c, latent = _floats(enthalpy, heat_capacity, melting.latent_heat)
    if h is None:
        return _both(start + change, h, scale, c, latent)
    h = h + change * c
    return _both(temperature_of(h, c, melting.melting_point, latent), h, scale, c, latent)


def _taken_up(t, start, scale, enthalpy, heat_capacity, melting):
    """With latent heat H = H^n + c (T - T^n) and T = T(H) (Chernoff's formula), else T."""
    h, c, latent = _floats(enthalpy, heat_capacity, melting.latent_heat)
    if h is not None:
        h = h + c * (t - start)
        t = temperature_of(h, c, melting.melting_point, latent)
    return _both(t, h, scale, c, latent)


# The schemes


@_scheme("forward Euler on (4)", reach=1)
def explicit(body: Body, melting: Melting, step: Step, enthalpy, temperature):
    """Forward Euler: C_i T_i += dt Q_i, or m_i H_i += dt Q_i [K; J/kg]. Unstable where s_i > 1."""
    i, j, g, inverse = exchanges(body, step)
    start = np.array(temperature, dtype=float)
    change, scale = inverse * flow(i, j, g, start), _scale(i, j, g, inverse, [start])
    return _gained(change, start, scale, enthalpy, body.heat_capacity, melting)


@_scheme(
    "(4) with Shao & Song M7 as printed (R1)", paper="Shao & Song 2017", outputs="temperature", reach=2, **_SOLID,
    invariants="translation",
)  # fmt: skip
def one_sided(body: Body, step: Step, temperature):
    """M(4) as read literally (R1): T_i <- T_i + g (T_j - T_i)/C_i / (1 + g (1/C_i + 1/C_j)), neighbour by neighbour.

    Every particle takes its neighbours one after another, with their temperatures before the sweep; then, from the new
    temperatures, backwards. With `frozen` (Shao & Song M9) T_i in the difference is that before the sweep, too.
    [degrees C]
    """
    i, j, g, inverse = exchanges(body, step)
    before = np.array(temperature, dtype=float)
    share = inverse[i] * g / (1 + g * (inverse[i] + inverse[j]))
    first = np.searchsorted(i, np.arange(len(before)))
    count = np.bincount(i, minlength=len(before))
    size = np.abs(before).max(initial=0)
    for backwards in (False, True):
        running = before.copy()
        for k in range(count.max(initial=0)):
            own = np.flatnonzero(count > k)
            pair = first[own] + (count[own] - 1 - k if backwards else k)
            reached = before[own] if step.conduction.frozen else running[own]
            running[own] += share[pair] * (before[j[pair]] - reached)
        before = running
        size = max(size, np.abs(before).max(initial=0))
    return {"temperature": (before, np.full(len(before), 4 * size))}


@_scheme(
    "(4) with Shao & Song M5 to M9 (R3)", paper="Shao & Song 2017", outputs="temperature", optional="reservoir period",
    variants=("reservoir period", without("reservoir", period="wide_box"), "period"), invariants="",
    programs={"cpu": "pair_exchange", "cuda": "pair_exchange"},
)  # fmt: skip
def pair_exchange(
    position, mass, volume, heat_capacity, conductivity, reservoir, timestep, conduction, period, temperature
):
    """M(4) for both particles of a pair at once (R3): E = g (T_j - T_i)/(1 + g (1/C_i + 1/C_j)) goes from j to i [J].

    Every pair once, in the order of `rounds`, and once more backwards; half of dt each (Shao & Song M8). [degrees C]
    """
    step = Step(timestep, conduction, period)
    i, j, g, inverse = exchanges(Body(position, mass, volume, heat_capacity, conductivity, reservoir, None, None), step)
    g = float(step.conduction.sweep_share) * g
    t = np.array(temperature, dtype=float)
    side, dim = float(step.conduction.support_radius) / 2, int(step.conduction.dim)
    order = [np.array(r).T for r in rounds(position, side, dim, step.period)]
    size = np.abs(t).max(initial=0)
    at = i * np.int64(len(t)) + j  # sorted
    for a, b in order + order[::-1]:
        key = a * np.int64(len(t)) + b
        k = np.minimum(np.searchsorted(at, key), max(len(at) - 1, 0))
        near = (at[k] == key) if len(at) else np.zeros(len(key), bool)
        a, b, w = a[near], b[near], g[k[near]]
        moved = w * (t[b] - t[a]) / (1 + w * (inverse[a] + inverse[b]))
        t[a] += inverse[a] * moved
        t[b] -= inverse[b] * moved
    size = max(size, np.abs(t).max(initial=0))
    return {"temperature": (t, np.full(len(t), 4 * size))}


def rounds(position, side, dim, period):
    """Yield lists of pairs (a, b) no two of which share a particle; together every pair of neighbouring cells.

    Cells of `side` [m], half the support radius, or wider, so that a multiple of four fits a period. First each cell
    with itself, then with those up to two cells away, 62 directions (12 in 2D), by falling distance and then in the
    order of x, y, z; cells whose place along the direction's first axis, counted in its steps, is even before odd ones.
    In two cells of p and q particles round k pairs number a with number (a + k) mod max(p, q); in one cell of p, number
    a with the one that makes a + b = k mod p.
    """
    lengths = [0.0] * 3 if period is None else [float(v) for v in period[:3]]
    wraps = [int(length / side * (1 + 1e-6)) // 4 * 4 for length in lengths]
    sides = [length / n if n else side for length, n in zip(lengths, wraps)]
    cell = np.floor(np.asarray(position, dtype=float) * (1.0 / np.array(sides))).astype(np.int64)
    for axis, n in enumerate(wraps):
        if n:
            cell[:, axis] %= n

    def beside(key, direction):
        moved = key[0] + direction[0], key[1] + direction[1], key[2] + direction[2]
        return moved if period is None else tuple(m % n if n else m for m, n in zip(moved, wraps))

    members = {}
    for i, key in enumerate(map(tuple, cell.tolist())):
        members.setdefault(key, []).append(i)
    turns = {}
    for own in members.values():
        for b, j in enumerate(own):
            for a, i in enumerate(own[:b]):
                turns.setdefault((a + b) % len(own), []).append((i, j))
    yield from (turns[k] for k in sorted(turns))
    steps = [(a - 2, b - 2, c - 2) for a, b, c in np.ndindex(5, 5, 5)]
    for x, y, z in sorted(steps[63:], key=lambda d: -(d[0] ** 2 + d[1] ** 2 + d[2] ** 2)):
        if dim == 2 and z != 0:
            continue
        axis, stride = (0, x) if x else (1, y) if y else (2, z)
        parities = {}, {}
        for key, own in members.items():
            other = members.get(beside(key, (x, y, z)), [])
            turns, m = parities[key[axis] // stride % 2], max(len(own), len(other))
            for a, i in enumerate(own):
                for b, j in enumerate(other):
                    turns.setdefault((b - a) % m, []).append((i, j))
        for turns in parities:
            yield from (turns[k] for k in sorted(turns))


@_scheme(
    "backward Euler, of which (4) is one pair (CHEB)",
    variants=(
        without(f"reservoir period {_MELTS} {_MADE_UP}", conduction="planned"), f"reservoir {_MELTS}",
        f"period {_MELTS} {_MADE_UP}", f"reservoir period {_MADE_UP}",
    ),
)  # fmt: skip
def chebyshev(body: Body, melting: Melting, step: Step, enthalpy, temperature):
    """CHEB: backward Euler (C + dt A) T = C T^n by n steps of Chebyshev's iteration, n = ceil(ln(tol/2)/ln sigma).

    The eigenvalues of 1 + dt A/C lie in 1..1 + 2 s_max; sigma = rho/(1 + sqrt(1 - rho^2)), rho = s_max/(1 + s_max).
    Beyond `most_passes` steps a truncated iteration may overshoot: then solved to the end (as by conjugate gradients).
    Written as corrections d of a residual r [K] (Saad 2003, algorithm 12.1). [degrees C]
    """
    i, j, g, inverse = exchanges(body, step)
    start = np.array(temperature, dtype=float)
    s = exchange_sums(i, j, g, inverse).max(initial=0)
    passes = chebyshev_passes(s, float(step.conduction.tolerance))
    if passes > step.conduction.most_passes:
        return conjugate_gradient(body, melting, step, enthalpy, temperature)
    t, middle, half = start.copy(), 1 + s, s
    r = inverse * flow(i, j, g, t)
    ratio, d = half / middle, r / middle
    for k in range(passes):
        t = t + d
        if k < passes - 1:
            r = r - d + inverse * flow(i, j, g, d)
            after = 1 / (2 * middle / half - ratio)
            d = after * ratio * d + 2 * after / half * r
            ratio = after
    return _taken_up(t, start, _scale(i, j, g, inverse, [start, t], passes), enthalpy, body.heat_capacity, melting)


def chebyshev_passes(s_max, tolerance):
    """n = ceil(ln(tol/2)/ln sigma), at least 1; 0 where nothing is exchanged. Dimensionless."""
    if not s_max > 0:
        return 0
    rho = s_max / (1 + s_max)
    sigma = rho / (1 + math.sqrt(1 - rho**2))
    return max(1, math.ceil(math.log(tolerance / 2) / math.log(sigma)))


@_scheme(
    "backward Euler, of which (4) is one pair (PCG)", tolerance=4.0, reason=f"{_REASON}; the residual of the solution"
)
def conjugate_gradient(body: Body, melting: Melting, step: Step, enthalpy, temperature):
    """PCG: backward Euler (C + dt A) T = C T^n, solved to the end, by elimination. [degrees C]"""
    i, j, g, inverse = exchanges(body, step)
    start = np.array(temperature, dtype=float)
    n = len(start)
    matrix = np.zeros((n, n))
    matrix[i, j] = -inverse[i] * g
    matrix[np.arange(n), np.arange(n)] = 1 + exchange_sums(i, j, g, inverse)
    t = start + np.linalg.solve(matrix, inverse * flow(i, j, g, start))
    return _taken_up(t, start, _scale(i, j, g, inverse, [start, t], 20), enthalpy, body.heat_capacity, melting)


@_scheme("RKL2; RKL1 with latent heat", paper="Meyer, Balsara & Aslam 2014")
def runge_kutta_legendre(body: Body, melting: Melting, step: Step, enthalpy, temperature):
    """RKL2 (Meyer, Balsara & Aslam 2014): s stages, s odd with (s^2 + s - 2)/4 >= s_max, in flux form [degrees C].

    With latent heat RKL1 on the enthalpy [J/kg], (s^2 + s)/2 >= 5/4 s_max.
    """
    i, j, g, inverse = exchanges(body, step)
    start, h, c, latent = _floats(temperature, enthalpy, body.heat_capacity, melting.latent_heat)
    s_max = exchange_sums(i, j, g, inverse).max(initial=0)
    if h is not None:
        stages = 1
        while (stages**2 + stages) / 2 < 1.25 * s_max:
            stages += 2
        w1 = 2 / (stages**2 + stages)
        old, y, t = h, h, start
        for k in range(1, stages + 1):
            mu = (2 * k - 1) / k
            old, y = y, mu * y + (1 - k) / k * old + mu * w1 * c * inverse * flow(i, j, g, t)
            t = temperature_of(y, c, melting.melting_point, latent)
        return _both(t, y, _scale(i, j, g, inverse, [start, t], 2 * stages), c, latent)
    stages = 3
    while (stages**2 + stages - 2) / 4 < s_max:
        stages += 2
    b = np.array([1 / 3, 1 / 3] + [(k**2 + k - 2) / (2 * k * (k + 1)) for k in range(2, stages + 1)])
    w1 = 4 / (stages**2 + stages - 2)
    first = inverse * flow(i, j, g, start)
    old, y = start, start + b[1] * w1 * first
    for k in range(2, stages + 1):
        mu = (2 * k - 1) / k * b[k] / b[k - 1]
        nu = -(k - 1) / k * b[k] / b[k - 2]
        now = mu * y + nu * old + (1 - mu - nu) * start
        now += mu * w1 * inverse * flow(i, j, g, y) - (1 - b[k - 1]) * mu * w1 * first
        old, y = y, now
    return _both(y, None, _scale(i, j, g, inverse, [start, y], 2 * stages), c, latent)


@operation(
    "V = m/rho of (4)", paper="Shao & Song 2017", outputs="volume", optional="", variants=(), tolerance=2.0,
    reason="one division", invariants="reordering", broken={}, cases="",
)  # fmt: skip
def particle_volume(mass, density, rows=None):
    """V_i = m_i/rho_i [m^3; m^2 in 2D]."""
    value = np.asarray(mass, dtype=float) / np.asarray(density, dtype=float)
    value = value if rows is None else value[rows]
    return {"volume": (value, value)}
