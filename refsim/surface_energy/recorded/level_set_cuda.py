"""States of nodes, vertices and facets, and components of inside nodes, a thread block to each block of nodes."""

import numpy as np

from refsim.backends.compile import cuda, cuda_formula, cuda_kernel, formula
from refsim.backends.primitives import largest_of_block, sum_before
from refsim.isosurface import kernels as isosurface_kernels
from refsim.sparse_grid.block_search_cuda import SUMMING, number
from refsim.sparse_grid.formulas import block_bits, step_node
from refsim.surface_energy.components_cuda import join, lowest
from refsim.surface_energy.recorded.cells_cuda import (
    CELLS,
    EDGES,
    FACETS,
    MADE,
    MISSING,
    VERTICES,
    block_start,
    local_place,
    occupied_near,
    sum_pairs,
)

SHARING = 4  # threads that share a node
AROUND = 343  # cells within two of a block's nodes: 7 x 7 x 7, or 11 x 11 in the plane


@cuda_formula
def load_cells(b, blocks, first, begin, end):
    """begin, end (dimensionless) of the particles of all cells within two of the nodes of block b, x fastest."""
    space = blocks.neighbour.shape[1] == 27
    width = 7 if space else 11
    for c in range(cuda.threadIdx.x, width**3 if space else width**2, CELLS):
        at = np.uint32(c)
        row = at // np.uint32(7) if space else at // np.uint32(11)
        z = row // np.uint32(7) if space else np.uint32(2)
        x, y = np.int32(at - np.uint32(width) * row), np.int32(row - np.uint32(7) * z if space else row)
        cell = step_node(blocks, CELLS * b, x - 2, y - 2, np.int32(z) - 2)
        held = number(max(cell, 0))
        low, high = first[held], first[held + 1]  # read in any case: such reads do not wait for each other
        begin[c], end[c] = low, high if cell >= 0 else low
    cuda.syncthreads()


@formula
def inside_spheres(local, dx, dy, dz, begin, end, placed, blocks, surface_term):
    """Algorithm 1, line 7, 1 or 0: whether a particle of a cell (dx, dy, dz) from a block's node is nearer than r."""
    bits = block_bits(blocks)
    width = 7 if bits == 2 else 11
    x, y, z = local_place(local, bits)
    cx, cy, cz = x + dx, y + dy, z + dz
    c = number(cx + 2 + width * (cy + 2) + (width * width * (cz + 2) if bits == 2 else 0))
    if begin[c] < end[c]:
        real = type(surface_term.cell_size)
        # from the node to the lowest node of the cell's block
        px, py = real(block_start(cx, bits) - x), real(block_start(cy, bits) - y)
        pz = real(block_start(cz, bits) - z) if bits == 2 else real(0)
        for at in range(begin[c], end[c]):
            k = number(at)
            ux, uy, uz = px + placed[k, 0], py + placed[k, 1], pz + placed[k, 2]
            if ux * ux + uy * uy + uz * uz < surface_term.radius_squared:
                return 1
    return 0


