"""CUDA kernels of heat conduction, and the schemes that launch them."""

import numpy as np

from refsim.backends import device
from refsim.backends.compile import THREADS_PER_BLOCK, cuda, cuda_kernel, formula
from refsim.backends.primitives import largest_of_block
from refsim.heat import pairing, particle, schemes, shapes
from refsim.heat.formulas import temperature_of
from refsim.neighbours.rows import cuda_lane, cuda_lane_row, cuda_row, lanes_sum

CHECKED = 8  # passes of conjugate gradients between two looks at the residual


@cuda_kernel(rows_of="exchange_sum", lanes="exchanges")
def weigh(
    position, mass, volume, heat_capacity, conductivity, reservoir, timestep, conduction, period, exchanges, inverse,
    exchange_sum, largest,
):  # fmt: skip
    """The weights of every particle's neighbours, 1/C_i, s_i, and the largest s_i (infinite for none)."""
    i, lane = cuda_lane(cuda.grid(1), exchanges)
    real = largest.dtype.type
    own = real(0)
    if i < exchange_sum.shape[0]:
        row = cuda_lane_row(exchanges, i, lane)
        total = particle.weigh(i, row, position, volume, conductivity, timestep, conduction, period, exchanges)
        total = lanes_sum(total, lane, exchanges)
        if lane == 0:
            inverse[i] = particle.inverse_capacity(i, mass, volume, heat_capacity, reservoir, conduction)
            own = inverse[i] * total
            exchange_sum[i] = own
            if not own < real(np.inf):
                own = real(np.inf)
    shared = cuda.shared.array(THREADS_PER_BLOCK, largest.dtype)
    most = largest_of_block(shared, own)
    if cuda.threadIdx.x == 0:
        cuda.atomic.max(largest, 0, most)


@cuda_kernel(lanes=True)
def exchange_rate(
    position, mass, volume, heat_capacity, conductivity, reservoir, neighbours, conduction, period, exchange_rate
):
    """s_i/dt of every particle."""
    i, lane = cuda_lane(cuda.grid(1), neighbours)
    if i < exchange_rate.shape[0]:
        row = cuda_lane_row(neighbours, i, lane)
        total = particle.exchange_rate(i, row, position, volume, conductivity, neighbours.entries, conduction, period)
        total = lanes_sum(total, lane, neighbours)
        if lane == 0:
            exchange_rate[i] = total * particle.inverse_capacity(i, mass, volume, heat_capacity, reservoir, conduction)


@cuda_kernel(rows_of="new", lanes="exchanges")
def advance(
    exchanges, start, now, before, temperature, flow_start, inverse, heat_capacity, melting_point, latent_heat, table,
    number, k, new_temperature, new,
):  # fmt: skip
    """Stage k of a scheme, if there is one, for all: of temperatures, or, with materials, of gains of enthalpy."""
    i, lane = cuda_lane(cuda.grid(1), exchanges)
    if i < new.shape[0] and k < number[0]:
        total = particle.flow_at(i, cuda_lane_row(exchanges, i, lane), temperature[i], temperature, exchanges)
        total = lanes_sum(total, lane, exchanges)
        if lane == 0:
            coefficients = shapes.Stage(table[k, 0], table[k, 1], table[k, 2], table[k, 3])
            value = particle.stage(
                i, total, start, now, before, flow_start, inverse, heat_capacity, coefficients, k == 0
            )
            new[i] = value
            if melting_point is not None:
                enthalpy = start[i] + value
                new_temperature[i] = temperature_of(enthalpy, heat_capacity[i], melting_point[i], latent_heat[i])


