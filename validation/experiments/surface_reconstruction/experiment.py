"""A surface out of particles: how good its normals are, how the fit converges, how good the mesh is, what it costs."""

from __future__ import annotations

from typing import Any

import numpy as np

from validation.checks import Checks
from validation.claims import measures
from validation.experiment import Experiment, Options, Picture, Results, Run
from validation.experiments.surface_reconstruction import accuracy, claims, pictures, runs
from validation.experiments.surface_reconstruction.shapes import RADII
from validation.tables import Table

BEST_KEY, DEFAULT_KEY = "gradient_0.25_1", "mls_0.5_10"


def planned(options: Options) -> list[Run]:
    """The runs under the options."""
    backend = options.backend
    made = [
        Run(f"normals_{shape}", runs.normal_errors, {"shape": shape, "backend": backend}, estimate=8.0)
        for shape in RADII
    ]
    made.append(Run("meshes", runs.meshes, {"backend": backend}, estimate=2.0))
    slow = "takes a minute with the others; run without --quick" if options.quick else ""
    made.append(Run("smooth", runs.smooth_samples, {"backend": backend}, estimate=15.0, skip=slow))
    made.append(Run("convergence", runs.convergence, {"backend": backend}, estimate=30.0, skip=slow))
    counts = [8_000, 64_000] if options.quick else [8_000, 64_000, 1_000_000]
    parameters = {"backend": backend, "counts": counts, "threads": options.threads}
    made.append(Run("stages", runs.stages, parameters, estimate=4.0 if options.quick else 30.0))
    reason = "a bar for the GPU, measured with --backend cuda" if backend != "cuda" else slow
    parameters = {"backend": backend, "cells": 50, "rounds": 3}
    made.append(Run("beside_transfers", runs.beside_transfers, parameters, estimate=30.0, skip=reason))
    parameters = {"backend": backend, "threads": options.threads}
    made.append(Run("normals_cost", runs.normals_cost, parameters, estimate=3.0))
    made.append(Run("solvers", runs.solvers, {"threads": options.threads}, estimate=30.0, skip=slow))
    threads = [n for n in (1, 2, 4, 8, 16) if n <= (options.threads or runs.there_threads())]
    parameters = {"backend": options.backend, "threads": threads if options.backend == "cpu" else []}
    made.append(Run("fit_scaling", runs.fit_scaling, parameters, estimate=30.0, skip=slow))
    peer = {"count": 64_000 if options.quick else 524_288, "rounds": 3, "threads": options.threads or 2}
    reason = "" if options.peers else "measured with --peers"
    made.append(Run("peer_pysplashsurf", runs.against_pysplashsurf, peer, estimate=40.0, skip=reason))
    return made


def checks(results: Results, check: Checks) -> None:
    """Normals, topology, convergence and the ratio to the peer; absolute times are shown."""
    for shape in RADII:
        if f"normals_{shape}" in results:
            rows = results[f"normals_{shape}"].values["rows"]
            for name, key, part in (
                ("best_mean", BEST_KEY, "mean"), ("best_max", BEST_KEY, "max"), ("default_mean", DEFAULT_KEY, "mean"),
                ("default_max", DEFAULT_KEY, "max"), ("facet_mean", "facets", "mean"),
            ):  # fmt: skip
                check(name, rows[key][part], shape)
        if "meshes" in results:
            row = results["meshes"].values["rows"][shape]
            check("euler", row["euler"], shape)
            check("unmatched", row["unmatched"], shape)
    if "smooth" in results:
        rows = results["smooth"].values["rows"]
        (row,) = (row for row in rows if row["offset"] == 0.25 and row["iterations"] == 300)
        check("smooth_error", row["gradient"])
    if "convergence" in results:
        largest = results["convergence"].values["spectrum"]["largest"]
        check("largest_eigenvalue", abs(largest - 1))
    if "stages" in results:
        for row in results["stages"].values["rows"]:
            words = f"{row['particles']:,} particles, {row['quadrature']}"
            name = f"{row['particles']}_{row['quadrature']}"
            check("stage_time", 1e3 * sum(row["stages"].values()), name, words)
    if "beside_transfers" in results:
        values = results["beside_transfers"].values
        check("over_transfers", values["ratio"], "cuda", f"{values['particles']:,} particles")
    if "peer_pysplashsurf" in results and not results["peer_pysplashsurf"].values["missing"]:
        values = results["peer_pysplashsurf"].values
        check("peer_ratio", values["ratio"], "pysplashsurf", "pysplashsurf")
        for name, words in (("refsim", "refsim"), ("peer", "pysplashsurf")):
            check("peer_time", 1e6 * values[name]["median"], name, words)


