"""Runs of bodies of liquid under surface tension: at rest, rounding off, swinging, colliding, on a floor, a sheet."""

from __future__ import annotations

import math
import pathlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from refsim import RunStopped, Simulation
from refsim.scene.files import load_scene
from refsim.surface_energy import Tension
from validation.experiments.mpm_droplet import measures
from validation.experiments.mpm_droplet.scene import CELLS, MODULUS, box, drop_scene, ellipsoid, radius_of
from validation.results import Result
from validation.running import Context

EXAMPLE = pathlib.Path(__file__).resolve().parents[3] / "refsim" / "examples" / "mpm_droplet.toml"
THESIS = "M9, M10"  # the embedding as printed
SPIN = 20.0  # rad/s, of the disc that turns
SIDES = (1.3, 1.0, 0.8)  # of the box that becomes a sphere


def follow(
    context: Context,
    run: Simulation,
    until: float,
    rows: int,
    shown: Sequence[float] = (),
    each: Callable[[Simulation], None] | None = None,
) -> tuple[measures.Ledger, dict[str, np.ndarray], str]:
    """Step to `until` [s]: (ledger of `rows` rows, surfaces nearest after the times `shown`, why it stopped or "").

    each  called after every step
    """
    ledger, kept, stopped = measures.Ledger(run), {}, ""
    noted, waiting = 0, sorted(shown)
    try:
        while run.time < until - 1e-9:
            run.step()
            if each is not None:
                each(run)
            if run.time >= noted * until / rows or run.time >= until - 1e-9:
                noted += 1
                ledger.note()
                context.progress(run.time / until)
            while waiting and run.time >= waiting[0] - 1e-9:
                mesh = measures.surface_of(run).inset_mesh
                place = f"{len(shown) - len(waiting)}"
                kept[f"vertices_{place}"] = run.backend.host(mesh.vertices) / ledger.h
                kept[f"facets_{place}"] = run.backend.host(mesh.facets)
                waiting.pop(0)
    except RunStopped as stop:
        stopped = f"{stop.reason} in step {run.steps}"
        if not ledger.series:
            raise
    return ledger, kept, stopped


def rounding(
    context: Context, backend: str, shape: str, size: float, until: float, shown: Sequence[float] = (),
    tension: Mapping[str, Any] | None = None, liquid: Mapping[str, Any] | None = None, rows: int = 120, seed: int = 3,
    per: int = 2, cell: float | None = None,
) -> Result:  # fmt: skip
    """A box of 1.3 : 1 : 0.8, or a cube (square), whose surface draws it to a ball.

    shape  "box" (turned off the axes by `seed`), "cube" or "square"; size  side of the cube of the same volume [cells]
    per    particles along a cell; cell  h [m]
    """
    dim = 2 if shape == "square" else 3
    if shape == "box":
        scale = size / math.prod(SIDES) ** (1 / 3)
        place = box([round(per * scale * side) / per for side in SIDES], seed=seed, per=per)
    else:
        place = box([size] * dim, per=per)
    scene = drop_scene(place, dim, tension=dict(tension or {}), liquid=dict(liquid or {}), cell=cell, per=per)
    run = context.simulation(scene, backend)
    ledger, kept, stopped = follow(context, run, until, rows, shown)
    return Result(
        {"stopped": stopped, "dim": dim, "shown": list(shown), "steps": run.steps, "series": ledger.series,
         "last": late(ledger.series), "chance": measures.anisotropy_of_chance(run.count, dim),
         "cut": measures.anisotropy_of_cut(radius_of(run.count, dim, per), dim, per),
         "inside": measures.evenness(run), **ledger.summary()},
        kept,
    )  # fmt: skip


