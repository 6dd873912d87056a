"""What one neighbour and one particle do in heat conduction.

An exchange is a pair (i, j) within the support radius with its weight g = dt G_ij [J/K]; `schemes` says in which order
the kernels are launched, `weights` finds the exchanges.
"""

import numpy as np

from refsim.backends.compile import formula, kernel
from refsim.backends.tuples import difference, put, scaled, three
from refsim.heat import formulas
from refsim.heat.operations import Body
from refsim.heat.stages import chebyshev_omega, chebyshev_passes
from refsim.neighbours.formulas import to_nearest_image
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.neighbours.rows import first_lane, row_of


@formula
def held(i, reservoir):
    """Whether the temperature of particle i is held."""
    value = False
    if reservoir is not None:
        value = reservoir[i] != 0
    return value


@formula
def inverse_capacity(i, body, conduction):
    """1/C_i [K/J], C_i = m_i c_i, or V_i (Shao & Song M11); 0 for a reservoir, whose temperature is held."""
    real = type(conduction.support_radius)
    if held(i, body.reservoir):
        return real(0)
    if conduction.unit_capacity:
        return real(1) / body.volume[i]
    return real(1) / (body.mass[i] * body.heat_capacity[i])


@formula
def weight_at(q, volume_i, volume_j, conductivity_i, conductivity_j, seconds, conduction):
    """g of a pair at the distance q h [J/K]: 0 beyond h and for coincident particles."""
    real = type(q)
    if q >= real(1) or q <= real(0):
        return real(0)
    return formulas.pair_weight(q, volume_i, volume_j, conductivity_i, conductivity_j, seconds, conduction)


@formula
def factor_of(i, j, position, x, rest, period):
    """f_ij of particles i and j; 1 without a compensation."""
    value = position.dtype.type(1)
    if x is not None:
        dx, dy, dz = difference(three(position, i), three(position, j))
        away = to_nearest_image(dx, dy, dz, period)
        value = formulas.missing_factor(away, three(x, i), three(rest, i), three(x, j), three(rest, j))
    return value


@formula
def factor_in(body, i, j, period):
    """`factor_of` particles of a body."""
    return factor_of(i, j, body.position, body.compensation_x, body.compensation_rest, period)


@pair
def rate_pair(
    r, x_ij, volume_i, volume_j, conductivity_i, conductivity_j, compensation_x_i, compensation_x_j,
    compensation_rest_i, compensation_rest_j, conduction,
):  # fmt: skip
    """|G_ij| [W/K]."""
    q = r * conduction.inverse_radius
    f = formulas.missing_factor(x_ij, compensation_x_i, compensation_rest_i, compensation_x_j, compensation_rest_j)
    return f * abs(weight_at(q, volume_i, volume_j, conductivity_i, conductivity_j, type(q)(1), conduction))


@kernel(lanes=True)
def exchange_rate(
    i, lane, position, mass, volume, heat_capacity, conductivity, reservoir, compensation_x, compensation_rest,
    neighbours, conduction, period, exchange_rate,
):  # fmt: skip
    """s_i/dt = sum_j |G_ij|/C_i [1/s]."""
    body = Body(position, mass, volume, heat_capacity, conductivity, reservoir, compensation_x, compensation_rest)
    total = neighbour_sum(
        rate_pair, i, lane, neighbours, position, period, volume, conductivity, compensation_x, compensation_rest,
        conduction,
    )  # fmt: skip
    if first_lane(lane):
        exchange_rate[i] = total * inverse_capacity(i, body, conduction)


