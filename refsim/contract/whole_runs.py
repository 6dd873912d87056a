"""A trajectory of another code against refsim's run of the same scene: by the chaos of the start, and by resolution.

What is compared are measures of the whole liquid, as single particles of two correct codes part soon. Three runs of
refsim, from the scene's start and from two starts that are shaken, say how far such a measure is determined at all. A
fourth with a coarser spacing says how far a code of another discretisation may be away.
"""

import contextlib
import itertools
import math
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from refsim.contract.target import Outcome
from refsim.contract.trajectories import Snapshot, trajectory
from refsim.core.errors import InputError, RunStopped
from refsim.engine.simulation import Simulation
from refsim.io.results import SAME_TIME
from refsim.scene.plan import make_plan
from refsim.scene.refine import RATIO, refined, spaced
from refsim.scene.scene import Scene
from refsim.sph import Gravity

SHAKEN = 1e-6  # of the particle spacing; of the coordinates' precision where that is coarser
SEEDS = (1, 2)
RATIOS = (RATIO, 2.0)  # of the coarser spacing to the scene's; the first at which boxes keep their edges
AXES = "xyz"
EXTENTS = ("largest", "smallest")  # measures of single particles, which no code knows to less than the spacing
DECIDES = 0.05  # share of a measure's range up to which the width of refsim's runs decides
MASS_ROUNDING = 1e-5  # share of the mass that sums in single precision may be off


@dataclass(frozen=True)
class Measure:
    """One measure as a curve over the frames up to the time of the comparison, told where it is farthest off."""

    name: str
    unit: str
    time: float  # [s]
    theirs: float  # of the trajectory at that time
    ours: tuple[float, ...]  # of refsim's three runs then, the unshaken first
    chaos: float  # largest distance from their middle: so many times their largest width, or as given
    resolution: float = 0.0  # that of the coarser run, of an extent at least the spacing; 0 where chaos is given

    @property
    def middle(self) -> float:
        """Middle between the smallest and the largest of refsim's runs."""
        return 0.5 * (min(self.ours) + max(self.ours))

    @property
    def difference(self) -> float:
        """Distance from the middle of refsim's runs."""
        return abs(self.theirs - self.middle)

    @property
    def allowed(self) -> float:
        """Largest difference with which the measure holds."""
        return max(self.chaos, self.resolution)

    @property
    def holds(self) -> bool:
        """Whether the difference is at most what is allowed."""
        return self.difference <= self.allowed

    @property
    def verdict(self) -> str:
        """Whether the measure holds, and by which of the two."""
        return "FAILS" if not self.holds else "holds" if self.difference <= self.chaos else "within resolution"


class Comparison(NamedTuple):
    """Measures of a trajectory and of refsim's runs up to a time."""

    time: float  # [s]
    measures: list[Measure]
    coarser: float | str  # its spacing [m], or why there is none
    times: list[float]  # of the frames [s]
    curves: Mapping[str, Sequence[float]]  # middle of refsim's runs at these, by measure
    bands: dict[str, float]  # largest difference that is allowed, by measure
    decides: tuple[float, str]  # time [s] from which on the runs' width is over 1/20 of a measure's range, that measure
    still: list[str]  # gauges whose values stood still
    behind: bool = False  # whether velocities are those of half a step before


# Measures

UNITS = {"particles": "-", "momentum": "kg m/s", "potential": "J", "kinetic": "J"}  # by a name's first word; else m


def curves_of(frames: Sequence[Snapshot], scene: Scene) -> dict[str, np.ndarray]:
    """{measure: values at the frames}: number, mass, centre, spread and extent, momentum and energies, as far as known
    in all frames.
    """
    told = [_measures(frame, scene) for frame in frames]
    return {name: np.array([values[name] for values in told]) for name in told[-1] if all(name in v for v in told)}


