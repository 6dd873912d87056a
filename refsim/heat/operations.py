"""The operations of heat conduction: which equations make each, over all pairs in float64.

Sizes are those of the temperatures, once for each pass over the neighbours, and of the largest exchange: an iteration
that converges forgets its roundings, which sums of absolute terms would multiply from pass to pass.
Arrays: position (n, 3) [m]; volume [m^3; m^2 in 2D], mass [kg; kg/m], heat_capacity [J/(kg K)], conductivity
[W/(m K)], temperature and melting_point [degrees C], enthalpy and latent_heat [J/kg] (n,); reservoir (n,) uint8 or
None; timestep [kick, drift] [s].
"""

from typing import Any, NamedTuple

import numpy as np

from refsim.core.operation import SYMMETRY, operations, without
from refsim.heat import reference as ref
from refsim.neighbours.reference import nearest_image, pair_blocks

_STEEP = "steep_volumes steep_conductivities"
_REASON = "the scale counts the temperatures once for each pass; the few roundings of one exchange"
_MELTS, _MADE_UP = "melting_point latent_heat enthalpy", "compensation_x compensation_rest"
_SOLID, _ALL = f"reservoir period {_MADE_UP}", f"reservoir period {_MELTS} {_MADE_UP}"
_OTHERS = f"reservoir {_MELTS}", f"period {_MELTS} {_MADE_UP}", _SOLID
_PROGRAMS = {"cpu": "schemes", "cuda": "schemes"}
operation = operations(
    paper="standard", cases=_STEEP, optional=_SOLID, variants=(_SOLID, "reservoir", f"period {_MADE_UP}"),
    invariants=SYMMETRY, broken={1: "rotation"},
)  # fmt: skip
_scheme = operations(
    paper="standard", cases=_STEEP, outputs="enthalpy temperature", halo_depth=0, optional=_ALL,
    variants=(_ALL, *_OTHERS), tolerance=1.0, reason=_REASON, invariants=SYMMETRY, broken={1: "rotation"},
    programs=_PROGRAMS,
)  # fmt: skip


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


LAPLACIANS = {ref.SPIKY: ref.spiky, ref.MUELLER: ref.mueller, ref.POLY6: ref.poly6}


def _f(*arrays):
    return tuple(None if a is None else np.asarray(a, dtype=float) for a in arrays)


class Of:
    """Arrays by name, as numbers without sizes."""

    def __init__(self, **given):
        vars(self).update(given)


class Pairs:
    """Both directions of every pair within h, in the order of i, then j; `weight` is g_ij = dt G_ij [J/K]."""

    def __init__(self, position, volume, conductivity, timestep, conduction, period):
        h, pairs = float(conduction.support_radius), [np.zeros((2, 0), int)]
        for place, _, distance in pair_blocks(position, position, period=period):
            pairs.append(np.argwhere((distance < h) & (distance > 0)).T + [[place.start], [0]])
        self.i, self.j = np.concatenate(pairs, axis=1)
        x, volume, conductivity = _f(position, volume, conductivity)
        away = x[self.i] - x[self.j]
        self.x = away if period is None else nearest_image(away, period)
        self.count, r = len(volume), np.sqrt((self.x * self.x).sum(1))
        self.e, self.factor = self.x / r[:, None], 1.0
        self.laplacian = float(conduction.factor) * LAPLACIANS[int(conduction.laplacian)](r, h, int(conduction.dim))
        mean = ref.harmonic_mean if conduction.harmonic else ref.arithmetic_mean
        self.conductivity = mean(*self.of(conductivity=conductivity))
        self.weight = float(timestep[1]) * ref.conductance(*self.of(volume=volume), self)

    def of(self, **fields):
        """(i, j): fields of both particles by name."""
        return tuple(Of(**{name: values[rows] for name, values in fields.items()}) for rows in (self.i, self.j))

    def sum(self, terms):
        """Sums over the neighbours of each particle."""
        total = np.zeros((self.count, *terms.shape[1:]))
        first = np.flatnonzero(np.diff(self.i, prepend=-1))
        if len(first):
            total[self.i[first]] = np.add.reduceat(terms, first, axis=0)
        return total


