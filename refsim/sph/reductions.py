"""Maxima over all particles, and the leap-frog step that yields the largest displacement.

On a CPU each chunk of the particles has its own; `reductions_cuda` has the CUDA kernels.
"""

import math

import numpy as np

from refsim.backends.chunks import CHUNKS, limits
from refsim.backends.compile import formula, kernel
from refsim.sph.formulas import drifted


@formula
def squares(
    i, velocity, acceleration, temperature, temperature_range, exchange_rate, density, rest_density, density_bounds,
):  # fmt: skip
    """(|v|^2, |a|^2, exchange rate [1/s], excess over the temperature range [K], whether a value is not finite, whether
    the density is above the first, and above the second of the bounds) of i.

    Rate, excess and the last two are 0 where their arrays are None.
    """
    speed = velocity[i, 0] ** 2 + velocity[i, 1] ** 2 + velocity[i, 2] ** 2
    force = acceleration[i, 0] ** 2 + acceleration[i, 1] ** 2 + acceleration[i, 2] ** 2
    # Numba's isfinite(x) tests x - x, which the compiler removes where sums may be taken in any order.
    beyond = type(speed)(math.inf)
    broken = not (speed < beyond and force < beyond)
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
    return speed, force, rate, excess, broken, dense, crushed


def extremes(
    velocity, acceleration, temperature, temperature_range, exchange_rate, density, rest_density, density_bounds,
    extremes,
):  # fmt: skip
    """Largest |v|^2 and |a|^2, number of particles with a value that is not finite, largest rate and excess, numbers of
    particles above the two bounds of the density."""
    partial = np.zeros((CHUNKS, len(extremes)), extremes.dtype)
    extremes_chunk(
        velocity, acceleration, temperature, temperature_range, exchange_rate, density, rest_density, density_bounds,
        partial,
    )  # fmt: skip
    extremes[:] = partial.max(0)
    extremes[[2, 5, 6]] = partial[:, [2, 5, 6]].sum(0)


@kernel
def extremes_chunk(
    chunk, velocity, acceleration, temperature, temperature_range, exchange_rate, density, rest_density, density_bounds,
    partial,
):  # fmt: skip
    """`extremes` of a chunk of the particles."""
    zero = partial.dtype.type(0)
    speed, force, rate, excess = zero, zero, zero, zero
    begin, end = limits(chunk, velocity.shape[0])
    broken, dense, crushed = 0, 0, 0
    for i in range(begin, end):
        s, f, r, e, bad, above, far_above = squares(
            i, velocity, acceleration, temperature, temperature_range, exchange_rate, density, rest_density,
            density_bounds,
        )  # fmt: skip
        speed = max(speed, s)
        force = max(force, f)
        rate = max(rate, r)
        excess = max(excess, e)
        broken += bad
        dense += above
        crushed += far_above
    partial[chunk, 0], partial[chunk, 1], partial[chunk, 2] = speed, force, broken
    partial[chunk, 3], partial[chunk, 4], partial[chunk, 5], partial[chunk, 6] = rate, excess, dense, crushed


@formula
def stepped(i, position, position_residual, velocity, acceleration, build_position, bounds, timestep, shift):
    """Leap-frog with a changing step: v += (dt_previous + dt)/2 a, x += dt v, stopped at the walls' planes.

    Where there is a residual, x + residual is advanced; a `shift` [m] adds to dt v.

    Returns (squared displacement since the list was built [m^2], whether a wall's plane stopped the particle).
    """
    given = position, position_residual, velocity, acceleration, build_position, bounds, timestep, shift
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
    return squared, stopped_x or stopped_y or stopped_z


@formula
def stepped_along(
    c, i, position, position_residual, velocity, acceleration, build_position, bounds, timestep, shift
):  # fmt: skip
    """(v [m/s], x [m], its residual [m], squared displacement [m^2], whether a plane stopped it) along axis c."""
    v = velocity[i, c] + timestep[0] * acceleration[i, c]
    change, residual, stopped = timestep[1] * v, type(v)(0), False
    if shift is not None:
        change += shift[i, c]
    if position_residual is not None:
        x, residual = drifted(position[i, c], position_residual[i, c], change)
    else:
        x = position[i, c] + change
    if bounds is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
        if x < bounds.lower[c] or x > bounds.upper[c]:
            x = min(max(x, bounds.lower[c]), bounds.upper[c])
            v, residual, stopped = type(v)(0), type(v)(0), True
    moved = x - build_position[i, c]
    return v, x, residual, moved * moved, stopped


def kick_drift(
    acceleration, build_position, bounds, timestep, shift, displacement, position_residual, velocity, position
):  # fmt: skip
    """Leap-frog step; `displacement` is the largest squared displacement since the list was built [m^2] and the number
    of particles that a wall's plane stopped."""
    partial = np.zeros((CHUNKS, len(displacement)), displacement.dtype)
    step_chunk(acceleration, build_position, bounds, timestep, shift, position_residual, velocity, position, partial)
    displacement[:] = partial[:, 0].max(), partial[:, 1].sum()


@kernel
def step_chunk(
    chunk, acceleration, build_position, bounds, timestep, shift, position_residual, velocity, position, partial
):  # fmt: skip
    """`kick_drift` of a chunk of the particles: its largest squared displacement [m^2] and number of stops."""
    largest = partial.dtype.type(0)
    begin, end = limits(chunk, position.shape[0])
    stopped = 0
    for i in range(begin, end):
        squared, hit = stepped(
            i, position, position_residual, velocity, acceleration, build_position, bounds, timestep, shift
        )
        largest = max(largest, squared)
        stopped += hit
    partial[chunk, 0], partial[chunk, 1] = largest, stopped
