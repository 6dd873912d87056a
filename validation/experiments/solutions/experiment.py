"""The base SPH liquid held against solutions of its equations, at three spacings each."""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Sequence
from typing import Any

from validation.checks import Checks
from validation.experiment import Experiment, Options, Picture, Results, Run
from validation.experiments.solutions import pictures, runs, tension, terms
from validation.results import Result

FORMS = ("laplacian", "central")
CELLS = {
    "tank": (20, 40, 80),
    "wave": (10, 20, 40),
    "ellipse": (10, 20, 40),
    "disc": (10, 20, 40),
    "vortex": (20, 40, 80),
    "vortices": (20, 40, 80),
    "couette": (12, 24, 48),
    "poiseuille": (12, 24, 48),
    "capillary": (12, 24, 48),
    "drop": (6, 12, 24),
    "meniscus": (4, 8, 12),
    "jurin": (8, 12, 16),
}
WITH_FORMS = dict.fromkeys(("wave", "disc", "vortex", "vortices", "couette", "poiseuille", "drop"), FORMS)
WITH_FORMS["meniscus"] = ("70", "110")  # [degrees]
JUDGED = {  # quantities by problem: those with a measured order, and those that are judged at the smallest spacing
    "tank": ("error", "bulk"),
    "wave": ("period_off", "decay_off"),
    "ellipse": ("error", "period_off"),
    "disc": ("rate_off",),
    "vortex": ("rate_off", "error"),
    "vortices": ("rate_off", "error"),
    "couette": ("error", "steady"),
    "poiseuille": ("error", "steady"),
    "capillary": ("crest_off", "error", "side"),
    "drop": ("rate_off",),
    "meniscus": ("lifted_off",),
    "jurin": ("risen_off",),
}
ORDERED = {
    "tank": "error",
    "ellipse": "error",
    "couette": "steady",
}  # whose order is judged: surfaces are of first order in the spacing
VARIED: dict[str, tuple[Callable[..., Result], dict[str, Any], tuple[str, ...]]] = {  # run, parameters, quantities
    "varied_crest_0.005": (runs.wave, {"cells": 20, "form": "central", "crest": 0.005}, ("period", "decay")),
    "varied_crest_0.06": (runs.wave, {"cells": 20, "form": "central", "crest": 0.06}, ("period", "decay")),
    "varied_creeping_laplacian": (runs.vortices, {"cells": 40, "form": "laplacian", "reynolds": 0.5}, ("rate",)),
    "varied_creeping_central": (runs.vortices, {"cells": 40, "form": "central", "reynolds": 0.5}, ("rate",)),
    "varied_mu_laplacian": (runs.couette, {"cells": 24, "form": "laplacian", "friction": 1.0}, ("steady",)),
    "varied_mach_0.05": (runs.ellipse, {"cells": 20, "mach": 0.05}, ("error", "period")),
}
PEER = {"side": 12, "seed": 1}  # of every comparison of terms
SECONDS = 5e-6  # of a particle in a step, for the progress bar


def planned(options: Options) -> list[Run]:
    """Every problem at three spacings, with both viscosities where they differ; with --quick a tank of 50 particles."""
    if options.quick:
        return [_run("tank", 10, "", options.backend)]
    varied = [
        Run(key, function, {**parameters, "backend": options.backend}, estimate=10.0)
        for key, (function, parameters, _) in VARIED.items()
    ]
    return [*_solved(options.backend), *varied, *_compared(options)]


def _solved(backend: str) -> list[Run]:
    return [
        _run(problem, cells, form, backend)
        for problem, sizes in CELLS.items()
        for form in WITH_FORMS.get(problem, ("",))
        for cells in sizes
    ]


def _compared(options: Options) -> list[Run]:
    """Terms beside those of every other program, where it is installed."""
    without = "" if options.peers else "measured with --peers"
    return [
        Run(f"terms_{program}", compare, PEER, skip=without or terms.PEERS[program].missing())
        for program, compare in terms.COMPARED.items()
    ]