class Exchanges(Pairs):
    """Pairs with the factors f_ij, and 1/C_i [K/J], 0 of reservoirs."""

    def __init__(self, body, step):
        super().__init__(body.position, body.volume, body.conductivity, *step)
        if body.compensation_x is not None:
            tensor = tensors(body.compensation_x, body.compensation_rest)
            self.weight = self.weight * ref.factor_of(*self.of(tensor=tensor), self)
        diffuses = step.conduction.unit_capacity
        mass, c = _f(body.volume if diffuses else body.mass, 1.0 if diffuses else body.heat_capacity)
        reservoir = False if body.reservoir is None else np.asarray(body.reservoir) != 0
        self.inverse = np.where(reservoir, 0.0, 1 / ref.capacity_of(mass, c))

    def change(self, temperature):
        """dt/C_i sum_j G_ij (T_j - T_i) [K]."""
        return self.inverse * self.sum(ref.flow(*self.of(temperature=temperature), self))

    def largest(self):
        """The largest s_i = dt/C_i sum_j G_ij, dimensionless."""
        return (self.inverse * self.sum(self.weight)).max(initial=0)

    def size(self, *temperatures, passes=1):
        """Of the temperatures, once for each pass, and of the largest exchange at any of them, for every particle."""
        flows = [np.abs(ref.flow(*self.of(temperature=t), self)) for t in temperatures]
        moved = max((self.inverse * self.sum(flow)).max(initial=0) for flow in flows)
        return np.full(self.count, max(np.abs(t).max(initial=0) for t in temperatures) * (2 + passes) + moved)


def tensors(x, rest):
    """Symmetric matrices (n, 3, 3) of (xx, xy, xz) and (yy, yz, zz)."""
    return np.concatenate(_f(x, rest), axis=1)[:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]


@operation(
    "S_i = sum_j V_j L_ij f_ij x_ij x_ij^T = I, f_ij = e.(A_i + A_j).e/2 (Shao & Song M26)",
    optional="reservoir period", outputs="compensation_x compensation_rest", variants=("reservoir period", ""),
    halo_depth=0, broken={}, tolerance=4.0, invariants="translation reordering", programs=_PROGRAMS,
    reason="the scale counts the moments once for each round, over the square of the least eigenvalue that is inverted",
)  # fmt: skip
def compensation(position, velocity, volume, reservoir, conduction, period, compensation_x, compensation_rest):
    """A of each particle, with which its moment S_i is nearly I where the neighbours allow it; dimensionless.

    One round if a particle moves; A = P where A was 0, with four rounds more of all. Reservoirs have A = I.
    """
    pairs = Pairs(position, volume, np.ones(len(volume)), (0.0, 0.5), conduction, period)
    a, pairs.share = tensors(compensation_x, compensation_rest), pairs.weight / np.asarray(volume, float)[pairs.i]
    p = ref.nearly_inverse(pairs.sum(ref.moment(None, None, pairs)))
    new = a[:, 0, 0] == 0
    weights = [1.5] if new.any() or np.any(np.asarray(velocity) != 0) else []
    scale = 1.0
    for weight in weights + [ref.round_weight(k) for k in (1, 2, 3, 4)] * bool(new.any()):
        pairs.factor = ref.factor_of(*pairs.of(tensor=a), pairs)
        change = ref.correction(a, p, pairs.sum(ref.moment(None, None, pairs)))
        a = np.where((a[:, 0, 0] == 0)[:, None, None], p, a + weight * change)
        if reservoir is not None:
            a[np.asarray(reservoir) != 0] = np.eye(3)
        scale = max(scale, np.abs(a).max(initial=0))
    size = pairs.sum(np.abs(pairs.share) * (pairs.x**2).sum(1)).max(initial=0)
    scale += 4 * (1 + np.abs(p).max(initial=0)) ** 2 * (1 + size)
    whole = np.full((len(a), 3), scale)
    return {"compensation_x": (a[:, 0], whole), "compensation_rest": (a[:, [1, 1, 2], [1, 2, 2]], whole)}


@operation(
    "s_i/dt = sum_j |G_ij|/C_i of (4)", outputs="exchange_rate", tolerance=8.0,
    reason="a few roundings in each of distance, shape, mean conductivity, products and sum",
)  # fmt: skip
def exchange_rate(body: Body, conduction, period):
    """s_i/dt [1/s], 0 for reservoirs: explicit steps keep the range up to dt = 1/(the largest)."""
    pairs = Exchanges(body, Step((0.0, 1.0), conduction, period))
    rate = pairs.inverse * pairs.sum(np.abs(pairs.weight))
    return {"exchange_rate": (rate, rate)}


# The schemes


def _answer(t, h, scale, heat_capacity, latent_heat):
    if h is None:
        return {"temperature": (t, scale)}
    return {
        "temperature": (t, scale + latent_heat / heat_capacity),
        "enthalpy": (h, scale * heat_capacity + latent_heat),
    }


def _after(change, start, scale, enthalpy, heat_capacity, melting):
    """T + dT, or with latent heat H + c dT and T = T(H), for implicit steps by Chernoff's formula."""
    h, c, point, latent = _f(enthalpy, heat_capacity, melting.melting_point, melting.latent_heat)
    if h is None:
        return _answer(start + change, h, scale, c, latent)
    h = ref.heated(h, c, change)
    return _answer(ref.temperature_of(h, c, point, latent), h, scale, c, latent)


