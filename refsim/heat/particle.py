"""What one particle does in heat conduction; the CPU and the CUDA kernels share these loops.

`row` is (first, stride, count) of the particle's neighbours in `index`, or of its exchanges in `exchanges`.
"""

import math

import numpy as np

from refsim.backends.compile import formula
from refsim.heat.formulas import melted, pair_share, pair_weight, single_pass_share
from refsim.heat.pairing import partner


@formula
def nearest_image(way, length, inverse):
    """A component of a separation [m] to the nearest image in a period of `length` [m]; both 0 for none."""
    return way - length * type(way)(math.floor(way * inverse + type(way)(0.5)))


@formula
def scaled_distance(i, j, position, period, conduction):
    """q = |x_i - x_j|/h; with a period to the nearest image."""
    dx, dy, dz = position[i, 0] - position[j, 0], position[i, 1] - position[j, 1], position[i, 2] - position[j, 2]
    if period is not None:
        dx = nearest_image(dx, period.x, period.inverse_x)
        dy = nearest_image(dy, period.y, period.inverse_y)
        dz = nearest_image(dz, period.z, period.inverse_z)
    return math.sqrt(dx * dx + dy * dy + dz * dz) * conduction.inverse_radius


@formula
def inverse_capacity(i, mass, volume, heat_capacity, reservoir, conduction):
    """1/C_i [K/J], C_i = m_i c_i, or V_i (M11); 0 for a reservoir, whose temperature is held."""
    real = type(conduction.support_radius)
    if reservoir is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
        if reservoir[i] != 0:
            return real(0)
    if conduction.unit_capacity:
        return real(1) / volume[i]
    return real(1) / (mass[i] * heat_capacity[i])


@formula
def weight(i, j, position, volume, conductivity, seconds, conduction, period):
    """g of a pair [J/K]: 0 beyond h and at the same place; no number where the distance is none."""
    q = scaled_distance(i, j, position, period, conduction)
    real = type(q)
    if q >= real(1) or q <= real(1e-9):
        return real(0)
    return pair_weight(q, volume[i], volume[j], conductivity[i], conductivity[j], seconds, conduction)


@formula
def weigh_and_pack(i, row, position, volume, conductivity, index, timestep, conduction, period, exchanges):
    """Write the exchanges of particle i, those nearer than h, one after the other; their sum of g [J/K]."""
    first, stride, count = row
    total = type(conduction.support_radius)(0)
    found = np.uint64(0)
    for k in range(count):
        j = index[first + k * stride]
        g = weight(i, j, position, volume, conductivity, timestep[1], conduction, period)
        if g != type(g)(0):
            exchanges.entries[first + found * stride] = j
            exchanges.weight[first + found * stride] = g
            total += g
            found += np.uint64(1)
    exchanges.count[i] = found  # here: in a loop of Numba's own a store into a tuple's array is lost
    return total


@formula
def exchange_rate(i, row, position, volume, conductivity, index, conduction, period):
    """sum_j |G_ij| [W/K] of particle i; s_i = dt sum_j |G_ij|/C_i."""
    first, stride, count = row
    real = type(conduction.support_radius)
    total = real(0)
    for k in range(count):
        j = index[first + k * stride]
        total += abs(weight(i, j, position, volume, conductivity, real(1), conduction, period))
    return total


@formula
def weigh(i, row, position, volume, conductivity, timestep, conduction, period, exchanges):
    """Write the weights of particle i's neighbours, 0 beyond h; their sum of g [J/K]."""
    first, stride, count = row
    total = type(conduction.support_radius)(0)
    for k in range(count):
        at = first + k * stride
        j = exchanges.entries[at]
        g = weight(i, j, position, volume, conductivity, timestep[1], conduction, period)
        exchanges.weight[at] = g
        total += g
    return total


@formula
def flow_at(i, row, own, temperature, exchanges):
    """sum_j g (T_j - T) [J] for particle i at a temperature T = `own` [degrees C]."""
    first, stride, count = row
    total = type(own)(0)
    for k in range(count):
        at = first + k * stride
        total += exchanges.weight[at] * (temperature[exchanges.entries[at]] - own)
    return total


