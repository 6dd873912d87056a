"""The material point method with surface tension: transfers, drops that round off, rest, swing, meet and stand on
floors, and its speed beside Taichi."""

from __future__ import annotations

import math
from collections.abc import Mapping
from statistics import fmean
from typing import Any

from refsim.mpm import READINGS
from validation.checks import Checks
from validation.experiment import Experiment, Options, Picture, Results, Run, measures
from validation.experiments.mpm_droplet import claims, drops, fine_runs, pictures, runs, stability
from validation.experiments.mpm_droplet.scene import CELLS

COLUMNS = {
    "grid_mass": "mass on the grid", "grid_momentum": "momentum on the grid", "momentum": "momentum there and back",
    "velocity": "v", "gradient": "A at the surface", "power": "power balance",
}  # fmt: skip


ENCLOSING = {"enclose_volume": True}
# What brings the box to rest: no liquid comes to rest without viscosity, and soonest with about the one that damps mode
# 2 critically, rho w R^2/5 = 0.25. lambda is twice that of the other drops, so that the surface's pressure takes half a
# per cent of the volume.
RESTFUL = {"dynamic_viscosity": 0.3, "bulk_modulus": 2000.0}
# The box again, in other cells and turns, fuller, and less viscous: (side of its cube [cells], particles along a cell,
# seed of its turn, viscosity)
BOXES = {
    "turn_5": (10.0, 2, 5, 0.3), "turn_7": (10.0, 2, 7, 0.3), "coarse": (6.5, 2, 3, 0.3), "fine": (15.0, 2, 3, 0.3),
    "full": (10.0, 3, 3, 0.3), "thin": (10.0, 2, 3, 0.12),
}  # fmt: skip
DAMPED = {"dynamic_viscosity": 0.05}
RADII = {2: (5.5, 11.0, 22.0), 3: (4.0, 6.0, 8.0, 12.0)}
SEEDS = (0, 1, 2)
SWINGS = {"2d_5.5": (2, 5.5, 0.1), "2d_8": (2, 8.0, 0.1), "2d_11": (2, 11.0, 0.1), "2d_16": (2, 16.0, 0.1),
          "2d_22": (2, 22.0, 0.1), "2d_16_small": (2, 16.0, 0.03), "2d_16_half": (2, 16.0, 0.05),
          "2d_16_double": (2, 16.0, 0.2), "3d_4": (3, 4.0, 0.1), "3d_6": (3, 6.2, 0.1), "3d_9": (3, 9.0, 0.1),
          "3d_12": (3, 12.0, 0.1), "3d_9_half": (3, 9.0, 0.05), "3d_9_double": (3, 9.0, 0.2)}  # fmt: skip
ANGLES = (60, 90, 120)
# Blocks beside Taichi on a GPU: cells along an axis, order of the particles in memory, turns
PEER_BLOCKS = ((64, "lattice", 3), (64, "cells", 3), (64, "random", 3), (128, "lattice", 2), (128, "random", 1),
               (128, "cells", 1))  # fmt: skip
# Errata whose printed reading a run can take, and what it does
ERRATA = {
    "": "all corrections",
    "M1": "the surface's force with the other sign",
    "M3": "stress without the volume",
    "M4": "stress without J",
    "M5": "J moves without dt",
    "M6": "stress through grad B",
    "M7": "velocities of before the update",
    drops.THESIS: "embedding of (4.12), (4.14)",
    "M13": "A starts as the unit matrix",
    "M14": "a fit that never fits",
    "M27": "twice the stress",
    "M31": "the surface at r",
    "M32": "15 cases",
}

