"""Solid bodies of a scene, voxelised in one global lattice, on the host (Shao & Song 2017, figure 2).

A body consists of the cells of the lattice whose centres lie in it; each becomes a node, a particle of the scene.
The nodes are the first particles, body by body, in each sorted by cell.
"""

import dataclasses
import itertools
import math
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from refsim.backends.arrays import host_memory
from refsim.core.checked import Checked, NotNegative, Positive
from refsim.core.effect import Discretisation, Lattice, Nodes
from refsim.core.errors import InputError
from refsim.core.tables import vector
from refsim.scene.overlaps import winding
from refsim.scene.surface_mesh import SurfaceMesh, placed_mesh
from refsim.sparse_grid.tables import OFFSET, keys_at

Vector = tuple[float, float, float]
MOST_CELLS = 2**31 - 1  # particles are numbered in 32 bits
CELL = 100  # bytes of a cell while a body is cut out of the lattice
TIED = 1e-6  # of a body's size, by which centres of cells on its surface count as inside at its lower faces alone
OFF = 0.25  # spacings by which cells may miss what is drawn without a note
LAID_OUT = 280  # bytes of a particle while a scene is planned, in float64


class Solid(Checked, tag_field="shape", frozen=True, kw_only=True):
    """What every solid body has; in 2D it is what the plane z = 0 cuts.

    density   rest density of its substance [kg/m^3]
    velocity  at the start [m/s]
    spin      angular velocity at the start, about its center of mass [1/s]
    mass      of the whole body [kg], shared by its particles, which keep the density; left out, it is the density times
              the volume of its cells
    """

    density: Positive = 917.0
    velocity: Vector = (0.0, 0.0, 0.0)
    spin: Vector = (0.0, 0.0, 0.0)
    mass: Positive | None = None

    def inside(self, points: np.ndarray) -> np.ndarray:
        """Which of the points (n, 3) [m] lie in the body."""
        raise NotImplementedError

    def extent(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of a box around it [m]."""
        raise NotImplementedError

    def notes(self) -> tuple[str, ...]:
        """What a user should know about it, one sentence each."""
        return ()


class SolidBox(Solid, tag="box", frozen=True, kw_only=True):
    """Box with edges along the axes.

    lower, upper  corners [m]
    """

    lower: Vector
    upper: Vector

    def inside(self, points: np.ndarray) -> np.ndarray:
        lower, upper = self.extent()
        shifted = points + TIED * (upper - lower)
        return np.all((shifted > lower) & (shifted < upper) | (lower == upper), axis=1)

    def extent(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array(self.lower), np.array(self.upper)


class SolidBall(Solid, tag="ball", frozen=True, kw_only=True):
    """Ball.

    center, radius  [m]
    """

    center: Vector
    radius: Positive

    def inside(self, points: np.ndarray) -> np.ndarray:
        return ((points - np.array(self.center)) ** 2).sum(1) < (1 - TIED) * self.radius**2

    def extent(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array(self.center) - self.radius, np.array(self.center) + self.radius


class SolidTorus(Solid, tag="torus", frozen=True, kw_only=True):
    """Ring.

    center        [m]
    radius        of the circle in its middle [m]
    tube_radius   [m]
    axis          direction of its axis
    """

    center: Vector
    radius: Positive
    tube_radius: Positive
    axis: Vector = (0.0, 0.0, 1.0)

    def inside(self, points: np.ndarray) -> np.ndarray:
        axis = np.array(self.axis) / np.linalg.norm(self.axis)
        away = points - np.array(self.center)
        height = away @ axis
        ring = np.linalg.norm(away - height[:, None] * axis, axis=1) - self.radius
        return ring**2 + height**2 < (1 - TIED) * self.tube_radius**2

    def extent(self) -> tuple[np.ndarray, np.ndarray]:
        if not any(self.axis):
            raise InputError(f"solid torus: axis = {list(self.axis)} has no direction; give one.")
        reach = self.radius + self.tube_radius
        return np.array(self.center) - reach, np.array(self.center) + reach


class SolidMesh(Solid, tag="mesh", frozen=True, kw_only=True):
    """Closed triangle mesh.

    file      mesh file (.obj, .off, .ply, .stl)
    center    where the middle of its bounding box goes [m]
    size      its longest edge there [m]; 0 leaves the file's numbers as metres
    rotation  turn about x, then y, then z before [degrees]
    """

    file: str
    center: Vector
    size: NotNegative = 0.0
    rotation: Vector = (0.0, 0.0, 0.0)

    def notes(self) -> tuple[str, ...]:
        return self.mesh().notes

    @np.errstate(over="warn", divide="warn", invalid="warn")
    def mesh(self) -> SurfaceMesh:
        """The mesh in its place. Raises InputError where it cannot be read or has no inside."""
        return placed_mesh(self.file, self.center, self.size, self.rotation, "solid mesh")

    @np.errstate(over="warn", divide="warn", invalid="warn")
    def inside(self, points: np.ndarray) -> np.ndarray:
        """Where the winding number exceeds 1/2."""
        surface = self.mesh()
        points = points + TIED * np.array([1.0, 0.7, 0.9]) * surface.extent
        return winding(points - surface.origin, surface.corners) > 0.5

    def extent(self) -> tuple[np.ndarray, np.ndarray]:
        mesh = self.mesh()
        return mesh.vertices.min(0) + mesh.origin, mesh.vertices.max(0) + mesh.origin


class SolidCells(Solid, tag="cells", frozen=True, kw_only=True):
    """Cells of the global lattice given one by one.

    cells  (k, 3) whole numbers; cell (a, b, e) has its centre at ((a + 1/2) d, (b + 1/2) d, (e + 1/2) d)
    """

    cells: Any = None


def cell_key(cell: np.ndarray) -> np.ndarray:
    """Sortable keys (S,) int64 of cells (S, 3), x lowest."""
    return keys_at(np.asarray(cell, np.int64))


def lattice_of(cells: list[np.ndarray], dim: int = 3) -> Lattice:
    """Lattice of bodies, each given by its cells (k, 3); nodes come body by body, in each sorted by key."""
    ordered = [np.asarray(c, np.int32).reshape(-1, 3)[np.argsort(cell_key(c))] for c in cells]
    cell = np.concatenate([np.zeros((0, 3), np.int32), *ordered])
    first = np.cumsum([0, *map(len, ordered)]).astype(np.int32)
    body = np.repeat(np.arange(len(ordered), dtype=np.int32), np.diff(first))
    return Lattice(cell, cell_key(cell), body, first, np.int32(dim))


def moved(solids: Nodes, cells: np.ndarray) -> Nodes:
    """The nodes, as many cells (3,) of the lattice further back."""
    cell, _, _, first, dim = solids.lattice
    parts = [cell[a:b] - cells for a, b in itertools.pairwise(first)]
    return dataclasses.replace(solids, lattice=lattice_of(parts, dim))


def voxelised(solids: tuple[Solid, ...], grid: Discretisation) -> Nodes:
    """The nodes of the bodies. Raises InputError for bodies that are too small or that overlap."""
    cells = [body_cells(body, f"[[solid]] number {number}", grid) for number, body in enumerate(solids, 1)]
    owner = np.repeat(np.arange(len(cells)), [len(c) for c in cells])
    keys = cell_key(np.concatenate(cells))
    order = np.argsort(keys, kind="stable")
    same = np.flatnonzero(np.diff(keys[order]) == 0)
    if len(same):
        a, b = sorted(owner[order[same[0] : same[0] + 2]] + 1)
        raise InputError(
            f"scene: [[solid]] number {a} and number {b} overlap (bodies share {len(same)} cells of the lattice);"
            " move them apart."
        )
    return Nodes(lattice_of(cells, grid.dim), solids, grid.spacing)


def off_the_lattice(solids: Nodes) -> Iterator[str]:
    """Notes on bodies whose cells stand elsewhere than what is drawn: corners of boxes, the middle of others."""
    ends = itertools.pairwise(solids.lattice.first)
    for number, (body, (a, b)) in enumerate(zip(solids.bodies, ends), 1):
        if isinstance(body, SolidCells):
            continue
        cells = solids.lattice.cell[a:b]
        off = np.array([cells.min(0), cells.max(0) + 1]) - np.array(body.extent()) / solids.spacing
        off = off if isinstance(body, SolidBox) else off.mean(0)
        most = float(np.abs(off - np.round(off))[..., : solids.lattice.dim].max())
        if most > OFF:
            what = "corners of its cells are" if isinstance(body, SolidBox) else "middle of its cells is"
            yield (
                f"[[solid]] number {number}: the {what} up to {most:.2g} d off what is drawn, as cells begin at whole"
                " spacings; draw it there, or take a smaller spacing"
            )


def countable(
    what: str, cells: Iterable[float], each: float = LAID_OUT, kind: str = "cells of the lattice",
    advice: str = "give a smaller body or a larger spacing", grid: Discretisation | None = None,
) -> None:  # fmt: skip
    """Raises InputError where a block of so many cells along each axis has more than an index of 32 bits can number,
    or, at so many bytes each, takes more memory than the machine has. With a grid the advice is a spacing that fits."""
    number, total = math.prod(map(float, cells)), host_memory()["total"]
    most = MOST_CELLS if total is None else min(MOST_CELLS, total / each)
    if number <= most:
        return
    if grid is not None and math.isfinite(number):
        advice = f"a spacing of {1.05 * grid.spacing * (number / most) ** (1 / grid.dim):.2g} m fits"
    if number <= MOST_CELLS and total is not None:
        raise InputError(
            f"{what} makes {number:.3g} {kind}, whose {number * each / 2**30:.3g} GiB this machine with"
            f" its {total / 2**30:.3g} GiB cannot hold; {advice}."
        )
    raise InputError(f"{what} makes {number:.3g} {kind}, and {MOST_CELLS:,} can be numbered; {advice}.")


def body_cells(body: Solid, place: str, grid: Discretisation) -> np.ndarray:
    """Cells (k, 3) int32 whose centres lie in a body. Raises InputError where it is empty, too small or too large."""
    if isinstance(body, SolidCells):
        return _given_cells(body, place, grid.dim)
    spacing, (lower, upper) = grid.spacing, body.extent()
    if grid.dim == 2:
        if lower[2] > 0 or upper[2] < 0:
            raise InputError(f"{place}: the plane z = 0 of a scene in 2D does not cut it; move it there.")
        lower[2], upper[2] = 0.0, spacing
    if not (np.isfinite([lower, upper]).all() and (lower < upper).all()):
        raise InputError(f"{place}: its extent from {vector(lower)} to {vector(upper)} m is empty; give it a size.")
    countable(f"{place}: its extent at a spacing of {spacing} m", np.ceil((upper - lower) / spacing), CELL)
    if not (np.abs([lower, upper]) < OFFSET * spacing).all():
        raise InputError(
            f"{place}: it reaches farther than {OFFSET:,} cells of {spacing:g} m from the origin, from {vector(lower)}"
            f" to {vector(upper)} m; move it there or make it smaller."
        )
    low, high = np.floor(lower / spacing).astype(int), np.ceil(upper / spacing).astype(int)
    axes = [np.arange(a, b) for a, b in zip(low, high)]
    cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    cells = cells[body.inside(spacing * (cells + 0.5) * (1, 1, grid.dim == 3))]
    if not len(cells):
        raise InputError(
            f"{place}: no centre of a lattice cell lies in it, because it is smaller than the spacing ({spacing} m);"
            " make it larger or the spacing smaller."
        )
    return cells.astype(np.int32)


def _given_cells(body: SolidCells, place: str, dim: int) -> np.ndarray:
    try:
        cells = np.array(body.cells)
    except (TypeError, ValueError):
        cells = np.zeros(0)
    if cells.ndim != 2 or cells.shape[1:] != (3,) or cells.dtype.kind not in "iu" or not len(cells):
        raise InputError(f"{place}: cells must be rows of 3 whole numbers; give at least one.")
    if not ((cells > -OFFSET) & (cells < OFFSET)).all():
        raise InputError(f"{place}: a cell is {OFFSET:,} or more cells from the origin; move it there.")
    if dim == 2 and cells[:, 2].any():
        raise InputError(f"{place}: in 2D the third number of its cells must be 0.")
    cells = cells.astype(np.int32)
    if len(np.unique(cells, axis=0)) < len(cells):
        raise InputError(f"{place}: a cell is listed twice; keep one.")
    return cells
