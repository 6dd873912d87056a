"""Runs of the reconstruction: normals, the fit's convergence, meshes, and stages."""

import itertools
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from refsim.backends.arrays import choose, unavailable
from refsim.core.operation import REGISTRY
from refsim.isosurface import Mesh
from refsim.sparse_grid import nodes
from refsim.surface_energy import Tension
from refsim.surface_energy.effect import reconstruction_on
from refsim.surface_energy.reconstruction import Reconstruction, Surface
from validation.checks import Checks
from validation.experiment import Experiment, Measure, Options, Results, RunSpec, each, every
from validation.experiments.surface_reconstruction import scene
from validation.experiments.surface_reconstruction.scene import RADII
from validation.metrics.meshes import edge_counts, eigenvalues, neighbouring_facets, smallest_angles
from validation.results import Result, real
from validation.running import Context, beside, median_and_mad, medians, on_threads

CELL = 1 / 32  # m
RADIUS = 9.0  # of the sphere, in cells
SWEEPS = (1, 10, 100)
OFFSETS = (0.25, 0.5, 1.0, 2.0)
WORDS = {"facets": "facets", "offsets": "offset directions", "mls": "MLS (3.17)", "gradient": "gradient (3.9)"}
DEFAULT = {"normals": "mls", "offset": 0.5, "iterations": 10}
BEST = {"normals": "gradient", "offset": 0.25, "iterations": 1}


def settings() -> dict[str, dict[str, Any]]:
    """Every setting of the normals that is compared, by key."""
    made: dict[str, dict[str, Any]] = {"facets": {"normals": "facets"}, "offsets": {"normals": "offsets"}}
    for kind in ("mls", "gradient"):
        for offset in OFFSETS:
            for sweeps in SWEEPS:
                made[f"{kind}_{offset:g}_{sweeps}"] = {"normals": kind, "offset": offset, "iterations": sweeps}
    return made


def words_of(parameters: Mapping[str, Any]) -> str:
    """A setting in words."""
    text = WORDS[parameters["normals"]]
    if "offset" in parameters:
        sweeps = parameters["iterations"]
        text += f", epsilon {parameters['offset']:g} h, {sweeps} sweep{'s' if sweeps > 1 else ''}"
    return text


def reconstruct(
    place: np.ndarray, backend: str, dtype: str = "float64", dim: int = 3, timed: bool = False, **parameters: Any
) -> tuple[Reconstruction, Surface, Any]:
    """(reconstruction, surface, positions on the backend) of particles at `place`, in cells."""
    there = choose(backend)
    made = reconstruction_on(there, dim, dtype, CELL, Tension(surface_tension=1.0, **parameters), timed)
    position = there.asarray((CELL * place).astype(dtype))
    return made, made.surface(position), position


def normal_errors(context: Context, shape: str, backend: str, seed: int = 0, radius: float = RADIUS) -> Result:
    """Angles between normals and the true ones [degrees], for every setting, on one jittered cloud."""
    place = scene.cloud(shape, radius, seed)
    rows, arrays = {}, {}
    chosen = settings()
    for k, (key, parameters) in enumerate(chosen.items()):
        made, surface, _ = reconstruct(place, backend, inset=-1.0, **parameters)
        angle = angles_off(made, surface, shape, radius)
        rows[key] = {
            "words": words_of(parameters), **parameters,
            "mean": float(angle.mean()), "p95": float(np.quantile(angle, 0.95)), "max": float(angle.max()),
        }  # fmt: skip
        if key in ("facets", "offsets") or parameters in (DEFAULT, BEST):
            arrays[key] = angle
        context.progress((k + 1) / len(chosen))
    return Result({"particles": len(place), "samples": len(angle), "rows": rows}, arrays)


def angles_off(made: Reconstruction, surface: Surface, shape: str = "sphere", radius: float = RADIUS) -> np.ndarray:
    """Angles between the normals of a surface's samples and the true ones [degrees]."""
    sample, normal = (made.backend.host(a) for a in (surface.samples.position, surface.samples.normal))
    return scene.angles(normal, scene.true_normals(sample / CELL, shape, radius))


