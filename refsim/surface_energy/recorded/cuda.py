"""CUDA kernels of a reconstruction that the host does not accompany: how much there is of anything stands in `counts`.

They do what the registered programs do, several at a time, in arrays with room to spare. Where a particle stands in no
block, or the room does not suffice, nothing is made of vertices and facets, and the host sees why.
"""

import numpy as np

from refsim.backends.compile import cuda, cuda_kernel, formula
from refsim.backends.primitives import lanes_mask, sum_before, sum_of_lanes
from refsim.backends.runtime import simulated
from refsim.isosurface import kernels as isosurface_kernels
from refsim.sparse_grid.cuda import SUMMING
from refsim.sparse_grid.formulas import cell_coordinate, find_node_near, node_coordinates, step_node
from refsim.surface_energy import formulas, node
from refsim.surface_energy.cuda import lowest

LANES = 1 if simulated() else 8  # threads that share a vertex or a facet; the simulator knows no shuffles
CELLS = 64  # of a block, a thread to each
REACHING = 216  # cells that reach a block's nodes: 6 x 6 x 6, or 10 x 10 in the plane
CELL_BIT = 1 << 24  # counts a cell beside its points: 64 cells of fewer than 2^24 points together
FAR_ENOUGH = 1.0001  # a row of cells this much farther than a particle has none that is nearer, however it was rounded
WIDTH = 1 if simulated() else 32  # threads that share a cell, one for each of the 27 nodes that its points reach
OWN = 27 // WIDTH + (27 % WIDTH > 0)  # nodes of each thread
# What `counts` holds: whether a particle is not covered, most particles in a cell, cut edges and facets as found and
# as made (0 where they do not fit), samples without a particle, cells with a point of the fit or a sample
MISSING, MOST, EDGES, FACETS, VERTICES, MADE, UNFOUND, FILLED = range(8)
COUNTS = 8


@cuda_kernel(rows_of="held")
def clear(held, held_points, members, sample_count, counts):
    """Everything that is counted starts from zero."""
    i = cuda.grid(1)
    if i < held.shape[0]:
        held[i] = 0
        held_points[i] = 0
        members[i] = 0
        if i < counts.shape[0]:
            counts[i] = 0
        for p in range(i, sample_count.shape[0], held.shape[0]):
            sample_count[p] = 0


@formula
def node_at(x, y, z, shift, guess, blocks, surface_term):
    """Node of the cell j = floor(x/h - shift) with a place [m], -1 where no block holds it; block `guess` first."""
    jx = cell_coordinate(x, surface_term.inverse_cell, shift)
    jy = cell_coordinate(y, surface_term.inverse_cell, shift)
    jz = cell_coordinate(z, surface_term.inverse_cell, shift) if blocks.neighbour.shape[1] == 27 else 0
    return find_node_near(blocks, jx, jy, jz, guess)


@cuda_kernel(rows_of="cell")
def count_particles(interior_position, surface_term, blocks, sure, held, place, cell, counts):
    """Cell of each particle, looked for where it was, and how many of its cell were counted before it."""
    i = cuda.grid(1)
    if i < cell.shape[0]:
        x, y, z = interior_position[i, 0], interior_position[i, 1], interior_position[i, 2]
        found = node_at(x, y, z, 0.0, cell[i] >> 6, blocks, surface_term)
        cell[i] = found
        if found < 0 or sure[found >> 6] == 0:
            counts[MISSING] = 1
        if found >= 0:
            place[i] = cuda.atomic.add(held, found, 1)


@cuda_kernel(rows_of="cell")
def fill_particles(interior_position, cell, place, first, point, placed):
    """The particles of each cell, in any order, and their positions [m] side by side."""
    i = cuda.grid(1)
    if i < cell.shape[0] and cell[i] >= 0:
        at = first[cell[i]] + place[i]
        point[at] = i
        for c in range(3):
            placed[at, c] = interior_position[i, c]


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="total")
def total_blocks(held, counts, total):
    """Points of each block; the most in a cell, where that is asked for."""
    part = cuda.shared.array(CELLS, np.int32)
    thread = cuda.threadIdx.x
    mine = held[CELLS * cuda.blockIdx.x + thread]
    if counts is not None and mine > counts[MOST]:
        cuda.atomic.max(counts, MOST, mine)
    before = sum_before(part, mine)
    if thread == CELLS - 1:
        total[cuda.blockIdx.x] = before + mine


@formula
def occupied_near(first, blocks, b, lowest_way, ways):
    """Whether one of the blocks around b holds a point; the block's threads ask together."""
    thread = cuda.threadIdx.x
    found = 0
    if thread < ways:
        other = blocks.neighbour[b, lowest_way + thread]
        if other >= 0 and first[CELLS * other] != first[CELLS * other + CELLS]:
            found = 1
    return cuda.syncthreads_or(found) != 0