@pair
def moment_pair(
    r, x_ij, volume_j, compensation_x_i, compensation_x_j, compensation_rest_i, compensation_rest_j, conduction
):
    """V_j L_ij x_ij x_ij^T, and the same times f_ij, as (xx, xy, xz, yy, yz, zz); dimensionless."""
    x, y, z = scaled(x_ij, conduction.inverse_radius)
    f = formulas.missing_factor(x_ij, compensation_x_i, compensation_rest_i, compensation_x_j, compensation_rest_j)
    share = formulas.moment_share(r * conduction.inverse_radius, volume_j, conduction)
    xx, xy, xz, yy, yz, zz = share * x * x, share * x * y, share * x * z, share * y * y, share * y * z, share * z * z
    return xx, xy, xz, yy, yz, zz, f * xx, f * xy, f * xz, f * yy, f * yz, f * zz


@kernel(rows_of="velocity")
def note_rounds(i, velocity, compensation_x, rounds):
    """rounds[0] becomes 1 if a particle moves, rounds[1] if one has no A yet."""
    x, y, z = three(velocity, i)
    zero = type(x)(0)
    if not (x == zero and y == zero and z == zero):
        rounds[0] = 1
    if compensation_x[i, 0] == zero:
        rounds[1] = 1


@formula
def compensate_one(i, lane, weight, places, neighbours, old, compensation_x, compensation_rest):
    """A of particle i by a round from `old`; A = I for a reservoir."""
    sums = neighbour_sum(
        moment_pair, i, lane, neighbours, places.position, places.period, places.volume, old.x, old.rest,
        places.conduction,
    )  # fmt: skip
    if first_lane(lane):
        before, inverse = (*three(old.x, i), *three(old.rest, i)), formulas.inverse_moment(sums[0:6])
        a = formulas.compensated(before, inverse, sums[6:12], weight)
        if held(i, places.reservoir):
            one, zero = type(weight)(1), type(weight)(0)
            a = one, zero, zero, one, zero, one
        put(compensation_x, i, a[0:3])
        put(compensation_rest, i, a[3:6])


@kernel(lanes=True)
def compensate(i, lane, rounds, k, weight, places, neighbours, old, compensation_x, compensation_rest):
    """Round k of a start, or the one of a step in which something moves."""
    if rounds[1] != 0 or (k == 0 and rounds[0] != 0):
        compensate_one(i, lane, weight, places, neighbours, old, compensation_x, compensation_rest)


@kernel
def take_over(i, rounds, new, compensation_x, compensation_rest):
    """A as a round has made it, if one was wanted."""
    if rounds[0] != 0 or rounds[1] != 0:
        put(compensation_x, i, three(new.x, i))
        put(compensation_rest, i, three(new.rest, i))


@pair
def flow_pair(weight_ij, temperature_j, own):
    """g (T_j - T) [J] for a particle at T = `own` [degrees C]."""
    return weight_ij * (temperature_j - own)


@formula
def flow_to(i, lane, own, temperature, exchanges):
    """dt Q_i = sum_j g (T_j - T) [J] for particle i at T = `own` [degrees C]."""
    return neighbour_sum(flow_pair, i, lane, exchanges, None, None, temperature, own)


@formula(ordered=True)
def stage_change(y, start, change, flow, flow_start, rate, coefficients):
    """y' - y of a stage. In another order its differences become those of products, and the mean drifts."""
    before, back, share, share_start = coefficients
    return back * (start - y) - before * change + rate * (share * flow + share_start * flow_start)


@formula
def at_enthalpy(i, enthalpy, substance):
    """T(H) of particle i [degrees C]."""
    return formulas.temperature_of(
        enthalpy, substance.heat_capacity[i], substance.melting_point[i], substance.latent_heat[i]
    )