def erratum(context: Context, backend: str, printed: str, dim: int, size: float, until: float) -> Result:
    """A square or a cube becomes round with one erratum of the thesis as printed, or none (""), all else as adopted."""
    literal: dict[str, Any] = {"literal": (printed,)} if printed else {}
    surface = literal if printed in Tension.errata else {"embedding": "thesis"} if printed == THESIS else {}
    liquid = literal if printed and printed != THESIS and printed not in Tension.errata else {}
    run = context.simulation(drop_scene(box([size] * dim), dim, tension=surface, liquid=liquid), backend)
    nothing = {"stopped": "", "dim": dim, "printed": printed, "steps": 0}
    try:
        ledger, _, stopped = follow(context, run, until, 60)
    except RunStopped as stop:
        return Result({**nothing, "stopped": f"{stop.reason} in step {run.steps}", "steps": run.steps})
    return Result({**nothing, **ledger.summary(), "stopped": stopped, "steps": run.steps})


def held(
    context: Context, backend: str, body: str, until: float, dim: int = 2, tension: Mapping[str, Any] | None = None,
    liquid: Mapping[str, Any] | None = None, step: float | None = None,
) -> Result:  # fmt: skip
    """How long a scene holds: when the runner's note comes, and when and why it stops.

    body  "square" of 20 cells, "box" of R = 6.3 cells as in `rounding`; "rest", "turn" (20 rad/s, from J = 1) and
          "swing" (10 %) of a disc of 11 cells or a ball of 6; "meet" as in `collision`, "sheet" as in `sheet`
    """
    balanced, velocity = body in ("rest", "swing"), None
    if body in ("square", "box"):
        scale = 10.0 / math.prod(SIDES) ** (1 / 3)
        place = box([20.0] * 2) if body == "square" else box([round(2 * scale * s) / 2 for s in SIDES], seed=3)
    elif body == "sheet":
        place, tension, step = box([40.0, 1.0]), {"surface_tension": 0.1, **(tension or {})}, 0.0
    else:
        single = ellipsoid({"meet": 8.0}.get(body, 11.0) if dim == 2 else 6.0, dim, 0.1 if body == "swing" else 0.0)
        place = single
        if body == "meet":
            apart = np.array([10.0, 2.0])
            place = np.vstack([single - apart, single + apart])
            velocity = np.sign(-place[:, :1]) * [1.0, 0.0, 0.0]
        if body == "turn":
            velocity = SPIN * CELLS[dim] * np.stack([-place[:, 1], place[:, 0], 0 * place[:, 0]], axis=1)
    moving = {} if velocity is None else {"velocity": velocity}
    scene = drop_scene(
        place, dim, tension=dict(tension or {}), liquid=dict(liquid or {}), balanced=balanced, step=step, **moving
    )
    run = context.simulation(scene, backend)
    noted: list[float] = []
    greatest = 0.0

    def look(run: Simulation) -> None:
        nonlocal greatest
        greatest = max(greatest, float(run.field("greatest_crowding")[0]))
        if run.remarks and not noted:
            noted.append(run.time)

    ledger, _, stopped = follow(context, run, until, 60, each=look)
    turning = ledger.series["angular"]
    return Result(
        {"noted": noted[0] if noted else None, "stopped": stopped.split(" in ")[0], "time": run.time, "until": until,
         "crowding": greatest, "inside": measures.evenness(run)["mean"], "dim": dim,
         "angular": turning[-1] / turning[0] - 1 if body == "turn" else None, "steps": run.steps}
    )  # fmt: skip


def late(series: Mapping[str, Sequence[float]], share: float = 0.25) -> dict[str, dict[str, float]]:
    """Least, mean and largest of the shape's measures over the last quarter of a run."""
    begin = int((1 - share) * len(series["time"]))
    made = {}
    for name in ("volume", "sphericity", "anisotropy", "particle_anisotropy", "pressure", "area"):
        values = np.array(series[name][begin:])
        made[name] = {"least": float(values.min()), "mean": float(values.mean()), "largest": float(values.max())}
    return made


def at_rest(
    context: Context, backend: str, dim: int, radius: float, until: float, seed: int = 0, modulus: float = MODULUS,
    tension: Mapping[str, Any] | None = None, dtype: str = "float64", step: float | None = None,
    shown: Sequence[float] = (),
) -> Result:  # fmt: skip
    """A disc or a ball cut from a turned lattice, with the J that holds its pressure: the pressure it settles at."""
    place = ellipsoid(radius, dim, seed=seed)
    scene = drop_scene(
        place, dim, tension=dict(tension or {}), liquid={"bulk_modulus": modulus}, balanced=True, dtype=dtype, step=step
    )
    run = context.simulation(scene, backend)
    ledger, kept, stopped = follow(context, run, until, 60, shown)
    return Result(
        {"stopped": stopped, "dim": dim, "shown": list(shown), "series": ledger.series, **ledger.summary(),
         "steps": run.steps},
        kept,
    )  # fmt: skip


