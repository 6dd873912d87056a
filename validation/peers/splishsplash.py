"""SPlisHSPlasH on the same work: in a process of its own.

block  its WCSPH on a block of liquid that spins. Equation of state, viscosity, step and support radius (2 spacings) are
       those of `timing.runs.spinning_block`. The neighbour search runs in every step, as that program does it. With
       the surface tension of Akinci et al. 2013, where a coefficient is given.
drop   its DFSPH with the surface tension of Akinci et al. 2013, on a cube of liquid that becomes a drop.
column its DFSPH on a column of liquid that collapses in a tank, in 2D; walls are its sampled boundary particles.

Coefficients are set through its own interface: what a scene file says of them it does not read in every version.
"""

import ctypes.util
import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from refsim.core.writing import write_file
from validation.peers import launch, stopwatch

CELLS = 47  # spacings along 1 m
SPIN = 5.0  # rad/s
STEP = 5e-4  # s
DENSITY = 1000.0  # kg/m^3
STIFFNESS = 9e5  # rho0 c^2 [Pa], exponent 1
VISCOSITY = 0.01  # kinematic [m^2/s]
GAP = 0.25  # spacings more than one from the tank's particles: without it the corner is too dense and is shot off
WARM = 3  # steps that are not counted


def run(side: int, steps: int, threads: int, tension: float = 0.0) -> dict[str, Any]:
    """Time `steps` steps of side^3 particles: {"particles", "seconds" (mean of a step), "version"} or {"missing"}.

    tension  its one coefficient of cohesion and area term after Akinci et al. 2013; 0 for none
    """
    return launched("splishsplash", {"work": "block", "side": side, "steps": steps, "tension": tension}, threads)


def run_drop(settings: Mapping[str, Any], threads: int) -> dict[str, Any]:
    """A cube of side^3 particles becomes a drop: {"time", "wall", "error" (lists), "particles", "steps", "version"} or
    {"missing"}.

    settings  "side", "tension" (its coefficient gamma of cohesion), "viscosity" (kinematic [m^2/s]), "step" (largest
              step [s]), "until" [s], "samples" and "shake" (seed of the small displacements at the start); rest
              density 1000 kg/m^3, side of 1 m

    Seconds, in "wall", count stepping alone, from the first step on (`stopwatch`).
    """
    return launched("splishsplash", {"work": "drop", **settings}, threads)


def run_column(settings: Mapping[str, Any], threads: int) -> dict[str, Any]:
    """A column of width a and height 2 a collapses in 2D: {"time", "wall", "front" (lists), "particles", "steps",
    "version"} or {"missing"}; the front is that of the connected liquid from the column's wall [m].

    settings  "columns" (particles along a), "width" (a [m]), "length", "height" (of the tank [m]), "viscosity"
              (kinematic [m^2/s]), "step" (largest step [s]), "times" (of the samples [s]) and "shake" (seed of the
              small displacements at the start); rest density 1000 kg/m^3

    Seconds, in "wall", count stepping alone, from the first step on (`stopwatch`).
    """
    return launched("splishsplash", {"work": "column", **settings}, threads)


def graphics_libraries() -> dict[str, str]:
    """LD_PRELOAD for its process: its window libraries must be there before Python's own, even without a window."""
    graphics = [name for name in map(ctypes.util.find_library, ("GLdispatch", "GLX")) if name]
    return {"LD_PRELOAD": ":".join([*graphics, *os.environ.get("LD_PRELOAD", "").split()])} if graphics else {}


def launched(program: str, given: Mapping[str, Any], threads: int, limit: float = 300.0) -> dict[str, Any]:
    """What a module of this program answers."""
    environment = {"OMP_NUM_THREADS": str(threads), **graphics_libraries()}
    return launch(program, given, environment, limit)


WCSPH = {"simulationMethod": 0, "cflMethod": 0}
DFSPH = {"simulationMethod": 4, "cflMethod": 1, "cflFactor": 0.5}


def scene(
    spacing: float, configuration: Mapping[str, Any], block: Mapping[str, Any], tension: bool, **more: Any
) -> dict[str, Any]:  # fmt: skip
    """A scene file of one block of liquid with its standard viscosity and, if asked for, Akinci's tension of 2013."""
    liquid = {"id": "Fluid", "density0": DENSITY, "viscosityMethod": 1, "surfaceTensionMethod": 2 if tension else 0}
    return {
        "Configuration": {"particleRadius": 0.5 * spacing, "gravitation": [0.0, 0.0, 0.0], **configuration},
        "Materials": [liquid], "FluidBlocks": [{"denseMode": 0, "id": "Fluid", **block}], **more,
    }  # fmt: skip


def coefficients(peer: Any, viscosity: float, tension: float, stiffness: float = 0.0) -> Any:
    """Set them, those of its WCSPH where a stiffness is given; returns the liquid."""
    fluid = peer.Simulation.getCurrent().getFluidModel(0)
    fluid.getViscosityBase().setValueFloat(peer.Viscosity_Standard.VISCOSITY_COEFFICIENT, viscosity)
    if tension:
        fluid.getSurfaceTensionBase().setValueFloat(peer.SurfaceTension_Akinci2013.SURFACE_TENSION, tension)
    if stiffness:
        method = peer.Simulation.getCurrent().getTimeStep()
        method.setValueFloat(peer.TimeStepWCSPH.STIFFNESS, stiffness)
        method.setValueFloat(peer.TimeStepWCSPH.EXPONENT, 1.0)
    return fluid