@cuda_formula
def mark_nodes(state, placed, first, blocks, surface_term):
    """Algorithm 1, lines 5 to 9, of the nodes of a thread block's block: state <- 1 or 0.

    Every particle in a node's own cell is nearer than sqrt(dim) h: deep in the liquid that decides. Else cells that
    touch a node come first, a thread to each node; then several threads share an undecided node and take the cells
    around it by turns.
    """
    begin = cuda.shared.array(AROUND, np.int32)
    end = cuda.shared.array(AROUND, np.int32)
    waiting = cuda.shared.array(CELLS, np.int32)
    many = cuda.shared.array(1, np.int32)
    b, thread = cuda.blockIdx.x, cuda.threadIdx.x
    space = blocks.neighbour.shape[1] == 27
    i = number(CELLS * b + thread)
    own = 0
    if first[i] < first[i + 1] and surface_term.radius_squared >= type(surface_term.cell_size)(3 if space else 2):
        own = 1
    state[thread] = own
    if cuda.syncthreads_and(own) != 0:
        return
    if thread == 0:
        many[0] = 0
    load_cells(b, blocks, first, begin, end)
    for c in range(7 if space else 3):
        if own == 0:
            dx, dy, dz = (c & 1) - 1, ((c >> 1) & 1) - 1, (c >> 2) - 1 if space else 0
            own = inside_spheres(thread, dx, dy, dz, begin, end, placed, blocks, surface_term)
    state[thread] = own
    if own == 0:
        waiting[cuda.atomic.add(many, 0, 1)] = thread  # their order changes no result
    cuda.syncthreads()
    for n in range(thread // SHARING, many[0], CELLS // SHARING):
        node = waiting[n]
        for c in range(thread % SHARING, 64 if space else 16, SHARING):
            if state[node] == 0:
                dx, dy, dz = (c & 3) - 2, ((c >> 2) & 3) - 2, (c >> 4) - 2 if space else 0
                if inside_spheres(node, dx, dy, dz, begin, end, placed, blocks, surface_term) != 0:
                    state[node] = 1
    cuda.syncthreads()


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="total")
def states_of_blocks(placed, cells, blocks, surface_term, node_state, node_label, total):
    """Algorithm 1, lines 5 to 9, and first labels: the lowest node of each node's component within its block.

    Without `placed` the states are given, and only labels are written.
    """
    label = cuda.shared.array(CELLS, np.int32)
    b, thread = cuda.blockIdx.x, cuda.threadIdx.x
    i = CELLS * b + thread
    state = 0
    if placed is not None:
        if occupied_near(cells.first, blocks, b):
            mark_nodes(label, placed, cells.first, blocks, surface_term)
            state = label[thread]
            cuda.syncthreads()
        node_state[i] = state
    else:
        state = 1 if node_state[i] == 1 else 0
    own = thread if state == 1 else CELLS
    if cuda.syncthreads_and(state) != 0:
        own = 0
    label[thread] = own
    changed = cuda.syncthreads_or(1 if 0 < own < CELLS else 0)
    while changed != 0:
        least = own
        if own < CELLS:
            least = min(lowest_beside(label, thread, blocks), label[own])
        cuda.syncthreads()
        label[thread] = least
        changed = cuda.syncthreads_or(1 if least < own else 0)
        own = least
    node_label[i] = CELLS * b + own if own < CELLS else -1


@formula
def lowest_beside(label, thread, blocks):
    """The lowest label of a node and of its neighbours within the block."""
    bits = 2 if blocks.neighbour.shape[1] == 27 else 3
    least = label[thread]
    for axis in range(3 if bits == 2 else 2):
        step, place = 1 << (axis * bits), (thread >> (axis * bits)) & ((1 << bits) - 1)
        if place > 0:
            least = min(least, label[thread - step])
        if place < (1 << bits) - 1:
            least = min(least, label[thread + step])
    return least


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="cut_total")
def classify_blocks(blocks, node_state, table, crossings, cell_case, cut_total):
    """Cut edges and corner states; vertices and 2^32 facets of each block."""
    part = cuda.shared.array(CELLS, np.int32)
    b, thread = cuda.blockIdx.x, cuda.threadIdx.x
    i = CELLS * b + thread
    bits, case = isosurface_kernels.cell_states(i, blocks, node_state)
    crossings[i] = bits
    cell_case[i] = case
    mine = cut_count(bits) + (int(table.count[case]) << 16)
    before = sum_before(part, np.int32(mine))
    if thread == CELLS - 1:
        cut = before + mine
        cut_total[b] = (np.int64(cut >> 16) << 32) | np.int64(cut & 0xFFFF)


@formula
def cut_count(bits):
    """Number of bits set out of three, = b0 + b1 + b2, dimensionless."""
    return (bits & 1) + ((bits >> 1) & 1) + (bits >> 2)


@cuda_kernel(block_for_each_row=True, threads=SUMMING, rows_of="one")
def sum_cuts(one, cut_total, vertex_edge, facets, counts):
    """cut_total[b] <- sum over the blocks before b; numbers of vertices and facets, as found and as made."""
    part = cuda.shared.array(SUMMING, np.int64)
    before = sum_pairs(part, cut_total)
    if cuda.threadIdx.x == SUMMING - 1:
        counts[EDGES], counts[FACETS] = before & 0xFFFFFFFF, before >> 32
        if counts[MISSING] == 0 and counts[EDGES] <= vertex_edge.shape[0] and counts[FACETS] <= facets.shape[0]:
            counts[VERTICES], counts[MADE] = counts[EDGES], counts[FACETS]


