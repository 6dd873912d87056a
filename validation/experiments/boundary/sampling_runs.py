"""Runs of boundary sampling: scorecards, the distance's error and order, and other programs on the same work."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from refsim.backends.arrays import choose, set_threads
from refsim.boundary.mesh import load_mesh
from refsim.boundary.sampling import HEXAGONAL, sample
from refsim.boundary.signed_distance import signed_distance
from refsim.sparse_grid.reference import node_table
from validation.experiments.boundary.sampling_shapes import SHAPES, known_distance, mesh_of
from validation.peers import libigl, splishsplash_sampling
from validation.reading import Reading, distribution, measured
from validation.results import Result
from validation.running import Context
from validation.turns import rounds

DARTS = 30  # places for each particle at which holes are sought
EXACT_QUERIES = 1000
FORCES = 2000  # places at which the wall's force is evaluated
SMOOTH_PART = 0.75  # cosine of the angle between normals near each other beyond which a place counts as at an edge
HOLE = 1.0  # distance from every particle, in mean spacings, at which another one would fit


def radius_for(area: float, count: int) -> float:
    """r [m] for which g A/(pi r^2) is `count`."""
    return math.sqrt(HEXAGONAL * area / (math.pi * count))


def evenness(position: np.ndarray) -> dict[str, float]:
    """Distances to the nearest other particle: mean [m], least over mean, coefficient of variation."""
    nearest = cKDTree(position).query(position, k=2)[0][:, 1]
    mean = float(nearest.mean())
    return {"mean": mean, "least": float(nearest.min()) / mean, "variation": float(nearest.std()) / mean}


def holes(position: np.ndarray, darts: np.ndarray, size: float) -> int:
    """Places of `darts` (m, 3) further than `size` [m] from every particle, of two nearer than that one only."""
    distance = cKDTree(position).query(darts)[0]
    left = darts[distance > size][np.argsort(-distance[distance > size])]
    count = 0
    while len(left):
        count += 1
        left = left[np.linalg.norm(left - left[0], axis=1) > size]
    return count


def wall_force_noise(
    position: np.ndarray, normal: np.ndarray, place: np.ndarray, out: np.ndarray, apart: float
) -> float:
    """Unevenness of the wall's force on a resting layer of liquid: rms of what varies and of what is tangential, over
    its mean.

    place, out  (m, 3) places [m] on the surface, and the normals there
    apart       2 r [m], of the particles and of the layer from the wall

    The force for one pressure is -sum_b V_b grad W, V_b = 1/sum_k W_bk (patent P5, P6), by Wendland's kernel of support
    2.7 spacings; it varies from its mean within 3 spacings. Places at edges do not count: the force is no normal one
    there. nan where there are no others.
    """
    h = 2.7 * apart
    tree = cKDTree(position)

    def value(r: np.ndarray) -> np.ndarray:
        q = r / h
        return (1 - q) ** 4 * (4 * q + 1)

    def slope(r: np.ndarray) -> np.ndarray:
        q = r / h
        return -20 * q * (1 - q) ** 3 / h

    near = tree.query_ball_point(position, h)
    volume = np.array([1 / value(np.linalg.norm(position[k] - x, axis=1)).sum() for x, k in zip(position, near)])
    forces, there = [], []
    for x, n in zip(place + apart * out, out):
        k = tree.query_ball_point(x, h)
        if len(k) and (normal[k] @ n).min() > SMOOTH_PART:
            away = x - position[k]
            r = np.linalg.norm(away, axis=1)
            force = -(volume[k] * slope(r) / r) @ away
            forces.append((force @ n, np.linalg.norm(force - (force @ n) * n)))
            there.append(x)
    if not forces:
        return math.nan
    along, across = np.array(forces).T
    around = cKDTree(there).query_ball_point(there, 3 * apart)
    varies = along - np.array([along[k].mean() for k in around])  # the solid's curvature changes it more slowly
    return float(np.sqrt((varies**2 + across**2).mean()) / along.mean())


def score(position: np.ndarray, normal: np.ndarray, made: Any, radius: float, seed: int = 0) -> dict[str, float]:
    """How good a sampling of the trimesh mesh `made` is."""
    import trimesh

    spread = blueness(position, made.area)
    darts, face = trimesh.sample.sample_surface(made, DARTS * len(position), seed=seed)
    rows = np.random.default_rng(seed).choice(len(position), min(EXACT_QUERIES, len(position)), replace=False)
    off = trimesh.proximity.closest_point(made, position[rows])[1]
    expected = HEXAGONAL * made.area / (math.pi * radius**2)
    return {
        "particles": len(position), "expected": expected, "count_error": abs(len(position) - expected) / expected,
        **spread, "mean_over_2r": spread["mean"] / (2 * radius), "off": float(off.max()) / radius,
        "holes": holes(position, darts, HOLE * spread["mean"]),
        "force_noise": wall_force_noise(
            position, normal, darts[:FORCES], np.asarray(made.face_normals)[face[:FORCES]], 2 * radius
        ),
    }  # fmt: skip


def scorecard(context: Context, shape: str, count: int, backend: str, threads: int | None, seed: int = 0) -> Result:
    """Particles on one shape: how even they are, and what it took."""
    there = choose(backend)
    made = SHAPES[shape]()
    mesh = mesh_of(made, shape)
    radius = radius_for(mesh.area, count)
    set_threads(there, threads)
    try:
        sample(mesh, 2 * radius, backend=there, seed=seed)  # compiles
        began = time.perf_counter()
        found = sample(mesh, radius, backend=there, seed=seed)
        seconds = time.perf_counter() - began
    finally:
        set_threads(there, None)
    context.progress(0.6)
    values = score(found.position, found.normal, made, radius)
    values |= {
        "shape": shape, "radius": radius, "iterations": found.iterations, "converged": found.converged,
        "seconds": seconds, "triangles": len(mesh.faces), "notes": list(found.notes),
    }  # fmt: skip
    return Result(values, {"position": found.position, "normal": found.normal, "residuals": found.residuals})


def printed(context: Context, shape: str, count: int, backend: str, iterations: int) -> Result:
    """The adopted rule beside the printed one (patent E24): displacements over the iterations."""
    made = SHAPES[shape]()
    mesh = mesh_of(made, shape)
    radius = radius_for(mesh.area, count)
    rows: dict[str, Any] = {}
    arrays = {}
    for name, literal in (("adopted", ()), ("printed", ("E24",))):
        found = sample(mesh, radius, backend=backend, literal=literal, most_iterations=iterations)
        rows[name] = {
            "iterations": found.iterations, "converged": found.converged, "residual": found.residual,
            **evenness(found.position),
        }  # fmt: skip
        arrays[name] = found.residuals
        context.progress(0.5 * len(rows))
    return Result({"rows": rows}, arrays)


def near_surface(made: Any, spacing: float, count: int, seed: int) -> np.ndarray:
    """Places (count, 3) within a spacing of the surface."""
    import trimesh

    place, _ = trimesh.sample.sample_surface(made, count, seed=seed)
    return place + np.random.default_rng(seed).uniform(-0.5, 0.5, place.shape) * spacing


def distance_errors(
    context: Context, shape: str, spacings: list[float], level: int, backend: str, dtype: str = "float64"
) -> Result:
    """Error of the trilinear distance near the surface, against the closed form or the exact closest triangle."""
    import trimesh

    made = SHAPES[shape](level)
    mesh = mesh_of(made, shape)
    there = choose(backend)
    rows = []
    for k, spacing in enumerate(spacings):
        analytic = shape in ("sphere", "torus", "cube")
        place = near_surface(made, spacing, 4000 if analytic else EXACT_QUERIES, k)
        if analytic:
            known = known_distance(shape, place)
        else:
            known = -trimesh.proximity.signed_distance(made, place)
        band = signed_distance(mesh, spacing, backend=there, dtype=dtype)
        distance, _ = band.at(there.asarray(place.astype(dtype)))
        error = np.abs(there.host(distance) - known)
        clear = np.abs(known) > 2 * error.max()
        rows.append(
            {
                "spacing": spacing, "rms": float(np.sqrt((error**2).mean())), "largest": float(error.max()),
                "largest_in_spacings": float(error.max()) / spacing, "bytes": band.nbytes,
                "wrong_signs": int((np.sign(there.host(distance)) != np.sign(known))[clear].sum()),
                "triangles": len(mesh.faces),
            }
        )  # fmt: skip
        context.progress((k + 1) / len(spacings))
    return Result({"shape": shape, "rows": rows})


def exact_nodes(context: Context, shape: str, spacing: float, level: int, backend: str) -> Result:
    """Node values against the exact closest triangle of trimesh, and signs against the winding number, in float32."""
    import trimesh

    from refsim.sparse_grid.reference import node_table
    from refsim.winding_number.reference import solid_angles

    made = SHAPES[shape](level)
    mesh = mesh_of(made, shape)
    there = choose(backend)
    band = signed_distance(mesh, spacing, backend=there)
    field = type(band.field)(*(there.host(p) if hasattr(p, "shape") and p.shape else p for p in band.field))
    inside = np.flatnonzero(field.closest >= 0)
    rows = np.random.default_rng(1).choice(inside, min(EXACT_QUERIES, len(inside)), replace=False)
    place = band.spacing * node_table(field)[rows]
    distance = trimesh.proximity.closest_point(made, place + mesh.origin)[1]
    found = field.distance[rows]
    clear = distance > 1e-5
    signs = np.concatenate([solid_angles(p[None], mesh.corners)[0].sum(1) for p in place[clear]]) > 2 * np.pi
    context.progress(1.0)
    return Result(
        {
            "shape": shape, "nodes": len(rows), "error": float(np.abs(np.abs(found) - distance).max()) / spacing,
            "wrong_signs": int(np.count_nonzero((found[clear] < 0) != signs)),
        }
    )  # fmt: skip


def marked_region(context: Context, count: int, repeats: int, threads: int | None) -> Result:
    """Cost of asking the field where particles are, when few and when all of them are near the boundary.

    A particle outside the marked blocks is answered by one search in the table of keys; testing every particle means
    the distance from the mesh, here by an exact query for a few of them.
    """
    import trimesh

    there = choose("cpu")
    made = SHAPES["organic"](5)
    mesh = mesh_of(made, "organic")
    band = signed_distance(mesh, 0.02)
    random = np.random.default_rng(0)
    far = random.uniform(2.0, 4.0, (count, 3)).astype(np.float32)
    near = near_surface(made, 0.04, count, 1).astype(np.float32)
    rows = {}
    set_threads(there, threads)
    try:
        for name, place in (("far", far), ("near", near)):
            band.at(place)
            spent = []
            for _ in range(repeats):
                began = time.perf_counter()
                band.at(place)
                spent.append(time.perf_counter() - began)
            rows[name] = 1e9 * float(np.median(spent)) / count
    finally:
        set_threads(there, None)
    few = near[:200].astype(float)
    trimesh.proximity.closest_point(made, few)
    began = time.perf_counter()
    trimesh.proximity.closest_point(made, few)
    rows["every"] = 1e9 * (time.perf_counter() - began) / len(few)
    context.progress(1.0)
    return Result({"nanoseconds": rows, "particles": count, "triangles": len(mesh.faces), "threads": threads})


def against_peers(context: Context, level: int, count: int, threads: int, rounds: int, scale: float) -> Result:
    """A mesh to particles, beside pySPlisHSPlasH's surface sampling, and a field's nodes, beside libigl, in turn.

    scale  of the other program's disks, so that it makes as many particles

    refsim's sampling is timed twice: to its end, and stopped as soon as it is as even as the other program's.
    """
    there = choose("cpu")
    made = SHAPES["organic"](level)
    mesh = mesh_of(made, "organic")
    radius = radius_for(mesh.area, count)
    values: dict[str, Any] = {"triangles": len(mesh.faces), "radius": radius, "threads": threads}
    set_threads(there, threads)
    own: dict[str, list[float]] = {"sampling": [], "as_even": [], "field": []}
    other: dict[str, list[float]] = {"sampling": [], "field": []}
    peer: dict[str, Any] = {}
    nodes: dict[str, Any] = {}
    few: dict[str, Any] = {}
    folder = TemporaryDirectory()
    file = Path(folder.name) / "mesh.obj"
    made.export(file)
    try:
        sample(mesh, 4 * radius)
        for k in range(rounds):
            began = time.perf_counter()
            band = signed_distance(mesh, radius)
            nodes_there = band.field.distance.shape[0]
            own["field"].append((time.perf_counter() - began) / nodes_there)
            del band
            began = time.perf_counter()
            found = sample(load_mesh(file), radius)  # the other program reads the file, too
            own["sampling"].append(time.perf_counter() - began)
            context.progress((3 * k + 1) / (3 * rounds))
            peer = splishsplash_sampling.run(made.vertices, made.faces, radius, threads, scale)
            if "missing" not in peer:
                other["sampling"].append(peer["seconds"])
                spread = blueness(peer.pop("position"), mesh.area)
                if not few:
                    few = as_even_as(spread, mesh, radius)
                began = time.perf_counter()
                sample(load_mesh(file), radius, most_iterations=few["iterations"])
                own["as_even"].append(time.perf_counter() - began)
            context.progress((3 * k + 2) / (3 * rounds))
            nodes = libigl.run(made.vertices, made.faces, near_surface(made, 2 * radius, 20_000, k), threads)
            if "missing" not in nodes:
                other["field"].append(nodes["seconds_per_query"])
            context.progress((k + 1) / rounds)
    finally:
        set_threads(there, None)
    folder.cleanup()
    values |= {"particles": len(found.position), "nodes": nodes_there, "own": own, "other": other}
    values["quality"] = blueness(found.position, mesh.area)
    values["iterations"] = found.iterations
    values["missing"] = {"sampling": peer.get("missing", ""), "field": nodes.get("missing", "")}
    if "missing" not in peer:
        values["peer_quality"], values["as_even"] = spread, few
        values["peer_particles"] = peer["particles"]
        values["sampling_ratio"] = float(np.median(other["sampling"]) / np.median(own["sampling"]))
        values["as_even_ratio"] = float(np.median(other["sampling"]) / np.median(own["as_even"]))
    if "missing" not in nodes:
        values["field_ratio"] = float(np.median(other["field"]) / np.median(own["field"]))
    return Result(values)


def blueness(position: np.ndarray, area: float) -> dict[str, float]:
    """`evenness`, and the least distance over that of the densest packing of as many particles (blue-noise ratio)."""
    spread = evenness(position)
    hexagonal = math.sqrt(2 * area / (math.sqrt(3) * len(position)))
    return {**spread, "blue": spread["least"] * spread["mean"] / hexagonal}


class _AsEven(Exception):
    """The relaxation has come as far as was asked."""


def as_even_as(wanted: dict[str, float], mesh: Any, radius: float) -> dict[str, Any]:
    """After how many iterations the particles are as even as `wanted`, in variation and blue-noise ratio."""
    reached: dict[str, Any] = {}

    def look(iteration: int, position: Any) -> None:
        spread = blueness(np.asarray(position, dtype=float), mesh.area)
        reached.update(iterations=iteration, **spread)
        if spread["variation"] <= wanted["variation"] and spread["blue"] >= wanted["blue"]:
            raise _AsEven

    with suppress(_AsEven):
        sample(mesh, radius, watch=look)
    return reached


# What accuracy costs

PLACES = 4000


def quality(
    context: Context, settings: Mapping[str, Mapping[str, Any]], backend: str, threads: int | None, repeats: int
) -> Result:
    """Coefficient of variation of the spacing on the organic shape, and seconds, for each number of iterations."""
    there = choose(backend)
    set_threads(there, threads)
    mesh = mesh_of(SHAPES["organic"](4), "organic")
    radius = {key: radius_for(mesh.area, setting["count"]) for key, setting in settings.items()}
    made: dict[str, Any] = {}

    def sampled(key: str, k: int) -> float:
        setting = settings[key]
        began = time.perf_counter()
        made[key] = sample(
            mesh, radius[key], most_iterations=setting["iterations"], backend=there, dtype=setting["knobs"]["dtype"]
        )
        return time.perf_counter() - began

    readings = []
    try:
        first = {key: sampled(key, 0) for key in settings}
        spent = rounds(context, settings, sampled, float, repeats)
        for key, setting in settings.items():
            found, seconds = made[key], spent[key].means(float)
            nearest = cKDTree(found.position).query(found.position, k=2)[0][:, 1]
            error = evenness(found.position)["variation"]
            readings.append(
                Reading(
                    key, setting["words"], {**setting["knobs"], "iterations": found.iterations}, error=error,
                    value=error, seconds=seconds, per_step=[s / max(found.iterations, 1) for s in seconds],
                    parts={"sampling": seconds}, compile=first[key],
                    distribution={"distance to the nearest / mean - 1": distribution(nearest / nearest.mean() - 1)},
                    particles=len(found.position), steps=found.iterations, noise=spent[key].noise,
                )
            )  # fmt: skip
    finally:
        set_threads(there, None)
    return measured(readings, threads, backend)


def quality_by_splishsplash(
    context: Context, settings: Mapping[str, Mapping[str, Any]], threads: int, repeats: int
) -> Result:
    """The same shape sampled by SPlisHSPlasH, with as many particles ("count"), as readings like the others."""
    made = SHAPES["organic"](4)
    area = mesh_of(made, "organic").area
    last: dict[str, dict[str, Any]] = {}

    def sampled(key: str, k: int) -> float:
        radius = radius_for(area, settings[key]["count"])
        last[key] = splishsplash_sampling.run(made.vertices, made.faces, radius, threads)
        return float(last[key].get("seconds", 0.0))

    spent = rounds(context, settings, sampled, float, repeats)
    readings = []
    for key, setting in settings.items():
        common = {"key": key, "words": setting["words"], "knobs": setting["knobs"], "expected": True}
        if "missing" in last[key]:
            readings.append(Reading(**common, stopped=f"missing: {last[key]['missing']}"))
            continue
        error, seconds = evenness(last[key]["position"])["variation"], spent[key].means(float)
        readings.append(
            Reading(
                **common, error=error, value=error, seconds=seconds, per_step=seconds, parts={"sampling": seconds},
                particles=last[key]["particles"], noise=spent[key].noise,
            )
        )  # fmt: skip
    return measured(readings, threads, "peer")


def distance(
    context: Context, settings: Mapping[str, Mapping[str, Any]], backend: str, threads: int | None, repeats: int
) -> Result:
    """Root mean square error of the trilinear distance from a ball near its surface, seconds and bytes."""
    there = choose(backend)
    set_threads(there, threads)
    made = SHAPES["sphere"](6)
    mesh = mesh_of(made, "sphere")
    place = near_surface(made, 0.04, PLACES, 0)
    known = known_distance("sphere", place)
    bands: dict[str, Any] = {}

    def banded(key: str, k: int) -> float:
        knobs = settings[key]["knobs"]
        began = time.perf_counter()
        bands[key] = signed_distance(mesh, knobs["spacing"], backend=there, dtype=knobs["dtype"])
        there.synchronize()
        return time.perf_counter() - began

    readings = []
    try:
        first = {key: banded(key, 0) for key in settings}
        spent = rounds(context, settings, banded, float, repeats)
        for key, setting in settings.items():
            band, seconds = bands[key], spent[key].means(float)
            points = there.asarray(place.astype(setting["knobs"]["dtype"]))
            error = there.host(band.at(points)[0]).astype(float) - known
            rms = float(np.sqrt((error**2).mean()))
            knobs = {**setting["knobs"], "bytes": band.nbytes}
            readings.append(
                Reading(
                    key, f"{setting['words']}, {band.nbytes / 2**20:.2f} MiB", knobs, error=rms, value=rms,
                    seconds=seconds, per_step=seconds, parts={"field": seconds}, compile=first[key],
                    distribution={"error [m]": distribution(error)}, particles=PLACES, bytes=band.nbytes // PLACES,
                    noise=spent[key].noise,
                )
            )  # fmt: skip
    finally:
        set_threads(there, None)
    return measured(readings, threads, backend)


def distance_by_libigl(
    context: Context, settings: Mapping[str, Mapping[str, Any]], threads: int, repeats: int
) -> Result:
    """The field with libigl's distances at its nodes, trilinear between them; seconds of libigl's tree and queries."""
    there = choose("cpu")
    made = SHAPES["sphere"](6)
    mesh = mesh_of(made, "sphere")
    place = near_surface(made, 0.04, PLACES, 0)
    known = known_distance("sphere", place)
    bands = {key: signed_distance(mesh, s["knobs"]["spacing"], dtype="float64") for key, s in settings.items()}
    nodes = {key: band.spacing * node_table(band.blocks) + mesh.origin for key, band in bands.items()}
    found: dict[str, dict[str, Any]] = {}

    def queried(key: str, k: int) -> float:
        found[key] = libigl.run(made.vertices, made.faces, nodes[key], threads)
        missing = found[key].get("missing", "")
        return 0.0 if missing else found[key]["tree"] + found[key]["seconds_per_query"] * len(nodes[key])

    spent = rounds(context, settings, queried, float, repeats)
    readings = []
    for key, setting in settings.items():
        common = {"key": key, "words": setting["words"], "knobs": setting["knobs"], "expected": True}
        if "missing" in found[key]:
            readings.append(Reading(**common, stopped=f"missing: {found[key]['missing']}"))
            continue
        seconds = spent[key].means(float)
        own = bands[key]
        distance = np.clip(found[key]["distance"], -own.band, own.band)
        other = replace(own, field=own.field._replace(distance=distance))
        error = there.host(other.at(place)[0]) - known
        rms = float(np.sqrt((error**2).mean()))
        readings.append(
            Reading(
                **common, error=rms, value=rms, seconds=seconds, per_step=seconds, parts={"field": seconds},
                distribution={"error [m]": distribution(error)}, particles=PLACES, bytes=distance.nbytes // PLACES,
                noise=spent[key].noise,
            )
        )  # fmt: skip
    return measured(readings, threads, "peer")