def oscillation(
    context: Context, backend: str, dim: int, radius: float, amplitude: float, periods: float,
    modulus: float = MODULUS, tension: Mapping[str, Any] | None = None, normalised: bool = True,
    embedding: str = "cluster", shown: Sequence[float] = (),
) -> Result:  # fmt: skip
    """An ellipse or a spheroid, longer by `amplitude`, swings; frequency against Rayleigh's, and what shifts it.

    shown       periods after which the surface is kept
    normalised  lambda in proportion to 1/R, so that the liquid's compression by its surface is the same for all radii
    """
    place = ellipsoid(radius, dim, amplitude)
    radius = radius_of(len(place), dim)
    if normalised:
        modulus = modulus * 11.0 / radius if dim == 2 else modulus
    surface = {"embedding": embedding, **(tension or {})}
    scene = drop_scene(place, dim, tension=surface, liquid={"bulk_modulus": modulus}, balanced=True)
    run = context.simulation(scene, backend)
    metres = radius * CELLS[dim]
    first = measures.rayleigh(metres, dim)
    until = periods * 2 * math.pi / first
    times, value = [], []

    def note(run: Simulation) -> None:
        if run.steps % 4 == 0:
            times.append(run.time)
            value.append(measures.deformation(run.field("position"), dim))

    instants = [share * 2 * math.pi / first for share in shown]
    ledger, kept, stopped = follow(context, run, until, 60, instants, note)
    fit = measures.damped_cosine(np.array(times), np.array(value), first)
    series = ledger.series
    area = float(np.mean(series["area"])) / round_area_of_ellipse(amplitude, dim)
    inertia = measures.inertia_share(run) if embedding != "none" else float("nan")
    return Result(
        {
            "stopped": stopped, "dim": dim, "radius_in_cells": radius, "amplitude": amplitude, "modulus": modulus,
            "ratio": fit["frequency"] / first, "ratio_error": fit["error"] / first, "damping": fit["damping"],
            "damping_of_period": fit["damping"] * 2 * math.pi / first, "misfit": fit["misfit"],
            "fitted_amplitude": fit["amplitude"], "inertia": inertia, "area_share": area,
            "compressible": measures.compressible(metres, dim, modulus), "series": series, **ledger.summary(),
            "swing": {"time": times[::4], "value": value[::4]}, "steps": run.steps, "shown": instants,
        },
        kept,
    )  # fmt: skip


def round_area_of_ellipse(amplitude: float, dim: int) -> float:
    """Mean area over a swing of an ellipse (spheroid) of this amplitude over that of the ball: 1 + O(amplitude^2)."""
    # in the plane 1 + 3 s^2/8 on average with a = R (1 + s cos wt); in space 1 + s^2/5
    return 1 + (0.375 if dim == 2 else 0.2) * amplitude**2


