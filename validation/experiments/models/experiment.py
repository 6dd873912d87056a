"""The models of surface tension side by side (Jiang & Zhu, figures 3 and 6 and table 1; Dong, figure 1)."""

from __future__ import annotations

from validation.checks import Checks
from validation.experiment import Experiment, Options, Picture, Results, Run, measures
from validation.experiments.models import claims, pictures, runs, stability
from validation.experiments.models.scene import MODELS


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
    claims=measures(claims),
    trials=vars(stability),
    maps=stability.MAPS,
)
