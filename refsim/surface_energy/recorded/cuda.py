"""CUDA kernels of a reconstruction that the host does not accompany: how much there is of anything stands in `counts`.

They do what the registered programs do, several at a time, in arrays with room to spare. Where a particle stands in no
block, or the room does not suffice, nothing is made of vertices and facets, and the host sees why.
"""

import numpy as np

from refsim.backend import simulated
from refsim.compile import cuda, cuda_kernel, formula
from refsim.isosurface import node as isosurface_node
from refsim.neighbours.rows import lanes_mask
from refsim.sparse_grid.cuda import SUMMING
from refsim.sparse_grid.formulas import cell_coordinate, find_node_near, node_coordinates, step_node
from refsim.surface_energy import formulas, node
from refsim.surface_energy.cuda import lowest

LANES = 1 if simulated() else 8  # threads that share a vertex or a facet; the simulator knows no shuffles
CELLS = 64  # of a block, a thread to each
SWEEPING = 256  # threads of a block in a sweep: at least as many as there are cells, and 3 x 64, a layer of nodes' sums
STARTS = SWEEPING + 1
LAYERS = 3 * CELLS
REACHED = 512  # nodes that the points of a sweep reach: 8 x 8 x 8, or 12 x 12 in the plane
POINTS = 1024  # of a sweep in shared memory
# What `counts` holds: whether a particle is not covered, most particles in a cell, cut edges and facets as found and
# as made (0 where they do not fit), samples without a particle
MISSING, MOST, EDGES, FACETS, VERTICES, MADE, UNFOUND = range(7)
COUNTS = 8


@formula
def sum_before(part, mine):
    """Sum of `mine` over the threads of the block before this one; `part` is shared, one place for each thread."""
    thread = cuda.threadIdx.x
    part[thread] = mine
    cuda.syncthreads()
    reach = 1
    while reach < cuda.blockDim.x:
        other = part[thread - reach] if thread >= reach else 0
        cuda.syncthreads()
        part[thread] += other
        cuda.syncthreads()
        reach *= 2
    return part[thread] - mine


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


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="total")
def states_of_blocks(interior_position, cells, blocks, surface_term, node_state, node_label, total):
    """Algorithm 1, lines 5 to 9, and a first label: the block's lowest node where it is inside altogether."""
    b = cuda.blockIdx.x
    i = CELLS * b + cuda.threadIdx.x
    state = 0
    if occupied_near(cells.first, blocks, b, 0, blocks.neighbour.shape[1]):
        state = node.is_inside(i, interior_position, cells, blocks, surface_term)
    node_state[i] = state
    label = i if state == 1 else -1
    if cuda.syncthreads_and(state) != 0:
        label = CELLS * b
    node_label[i] = label


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="cut_total")
def classify_blocks(blocks, node_state, table, crossings, cell_case, cut_total):
    """Cut edges and corner states; vertices and 2^32 facets of each block."""
    part = cuda.shared.array(CELLS, np.int32)
    b, thread = cuda.blockIdx.x, cuda.threadIdx.x
    i = CELLS * b + thread
    bits, case = isosurface_node.classify(i, blocks, node_state)
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


@cuda_kernel(block_for_each_row=True, threads=SUMMING, rows_of="one")
def sum_cuts(one, cut_total, vertex_edge, facets, counts):
    """cut_total[b] <- those of the blocks before b; how many vertices and facets are made."""
    part = cuda.shared.array(SUMMING, np.int64)
    thread = cuda.threadIdx.x
    size = (cut_total.shape[0] + SUMMING - 1) // SUMMING
    begin, end = min(thread * size, cut_total.shape[0]), min(thread * size + size, cut_total.shape[0])
    own = np.int64(0)
    for b in range(begin, end):
        own += cut_total[b]
    before = sum_before(part, own)
    for b in range(begin, end):
        own = cut_total[b]
        cut_total[b] = before
        before += own
    if thread == SUMMING - 1:
        counts[EDGES], counts[FACETS] = before & 0xFFFFFFFF, before >> 32
        if counts[MISSING] == 0 and counts[EDGES] <= vertex_edge.shape[0] and counts[FACETS] <= facets.shape[0]:
            counts[VERTICES], counts[MADE] = counts[EDGES], counts[FACETS]


