"""Flows of the literature with the liquid that rests (docs/solutions.md): a cavity with a moving lid, a tank that sways
and columns that collapse (2D, float64, default options), and water that falls onto sensors (`falls.toml`).
"""

import itertools
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import refsim
from refsim.engine.counting import counted
from refsim.study.panels.scenes import shaken
from validation.checks import Checks
from validation.experiment import Experiment, Options, Results, RunSpec
from validation.metrics import dam_break
from validation.metrics.liquid import centre_lines
from validation.metrics.solutions import DEPTH, LENGTH, PERIOD, PROBE, SWAY, swaying_linear, swaying_potential
from validation.results import Result
from validation.running import Context, advance

DENSITY, GRAVITY = 1000.0, 9.81  # kg/m^2, m/s^2
ARTIFICIAL = 0.02  # alpha of the artificial viscosity that has the kinematic viscosity of water that falls or sways
PAPERS = Path(__file__).resolve().parents[2] / "papers"
REYNOLDS, SETTLED, MEAN = 100.0, 15.0, 1.0  # of the cavity; s until it is steady, s of the mean at the end

EXTREMES = (
    (0.498, -0.0312), (1.163, 0.0754), (1.925, -0.0880), (2.574, 0.1421), (3.267, -0.0925), (4.040, 0.1093),
    (4.711, -0.0454), (5.295, 0.0126),
)  # fmt: skip
NEAR = 0.3  # s around an extreme of the experiment in which that of the run is looked for


def _liquid(sound: float, viscosity: float) -> refsim.WeaklyCompressible:
    return refsim.WeaklyCompressible(rest_density=DENSITY, sound_speed=sound, dynamic_viscosity=DENSITY * viscosity)


def cavity(context: Context, cells: int, support: float, backend: str) -> Result:
    """A square cavity of 1 m whose lid moves with 1 m/s, at Re 100, from rest.

    u_off, v_off  largest difference of the centre-line velocities from Ghia's over the lid's speed; means of the last
    second
    """
    spacing, viscosity = 1.0 / cells, 1.0 / REYNOLDS
    scene = refsim.Scene(
        name="cavity", dim=2, dtype="float64", spacing=spacing, support_radius=support * spacing,
        fluid=(refsim.Box(cells=(cells, cells, 1)),),
        effects=(
            _liquid(10.0, viscosity),
            refsim.BoxWalls(
                lower=(0.0, 0.0, 0.0), upper=(1.0, 1.0, 0.0), model="extrapolated", moving_faces=("+y",),
                velocity=(1.0, 0.0, 0.0), no_slip=True,
            ),
        ),
    )  # fmt: skip
    simulation = context.simulation(scene, backend)
    seen: list[tuple[NDArray, NDArray]] = []

    def sample(simulation: refsim.Simulation, wall: float) -> None:
        seen.append((simulation.field("position")[:, :2], simulation.field("velocity")))

    advance(simulation, [SETTLED - MEAN + 0.1 * k for k in range(1 + round(MEAN / 0.1))], sample, context)
    (u, v), off = centre_lines(seen, support * spacing)
    values = {
        "kind": "cavity", "cells": cells, "support": support, "particles": simulation.count,
        "u_off": float(np.abs(off[0]).max()), "v_off": float(np.abs(off[1]).max()),
        "off": float(np.sqrt(np.mean(np.concatenate(off) ** 2))), "stops": simulation.stopped_at_walls,
    }  # fmt: skip
    return Result(values, {"u": u, "v": v})


FALLS: dict[str, Any] = tomllib.loads(Path(__file__).with_name("falls.toml").read_text(encoding="utf-8"))
COLLAPSES: Mapping[str, Any] = FALLS.pop("collapses")


def measured(fall: Mapping[str, Any]) -> dict[str, tuple[NDArray, NDArray]]:
    """Times and pressures of each sensor of an experiment."""
    rows = np.genfromtxt(PAPERS / fall["series"], delimiter=",", names=True, dtype=None, encoding="utf-8")
    parts = {name: rows[rows["sensor"] == name] for name in fall["sensors"]}
    return {name: (part["time"], part["pressure"]) for name, part in parts.items()}