# Cells in a row along x of one block stand one after the other, and so do their particles.


@formula
def row_part(i, way, low, high, dy, dz, blocks, first):
    """(begin, end) of the particles of cells i + (dx, dy, dz), dx from low to high, of the block `way` along x."""
    width = 4 if blocks.neighbour.shape[1] == 27 else 8
    x = i & (width - 1)
    begin, end = max(x + low, width * way), min(x + high, width * way + width - 1)
    if begin > end:
        return 0, 0
    cell = step_node(blocks, i, begin - x, dy, dz)
    if cell < 0:
        return 0, 0
    return first[cell], first[cell + end - begin + 1]


@formula
def is_inside(i, placed, cells, blocks, surface_term):
    """What `node.is_inside` finds; the cells that touch the node come first here, too."""
    jx, jy, jz = node_coordinates(blocks, i)
    space = blocks.neighbour.shape[1] == 27
    for reach in range(1, 3):
        for dz in range(-reach if space else 0, reach if space else 1):
            for dy in range(-reach, reach):
                for way in range(-1, 2):
                    begin, end = row_part(i, way, -reach, reach - 1, dy, dz, blocks, cells.first)
                    for k in range(begin, end):
                        ux = formulas.grid_offset(placed[k, 0], jx, surface_term)
                        uy = formulas.grid_offset(placed[k, 1], jy, surface_term)
                        uz = formulas.grid_offset(placed[k, 2], jz, surface_term)
                        if ux * ux + uy * uy + uz * uz < surface_term.radius_squared:
                            return 1
    return 0


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="total")
def states_of_blocks(placed, cells, blocks, surface_term, node_state, node_label, total):
    """Algorithm 1, lines 5 to 9, and first labels: the lowest node that hangs together with each within its block."""
    label = cuda.shared.array(CELLS, np.int32)
    b, thread = cuda.blockIdx.x, cuda.threadIdx.x
    i = CELLS * b + thread
    state = 0
    if occupied_near(cells.first, blocks, b, 0, blocks.neighbour.shape[1]):
        state = is_inside(i, placed, cells, blocks, surface_term)
    node_state[i] = state
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
    """The lowest label of a block's node and those of the block beside it."""
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
    """Number of bits set of three."""
    return (bits & 1) + ((bits >> 1) & 1) + (bits >> 2)


@formula
def sum_pairs(part, total):
    """total[b] <- those of the blocks before b, by one thread block; the last thread gets all."""
    thread = cuda.threadIdx.x
    size = (total.shape[0] + SUMMING - 1) // SUMMING
    begin, end = min(thread * size, total.shape[0]), min(thread * size + size, total.shape[0])
    own = np.int64(0)
    for b in range(begin, end):
        own += total[b]
    before = sum_before(part, own)
    for b in range(begin, end):
        own = total[b]
        total[b] = before
        before += own
    return before


@cuda_kernel(block_for_each_row=True, threads=SUMMING, rows_of="one")
def sum_cuts(one, cut_total, vertex_edge, facets, counts):
    """cut_total[b] <- those of the blocks before b; how many vertices and facets are made."""
    part = cuda.shared.array(SUMMING, np.int64)
    before = sum_pairs(part, cut_total)
    if cuda.threadIdx.x == SUMMING - 1:
        counts[EDGES], counts[FACETS] = before & 0xFFFFFFFF, before >> 32
        if counts[MISSING] == 0 and counts[EDGES] <= vertex_edge.shape[0] and counts[FACETS] <= facets.shape[0]:
            counts[VERTICES], counts[MADE] = counts[EDGES], counts[FACETS]


# Which nodes hang together is found beside vertices and facets: a launch costs as much as either.


@formula
def join_node(i, blocks, node_label):
    """Of two components that touch at node i across the face of a block, the one with the higher number joins the
    lower one (`join_labels`); once for neighbours on the face that touch the same."""
    mine = node_label[i]
    if mine >= 0:
        bits = 2 if blocks.neighbour.shape[1] == 27 else 3
        for axis in range(3 if bits == 2 else 2):
            if (i >> (axis * bits)) & ((1 << bits) - 1) == (1 << bits) - 1:
                x, y, z = (1 if axis == 0 else 0), (1 if axis == 1 else 0), (1 if axis == 2 else 0)
                other = step_node(blocks, i, x, y, z)
                theirs = node_label[other] if other >= 0 else -1
                if theirs >= 0 and not joined_before(i, other, axis, mine, theirs, bits, node_label):
                    join_labels(node_label, i, other)


