"""Solids given as meshes: distance, particles spread over them, and liquid that meets them (patent CN104318598A)."""

from __future__ import annotations

from validation.checks import Checks
from validation.experiment import Experiment, Options, Picture, Results, Run, measures
from validation.experiments.boundary import claims, flow_runs, pictures, sampling_runs, stability
from validation.experiments.boundary.flow_runs import ARMS, POUR
from validation.experiments.boundary.sampling_shapes import SHAPES
from validation.results import real
from validation.work_precision import order_from_errors

SPACINGS = [0.2, 0.1, 0.05]
SMOOTH = ("sphere", "torus")
MEASURED = (*SMOOTH, "cube", "organic")
EXACT = ("needle", "organic")


def sampling_planned(options: Options) -> list[Run]:
    """Sampling and signed distance."""
    backend, threads = {"backend": options.backend}, {"threads": options.threads}
    slow = "takes a minute with the others; run without --quick" if options.quick else ""
    size = (
        {"level": 5, "count": 20_000, "scale": 1.44}
        if options.quick
        else {"level": 6, "count": 1_000_000, "scale": 1.28}
    )
    peers = {**size, "rounds": 3, "threads": options.threads or 2}
    iterations = 200 if options.quick else 400
    return [
        *(Run(f"sampling_{shape}", sampling_runs.scorecard, {"shape": shape, "count": 5000, **backend, **threads}, 6.0)
          for shape in SHAPES),
        Run("sampling_printed", sampling_runs.printed,
            {"shape": "cube", "count": 2000, "iterations": iterations, **backend}, 5.0),
        *(Run(f"distance_{shape}", sampling_runs.distance_errors,
              {"shape": shape, "spacings": SPACINGS, "level": 6 if shape in SMOOTH else 4, **backend}, 6.0)
          for shape in MEASURED),
        *(Run(f"nodes_{shape}", sampling_runs.exact_nodes, {"shape": shape, "spacing": 0.04, "level": 4, **backend},
              4.0) for shape in EXACT),
        Run("marked_region", sampling_runs.marked_region, {"count": 100_000, "repeats": 5, **threads}, 6.0, slow),
        Run("sampling_peers", sampling_runs.against_peers, peers, 900.0,
            "" if options.peers else "measured with --peers"),
    ]  # fmt: skip


def sampling_checks(results: Results, check: Checks) -> None:
    """Sampling and signed distance."""

    for shape in SHAPES:
        if f"sampling_{shape}" in results:
            row = results[f"sampling_{shape}"].values
            for name, key in (
                ("count", "count_error"), ("least", "least"), ("variation", "variation"), ("off", "off"),
                ("holes", "holes"), ("blue", "blue"), ("force", "force_noise"),
                ("iterations", "iterations"), ("seconds", "seconds"),
            ):  # fmt: skip
                check(f"sampling_{name}", row[key], shape)
    if "sampling_printed" in results:
        rows = results["sampling_printed"].values["rows"]
        check("printed_residual", rows["printed"]["residual"])
        check("adopted_residual", rows["adopted"]["residual"])
    for shape in MEASURED:
        if f"distance_{shape}" in results:
            rows = results[f"distance_{shape}"].values["rows"]
            if shape in SMOOTH:
                order = order_from_errors([r["spacing"] for r in rows], [r["rms"] for r in rows], 2.0)
                check("distance_order", order.order, shape)
                check("distance_smooth", rows[-1]["largest_in_spacings"], shape)
            if shape == "cube":
                check("distance_edges", max(r["largest_in_spacings"] for r in rows))
            check("distance_signs", sum(r["wrong_signs"] for r in rows), shape)
    for shape in EXACT:
        if f"nodes_{shape}" in results:
            check("node_error", results[f"nodes_{shape}"].values["error"], shape)
            check(
                "distance_signs", results[f"nodes_{shape}"].values["wrong_signs"], f"nodes_{shape}", f"{shape}, nodes"
            )
    if "marked_region" in results:
        spent = results["marked_region"].values["nanoseconds"]
        check("marked_region", spent["far"], "far", "all of them far from the boundary")
        check("marked_region", spent["near"], "near", "all of them near it")
        check("every_particle", spent["every"])
    if "sampling_peers" in results:
        values = results["sampling_peers"].values
        if "sampling_ratio" in values:
            check("peer_sampling_ratio", values["sampling_ratio"])
            check("peer_sampling_quality", values["quality"]["variation"] / values["peer_quality"]["variation"])
            check("peer_sampling_blue", values["quality"]["blue"] / values["peer_quality"]["blue"])
            check("peer_sampling_count", abs(values["peer_particles"] / values["particles"] - 1))
            check("peer_sampling_as_even", values["as_even_ratio"])
        if "field_ratio" in values:
            check("peer_field_ratio", values["field_ratio"])


