"""What one neighbour and one particle do in two-way coupling."""

import math

from refsim.backends.compile import formula, kernel
from refsim.backends.tuples import added, difference, dot, over, scaled, three
from refsim.boundary.two_way_coupling import PASSED
from refsim.boundary.two_way_coupling.formulas import lightness, nearness, pressed, side, steepness, tait_pressure
from refsim.motion.formulas import felt
from refsim.neighbours.forces import force
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.neighbours.rows import add_vector, first_lane, set_vector
from refsim.shape_matching.phases import FLUID, INTERIOR, SURFACE
from refsim.smoothing.formulas import gradient_factor, kernel_slope, kernel_value, safe_distance, viscosity_laplacian
from refsim.sph.formulas import film_pressure, pressure_pair
from refsim.sph.kernels import central_pair, own_share, wall_sum

LEAST = 1e-20  # wetness that is passed on: some 30 times its way, a support wide
WIDENED = 8.0  # times its pairs a film pushes at most: between half-spaces a spacing apart it lacks 1 - 1/6 (h = 3 d)
FACING = 0.125  # of (sum_s V_s |grad W_ks|)^2, the least |G_film|^2: half-spaces have 0.5, corners 0.17
LOOSE = 0.06  # of 1/h, what uneven liquid lacks beside gaps of 0.25 to 1.3 d
SUCKED = 4.0  # times the liquid's own pressure below zero: the least of a film


@pair
def contribution_pair(r, phase_j, smoothing, coupling):
    """W_kk' of a solid's particle [1/m^dim]."""
    counted = phase_j == SURFACE if coupling.printed_volume else phase_j != FLUID
    return kernel_value(r, smoothing) if counted else type(r)(0)


@kernel(lanes=True)
def contribution(i, lane, position, phase, neighbours, smoothing, coupling, relative_contribution):
    """Weight of particle i in Shao & Song (1): 1 in the liquid, phi_i at a solid's surface, 0 inside; dimensionless.

    phi_k = V_k/V_min, V_k = 1/sum_k' W_kk' (Shao & Song M4).
    """
    w0 = own_share(smoothing)
    weight = type(w0)(0)
    if phase[i] == FLUID:
        weight = type(w0)(1)
    elif phase[i] == SURFACE:
        total = neighbour_sum(contribution_pair, i, lane, neighbours, position, None, phase, smoothing, coupling)
        weight = type(w0)(1) / ((total + w0) * coupling.least_volume)
    if first_lane(lane):
        relative_contribution[i] = weight


@pair
def density_pair(r, relative_contribution_j, smoothing):
    """Shao & Song (1) without m_i: phi_j W_ij [1/m^dim]."""
    return relative_contribution_j * kernel_value(r, smoothing)


@kernel(lanes=True)
def density(
    i, lane, position, mass, rest_density, phase, relative_contribution, neighbours, walls, smoothing, coupling,
    density, pressure, volume,
):  # fmt: skip
    """Shao & Song (1) [kg/m^dim], Tait's pressure [Pa], V = m/rho [m^dim]; solids keep rho0 and have no pressure."""
    rho = rest_density[i]
    p = type(rho)(0)
    if phase[i] == FLUID:
        total = neighbour_sum(density_pair, i, lane, neighbours, position, None, relative_contribution, smoothing)
        rho = mass[i] * (total + relative_contribution[i] * own_share(smoothing))
        if walls is not None:
            rho += rest_density[i] * wall_sum(i, lane, position, walls, smoothing, None)
        p = tait_pressure(rho, rest_density[i], coupling)
    if first_lane(lane):
        density[i] = rho
        pressure[i] = p
        volume[i] = mass[i] / rho


