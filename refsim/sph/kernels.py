"""What one pair of particles and one particle do in weakly compressible SPH."""

import math

from refsim.backends.compile import formula, kernel
from refsim.backends.reductions import reduction
from refsim.backends.tuples import added, cross, difference, dot, over, scaled, three
from refsim.motion.formulas import felt
from refsim.neighbours.forces import force, joined, together
from refsim.neighbours.formulas import longest_of
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.neighbours.rows import add_vector, first_lane, set_vector
from refsim.smoothing.formulas import (
    gradient_factor,
    kernel_slope,
    kernel_value,
    quick_inverse,
    safe_distance,
    undivided_factor,
    viscosity_laplacian,
)
from refsim.sph import formulas
from refsim.sph.formulas import central_viscosity_pair, corrected, pressure_pair, viscosity_pair, volume_of

LIQUID_PHASE = 0  # in `phase`; solids have others


@pair
def density_pair(r, mass_j, smoothing):
    """Terms of J(7) [kg/m^dim] and J(8) [1/m^dim]."""
    w = kernel_value(r, smoothing)
    return mass_j * w, w


@pair
def density_moment_pair(r, x_ij, mass_j, smoothing):
    """Terms of J(7), J(8) and sum W_ij x_ij."""
    mass_w, w = density_pair(r, mass_j, smoothing)
    return mass_w, w, w * x_ij[0], w * x_ij[1], w * x_ij[2]


@pair
def wall_density_pair(r, volume_j, smoothing):
    """V_b W_ib, dimensionless."""
    return volume_j * kernel_value(r, smoothing)


@pair
def wall_moment_pair(r, x_ij, volume_j, smoothing):
    """V_b W_ib, dimensionless, and V_b W_ib x_ib [m]."""
    w = wall_density_pair(r, volume_j, smoothing)
    return w, w * x_ij[0], w * x_ij[1], w * x_ij[2]


@kernel(lanes=True, registers=32)
def density(i, lane, position, mass, neighbours, walls, smoothing, fluid, period, number_density, asymmetry, density):
    """J(7) [kg/m^dim]; J(8) where `number_density` is requested, |sum W_ij x_ij| where `asymmetry` is."""
    zero = type(smoothing.support_radius)(0)
    moment = zero, zero, zero
    if asymmetry is None:
        rho, number = neighbour_sum(density_pair, i, lane, neighbours, position, period, mass, smoothing)
    else:
        found = neighbour_sum(density_moment_pair, i, lane, neighbours, position, period, mass, smoothing)
        rho, number, moment = found[0], found[1], found[2:5]
    sums = rho, number, moment[0], moment[1], moment[2]
    put_sums(
        i, lane, sums, (position, mass), walls, (smoothing, fluid), period, number_density, asymmetry, density
    )  # fmt: skip


@formula(inlined=True)
def put_sums(i, lane, sums, fields, walls, groups, period, number_density, asymmetry, density):
    """Write what `density` says [kg/m^dim] with the neighbours' sums; the own part and the walls' are added."""
    (position, mass), (smoothing, fluid) = fields, groups
    rho, number, moment = sums[0], sums[1], sums[2:5]
    w0 = own_share(smoothing)
    if not number >= type(w0)(0):  # keeps the sum of W in every variant, so that the density has the same bits in all
        rho = number
    rho += mass[i] * w0
    number += w0
    if walls is not None:
        if asymmetry is None:
            filled = wall_sum(i, lane, position, walls, smoothing, period)
        else:
            beside = neighbour_sum(wall_moment_pair, i, lane, walls, position, period, walls.volume, smoothing)
            filled, moment = beside[0], added(moment, scaled(beside[1:4], fluid.rest_density / mass[i]))
        filled *= fluid.rest_density
        rho += filled
        number += filled / mass[i]
    if first_lane(lane):
        density[i] = rho
        if number_density is not None:
            number_density[i] = number
        if asymmetry is not None:
            asymmetry[i] = math.sqrt(dot(moment, moment))


