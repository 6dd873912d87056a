"""SPlisHSPlasH's surface sampling: in a process of its own.

Its Python calls of the samplers take a single vertex, so the mesh goes in as the rigid body of a scene, whose boundary
data it then makes: it reads the file and samples it with Poisson disks, its default. Both are counted. Its disks pack
less densely: a disk's radius is `scale` times that of the particles, for as many of them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from refsim.core.writing import write_file
from validation.peers import stopwatch
from validation.peers.splishsplash import launched, simulator

SCALE = 1.44  # for 10,000 particles on a sphere, and less for more particles


def run(vertices: np.ndarray, faces: np.ndarray, radius: float, threads: int, scale: float = SCALE) -> dict[str, Any]:
    """Sample a mesh with disks of `scale` times `radius` [m], in a process of its own.

    {"seconds", "particles", "position" (n, 3) [m], "version"} or {"missing"}.
    """
    given = {"vertices": vertices, "faces": faces, "radius": scale * radius}
    return launched("splishsplash_sampling", given, threads, 600.0)


def work(vertices: np.ndarray, faces: np.ndarray, radius: float) -> dict[str, Any]:
    """Start a simulation with the mesh in this process, and return what was sampled."""
    import pysplishsplash as peer

    folder = Path.cwd()
    rows = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices]
    rows += [f"f {a} {b} {c}" for a, b, c in np.asarray(faces) + 1]
    write_file(folder / "mesh.obj", "\n".join(rows) + "\n")
    scene = {
        "Configuration": {"particleRadius": radius, "simulationMethod": 4, "boundaryHandlingMethod": 0,
                          "timeStepSize": 1e-3, "stopAt": 1e-3},
        "Materials": [{"id": "Fluid", "density0": 1000.0}],
        "RigidBodies": [
            {
                "geometryFile": str(folder / "mesh.obj"), "translation": [0, 0, 0], "rotationAxis": [1, 0, 0],
                "rotationAngle": 0, "scale": [1, 1, 1], "isDynamic": False, "isWall": False, "samplingMode": 0,
            }
        ],
        "FluidBlocks": [
            {"denseMode": 0, "start": [9.0, 9.0, 9.0], "end": [9.0 + 6 * radius] * 3, "id": "Fluid"}
        ],
    }  # fmt: skip
    base = simulator(peer, scene, useCache=False)
    base.initSimulation()
    began = stopwatch()
    base.getBoundarySimulator().initBoundaryData()
    seconds = stopwatch() - began
    model = peer.Simulation.getCurrent().getBoundaryModel(0)
    count = model.numberOfParticles()
    position = np.array([model.getPosition(i) for i in range(count)])
    return {"seconds": seconds, "particles": count, "position": position}
