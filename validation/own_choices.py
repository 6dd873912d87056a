"""What the papers' own choices give: `python -m validation own`, `literal = "paper"` beside refsim's defaults.

One scene of each system, which the rest of validation takes, too; nothing differs but the preset. The numbers stand in
figures/own_choices.json and, from there, on docs/study.md.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from refsim import Cloud, Dong2016, HeatConduction, RunStopped, Scene, Simulation
from refsim.core.writing import write_file
from refsim.scene.plan import make_plan
from validation.running import Context

ROOT = Path(__file__).resolve().parent.parent
STORED = ROOT / "figures" / "own_choices.json"
Measured = dict[str, Any]  # "value", and "remark" on how the run ended


def _drop(changes: Mapping[str, Any]) -> Measured:
    """Radius variation of the drop that a cube of 13^3 particles has become after 2.2 s."""
    from validation.experiments.droplet.runs import outcome, relaxed

    result = relaxed(Context(), "", changes, "cube", 13**3, "cpu", samples=24)
    return {"value": result.values["end"]["radius_variation"], "remark": outcome(result)}


def jiang_zhu(literal: tuple[str, ...]) -> Measured:
    """The drop of the panel `droplet`."""
    return _drop({"literal": literal, "tension": {"literal": literal}})


def detection(literal: tuple[str, ...]) -> Measured:
    """1 - F1 of the panel `detection_2d`, against the exact cover."""
    from refsim.study.panels import FOLDER
    from refsim.study.panels.scenes import changed, packaged
    from validation.metrics.surface_truth import detection_score

    given = ("effects.surface_detection", {"literal": literal}), ("dtype", "float64")
    simulation = Simulation(changed(packaged("detection_2d"), given))
    simulation.evaluate()
    score = detection_score(simulation.field("surface"), np.load(FOLDER / "detection_2d.npz")["surface"])
    return {"value": 1 - score.f1, "remark": f"precision {score.precision:.3f}, recall {score.recall:.3f}"}


def dong(literal: tuple[str, ...]) -> Measured:
    """The same drop under Dong's tension, with the kernels and the support of docs/models.md."""
    effects = (Dong2016(surface_tension=1.0, literal=literal),)
    return _drop({"effects": effects, "support": 2.7, "kernels": "wendland"})


def thesis(literal: tuple[str, ...]) -> Measured:
    """Off 1: pressure over Laplace's of the square of 12 cells of docs/errata.md, at the step of that table."""
    from validation.experiments.mpm_droplet.runs import follow
    from validation.experiments.mpm_droplet.scene import box, drop_scene

    scene = drop_scene(box([12.0] * 2), 2, tension={"literal": literal}, liquid={"literal": literal})
    run = Simulation(scene)
    try:
        ledger, _, stopped = follow(Context(), run, 0.15, 60)
    except RunStopped as stop:
        return {"value": None, "remark": f"stops: {stop.reason} in step {run.steps}"}
    off = None if stopped else abs(ledger.summary()["pressure"] - 1)
    return {"value": off, "remark": f"stops: {stopped}" if stopped else ""}


def shao_song(literal: tuple[str, ...]) -> Measured:
    """Error of half a cosine in an insulated slab of 40 spacings, k dt/(rho c d^2) = 2, over its range."""
    from validation.metrics import heat as exact

    d, cells, until, steps = 0.2, 40, 6.4, 80
    axes = [(np.arange(n) + 0.5) * d for n in (cells, 6, 6)]
    place = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    stored = 1.0 if literal else 4.0e6  # rho c [J/(m^3 K)]: the paper's K is a diffusivity (M11)
    heat = HeatConduction(
        temperature=tuple(exact.cosine(place[:, 0], cells * d, 0.0)), conductivity=stored, heat_capacity=4000.0,
        density=1000.0, literal=literal,
    )  # fmt: skip
    scene = Scene(spacing=d, support_radius=2.5 * d, dtype="float64", step=until / steps, period=(0.0, 6 * d, 6 * d),
                  fluid=(Cloud(position=place),), effects=(heat,))  # fmt: skip
    run = Simulation(scene)
    first = run.field("temperature").astype(float)
    for _ in range(steps):
        run.step()
    last = run.field("temperature").astype(float)
    error = np.sqrt(((last - exact.cosine(place[:, 0], cells * d, until)) ** 2).mean()) / np.ptp(first)
    lost = float(first.mean() - last.mean())
    return {"value": float(error), "remark": f"mean temperature {-lost:+.2g} K" if abs(lost) > 1e-9 else "heat kept"}