def watched(
    peer: Any, base: Any, times: Sequence[float], see: Callable[[Any], dict[str, float]], coefficients_given: tuple,
    spacing: float, shake: int, flat: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """Run from a shaken lattice: moments, seconds and what `see(positions)` says at the `times`."""
    import numpy as np

    from validation.metrics.shapes import jittered

    series: dict[str, Any] = {"time": [], "wall": []}
    clock = {"last": 0.0, "spent": 0.0, "steps": 0}

    def after_step() -> None:
        clock["spent"] += stopwatch() - clock["last"]
        clock["steps"] += 1
        now = peer.TimeManager.getCurrent().getTime()
        if len(series["time"]) < len(times) and now >= times[len(series["time"])]:
            model = peer.Simulation.getCurrent().getFluidModel(0)
            position = np.array(model.getFieldBuffer("position"))[: model.numActiveParticles()]
            for name, value in {"time": now, "wall": clock["spent"], **see(position)}.items():
                series.setdefault(name, []).append(float(value))
        clock["last"] = stopwatch()

    base.setTimeStepCB(after_step)
    base.initSimulation()
    fluid = coefficients(peer, *coefficients_given)
    lattice = np.array(fluid.getFieldBuffer("position"))[: fluid.numActiveParticles()].astype(float)
    for i, place in enumerate(jittered(lattice, spacing, shake)):
        fluid.setPosition(i, (place * [1.0, 1.0, 0.0] if flat else place).astype(np.float32))
    clock["last"] = stopwatch()
    base.runSimulation()
    return {
        **series, "particles": int(fluid.numActiveParticles()), "lowest": lattice.min(0).tolist(),
        "highest": lattice.max(0).tolist(), "steps": clock["steps"],
    }  # fmt: skip


def block(side: int, steps: int, tension: float) -> dict[str, Any]:
    """Run the spinning block in this process."""
    import numpy as np
    import pysplishsplash as peer

    spacing = 1.0 / CELLS
    liquid = {"start": [0.0] * 3, "end": [(side + 0.5) * spacing] * 3, "initialAngularVelocity": [0.0, 0.0, SPIN]}
    settings = WCSPH | {"timeStepSize": STEP, "stopAt": STEP * (steps + WARM + 2)}
    base = simulator(peer, scene(spacing, settings, liquid, tension > 0))
    moments: list[float] = []
    base.setTimeStepCB(lambda: moments.append(time.perf_counter()))
    base.initSimulation()
    fluid = coefficients(peer, VISCOSITY, tension, STIFFNESS)
    particles = fluid.numActiveParticles()
    base.runSimulation()
    spent = np.diff(moments)[WARM : WARM + steps]
    return {"particles": int(particles), "seconds": float(np.mean(spent)), "steps": len(spent)}


def drop(
    side: int, tension: float, viscosity: float, step: float, until: float, samples: int, shake: int
) -> dict[str, Any]:
    """Run the drop in this process."""
    import pysplishsplash as peer

    from validation.metrics.droplet import radius_variation

    spacing = 1.0 / side
    settings = DFSPH | {"cflMaxTimeStepSize": step, "timeStepSize": step, "stopAt": until}
    liquid = {"start": [0.0] * 3, "end": [1.0 + 0.5 * spacing] * 3}
    base = simulator(peer, scene(spacing, settings, liquid, True))
    times = [k * until / samples for k in range(samples + 2)]

    def see(position: Any) -> dict[str, float]:
        return {"error": radius_variation(position)}

    return watched(peer, base, times, see, (viscosity, tension), spacing, shake)


def column(
    columns: int, width: float, length: float, height: float, viscosity: float, step: float, times: list[float],
    shake: int,
) -> dict[str, Any]:  # fmt: skip
    """Run the column in this process; the front counts from half a spacing before its first particles."""
    import pysplishsplash as peer
    import trimesh

    from validation.metrics.dam_break import front_position

    spacing = width / columns
    write_file("box.obj", trimesh.creation.box((1.0, 1.0, 1.0)).export(file_type="obj"))
    settings = DFSPH | {
        "sim2D": True, "gravitation": [0.0, -9.81, 0.0], "boundaryHandlingMethod": 0,  # Akinci et al. 2012
        "cflMaxTimeStepSize": step, "timeStepSize": step, "stopAt": times[-1],
    }  # fmt: skip
    tank = {
        "geometryFile": "box.obj", "translation": [0.5 * length, 0.5 * height, 0.0],
        "scale": [length, height, 4.0 * width], "isDynamic": False, "isWall": True, "mapInvert": True,
        "samplingMode": 1,
    }  # fmt: skip
    liquid = {
        "start": [GAP * spacing, GAP * spacing, -width],
        "end": [width + (1.0 + GAP) * spacing, 2.0 * width + (1.0 + GAP) * spacing, width],
    }
    base = simulator(peer, scene(spacing, settings, liquid, False, RigidBodies=[tank]))

    def see(position: Any) -> dict[str, float]:
        front = front_position(position[:, :2].astype(float), spacing)
        return {"front": front.connected - (0.5 + GAP) * spacing}

    return watched(peer, base, times, see, (viscosity, 0.0), spacing, shake, flat=True)


def simulator(peer: Any, scene: Mapping[str, Any], **options: Any) -> Any:
    """Its simulator with a scene file in the working folder."""
    write_file("scene.json", json.dumps(scene))
    base, paths = peer.Exec.SimulatorBase(), {"sceneFile": "scene.json", "outputDir": "output"}
    made = {name: os.path.abspath(path) for name, path in paths.items()}
    base.init(useGui=False, initialPause=False, **made, **options)
    return base


def work(work: str, **given: Any) -> dict[str, Any]:
    """One of the three."""
    return {"block": block, "drop": drop, "column": column}[work](**given)