def fit_system(
    dim: int, radius: float, seed: int = 0, **parameters: Any
) -> tuple[Any, np.ndarray, np.ndarray, Surface]:
    """(B as a sparse matrix of its active columns, b, active nodes, surface) of a particle cloud's fit."""
    from scipy.sparse import csr_array

    from refsim.surface_energy.operations import matrix

    place = scene.cloud("sphere", radius, seed, dim)
    made, surface, _ = reconstruct(place, "cpu", dim=dim, inset=-1.0, **parameters)
    h = float(made.term.cell_size)
    points = np.vstack(
        [surface.sample_place, surface.sample_place + float(made.term.offset) * h * surface.offset_direction]
    )
    row, node, weight = matrix(points, surface.blocks, made.term)
    row, node, weight = (a[weight > 1e-12] for a in (row, node, weight))
    active, column = np.unique(node, return_inverse=True)
    goal = np.repeat([0.0, float(made.term.offset)], len(points) // 2)
    return csr_array((weight, (row, column)), shape=(len(points), len(active))), goal, active, surface


# Meshes


def meshes(context: Context, backend: str) -> Result:
    """The surfaces of both shapes, and whether they are closed."""
    rows = {}
    for shape in scene.RADII:
        made, surface, _ = reconstruct(scene.cloud(shape, RADIUS), backend, **DEFAULT)
        mesh = Mesh(*(made.backend.host(a) for a in surface.mesh))
        edges, unmatched = edge_counts(mesh.facets)
        rows[shape] = {
            "vertices": len(mesh.vertices), "facets": len(mesh.facets), "unmatched": unmatched,
            "euler": len(mesh.vertices) - edges + len(mesh.facets),
        }  # fmt: skip
    return Result({"rows": rows})


# Time


def stages(context: Context, backend: str, counts: list[int], threads: int | None, repeats: int = 5) -> Result:
    """Seconds of each stage of a reconstruction and of the force, by number of particles."""
    rows = []
    quadratures = ("facets",) if backend == "cuda" else ("facets", "poisson")
    with on_threads(backend, threads) as there:
        for k, (count, quadrature) in enumerate(itertools.product(counts, quadratures)):
            place = scene.lattice_block(count)
            made, surface, position = reconstruct(place, backend, "float32", timed=True, quadrature=quadrature)
            spent: dict[str, list[float]] = {}
            for _ in range(repeats):
                surface = made.surface(position)
                began = time.perf_counter()
                made.force(surface.samples, surface.blocks)
                there.synchronize()
                for name, seconds in {**surface.seconds, "force": time.perf_counter() - began}.items():
                    spent.setdefault(name, []).append(seconds)
            rows.append({
                "particles": len(place), "quadrature": quadrature,
                "samples": int(surface.samples.area.shape[0]), "nodes": nodes(surface.blocks),
                "stages": {name: float(np.median(values)) for name, values in spent.items()},
            })  # fmt: skip
            context.progress((k + 1) / (len(quadratures) * len(counts)))
    return Result({"backend": backend, "threads": threads, "rows": rows})


def beside_transfers(context: Context, backend: str, cells: int, rounds: int, repeats: int = 25) -> Result:
    """A surface and its force as a run makes them, in turns with a step of plain liquid of as many particles.

    cells  of the cube's edge, with eight particles each
    """
    from validation.experiments.mpm_droplet.runs import BLOCK, plain_block  # it imports from here

    there = choose(backend)
    place = scene.lattice_block(8 * cells**3)
    position = there.asarray((CELL * place).astype(np.float32))
    made = reconstruction_on(there, 3, "float32", CELL, Tension(surface_tension=1.0), reused=True)
    surfaces = []

    def whole() -> None:
        surfaces[:] = [made.surface(position)]
        made.force(surfaces[0].samples, surfaces[0].blocks)

    seconds, force, plain = [], [], []
    for k in range(rounds):
        for _ in range(3):  # compiled, recorded, and warm
            whole()
        seconds.append(medians(whole, there, repeats)[0])
        force.append(medians(lambda: made.force(surfaces[0].samples, surfaces[0].blocks), there, repeats)[0])
        block = {**BLOCK, "cells": cells, "room": cells + 24, "steps": 3 * 8}  # it sorts in one step of eight
        plain.append(plain_block(context, block, 1, backend)[1])
        context.progress((k + 1) / rounds)
    ratios = [a / b for a, b in zip(seconds, plain, strict=True)]
    return Result({
        "backend": backend, "particles": len(place), "samples": int(surfaces[0].samples.area.shape[0]),
        "nodes": nodes(surfaces[0].blocks), "own": seconds, "force": force, "plain": plain, "ratios": ratios,
        "ratio": float(np.median(ratios)),
    })  # fmt: skip


def normals_cost(
    context: Context, backend: str, threads: int | None, repeats: int = 15, count: int = 200_000, copies: int = 1
) -> Result:
    """Nanoseconds of a normal by MLS and by the spline's gradient, in both dtypes, at the samples of a large drop of
    `count` particles, each taken `copies` times: on a GPU a launch alone takes as long as 100,000 normals."""
    rows = []
    with on_threads(backend, threads) as there:
        for dtype in ("float32", "float64"):
            made, surface, _ = reconstruct(scene.lattice_block(count), backend, dtype, inset=-1.0)
            sample, away = (
                there.asarray(np.tile(there.host(a), (copies, 1)))
                for a in (surface.sample_place, surface.offset_direction)
            )
            calls = normal_calls(made, surface, sample, away)
            for kind, spent in beside(calls, there, repeats).items():
                seconds, spread = median_and_mad(spent)
                rows.append({
                    "dtype": dtype, "kind": kind, "normals": int(sample.shape[0]),
                    "nanoseconds": 1e9 * seconds / sample.shape[0], "spread": 1e9 * spread / sample.shape[0],
                    "turns": spent, "registers": registers(kind) if backend == "cuda" else None,
                })  # fmt: skip
            context.progress(len(rows) / 4)
    return Result({"backend": backend, "threads": threads, "rows": rows})


def normal_calls(made: Reconstruction, surface: Surface, sample: Any, away: Any) -> dict[str, Callable[[], None]]:
    """Calls that compute the normals at `sample` (s, 3) [m], by kind; `away` (s, 3) where there is no gradient."""
    there, out = made.backend, made.backend.empty(sample.shape, made.dtype)
    if there.name == "cuda":
        from refsim.surface_energy import kernels_cuda
        from refsim.surface_energy.recorded import stages
        from refsim.surface_energy.recorded.samples_cuda import find_normals

        a = kernels_cuda.normal_arrays(sample, surface.blocks, made.term, surface.coefficients, away, out)
        kinds = ("mls", np.int32(1)), ("gradient", None)
        return {kind: partial(stages.launch, a | {"mls": mls}, find_normals) for kind, mls in kinds}
    bases = made.grid.by_cell(sample, surface.blocks, 0.5)
    given = (sample, bases, surface.blocks, made.term, surface.coefficients, away, None, None, out)
    names = {"mls": "mls_normals", "gradient": "spline_normals"}
    return {kind: partial(REGISTRY[f"surface_energy.{name}"].program("cpu"), *given) for kind, name in names.items()}


def registers(kind: str) -> int:
    """Most registers that the CUDA kernel of the normals of a kind takes, as compiled so far."""
    from refsim.surface_energy.recorded.samples_cuda import find_normals

    registers_used = find_normals.dispatcher.get_regs_per_thread()
    return max(count for types, count in registers_used.items() if ("none" in str(types)) == (kind == "gradient"))


def fit_scaling(
    context: Context, backend: str, threads: list[int], count: int = 1_000_000, sweeps: int = 10, repeats: int = 7
) -> Result:
    """Seconds of the fit to the surface of a block of `count` particles, float32, on one backend.

    threads  numbers of CPU threads to time; one row without a number on a GPU
    """
    tension = {**DEFAULT, "iterations": sweeps}
    made, surface, position = reconstruct(
        scene.lattice_block(count), backend, "float32", timed=True, inset=-1.0, **tension
    )
    rows = []
    for used in threads or [0]:
        with on_threads(backend, used or None):
            seconds, spread = median_and_mad([made.surface(position).seconds["fit"] for _ in range(repeats)])
        rows.append({"threads": used, "seconds": seconds, "spread": spread})
        context.progress(len(rows) / len(threads or [0]))
    return Result({
        "backend": backend, "rows": rows, "points": 2 * int(surface.samples.area.shape[0]),
        "nodes": nodes(surface.blocks), "sweeps": sweeps,
    })  # fmt: skip


# Starts are jitters of the cloud's lattice. Times come from the experiment's run `normals_cost`.


SEEDS = (1, 2, 3, 4, 5)


def reconstruction(context: Context, seed: int, backend: str) -> Result:
    """Errors of normals by kind, jumps over edges, the fit's largest eigenvalue and what it keeps, on one cloud."""
    place = scene.cloud("sphere", RADIUS, seed)
    values: dict[str, float] = {}
    for kind in ("mls", "gradient", "facets"):
        made, surface, _ = reconstruct(place, backend, inset=-1.0, **{**DEFAULT, "normals": kind})
        normal = made.backend.host(surface.samples.normal)
        pairs = neighbouring_facets(made.backend.host(surface.mesh.facets))
        values[f"error_{kind}"] = float(angles_off(made, surface).mean())
        jump = scene.angles(normal[pairs[:, 0]], normal[pairs[:, 1]])
        values[f"jump_{kind}"] = float(np.quantile(jump, 0.95))
    least = smallest_angles(made.backend.host(surface.mesh.vertices), made.backend.host(surface.mesh.facets))
    values["slivers"] = float((least < 10).mean())
    largest = eigenvalues(fit_system(2, RADIUS, offset=0.5, seed=seed)[0])[-1]
    values["beyond_one"] = float(abs(largest - 1))
    matrix, _, active, _ = fit_system(3, RADIUS, offset=0.5, seed=seed)
    product = (matrix.T @ matrix).nnz
    values["kept_share"] = (3 * len(active) + 9 * matrix.shape[0]) / (1.5 * product + 4 * len(active))
    return Result(values)


CLOUDS = every(reconstruction, {f"claim_surface_{seed}": {"seed": seed} for seed in SEEDS}, 6.0)


def _normals(options: Options) -> list[RunSpec]:
    parameters = {"backend": options.backend, "threads": options.threads}
    return [RunSpec("normals_cost", normals_cost, parameters, estimate=3.0)]


def _normals_on_gpu(options: Options) -> list[RunSpec]:
    parameters = {"backend": "cuda", "threads": None, "count": 1_000_000, "copies": 128}
    return [RunSpec("normals_on_gpu", normals_cost, parameters, estimate=60.0, skip=unavailable("cuda") or "")]


def _fits(options: Options) -> list[RunSpec]:
    """The fit to large surfaces on four threads of a host and on its GPU."""
    missing = unavailable("cuda") or ""
    return [
        RunSpec(f"fit_on_{backend}_{count}", fit_scaling, {"backend": backend, "threads": threads, "count": count},
            estimate=15.0, skip=missing)
        for count in COUNTS for backend, threads in (("cpu", [4]), ("cuda", []))
    ]  # fmt: skip


def _gain(results: Results) -> list[float]:
    def seconds(backend: str, count: int) -> float:
        return real(results[f"fit_on_{backend}_{count}"].values["rows"][0]["seconds"])

    return [seconds("cpu", count) / seconds("cuda", count) for count in COUNTS]


COUNTS = (200_000, 400_000, 600_000, 800_000, 1_000_000)  # particles of a block whose surface is fitted
FIFTHS = 5  # into which the turns are cut: each gives a value


def _ratios(above: list[float], below: list[float]) -> list[float]:
    """The median turn's ratio in each fifth of the turns: what else the machine does slows both programs of a turn."""
    turns = np.array([real(a) / real(b) for a, b in zip(above, below, strict=True)])
    return [float(np.median(part)) for part in np.array_split(turns, FIFTHS)]


def _costs(results: Results) -> list[float]:
    """Nanoseconds of MLS normals over those of the gradient, in the dtype in which they compare worse."""
    (result,) = results.values()
    rows = {(row["dtype"], row["kind"]): row["turns"] for row in result.values["rows"]}
    both = [_ratios(rows[dtype, "mls"], rows[dtype, "gradient"]) for dtype in ("float32", "float64")]
    return max(both, key=np.median)


SURFACE_MLS_IS_CHEAPER = Measure(_normals, _costs, quick=False, timed=True)


def _registers(results: Results) -> list[float]:
    """Registers of the MLS kernel over those of the gradient's, in the dtype in which they compare worse."""
    rows = {(row["dtype"], row["kind"]): row["registers"] for row in results["normals_on_gpu"].values["rows"]}
    return [max(rows[dtype, "mls"] / rows[dtype, "gradient"] for dtype in ("float32", "float64"))]


SURFACE_MLS_TAKES_FEWER_REGISTERS = Measure(_normals_on_gpu, _registers, quick=False, timed=True)
SURFACE_FIT_SCALES = Measure(_fits, _gain, quick=False, timed=True)
SURFACE_MLS_IS_CHEAPER_ON_GPU = Measure(_normals_on_gpu, _costs, quick=False, timed=True)


def _stages(options: Options) -> list[RunSpec]:
    parameters = {"backend": options.backend, "counts": [20_000, 40_000, 60_000, 80_000, 100_000], "threads": 1}
    return [RunSpec("claim_stages", stages, parameters, estimate=20.0)]


def _over_facets(results: Results) -> list[float]:
    """Seconds of the normals, without the fit, over those of areas, centroids and normals of the mesh's facets."""
    rows = [row["stages"] for row in results["claim_stages"].values["rows"] if row["quadrature"] == "facets"]
    return [stage["normals"] / stage["samples"] for stage in rows]


SURFACE_MLS_CHEAPER_THAN_MESH = Measure(_stages, _over_facets, quick=False, timed=True)
SURFACE_FIT_CONVERGES = Measure(CLOUDS, each("beyond_one"))
SURFACE_FIT_KEEPS_LITTLE = Measure(CLOUDS, each("kept_share"))
SURFACE_FACETS_ARE_SLIVERS = Measure(CLOUDS, each("slivers"))
SURFACE_FIT_SMOOTHS_NORMALS = Measure(CLOUDS, each("jump_mls", "jump_facets"))
SURFACE_MLS_AS_GOOD_AS_GRADIENT = Measure(CLOUDS, each("error_mls", "error_gradient"))

# Null models


def _unweighted(measure: Measure) -> list[float]:
    """The iteration (3.6) with equal weights in the place of (3.7)."""
    matrix, _, _, _ = fit_system(2, RADIUS, offset=0.5, seed=SEEDS[0])
    dense = matrix.toarray()
    return measure.of({"": {"beyond_one": float(abs(np.linalg.eigvalsh(dense.T @ dense)[-1] - 1))}})


def _equilateral(measure: Measure) -> list[float]:
    """Triangles with equal sides."""
    corner = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.75**0.5, 0.0]])
    least = smallest_angles(corner, np.array([[0, 1, 2]]))
    return measure.of({"": {"slivers": float((least < 10).mean())}})


