"""What one neighbour and one particle do in implicit incompressible SPH. Walls are at rest."""

from refsim.backends.compile import kernel
from refsim.backends.tuples import difference, dot, scaled, three
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.neighbours.rows import add_vector, first_lane, set_vector
from refsim.smoothing.formulas import gradient_factor, kernel_slope, safe_distance
from refsim.sph.iisph import formulas
from refsim.sph.kernels import wall_gradient


@pair
def predict_pair(r, x_ij, velocity_i, velocity_j, mass_i, mass_j, acceleration_i, acceleration_j, smoothing, kick):
    """m_j grad W_ij, m_i m_j |grad W_ij|^2 and m_j (v_i - v_j).grad W_ij, with the velocities after the kick."""
    slope = gradient_factor(r, smoothing)
    f = mass_j * slope
    # A mass goes with each slope: the square of the slope alone overflows float32 at small lengths.
    squares = (mass_i * slope * r) * (f * r)
    flow = f * x_ij[0] * (velocity_i[0] - velocity_j[0] + kick * (acceleration_i[0] - acceleration_j[0]))
    flow += f * x_ij[1] * (velocity_i[1] - velocity_j[1] + kick * (acceleration_i[1] - acceleration_j[1]))
    flow += f * x_ij[2] * (velocity_i[2] - velocity_j[2] + kick * (acceleration_i[2] - acceleration_j[2]))
    return f * x_ij[0], f * x_ij[1], f * x_ij[2], squares, flow


@kernel(lanes=True)
def predict(
    i, lane, position, velocity, mass, density, acceleration, neighbours, walls, smoothing, fluid, timestep,
    own_displacement, diagonal, advected_density,
):  # fmt: skip
    """d_ii [m/Pa], a_ii [kg/(m^dim Pa)] and rho_adv [kg/m^dim], with the velocities after the kick."""
    kick, drift = timestep[0], timestep[1]
    gx, gy, gz, squares, flow = neighbour_sum(
        predict_pair, i, lane, neighbours, position, None, velocity, mass, acceleration, smoothing, kick
    )
    if walls is not None:
        bx, by, bz = wall_gradient(i, lane, position, walls, smoothing, fluid.rest_density, None)
        flow += bx * (velocity[i, 0] + kick * acceleration[i, 0])
        flow += by * (velocity[i, 1] + kick * acceleration[i, 1])
        flow += bz * (velocity[i, 2] + kick * acceleration[i, 2])
        gx, gy, gz = gx + bx, gy + by, gz + bz
    rho = density[i]
    share = -kick * drift / (rho * rho)
    set_vector(own_displacement, i, lane, (share * gx, share * gy, share * gz))
    if first_lane(lane):
        diagonal[i] = formulas.diagonal(gx * gx + gy * gy + gz * gz, squares, rho, kick * drift)
        advected_density[i] = rho + drift * flow


@pair
def displace_pair(r, x_ij, mass_j, density_j, pressure_j, smoothing):
    """-(m_j p_j/rho_j^2) grad W_ij [m/s^2]."""
    f = -mass_j * pressure_j / (density_j * density_j) * gradient_factor(r, smoothing)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


@kernel(lanes=True)
def displace(i, lane, position, mass, density, pressure, neighbours, smoothing, timestep, pair_displacement):
    """s_i = sum_j d_ij p_j = -s sum_j (m_j p_j/rho_j^2) grad W_ij [m]."""
    s = neighbour_sum(displace_pair, i, lane, neighbours, position, None, mass, density, pressure, smoothing)
    set_vector(pair_displacement, i, lane, scaled(s, timestep[0] * timestep[1]))


@pair
def relax_pair(
    r, x_ij, mass_j, pressure_j, own_displacement_j, pair_displacement_i, pair_displacement_j, smoothing, own
):
    """m_j (s_i - d_jj p_j - s_j + d_ji p_i).grad W_ij [kg/m^dim], d_ji p_i = `own` grad W_ij."""
    g = gradient_factor(r, smoothing)
    sx, sy, sz = pair_displacement_i
    away = (sx - own_displacement_j[0] * pressure_j - pair_displacement_j[0] + own * g * x_ij[0]) * x_ij[0]
    away += (sy - own_displacement_j[1] * pressure_j - pair_displacement_j[1] + own * g * x_ij[1]) * x_ij[1]
    away += (sz - own_displacement_j[2] * pressure_j - pair_displacement_j[2] + own * g * x_ij[2]) * x_ij[2]
    return mass_j * g * away