RAINED = ("sphere", "torus", "cube", "needle", "plate", "funnel", "pebble")
CORRECTIONS = {"none": "no correction", "point": "where the step ends", "swept": "swept"}
SHARES = (0.5, 1.0, 1.55)  # of the runner's step, which 1 stands for; it refuses fixed steps over 1.6
GAMMAS = (0.02, 0.1, 0.4)
QUICK_RAIN, QUICK_POUR = 640, 0.1  # particles; simulated seconds


def flow_planned(options: Options) -> list[Run]:
    """Liquid at meshes; the quick ones are one rain, one pour and a drop."""
    reason = "takes minutes; run without --quick" if options.quick else ""
    backend = {"backend": options.backend}
    fewer = {"count": QUICK_RAIN} if options.quick else {}
    shorter = {"seconds": QUICK_POUR} if options.quick else {}
    rains = [
        (shape, correction, share)
        for shape in RAINED
        for correction in CORRECTIONS
        for share in (SHARES if correction != "point" else SHARES[1:])
    ]
    return [
        *(Run(f"flow_rain_{s}_{c}_{share:g}", flow_runs.rain,
              {"shape": s, "correction": c, "share": share, **backend, **fewer}, 5.0,
              "" if (s, c, share) == ("sphere", "swept", 1) else reason) for s, c, share in rains),
        *(Run(f"flow_pour_{shape}_{arm}", flow_runs.pour, {"shape": shape, "arm": arm, **backend, **shorter}, 8.0,
              "" if (shape, arm) == ("sphere", "difference") else reason) for shape in POUR for arm in ARMS),
        Run("flow_tank", flow_runs.resting_tank, {"steps": 10_000, **backend}, 100.0, reason),
        *(Run(f"flow_marked_{int(every)}", flow_runs.marked_cost, {"everywhere": every, **backend}, 9.0, reason,
              timed=True) for every in (False, True)),
        *(Run(f"flow_sigma_{gamma:g}", flow_runs.own_tension,
              {"gamma": gamma, "count": 257 if options.quick else 515, **backend}, 6.0,
              "" if gamma == GAMMAS[1] else reason) for gamma in GAMMAS),
        Run("flow_bound", flow_runs.own_bound, {"gamma": 1.0, **backend}, 30.0, reason),
    ]  # fmt: skip


def flow_checks(results: Results, check: Checks) -> None:
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
        for arm in ARMS:
            if (key := f"flow_pour_{shape}_{arm}") in results:
                check("pour_leaks", results[key].values["inside"], f"{shape}_{arm}")
    if {"flow_marked_0", "flow_marked_1"} <= set(results):
        ratio = real(results["flow_marked_1"].values["seconds"]) / real(results["flow_marked_0"].values["seconds"])
        check("marked_cost", ratio)


EXPERIMENT = Experiment(
    name="boundary",
    title="meshes as boundaries: distance, particles, penetration, a tank at rest, pouring by tension",
    runs=lambda options: [*sampling_planned(options), *flow_planned(options)],
    checks=lambda results, check: (sampling_checks(results, check), flow_checks(results, check)),
    pictures=(
    Picture(
        "boundary_sampling",
        pictures.shape_data,
        pictures.shape_picture,
        tuple(f"sampling_{shape}" for shape in SHAPES),
        shaded=True,
    ),
    Picture(
        "boundary_convergence",
        pictures.convergence_data,
        pictures.convergence_picture,
        ("sampling_printed", *(f"distance_{shape}" for shape in MEASURED)),
    ),
    Picture(
        "boundary_pouring", pictures.pour_data, pictures.pour_picture,
        ("flow_pour_sphere_difference",), shaded=True),
    Picture(
        "boundary_penetration", pictures.rain_data, pictures.rain_picture,
        tuple(f"flow_rain_{s}_{c}_1" for s in RAINED for c in ("none", "swept")),
    ),
    Picture("boundary_tank", pictures.tank_data, pictures.tank_picture, ("flow_tank",)),
    ),
    claims=measures(claims),
    trials=vars(stability),
)  # fmt: skip