def _random_normals(measure: Measure) -> list[float]:
    """MLS normals in random directions, beside gradients that are off by 5 degrees."""
    true, guess = np.random.default_rng(1).normal(size=(2, 1000, 3))
    true, guess = (each / np.linalg.norm(each, axis=1)[:, None] for each in (true, guess))
    errors = {"error_mls": scene.angles(guess, true).mean(), "error_gradient": 5.0}
    return measure.of({"": {name: float(value) for name, value in errors.items()}})


def _same_time(measure: Measure) -> list[float]:
    """All programs take the same time and the same registers."""
    same = {"turns": [0.01] * 9, "seconds": 0.01, "registers": 64}
    rows = [{"dtype": d, "kind": kind, **same} for d in ("float32", "float64") for kind in ("mls", "gradient")]
    return measure.of({"": {"rows": rows}})


# A surface out of particles: how good its normals are, how the fit converges, how good the mesh is, what it costs.


NORMALS = {  # check: setting and part of its errors
    "best_mean": ("gradient_0.25_1", "mean"), "best_max": ("gradient_0.25_1", "max"),
    "default_mean": ("mls_0.5_10", "mean"), "default_max": ("mls_0.5_10", "max"), "facet_mean": ("facets", "mean"),
}  # fmt: skip


def planned(options: Options) -> list[RunSpec]:
    """The runs under the options."""
    quick, backend, threads = options.quick, {"backend": options.backend}, {"threads": options.threads}
    slow = "takes a minute with the others; run without --quick" if quick else ""
    on_gpu = slow if options.backend == "cuda" else "a bar for the GPU, measured with --backend cuda"
    counts = [8_000, 64_000] if quick else [8_000, 64_000, 1_000_000]
    return [
        *(RunSpec(f"normals_{shape}", normal_errors, {"shape": shape, **backend}, 8.0) for shape in RADII),
        RunSpec("meshes", meshes, backend, 2.0),
        RunSpec("stages", stages, {"counts": counts, **backend, **threads}, 4.0 if quick else 30.0),
        RunSpec("beside_transfers", beside_transfers, {"cells": 50, "rounds": 3, **backend}, 30.0, on_gpu),
        RunSpec("normals_cost", normals_cost, {**backend, **threads}, 3.0),
    ]  # fmt: skip


def checks(results: Results, check: Checks) -> None:
    """Normals, topology and convergence; absolute times are shown."""
    for shape in RADII:
        quantities = {name: lambda v, key=key, part=part: v["rows"][key][part] for name, (key, part) in NORMALS.items()}
        check.run(results, f"normals_{shape}", quantities, shape)
        for name in ("euler", "unmatched"):
            check.run(results, "meshes", {name: lambda v, name=name, shape=shape: v["rows"][shape][name]}, shape)
    for row in results["stages"].values["rows"] if "stages" in results else ():
        label = f"{row['particles']:,} particles, {row['quadrature']}"
        check("stage_time", 1e3 * sum(row["stages"].values()), f"{row['particles']}_{row['quadrature']}", label)
    if "beside_transfers" in results:
        values = results["beside_transfers"].values
        check("over_transfers", values["ratio"], "cuda", f"{values['particles']:,} particles")


EXPERIMENT = Experiment(
    name="surface_reconstruction", title="a surface out of particles: normals, convergence of the fit, meshes, time",
    runs=planned, checks=checks,
)  # fmt: skip
