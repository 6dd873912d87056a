"""Boundary particles on a triangle mesh, evenly spread (patent CN104318598A, claim 2: patent P2 to P4, E24, E25).

The surface is the zero level of the signed distance. g A/(pi r^2) particles are placed on it at random, repel each
other along it and are projected back onto it until they hardly move. Finally they are projected onto the mesh itself.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from refsim.backends.arrays import Backend, choose
from refsim.boundary.signed_distance import LEAST_BAND, DistanceField, NarrowBand, signed_distance
from refsim.core.checked import Printed, plainly
from refsim.core.effect import Field, literal_errata
from refsim.core.errors import InputError
from refsim.core.operation import REGISTRY
from refsim.isosurface import Contour, edges_and_facets
from refsim.neighbours import NeighbourSearch
from refsim.scene.solids import countable
from refsim.scene.surface_mesh import SurfaceMesh
from refsim.sparse_grid import Blocks

HEXAGONAL = math.pi / (2 * math.sqrt(3))  # g of the densest packing, at the spacing 2 r
LITERAL = ("E24", "E25")
WIDTH = 0.8  # sigma, in r
STEP = 2.0  # lambda
LONGEST_STEP = 0.5  # of a tangential move, in r
DECAY = 0.95  # of lambda in each iteration
CUTOFF = 3.0  # of Omega, in sigma
THRESHOLD = 2e-3  # of the sum of all steps' lengths, in r N
MOST_ITERATIONS = 1000
SKIN = 0.5  # of the neighbour list, in cut-offs
GRIDS = (1.5, 1.0, 0.5, 0.25, 0.125)  # spacings of the grid, in r; the first that resolves all parts is taken
AREA_KEPT = 0.05  # fraction of the mesh's area that the isosurface may lack
ROUNDED = 0.2  # trilinear distance, in spacings of the grid, above which a corner of the mesh may be cut off
CUT_OFF = 1.8  # distance of such a corner from the isosurface, in r, at which another particle would fit

RELAXED_POSITION = Field("relaxed_position", "m", "position of a boundary particle after a step of the relaxation", 3)
STEP_LENGTH = Field("step_length", "m", "length of a boundary particle's step in the relaxation")


class Relaxation(NamedTuple):
    """A step of the relaxation as the kernels take it."""

    inverse_width: float  # 1/(2 sigma^2) [1/m^2]
    cutoff_squared: float  # (3 sigma)^2 [m^2]
    step: float  # lambda_k r [m]
    longest: float  # r/2 [m]
    tangential: Any  # int32, 1 to project v_t on the tangent plane, 0 as printed (patent E24)
    seed: Any  # int64, of the directions of coincident particles


@dataclass(frozen=True)
class BoundarySample:
    """Boundary particles on a mesh."""

    position: np.ndarray  # (n, 3) float64 [m] in the scene, on the mesh
    normal: np.ndarray  # (n, 3) unit outward normals
    radius: float  # r [m]; neighbours are about 2 r apart
    expected: float  # g A/(pi r^2) for the mesh's area
    iterations: int  # of the relaxation
    converged: bool  # whether the patent's threshold was met
    residuals: np.ndarray  # sum of the steps' lengths over r N in each iteration
    field: NarrowBand  # the narrow band on which they were spread
    notes: tuple[str, ...] = ()  # warnings for the user, one sentence each

    @property
    def residual(self) -> float:
        """Sum of the steps' lengths over r N in the last iteration."""
        return float(self.residuals[-1]) if len(self.residuals) else 0.0


