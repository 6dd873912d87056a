"""Liquid at meshes: what is run, what must hold, tables and pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from validation.checks import Checks
from validation.experiment import Options, Picture, Results, Run
from validation.experiments.boundary import flow_pictures, flow_runs
from validation.experiments.boundary.flow_runs import ARMS, POUR
from validation.results import real
from validation.tables import Table

RAINED = ("sphere", "torus", "cube", "needle", "plate", "funnel", "pebble")
CORRECTIONS = {"none": "no correction", "point": "where the step ends", "swept": "swept"}
SHARES = (0.5, 1.0, 1.55)  # of the runner's step, which 1 stands for; it refuses fixed steps over 1.6
GAMMAS = (0.02, 0.1, 0.4)
QUICK_RAIN, QUICK_POUR = 640, 0.1  # particles; simulated seconds


def planned(options: Options) -> list[Run]:
    """The runs under the options; the quick ones are one rain, one pour and the drops."""
    reason = "takes minutes; run without --quick" if options.quick else ""
    backend = {"backend": options.backend}
    made = []
    for shape in RAINED:
        for correction in CORRECTIONS:
            for share in SHARES if correction != "point" else (1.0, 1.55):
                parameters = {"shape": shape, "correction": correction, "share": share, **backend}
                kept = shape == "sphere" and correction == "swept" and share == 1
                if options.quick:
                    parameters["count"] = QUICK_RAIN
                key = f"flow_rain_{shape}_{correction}_{share:g}"
                made.append(Run(key, flow_runs.rain, parameters, 5.0, "" if kept else reason))
    for shape in POUR:
        for arm in ARMS:
            parameters = {"shape": shape, "arm": arm, **backend}
            kept = shape == "sphere" and arm == "difference"
            if options.quick:
                parameters["seconds"] = QUICK_POUR
            made.append(Run(f"flow_pour_{shape}_{arm}", flow_runs.pour, parameters, 8.0, "" if kept else reason))
    made.append(Run("flow_tank", flow_runs.resting_tank, {"steps": 10_000, **backend}, 100.0, reason))
    for everywhere in (False, True):
        parameters = {"everywhere": everywhere, **backend}
        made.append(Run(f"flow_marked_{int(everywhere)}", flow_runs.marked_cost, parameters, 9.0, reason))
    for gamma in GAMMAS:
        parameters = {"gamma": gamma, "count": 257 if options.quick else 515, **backend}
        kept = gamma == GAMMAS[1]
        made.append(Run(f"flow_sigma_{gamma:g}", flow_runs.own_tension, parameters, 6.0, "" if kept else reason))
    made.append(Run("flow_bound", flow_runs.own_bound, {"gamma": 1.0, **backend}, 30.0, reason))
    return made


def checks(results: Results, check: Checks) -> None:
    """No leaks at the runner's own step, the tank at rest, and what is shown of the rest."""
    for shape in RAINED:
        key = f"flow_rain_{shape}_swept_1"
        if key in results:
            check("rain_leaks", results[key].values["ever_inside"], shape)
        for correction in ("none", "swept"):
            runs = {share: results.get(f"flow_rain_{shape}_{correction}_{share:g}") for share in SHARES}
            if all(runs.values()):
                largest = max([s for s, r in runs.items() if r and not r.values["ever_inside"]], default=0.0)
                check(f"rain_step_{correction}", largest, shape)
    if "flow_tank" in results:
        values = results["flow_tank"].values
        check("tank_lost", values["lost"] + values["inside"])
        check("tank_pressure", abs(real(values["pressure_error"])))
        check("tank_everywhere", abs(real(values["pressure_everywhere"])))
        check("tank_gradient", values["gradient_error"])
        check("tank_force", abs(real(values["force_error"])))
        check("tank_noise", values["force_noise"])
    for gamma in GAMMAS:
        key = f"flow_sigma_{gamma:g}"
        if key in results:
            density = real(results[key].values["core_density"])
            check("own_density", density, f"{gamma:g}", f"gamma = {gamma:g} m/s^2")
            check("own_sigma", results[key].values["sigma"], f"{gamma:g}", f"gamma = {gamma:g} m/s^2")
    if "flow_bound" in results:
        values = results["flow_bound"].values
        check("own_bound", real(values["largest_step"]) / real(values["predicted"]))
    for shape in POUR:
        keys = [f"flow_pour_{shape}_{arm}" for arm in ARMS]
        for key, arm in zip(keys, ARMS):
            if key in results:
                check("pour_leaks", results[key].values["inside"], f"{shape}_{arm}")
    if {"flow_marked_0", "flow_marked_1"} <= set(results):
        ratio = real(results["flow_marked_1"].values["seconds"]) / real(results["flow_marked_0"].values["seconds"])
        check("marked_cost", ratio)


