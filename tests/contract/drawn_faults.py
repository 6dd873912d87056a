"""Faults drawn by a seed: a place of the equations, what is wrong there, and where or when.

`python -m tests.contract.drawn_faults SEED [NUMBER]` plants ten in all-pairs programs of density and momentum and
prints for each how many trials notice it, whether the first cause names it, and the first cause.
"""

import dataclasses
import random
import re
import sys

import numpy as np

from refsim.contract import Programs, trials
from refsim.contract.causes import first_cause
from tests.contract.faulty import ALL_PAIRS, LAPLACIANS, TWO, Pairs

FACTORS = (0.0, -1.0, 0.5, 2.0, 1.0005, 0.998, 1.07, 0.75, 3.0)
PLACES = {  # {operation: {place: words of its name in a cause}}
    "sph.density": {
        "m_j": "mass", "W": "", "h": "h", "V_b": "walls", "rho0": "walls", "own": "the particle itself", "total": "",
    },
    "sph.momentum": {
        "m_j": "mass", "rho_j": "density", "rho_i": "density", "p_j": "pressure", "p_i": "pressure", "slope": "",
        "h": "h", "v_j": "velocity", "v_i": "velocity", "mu": "viscosity", "lap": "viscosity", "V_b": "walls",
        "total": "",
    },
}  # fmt: skip
OF_FIELDS = ("swapped", "next", "missing", "square")  # kinds of faults of a neighbour's value
OF_ALL = ("stale", "rolled", "offset", "z missing", "lower")  # and of the whole sum
KINDS = ("factor", "factor", "single precision", *OF_FIELDS, "other dimension", *OF_ALL, *["when"] * 5)
WHEN = {  # {when: words of it in a cause}
    "": "", "in the plane": "in 2 dimensions", "in float32": "in float32", "one kernel": "with the kernel cubic_spline",
    "across a border": "across a border|with period", "beyond a capacity": r"with up to \d+ neighbours",
    "above a number": r"with up to \d+ particles", "from a row on": r"up to row \d+", "odd rows": "in odd rows",
    "beside walls": "near walls|with walls", "at the end": "last rows",
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Fault:
    """What is wrong: `kind` at `place` of the operation, by an `amount`, `when`."""

    operation: str
    place: str
    kind: str
    amount: float = 1.0
    when: str = ""

    def __str__(self):
        amount = f" {self.amount:g}" if self.kind in ("factor", "offset") else ""
        return f"{self.operation} {self.place}: {self.kind}{amount} {self.when}".strip()

    def told_by(self, cause):
        """Whether a first cause names the fault: what or where, in words that belong to it."""
        if self.when:
            return bool(re.search(WHEN[self.when], cause))
        name, number = PLACES[self.operation][self.place], re.escape(f"{self.amount:g}")
        factors = {-1.0: f"-{name}|opposite sign", 0.0: f"0 in place of {name}|without {name}|leaves out {name}"}
        times = rf"{number}\d* times ({name}|as large)|{name}.* {number}\d* times"
        if self.place == "rho_i" and self.amount:  # by which all is divided
            times += f"|{1 / self.amount:.5g} times as large"
        words = {
            "factor": "|".join(filter(None, (factors.get(self.amount), times))),
            "single precision": "single precision|float32",
            "swapped": f"{name}_i in place of {name}_j", "next": f"{name} of the particle",
            "missing": f"1 in place of {name}", "square": f"square (of|in place of) {name}|m_j/rho_j in place of m_j",
            "other dimension": "normalisation for|wrong only with viscosity", "stale": "calls before|other values of",
            "rolled": "in other rows", "offset": "same amount", "z missing": "in z alone|z = 0",
            "lower": "of (lower|higher) numbers",
        }  # fmt: skip
        same = "|without viscosity" if (self.place, self.kind) == ("v_j", "swapped") else ""  # v_i - v_i
        return bool(re.search(words[self.kind] + same, cause))


def draw(seed):
    """A fault, the same for the same seed."""
    lot = random.Random(seed)
    operation, kind = lot.choice(list(PLACES)), lot.choice(KINDS)
    kind = "rolled" if (operation, kind) == ("sph.density", "z missing") else kind  # which has no z
    when = lot.choice(list(WHEN)[1:]) if kind == "when" else ""
    kind, places = "factor" if when else kind, list(PLACES[operation])
    if kind in OF_FIELDS:
        places = [place for place in places if place in ("m_j", "rho_j", "p_j", "v_j")]
    elif kind == "other dimension":
        places = [place for place in places if place in ("W", "slope", "lap")]
    elif kind in OF_ALL or when in ("from a row on", "odd rows", "at the end"):
        places = ["total"]
    elif when or kind == "single precision":
        places = [place for place in places if place not in ("own", "h", "V_b", "rho0", "mu")]
    place = lot.choice(places)
    return Fault(operation, place, kind, lot.choice([f for f in FACTORS if place != "h" or f > 0]), when)


class Planted(Pairs):
    """Values and slopes of all pairs, and quantities with the fault where it is."""

    def __init__(self, fault, smoothing, x, y, period, dtype):
        other = {2: "constant of space", 3: "constant of the plane"}[int(smoothing.dim)]
        h = smoothing.support_radius * (fault.amount if fault.place == "h" else 1)
        kernels = fault.kind == "other dimension" and fault.place != "lap"
        super().__init__(other if kernels else "", smoothing._replace(support_radius=h), x, y, period)
        self.fault, self.dtype, self.beside = fault, str(dtype), np.zeros(len(x), bool)
        self.across = self.near & ~Pairs("", smoothing, x, y, None).near

    def take(self, place, value):
        """A quantity of the equations, (n, n, ...) of pairs or (n, ...) of particles."""
        fault, n = self.fault, len(value)
        if place != fault.place or fault.kind in ("lower", "stale"):
            return value
        if fault.kind == "next":
            other, own = np.roll(value, 1, 1), np.eye(n, dtype=bool)
            other[own] = value[own]
            return other
        simple = {
            "single precision": lambda: value.astype(np.float32).astype(float), "swapped": lambda: value.swapaxes(0, 1),
            "missing": lambda: np.ones_like(value), "square": lambda: value**2, "rolled": lambda: np.roll(value, 1, 0),
            "offset": lambda: value + (fault.amount + 2) * 1e-3 * np.abs(value).max(initial=0),
            "z missing": lambda: value * [1, 1, 0] if value.ndim == 2 else value, "other dimension": lambda: value,
        }  # fmt: skip
        return simple[fault.kind]() if fault.kind in simple else np.where(self.mask(value), fault.amount * value, value)

    def mask(self, value):
        """Where the fault is, in the shape of a quantity."""
        n, pairs = len(value), value.ndim > 1 and self.fault.place != "total"
        others, row = self.near & ~np.eye(*self.near.shape, dtype=bool), np.arange(n)
        found = np.asarray({
            "": True, "in the plane": self.dim == 2, "in float32": self.dtype == "float32",
            "one kernel": self.kernel == "cubic_spline", "across a border": self.across,
            "beyond a capacity": np.cumsum(others, 1) > 24 if pairs else others.sum(1) > 24, "above a number": n > 100,
            "from a row on": row >= 64, "odd rows": row % 2 == 1, "beside walls": self.beside,
            "at the end": row >= n - 2,
        }[self.fault.when])  # fmt: skip
        found = (found & others).any(1) if found.ndim == 2 and not pairs else found
        found = found[:, None] if found.ndim == 1 and pairs else found
        return found.reshape(*found.shape, *[1] * (value.ndim - found.ndim))

    def total(self, terms):
        """The sum over the neighbours."""
        if self.fault.kind == "lower":
            lower = np.where(np.tri(len(terms), k=-1, dtype=bool), self.fault.amount, 1)
            terms = terms * lower.reshape(*lower.shape, *[1] * (terms.ndim - 2))
        return terms.sum(1)


def program(fault):
    """The operation with the fault."""
    kept = {}

    def prepared(position, walls, smoothing, period, dtype):
        x = kept.setdefault(len(position), position.copy()) if fault.kind == "stale" else position
        p, w = Planted(fault, smoothing, x, x, period, dtype), None
        if walls is not None and len(walls.position):
            w = Planted(fault, smoothing, x, walls.position, period, dtype)
            p.beside = w.near.any(1)
        return p, w, lambda values: np.repeat(np.asarray(values, float)[None], len(x), 0)

    def density(position, mass, walls, smoothing, fluid, period, density):
        p, w, of_j = prepared(position, walls, smoothing, period, mass.dtype)
        terms, own = p.take("m_j", of_j(mass)) * p.take("W", p.value()), np.diag_indices(len(mass))
        terms[own] = p.take("own", terms[own])
        total = p.total(terms)
        if w is not None:
            rest = p.take("rho0", np.full(len(mass), float(fluid.rest_density)))
            total += rest * (p.take("V_b", np.asarray(walls.volume, float)) * w.value()).sum(1)
        density[:] = p.take("total", total)

    def momentum(position, velocity, mass, density, pressure, walls, smoothing, fluid, viscosity, period, acceleration):
        p, w, of_j = prepared(position, walls, smoothing, period, mass.dtype)
        given = {"m": mass, "rho": density, "p": pressure, "v": velocity}
        m_j, rho_j, p_j, v_j = (p.take(f"{name}_j", of_j(values)) for name, values in given.items())
        rho_i, p_i, v_i = (p.take(f"{k}_i", np.asarray(given[k], float))[:, None] for k in ("rho", "p", "v"))
        share, slope = float(fluid.gradient_share), p.take("slope", p.slope_over_r())
        terms = (-share * m_j / rho_j * (p_j + p_i) / rho_i * slope)[..., None] * p.d
        if viscosity is not None:
            dim = 5 - p.dim if (fault.kind, fault.place) == ("other dimension", "lap") else p.dim
            lap = p.take("lap", LAPLACIANS[dim] / p.h ** (dim + 2) * np.where(p.q < 1, 1 - p.q, 0))
            mu = p.take("mu", np.full(len(mass), float(viscosity.coefficient)))[:, None]
            np.fill_diagonal(lap, 0)
            terms += (mu * m_j / rho_j / rho_i * lap)[..., None] * (v_j - v_i)
        total = p.total(terms)
        if w is not None:
            volume = p.take("V_b", np.asarray(walls.volume, float))
            factor = float(fluid.wall_share) * share * float(fluid.rest_density) * volume[None] * p_i / rho_i**2
            total -= ((factor * w.slope_over_r())[..., None] * w.d).sum(1)
        acceleration += p.take("total", total)

    return density if fault.operation == "sph.density" else momentum


def judged(fault):
    """(outcomes, first cause) of the ladder."""
    without = ("number_density", "asymmetry") if fault.operation == "sph.density" else ()
    declared = (TWO if fault.when == "one kernel" else ALL_PAIRS) | {"without": without, "name": "drawn"}
    dtypes = ("float32", "float64") if fault.when == "in float32" else ("float64",)
    programs = Programs({fault.operation: program(fault)}, **declared)
    outcomes = list(trials(programs, fault.operation, dtypes, (), ("T1", "T2")))
    return outcomes, first_cause(outcomes)


if __name__ == "__main__":
    seed, number = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 10
    right = noticed = 0
    for k in range(number):
        fault = draw(f"{seed}.{k}")
        outcomes, cause = judged(fault)
        tried = [o for o in outcomes if not o.not_judged]
        failed, told = sum(not o.passed for o in tried), fault.told_by(cause)
        right, noticed = right + told, noticed + bool(failed)
        print(f"{fault!s:56}{failed:4} of {len(tried):4}  {'right' if told else 'WRONG'}  {cause}", flush=True)
    print(f"{noticed} of {number} noticed, the first cause right for {right}")
