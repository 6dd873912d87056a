"""CPU kernels of heat conduction, and the schemes that launch them."""

import numpy as np

from refsim.backends.compile import cpu_kernel, prange
from refsim.heat import pairing, particle, schemes, shapes
from refsim.heat.formulas import temperature_of
from refsim.neighbours.rows import cpu_row

CHUNKS = 64  # of a sum, fixed, so that it does not depend on the number of threads


@cpu_kernel
def weigh(
    position, mass, volume, heat_capacity, conductivity, reservoir, neighbours, timestep, conduction, period,
    exchanges, inverse, exchange_sum, largest,
):  # fmt: skip
    """The exchanges of every particle with their weights, 1/C_i, s_i, and the largest s_i (infinite for none)."""
    real = largest.dtype.type
    most = real(0)
    for i in prange(exchange_sum.shape[0]):
        row = cpu_row(neighbours, i)
        total = particle.weigh_and_pack(
            i, row, position, volume, conductivity, neighbours.entries, timestep, conduction, period, exchanges
        )
        inverse[i] = particle.inverse_capacity(i, mass, volume, heat_capacity, reservoir, conduction)
        own = inverse[i] * total
        exchange_sum[i] = own
        if not own < real(np.inf):
            own = real(np.inf)
        most = max(most, own)
    largest[0] = most


@cpu_kernel
def exchange_rate(
    position, mass, volume, heat_capacity, conductivity, reservoir, neighbours, conduction, period, exchange_rate
):
    """s_i/dt of every particle."""
    for i in prange(exchange_rate.shape[0]):
        total = particle.exchange_rate(
            i, cpu_row(neighbours, i), position, volume, conductivity, neighbours.entries, conduction, period
        )
        exchange_rate[i] = total * particle.inverse_capacity(i, mass, volume, heat_capacity, reservoir, conduction)


@cpu_kernel
def advance(
    exchanges, start, now, before, temperature, flow_start, inverse, heat_capacity, melting_point, latent_heat,
    coefficients, first, new_temperature, new,
):  # fmt: skip
    """One stage of a scheme for all particles: of temperatures, or, with materials, of gains of enthalpy."""
    for i in prange(new.shape[0]):
        total = particle.flow_at(i, cpu_row(exchanges, i), temperature[i], temperature, exchanges)
        value = particle.stage(i, total, start, now, before, flow_start, inverse, heat_capacity, coefficients, first)
        new[i] = value
        if melting_point is not None:
            enthalpy = start[i] + value
            new_temperature[i] = temperature_of(enthalpy, heat_capacity[i], melting_point[i], latent_heat[i])


@cpu_kernel
def pass_once(exchanges, exchange_sum, inverse, old, heat_capacity, melting_point, latent_heat, enthalpy, temperature):
    """NPX for all particles; `old` are the temperatures of before."""
    for i in prange(temperature.shape[0]):
        change = inverse[i] * particle.single_pass_flow(i, cpu_row(exchanges, i), old, exchange_sum, exchanges)
        if enthalpy is None:
            temperature[i] = old[i] + change
        else:
            enthalpy[i] += change * heat_capacity[i]
            temperature[i] = temperature_of(enthalpy[i], heat_capacity[i], melting_point[i], latent_heat[i])


@cpu_kernel
def sweep(exchanges, inverse, conduction, backwards, old, temperature):
    """M(4) for every particle by itself (R1)."""
    for i in prange(temperature.shape[0]):
        temperature[i] = particle.one_sided(i, cpu_row(exchanges, i), backwards, old, inverse, conduction, exchanges)


@cpu_kernel
def invert_capacities(mass, volume, heat_capacity, reservoir, conduction, inverse):
    """1/C_i of every particle."""
    for i in prange(inverse.shape[0]):
        inverse[i] = particle.inverse_capacity(i, mass, volume, heat_capacity, reservoir, conduction)


@cpu_kernel
def exchange_cells(
    cells, ends, members, first, backwards, position, volume, conductivity, inverse, timestep, conduction, period,
    temperature,
):  # fmt: skip
    """M(4) for all pairs of each two cells (R3), colour by colour; of one no two pairs of cells share a particle."""
    for n in range(ends.shape[0] - 1):
        colour = ends.shape[0] - 2 - n if backwards else n
        for c in prange(ends[colour], ends[colour + 1]):
            particle.exchange_two_cells(
                cells[c, 0], cells[c, 1], members, first, backwards, position, volume, conductivity, inverse, timestep,
                conduction, period, temperature,
            )  # fmt: skip


