"""Shapes of the fluid: lattice blocks, balls cut out of the lattice, and particles given one by one."""

import io
import math
import warnings
from typing import Any, Literal

import numpy as np

from refsim.core.checked import Checked, NotNegative, Positive
from refsim.core.effect import Discretisation
from refsim.core.errors import InputError
from refsim.core.reading import open_regular
from refsim.scene.filling import Room, room_in, room_of_block
from refsim.scene.solids import CELL, MOST_CELLS, SolidMesh, countable
from refsim.scene.surface_mesh import placed_mesh

Vector = tuple[float, float, float]
WIDEST = 1.1  # spacings between the particles of a box


class Box(Checked, tag="box", tag_field="shape", frozen=True, kw_only=True):
    """Lattice block of `cells` particles per axis, each in the middle of its cell.

    lower     corner of the block [m]
    cells     particles along x, y and z (1 along z in 2D); left out, as many as fit the size best
    velocity  of every particle [m/s]
    size      edges [m]; particles stand evenly in them, and their mass follows, so that the density stays. Left out,
              each particle has a cell of the spacing
    outside   "bodies": only what meshes and solids leave of the block is filled, and the particles beside them are
              packed so that no gap stays
    """

    lower: Vector = (0.0, 0.0, 0.0)
    cells: tuple[int, int, int] | None = None
    velocity: Vector = (0.0, 0.0, 0.0)
    size: Vector | None = None
    outside: Literal["bodies"] | None = None

    def counts(self, dim: int, spacing: float) -> tuple[int, int, int]:
        """Particles along each axis, at a spacing [m] in `dim` dimensions."""
        if self.cells is not None:
            return self.cells
        if self.size is None:
            raise InputError("fluid box: its extent is missing; give cells, size, or both.")
        edges = (*self.size[:dim], spacing)[:3]
        if not all(0 < edge < MOST_CELLS * spacing for edge in edges):
            raise InputError(
                f"fluid box: size = {list(self.size)} m is not possible at a spacing of {spacing:g} m; give edges above"
                f" 0 and below {MOST_CELLS:,} spacings."
            )
        return tuple(max(1, round(edge / spacing)) for edge in edges)  # type: ignore[return-value]

    def _counted(self, grid: Discretisation) -> tuple[int, int, int]:
        """Particles along each axis. Raises InputError where there can be none, or too many."""
        cells = self.counts(grid.dim, grid.spacing)
        if min(cells) < 1 or (grid.dim == 2 and cells[2] != 1):
            raise InputError(
                f"fluid box: cells = {list(cells)} is not possible in {grid.dim}D; give at least 1 along each"
                " axis, and 1 along z in 2D."
            )
        countable(f"fluid box: cells = {list(cells)}", cells, grid=grid)
        return cells

    def positions(self, grid: Discretisation) -> np.ndarray:
        """Positions (n, 3) [m]."""
        corners = zip(self._counted(grid), self.steps(grid), self.lower)
        axes = [(np.arange(n) + 0.5) * step + low for n, step, low in corners]
        if grid.dim == 2:
            axes[2] = np.zeros(1)
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)

    def steps(self, grid: Discretisation) -> np.ndarray:
        """Distances (3,) [m] of its particles along each axis."""
        return np.array((*self.shares(grid), 1.0)[:3]) * grid.spacing

    def room(self, grid: Discretisation) -> Room:
        """The cells that it fills as far as bodies leave them."""
        return room_of_block(np.array(self.lower), np.array(self._counted(grid)), self.steps(grid), grid.dim)

    def shares(self, grid: Discretisation) -> tuple[float, ...]:
        """Distances of its particles over the spacing, along each axis."""
        if self.size is None:
            return (1.0,) * grid.dim
        cells = self.counts(grid.dim, grid.spacing)
        stretch = tuple(edge / (n * grid.spacing) for edge, n in zip(self.size[: grid.dim], cells))
        if not all(1 / WIDEST <= share <= WIDEST for share in stretch):
            raise InputError(
                f"fluid box: size = {list(self.size)} puts {list(cells)} particles at"
                f" {', '.join(f'{share:.3g}' for share in stretch)} spacings along the axes; give"
                f" {1 / WIDEST:.2g} to {WIDEST:g}, or leave the size out."
            )
        return stretch