@formula
def own_share(smoothing):
    """W(0) [1/m^dim]: the particle's own part in J(7) and J(8)."""
    return kernel_value(type(smoothing.support_radius)(0), smoothing)


@formula
def wall_sum(i, lane, position, walls, smoothing, period):
    """Sum of V_b W_ib over the wall particles; dimensionless."""
    return neighbour_sum(wall_density_pair, i, lane, walls, position, period, walls.volume, smoothing)


@pair
def wall_gradient_pair(r, x_ij, volume_j, smoothing, weight):
    """w V_b grad W_ib [1/m, times the unit of the weight w]."""
    f = weight * volume_j * gradient_factor(r, smoothing)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


@formula
def wall_gradient(i, lane, position, walls, smoothing, weight, period):
    """Sum of w V_b grad W_ib over the wall particles [1/m, times the unit of the weight w]."""
    return neighbour_sum(wall_gradient_pair, i, lane, walls, position, period, walls.volume, smoothing, weight)


@pair
def continuity_pair(
    r, x_ij, velocity_i, velocity_j, volume_j, rest_density_j, phase_j, advanced_excess_i, advanced_excess_j, borne_i,
    borne_j, shift_i, shift_j, smoothing, fluid, central_viscosity, diffusion, lean, turning, recount, own_rest,
    per_step,
):  # fmt: skip
    """(d rho_i/dt)/rho_i by the flow [1/s], d rho_i/dt by diffusion [kg/(m^dim s)], by liquid alone, -V_j r W' of
    liquid, where it is counted V_j W_ij, -V_j r W' of solids, and viscosity along the line of centres [N/m^3].
    """
    approach, f, slope = dot(difference(velocity_i, velocity_j), x_ij), type(r)(0), undivided_factor(r, smoothing)
    if central_viscosity is not None:
        squared = dot(x_ij, x_ij)  # known before its root
        inverse = quick_inverse(squared if squared > type(r)(0) else smoothing.support_radius)
        f = -central_viscosity_pair(volume_j, central_viscosity, viscosity_laplacian(r, smoothing)) * approach * inverse
    x, y, z = scaled(x_ij, f)
    if shift_j is not None:
        rest = fluid.rest_density if rest_density_j is None else rest_density_j
        more = ((rest - own_rest) + (advanced_excess_j - advanced_excess_i)) / (own_rest + advanced_excess_i)
        approach += per_step * formulas.shift_approach(dot(shift_i, x_ij), more * dot(shift_j, x_ij))
    spread = filled = held = type(r)(0)
    around = -volume_j * slope * r * r
    if diffusion is not None:
        head = type(r)(0)
        if borne_j is not None:
            head = dot(lean, x_ij)
            if turning is not None:  # from the pull at i to the mean of both
                across = cross((turning[0], turning[1], turning[2]), x_ij)
                head -= type(r)(0.5) * dot(across, across)
            head *= borne_i * borne_j
        spread = formulas.diffusion_pair(volume_j, advanced_excess_i, advanced_excess_j, head, slope, diffusion)
    if recount is not None:
        filled = volume_j * kernel_value(r, smoothing)
    if phase_j is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
        if phase_j != LIQUID_PHASE:
            spread, around, held = type(r)(0), type(r)(0), around
    return formulas.continuity_pair(volume_j, approach, slope), spread, around, filled, held, x, y, z