def patent(literal: tuple[str, ...]) -> Measured:
    """Pressure of the tank of the panel `tank_pressure`, root mean square over that at the bottom.

    Its density is summed; mirrored walls stand for a layer half a spacing beyond the mesh, where the water begins.
    """
    from refsim.study.observables import observable_of
    from refsim.study.panels import panel
    from refsim.study.panels.scenes import changed, scene_of
    from refsim.study.runs import Setting, measure

    of = panel("tank_pressure")
    scene = scene_of(of, of.points["n10"])
    d = scene.spacing
    liquid = {"density": "summation", "gradient": "plain", "dynamic_viscosity": 8.4}
    changes = {f"effects.weakly_compressible.{name}": value for name, value in liquid.items()} | {
        "effects.mesh_boundary.literal": literal, "fluid.1.lower": [0.5 * d] * 3, "fluid.1.cells": [9, 9, 10],
        "support_radius": 3.0 * d,
    }  # fmt: skip
    scene = changed(scene, list(changes.items()))
    trial = measure(Setting("", "", 1.0, scene, "cpu"), observable_of(f"panel:{of.name}", make_plan(scene)))
    return {"value": None if trial.failed else trial.value, "remark": f"stops: {trial.failed}" * bool(trial.failed)}


# paper, effects with the preset, scene and measure
ROWS: dict[str, tuple[str, str, str, Callable[[tuple[str, ...]], Measured]]] = {
    "jiang_zhu": (
        "Jiang & Zhu (E9, E23, E6, E24, E32, E33)", "`weakly_compressible`, `jiang_zhu_2023`",
        "radius variation of a drop that was a cube of 13^3, 2.2 s (a settled drop: 0.005)", jiang_zhu,
    ),
    "detection": (
        "Jiang & Zhu (E23, E6, E33)", "`surface_detection`", "wrong surface particles, 1 - F1, splash in 2D", detection
    ),
    "dong": ("Dong (E21, E31)", "`dong_2016`", "radius variation of the same drop, h = 2.7 d", dong),
    "thesis": (
        "thesis (M4, M6, M9, M10, M31, M32, M37)", "`mpm_liquid`, `surface_energy`",
        "pressure off Laplace's, square of 12 cells, 0.15 s", thesis,
    ),
    "shao_song": (
        "Shao & Song (M6, M7, M8, M11, M26)", "`heat_conduction`",
        "temperature, insulated slab of 40 spacings, k dt/(rho c d^2) = 2, of the range", shao_song,
    ),
    "patent": ("patent (E27, E30, P8)", "`mesh_boundary`", "pressure of a tank at rest, of rho g H", patent),
}  # fmt: skip


def measure() -> dict[str, Any]:
    """Every row by refsim's default and by the paper's own choices."""
    return {name: {"refsim": row[-1](()), "paper": row[-1](("paper",))} for name, row in ROWS.items()}


def _shown(trial: Measured) -> str:
    if trial["value"] is None:
        return trial["remark"]
    value = f"{trial['value']:.2g}" if trial["value"] < 0.1 else f"{trial['value']:.3g}"
    return f"{value} ({trial['remark']})" if trial["remark"] else value


def markdown() -> list[str]:
    """The table of docs/study.md, from what is stored."""
    head = ['| paper | measured | refsim\'s default | `literal = "paper"` |', "| --- | --- | --- | --- |"]
    return head + [
        f"| {ROWS[name][0]} | {ROWS[name][2]} | {_shown(row['refsim'])} | {_shown(row['paper'])} |"
        for name, row in json.loads(STORED.read_text(encoding="utf-8")).items()
    ]


def write() -> Path:
    """Measure and store; returns the path."""
    write_file(STORED, json.dumps(measure(), indent=1) + "\n")
    return STORED
