"""Shapes of the fluid: lattice blocks, balls cut out of the lattice, and particles given one by one."""

import io
import math
import warnings
from collections.abc import Callable, Mapping
from typing import Any, Literal, NamedTuple

import numpy as np

from refsim.core.capabilities import BringsWalls, effects_with
from refsim.core.checked import Checked, NotNegative, Positive
from refsim.core.effect import Discretisation, Effect, Nodes
from refsim.core.errors import InputError
from refsim.core.reading import open_regular
from refsim.scene.solids import CELL, MOST_CELLS, SolidMesh, Vector, countable
from refsim.scene.surface_mesh import placed_mesh
from refsim.smoothing import smoothing

WIDEST = 1.1  # spacings between the particles of a box
COLUMNS, DEEP = 16, 4  # of points in a cell that a surface cuts, so that planes across an axis meet them one by one
AROUND = 0.75  # spacings from a cell's centre, along each axis, of points that show whether a surface may cut it
LEAST = 1e-3  # share of a cell that counts
TIED = 1e-6  # share of a cell, or of the edges of a block, that decides nothing
SAME = 0.25  # share of a cell up to which a body overlaps a part whose surface it has
REACH = 3.0  # support radius of the packing [spacings]
NEAR = 3.08  # spacings from a cut cell up to which particles are packed; between two distances of a lattice
HOLLOW = "a mesh is a solid: give a container an outer surface, too, or take box_walls"  # where liquid stands inside
STEPS, LONGEST, AT_REST = 200, 0.1, 2e-3  # of the packing; longest displacement of one, and at its end [spacings]


class CellShares(NamedTuple):
    """Cells of a lattice, those around a part among them."""

    place: np.ndarray  # (n, 3) [m]
    share: np.ndarray  # (n,) that the part takes of each, 0 around it
    centre: np.ndarray  # (n, 3) of what it takes [m]


def shares_of_block(lower: np.ndarray, cells: np.ndarray, step: np.ndarray, dim: int) -> CellShares:
    """Shares of a block of cells with edges `step` [m]."""
    around = np.where(np.arange(3) < dim, int(np.ceil(REACH)) + 1, 0)
    index = np.indices(cells + 2 * around).reshape(3, -1).T - around
    place = lower + (index + 0.5) * step
    place[:, dim:] = 0.0
    return CellShares(place, ((index >= 0) & (index < cells)).all(1).astype(float), place)