RECOUNT = {"recount_time": 2e-3}  # ten steps
# How long scenes hold: (what it is, parameters of `drops.held`)
HELD: dict[str, tuple[str, dict[str, Any]]] = {
    "square": ("square that becomes a disc", {"body": "square"}),
    "square_none": ("the same, nothing embedded", {"body": "square", "tension": {"embedding": "none"}}),
    "square_half": ("the same, half the step", {"body": "square", "step": 1e-4}),
    "square_viscous": ("the same, viscosity 0.05", {"body": "square", "liquid": DAMPED}),
    "square_recount": ("the same, recount_time of ten steps", {"body": "square", "tension": RECOUNT}),
    "rest": ("disc at rest", {"body": "rest"}),
    "rest_viscous": ("the same, viscosity 0.05", {"body": "rest", "liquid": DAMPED}),
    "rest_recount": ("the same, recount_time of ten steps", {"body": "rest", "tension": RECOUNT}),
    "turn": ("disc that turns, 20 rad/s", {"body": "turn"}),
    "turn_gradient": ('the same, volume = "gradient"', {"body": "turn", "liquid": {"volume": "gradient"}}),
    "turn_recount": (
        'the same, volume = "gradient" and recount_time of ten steps',
        {"body": "turn", "liquid": {"volume": "gradient"}, "tension": RECOUNT},
    ),
    "swing": ("disc that swings by 10 %", {"body": "swing"}),
    "meet": ("two discs that meet", {"body": "meet"}),
    "sheet": ("sheet, one cell thick", {"body": "sheet"}),
    "ball": ("ball at rest, R = 6 h, in space", {"body": "rest", "dim": 3, "until": 1.0}),
    "box": ("box that becomes a ball, in space", {"body": "box", "dim": 3, "until": 0.5}),
}  # fmt: skip


