"""Runs of the MPM droplet: transfers by themselves, a square that becomes a disc, and the same work in Taichi."""

from __future__ import annotations

import math
import statistics
import time
from typing import Any

import numpy as np

from refsim import Box, Cloud, Gravity, MpmLiquid, MpmWalls, RunStopped, Scene, Simulation, SurfaceEnergy
from refsim.mpm import READINGS
from validation.metrics.mpm import Transfers, ball, round_trip
from validation.peers import taichi_mpm
from validation.results import Result
from validation.running import Context

SPIN = 20.0  # rad/s
FRAMES = (0.016, 0.033)  # s, beside the start and the end: half of an oscillation and a whole one
BLOCK = {"spacing": 0.01, "density": 1000.0, "bulk_modulus": 1e5, "gravity": -9.81, "step": 1e-4, "warm": 3}


def transfers(context: Context) -> Result:
    """Round trips of an affine field in the four readings, and one step of a rigid rotation."""
    readings = {}
    for k, name in enumerate(READINGS):
        readings[name] = round_trip(name)
        context.progress((k + 1) / len(READINGS))
    position, _ = ball(2)
    turn = np.array([[0.0, -SPIN, 0.0], [SPIN, 0.0, 0.0], [0.0, 0.0, 0.0]])
    spun = Transfers(position, position @ turn.T, np.tile(turn, (len(position), 1, 1)), dim=2, step=1e-3)
    spun.to_grid()
    spun.back()
    return Result({"readings": readings, "rotation": float(abs(spun.values["volume_ratio"] - 1).max())})


def free_fall(context: Context, backend: str, dim: int) -> Result:
    """A block that is thrown, in float64: where it is after 200 steps, against x + sum of dt v."""
    velocity, pull = np.array([1.0, 0.5, 0.0]), np.array([0.3, -9.81, 0.0])
    scene = Scene(
        spacing=0.1, support_radius=0.3, dim=dim, dtype="float64",
        fluid=(Box(lower=(0.03, 0.05, 0.0), cells=(6, 6, 6 if dim == 3 else 1), velocity=tuple(velocity)),),
        effects=(MpmLiquid(bulk_modulus=1e5), Gravity(acceleration=tuple(pull))),
    )  # fmt: skip
    run = context.simulation(scene, backend)
    start, displacement = run.field("position"), np.zeros(3)
    for k in range(200):
        length = run.step().length
        velocity = velocity + length * pull
        displacement = displacement + length * velocity
        context.progress(k / 200)
    return Result(
        {
            "error": float(abs(run.field("position") - start - displacement).max() / abs(displacement).max()),
            "time": run.time,
        }
    )


