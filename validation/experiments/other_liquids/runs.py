"""The same flows by refsim's liquids, PySPH and SPlisHSPlasH, judged by one program (docs/solutions.md).

2D, equal particles from one lattice, equal viscosities and sound speeds; kernels, steps and schemes are each program's
own. Every run takes one thread; its seconds are processor time of the steps, the first one apart. refsim runs in
float64, h = 3.2 d in vortices and cavity and 3 d elsewhere. The floating cube is in 3D.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim import Box, BoxWalls, Gravity, ParticleShifting, Scene, Simulation, WeaklyCompressible
from refsim.scene.plan import make_plan
from validation.checks import Checks
from validation.experiment import Experiment, Options, Results, RunSpec
from validation.experiments.liquid.runs import ICE, draught, submerged
from validation.metrics.dam_break import dimensionless_time, fit_time_offset, front_position, load_front_data
from validation.metrics.liquid import centre_lines, rest, vortex, vortex_error
from validation.peers import missing, pysph_flows, splishsplash
from validation.peers.pysph_flows import BOX, DENSITY, GRAVITY, LIQUID, SOUND
from validation.results import Result
from validation.running import Context

REYNOLDS, ARTIFICIAL = 100.0, 0.02  # of vortices and cavity; alpha whose kinematic viscosity the tank has
TIMES = {  # s of the samples; what is judged is their mean
    "vortices": [1.0], "tank": [3.5 + 0.05 * k for k in range(11)], "cavity": [14.0 + 0.1 * k for k in range(11)],
    "dam": [0.02 * k for k in range(1, 42)], "body": [3.5 + 0.05 * k for k in range(11)],
}  # fmt: skip
CELLS = {"vortices": (25, 50, 100), "tank": (16, 32), "cavity": (25, 50), "dam": (20,), "body": (12,)}
SUPPORT = {"vortices": 3.2, "tank": 3.0, "cavity": 3.2, "dam": 3.0}  # spacings
OWN = {
    "vortices": ("papers", "rests", "corrected"), "tank": ("papers", "rests"), "cavity": ("rests", "corrected"),
    "dam": ("papers", "rests"), "body": ("rests",),
}  # fmt: skip
SCHEMES = {  # of PySPH
    "vortices": ("wcsph", "tvf", "edac"), "tank": ("wcsph", "adami", "edac"), "cavity": ("tvf", "edac"),
    "dam": ("wcsph", "adami", "edac"), "body": (),
}  # fmt: skip
METHODS = {"tank": ("dfsph", "wcsph"), "body": ("dfsph",)}  # of SPlisHSPlasH
STEPS = {"vortices": 20, "tank": 150, "cavity": 250, "dam": 400, "body": 2000}  # times the cells, for the progress bar
EDGE, WIDE, BOTTOM = 5, 20, 5  # cells of the floating cube, of its tank, and below the cube at the start

Sample = tuple[float, NDArray, NDArray]  # moment, positions, velocities


def viscosity(flow: str, cells: int) -> float:
    """Kinematic viscosity [m^2/s]."""
    return ARTIFICIAL * 0.5 * SUPPORT[flow] / cells * SOUND[flow] / 8 if flow in LIQUID else 1 / REYNOLDS


def judged(flow: str, cells: int, samples: Sequence[Sample]) -> dict[str, float]:
    """Errors of one flow: {"error"}, and {"level_off"} of a tank."""
    if flow == "body":
        found = [draught(x[1:], x[0, 2], EDGE, WIDE, 1 / cells) for _, x, _ in samples]
        return {"error": abs(float(np.mean(found)) - ICE / DENSITY)}
    if flow == "dam":
        front = [front_position(x, 1 / cells).connected for _, x, _ in samples]
        moments = dimensionless_time([at for at, _, _ in samples], 1.0, GRAVITY)
        return {"error": fit_time_offset(moments, front, load_front_data("koshizuka_oka")).rms}
    if flow == "vortices":
        return {"error": vortex_error(samples[-1][1], samples[-1][2], samples[-1][0], REYNOLDS)}
    if flow == "cavity":
        reach = SUPPORT[flow] / cells
        off = centre_lines([(x, v) for _, x, v in samples], reach)[1]
        return {"error": float(max(np.abs(part).max() for part in off))}
    found = [rest(x, v, LIQUID[flow][1], SOUND[flow]) for _, x, v in samples]
    return {"error": float(np.mean([row["moving"] for row in found])), "level_off": found[-1]["level_off"]}


def _scene(flow: str, kind: str, cells: int) -> Scene:
    spacing = 1.0 / cells
    own: dict[str, Any] = {"density": "summation", "clamp_pressure": flow in LIQUID}
    if kind != "papers":
        own = {"density": "continuity", "gradient": "corrected" if kind == "corrected" else "plain"}
    sound, nu = SOUND.get(flow, 10.0), viscosity(flow, cells)
    liquid = WeaklyCompressible(
        rest_density=DENSITY, sound_speed=sound, dynamic_viscosity=DENSITY * nu, viscosity="central", **own
    )
    effects: list[Any] = [liquid]
    model: Any = "mirrored" if kind == "papers" else "extrapolated"
    walls: dict[str, Any] = {"lower": (0.0, 0.0, 0.0), "model": model}
    if flow == "vortices" and kind != "papers":
        effects.append(ParticleShifting(surface="none"))
    elif flow in LIQUID:
        effects += [Gravity(acceleration=(0.0, -GRAVITY, 0.0)), BoxWalls(upper=(*BOX[flow], 0.0), **walls)]
    elif flow == "cavity":
        lid: dict[str, Any] = {"moving_faces": ("+y",), "velocity": (1.0, 0.0, 0.0), "viscosity": 2 * DENSITY * nu}
        effects.append(BoxWalls(upper=(1.0, 1.0, 0.0), **walls, **lid))
    return Scene(
        name=flow, dim=2, dtype="float64", spacing=spacing, support_radius=SUPPORT[flow] * spacing,
        period=(1.0, 1.0, 0.0) if flow == "vortices" else (0.0, 0.0, 0.0),
        fluid=(Box(cells=(*(cells * part for part in LIQUID.get(flow, (1, 1))), 1)),), effects=tuple(effects),
    )  # fmt: skip


def floating(cells: int) -> Scene:
    """A cube of ice, released under water."""
    return submerged((EDGE, EDGE), BOTTOM, (WIDE, cells), 3.0, ARTIFICIAL)


def _sample(simulation: Simulation) -> Sample:
    """Velocities are taken to the moment of the positions."""
    v = simulation.field("velocity") + 0.5 * simulation.previous_length * simulation.field("acceleration")
    x, dim = simulation.field("position"), simulation.plan.grid.dim
    if simulation.plan.scene.solid:  # its centre comes first
        x, v = (np.vstack([values[: EDGE**3].mean(0), values[EDGE**3 :]]) for values in (x, v))
    return simulation.time, x[:, :dim], v[:, :dim]


def of_refsim(context: Context, flow: str, kind: str, cells: int, threads: int, backend: str) -> Result:
    """error  of the flow, level_off  of a tank; seconds  of the processor."""
    scene = floating(cells) if flow == "body" else _scene(flow, kind, cells)
    simulation = context.simulation(scene, backend, threads)
    if flow == "vortices":
        x = simulation.field("position")[:, :2]
        start = np.zeros((simulation.count, 3))
        start[:, :2] = vortex(x, 0.0, REYNOLDS)
        simulation.set_field("velocity", start)
        if kind != "papers":
            excess = -0.25 * DENSITY * np.cos(4 * np.pi * x).sum(1) / 10.0**2
            simulation.set_field("advanced_excess", excess)
    simulation.step()
    samples, spent = [], 0.0
    for at in TIMES[flow]:
        began = time.process_time()
        while simulation.time < at:
            simulation.step()
        spent += time.process_time() - began
        samples.append(_sample(simulation))
        context.progress(simulation.time / TIMES[flow][-1])
    return _result("refsim", flow, kind, cells, samples, spent)


def of_pysph(context: Context, flow: str, kind: str, cells: int, threads: int) -> Result:
    """The same by PySPH; version."""
    more = {"viscosity": viscosity(flow, cells)} if flow in LIQUID else {}
    found = pysph_flows.run(flow, kind, cells, TIMES[flow], **more)
    return _of_peer("PySPH", flow, kind, cells, found)


def of_splishsplash(context: Context, flow: str, kind: str, cells: int, threads: int) -> Result:
    """The same by SPlisHSPlasH; version."""
    if flow == "body":
        start, count = make_plan(floating(cells)).state.position, EDGE**3
        settings = {
            "water": start[count:], "centre": start[:count].mean(0).tolist(), "edge": EDGE / cells, "density": ICE,
            "wide": WIDE / cells, "spacing": 1 / cells, "viscosity": ARTIFICIAL * 1.5 / cells * SOUND["tank"] / 10,
        }  # fmt: skip
        found = splishsplash.run_body(settings | {"times": TIMES[flow]}, threads)
    else:
        settings = {"cells": cells, "method": kind, "sound": SOUND[flow], "viscosity": viscosity(flow, cells)}
        found = splishsplash.run_tank(settings | {"times": TIMES[flow]}, threads)
    return _of_peer("SPlisHSPlasH", flow, kind, cells, found)


def _of_peer(program: str, flow: str, kind: str, cells: int, found: dict[str, Any]) -> Result:
    if "missing" in found:
        return Result({"program": program, "flow": flow, "kind": kind, "cells": cells, "missing": found["missing"]})
    dim = 3 if flow == "body" else 2
    moments = zip(found["time"], found["position"], found["velocity"])
    samples = [(float(at), x[:, :dim], v[:, :dim]) for at, x, v in moments]
    made = _result(program, flow, kind, cells, samples, found["seconds"])
    return Result(made.values | {"version": found["version"]})


def _result(program: str, flow: str, kind: str, cells: int, samples: list[Sample], seconds: float) -> Result:
    row = {"program": program, "flow": flow, "kind": kind, "cells": cells, "particles": len(samples[-1][1])}
    return Result(row | judged(flow, cells, samples) | {"seconds": seconds, "until": samples[-1][0]})


def planned(options: Options) -> list[RunSpec]:
    """Every flow by every scheme; with --quick vortices of 625 particles by refsim's liquid that rests."""
    if options.quick:
        return [_run(of_refsim, "refsim", "vortices", "rests", 25, options)]
    made = []
    for flow, sizes in CELLS.items():
        for cells in sizes:
            made += [_run(of_refsim, "refsim", flow, kind, cells, options) for kind in OWN[flow]]
            made += [_run(of_pysph, "pysph", flow, kind, cells, options) for kind in SCHEMES[flow]]
            methods = METHODS.get(flow, ())
            made += [_run(of_splishsplash, "splishsplash", flow, kind, cells, options) for kind in methods]
    return made


