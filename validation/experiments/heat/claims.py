"""What the paper on melting claims of its conduction of heat, equation (4), measured on a cosine in a slab.

Read literally (R1: each particle by itself) and as it keeps the heat (R3: both particles of a pair). K of the figures
is read in hundredths of a m^2/s, as in the scenes of melting (`validation.experiments.melting.scene.SCALE`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from refsim.heat import kernels, pair_exchange
from validation.experiment import Family, Measure, Options, Results, Run, alike
from validation.experiments.heat import exact
from validation.experiments.heat.conductor import Conductor, cosine_slab
from validation.experiments.melting.scene import SCALE
from validation.experiments.melting.scene import STEP as PAPER_STEP
from validation.results import Result, real
from validation.running import Context

CELLS, ACROSS, SPACING, UNTIL = 20, 10, 0.2, 1.6  # [1], [1], [m], [s]
LARGE = (1.0, 2.0, 4.0, 8.75, 35.0)  # k dt/(rho c d^2) of steps that are long for an explicit scheme
NUMBERS = (2.0, 3.0, 4.0, 6.0, 8.75)  # k dt/(rho c d^2) of long steps; the paper's are 100 times smaller
SEEDS = (1, 2, 3, 4, 5)
PASSES = (1, 2, 4, 8)


def column(scheme: str, seed: int | None = None) -> tuple[Conductor, np.ndarray]:
    """The slab of all claims, and the depth of its particles [m]."""
    return cosine_slab(scheme, CELLS, ACROSS, SPACING, seed)


def swept(made: Conductor, order: Any, seconds: float, passes: int, reverse: bool) -> None:
    """One step of M(4) in so many passes of equal parts; every second one backwards, or none.

    order  of the pairs, from `pair_exchange.colours`
    """
    t, conduction = made.temperature, made.conduction._replace(sweep_share=np.float64(1 / passes))
    if made.scheme == "one_sided":
        exchanges, inverse, _, _ = made.weighed(seconds / passes)
        for k in range(passes):
            kernels.sweep(exchanges, inverse, conduction, np.int32(reverse and k % 2), t.copy(), t)
        return
    given = {**made.given, "timestep": np.array([0.0, seconds])}
    inverse = 1.0 / (given["mass"] * given["heat_capacity"])
    members, first, colours = order
    cells, ends = pair_exchange.joined(colours)
    for k in range(passes):
        pair_exchange.exchange_colours(
            cells, ends, members, first, np.int32(reverse and k % 2), given["position"], given["volume"],
            given["conductivity"], inverse, given["timestep"], conduction, given["period"], t,
        )  # fmt: skip


def reversal(context: Context, scheme: str, number: float) -> Result:
    """rms error [% of the range] after 1, 2, 4 and 8 passes a step, all forward, and every second one backwards."""
    steps = max(1, round(UNTIL / (number * SPACING**2)))
    found: dict[str, list[float]] = {"forward": [], "reversed": []}
    for words, reverse in (("forward", False), ("reversed", True)):
        for passes in PASSES:
            made, x = column(scheme)
            order = pair_exchange.colours(np, made.given["position"], made.conduction, made.given["period"])
            for _ in range(steps):
                swept(made, order, UNTIL / steps, passes, reverse)
            error = made.temperature - exact.cosine(x, CELLS * SPACING, UNTIL)
            found[words].append(float(np.sqrt((error**2).mean())))
        context.progress(0.5)
    return Result({"passes": PASSES, **found})


def long_steps(context: Context, scheme: str, number: float) -> Result:
    """How far 20 steps on a jump leave the range of the start, over it; 1e6 where they blow up."""
    made, x = column(scheme)
    made.temperature[...] = np.where(x > CELLS * SPACING / 2, 100.0, 0.0)
    beyond = 0.0
    for _ in range(20):
        made.step(number * SPACING**2)
        beyond = max(beyond, float(made.temperature.max()) / 100 - 1, -float(made.temperature.min()) / 100)
    return Result({"beyond": min(beyond, 1e6) if math.isfinite(beyond) else 1e6})


def numbering(context: Context, scheme: str, seed: int, number: float = 2.0) -> Result:
    """rms difference [% of the range] of a slab whose particles are numbered otherwise."""
    steps, found = round(UNTIL / (number * SPACING**2)), []
    for own in (None, seed):
        made, x = column(scheme, own)
        made.run(UNTIL, steps)
        depth = np.rint(x / SPACING - 0.5).astype(int)
        found.append(np.bincount(depth, made.temperature) / np.bincount(depth))
    return Result({"difference": float(np.sqrt(((found[0] - found[1]) ** 2).mean()))})


def delivered(context: Context, scheme: str, seed: int | None = None) -> Result:
    """Diffusivity that the cosine's decay shows, over that of the particles, for K of figures 4 to 6.

    d = 0.2, h = 0.5, dt = 0.005 as in table 1; the printed form conducts with 2 K (Shao & Song M6), so that K stands
    for a number of 2 K dt/d^2. With a `seed` the particles are numbered otherwise.
    """
    rows = []
    for diffusivity in (SCALE * k for k in (10.0, 30.0, 50.0, 70.0)):
        number, steps = 2 * diffusivity * PAPER_STEP / SPACING**2, 8
        made, x = column(scheme, seed)
        seconds = number * SPACING**2
        made.run(steps * seconds, steps)
        mode = np.cos(math.pi * x / (CELLS * SPACING))
        left = float((made.temperature - 50) @ mode / (50 * mode @ mode))
        rate = -math.log(left) / ((math.pi / (CELLS * SPACING)) ** 2 * steps * seconds)
        rows.append({"K": diffusivity, "delivered": rate * 2 * diffusivity})
    return Result({"rows": rows})


def _runs(
    key: str, function: Callable[..., Result], parameters: list[dict[str, Any]]
) -> Callable[[Options], list[Run]]:
    def made(options: Options) -> list[Run]:
        return [Run(f"claim_{key}_{k}", function, given, estimate=20.0) for k, given in enumerate(parameters)]

    return made


def _each(value: Callable[[Result], float]) -> Callable[[Results], list[float]]:
    return lambda results: [value(result) for result in results.values()]


def _ratio(passes: int) -> Callable[[Results], list[float]]:
    at = PASSES.index(passes)
    return _each(lambda result: real(result.values["reversed"][at]) / real(result.values["forward"][at]))


def _reversals(scheme: str) -> Callable[[Options], list[Run]]:
    return _runs(f"reversal_{scheme}", reversal, [{"scheme": scheme, "number": number} for number in NUMBERS])


HEAT_REVERSED_PAIRS_2 = Measure(_reversals("pair_exchange"), _ratio(2))
HEAT_REVERSED_PAIRS_4 = Measure(_reversals("pair_exchange"), _ratio(4))
HEAT_REVERSED_PAIRS_8 = Measure(_reversals("pair_exchange"), _ratio(8))
HEAT_REVERSED_SINGLE_2 = Measure(_reversals("one_sided"), _ratio(2))
HEAT_REVERSED_SINGLE_4 = Measure(_reversals("one_sided"), _ratio(4))
HEAT_REVERSED_SINGLE_8 = Measure(_reversals("one_sided"), _ratio(8))
HEAT_LONG_STEPS_HOLD = Measure(
    _runs("long", long_steps, [
        {"scheme": scheme, "number": number} for scheme in ("one_sided", "pair_exchange") for number in (8.75, 1e3, 3e6)
    ]),
    _each(lambda result: real(result.values["beyond"])),
)  # fmt: skip
HEAT_EXPLICIT_BREAKS = Measure(
    _runs("explicit", long_steps, [{"scheme": "explicit", "number": number} for number in LARGE]),
    _each(lambda result: real(result.values["beyond"])),
)
HEAT_ORDER_MATTERS = Measure(
    _runs("order", numbering, [{"scheme": "one_sided", "seed": seed} for seed in SEEDS]),
    _each(lambda result: real(result.values["difference"])),
)


def _material(scheme: str) -> Measure:
    """Diffusivity that K = 70 delivers over that of K = 10, over seven, for five numberings."""
    return Measure(
        _runs(f"material_{scheme}", delivered, [{"scheme": scheme, "seed": seed} for seed in SEEDS]),
        _each(lambda r: real(r.values["rows"][-1]["delivered"]) / real(r.values["rows"][0]["delivered"]) / 7),
    )


HEAT_MATERIAL_COUNTS_SINGLE = _material("one_sided")
HEAT_MATERIAL_COUNTS_PAIRS = _material("pair_exchange")

# Null models


def _other_scheme(scheme: str, number: float) -> Callable[[Measure], list[float]]:
    """What another scheme does with a long step on the same jump."""

    def model(measure: Measure) -> list[float]:
        return measure.of({"": dict(long_steps(Context(), scheme, number).values)})

    return model


def _same_numbering(measure: Measure) -> list[float]:
    """Explicit conduction, which takes all temperatures of the step before."""
    return measure.of({"": dict(numbering(Context(), "explicit", 1, 0.1).values)})


FAMILIES = (
    Family(
        tuple(f"heat_reversed_{way}_{passes}" for way in ("single", "pairs") for passes in (2, 4, 8)),
        "Passes backwards could leave the same error as passes forwards.", "both leave the same error",
        alike({"forward": [0.5] * 4, "reversed": [0.5] * 4}),
    ),
    Family(
        ("heat_long_steps_hold",), "Temperatures could leave the range of the start.",
        "the explicit scheme with k dt/(rho c d^2) = 8.75", _other_scheme("explicit", 8.75),
    ),
    Family(
        ("heat_explicit_breaks",), "The explicit scheme could keep the range at long steps.",
        "the implicit scheme R3 with k dt/(rho c d^2) = 8.75", _other_scheme("pair_exchange", 8.75),
    ),
    Family(
        ("heat_order_matters",), "The numbering of particles could be without effect.",
        "explicit conduction, whose sums do not depend on it", _same_numbering,
    ),
    Family(
        ("heat_material_counts_single", "heat_material_counts_pairs"), "All materials could conduct alike.",
        "every K delivers the same", alike({"rows": [{"delivered": 1.0}] * 4}),
    ),
)  # fmt: skip