@cuda_kernel(rows_of="table")
def plan_chebyshev(largest, conduction, table, number):
    """Number of passes and coefficients of Chebyshev's iteration; where the room is short, passes that damp only."""
    if cuda.grid(1) == 0:
        passes = schemes.chebyshev_passes(float(largest[0]), float(conduction.tolerance))
        if passes > table.shape[0]:
            number[0] = table.shape[0]
        else:
            number[0] = max(1, passes)
        omega = 1.0
        for k in range(number[0]):
            omega = schemes.chebyshev_omega(k, float(largest[0]), omega)
            if passes > table.shape[0]:
                omega = 1.0
            step = omega / (1.0 + float(largest[0]))
            table[k, 0], table[k, 1], table[k, 2], table[k, 3] = 1.0 - omega, step, step, 0.0


@cuda_kernel
def collect(first, second, third, number, start, target):
    """target = the buffer that the last of `number` stages has written, on top of `start` where there is one."""
    i = cuda.grid(1)
    if i < target.shape[0]:
        last = (number[0] - 1) % 3
        value = third[i]
        if last == 0:
            value = first[i]
        elif last == 1:
            value = second[i]
        if start is not None:
            value += start[i]
        target[i] = value


@cuda_kernel(rows_of="temperature", lanes="exchanges")
def pass_once(exchanges, exchange_sum, inverse, old, heat_capacity, melting_point, latent_heat, enthalpy, temperature):
    """NPX for all particles; `old` are the temperatures of before."""
    i, lane = cuda_lane(cuda.grid(1), exchanges)
    if i < temperature.shape[0]:
        total = particle.single_pass_flow(i, cuda_lane_row(exchanges, i, lane), old, exchange_sum, exchanges)
        change = inverse[i] * lanes_sum(total, lane, exchanges)
        if lane == 0:
            if enthalpy is None:
                temperature[i] = old[i] + change
            else:
                enthalpy[i] += change * heat_capacity[i]
                temperature[i] = temperature_of(enthalpy[i], heat_capacity[i], melting_point[i], latent_heat[i])


@cuda_kernel
def sweep(exchanges, inverse, conduction, backwards, old, temperature):
    """M(4) for every particle by itself (R1)."""
    i = cuda.grid(1)
    if i < temperature.shape[0]:
        temperature[i] = particle.one_sided(i, cuda_row(exchanges, i), backwards, old, inverse, conduction, exchanges)


@cuda_kernel
def invert_capacities(mass, volume, heat_capacity, reservoir, conduction, inverse):
    """1/C_i of every particle."""
    i = cuda.grid(1)
    if i < inverse.shape[0]:
        inverse[i] = particle.inverse_capacity(i, mass, volume, heat_capacity, reservoir, conduction)


@cuda_kernel(rows_of="cells")
def exchange_cells(
    cells, members, first, backwards, position, volume, conductivity, inverse, timestep, conduction, period,
    temperature,
):  # fmt: skip
    """M(4) for all pairs of each two cells, of which no other two share a particle (R3)."""
    c = cuda.grid(1)
    if c < cells.shape[0]:
        particle.exchange_two_cells(
            cells[c, 0], cells[c, 1], members, first, backwards, position, volume, conductivity, inverse, timestep,
            conduction, period, temperature,
        )  # fmt: skip


@cuda_kernel(rows_of="temperature", lanes="exchanges")
def solve_own(
    exchanges, exchange_sum, inverse, start, heat_capacity, melting_point, latent_heat, old, enthalpy, temperature
):
    """Nonlinear Jacobi for all particles; `old` are the temperatures of the iterate before."""
    i, lane = cuda_lane(cuda.grid(1), exchanges)
    if i < temperature.shape[0]:
        total = particle.flow_at(i, cuda_lane_row(exchanges, i, lane), melting_point[i], old, exchanges)
        total = lanes_sum(total, lane, exchanges)
        if lane == 0:
            value = particle.jacobi(i, total, start, exchange_sum, inverse, heat_capacity, latent_heat)
            enthalpy[i] = value
            temperature[i] = temperature_of(value, heat_capacity[i], melting_point[i], latent_heat[i])


# Sums: in double precision, a tree in each block, then one over the blocks; the answer repeats bit for bit.