def bodies(options: Options) -> list[Run]:
    """Drops under surface tension."""
    backend, quick = options.backend, options.quick
    made: list[Run] = []

    def add(key: str, function: Any, estimate: float, small: bool = False, **parameters: Any) -> None:
        if small == quick:
            slow = estimate > 500 and backend != "cuda"
            skip = "takes more than ten minutes on two threads; run with --backend cuda" if slow else ""
            made.append(Run(key, function, {"backend": backend, **parameters}, estimate, skip))

    shown = [0.0, 0.02, 0.04, 0.08, 0.16, 0.5]
    settled = {"shape": "box", "until": 0.55, "tension": ENCLOSING}
    add("box", drops.rounding, 110.0, size=10.0, shown=shown, liquid=RESTFUL, **settled)
    for name, (size, per, seed, viscosity) in BOXES.items():
        liquid = {**RESTFUL, "dynamic_viscosity": viscosity}
        seconds = 110.0 * (size / 10) ** 5 * (per / 2) ** 3
        add(f"box_{name}", drops.rounding, seconds, size=size, cell=CELLS[3] * 10 / size, per=per, seed=seed,
            liquid=liquid, **settled)  # fmt: skip
    add("box_default", drops.rounding, 40.0, shape="box", size=10.0, until=0.3, shown=[0.3])
    add("cube", drops.rounding, 35.0, shape="cube", size=10.0, until=0.28, shown=[0.0, 0.02, 0.04, 0.28])
    for dim, radii in RADII.items():
        for radius in radii:
            for name, tension in (("default", {}), ("enclosing", ENCLOSING)):
                for seed in SEEDS if dim == 2 else SEEDS[:1]:
                    key = f"rest_{dim}d_{radius:g}_{name}_{seed}"
                    until = 0.4 if dim == 2 else 0.12
                    add(key, drops.at_rest, 1e-3 * radius**3 * (20 if dim == 3 else 2), dim=dim, radius=radius,
                        until=until, seed=seed, tension=tension, shown=[0.0, until / 4, until / 2, until])  # fmt: skip
    for key, (dim, radius, amplitude) in SWINGS.items():
        seconds = radius**3 * (0.1 if dim == 3 else 4e-3)
        add(f"swing_{key}", drops.oscillation, seconds, dim=dim, radius=radius, amplitude=amplitude,
            periods=2.0 if dim == 2 else 1.5, shown=[0.0, 0.25, 0.5, 1.0])  # fmt: skip
    smooth = {"level_set_radius": 1.8, "normals": "gradient", "offset": 0.25, "iterations": 1}
    for key, tension, embedding in (
        ("poisson", {"quadrature": "poisson"}, "cluster"), ("wide", smooth, "cluster"), ("bare", {}, "none"),
        ("enclosing", ENCLOSING, "cluster"),
    ):  # fmt: skip
        add(f"swing_2d_11_{key}", drops.oscillation, 20.0, dim=2, radius=11.0, amplitude=0.1, periods=2.0,
            tension=tension, embedding=embedding)  # fmt: skip
    for dim in (2, 3) if not quick else ():
        found = {"amplitudes": [0.01, 0.03, 0.05, 0.1, 0.15, 0.2], "dim": dim}
        made.append(Run(f"potential_flow_{dim}d", drops.potential_flow, found, 10.0))
    add("collision_2d", drops.collision, 15.0, dim=2, radius=8.0, speed=1.0, until=0.3, shown=[0.0, 0.05, 0.15, 0.3])
    add("collision_3d", drops.collision, 60.0, dim=3, radius=5.0, speed=1.0, until=0.2, step=2e-4,
        shown=[0.0, 0.02, 0.05, 0.1, 0.15, 0.2])  # fmt: skip
    for angle in ANGLES:
        add(f"floor_2d_{angle}", drops.on_floor, 20.0, dim=2, radius=11.0, angle=angle, until=0.8, liquid=DAMPED,
            shown=[0.0, 0.1, 0.2, 0.8])  # fmt: skip
        add(f"floor_3d_{angle}", drops.on_floor, 60.0, dim=3, radius=6.0, angle=angle, until=0.5,
            shown=[0.0, 0.1, 0.2, 0.5],
            liquid=DAMPED)  # fmt: skip
    for key, parameters in fine_runs.RUNS.items():
        add(f"fine_{key}", fine_runs.smooth, 200.0, **parameters)
    add("sheet", drops.sheet, 10.0, length=40.0, thick=1.0, tension=0.1, until=0.07, shown=[0.0, 0.02, 0.04, 0.06])
    for printed in ERRATA:
        for dim, size, until in ((2, 12.0, 0.15), (3, 6.0, 0.06)):
            key = f"erratum_{dim}d_{printed.replace(', ', '_') or 'none'}"
            add(key, drops.erratum, 6.0, printed=printed, dim=dim, size=size, until=until)
    for key, (_, scene) in HELD.items():
        seconds = 150.0 if scene.get("dim") == 3 else 30.0
        add(f"held_{key}", drops.held, seconds, **{"until": 2.0, **scene})
    add("small_held", drops.held, 1.0, True, body="meet", until=0.02)
    add("example", drops.example, 60.0, until=0.25, shown=[0.0, 0.005, 0.01, 0.02, 0.05, 0.25])
    add("small_box", drops.rounding, 4.0, True, shape="box", size=5.0, until=0.02, tension=ENCLOSING, liquid=RESTFUL)
    add("small_rest", drops.at_rest, 1.0, True, dim=2, radius=5.5, until=0.05)
    add("small_floor", drops.on_floor, 2.0, True, dim=2, radius=5.5, angle=60, until=0.05, liquid=DAMPED)
    add("small_swing", drops.oscillation, 3.0, True, dim=2, radius=5.5, amplitude=0.1, periods=0.5)
    return made


def planned(options: Options) -> list[Run]:
    """The runs under the options."""
    reason = "takes minutes with the others; run without --quick" if options.quick else ""
    made = [Run("transfers", runs.transfers, {}, estimate=5.0)]
    for dim in (2, 3):
        made.append(Run(f"free_fall_{dim}d", runs.free_fall, {"backend": options.backend, "dim": dim}, estimate=3.0))
    for name in READINGS:
        parameters = {
            "backend": options.backend,
            "embedding": name,
            "cells": 20,
            "until": 0.2 if options.quick else 0.6,
        }
        estimate = 10.0 if options.quick else 40.0
        made.append(Run(f"square_{name}", runs.square, parameters, estimate, reason if name != "cluster" else ""))
    made += bodies(options)
    peer: dict[str, Any] = {"cells": 24 if options.quick else 40, "steps": 10, "rounds": 3 if options.quick else 5}
    peer |= {"threads": options.threads or 2, "backend": options.backend}
    asked = "" if options.peers else "measured with --peers"
    if options.backend != "cuda":
        return [*made, Run("peer_taichi", runs.against_taichi, peer, estimate=60.0, skip=asked)]
    for cells, order, rounds in PEER_BLOCKS[: 1 if options.quick else None]:
        block = peer | {"cells": cells, "order": order, "rounds": rounds, "steps": 100}
        made.append(Run(f"peer_taichi_{cells}_{order}", runs.against_taichi, block, 0.1 * cells * rounds, asked))
    return made


