"""pysplashsurf on the same particles, in a process of its own: the time of a reconstruction.

Its marching cubes run on a colour field of SPH: particle radius a quarter of a cell of refsim, which has 2^3 particles,
smoothing length twice that radius and the threshold as its own guide recommends, all threads that it is given.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from validation.peers import launch, stopwatch

THRESHOLD = 0.6
REPEATS = 3


def run(position: np.ndarray, cell_size: float, threads: int) -> dict[str, Any]:
    """Reconstruct the surface of particles (n, 3) [m] in a process of its own.

    {"seconds" (median of its calls), "facets", "version"} or {"missing"}.
    """
    given = {"position": position, "cell": cell_size}
    return launch("pysplashsurf", given, {"RAYON_NUM_THREADS": str(threads)})


def work(position: np.ndarray, cell: float) -> dict[str, Any]:
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
