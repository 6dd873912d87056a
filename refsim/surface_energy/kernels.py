"""What one node, vertex, facet, sample or particle does in the reconstruction of a surface and in its tension.

Loops over cells near a node go through `step_node`; the particles of a cell stand in its row of a `PointList`.
"""

import math

from refsim.backends import arrays
from refsim.backends.compile import formula, kernel
from refsim.backends.tuples import added, cross, difference, dot, over, put, scaled, three
from refsim.neighbours.formulas import lower_bound
from refsim.sparse_grid.formulas import node_coordinates, step_node
from refsim.surface_energy import formulas

REJECTED, ACCEPTED, UNDECIDED = 0, 1, 2  # a candidate of the Poisson-disk sampling


@kernel
def node_states(i, interior_position, cells, blocks, surface_term, node_state):
    """Algorithm 1, lines 5 to 9, a flag: 1 where a particle stands nearer than r to node i, else 0.

    The cells that touch the node come first: inside the liquid the first particle decides.
    """
    j = node_coordinates(blocks, i)
    space = blocks.neighbour.shape[1] == 27
    node_state[i] = 0
    for ring in range(2):
        for dz in range(-2 if space else 0, 2 if space else 1):
            for dy in range(-2, 2):
                for dx in range(-2, 2):
                    touches = -1 <= dx <= 0 and -1 <= dy <= 0 and -1 <= dz <= 0
                    if touches != (ring == 0):
                        continue
                    cell = step_node(blocks, i, dx, dy, dz)
                    if cell < 0:
                        continue
                    for k in range(cells.first[cell], cells.first[cell + 1]):
                        u = formulas.place_over(interior_position, cells.point[k], j, surface_term)
                        if dot(u, u) < surface_term.radius_squared:
                            node_state[i] = 1
                            return


@formula(inlined=True)
def farther_exit(farthest, u, axis, towards, surface_term):
    """Algorithm 1, line 15: max(`farthest`, l) [h], where l leads out of the sphere of a particle at u, along an axis.

    `farthest` itself where the sphere does not hold the edge's inside end.
    """
    real = type(farthest)
    ax, ay, az = axis
    along = u[0] * real(ax) + u[1] * real(ay) + u[2] * real(az)
    across = u[0] * u[0] * real(1 - ax) + u[1] * u[1] * real(1 - ay) + u[2] * u[2] * real(1 - az)
    if along * along + across < surface_term.radius_squared:
        farthest = max(farthest, formulas.exit_length(real(towards) * along, across, surface_term))
    return farthest


@kernel
def exit_points(v, interior_position, cells, blocks, node_state, surface_term, vertex_edge, vertex_position):
    """Algorithm 1, lines 10 to 17: vertex v [m], the farthest exit from the spheres around the edge's inside end."""
    h = surface_term.cell_size
    real = type(h)
    node = vertex_edge[v] // 3
    axis = vertex_edge[v] - 3 * node
    ax, ay, az = int(axis == 0), int(axis == 1), int(axis == 2)
    towards = 1
    if node_state[node] != 1:
        node = step_node(blocks, node, ax, ay, az)
        towards = -1
    farthest = real(0)
    j = node_coordinates(blocks, node)
    space = blocks.neighbour.shape[1] == 27
    for dz in range(-2 if space else 0, 2 if space else 1):
        for dy in range(-2, 2):
            for dx in range(-2, 2):
                cell = step_node(blocks, node, dx, dy, dz)
                if cell < 0:
                    continue
                for k in range(cells.first[cell], cells.first[cell + 1]):
                    u = formulas.place_over(interior_position, cells.point[k], j, surface_term)
                    farthest = farther_exit(farthest, u, (ax, ay, az), towards, surface_term)
    length = real(towards) * min(farthest, real(1))
    put(vertex_position, v, formulas.on_edge(j, (ax, ay, az), length, h))


@kernel
def facet_samples(f, vertex_position, facets, sample_position, sample_area, facet_normal):
    """One sample to a facet: its centroid [m], area [m^(dim-1)] and unit normal."""
    x, area, n = facet_sample(f, vertex_position, facets)
    put(sample_position, f, x)
    sample_area[f] = area
    put(facet_normal, f, n)