@cpu_kernel
def solve_own(
    exchanges, exchange_sum, inverse, start, heat_capacity, melting_point, latent_heat, old, enthalpy, temperature
):
    """Nonlinear Jacobi for all particles; `old` are the temperatures of the iterate before."""
    for i in prange(temperature.shape[0]):
        total = particle.flow_at(i, cpu_row(exchanges, i), melting_point[i], old, exchanges)
        value = particle.jacobi(i, total, start, exchange_sum, inverse, heat_capacity, latent_heat)
        enthalpy[i] = value
        temperature[i] = temperature_of(value, heat_capacity[i], melting_point[i], latent_heat[i])


@cpu_kernel
def turn_direction(exchanges, inverse, gradient, sums, old, direction, image, partial):
    """p = z + beta p_before [K], A p [J], and chunks of p A p."""
    share = direction.dtype.type(0)
    if sums[2] > 0:
        share = direction.dtype.type(sums[0] / sums[2])
    n = direction.shape[0]
    for chunk in prange(partial.shape[0]):
        total = 0.0
        for i in range(chunk * n // partial.shape[0], (chunk + 1) * n // partial.shape[0]):
            own = gradient[i] + share * old[i]
            through = particle.direction_flow(i, cpu_row(exchanges, i), gradient, old, share, exchanges)
            direction[i] = own
            image[i] = particle.capacity_image(own, inverse[i], through)
            total += np.float64(own) * np.float64(image[i])
        partial[chunk] = total


@cpu_kernel
def take_step(inverse, direction, image, sums, solution, residual, gradient, partial):
    """x += alpha p, r -= alpha A p, z = r/C, and chunks of r z."""
    length = direction.dtype.type(0)
    if sums[1] > 0:
        length = direction.dtype.type(sums[0] / sums[1])
    n = direction.shape[0]
    for chunk in prange(partial.shape[0]):
        total = 0.0
        for i in range(chunk * n // partial.shape[0], (chunk + 1) * n // partial.shape[0]):
            solution[i] += length * direction[i]
            residual[i] -= length * image[i]
            gradient[i] = inverse[i] * residual[i]
            total += np.float64(residual[i]) * np.float64(gradient[i])
        partial[chunk] = total


@cpu_kernel
def take_up(start, heat_capacity, melting_point, latent_heat, enthalpy, temperature):
    """H += c (T - T_start), T = T(H)."""
    for i in prange(temperature.shape[0]):
        enthalpy[i] += heat_capacity[i] * (temperature[i] - start[i])
        temperature[i] = temperature_of(enthalpy[i], heat_capacity[i], melting_point[i], latent_heat[i])


@cpu_kernel
def divide(mass, density, volume):
    """V = m/rho."""
    for i in prange(volume.shape[0]):
        volume[i] = mass[i] / density[i]


# What the schemes share


def weighed(
    position, mass, volume, heat_capacity, conductivity, reservoir, neighbours, timestep, conduction, period, scratch
):
    """(exchanges, 1/C, s, largest s) of all particles, now."""
    n, real, room = len(volume), volume.dtype, len(neighbours.entries)
    exchanges = shapes.ExchangeRows(
        neighbours.start,
        scratch.array("heat count", n, np.int32),
        scratch.array("heat entries", room, np.int32),
        scratch.array("heat weight", room, real),
    )
    inverse, sums = scratch.array("heat inverse", n, real), scratch.array("heat sums", n, real)
    largest = scratch.array("heat largest", 1, real)
    weigh(
        position, mass, volume, heat_capacity, conductivity, reservoir, neighbours, timestep, conduction, period,
        exchanges, inverse, sums, largest,
    )  # fmt: skip
    return exchanges, inverse, sums, float(largest[0])


def copied(values, name, scratch):
    """A copy of an array in scratch memory."""
    copy = scratch.array(name, len(values), values.dtype)
    copy[...] = values
    return copy


def run_stages(stages, exchanges, inverse, heat_capacity, melting_point, latent_heat, scratch, enthalpy, temperature):
    """Take the stages one after the other, from the state and into it."""
    state = temperature if melting_point is None else enthalpy
    heat_capacity = None if melting_point is None else heat_capacity
    n, real = len(state), state.dtype
    start = copied(state, "heat start", scratch)
    flow_start = scratch.array("heat flow", n, real)
    buffers = [scratch.array(f"heat buffer {k}", n, real) for k in range(3)]
    warm = [copied(temperature, f"heat warm {k}", scratch) for k in range(2)] if melting_point is not None else None
    now = before = start
    if warm is not None:
        now = before = scratch.array("heat nothing", n, real)
        now[...] = 0
    for k, stage in enumerate(stages):
        new = buffers[k % 3]
        coefficients = shapes.Stage(*(real.type(c) for c in stage))
        if warm is None:
            source, target = now, None
        else:
            source, target = warm[k % 2], warm[1 - k % 2]
        advance(
            exchanges, start, now, before, source, flow_start, inverse, heat_capacity, melting_point, latent_heat,
            coefficients, np.int32(k == 0), target, new,
        )  # fmt: skip
        before, now = now, new
        last = target
    if warm is None:
        state[...] = now
    else:
        state += now
        temperature[...] = last


def spoiled(largest, enthalpy, temperature):
    """Whether the exchanges are not finite; then every temperature is none, because each would hang on theirs."""
    if largest < np.inf:
        return False
    temperature[...] = np.nan
    if enthalpy is not None:
        enthalpy[...] = np.nan
    return True


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
    run_stages(
        [schemes.EXPLICIT], exchanges, inverse, heat_capacity, melting_point, latent_heat, scratch, enthalpy,
        temperature,
    )  # fmt: skip


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
    inverse = scratch.array("heat inverse", len(volume), volume.dtype)
    invert_capacities(mass, volume, heat_capacity, reservoir, conduction, inverse)
    members, first, colours = pairing.colours(np, position, conduction, period)
    ends = np.cumsum([0, *map(len, colours)])
    cells = np.concatenate(colours) if colours else np.zeros((0, 2), np.int32)
    for backwards in (0, 1):
        exchange_cells(
            cells, ends, members, first, np.int32(backwards), position, volume, conductivity, inverse, timestep,
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
    if spoiled(largest, enthalpy, temperature):
        return
    passes = max(1, schemes.chebyshev_passes(largest, float(conduction.tolerance)))
    if passes > conduction.most_passes:
        solve(exchanges, inverse, conduction, scratch, temperature)
    else:
        stages = schemes.chebyshev_stages(largest, passes)
        run_stages(stages, exchanges, inverse, heat_capacity, None, None, scratch, None, temperature)
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
    if not spoiled(largest, enthalpy, temperature):
        solve(exchanges, inverse, conduction, scratch, temperature)
        absorb(heat_capacity, melting_point, latent_heat, scratch, enthalpy, temperature)


def solve(exchanges, inverse, conduction, scratch, temperature):
    """Conjugate gradients, scaled by C, for the change of the temperatures; returns the passes taken.

    Every direction is a polynomial in A/C of the old temperatures, so that sum C T is kept without a correction.
    """
    n, real = len(temperature), temperature.dtype
    names = ("residual", "gradient", "direction", "turned", "image", "solution")
    residual, gradient, direction, turned, image, solution = (scratch.array(f"heat {k}", n, real) for k in names)
    partial = scratch.array("heat partial", CHUNKS, np.float64)
    sums = np.array([0.0, 0.0, 0.0])  # r z now, p A p, r z before
    copied(temperature, "heat start", scratch)
    coefficients = shapes.Stage(*(real.type(c) for c in schemes.EXPLICIT))
    advance(
        exchanges, temperature, temperature, temperature, temperature, residual, inverse, None, None, None,
        coefficients, np.int32(1), None, solution,
    )  # fmt: skip
    for array in (direction, image, solution):
        array[...] = 0
    take_step(inverse, direction, image, sums, solution, residual, gradient, partial)
    sums[0] = first = partial.sum()
    passes = 1
    while True:
        turn_direction(exchanges, inverse, gradient, sums, direction, turned, image, partial)
        direction, turned = turned, direction
        sums[1] = partial.sum()
        take_step(inverse, direction, image, sums, solution, residual, gradient, partial)
        sums[2], sums[0] = sums[0], partial.sum()
        passes += 1
        if not sums[0] > float(conduction.residual) ** 2 * first or passes > schemes.MOST_CONJUGATE_PASSES:
            break
    temperature += solution
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
    if spoiled(largest, enthalpy, temperature):
        return
    stages = (schemes.legendre_stages if enthalpy is None else schemes.first_legendre_stages)(largest)
    run_stages(stages, exchanges, inverse, heat_capacity, melting_point, latent_heat, scratch, enthalpy, temperature)


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
