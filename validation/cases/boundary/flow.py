"""Liquid at meshes: what is run, what must hold, tables and pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from validation.cases.boundary import flow_pictures, flow_runs
from validation.cases.boundary.flow_runs import ARMS, POUR
from validation.harness import Options, Picture, Results, Run
from validation.results import real
from validation.tables import Table
from validation.verdicts import Bounds, Measurement

RAINED = ("sphere", "torus", "cube", "needle", "plate", "pebble")
CORRECTIONS = {"none": "no correction", "point": "where the step ends", "swept": "swept"}
SHARES = (0.5, 1.5)  # of the runner's step, on the plate
GAMMAS = (0.02, 0.1, 0.4)


def planned(options: Options) -> list[Run]:
    """The runs under the options; the quick ones are one rain, one pour and the drops."""
    reason = "takes minutes; run without --quick" if options.quick else ""
    backend = {"backend": options.backend}
    made = []
    for shape in RAINED:
        for correction in ("none", "swept"):
            skip = reason if shape != "sphere" else ""
            parameters = {"shape": shape, "correction": correction, "share": 1.0, **backend}
            made.append(Run(f"flow_rain_{shape}_{correction}_1", flow_runs.rain, parameters, 20.0, skip))
    for shape in POUR:
        for arm in ARMS:
            skip = reason if shape != "sphere" else ""
            parameters = {"shape": shape, "arm": arm, **backend}
            made.append(Run(f"flow_pour_{shape}_{arm}", flow_runs.pour, parameters, 20.0, skip))
    made.append(Run("flow_tank", flow_runs.resting_tank, {"steps": 10_000, **backend}, 250.0, reason))
    for everywhere in (False, True):
        parameters = {"everywhere": everywhere, **backend}
        made.append(Run(f"flow_marked_{int(everywhere)}", flow_runs.marked_cost, parameters, 9.0, reason))
    for gamma in GAMMAS:
        parameters = {"gamma": gamma, "count": 515, **backend}
        made.append(Run(f"flow_sigma_{gamma:g}", flow_runs.own_tension, parameters, 12.0))
    for correction in CORRECTIONS:
        for share in SHARES if correction != "point" else (1.0, *SHARES):
            parameters = {"shape": "plate", "correction": correction, "share": share, **backend}
            made.append(Run(f"flow_rain_plate_{correction}_{share:g}", flow_runs.rain, parameters, 20.0, reason))
    return made


def judge(results: Results) -> list[Measurement]:
    """No leaks at the runner's own step, the tank at rest, and what is shown of the rest."""
    bounds, made = Bounds("boundary"), []
    for shape in RAINED:
        for correction in ("none", "swept"):
            key = f"flow_rain_{shape}_{correction}_1"
            if key in results:
                name = "rain_leaks" if correction == "swept" else "rain_uncorrected"
                made.append(bounds.judge(name, results[key].values["ever_inside"], shape))
    if "flow_tank" in results:
        values = results["flow_tank"].values
        made.append(bounds.judge("tank_lost", values["lost"] + values["inside"]))
        made.append(bounds.judge("tank_pressure", abs(real(values["pressure_error"]))))
        made.append(bounds.judge("tank_gradient", real(values["gradient_error"])))
        made.append(bounds.judge("tank_force", abs(real(values["force_error"]))))
        made.append(bounds.judge("tank_noise", real(values["force_noise"])))
    for gamma in GAMMAS:
        key = f"flow_sigma_{gamma:g}"
        if key in results:
            density = real(results[key].values["core_density"])
            made.append(bounds.judge("own_density", density, f"{gamma:g}", f"gamma = {gamma:g} m/s^2"))
    for shape in POUR:
        keys = [f"flow_pour_{shape}_{arm}" for arm in ARMS]
        for key, arm in zip(keys, ARMS):
            if key in results:
                made.append(bounds.judge("pour_leaks", results[key].values["inside"], f"{shape}_{arm}"))
    if {"flow_marked_0", "flow_marked_1"} <= set(results):
        ratio = real(results["flow_marked_1"].values["seconds"]) / real(results["flow_marked_0"].values["seconds"])
        made.append(bounds.judge("marked_cost", ratio))
    return made


def tables(results: Results) -> list[Table]:
    """Penetrations over the step, and what becomes of the poured liquid."""
    made = []
    rows = []
    for shape in RAINED:
        for correction, words in CORRECTIONS.items():
            own = {s: results.get(f"flow_rain_{shape}_{correction}_{s:g}") for s in sorted((1.0, *SHARES))}
            if any(own.values()):
                rows.append([shape, words, *(_rained(r.values) if r else "-" for r in own.values())])
    if rows:
        heading = ["shape", "correction", *(f"dt x {s:g}" for s in sorted((1.0, *SHARES)))]
        note = "Of 2,560 particles: found inside after any step (inside at the end), greatest depth in spacings."
        made.append(Table("Rain on solids: particles inside", heading, rows, note))
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
        _needs([f"flow_pour_{shape}_{arm}" for shape in POUR for arm in ARMS]),
    ),
    Picture(
        "boundary_penetration", flow_pictures.rain_data, flow_pictures.rain_picture,
        _needs([f"flow_rain_{s}_{c}_1" for s in RAINED for c in ("none", "swept")]),
    ),
    Picture("boundary_tank", flow_pictures.tank_data, flow_pictures.tank_picture, ("flow_tank",)),
)  # fmt: skip