@pair
def wall_continuity_pair(
    r, x_ij, velocity_i, shift_i, volume_j, wall_normal_j, wall_strain_j, smoothing, recount, number, per_step
):
    """(d rho_i/dt)/rho_i by a wall particle at rest [1/s], of what moves across it where it has a normal, -V_b r W',
    (d rho_i/dt)/rho_i by its strain, `number` = 1/V_i [1/m^dim], and, where it is counted, V_b W_ib.
    """
    v = velocity_i
    if wall_normal_j is not None:
        v = formulas.across(v, wall_normal_j)
    approach = dot(v, x_ij)
    if shift_i is not None:
        approach += per_step * formulas.shift_approach(dot(shift_i, x_ij), type(r)(0))
    slope = gradient_factor(r, smoothing)
    given = type(r)(0)
    if wall_strain_j is not None:
        given = number * wall_strain_j * kernel_value(r, smoothing)
    filled = type(r)(0)
    if recount is not None:
        filled = volume_j * kernel_value(r, smoothing)
    return formulas.continuity_pair(volume_j, approach, slope), -volume_j * slope * r * r, given, filled


@kernel(lanes=True)
def continuity(
    i, lane, position, velocity, volume, rest_density, phase, advanced_excess, borne, wall_strain, shift, neighbours,
    walls, wall_normal, smoothing, fluid, central_viscosity, diffusion, lean, turning, recount, period, timestep,
    acceleration, filling, pressure, density_excess, density,
):  # fmt: skip
    """Density after the step [kg/m^dim], its excess over rho0, pressure [Pa] and filling; solids keep their rest
    density. The acceleration [m/s^2] becomes that by viscosity with the density before."""
    rest = fluid.rest_density if rest_density is None else rest_density[i]
    per_step, pull = inverse_step(timestep, rest), felt(i, position, None, lean, turning)
    sums = neighbour_sum(
        continuity_pair, i, lane, neighbours, position, period, velocity, volume, rest_density, phase, advanced_excess,
        borne, shift, smoothing, fluid, central_viscosity, diffusion, pull, turning, recount, rest, per_step,
    )  # fmt: skip
    fields = position, velocity, volume, advanced_excess, density_excess, density
    given = sums, fields, rest, per_step, timestep, smoothing, period
    put_advanced(i, lane, given, walls, wall_normal, wall_strain, shift, diffusion, recount, filling)
    put_solid(i, lane, phase, rest, filling, density_excess, density)
    put_pressure(i, lane, density, fluid, pressure)
    if acceleration is not None:
        set_vector(acceleration, i, lane, over(sums[5:8], rest + advanced_excess[i]))


@formula
def inverse_step(timestep, zero_like):
    """1/dt [1/s]; 0 before the first step, as none has been taken."""
    real = type(zero_like)
    return real(1) / timestep[1] if timestep[1] > real(0) else real(0)


@formula(inlined=True)
def put_advanced(i, lane, given, walls, wall_normal, wall_strain, shift, diffusion, recount, filling):
    """Write what `continuity` says [kg/m^dim] with the neighbours' sums; the walls' are added."""
    sums, fields, rest, per_step, timestep, smoothing, period = given
    position, velocity, volume, advanced_excess, density_excess, density = fields
    rate, spread, fill, filled, held = sums[0:5]
    strain = type(rest)(0)
    if walls is not None:
        number = type(rest)(1) / volume[i]
        beside, around, strain, more = neighbour_sum(
            wall_continuity_pair, i, lane, walls, position, period, velocity, shift, walls.volume, wall_normal,
            wall_strain, smoothing, recount, number, per_step,
        )  # fmt: skip
        rate, held, filled = rate + beside, held + around, filled + more
    dim = type(fill)(smoothing.dim)
    inside = formulas.surrounded_share(fill / dim, held / dim)
    rate += inside * strain
    excess = advanced_excess[i]
    if recount is not None:
        share = (filled + volume[i] * own_share(smoothing)) * recount.whole
        rate += recount.rate * inside * (share - type(share)(1))
        if filling is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
            if first_lane(lane):
                filling[i] = share
    if first_lane(lane):
        excess += timestep[1] * ((rest + excess) * rate + spread)
        if diffusion is not None:
            lone = formulas.lone_share((fill + held) / dim)
            excess /= type(rest)(1) + timestep[1] * lone * diffusion.release
        excess = formulas.least_excess(excess, rest)
        density_excess[i] = excess
        density[i] = rest + excess


