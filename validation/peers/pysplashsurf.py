"""pysplashsurf on the same particles: in a process of its own.

surface  the time of a reconstruction
normals  normals at the vertices of its surface, and the time of its whole pipeline: marching cubes, and with rounds of
         smoothing its weighted smoothing of the mesh and ten rounds for the normals

Its marching cubes run on a colour field of SPH: particle radius a quarter of a cell of refsim, which has 2^3 particles,
smoothing length twice that radius and the threshold as its own guide recommends, all threads that it is given. For
normals the smoothing length is three radii: with two, the jittered particles enclose voids, whose walls count.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from validation.peers import launch, stopwatch

THRESHOLD = 0.6
REPEATS = 3
LASTS = 0.05  # s of a reading of the normals, at least


def run(position: np.ndarray, cell_size: float, threads: int) -> dict[str, Any]:
    """Reconstruct the surface of particles (n, 3) [m] in a process of its own.

    {"seconds" (median of its calls), "facets", "version"} or {"missing"}.
    """
    return _launch({"work": "surface", "position": position, "cell": cell_size}, threads)


def run_normals(position: np.ndarray, cell_size: float, share: float, smoothing: int, threads: int) -> dict[str, Any]:
    """Normals on the surface of particles (n, 3) [m] in a process of its own.

    share      of `cell_size` [m] that a cell of its marching cubes has
    smoothing  rounds of smoothing of the mesh; 0 for none

    {"seconds" (mean of its calls), "place" (m, 3) [m], "normal" (m, 3), "version"} or {"missing"}.
    """
    given = {"work": "normals", "position": position, "cell": cell_size, "share": share, "smoothing": smoothing}
    return _launch(given, threads)


def _launch(given: Mapping[str, Any], threads: int) -> dict[str, Any]:
    return launch("pysplashsurf", given, {"RAYON_NUM_THREADS": str(threads)})


def surface(position: np.ndarray, cell: float) -> dict[str, Any]:
    """Time the reconstruction in this process."""
    import pysplashsurf

    radius = cell / 4
    spent, facets = [], 0
    for _ in range(REPEATS):
        began = stopwatch()
        made = pysplashsurf.reconstruct_surface(
            position, particle_radius=radius, smoothing_length=2.0, cube_size=cell / radius,
            iso_surface_threshold=THRESHOLD, multi_threading=True, simd=True,
        )  # fmt: skip
        spent.append(stopwatch() - began)
        facets = len(made.mesh.triangles)
    if abs(made.grid.cell_size / cell - 1) > 1e-4:  # lengths are meant in radii, whatever its guide says
        raise RuntimeError(f"its cells are {made.grid.cell_size:g} m instead of {cell:g} m")
    return {"seconds": float(np.median(spent)), "facets": facets}


def normals(position: np.ndarray, cell: float, share: float, smoothing: int) -> dict[str, Any]:
    """Time the pipeline with normals in this process."""
    import pysplashsurf

    radius = cell / 4

    def computed() -> Any:
        return pysplashsurf.reconstruction_pipeline(
            position, particle_radius=radius, smoothing_length=3.0, cube_size=share * cell / radius,
            iso_surface_threshold=THRESHOLD, compute_normals=True, multi_threading=True, simd=True,
            **({"mesh_cleanup": True, "mesh_smoothing_iters": smoothing, "normals_smoothing_iters": 10}
               if smoothing else {}),
        )[0]  # fmt: skip

    made, calls, began = computed(), 0, stopwatch()
    while (spent := stopwatch() - began) < LASTS:
        made, calls = computed(), calls + 1
    normal = np.asarray(made.point_attributes["normals"])
    return {"seconds": spent / calls, "place": np.asarray(made.mesh.vertices), "normal": normal}


def work(work: str, **given: Any) -> dict[str, Any]:
    """Either of both."""
    return {"surface": surface, "normals": normals}[work](**given)