@formula
def sum_of_block(values, mine):
    """Sum of `mine` over the block's threads (a power of two of them); `values` is shared, one place for each."""
    place = cuda.threadIdx.x
    values[place] = mine
    cuda.syncthreads()
    half = cuda.blockDim.x // 2
    while half > 0:
        if place < half:
            values[place] += values[place + half]
        cuda.syncthreads()
        half //= 2
    return values[0]


@cuda_kernel(lanes="exchanges")
def turn_direction(exchanges, inverse, gradient, sums, old, image, partial, direction):
    """p = z + beta p_before [K], A p [J], and each block's p A p."""
    i, lane = cuda_lane(cuda.grid(1), exchanges)
    total = 0.0
    if i < direction.shape[0]:
        share = direction.dtype.type(0)
        if sums[2] > 0:
            share = direction.dtype.type(sums[0] / sums[2])
        own = gradient[i] + share * old[i]
        row = cuda_lane_row(exchanges, i, lane)
        through = lanes_sum(particle.direction_flow(i, row, gradient, old, share, exchanges), lane, exchanges)
        if lane == 0:
            direction[i] = own
            image[i] = particle.capacity_image(own, inverse[i], through)
            total = np.float64(own) * np.float64(image[i])
    shared = cuda.shared.array(THREADS_PER_BLOCK, np.float64)
    whole = sum_of_block(shared, total)
    if cuda.threadIdx.x == 0:
        partial[cuda.blockIdx.x] = whole


@cuda_kernel
def take_step(inverse, direction, image, sums, residual, gradient, partial, solution):
    """x += alpha p, r -= alpha A p, z = r/C, and each block's r z."""
    i = cuda.grid(1)
    total = 0.0
    if i < solution.shape[0]:
        length = solution.dtype.type(0)
        if sums[1] > 0:
            length = solution.dtype.type(sums[0] / sums[1])
        solution[i] += length * direction[i]
        residual[i] -= length * image[i]
        gradient[i] = inverse[i] * residual[i]
        total = np.float64(residual[i]) * np.float64(gradient[i])
    shared = cuda.shared.array(THREADS_PER_BLOCK, np.float64)
    whole = sum_of_block(shared, total)
    if cuda.threadIdx.x == 0:
        partial[cuda.blockIdx.x] = whole


@cuda_kernel(rows_of="one", block_for_each_row=True)
def add_up(partial, target, one, sums):
    """sums[target] = sum of `partial`; sums[0], if it is that, goes to sums[2] before. One block."""
    total = 0.0
    k = cuda.threadIdx.x
    while k < partial.shape[0]:
        total += partial[k]
        k += cuda.blockDim.x
    shared = cuda.shared.array(THREADS_PER_BLOCK, np.float64)
    whole = sum_of_block(shared, total)
    if cuda.threadIdx.x == 0:
        if target == 0:
            sums[2] = sums[0]
        sums[target] = whole


@cuda_kernel
def clear_sums(sums):
    """sums = 0."""
    i = cuda.grid(1)
    if i < sums.shape[0]:
        sums[i] = 0.0


@cuda_kernel
def add_values(change, values):
    """values += change."""
    i = cuda.grid(1)
    if i < values.shape[0]:
        values[i] += change[i]


@cuda_kernel
def take_up(start, heat_capacity, melting_point, latent_heat, enthalpy, temperature):
    """H += c (T - T_start), T = T(H)."""
    i = cuda.grid(1)
    if i < temperature.shape[0]:
        enthalpy[i] += heat_capacity[i] * (temperature[i] - start[i])
        temperature[i] = temperature_of(enthalpy[i], heat_capacity[i], melting_point[i], latent_heat[i])


@cuda_kernel
def divide(mass, density, volume):
    """V = m/rho."""
    i = cuda.grid(1)
    if i < volume.shape[0]:
        volume[i] = mass[i] / density[i]


# What the schemes share


