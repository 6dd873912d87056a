"""SPlisHSPlasH's WCSPH on a block of liquid that spins: `python -m validation.peers.splishsplash SIDE STEPS`.

Equation of state, viscosity, step and support radius (2 spacings) are those of `timing.runs.spinning_block`. The
neighbour search runs in every step, as that program does it.
"""

from __future__ import annotations

import ctypes.util
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

CELLS = 47  # spacings along 1 m
SPIN = 5.0  # rad/s
STEP = 5e-4  # s
DENSITY = 1000.0  # kg/m^3
STIFFNESS = 9e5  # rho0 c^2 [Pa], exponent 1
VISCOSITY = 0.01  # kinematic [m^2/s]
WARM = 3  # steps that are not counted
TIME_LIMIT = 300.0  # s


def missing() -> str:
    """Why the program cannot run here, or ""."""
    if importlib.util.find_spec("pysplishsplash") is None:
        return "pySPlisHSPlasH is not installed; run pip install pySPlisHSPlasH"
    return ""


def run(side: int, steps: int, threads: int) -> dict[str, Any]:
    """Time `steps` steps of side^3 particles: {"particles", "seconds" (mean of a step), "version"} or {"missing"}."""
    environment = {**os.environ, "OMP_NUM_THREADS": str(threads)}
    # Its window libraries must be there before Python's own are loaded, even when no window is opened.
    graphics = [name for name in map(ctypes.util.find_library, ("GLdispatch", "GLX")) if name]
    if graphics:
        environment["LD_PRELOAD"] = ":".join([*graphics, *environment.get("LD_PRELOAD", "").split()])
    root = str(Path(__file__).resolve().parent.parent.parent)
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, [root, environment.get("PYTHONPATH", "")]))
    command = [sys.executable, "-m", "validation.peers.splishsplash", str(side), str(steps)]
    with tempfile.TemporaryDirectory() as folder:
        try:
            done = subprocess.run(
                command, cwd=folder, env=environment, capture_output=True, text=True, timeout=TIME_LIMIT, check=False
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            return {"missing": f"SPlisHSPlasH did not run ({error})"}
        answer = Path(folder) / "answer.json"
        if done.returncode != 0 or not answer.exists():
            last = (done.stderr.strip() or done.stdout.strip() or "no message").splitlines()[-1]
            return {"missing": f"SPlisHSPlasH ended with code {done.returncode}: {last}"}
        return json.loads(answer.read_text())


def main(side: int, steps: int) -> None:
    """Run in this process and write answer.json into the working folder."""
    import numpy as np
    import pysplishsplash as peer

    spacing = 1.0 / CELLS
    scene = {
        "Configuration": {
            "particleRadius": 0.5 * spacing,
            "simulationMethod": 0,  # WCSPH
            "gravitation": [0.0, 0.0, 0.0],
            "cflMethod": 0,
            "timeStepSize": STEP,
            "stiffness": STIFFNESS,
            "exponent": 1,
            "stopAt": STEP * (steps + WARM + 2),
        },
        "Materials": [
            {
                "id": "Fluid",
                "density0": DENSITY,
                "viscosityMethod": 1,  # standard
                "viscosity": VISCOSITY,
                "surfaceTensionMethod": 0,
            }
        ],
        "FluidBlocks": [
            {
                "denseMode": 0,
                "start": [0.0, 0.0, 0.0],
                "end": [(side + 0.5) * spacing] * 3,
                "id": "Fluid",
                "initialAngularVelocity": [0.0, 0.0, SPIN],
            }
        ],
    }
    Path("scene.json").write_text(json.dumps(scene))
    base = peer.Exec.SimulatorBase()
    base.init(
        sceneFile=os.path.abspath("scene.json"), useGui=False, initialPause=False, outputDir=os.path.abspath("output")
    )
    moments: list[float] = []
    base.setTimeStepCB(lambda: moments.append(time.perf_counter()))
    base.initSimulation()
    particles = peer.Simulation.getCurrent().getFluidModel(0).numActiveParticles()
    base.runSimulation()
    spent = np.diff(moments)[WARM : WARM + steps]
    answer = {
        "particles": int(particles),
        "seconds": float(np.mean(spent)),
        "steps": len(spent),
        "version": importlib.metadata.version("pySPlisHSPlasH"),
    }
    Path("answer.json").write_text(json.dumps(answer))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
