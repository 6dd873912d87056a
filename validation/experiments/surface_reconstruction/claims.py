"""What the thesis claims of its reconstructed surface (chapter 3), measured on particle clouds cut by a sphere.

Starts are jitters of the cloud's lattice. Times come from the experiment's runs `solvers` and `normals_cost`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from refsim.backends.arrays import unavailable
from validation.experiment import Family, Measure, Options, Results, Run, alike
from validation.experiments.surface_reconstruction import runs, shapes
from validation.results import Result, real
from validation.running import Context

SEEDS = (1, 2, 3, 4, 5)


def reconstruction(context: Context, seed: int, backend: str) -> Result:
    """Errors of normals by kind, jumps over edges, the fit's largest eigenvalue and what it keeps, on one cloud."""
    place = shapes.cloud("sphere", runs.RADIUS, seed)
    values: dict[str, float] = {}
    for kind in ("mls", "gradient", "facets"):
        parameters = {**runs.DEFAULT, "normals": kind}
        made, surface, _ = runs.reconstruct(place, backend, inset=-1.0, **parameters)
        sample = made.backend.host(surface.samples.position) / runs.CELL
        normal = made.backend.host(surface.samples.normal)
        true = shapes.true_normals(sample, "sphere", runs.RADIUS)
        pairs = runs.neighbouring_facets(made.backend.host(surface.mesh.facets))
        values[f"error_{kind}"] = float(shapes.angles(normal, true).mean())
        jump = shapes.angles(normal[pairs[:, 0]], normal[pairs[:, 1]])
        values[f"jump_{kind}"] = float(np.quantile(jump, 0.95))
    least = runs.smallest_angles(made.backend.host(surface.mesh.vertices), made.backend.host(surface.mesh.facets))
    values["slivers"] = float((least < 10).mean())
    matrix, _, active, _ = runs.fit_system(2, runs.RADIUS, offset=0.5, seed=seed)
    dense = matrix.toarray()
    root = np.sqrt(1 / dense.sum(0))
    largest = np.linalg.eigvalsh(root[:, None] * (dense.T @ dense) * root[None, :])[-1]
    values["beyond_one"] = float(abs(largest - 1))
    matrix, _, active, _ = runs.fit_system(3, runs.RADIUS, offset=0.5, seed=seed)
    product = (matrix.T @ matrix).nnz
    values["kept_share"] = (3 * len(active) + 9 * matrix.shape[0]) / (1.5 * product + 4 * len(active))
    return Result(values)


def _clouds(options: Options) -> list[Run]:
    return [
        Run(f"claim_surface_{seed}", reconstruction, {"seed": seed, "backend": options.backend}, estimate=6.0)
        for seed in SEEDS
    ]


def _each(value: Callable[[Result], float]) -> Callable[[Results], list[float]]:
    return lambda results: [value(result) for result in results.values()]


def _ratio(above: str, below: str) -> Callable[[Results], list[float]]:
    return _each(lambda result: real(result.values[above]) / real(result.values[below]))


def _solvers(options: Options) -> list[Run]:
    return [Run("solvers", runs.solvers, {"threads": options.threads}, estimate=30.0)]


def _normals(options: Options) -> list[Run]:
    parameters = {"backend": options.backend, "threads": options.threads}
    return [Run("normals_cost", runs.normals_cost, parameters, estimate=3.0)]


def _normals_on_gpu(options: Options) -> list[Run]:
    parameters = {"backend": "cuda", "threads": None, "count": 1_000_000, "copies": 128}
    return [Run("normals_on_gpu", runs.normals_cost, parameters, estimate=60.0, skip=unavailable("cuda") or "")]


