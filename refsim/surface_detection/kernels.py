"""What one neighbour and one particle do in surface detection."""

import math

from refsim.backends.compile import formula, kernel
from refsim.neighbours.rows import row_of
from refsim.surface_detection.formulas import in_scan_region

ENOUGH = 3  # neighbours; a particle with fewer is spray (Jiang & Zhu E20)


@kernel
def near_surface(i, number_density, asymmetry, near_surface_limit, near_surface):
    """J(12) delta_i <= lambda delta0; with `asymmetry` also particles whose neighbours stand on one side, |sum_j W_ij
    x_ij| >= limit (Jiang & Zhu E23); a flag."""
    near = number_density[i] <= near_surface_limit.number_density
    if asymmetry is not None:
        near = near or asymmetry[i] >= near_surface_limit.asymmetry
    near_surface[i] = near


@kernel
def fan_scan(i, position, surface_normal, candidates, neighbours, walls, fan_scan, surface):
    """J(13); a flag, zero for a particle that is no candidate."""
    near, occupied = ENOUGH, True
    if candidates is None or candidates[i] != 0:
        normal, directed = unit(surface_normal, i, fan_scan.smallest_normal)
        near, occupied = scan(i, position, neighbours, position, normal, fan_scan, 0, not directed)
        if walls is not None:
            near, occupied = scan(i, position, walls, walls.position, normal, fan_scan, near, occupied)
    surface[i] = near < ENOUGH or not occupied


@formula
def unit(vector, i, smallest):
    """(components of row i divided by its length, whether the length is at least `smallest`)."""
    x, y, z = vector[i, 0], vector[i, 1], vector[i, 2]
    length = math.sqrt(x * x + y * y + z * z)
    if length < smallest:
        zero = type(length)(0)
        return (zero, zero, zero), False
    return (x / length, y / length, z / length), True


@formula
def scan(i, position, listed, source, normal, fan_scan, near, occupied):
    """J(13) over the particles at `source` in the list: (neighbours within the support radius, at most ENOUGH; whether
    the region is occupied).

    `near` and `occupied` are the results of other lists; the loop ends as soon as neither can change.
    """
    first, stride, count = row_of(listed, i)
    limit = fan_scan.support_radius * fan_scan.support_radius
    nx, ny, nz = normal
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        if occupied and near >= ENOUGH:
            break
        j = listed.entries[first + k * stride]
        dx, dy, dz = x - source[j, 0], y - source[j, 1], z - source[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            near += 1
        occupied = occupied or in_scan_region(r2, nx * dx + ny * dy + nz * dz, fan_scan)
    return near, occupied


@kernel
def release_pressure(i, surface, pressure):
    """p = 0 on S, unchanged elsewhere [Pa]."""
    if surface[i] != 0:
        pressure[i] = type(pressure[i])(0)