def read_sensor(fall: Mapping[str, Any], time: NDArray, pressure: NDArray) -> dict[str, float]:
    """Time at which a sensor first reads 0.3 rho g H, and its mean in each span."""
    after = int(np.argmax(pressure > 0.3))
    arrival = float(np.interp(0.3, pressure[after - 1 : after + 1], time[after - 1 : after + 1]))
    means = {
        name: float(np.interp(np.linspace(low, high, 1001), time, pressure).mean())
        for name, (low, high) in fall["spans"].items()
    }
    return {"arrival": arrival, **means}


def impact(context: Context, kind: str, fall: Mapping[str, Any], cells: int, backend: str) -> Result:
    """Water of `falls.toml`, `cells` particles high: arrivals and means of each sensor, `found` and `known` by its
    experiment; the series hold means since the value before."""
    length, height, *across = fall["column"]
    unit, scale = math.sqrt(height / GRAVITY), DENSITY * GRAVITY * height
    effects: list[Any] = [
        refsim.WeaklyCompressible(
            rest_density=DENSITY, sound_speed=10 * math.sqrt(2 * GRAVITY * height), artificial_viscosity=ARTIFICIAL,
            **fall.get("liquid", {}),
        ),
        refsim.Gravity(acceleration=(0.0, -GRAVITY, 0.0)),
        refsim.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(*fall["tank"], 0.0)[:3], open_faces=("+y",)),
    ]  # fmt: skip
    if "papers" in fall:
        effects += [refsim.SurfaceDetection(), refsim.ParticleShifting(strength=2.2, surface="detected")]
    if "block" in fall:
        effects.append(refsim.MeshBoundary(file=str(Path(__file__).with_name(fall["block"]))))
    gauges, dim = [], 2 + len(across)
    for name, corners in fall["sensors"].items():
        place: Any = dict(zip(("lower", "upper") if corners[1:] else ("at",), map(tuple, corners)))
        gauges.append(refsim.Gauge(name=name, kind="pressure", every=0.02 * unit, instants=5, **place))
    scene = refsim.Scene(
        name=kind, dim=dim, spacing=height / cells, effects=tuple(effects), gauge=tuple(gauges),  # type: ignore[arg-type]
        support_radius=fall.get("support", 2.6) * height / cells,
        fluid=(refsim.Box(size=(length, height, *across, height / cells)[:3]),),
    )  # fmt: skip
    simulation = context.simulation(scene, backend)
    advance(simulation, (np.linspace(0, fall["until"], 51) * unit).tolist(), lambda simulation, wall: None, context)
    values: dict[str, Any] = {"kind": kind, "cells": cells, "particles": simulation.count, "steps": simulation.steps}
    known = {name: read_sensor(fall, *series) for name, series in measured(fall).items()} if "series" in fall else {}
    arrays: dict[str, NDArray] = {}
    for name in fall["sensors"]:
        gauge = simulation.gauge(name)
        arrays |= {"time": gauge.time / unit, name: gauge["pressure_mean"] / scale}
        found = read_sensor(fall, arrays["time"], arrays[name])
        values[name] = {"found": found, "known": known.get(name, fall.get("known"))}
    return Result(values, arrays)