@pair
def force_pair(
    r, x_ij, velocity_i, velocity_j, mass_i, mass_j, phase_i, phase_j, pressure_i, pressure_j, volume_i, volume_j,
    relative_contribution_i, relative_contribution_j, smoothing, coupling, viscosity,
):  # fmt: skip
    """Shao & Song (2), (3) and the forces between liquids [N]; zero between two solids' particles.

    (2) with M1, M2: F_ij = -(V_i^2 p_i phi_j + V_j^2 p_j phi_i) W' e_ij, phi = 1 in the liquid; solids have no pressure
    of their own. (3) with M3: F_ij = mu V V phi lap W (v_j - v_i). Density-weighted after Hu & Adams 2007:
    p_ij = (rho_j p_i + rho_i p_j)/(rho_i + rho_j).
    """
    real = type(r)
    own_fluid, fluid = phase_i == FLUID, phase_j == FLUID
    force = real(0), real(0), real(0)
    if own_fluid or fluid:
        mine, push = volume_i * volume_i * pressure_i, volume_j * volume_j * pressure_j
        both = volume_i * volume_j
        weight_i, weight_j = real(1), real(1)
        if own_fluid and not fluid:
            mine = mine / mass_i if coupling.printed_pressure else mine
            push, weight_j = real(0), relative_contribution_j
            both = volume_i * weight_j
        elif not own_fluid:
            mine, weight_i = real(0), relative_contribution_i
            push = push / mass_j if coupling.printed_pressure else push
            both = volume_j * weight_i
        elif coupling.density_weighted:
            rho_i, rho_j = mass_i / volume_i, mass_j / volume_j
            p = (rho_j * pressure_i + rho_i * pressure_j) / (rho_i + rho_j)
            mine, push = volume_i * volume_i * p, volume_j * volume_j * p
        f = -(mine * weight_j + push * weight_i) * kernel_slope(r, smoothing) / safe_distance(r, smoothing)
        force = added(force, scaled(x_ij, f))
        if viscosity is not None:
            if own_fluid != fluid and not coupling.printed_viscosity:
                both *= volume_i if own_fluid else volume_j
            g = viscosity.coefficient * both * viscosity_laplacian(r, smoothing)
            force = added(force, scaled(difference(velocity_j, velocity_i), g))
    return force[0], force[1], force[2]


@pair
def wall_push_pair(r, x_ij, density_i, rest_density_i, pressure_i, volume_j, smoothing):
    """Shao & Song (2) at a wall particle, m_i phi_b = Psi_b: -Psi_b p_i/rho_i^2 W' e_ib [m/s^2]."""
    f = -(rest_density_i * volume_j) * pressure_i / (density_i * density_i) * gradient_factor(r, smoothing)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


@kernel(lanes=True)
def forces(
    i, lane, position, velocity, mass, density, rest_density, phase, pressure, volume, relative_contribution,
    neighbours, walls, smoothing, coupling, viscosity, acceleration,
):  # fmt: skip
    """Shao & Song (2), (3) and the forces between liquids, walls included; added to the acceleration [m/s^2].

    A solid's particle gathers the reaction of the liquid around it.
    """
    if phase[i] == INTERIOR:
        return
    force = neighbour_sum(
        force_pair, i, lane, neighbours, position, None, velocity, mass, phase, pressure, volume,
        relative_contribution, smoothing, coupling, viscosity,
    )  # fmt: skip
    a = over(force, mass[i])
    if walls is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
        if phase[i] == FLUID:
            of_walls = neighbour_sum(
                wall_push_pair, i, lane, walls, position, None, density, rest_density, pressure, walls.volume, smoothing
            )  # fmt: skip
            a = added(a, of_walls)
    add_vector(acceleration, i, lane, a)


@formula
def pulled(i, position, velocity, followed_velocity, lean, turning, delay):
    """g - a_k [m/s^2], a_k = (v_k - u_k)/tau the acceleration of a solid's particle."""
    a = over(difference(three(velocity, i), three(followed_velocity, i)), delay.tau)
    return difference(felt(i, position, velocity, lean, turning), a)


@pair
def held_pair(r, x_ij, phase_j, density_j, pressure_j, smoothing, pull):
    """Adami 2012 (27) at a solid's particle: W p, p = p_f + rho_f (g - a_k).(x_k - x_f), and W p_f [Pa/m^dim]; and W
    [1/m^dim]. `pull` is g - a_k.
    """
    real = type(r)
    if phase_j != FLUID:
        return real(0), real(0), real(0)
    w = kernel_value(r, smoothing)
    p = w * pressure_j
    return p + w * (density_j * dot(pull, x_ij)), p, w