@formula(inlined=True)
def put_solid(i, lane, phase, rest, filling, density_excess, density):
    """Write over what `put_advanced` wrote: solids keep their rest density [kg/m^dim] and are filled."""
    if phase is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
        if phase[i] != LIQUID_PHASE and first_lane(lane):
            density_excess[i] = type(rest)(0)
            density[i] = rest
            if filling is not None:
                filling[i] = type(rest)(1)


@formula(inlined=True)
def put_pressure(i, lane, density, fluid, pressure):
    """J(9) or Tait's equation of state [Pa] with the density that stands there."""
    if pressure is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
        if first_lane(lane):
            pressure[i] = formulas.state_pressure(density[i], fluid)


continuity_and_sums_pair = joined(
    "continuity_and_sums_pair", (continuity_pair, {"smoothing": "gradient_smoothing"}), (density_moment_pair, {})
)


@kernel(lanes=True)
def continuity_and_sums(
    i, lane, position, velocity, volume, mass, rest_density, phase, advanced_excess, borne, wall_strain, shift,
    neighbours, walls, wall_normal, gradient_smoothing, smoothing, fluid, central_viscosity, diffusion, lean, turning,
    recount, period, timestep, number_density, asymmetry, summed_density, acceleration, filling, pressure,
    density_excess, density,
):  # fmt: skip
    """`continuity`, and `density` beside it, with the variants of both [kg/m^dim]."""
    rest = fluid.rest_density if rest_density is None else rest_density[i]
    per_step, pull = inverse_step(timestep, rest), felt(i, position, None, lean, turning)
    sums = neighbour_sum(
        continuity_and_sums_pair, i, lane, neighbours, position, period, velocity, volume, rest_density, phase,
        advanced_excess, borne, shift, gradient_smoothing, fluid, central_viscosity, diffusion, pull, turning, recount,
        rest, per_step, mass, smoothing,
    )  # fmt: skip
    fields = position, velocity, volume, advanced_excess, density_excess, density
    given = sums[0:5], fields, rest, per_step, timestep, gradient_smoothing, period
    put_advanced(i, lane, given, walls, wall_normal, wall_strain, shift, diffusion, recount, filling)
    put_solid(i, lane, phase, rest, filling, density_excess, density)
    put_pressure(i, lane, density, fluid, pressure)
    if acceleration is not None:
        set_vector(acceleration, i, lane, over(sums[5:8], rest + advanced_excess[i]))
    groups = smoothing, fluid
    put_sums(
        i, lane, sums[8:13], (position, mass), walls, groups, period, number_density, asymmetry, summed_density
    )  # fmt: skip


@formula
def wall_moves(place, wall_motion):
    """Whether a wall particle at `place` [m] stands beyond one of the planes of `wall_motion`."""
    low, high = wall_motion.lower, wall_motion.upper
    below = place[0] < low[0] or place[1] < low[1] or place[2] < low[2]
    return below or place[0] > high[0] or place[1] > high[1] or place[2] > high[2]


@kernel(looping=True)
def volume_before(i, mass, rest_density, advanced_excess, fluid, volume):
    """V = m/rho [m^dim] of the density that the step before advanced."""
    rest = fluid.rest_density if rest_density is None else rest_density[i]
    volume[i] = mass[i] / (rest + advanced_excess[i])


@kernel(looping=True)
def keep_density(i, position, velocity, density_excess, acceleration, lean, turning, borne, advanced_excess):
    """The excess of the density [kg/m^dim], from which the next step goes on, and b of `borne_share` [-]."""
    advanced_excess[i] = density_excess[i]
    if borne is not None:
        pull = felt(i, position, velocity, lean, turning)
        borne[i] = formulas.borne_share(dot(pull, pull), dot(pull, three(acceleration, i)))


@kernel(looping=True)
def state(i, density, fluid, pressure):
    """J(9) or Tait's equation of state [Pa]."""
    pressure[i] = formulas.state_pressure(density[i], fluid)