# Which nodes hang together is found beside vertices and facets: a launch costs as much as either.


@formula
def join_node(i, blocks, node_label):
    """Of two components that touch at node i, the one with the higher number joins the lower one (`join_labels`)."""
    if node_label[i] >= 0:
        for axis in range(3 if blocks.neighbour.shape[1] == 27 else 2):
            other = step_node(blocks, i, 1 if axis == 0 else 0, 1 if axis == 1 else 0, 1 if axis == 2 else 0)
            if other >= 0 and node_label[other] >= 0 and node_label[other] != node_label[i]:
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
        isosurface_node.write_facets(
            i, blocks, crossings, cell_case, edge_first, facet_first, table, vertex_edge, facets
        )
    add_members(first, node_label, members)


# A vertex or a facet is shared by LANES threads, which take cells by turns: what they look for, the farthest way out or
# the nearest particle, does not depend on the order.


@formula
def nearest_of_lanes(lane, i, x, y, z, interior_position, cells, blocks, surface_term):
    """What `node.nearest_particle` finds."""
    jx, jy, jz = node_coordinates(blocks, i)
    ox = formulas.grid_offset(x, jx, surface_term)
    oy = formulas.grid_offset(y, jy, surface_term)
    oz = formulas.grid_offset(z, jz, surface_term)
    space = blocks.neighbour.shape[1] == 27
    best = type(surface_term.cell_size)(4)
    found = -1
    for reach in range(1, 3):
        if best < type(best)(1):
            break
        width = 2 * reach + 1
        for m in range(lane, width * width * width if space else width * width, LANES):
            dx, dy, dz = m % width - reach, m // width % width - reach, m // (width * width) - reach if space else 0
            if reach == 2 and max(abs(dx), max(abs(dy), abs(dz))) < 2:
                continue
            cell = step_node(blocks, i, dx, dy, dz)
            if cell >= 0:
                best, found = node.nearer(
                    cell, best, found, ox, oy, oz, jx, jy, jz, interior_position, cells, surface_term
                )
        best, found = nearest_lane(lane, best, found)
    nx, ny, nz = node.away_from(found, best, ox, oy, oz, jx, jy, jz, interior_position, surface_term)
    return found, nx, ny, nz


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
    interior_position, cells, blocks, node_state, surface_term, vertex_edge, counts, vertex_position, outward
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
        for m in range(lane, 64 if space else 16, LANES):
            cell = step_node(blocks, i, (m & 3) - 2, ((m >> 2) & 3) - 2, (m >> 4) - 2 if space else 0)
            if cell >= 0:
                farthest = node.farthest_exit(
                    cell, farthest, interior_position, cells, jx, jy, jz, ax, ay, az, towards, surface_term
                )
        way = real(towards) * min(farthest_lane(lane, farthest), real(1))
        x = h * (real(jx) + real(ax) * way)
        y = h * (real(jy) + real(ay) * way)
        z = h * (real(jz) + real(az) * way)
        own = node_at(x, y, z, 0.0, i >> 6, blocks, surface_term)
        _, nx, ny, nz = nearest_of_lanes(lane, own, x, y, z, interior_position, cells, blocks, surface_term)
        if lane == 0:
            vertex_position[v, 0], vertex_position[v, 1], vertex_position[v, 2] = x, y, z
            outward[v, 0], outward[v, 1], outward[v, 2] = nx, ny, nz