@formula
def facet_sample(f, vertex_position, facets):
    """(centroid [m], area [m^(dim-1)], unit normal) of facet f; no normal where the facet has no area."""
    a = three(vertex_position, facets[f, 0])
    u = difference(three(vertex_position, facets[f, 1]), a)
    real = type(u[0])
    half = real(0.5)
    if facets.shape[1] == 2:
        x = a[0] + half * u[0], a[1] + half * u[1], a[2]
        n = u[1], -u[0], real(0)
    else:
        w = difference(three(vertex_position, facets[f, 2]), a)
        x = added(a, scaled(added(u, w), real(1) / real(3)))
        n = scaled(cross(u, w), half)
    area = math.sqrt(dot(n, n))
    return x, area, over(n, area) if area > real(0) else n


@kernel
def candidates(k, vertex_position, facets, area_before, dice, candidate_facet, candidate_position):
    """Facet and position [m] of candidate k: spread evenly over the area, one to each of its equal shares."""
    one = vertex_position.dtype.type(1)
    shares = area_before.shape[0] - 1
    total = int(area_before[shares])
    width = total // int(dice.candidates)
    mark = width * k + ((width * (formulas.hash_word(dice.seed, k, 0) >> 16)) >> 16)
    f = min(lower_bound(area_before[1:], mark + 1), shares - 1)
    u = formulas.unit_share(formulas.hash_word(dice.seed, k, 1), one)
    a, b = facets[f, 0], facets[f, 1]
    if facets.shape[1] == 2:
        s, t, c = u, one - one, a
    else:
        root = math.sqrt(u)
        w = formulas.unit_share(formulas.hash_word(dice.seed, k, 2), one)
        s, t, c = root * (one - w), root * w, facets[f, 2]
    origin, first, second = three(vertex_position, a), three(vertex_position, b), three(vertex_position, c)
    x = added(origin, scaled(difference(first, origin), s))
    candidate_facet[k] = f
    put(candidate_position, k, added(x, scaled(difference(second, origin), t)))


def poisson_disk(candidate_position, candidate_cells, blocks, dice, surface_term, accepted):
    """Poisson-disk samples, a flag for each candidate: rounds of `throw_darts` until every candidate is decided."""
    arrays.fill(accepted, UNDECIDED)
    while True:
        throw_darts(candidate_position, candidate_cells, blocks, dice, surface_term, accepted)
        if arrays.largest(accepted) != UNDECIDED:
            return


@kernel
def throw_darts(k, candidate_position, candidate_cells, blocks, dice, surface_term, accepted):
    """One round for an undecided candidate k, a flag: decided if those that are drawn before it are.

    It is accepted where no accepted candidate that is drawn before it stands nearer than the disk's radius. The result
    does not depend on which decisions of the same round it sees.
    """
    if accepted[k] != UNDECIDED:
        return
    i = candidate_cells.cell[k]
    if i < 0:
        accepted[k] = REJECTED
        return
    j = node_coordinates(blocks, i)
    own = formulas.place_over(candidate_position, k, j, surface_term)
    turn = formulas.hash_word(dice.seed, k, 3)
    limit = surface_term.disk * surface_term.disk
    space = blocks.neighbour.shape[1] == 27
    verdict = ACCEPTED
    for dz in range(-1 if space else 0, 2 if space else 1):
        for dy in range(-1, 2):
            for dx in range(-1, 2):
                cell = step_node(blocks, i, dx, dy, dz)
                if cell < 0:
                    continue
                for m in range(candidate_cells.first[cell], candidate_cells.first[cell + 1]):
                    other = candidate_cells.point[m]
                    if accepted[other] == REJECTED or other == k:
                        continue
                    u = difference(formulas.place_over(candidate_position, other, j, surface_term), own)
                    if dot(u, u) < limit:
                        theirs = formulas.hash_word(dice.seed, other, 3)
                        if theirs < turn or (theirs == turn and other < k):
                            if accepted[other] == ACCEPTED:
                                accepted[k] = REJECTED
                                return
                            verdict = UNDECIDED
    accepted[k] = verdict