def _run(problem: str, cells: int, form: str, backend: str) -> Run:
    parameters: dict[str, Any] = {"cells": cells, "backend": backend}
    if form:
        parameters |= {"angle": float(form)} if problem == "meniscus" else {"form": form}
    key = "_".join(filter(None, (problem, form, str(cells))))
    tense = problem == "jurin" or problem in pictures.WITH_TENSION
    return Run(
        key, getattr(tension if tense else runs, problem), parameters,
        estimate=5.0 * (cells / 12) ** 3 if tense else SECONDS * 200 * cells**3,
    )  # fmt: skip


def series(results: Results) -> dict[str, dict[str, list[float]]]:
    """Spacings and quantities of every problem (with its viscosity), from the largest spacing to the smallest."""
    found: dict[str, dict[str, list[float]]] = {}
    for key, result in results.items():
        if key.startswith("terms_") or key in VARIED:
            continue
        one = found.setdefault(key.rpartition("_")[0], {})
        for name, value in result.values.items():
            if isinstance(value, float):
                one.setdefault(name, []).append(value)
    return found


def order(spacing: Sequence[float], error: Sequence[float]) -> float:
    """Exponent p of error ~ spacing^p between the largest and the smallest spacing; NaN from one spacing alone."""
    if len(spacing) < 2:
        return math.nan
    return math.log(error[0] / error[-1]) / math.log(spacing[0] / spacing[-1])


def checks(results: Results, check: Checks) -> None:
    """Errors at the smallest spacing, and orders between the largest and the smallest."""
    for name, one in series(results).items():
        problem, _, form = name.partition("_")
        cells = len(one["spacing"])
        for quantity in JUDGED[problem]:
            if quantity not in one:
                continue
            if cells == len(CELLS[problem]):
                check(f"{problem}_{quantity}", one[quantity][-1], form)
                rule = "order" if ORDERED.get(problem) == quantity else "order_shown"
                if quantity != "side":  # no error
                    check(rule, order(one["spacing"], one[quantity]), f"{name}.{quantity}")
        if name in ("disc_central", "drop_central"):
            for value, size in zip(one["error"], one["spacing"]):
                check(f"{problem}_kept", value, f"{1 / size:.0f}", f"R = {1 / size:.0f} d")
        if problem == "tank":
            for value, size in zip(one["error"], one["spacing"]):
                check(
                    "tank_any", value * runs.HEIGHT / (runs.SUPPORT * size), f"{1 / size:.0f}", f"H = {1 / size:.0f} d"
                )

    for key, (_, _, quantities) in VARIED.items():
        for quantity in quantities if key in results else ():
            check(f"varied_{quantity}", results[key].values[quantity], key.removeprefix("varied_"))
    for program, names in terms.TERMS.items():
        if f"terms_{program}" not in results:
            continue
        values = results[f"terms_{program}"].values
        precise = "_double" if program in terms.DOUBLE else ""
        for term in names:
            equal = term in terms.EQUAL[program]
            check(f"peer_equal{precise}" if equal else "peer", values[term], f"{program}.{term}")
            check(f"peer_explained{precise}", values[f"{term}.explained"], f"{program}.{term}")


def _behind(titles: Container[str]) -> tuple[str, ...]:
    """Keys of the runs of some problems."""
    return tuple(run.key for run in _solved("cpu") if run.key.partition("_")[0] in titles)


EXPERIMENT = Experiment(
    name="solutions",
    title="the base SPH liquid against solutions: tank, waves, ellipse, spin-down, Taylor-Green, plates, meniscus",
    runs=planned,
    checks=checks,
    pictures=(
        Picture("solutions", pictures.collect, pictures.draw, _behind(pictures.TITLES)),
        Picture(
            "solutions_periodic",
            pictures.collect_periodic,
            pictures.draw_periodic,
            _behind(pictures.PERIODIC),
        ),
        Picture(
            "solutions_tension",
            pictures.collect_with_tension,
            pictures.draw_with_tension,
            _behind(pictures.WITH_TENSION),
        ),
    ),
)