def weighed(
    position, mass, volume, heat_capacity, conductivity, reservoir, neighbours, timestep, conduction, period, scratch
):
    """(exchanges, 1/C, s, largest s) of all particles, now."""
    n, real, room = volume.shape[0], volume.dtype, neighbours.entries.shape[0]
    weight = scratch.array("heat weight", room, real)
    exchanges = shapes.ExchangeColumns(neighbours.count, neighbours.entries, weight, neighbours.lanes)
    inverse, sums = scratch.array("heat inverse", n, real), scratch.array("heat sums", n, real)
    largest = scratch.array("heat largest", 1, real)
    device.fill(largest, 0)
    weigh(
        position, mass, volume, heat_capacity, conductivity, reservoir, timestep, conduction, period, exchanges,
        inverse, sums, largest,
    )  # fmt: skip
    return exchanges, inverse, sums, largest


def copied(values, name, scratch):
    """A copy of an array in scratch memory."""
    copy = scratch.array(name, values.shape[0], values.dtype)
    device.copy(values, copy)
    return copy


def written(stages, scratch, real):
    """(table, number) of a list of stages, from the host."""
    table = scratch.array(f"heat table {len(stages)}", (len(stages), 4), real)
    number = scratch.array("heat number", 1, np.int32)
    scratch.backend.assign(table, np.array(stages, real))
    device.fill(number, len(stages))
    return table, number


def run_stages(plan, exchanges, inverse, heat_capacity, melting_point, latent_heat, scratch, enthalpy, temperature):
    """Take the stages of a plan (table, number) one after the other, from the state and into it."""
    table, number = plan
    state = temperature if melting_point is None else enthalpy
    heat_capacity = None if melting_point is None else heat_capacity
    n, real = state.shape[0], state.dtype
    start = copied(state, "heat start", scratch)
    flow_start = scratch.array("heat flow", n, real)
    buffers = [scratch.array(f"heat buffer {k}", n, real) for k in range(3)]
    warm = None
    if melting_point is not None:
        warm = [copied(temperature, f"heat warm {k}", scratch) for k in range(3)]
    now = before = start
    if warm is not None:
        now = before = scratch.array("heat nothing", n, real)
        device.fill(now, 0)
    source, target = (now, None) if warm is None else (warm[2], warm[0])
    for k in range(table.shape[0]):
        new = buffers[k % 3]
        advance(
            exchanges, start, now, before, source, flow_start, inverse, heat_capacity, melting_point, latent_heat,
            table, number, np.int32(k), target, new,
        )  # fmt: skip
        before, now = now, new
        source, target = (now, None) if warm is None else (warm[k % 3], warm[(k + 1) % 3])
    collect(*buffers, number, None if warm is None else start, state)
    if warm is not None:
        collect(*warm, number, None, temperature)


def known(largest, enthalpy, temperature, scratch):
    """The largest s_i on the host; None where it is not finite: then no temperature is, as each hangs on all."""
    most = float(scratch.host(largest)[0])
    if most < np.inf:
        return most
    device.fill(temperature, np.nan)
    if enthalpy is not None:
        device.fill(enthalpy, np.nan)
    return None


# The schemes


def explicit(
    position, mass, volume, heat_capacity, conductivity, reservoir, melting_point, latent_heat, neighbours, timestep,
    conduction, period, scratch, enthalpy, temperature,
):  # fmt: skip
    """Forward Euler."""
    exchanges, inverse, _, _ = weighed(
        position, mass, volume, heat_capacity, conductivity, reservoir, neighbours, timestep, conduction, period,
        scratch,
    )  # fmt: skip
    plan = written([schemes.EXPLICIT], scratch, temperature.dtype)
    run_stages(plan, exchanges, inverse, heat_capacity, melting_point, latent_heat, scratch, enthalpy, temperature)


def one_sided(
    position, mass, volume, heat_capacity, conductivity, reservoir, neighbours, timestep, conduction, period, scratch,
    temperature,
):  # fmt: skip
    """M(4) read literally (R1): every particle by itself, forwards, then backwards."""
    exchanges, inverse, _, _ = weighed(
        position, mass, volume, heat_capacity, conductivity, reservoir, neighbours, timestep, conduction, period,
        scratch,
    )  # fmt: skip
    for backwards in (0, 1):
        old = copied(temperature, "heat start", scratch)
        sweep(exchanges, inverse, conduction, np.int32(backwards), old, temperature)


