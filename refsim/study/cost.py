"""Wall time and memory of a scene on this machine, before it is run.

The seconds of a run are those of its passes and of its list builds:

    T = sum over passes of  n_steps r_p t_p(N)  +  n_builds r_b t_b(N)

    t_p(N)   seconds of one launch with N particles on the scene's lattice, measured at a few sizes N of this scene and
             continued linearly beyond the largest; of an iteration whose first steps differ, the mean of
             the coarse run in proportion to N; sizes of an iteration on a GPU are timed up to one time of the flow
    r_p      mean seconds of a launch over the course of a run over those of its first steps, measured in a coarse run
    n_steps  from the step limits of the scene at the speeds, accelerations and rates of exchange of the coarse run
    n_builds from its list builds: the number grows as the path in units of the list's skin

Neighbours enter with the lattice: every size has the scene's ratio of support radius to spacing, and so its neighbours.
The coarse run is the scene with a larger spacing; see `refsim.scene.refine`.
"""

import dataclasses
import math
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from refsim.backends.arrays import unavailable
from refsim.backends.threads import threads_for
from refsim.core.effect import Extremes
from refsim.core.errors import InputError, RunStopped
from refsim.core.operation import BACKENDS
from refsim.engine.simulation import Simulation
from refsim.engine.stepping import DeviceStepper, stable_steps, step_limits
from refsim.io.store import read_stored, write_stored
from refsim.scene.plan import Plan, make_plan
from refsim.scene.refine import fitting, refined
from refsim.scene.scene import Scene
from refsim.study.memory import bytes_of
from refsim.study.runs import machine, scene_digest, source_digest
from refsim.study.waits import waits

FORMAT = 2  # of kept constants
COARSE = 1000  # particles of the coarse run, about
SIZES = 4.0  # ratio of the particles of two sizes at which launches are timed
FIRST = 4  # timed steps of each size, each with a list build; on a GPU also as many without
MOST_STEPS = 200  # of each kind on a GPU, where so many
SHORT = 0.2  # [s] take no longer than this
ITERATED = 16  # steps of the smallest size where a GPU's steps iterate; larger sizes are timed up to its time
SHARES = {"course": 0.5, "sizes": 0.5}  # of the seconds that measuring may take
MOST = {"numpy": 250, "cpu": 300_000, "cuda": 4_000_000}  # particles of the largest size
LONG = 60.0  # [s] of a run for which constants are measured before it begins
LEAST_PER_PARTICLE = 3e-7  # [s] of a step, less than any scene takes
HISTORY = 200  # entries of the coarse run's history
USUAL_SHARE = (0.5, 2.0)  # r_p of a pass whose first steps do what later ones do
LARGEST_GROWTH = 2.0  # of its seconds a particle, from the smallest to the largest size
LISTS = "neighbours"  # stage of the list builds
SLOW = 5.0  # times the median step on a GPU, beyond which a step has compiled or recorded kernels


@dataclass
class Course:
    """A coarse run of the scene, condensed.

    spacing   of the coarse run [m]
    reached   simulated time up to which it was run [s]
    history   of k blocks of steps: time [s] at its end, means of the largest speed, acceleration and rate of exchange
              of all particles [m/s, m/s^2, 1/s]
    steps, builds              up to `reached`
    seconds   of each stage in a step, mean; of a list build for "neighbours"
    """

    spacing: float
    particles: int
    reached: float
    history: list[list[float]] = field(default_factory=list)
    steps: int = 0
    builds: int = 0
    seconds: dict[str, float] = field(default_factory=dict)
    stopped: str = ""


@dataclass
class Constants:
    """What was measured of a scene on one backend of this machine.

    sizes  particles of each size, and seconds of each stage in a step there; of a list build for "neighbours"
    """

    backend: str
    threads: int | None
    course: Course
    sizes: list[tuple[int, dict[str, float]]]
    measured_in: float  # [s]