@kernel(lanes=True)
def extrapolation(
    i, lane, position, velocity, followed_velocity, phase, density, neighbours, smoothing, lean, turning, delay, wet,
    suction, pressure,
):  # fmt: skip
    """Adami 2012 (27): pressure of a solid's particle [Pa], the least one of a film there [Pa], and the sum of W over
    W(0); 0 without liquid in reach."""
    zero = type(smoothing.support_radius)(0)
    if phase[i] == FLUID:
        if first_lane(lane):
            wet[i] = suction[i] = zero
        return
    pull = pulled(i, position, velocity, followed_velocity, lean, turning, delay)
    total, alone, weights = neighbour_sum(
        held_pair, i, lane, neighbours, position, None, phase, density, pressure, smoothing, pull
    )
    if first_lane(lane):
        near = weights / own_share(smoothing)
        if near <= type(zero)(LEAST):  # liquid that rounding alone takes within h
            total = alone = near = zero
        wet[i] = near
        pressure[i] = total / weights if near != zero else zero
        suction[i] = zero if alone >= zero else type(zero)(SUCKED) * alone / weights


@pair
def spread_pair(r, x_ij, told_wet_j, told_pressure_j, told_suction_j, smoothing, fluid, pull):
    """W_ks w_s (p_s + rho0 (g - a_k).(x_k - x_s)) and W_ks w_s times suction [Pa/m^dim], W_ks w_s and W_ks
    [1/m^dim]. `pull` is g - a_k.
    """
    zero = type(r)(0)
    if told_wet_j == zero:
        return zero, zero, zero, zero
    w = kernel_value(r, smoothing)
    weight = w * told_wet_j
    p = told_pressure_j + fluid.rest_density * dot(pull, x_ij)
    return weight * p, weight * told_suction_j, weight, w


@kernel(lanes=True)
def spread(
    i, lane, position, velocity, followed_velocity, phase, told_wet, told_pressure, told_suction, neighbours,
    smoothing, fluid, lean, turning, delay, wet, suction, pressure,
):  # fmt: skip
    """What `extrapolation` tells [-, Pa], of a solid's particle without liquid in reach, by a film from those that had
    some in the step before; 0 without any. g - a_k is no longer than g: films have no inertia to hold bodies back."""
    zero = type(smoothing.support_radius)(0)
    if phase[i] == FLUID or wet[i] > zero:
        return
    pull = pulled(i, position, velocity, followed_velocity, lean, turning, delay)
    g = felt(i, position, velocity, lean, turning)
    most, much = dot(g, g), dot(pull, pull)
    if much > most:
        pull = scaled(pull, type(zero)(math.sqrt(most / much)))
    total, alone, weights, whole = neighbour_sum(
        spread_pair, i, lane, neighbours, position, None, told_wet, told_pressure, told_suction, smoothing, fluid, pull
    )
    if first_lane(lane) and not weights <= type(zero)(LEAST) * whole:  # NaN goes on
        wet[i] = type(zero)(PASSED) * weights / whole
        pressure[i] = total / weights
        suction[i] = alone / weights


@pair
def overlap_pair(
    r, x_ij, velocity_i, velocity_j, phase_j, solid_number_i, solid_number_j, smoothing, overlapping
):  # fmt: skip
    """C_ks of another solid's particle, dimensionless, and dC_ks/dt [1/s]."""
    if phase_j == FLUID or solid_number_i == solid_number_j:
        return type(r)(0), type(r)(0)
    near = nearness(r, overlapping)
    return near * near * near, -steepness(r, overlapping) * dot(difference(velocity_i, velocity_j), x_ij)


@pair
def wall_overlap_pair(r, x_ij, velocity_i, place_j, volume_j, smoothing, overlapping, bounds):
    """The same of a wall particle at rest, V_b/d^dim times: C of planes across x, y, z and of meshes, and dC/dt."""
    share, near = volume_j * overlapping.inverse_volume, nearness(r, overlapping)
    o = scaled(side(place_j, bounds), share)
    c, rate = near * near * near, -steepness(r, overlapping) * dot(velocity_i, x_ij)
    return o[0] * c, o[1] * c, o[2] * c, o[3] * c, o[0] * rate, o[1] * rate, o[2] * rate, o[3] * rate


