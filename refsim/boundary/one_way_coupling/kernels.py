"""What one particle does at the boundary particles of a mesh."""

import math

from refsim.backends.compile import formula, kernel
from refsim.boundary.one_way_coupling.formulas import boundary_pressure, boundary_pressure_pair, boundary_viscosity_pair
from refsim.neighbours.formulas import to_nearest_image
from refsim.neighbours.rows import row_of
from refsim.smoothing.formulas import kernel_slope, kernel_value, viscosity_laplacian


@kernel
def wall_viscosity(
    i, position, velocity, density, walls, smoothing, fluid, wall_viscosity, wall_motion, period, acceleration
):  # fmt: skip
    """Patent P6, viscous part; boundary particles are at rest, or move beyond the planes of `wall_motion` [m/s^2]."""
    first, stride, count = row_of(walls, i)
    h = smoothing.support_radius
    limit = h * h
    total, moving = type(h)(0), type(h)(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    rho = density[i]
    for k in range(count):
        b = walls.entries[first + k * stride]
        dx, dy, dz = x - walls.position[b, 0], y - walls.position[b, 1], z - walls.position[b, 2]
        dx, dy, dz = to_nearest_image(dx, dy, dz, period)
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            wall_mass = fluid.rest_density * walls.volume[b]
            laplacian = viscosity_laplacian(math.sqrt(r2), smoothing)
            g = boundary_viscosity_pair(wall_mass, rho, wall_viscosity, laplacian)
            total += g
            if wall_motion is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
                if wall_moves(b, walls, wall_motion):
                    moving += g
    for c in range(3):
        change = -total * velocity[i, c]
        if wall_motion is not None:
            change += moving * wall_motion.velocity[c]
        acceleration[i, c] += change


@formula
def wall_moves(b, walls, wall_motion):
    """Whether boundary particle b stands beyond one of the planes of `wall_motion`."""
    for c in range(3):
        if walls.position[b, c] < wall_motion.lower[c] or walls.position[b, c] > wall_motion.upper[c]:
            return True
    return False


@kernel
def extrapolated_wall_pressure(
    i, position, density, pressure, neighbours, walls, smoothing, fluid, wall_gravity, acceleration
):  # fmt: skip
    """Patent P6 with the boundary particles' pressures p_b (patent E30); added to the acceleration [m/s^2]."""
    wall_first, wall_stride, wall_count = row_of(walls, i)
    if wall_count > 0:
        first, stride, count = row_of(neighbours, i)
        h = smoothing.support_radius
        real = type(h)
        limit = h * h
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        weights = kernel_value(real(0), smoothing)
        total = weights * pressure[i]
        for k in range(count):
            j = neighbours.entries[first + k * stride]
            dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
            r2 = dx * dx + dy * dy + dz * dz
            if r2 < limit:
                w = kernel_value(math.sqrt(r2), smoothing)
                head = wall_gravity.x * dx + wall_gravity.y * dy + wall_gravity.z * dz
                weights += w
                total += w * (pressure[j] + density[j] * head)
        mean = total / weights
        tiny = real(1e-9) * h
        ax, ay, az = real(0), real(0), real(0)
        rho = density[i]
        for k in range(wall_count):
            b = walls.entries[wall_first + k * wall_stride]
            dx, dy, dz = x - walls.position[b, 0], y - walls.position[b, 1], z - walls.position[b, 2]
            r2 = dx * dx + dy * dy + dz * dz
            if r2 < limit:
                r = math.sqrt(r2)
                pressure_b = boundary_pressure(mean, wall_gravity, dx, dy, dz, fluid)
                wall_mass = fluid.rest_density * walls.volume[b]
                slope = kernel_slope(r, smoothing)
                f = boundary_pressure_pair(wall_mass, rho, pressure_b, slope, fluid) / (r + tiny)
                ax += f * dx
                ay += f * dy
                az += f * dz
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az