@kernel(rows_of="nearest")
def offsets(
    s, interior_position, interior_number, cells, blocks, surface_term, sample_position, sample_cells, nearest,
    offset_direction, fit_position,
):  # fmt: skip
    """Section 4.3.1: nearest particle of sample s, unit vector away from it, and the two points of the fit [m]."""
    h = surface_term.cell_size
    real = type(h)
    i = sample_cells.cell[s]
    j = node_coordinates(blocks, i)
    o = formulas.place_over(sample_position, s, j, surface_term)
    space = blocks.neighbour.shape[1] == 27
    limit = real(formulas.REACH * formulas.REACH)
    best, second, closest = limit, limit, -1
    for turn in range(2):  # the second looks for the lowest number where some are equally near
        for reach in range(1, 3):
            if reach == 2 and formulas.equally_near(best) < real(1):
                break
            for dz in range(-reach if space else 0, reach + 1 if space else 1):
                for dy in range(-reach, reach + 1):
                    for dx in range(-reach, reach + 1):
                        if reach == 2 and max(abs(dx), max(abs(dy), abs(dz))) < 2:
                            continue
                        cell = step_node(blocks, i, dx, dy, dz)
                        if cell < 0:
                            continue
                        for k in range(cells.first[cell], cells.first[cell + 1]):
                            p = cells.point[k]
                            u = difference(o, formulas.place_over(interior_position, p, j, surface_term))
                            squared = dot(u, u)
                            if turn == 1:
                                if squared < limit and formulas.comes_before(p, closest, interior_number):
                                    closest = p
                            elif squared < best:
                                best, second, closest = squared, best, p
                            elif squared < second:
                                second = squared
        limit = formulas.equally_near(best)
        if not second < limit:
            break
    nearest[s] = closest
    put(offset_direction, s, away_from(closest, o, j, interior_position, surface_term))
    if fit_position is not None:
        distance = surface_term.offset * h
        for c in range(3):
            fit_position[s, c] = sample_position[s, c]
            fit_position[nearest.shape[0] + s, c] = sample_position[s, c] + distance * offset_direction[s, c]


@formula
def away_from(closest, o, j, interior_position, surface_term):
    """Section 4.3.1: n = (o - x_p)/|o - x_p|, dimensionless, o over node j; 0 at its place and without a particle."""
    zero = type(surface_term.cell_size)(0)
    if closest < 0:
        return zero, zero, zero
    u = difference(o, formulas.place_over(interior_position, closest, j, surface_term))
    squared = dot(u, u)
    if not squared > zero:
        return zero, zero, zero
    return over(u, math.sqrt(squared))


def fit_weights(fit_position, fit_cells, blocks, surface_term, fit_splines, node_weight):
    """Splines of the points of the fit, and (3.7), both dimensionless."""
    splines_of_points(fit_position, fit_cells, blocks, surface_term, fit_splines)
    weights_of_nodes(fit_splines, fit_cells, blocks, surface_term, node_weight)


@kernel
def splines_of_points(r, fit_position, fit_cells, blocks, surface_term, fit_splines):
    """Splines of point r at the three nodes along each axis, dimensionless: 3 c + k; (1, 0, 0) along z in the plane."""
    real = type(surface_term.cell_size)
    base = fit_cells.cell[r]
    if base < 0:
        for k in range(9):
            fit_splines[r, k] = real(0)
        return
    put_splines(r, r, fit_position, base, blocks, surface_term, fit_splines)


@formula
def put_splines(row, r, fit_position, base, blocks, surface_term, fit_splines):
    """B of point r at three nodes from `base` on along each axis into a row of the splines, dimensionless."""
    real = type(surface_term.cell_size)
    fx, fy, fz = formulas.place_over(fit_position, r, node_coordinates(blocks, base), surface_term)
    space = blocks.neighbour.shape[1] == 27
    for k in range(3):
        fit_splines[row, k] = formulas.spline_weight(fx, k)
        fit_splines[row, 3 + k] = formulas.spline_weight(fy, k)
        fit_splines[row, 6 + k] = formulas.spline_weight(fz, k) if space else real(k == 0)


@kernel
def weights_of_nodes(i, fit_splines, fit_cells, blocks, surface_term, node_weight):
    """(3.7), the diagonal of Lambda: 1/sum_r B_i(x_r), dimensionless; 0 where the sum is at most LEAST_SUM."""
    real = type(surface_term.cell_size)
    total = real(0)
    space = blocks.neighbour.shape[1] == 27
    for kz in range(3 if space else 1):
        for ky in range(3):
            for kx in range(3):
                cell = step_node(blocks, i, -kx, -ky, -kz)
                if cell >= 0:
                    for k in range(fit_cells.first[cell], fit_cells.first[cell + 1]):
                        r = fit_cells.point[k]
                        total += fit_splines[r, kx] * fit_splines[r, 3 + ky] * fit_splines[r, 6 + kz]
    node_weight[i] = real(1) / total if total > real(formulas.LEAST_SUM) else real(0)