@cuda_kernel(lanes=LANES, rows_of="facets")
def place_points(
    interior_position, cells, blocks, surface_term, vertex_edge, vertex_position, facets, counts, sample_place,
    facet_normal, outward, fit_position, fit_cell, fit_place, held_points,
):  # fmt: skip
    """One sample to a facet, its nearest particle, the points of the fit [m] and their cells."""
    s, lane = cuda.grid(1) // LANES, cuda.grid(1) % LANES
    samples = counts[MADE]
    if s < samples:
        x, y, z, _, fx, fy, fz = node.facet_sample(s, vertex_position, facets)
        guess = (vertex_edge[facets[s, 0]] // 3) >> 6
        own = node_at(x, y, z, 0.0, guess, blocks, surface_term)
        _, nx, ny, nz = nearest_of_lanes(lane, own, x, y, z, interior_position, cells, blocks, surface_term)
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


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="total")
def begin_fit(
    fit_splines, fit_first, fit_target, blocks, surface_term, node_weight, coefficients, corrected, total
):  # fmt: skip
    """(3.7): 1/sum_r B_i(x_r), 0 at a node that is hardly reached, and the first sweep from C = 0."""
    b = cuda.blockIdx.x
    i = CELLS * b + cuda.threadIdx.x
    real = type(surface_term.cell_size)
    weight, value = real(0), real(0)
    # a node is reached from cells up to two nodes below it: blocks below and its own, ways 0 to the middle
    if occupied_near(fit_first, blocks, b, 0, blocks.neighbour.shape[1] // 2 + 1):
        reached, change = gathered(i, fit_splines, fit_first, blocks, fit_target)
        if reached > real(formulas.LEAST_SUM):
            weight = real(1) / reached
            if surface_term.iterations > 0:
                value = surface_term.relaxation * weight * change
    node_weight[i] = weight
    coefficients[i] = value
    corrected[i] = value


@formula
def gathered(i, fit_splines, fit_first, blocks, fit_target):
    """(sum_r B_i(x_r), sum_r b_r B_i(x_r)) of node i, over the points of the cells that reach it."""
    zero = fit_target.dtype.type(0)
    reached, change = zero, zero
    space = blocks.neighbour.shape[1] == 27
    for kz in range(3 if space else 1):
        for ky in range(3):
            for kx in range(3):
                cell = step_node(blocks, i, -kx, -ky, -kz)
                if cell >= 0:
                    for r in range(fit_first[cell], fit_first[cell + 1]):
                        share = fit_splines[r, kx] * fit_splines[r, 3 + ky] * fit_splines[r, 6 + kz]
                        reached += share
                        change += fit_target[r] * share
    return reached, change


# A sweep: a block's nodes take the residuals of the points in reach, which take the coefficients in their own reach.
# A thread block finds all of it in shared memory: points of cells up to two below the block, nodes up to two beyond.


@formula
def sweep_residual(r, base, row, wide, layers, target, fit_splines, near):
    """b - B C of a point, in units of h; `base` is the lowest of its nodes among those in shared memory."""
    value = target
    for kz in range(layers):
        for ky in range(3):
            across = fit_splines[r, 3 + ky] * fit_splines[r, 6 + kz]
            for kx in range(3):
                value -= near[base + kx + row * ky + wide * kz] * (fit_splines[r, kx] * across)
    return value


@cuda_kernel(block_for_each_row=True, threads=SWEEPING, rows_of="total")
def sweep(fit_first, fit_splines, fit_target, blocks, surface_term, node_weight, coefficients, corrected, total):
    """C <- C + w Lambda B^T (b - B C) on a block's nodes."""
    b, thread = cuda.blockIdx.x, cuda.threadIdx.x
    zero = fit_target.dtype.type(0)
    active = 0
    if thread < CELLS and node_weight[CELLS * b + thread] > zero:
        active = 1
    if cuda.syncthreads_or(active) == 0:
        return
    near = cuda.shared.array(REACHED, fit_target.dtype)
    start = cuda.shared.array(STARTS, np.int32)
    point = cuda.shared.array(POINTS, np.int32)
    base = cuda.shared.array(POINTS, np.int32)
    residual = cuda.shared.array(POINTS, fit_target.dtype)
    layer = cuda.shared.array(LAYERS, fit_target.dtype)
    space = blocks.neighbour.shape[1] == 27
    bits = 2 if space else 3
    width, cells, layers = (8, 6, 3) if space else (12, 10, 1)
    wide, deep = width * width, cells * cells
    for n in range(thread, wide * width if space else wide, SWEEPING):
        j = step_node(blocks, CELLS * b, n % width - 2, n // width % width - 2, n // wide - 2 if space else 0)
        near[n] = coefficients[j] if j >= 0 else zero
    first, held, own = 0, 0, 0
    if thread < (deep * cells if space else deep):
        x, y, z = thread % cells, thread // cells % cells, thread // deep if space else 0
        own = x + width * y + wide * z
        cell = step_node(blocks, CELLS * b, x - 2, y - 2, z - 2 if space else 0)
        if cell >= 0:
            first = fit_first[cell]
            held = fit_first[cell + 1] - first
    before = sum_before(start, np.int32(held))
    cuda.syncthreads()
    start[thread] = before
    if thread == SWEEPING - 1:
        start[SWEEPING] = before + held
    for k in range(held):
        if before + k < POINTS:
            point[before + k], base[before + k] = first + k, own
    cuda.syncthreads()
    points = start[SWEEPING]
    for k in range(thread, min(points, POINTS), SWEEPING):
        r = point[k]
        residual[k] = sweep_residual(r, base[k], width, wide, layers, fit_target[r], fit_splines, near)
    cuda.syncthreads()
    node_place, kz = thread & 63, thread >> 6
    i = CELLS * b + node_place
    change = zero
    if kz < layers and node_weight[i] > zero:
        rest = (1 << bits) - 1
        x, y, z = node_place & rest, (node_place >> bits) & rest, node_place >> (2 * bits)
        for ky in range(3):
            for kx in range(3):
                at = x + 2 - kx + cells * (y + 2 - ky) + (deep * (z + 2 - kz) if space else 0)
                for k in range(start[at], start[at + 1]):
                    if k < POINTS:
                        r, value = point[k], residual[k]
                    else:  # no room in shared memory: found again by every node
                        cell = step_node(blocks, i, -kx, -ky, -kz)
                        r = fit_first[cell] + k - start[at]
                        own = at % cells + width * (at // cells % cells) + (wide * (at // deep) if space else 0)
                        value = sweep_residual(r, own, width, wide, layers, fit_target[r], fit_splines, near)
                    change += value * (fit_splines[r, kx] * fit_splines[r, 3 + ky] * fit_splines[r, 6 + kz])
    if kz < 3:
        layer[thread] = change
    cuda.syncthreads()
    if thread < CELLS and node_weight[i] > zero:
        change = layer[thread] + layer[CELLS + thread] + layer[2 * CELLS + thread]
        corrected[i] = coefficients[i] + surface_term.relaxation * node_weight[i] * change


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
    interior_position, cells, blocks, surface_term, vertex_edge, inset_position, facets, node_label, members, least,
    sample_position, sample_area, nearest, sample_count, counts,
):  # fmt: skip
    """The samples after the inset, their nearest particles, and areas, 0 on components too small to bear tension."""
    s, lane = cuda.grid(1) // LANES, cuda.grid(1) % LANES
    if s < counts[MADE]:
        x, y, z, area, _, _, _ = node.facet_sample(s, inset_position, facets)
        guess = (vertex_edge[facets[s, 0]] // 3) >> 6
        own = node_at(x, y, z, 0.0, guess, blocks, surface_term)
        p, _, _, _ = nearest_of_lanes(lane, own, x, y, z, interior_position, cells, blocks, surface_term)
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


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="total")
def pull_nodes(sample_position, sample_area, sample_normal, bases, blocks, surface_term, node_force, total):
    """(4.18*): force on the nodes [N]."""
    b = cuda.blockIdx.x
    i = CELLS * b + cuda.threadIdx.x
    real = type(surface_term.cell_size)
    fx, fy, fz = real(0), real(0), real(0)
    if occupied_near(bases.first, blocks, b, 0, blocks.neighbour.shape[1] // 2 + 1):
        fx, fy, fz = node.node_tension(i, sample_position, sample_area, sample_normal, bases, blocks, surface_term)
    node_force[i, 0], node_force[i, 1], node_force[i, 2] = fx, fy, fz
