"""A cosine in an insulated slab, periodic across, by every scheme: error, drift and passes over the neighbours."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

from refsim.effect import Discretisation
from refsim.heat import HeatConduction
from refsim.heat.reference import nearest_image
from refsim.heat.schemes import chebyshev_passes, legendre_stages, stage_passes
from refsim.heat.shapes import lattice_sum, period_group
from refsim.neighbours.reference import other_particles, pair_blocks
from refsim.neighbours.rows import NeighbourRows
from refsim.scratch import Scratch
from validation.results import Result
from validation.running import Context

SPACING, SUPPORT, END = 0.2, 0.5, 6.4  # [m], [m], [s]; k/(rho c) = 1 m^2/s
LENGTH = 40  # spacings, along x
ACROSS = {"pair_exchange": 10}  # spacings along y and z, 6 otherwise: its cells need four support radii
NUMBERS = (0.5, 2.0, 8.0, 32.0)


def periodic_rows(position: np.ndarray, period: Any) -> NeighbourRows:
    """Neighbours within the support radius, to the nearest image, in the order of their numbers."""
    rows = []
    for place, separation, _ in pair_blocks(position, position):
        near = (nearest_image(separation, period) ** 2).sum(-1) < SUPPORT**2
        rows += [np.flatnonzero(line) for line in near & other_particles(place, len(position))]
    count = np.array([len(row) for row in rows], np.int32)
    return NeighbourRows(np.cumsum(count, dtype=np.int64) - count, count, np.concatenate(rows).astype(np.int32))


def slab(context: Context, scheme: str) -> Result:
    """Errors, drifts, passes for each unit of k dt/(rho c d^2) and seconds of stepping, for each of NUMBERS."""
    from refsim.backend import Backend

    across = ACROSS.get(scheme, 6)
    axes = [(np.arange(n) + 0.5) * SPACING for n in (LENGTH, across, across)]
    position = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    n = len(position)
    period = period_group((0.0, across * SPACING, across * SPACING), "float64")
    grid = Discretisation(3, "float64", SPACING, SUPPORT, n)
    effect = HeatConduction(scheme=scheme, conductivity=1.0, heat_capacity=1.0, density=1.0)
    conduction, one, volume = effect.conduction(grid), np.ones(n), np.full(n, SPACING**3)
    wave = math.pi / (LENGTH * SPACING)
    mode = np.cos(wave * position[:, 0])
    exact = 50 + 50 * mode * math.exp(-(wave**2) * END)
    fixed = {
        "position": position, "mass": volume, "volume": volume, "heat_capacity": one, "conductivity": one,
        "reservoir": None, "melting_point": None, "latent_heat": None, "enthalpy": None, "conduction": conduction,
        "period": period, "neighbours": periodic_rows(position, period), "scratch": Scratch(Backend("cpu")),
    }  # fmt: skip
    from refsim.operation import REGISTRY

    operation = REGISTRY[effect.operation()]
    program, names = operation.program("cpu"), operation.arguments("cpu")
    rows = []
    for number in NUMBERS:
        steps = round(END / (number * SPACING**2))
        temperature = 50 + 50 * mode
        start, wall = math.fsum(temperature), 0.0
        given = {**fixed, "timestep": np.array([0.0, END / steps]), "temperature": temperature}
        for _ in range(steps):
            began = time.perf_counter()
            program(*(given[name] for name in names))
            wall += time.perf_counter() - began
            if not np.isfinite(temperature).all():
                break
        error = float(np.sqrt(((temperature - exact) ** 2).mean()))
        drift = math.fsum(temperature) / start - 1 if np.isfinite(temperature).all() else math.inf
        rows.append(
            {
                "number": number, "error": error if error < 1e6 else math.inf, "drift": drift,
                "work": passes(scheme, number * lattice_sum(conduction, grid), conduction) / number, "seconds": wall,
            }
        )  # fmt: skip
    return Result({"scheme": scheme, "rows": rows})


def passes(scheme: str, largest_sum: float, conduction: Any) -> float:
    """Passes over the neighbours in one step; of conjugate gradients not known beforehand (NaN)."""
    if scheme == "implicit":
        return chebyshev_passes(largest_sum, float(conduction.tolerance))
    if scheme == "runge_kutta_legendre":
        return stage_passes(legendre_stages(largest_sum))
    return {"explicit": 1, "single_pass": 1, "one_sided": 2, "pair_exchange": 2}.get(scheme, math.nan)