def fit(fit_splines, fit_cells, blocks, surface_term, node_weight, active, residual, coefficients):
    """(3.6), Algorithm 2: `iterations` sweeps from C = 0; C [h] and residuals [h]."""
    arrays.fill(coefficients, 0)
    arrays.fill(residual, 0)
    for _ in range(surface_term.iterations):
        fit_residuals(fit_splines, fit_cells, blocks, surface_term, coefficients, residual)
        fit_correct(fit_splines, fit_cells, blocks, surface_term, node_weight, active, residual, coefficients)


@kernel
def fit_residuals(r, fit_splines, fit_cells, blocks, surface_term, coefficients, residual):
    """Algorithm 2: b_r - sum_j C_j B_j(x_r), in units of h; b is 0 for the first half of the points, then epsilon."""
    real = type(surface_term.cell_size)
    value = real(0)
    if 2 * r >= fit_splines.shape[0]:
        value = surface_term.offset
    base = fit_cells.cell[r]
    if base < 0:
        residual[r] = real(0)
        return
    space = blocks.neighbour.shape[1] == 27
    for kz in range(3 if space else 1):
        for ky in range(3):
            across = fit_splines[r, 3 + ky] * fit_splines[r, 6 + kz]
            for kx in range(3):
                j = step_node(blocks, base, kx, ky, kz)
                if j >= 0:
                    value -= coefficients[j] * (fit_splines[r, kx] * across)
    residual[r] = value


@kernel(rows_of="active")
def fit_correct(a, fit_splines, fit_cells, blocks, surface_term, node_weight, active, residual, coefficients):
    """Algorithm 2: C_i <- C_i + w Lambda_i sum_r (b_r - f(x_r)) B_i(x_r), in units of h, on the a-th active node i."""
    i = active[a]
    total = type(surface_term.cell_size)(0)
    space = blocks.neighbour.shape[1] == 27
    for kz in range(3 if space else 1):
        for ky in range(3):
            for kx in range(3):
                cell = step_node(blocks, i, -kx, -ky, -kz)
                if cell >= 0:
                    for k in range(fit_cells.first[cell], fit_cells.first[cell + 1]):
                        r = fit_cells.point[k]
                        total += residual[r] * (fit_splines[r, kx] * fit_splines[r, 3 + ky] * fit_splines[r, 6 + kz])
    coefficients[i] += surface_term.relaxation * node_weight[i] * total


@kernel
def mls_normals(
    q, query_position, spline_cells, blocks, surface_term, coefficients, outward, surface_value, surface_gradient,
    sample_normal,
):  # fmt: skip
    """(3.8) and (3.17): value [h], dimensionless gradient and unit normal of the implicit surface at position q."""
    base = spline_cells.cell[q]
    value, gradient = implicit_surface(q, query_position, base, blocks, surface_term, coefficients, 1)
    store_normal(q, value, gradient, outward, surface_value, surface_gradient, sample_normal)


@kernel
def spline_normals(
    q, query_position, spline_cells, blocks, surface_term, coefficients, outward, surface_value, surface_gradient,
    sample_normal,
):  # fmt: skip
    """(3.8) and (3.9): value [h], dimensionless gradient and unit normal of the implicit surface at position q."""
    base = spline_cells.cell[q]
    value, gradient = implicit_surface(q, query_position, base, blocks, surface_term, coefficients, None)
    store_normal(q, value, gradient, outward, surface_value, surface_gradient, sample_normal)