@dataclass(frozen=True)
class Prediction:
    """What a run would take on a backend.

    seconds   of its steps, without compiling, frames and checkpoints; NaN where the backend is not available
    stages    seconds by stage
    steps, builds  of the neighbour list
    bytes     of fields, lists and walls
    waits     seconds beside the steps: of the "start", of "loading" kernels, of "writing" frames; none if not measured
    kept      whether the constants were on file
    note      what limits the prediction, or why there is none; "" if nothing does
    """

    backend: str
    seconds: float
    steps: int = 0
    builds: int = 0
    bytes: int = 0
    particles: int = 0
    stages: dict[str, float] = field(default_factory=dict)
    waits: dict[str, float] = field(default_factory=dict)
    kept: bool = False
    note: str = ""

    @property
    def whole(self) -> float:
        """Seconds that the user of `refsim run` waits, on a warm cache."""
        return self.seconds + sum(self.waits.values())


def predict(
    scene: Scene | Plan, backend: str = "cpu", *, threads: int | None = None, budget: float = 5.0, fresh: bool = False
) -> Prediction:
    """What a run of the scene would take; its constants are measured unless they are on file.

    budget   seconds that measuring may take, beyond compiling
    fresh    measure anew

    Raises InputError for bad input.
    """
    plan = scene if isinstance(scene, Plan) else make_plan(scene)
    reason = unavailable(backend)
    if reason is not None:
        return Prediction(backend, math.nan, note=reason)
    known = None if fresh else load(plan.scene, backend, threads)
    return estimate(plan, known or constants_of(plan.scene, backend, threads, budget, fresh), known is not None)


def seconds_left(simulation: Simulation, until: float, threads: int | None = None) -> float | None:
    """Seconds that a simulation's steps to `until` [s] will take; None where that is not known.

    Measured beforehand only for a run that is long enough: constants take some seconds.
    """
    plan, backend = simulation.plan, simulation.backend.name
    scene = plan.scene
    found = load(scene, backend, threads)
    if found is None:
        steps = until / (min(stable_steps(step_limits(plan), Extremes(0.0, 0.0)).values()) * scene.step_factor)
        if backend == "numpy" or steps * plan.grid.count * LEAST_PER_PARTICLE < LONG:
            return None
        try:
            found = constants_of(scene, backend, threads)
        except (InputError, RunStopped):
            return None  # the run itself says why
    whole = dataclasses.replace(plan, scene=msgspec.structs.replace(scene, end_time=until))
    return estimate(whole, found).seconds * max(until - simulation.time, 0.0) / until if until else 0.0


def constants_of(
    scene: Scene, backend: str, threads: int | None = None, budget: float = 5.0, fresh: bool = False
) -> Constants:
    """A scene's constants: those on file, or measured and then kept.

    Raises InputError where the scene cannot be run on this backend.
    """
    found = None if fresh else load(scene, backend, threads)
    if found is None:
        found = calibrate(scene, backend, threads, budget)
        store(scene, found)
    return found


def every_backend(
    plan: Plan, threads: int | None = None, budget: float = 10.0, fresh: bool = False
) -> list[Prediction]:
    """Predictions for all backends, with what is waited for; with the reason for those that this machine lacks."""
    here = [name for name in BACKENDS if unavailable(name) is None]
    made = []
    for name in BACKENDS:
        try:
            found = predict(plan, name, threads=threads, budget=budget / len(here), fresh=fresh)
            if name in here and name != "numpy":  # whose constants have compiled what the run loads
                found = dataclasses.replace(found, waits=waits(plan, name, threads))
        except (InputError, RunStopped) as error:
            found = Prediction(name, math.nan, note=str(error))
        made.append(found)
    return made


# Measuring


