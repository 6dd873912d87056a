"""Vertices, samples and their nearest particles, normals, and the surface after the inset.

A vertex or a facet is shared by a few threads. What they look for, the farthest exit or the nearest particle, does not
depend on the order: of equally near particles the one with the lowest number is taken, as `kernels.offsets` does. A
search begins with the nearest particle of a vertex or a sample close by.
"""

import math
from collections import namedtuple

import numpy as np

from refsim.backends.compile import cuda, cuda_formula, cuda_kernel, formula
from refsim.backends.primitives import across_lanes, four_of
from refsim.backends.runtime import simulated
from refsim.backends.tuples import added, difference, dot, put, scaled, three
from refsim.sparse_grid.block_search_cuda import number
from refsim.sparse_grid.formulas import block_bits, node_coordinates, step_node
from refsim.surface_energy import formulas, kernels
from refsim.surface_energy.recorded.cells_cuda import (
    CELLS,
    MADE,
    UNFOUND,
    VERTICES,
    block_start,
    count_point,
    local_place,
    node_at,
    row_near,
    row_parts,
)
from refsim.surface_energy.recorded.level_set_cuda import write_facets

LANES = 2  # for a nearest particle
EXIT_LANES = 2 if simulated() else 8  # for a vertex
MARGIN = formulas.EQUALLY_NEAR  # [h] by which a row of cells must be farther to have no particle as near


# The particles of the liquid, sorted by cell; `placed` [h] in their blocks, cell by cell
Spheres = namedtuple("Spheres", "position number placed cells")
# Vertices of the surface, samples, one to a facet, and points of the fit, by the names of their work arrays;
# vertex_centre is the particle whose sphere a vertex is on
Vertices = namedtuple("Vertices", "vertex_position vertex_centre vertex_outward vertex_normal inset_position")
Samples = namedtuple("Samples", "sample_place nearest facet_normal outward sample_normal sample_position sample_area")
FitPoints = namedtuple("FitPoints", "fit_position fit_cell fit_place held_points")
# Labels of the nodes' components, particles of each, and the least number of a component with tension
Components = namedtuple("Components", "node_label members least")


@cuda_formula
def nearest_of_lanes(lane, i, x, seed, spheres, blocks, surface_term):
    """(nearest particle, unit vector away from it) of a position x [m] in cell i, as `kernels.offsets` finds them.

    `seed` is a particle that may be the nearest, or -1; each lane may have another one. The lanes take the rows of
    cells by turns, and look at those that reach nearer than the nearest particle so far. Each keeps the particle of the
    lowest number among those as near as the nearest; where it has lost it to a nearer one, but others are as near as
    that, a second round looks for it.
    """
    b = i >> 6
    space = block_bits(blocks) == 2
    real = type(surface_term.cell_size)
    cells, placed = spheres.cells, spheres.placed
    j = node_coordinates(blocks, CELLS * b)
    ox, oy, oz = formulas.offsets_over(x, j, surface_term)
    best = real(formulas.REACH * formulas.REACH)
    found = np.int32(-1)
    if seed >= 0:
        u = difference((ox, oy, oz), formulas.place_over(spheres.position, seed, j, surface_term))
        squared = dot(u, u)
        if squared < best:
            best, found = squared, np.int32(seed)
    distance = best  # squared [h^2], of the particle found; `best` is that of the nearest
    limit = formulas.equally_near(least_of_lanes(lane, best))
    ix, iy, iz = local_place(i, block_bits(blocks))
    lost = 0
    for turn in range(2):
        reach = math.sqrt(limit) + real(MARGIN)
        farthest_row = reach * reach
        y0, y1 = cells_within(oy, reach, iy)
        z0, z1 = np.int32(0), np.int32(0)
        if space:
            z0, z1 = cells_within(oz, reach, iz)
        cy, cz = np.int32(y0 + lane), z0
        while cz <= z1:
            if cy > y1:
                cy, cz = np.int32(cy - (y1 - y0 + 1)), np.int32(cz + 1)
                continue
            across, beyond = gap(oy, cy), gap(oz, cz) if space else real(0)
            left = farthest_row - across * across - beyond * beyond
            if left >= real(0):
                x0, x1 = cells_within(ox, math.sqrt(left), ix)
                py, pz = oy - real(block_start(cy, space)), oz - real(block_start(cz, space)) if space else oz
                near, far = row_parts(b, x0, x1, cy, cz, blocks, cells.first)
                begin, end, start = near
                low, high, middle = far
                k, px = number(begin), ox - real(start)
                own, many = np.int32(end - begin), np.int32(end - begin + high - low)
                for t in range(many):  # of both blocks in one loop, in which threads diverge less
                    if t == own:
                        k, px = number(low), ox - real(middle)
                    ux, uy, uz, _ = four_of(placed, k)
                    ux, uy, uz = px - ux, py - uy, pz - uz
                    squared = ux * ux + uy * uy + uz * uz
                    if squared < limit:
                        p = np.int32(cells.point[k])
                        before = found < 0 or formulas.comes_before(p, found, spheres.number)
                        if turn == 0 and squared < best:
                            limit = min(limit, formulas.equally_near(squared))
                            if distance >= limit:
                                before, lost = True, int(best < limit)
                            reach = math.sqrt(limit) + real(MARGIN)
                            best, farthest_row = squared, reach * reach
                        if before:
                            found, distance = p, squared
                    k += 1
            cy = np.int32(cy + LANES)
        if turn == 0:
            limit = formulas.equally_near(least_of_lanes(lane, best))
            if distance >= limit:
                found, lost = np.int32(-1), int(best < limit)
        else:
            lost = 0
        if least_of_lanes(lane, np.int32(-lost)) < 0:
            found = np.int32(-1)
            continue
        found = lowest_lane(lane, found, spheres.number)
        break
    return found, kernels.away_from(found, (ox, oy, oz), j, spheres.position, surface_term)


