"""A surface out of particles: how good its normals are, how the fit converges, how good the mesh is, what it costs."""

from __future__ import annotations

import numpy as np

from validation.checks import Checks
from validation.experiment import Experiment, Options, Picture, Results, Run, measures
from validation.experiments.surface_reconstruction import claims, pictures, runs
from validation.experiments.surface_reconstruction.shapes import RADII
from validation.tables import Table

BEST_KEY, DEFAULT_KEY = "gradient_0.25_1", "mls_0.5_10"
MESH_WORDS = {
    "least_angle": "smallest angle of a triangle", "least_angle_inset": "the same after the inset",
    "jump_facets": "jump of facet normals over an edge", "jump_fit": "jump of fitted normals",
}  # fmt: skip


def planned(options: Options) -> list[Run]:
    """The runs under the options."""
    quick, backend, threads = options.quick, {"backend": options.backend}, {"threads": options.threads}
    slow = "takes a minute with the others; run without --quick" if quick else ""
    on_gpu = slow if options.backend == "cuda" else "a bar for the GPU, measured with --backend cuda"
    counts = [8_000, 64_000] if quick else [8_000, 64_000, 1_000_000]
    scaled = [n for n in (1, 2, 4, 8, 16) if n <= (options.threads or runs.there_threads())]
    peer = {"count": 64_000 if quick else 524_288, "rounds": 3, "threads": options.threads or 2}
    return [
        *(Run(f"normals_{shape}", runs.normal_errors, {"shape": shape, **backend}, 8.0) for shape in RADII),
        Run("meshes", runs.meshes, backend, 2.0),
        Run("smooth", runs.smooth_samples, backend, 15.0, slow),
        Run("convergence", runs.convergence, backend, 30.0, slow),
        Run("stages", runs.stages, {"counts": counts, **backend, **threads}, 4.0 if quick else 30.0),
        Run("beside_transfers", runs.beside_transfers, {"cells": 50, "rounds": 3, **backend}, 30.0, on_gpu),
        Run("normals_cost", runs.normals_cost, {**backend, **threads}, 3.0),
        Run("solvers", runs.solvers, threads, 30.0, slow),
        Run("fit_scaling", runs.fit_scaling, {"threads": scaled if options.backend == "cpu" else [], **backend}, 30.0,
            slow),
        Run("peer_pysplashsurf", runs.against_pysplashsurf, peer, 40.0,
            "" if options.peers else "measured with --peers"),
    ]  # fmt: skip


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
    had, made = {key: result.values for key, result in results.items()}, list[Table]()
    for shape in RADII:
        if v := had.get(f"normals_{shape}"):
            title = (
                f"Normals of a {shape} of radius 9 h, {v['particles']:,} particles, {v['samples']:,} samples: degrees"
            )
            heading = ["normals", "mean", "95 %", "largest", "against n_s"]
            rows = [[row[n] for n in ("words", "mean", "p95", "max", "against_offsets")] for row in v["rows"].values()]
            note = "Samples stand at distance r from the particles; the true normal is that at the nearest point."
            made.append(Table(title, heading, rows, note))
    if v := had.get("smooth"):
        title = f"The fit alone: {v['samples']:,} samples on a sphere, directions off by {v['input']:.1f} degrees"
        rows = [[r["offset"], r["iterations"], r["mls"], r["gradient"]] for r in v["rows"]]
        made.append(Table(title, ["epsilon/h", "sweeps", "MLS (3.17)", "gradient (3.9)"], rows, "Mean error, degrees."))
    if v := had.get("meshes"):
        rows = [
            [shape, words, *(row[key][part] for part in ("min", "median", "p95", "max"))]
            for shape, row in v["rows"].items() for key, words in MESH_WORDS.items()
        ]  # fmt: skip
        heading = ["shape", "what", "least", "median", "95 %", "largest"]
        made.append(Table("Marching cubes before the fit, and after: degrees", heading, rows))
    if v := had.get("solvers"):
        title = f"The same fit by others: {v['samples']:,} samples, {v['active']:,} active nodes, float64"
        heading = ["solver", "ms", "rms residual / epsilon", "error, degrees", "numbers per node"]
        rows = [[r["words"], 1e3 * r["seconds"], r["residual"], r["error"], r["numbers_per_node"]] for r in v["rows"]]
        note = "Seconds include setting up: weights for LSPIA, the product B^T B for the others."
        made.append(Table(title, heading, rows, note))
    if v := had.get("fit_scaling"):
        first = v["rows"][0]["seconds"]
        title = f"{v['sweeps']} sweeps: {v['points']:,} points, {v['nodes']:,} nodes, float32"
        rows = [[r["threads"] or "GPU", 1e3 * r["seconds"], 1e3 * r["spread"], first / r["seconds"]] for r in v["rows"]]
        note = f"It keeps {v['bytes_per_node']:.1f} bytes a node and {v['bytes_per_point']:.0f} a point."
        made.append(Table(title, ["threads", "ms", "deviation", "gain"], rows, note))
    if v := had.get("normals_cost"):
        heading = ["dtype", "normals", "ns", "spread", "registers"]
        rows = [[r["dtype"], runs.WORDS[r["kind"]], r["nanoseconds"], r["spread"], r["registers"]] for r in v["rows"]]
        made.append(Table(f"A normal on {v['backend']}", heading, rows))
    for row in had.get("stages", {"rows": ()})["rows"]:
        size = f"{row['particles']:,} particles, {row['samples']:,} samples"
        title = f"Stages, {size}, {row['quadrature']}: milliseconds"
        made.append(Table(title, ["stage", "ms"], [[name, 1e3 * s] for name, s in row["stages"].items()]))
    if v := had.get("beside_transfers"):
        rows = [[1e3 * float(np.median(v[key])) for key in ("own", "force", "plain")]]
        title = f"Surface and force beside a plain step, {v['particles']:,} particles, {v['backend']}: ms"
        note = f"Ratio {v['ratio']:.2f} ({min(v['ratios']):.2f} to {max(v['ratios']):.2f}), in turns."
        made.append(Table(title, ["surface and force", "force alone", "plain step"], rows, note))
    if (v := had.get("peer_pysplashsurf")) and v["missing"]:
        made.append(Table("Other programs", ["program", "result"], [["pysplashsurf", f"left out: {v['missing']}"]]))
    elif v:
        title = f"Level set and marching cubes, {v['particles']:,} particles, {v['threads']} threads"
        rows = [
            [f"pysplashsurf {v['version']}", 1e6 * v["peer"]["median"], v["peer_facets"]],
            ["refsim", 1e6 * v["refsim"]["median"], v["facets"]],
        ]
        note = f"Ratio {v['ratio']:.2f} ({min(v['ratios']):.2f} to {max(v['ratios']):.2f}), alternating runs."
        made.append(Table(title, ["program", "us per particle", "triangles"], rows, note))
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
)