def _fits(options: Options) -> list[Run]:
    """The fit to large surfaces on four threads of a host and on its GPU."""
    missing = unavailable("cuda") or ""
    return [
        Run(f"fit_on_{backend}_{count}", runs.fit_scaling, {"backend": backend, "threads": threads, "count": count},
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


def _times(above: str, below: str) -> Callable[[Results], list[float]]:
    """Seconds of one solver over those of another; "most" in a name stands for all threads."""

    def values(results: Results) -> list[float]:
        found = results["solvers"].values
        seconds = {row["name"]: row["turns"] for row in found["rows"]}
        first, second = (name.replace("most", str(found["threads"])) for name in (above, below))
        return _ratios(seconds[first], seconds[second])

    return values


def _costs(results: Results) -> list[float]:
    """Nanoseconds of MLS normals over those of the gradient, in the dtype in which they compare worse."""
    (found,) = results.values()
    rows = {(row["dtype"], row["kind"]): row["turns"] for row in found.values["rows"]}
    both = [_ratios(rows[dtype, "mls"], rows[dtype, "gradient"]) for dtype in ("float32", "float64")]
    return max(both, key=np.median)


SURFACE_FIT_BEATS_GRADIENTS = Measure(_solvers, _times("cg_10", "lspia_10_most"), quick=False, timed=True)
SURFACE_FIT_BEATS_FACTORS = Measure(_solvers, _times("direct", "lspia_10_most"), quick=False, timed=True)
SURFACE_MLS_IS_CHEAPER = Measure(_normals, _costs, quick=False, timed=True)


def _registers(results: Results) -> list[float]:
    """Registers of the MLS kernel over those of the gradient's, in the dtype in which they compare worse."""
    rows = {(row["dtype"], row["kind"]): row["registers"] for row in results["normals_on_gpu"].values["rows"]}
    return [max(rows[dtype, "mls"] / rows[dtype, "gradient"] for dtype in ("float32", "float64"))]


SURFACE_MLS_TAKES_FEWER_REGISTERS = Measure(_normals_on_gpu, _registers, quick=False, timed=True)
SURFACE_FIT_SCALES = Measure(_fits, _gain, quick=False, timed=True)
SURFACE_MLS_IS_CHEAPER_ON_GPU = Measure(_normals_on_gpu, _costs, quick=False, timed=True)
SURFACE_FIT_CONVERGES = Measure(_clouds, _each(lambda result: real(result.values["beyond_one"])))
SURFACE_FIT_KEEPS_LITTLE = Measure(_clouds, _each(lambda result: real(result.values["kept_share"])))
SURFACE_FACETS_ARE_SLIVERS = Measure(_clouds, _each(lambda result: real(result.values["slivers"])))
SURFACE_FIT_SMOOTHS_NORMALS = Measure(_clouds, _ratio("jump_mls", "jump_facets"))
SURFACE_MLS_AS_GOOD_AS_GRADIENT = Measure(_clouds, _ratio("error_mls", "error_gradient"))

# Null models


def _unweighted(measure: Measure) -> list[float]:
    """The iteration (3.6) with equal weights in the place of (3.7)."""
    matrix, _, _, _ = runs.fit_system(2, runs.RADIUS, offset=0.5, seed=SEEDS[0])
    dense = matrix.toarray()
    return measure.of({"": {"beyond_one": float(abs(np.linalg.eigvalsh(dense.T @ dense)[-1] - 1))}})


def _equilateral(measure: Measure) -> list[float]:
    """Triangles with equal sides."""
    corner = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.75**0.5, 0.0]])
    least = runs.smallest_angles(corner, np.array([[0, 1, 2]]))
    return measure.of({"": {"slivers": float((least < 10).mean())}})


def _random_normals(measure: Measure) -> list[float]:
    """MLS normals in random directions, beside gradients that are off by 5 degrees."""
    true, guess = np.random.default_rng(1).normal(size=(2, 1000, 3))
    true, guess = (each / np.linalg.norm(each, axis=1)[:, None] for each in (true, guess))
    found = {"error_mls": shapes.angles(guess, true).mean(), "error_gradient": 5.0}
    return measure.of({"": {name: float(value) for name, value in found.items()}})


def _same_time(measure: Measure) -> list[float]:
    """All programs take the same time and the same registers."""
    turns, solvers = [0.01] * 9, ("lspia_10_1", "lspia_10_2", "cg_10", "direct")
    rows = [
        {"name": name, "turns": turns, "seconds": 0.01, "dtype": "", "kind": name, "registers": 64} for name in solvers
    ]
    rows += [
        {"dtype": dtype, "kind": kind, "turns": turns, "registers": 64, "name": "", "seconds": 0.01}
        for dtype in ("float32", "float64") for kind in ("mls", "gradient")
    ]  # fmt: skip
    return measure.of({"": {"rows": rows, "threads": 2}})


FAMILIES = (
    Family(
        ("surface_fit_converges",), "The largest eigenvalue could be another than one.",
        "equal weights instead of (3.7)",
        _unweighted,
    ),
    Family(
        ("surface_fit_keeps_little",), "The fit could keep as much as the normal equations take.",
        "a fit that keeps as much", alike({"kept_share": 1.0}),
    ),
    Family(
        ("surface_facets_are_slivers",), "Marching cubes could make well-shaped triangles.", "equilateral triangles",
        _equilateral,
    ),
    Family(
        ("surface_fit_smooths_normals",), "Fitted normals could jump as much as those of facets.", "both jump alike",
        alike({"jump_mls": 0.2, "jump_facets": 0.2}),
    ),
    Family(
        ("surface_mls_as_good_as_gradient",), "MLS normals could be farther from the surface's than the gradient's.",
        "normals in random directions", _random_normals,
    ),
    Family(
        (
            "surface_fit_scales", "surface_fit_beats_gradients", "surface_fit_beats_factors", "surface_mls_is_cheaper",
            "surface_mls_is_cheaper_on_gpu", "surface_mls_takes_fewer_registers",
        ),
        "The program could take as long, or as many registers, as the one that it is compared with.",
        "both take the same", _same_time,
    ),
)  # fmt: skip