@formula
def joined_before(i, other, axis, mine, theirs, bits, node_label):
    """Whether a neighbour on the face, one step back along it, touches a node of the same labels across it.

    Labels may fall meanwhile: a pair is then joined twice, or was found equal to one that is joined.
    """
    for along in range(3 if bits == 2 else 2):
        if along != axis and (i >> (along * bits)) & ((1 << bits) - 1) > 0:
            step = 1 << (along * bits)
            if node_label[i - step] == mine and node_label[other - step] == theirs:
                return True
    return False


@formula
def join_labels(node_label, i, other):
    """Let the components of two nodes hang together (see `refsim.surface_energy.cuda.join_labels`)."""
    own, met = lowest(node_label, i), lowest(node_label, other)
    while own != met:
        high, low = max(own, met), min(own, met)
        found = cuda.atomic.cas(node_label, high, high, low)
        if found == high:
            break
        own, met = lowest(node_label, found), lowest(node_label, low)


@formula
def add_members(first, node_label, members):
    """The end of each label's chain, and the particles of each component, at its lowest node."""
    together = cuda.shared.array(1, np.int32)
    i = CELLS * cuda.blockIdx.x + cuda.threadIdx.x
    if cuda.threadIdx.x == 0:
        together[0] = 0
    root = lowest(node_label, i) if node_label[i] >= 0 else -1
    node_label[i] = root
    # those of the block's lowest component together: inside the liquid that is all of them
    rank = np.int32(node_label.shape[0]) if root < 0 else np.int32(root)
    cuda.syncthreads()
    common = least_of_all(rank)
    held = first[i + 1] - first[i]
    if root >= 0 and held > 0:
        if root == common:
            cuda.atomic.add(together, 0, held)
        else:
            cuda.atomic.add(members, root, held)
    cuda.syncthreads()
    if cuda.threadIdx.x == 0 and together[0] > 0:
        cuda.atomic.add(members, common, together[0])


@formula
def least_of_all(rank):
    """The lowest of what a block's threads hold."""
    held = cuda.shared.array(CELLS, np.int32)
    thread = cuda.threadIdx.x
    held[thread] = rank
    cuda.syncthreads()
    step = CELLS // 2
    while step > 0:
        if thread < step:
            held[thread] = min(held[thread], held[thread + step])
        cuda.syncthreads()
        step //= 2
    return held[0]


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="cut_total")
def first_cuts(blocks, crossings, cell_case, table, node_label, edge_first, facet_first, cut_total):
    """First vertex of each node's edges and first facet of each cell; and inside nodes that touch are joined."""
    part = cuda.shared.array(CELLS, np.int32)
    b = cuda.blockIdx.x
    i = CELLS * b + cuda.threadIdx.x
    mine = cut_count(int(crossings[i])) + (int(table.count[cell_case[i]]) << 16)
    before = sum_before(part, np.int32(mine))
    edge_first[i] = np.int32(cut_total[b] & 0xFFFFFFFF) + (before & 0xFFFF)
    facet_first[i] = np.int32(cut_total[b] >> 32) + (before >> 16)
    join_node(i, blocks, node_label)


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="cut_total")
def write_facets(
    blocks, crossings, cell_case, edge_first, facet_first, table, counts, vertex_edge, facets, first, node_label,
    members, cut_total,
):  # fmt: skip
    """Vertices by their edges, facets by their vertices; and the particles of each component."""
    i = CELLS * cuda.blockIdx.x + cuda.threadIdx.x
    if counts[VERTICES] > 0:
        isosurface_kernels.write_facets(
            i, blocks, crossings, cell_case, edge_first, facet_first, table, vertex_edge, facets
        )
    add_members(first, node_label, members)


# A vertex or a facet is shared by LANES threads, which take cells by turns: what they look for, the farthest way out or
# the nearest particle, does not depend on the order.


@formula
def nearest_of_lanes(lane, i, x, y, z, interior_position, placed, cells, blocks, surface_term):
    """What `node.nearest_particle` finds."""
    jx, jy, jz = node_coordinates(blocks, i)
    ox = formulas.grid_offset(x, jx, surface_term)
    oy = formulas.grid_offset(y, jy, surface_term)
    oz = formulas.grid_offset(z, jz, surface_term)
    space = blocks.neighbour.shape[1] == 27
    real = type(surface_term.cell_size)
    best = real(4)
    found = -1
    for reach in range(1, 3):
        if best < real(1):
            break
        for m in range(lane, parts_of_rows(2 * reach + 1, space), LANES):
            way, dy, dz = part_of_row(m, 2 * reach + 1)
            dy, dz = dy - reach, dz - reach if space else 0
            across, beyond = gap(oy, dy), gap(oz, dz) if space else real(0)
            if across * across + beyond * beyond <= FAR_ENOUGH * float(best):
                begin, end = row_part(i, way, -reach, reach, dy, dz, blocks, cells.first)
                for k in range(begin, end):
                    ux = ox - formulas.grid_offset(placed[k, 0], jx, surface_term)
                    uy = oy - formulas.grid_offset(placed[k, 1], jy, surface_term)
                    uz = oz - formulas.grid_offset(placed[k, 2], jz, surface_term)
                    squared = ux * ux + uy * uy + uz * uz
                    if squared < best or (squared == best and cells.point[k] < found):
                        best, found = squared, cells.point[k]
        best, found = nearest_lane(lane, best, found)
    nx, ny, nz = node.away_from(found, best, ox, oy, oz, jx, jy, jz, interior_position, surface_term)
    return found, nx, ny, nz


