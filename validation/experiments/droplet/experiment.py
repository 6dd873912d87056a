"""A cube of liquid without gravity becomes a drop (figures 2, 6 and 7).

The settings are this project's (Jiang & Zhu E17): the paper gives no surface tension, stiffness, viscosity, step or
side. They stand in `scene.py`, in one place.
"""

from __future__ import annotations

from validation.checks import Checks
from validation.experiment import Experiment, Options, Picture, Results, Run, measures
from validation.experiments.droplet import claims, pictures, runs, stability
from validation.experiments.droplet.scene import VARIANTS
from validation.results import Result, real

SHAPES = {
    "cube_4913": ("cube", 4913, "cube of 17^3"),
    "cut_5039": ("cut", 5039, "cube of 5,039"),
    "box_4862": ("box", 4913, "turned box"),
}

COLUMNS = {
    "radius_variation": "radius variation", "nn_min": "NN min", "nn_5": "NN 5 %", "bulk_error": "bulk density",
    "kinetic_share": "KE end/peak", "momentum": "P", "angular_momentum": "L",
}  # fmt: skip
SEEDS = (2, 3, 4, 5)  # of other rotations, beside the seed 1 that is judged


def planned(options: Options) -> list[Run]:
    """The runs under the options."""
    reason = "takes minutes with the others; run without --quick" if options.quick else ""
    made = []
    for key, (shape, count, _) in SHAPES.items():
        parameters = {"shape": shape, "count": count, "backend": options.backend}
        made.append(Run(key, runs.relax, parameters, estimate=12.0, skip=reason if shape != "cube" else ""))
    for shape, count in (("cut", 5039), ("box", 4913)):
        for seed in SEEDS:
            parameters = {"shape": shape, "count": count, "backend": options.backend, "seed": seed}
            made.append(Run(f"seed_{shape}_{seed}", runs.relax, parameters, estimate=14.0, skip=reason))
    for variant in VARIANTS:
        if variant != "default":
            parameters = {"shape": "cube", "count": 4913, "backend": options.backend, "variant": variant}
            made.append(Run(f"mode_{variant}", runs.relax, parameters, estimate=16.0, skip=reason))
    return made


def checks(results: Results, check: Checks) -> None:
    """The verdicts on the default model from every start."""
    for key, (_, _, words) in SHAPES.items():
        if key not in results:
            continue
        values = results[key].values
        end = {name: real(value) for name, value in values["end"].items()}
        for name in ("radius_variation", "nn_5", "nn_min", "kinetic_share", "momentum", "angular_momentum"):
            check(name, end[name], key, words)
        check("bulk_error", abs(end["bulk_error"]), key, words)
        check("sphericity", end["sphericity"], key, words)
        steady = values["steady"]
        time = float("nan") if steady is None else steady["time"] / values["capillary_time"]
        check("steady_time", time, key, words)
        check("rebuilds", values["search"].get("rebuilds", 0), key, words)
        check("missed_neighbours", values["search"].get("missed_neighbours", 0), key, words)
    for shape in ("cube", "ball"):
        key = next((k for k in SHAPES if k in results), None)
        if key is not None:
            lattice = real(results[key].values["lattice"][shape])
            check("lattice_variation", lattice, shape, f"lattice {shape}")
    for key, name in (("mode_text", "text_energy"), ("mode_one_sided", "one_sided_momentum")):
        if key in results:
            part = "kinetic_share" if name == "text_energy" else "momentum"
            check(name, results[key].values["end"][part])


def outcome(result: Result) -> str:
    """What became of a drop, in words."""
    values = result.values
    end = {name: real(value) for name, value in values["end"].items()}
    if values["stopped"]:
        return f"stopped: {values['stopped']}"
    said = []
    if not end["extent"] < 1.6:
        said.append("flies apart")
    elif end["radius_variation"] <= runs.ROUND:
        said.append("round")
    else:
        said.append("nearly round" if end["radius_variation"] <= 0.02 else "not round")
    said.append("at rest" if end["kinetic_share"] <= runs.CALM else "not at rest")
    if end["momentum"] > 1e-4:
        said.append("drifts")
    return ", ".join(said)


EXPERIMENT = Experiment(
    name="droplet",
    title="a cube of liquid becomes a drop (figures 2, 6 and 7), every pair mode and the literal text beside it",
    runs=planned,
    checks=checks,
    pictures=(
        Picture("figure_2_force_curve", pictures.force_data, pictures.force_picture),
        Picture("figure_6", pictures.frame_data, pictures.frame_picture, ("cube_4913",), shaded=True),
        Picture("figure_7", pictures.surface_data, pictures.surface_picture_of, ("cube_4913",)),
    ),
    claims=measures(claims),
    trials=vars(stability),
    maps=stability.MAPS,
)