@formula
def cells_within(o, reach, i):
    """(first, last) cell along an axis, at most two from cell i, that are nearer than `reach` [h] to a coordinate o."""
    real = type(o)
    low, high = np.int32(i - 2), np.int32(i + 2)
    if o - reach > real(low):
        low = np.int32(math.floor(o - reach))
    if o + reach < real(high):
        high = np.int32(math.floor(o + reach))
    return low, high


@formula
def gap(o, d):
    """Distance [h] of a coordinate o from the cells d, from d to d + 1."""
    real = type(o)
    return max(max(real(d) - o, o - real(d + 1)), real(0))


@cuda_formula
def least_of_lanes(lane, mine):
    """The least of what the lanes have."""
    step = 1
    while step < LANES:
        mine = min(mine, across_lanes(mine, lane, LANES, step))
        step *= 2
    return mine


@cuda_formula
def lowest_lane(lane, found, interior_number):
    """The particle of the lowest number of what the lanes have found, -1 where none has one."""
    step = 1
    while step < LANES:
        other = across_lanes(found, lane, LANES, step)
        if other >= 0 and (found < 0 or formulas.comes_before(other, found, interior_number)):
            found = other
        step *= 2
    return found


@cuda_formula
def farthest_of_lanes(lane, i, axis, towards, spheres, blocks, surface_term):
    """(farthest exit [h] from the spheres around node i along an axis, the particle in the sphere's centre or -1)."""
    b = i >> 6
    space = block_bits(blocks) == 2
    real = type(surface_term.cell_size)
    cells, placed = spheres.cells, spheres.placed
    ax, ay, az = axis
    ix, iy, iz = local_place(i, block_bits(blocks))
    farthest, found = real(0), np.int32(-1)
    for row in range(lane, 16 if space else 4, EXIT_LANES):
        dy, dz = (row & 3) - 2, (row >> 2) - 2 if space else 0
        if space and ay != 0:  # the lanes take rows as far along the axis: on one side of a surface all have particles
            dy, dz = dz, dy
        cy, cz = np.int32(iy + dy), np.int32(iz + dz)
        x0, x1 = row_near(ix, -2, 1, dy, dz, surface_term)
        py = real(block_start(cy, space) - iy)
        pz = real(block_start(cz, space) - iz) if space else real(0)
        near, far = row_parts(b, x0, x1, cy, cz, blocks, cells.first)
        begin, end, start = near
        low, high, middle = far
        k, px = number(begin), real(start - ix)
        own, many = np.int32(end - begin), np.int32(end - begin + high - low)
        for t in range(many):
            if t == own:
                k, px = number(low), real(middle - ix)
            ux, uy, uz, _ = four_of(placed, k)
            ux, uy, uz = px + ux, py + uy, pz + uz
            along = ux * real(ax) + uy * real(ay) + uz * real(az)
            across = ux * ux * real(1 - ax) + uy * uy * real(1 - ay) + uz * uz * real(1 - az)
            if along * along + across < surface_term.radius_squared:
                length = formulas.exit_length(real(towards) * along, across, surface_term)
                if length > farthest or (length == farthest and cells.point[k] < found):
                    farthest, found = length, np.int32(cells.point[k])
            k += 1
    step = 1
    while step < EXIT_LANES:
        length, other = across_lanes(farthest, lane, EXIT_LANES, step), across_lanes(found, lane, EXIT_LANES, step)
        if length > farthest or (length == farthest and other < found):
            farthest, found = length, other
        step *= 2
    return farthest, found