def collapse(context: Context, kind: str, of: Mapping[str, Any], cells: int, seed: int, backend: str) -> Result:
    """A column of `collapses` in `falls.toml`, `cells` to a metre, moved by 0.01 d at random.

    Of a splash level_off  twice the mean height, less that of waves (as large as their kinetic energy), over the depth
    at rest, off 1, mean over the times; counted_off  counted density over the told one at the end, off 1.
    Else a series' name: root mean square difference of the front from it, in widths, with the best offset in time;
    left_at_wall  height of the water at x = 0, the wall that it leaves, at t sqrt(2g/L) = 3.5, over the width
    """
    left, high, (*lower, right, top) = of["left"], of["high"], of["box"]
    sound, rows = 10 * math.sqrt(2 * GRAVITY * high), list[tuple[float, ...]]()
    scene = refsim.Scene(
        name=kind, dim=2, dtype="float64", spacing=1 / cells, support_radius=3 / cells,
        fluid=(refsim.Box(lower=(left, 0.0, 0.0), cells=(round((1 - left) * cells), high * cells, 1)),),
        effects=(
            _liquid(sound, 3 * sound / cells / of["number"]), refsim.Gravity(acceleration=(0.0, -GRAVITY, 0.0)),
            refsim.BoxWalls(lower=(*lower, 0.0, 0.0), upper=(right, top, 0.0)),
        ),
    )  # fmt: skip
    simulation = context.simulation(shaken(scene, seed), backend)

    def sample(simulation: refsim.Simulation, wall: float) -> None:
        x, v = simulation.field("position")[:, :2], simulation.field("velocity")
        level = 2 * x[:, 1].mean() - (v**2).sum(1).mean() / GRAVITY
        edge = dam_break.front_position(x, 1 / cells).connected
        rows.append((simulation.time, level, edge, x[np.abs(x[:, 0]) < 0.1, 1].max(initial=0.0)))

    advance(simulation, np.linspace(*of["times"]).tolist(), sample, context)
    values: dict[str, Any] = {"kind": kind, "cells": cells, "particles": simulation.count}
    time, level, edge, above = np.array(rows).T
    if kind == "splash":
        depth, found = (1 - left) * high / (right - lower[0]), counted(simulation)
        counted_off = math.nan if found is None else abs(found.difference)
        return Result(values | {"level_off": abs(float(level.mean()) / depth - 1), "counted_off": counted_off})
    time = dam_break.dimensionless_time(time, 1.0)
    off = {name: dam_break.fit_time_offset(time, edge, data)[1] for name, data in dam_break.experiments().items()}
    return Result(values | off | {"left_at_wall": float(np.interp(3.5, time, above))})


def sway(context: Context, cells: int, support: float, amplitude: float, until: float, backend: str) -> Result:
    """A tank with water `cells` particles deep sways with `amplitude` [m]; seen from it.

    linear_off  root mean square difference of the level from linear theory over the theory's root mean square; of the
    sway of the experiment also nonlinear_off  from nonlinear potential flow, and crests_off, troughs_off  mean
    difference from the experiment's over the mean of its crests or troughs, theory_crests_off  that of potential flow
    """
    columns = round(cells * LENGTH / DEPTH)
    spacing, sound, path = LENGTH / columns, 10 * math.sqrt(GRAVITY * DEPTH), f"{amplitude}*cos(2*pi*t/{PERIOD})"
    viscosity = ARTIFICIAL * 0.5 * support * spacing * sound / 8
    scene = refsim.Scene(
        name="sway", dim=2, dtype="float64", spacing=spacing, support_radius=support * spacing,
        fluid=(refsim.Box(cells=(columns, cells, 1)),),
        motion=(refsim.Motion(of="gravity", kind="formula", direction=(1.0, 0.0, 0.0), formula=path),),
        gauge=(refsim.Gauge(name="level", kind="level", lower=(PROBE, 0.0, 0.0), upper=(PROBE, 1.1, 0.0), every=0.01),),
        effects=(
            _liquid(sound, viscosity), refsim.Gravity(acceleration=(0.0, -GRAVITY, 0.0)),
            refsim.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(LENGTH, 1.15, 0.0), model="extrapolated"),
        ),
    )  # fmt: skip
    simulation = context.simulation(scene, backend)
    advance(simulation, np.linspace(0, until, 51).tolist(), lambda simulation, wall: None, context)
    series = simulation.gauge("level")
    time, level = series.time, series["level"] - cells * spacing
    theory = swaying_linear(time, amplitude, viscosity)
    values: dict[str, Any] = {
        "kind": "sway", "cells": cells, "support": support, "amplitude": amplitude, "particles": simulation.count,
        "linear_off": float(np.sqrt(np.mean((level - theory) ** 2) / np.mean(theory**2))),
        "stops": simulation.stopped_at_walls,
    }  # fmt: skip
    if amplitude == SWAY:
        theory = swaying_potential(time, amplitude, viscosity)
        values["nonlinear_off"] = float(np.sqrt(np.mean((level - theory) ** 2) / np.mean(theory**2)))
        for name, of, sign in (
            ("crests_off", level, 1), ("troughs_off", level, -1), ("theory_crests_off", theory, 1)
        ):  # fmt: skip
            pairs = [(float((sign * of[np.abs(time - at) < NEAR]).max()), abs(h)) for at, h in EXTREMES if sign * h > 0]
            values[name] = sum(abs(top - height) for top, height in pairs) / sum(height for _, height in pairs)
    return Result(values, {"time": time, "level": level, "theory": theory})