@kernel(lanes=True)
def overlap(
    i, lane, position, velocity, phase, solid_number, neighbours, walls, bounds, smoothing, overlapping,
    allowed_closeness, contact_pressure, plane_pressure,
):  # fmt: skip
    """Pressure of contact [Pa] at a solid's particle to which other solids, meshes or planes are closer than
    ever, and than a spacing."""
    zero = type(smoothing.support_radius)(0)
    planes = zero, zero, zero, zero, zero, zero, zero, zero
    if phase[i] == FLUID:
        if first_lane(lane):
            contact_pressure[i] = zero
        set_vector(plane_pressure, i, lane, planes[0:3])
        return
    close, growth = neighbour_sum(
        overlap_pair, i, lane, neighbours, position, None, velocity, phase, solid_number, smoothing, overlapping
    )  # fmt: skip
    if walls is not None:
        planes = neighbour_sum(
            wall_overlap_pair, i, lane, walls, position, None, velocity, walls.position, walls.volume, smoothing,
            overlapping, bounds,
        )  # fmt: skip
        close, growth = close + planes[3], growth + planes[7]
    most = max(max(close, planes[0]), max(planes[1], planes[2]))
    allowed = min(allowed_closeness[i], max(most, type(zero)(1)))
    total = close + planes[0] + planes[1] + planes[2]
    across = (
        pressed(planes[0], allowed, planes[4], total, overlapping),
        pressed(planes[1], allowed, planes[5], total, overlapping),
        pressed(planes[2], allowed, planes[6], total, overlapping),
    )
    set_vector(plane_pressure, i, lane, across)
    if first_lane(lane):
        allowed_closeness[i] = allowed
        contact_pressure[i] = pressed(close, allowed, growth, total, overlapping)


@pair
def contact_pair(
    r, x_ij, mass_i, mass_j, phase_j, solid_number_i, solid_number_j, contact_pressure_i, contact_pressure_j, smoothing,
    fluid, overlapping,
):  # fmt: skip
    """-(b_k + b_s) grad C_ks of another solid's particle, b = s C/C_all [Pa/m]; of the lighter, of less if light."""
    f = type(r)(0)
    if phase_j != FLUID and solid_number_i != solid_number_j:
        f = (contact_pressure_i + contact_pressure_j) * steepness(r, overlapping)
        f *= lightness(min(mass_i, mass_j), fluid, overlapping)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


@pair
def wall_contact_pair(
    r, x_ij, mass_i, contact_pressure_i, plane_pressure_i, place_j, volume_j, smoothing, fluid, overlapping, bounds
):  # fmt: skip
    """The same of a wall particle, V_b/d^dim times, with b_b = b_k of its planes."""
    o, share = side(place_j, bounds), volume_j * overlapping.inverse_volume * lightness(mass_i, fluid, overlapping)
    b = dot(o[0:3], plane_pressure_i) + o[3] * contact_pressure_i
    f = share * (b + b) * steepness(r, overlapping)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


@kernel(lanes=True)
def contact(
    i, lane, position, mass, phase, solid_number, contact_pressure, plane_pressure, neighbours, walls, bounds,
    smoothing, fluid, overlapping, acceleration,
):  # fmt: skip
    """What presses a solid's particle off other solids and walls; added to the acceleration [m/s^2]."""
    if phase[i] == FLUID:
        return
    force = neighbour_sum(
        contact_pair, i, lane, neighbours, position, None, mass, phase, solid_number, contact_pressure, smoothing,
        fluid, overlapping,
    )  # fmt: skip
    if walls is not None:
        of_walls = neighbour_sum(
            wall_contact_pair, i, lane, walls, position, None, mass, contact_pressure, plane_pressure, walls.position,
            walls.volume, smoothing, fluid, overlapping, bounds,
        )  # fmt: skip
        force = added(force, of_walls)
    add_vector(acceleration, i, lane, over(force, mass[i] * overlapping.inverse_volume))


@pair
def around_pair(r, x_ij, phase_j, solid_number_i, solid_number_j, mass_j, density_j, smoothing):
    """V_j grad W_kj [1/m] of a neighbour, and the same and its length of other solids alone."""
    slope = mass_j / density_j * gradient_factor(r, smoothing)
    g, other = scaled(x_ij, slope), type(r)(phase_j != FLUID and solid_number_i != solid_number_j)
    return g[0], g[1], g[2], other * g[0], other * g[1], other * g[2], -other * slope * r