# Components are joined in the kernels that number vertices and write facets: a launch costs as much as either.


@cuda_formula
def join_node(i, blocks, node_label):
    """Join the components that touch at node i across a face of its block, once for a pair of labels on the face."""
    mine = node_label[i]
    if mine >= 0:
        bits = 2 if blocks.neighbour.shape[1] == 27 else 3
        for axis in range(3 if bits == 2 else 2):
            if (i >> (axis * bits)) & ((1 << bits) - 1) == (1 << bits) - 1:
                x, y, z = (1 if axis == 0 else 0), (1 if axis == 1 else 0), (1 if axis == 2 else 0)
                other = step_node(blocks, i, x, y, z)
                theirs = node_label[other] if other >= 0 else -1
                if theirs >= 0 and not joined_before(i, other, axis, mine, theirs, bits, node_label):
                    join(node_label, i, other)


@formula
def joined_before(i, other, axis, mine, theirs, bits, node_label):
    """Whether a neighbour on the face, one step back along it, touches a node of the same labels across it.

    Other threads may lower labels meanwhile: a pair is then joined twice, or is one that is joined already.
    """
    for along in range(3 if bits == 2 else 2):
        if along != axis and (i >> (along * bits)) & ((1 << bits) - 1) > 0:
            step = 1 << (along * bits)
            if node_label[i - step] == mine and node_label[other - step] == theirs:
                return True
    return False


@cuda_formula
def add_members(first, node_label, members):
    """The last label of each node's chain, and the particles of each component, at its lowest node."""
    together = cuda.shared.array(1, np.int32)
    i = CELLS * cuda.blockIdx.x + cuda.threadIdx.x
    if cuda.threadIdx.x == 0:
        together[0] = 0
    root = lowest(node_label, i) if node_label[i] >= 0 else -1
    node_label[i] = root
    # the particles of the block's lowest component are added up first: inside the liquid that is all of them
    rank = np.int32(node_label.shape[0]) if root < 0 else np.int32(root)
    cuda.syncthreads()
    common = -largest_of_block(cuda.shared.array(CELLS, np.int32), -rank)
    held = first[i + 1] - first[i]
    if root >= 0 and held > 0:
        if root == common:
            cuda.atomic.add(together, 0, held)
        else:
            cuda.atomic.add(members, root, held)
    cuda.syncthreads()
    if cuda.threadIdx.x == 0 and together[0] > 0:
        cuda.atomic.add(members, common, together[0])


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="cut_total")
def first_cuts(blocks, crossings, cell_case, table, node_label, edge_first, facet_first, cut_total):
    """First vertex of each node's edges and first facet of each cell; and components that touch are joined."""
    part = cuda.shared.array(CELLS, np.int32)
    b = cuda.blockIdx.x
    i = CELLS * b + cuda.threadIdx.x
    mine = cut_count(int(crossings[i])) + (int(table.count[cell_case[i]]) << 16)
    before = sum_before(part, np.int32(mine))
    edge_first[i] = np.int32(cut_total[b] & 0xFFFFFFFF) + (before & 0xFFFF)
    facet_first[i] = np.int32(cut_total[b] >> 32) + (before >> 16)
    join_node(i, blocks, node_label)


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="cut_total")
def write_facets(blocks, cuts, counts, first, node_label, members, cut_total):
    """Vertices by their edges, facets by their vertices; and the particles of each component."""
    crossings, cell_case, edge_first, facet_first, table, vertex_edge, facets = cuts
    i = CELLS * cuda.blockIdx.x + cuda.threadIdx.x
    if counts[VERTICES] > 0:
        isosurface_kernels.write_facets(
            i, blocks, crossings, cell_case, edge_first, facet_first, table, vertex_edge, facets
        )
    add_members(first, node_label, members)
