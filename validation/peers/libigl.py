"""libigl's signed distance of a mesh: in a process of its own.

Its pseudonormal sign, which is right on every closed mesh. Building its tree is not counted.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from validation.peers import launch, stopwatch


def run(vertices: np.ndarray, faces: np.ndarray, place: np.ndarray, threads: int) -> dict[str, Any]:
    """Signed distances at `place` (n, 3) [m] in a process of its own.

    {"seconds_per_query", "tree" [s to build it], "distance" (n,), "version"} or {"missing"}.
    """
    environment = {"OMP_NUM_THREADS": str(threads), "IGL_NUM_THREADS": str(threads)}
    given = {"vertices": vertices, "faces": faces, "place": place}
    return launch("libigl", given, environment)


def work(vertices: np.ndarray, faces: np.ndarray, place: np.ndarray) -> dict[str, Any]:
    """Time the queries in this process."""
    import igl

    vertices, faces, place = np.asarray(vertices, float), np.asarray(faces, np.int64), np.asarray(place, float)
    kind = igl.SIGNED_DISTANCE_TYPE_PSEUDONORMAL
    igl.signed_distance(place[:10], vertices, faces, sign_type=kind)
    began = stopwatch()
    igl.signed_distance(place[:1], vertices, faces, sign_type=kind)
    tree = stopwatch() - began
    began = stopwatch()
    found = igl.signed_distance(place, vertices, faces, sign_type=kind)
    spent = max(stopwatch() - began - tree, 0.0)  # the tree is built once for a field of any size
    return {"seconds_per_query": spent / len(place), "tree": tree, "distance": np.asarray(found[0])}
