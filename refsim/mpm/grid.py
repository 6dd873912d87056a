"""The background grid of one run: blocks where the liquid is, points by cell, arrays on the nodes.

Blocks are made anew only where a point has left them; blocks without a point contribute nothing to any sum, so that
a result does not depend on when that happened.
"""

import itertools
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from refsim.backends.arrays import Backend, Growing, Scratch, capacity_of, growing
from refsim.backends.runtime import simulated
from refsim.core.errors import RunStopped
from refsim.core.operation import REGISTRY
from refsim.mpm.groups import SETS, Bins, Places
from refsim.mpm.limits import FARTHEST
from refsim.mpm.operations import block_keys
from refsim.sparse_grid import Blocks, PointList
from refsim.sparse_grid.tables import blocks_of, reached

NODES = 64  # of a block
SLACK = {"cuda": 1}  # blocks by which a new table reaches further, where making one costs more than passing over it
EACH_TABLE = {2: 9, 3: 27}  # neighbours of a block
TILE, MOST_TILES = 64 if simulated() else 1024, 1024  # cells that a thread block of the GPU adds up, and such blocks
UNSEEN = 8  # steps, of half a cell each at most, in which a particle crosses no more than one block
OUT_OF_ORDER = 0.05  # share of particles out of order in memory, above which they are sorted


class Background(NamedTuple):
    """The background grid as kernels take it; the inverse in float64: places far off keep their digits."""

    cell_size: Any  # h [m]
    inverse_cell: Any  # 1/h [1/m], float64
    inverse_moment: Any  # 4/h^2 [1/m^2], (3.16)
    layers: Any  # of nodes along z that a particle reaches: 3, or 1 in the plane
    width: Any  # nodes along an axis that the particles of a block reach: 6, or 10 in the plane
    least_mass: Any  # of a node that moves [kg]
    least_speed: Any  # of a node that moves, along an axis [m/s]