@_scheme("forward Euler on (4)", halo_depth=1)
def explicit(body: Body, melting: Melting, step: Step, enthalpy, temperature):
    """Forward Euler: C_i T_i += dt Q_i, or m_i H_i += dt Q_i [K; J/kg]. Unstable where s_i > 1."""
    pairs, (start,) = Exchanges(body, step), _f(temperature)
    return _after(pairs.change(start), start, pairs.size(start), enthalpy, body.heat_capacity, melting)


@operation(
    "(4) with Shao & Song M7 as printed (R1)", paper="Shao & Song 2017", outputs="temperature", halo_depth=2,
    tolerance=1.0, reason=_REASON, invariants="translation", programs=_PROGRAMS,
)  # fmt: skip
def one_sided(body: Body, step: Step, temperature):
    """M(4) as read literally (R1): T_i <- T_i + E_ij/C_i, neighbour by neighbour [degrees C].

    Every particle takes its neighbours one after another, with their temperatures before the sweep; then, from the new
    temperatures, backwards; half of dt each, or all of it (Shao & Song M8). With `frozen` (Shao & Song M9) T_i in the
    difference is that before the sweep, too.
    """
    pairs, (before,) = Exchanges(body, step), _f(temperature)
    first, count = np.searchsorted(pairs.i, np.arange(len(before))), np.bincount(pairs.i, minlength=len(before))
    size, weight = np.abs(before).max(initial=0), float(step.conduction.sweep_share) * pairs.weight
    for backwards in (False, True):
        running = before.copy()
        for k in range(count.max(initial=0)):
            active = np.flatnonzero(count > k)
            pair = first[active] + (count[active] - 1 - k if backwards else k)
            reached = before if step.conduction.frozen else running
            j = pairs.j[pair]
            i, j = _side(active, reached, pairs.inverse), _side(j, before, pairs.inverse)
            running[active] += i.inverse * ref.exchange(i, j, Of(weight=weight[pair]))
        before = running
        size = max(size, np.abs(before).max(initial=0))
    return {"temperature": (before, np.full(len(before), 4 * size))}


def _side(rows, temperature, inverse):
    return Of(temperature=temperature[rows], inverse=inverse[rows])


@_scheme(
    "backward Euler, of which (4) is one pair (CHEB)",
    variants=(without(_ALL, conduction="planned"), *_OTHERS),
)
def implicit(body: Body, melting: Melting, step: Step, enthalpy, temperature):
    """CHEB: backward Euler (C + dt A) T = C T^n by n steps of Chebyshev's iteration [degrees C].

    Written as corrections d of a residual r [K].
    """
    pairs, (start,) = Exchanges(body, step), _f(temperature)
    s = pairs.largest()
    passes = ref.passes(s, float(step.conduction.tolerance)) if s > 0 else 0
    t, r, ratio = start, pairs.change(start), s / (1 + s)
    d = r / (1 + s)
    for k in range(passes):
        t = t + d
        if k < passes - 1:
            r = r - d + pairs.change(d)
            d, ratio = ref.next_correction(d, r, ratio, s)
    size = pairs.size(start, t, passes=passes)
    return _after(t - start, start, size, enthalpy, body.heat_capacity, melting)


@_scheme("RKL2; RKL1 with latent heat", paper="Meyer, Balsara & Aslam 2014")
def runge_kutta_legendre(body: Body, melting: Melting, step: Step, enthalpy, temperature):
    """RKL2 of the temperatures [degrees C]; with latent heat RKL1 of the enthalpies [J/kg]."""
    pairs = Exchanges(body, step)
    start, h, c, point, latent = _f(
        temperature, enthalpy, body.heat_capacity, melting.melting_point, melting.latent_heat
    )
    s = ref.stages(pairs.largest(), 2 if h is None else 1)
    y, t, first = (start if h is None else h), start, pairs.change(start)
    old = y
    for k in range(1, s + 1):
        if h is None:
            old, y = y, ref.second_order_stage(k, s, y, old, start, pairs.change(y), first)
            t = y
        else:
            old, y = y, ref.first_order_stage(k, s, y, old, c * pairs.change(t))
            t = ref.temperature_of(y, c, point, latent)
    return _answer(t, None if h is None else y, pairs.size(start, t, passes=2 * s), c, latent)


@operation(
    "V = m/rho of (4)", paper="Shao & Song 2017", outputs="volume", optional="", variants=(), tolerance=2.0,
    reason="one division", invariants="reordering", broken={}, cases="",
)  # fmt: skip
def particle_volume(mass, density, rows=None):
    """V_i = m_i/rho_i [m^3; m^2 in 2D]."""
    value = ref.volume_of(*_f(mass, density))
    value = value if rows is None else value[rows]
    return {"volume": (value, value)}
