"""Sampling and signed distance: runs, checks and tables."""

from __future__ import annotations

from typing import Any

import numpy as np

from validation.checks import Checks
from validation.experiment import Options, Picture, Results, Run
from validation.experiments.boundary import sampling_pictures, sampling_runs
from validation.experiments.boundary.sampling_shapes import SHAPES
from validation.tables import Table
from validation.work_precision import order_from_errors

SPACINGS = [0.2, 0.1, 0.05]
SMOOTH = ("sphere", "torus")
EXACT = ("needle", "organic")


def planned(options: Options) -> list[Run]:
    """The runs under the options."""
    backend, made = options.backend, []
    count = 5000
    slow = "takes a minute with the others; run without --quick" if options.quick else ""
    for shape in SHAPES:
        parameters = {"shape": shape, "count": count, "backend": backend, "threads": options.threads}
        made.append(Run(f"sampling_{shape}", sampling_runs.scorecard, parameters, estimate=6.0))
    parameters = {"shape": "cube", "count": 2000, "backend": backend, "iterations": 200 if options.quick else 400}
    made.append(Run("sampling_printed", sampling_runs.printed, parameters, estimate=5.0))
    for shape in (*SMOOTH, "cube", "organic"):
        parameters = {"shape": shape, "spacings": SPACINGS, "level": 6 if shape in SMOOTH else 4, "backend": backend}
        made.append(Run(f"distance_{shape}", sampling_runs.distance_errors, parameters, estimate=6.0))
    for shape in EXACT:
        parameters = {"shape": shape, "spacing": 0.04, "level": 4, "backend": backend}
        made.append(Run(f"nodes_{shape}", sampling_runs.exact_nodes, parameters, estimate=4.0))
    parameters = {"count": 100_000, "repeats": 5, "threads": options.threads}
    made.append(Run("marked_region", sampling_runs.marked_region, parameters, estimate=6.0, skip=slow))
    size = (
        {"level": 5, "count": 20_000, "rounds": 3, "scale": 1.44}
        if options.quick
        else {"level": 6, "count": 1_000_000, "rounds": 3, "scale": 1.28}
    )
    reason = "" if options.peers else "measured with --peers"
    parameters = {**size, "threads": options.threads or 2}
    made.append(Run("sampling_peers", sampling_runs.against_peers, parameters, estimate=900.0, skip=reason))
    return made


def checks(results: Results, check: Checks) -> None:
    """What each bound in expected/boundary.toml is held against."""

    def note(name: str, value: Any, run: str = "", words: str = "") -> None:
        check(name, value, run, words)

    for shape in SHAPES:
        if f"sampling_{shape}" in results:
            row = results[f"sampling_{shape}"].values
            for name, key in (
                ("count", "count_error"), ("least", "least"), ("variation", "variation"), ("off", "off"),
                ("holes", "holes"), ("blue", "blue"), ("force", "force_noise"),
                ("iterations", "iterations"), ("seconds", "seconds"),
            ):  # fmt: skip
                note(f"sampling_{name}", row[key], shape)
    if "sampling_printed" in results:
        rows = results["sampling_printed"].values["rows"]
        note("printed_residual", rows["printed"]["residual"])
        note("adopted_residual", rows["adopted"]["residual"])
    for shape in (*SMOOTH, "cube", "organic"):
        if f"distance_{shape}" in results:
            rows = results[f"distance_{shape}"].values["rows"]
            if shape in SMOOTH:
                order = order_from_errors([r["spacing"] for r in rows], [r["rms"] for r in rows], 2.0)
                note("distance_order", order.order, shape)
                note("distance_smooth", rows[-1]["largest_in_spacings"], shape)
            if shape == "cube":
                note("distance_edges", max(r["largest_in_spacings"] for r in rows))
            note("distance_signs", sum(r["wrong_signs"] for r in rows), shape)
    for shape in EXACT:
        if f"nodes_{shape}" in results:
            note("node_error", results[f"nodes_{shape}"].values["error"], shape)
            note("distance_signs", results[f"nodes_{shape}"].values["wrong_signs"], f"nodes_{shape}", f"{shape}, nodes")
    if "marked_region" in results:
        spent = results["marked_region"].values["nanoseconds"]
        note("marked_region", spent["far"], "far", "all of them far from the boundary")
        note("marked_region", spent["near"], "near", "all of them near it")
        note("every_particle", spent["every"])
    if "sampling_peers" in results:
        values = results["sampling_peers"].values
        if "sampling_ratio" in values:
            note("peer_sampling_ratio", values["sampling_ratio"])
            note("peer_sampling_quality", values["quality"]["variation"] / values["peer_quality"]["variation"])
            note("peer_sampling_blue", values["quality"]["blue"] / values["peer_quality"]["blue"])
            note("peer_sampling_count", abs(values["peer_particles"] / values["particles"] - 1))
            note("peer_sampling_as_even", values["as_even_ratio"])
        if "field_ratio" in values:
            note("peer_field_ratio", values["field_ratio"])