class MpmGrid:
    """Blocks, bins and node arrays on one backend.

    dim, dtype, cell_size  dimension, dtype of the node arrays, h [m]
    reach                  cells along an axis by which points of other sets may be away from their particle

    `node_mass` (nodes,) [kg], `node_momentum`, `node_velocity` (nodes, 3); node 64 b + l is the l-th of block b.
    """

    def __init__(self, dim: int, dtype: str, cell_size: float, backend: Backend | None = None, reach: int = 0) -> None:
        self.dim, self.dtype, self.cell_size, self.reach = dim, dtype, cell_size, reach
        self.backend = backend or Backend("numpy")
        self.width = 6 if dim == 3 else 10
        self.inverse_cell = 1.0 / float(np.dtype(dtype).type(cell_size))
        self.on_device = self.backend.name == "cuda"
        self.blocks: Any = None
        self.complete: Any = None  # (b,) 1 where the blocks that its particles reach are there, too; see DEEP
        # Where points are sorted without the host: how many particles are not deep in the blocks, are at no possible
        # place, and are out of order
        self.noted: Any = None
        self.lists = Scratch(self.backend)  # in which they are sorted
        self._unseen = 0  # steps for which the blocks suffice
        self.cells: dict[str, Any] = {}
        self.bins: dict[str, Bins] = {}
        self.rebuilds = 0
        self.arrays = Growing(self.backend)  # on the nodes
        self._located: dict[str, np.ndarray] = {}

    def on_backend(self, backend: Backend) -> "MpmGrid":
        """A grid like this one on another backend, with the same blocks and points in it."""
        grid = MpmGrid(self.dim, self.dtype, self.cell_size, backend, self.reach)
        if self._located:
            grid.blocks = Blocks(*map(backend.asarray, self.blocks))
            grid.complete = backend.asarray(self.complete)
            held = [self._located.get(name) for name in SETS]
            sets: list[Any] = [None if values is None else backend.asarray(values) for values in held]
            outputs = () if backend.name == "numpy" else (backend.empty(sets[0].shape[0], np.int32),)
            REGISTRY["mpm.cells"].program(backend.name)(*sets, grid, *outputs)
        return grid

    # What follows from where the points are

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return 0 if self.blocks is None else NODES * self.blocks.keys.shape[0]

    node_mass = growing("m_j (nodes,) [kg]", "node_mass", lambda grid: (grid.nodes,))
    node_momentum = growing(
        "(mv)_j with the forces' impulse (nodes, 3) [kg m/s]", "node_momentum", lambda grid: (grid.nodes, 3)
    )
    node_velocity = growing("v_j after the update (nodes, 3) [m/s]", "node_velocity", lambda grid: (grid.nodes, 3))
    node_pull = growing("Force of the surface on the nodes (nodes, 3) [N]", "node_pull", lambda grid: (grid.nodes, 3))
    scratch = growing(
        "What the points of each block give to the nodes in their reach (b, width^dim, 4): mass and momentum.",
        "scratch", lambda grid: (grid.nodes // NODES, grid.width**grid.dim, 4),
    )  # fmt: skip
    block_extremes = growing(
        "Extremes of the particles of each block (b, 5), where a device reduces them in two steps.", "block_extremes",
        lambda grid: (grid.nodes // NODES, 5),
    )  # fmt: skip

    def places(self, name: str) -> Places:
        """The points of a set by bin, their cells, and the blocks."""
        return Places(self.bins[name], self.cells[name], self.blocks)

    @property
    def sample_cells(self) -> PointList:
        """The surface's samples by cell."""
        cell = self.cells["samples"]
        if self.on_device:
            return PointList(*self.bins["samples"], cell)
        if self.backend.name == "numpy":
            order = np.argsort(cell, kind="stable").astype(np.int32)
            return PointList(np.searchsorted(cell[order], np.arange(self.nodes + 1)).astype(np.int32), order, cell)
        from refsim.sparse_grid.block_search import points_by_cell  # loads Numba

        return points_by_cell(cell, self.nodes // NODES)

    def attend(self, position: Any, moved: bool = False) -> bool:
        """Before a step that is one CUDA graph: make the blocks that particles at `position` (n, 3) [m] may reach in
        it. Returns whether any array is another one than before.

        moved  whether the positions were set other than by the latest step

        Raises RunStopped where a particle is not finite or too far away.
        """
        self._unseen -= 1
        if self.noted is not None and self._unseen > 0 and not moved:
            return False
        from refsim.backends import device
        from refsim.mpm import sorting_cuda as programs  # loads numba.cuda

        self._unseen = UNSEEN - 2 * self.reach
        if self.noted is None:
            self.noted = device.PinnedCopy(self.backend.zeros(3, "int32"))
        elif not moved:
            shallow, lost, _ = self._noted()  # by the step before, half a cell ago
            self._check_lost(SETS[0], lost)
            if not shallow:
                return False
        keys = programs.block_keys(position, self.inverse_cell, self.dim)
        self._check_lost(SETS[0], self._rebuild([keys], programs.make_table))
        self.bins = {SETS[0]: programs.bins_of(SETS[0], self, position.shape[0])}
        for name in ("node_mass", "node_momentum", "node_velocity", "scratch", "block_extremes"):
            getattr(self, name)  # nothing may be allocated while a step is recorded
        return True

    def order(self, position: Any) -> Any:
        """Numbers (n,) int32 of the particles at `position`, block by block and cell by cell, after `attend`.

        Particles of a cell keep their order, which depends on nothing but their places. None where they stand in it
        already, but for a few.
        """
        from refsim.mpm import sorting_cuda as programs

        cell = self.arrays.array("order_cell", (position.shape[0],), np.int32)
        point = programs.order(position, self, cell)
        return point if self._noted()[2] > OUT_OF_ORDER * position.shape[0] else None

    def _noted(self) -> list[int]:
        """Particles not deep in the blocks, at no possible place, and out of order, as counted last."""
        self.noted.send()
        return self.noted.read().tolist()

    def _check_lost(self, name: str, lost: int) -> None:
        if lost:
            raise RunStopped(
                "out_of_grid",
                f"{lost} of the {name} left the background grid, which ends {FARTHEST} cells from the origin, or"
                " are at no finite place: take a smaller step, or put walls around the liquid.",
            )

    def bytes(self) -> int:
        """Memory of all arrays but the particles' cells, which are a field."""
        kept = [*self.arrays.held.values(), *(self.blocks or ())]
        kept += [] if self.noted is not None else itertools.chain(*self.bins.values())
        kept += [] if self.complete is None else [self.complete]
        kept += [cell for name, cell in self.cells.items() if name != SETS[0]]
        return sum(int(np.prod(a.shape)) * a.dtype.itemsize for a in kept) + self.lists.bytes

    def locate(
        self, positions: Sequence[Any], cell: Any, find_cells: Any, block_keys: Any, sorted_bins: Any,
        make_table: Any = None,
    ) -> None:  # fmt: skip
        """Find the cell of every point of every set (n, 3) [m], make blocks where some are missing, and sort.

        positions  in the order of SETS; those that are None are no sets
        cell       (n,) where the particles' cells are written; other sets' are kept in `cells`
        The programs of a backend do the work: find_cells(position, inverse_cell, blocks, complete, cell) gives
        (points in no block, points at no possible place), block_keys(position, inverse_cell, dim) keys, with -1 for
        points at no possible place, sorted_bins(cell, blocks) what makes the Bins. make_table(keys, dim, low, high)
        gives blocks, `complete` and the number of points without a block; without it NumPy does.

        Raises RunStopped where a point is not finite or too far away.
        """
        sets = self.held(positions, cell)
        if self.backend.name == "numpy":
            self._located = {name: np.array(values) for name, values in sets.items()}

        def found() -> list[tuple[int, int]]:
            """Points in no block, and at no possible place, of each set."""
            return [
                find_cells(values, self.inverse_cell, self.blocks, self.complete, self.cells[name])
                for name, values in sets.items()
            ]

        counts = found() if self.blocks is not None else [(1, 0)]
        if any(missing for missing, _ in counts):
            self._rebuild([block_keys(values, self.inverse_cell, self.dim) for values in sets.values()], make_table)
            counts = found()
        for name, (_, lost) in zip(sets, counts, strict=True):
            self._check_lost(name, lost)
        self.bins = {name: Bins(*sorted_bins(self.cells[name], self.nodes // NODES)) for name in sets}

    def held(self, positions: Sequence[Any], cell: Any) -> dict[str, Any]:
        """The sets of points that there are, whose cells are then `cell` for the particles, and arrays of their own."""
        sets = {name: values for name, values in zip(SETS, positions, strict=True) if values is not None}
        for name, values in sets.items():
            if name == SETS[0]:
                self.cells[name] = cell
            elif name not in self.cells or self.cells[name].shape != values.shape[:1]:
                self.cells[name] = self.backend.empty(values.shape[0], np.int32)
        return sets

    # Inside

    def _rebuild(self, keys: list[Any], make_table: Any = None) -> int:
        """Make the blocks in reach of points with these `keys`; how many have none, -1."""
        self.rebuilds += 1
        slack = SLACK.get(self.backend.name, 0)
        if make_table is not None:
            self.blocks, self.complete, lost = make_table(keys, self.dim, -slack, slack + 1)
            return int(lost)
        every = np.concatenate(keys)
        self.blocks = blocks_of(reached(every[every >= 0], self.dim, -slack, slack + 1), self.dim)
        neighbour = self.blocks.neighbour
        corners = [k for k, s in enumerate(itertools.product((-1, 0, 1), repeat=self.dim)) if min(s) >= 0]
        complete: Any = (neighbour[:, corners] >= 0).all(1)
        deep = (neighbour >= 0).all(1) & complete[neighbour].all(1)
        self.complete = complete.astype(np.uint8) + (complete & deep)
        return sum(int((k < 0).sum()) for k in keys)


def blocks_at(position: np.ndarray, dim: int, dtype: str, cell_size: float, backend: str) -> int:
    """Blocks that a grid of `cell_size` [m] makes on a backend for particles at `position` (n, 3) [m]."""
    inverse_cell = MpmGrid(dim, dtype, cell_size).inverse_cell
    keys = block_keys(np.asarray(position, dtype=dtype), inverse_cell, dim)
    slack = SLACK.get(backend, 0)
    return len(reached(keys[keys >= 0], dim, -slack, slack + 1))


def grid_bytes(
    blocks: int, particles: int, dim: int, dtype: str, backend: str, tension: bool = False, sets: Iterable[int] = (),
) -> int:  # fmt: skip
    """Bytes of the background grid after a step, with so many `blocks` since its first one.

    tension  whether a surface pulls at the nodes
    sets     points in each set beside the particles: embedded points, samples
    """
    real, nodes = np.dtype(dtype).itemsize, NODES * blocks
    reach = {2: 10**2, 3: 6**3}[dim]  # nodes that the particles of a block reach
    on_device = backend == "cuda"
    tables = blocks * (8 + 4 * EACH_TABLE[dim] + 1)  # keys, neighbours, whether complete
    if backend == "numpy":
        return tables + capacity_of(nodes) * (7 + 3 * tension) * real + sum(4 * s for s in sets)
    arrays = capacity_of(nodes) * (7 + 3 * tension) * real + capacity_of(blocks) * 4 * reach * real
    bins = nodes + 1 if on_device else blocks + 1
    lists = sum(4 * (bins + count) for count in (particles, *sets)) + sum(4 * count for count in sets)
    if not on_device:
        return tables + arrays + lists
    counts = 4 * (nodes + min(-(-nodes // TILE), MOST_TILES))  # of each cell, of tiles of cells
    sorting = sum(counts + 8 * count for count in (particles, *sets)) + 4 * capacity_of(particles)
    return tables + arrays + lists + sorting + capacity_of(blocks) * 5 * real