def square(context: Context, backend: str, embedding: str, cells: int, until: float) -> Result:
    """A square of liquid whose surface draws it together: ledgers of momentum, energy and shape.

    Lengths in cells of 1/64 m, rho = 1, k = 1, lambda = 1000.
    """
    h = 1 / 64
    scene = Scene(
        spacing=h / 2, support_radius=1.5 * h, dim=2, dtype="float64", step=2e-4,
        fluid=(Box(lower=(0.4 + 0.13 * h, 0.4 - 0.21 * h, 0.0), cells=(2 * cells, 2 * cells, 1)),),
        effects=(
            MpmLiquid(rest_density=1.0, bulk_modulus=1000.0), SurfaceEnergy(surface_tension=1.0, embedding=embedding),
        ),
    )  # fmt: skip
    run = context.simulation(scene, backend)
    mass = run.field("mass")
    centre, radius = run.field("position").mean(0), math.sqrt(mass.sum() / math.pi)
    series: dict[str, list[float]] = {}
    frames, peak, stopped = [run.field("position")], 0.0, ""
    surfaces: dict[str, np.ndarray] = {}
    total = round(until / 2e-4)
    shown = [*(round(at / 2e-4) for at in FRAMES), total]
    try:
        while run.steps < total:
            run.step()
            if run.steps in shown:
                frames.append(run.field("position"))
            if run.steps in (1, *shown):  # the first step begins with the surface of the start
                mesh = run._shared["surface"].latest.inset_mesh
                surfaces[f"vertices_{len(frames) - 1}"] = run.backend.host(mesh.vertices) / h
                surfaces[f"facets_{len(frames) - 1}"] = run.backend.host(mesh.facets)
            if run.steps % max(1, total // 100) and run.steps not in (1, total):
                continue
            row = ledger(run, mass, centre, radius, h)
            peak = max(peak, row.pop("speed"))
            for name, value in row.items():
                series.setdefault(name, []).append(value)
            context.progress(run.steps / total)
    except RunStopped as stop:
        stopped = f"{stop.reason} in step {run.steps}"
    scale = mass.sum() * peak
    return Result(
        {
            "stopped": stopped, "frames": [0.0, *FRAMES, until], "series": series, "radius_in_cells": radius / h,
            "momentum": max(series["momentum"]) / scale, "angular": max(series["angular"]) / (scale * radius),
            "centre": max(series["centre"]), "least_ratio": min(series["least_ratio"]),
            "energy_rise": max(series["energy"]) / series["energy"][0] - 1,
        },
        {"frames": np.array(frames), **surfaces},
    )  # fmt: skip


def ledger(run: Simulation, mass: np.ndarray, centre: np.ndarray, radius: float, h: float) -> dict[str, float]:
    """Momenta, energies and shape at present."""
    x, v, ratio = (run.field(name) for name in ("position", "velocity", "volume_ratio"))
    length = float(run._shared["surface"].sample_area.sum())
    kinetic = 0.5 * float((mass * (v**2).sum(1)).sum())
    bulk = 0.5 * 1000.0 * float((mass * (ratio - 1) ** 2).sum())
    return {
        "time": run.time, "kinetic": kinetic, "bulk": bulk, "surface": length, "energy": kinetic + bulk + length,
        "perimeter": length / (2 * math.pi * radius), "pressure": float(-1000.0 * (ratio - 1).mean() * radius),
        "momentum": float(abs(mass @ v).max()), "angular": abs(float((mass * np.cross(x - centre, v)[:, 2]).sum())),
        "centre": float(abs(x.mean(0) - centre).max() / h), "least_ratio": float(ratio.min()),
        "speed": float(np.sqrt((v**2).sum(1).max())),
    }  # fmt: skip


def against_taichi(
    context: Context, cells: int, steps: int, rounds: int, threads: int, backend: str, order: str = "lattice"
) -> Result:
    """Plain MLS-MPM liquid here and in Taichi, in turns: mean seconds of a step, and that both computed the same.

    order  in which the particles stand in memory, see `taichi_mpm.places`
    """
    reason = taichi_mpm.missing()
    if reason:
        return Result({"missing": reason})
    block = {**BLOCK, "cells": cells, "room": cells + 24, "steps": steps, "order": order}
    own: list[float] = []
    other: list[float] = []
    for turn in range(rounds):
        peer = taichi_mpm.run(block, threads, "cuda" if backend == "cuda" else "cpu")
        if "missing" in peer:
            return Result({"missing": peer["missing"]})
        other.append(peer["seconds"])
        run, seconds = plain_block(context, block, threads, backend)
        own.append(seconds)
        context.progress((turn + 1) / rounds)
    velocity = run.field("velocity").astype(float)
    here = {
        "centre": run.field("position").astype(float).mean(0).tolist(),
        "speed": float(np.sqrt((velocity**2).sum(1).mean())),
        "ratio": float(run.field("volume_ratio").astype(float).std()),
    }
    ratios = [a / b for a, b in zip(other, own, strict=True)]
    return Result(
        {
            "missing": "", "particles": run.count, "threads": threads, "version": peer["version"], "order": order,
            "own": own, "peer": other, "ratios": ratios, "ratio": statistics.median(ratios),
            "difference": max(
                float(np.abs(np.subtract(here["centre"], peer["centre"])).max() / BLOCK["spacing"]),
                abs(here["speed"] / peer["speed"] - 1), abs(here["ratio"] / peer["ratio"] - 1),
            ),
        }
    )  # fmt: skip


def plain_block(context: Context, block: dict[str, Any], threads: int, backend: str) -> tuple[Simulation, float]:
    """(the run at its end, mean seconds of a step) of the block of liquid that the peer gets."""
    spacing, room = block["spacing"], block["room"] * 2 * block["spacing"]
    scene = Scene(
        spacing=spacing, support_radius=3 * spacing, step=block["step"], dtype="float32",
        fluid=(Cloud(position=taichi_mpm.places(block["cells"], spacing, block.get("order", "lattice"))),),
        effects=(
            MpmLiquid(rest_density=block["density"], bulk_modulus=block["bulk_modulus"]),
            Gravity(acceleration=(0.0, block["gravity"], 0.0)), MpmWalls(lower=(0, 0, 0), upper=(room, room, room)),
        ),
    )  # fmt: skip
    run = context.simulation(scene, backend, threads if backend == "cpu" else None)
    spent = []
    for _ in range(block["warm"] + block["steps"]):
        run.backend.synchronize()
        began = time.perf_counter()
        run.step()
        run.backend.synchronize()
        spent.append(time.perf_counter() - began)
    return run, statistics.fmean(spent[block["warm"] :])  # sorting, in every few steps on a GPU, counts