def potential_flow(context: Context, amplitudes: Sequence[float], modes: int = 12, dim: int = 2) -> Result:
    """Mode 2 of a drop of ideal liquid at finite amplitude: frequency over Rayleigh's.

    The same ellipses (spheroids), by another method: r(angle) and the potential on the surface as series of cosines
    (Legendre polynomials), the potential inside as sum c_n r^n Y_n by least squares, Bernoulli's equation and the
    curvature, DOP853 of SciPy.
    """
    from scipy.integrate import solve_ivp

    count = 4 * modes
    angle = (np.arange(count) + 0.5) * math.pi / (2 * count)
    n = np.arange(0, 2 * modes + 1, 2)
    shape, first_slope, second_slope = surface_series(angle, n, dim)
    to_series = np.linalg.pinv(shape)
    kept = np.where(n > 1.4 * modes, 0, 1)  # products fold back onto the highest modes
    measure = np.ones(count) if dim == 2 else np.sin(angle)
    share = np.cos(angle) ** 2 - np.sin(angle) ** 2 / (dim - 1), np.cos(angle) ** 2 + np.sin(angle) ** 2 / (dim - 1)
    rows = []
    for done, amplitude in enumerate(amplitudes):
        long, short = 1 + amplitude, (1 + amplitude) ** (-1 / (dim - 1))
        start = long * short / np.hypot(short * np.cos(angle), long * np.sin(angle))

        def slope(_: float, state: np.ndarray) -> np.ndarray:
            radius, potential = shape @ state[: len(n)], shape @ state[len(n) :]
            turn, bend = first_slope @ state[: len(n)], second_slope @ state[: len(n)]
            power = radius[:, None] ** n
            inside = np.linalg.lstsq(power * shape, potential, rcond=None)[0]
            outward, around = (n * power / radius[:, None] * shape) @ inside, (power * first_slope) @ inside / radius
            rising = outward - turn / radius * around
            curvature = (radius**2 + 2 * turn**2 - radius * bend) / (radius**2 + turn**2) ** 1.5
            if dim == 3:  # about the axis
                curvature = curvature + (1 - turn / radius / np.tan(angle)) / np.hypot(radius, turn)
            pushed = -0.5 * (outward**2 + around**2) - curvature + (dim - 1) + outward * rising
            return np.concatenate([kept * (to_series @ rising), kept * (to_series @ pushed)])

        first = measures.rayleigh(1.0, dim)
        instants = np.linspace(0, 3 * math.pi / first, 600)
        begin = np.concatenate([to_series @ start, np.zeros(len(n))])
        found = solve_ivp(slope, (0, instants[-1]), begin, t_eval=instants, rtol=1e-8, atol=1e-10, method="DOP853")
        weight = measure[:, None] * (shape @ found.y[: len(n)]) ** (dim + 2)
        swing = (weight * share[0][:, None]).sum(0) / (weight * share[1][:, None]).sum(0)
        rows.append(measures.damped_cosine(instants, swing, first)["frequency"] / first)
        context.progress((done + 1) / len(amplitudes))
    return Result({"amplitudes": list(amplitudes), "ratios": rows})