@pair
def wall_around_pair(r, x_ij, volume_j, smoothing):
    """The same of a wall particle."""
    slope = volume_j * gradient_factor(r, smoothing)
    g = scaled(x_ij, slope)
    return g[0], g[1], g[2], -slope * r


@kernel(lanes=True)
def close_films(
    i, lane, position, velocity, phase, solid_number, mass, density, pressure, neighbours, walls, smoothing, fluid,
    lean, turning, film_factor,
):  # fmt: skip
    """g_k = 1 - G_film.G/|G_film|^2, dimensionless, 1 to WIDENED, at a solid's particle; 1 in the liquid.

    G = sum_j V_j grad W_kj, G_film its part by other solids and walls, whose sides that face each other count little.
    Near a surface what is missing may be air: g_k - 1 has the share 1/(1 + (P/p_k)^4), P = rho0 |g| h/2, g as felt
    at k; and, as liquid is not even, q^2/(q^2 + LOOSE^2), q = -h G_film.G/|G_film|.
    """
    one = type(smoothing.support_radius)(1)
    factor = one
    if phase[i] != FLUID:
        total = neighbour_sum(
            around_pair, i, lane, neighbours, position, None, phase, solid_number, mass, density, smoothing
        )  # fmt: skip
        around, film, most = total[0:3], total[3:6], total[6]
        if walls is not None:
            of_walls = neighbour_sum(wall_around_pair, i, lane, walls, position, None, walls.volume, smoothing)
            around, film = added(around, of_walls[0:3]), added(film, of_walls[0:3])
            most += of_walls[3]
        lacking, square = -dot(around, film), max(dot(film, film), type(one)(FACING) * most * most)
        if not (lacking <= type(one)(0) or square <= type(one)(0)):  # NaN goes on
            h, wider = smoothing.support_radius, lacking / square
            if wider > type(one)(WIDENED - 1):
                wider = type(one)(WIDENED - 1)
            g = felt(i, position, velocity, lean, turning)
            deep = fluid.rest_density * type(one)(math.sqrt(dot(g, g))) * h / type(one)(2)
            much = (h * lacking) * (h * lacking) / type(one)(LOOSE * LOOSE)
            if not pressure[i] <= type(one)(0):
                near = (deep / pressure[i]) * (deep / pressure[i])
                factor = one + wider * (much / (much + square)) / (one + near * near)
    if first_lane(lane):
        film_factor[i] = factor


@pair
def push_pair(
    r, x_ij, phase_i, phase_j, solid_number_i, solid_number_j, mass_j, density_j, pressure_i, pressure_j, suction_i,
    suction_j, film_factor_i, film_factor_j, smoothing, fluid,
):  # fmt: skip
    """J(10) [N/m^3] of a neighbour, by a film between two solids; none between particles of one solid."""
    f, met = type(r)(0), phase_i == FLUID or phase_j == FLUID
    if met or solid_number_i != solid_number_j:
        p = pressure_i + pressure_j
        if not met:
            p = film_pressure(p, suction_i + suction_j) * (type(r)(0.5) * (film_factor_i + film_factor_j))
        f = pressure_pair(mass_j / density_j, p, type(r)(0), gradient_factor(r, smoothing), fluid)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


push = force(push_pair, divided="density")


@pair
def hold_pair(
    r, x_ij, velocity_i, velocity_j, phase_i, phase_j, mass_j, density_j, smoothing, central_viscosity
):  # fmt: skip
    """Viscosity along the line of centres [N/m^3] between liquid and solid; none between others."""
    f = central_pair(r, x_ij, velocity_i, velocity_j, mass_j, density_j, smoothing, central_viscosity)
    real = type(r)
    share = real(1) if (phase_i == FLUID) != (phase_j == FLUID) else real(0)
    return share * f[0], share * f[1], share * f[2]


hold = force(hold_pair, divided="density")


@kernel
def follow(
    i, velocity, wet, pressure, suction, delay, timestep, followed_velocity, told_wet, told_pressure, told_suction
):
    """Velocity u that follows that of particle i [m/s], with the delay tau: u += (v - u) dt/tau; and what the next step
    spreads."""
    for c in range(3):
        before = followed_velocity[i, c]
        followed_velocity[i, c] = before + (velocity[i, c] - before) * timestep[0] / delay.tau
    told_wet[i], told_pressure[i], told_suction[i] = wet[i], pressure[i], suction[i]
