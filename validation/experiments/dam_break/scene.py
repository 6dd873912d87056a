"""Stored moments of the dam break, so that detectors are measured on the same cloud whatever becomes of the flow.

`python -m validation measure states` computes them anew (some minutes); what they were made with stands in each file.
"""

import json
from typing import Any

import numpy as np

from refsim.core.writing import made_by, write_file
from refsim.study.panels import FOLDER

STATES = {"dam_break_2d": FOLDER / "detection_2d.npz", "dam_break_3d": FOLDER / "detection_3d.npz"}
# Name: columns, particles across, moment [s]. In 2D the wave that came back breaks, in 3D the front has hit the wall.
STORED = {"dam_break_2d": (60, 1, 1.0), "dam_break_3d": (16, 16, 0.6)}
TANK = 4.0  # column widths


def perform(given: Any) -> None:
    """Compute and store every moment."""
    from refsim import Simulation
    from validation.experiments.dam_break.runs import TRUTH_RADIUS, column_scene
    from validation.metrics.surface_truth import arc_cover_surface, cap_cover_surface
    from validation.reading import environment
    from validation.running import run_to

    for name, (columns, depth, moment) in STORED.items():
        simulation = Simulation(column_scene(columns, depth, TANK), backend="cpu", threads=1)
        run_to(simulation, moment)
        where = environment(1, "cpu")
        made = {"time": simulation.time, "steps": simulation.steps, "commit": where["commit"],
                "versions": where["versions"], "dtype": "float32"}  # fmt: skip
        fields = {field: simulation.field(field) for field in ("position", "mass")}
        walls = simulation.plan.walls.position
        cover = arc_cover_surface if depth == 1 else cap_cover_surface
        fields["surface"] = cover(fields["position"], TRUTH_RADIUS * simulation.plan.grid.spacing, walls)
        write_file(STATES[name], made_by(np.savez_compressed, made=np.array(json.dumps(made)), **fields))
        print(name, simulation.count, "particles", made, flush=True)
