"""Densities and pressure forces in NumPy with one planted fault each, and the first cause that is right for it.

`python -m tests.contract.faulty` prints the table: fault, noticed, first cause.
"""

import math
import threading

import numpy as np

from refsim.contract import Programs, trials
from refsim.contract.causes import first_cause
from tests.running import rows

NORMS = {
    "cubic_spline": {2: 40 / (7 * math.pi), 3: 8 / math.pi}, "wendland_c2": {2: 7 / math.pi, 3: 21 / (2 * math.pi)},
}  # fmt: skip
SHAPES = {2: "cubic_spline", 3: "wendland_c2"}  # by number
LAPLACIANS = {2: 40 / math.pi, 3: 45 / math.pi}


class Pairs:
    """Values and slopes of one kernel for all pairs."""

    def __init__(self, fault, smoothing, x, y, period):
        self.dim, h = int(smoothing.dim), float(smoothing.support_radius)
        self.h = h * {"half h": 0.5, "twice h": 2}.get(fault, 1)
        self.kernel = SHAPES[int(smoothing.shape)]
        if fault == "other kernel" and self.kernel == "wendland_c2":
            self.kernel = "cubic_spline"
        norm = NORMS[self.kernel]
        wrong = {"constant of the plane": 2, "constant of space": 3}.get(fault, self.dim)
        self.scale = norm[wrong] / self.h**self.dim
        self.scale *= 1.0005 if fault == "constant off" or (fault == "constant off in 2D" and self.dim == 2) else 1
        x, y = (v.astype(np.float32).astype(v.dtype) if fault == "float32 positions" else v for v in (x, y))
        d = x[:, None] - y[None]
        for c in range(3 if period is not None and fault != "no period" else 0):
            if period[c] > 0:
                d[..., c] -= period[c] * (
                    d[..., c] > period[c] / 2 if fault == "one image" else np.round(d[..., c] / period[c])
                )
        if fault == "no z":
            d[..., 2] = 0
        self.d, self.r = d, np.sqrt((d * d).sum(2))
        self.q, self.cut = self.r / self.h, fault != "no cut"
        self.near = self.r < self.h
        self.six = 6.003 if fault == "coefficient of one kernel" else 6

    def value(self):
        q, a = self.q, 1 - self.q
        w = (
            a**4 * (1 + 4 * q)
            if self.kernel == "wendland_c2"
            else np.where(q <= 0.5, 1 - self.six * q * q * a, 2 * a**3)
        )
        return self.scale * (np.where(q < 1, w, 0) if self.cut else w)

    def slope_over_r(self, guarded=True):
        q, a = self.q, 1 - self.q
        s = -20 * a**3 / self.h if self.kernel == "wendland_c2" else np.where(
            q <= 0.5, (-12 + 18 * q) / self.h, -6 * a**2 / np.where(q > 0, q, 1) / self.h
        )  # fmt: skip
        s = s if guarded else s * (self.r / self.r)
        return self.scale / self.h * np.where(q < 1, s, 0)


def other_terms(fault, terms, others, near):
    """The terms (n, n) of a sum with a fault; `others` are near without the particle itself, `near` by any distance."""
    n, own = len(terms), np.diag(np.diag(terms))
    if fault in ("last missing", "last twice", "first missing"):
        for i, j in ((i, np.flatnonzero(others[i])) for i in range(n)):
            terms[i, j[:1] if fault == "first missing" else j[-1:]] *= 2 if fault == "last twice" else 0
        return terms
    made = {
        "float32 sum": lambda: terms.astype(np.float32), "no self": lambda: terms - own,
        "self twice": lambda: terms + own, "r = 0 left out": lambda: np.where(near | np.eye(n, dtype=bool), terms, 0),
        "64 neighbours": lambda: np.where(np.cumsum(others, 1) <= 64, terms, own),
        "32 neighbours": lambda: np.where(np.cumsum(others, 1) <= 32, terms, own),
        "index of 8 bits": lambda: np.where(np.arange(n)[None] < 256, terms, own),
    }  # fmt: skip
    return made.get(fault, lambda: terms)()


