"""Scenes whose steps are timed by `tests/times`, what their plans say of a step, and what a step launches.

A ladder is a scene to which effects are added one by one; the systems are one scene of each method, at any size; the
turning cube is the scene of the device's limits.
"""

import functools
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import refsim
from refsim.backends import runtime
from refsim.engine.binding import fused
from refsim.engine.launching import ready
from refsim.scene.plan import Plan, make_plan
from refsim.study.cost import bytes_of
from validation.running import take_steps

PEBBLE = str(Path(__file__).resolve().parent.parent / "refsim" / "examples" / "pebble.obj")
STEP = 2e-5  # [s], so short that the particles stay where they are and a neighbour list is built once
EDGE = 79  # particles along the edge of a system's cube: 493,039
SUMMED = functools.partial(refsim.WeaklyCompressible, density="summation")
SOUND, SPIN = 20.0, 1.0  # of the turning cube [m/s], [rad/s]
LIQUID = SUMMED(sound_speed=20.0, dynamic_viscosity=5.0)
THIN = SUMMED(sound_speed=SOUND, dynamic_viscosity=1.0)
COHESION = refsim.JiangZhu2023(surface_tension=0.5, pair_mode="all", area_ratio=0.0, density_correction=False)
# Effects of the turning cube by the name of a reading
CUBES: dict[str, tuple[Any, ...]] = {
    "jiang_zhu": (THIN, COHESION),
    "akinci": (THIN, refsim.Akinci2013(surface_tension=0.5)),  # cohesion and area term
    "detection": (THIN, COHESION, refsim.SurfaceDetection(each_step=True)),
    "dong": (THIN, refsim.Dong2016(surface_tension=0.5)),
    "he": (THIN, refsim.He2014(surface_tension=0.5)),
    "csf": (THIN, refsim.CsfWang2019(surface_tension=0.5)),
    "becker": (THIN, refsim.BeckerTeschner2007(surface_tension=0.5)),
    "tartakovsky": (THIN, refsim.TartakovskyMeakin2005(surface_tension=0.5)),
    "normal_difference": (THIN, refsim.NormalDifference2014(area_acceleration=0.1)),
    "continuity": (refsim.WeaklyCompressible(density="continuity", sound_speed=SOUND, dynamic_viscosity=1.0),),
    "shifting": (refsim.WeaklyCompressible(sound_speed=SOUND, dynamic_viscosity=1.0),),
    "papers": (THIN,),
}  # fmt: skip


@dataclass(frozen=True)
class Rung:
    """A scene of a ladder, and what it has beyond the one before."""

    words: str
    scene: refsim.Scene


@dataclass(frozen=True)
class Ladder:
    """Scenes to which effects are added one by one."""

    words: str
    rungs: tuple[Rung, ...]


def ladders(small: bool = False) -> dict[str, Ladder]:
    """All ladders; `small` ones have the same effects and tens of particles."""
    return {"sph": _sph(small), "melting": _melting(small), "mpm": _mpm(small), "mesh": _mesh(small)}


def _climb(title: str, base: Mapping[str, Any], *rungs: tuple[Any, ...]) -> Ladder:
    """A ladder of (words, effects, what else the scene has)."""
    return Ladder(title, tuple(
        Rung(said, refsim.Scene(effects=effects, step=STEP, **base, **dict(*more))) for said, effects, *more in rungs
    ))  # fmt: skip


def _sph(small: bool) -> Ladder:
    edge, d = 3 if small else 16, 0.01
    base = {"spacing": d, "support_radius": 2 * d, "fluid": (refsim.Box(cells=(edge,) * 3),), "name": "effects_sph"}
    plain = SUMMED(sound_speed=4.0, clamp_pressure=False)
    liquid = SUMMED(sound_speed=4.0, clamp_pressure=False, dynamic_viscosity=0.5)
    walls = refsim.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(2 * edge * d, edge * d, 2 * edge * d))
    detected, tension = refsim.SurfaceDetection(each_step=True), refsim.JiangZhu2023(surface_tension=0.07)
    parts = (liquid, refsim.Gravity(), walls, detected, tension)
    added = (
        "viscosity", "gravity", "walls of a box", "surface detection in each step", "surface tension (Jiang & Zhu)",
    )  # fmt: skip
    rungs = ((f"+ {step}", parts[: k + 1]) for k, step in enumerate(added))
    density = {"density": "continuity", "sound_speed": 4.0, "clamp_pressure": False, "dynamic_viscosity": 0.5}
    pairs = (
        (step, (refsim.WeaklyCompressible(**density, **more), *parts[1:]))
        for step, more in (("the same, density advanced", {"restoring": 0.0}), ("+ restoring", {}))
    )
    return _climb("weakly compressible SPH, 3D", base, ("liquid", (plain,)), *rungs, *pairs)