@formula
def parts_of_rows(width, space):
    """Rows along x of a square of so many, or of a line in the plane, each in three blocks."""
    return 3 * width * width if space else 3 * width


@formula
def part_of_row(m, width):
    """(way along x in blocks, place along y, place along z) of the m-th part; constants divide fast."""
    row = np.uint32(m) // np.uint32(3)
    way = np.int32(np.uint32(m) - np.uint32(3) * row) - 1
    z = row // np.uint32(3)
    if width == 4:
        z = row // np.uint32(4)
    elif width == 5:
        z = row // np.uint32(5)
    return way, np.int32(row - np.uint32(width) * z), np.int32(z)


@formula
def gap(o, d):
    """Distance [h] of place o, from 0 to 1, from the row of cells d away."""
    real = type(o)
    if d > 0:
        return real(d) - o
    return o - real(d + 1) if d < 0 else real(0)


@formula
def nearest_lane(lane, best, found):
    """The nearest of what the lanes have found; of equally near particles the lowest number."""
    if LANES > 1:
        mask = lanes_mask(lane, LANES)
        step = 1
        while step < LANES:
            squared, other = cuda.shfl_xor_sync(mask, best, step), cuda.shfl_xor_sync(mask, found, step)
            if squared < best or (squared == best and other < found):
                best, found = squared, other
            step *= 2
    return best, found


@formula
def farthest_lane(lane, farthest):
    """The largest of what the lanes have found."""
    if LANES > 1:
        mask = lanes_mask(lane, LANES)
        step = 1
        while step < LANES:
            farthest = max(farthest, cuda.shfl_xor_sync(mask, farthest, step))
            step *= 2
    return farthest


@cuda_kernel(lanes=LANES, rows_of="vertex_edge")
def place_vertices(
    interior_position, placed, cells, blocks, node_state, surface_term, vertex_edge, counts, vertex_position, outward
):
    """Algorithm 1, lines 10 to 17: vertices on the union of spheres [m], and directions away from the liquid."""
    v, lane = cuda.grid(1) // LANES, cuda.grid(1) % LANES
    if v < counts[VERTICES]:
        h = surface_term.cell_size
        real = type(h)
        i = vertex_edge[v] // 3
        axis = vertex_edge[v] - 3 * i
        ax, ay, az = int(axis == 0), int(axis == 1), int(axis == 2)
        towards = 1
        if node_state[i] != 1:
            i = step_node(blocks, i, ax, ay, az)
            towards = -1
        jx, jy, jz = node_coordinates(blocks, i)
        space = blocks.neighbour.shape[1] == 27
        farthest = real(0)
        for m in range(lane, parts_of_rows(4, space), LANES):
            part, dy, dz = part_of_row(m, 4)
            begin, end = row_part(i, part, -2, 1, dy - 2, dz - 2 if space else 0, blocks, cells.first)
            for k in range(begin, end):
                ux = formulas.grid_offset(placed[k, 0], jx, surface_term)
                uy = formulas.grid_offset(placed[k, 1], jy, surface_term)
                uz = formulas.grid_offset(placed[k, 2], jz, surface_term)
                farthest = node.farther_exit(farthest, ux, uy, uz, ax, ay, az, towards, surface_term)
        way = real(towards) * min(farthest_lane(lane, farthest), real(1))
        x = h * (real(jx) + real(ax) * way)
        y = h * (real(jy) + real(ay) * way)
        z = h * (real(jz) + real(az) * way)
        own = node_at(x, y, z, 0.0, i >> 6, blocks, surface_term)
        _, nx, ny, nz = nearest_of_lanes(lane, own, x, y, z, interior_position, placed, cells, blocks, surface_term)
        if lane == 0:
            vertex_position[v, 0], vertex_position[v, 1], vertex_position[v, 2] = x, y, z
            outward[v, 0], outward[v, 1], outward[v, 2] = nx, ny, nz