@formula
def single_pass_flow(i, row, temperature, exchange_sum, exchanges):
    """NPX: sum_j g (T_j - T_i)/(1 + s_i + s_j) [J]."""
    first, stride, count = row
    own, sum_i = temperature[i], exchange_sum[i]
    total = type(own)(0)
    for k in range(count):
        at = first + k * stride
        j = exchanges.entries[at]
        total += single_pass_share(exchanges.weight[at], sum_i, exchange_sum[j]) * (temperature[j] - own)
    return total


@formula
def one_sided(i, row, backwards, temperature, inverse, conduction, exchanges):
    """M(4) for particle i and all its neighbours in turn, by itself (R1); its temperature [degrees C]."""
    first, stride, count = row
    before = temperature[i]
    running = before
    for n in range(count):
        k = count - np.uint64(1) - n if backwards else n
        at = first + k * stride
        j = exchanges.entries[at]
        share = inverse[i] * pair_share(exchanges.weight[at], inverse[i], inverse[j])
        if conduction.frozen:  # M9 as printed
            running += share * (temperature[j] - before)
        else:
            running += share * (temperature[j] - running)
    return running


@formula
def exchange(i, j, position, volume, conductivity, inverse, timestep, conduction, period, temperature):
    """M(4) for both particles of one pair (R3): what one gains the other loses."""
    seconds = conduction.sweep_share * timestep[1]
    g = weight(i, j, position, volume, conductivity, seconds, conduction, period)
    if g != type(g)(0):
        moved = pair_share(g, inverse[i], inverse[j]) * (temperature[j] - temperature[i])
        temperature[i] += inverse[i] * moved
        temperature[j] -= inverse[j] * moved


@formula
def exchange_two_cells(
    a, b, members, first, backwards, position, volume, conductivity, inverse, timestep, conduction, period, temperature
):
    """M(4) for all pairs of cells a and b, or of one cell, in rounds; backwards the last round first."""
    own, other = first[a + 1] - first[a], first[b + 1] - first[b]
    rounds = max(own, other)
    for n in range(rounds):
        k = rounds - 1 - n if backwards else n
        for m in range(own):
            p = partner(m, k, rounds, a == b)
            if p < other:
                i, j = members[first[a] + m], members[first[b] + p]
                exchange(i, j, position, volume, conductivity, inverse, timestep, conduction, period, temperature)


@formula
def stage(i, total, start, now, before, flow_start, inverse, heat_capacity, coefficients, first):
    """One stage of a scheme: the new temperature, or, where there is a heat capacity, the new gain of enthalpy.

    `total` is dt Q of the present temperatures [J]; in the first stage it is stored in `flow_start`. Enthalpies are
    large beside what a stage adds: `now` and `before` are gains since the start, so that little is rounded away.
    """
    if first:
        flow_start[i] = total
    rate = inverse[i]
    y = now[i]
    if heat_capacity is not None:
        rate *= heat_capacity[i]
        change = coefficients.before * (before[i] - y) - coefficients.start * y
    else:
        change = coefficients.before * (before[i] - y) + coefficients.start * (start[i] - y)
    return y + change + rate * (coefficients.flow * total + coefficients.flow_start * flow_start[i])


@formula
def jacobi(i, total, start, exchange_sum, inverse, heat_capacity, latent_heat):
    """Enthalpy [J/kg] of particle i from its own equation; `total` is the flow to it at its melting point [J]."""
    rate = inverse[i]
    if rate == type(rate)(0):
        return start[i]
    return melted(start[i] + rate * heat_capacity[i] * total, exchange_sum[i], latent_heat[i])


@formula
def capacity_image(own, inverse, through):
    """A p = C p - sum_j g (p_j - p_i) [J]; 0 for a reservoir, where p is 0 [K]."""
    real = type(own)
    if inverse > real(0):
        return own / inverse - through
    return real(0)


@formula
def direction_flow(i, row, gradient, direction, share, exchanges):
    """sum_j g (p_j - p_i) [J] for the new direction p = z + share * p_before [K]."""
    first, stride, count = row
    own = gradient[i] + share * direction[i]
    total = type(own)(0)
    for k in range(count):
        at = first + k * stride
        j = exchanges.entries[at]
        total += exchanges.weight[at] * (gradient[j] + share * direction[j] - own)
    return total