def _melting(small: bool) -> Ladder:
    wide, deep = (4, 2) if small else (16, 10)
    d, top = 0.01, wide * 0.01
    fluid = (refsim.Box(cells=(wide, wide, deep)),)
    base = {"spacing": d, "support_radius": 2.1 * d, "fluid": fluid, "name": "effects_melting"}
    low = (0.25 * top, 0.25 * top, deep * d)
    solid = {"solid": (refsim.SolidBox(lower=low, upper=(0.75 * top, 0.75 * top, deep * d + 0.5 * top)),)}
    walls = refsim.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(top, top, 4 * top))
    liquid = (SUMMED(sound_speed=10.0), refsim.Gravity(), walls)
    bodies = (*liquid, refsim.ShapeMatching(), refsim.TwoWayCoupling())
    warm = refsim.HeatConduction(temperature=50.0, melting_point=0.0)
    return _climb(
        "melting solids in a tank, 3D", base, ("liquid, gravity, walls of a box", liquid),
        ("+ a solid: shape matching and coupling", bodies, solid), ("+ conduction of heat", (*bodies, warm), solid),
        ("+ melting", (*bodies, warm, refsim.Melting()), solid),
    )  # fmt: skip


def _mpm(small: bool) -> Ladder:
    edge, d = 3 if small else 64, 0.01
    fluid = (refsim.Box(cells=(edge, edge, 1)),)
    base = {"dim": 2, "spacing": d, "support_radius": 3 * d, "fluid": fluid, "name": "effects_mpm"}
    viscous = (refsim.MpmLiquid(bulk_modulus=1e4, dynamic_viscosity=0.1),)
    heavy = (*viscous, refsim.Gravity(acceleration=(0.0, -9.81, 0.0)))
    tense = (*heavy, refsim.SurfaceEnergy(surface_tension=0.07))
    walls = refsim.MpmWalls(lower=(-0.5, 0.0, 0.0), upper=(2.0, 2.0, 0.0))
    return _climb(
        "material points, 2D", base, ("liquid", (refsim.MpmLiquid(bulk_modulus=1e4),)), ("+ viscosity", viscous),
        ("+ gravity", heavy), ("+ surface energy", tense), ("+ walls, which mirror the surface", (*tense, walls)),
    )  # fmt: skip


def _mesh(small: bool) -> Ladder:
    edge, d = 3 if small else 14, 0.02
    middle = 0.5 * edge * d
    place: dict[str, Any] = {"file": PEBBLE, "center": (middle, middle, -1.5 * middle), "size": 2.5 * middle}
    base = {"spacing": d, "support_radius": 2 * d, "fluid": (refsim.Box(cells=(edge,) * 3),), "name": "effects_mesh"}
    fluid, kept = (SUMMED(sound_speed=8.0), refsim.Gravity()), {**place, "correction": "none"}
    sticky = {"viscosity": 0.1, "adhesion": 0.1}
    return _climb(
        "a mesh as boundary, 3D", base, ("liquid and gravity", fluid),
        ("+ a mesh: pressure of its particles", (*fluid, refsim.MeshBoundary(**kept))),
        ("+ friction", (*fluid, refsim.MeshBoundary(viscosity=0.1, **kept))),
        ("+ adhesion", (*fluid, refsim.MeshBoundary(**sticky, **kept))),
        ("+ correction of places", (*fluid, refsim.MeshBoundary(**sticky, **place))),
    )  # fmt: skip