@pair
def momentum_pair(
    r, x_ij, velocity_i, velocity_j, mass_j, density_j, pressure_i, pressure_j, smoothing, fluid, viscosity
):
    """J(10) and, unless `viscosity` is None, J(11) [N/m^3]."""
    apart = safe_distance(r, smoothing)
    share = mass_j / (density_j * apart)  # V_j/r: one division serves both terms
    f = pressure_pair(share, pressure_i, pressure_j, kernel_slope(r, smoothing), fluid)
    total = scaled(x_ij, f)
    if viscosity is not None:
        g = viscosity_pair(share * apart, viscosity, viscosity_laplacian(r, smoothing))
        total = added(total, scaled(difference(velocity_j, velocity_i), g))
    return total[0], total[1], total[2]


@pair
def filling_pair(r, x_ij, mass_j, density_j, smoothing):
    """-V_j x_ij grad W_ij as (xx, yy, zz, xy, xz, yz), V_j as `volume_of` says; dimensionless."""
    f = -volume_of(mass_j, density_j) * gradient_factor(r, smoothing)
    x, y, z = x_ij[0], x_ij[1], x_ij[2]
    return f * x * x, f * y * y, f * z * z, f * x * y, f * x * z, f * y * z


@kernel(lanes=True)
def gradient_correction(
    i, lane, position, mass, density, neighbours, walls, smoothing, period, correction_diagonal, correction_mixed
):  # fmt: skip
    """Bonet & Lok 1999: matrix B_i of the gradients, dimensionless."""
    sums = neighbour_sum(filling_pair, i, lane, neighbours, position, period, mass, density, smoothing)
    if walls is not None:
        sums = added(sums, neighbour_sum(filling_pair, i, lane, walls, position, period, walls.volume, None, smoothing))
    matrix = formulas.gradient_correction(sums[0], sums[1], sums[2], sums[3], sums[4], sums[5], smoothing)
    set_vector(correction_diagonal, i, lane, matrix[0:3])
    set_vector(correction_mixed, i, lane, matrix[3:6])


@kernel
def own_pressure(i, pressure, near_surface, own_pressure):
    """Sun et al. 2018: pressure of the particle in its own force [Pa]."""
    if near_surface is None:
        own_pressure[i] = formulas.own_pressure(pressure[i], False)
    else:
        own_pressure[i] = formulas.own_pressure(pressure[i], near_surface[i] != 0)


@pair
def corrected_pressure_pair(
    r, x_ij, mass_j, density_j, own_pressure_i, pressure_j, correction_diagonal_i, correction_mixed_i,
    correction_diagonal_j, correction_mixed_j, smoothing, fluid,
):  # fmt: skip
    """J(10) along the mean of both particles' corrected gradients [N/m^3]."""
    f = pressure_pair(mass_j / density_j, own_pressure_i, pressure_j, gradient_factor(r, smoothing), fluid)
    x, y, z = x_ij[0], x_ij[1], x_ij[2]
    if correction_diagonal_i is not None:
        gradient = corrected(correction_diagonal_i, correction_mixed_i, x_ij)
        x, y, z = scaled(added(gradient, corrected(correction_diagonal_j, correction_mixed_j, x_ij)), type(f)(0.5))
    return f * x, f * y, f * z


corrected_pressure = force(corrected_pressure_pair, divided="density", period=True)


@pair
def central_momentum_pair(
    r, x_ij, velocity_i, velocity_j, volume_j, density_j, pressure_i, pressure_j, smoothing, fluid, central_viscosity
):
    """J(10) and, unless `central_viscosity` is None, the viscosity along the line of centres [N/m^3], V_j as
    `volume_of` says."""
    volume = volume_of(volume_j, density_j)
    f = pressure_pair(volume, pressure_i, pressure_j, undivided_factor(r, smoothing), fluid)
    if central_viscosity is not None:
        apart = safe_distance(r, smoothing)
        parting = dot(difference(velocity_j, velocity_i), x_ij)
        laplacian = viscosity_laplacian(r, smoothing)
        f += central_viscosity_pair(volume, central_viscosity, laplacian) * parting / (apart * apart)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


