"""A surface out of particles: how good its normals are, how the fit converges, how good the mesh is, what it costs."""

from __future__ import annotations

from validation.checks import Checks
from validation.experiment import Experiment, Options, Picture, Results, Run, measures
from validation.experiments.surface_reconstruction import claims, pictures, runs
from validation.experiments.surface_reconstruction.shapes import RADII

BEST_KEY, DEFAULT_KEY = "gradient_0.25_1", "mls_0.5_10"


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
    claims=measures(claims),
)