@kernel(lanes=True)
def relax(
    i, lane, position, mass, density, pressure, own_displacement, pair_displacement, diagonal, advected_density,
    neighbours, walls, smoothing, fluid, implicit, timestep, density_error, new_pressure,
):  # fmt: skip
    """One Jacobi step p <- (1 - w) p + (w/a_ii) (rho0 - rho_adv - L_i) [Pa], L_i = sum_j m_j (s_i - d_jj p_j - s_j +
    d_ji p_i).grad W_ij, and the compression [kg/m^dim] that the pressures before it leave."""
    square = timestep[0] * timestep[1]
    p, a = pressure[i], diagonal[i]
    coefficient = square * mass[i] / (density[i] * density[i]) * p
    total = neighbour_sum(
        relax_pair, i, lane, neighbours, position, None, mass, pressure, own_displacement, pair_displacement,
        smoothing, coefficient,
    )  # fmt: skip
    if walls is not None:
        beside = wall_gradient(i, lane, position, walls, smoothing, fluid.rest_density, None)
        total += dot(beside, three(pair_displacement, i))
    missing = fluid.rest_density - advected_density[i]
    left = total + a * p - missing
    if first_lane(lane):
        density_error[i] = max(left, left - left)  # 0 at least; a NaN stays NaN
        new_pressure[i] = formulas.relaxed_pressure(p, missing, total, a, implicit, square)


@pair
def push_pair(r, x_ij, mass_j, density_i, density_j, pressure_i, pressure_j, smoothing):
    """-m_j (p_i/rho_i^2 + p_j/rho_j^2) grad W_ij [m/s^2]."""
    both = pressure_i / (density_i * density_i) + pressure_j / (density_j * density_j)
    f = -mass_j * both * kernel_slope(r, smoothing) / safe_distance(r, smoothing)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


@kernel(lanes=True)
def push(i, lane, position, mass, density, pressure, neighbours, walls, smoothing, fluid, acceleration):
    """-sum_j m_j (p_i/rho_i^2 + p_j/rho_j^2) grad W_ij, walls with p_b = 0; added to the acceleration [m/s^2]."""
    a = neighbour_sum(push_pair, i, lane, neighbours, position, None, mass, density, pressure, smoothing)
    if walls is not None:
        beside = wall_gradient(i, lane, position, walls, smoothing, fluid.rest_density, None)
        a = difference(a, scaled(beside, pressure[i] / (density[i] * density[i])))
    add_vector(acceleration, i, lane, a)


@kernel
def halve(i, pressure):
    """p <- p/2 [Pa], the start of the next solution."""
    pressure[i] = pressure[i] / (pressure.dtype.type(1) + pressure.dtype.type(1))


@kernel
def keep(i, new_pressure, pressure):
    """p <- the relaxed p [Pa]."""
    pressure[i] = new_pressure[i]


def solve(
    position, velocity, mass, density, neighbours, walls, smoothing, fluid, implicit, timestep, own_displacement,
    diagonal, advected_density, pair_displacement, density_error, new_pressure, pressure, acceleration,
):  # fmt: skip
    """Relax, `least` to `most` times, until the mean compression is at most `tolerance` rho0; add the acceleration."""
    predict(
        position, velocity, mass, density, acceleration, neighbours, walls, smoothing, fluid, timestep,
        own_displacement, diagonal, advected_density,
    )  # fmt: skip
    halve(pressure)
    allowed = float(implicit.tolerance) * float(fluid.rest_density)
    for count in range(1, int(implicit.most) + 1):
        displace(position, mass, density, pressure, neighbours, smoothing, timestep, pair_displacement)
        relax(
            position, mass, density, pressure, own_displacement, pair_displacement, diagonal, advected_density,
            neighbours, walls, smoothing, fluid, implicit, timestep, density_error, new_pressure,
        )  # fmt: skip
        keep(new_pressure, pressure)
        if count >= int(implicit.least) and not _mean(density_error) > allowed:
            break
    push(position, mass, density, pressure, neighbours, walls, smoothing, fluid, acceleration)


def _mean(values):
    """Mean of an array on either backend; 0 of none."""
    here = values.copy_to_host() if hasattr(values, "copy_to_host") else values
    return float(here.mean()) if len(here) else 0.0