def _measures(frame: Snapshot, scene: Scene) -> dict[str, float]:
    gravity = next((effect.acceleration for effect in scene.effects if isinstance(effect, Gravity)), None)
    mass = np.ones(len(frame.position)) if frame.mass is None else frame.mass
    x, v, total = frame.position, frame.velocity, mass.sum()
    centre = (mass[:, None] * x).sum(0) / total
    spread = np.sqrt((mass[:, None] * (x - centre) ** 2).sum(0) / total)
    extents = {"centre": centre, "spread": spread, "largest": x.max(0), "smallest": x.min(0)}
    values: dict[str, Any] = {"particles": len(x), "mass": total}
    values |= {f"{name} {AXES[c]}": place[c] for c in range(scene.dim) for name, place in extents.items()}
    if gravity is not None:
        values["potential energy"] = -(mass * (x @ np.array(gravity))).sum()
    if v is not None:
        values |= dict(zip((f"momentum {axis}" for axis in AXES[: scene.dim]), (mass[:, None] * v).sum(0)))
        values["kinetic energy"] = 0.5 * (mass * (v**2).sum(1)).sum()
    return values


def compare(
    scene: Scene, folder: Path, at: float | None = None, backend: str = "cpu", within: float = 3.0,
    allowed: Mapping[str, float] | None = None, chaos_only: bool = False,
) -> Comparison:  # fmt: skip
    """The trajectory in a folder up to a time against three runs of refsim and a coarser one.

    at          time of the comparison [s], the last frame's by default; frames up to the one nearest to it are taken
    within      how many times the largest width of refsim's three runs a measure may be away from their middle
    allowed     largest distance by the name of a measure, in place of both bands
    chaos_only  without the coarser run: for a code with the same equations, spacing and steps

    The number of particles and, up to single precision, the mass are those of the scene. The frames' velocities belong
    to the frames' time; refsim's, which are half a step behind, are interpolated, unless the frames are refsim's. Where
    the frames have no masses, all particles have the same share of the scene's.
    Raises InputError for bad input and RunStopped where refsim's run stops.
    """
    frames = trajectory(folder)
    wanted = frames[-1].time if at is None else at
    time = min((frame.time for frame in frames), key=lambda t: abs(t - wanted))
    gaps = [later.time - earlier.time for earlier, later in itertools.pairwise(frames)]
    if abs(time - wanted) > 0.5 * max(gaps, default=0.0) + SAME_TIME * abs(wanted):
        raise InputError(f"{folder} has no frame at {wanted:.9g} s; the nearest is at {time:.9g} s.")
    if time <= 0:
        raise InputError(f"{folder}: the frame at {time:g} s is the start; give a later time with --at.")
    frames = [frame for frame in frames if 0 <= frame.time <= time]
    total = float(make_plan(scene).state.mass.sum())
    equal = (total / len(frame.position) * np.ones(len(frame.position)) for frame in frames)
    weighed = [replace(frame, mass=mass) if frame.mass is None else frame for frame, mass in zip(frames, equal)]
    theirs, given = curves_of(weighed, scene), dict(allowed or {})
    unknown = ", ".join(given.keys() - theirs.keys())
    if unknown:
        raise InputError(f"--allow: there is no measure {unknown}; there are {', '.join(theirs)}.")
    given = {"particles": 0.0, "mass": MASS_ROUNDING * total} | given
    times, behind = [frame.time for frame in frames], frames[-1].behind
    still: list[str] = []
    runs = [run_of(scene, seed, times, backend, behind, still=still) for seed in (None, *SEEDS)]
    other, coarser = (None, "") if chaos_only else _coarser(scene, times, backend, behind, total)
    compared, middles, bands, decides = [], {}, {}, (math.inf, "")
    for name, curve in theirs.items():
        ours = np.array([run[name] for run in runs])  # (runs, frames)
        middle, width = 0.5 * (ours.min(0) + ours.max(0)), within * np.ptp(ours, axis=0)
        chaos, resolution = given.get(name, float(width.max())), 0.0
        if name not in given and other is not None:
            resolution = float(np.abs(other[name] - middle).max())
            resolution = max(resolution, scene.spacing if name.startswith(EXTENTS) else 0.0)
        off = np.abs(curve - middle)
        k = int(np.flatnonzero(off == off.max())[-1])
        unit = UNITS.get(name.split()[0], "m") if name != "mass" else "kg" if scene.dim == 3 else "kg/m"
        found = float(curve[k]), tuple(ours[:, k].tolist())
        compared.append(Measure(name, unit, times[k], *found, chaos, resolution))
        middles[name], bands[name] = middle, compared[-1].allowed
        spread = [at for at, wide in zip(times, width) if wide > DECIDES * np.ptp(middle)]
        if next(at for at in times if at > 0) not in spread:  # else it says nothing, as what is zero by symmetry
            decides = min(decides, (min(spread, default=math.inf), name))
    return Comparison(time, compared, coarser, times, middles, bands, decides, still, behind)