def systems(edge: int = EDGE) -> dict[str, Callable[[], refsim.Scene]]:
    """A scene of each system with about edge^3 particles, float32, by the words of its page."""
    d = 1.0 / edge
    cube: dict[str, Any] = {"spacing": d, "support_radius": 2.6 * d, "fluid": (refsim.Box(cells=(edge,) * 3),)}

    def akinci() -> refsim.Scene:
        from validation.experiments.timing.runs import spinning_block

        return spinning_block(edge, 0.5)

    def melting() -> refsim.Scene:
        from validation.experiments.melting.scene import make_scene, shared_tank

        return make_scene(shared_tank("figure_6", 2.55 * edge / 100, 1 / 3))

    def mpm() -> refsim.Scene:
        cell = 1 / 64
        liquid = refsim.Box(lower=(0.2, 0.2, 0.2), cells=(edge,) * 3)
        effects = (refsim.MpmLiquid(rest_density=1.0, bulk_modulus=1000.0), refsim.SurfaceEnergy(surface_tension=1.0))
        return refsim.Scene(spacing=cell / 2, support_radius=1.5 * cell, step=1e-4, fluid=(liquid,), effects=effects)

    def mesh() -> refsim.Scene:
        top = 0.623  # of the pebble above its centre [m]
        pebble = refsim.MeshBoundary(file=PEBBLE, center=(0.5, 0.5, -top - d), size=1.25, viscosity=0.1, adhesion=0.1)
        return refsim.Scene(effects=(SUMMED(sound_speed=8.0), refsim.Gravity(), pebble), **cube)

    tension, detection = refsim.JiangZhu2023(surface_tension=0.5), refsim.SurfaceDetection(each_step=True)
    return {
        "SPH with Akinci": akinci,
        "Jiang & Zhu with detection": lambda: refsim.Scene(effects=(LIQUID, tension, detection), **cube),
        "Dong": lambda: refsim.Scene(effects=(LIQUID, refsim.Dong2016(surface_tension=0.5)), **cube),
        "MPM with surface tension": mpm, "melting": melting, "mesh coupling": mesh,
    }  # fmt: skip


def spinning_cube(edge: int, effects: str = "jiang_zhu", **more: Any) -> refsim.Scene:
    """A cube of edge^3 particles with CUBES[effects], side 1 m, h = 2 d, float32; `spinning` makes it turn."""
    spacing = 1.0 / edge
    return refsim.Scene(
        dtype="float32", spacing=spacing, support_radius=2 * spacing, fluid=(refsim.Box(cells=(edge,) * 3),),
        effects=CUBES[effects], **more,
    )  # fmt: skip


def spinning(position: np.ndarray) -> np.ndarray:
    """Velocities (n, 3) [m/s] of the cube that turns about its axis along z."""
    return np.cross([0.0, 0.0, SPIN], position - 0.5)


def fixed_step(edge: int) -> float:
    """Length of a step [s]: 0.4 h/(c + v) with the greatest speed v = 1 m/s, which no corner of the cube reaches."""
    return 0.4 * (2 / edge) / (SOUND + 1.0)


def begun(plan: Plan, **state: np.ndarray) -> Plan:
    """The plan with another start: `position` or `velocity` (n, 3) of its particles."""
    return replace(plan, state=replace(plan.state, **state))


def started(edge: int, backend: str = "cuda", warm: int = 60) -> refsim.Simulation:
    """The turning cube with steps of fixed length, after `warm` steps."""
    plan = make_plan(spinning_cube(edge, step=fixed_step(edge)))
    simulation = refsim.Simulation(begun(plan, velocity=spinning(plan.state.position)), backend)
    take_steps(simulation, warm)
    return simulation


# What the plan says, and what a run does


def step_launches(plan: Plan, backend: str) -> tuple[str, ...]:
    """Operations that one step of a plan launches on a backend, in order: its passes, and what the runner adds.

    "choose_step" and "send_clock" are the runner's own on backend "cuda", where a step is one graph.
    """
    forces = [p.operation for _, p in fused(plan.passes, backend) if not p.on_demand]
    choice, clock = (("choose_step",), ("send_clock",)) if backend == "cuda" else ((), ())
    motion = [p.operation for _, p in plan.motion]
    return (*(p.operation for _, p in plan.begin), *forces, "sph.extremes", *choice, *motion, *clock)