def checks(results: Results, check: Checks) -> None:
    """The cluster's errors and ledgers are judged, the printed readings' shown."""
    if "transfers" in results:
        values = results["transfers"].values
        for name in COLUMNS:
            value = values["readings"]["cluster"][name]
            check(f"cluster_{name}", abs(value - 1) if name == "power" else value)
        for reading in ("thesis", "gradient_corrected"):
            check("reading_gradient", values["readings"][reading]["gradient"], reading)
        check("rotation", values["rotation"])
    for dim in (2, 3):
        if f"free_fall_{dim}d" in results:
            check("free_fall", results[f"free_fall_{dim}d"].values["error"], f"{dim}d")
    for reading in READINGS:
        if f"square_{reading}" in results:
            values = results[f"square_{reading}"].values
            rule = "square" if reading == "cluster" else "reading"
            for name in ("momentum", "angular", "centre", "least_ratio", "energy_rise"):
                check(f"{rule}_{name}", values[name], reading)
    check_bodies(results, check)
    for key, values in peers(results).items():
        if not values["missing"]:
            words = "Taichi" if key == "peer_taichi" else f"Taichi, {values['particles']:,} ({values['order']})"
            rule = "peer_ratio" if key == "peer_taichi" else "peer_ratio_gpu"
            check(rule, values["ratio"], key.removeprefix("peer_"), words)
            check("peer_difference", values["difference"], key.removeprefix("peer_"), words)


def peers(results: Results) -> dict[str, Mapping[str, Any]]:
    """What the runs beside Taichi found."""
    return {key: result.values for key, result in results.items() if key.startswith("peer_taichi")}


KEPT = ("momentum", "angular", "centre")
JUDGED = ("box", "box_turn_5", "box_turn_7", "box_fine", "box_full")
ROUNDED = ("box", *(f"box_{name}" for name in BOXES), "box_default", "cube")
SHAPES = ("sphericity", "volume", "anisotropy", "particle_anisotropy")


def check_bodies(results: Results, check: Checks) -> None:
    """Shapes, pressures, frequencies, angles and ledgers of the drops."""
    for key in (*ROUNDED, "small_box"):
        if key not in results:
            continue
        values = results[key].values
        rule = "box" if key in JUDGED else "shape"
        last = values["last"]
        check(f"{rule}_sphericity", last["sphericity"]["least"], key)
        check(f"{rule}_sphericity_most", last["sphericity"]["largest"], key)
        volume = max(abs(last["volume"][name] - 1) for name in ("least", "largest"))
        check(f"{rule}_volume", volume, key)
        check(f"{rule}_anisotropy", last["anisotropy"]["largest"], key)
        check(f"{rule}_particle_anisotropy", last["particle_anisotropy"]["largest"], key)
    kept = (*ROUNDED, "small_box", "collision_2d", "collision_3d", "sheet")
    for key in (k for k in kept if k in results):
        values = results[key].values
        rules = {name: f"drop_{name}" for name in (*KEPT, "energy_rise")}
        if key not in JUDGED:
            rules["energy_rise"] = "energy_rise"
        if key not in ROUNDED:
            rules["angular"] = "angular"
        for name, rule in rules.items():
            check(rule, values[name], key)
    for (dim, name), rows in pressures(results).items():
        for row in rows:
            rule = {(2, 11.0): "laplace_2d", (3, 6.0): "laplace_3d"}.get((dim, row["radius"]), "laplace")
            check(rule, abs(row["pressure"] - 1), f"{dim}d_{row['radius']:g}_{name}")
        for small, value in orders(rows):
            check("laplace_order", value, f"{dim}d_{small:g}_{name}")
    for key in (k for k in results if k.startswith("swing_")):
        rule = "swing_2d_16" if key == "swing_2d_16" else "swing"
        check(rule, abs(results[key].values["ratio"] - 1), key.removeprefix("swing_"))
    for key in (k for k in results if k.startswith("floor_")):
        values = results[key].values
        check("contact_angle", abs(values["angle"] - values["asked"]), key.removeprefix("floor_"))
    if "sheet" in results:
        values = results["sheet"].values
        check("sheet_speed", abs(values["speed"] / values["culick"] - 1))