class Ball(Checked, tag="ball", tag_field="shape", frozen=True, kw_only=True):
    """Ball (disc in 2D) cut out of the lattice.

    center    [m]
    radius    [m]
    velocity  of every particle [m/s]
    mass      of the whole ball [kg; kg/m in 2D]; the distances of its particles follow, so that its density stays. Left
              out, each particle has the mass of the fluid's lattice
    """

    center: Vector = (0.0, 0.0, 0.0)
    radius: Positive
    velocity: Vector = (0.0, 0.0, 0.0)
    mass: Positive | None = None

    def positions(self, grid: Discretisation) -> np.ndarray:
        """Positions (n, 3) [m]."""
        reach = math.ceil(self.radius / grid.spacing) + 1
        what = f"fluid ball: a radius of {self.radius} m at a spacing of {grid.spacing} m"
        countable(what, [2 * reach] * grid.dim, CELL, grid=grid)
        steps = (np.arange(-reach, reach) + 0.5) * grid.spacing
        axes = [steps, steps, steps if grid.dim == 3 else np.zeros(1)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        return points[(points**2).sum(1) <= self.radius**2] + np.array(self.center)


class Cloud(Checked, tag="cloud", tag_field="shape", frozen=True, kw_only=True):
    """Particles given one by one.

    position  (n, 3) or (n, 2) coordinates [m]; from TOML a list of lists
    file      instead of `position`: a .npy file or a text file with one particle a line (comma separated)
    velocity  one for all [m/s], or (n, 3)
    mass      (n,) [kg; kg/m in 2D]; left out, the fluid's lattice mass
    """

    position: Any = None
    file: str = ""
    velocity: Any = (0.0, 0.0, 0.0)
    mass: Any = None

    def positions(self, grid: Discretisation) -> np.ndarray:
        """Positions (n, 3) [m]."""
        values = self.position
        if (values is None) == (not self.file):
            raise InputError("fluid cloud: positions must be given exactly once; give either position or file.")
        if self.file:
            try:
                with open_regular(self.file) as file, warnings.catch_warnings():
                    warnings.simplefilter("ignore")  # an empty file is reported below
                    if self.file.endswith(".npy"):
                        values = np.lib.format.open_memmap(self.file, "r")  # which compares shape and size before
                    else:
                        with io.TextIOWrapper(file, encoding="utf-8") as lines:
                            values = np.loadtxt(lines, delimiter=",", ndmin=2)
            except OSError as error:
                why = error.strerror or error
                raise InputError(f"fluid cloud: cannot read {self.file!r} ({why}); give a readable file.") from None
            except Exception as error:  # a damaged header of a .npy file is parsed as Python, with any of its errors
                why = str(error).partition(";")[0].rstrip(".")  # without NumPy's advice
                raise InputError(
                    f"fluid cloud: cannot read positions from {self.file!r} ({why}); give a .npy file or one line of"
                    " comma-separated numbers for each particle."
                ) from None
        try:
            points = as_floats(values)
        except (TypeError, ValueError):
            raise InputError("fluid cloud: position must be a list of coordinates; give (n, 3) numbers.") from None
        if points.ndim != 2 or points.shape[1] not in (2, 3):
            raise InputError(f"fluid cloud: position has shape {points.shape}; give a row of 2 or 3 numbers for each.")
        if points.shape[1] == 2:
            points = np.hstack([points, np.zeros((len(points), 1))])
        return points


class FluidMesh(Checked, tag="mesh", tag_field="shape", frozen=True, kw_only=True):
    """What meshes and solids leave of the inside of a closed triangle mesh, packed so that no gap stays.

    file      mesh file that trimesh reads (.stl, .obj, .ply, ...)
    center    where the middle of its bounding box goes [m]; left out, the file's
    size      its longest edge there [m]; 0 leaves the file's numbers as metres
    rotation  turn about x, then y, then z before [degrees]
    level     height z up to which it is filled [m]; left out, it is full
    velocity  of every particle [m/s]
    """

    file: str
    center: Vector | None = None
    size: NotNegative = 0.0
    rotation: Vector = (0.0, 0.0, 0.0)
    level: float | None = None
    velocity: Vector = (0.0, 0.0, 0.0)

    def room(self, grid: Discretisation) -> Room:
        """The cells that it fills as far as bodies leave them."""
        if grid.dim != 3:
            raise InputError("fluid mesh: a mesh is a body in space; set dim to 3 or leave it out.")
        origin = placed_mesh(self.file, None, self.size, self.rotation, "fluid mesh").origin
        center = tuple(origin.tolist()) if self.center is None else self.center
        inside = SolidMesh(file=self.file, center=center, size=self.size, rotation=self.rotation)
        low, high = inside.extent()
        top = high[2] if self.level is None else min(self.level, high[2])
        if not top > low[2]:
            raise InputError(
                f"fluid mesh: level = {self.level:g} m is below {self.file!r}, which begins at {low[2]:g} m; raise it."
            )
        cells = np.ceil((np.append(high[:2], top) - low) / grid.spacing - 1e-9)
        countable(f"fluid mesh: {self.file!r} at a spacing of {grid.spacing} m", cells, CELL, grid=grid)
        lower = np.append(low[:2], top - cells[2] * grid.spacing)
        room = room_of_block(lower, cells.astype(int), np.full(3, grid.spacing), 3)
        return room_in(room, grid.spacing, inside.inside)


def as_floats(values: Any) -> np.ndarray:
    """Numbers as an array of float64. Raises TypeError or ValueError for anything else."""
    array = np.asarray(values)
    if array.dtype.kind not in "iuf":
        raise TypeError(f"{array.dtype} are no numbers")
    return array.astype(float)