@kernel(lanes=True)
def central_momentum(
    i, lane, position, velocity, volume, mass, density, pressure, neighbours, smoothing, fluid, central_viscosity,
    period, acceleration,
):  # fmt: skip
    """J(10) and, unless `central_viscosity` is None, the viscosity along the line of centres; added to the acceleration
    [m/s^2]."""
    a = neighbour_sum(
        central_momentum_pair, i, lane, neighbours, position, period, velocity, volume, density, pressure, smoothing,
        fluid, central_viscosity,
    )  # fmt: skip
    add_vector(acceleration, i, lane, scaled(a, specific_volume(i, volume, mass, density)))


@formula
def specific_volume(i, volume, mass, density):
    """V_i/m_i [m^dim/kg], V_i as `volume_of` says."""
    if density is None:
        return volume[i] / mass[i]
    return volume[i] / (mass[i] * density[i])


@pair
def wall_push_pair(r, x_ij, density_i, pressure_i, volume_j, smoothing, fluid):
    """Akinci 2012: -k s Psi_b p_i/rho_i^2 W'(r) e_ib by the mirrored pressure of a wall particle, k = 2 for p_b = p_i
    [m/s^2]."""
    share = fluid.wall_share * fluid.gradient_share * (fluid.rest_density * volume_j)
    f = -share * pressure_i / (density_i * density_i) * gradient_factor(r, smoothing)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


@formula
def wall_pressure(i, lane, position, density, pressure, walls, smoothing, fluid, period):
    """Akinci 2012: acceleration of particle i by the walls' mirrored pressure [m/s^2]."""
    return neighbour_sum(
        wall_push_pair, i, lane, walls, position, period, density, pressure, walls.volume, smoothing, fluid
    )


momentum = force(momentum_pair, divided="density", walled=wall_pressure, period=True)


def with_momentum(tension, names=None, per_volume=False):
    """Pair functions and kernels that sum a tension in one loop with `momentum`, and with `central_momentum`."""
    return (
        *together("tension_and_momentum", momentum_pair, tension, wall_pressure, names, per_volume),
        *together("tension_and_central_momentum", central_momentum_pair, tension, None, names, per_volume),
    )


@pair
def viscous_pair(r, velocity_i, velocity_j, mass_j, density_j, smoothing, viscosity):
    """J(11) [N/m^3]."""
    f = viscosity_pair(mass_j / density_j, viscosity, viscosity_laplacian(r, smoothing))
    return f * (velocity_j[0] - velocity_i[0]), f * (velocity_j[1] - velocity_i[1]), f * (velocity_j[2] - velocity_i[2])


viscous = force(viscous_pair, divided="density", period=True)


@pair
def central_pair(r, x_ij, velocity_i, velocity_j, mass_j, density_j, smoothing, central_viscosity):
    """Viscosity along the line of centres [N/m^3]."""
    laplacian = viscosity_laplacian(r, smoothing)
    g = central_viscosity_pair(mass_j / density_j, central_viscosity, laplacian)
    parting = dot(difference(velocity_j, velocity_i), x_ij)
    apart = safe_distance(r, smoothing)
    f = g * parting / (apart * apart)  # a product with 1/r^2 may overflow: its factors are taken in any order
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


central_viscous = force(central_pair, "central_viscous", divided="density", period=True)


@kernel(looping=True)
def gravity(i, field, acceleration):
    """Uniform acceleration [m/s^2]."""
    for c in range(3):
        acceleration[i, c] += field[c]


# Maxima over all particles, and the leap-frog step that yields the largest displacement


