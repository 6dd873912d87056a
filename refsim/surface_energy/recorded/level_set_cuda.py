"""States of nodes, vertices and facets, and components of inside nodes, a thread block to each block of nodes."""

import numpy as np

from refsim.backends.compile import cuda, cuda_formula, cuda_kernel, formula, row_kernel
from refsim.backends.primitives import four_of, largest_of_block, sum_before
from refsim.isosurface import kernels as isosurface_kernels
from refsim.sparse_grid.block_search_cuda import number
from refsim.sparse_grid.formulas import block_bits, step_node
from refsim.surface_energy.recorded.cells_cuda import (
    CELLS,
    EDGES,
    FACETS,
    MADE,
    MISSING,
    MOST,
    VERTICES,
    block_start,
    local_place,
    occupied_near,
    row_near,
)

CORNERS = 125  # nodes of a block's cells: 5 x 5 x 5, or 9 x 9 in the plane
SUMMED = CELLS  # blocks whose cuts are added up together
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
def inside_spheres(local, x0, x1, dy, dz, begin, end, placed, blocks, surface_term):
    """Algorithm 1, line 7, 1 or 0: whether a particle of a row of cells is nearer than r to a block's node.

    The cells are x0 to x1 along x and (dy, dz) away from the node; of cells that touch the sphere at most, only the
    middle ones are looked at.
    """
    space = block_bits(blocks) == 2
    x, y, z = local_place(local, block_bits(blocks))
    cy, cz = np.int32(y + dy), np.int32(z + dz)
    real = type(surface_term.cell_size)
    first, last = row_near(x, x0, x1, dy, dz, surface_term)
    row = number(2 + 7 * (cy + 2 + 7 * (cz + 2)) if space else 2 + 11 * (cy + 2))
    # from the node to the lowest node of the cells' block
    py, pz = real(block_start(cy, space) - y), real(block_start(cz, space) - z) if space else real(0)
    start = block_start(first, space)
    after = np.int32(start + (4 if space else 8))
    k, low, px = number(begin[row + first]), begin[row + min(after, last)], real(start - x)
    own = np.int32(end[row + min(last, np.int32(after - 1))] - begin[row + first])
    many = np.int32(own + (end[row + last] - low if last >= after else 0))
    for t in range(many):  # of both blocks in one loop, in which threads diverge less
        if t == own:
            k, px = number(low), real(after - x)
        ux, uy, uz, _ = four_of(placed, k)
        ux, uy, uz = px + ux, py + uy, pz + uz
        if ux * ux + uy * uy + uz * uz < surface_term.radius_squared:
            return 1
        k += 1
    return 0