def calibrate(scene: Scene, backend: str, threads: int | None = None, budget: float = 5.0) -> Constants:
    """Measure a scene's constants: a coarse run, and a few steps at some sizes.

    Raises InputError where the scene cannot be run on this backend.
    """
    began = time.perf_counter()
    particles = make_plan(scene).grid.count
    used = threads or threads_for(particles) if backend == "cpu" else threads  # those of the scene, at all sizes
    first = Simulation(_coarse(scene, particles, min(COARSE, MOST[backend])), backend, used)
    if _steps(first, 2) == 2:  # compiles what later steps launch
        first.lists.compare()
    course = _course(scene, backend, used, particles, SHARES["course"] * budget)
    sizes: list[tuple[int, dict[str, float]]] = []
    left = SHARES["sizes"] * budget
    wanted, until = float(course.particles), 0.0
    while True:
        clock = time.perf_counter()
        simulation = Simulation(_sized(scene, particles, wanted), backend, used)
        count, seconds = simulation.count, _first_steps(simulation, until, left)
        if sizes and (count <= sizes[-1][0] or simulation.time < until):
            break
        sizes.append((count, seconds))
        if backend == "cuda" and _iterates(simulation):
            until = until or simulation.time
        took = time.perf_counter() - clock
        left -= took
        wanted = count * SIZES
        if wanted > 0.5 * particles:
            wanted = float(particles)
        if count >= min(particles, MOST[backend]) or took * wanted / count > left:
            break
    if backend == "cuda" and course.seconds:
        of_lists = sizes[0][1].get(LISTS, 0.0) * max(course.builds - 1, 0) / max(course.steps - 1, 1)
        course.seconds["step"] = max(course.seconds["step"] - of_lists, 0.5 * sizes[0][1]["step"])
    return Constants(backend, threads, course, sizes, time.perf_counter() - began)


def _sized(scene: Scene, particles: int, wanted: float) -> Scene:
    """The scene with about `wanted` particles; the scene itself where it has no other spacing."""
    if wanted >= 0.9 * particles:
        return scene
    try:
        return refined(scene, fitting(scene, (wanted / particles) ** (1 / scene.dim)))
    except InputError:
        return scene


def _coarse(scene: Scene, particles: int, wanted: float) -> Plan:
    """The coarsest plan from `wanted` particles on that the scene's effects accept."""
    while wanted < 0.9 * particles:
        try:
            return make_plan(_sized(scene, particles, wanted))
        except InputError:
            wanted *= 2
    return make_plan(scene)


def _steps(simulation: Simulation, count: int) -> int:
    """Take up to so many steps, each with a list build; the number taken."""
    for done in range(count):
        simulation.lists.policy.invalidate()
        try:
            simulation.step()
        except RunStopped:
            return done
    return count


def _first_steps(simulation: Simulation, until: float, budget: float) -> dict[str, float]:
    """Seconds of each stage in a step, medians of some steps from the start; `until` and `budget` as `_whole_steps`."""
    _steps(simulation, 1)  # first calls are counted apart
    if simulation.backend.name == "cuda":
        return _whole_steps(simulation, until, budget)
    each: list[dict[str, float]] = []
    for _ in range(FIRST):
        before, clock = dict(simulation.timings.stages), time.perf_counter()
        if not _steps(simulation, 1):
            break
        whole = time.perf_counter() - clock
        now = simulation.timings.stages
        seconds = {stage: now[stage] - before.get(stage, 0.0) for stage in now}
        seconds["other"] = max(whole - sum(seconds.values()), 0.0)
        each.append(seconds)
    stages = {stage for seconds in each for stage in seconds}
    return {s: float(np.median([seconds.get(s, 0.0) for seconds in each])) for s in stages}


def _iterates(simulation: Simulation) -> bool:
    """Whether steps on a GPU need the host for another number of launches each, so that they are not one graph."""
    return not (isinstance(simulation.stepper, DeviceStepper) and simulation.stepper.recorded.whole)


def _whole_steps(simulation: Simulation, until: float = 0.0, budget: float = math.inf) -> dict[str, float]:
    """Seconds of a step that builds no list, and what a build adds to it, medians.

    A GPU works on while the host launches the next stage: stages of a step cannot be told apart by the host's clock.
    Steps that iterate need fewer iterations later: theirs is the mean up to the time `until` [s], or of some steps
    where that is 0, in at most `budget` seconds.
    """
    plain, built, began, iterates = list[float](), list[float](), time.perf_counter(), _iterates(simulation)
    for k in range(2 * MOST_STEPS):
        spent = time.perf_counter() - began
        if iterates and (spent > budget or (simulation.time >= until if until else k >= ITERATED)):
            break
        if not iterates and k >= 2 * FIRST and spent > SHORT:
            break
        spans = plain if k % 2 or simulation.search is None else built
        if spans is built:
            simulation.lists.policy.invalidate()
        clock = time.perf_counter()
        try:
            simulation.step()
        except RunStopped:
            break
        spans.append(time.perf_counter() - clock)
    step = float(np.median(plain or built or [0.0]))
    lists = {LISTS: max(float(np.median(built)) - step, 0.0)} if built else {}
    return {"step": _mean(plain) if iterates and plain else step} | lists


