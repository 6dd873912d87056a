"""What the thesis claims of its reconstructed surface (chapter 3), measured on particle clouds cut by a sphere.

Starts are jitters of the cloud's lattice. What is about time stands in the case's tables `solvers` and `normals_cost`,
which want a quiet machine.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from validation.cases.surface_reconstruction import runs, shapes
from validation.claims import Measure
from validation.harness import Options, Results, Run
from validation.results import Result, real
from validation.running import Context

SEEDS = (1, 2, 3)


def reconstruction(context: Context, seed: int, backend: str) -> Result:
    """Errors of normals by kind, jumps over edges, the fit's largest eigenvalue and what it keeps, on one cloud."""
    place = shapes.cloud("sphere", runs.RADIUS, seed)
    values: dict[str, float] = {}
    for kind in ("mls", "gradient", "facets"):
        parameters = {**runs.DEFAULT, "normals": kind}
        made, surface, _ = runs.reconstruct(place, backend, inset=None, **parameters)
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


FIT_CONVERGES = Measure(_clouds, _each(lambda result: real(result.values["beyond_one"])))
FIT_KEEPS_LITTLE = Measure(_clouds, _each(lambda result: real(result.values["kept_share"])))
FACETS_ARE_SLIVERS = Measure(_clouds, _each(lambda result: real(result.values["slivers"])))
FIT_SMOOTHS_NORMALS = Measure(_clouds, _ratio("jump_mls", "jump_facets"))
MLS_AS_GOOD_AS_GRADIENT = Measure(_clouds, _ratio("error_mls", "error_gradient"))