@cuda_kernel(lanes=LANES, rows_of="facets")
def place_points(
    interior_position, placed, cells, blocks, surface_term, vertex_edge, vertex_position, facets, counts, sample_place,
    facet_normal, outward, fit_position, fit_cell, fit_place, held_points,
):  # fmt: skip
    """One sample to a facet, its nearest particle, the points of the fit [m] and their cells."""
    s, lane = cuda.grid(1) // LANES, cuda.grid(1) % LANES
    samples = counts[MADE]
    if s < samples:
        x, y, z, _, fx, fy, fz = node.facet_sample(s, vertex_position, facets)
        guess = (vertex_edge[facets[s, 0]] // 3) >> 6
        own = node_at(x, y, z, 0.0, guess, blocks, surface_term)
        _, nx, ny, nz = nearest_of_lanes(lane, own, x, y, z, interior_position, placed, cells, blocks, surface_term)
        for k in range(lane, 2, LANES):
            r = s
            if k == 0:
                sample_place[s, 0], sample_place[s, 1], sample_place[s, 2] = x, y, z
                facet_normal[s, 0], facet_normal[s, 1], facet_normal[s, 2] = fx, fy, fz
                outward[s, 0], outward[s, 1], outward[s, 2] = nx, ny, nz
            else:
                r = samples + s
                way = surface_term.offset * surface_term.cell_size
                x, y, z = x + way * nx, y + way * ny, z + way * nz
            fit_position[r, 0], fit_position[r, 1], fit_position[r, 2] = x, y, z
            cell = node_at(x, y, z, 0.5, own >> 6, blocks, surface_term)
            fit_cell[r] = cell
            if cell >= 0:
                fit_place[r] = cuda.atomic.add(held_points, cell, 1)


@cuda_kernel(rows_of="fit_cell")
def fill_points(fit_cell, fit_place, fit_first, counts, unsorted):
    """The fit's points of each cell, in any order."""
    r = cuda.grid(1)
    if r < 2 * counts[MADE] and fit_cell[r] >= 0:
        unsorted[fit_first[fit_cell[r]] + fit_place[r]] = r


@formula
def place_in_row(r, cell, first, unsorted):
    """Where point r stands among the points of its cell, by their numbers."""
    at = first[cell]
    for k in range(first[cell], first[cell + 1]):
        if unsorted[k] < r:
            at += 1
    return at


@cuda_kernel(rows_of="fit_cell")
def sort_points(
    fit_position, fit_cell, fit_first, unsorted, blocks, surface_term, counts, fit_splines, fit_target
):  # fmt: skip
    """Splines of the fit's points, cell by cell, and b [h]: 0 at the samples, epsilon at their second points."""
    r = cuda.grid(1)
    if r < 2 * counts[MADE] and fit_cell[r] >= 0:
        at = place_in_row(r, fit_cell[r], fit_first, unsorted)
        real = type(surface_term.cell_size)
        fx, fy, fz = node.place_fractions(r, fit_position, fit_cell[r], blocks, surface_term)
        space = blocks.neighbour.shape[1] == 27
        for k in range(3):
            fit_splines[at, k] = formulas.spline_weight(fx, k)
            fit_splines[at, 3 + k] = formulas.spline_weight(fy, k)
            fit_splines[at, 6 + k] = formulas.spline_weight(fz, k) if space else real(k == 0)
        fit_target[at] = surface_term.offset if r >= counts[MADE] else real(0)


# Sums over points on nodes: first over the points of each cell, for the nodes that these reach, a thread for each; then
# over the cells that reach a node. Cells with points are numbered, so that nothing else is looked at.


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="pair_total")
def total_points(held, pair_total):
    """Points and 2^32 cells with points of each block."""
    part = cuda.shared.array(CELLS, np.int32)
    thread = cuda.threadIdx.x
    mine = held[CELLS * cuda.blockIdx.x + thread]
    mine += CELL_BIT if mine > 0 else 0
    before = sum_before(part, np.int32(mine))
    if thread == CELLS - 1:
        pair_total[cuda.blockIdx.x] = unpacked(before + mine)


@formula
def unpacked(pair):
    """Points and 2^32 cells out of 32 bits."""
    return (np.int64(pair >> 24) << 32) | np.int64(pair & (CELL_BIT - 1))


