"""Dong, Zhang & Chen 2016: figures 3 to 6 (figure 1 is drawn by `models`, table 1 stands in `dong_table_1`).

The paper's numbers cannot move its cube, and its step is too long for its falling block: both are shown, beside the
calibrated runs. Release height, the time between frames, sound speed and viscosity are this project's; see `scene.py`.
"""

from __future__ import annotations

from typing import Any

from validation.checks import Checks
from validation.experiment import Experiment, Options, Picture, Results, Run, measures
from validation.experiments.dong import claims, pictures, runs
from validation.experiments.dong import scene as scenes
from validation.results import real

TERMS = {"both": (True, True), "cohesion": (True, False), "correction": (False, True), "neither": (False, False)}
WORDS = {"both": "both terms", "cohesion": "cohesion alone", "correction": "correction alone", "neither": "no tension"}
ARMS = {"with": True, "without": False}
OWN = {"solver": "hu_adams"}  # D(3) to D(5) in place of the shared liquid
SMALL = 1331  # particles of the cube that both solvers round, at any size of the experiment
SOLVERS = {"shared": "shared liquid", "own": "D(3) to D(5)"}
LATE = tuple(sorted({*scenes.LATER, *pictures.MERGING, *range(100, pictures.REST + 1, 20)}))


def planned(options: Options) -> list[Run]:
    """The runs under the options."""
    reason = "takes minutes; run without --quick" if options.quick else ""
    backend = {"backend": options.backend}
    made = [Run("cube_4913", runs.cube, {"shape": "cube", "count": 4913, **backend}, 40.0, reason)]
    for name, (cohesion, correction) in TERMS.items():
        parameters = {"side": 17, "cohesion": cohesion, "correction": correction, "steps": 400, **backend}
        made.append(Run(f"printed_{name}", runs.printed, parameters, 8.0, reason))
    made.append(Run("printed_limits", runs.printed_limits, backend, 3.0, reason))
    for arm, tension in ARMS.items():
        frames = sorted({*scenes.FRAMES, *(scenes.LATER if options.quick else LATE)})
        parameters = {"tension": tension, "frames": frames, **backend}
        key, estimate = ("fall", 2.0) if options.quick else ("rest", 40.0)
        made.append(Run(f"{key}_{arm}", runs.fall, parameters, estimate))
        made.append(Run(f"own_{key}_{arm}", runs.fall, {**parameters, **OWN}, 2 * estimate))
    small = {"shape": "cube", "count": SMALL, **backend}
    for name, changes in (("shared", {}), ("own", OWN)):
        made.append(Run(f"{name}_cube_{SMALL}", runs.cube, {**small, "changes": changes}, 10.0))
    made.append(
        Run("own_cube_4913", runs.cube, {"shape": "cube", "count": 4913, "changes": OWN, **backend}, 60.0, reason)
    )
    for key, pair in runs.sweep_pairs().items():
        made.append(Run(key, runs.sweep, {**pair, **backend}, 3.0, reason))
    return made


def blocks(results: Results, solver: str = "") -> dict[str, list[dict[str, Any]]]:
    """What lies on the floor, frame by frame, of both arms: until they rest, or the quick runs; empty without them.

    solver  "own_" for the runs with D(3) to D(5)
    """
    for key in (f"{solver}rest", f"{solver}fall"):
        if {f"{key}_{arm}" for arm in ARMS} <= set(results):
            return {arm: results[f"{key}_{arm}"].values["rows"] for arm in ARMS}
    return {}


def checks(results: Results, check: Checks) -> None:
    """Octahedron and ball, the printed settings, droplets against net, drop against layer."""
    if "cube_4913" in results:
        values = results["cube_4913"].values
        top = max(values["series"]["moment"])
        k = values["series"]["moment"].index(top)
        check("octahedron", top)
        check("points_over_corners", values["series"]["points"][k] / values["series"]["corners"][k])
        rayleigh = runs.rayleigh_period(scenes.TENSION, values["radius"])
        check("period", values["oscillation"]["period"])
        ratio = real(values["oscillation"]["free"]) / rayleigh
        check("period_over_rayleigh", ratio)
        check("period_off_rayleigh", abs(ratio - 1))
        check("roundness", values["series"]["radius_variation"][-1])
        check("swing", values["swing_late"])
    for name in TERMS:
        if f"printed_{name}" in results:
            series = results[f"printed_{name}"].values["series"]
            rule = "printed_moved" if name == "cohesion" else "printed_moved_shown"
            check(rule, series["moved"][-1], name, WORDS[name])
            if name == "both":
                check("printed_shape", abs(1 - series["moment"][-1] / series["moment"][0]))
    if "printed_limits" in results:
        values = results["printed_limits"].values
        check("printed_step", values["step"] / values["limit"])
        check("printed_refused", float(bool(values["refused"])))
        check("printed_compression", values["soft"])
    for key in (*(f"{name}_cube_{SMALL}" for name in SOLVERS), "own_cube_4913"):
        if key in results:
            values = results[key].values
            words = f"cube of {values['particles']:,}, {SOLVERS[key.partition('_')[0]]}"
            check("solver_octahedron", max(values["series"]["moment"]), key, words)
            check("solver_roundness", values["series"]["radius_variation"][-1], key, words)
            check("solver_swing", values["swing_late"], key, words)
    for arm, rows in blocks(results, "own_").items():
        for row in rows:
            if row["frame"] in (*scenes.FRAMES, *scenes.LATER, pictures.REST):
                words = f"frame {row['frame']}, {arm} tension, D(3) to D(5)"
                for name in ("parts", "lone", "holes"):
                    check(name, row[name], f"own_{row['frame']}_{arm}", words)
                if row["frame"] == pictures.REST:
                    check("solver_layers", row["layers"], f"own_{arm}", words)
    landed = blocks(results)
    if landed:
        at = {arm: {row["frame"]: row for row in rows} for arm, rows in landed.items()}
        for frame in (*scenes.FRAMES, *scenes.LATER):
            both = {arm: at[arm][frame] for arm in ARMS}
            for name in ("parts", "lone", "holes"):
                for arm in ARMS:
                    check(name, both[arm][name], f"{frame}_{arm}", f"frame {frame}, {arm} tension")
        if pictures.REST in at["with"]:
            check("layers_with", at["with"][pictures.REST]["layers"])
            check("layers_without", at["without"][pictures.REST]["layers"])
            check("parts_at_rest", at["with"][pictures.REST]["parts"])
            check("largest_at_rest", at["with"][pictures.REST]["largest"])


EXPERIMENT = Experiment(
    name="dong",
    title="Dong 2016: cube through octahedron to ball, a block that falls with and without tension",
    runs=planned,
    checks=checks,
    pictures=(
        Picture("dong_figure_3", pictures.cube_data, pictures.cube_picture, ("cube_4913",), shaded=True),
        Picture(
            "dong_figure_4", pictures.splash_data, pictures.splash_picture, ("rest_with", "rest_without"), shaded=True
        ),
        Picture("dong_fall", pictures.splash_data, pictures.splash_picture, ("fall_with", "fall_without"), shaded=True),
        Picture("dong_figure_5", pictures.rest_data, pictures.rest_picture, ("rest_with", "rest_without")),
        Picture("dong_sweep", pictures.sweep_data, pictures.sweep_picture, tuple(runs.sweep_pairs())),
        Picture("dong_figure_6", pictures.merging_data, pictures.merging_picture, ("rest_with",), shaded=True),
    ),
    claims=measures(claims),
)
