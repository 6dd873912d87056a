"""Vertices, samples and their nearest particles, normals, and the surface after the inset.

A vertex or a facet is shared by LANES threads, which take the rows of cells by turns. What they look for, the farthest
exit or the nearest particle, does not depend on the order.
"""

import numpy as np

from refsim.backends.compile import cuda, cuda_formula, cuda_kernel, formula
from refsim.backends.primitives import across_lanes, largest_of_lanes
from refsim.backends.runtime import simulated
from refsim.sparse_grid.formulas import node_coordinates, step_node
from refsim.surface_energy import formulas, kernels
from refsim.surface_energy.recorded.cells_cuda import MADE, UNFOUND, VERTICES, node_at, row_part

LANES = 2 if simulated() else 8
FAR_ENOUGH = 1.0001  # a row of cells farther than a particle by this factor has no nearer one, whatever the rounding


@cuda_formula
def nearest_of_lanes(lane, i, x, y, z, interior_position, placed, cells, blocks, surface_term):
    """(nearest particle, unit vector away from it) of a position [m] in cell i, as `kernels.offsets` finds them."""
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
            direction, dy, dz = part_of_row(m, 2 * reach + 1)
            dy, dz = dy - reach, dz - reach if space else 0
            across, beyond = gap(oy, dy), gap(oz, dz) if space else real(0)
            if across * across + beyond * beyond <= FAR_ENOUGH * float(best):
                begin, end = row_part(i, direction, -reach, reach, dy, dz, blocks, cells.first)
                for k in range(begin, end):
                    ux = ox - formulas.grid_offset(placed[k, 0], jx, surface_term)
                    uy = oy - formulas.grid_offset(placed[k, 1], jy, surface_term)
                    uz = oz - formulas.grid_offset(placed[k, 2], jz, surface_term)
                    squared = ux * ux + uy * uy + uz * uz
                    if squared < best or (squared == best and cells.point[k] < found):
                        best, found = squared, cells.point[k]
        best, found = nearest_lane(lane, best, found)
    nx, ny, nz = kernels.away_from(found, best, ox, oy, oz, jx, jy, jz, interior_position, surface_term)
    return found, nx, ny, nz


@formula
def parts_of_rows(width, space):
    """Number of rows along x in a cube of so many cells, or in a square in the plane, each in three blocks."""
    return 3 * width * width if space else 3 * width


@formula
def part_of_row(m, width):
    """(block along x, cell along y, cell along z) of the m-th part; divisions by constants are fast."""
    row = np.uint32(m) // np.uint32(3)
    direction = np.int32(np.uint32(m) - np.uint32(3) * row) - 1
    z = row // np.uint32(3)
    if width == 4:
        z = row // np.uint32(4)
    elif width == 5:
        z = row // np.uint32(5)
    return direction, np.int32(row - np.uint32(width) * z), np.int32(z)


@formula
def gap(o, d):
    """Distance [h] of a coordinate o, from 0 to 1, from the row of cells d away."""
    real = type(o)
    if d > 0:
        return real(d) - o
    return o - real(d + 1) if d < 0 else real(0)


@cuda_formula
def nearest_lane(lane, best, found):
    """The nearest of what the lanes have found; of equally near particles the lowest number."""
    step = 1
    while step < LANES:
        squared, other = across_lanes(best, lane, LANES, step), across_lanes(found, lane, LANES, step)
        if squared < best or (squared == best and other < found):
            best, found = squared, other
        step *= 2
    return best, found


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
                farthest = kernels.farther_exit(farthest, ux, uy, uz, ax, ay, az, towards, surface_term)
        length = real(towards) * min(largest_of_lanes(farthest, lane, LANES), real(1))
        x = h * (real(jx) + real(ax) * length)
        y = h * (real(jy) + real(ay) * length)
        z = h * (real(jz) + real(az) * length)
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
        x, y, z, _, fx, fy, fz = kernels.facet_sample(s, vertex_position, facets)
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
                distance = surface_term.offset * surface_term.cell_size
                x, y, z = x + distance * nx, y + distance * ny, z + distance * nz
            fit_position[r, 0], fit_position[r, 1], fit_position[r, 2] = x, y, z
            cell = node_at(x, y, z, 0.5, own >> 6, blocks, surface_term)
            fit_cell[r] = cell
            if cell >= 0:
                fit_place[r] = cuda.atomic.add(held_points, cell, 1)


@formula
def implicit_normal(q, position, guess, blocks, surface_term, coefficients, outward, mls, normal):
    """Unit normal of the implicit surface at position q: (3.17), or without `mls` (3.9)."""
    base = node_at(position[q, 0], position[q, 1], position[q, 2], 0.5, guess, blocks, surface_term)
    if mls is not None:
        _, gx, gy, gz = kernels.mls_gradient(q, position, base, blocks, surface_term, coefficients)
    else:
        _, gx, gy, gz = kernels.spline_gradient(q, position, base, blocks, surface_term, coefficients)
    nx, ny, nz = kernels.oriented_normal(gx, gy, gz, outward[q, 0], outward[q, 1], outward[q, 2])
    normal[q, 0], normal[q, 1], normal[q, 2] = nx, ny, nz


@cuda_kernel(rows_of="either")
def find_normals(
    sample_place, sample_outward, vertex_position, vertex_outward, vertex_edge, facets, blocks, surface_term,
    coefficients, mls, counts, either, sample_normal, vertex_normal, inset_position,
):  # fmt: skip
    """Normals of the implicit surface at samples and vertices, and vertices moved back to the liquid's surface [m].

    The first threads, as many as the capacity of facets, take samples, the others vertices.
    """
    s = cuda.grid(1)
    v = s - facets.shape[0]
    if s < counts[MADE]:
        guess = (vertex_edge[facets[s, 0]] // 3) >> 6
        implicit_normal(s, sample_place, guess, blocks, surface_term, coefficients, sample_outward, mls, sample_normal)
    elif 0 <= v < counts[VERTICES]:
        guess = (vertex_edge[v] // 3) >> 6
        implicit_normal(
            v, vertex_position, guess, blocks, surface_term, coefficients, vertex_outward, mls, vertex_normal
        )
        distance = surface_term.inset * surface_term.cell_size
        for c in range(3):
            inset_position[v, c] = vertex_position[v, c] - distance * vertex_normal[v, c]


@cuda_kernel(lanes=LANES, rows_of="facets")
def place_samples(
    interior_position, placed, cells, blocks, surface_term, vertex_edge, inset_position, facets, node_label, members,
    least, sample_position, sample_area, nearest, sample_count, counts,
):  # fmt: skip
    """Samples after the inset, their nearest particles, and areas, 0 on components of fewer than `least` particles."""
    s, lane = cuda.grid(1) // LANES, cuda.grid(1) % LANES
    if s < counts[MADE]:
        x, y, z, area, _, _, _ = kernels.facet_sample(s, inset_position, facets)
        guess = (vertex_edge[facets[s, 0]] // 3) >> 6
        own = node_at(x, y, z, 0.0, guess, blocks, surface_term)
        p, _, _, _ = nearest_of_lanes(lane, own, x, y, z, interior_position, placed, cells, blocks, surface_term)
        if lane == 0:
            has_tension = False
            if p < 0:
                counts[UNFOUND] = 1
            else:
                cuda.atomic.add(sample_count, p, 1)
                label = node_label[cells.cell[p]]
                has_tension = label >= 0 and members[label] >= least
            sample_position[s, 0], sample_position[s, 1], sample_position[s, 2] = x, y, z
            sample_area[s] = area if has_tension else type(area)(0)
            nearest[s] = p