def pressures(results: Results) -> dict[tuple[int, str], list[dict[str, float]]]:
    """Mean pressure of drops at rest over Laplace's, by dimension and inset, from small to large."""
    made: dict[tuple[int, str], list[dict[str, float]]] = {}
    for dim, radii in RADII.items():
        for name in ("default", "enclosing"):
            for radius in radii:
                keys = [f"rest_{dim}d_{radius:g}_{name}_{seed}" for seed in SEEDS]
                found = [results[key].values for key in keys if key in results]
                if found:
                    values = [v["pressure"] for v in found]
                    row = {"radius": radius, "cells": found[0]["radius_in_cells"], "pressure": fmean(values),
                           "spread": max(values) - min(values), "noise": fmean(v["kinetic"] for v in found),
                           "volume": fmean(v["volume"] for v in found)}  # fmt: skip
                    made.setdefault((dim, name), []).append(row)
    return made


def orders(rows: list[dict[str, float]]) -> list[tuple[float, float]]:
    """(R, log2 of the error |p/p_L - 1| at R over that at 2 R) for every radius whose double was run as well."""
    error = {row["radius"]: abs(row["pressure"] - 1) for row in rows}
    return [(radius, math.log2(error[radius] / error[2 * radius])) for radius in error if 2 * radius in error]


EXPERIMENT = Experiment(
    name="mpm_droplet",
    title="transfers of MPM, drops that round off, rest, swing, meet and stand on floors, speed beside Taichi",
    runs=planned,
    checks=checks,
    pictures=(
        Picture("mpm_square", pictures.square_data, pictures.square_picture, ("square_cluster",)),
        Picture("mpm_readings", pictures.readings_data, pictures.readings_picture, ("transfers",)),
        Picture(
            "mpm_surfaces", pictures.surfaces_data, pictures.surfaces_picture, tuple(pictures.SURFACES), shaded=True
        ),
        Picture("mpm_ledgers", pictures.ledgers_data, pictures.ledgers_picture, tuple(pictures.LEDGERS)),
        Picture("mpm_box", pictures.box_data, pictures.box_picture, ("box", "box_default")),
        Picture(
            "mpm_settling",
            pictures.settling_data,
            pictures.settling_picture,
            ("box", "box_thin"),
        ),
        Picture("mpm_drops", pictures.drops_data, pictures.drops_picture, pictures.DROPS, shaded=True),
        Picture("mpm_collision", pictures.collision_data, pictures.collision_picture, ("collision_2d", "collision_3d")),
        Picture(
            "mpm_floor",
            pictures.floor_data,
            pictures.floor_picture,
            tuple(f"{size}_{a}" for size in ("floor_2d", "floor_3d") for a in ANGLES),
        ),
        Picture("mpm_pressure", pictures.pressure_data, pictures.pressure_picture, ("rest_2d_22_enclosing_0",)),
        Picture(
            "mpm_frequency",
            pictures.frequency_data,
            pictures.frequency_picture,
            ("swing_2d_22", "swing_3d_9", "potential_flow_2d", "potential_flow_3d"),
        ),
        Picture("mpm_example", pictures.example_data, pictures.example_picture, ("example",)),
        Picture("mpm_sheet", pictures.sheet_data, pictures.sheet_picture, ("sheet",)),
    ),
    claims=measures(claims),
    trials=vars(stability),
    maps=stability.MAPS,
)
