"""Hard cases of meshes and sampling."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from refsim.backends.arrays import choose
from refsim.boundary.mesh import SurfaceMesh, surface_mesh
from refsim.boundary.sampling import relaxed, sample
from refsim.boundary.signed_distance import signed_distance
from refsim.boundary.signed_distance.cases import crossed
from validation.experiments.boundary.sampling_runs import evenness
from validation.experiments.boundary.sampling_shapes import cube, mesh_of, needle, sphere, tilted
from validation.results import Result
from validation.running import Context
from validation.trials import HardCase, Trial


def _box(size: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> tuple[np.ndarray, np.ndarray]:
    import trimesh

    made = tilted(trimesh.creation.box(size))
    return np.array(made.vertices), np.array(made.faces)


def _opened() -> SurfaceMesh:
    made = sphere(3)
    return surface_mesh(made.vertices, made.faces[40:], "open")


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
    made = crossed()
    return surface_mesh(made.vertices, made.faces, "crossed")


MESHES: dict[str, Callable[[], SurfaceMesh]] = {
    "open": _opened, "not_manifold": _not_manifold, "duplicated": _duplicated, "inside_out": _inside_out,
    "zero_area": _zero_area, "crossed": _crossed,
}  # fmt: skip


def bad_mesh(context: Context, backend: str, kind: str) -> Result:
    """A mesh with something the matter: repaired, with a note, and then as good as new, or refused."""
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
    from refsim.boundary.mesh import winding

    trial = Trial(context, backend)
    with trial.ending():
        made = needle()
        mesh = mesh_of(made, "needle")
        band = signed_distance(mesh, 0.02, backend=backend)
        random = np.random.default_rng(0)
        tip = np.array(made.vertices)[np.argmax(np.linalg.norm(made.vertices, axis=1))]
        place = tip + random.uniform(-0.04, 0.04, (600, 3))
        distance = band.backend.host(band.at(band.backend.asarray(place))[0])
        inside = np.array([winding(p - mesh.origin, mesh.corners) > 0.5 for p in place])
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


_SAYS = {
    "open": "refused in one sentence", "not_manifold": "refused in one sentence",
    "duplicated": "repaired with a note, then even", "inside_out": "repaired with a note, then even",
    "zero_area": "repaired with a note, then even", "crossed": "refused in one sentence",
}  # fmt: skip


def hard_cases() -> tuple[HardCase, ...]:
    """All of this half."""
    made: list[HardCase] = [
        HardCase(f"mesh_{kind}", f"a mesh: {kind.replace('_', ' ')}", _SAYS[kind], bad_mesh, {"kind": kind}, True, 2.0)
        for kind in MESHES
    ]
    rest: tuple[tuple[str, str, str, Callable[..., Result], dict[str, Any]], ...] = (
        ("mesh_too_small", "a mesh smaller than the spacing", "refused in one sentence", too_coarse, {}),
        ("mesh_thin_plate", "a plate thinner than a radius", "all particles, on a finer grid", thin_plate,
         {"thickness": 0.012}),
        ("mesh_sheet", "a plate of a tenth of a millimetre", "refused in one sentence", thin_plate,
         {"thickness": 1e-4}),
        ("mesh_needle", "the tip of a needle", "right signs", needle_edges, {}),
        ("sampling_piled", "coincident boundary particles", "they part, on the surface", piled, {}),
        ("mesh_far_away", "a mesh 1e4 m away in float32", "the same particles", far_away, {}),
    )  # fmt: skip
    made += [HardCase(name, hard, holds, function, more, True, 3.0) for name, hard, holds, function, more in rest]
    return tuple(made)