def tables(results: Results) -> list[Table]:
    """Scorecard, errors of the distance, the printed rule, other programs."""
    made = []
    rows: list[list[Any]] = []
    for shape in SHAPES:
        if f"sampling_{shape}" in results:
            v = results[f"sampling_{shape}"].values
            rows.append(
                [
                    shape, v["particles"], v["expected"], v["mean_over_2r"], v["least"], v["variation"], v["off"],
                    v["holes"], v["blue"], v["force_noise"], v["iterations"], v["seconds"],
                ]
            )  # fmt: skip
    if rows:
        head = [
            "shape", "particles", "g A/(pi r^2)", "mean/2r", "least/mean", "variation", "|phi|/r", "holes", "blue",
            "force noise", "iterations", "s",
        ]  # fmt: skip
        made.append(Table("Sampling scorecard", head, rows))
    rows = []
    for shape in (*SMOOTH, "cube", "organic"):
        if f"distance_{shape}" in results:
            for r in results[f"distance_{shape}"].values["rows"]:
                rows.append([shape, r["spacing"], r["rms"], r["largest"], r["largest_in_spacings"], r["bytes"]])
    if rows:
        head = ["shape", "spacing m", "rms error m", "largest m", "largest/spacing", "bytes"]
        words = "Closed forms for sphere, torus and cube; exact closest triangle for the organic shape."
        made.append(Table("Trilinear distance within half a spacing of the surface", head, rows, words))
    if "sampling_printed" in results:
        rows = [
            [name, r["iterations"], "yes" if r["converged"] else "no", r["residual"], r["least"], r["variation"]]
            for name, r in results["sampling_printed"].values["rows"].items()
        ]
        head = ["step", "iterations", "threshold met", "ways/(r N)", "least/mean", "variation"]
        made.append(Table("Adopted and printed step (patent E24) on a cube", head, rows))
    if "sampling_peers" in results:
        v = results["sampling_peers"].values
        rows = []
        programs = [("refsim", "own", "sampling", "quality", v["particles"], v["iterations"])]
        if "sampling_ratio" in v:
            programs += [
                ("refsim, stopped early", "own", "as_even", "as_even", v["particles"], v["as_even"]["iterations"]),
                ("pySPlisHSPlasH, Poisson disks", "other", "sampling", "peer_quality", v["peer_particles"], None),
            ]
        for words, whose, what, quality, particles, iterations in programs:
            spent = float(np.median(v[whose][what]))
            rows.append([words, spent, particles, iterations, *(v[quality][k] for k in ("least", "variation", "blue"))])
        if "sampling_ratio" not in v:
            rows.append([f"pySPlisHSPlasH: {v['missing']['sampling']}", *6 * [None]])
        made.append(
            Table(
                f"Other programs, {v['triangles']:,} triangles, {v['threads']} threads",
                ["program", "s", "particles", "iterations", "least/mean", "variation", "blue"], rows,
                f"A node of refsim's field takes {1e6 * float(np.median(v['own']['field'])):.3g} us"
                + (f", a query of libigl's {1e6 * float(np.median(v['other']['field'])):.3g} us."
                   if "field_ratio" in v else f"; libigl: {v['missing']['field']}."),
            )
        )  # fmt: skip
    return made


PICTURES = (
    Picture(
        "boundary_sampling",
        sampling_pictures.shape_data,
        sampling_pictures.shape_picture,
        tuple(f"sampling_{shape}" for shape in SHAPES),
        shaded=True,
    ),
    Picture(
        "boundary_convergence",
        sampling_pictures.convergence_data,
        sampling_pictures.convergence_picture,
        ("sampling_printed", *(f"distance_{shape}" for shape in (*SMOOTH, "cube", "organic"))),
    ),
)
