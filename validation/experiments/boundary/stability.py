"""Hard cases of meshes, of sampling, and of liquid at meshes."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from refsim import Box, Cloud, Gravity, MeshBoundary, Scene, WeaklyCompressible
from refsim.backends.arrays import choose
from refsim.boundary.mesh import SurfaceMesh, surface_mesh
from refsim.boundary.sampling import relaxed, sample
from refsim.boundary.signed_distance import signed_distance
from refsim.core.walls import WallParticles
from refsim.scene.plan import make_plan
from refsim.winding_number.reference import solid_angles
from validation.experiments.boundary.flow_shapes import SHAPES as SOLIDS
from validation.experiments.boundary.flow_shapes import SPACING, mesh_file
from validation.experiments.boundary.sampling_runs import evenness
from validation.experiments.boundary.sampling_shapes import cube, mesh_of, needle, sphere, tilted
from validation.results import Result
from validation.running import Context
from validation.trials import Trial


def _box(size: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> tuple[np.ndarray, np.ndarray]:
    import trimesh

    made = tilted(trimesh.creation.box(size))
    return np.array(made.vertices), np.array(made.faces)


def _opened() -> SurfaceMesh:
    made = sphere(3)
    return surface_mesh(made.vertices, made.faces[made.triangles_center[:, 2] < 0], "open")


def _not_manifold() -> SurfaceMesh:
    vertices, faces = _box()
    fin = np.array([[faces[0, 0], faces[0, 1], len(vertices)]])
    return surface_mesh(np.concatenate([vertices, [[3.0, 3.0, 3.0]]]), np.concatenate([faces, fin]), "fin")


def _duplicated() -> SurfaceMesh:
    vertices, faces = _box()
    return surface_mesh(vertices, np.concatenate([faces, faces[:3]]), "duplicated")


def _inside_out() -> SurfaceMesh:
    vertices, faces = _box()
    return surface_mesh(vertices, faces[:, ::-1], "inside out")


def _zero_area() -> SurfaceMesh:
    vertices, faces = _box()
    a, b, c = faces[0]
    middle, m = 0.5 * (vertices[a] + vertices[b]), len(vertices)
    new = np.array([[a, m, c], [m, b, c], [a, b, m]])
    return surface_mesh(np.concatenate([vertices, [middle]]), np.concatenate([faces[1:], new]), "flat triangle")


def _crossed() -> SurfaceMesh:
    """A box of 0.9 m^3 and one that reaches 0.125 m out of it at both ends, 0.1 m^3 in all."""
    (one, faces), (other, more) = _box((1.0, 1.0, 0.9)), _box((0.5, 0.8, 1.15))
    return surface_mesh(np.concatenate([one, other]), np.concatenate([faces, more + len(one)]), "crossed")


MESHES: dict[str, Callable[[], SurfaceMesh]] = {
    "open": _opened, "not_manifold": _not_manifold, "duplicated": _duplicated, "inside_out": _inside_out,
    "zero_area": _zero_area, "crossed": _crossed,
}  # fmt: skip


def bad_mesh(context: Context, backend: str, kind: str) -> Result:
    """A defective mesh: refused, or repaired with a note and then sampled as evenly as a sound one."""
    trial = Trial(context, backend)
    with trial.ending():
        mesh = MESHES[kind]()
        found = sample(mesh, 0.04, backend=backend)
        trial.check("repairs noted", len(mesh.notes), at_least=1)
        trial.check("volume off", abs(mesh.volume - 1), at_most=1e-9)
        _check_even(trial, found.position)
    return trial.result()


def _check_even(trial: Trial, position: np.ndarray, least: float = 0.7) -> None:
    spread = evenness(position)
    trial.check("values that are not finite", int((~np.isfinite(position)).sum()), equals=0)
    trial.check("least over mean spacing", spread["least"], at_least=least)
    trial.check("variation of the spacing", spread["variation"], at_most=0.06)


def too_coarse(context: Context, backend: str) -> Result:
    """A mesh smaller than the spacing of the grid."""
    trial = Trial(context, backend)
    with trial.ending():
        signed_distance(mesh_of(cube(), "cube"), 3.0, backend=backend)
    return trial.result()


def thin_plate(context: Context, backend: str, thickness: float) -> Result:
    """A plate thinner than the particles, tilted: the grid is made finer, and both sides get particles."""
    trial = Trial(context, backend)
    with trial.ending():
        mesh = surface_mesh(*_box((1.0, 0.8, thickness)), "plate")
        found = sample(mesh, 0.03, backend=backend)
        trial.check("count off", abs(len(found.position) - found.expected), at_most=1.0)
        trial.check("values that are not finite", int((~np.isfinite(found.position)).sum()), equals=0)
        trial.show("notes", list(found.notes))
    return trial.result()


def needle_edges(context: Context, backend: str) -> Result:
    """A cone with a tip of 7 degrees: signs at the tip and along the rim."""
    trial = Trial(context, backend)
    with trial.ending():
        made = needle()
        mesh = mesh_of(made, "needle")
        band = signed_distance(mesh, 0.02, backend=backend)
        random = np.random.default_rng(0)
        tip = np.array(made.vertices)[np.argmax(np.linalg.norm(made.vertices, axis=1))]
        place = tip + random.uniform(-0.04, 0.04, (600, 3))
        distance = band.backend.host(band.at(band.backend.asarray(place))[0])
        inside = solid_angles(place - mesh.origin, mesh.corners)[0].sum(1) > 2 * np.pi
        clear = np.abs(distance) > 0.01  # half a spacing: nearer the trilinear distance rounds the tip off
        trial.check("wrong signs", int(((distance < 0) != inside)[clear].sum()), equals=0)
        _check_even(trial, sample(mesh, 0.012, backend=backend).position, least=0.5)
    return trial.result()


def piled(context: Context, backend: str) -> Result:
    """All particles at one place at the start."""
    trial = Trial(context, backend)
    with trial.ending():
        there = choose(backend)
        band = signed_distance(mesh_of(sphere(3), "ball"), 0.1, backend=there)
        start = there.asarray(np.repeat(np.array([[0.0, 0.0, 0.99]], np.float32), 100, axis=0))
        end = there.host(relaxed(there, band.local, start, 0.1, 0, False, 200)[0])
        trial.check("least distance of two particles over r", evenness(end)["mean"] / 0.1, at_least=0.5)
        trial.check("furthest from the ball", float(np.abs(np.linalg.norm(end, axis=1) - 1).max()), at_most=0.02)
    return trial.result()


def far_away(context: Context, backend: str) -> Result:
    """A mesh 1e4 m from the origin, in float32: the same particles as beside it."""
    trial = Trial(context, backend)
    with trial.ending():
        made = sphere(3)
        near = sample(mesh_of(made, "ball"), 0.08, backend=backend)
        shift = np.array([16384.0, -8192.0, 4096.0])
        far = sample(surface_mesh(np.array(made.vertices) + shift, made.faces, "far"), 0.08, backend=backend)
        trial.check("largest difference [m]", float(np.abs(far.position - shift - near.position).max()), at_most=1e-9)
    return trial.result()


# Liquid at meshes

STEP, SOUND = 2e-4, 20.0  # [s], [m/s]
LIQUID = WeaklyCompressible(sound_speed=SOUND, dynamic_viscosity=0.5)


def shots(
    context: Context, backend: str, shape: str, spacings: float, shift: float = 0.0, begin: float = 0.045,
    steps: int = 60, thin: float = 1.0, **changes: Any,
) -> Result:  # fmt: skip
    """Lone particles that fly down on a solid at `spacings` a step from `begin` [m] over its middle; none gets in."""
    trial = Trial(context, backend)
    made = SOLIDS[shape]()
    made.apply_scale((1, 1, thin))
    x, y = np.meshgrid(np.arange(-3, 4), np.arange(-3, 4))
    at = np.stack([0.012 * x.ravel(), 0.012 * y.ravel(), np.full(x.size, begin)], axis=1)
    at[:, 2] += 0.1 * SPACING * np.arange(x.size) % SPACING
    fluid = Cloud(position=at + [0, 0, shift], velocity=(0.0, 0.0, -spacings * SPACING / STEP))
    with mesh_file(made) as file, trial.ending():
        boundary = MeshBoundary(**{"file": file, "center": (0.0, 0.0, shift), "field_spacing": 0.0025, **changes})
        scene = Scene(
            spacing=SPACING, support_radius=1.1 * SPACING, fluid=(fluid,), effects=(LIQUID, boundary), step=STEP
        )
        simulation = trial.start(scene)
        solid = boundary.placed(simulation.plan.grid)

        def watch(simulation: Any) -> None:
            depth = -solid.distance(simulation.field("position").astype(float)).min() / SPACING
            trial.check("greatest depth [d]", depth, at_most=0.2 if shift else 0.02)

        trial.advance(simulation, steps=steps, watch=watch)
        trial.check("corrections", simulation.field("corrections").sum(), at_least=1)
        if shape == "plate":
            over = np.abs(at[:, :2]).max(1) < 0.05
            lowest = float((simulation.field("position")[over, 2] - shift).min())
            trial.check("height over the plate's middle [m]", lowest, at_least=-0.003)
    return trial.result()


def coincident(context: Context, backend: str) -> Result:
    """Every boundary particle stands there twice, with half the volume each: liquid falls on them as on one."""
    trial = Trial(context, backend)
    with mesh_file(SOLIDS["plate"]()) as file, trial.ending():
        block = Box(lower=(-0.03, -0.03, 0.013), cells=(6, 6, 4))
        effects = (LIQUID, Gravity(), MeshBoundary(file=file))
        plan = make_plan(Scene(spacing=SPACING, support_radius=2.7 * SPACING, fluid=(block,), effects=effects))
        twice = WallParticles(np.repeat(plan.walls.position, 2, axis=0), 0.5 * np.repeat(plan.walls.volume, 2))
        places = []
        for walls in (plan.walls, twice):
            simulation = trial.start(dataclasses.replace(plan, walls=walls))
            trial.advance(simulation, steps=40)
            places.append(simulation.field("position"))
        trial.check("difference [d]", np.abs(places[0] - places[1]).max() / SPACING, at_most=1e-3)
    return trial.result()