@kernel(lanes="exchanges")
def advance(i, lane, exchanges, stage, inverse, substance, plan, k, new_temperature, new):
    """Stage k of a scheme, if it has so many: the new temperature [degrees C], or the new gain of enthalpy [J/kg].

    y' = y + before (y_before - y) + start (y_start - y) + (flow Q(y) + flow_start Q(y_start)) dt/C, the coefficients
    in row k of the plan's table. The `change` y - y_before is stored in place of y_before: from the difference of two
    values the rounding of each is fed back, and the mean, which no flow pulls back, drifts with the square of the
    number of stages. With latent heat y are enthalpies, `now` their gain since the start. The first stage has the
    flow `flow_start`; the last one writes the state, which no other particle reads.
    """
    table, number = plan
    if k < number[0]:
        total = stage.flow_start[i]
        if k > 0:
            total = flow_to(i, lane, stage.temperature[i], stage.temperature, exchanges)
        if first_lane(lane):
            if k == 0:
                stage.change[i] = 0
            y, rate, origin = stage.now[i], inverse[i], stage.start[i]
            if substance is not None:
                rate *= substance.heat_capacity[i]
                origin = type(y)(0)
            coefficients = table[k, 0], table[k, 1], table[k, 2], table[k, 3]
            change = stage_change(y, origin, stage.change[i], total, stage.flow_start[i], rate, coefficients)
            stage.change[i] = change
            value = y + change
            new[i] = value
            if substance is not None:
                enthalpy = stage.start[i] + value
                value = at_enthalpy(i, enthalpy, substance)
                new_temperature[i] = value
                if k + 1 == number[0]:
                    stage.start[i] = enthalpy
            if k + 1 == number[0]:
                stage.target[i] = value


@kernel(rows_of="table")
def plan_chebyshev(i, largest, conduction, table, number):
    """Number of passes and coefficients of Chebyshev's iteration; if it exceeds the table, passes that only damp.

    Backward Euler on 1 + dt A/C, started from the old temperatures. No scaling by the diagonal: every iterate is a
    polynomial in A/C of the old temperatures and keeps sum C T.
    """
    if i == 0:
        passes = chebyshev_passes(float(largest[0]), float(conduction.tolerance))
        if passes > table.shape[0]:
            number[0] = table.shape[0]
        else:
            number[0] = passes
        omega = 1.0
        for k in range(number[0]):
            omega = chebyshev_omega(k, float(largest[0]), omega)
            if passes > table.shape[0]:
                omega = 1.0
            step = omega / (1.0 + float(largest[0]))
            table[k, 0], table[k, 1], table[k, 2], table[k, 3] = 1.0 - omega, step, step, 0.0


@kernel
def sweep(i, exchanges, inverse, conduction, backwards, old, temperature):
    """M(4) for particle i alone and its neighbours in turn (R1), with their `old` temperatures [degrees C]."""
    first, stride, count = row_of(exchanges, i)
    before = old[i]
    running = before
    for n in range(count):
        k = count - np.uint64(1) - n if backwards else n
        at = first + k * stride
        j = exchanges.entries[at]
        share = inverse[i] * formulas.pair_share(conduction.sweep_share * exchanges.weight[at], inverse[i], inverse[j])
        if conduction.frozen:  # Shao & Song M9 as printed
            running += share * (old[j] - before)
        else:
            running += share * (old[j] - running)
    temperature[i] = running


@kernel(ordered=True)
def step_forward(i, inverse, flow, substance, enthalpy, temperature):
    """T += dt Q/C [degrees C]; with latent heat H += c dt Q/C, T = T(H) [J/kg; degrees C]."""
    if substance is None:
        temperature[i] += inverse[i] * flow[i]
    else:
        enthalpy[i] += inverse[i] * substance.heat_capacity[i] * flow[i]
        temperature[i] = at_enthalpy(i, enthalpy[i], substance)


@kernel
def take_up(i, start, substance, enthalpy, temperature):
    """H += c (T - T_start), T = T(H) [J/kg; degrees C]."""
    enthalpy[i] += substance.heat_capacity[i] * (temperature[i] - start[i])
    temperature[i] = at_enthalpy(i, enthalpy[i], substance)


@kernel
def copy(i, values, target):
    """target = values."""
    target[i] = values[i]


@kernel
def particle_volume(i, mass, density, volume):
    """V_i = m_i/rho_i [m^3; m^2 in 2D]."""
    volume[i] = mass[i] / density[i]