@reduction(into="extremes", how="largest largest count largest largest count count", rows="velocity")
def extremes(
    i, velocity, acceleration, temperature, temperature_range, exchange_rate, density, rest_density, density_bounds,
):  # fmt: skip
    """What particle i adds to E, |v|^2 [m^2/s^2] first; 0 for the rate, the excess and the bounds that are None."""
    speed = velocity[i, 0] ** 2 + velocity[i, 1] ** 2 + velocity[i, 2] ** 2
    push = acceleration[i, 0] ** 2 + acceleration[i, 1] ** 2 + acceleration[i, 2] ** 2
    # Numba's isfinite(x) tests x - x, which the compiler removes where sums may be taken in any order.
    beyond = type(speed)(math.inf)
    broken = not (speed < beyond and push < beyond)
    if temperature is not None:
        broken = broken or not abs(temperature[i]) < beyond
    rate, excess = type(speed)(0), type(speed)(0)
    if temperature_range is not None:
        excess = max(excess, max(temperature[i] - temperature_range[1], temperature_range[0] - temperature[i]))
    if exchange_rate is not None:
        rate = exchange_rate[i]
        broken = broken or not rate < beyond
    dense, crushed = False, False
    if density_bounds is not None:
        rest = density_bounds.rest_density
        if rest_density is not None:
            rest = rest_density[i]
        dense, crushed = density[i] > density_bounds.dense * rest, density[i] > density_bounds.crushed * rest
    return speed, push, broken, rate, excess, dense, crushed


@reduction(into="displacement", how="largest count largest", rows="position")
def kick_drift(
    i, acceleration, build_position, bounds, timestep, way, longest_shift, drawn_body, position_residual, velocity,
    position,
):  # fmt: skip
    """Leap-frog; (squared displacement since the build [m^2], whether a plane stopped it, squared shift [m^2])."""
    longest = longest_of(i, longest_shift, drawn_body, timestep[0])
    factors = timestep[0], timestep[1], longest
    given = position, position_residual, velocity, acceleration, build_position, bounds, factors, way
    u, x, a, squared_x, stopped_x = stepped_along(0, i, *given)
    v, y, b, squared_y, stopped_y = stepped_along(1, i, *given)
    w, z, c, squared_z, stopped_z = stepped_along(2, i, *given)
    # Written when all is read: an array might be the same memory as another, so that a GPU would wait for each value.
    velocity[i, 0], velocity[i, 1], velocity[i, 2] = u, v, w
    position[i, 0], position[i, 1], position[i, 2] = x, y, z
    if position_residual is not None:
        position_residual[i, 0], position_residual[i, 1], position_residual[i, 2] = a, b, c
    squared = squared_x + squared_y + squared_z
    if not squared >= type(squared)(0):  # NaN: a maximum over the particles would ignore it
        squared = type(squared)(math.inf)
    return squared, stopped_x or stopped_y or stopped_z, squared_shift(i, way, longest)


@formula
def squared_shift(i, way, longest):
    """|s_i|^2 [m^2], s = L way; 0 without shifts."""
    if way is None:
        return longest
    return longest * longest * dot(three(way, i), three(way, i))


@formula
def stepped_along(
    c, i, position, position_residual, velocity, acceleration, build_position, bounds, factors, way
):  # fmt: skip
    """(v [m/s], x [m], its residual [m], squared displacement [m^2], whether a plane stopped it) along axis c."""
    kick, drift, longest = factors
    v = velocity[i, c] + kick * acceleration[i, c]
    change, residual, stopped = drift * v, type(v)(0), False
    if way is not None:
        change += longest * way[i, c]
    if position_residual is not None:
        x, residual = formulas.drifted(position[i, c], position_residual[i, c], change)
    else:
        x = position[i, c] + change
    if bounds is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
        if (x < bounds.lower[c] or x > bounds.upper[c]) and formulas.between_ends(three(position, i), bounds):
            x = min(max(x, bounds.lower[c]), bounds.upper[c])
            v, residual, stopped = type(v)(0), type(v)(0), True
    moved = x - build_position[i, c]
    return v, x, residual, moved * moved, stopped
