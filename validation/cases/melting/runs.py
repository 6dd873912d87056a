"""Runs of melting: the figures' scenes stage by stage, and what the tables of a body look like while they are filled."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from refsim import Simulation
from refsim.shape_matching.phases import FLUID, INTERIOR, NOBODY, SURFACE
from validation.cases.melting.scene import FIGURES, SPACING, scene_of
from validation.results import Result
from validation.running import Context, first_call_seconds, search_log, stage_seconds

EVERY = 10  # steps between two entries of a series
LARGEST_TEMPERATURE = 250  # as a byte in steps of half a degree, from -25 deg C


class Watch:
    """What is seen of a melting scene from step to step."""

    def __init__(self, simulation: Simulation) -> None:
        self.simulation = simulation
        self.solid = self._phase() != FLUID
        self.phase = self._phase()
        self.inside_melted = 0  # particles that melted without having been at a surface
        self.together = 0  # most that melted in one step
        self.series: dict[str, list[float]] = {}

    def _phase(self) -> np.ndarray:
        return self.simulation.field("phase")

    def after_step(self) -> None:
        """Compare with the step before."""
        now = self._phase()
        melted = (self.phase != FLUID) & (now == FLUID)
        self.inside_melted += int((self.phase[melted] != SURFACE).sum())
        self.together = max(self.together, int(melted.sum()))
        self.phase = now

    def note(self) -> dict[str, float]:
        """An entry of the series."""
        s = self.simulation
        field = {name: s.field(name).astype(float) for name in ("mass", "rest_density", "density", "temperature")}
        row = {
            "time": s.time,
            "solid": int((self.phase != FLUID).sum()),
            "inside": int((self.phase == INTERIOR).sum()),
            "fragments": fragments(s.field("direct")),
            "mass": float(field["mass"].sum()),
            "rest_volume": float((field["mass"] / field["rest_density"]).sum()),
            "fastest": float(np.linalg.norm(s.field("velocity").astype(float), axis=1).max()),
            "densest": float((field["density"] / field["rest_density"]).max()),
            "coldest": float(field["temperature"].min()),
            "hottest": float(field["temperature"].max()),
        }
        for name, value in row.items():
            self.series.setdefault(name, []).append(value)
        return row


def fragments(direct: np.ndarray) -> int:
    """Pieces of solid that hang together over direct neighbours."""
    node, slot = np.nonzero(direct != NOBODY)
    if not len(node):
        return 0
    there = np.unique(node)
    graph = coo_array((np.ones(len(node)), (node, direct[node, slot])), shape=(len(direct),) * 2)
    _, label = connected_components(graph, directed=False)
    return len(np.unique(label[there]))


def melt(
    context: Context, figure: str, size: float, backend: str, shares: list[float], until: float, **options: Any
) -> Result:
    """A figure's scene until `until` [s]: frames at the start and whenever the share of solid has fallen to `shares`."""
    setting = FIGURES[figure](size)
    simulation = context.simulation(scene_of(figure, size, **options), backend)
    watch = Watch(simulation)
    arrays: dict[str, np.ndarray] = {}
    times: list[float] = []
    whole = int(watch.solid.sum())
    waiting = sorted(shares, reverse=True)
    frame(simulation, arrays, times)
    watch.note()
    while simulation.time < until - 1e-9:
        simulation.step()
        watch.after_step()
        left = int((watch.phase != FLUID).sum())
        if simulation.steps % EVERY == 0:
            watch.note()
            context.progress(max(simulation.time / until, 1 - left / whole))
        if waiting and left <= waiting[0] * whole:
            while waiting and left <= waiting[0] * whole:
                waiting.pop(0)
            frame(simulation, arrays, times)
            if not waiting:
                break
    watch.note()
    bodies = np.diff(simulation.plan.grid.solids.lattice.first)
    values = {
        "figure": figure, "size": size, "options": options, "particles": simulation.count, "solids": bodies,
        "tank": [SPACING * c for c in setting.tank], "colours": [colour for colour, *_ in setting.bodies],
        "densities": [density for _, density, *_ in setting.bodies],
        "temperatures": [setting.solid_temperature, setting.water_temperature],
        "bookkeeping": setting.bookkeeping, "times": times, "series": watch.series, "steps": simulation.steps,
        "inside_melted": watch.inside_melted, "together": watch.together,
        "stages": stage_seconds(simulation), "first_calls": first_call_seconds(simulation),
        "search": search_log(simulation),
    }  # fmt: skip
    return Result(values, arrays)


def frame(simulation: Simulation, arrays: dict[str, np.ndarray], times: list[float]) -> None:
    """Keep positions [cm], temperatures [half degrees from -25] and what is solid."""
    k = len(times)
    times.append(simulation.time)
    arrays[f"position_{k}"] = np.rint(100 * simulation.field("position")).astype(np.int16)
    degrees = np.rint(2 * (simulation.field("temperature") + 25))
    arrays[f"temperature_{k}"] = np.clip(degrees, 0, LARGEST_TEMPERATURE).astype(np.uint8)
    arrays[f"solid_{k}"] = (simulation.field("phase") != FLUID).astype(np.uint8)