def pair_exchange(
    position, mass, volume, heat_capacity, conductivity, reservoir, timestep, conduction, period, scratch, temperature
):
    """M(4) for both particles of each pair (R3), in coloured order, forwards and backwards."""
    inverse = scratch.array("heat inverse", volume.shape[0], volume.dtype)
    invert_capacities(mass, volume, heat_capacity, reservoir, conduction, inverse)
    members, first, colours = device.computed(pairing.colours, position, conduction, period)
    for backwards, order in ((0, colours), (1, colours[::-1])):
        for cells in order:
            exchange_cells(
                cells, members, first, np.int32(backwards), position, volume, conductivity, inverse, timestep,
                conduction, period, temperature,
            )  # fmt: skip


def single_pass(
    position, mass, volume, heat_capacity, conductivity, reservoir, melting_point, latent_heat, neighbours, timestep,
    conduction, period, scratch, enthalpy, temperature,
):  # fmt: skip
    """NPX."""
    exchanges, inverse, sums, _ = weighed(
        position, mass, volume, heat_capacity, conductivity, reservoir, neighbours, timestep, conduction, period,
        scratch,
    )  # fmt: skip
    old = copied(temperature, "heat start", scratch)
    pass_once(exchanges, sums, inverse, old, heat_capacity, melting_point, latent_heat, enthalpy, temperature)


def chebyshev(
    position, mass, volume, heat_capacity, conductivity, reservoir, melting_point, latent_heat, neighbours, timestep,
    conduction, period, scratch, enthalpy, temperature,
):  # fmt: skip
    """Backward Euler by Chebyshev's iteration; by conjugate gradients where that would take too many passes."""
    exchanges, inverse, _, largest = weighed(
        position, mass, volume, heat_capacity, conductivity, reservoir, neighbours, timestep, conduction, period,
        scratch,
    )  # fmt: skip
    if conduction.planned_passes:  # all of it on the device
        table = scratch.array("heat table", (int(conduction.planned_passes), 4), temperature.dtype)
        number = scratch.array("heat number", 1, np.int32)
        plan_chebyshev(largest, conduction, table, number)
        plan = (table, number)
    else:
        most = known(largest, enthalpy, temperature, scratch)
        if most is None:
            return
        passes = max(1, schemes.chebyshev_passes(most, float(conduction.tolerance)))
        plan = None
        if passes <= conduction.most_passes:
            plan = written(list(schemes.chebyshev_stages(most, passes)), scratch, temperature.dtype)
    if plan is None:
        solve(exchanges, inverse, conduction, scratch, temperature)
    else:
        run_stages(plan, exchanges, inverse, heat_capacity, None, None, scratch, None, temperature)
    absorb(heat_capacity, melting_point, latent_heat, scratch, enthalpy, temperature)


def conjugate_gradient(
    position, mass, volume, heat_capacity, conductivity, reservoir, melting_point, latent_heat, neighbours, timestep,
    conduction, period, scratch, enthalpy, temperature,
):  # fmt: skip
    """Backward Euler by conjugate gradients."""
    exchanges, inverse, _, largest = weighed(
        position, mass, volume, heat_capacity, conductivity, reservoir, neighbours, timestep, conduction, period,
        scratch,
    )  # fmt: skip
    if known(largest, enthalpy, temperature, scratch) is not None:
        solve(exchanges, inverse, conduction, scratch, temperature)
        absorb(heat_capacity, melting_point, latent_heat, scratch, enthalpy, temperature)