@cuda_formula
def mark_nodes(state, placed, first, blocks, surface_term):
    """Algorithm 1, lines 5 to 9, of the nodes of a thread block's block: state <- 1 or 0.

    Every particle in a node's own cell is nearer than sqrt(dim) h: deep in the liquid that decides. Else cells that
    touch a node come first; then as many threads as there are undecided nodes, side by side, take the rows of cells
    around one each.
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
    for c in range(4 if space else 2):
        if own == 0:
            dy, dz = np.int32((c & 1) - 1), np.int32((c >> 1) - 1 if space else 0)
            own = inside_spheres(thread, -1, 0, dy, dz, begin, end, placed, blocks, surface_term)
    state[thread] = own
    if own == 0:
        waiting[cuda.atomic.add(many, 0, 1)] = thread  # their order changes no result
    cuda.syncthreads()
    if thread < many[0]:
        node = waiting[thread]
        for c in range(16 if space else 4):
            if state[node] == 0:
                dy, dz = np.int32((c & 3) - 2), np.int32((c >> 2) - 2 if space else 0)
                state[node] = inside_spheres(node, -2, 1, dy, dz, begin, end, placed, blocks, surface_term)
    cuda.syncthreads()


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="total")
def states_of_blocks(placed, cells, blocks, surface_term, node_state, node_label, counts, total):
    """Algorithm 1, lines 5 to 9, and first labels: the lowest node of each node's component within its block; most
    particles in a cell.

    Without `placed` the states are given, and only labels are written.
    """
    label = cuda.shared.array(CELLS, np.int32)
    b, thread = cuda.blockIdx.x, cuda.threadIdx.x
    i = CELLS * b + thread
    state = 0
    if placed is not None:
        if occupied_near(cells.first, blocks, b):
            most = largest_of_block(cuda.shared.array(CELLS, np.int32), cells.first[i + 1] - cells.first[i])
            if thread == 0 and most > counts[MOST]:
                cuda.atomic.max(counts, MOST, most)
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
    space = block_bits(blocks) == 2
    least = label[thread]
    for axis in range(3):
        if axis < 2 or space:
            shift, last = along_axis(axis, space)
            place = (thread >> shift) & last
            if place > 0:
                least = min(least, label[number(thread - (1 << shift))])
            if place < last:
                least = min(least, label[number(thread + (1 << shift))])
    return least


@formula
def along_axis(axis, space):
    """(bits below those that number a block's nodes along an axis, the last of these numbers), dimensionless."""
    return (2 * axis, 3) if space else (3 * axis, 7)


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="cut_total")
def classify_blocks(blocks, node_state, table, crossings, cell_case, cut_sum, cut_total):
    """Cut edges and corner states; vertices and 2^32 facets of each block, and of SUMMED blocks together."""
    part = cuda.shared.array(CELLS, np.int32)
    near = cuda.shared.array(CORNERS, np.int32)
    b, thread = cuda.blockIdx.x, cuda.threadIdx.x
    space = blocks.neighbour.shape[1] == 27
    width = 5 if space else 9
    for turn in range(2):
        c = np.uint32(min(thread + CELLS * turn, CORNERS - 1 if space else 80))
        row = c // np.uint32(5) if space else c // np.uint32(9)
        z = row // np.uint32(5) if space else np.uint32(0)
        x, y = np.int32(c - np.uint32(width) * row), np.int32(row - np.uint32(5) * z)
        near[number(c)] = isosurface_kernels.state_at(blocks, node_state, CELLS * b, x, y, np.int32(z))
    cuda.syncthreads()
    x, y, z = local_place(thread, 2 if space else 3)
    own = number(x + width * (y + width * z))
    state = near[own]
    bits, case = 0, state if state < 2 else -1
    for c in range(1, 8):
        if c < 4 or space:
            other = near[own + ((c & 1) + width * ((c >> 1) & 1) + 25 * (c >> 2))]
            bits, case = isosurface_kernels.with_corner(c, state, other, bits, case)
    i, case = number(CELLS * b + thread), max(case, 0)
    crossings[i], cell_case[i] = bits, case
    mine = cuts_of(bits, case, table)
    if cuda.syncthreads_or(mine) != 0:  # most blocks have none
        cut = np.int32(sum_before(part, mine) + mine)
        if thread == CELLS - 1:
            cut_total[b] = (np.int64(cut >> 16) << 32) | np.int64(cut & 0xFFFF)
            cuda.atomic.add(cut_sum, b // SUMMED, cut_total[b])
    elif thread == 0:
        cut_total[b] = 0


@formula
def cuts_of(bits, case, table):
    """Vertices and 2^16 facets of a node, int32, dimensionless."""
    return np.int32((bits & 1) + ((bits >> 1) & 1) + (bits >> 2) + (int(table.count[case]) << 16))


@cuda_formula
def sum_to(b, part, cut_sum, cut_total):
    """Vertices and 2^32 facets of the blocks before b; called by all threads."""
    own, group = np.int64(0), b // SUMMED
    for k in range(cuda.threadIdx.x, group, CELLS):
        own += cut_sum[k]
    at = SUMMED * group + cuda.threadIdx.x
    if at < b:
        own += cut_total[at]
    before = sum_before(part, own)
    cuda.syncthreads()
    if cuda.threadIdx.x == CELLS - 1:
        part[0] = before + own
    cuda.syncthreads()
    return part[0]


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="cut_total")
def first_cuts(cuts, table, firsts, vertex_edge, facets, counts, sent, cut_sum, cut_total):
    """First vertex of each node's edges, and first facet of each cell; how many there are, and how many are made.

    `vertex_edge` takes the edges of the vertices, `sent` takes what the host reads of the counts.
    """
    part = cuda.shared.array(CELLS, np.int32)
    wide = cuda.shared.array(CELLS, np.int64)
    b, thread, last = cuda.blockIdx.x, cuda.threadIdx.x, cut_total.shape[0] - 1
    i = CELLS * b + thread
    (crossings, cell_case), (edge_first, facet_first) = cuts, firsts
    mine = cuts_of(int(crossings[i]), int(cell_case[i]), table)
    if cuda.syncthreads_or(mine if b < last else 1) != 0:
        before, lower = sum_before(part, mine), sum_to(b, wide, cut_sum, cut_total)
        edge_first[i] = np.int32(lower & 0xFFFFFFFF) + (before & 0xFFFF)
        facet_first[i] = np.int32(lower >> 32) + (before >> 16)
        isosurface_kernels.write_edges(i, int(crossings[i]), edge_first[i], vertex_edge)
        if b == last and thread == 0:
            whole = lower + cut_total[b]
            counts[EDGES], counts[FACETS] = whole & 0xFFFFFFFF, whole >> 32
            if counts[MISSING] == 0 and counts[EDGES] <= vertex_edge.shape[0] and counts[FACETS] <= facets.shape[0]:
                counts[VERTICES], counts[MADE] = counts[EDGES], counts[FACETS]
            for k in range(sent.shape[0]):
                sent[k] = counts[k]


