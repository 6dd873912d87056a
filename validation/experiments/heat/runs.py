"""Runs of heat conduction: slab, orders, sphere, Stefan's problem, a melting sphere, ledgers and ranges.

Everywhere k = rho = c = 1 (SI units), h = 2.5 d; `number` is k dt/(rho c d^2).
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

from refsim import Box, HeatConduction, Scene, WeaklyCompressible
from refsim.backends.arrays import choose, set_threads
from refsim.core.effect import Discretisation
from refsim.core.operation import REGISTRY
from refsim.core.period import period_group
from refsim.engine.stock import stock
from refsim.heat import reference
from validation.experiments.heat import exact
from validation.experiments.heat.conductor import SUPPORT, Conductor, cosine_slab, lattice
from validation.results import Result
from validation.running import Context

NUMBERS = (0.5, 2.0, 8.0, 32.0)
SPACING, LENGTH, END = 0.2, 40, 6.4  # of the slab: [m], spacings along x, [s]
WALL, START, LATENT = 50.0, -10.0, 100.0  # of ice: held at the surface [deg C], at first [deg C], [J/kg]


def across(scheme: str) -> int:
    """Spacings along y and z of a periodic column; cells of the pair exchange need four support radii."""
    return 10 if scheme == "pair_exchange" else 6


# A cosine in an insulated slab, periodic across


def slab_of(scheme: str, cells: int = LENGTH, spacing: float = SPACING, **options: Any) -> tuple[Conductor, np.ndarray]:
    """The slab at its start, and the depth x of its particles [m]."""
    return cosine_slab(scheme, cells, across(scheme), spacing, **options)


def rms(values: np.ndarray) -> float:
    """Root of the mean square; infinite where something has blown up."""
    found = float(np.sqrt((np.asarray(values, dtype=float) ** 2).mean()))
    return found if found < 1e6 else math.inf


def slab(context: Context, scheme: str) -> Result:
    """Errors, drifts, passes for each unit of k dt/(rho c d^2) and seconds of stepping, for each of NUMBERS."""
    rows, profiles = [], {}
    for share, number in enumerate(NUMBERS):
        slab, x = slab_of(scheme)
        steps = round(END / (number * SPACING**2))
        start, work = slab.heat(), slab.passes(END / steps) / number
        slab.run(END, steps)
        drift = slab.heat() / start - 1 if np.isfinite(slab.temperature).all() else math.inf
        error = rms(slab.temperature - exact.cosine(x, LENGTH * SPACING, END))
        rows.append({"number": number, "error": error, "drift": drift, "work": work, "seconds": slab.seconds})
        profiles[f"profile_{number:g}"] = slab.temperature.reshape(LENGTH, -1).mean(1)
        context.progress((share + 1) / len(NUMBERS))
    return Result({"scheme": scheme, "rows": rows}, profiles)


def pair_orders(context: Context, numbers: tuple[float, ...] = (2.0, 8.0, 32.0)) -> Result:
    """Errors of R3 in plain Python, one pair after the other: by the particles' numbers, and at random.

    No colours, no cells: what the order of the pairs alone does. The box is 6 spacings wide, as the others'.
    """
    cells = (LENGTH, 6, 6)
    position = lattice(cells, SPACING)
    period = period_group((0.0, 6 * SPACING, 6 * SPACING), "float64")
    conduction = HeatConduction(scheme="pair_exchange").conduction(
        Discretisation(3, "float64", SPACING, SUPPORT * SPACING, len(position))
    )
    volume, one = np.full(len(position), SPACING**3), np.ones(len(position))
    i, j, g = reference.pairs(position, volume, one, (0.0, 1.0), conduction, period)
    once = i < j
    i, j, g = i[once], j[once], g[once] / SPACING**3  # s of a pair for a step of one second
    found = {}
    for words, order in (("by number", np.arange(len(g))), ("at random", np.random.default_rng(0).permutation(len(g)))):
        found[words] = []
        for number in numbers:
            steps = round(END / (number * SPACING**2))
            s = g[order] * (END / steps / 2)
            sweep = list(zip(i[order].tolist(), j[order].tolist(), (s / (1 + 2 * s)).tolist()))
            start = exact.cosine(position[:, 0], LENGTH * SPACING, 0.0)
            t = start.tolist()
            for _ in range(steps):
                for pairs in (sweep, reversed(sweep)):
                    for a, b, share in pairs:
                        moved = share * (t[b] - t[a])
                        t[a] += moved
                        t[b] -= moved
            truth = exact.cosine(position[:, 0], LENGTH * SPACING, END)
            found[words].append({"number": number, "error": rms(np.array(t) - truth)})
    return Result({"orders": found})


# Orders of convergence


def order_in_spacing(context: Context, cells: tuple[int, ...] = (10, 20, 40, 80)) -> Result:
    """Error of the slab's cosine over the spacing, RKL2 with steps so short that they cost no accuracy."""
    length, rows = 8.0, []
    for n in cells:
        slab, x = slab_of("runge_kutta_legendre", n, length / n)
        steps = math.ceil(END / (2.0 * (length / n) ** 2))
        slab.run(END, steps)
        rows.append({"size": length / n, "error": rms(slab.temperature - exact.cosine(x, length, END))})
    return Result({"rows": rows})