def solve(exchanges, inverse, conduction, scratch, temperature):
    """Conjugate gradients, scaled by C, for the change of the temperatures; returns the passes taken.

    Every direction is a polynomial in A/C of the old temperatures, so that sum C T is kept without a correction.
    """
    n, real = temperature.shape[0], temperature.dtype
    names = ("residual", "gradient", "direction", "turned", "image", "solution")
    residual, gradient, direction, turned, image, solution = (scratch.array(f"heat {k}", n, real) for k in names)
    threads = take_step.threads
    partial = scratch.array("heat partial", (n + threads - 1) // threads, np.float64)
    turns = (n * len(exchanges.lanes) + threads - 1) // threads
    partial_turn = scratch.array("heat partial turn", turns, np.float64)
    sums = scratch.array("heat dots", 3, np.float64)  # r z now, p A p, r z before
    one = scratch.array("heat one", 1, np.int32)
    copied(temperature, "heat start", scratch)
    table, number = written([schemes.EXPLICIT], scratch, real)
    advance(
        exchanges, temperature, temperature, temperature, temperature, residual, inverse, None, None, None, table,
        number, np.int32(0), None, solution,
    )  # fmt: skip
    for array in (direction, image, solution):
        device.fill(array, 0)
    clear_sums(sums)
    take_step(inverse, direction, image, sums, residual, gradient, partial, solution)
    add_up(partial, np.int32(0), one, sums)
    first, passes = None, 1
    while True:
        turn_direction(exchanges, inverse, gradient, sums, direction, image, partial_turn, turned)
        direction, turned = turned, direction
        add_up(partial_turn, np.int32(1), one, sums)
        take_step(inverse, direction, image, sums, residual, gradient, partial, solution)
        add_up(partial, np.int32(0), one, sums)
        passes += 1
        if first is None or passes % CHECKED == 0:
            now, _, before = (float(v) for v in scratch.host(sums))
            first = before if first is None else first
            enough = float(conduction.residual) ** 2 * first
            if not now > enough or passes > schemes.MOST_CONJUGATE_PASSES:
                break
    add_values(solution, temperature)
    return passes


def absorb(heat_capacity, melting_point, latent_heat, scratch, enthalpy, temperature):
    """With latent heat: what each particle gained goes into its enthalpy, and the temperature follows (Chernoff)."""
    if enthalpy is not None:
        start = scratch.array("heat start", temperature.shape, temperature.dtype)
        take_up(start, heat_capacity, melting_point, latent_heat, enthalpy, temperature)


def runge_kutta_legendre(
    position, mass, volume, heat_capacity, conductivity, reservoir, melting_point, latent_heat, neighbours, timestep,
    conduction, period, scratch, enthalpy, temperature,
):  # fmt: skip
    """RKL2 on temperatures, RKL1 on enthalpies."""
    exchanges, inverse, _, largest = weighed(
        position, mass, volume, heat_capacity, conductivity, reservoir, neighbours, timestep, conduction, period,
        scratch,
    )  # fmt: skip
    most = known(largest, enthalpy, temperature, scratch)
    if most is None:
        return
    stages = (schemes.legendre_stages if enthalpy is None else schemes.first_legendre_stages)(most)
    plan = written(list(stages), scratch, temperature.dtype)
    run_stages(plan, exchanges, inverse, heat_capacity, melting_point, latent_heat, scratch, enthalpy, temperature)


def enthalpy_jacobi(
    position, mass, volume, heat_capacity, conductivity, reservoir, melting_point, latent_heat, neighbours, timestep,
    conduction, period, scratch, enthalpy, temperature,
):  # fmt: skip
    """Backward Euler with latent heat, nonlinear Jacobi."""
    exchanges, inverse, sums, _ = weighed(
        position, mass, volume, heat_capacity, conductivity, reservoir, neighbours, timestep, conduction, period,
        scratch,
    )  # fmt: skip
    start = copied(enthalpy, "heat start", scratch)
    for _ in range(conduction.iterations):
        old = copied(temperature, "heat warm 0", scratch)
        solve_own(
            exchanges, sums, inverse, start, heat_capacity, melting_point, latent_heat, old, enthalpy, temperature
        )


def particle_volume(mass, density, volume):
    """V_i = m_i/rho_i."""
    divide(mass, density, volume)