def surface_series(angle: np.ndarray, n: np.ndarray, dim: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """cos(n angle), or in space P_n(cos angle), and its first two slopes over the angle: each (angles, n)."""
    if dim == 2:
        cosine = np.cos(np.outer(angle, n))
        return cosine, -n * np.sin(np.outer(angle, n)), -(cosine * n**2)
    from numpy.polynomial import Legendre

    x, y = np.cos(angle), np.sin(angle)
    found = [Legendre.basis(int(k)) for k in n]
    value, rise, bend = (np.stack([p.deriv(m)(x) for p in found], axis=1) for m in range(3))
    return value, -y[:, None] * rise, (y**2)[:, None] * bend - x[:, None] * rise


def collision(
    context: Context, backend: str, dim: int, radius: float, speed: float, until: float, shown: Sequence[float],
    embedding: str = "cluster", step: float | None = None, tension: Mapping[str, Any] | None = None,
) -> Result:  # fmt: skip
    """Two drops meet off their axis, each at `speed` [m/s]: ledgers until they are one."""
    single = ellipsoid(radius, dim)
    apart = np.array([radius + 2.0, 0.25 * radius, 0.0])[:dim]
    place = np.vstack([single - apart, single + apart])
    velocity = np.zeros((len(place), 3))
    velocity[: len(single), 0], velocity[len(single) :, 0] = speed, -speed
    scene = drop_scene(place, dim, velocity=velocity, tension={"embedding": embedding, **(tension or {})}, step=step)
    run = context.simulation(scene, backend)
    ledger, kept, stopped = follow(context, run, until, 120, shown)
    # both drops turn about the common centre: L is not zero here, its drift is
    first = ledger.series["angular"][0]
    drift = max(abs(a - first) for a in ledger.series["angular"])
    summary = ledger.summary()
    scale = float(ledger.mass.sum()) * ledger.fastest * ledger.radius
    return Result(
        {"stopped": stopped, "dim": dim, "shown": list(shown), "series": ledger.series, **summary,
         "angular": drift / scale, "steps": run.steps},
        kept,
    )  # fmt: skip


def on_floor(
    context: Context, backend: str, dim: int, radius: float, angle: float, until: float, shown: Sequence[float] = (),
    tension: Mapping[str, Any] | None = None, liquid: Mapping[str, Any] | None = None,
) -> Result:  # fmt: skip
    """Half a disc or ball on a slipping floor takes its contact angle: circle through its free surface over time."""
    place = ellipsoid(radius, dim, seed=1)
    place = place[place[:, 1] > 0]
    room = float(math.ceil(4 * radius))
    walls = {"lower": (-room, 0.0, -room), "upper": (room, room, room), "rule": "slip"}
    wet = {"contact_angle": float(angle), **(tension or {})}
    scene = drop_scene(place, dim, tension=wet, liquid=dict(liquid or {}), walls=walls)
    run = context.simulation(scene, backend)
    h, angles_seen, times = CELLS[dim], [], []
    fits: list[dict[str, float]] = []

    def note(run: Simulation) -> None:
        if run.steps % 10 == 0:
            samples = measures.surface_of(run).samples
            position = run.backend.host(samples.position).astype(float)
            fits.append(measures.contact(position, 0.0, h, dim))
            height = float(run.field("position")[:, 1].mean())
            fits[-1]["angle_of_mass"] = measures.angle_of_mass(height, run.count * (h / 2) ** dim, dim)
            times.append(run.time)
            angles_seen.append(fits[-1]["angle"])

    ledger, kept, stopped = follow(context, run, until, 60, shown, note)
    late = fits[len(fits) // 2 :]
    made = {name: float(np.mean([f[name] for f in late])) for name in late[0]}
    spread = float(np.std([f["angle"] for f in late]))
    return Result(
        {"stopped": stopped, "dim": dim, "asked": angle, "shown": list(shown), "time": times, "angles": angles_seen,
         **ledger.summary(), **made, "spread": spread, "series": ledger.series, "steps": run.steps},
        kept,
    )  # fmt: skip


def sheet(context: Context, backend: str, length: float, thick: float, tension: float, until: float,
          shown: Sequence[float], embedding: str = "cluster") -> Result:  # fmt: skip
    """A sheet of liquid in the plane draws back from its ends: their speed against Taylor and Culick's."""
    place = box([length, thick])
    scene = drop_scene(place, 2, tension={"surface_tension": tension, "embedding": embedding}, step=0.0)
    run = context.simulation(scene, backend)
    times, width = [], []

    def note(run: Simulation) -> None:
        x = run.field("position")[:, 0]
        times.append(run.time)
        width.append(float(x.max() - x.min()) / CELLS[2])

    ledger, kept, stopped = follow(context, run, until, 60, shown, note)
    culick = math.sqrt(2 * tension / (thick * CELLS[2]))
    t, w = np.array(times), np.array(width)
    held = (w < 0.9 * length) & (w > 0.5 * length)
    speed = -0.5 * float(np.polyfit(t[held], w[held], 1)[0]) * CELLS[2] if held.sum() > 5 else float("nan")
    return Result(
        {"stopped": stopped, "dim": 2, "shown": list(shown), "series": ledger.series, **ledger.summary(),
         "speed": speed, "culick": culick, "width": {"time": times[::5], "value": width[::5]}, "steps": run.steps},
        kept,
    )  # fmt: skip


def example(context: Context, backend: str, until: float, shown: Sequence[float]) -> Result:
    """The scene file refsim/examples/mpm_droplet.toml, as `refsim run` runs it, and its surface."""
    plan = load_scene(EXAMPLE)
    run = context.simulation(plan, backend)
    ledger, kept, stopped = follow(context, run, until, 60, shown)
    return Result(
        {"stopped": stopped, "dim": 3, "shown": list(shown), "series": ledger.series, **ledger.summary(),
         "steps": run.steps, "millimetres": 1e3 * ledger.h},
        kept,
    )  # fmt: skip