@cuda_kernel(block_for_each_row=True, threads=SUMMING, rows_of="one")
def sum_points(one, pair_total, counts):
    """pair_total[b] <- those of the blocks before b; how many cells have points."""
    part = cuda.shared.array(SUMMING, np.int64)
    before = sum_pairs(part, pair_total)
    if cuda.threadIdx.x == SUMMING - 1:
        counts[FILLED] = before >> 32


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="pair_total")
def first_points(held, first, rank, filled, pair_total):
    """First point of each cell; the number of each cell with points, -1 for the others."""
    part = cuda.shared.array(CELLS, np.int32)
    i = CELLS * cuda.blockIdx.x + cuda.threadIdx.x
    mine = held[i]
    before = unpacked(sum_before(part, np.int32(mine + (CELL_BIT if mine > 0 else 0))))
    before += pair_total[cuda.blockIdx.x]
    first[i] = before & 0xFFFFFFFF
    rank[i] = -1
    if mine > 0:
        rank[i] = before >> 32
        filled[before >> 32] = i
    if i == first.shape[0] - 2:
        first[i + 1] = (before & 0xFFFFFFFF) + mine


@cuda_kernel(lanes=WIDTH, rows_of="warps")
def sum_fit(fit_first, fit_splines, fit_target, filled, blocks, coefficients, counts, reached, change, warps):
    """Of each cell's points, for each node k that they reach: sum of B_k, and of (b - B C) B_k in units of h.

    Without `coefficients` C is 0; the first of the sums is left out where `reached` is.
    """
    warp, lane = cuda.grid(1) // WIDTH, cuda.grid(1) % WIDTH
    zero = fit_target.dtype.type(0)
    terms = 27 if blocks.neighbour.shape[1] == 27 else 9
    c = cuda.local.array(OWN, fit_target.dtype)
    share = cuda.local.array(OWN, fit_target.dtype)
    total = cuda.local.array(OWN, fit_target.dtype)
    changed = cuda.local.array(OWN, fit_target.dtype)
    for n in range(warp, counts[FILLED], warps.shape[0]):
        cell = filled[n]
        for m in range(OWN):
            k = lane + m * WIDTH
            c[m], share[m], total[m], changed[m] = zero, zero, zero, zero
            if coefficients is not None and k < terms:
                j = step_node(blocks, cell, k % 3, k // 3 % 3, k // 9)
                if j >= 0:
                    c[m] = coefficients[j]
        for r in range(fit_first[cell], fit_first[cell + 1]):
            fitted = zero
            for m in range(OWN):
                k = lane + m * WIDTH
                if k < terms:
                    share[m] = fit_splines[r, k % 3] * fit_splines[r, 3 + k // 3 % 3] * fit_splines[r, 6 + k // 9]
                    fitted += c[m] * share[m]
            residual = fit_target[r]
            if coefficients is not None:
                residual -= sum_of_lanes(fitted, lane, WIDTH)
            for m in range(OWN):
                total[m] += share[m]
                changed[m] += residual * share[m]
        for m in range(OWN):
            k = lane + m * WIDTH
            if k < terms:
                change[n, k] = changed[m]
                if reached is not None:
                    reached[n, k] = total[m]


@formula
def load_ranks(b, rank, blocks, near):
    """near[c]: numbers of the cells that reach the nodes of block b: of its own and of those up to two below."""
    space = blocks.neighbour.shape[1] == 27
    for c in range(cuda.threadIdx.x, 216 if space else 100, CELLS):
        at = np.uint32(c)
        if space:
            z = at // np.uint32(36)
            y = (at - np.uint32(36) * z) // np.uint32(6)
            x = at - np.uint32(36) * z - np.uint32(6) * y
        else:
            z, y = np.uint32(2), at // np.uint32(10)
            x = at - np.uint32(10) * y
        cell = step_node(blocks, CELLS * b, np.int32(x) - 2, np.int32(y) - 2, np.int32(z) - 2)
        near[c] = rank[cell] if cell >= 0 else -1
    cuda.syncthreads()


@formula
def sum_around(near, blocks, first_column, columns, sums):
    """Sum, for a thread's node, of what the cells hold for it from which it is the k-th in reach."""
    space = blocks.neighbour.shape[1] == 27
    bits, width = (2, 6) if space else (3, 10)
    rest = (1 << bits) - 1
    thread = cuda.threadIdx.x
    own = (thread & rest) + 2 + width * (((thread >> bits) & rest) + 2)
    if space:
        own += 36 * ((thread >> 4) + 2)
    total = sums.dtype.type(0)
    for kz in range(3):
        if kz == 0 or space:
            for ky in range(3):
                for kx in range(3):
                    n = near[own - kx - width * ky - 36 * kz]
                    if n >= 0:
                        total += sums[n, columns * (kx + 3 * ky + 9 * kz) + first_column]
    return total


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="total")
def begin_fit(fit_first, rank, blocks, reached, change, surface_term, node_weight, coefficients, total):
    """(3.7): 1/sum_r B_i(x_r), 0 at a node that is hardly reached, and the first sweep from C = 0."""
    b = cuda.blockIdx.x
    i = CELLS * b + cuda.threadIdx.x
    near = cuda.shared.array(REACHING, np.int32)
    real = type(surface_term.cell_size)
    weight, value = real(0), real(0)
    # blocks below and its own, ways 0 to the middle, reach a block's nodes
    if occupied_near(fit_first, blocks, b, 0, blocks.neighbour.shape[1] // 2 + 1):
        load_ranks(b, rank, blocks, near)
        whole = sum_around(near, blocks, 0, 1, reached)
        if whole > real(formulas.LEAST_SUM):
            weight = real(1) / whole
            if surface_term.iterations > 0:
                value = surface_term.relaxation * weight * sum_around(near, blocks, 0, 1, change)
    node_weight[i] = weight
    coefficients[i] = value


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="total")
def correct(rank, blocks, change, surface_term, node_weight, coefficients, total):
    """C <- C + w Lambda B^T (b - B C)."""
    b = cuda.blockIdx.x
    i = CELLS * b + cuda.threadIdx.x
    near = cuda.shared.array(REACHING, np.int32)
    weight = node_weight[i]
    if cuda.syncthreads_or(1 if weight > type(weight)(0) else 0) != 0:
        load_ranks(b, rank, blocks, near)
        if weight > type(weight)(0):
            coefficients[i] += surface_term.relaxation * weight * sum_around(near, blocks, 0, 1, change)


@formula
def implicit_gradient(q, place, guess, blocks, surface_term, coefficients, outward, mls, normal):
    """Unit normal of the implicit surface at place q, (3.17), or without `mls` (3.9)."""
    base = node_at(place[q, 0], place[q, 1], place[q, 2], 0.5, guess, blocks, surface_term)
    real = type(surface_term.cell_size)
    gx, gy, gz = real(0), real(0), real(0)
    if base >= 0:
        if mls is not None:
            _, gx, gy, gz = node.mls_gradient_at(q, place, base, blocks, surface_term, coefficients)
        else:
            _, gx, gy, gz = node.spline_gradient_at(q, place, base, blocks, surface_term, coefficients)
    nx, ny, nz = node.oriented_normal(gx, gy, gz, outward[q, 0], outward[q, 1], outward[q, 2])
    normal[q, 0], normal[q, 1], normal[q, 2] = nx, ny, nz


@cuda_kernel(rows_of="either")
def find_normals(
    sample_place, sample_outward, vertex_position, vertex_outward, vertex_edge, facets, blocks, surface_term,
    coefficients, mls, counts, either, sample_normal, vertex_normal, inset_position,
):  # fmt: skip
    """Normals of the implicit surface at samples and vertices, and vertices moved back to the liquid's surface [m].

    Threads as many as there is room for facets take samples, the others vertices.
    """
    s = cuda.grid(1)
    v = s - facets.shape[0]
    if s < counts[MADE]:
        guess = (vertex_edge[facets[s, 0]] // 3) >> 6
        implicit_gradient(
            s, sample_place, guess, blocks, surface_term, coefficients, sample_outward, mls, sample_normal
        )
    elif 0 <= v < counts[VERTICES]:
        guess = (vertex_edge[v] // 3) >> 6
        implicit_gradient(
            v, vertex_position, guess, blocks, surface_term, coefficients, vertex_outward, mls, vertex_normal
        )
        way = surface_term.inset * surface_term.cell_size
        for c in range(3):
            inset_position[v, c] = vertex_position[v, c] - way * vertex_normal[v, c]


@cuda_kernel(lanes=LANES, rows_of="facets")
def place_samples(
    interior_position, placed, cells, blocks, surface_term, vertex_edge, inset_position, facets, node_label, members,
    least, sample_position, sample_area, nearest, sample_count, counts,
):  # fmt: skip
    """The samples after the inset, their nearest particles, and areas, 0 on components too small to bear tension."""
    s, lane = cuda.grid(1) // LANES, cuda.grid(1) % LANES
    if s < counts[MADE]:
        x, y, z, area, _, _, _ = node.facet_sample(s, inset_position, facets)
        guess = (vertex_edge[facets[s, 0]] // 3) >> 6
        own = node_at(x, y, z, 0.0, guess, blocks, surface_term)
        p, _, _, _ = nearest_of_lanes(lane, own, x, y, z, interior_position, placed, cells, blocks, surface_term)
        if lane == 0:
            bears = False
            if p < 0:
                counts[UNFOUND] = 1
            else:
                cuda.atomic.add(sample_count, p, 1)
                label = node_label[cells.cell[p]]
                bears = label >= 0 and members[label] >= least
            sample_position[s, 0], sample_position[s, 1], sample_position[s, 2] = x, y, z
            sample_area[s] = area if bears else type(area)(0)
            nearest[s] = p


# The force on the nodes of the same blocks


@cuda_kernel(rows_of="held")
def clear_samples(held):
    """Counters start from zero."""
    i = cuda.grid(1)
    if i < held.shape[0]:
        held[i] = 0


@cuda_kernel(rows_of="facets")
def locate_samples(
    sample_position, vertex_edge, facets, blocks, surface_term, counts, held, sample_place, sample_cell
):  # fmt: skip
    """Cell of each sample, and how many of its cell were counted before it."""
    s = cuda.grid(1)
    if s < counts[MADE]:
        guess = (vertex_edge[facets[s, 0]] // 3) >> 6
        x, y, z = sample_position[s, 0], sample_position[s, 1], sample_position[s, 2]
        cell = node_at(x, y, z, 0.5, guess, blocks, surface_term)
        sample_cell[s] = cell
        if cell >= 0:
            sample_place[s] = cuda.atomic.add(held, cell, 1)


@cuda_kernel(rows_of="sample_cell")
def fill_samples(sample_cell, sample_place, first, counts, unsorted):
    """The samples of each cell, in any order."""
    s = cuda.grid(1)
    if s < counts[MADE] and sample_cell[s] >= 0:
        unsorted[first[sample_cell[s]] + sample_place[s]] = s


@cuda_kernel(rows_of="sample_cell")
def sort_samples(sample_cell, first, unsorted, counts, point):
    """The samples of each cell by their numbers."""
    s = cuda.grid(1)
    if s < counts[MADE] and sample_cell[s] >= 0:
        point[place_in_row(s, sample_cell[s], first, unsorted)] = s


@cuda_kernel(lanes=WIDTH, rows_of="warps")
def sum_pulls(
    sample_position, sample_area, sample_normal, first, point, filled, counts, blocks, surface_term, pulls, warps
):  # fmt: skip
    """(4.18*): sum of A_s (I - n n^T) h grad B_k(x_s) of each cell's samples, for each node k that they reach."""
    warp, lane = cuda.grid(1) // WIDTH, cuda.grid(1) % WIDTH
    real = type(surface_term.cell_size)
    space = blocks.neighbour.shape[1] == 27
    for n in range(warp, counts[FILLED], warps.shape[0]):
        cell = filled[n]
        jx, jy, jz = node_coordinates(blocks, cell)
        for k in range(lane, 27 if space else 9, WIDTH):
            kx, ky, kz = k % 3, k // 3 % 3, k // 9
            tx, ty, tz = real(0), real(0), real(0)
            for at in range(first[cell], first[cell + 1]):
                s = point[at]
                fx = formulas.grid_offset(sample_position[s, 0], jx, surface_term)
                fy = formulas.grid_offset(sample_position[s, 1], jy, surface_term)
                wx, wy, wz = formulas.spline_weight(fx, kx), formulas.spline_weight(fy, ky), real(1)
                sx, sy, sz = formulas.spline_slope(fx, kx), formulas.spline_slope(fy, ky), real(0)
                if space:
                    fz = formulas.grid_offset(sample_position[s, 2], jz, surface_term)
                    wz, sz = formulas.spline_weight(fz, kz), formulas.spline_slope(fz, kz)
                ux, uy, uz = formulas.tangential(
                    sample_normal[s, 0], sample_normal[s, 1], sample_normal[s, 2],
                    sx * wy * wz, wx * sy * wz, wx * wy * sz,
                )  # fmt: skip
                area = sample_area[s]
                tx += area * ux
                ty += area * uy
                tz += area * uz
            pulls[n, 3 * k], pulls[n, 3 * k + 1], pulls[n, 3 * k + 2] = tx, ty, tz


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="total")
def pull_nodes(first, rank, blocks, pulls, surface_term, node_force, total):
    """(4.18*): force on the nodes [N], -k sum_s A_s (I - n n^T) grad B_i(x_s)."""
    b = cuda.blockIdx.x
    i = CELLS * b + cuda.threadIdx.x
    real = type(surface_term.cell_size)
    near = cuda.shared.array(REACHING, np.int32)
    tx, ty, tz = real(0), real(0), real(0)
    if occupied_near(first, blocks, b, 0, blocks.neighbour.shape[1] // 2 + 1):
        load_ranks(b, rank, blocks, near)
        tx = sum_around(near, blocks, 0, 3, pulls)
        ty = sum_around(near, blocks, 1, 3, pulls)
        tz = sum_around(near, blocks, 2, 3, pulls)
    strength = -surface_term.tension / surface_term.cell_size
    node_force[i, 0], node_force[i, 1], node_force[i, 2] = strength * tx, strength * ty, strength * tz