STEPS = {
    "explicit": (0.03125, 0.0625, 0.125, 0.25), "one_sided": (0.03125, 0.0625, 0.125, 0.25),
    "single_pass": (0.03125, 0.0625, 0.125, 0.25), "pair_exchange": (0.125, 0.25, 0.5, 1.0),
    "implicit": (1.0, 2.0, 4.0, 8.0), "conjugate_gradient": (1.0, 2.0, 4.0, 8.0),
    "runge_kutta_legendre": (1.0, 2.0, 4.0, 8.0),
}  # fmt: skip


def order_in_step(context: Context, scheme: str) -> Result:
    """Error of half a slab over the step, against the same particles with a step that costs no accuracy.

    What the step does is apart from what the spacing does; linear solves are taken to the end.
    """
    tight = {"tolerance": 1e-9, "residual": 1e-10}
    best, _ = slab_of("runge_kutta_legendre", LENGTH // 2)
    best.run(END / 4, 640)
    limit = best.temperature.reshape(LENGTH // 2, -1).mean(1)
    rows = []
    for number in STEPS[scheme]:
        slab, _ = slab_of(scheme, LENGTH // 2, **tight)
        slab.run(END / 4, round(END / 4 / (number * SPACING**2)))
        rows.append({"size": number, "error": rms(slab.temperature.reshape(LENGTH // 2, -1) - limit[:, None])})
    return Result({"scheme": scheme, "rows": rows})


# A sphere that cools


def ball(cells: int, jitter: float, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Particles (n, 3) in units of the spacing about the origin, out to `cells` + a support radius; whether held.

    Jittered by so many spacings, each way; those beyond `cells` are held.
    """
    reach = math.ceil(cells + SUPPORT)
    position = lattice((2 * reach,) * 3, 1.0) - reach
    position += np.random.default_rng(seed).uniform(-jitter, jitter, position.shape)
    distance = np.linalg.norm(position, axis=1)
    position = position[distance < cells + SUPPORT]
    return position, np.linalg.norm(position, axis=1) >= cells


def sphere(context: Context, scheme: str, cells: int, numbers: tuple[float, ...], jitter: float = 0.2) -> Result:
    """A jittered ball of 1 m at 1 deg C, all beyond held at 0, at t = 0.1 s: rms error [% of the range].

    Against the series with the surface where the particles end, and with the first held layer taken for the surface,
    half a spacing out.
    """
    position, held = ball(cells, jitter)
    spacing, until = 1.0 / cells, 0.1
    r = np.linalg.norm(position, axis=1)[~held] * spacing
    truth = {
        name: exact.cooled_sphere(r, 1.0 + shift * spacing, until) for name, shift in (("raw", 0), ("shifted", 0.5))
    }
    rows, arrays = [], {"r": r.astype(np.float32)}
    for share, number in enumerate(numbers):
        made = Conductor(scheme, position * spacing, spacing, np.where(held, 0.0, 1.0), held=held)
        steps = max(1, round(until / (number * spacing**2)))
        made.run(until, steps)
        inner = made.temperature[~held]
        rows.append(
            {
                "number": until / steps / spacing**2, "particles": int((~held).sum()), "size": spacing,
                "seconds": made.seconds, **{name: 100 * rms(inner - values) for name, values in truth.items()},
            }
        )  # fmt: skip
        arrays[f"temperature_{number:g}"] = inner.astype(np.float32)
        context.progress((share + 1) / len(numbers))
    return Result({"scheme": scheme, "cells": cells, "rows": rows}, arrays)


# Stefan's problem with two phases


def stefan(context: Context, scheme: str, cells: int, numbers: tuple[float, ...], backend: str = "cpu") -> Result:
    """Ice of 1 m at -10 deg C beside a wall of particles held at 50: fronts [m] at 40 times to t = 0.1 s.

    The error is that of the melted depth, largest over the last three quarters of the time, over the depth: as it is,
    and measured from the first held layer, half a spacing behind the surface.
    """
    wide, layers, spacing, until = across(scheme), math.ceil(SUPPORT), 1.0 / cells, 0.1
    position = lattice((cells + layers, wide, wide), spacing) - [layers * spacing, 0.0, 0.0]
    held = position[:, 0] < 0
    period = (0.0, wide * spacing, wide * spacing)
    root = exact.stefan_root(WALL, START, LATENT)
    start = np.where(held, WALL, START)
    rows, arrays = [], {"x": position[:: wide * wide, 0]}
    for share, number in enumerate(numbers):
        made = Conductor(scheme, position, spacing, start, period=period, held=held, ice=(0.0, LATENT), backend=backend)
        steps = max(4, round(until / (number * spacing**2)))
        times, depth = until * np.arange(1, steps + 1) / steps, np.empty(steps)
        began, drift = made.heat(), math.nan
        for k in range(steps):
            made.step(until / steps)
            depth[k] = made.molten()[~held].sum() * spacing / wide**2
        truth, late = 2 * root * np.sqrt(times), times >= until / 4
        drift = made.heat() - began
        rows.append(
            {
                "number": until / steps / spacing**2, "size": spacing, "seconds": made.seconds,
                "raw": 100 * float((abs(depth - truth) / truth)[late].max()),
                "shifted": 100 * float((abs(depth + spacing / 2 - truth) / truth)[late].max()), "taken_up": drift,
                "highest": float(made.temperature.max()), "lowest": float(made.temperature.min()),
            }
        )  # fmt: skip
        arrays[f"time_{number:g}"], arrays[f"depth_{number:g}"] = times, depth
        arrays[f"temperature_{number:g}"] = made.temperature.reshape(cells + layers, -1).mean(1)
        context.progress((share + 1) / len(numbers))
    return Result({"scheme": scheme, "cells": cells, "root": root, "until": until, "rows": rows}, arrays)


# A sphere of ice that melts


def oracle(context: Context, cells: int = 400) -> Result:
    """The melting sphere in one dimension, and how near that program comes to what is known in two limits."""
    made = exact.melting_shell(0.0, 1.0, cells, WALL, START, LATENT, 0.6)
    context.progress(0.6)
    slow = exact.melting_shell(0.0, 1.0, 40, 0.02, 0.0, 1.0, 12.0)
    plane = exact.melting_shell(1e4, 1e4 + 1, cells // 2, WALL, START, LATENT, 0.1)
    root = exact.stefan_root(WALL, START, LATENT)
    half = exact.melting_shell(0.0, 1.0, cells // 2, WALL, START, LATENT, 0.6)
    return Result(
        {
            "melted": made.time[-1],
            "refinement": float(abs(half.at(made.time) - made.ice).max()),
            "quasi_steady": slow.time[-1] / exact.quasi_steady_melting_time(0.02, 1.0) - 1,
            "plane": (1 - plane.ice[-1]) / (2 * root * math.sqrt(plane.time[-1])) - 1,
        },
        {"time": made.time, "ice": made.ice},
    )


def melting_sphere(
    context: Context, scheme: str, cells: int, number: float, jitter: float = 0.0, backend: str = "cpu"
) -> Result:
    """A ball of ice of 1 m at -10 deg C, all beyond held at 50: radius of the ice [m] until a fifth is left.

    Against the one-dimensional program: with the surface where the particles end, and half a spacing further out. The
    error is the largest, over the first radius.
    """
    position, held = ball(cells, jitter)
    spacing = 1.0 / cells
    made = Conductor(
        scheme, position * spacing, spacing, np.where(held, WALL, START), held=held, ice=(0.0, LATENT),
        largest_number=1e9, backend=backend,
    )  # fmt: skip
    truth = exact.melting_shell(0.0, 1.0, 200, WALL, START, LATENT, 0.6)
    step = number * spacing**2
    steps, times, ice = math.ceil(0.8 / step), [0.0], [1.0]
    while ice[-1] > 0 and len(times) <= steps:
        made.step(step)
        times.append(len(times) * step)
        ice.append(1 - float(made.molten()[~held].mean()))
        context.progress(1 - ice[-1])
    at, radius = np.array(times), np.cbrt(np.clip(ice, 0, None))
    wider = 1 + spacing / 2  # lengths grow by this, times by its square
    raw = np.cbrt(truth.at(at))
    shifted = wider * np.cbrt(truth.at(at / wider**2))
    seen = (radius > 0.2) & (shifted < 1)
    melted = np.interp(0.0, -np.array(ice), at) if ice[-1] > 0 else at[-1]
    return Result(
        {
            "scheme": scheme, "cells": cells, "number": number, "particles": int((~held).sum()),
            "raw": 100 * float(abs(radius - raw)[seen].max()),
            "shifted": 100 * float(abs(radius - shifted)[seen].max()),
            "melted": float(melted), "melted_exactly": float(truth.time[-1]), "seconds": made.seconds,
        },
        {"time": at, "radius": radius, "raw": raw, "shifted": shifted},
    )  # fmt: skip


# What is kept, and what is never left


def melting_scene(scheme: str, dtype: str, **options: Any) -> Scene:
    """A block of ice on warm water, insulated, in steps of k dt/(rho c d^2) = 2: 1,000 particles."""
    spacing = 0.01
    water, ice = Box(cells=(10, 10, 5)), Box(cells=(10, 10, 5), lower=(0.0, 0.0, 5 * spacing))
    latent = {} if scheme in ("pair_exchange", "one_sided") else {"melting_point": 0.0, "latent_heat": 3.34e5}
    effect = HeatConduction(
        temperature=(60.0, -10.0), conductivity=(0.6, 2.2), heat_capacity=(4186.0, 2100.0), scheme=scheme,
        largest_number=100.0, largest_drift=0.0, **latent, **options,
    )  # fmt: skip
    step = 2.0 * spacing**2 * 1000.0 * 2100.0 / 2.2
    return Scene(
        spacing=spacing, support_radius=SUPPORT * spacing, fluid=(water, ice), effects=(effect,), step=step, dtype=dtype
    )


def ledger(context: Context, scheme: str, dtype: str, steps: int = 1000) -> Result:
    """Heat of the melting scene after so many steps, less that of the start, over the heat that could be moved.

    That is sum m c |T - T_mean| of the start, with latent heat sum m L more.
    """
    simulation = context.simulation(melting_scene(scheme, dtype), "cpu")
    simulation.evaluate()

    def now() -> float:
        return stock(simulation)["effects"]["heat_conduction"]["heat"]

    fields = {name: simulation.field(name).astype(float) for name in ("mass", "heat_capacity", "temperature")}
    capacity = fields["mass"] * fields["heat_capacity"]
    mean = np.average(fields["temperature"], weights=capacity)
    scale = float((capacity * abs(fields["temperature"] - mean)).sum())
    start, spread = now(), float(np.ptp(fields["temperature"]))
    melts = simulation.plan.effects["heat_conduction"].melts
    if melts:
        scale = max(scale, float((fields["mass"] * abs(simulation.field("enthalpy"))).sum()))
        molten = lambda: float((simulation.field("enthalpy") >= simulation.field("latent_heat")).mean())  # noqa: E731
        first = molten()
    drift = []
    for k in range(steps):
        simulation.step()
        if (k + 1) % (steps // 20) == 0:
            drift.append((now() - start) / scale)
            context.progress((k + 1) / steps)
    return Result(
        {
            "scheme": scheme, "dtype": dtype, "drift": drift[-1], "largest": float(np.abs(drift).max()),
            "spread": float(np.ptp(simulation.field("temperature"))) / spread,
            "melted": molten() - first if melts else 0.0,
        },
        {"drift": np.array(drift)},
    )  # fmt: skip


RANGE = (1.0, 1e2, 1e4, 3e6)


def ranges(context: Context, scheme: str, melts: bool) -> Result:
    """How far temperatures leave the range of the start, over it, in three steps of s_max up to 1e7.

    A jittered ball, one half 50 deg C and the other -10, conductivities 1000 : 1 from particle to particle.
    """
    position, _ = ball(5, 0.2)
    random = np.random.default_rng(3)
    start = np.where(position[:, 0] > 0, 50.0, -10.0)
    conductivity = random.choice([1.0, 1e-3], len(position))
    rows = []
    for number in RANGE:
        made = Conductor(
            scheme, position, 1.0, start, conductivity=conductivity, ice=(0.0, LATENT) if melts else None,
            largest_number=1e9,
        )  # fmt: skip
        beyond, began = 0.0, made.heat()
        for _ in range(3):
            made.step(number)
            beyond = max(beyond, float(made.temperature.max()) - 50.0, -10.0 - float(made.temperature.min()))
        drift = (made.heat() - began) / (60.0 * len(position))
        rows.append({"number": number, "beyond": beyond / 60.0, "drift": drift})
    return Result({"scheme": scheme, "melts": melts, "rows": rows})


# What a step costs


def speed(context: Context, threads: int, number: float = 2.0, rounds: int = 7) -> Result:
    """Median seconds of one step of every scheme on 60,800 jittered particles in float32, beside a density pass.

    All of them take turns over the same neighbours; building the list is not counted.
    """
    position = lattice((40, 40, 38), 1.0)
    position += np.random.default_rng(1).uniform(-0.1, 0.1, position.shape)
    start = np.where(position[:, 0] > 20, 50.0, -10.0)
    schemes = {name: {} for name in STEPS} | {"nonlinear_jacobi": {"ice": (0.0, LATENT)}}
    schemes |= {"runge_kutta_legendre with ice": {"ice": (0.0, LATENT)}}
    made = {
        name: Conductor(name.split()[0], position, 1.0, start, dtype="float32", **options)
        for name, options in schemes.items()
    }
    one = made["explicit"]
    liquid = WeaklyCompressible(rest_density=1.0, sound_speed=1.0)
    given = {**dict.fromkeys(("walls", "number_density", "asymmetry")), **one.given}
    given |= liquid.shares(one.grid, {liquid.name: liquid})
    given["density"] = np.empty(len(position), np.float32)
    operation = REGISTRY["sph.density"]
    program, names = operation.program("cpu"), operation.arguments("cpu")
    spent: dict[str, list[float]] = {"density": [], **{name: [] for name in made}}
    there = choose("cpu")
    set_threads(there, threads)
    try:
        for k in range(rounds + 1):  # the first round compiles
            began = time.perf_counter()
            program(*(given[name] for name in names))
            spent["density"].append(time.perf_counter() - began)
            for name, conductor in made.items():
                conductor.temperature[...] = start
                before = conductor.seconds
                conductor.step(number)
                spent[name].append(conductor.seconds - before)
            context.progress((k + 1) / (rounds + 1))
    finally:
        set_threads(there, None)
    median = {name: float(np.median(seconds[1:])) for name, seconds in spent.items()}
    ratio = {name: float(np.median(np.array(v[1:]) / np.array(spent["density"][1:]))) for name, v in spent.items()}
    passes = {name: conductor.passes(number) for name, conductor in made.items()}
    return Result({"particles": len(position), "threads": threads, "seconds": median, "ratio": ratio, "passes": passes})
