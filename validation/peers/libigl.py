"""libigl's signed distance of a mesh: `python -m validation.peers.libigl FOLDER`, a folder that `run` fills.

Its pseudonormal sign, which is right on every closed mesh. Building its tree is not counted.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

TIME_LIMIT = 300.0  # s


def missing() -> str:
    """Why the program cannot run here, or ""."""
    return "" if importlib.util.find_spec("igl") else "libigl is not installed; run pip install libigl"


def run(vertices: np.ndarray, faces: np.ndarray, place: np.ndarray, threads: int) -> dict[str, Any]:
    """Signed distances at `place` (n, 3) [m] in a process of its own.

    {"seconds_per_query", "distance" (n,), "version"} or {"missing"}.
    """
    if missing():
        return {"missing": missing()}
    with tempfile.TemporaryDirectory() as folder:
        np.savez(Path(folder) / "given.npz", vertices=vertices, faces=faces, place=place)
        environment = {**os.environ, "OMP_NUM_THREADS": str(threads), "IGL_NUM_THREADS": str(threads)}
        command = [sys.executable, "-m", "validation.peers.libigl", folder]
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, env=environment, timeout=TIME_LIMIT, check=False
            )
        except subprocess.TimeoutExpired:
            return {"missing": f"libigl was not done after {TIME_LIMIT:g} s"}
        if done.returncode != 0:
            return {"missing": f"libigl failed: {(done.stderr.strip().splitlines() or ['no words'])[-1]}"}
        answer = json.loads(done.stdout.splitlines()[-1])
        answer["distance"] = np.load(Path(folder) / "distance.npy")
        return answer


def main(folder: Path) -> int:
    """Time the queries in `folder`."""
    import igl

    given = np.load(folder / "given.npz")
    vertices, faces = np.asarray(given["vertices"], float), np.asarray(given["faces"], np.int64)
    place = np.asarray(given["place"], float)
    kind = igl.SIGNED_DISTANCE_TYPE_PSEUDONORMAL
    igl.signed_distance(place[:10], vertices, faces, sign_type=kind)
    began = time.perf_counter()
    igl.signed_distance(place[:1], vertices, faces, sign_type=kind)
    tree = time.perf_counter() - began
    began = time.perf_counter()
    found = igl.signed_distance(place, vertices, faces, sign_type=kind)
    spent = max(time.perf_counter() - began - tree, 0.0)  # the tree is built once for a field of any size
    np.save(folder / "distance.npy", np.asarray(found[0]))
    print(json.dumps({"seconds_per_query": spent / len(place), "tree": tree,
                      "version": importlib.metadata.version("libigl")}))  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
