"""Flows of a weakly compressible liquid by PySPH, in a process of its own.

vortices  its example `taylor_green`; tank  a tank at rest of its EDAC scheme, with three layers of wall particles.
Kernel (a quintic spline of radius 3 d), step and scheme are its own; c is ten times the largest speed, as refsim's. One
thread; the seconds are processor time from the first step on.
"""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from validation.peers import launch

LAYERS = 3  # of wall particles, as many as the support is wide
GRAVITY, DENSITY = 9.81, 1000.0  # m/s^2, kg/m^2
DEPTH, BOX = 1, (1, 2)  # of the tank: m deep, m wide and high
SOUND = 10 * GRAVITY**0.5  # m/s, of the tank


def run(flow: str, scheme: str, cells: int, times: Sequence[float], **more: float) -> dict[str, Any]:
    """The liquid at the `times` [s]: {"time" (samples,), "position", "velocity" (samples, n, 2), "pressure" (samples,
    n), "seconds", "steps", "version"}, or {"missing"}.

    flow    "vortices" (in a box of 1 m, Re 100) or "tank" (`viscosity` [m^2/s])
    scheme  of the vortices, the name that PySPH gives it; cells: particles along 1 m
    """
    given = {"flow": flow, "scheme": scheme, "cells": cells, "times": list(times), **more}
    return launch("pysph_flows", given, {"OMP_NUM_THREADS": "1"}, 7200.0)


def _tank(cells: int, viscosity: float) -> type:
    """A column of liquid between three walls, for PySPH's scheme EDAC; it begins at rest."""
    from pysph.base.kernels import QuinticSpline
    from pysph.base.utils import get_particle_array
    from pysph.solver.application import Application
    from pysph.sph.wc.edac import EDACScheme

    spacing, step = 1.0 / cells, 0.25 / cells / (1.1 * SOUND)

    class Tank(Application):
        def create_particles(self) -> list:
            places = np.indices((BOX[0] * cells + 2 * LAYERS, BOX[1] * cells + LAYERS)).reshape(2, -1).T - LAYERS
            inside = ((places >= 0) & (places < np.multiply(BOX, cells))).all(1)
            wet = inside & (places[:, 1] < DEPTH * cells)
            arrays = []
            for name, chosen in (("fluid", wet), ("solid", ~inside)):
                x, y = ((places[chosen] + 0.5) * spacing).T
                pressure = DENSITY * GRAVITY * np.maximum(DEPTH - y, 0)
                density = DENSITY + pressure / SOUND**2
                same = {"m": DENSITY * spacing**2, "rho": density, "p": pressure, "h": spacing}
                arrays.append(get_particle_array(name=name, x=x, y=y, **same))
            self.scheme.setup_properties(arrays)
            for array in arrays:
                if "V" in array.properties:
                    array.V[:] = 1 / spacing**2
            return arrays

        def create_scheme(self) -> Any:
            both = {"dim": 2, "rho0": DENSITY, "c0": SOUND, "nu": viscosity, "gy": -GRAVITY}
            made = EDACScheme(["fluid"], ["solid"], h=spacing, **both)
            made.configure_solver(kernel=QuinticSpline(dim=2), dt=step, tf=1.0, pfreq=10**9)
            return made

    return Tank


def work(flow: str, scheme: str, cells: int, times: list[float], viscosity: float = 0.0) -> dict[str, Any]:
    """Run one flow in this process."""
    options = ["--pfreq", str(10**9), "--tf", repr(times[-1] + 1e-9), "-d", "output", "--no-openmp"]
    if flow == "vortices":
        from pysph.examples.taylor_green import TaylorGreen as Flow

        options += ["--scheme", scheme, "--nx", str(cells), "--re", "100"]
    else:
        Flow = _tank(cells, viscosity)
    seen: dict[str, list[NDArray | float]] = {"time": [], "position": [], "velocity": [], "pressure": []}
    clock = {"began": 0.0, "steps": 0}

    class Watched(Flow):  # type: ignore[misc, valid-type]
        def pre_step(self, solver: Any) -> None:
            if clock["steps"] == 1:
                clock["began"] = time.process_time()

        def post_step(self, solver: Any) -> None:
            clock["steps"] += 1
            now = solver.t + solver.dt  # `t` is that of the step's start
            while len(seen["time"]) < len(times) and now >= times[len(seen["time"])] - 1e-9:
                fluid = next(array for array in self.particles if array.name == "fluid")
                seen["time"].append(float(now))
                for name, parts in (("position", ("x", "y")), ("velocity", ("u", "v"))):
                    values = [fluid.get(part, only_real_particles=True) for part in parts]
                    seen[name].append(np.column_stack(values))
                seen["pressure"].append(fluid.get("p", only_real_particles=True).copy())

    Watched().run(options)
    spent = time.process_time() - clock["began"]
    series = {name: np.array(values) for name, values in seen.items()}
    return {**series, "seconds": spent, "steps": clock["steps"]}