@row_kernel(rows_of="node_label")
def join_nodes(i, blocks, node_label):
    """Join the components that touch at a node across a face of its block, once for a pair of labels on the face."""
    mine, space = node_label[number(i)], block_bits(blocks) == 2
    if mine >= 0:
        for axis in range(3):
            shift, last = along_axis(axis, space)
            if (axis < 2 or space) and (i >> shift) & last == last:
                other = step_node(blocks, i, int(axis == 0), int(axis == 1), int(axis == 2))
                theirs = node_label[number(max(other, 0))] if other >= 0 else -1
                if theirs >= 0 and not joined_before(i, other, axis, mine, theirs, space, node_label):
                    join(node_label, i, other)


@formula
def joined_before(i, other, axis, mine, theirs, space, node_label):
    """Whether a neighbour on the face, one step back along it, touches a node of the same labels across it.

    Other threads may lower labels meanwhile: a pair is then joined twice, or is one that is joined already.
    """
    for along in range(3):
        shift, last = along_axis(along, space)
        if along != axis and (along < 2 or space) and (i >> shift) & last > 0:
            step = 1 << shift
            if node_label[number(i - step)] == mine and node_label[number(other - step)] == theirs:
                return True
    return False


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="cut_total")
def add_members(first, node_label, members, cut_total):
    """The last label of each node's chain, and the particles of each component, at its lowest node."""
    together = cuda.shared.array(1, np.int32)
    lowest_node = CELLS * cuda.blockIdx.x
    i = number(lowest_node + cuda.threadIdx.x)
    root = lowest(node_label, i) if node_label[i] >= 0 else -1
    node_label[i] = root
    # the particles of the block's lowest component are added together: inside the liquid that is all of them
    rank = np.int32(node_label.shape[0]) if root < 0 else np.int32(root)
    common = -largest_of_block(cuda.shared.array(CELLS, np.int32), -rank)
    if cuda.threadIdx.x == 0:
        together[0] = first[number(lowest_node + CELLS)] - first[number(lowest_node)]
    if cuda.syncthreads_and(1 if rank == common else 0) == 0:
        held = first[i + 1] - first[i]
        if rank != common and held > 0:
            cuda.atomic.sub(together, 0, held)
            if root >= 0:
                cuda.atomic.add(members, root, held)
        cuda.syncthreads()
    if cuda.threadIdx.x == 0 and together[0] > 0 and common < node_label.shape[0]:
        cuda.atomic.add(members, common, together[0])


@formula
def write_facets(i, blocks, cut_cells, counts, facets):
    """Facets of cell i by their vertices."""
    if i < cut_cells[0].shape[0] and counts[MADE] > 0:
        isosurface_kernels.write_facets(i, blocks, *cut_cells, facets)


@formula
def lowest(node_label, i):
    """Number (dimensionless) of the node at the end of i's chain of labels, i <- label[i]."""
    label = node_label[i]
    while label != i:
        i, label = label, node_label[label]
    return i


@formula
def shortened(node_label, i):
    """`lowest`, while nothing but joins changes labels: each node on the way takes the label of its label."""
    label = node_label[i]
    while label != i:
        after = node_label[label]
        if after != label:
            node_label[i] = after
        i, label = label, after
    return i


@cuda_formula
def join(node_label, i, other):
    """Join the components of two nodes: the label of the higher lowest node becomes the lower one.

    Labels only decrease, and a chain that another thread has just lengthened still leads into the same component. A
    join that finds its label changed is tried again from there.
    """
    own, met = shortened(node_label, i), shortened(node_label, other)
    while own != met:
        high, low = max(own, met), min(own, met)
        found = cuda.atomic.cas(node_label, high, high, low)
        if found == high:
            break
        own, met = shortened(node_label, found), shortened(node_label, low)
