"""Scenes whose steps are timed by `tests/times`, what their plans say of a step, and what a step launches.

A ladder is a scene to which effects are added one by one; the systems are one scene of each method, at any size; the
turning cube is the scene of the device's limits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from refsim import (
    Akinci2013,
    BeckerTeschner2007,
    Box,
    BoxWalls,
    CsfWang2019,
    Dong2016,
    Gravity,
    He2014,
    HeatConduction,
    JiangZhu2023,
    Melting,
    MeshBoundary,
    MpmLiquid,
    MpmWalls,
    NormalDifference2014,
    ParticleShifting,
    Scene,
    ShapeMatching,
    Simulation,
    SolidBox,
    SurfaceDetection,
    SurfaceEnergy,
    TartakovskyMeakin2005,
    TwoWayCoupling,
    WeaklyCompressible,
)
from refsim.engine.binding import step_launches
from refsim.scene.plan import make_plan
from refsim.study.memory import bytes_of
from validation.running import take_steps

PEBBLE = str(Path(__file__).resolve().parent.parent / "refsim" / "examples" / "pebble.obj")
STEP = 2e-5  # [s], so short that the particles stay where they are and a neighbour list is built once
EDGE = 79  # particles along the edge of a system's cube: 493,039
SOUND, SPIN = 20.0, 1.0  # of the turning cube [m/s], [rad/s]
LIQUID = WeaklyCompressible(sound_speed=20.0, dynamic_viscosity=5.0, density="summation")
THIN = WeaklyCompressible(sound_speed=SOUND, dynamic_viscosity=1.0, density="summation")
COHESION = JiangZhu2023(surface_tension=0.5, pair_mode="all", area_ratio=0.0, density_correction=False)
# Effects of the turning cube by the name of a reading
CUBES: dict[str, tuple[Any, ...]] = {
    "jiang_zhu": (THIN, COHESION),
    "akinci": (THIN, Akinci2013(surface_tension=0.5)),  # cohesion and area term
    "detection": (THIN, COHESION, SurfaceDetection(each_step=True)),
    "dong": (THIN, Dong2016(surface_tension=0.5)),
    "he": (THIN, He2014(surface_tension=0.5)),
    "csf": (THIN, CsfWang2019(surface_tension=0.5)),
    "becker": (THIN, BeckerTeschner2007(surface_tension=0.5)),
    "tartakovsky": (THIN, TartakovskyMeakin2005(surface_tension=0.5)),
    "normal_difference": (THIN, NormalDifference2014(area_acceleration=0.1)),
    "continuity": (WeaklyCompressible(sound_speed=SOUND, dynamic_viscosity=1.0),),
    "shifting": (
        WeaklyCompressible(sound_speed=SOUND, dynamic_viscosity=1.0), SurfaceDetection(each_step=True),
        ParticleShifting(),
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Rung:
    """A scene of a ladder, and what it has beyond the one before."""

    words: str
    scene: Scene


@dataclass(frozen=True)
class Ladder:
    """Scenes to which effects are added one by one."""

    words: str
    rungs: tuple[Rung, ...]


def ladders(small: bool = False) -> dict[str, Ladder]:
    """All ladders; `small` ones have the same effects and tens of particles."""
    return {"sph": _sph(small), "melting": _melting(small), "mpm": _mpm(small), "mesh": _mesh(small)}


def _climb(words: str, base: Mapping[str, Any], *rungs: tuple[Any, ...]) -> Ladder:
    """A ladder of (words, effects, what else the scene has)."""
    return Ladder(words, tuple(
        Rung(said, Scene(effects=effects, step=STEP, **base, **dict(*more))) for said, effects, *more in rungs
    ))  # fmt: skip


def _sph(small: bool) -> Ladder:
    edge, d = 3 if small else 16, 0.01
    base = {"spacing": d, "support_radius": 2 * d, "fluid": (Box(cells=(edge,) * 3),), "name": "effects_sph"}
    plain = WeaklyCompressible(sound_speed=4.0, clamp_pressure=False, density="summation")
    liquid = WeaklyCompressible(sound_speed=4.0, clamp_pressure=False, dynamic_viscosity=0.5, density="summation")
    walls = BoxWalls(lower=(0.0, 0.0, 0.0), upper=(2 * edge * d, edge * d, 2 * edge * d))
    parts = (liquid, Gravity(), walls, SurfaceDetection(each_step=True), JiangZhu2023(surface_tension=0.07))
    added = (
        "viscosity", "gravity", "walls of a box", "surface detection in each step", "surface tension (Jiang & Zhu)",
    )  # fmt: skip
    rungs = ((f"+ {words}", parts[: k + 1]) for k, words in enumerate(added))
    return _climb("weakly compressible SPH, 3D", base, ("liquid", (plain,)), *rungs)


def _melting(small: bool) -> Ladder:
    wide, deep = (4, 2) if small else (16, 10)
    d, top = 0.01, wide * 0.01
    base = {
        "spacing": d, "support_radius": 2.1 * d, "fluid": (Box(cells=(wide, wide, deep)),), "name": "effects_melting",
    }  # fmt: skip
    low = (0.25 * top, 0.25 * top, deep * d)
    solid = {"solid": (SolidBox(lower=low, upper=(0.75 * top, 0.75 * top, deep * d + 0.5 * top)),)}
    walls = BoxWalls(lower=(0.0, 0.0, 0.0), upper=(top, top, 4 * top))
    fluid = (WeaklyCompressible(sound_speed=10.0, density="summation"), Gravity(), walls)
    bodies = (*fluid, ShapeMatching(), TwoWayCoupling())
    warm = HeatConduction(temperature=50.0, melting_point=0.0)
    return _climb(
        "melting solids in a tank, 3D", base, ("liquid, gravity, walls of a box", fluid),
        ("+ a solid: shape matching and coupling", bodies, solid), ("+ conduction of heat", (*bodies, warm), solid),
        ("+ melting", (*bodies, warm, Melting()), solid),
    )  # fmt: skip


def _mpm(small: bool) -> Ladder:
    edge, d = 3 if small else 64, 0.01
    base = {
        "dim": 2, "spacing": d, "support_radius": 3 * d, "fluid": (Box(cells=(edge, edge, 1)),), "name": "effects_mpm",
    }  # fmt: skip
    viscous = (MpmLiquid(bulk_modulus=1e4, dynamic_viscosity=0.1),)
    heavy = (*viscous, Gravity(acceleration=(0.0, -9.81, 0.0)))
    tense = (*heavy, SurfaceEnergy(surface_tension=0.07))
    walls = MpmWalls(lower=(-0.5, 0.0, 0.0), upper=(2.0, 2.0, 0.0))
    return _climb(
        "material points, 2D", base, ("liquid", (MpmLiquid(bulk_modulus=1e4),)), ("+ viscosity", viscous),
        ("+ gravity", heavy), ("+ surface energy", tense), ("+ walls, which mirror the surface", (*tense, walls)),
    )  # fmt: skip


def _mesh(small: bool) -> Ladder:
    edge, d = 3 if small else 14, 0.02
    middle = 0.5 * edge * d
    place: dict[str, Any] = {"file": PEBBLE, "center": (middle, middle, -1.5 * middle), "size": 2.5 * middle}
    base = {"spacing": d, "support_radius": 2 * d, "fluid": (Box(cells=(edge,) * 3),), "name": "effects_mesh"}
    fluid, kept = (WeaklyCompressible(sound_speed=8.0, density="summation"), Gravity()), {**place, "correction": "none"}
    sticky = {"viscosity": 0.1, "adhesion": 0.1}
    return _climb(
        "a mesh as boundary, 3D", base, ("liquid and gravity", fluid),
        ("+ a mesh: pressure of its particles", (*fluid, MeshBoundary(**kept))),
        ("+ friction", (*fluid, MeshBoundary(viscosity=0.1, **kept))),
        ("+ adhesion", (*fluid, MeshBoundary(**sticky, **kept))),
        ("+ correction of places", (*fluid, MeshBoundary(**sticky, **place))),
    )  # fmt: skip


def systems(edge: int = EDGE) -> dict[str, Callable[[], Scene]]:
    """A scene of each system with about edge^3 particles, float32, by the words of its page."""
    d = 1.0 / edge
    cube: dict[str, Any] = {"spacing": d, "support_radius": 2.6 * d, "fluid": (Box(cells=(edge,) * 3),)}

    def akinci() -> Scene:
        from validation.experiments.timing.runs import spinning_block

        return spinning_block(edge, 0.5)

    def melting() -> Scene:
        from validation.experiments.melting.scene import made, shared_tank

        return made(shared_tank("figure_6", 2.55 * edge / 100, 1 / 3))

    def mpm() -> Scene:
        cell = 1 / 64
        liquid = Box(lower=(0.2, 0.2, 0.2), cells=(edge,) * 3)
        effects = (MpmLiquid(rest_density=1.0, bulk_modulus=1000.0), SurfaceEnergy(surface_tension=1.0))
        return Scene(spacing=cell / 2, support_radius=1.5 * cell, step=1e-4, fluid=(liquid,), effects=effects)

    def mesh() -> Scene:
        top = 0.623  # of the pebble above its centre [m]
        pebble = MeshBoundary(file=PEBBLE, center=(0.5, 0.5, -top - d), size=1.25, viscosity=0.1, adhesion=0.1)
        return Scene(effects=(WeaklyCompressible(sound_speed=8.0, density="summation"), Gravity(), pebble), **cube)

    tension, found = JiangZhu2023(surface_tension=0.5), SurfaceDetection(each_step=True)
    return {
        "SPH with Akinci": akinci,
        "Jiang & Zhu with detection": lambda: Scene(effects=(LIQUID, tension, found), **cube),
        "Dong": lambda: Scene(effects=(LIQUID, Dong2016(surface_tension=0.5)), **cube),
        "MPM with surface tension": mpm, "melting": melting, "mesh coupling": mesh,
    }  # fmt: skip


def spinning_cube(edge: int, effects: str = "jiang_zhu", **more: Any) -> Scene:
    """A cube of edge^3 particles with CUBES[effects], side 1 m, h = 2 d, float32; `spinning` makes it turn."""
    spacing = 1.0 / edge
    return Scene(
        dtype="float32", spacing=spacing, support_radius=2 * spacing, fluid=(Box(cells=(edge,) * 3),),
        effects=CUBES[effects], **more,
    )  # fmt: skip


def spinning(position: np.ndarray) -> np.ndarray:
    """Velocities (n, 3) [m/s] of the cube that turns about its axis along z."""
    return np.cross([0.0, 0.0, SPIN], position - 0.5)


def fixed_step(edge: int) -> float:
    """Length of a step [s]: 0.4 h/(c + v) with the greatest speed v = 1 m/s, which no corner of the cube reaches."""
    return 0.4 * (2 / edge) / (SOUND + 1.0)


def started(edge: int, backend: str = "cuda", warm: int = 60) -> Simulation:
    """The turning cube with steps of fixed length, after `warm` steps."""
    plan = make_plan(spinning_cube(edge, step=fixed_step(edge)))
    plan.state.velocity[:] = spinning(plan.state.position)
    simulation = Simulation(plan, backend)
    take_steps(simulation, warm)
    return simulation


# What the plan says, and what a run does


def planned(scene: Scene, backend: str) -> dict[str, Any]:
    """Operations of a step, particles and bytes of a scene by its plan."""
    plan = make_plan(scene)
    operations, held = list(step_launches(plan, backend)), bytes_of(plan, backend)["total"]
    return {"operations": operations, "particles": plan.grid.count, "bytes": held}


def launched(simulation: Simulation) -> list[str]:
    """Operations that one step of a simulation launches, in order; it is advanced by the step.

    On backend "cuda" it is the call that the step's graph is recorded from.
    """
    simulation.timings.launches.clear()
    if simulation.backend.name == "cuda":
        stepper = simulation.stepper
        named, stepper.profiled = stepper.profiled, True  # what is called has its name, and is the same
        try:
            stepper.recorded.call()
        finally:
            stepper.profiled = named
    else:
        simulation.step()
    around = ("neighbours", "sorting")  # between the steps
    return [name for name, count in simulation.timings.launches.items() for _ in range(count) if name not in around]


@contextmanager
def counted_kernels() -> Iterator[list[str]]:
    """Names of the CUDA kernels that are launched meanwhile."""
    from refsim.backends.compile import CudaKernel

    names: list[str] = []
    launch: Callable[..., None] = CudaKernel.__call__

    def counting(self: Any, *arguments: Any) -> None:
        names.append(self.__name__)
        launch(self, *arguments)

    CudaKernel.__call__ = counting  # type: ignore[method-assign]
    try:
        yield names
    finally:
        CudaKernel.__call__ = launch  # type: ignore[method-assign]


def differences(simulation: Simulation, operations: Sequence[str]) -> list[str]:
    """Where the operations that a step launched, or the bytes of the fields, are not the plan's; one sentence each."""
    plan, found = simulation.plan, []
    expected = list(step_launches(plan, simulation.backend.name))
    if list(operations) != expected:
        found.append(f"a step launched {', '.join(operations)}; the plan says {', '.join(expected)}")
    held = sum(array.nbytes for array in simulation.fields.values())
    said = bytes_of(plan, simulation.backend.name)["fields"]
    if held != said:
        found.append(f"the fields hold {held} bytes; the plan says {said}")
    return found


def neighbourhood(simulation: Simulation) -> tuple[int, float, float]:
    """(particles, mean neighbours within h of sampled particles, mean entries of the list) on backend "cuda"."""
    from refsim.backends import device

    n, h, listed = simulation.count, simulation.plan.grid.support_radius, simulation._shared["neighbours"]
    counts = simulation.backend.host(listed.count)
    rows = np.random.default_rng(0).choice(n, min(n, 2000), replace=False)
    position = simulation.backend.host(simulation.fields["position"]).astype(float)
    sampled = device.seen(listed.entries).reshape(-1, n)[:, device.library().asarray(rows)]
    entries = np.asarray(sampled.get() if hasattr(sampled, "get") else sampled)
    within = 0
    for column, i in enumerate(rows):
        away = position[entries[: counts[i], column]] - position[i]
        within += int(((away**2).sum(1) < h * h).sum())
    return n, within / len(rows), float(counts.mean())