def _mean(spans: list[float]) -> float:
    """Mean of steps, without those that have compiled or recorded kernels."""
    usual = SLOW * float(np.median(spans or [0.0]))
    return float(np.mean([span for span in spans if span <= usual] or [0.0]))


def _course(scene: Scene, backend: str, threads: int | None, particles: int, budget: float) -> Course:
    """A coarse run to the scene's end, or as far as the budget [s] goes."""
    plan = _coarse(scene, particles, min(COARSE, MOST[backend]))
    simulation = Simulation(plan, backend, threads)
    end = scene.end_time
    course = Course(plan.grid.spacing, plan.grid.count, 0.0)
    began, rows, spans = time.perf_counter(), list[Any](), list[float]()
    while simulation.time < end and time.perf_counter() - began < budget:
        clock = time.perf_counter()
        try:
            simulation.step()
        except RunStopped as stop:
            course.stopped = str(stop)
            break
        spans.append(time.perf_counter() - clock)
        speed2, force2, _, rate, *_ = (float(x) for x in simulation.backend.host(simulation.extremes))
        rows.append((simulation.time, math.sqrt(speed2), math.sqrt(force2), rate))
    course.reached, course.steps = simulation.time, simulation.steps
    course.builds = simulation.search.log.rebuilds if simulation.search else 0
    block = max(1, math.ceil(len(rows) / HISTORY))
    for k in range(0, len(rows), block):
        part = np.array(rows[k : k + block])
        course.history.append([float(part[-1, 0]), *part[:, 1:].mean(0).tolist()])
    if backend == "cuda":
        if _iterates(simulation):  # one graph does the same work each time
            course.seconds = {"step": _mean(spans[1:])}
        return course
    steps, whole = max(simulation.steps - 1, 1), sum(spans[1:])
    stages = simulation.timings.stages
    course.seconds = {stage: seconds / steps for stage, seconds in stages.items() if stage != LISTS}
    if LISTS in stages and course.builds > 1:
        course.seconds[LISTS] = stages[LISTS] / (course.builds - 1)
    course.seconds["other"] = max(whole - sum(stages.values()), 0.0) / steps
    return course


# Estimating


def estimate(plan: Plan, constants: Constants, kept: bool = True) -> Prediction:
    """The prediction for a plan from constants; the plan may have another spacing than the scene measured."""
    n, course = plan.grid.count, constants.course
    steps = steps_of(plan, constants)
    finer = course.spacing / plan.grid.spacing
    end = plan.scene.end_time
    whole = end / course.reached if course.reached else 1.0
    builds = min(steps, 1 + (course.builds - 1) * finer * whole) if course.builds else 0.0  # the first: at the start
    first = constants.sizes[0][1]
    stages = {}
    for stage in {*course.seconds, *first}:
        launches = builds if stage == LISTS else steps
        if _representative(constants, stage):
            share = _share(course.seconds.get(stage), first.get(stage))
            each = _launch(constants, stage, n)
        else:
            share, each = 1.0, course.seconds[stage] * _growth(constants, n)
        stages[stage] = launches * share * each
    note = ""
    if course.stopped:
        note = f"the coarse run of {course.particles:,} particles stopped at {course.reached:.3g} s: {course.stopped}"
    elif course.reached < end:
        note = (
            f"the coarse run of {course.particles:,} particles was measured to {course.reached:.3g} of {end:g} s, and"
            " its last part taken for the rest"
        )
    memory = bytes_of(plan, constants.backend)["total"]
    return Prediction(
        constants.backend, sum(stages.values()), round(steps), round(builds), memory, n, stages, {}, kept, note
    )