@cuda_formula
def place_vertex(v, lane, spheres, blocks, node_state, surface_term, vertex_edge, counts, vertices):
    """Algorithm 1, lines 10 to 17: vertex v on the union of spheres [m], and the particle of its sphere."""
    if v < counts[VERTICES]:
        h = surface_term.cell_size
        real = type(h)
        i = vertex_edge[v] // 3
        axis = vertex_edge[v] - 3 * i
        axes = int(axis == 0), int(axis == 1), int(axis == 2)
        towards = 1
        if node_state[i] != 1:
            i = step_node(blocks, i, axes[0], axes[1], axes[2])
            towards = -1
        farthest, centre = farthest_of_lanes(lane, i, axes, towards, spheres, blocks, surface_term)
        if lane == 0:
            length = real(towards) * min(farthest, real(1))
            put(vertices.vertex_position, v, formulas.on_edge(node_coordinates(blocks, i), axes, length, h))
            vertices.vertex_centre[v] = centre


@cuda_kernel(rows_of="searching")
def place_vertices(
    spheres, blocks, node_state, surface_term, vertex_edge, counts, vertices, cut_cells, facets, searching
):
    """Vertices, each by EXIT_LANES of the first threads, and facets by their vertices, a cell's by one of the others.

    The first threads suffice for the capacity of vertices. Without `spheres` there are facets only, without
    `cut_cells` vertices only.
    """
    v, lane = cuda.grid(1) // EXIT_LANES, cuda.grid(1) % EXIT_LANES
    if v >= vertex_edge.shape[0]:
        if cut_cells is not None:
            write_facets(cuda.grid(1) - EXIT_LANES * vertex_edge.shape[0], blocks, cut_cells, counts, facets)
    elif spheres is not None:
        place_vertex(v, lane, spheres, blocks, node_state, surface_term, vertex_edge, counts, vertices)