def planned(scene: refsim.Scene, backend: str) -> dict[str, Any]:
    """Operations of a step, particles and bytes of a scene by its plan."""
    plan = make_plan(scene)
    operations, held = list(step_launches(plan, backend)), bytes_of(plan, backend)["total"]
    return {"operations": operations, "particles": plan.grid.count, "bytes": held}


def launched(simulation: refsim.Simulation) -> list[str]:
    """Operations that one step of a simulation launches, in order; it is advanced by the step.

    On backend "cuda" it is the call that the step's graph is recorded from.
    """
    simulation.timings.launches.clear()
    if simulation.backend.name == "cuda":
        stepper = simulation.stepper
        assert stepper is not None
        named, stepper.profiled = stepper.profiled, True  # what is called has its name, and is the same
        try:
            stepper.recorded.call()
        finally:
            stepper.profiled = named
    else:
        simulation.step()
    around = ("neighbours", "sorting")  # between the steps
    return [name for name, count in simulation.timings.launches.items() for _ in range(count) if name not in around]


def differences(simulation: refsim.Simulation, operations: Sequence[str]) -> list[str]:
    """Where the operations that a step launched, or the bytes of the fields, are not the plan's; one sentence each."""
    plan, faults = simulation.plan, []
    expected = list(step_launches(plan, simulation.backend.name))
    if list(operations) != expected:
        faults.append(f"a step launched {', '.join(operations)}; the plan says {', '.join(expected)}")
    held = sum(array.nbytes for array in simulation.fields.values())
    said = bytes_of(plan, simulation.backend.name)["fields"]
    if held != said:
        faults.append(f"the fields hold {held} bytes; the plan says {said}")
    return faults


def clock() -> tuple[Callable[[], Any], Callable[[Any, Any], float]]:
    """(mark, seconds between two marks) on the device; on the host in the simulator."""
    if runtime.simulated():
        return time.perf_counter, lambda a, b: b - a
    import cupy

    def mark() -> Any:
        event = cupy.cuda.Event()
        event.record()
        return event

    def between(a: Any, b: Any) -> float:
        b.synchronize()
        return 1e-3 * float(cupy.cuda.get_elapsed_time(a, b))

    return mark, between


def steps(simulation: refsim.Simulation, warm: int, count: int) -> dict[str, list[float]]:
    """Wall seconds of steps, those with a new neighbour list apart; every step waits for the device."""
    take_steps(simulation, warm)
    taken: dict[str, list[float]] = {"step": [], "step with a new list": []}
    assert simulation.search is not None
    for _ in range(count):
        built = simulation.search.log.rebuilds
        seconds = take_steps(simulation, 1)
        taken["step with a new list" if simulation.search.log.rebuilds > built else "step"].append(seconds)
    return taken


def stages(simulation: refsim.Simulation, rebuilt: float, repeats: int = 20) -> dict[str, float]:
    """Device seconds of every operation of a step, each timed alone; `rebuilt` is the share of steps with a new list.

    Fields are put back after each, so that all see the same state.
    """
    from refsim.backends import device

    mark, between = clock()
    kept = {name: np.array(simulation.backend.host(values)) for name, values in simulation.fields.items()}
    seconds: dict[str, float] = {}
    forces = [(name, call) for name, rare, call in simulation.force_calls if not rare]
    motion = [("sph.extremes", simulation.extremes_call), *simulation.motion_calls]
    for name, call in [*simulation.begin_calls, *forces, *motion]:
        repeated = device.CudaGraph(call)
        repeated()  # compiles
        repeated()  # records
        first = mark()
        for _ in range(repeats):
            repeated()
        last = mark()
        simulation.backend.synchronize()
        seconds[name] = between(first, last) / repeats
        for field, values in kept.items():
            simulation.backend.assign(simulation.fields[field], values)
    began = time.perf_counter()
    simulation.lists.invalidate()
    ready(simulation)
    simulation.backend.synchronize()
    seconds["neighbours"] = rebuilt * (time.perf_counter() - began)
    return seconds


def list_seconds(taken: dict[str, list[float]], alone: float) -> float:
    """Seconds a step for new lists: what steps with one take beyond the others; `alone` where one kind is missing."""
    plain, renewed = taken["step"], taken["step with a new list"]
    if not plain or not renewed:
        return alone
    return len(renewed) / (len(plain) + len(renewed)) * max(float(np.median(renewed) - np.median(plain)), 0.0)
