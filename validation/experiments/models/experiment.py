"""The models of surface tension side by side (Jiang & Zhu, figures 3 and 6 and table 1; Dong, figure 1)."""

from __future__ import annotations

from typing import Any

from validation.checks import Checks
from validation.experiment import Experiment, Options, Picture, Results, Run, measures
from validation.experiments.droplet.experiment import COLUMNS, ENDS
from validation.experiments.models import claims, pictures, runs, stability
from validation.experiments.models.scene import MODELS
from validation.results import real
from validation.tables import Table


def planned(options: Options) -> list[Run]:
    """Every model from the cube of 17^3, and from the cube of 5,039 cut from a turned lattice."""
    reason = "takes minutes; run without --quick" if options.quick else ""
    made = []
    for shape, count in (("cube", 4913), ("cut", 5039)):
        for model in MODELS:
            parameters = {"model": model, "shape": shape, "count": count, "backend": options.backend}
            made.append(Run(f"{shape}_{model}", runs.relax, parameters, 20.0, reason, timed=True))
    return made


def checks(results: Results, check: Checks) -> None:
    """Shape, neighbours, rest and momenta of each model at its end; nothing is judged but shown."""
    for key, result in results.items():
        values, words = result.values, f"{result.values['words']}, {result.values['particles']:,} particles"
        for name in ("radius_variation", "nn_5", "kinetic_share", "momentum", "angular_momentum", "bulk_error"):
            check(name, values["end"][name], key, words)
        rest = values["rest"]
        check("rest_time", float("nan") if rest is None else rest["time"], key, words)
        check("rest_seconds", float("nan") if rest is None else rest["wall"], key, words)


def tables(results: Results) -> list[Table]:
    """Jiang & Zhu's table 1: seconds until a model is at rest by one criterion, and what it has come to by then."""
    made = []
    for shape in ("cube", "cut"):
        rows = []
        for name, model in MODELS.items():
            if f"{shape}_{name}" not in results:
                continue
            values = results[f"{shape}_{name}"].values
            rest, end = values["rest"], values["end"]
            cells: list[Any] = [model.words, None if model.paper is None else f"{model.paper:.1f}"]
            cells += (
                ["never", "-", "-"] if rest is None else [f"{rest['wall']:.1f}", rest["steps"], f"{rest['time']:.2f}"]
            )
            cells.append(f"{1e3 * real(values['series']['wall'][-1]) / max(1, values['series']['steps'][-1]):.2f}")
            cells += [None if end[column] is None else form.format(end[column]) for column, form in ENDS]
            rows.append([*cells, values["stopped"]])
        if rows:
            heading = [
                "model",
                "paper, s",
                "at rest after, s",
                "steps",
                "time",
                "ms a step",
                *(COLUMNS[c] for c, _ in ENDS),
                "stopped",
            ]
            note = "At rest: kinetic energy below 1e-3 of its peak from then on. The paper does not give its criterion."
            count = next(r.values["particles"] for key, r in results.items() if key.startswith(shape))
            made.append(Table(f"Table 1: from a cube of {count:,} particles to rest", heading, rows, note))
    return made


EXPERIMENT = Experiment(
    name="models",
    title="all models of surface tension: force curves, from a cube to a ball, seconds to rest",
    runs=planned,
    checks=checks,
    pictures=(
        Picture("figure_3_force_curves", pictures.curve_data, pictures.curve_picture),
        Picture("dong_figure_1", pictures.dong_data, pictures.dong_picture),
        Picture(
            "models_panel", pictures.panel_data, pictures.panel_picture, tuple(f"cube_{m}" for m in MODELS), shaded=True
        ),
        Picture(
            "models_panel_cut",
            pictures.cut_panel_data,
            pictures.panel_picture,
            tuple(f"cut_{m}" for m in MODELS),
            shaded=True,
        ),
        Picture(
            "models_table_1",
            pictures.rest_data,
            pictures.rest_picture,
            tuple(f"{shape}_{m}" for shape in pictures.SHAPES for m in MODELS),
        ),
    ),
    tables=tables,
    claims=measures(claims),
    trials=vars(stability),
    maps=stability.MAPS,
)
