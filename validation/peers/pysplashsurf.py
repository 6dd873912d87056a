"""pysplashsurf on the same particles: `python -m validation.peers.pysplashsurf FOLDER`, a folder that `run` fills.

Its marching cubes run on a colour field of SPH: cells of the same size, particle radius a quarter of a cell (2^3
particles to a cell), smoothing length twice that radius and the threshold as its own guide recommends, all threads that
it is given.
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

THRESHOLD = 0.6
REPEATS = 3
TIME_LIMIT = 300.0  # s


def missing() -> str:
    """Why the program cannot run here, or ""."""
    if importlib.util.find_spec("pysplashsurf") is None:
        return "pysplashsurf is not installed; run pip install pysplashsurf"
    return ""


def run(position: np.ndarray, cell_size: float, threads: int) -> dict[str, Any]:
    """Reconstruct the surface of particles (n, 3) [m] in a process of its own.

    {"seconds" (median of its calls), "facets", "version"} or {"missing"}.
    """
    with tempfile.TemporaryDirectory() as folder:
        np.save(Path(folder) / "position.npy", position)
        (Path(folder) / "spec.json").write_text(json.dumps({"cell_size": cell_size}))
        environment = {**os.environ, "RAYON_NUM_THREADS": str(threads)}
        try:
            done = subprocess.run(
                [sys.executable, "-m", "validation.peers.pysplashsurf", folder],
                capture_output=True, text=True, env=environment, timeout=TIME_LIMIT, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return {"missing": f"pysplashsurf was not done after {TIME_LIMIT:g} s"}
    if done.returncode != 0:
        return {"missing": f"pysplashsurf failed: {(done.stderr.strip().splitlines() or ['no words'])[-1]}"}
    return json.loads(done.stdout.splitlines()[-1])


def main(folder: Path) -> int:
    """Time the reconstruction of the particles in `folder` and print what was found."""
    import pysplashsurf

    position = np.load(folder / "position.npy")
    cell = json.loads((folder / "spec.json").read_text())["cell_size"]
    radius = cell / 4
    spent, facets = [], 0
    for _ in range(REPEATS):
        began = time.perf_counter()
        made = pysplashsurf.reconstruct_surface(
            position, particle_radius=radius, smoothing_length=2.0, cube_size=cell / radius,
            iso_surface_threshold=THRESHOLD, multi_threading=True, simd=True,
        )  # fmt: skip
        spent.append(time.perf_counter() - began)
        facets = len(made.mesh.triangles)
    if abs(made.grid.cell_size / cell - 1) > 1e-4:  # lengths are meant in radii, whatever its guide says
        raise RuntimeError(f"its cells are {made.grid.cell_size:g} m instead of {cell:g} m")
    print(
        json.dumps(
            {
                "seconds": float(np.median(spent)), "facets": facets,
                "version": importlib.metadata.version("pysplashsurf"),
            }
        )
    )  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