@plainly
def sample(
    mesh: SurfaceMesh, radius: float, *, seed: int = 0, backend: str | Backend = "cpu", dtype: str = "float32",
    literal: Printed = (), most_iterations: int = MOST_ITERATIONS,
) -> BoundarySample:  # fmt: skip
    """Boundary particles of radius r = `radius` [m] on a mesh, as dense as a hexagonal packing, 2 r apart.

    The grid of the signed distance has a spacing of 1.5 r, or finer if parts of the mesh are too thin or too sharp.

    seed             of the initial positions; the same seed gives the same particles on any number of threads
    literal          readings of the patent, its own choices: E24 (repulsion not projected, constant step), E25
                     (particles counted for each triangle separately); or "paper" or "all", which are the same
    most_iterations  limit of the relaxation; a note says if it ends unconverged

    Raises InputError for backend "numpy", for a radius that is not positive or larger than half the mesh, and where
    `signed_distance` does.
    """
    backend = choose(backend) if isinstance(backend, str) else backend
    if backend.name == "numpy":
        raise InputError("sampling: backend 'numpy' has no neighbour list; choose cpu or cuda.")
    printed = literal_errata("sampling", literal, LITERAL, LITERAL, "patent")
    size = float(mesh.extent.max())
    if not (np.isfinite(radius) and radius > 0):
        raise InputError(f"sampling: radius = {radius} is not possible; give a positive number.")
    if radius > 0.5 * size:
        raise InputError(
            f"sampling: radius = {radius:g} m is larger than the mesh {mesh.source!r}, which is {size:.4g} m across;"
            " give a smaller radius."
        )
    expected = HEXAGONAL * mesh.area / (math.pi * radius**2)
    countable(f"sampling: radius = {radius:g} m", [expected], kind="particles", advice="give a larger radius")
    notes: list[str] = []
    band, corner, facets, area = _surface(mesh, radius, backend, dtype, notes)
    whole = mesh.area / float(area.sum(dtype=float))  # marching cubes cuts a little off at edges
    last = facet_counts(area, HEXAGONAL * whole, radius, "E25" in printed)
    position = placed(backend, corner, facets, last, seed)
    if position.shape[0] == 0:
        raise InputError(
            f"sampling: radius = {radius:g} m leaves no particle on {mesh.source!r}; give a smaller radius"
            + (" or remove E25 from literal." if "E25" in printed else ".")
        )
    position, residuals, converged = relaxed(
        backend, band.local.field, position, radius, seed, "E24" in printed, most_iterations
    )
    if not converged:
        notes.append(
            f"not converged: the particles still move by {residuals[-1]:.2g} r in a step after {len(residuals)}"
            " iterations"
            if len(residuals)
            else "the particles were not relaxed"
        )
    place, normal = band.local.project(position)
    return BoundarySample(
        backend.host(place).astype(float) + mesh.origin, backend.host(normal).astype(float), radius, expected,
        len(residuals), converged, np.array(residuals), band, tuple(notes),
    )  # fmt: skip


def _surface(
    mesh: SurfaceMesh, radius: float, backend: Backend, dtype: str, notes: list[str]
) -> tuple[NarrowBand, Any, Any, np.ndarray]:
    """(band, vertices, facets, areas) of the isosurface, on a grid that resolves all parts of the mesh."""
    for attempt, share in enumerate(GRIDS):
        h = min(share * radius, 0.25 * float(mesh.extent.max()))
        band = signed_distance(mesh, h, LEAST_BAND * h, backend, dtype)
        corner, facets, area = isosurface(band)
        lacking = 1 - float(np.sum(area, dtype=float)) / mesh.area
        if abs(lacking) > AREA_KEPT:
            continue
        cut = _corners_cut_off(band, backend.host(corner), radius)
        if cut and attempt < len(GRIDS) - 1:
            continue
        if attempt:
            notes.append(
                f"the grid's spacing was made {GRIDS[0] / GRIDS[attempt]:g} times finer, for thin or sharp parts"
            )
        if cut:
            notes.append(f"{cut} corners of the mesh are sharper than the grid resolves: particles may not reach them")
        return band, corner, facets, area
    raise InputError(
        f"sampling: {mesh.source!r} has parts thinner than the grid of the signed distance, whose isosurface lacks"
        f" {100 * lacking:.0f} % of the mesh's area at a spacing of {h:.4g} m; give a smaller radius."
    )


def _corners_cut_off(band: NarrowBand, corner: np.ndarray, radius: float) -> int:
    """Number of vertices of the mesh farther than CUT_OFF r from the isosurface."""
    backend, vertices = band.backend, band.mesh.vertices.astype(band.field.distance.dtype)
    distance, _ = band.local.at(backend.asarray(vertices))
    sharp = vertices[backend.host(distance) > ROUNDED * band.spacing]
    if not len(sharp):
        return 0
    from scipy.spatial import cKDTree

    away, _ = cKDTree(corner).query(sharp, distance_upper_bound=CUT_OFF * radius)
    return int(np.count_nonzero(np.asarray(away) > CUT_OFF * radius))