@cuda_kernel(lanes=LANES, rows_of="facets")
def place_points(spheres, blocks, surface_term, vertex_edge, vertices, facets, counts, samples, points):
    """One sample to a facet, its nearest particle, the points of the fit [m] and their cells."""
    s, lane = cuda.grid(1) // LANES, cuda.grid(1) % LANES
    made = counts[MADE]
    if s < made:
        corner = facets[s, min(lane, facets.shape[1] - 1)]
        x, _, normal = kernels.facet_sample(s, vertices.vertex_position, facets)
        own = node_at(x, 0.0, (vertex_edge[corner] // 3) >> 6, blocks, surface_term)
        p, n = nearest_of_lanes(lane, own, x, vertices.vertex_centre[corner], spheres, blocks, surface_term)
        for k in range(lane, 2, LANES):
            r = s
            if k == 0:
                put(samples.sample_place, s, x)
                put(samples.facet_normal, s, normal)
                put(samples.outward, s, n)
                samples.nearest[s] = p
            else:
                r = made + s
                x = added(x, scaled(n, surface_term.offset * surface_term.cell_size))
            put(points.fit_position, r, x)
            count_point(r, x, own >> 6, blocks, surface_term, points.held_points, points.fit_place, points.fit_cell)


@cuda_kernel(lanes=LANES, rows_of="vertex_edge")
def turn_vertices(spheres, blocks, surface_term, vertex_edge, counts, vertices):
    """Unit vectors at vertices away from the particles nearest to them."""
    v, lane = cuda.grid(1) // LANES, cuda.grid(1) % LANES
    if v < counts[VERTICES]:
        x = three(vertices.vertex_position, v)
        own = node_at(x, 0.0, (vertex_edge[v] // 3) >> 6, blocks, surface_term)
        _, n = nearest_of_lanes(lane, own, x, vertices.vertex_centre[v], spheres, blocks, surface_term)
        if lane == 0:
            put(vertices.vertex_outward, v, n)


@formula
def implicit_normal(q, position, guess, blocks, surface_term, coefficients, outward, mls, normal):
    """Unit normal of the implicit surface at position q: (3.17), or without `mls` (3.9)."""
    base = node_at(three(position, q), 0.5, guess, blocks, surface_term)
    _, gradient = kernels.implicit_surface(q, position, base, blocks, surface_term, coefficients, mls)
    put(normal, q, kernels.oriented_normal(gradient, three(outward, q)))


@cuda_kernel(rows_of="either")
def find_normals(samples, vertices, vertex_edge, facets, blocks, surface_term, coefficients, mls, counts, either):
    """Normals of the implicit surface at samples and vertices, and vertices moved back to the liquid's surface [m].

    The first threads, as many as the capacity of facets, take samples, the others vertices.
    """
    s = cuda.grid(1)
    v = s - facets.shape[0]
    if s < counts[MADE]:
        guess = (vertex_edge[facets[s, 0]] // 3) >> 6
        place, outward, normal = samples.sample_place, samples.outward, samples.sample_normal
        implicit_normal(s, place, guess, blocks, surface_term, coefficients, outward, mls, normal)
    elif 0 <= v < counts[VERTICES]:
        guess = (vertex_edge[v] // 3) >> 6
        place, outward, normal = vertices.vertex_position, vertices.vertex_outward, vertices.vertex_normal
        implicit_normal(v, place, guess, blocks, surface_term, coefficients, outward, mls, normal)
        distance = surface_term.inset * surface_term.cell_size
        for c in range(3):
            vertices.inset_position[v, c] = place[v, c] - distance * normal[v, c]


@cuda_kernel(lanes=LANES, rows_of="facets")
def place_samples(
    spheres, blocks, surface_term, vertex_edge, inset_position, facets, components, samples, of_cells, told
):
    """Samples after the inset, their nearest particles, and areas, 0 on components of fewer than `least` particles.

    Behind them stand samples at NaN, of area 0 and without a particle. Where a sample has no particle, the second of
    the arrays `told` tells the host.
    """
    counts, sent = told
    s, lane = cuda.grid(1) // LANES, cuda.grid(1) % LANES
    if s < counts[MADE]:
        x, area, _ = kernels.facet_sample(s, inset_position, facets)
        guess = (vertex_edge[facets[s, 0]] // 3) >> 6
        own = node_at(x, 0.0, guess, blocks, surface_term)
        p, _ = nearest_of_lanes(lane, own, x, samples.nearest[s], spheres, blocks, surface_term)
        if lane == 0:
            has_tension = False
            if p < 0:
                sent[UNFOUND] = 1
            else:
                label = components.node_label[spheres.cells.cell[p]]
                has_tension = label >= 0 and components.members[label] >= components.least
            put(samples.sample_position, s, x)
            samples.sample_area[s] = area if has_tension else type(area)(0)
            samples.nearest[s] = p
            count_point(s, x, guess, blocks, surface_term, *of_cells)
    elif lane == 0 and s < min(samples.nearest.shape[0], samples.sample_area.shape[0]):
        nowhere = type(surface_term.cell_size)(math.nan)
        put(samples.sample_position, s, (nowhere, nowhere, nowhere))
        samples.sample_area[s] = type(nowhere)(0)
        samples.nearest[s] = -1