def tables(results: Results) -> list[Table]:
    """Errors of all settings, smooth samples, mesh quality, solvers, normals and stages."""
    made = []
    for shape in RADII:
        if f"normals_{shape}" in results:
            values = results[f"normals_{shape}"].values
            rows: list[list[Any]] = [
                [row["words"], row["mean"], row["p95"], row["max"], row["against_offsets"]]
                for row in values["rows"].values()
            ]
            made.append(
                Table(
                    f"Normals of a {shape} of radius 9 h, {values['particles']:,} particles, {values['samples']:,}"
                    " samples: degrees",
                    ["normals", "mean", "95 %", "largest", "against n_s"],
                    rows,
                    "Samples stand at distance r from the particles; the true normal is that at the nearest point.",
                )
            )
    if "smooth" in results:
        values = results["smooth"].values
        rows = [[r["offset"], r["iterations"], r["mls"], r["gradient"]] for r in values["rows"]]
        title = (
            f"The fit alone: {values['samples']:,} samples on a sphere, directions off by {values['input']:.1f} degrees"
        )
        made.append(Table(title, ["epsilon/h", "sweeps", "MLS (3.17)", "gradient (3.9)"], rows, "Mean error, degrees."))
    if "meshes" in results:
        rows = []
        for shape, row in results["meshes"].values["rows"].items():
            for words, key in (
                ("smallest angle of a triangle", "least_angle"), ("the same after the inset", "least_angle_inset"),
                ("jump of facet normals over an edge", "jump_facets"), ("jump of fitted normals", "jump_fit"),
            ):  # fmt: skip
                rows.append([shape, words, *(row[key][part] for part in ("min", "median", "p95", "max"))])
        heading = ["shape", "what", "least", "median", "95 %", "largest"]
        made.append(Table("Marching cubes before the fit, and after: degrees", heading, rows))
    if "solvers" in results:
        values = results["solvers"].values
        rows = [
            [r["words"], 1e3 * r["seconds"], r["residual"], r["error"], r["numbers_per_node"]] for r in values["rows"]
        ]
        made.append(
            Table(
                f"The same fit by others: {values['samples']:,} samples, {values['active']:,} active nodes, float64",
                ["solver", "ms", "rms residual / epsilon", "error, degrees", "numbers per node"],
                rows,
                "Seconds include setting up: weights for LSPIA, the product B^T B for the others.",
            )
        )
    if "fit_scaling" in results:
        values = results["fit_scaling"].values
        first = values["rows"][0]["seconds"]
        rows = [
            [r["threads"] or "GPU", 1e3 * r["seconds"], 1e3 * r["spread"], first / r["seconds"]] for r in values["rows"]
        ]
        made.append(
            Table(
                f"{values['sweeps']} sweeps: {values['points']:,} points, {values['nodes']:,} nodes, float32",
                ["threads", "ms", "deviation", "gain"],
                rows,
                f"It keeps {values['bytes_per_node']:.1f} bytes a node and {values['bytes_per_point']:.0f} a point.",
            )
        )
    if "normals_cost" in results:
        values = results["normals_cost"].values
        rows = [
            [r["dtype"], runs.WORDS[r["kind"]], r["nanoseconds"], r["spread"], r["registers"]] for r in values["rows"]
        ]
        title = f"A normal on {values['backend']}"
        made.append(Table(title, ["dtype", "normals", "ns", "spread", "registers"], rows))
    if "stages" in results:
        for row in results["stages"].values["rows"]:
            title = (
                f"Stages, {row['particles']:,} particles, {row['samples']:,} samples, {row['quadrature']}: milliseconds"
            )
            made.append(Table(title, ["stage", "ms"], [[name, 1e3 * s] for name, s in row["stages"].items()]))
    if "beside_transfers" in results:
        values = results["beside_transfers"].values
        rows = [[1e3 * float(np.median(values[key])) for key in ("own", "force", "plain")]]
        title = f"Surface and force beside a plain step, {values['particles']:,} particles, {values['backend']}: ms"
        note = f"Ratio {values['ratio']:.2f} ({min(values['ratios']):.2f} to {max(values['ratios']):.2f}), in turns."
        made.append(Table(title, ["surface and force", "force alone", "plain step"], rows, note))
    if "peer_pysplashsurf" in results:
        values = results["peer_pysplashsurf"].values
        if values["missing"]:
            made.append(
                Table("Other programs", ["program", "result"], [["pysplashsurf", f"left out: {values['missing']}"]])
            )
        else:
            rows = [
                [f"pysplashsurf {values['version']}", 1e6 * values["peer"]["median"], values["peer_facets"]],
                ["refsim", 1e6 * values["refsim"]["median"], values["facets"]],
            ]
            low, high = min(values["ratios"]), max(values["ratios"])
            made.append(
                Table(
                    f"Level set and marching cubes, {values['particles']:,} particles, {values['threads']} threads",
                    ["program", "us per particle", "triangles"],
                    rows,
                    f"Ratio {values['ratio']:.2f} ({low:.2f} to {high:.2f}), alternating runs.",
                )
            )
    return made


EXPERIMENT = Experiment(
    name="surface_reconstruction",
    title="a surface out of particles: normals, convergence of the fit, meshes, time",
    runs=planned,
    checks=checks,
    pictures=(
        Picture(
            "surface_normals", pictures.error_data, pictures.error_picture, ("normals_sphere", "normals_ellipsoid")
        ),
        Picture("surface_meshes", pictures.mesh_data, pictures.mesh_picture, ("meshes",)),
        Picture("surface_convergence", pictures.convergence_data, pictures.convergence_picture, ("convergence",)),
        Picture("surface_pipeline", pictures.pipeline_data, pictures.pipeline_picture, ("stages",)),
    ),
    tables=tables,
    claims=measures(claims),
    panels=accuracy.PANELS,
)