@formula
def implicit_surface(q, query_position, base, blocks, surface_term, coefficients, mls):
    """(value [h], gradient) of the implicit surface at position q: (3.8) and (3.17), or where `mls` is None (3.9).

    C and lengths in units of h: 4/h^2 sum_j B_j C_j (x_j - y) is 4 sum_j B_j C_j (k - f), dimensionless, as is
    sum_j C_j h grad B_j. 0 where no block holds `base`, the lowest node of the position's splines.
    """
    real = type(surface_term.cell_size)
    value, gx, gy, gz = real(0), real(0), real(0), real(0)
    if base < 0:
        return value, (gx, gy, gz)
    fx, fy, fz = formulas.place_over(query_position, q, node_coordinates(blocks, base), surface_term)
    space = blocks.neighbour.shape[1] == 27
    for kz in range(3 if space else 1):
        wz = formulas.spline_weight(fz, kz) if space else real(1)
        sz = formulas.spline_slope(fz, kz) if space else real(0)
        az = real(kz) - fz if space else real(0)
        for ky in range(3):
            wy, sy = formulas.spline_weight(fy, ky), formulas.spline_slope(fy, ky)
            across, ay = wy * wz, real(ky) - fy
            for kx in range(3):
                j = step_node(blocks, base, kx, ky, kz)
                if j >= 0:
                    wx, c = formulas.spline_weight(fx, kx), coefficients[j]
                    term = wx * across * c
                    value += term
                    if mls is not None:
                        gx += term * (real(kx) - fx)
                        gy += term * ay
                        gz += term * az
                    else:
                        gx += formulas.spline_slope(fx, kx) * wy * wz * c
                        gy += wx * sy * wz * c
                        gz += wx * wy * sz * c
    if mls is not None:
        gx, gy, gz = real(4) * gx, real(4) * gy, real(4) * gz
    return value, (gx, gy, gz)


@formula
def store_normal(q, value, gradient, outward, surface_value, surface_gradient, sample_normal):
    """Value [h] and gradient = g, if their arrays are given, and the unit normal."""
    if surface_value is not None:
        surface_value[q] = value
    if surface_gradient is not None:
        put(surface_gradient, q, gradient)
    put(sample_normal, q, oriented_normal(gradient, three(outward, q)))


@formula
def oriented_normal(g, n):
    """Unit vector = g/|g| (dimensionless); the direction n instead where g is 0 or points against n."""
    length = math.sqrt(dot(g, g))
    if length > type(length)(0):
        g = over(g, length)
        if dot(g, n) >= type(length)(0):
            return g
    return n


@kernel
def inset(v, vertex_position, vertex_normal, surface_term, inset_position):
    """x - (r - delta) n [m]: vertex v moved back to the liquid's surface (thesis M31)."""
    distance = surface_term.inset * surface_term.cell_size
    for c in range(3):
        inset_position[v, c] = vertex_position[v, c] - distance * vertex_normal[v, c]


@kernel
def surface_force(i, sample_position, sample_area, sample_normal, spline_cells, blocks, surface_term, node_force):
    """(4.5), (4.18*): force on node i [N], -k sum_s A_s (I - n n^T) grad B_i(x_s); k has the sign of thesis M1."""
    real = type(surface_term.cell_size)
    total = real(0), real(0), real(0)
    space = blocks.neighbour.shape[1] == 27
    for row in range(9 if space else 3):
        ky, kz = row % 3, row // 3
        for kx in range(3):
            cell = step_node(blocks, i, -kx, -ky, -kz)
            if cell < 0:
                continue
            first, end = spline_cells.first[cell], spline_cells.first[cell + 1]
            if first == end:
                continue
            jx, jy, jz = node_coordinates(blocks, cell)
            for k in range(first, end):
                s = spline_cells.point[k]
                fx = formulas.grid_offset(sample_position[s, 0], jx, surface_term)
                fy = formulas.grid_offset(sample_position[s, 1], jy, surface_term)
                wx, wy, wz = formulas.spline_weight(fx, kx), formulas.spline_weight(fy, ky), real(1)
                sx, sy, sz = formulas.spline_slope(fx, kx), formulas.spline_slope(fy, ky), real(0)
                if space:
                    fz = formulas.grid_offset(sample_position[s, 2], jz, surface_term)
                    wz, sz = formulas.spline_weight(fz, kz), formulas.spline_slope(fz, kz)
                slope = sx * wy * wz, wx * sy * wz, wx * wy * sz
                u = formulas.tangential(three(sample_normal, s), slope)
                total = added(total, scaled(u, sample_area[s]))
    put(node_force, i, scaled(total, -surface_term.tension / surface_term.cell_size))


@kernel
def look_up_members(p, cell, node_label, members, component_size):
    """Particles in the component of each particle."""
    i = cell[p]
    component_size[p] = members[node_label[i]] if i >= 0 and node_label[i] >= 0 else 0
