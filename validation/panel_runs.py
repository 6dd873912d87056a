"""Readings of panels by SPlisHSPlasH (DFSPH): surge front, drop that was a cube; by PySPH: tank, vortices."""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import Any

import numpy as np

from refsim.backends.arrays import choose
from refsim.boundary.signed_distance import signed_distance
from refsim.sparse_grid.reference import node_table
from refsim.study.panels import Point
from refsim.study.panels.making import GRAVITY, REYNOLDS, SHARE
from refsim.study.panels.observables import FALL, kept
from refsim.study.runs import Reading
from validation.experiments.boundary import scene as meshes
from validation.experiments.boundary.scene import SHAPES
from validation.experiments.dam_break.runs import DENSITY, HEIGHT, LID, viscosity
from validation.experiments.surface_reconstruction import scene
from validation.experiments.surface_reconstruction.runs import CELL, RADIUS
from validation.metrics.sampling import evenness, near_surface, radius_for
from validation.peers import libigl, pysph_flows, pysplashsurf, splishsplash, splishsplash_sampling
from validation.reading import reading

WALLED = 15.0  # column widths: the tank of the front
STEP = 2e-3  # s, the longest of the front, which SPlisHSPlasH shortens by the speed (CFL number 0.5)


def front_by_splishsplash(point: Point, repeat: int, threads: int | None) -> Reading:
    """Mean front over t sqrt(2g/L) from 1 to 3 by DFSPH, with the kinematic viscosity of the experiment `dam_break`."""
    width, columns = 0.5 * HEIGHT, point.setting["columns"]
    found = splishsplash.run_column(
        {
            "columns": columns, "width": width, "length": WALLED * width, "height": LID, "step": STEP,
            "viscosity": viscosity(width / columns) / DENSITY, "shake": repeat,
            "times": (FALL * np.arange(0.0, 4.625, 0.05)).tolist(),
        },
        threads or 1,
    )  # fmt: skip
    if "missing" in found:
        return reading(failed=f"missing: {found['missing']}")
    place = np.interp(np.linspace(1.0, 3.0, 41), np.array(found["time"]) / FALL, np.array(found["front"]) / width)
    return reading(float(place.mean()), found["wall"][-1], found["steps"], found["particles"])


def drop_by_splishsplash(point: Point, repeat: int, threads: int | None) -> Reading:
    """Radius variation that a drop keeps under Akinci et al. 2013, and the seconds after which it does."""
    found = splishsplash.run_drop({**point.setting["settings"], "shake": repeat}, threads or 1)
    if "missing" in found:
        return reading(failed=f"missing: {found['missing']}")
    value = kept(np.array(found["time"]), found["error"])
    above = [k for k, error in enumerate(found["error"]) if not error <= value]
    torn = "" if np.isfinite(value) else "torn: no outer surface all around"
    seconds = found["wall"][above[-1] + 1 if above else 0]
    return reading(value, seconds, found["steps"], found["particles"], torn)


def vortices_by_pysph(point: Point, repeat: int, threads: int | None) -> Reading:
    """Rate at which the speed of four vortices decays in 1 s, over 8 pi^2/Re."""
    found = pysph_flows.run("vortices", point.setting["scheme"], point.setting["cells"], [1.0])
    if "missing" in found:
        return reading(failed=f"missing: {found['missing']}")
    x, y = 2 * np.pi * found["position"][-1].T
    first = (np.sin(x) * np.cos(y)) ** 2 + (np.cos(x) * np.sin(y)) ** 2
    decay = -0.5 * np.log((found["velocity"][-1] ** 2).sum() / first.sum()) / found["time"][-1]
    return reading(float(decay * REYNOLDS / (8 * np.pi**2)), found["seconds"], found["steps"], len(x))


def tank_by_pysph(point: Point, repeat: int, threads: int | None) -> Reading:
    """Root mean square of p - rho g (H - y) over rho g H farther than h from walls and surface, in places and pressures
    of the mean of samples; the kinematic viscosity is that of refsim's liquid."""
    cells, sound = point.setting["cells"], pysph_flows.SOUND["tank"]
    reach, end = 2.6 / cells, 5.0 / np.sqrt(GRAVITY)
    times = (end * np.linspace(0.8, 1.0, 61)).tolist()
    found = pysph_flows.run("tank", point.setting["scheme"], cells, times, viscosity=0.25 * SHARE * sound * reach)
    if "missing" in found:
        return reading(failed=f"missing: {found['missing']}")
    x, y = found["position"].mean(0).T
    bulk = (np.minimum(x, 1 - x) > reach) & (np.minimum(y, 1 - y) > reach)
    off = found["pressure"].mean(0) / (1000.0 * GRAVITY) - (1 - y)
    return reading(float(np.sqrt((off[bulk] ** 2).mean())), found["seconds"], found["steps"], len(x))


PLACES = 4000


@functools.cache
def _meshed(shape: str, level: int) -> tuple[Any, Any]:
    """A shape and its mesh as refsim takes it."""
    made = SHAPES[shape](level)
    return made, meshes.mesh_of(made, shape)


def quality_by_splishsplash(point: Point, repeat: int, threads: int | None) -> Reading:
    """The same shape sampled by SPlisHSPlasH, with as many particles."""
    made, mesh = _meshed("organic", 4)
    radius = radius_for(mesh.area, point.setting["count"])
    found = splishsplash_sampling.run(made.vertices, made.faces, radius, threads)
    if "missing" in found:
        return reading(failed=f"missing: {found['missing']}")
    return reading(evenness(found["position"])["variation"], found["seconds"], particles=found["particles"])


def _off_sphere(place: np.ndarray, found: np.ndarray, seconds: float, held: int) -> Reading:
    error = found - meshes.known_distance("sphere", place)
    return reading(float(np.sqrt((error**2).mean())), seconds, particles=len(place), held=held)


def distance_by_libigl(point: Point, repeat: int, threads: int | None) -> Reading:
    """The field with libigl's distances at its nodes, trilinear between them; seconds of libigl's tree and queries."""
    made, mesh = _meshed("sphere", 6)
    place = near_surface(made, 0.04, PLACES, 0)
    own = signed_distance(mesh, point.knobs["spacing"], dtype="float64")
    nodes = own.spacing * node_table(own.blocks) + mesh.origin
    found = libigl.run(made.vertices, made.faces, nodes, threads)
    if "missing" in found:
        return reading(failed=f"missing: {found['missing']}")
    held = np.clip(found["distance"], -own.band, own.band)
    other = replace(own, field=own.field._replace(distance=held))
    seconds = found["tree"] + found["seconds_per_query"] * len(nodes)
    return _off_sphere(place, choose("cpu").host(other.at(place)[0]), seconds, held.nbytes)


def peer_normals(point: Point, repeat: int, threads: int | None) -> Reading:
    """pysplashsurf's normals on the same sphere of particles, its mesh included."""
    position, given = CELL * scene.cloud("sphere", RADIUS), point.setting
    found = pysplashsurf.run_normals(position, CELL, given["share"], given["smoothing"], threads)
    if "missing" in found:
        return reading(failed=f"missing: {found['missing']}")
    place, normal = (np.asarray(found[name], dtype=float) for name in ("place", "normal"))
    angle = scene.angles(normal, scene.true_normals(place / CELL, "sphere", RADIUS))
    return reading(float(angle.mean()), found["seconds"], particles=len(position))