def isosurface(band: NarrowBand, level: float = 0.0) -> tuple[Any, Any, np.ndarray]:
    """(vertices (v, 3) [m] relative to the mesh's origin, facets (f, 3) int32, their areas [m^2] on the host) of
    phi = level [m]."""
    backend, blocks = band.backend, Blocks(band.field.keys, band.field.neighbour)
    at = type(band.grid.spacing)(level)
    _, to_xp, from_xp = backend.array_library()
    state = from_xp((to_xp(band.field.distance) < at).astype(np.uint8))
    cells = edges_and_facets(backend, blocks, state, 3)
    corner = backend.empty((cells.vertex_edge.shape[0], 3), band.field.distance.dtype)
    contour = Contour(band.grid.spacing, at)
    program = REGISTRY["isosurface.edge_points"].program(backend.name)
    program(blocks, band.field.distance, contour, cells.vertex_edge, corner)
    area = backend.empty(cells.facets.shape[0], corner.dtype)
    REGISTRY["sampling.areas"].program(backend.name)(corner, cells.facets, area)
    return corner, cells.facets, backend.host(area)


def placed(backend: Backend, corner: Any, facets: Any, last: np.ndarray, seed: int) -> Any:
    """Particles (n, 3) [m] at random on facets, whose cumulative counts are `last`."""
    position = backend.empty((int(last[-1]) if len(last) else 0, 3), corner.dtype)
    if position.shape[0]:
        program = REGISTRY["sampling.place"].program(backend.name)
        program(corner, facets, backend.asarray(last), np.int64(seed), position)
    return position


def sample_beneath(mesh: SurfaceMesh, radius: float, depth: float, spacing: float, seed: int = 0) -> np.ndarray:
    """Particles (n, 3) [m] inside a mesh, `depth` [m] below its surface, spread as `sample` spreads them on it.

    spacing  of the signed distance's grid [m]

    n is 0 if the solid is nowhere that thick. The particles lie on the level of the trilinear distance.
    """
    band = signed_distance(mesh, spacing, depth + 2 * spacing)
    backend = band.backend
    corner, facets, area = isosurface(band, -depth)
    position = placed(backend, corner, facets, facet_counts(area, HEXAGONAL, radius), seed)
    if len(position):
        level = band.local.field._replace(distance=band.field.distance + corner.dtype.type(depth))
        position, _, _ = relaxed(backend, level, position, radius, seed, False, MOST_ITERATIONS)
    return np.asarray(position, dtype=float) + mesh.origin


def facet_counts(area: np.ndarray, density: float, radius: float, separately: bool = False) -> np.ndarray:
    """(f,) int32 cumulative count of particles: floor(S_f + 1/2), S_f the running sum of g A/(pi r^2).

    Patent P2 with E25; `separately` rounds the count of each facet down, as printed.
    """
    wanted = density * np.asarray(area, dtype=float) / (math.pi * radius**2)
    if separately:
        return np.cumsum(np.floor(wanted)).astype(np.int32)
    return np.floor(np.cumsum(wanted) + 0.5).astype(np.int32)


def relaxation_step(radius: float, step: float, seed: int, printed: bool, dtype: str) -> Relaxation:
    """The kernels' parameters of one step with lambda = `step`; sigma = 0.8 r."""
    real = np.dtype(dtype).type
    return Relaxation(
        real(0.5 / (WIDTH * radius) ** 2), real((CUTOFF * WIDTH * radius) ** 2), real(step * radius),
        real(LONGEST_STEP * radius), np.int32(not printed), np.int64(seed),
    )  # fmt: skip


def relaxed(
    backend: Backend, field: DistanceField, position: Any, radius: float, seed: int, printed: bool, most: int
) -> tuple[Any, list[float], bool]:  # fmt: skip
    """(positions in cell order, sum of the steps' lengths over r N of each iteration, whether it converged)."""
    dtype = np.dtype(position.dtype).name
    search = NeighbourSearch(backend, 3, dtype, CUTOFF * WIDTH * radius, SKIN)
    program = REGISTRY["sampling.relax"].program(backend.name)
    count = position.shape[0]
    residuals: list[float] = []
    moved, neighbours = np.inf, None
    other, step_length = backend.empty((count, 3), dtype), backend.empty(count, dtype)
    for iteration in range(most):
        if moved > search.allowed_displacement * 0.999:
            position = search.reorder(position, search.order(position))
            neighbours = search.build(position)
            moved = 0.0
        step = STEP * (1.0 if printed else DECAY**iteration)
        program(position, neighbours, field, relaxation_step(radius, step, seed, printed, dtype), other, step_length)
        position, other = other, position
        lengths = backend.array_library()[1](step_length)
        moved += float(lengths.max())
        residuals.append(float(lengths.sum(dtype=np.float64)) / (radius * count))
        if residuals[-1] < THRESHOLD:
            return position, residuals, True
    return position, residuals, False