def shares_in(block: CellShares, spacing: float, inside: Callable[[np.ndarray], np.ndarray]) -> CellShares:
    """Shares of the block's cells, of the spacing [m], that lie in a body; `inside` says which places (n, 3) [m] do."""
    around = (np.indices((3, 3, 3)).reshape(3, -1).T - 1) * (AROUND * spacing)
    held = inside((block.place[:, None] + around).reshape(-1, 3)).reshape(len(block.place), -1)
    share, centre = held.all(1).astype(float), block.place.copy()
    column, deep = np.indices((COLUMNS, DEEP)).reshape(2, -1)
    across = (np.stack([column, 5 * column % COLUMNS, 13 * column % COLUMNS]) + 0.5) / COLUMNS
    fine = np.stack([*across[:2], (deep + across[2]) / DEEP], 1) * spacing - 0.5 * spacing
    cut = np.flatnonzero(held.any(1) & ~held.all(1))
    for few in np.array_split(cut, 1 + len(cut) // 4096):
        within = inside((block.place[few, None] + fine).reshape(-1, 3)).reshape(len(few), -1)
        share[few] = within.mean(1)
        centre[few] += (within[..., None] * fine).sum(1) / np.maximum(within.sum(1), 1)[:, None]
    return CellShares(block.place, block.share * share, centre)


def filled(
    block: CellShares, grid: Discretisation, effects: Mapping[str, Effect], solids: Nodes | None
) -> np.ndarray:  # fmt: skip
    """Places (n, 3) [m] of particles, a cell's volume each, that fill what bodies leave of the block.

    Raises InputError where bodies take most of all cells that the part fills whole.
    """
    taken, centre = _bodies(block.place, grid, effects, solids)
    inner = block.share == 1
    if inner.any() and taken[inner].min() > 1 - SAME:
        raise InputError(f"scene: bodies take all of a part of its fluid; {HOLLOW}.")
    open_share, open_centre = _rest(block.place, (taken, centre))
    # Where the part's own surface cuts a cell, a body there is what contains it
    bounded = block.share < np.where(block.share < 1, open_share + SAME, open_share)
    left = np.where(bounded, block.share, open_share)
    place = np.where(bounded[:, None], block.centre, open_centre)
    whole, cut = left > 1 - LEAST, (left > LEAST) & (left <= 1 - LEAST)
    if not cut.any():
        return block.place[whole]
    places = np.flatnonzero(cut)
    # Of equal shares those farthest, over the block's edges, from its middle, then from the bodies': both turn with it
    middles = np.average(centre, 0, taken if taken.any() else None), block.place.mean(0)
    edges = np.ptp(block.place, axis=0) + grid.spacing
    apart = (np.linalg.norm((block.place[places] - middle) / edges, axis=1) for middle in middles)
    first = np.lexsort([-_ranks(values) for values in (*apart, left[places])])
    best = places[first[: round(float(left[cut].sum()) + TIED)]]
    kept = np.sort(np.concatenate([np.flatnonzero(whole), best]))
    beyond, outer = _rest(block.place, (taken, centre), (left, place))
    still = [(centre[taken > LEAST], taken[taken > LEAST]), (outer[beyond > LEAST], beyond[beyond > LEAST])]
    kept_out, volume = (np.concatenate(parts) for parts in zip(*still))
    return _packed(place[kept], block.place[cut], kept_out, volume, grid)


def _ranks(values: np.ndarray) -> np.ndarray:
    """Ranks (n,) of values; neighbours in their order that are at most TIED apart have the same."""
    order = np.argsort(values)
    ranks = np.empty(len(values), int)
    ranks[order] = np.cumsum(np.diff(values[order], prepend=values[order[:1]]) > TIED)
    return ranks


def _rest(place: np.ndarray, *parts: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Share (n,) of the cells at (n, 3) [m] that parts, (share, centre) each, leave, and its centre (n, 3) [m]."""
    share = np.clip(1 - sum(part for part, _ in parts), 0.0, 1.0)
    moment = sum(part[:, None] * (centre - place) for part, centre in parts)
    return share, np.where(share[:, None] > LEAST, place - moment / np.maximum(share, LEAST)[:, None], place)


def _bodies(
    place: np.ndarray, grid: Discretisation, effects: Mapping[str, Effect], solids: Nodes | None
) -> tuple[np.ndarray, np.ndarray]:
    """Share (n,) that meshes and solids take of the cells at (n, 3) [m], and its centre (n, 3) [m]."""
    from scipy.spatial import cKDTree

    bodies = [effect.taken(grid, place) for effect in effects_with(effects, BringsWalls)]
    if solids is not None:
        nodes = solids.position()
        pairs = cKDTree(place).sparse_distance_matrix(cKDTree(nodes), grid.spacing * (1 - LEAST), np.inf, "ndarray")
        apart = (nodes[pairs["j"]] - place[pairs["i"]]) / grid.spacing
        each = (1 - np.abs(apart)).prod(1)  # the part that two cells have in common has its centre between theirs
        share = np.bincount(pairs["i"], each, len(place))
        middle = [np.bincount(pairs["i"], 0.5 * each * axis * grid.spacing, len(place)) for axis in apart.T]
        bodies.append((share, place + np.stack(middle, 1) / np.maximum(share, LEAST)[:, None]))
    total = np.zeros(len(place))
    moment = np.zeros_like(place)
    for share, centre in bodies:
        total += share
        moment += share[:, None] * (centre - place)
    return total, place + moment / np.maximum(total, LEAST)[:, None]


def _packed(
    place: np.ndarray, cut: np.ndarray, still: np.ndarray, volume: np.ndarray, grid: Discretisation
) -> np.ndarray:  # fmt: skip
    """Places (n, 3) [m] of which those near the `cut` cells are shifted to even distances.

    still, volume  places (m, 3) [m] of what stays, and its volumes [spacing^dim]
    """
    from scipy.spatial import cKDTree

    from refsim.smoothing.reference import kernel_slope

    d, reach = grid.spacing, REACH * grid.spacing
    kernel = smoothing("wendland_c2", reach, grid.dim)
    near = cKDTree(cut).query(place)[0] < NEAR * d
    place, moving = place.copy(), place[near]
    still = np.concatenate([place[~near], still])
    volume = np.concatenate([np.ones(np.count_nonzero(~near)), volume]) * d**grid.dim
    kept = cKDTree(moving).query(still)[0] < reach + NEAR * d
    still, volume = cKDTree(still[kept]), volume[kept]
    for _ in range(STEPS):
        tree = cKDTree(moving)
        moving_pairs, beside = (tree.sparse_distance_matrix(other, reach, 2, "ndarray") for other in (tree, still))
        i = np.concatenate([moving_pairs["i"], beside["i"]])
        apart = moving[i] - np.concatenate([moving[moving_pairs["j"]], still.data[beside["j"]]])
        each = np.concatenate([np.full(len(moving_pairs), d**grid.dim), volume[beside["j"]]])
        r = np.concatenate([moving_pairs["v"], beside["v"]])
        slope = each * kernel_slope(r, kernel) / np.maximum(r, 1e-9 * d)
        shift = -0.5 * (0.5 * reach) ** 2 * np.stack([np.bincount(i, slope * a, len(moving)) for a in apart.T], 1)
        length = np.linalg.norm(shift, axis=1)
        moving = moving + shift * np.minimum(1.0, LONGEST * d / np.maximum(length, 1e-300))[:, None]
        if length.max() < AT_REST * d:
            break
    place[near] = moving
    return place


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

    def cell_shares(self, grid: Discretisation) -> CellShares:
        """The cells that it fills as far as bodies leave them."""
        return shares_of_block(np.array(self.lower), np.array(self._counted(grid)), self.steps(grid), grid.dim)

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
        return points[(points**2).sum(1) < (1 + TIED) * self.radius**2] + np.array(self.center)


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

    file      mesh file (.obj, .off, .ply, .stl)
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

    def cell_shares(self, grid: Discretisation) -> CellShares:
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
        cells = np.ceil((np.append(high[:2], top) - low) / grid.spacing - TIED)
        countable(f"fluid mesh: {self.file!r} at a spacing of {grid.spacing} m", cells, CELL, grid=grid)
        lower = 0.5 * (low + high - cells * grid.spacing)  # a mirrored mesh has mirrored cells
        if self.level is not None:
            lower[2] = top - cells[2] * grid.spacing
        block = shares_of_block(lower, cells.astype(int), np.full(3, grid.spacing), 3)
        return shares_in(block, grid.spacing, inside.inside)


def as_floats(values: Any) -> np.ndarray:
    """Numbers as an array of float64. Raises TypeError or ValueError for anything else."""
    array = np.asarray(values)
    if array.dtype.kind not in "iuf":
        raise TypeError(f"{array.dtype} are no numbers")
    return array.astype(float)