CAVITIES, SWAYS = (25, 50), ((12, SWAY), (25, SWAY), (12, 0.008), (25, 0.008))


def planned(options: Options) -> list[RunSpec]:
    """Two spacings of each; with --quick the coarse cavity alone."""
    made = []
    for cells in CAVITIES:
        row: dict[str, Any] = {"cells": cells, "support": 3.2, "backend": "cpu"}
        made.append(RunSpec(f"cavity_{cells}", cavity, row, estimate=2e-3 * cells**3))
    for kind, fall in FALLS.items():
        for cells in fall["cells"]:
            row = {"kind": kind, "fall": fall, "cells": cells, "backend": options.backend}
            made.append(RunSpec(f"{kind}_{cells}", impact, row, 3e-4 * cells ** (2 * len(fall["column"]) - 1)))
    for cells, amplitude in SWAYS:
        row = {"cells": cells, "support": 3.2, "amplitude": amplitude, "until": 5.6, "backend": "cpu"}
        made.append(RunSpec(f"sway_{cells}_{1000 * amplitude:g}mm", sway, row, estimate=4e-3 * cells**3))
    for kind, of in COLLAPSES.items():
        for cells, seed in itertools.product(of["cells"], range(of["starts"])):
            row = {"kind": kind, "of": of, "cells": cells, "seed": seed, "backend": "cpu"}
            made.append(RunSpec(f"{kind}_{cells}_{seed}", collapse, row, estimate=2e-4 * cells**3))
    return made[:1] if options.quick else made


def checks(results: Results, check: Checks) -> None:
    """Bars hold at the finer spacing; the coarser one is shown."""
    for key, result in results.items():
        row, fine = result.values, key.startswith(("cavity_50", "sway_25"))
        if row["kind"] in COLLAPSES:
            for name in row.keys() - {"kind", "cells", "particles"}:
                kind = "front" if name in dam_break.FRONT_DATA else name
                check(kind, row[name], f"{key}.{name}", f"{row['cells']} cells")
            continue
        if row["kind"] in FALLS:
            _judge_fall(FALLS[row["kind"]], row, key, check)
            continue
        names = [name for name in ("u_off", "v_off") if name in row]
        if row["kind"] == "sway":
            names = ["nonlinear_off"] if row["amplitude"] == SWAY else ["linear_off"]
            if row["amplitude"] == SWAY and fine:
                names += ["crests_off", "troughs_off", "theory_crests_off"]
        for name in names:
            check(name if fine else f"coarse_{name}", row[name], key, f"{row['cells']} cells")


def _judge_fall(fall: Mapping[str, Any], row: Mapping[str, Any], key: str, check: Checks) -> None:
    """Arrivals and means over the experiment's, and over those of a grid where they are known, off 1."""
    coarse = "coarse_" * (row["cells"] < fall["cells"][-1])
    for name, part in itertools.product(fall["sensors"], ("arrival", *fall["spans"])):
        found, known = (row[name][which][part] for which in ("found", "known"))
        where = (f"{key}.{name}.{part}", f"{row['cells']} cells, {name}, {part}")
        missed = "_missed" * (not coarse and f"{name}.{part}" in fall["missed"])
        check(f"{coarse}fall_{'arrival' if part == 'arrival' else 'mean'}{missed}", abs(found / known - 1), *where)
        if part in fall.get("grid", {}).get(name, ()):
            check(f"{coarse}fall_grid", abs(found / fall["grid"][name][part] - 1), *where)


EXPERIMENT = Experiment(
    "flows", "cavity, swaying tank and water that falls onto sensors, with the liquid that rests", planned, checks
)