def _run(function: Any, program: str, flow: str, kind: str, cells: int, options: Options) -> RunSpec:
    row: dict[str, Any] = {"flow": flow, "kind": kind, "cells": cells, "threads": 1}
    skip = ""
    if function is of_refsim:
        row["backend"] = options.backend
    elif not options.peers:
        skip = "measured with --peers"
    else:
        skip = missing("pysph_flows" if function is of_pysph else "splishsplash")
    estimate = 2e-6 * STEPS[flow] * cells**3
    return RunSpec(f"{flow}_{program}_{kind}_{cells}", function, row, estimate=estimate, skip=skip, rough=True)


def checks(results: Results, check: Checks) -> None:
    """Errors and seconds are shown; refsim's best has a smaller error than every peer at equal particles."""
    for flow, sizes in CELLS.items():
        for cells in sizes:
            rows = {key: r.values for key, r in results.items() if key.startswith(f"{flow}_") and "error" in r.values}
            rows = {key: row for key, row in rows.items() if row["cells"] == cells}
            for key, row in rows.items():
                where = f"{row['program']}, {row['kind']}, {cells} particles along a side"
                check("error", row["error"], key, where)
                check("seconds", row["seconds"], key, where)
            own = [row["error"] for row in rows.values() if row["program"] == "refsim" and row["kind"] != "papers"]
            others = [row["error"] for row in rows.values() if row["program"] != "refsim"]
            if own and others:
                check("over_best_peer", min(own) / min(others), f"{flow}_{cells}", f"{flow}, {cells} along a side")


EXPERIMENT = Experiment(
    name="other_liquids", title="flows of liquids by refsim, PySPH and SPlisHSPlasH", runs=planned,
    checks=checks,
)  # fmt: skip