def tables(results: Results) -> list[Table]:
    """Penetrations over the step, and what becomes of the poured liquid."""
    made = []
    rows = []
    for shape in RAINED:
        for correction, words in CORRECTIONS.items():
            own = {s: results.get(f"flow_rain_{shape}_{correction}_{s:g}") for s in SHARES}
            if any(own.values()):
                rows.append([shape, words, *(_rained(r.values) if r else "-" for r in own.values())])
    if rows:
        heading = ["shape", "correction", *("own step" if s == 1 else f"dt x {s:g}" for s in SHARES)]
        note = "Of 2,560 particles: found inside after any step (inside at the end), greatest depth in spacings."
        made.append(Table("Rain on solids: particles inside", heading, rows, note))
    rows = []
    for gamma in GAMMAS:
        if f"flow_sigma_{gamma:g}" in results:
            v = results[f"flow_sigma_{gamma:g}"].values
            rows.append([gamma, v["particles"], v["core_density"], v["pressure"], v["sigma"], v["extent"]])
    if rows:
        heading = ["gamma m/s^2", "particles", "density in the middle", "pressure Pa", "p R/2 N/m", "extent/R"]
        note = "Patent P7 alone, 0.2 s. A tension would hold the drop: density 1 or more, extent near 1."
        made.append(Table("A drop under the normal difference alone", heading, rows, note))
    rows = []
    for shape in POUR:
        for arm, words in ARMS.items():
            result = results.get(f"flow_pour_{shape}_{arm}")
            if result:
                end, middle = result.values["frames"][-1], result.values["frames"][2]
                parts = [middle["components"], middle["holes"], end["components"], end["lone"], end["holes"]]
                rows.append([shape, words, *parts, f"{end['nearest_5']:.2f}"])
    if rows:
        heading = ["shape", "tension", "parts half-way", "holes", "parts at the end", "lone", "holes", "nearest, 5 %"]
        made.append(
            Table("Poured liquid", heading, rows, "Parts: particles within 1.5 spacings. Holes: tunnels on a raster.")
        )
    return made


def _rained(values: Mapping[str, Any]) -> str:
    words = f"{values['ever_inside']} ({values['inside_at_end']}), {real(values['deepest_spacings']):.2f}"
    return words + (f", {values['reason']}" if values["reason"] else "")


def _needs(keys: Sequence[str]) -> tuple[str, ...]:
    return tuple(keys)


PICTURES = (
    Picture(
        "boundary_pouring", flow_pictures.pour_data, flow_pictures.pour_picture,
        _needs([f"flow_pour_{shape}_{arm}" for shape in POUR for arm in ARMS]), shaded=True),
    Picture(
        "boundary_penetration", flow_pictures.rain_data, flow_pictures.rain_picture,
        _needs([f"flow_rain_{s}_{c}_1" for s in RAINED for c in ("none", "swept")]),
    ),
    Picture("boundary_tank", flow_pictures.tank_data, flow_pictures.tank_picture, ("flow_tank",)),
)  # fmt: skip