def other_total(fault, total, mass, scale, before, state):
    """A sum (n,) with a fault in its rows."""
    n = len(total)
    row, race = np.arange(n), "a race"  # another thread's share of a row is lost
    made = {
        "above 128 particles": lambda: total * (0.99 if n > 128 else 1),
        "rows from 128 on": lambda: np.where(row < 128, total, 0.5 * total + 1),
        "last block": lambda: np.where(row < n // 64 * 64, total, 0.9 * total),
        "last of four lanes": lambda: np.where(row < n // 4 * 4, total, 0),
        "last row": lambda: np.where((row < n - 1) | (n == 1), total, 0.5 * total), "reversed": lambda: total[::-1],
        race: lambda: np.where(state.random(n) < 0.5, 0.9 * total, total), "two threads": lambda: by_threads(total),
        "adds": lambda: total + before, "float32 factor": lambda: total * np.float32(1 / 3) * 3,
        "same amount": lambda: total + 0.01 * mass.max(initial=0) * scale,
    }  # fmt: skip
    return made.get(fault, lambda: total)()


def density_with(fault):
    kept, state = {}, np.random.default_rng()

    def density(position, mass, walls, smoothing, fluid, period, density):
        n, x = len(mass), position
        if fault == "raises" and n == 1:
            raise IndexError("list index out of range")
        if fault == "not written":
            return
        if fault in ("stale by number", "stale list") and n > 3:
            if n not in kept:
                kept.clear() if fault == "stale list" else None
                kept[n] = position.copy()
            x = kept[n]
        p = Pairs(fault, smoothing, position, position, period)
        terms = (mass[:, None] if fault == "m_i" else mass[None]) * p.value()
        if x is not position:
            terms *= Pairs("", smoothing, x, x, period).near
        total = other_terms(fault, terms, p.near & ~np.eye(n, dtype=bool), p.r > 0).sum(1)
        if walls is not None and len(walls.position) and fault != "no walls":
            mirror = {"mirrored walls": [1, 1, -1] if p.dim == 3 else [1, -1, 1]}.get(fault, [1, 1, 1])
            w = Pairs(fault, smoothing, position, (walls.position * mirror).astype(position.dtype), period)
            filled = (fluid.rest_density * walls.volume)[None] * w.value()
            total = total + filled.sum(1) * {"half walls": 0.5, "walls off": 1.01}.get(fault, 1)
        density[:] = other_total(fault, total, mass, p.scale, density, state)
        if fault == "changes an input" and n:
            mass[0] *= 2
        if fault == "writes behind":
            np.lib.stride_tricks.as_strided(density, (n + 1,), density.strides)[n] = 1

    return density


def by_threads(total):
    """Halves by two threads; the second's share is lost where it runs on a core of its own."""
    import os

    result = total.copy()
    if len(os.sched_getaffinity(0)) > 1:
        second = threading.Thread(
            target=lambda: result.__setitem__(slice(len(result) // 2, None), 0.9 * total[len(result) // 2 :])
        )
        second.start()
        second.join()
    return result


def listed_density(fault):
    """Over lists: prefix sums in single precision, or an index of 16 bits."""

    def density(position, mass, neighbours, smoothing, density):
        count = neighbours.count.astype(np.int64)
        own = np.repeat(np.arange(len(mass)), count)
        end = np.cumsum(count)
        place = np.arange(len(own)) + np.repeat(neighbours.start - (end - count), count)
        index = neighbours.entries[place].astype(np.uint16 if fault == "index of 16 bits" else np.int64)
        d = position[own] - position[index]
        q = np.minimum(np.sqrt((d * d).sum(1)) / float(smoothing.support_radius), 1)
        scale = NORMS["wendland_c2"][int(smoothing.dim)] / float(smoothing.support_radius) ** int(smoothing.dim)
        terms = mass[index] * scale * (1 - q) ** 4 * (1 + 4 * q)
        if fault == "prefix sums":
            running = np.concatenate([[0], np.cumsum(terms, dtype=np.float32)])
            density[:] = mass * scale + (running[end] - running[end - count])
        else:
            density[:] = mass * scale + np.bincount(own, terms, len(mass))

    return density


def momentum_with(fault):
    def momentum(position, velocity, mass, density, pressure, walls, smoothing, fluid, viscosity, period, acceleration):
        p = Pairs(fault, smoothing, position, position, period)
        m, rho, pr, v = (np.asarray(a, float) for a in (mass, density, pressure, velocity))
        volume = m / (rho[:, None] if fault == "rho_i for rho_j" else rho[None])
        volume = volume * {"m for V": rho[None], "V by rho_j": 1 / rho[None]}.get(fault, 1)
        both = {"p_i for p_j": 2 * pr[:, None], "p_i - p_j": pr[:, None] - pr[None]}.get(fault, pr[:, None] + pr[None])
        share = float(fluid.gradient_share) * {"opposite": -1, "half": 0.5}.get(fault, 1)
        slope = p.slope_over_r(fault != "0 by 0")
        total = (-share * volume * both / rho[:, None] * slope)[..., None] * p.d
        total = total.sum(1)
        if viscosity is not None and fault != "no viscosity":
            mu = float(viscosity.coefficient) * {"twice mu": 2, "minus mu": -1}.get(fault, 1)
            lap = LAPLACIANS[2 if fault == "Laplacian of the plane" else p.dim] / p.h ** (p.dim + 2)
            lap = lap * np.where(p.q < 1, 1 - p.q, 0) * (1.001 if fault == "Laplacian off" else 1)
            apart = v[None] - v[:, None] if fault != "v_j alone" else np.broadcast_to(v[None], p.d.shape)
            total += (mu * volume * lap / rho[:, None])[..., None].__mul__(apart).sum(1)
        if walls is not None and len(walls.position):
            w = Pairs(fault, smoothing, position, walls.position, period)
            part = 1.0 if fault == "wall share" else float(fluid.wall_share)
            filled = part * share * float(fluid.rest_density) * np.asarray(walls.volume, float)[None]
            total -= ((filled * (pr / rho**2)[:, None] * w.slope_over_r())[..., None] * w.d).sum(1)
        if fault == "z missing":
            total[:, 2] = 0
        if fault == "overwrites":
            acceleration[:] = total
        else:
            acceleration += total

    return momentum


ONE = {"kernels": ("wendland_c2",), "without": ("number_density", "asymmetry")}
ALL_PAIRS = ONE | {"most_particles": 1100}
TWO = ALL_PAIRS | {"kernels": ("wendland_c2", "cubic_spline")}
LISTS = {"kernels": ("wendland_c2",), "without": ("number_density", "asymmetry", "period"), "walls": False}
CAUSES = rows(__file__, "causes")
FORCES = list(CAUSES)[list(CAUSES).index("m for V") :]
VARIANTS = {"walls": (0, 6), "period": (0, 7), "image": (0, 7), "viscosity": (0, 3), "mu": (0, 3), "Laplacian": (0, 3)}
VARIANTS |= {"v_j alone": (0, 3), "wall share": (0, 4)}  # by a word of the fault; else the plain one


def programs(fault):
    """The library with a fault; "" for the right one."""
    if fault in FORCES or fault == "right forces":
        return Programs({"sph.momentum": momentum_with(fault)}, name="faulty", **(ALL_PAIRS | {"without": ()}))
    if fault in ("prefix sums", "index of 16 bits", "right lists"):
        return Programs({"sph.density": listed_density(fault)}, name="faulty", **LISTS)
    kernels = TWO if fault == "coefficient of one kernel" else ALL_PAIRS
    return Programs({"sph.density": density_with(fault)}, name="faulty", **kernels)


def judged(fault, steps=None):
    """(outcomes, first cause) of the ladder."""
    made = programs(fault)
    (operation,) = made.programs
    beyond = fault in ("prefix sums", "index of 16 bits")
    variants = next((chosen for word, chosen in VARIANTS.items() if word in fault), (0,))
    dtype = "float32" if fault == "prefix sums" else "float64"
    outcomes = list(trials(made, operation, (dtype,), variants, steps or (("T2", "T3") if beyond else ("T1", "T2"))))
    return outcomes, first_cause(outcomes)


if __name__ == "__main__":
    import sys

    right = noticed = 0
    for fault, words in CAUSES.items():
        if len(sys.argv) > 1 and fault not in sys.argv[1:]:
            continue
        outcomes, cause = judged(fault)
        failed, found = sum(not (o.passed or o.not_judged) for o in outcomes), words in cause
        right, noticed = right + found, noticed + bool(failed)
        tried = sum(not o.not_judged for o in outcomes)
        print(f"{fault:26}{failed:5} of {tried:4}  {'right' if found else 'WRONG'}  {cause}", flush=True)
    print(f"{noticed} of {len(CAUSES)} noticed, the first cause right for {right}")