def _representative(constants: Constants, stage: str) -> bool:
    """Whether a stage's first steps say what it takes later.

    They do not where it is not launched in them, or iterates and needs another number of iterations in them, which
    shows in seconds far from the course's, or that rise faster than the number of particles.
    """
    first, last = constants.sizes[0], constants.sizes[-1]
    if stage not in constants.course.seconds:
        return True
    if not first[1].get(stage):
        return False
    if stage == LISTS:
        return True
    share = _share(constants.course.seconds[stage], first[1][stage])
    growth = last[1].get(stage, 0.0) / first[1][stage] / (last[0] / first[0])
    return USUAL_SHARE[0] <= share <= USUAL_SHARE[1] and growth <= LARGEST_GROWTH


def _share(mean: float | None, first: float | None) -> float:
    """r_p: of the course's mean over the first steps' seconds; 1 where one of them was not measured."""
    return mean / first if mean and first else 1.0


def _launch(constants: Constants, stage: str, particles: int) -> float:
    """t_p(N): between two sizes and beyond the largest on a straight line; quadratic where all pairs are summed."""
    counts = np.array([count for count, _ in constants.sizes], dtype=float)
    seconds = np.array([each.get(stage, 0.0) for _, each in constants.sizes])
    if constants.backend == "numpy":
        counts, particles = counts**2, particles**2
    if particles <= counts[-1]:
        if particles < counts[0]:
            return float(seconds[0] * particles / counts[0])
        return float(np.interp(particles, counts, seconds))
    slope = seconds[-1] / counts[-1]
    if len(counts) > 1:
        measured = (seconds[-1] - seconds[-2]) / (counts[-1] - counts[-2])
        slope = min(max(measured, 0.0), slope)
    return float(seconds[-1] + slope * (particles - counts[-1]))


def _growth(constants: Constants, particles: int) -> float:
    """Seconds of a step of so many particles over those of the coarse run's.

    They grow as the particles, but on a GPU as the sizes say: it takes the same time for a thousand and for a hundred.
    """
    few, (least, first) = constants.course.particles, constants.sizes[0]
    if constants.backend != "cuda" or not first["step"]:
        return particles / few
    return _launch(constants, "step", particles) / _launch(constants, "step", max(few, least))


def steps_of(plan: Plan, constants: Constants) -> float:
    """Steps to the scene's end: its limits at the extremes of the coarse run.

    Accelerations of pressure waves and impacts grow as one over the spacing, rates of exchange as one over its square.
    """
    scene, course = plan.scene, constants.course
    if scene.end_time <= 0:
        return 0.0
    if scene.step > 0:
        return math.ceil(scene.end_time / scene.step)
    if not course.history:
        at_start = min(stable_steps(step_limits(plan), Extremes(0.0, 0.0)).values())
        return scene.end_time / (at_start * scene.step_factor)
    limits, finer = step_limits(plan), course.spacing / plan.grid.spacing
    total, last, rate = 0.0, 0.0, 0.0
    for end, speed, acceleration, exchange in course.history:
        allowed = stable_steps(limits, Extremes(speed, acceleration * finer, exchange * finer**2))
        rate = 1 / (min(allowed.values()) * scene.step_factor)
        total += (min(end, scene.end_time) - last) * rate
        last = min(end, scene.end_time)
    return total + max(scene.end_time - last, 0.0) * rate


# Kept constants


def _file(scene: Scene, backend: str, threads: int | None) -> Path:
    from refsim.backends.cache import cache_root

    digest = scene_digest(scene)
    digest.update(repr((FORMAT, backend, threads, source_digest(), machine())).encode())
    return cache_root() / "cost" / f"{digest.hexdigest()[:20]}.json"


def load(scene: Scene, backend: str, threads: int | None = None) -> Constants | None:
    """Constants on file for this scene, backend and machine; None if there are none."""
    try:
        found = read_stored(_file(scene, backend, threads))
        return None if found is None else msgspec.convert(found, Constants)
    except (InputError, ValueError):  # msgspec.ValidationError is a ValueError
        return None


def store(scene: Scene, constants: Constants) -> None:
    """Keep constants for this machine; a folder that cannot be written to is no error, they are measured anew then."""
    path = _file(scene, constants.backend, constants.threads)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_stored(path, asdict(constants))
    except OSError:
        return