def _coarser(
    scene: Scene, times: Sequence[float], backend: str, behind: bool, total: float
) -> tuple[dict[str, np.ndarray] | None, float | str]:
    """(measures at times [s] of a run with a coarser spacing and the same mass, the spacing), or (None, why not)."""
    why = ""
    for ratio in RATIOS:
        try:
            other = refined(scene, spaced(scene, 2, 0, ratio)[0])
            return run_of(other, None, times, backend, behind, total), other.spacing
        except (InputError, RunStopped) as error:
            why = why or str(error)
    return None, why


def run_of(
    scene: Scene, seed: int | None, times: Sequence[float], backend: str, behind: bool = False, total: float = 0.0,
    still: list[str] | None = None,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Measures at times [s] of a run from the scene's start, or from a shaken one; with a total mass [kg] if given.

    behind  whether velocities are those of half a step before the times
    still   is given the names of gauges whose values stood still
    """
    simulation = Simulation(scene, backend)
    mass = np.asarray(simulation.field("mass"), dtype=float)
    mass = total / mass.sum() * mass if total else mass
    if seed is not None:
        position = simulation.field("position")
        grid = simulation.plan.grid
        coarse = 2 * float(np.finfo(grid.dtype).eps) * float(np.abs(grid.local(position)).max(initial=0.0))
        amount = max(SHAKEN * scene.spacing, coarse)
        shift = np.random.default_rng(seed).uniform(-amount, amount, position.shape)
        shift[:, scene.dim :] = 0
        simulation.set_field("position", (position + shift).astype(position.dtype))

    def state() -> list[tuple[float, np.ndarray]]:
        """Positions and velocities, each with their time [s]."""
        now, half = simulation.time, 0.0 if behind else 0.5 * simulation.previous_length
        position, velocity = (np.asarray(simulation.field(name), dtype=float) for name in ("position", "velocity"))
        return [(now, position), (now - half, velocity)]

    before = after = state()
    frames = []
    for until in times:
        while simulation.time - 0.5 * simulation.previous_length < until:
            simulation.step()
            before, after = after, state()
        position, velocity = (  # by a straight line through those of two times
            last if end == start else first + (last - first) * (until - start) / (end - start)
            for (start, first), (end, last) in zip(before, after)
        )
        frames.append(Snapshot(until, position, velocity, mass))
    for gauge in scene.gauge if still is not None and seed is None else ():
        if not np.ptp(simulation.gauge(gauge.name).values, axis=0).any():
            still.append(gauge.name)  # type: ignore[union-attr]
    return curves_of(frames, scene)


def report(compared: list[Measure]) -> list[dict[str, Any]]:
    """The measures as plain data."""
    told = ("name", "unit", "time", "theirs", "chaos", "resolution", "difference", "allowed", "holds", "verdict")
    return [{name: getattr(m, name) for name in told} | {"refsim": list(m.ours)} for m in compared]


# What the verdict would have noticed, and what nothing touched

LITTLE = 0.01  # share by which a parameter is off in the runs that are compared
SCALED = ("acceleration", "velocity")  # vectors that are multiplied as a whole; others are places


class Sensitivity(NamedTuple):
    """The least error of a parameter, as a share of it, that the measure `by` would have shown; infinite for none."""

    parameter: str
    error: float
    by: str


def sensitivities(scene: Scene, compared: Comparison, backend: str) -> Iterator[Sensitivity]:
    """The least error of each parameter of the scene's effects that the comparison would have noticed.

    One run with each parameter off by a hundredth, of which less, or more, is a multiple.
    """
    for name, altered in off_by_little(scene):
        try:
            run = run_of(altered, None, compared.times, backend, compared.behind)
        except RunStopped:
            yield Sensitivity(name, LITTLE, "the run, which stops")
            continue
        moved = {measure: float(np.abs(run[measure] - curve).max()) for measure, curve in compared.curves.items()}
        shares = {m: LITTLE * compared.bands[m] / most if most > 0 else math.inf for m, most in moved.items()}
        by = min(shares, key=lambda measure: shares[measure])
        yield Sensitivity(name, shares[by], by if shares[by] < math.inf else "")


def off_by_little(scene: Scene) -> Iterator[tuple[str, Scene]]:
    """(parameter, scene with it a hundredth larger, or smaller where more is not possible); none that no run takes."""
    for effect in scene.effects:
        for field in msgspec.structs.fields(type(effect)):
            value = getattr(effect, field.name)
            number = isinstance(value, float) and math.isfinite(value) and value != 0
            vector = field.name in SCALED and isinstance(value, tuple) and any(value)
            for share in (1 + LITTLE, 1 - LITTLE) if number or vector else ():
                other: Any = tuple(share * v for v in value) if vector else share * value
                with contextlib.suppress(InputError):
                    altered = scene.with_(**{f"{effect.name}__{field.name}": other})
                    make_plan(altered)
                    yield f"{effect.name}.{field.name}", altered
                    break


def untouched(scene: Scene, compared: Comparison, errors_of: Mapping[str, float]) -> list[str]:
    """Faces of walls that no particle came near, gauges whose values stood still, effects without any action.

    errors_of  {parameter: least error}, see `sensitivities`
    """
    told = []
    for effect in scene.effects:
        errors = [error for name, error in errors_of.items() if name.partition(".")[0] == effect.name]
        if errors and min(errors) == math.inf:
            told.append(f"effect {effect.name}")
        places: list[Any] = [getattr(effect, name, None) for name in ("lower", "upper")]
        for axis in range(scene.dim) if all(isinstance(place, tuple) for place in places) else ():
            for sign, word, place in (("-", "smallest", places[0]), ("+", "largest", places[1])):
                curve, face = compared.curves.get(f"{word} {AXES[axis]}", ()), f"{sign}{AXES[axis]}"
                apart = min((abs(value - place[axis]) for value in curve), default=0.0)
                if apart > scene.support_radius and face not in getattr(effect, "open_faces", ()):
                    told.append(f"{effect.name} {face}")
    return told + [f"gauge {name}" for name in compared.still]


def bits(simulation: Simulation) -> dict[str, bytes]:
    """Everything that a run carries from step to step, in the particles' first order."""
    fields = {name: simulation.field(name).tobytes() for name, f in simulation.plan.fields.items() if f.state}
    return fields | {"time": repr((simulation.time, simulation.steps, simulation.previous_length)).encode()}


def resumes(scene: Scene, backend: str = "cpu", steps: tuple[int, int] = (7, 9)) -> Iterator[Outcome]:
    """T8 for one scene on one backend: `steps` before and after the checkpoint.

    Compared are a run that never stopped, the run that wrote the checkpoint, and one resumed from it, at the
    checkpoint and at the end. Raises InputError for a bad scene or a backend that is not there.
    """
    begin, rest = steps

    def advanced(simulation: Simulation, count: int) -> Simulation:
        for _ in range(count):
            simulation.step()
        return simulation

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "checkpoint.h5"
        whole = bits(advanced(Simulation(scene, backend), begin + rest))
        watched = advanced(Simulation(scene, backend), begin)
        half = bits(watched)
        watched.checkpoint(path)
        resumed = Simulation.resume(path)
        found = {
            "resumed as it was": bits(resumed) == half,
            "resumed to the end": bits(advanced(resumed, rest)) == whole,
            "writing changed nothing": bits(advanced(watched, rest)) == whole,
            "something happened": half["position"] != whole["position"],
        }
    for trial, passed in found.items():
        error = 0.0 if passed else math.inf
        yield Outcome("run", "T8", f"{scene.name}: {trial}", backend, scene.dtype, 0, passed, error)
