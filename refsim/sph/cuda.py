"""CUDA kernels of weakly compressible SPH."""

import math

import numpy as np

from refsim.backends import device
from refsim.backends.compile import THREADS_PER_BLOCK, cuda, cuda_kernel, formula
from refsim.neighbours.rows import cuda_lane, cuda_lane_row, cuda_row, lanes_sum
from refsim.sph import formulas, particle


@cuda_kernel(lanes=True)
def density(position, mass, neighbours, walls, smoothing, fluid, number_density, asymmetry, density):
    """J(7); J(8) where `number_density` is wanted, and the length of the first moment where `asymmetry` is."""
    i, lane = cuda_lane(cuda.grid(1), neighbours)
    if i < density.shape[0]:
        row = cuda_lane_row(neighbours, i, lane)
        rho, number, moment = particle.kernel_sums(i, row, position, mass, neighbours.entries, smoothing, asymmetry)
        mx, my, mz = moment
        rho = lanes_sum(rho, lane, neighbours)
        if number_density is not None:
            number = lanes_sum(number, lane, neighbours)
        if asymmetry is not None:
            mx, my, mz = (
                lanes_sum(mx, lane, neighbours),
                lanes_sum(my, lane, neighbours),
                lanes_sum(mz, lane, neighbours),
            )
        if lane == 0:
            own = particle.own_share(smoothing)
            rho += mass[i] * own
            number += own
            if walls is not None:
                filled = fluid.rest_density * particle.wall_sum(i, cuda_row(walls, i), position, walls, smoothing)
                rho += filled
                number += filled / mass[i]
                if asymmetry is not None:
                    bx, by, bz = particle.wall_moment(i, cuda_row(walls, i), position, walls, smoothing)
                    weight = fluid.rest_density / mass[i]
                    mx += weight * bx
                    my += weight * by
                    mz += weight * bz
            density[i] = rho
            if number_density is not None:
                number_density[i] = number
            if asymmetry is not None:
                asymmetry[i] = math.sqrt(mx * mx + my * my + mz * mz)


@cuda_kernel
def state(density, fluid, pressure):
    """J(9) or Tait."""
    i = cuda.grid(1)
    if i < pressure.shape[0]:
        pressure[i] = formulas.state_pressure(density[i], fluid)


@cuda_kernel(lanes=True)
def momentum(position, velocity, mass, density, pressure, neighbours, walls, smoothing, fluid, viscosity, acceleration):
    """J(10) and J(11), walls after Akinci 2012; added to the acceleration."""
    i, lane = cuda_lane(cuda.grid(1), neighbours)
    if i < acceleration.shape[0]:
        ax, ay, az = particle.momentum(
            i,
            cuda_lane_row(neighbours, i, lane),
            position,
            velocity,
            mass,
            density,
            pressure,
            neighbours.entries,
            smoothing,
            fluid,
            viscosity,
        )
        ax, ay, az = lanes_sum(ax, lane, neighbours), lanes_sum(ay, lane, neighbours), lanes_sum(az, lane, neighbours)
        if lane == 0:
            if walls is not None:
                bx, by, bz = particle.wall_pressure(
                    i, cuda_row(walls, i), position, density, pressure, walls, smoothing, fluid
                )
                ax += bx
                ay += by
                az += bz
            acceleration[i, 0] += ax
            acceleration[i, 1] += ay
            acceleration[i, 2] += az


@cuda_kernel
def viscous(position, velocity, mass, density, neighbours, smoothing, viscosity, acceleration):
    """J(11); added to the acceleration."""
    i = cuda.grid(1)
    if i < acceleration.shape[0]:
        ax, ay, az = particle.viscous(
            i, cuda_row(neighbours, i), position, velocity, mass, density, neighbours.entries, smoothing, viscosity
        )
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az


@cuda_kernel(lanes=True)
def central_viscous(position, velocity, mass, density, neighbours, smoothing, central_viscosity, acceleration):
    """Viscosity along the line of centres; added to the acceleration."""
    i, lane = cuda_lane(cuda.grid(1), neighbours)
    if i < acceleration.shape[0]:
        ax, ay, az = particle.central_viscous(
            i, cuda_lane_row(neighbours, i, lane), position, velocity, mass, density, neighbours.entries, smoothing,
            central_viscosity,
        )  # fmt: skip
        ax, ay, az = lanes_sum(ax, lane, neighbours), lanes_sum(ay, lane, neighbours), lanes_sum(az, lane, neighbours)
        if lane == 0:
            acceleration[i, 0] += ax
            acceleration[i, 1] += ay
            acceleration[i, 2] += az


@cuda_kernel
def gravity(field, acceleration):
    """Uniform acceleration."""
    i = cuda.grid(1)
    if i < acceleration.shape[0]:
        for c in range(3):
            acceleration[i, c] += field[c]


# Reductions: a tree in shared memory, then one atomic for each block. Maxima do not depend on the order in which
# the blocks come, nor do sums of whole numbers (up to 2^24 in float32), so the answers repeat bit for bit. The
# outputs are cleared before every launch.


@formula
def largest_of_block(values, mine):
    """Largest `mine` of the block's threads (a power of two of them); `values` is shared, one place for each."""
    place = cuda.threadIdx.x
    values[place] = mine
    cuda.syncthreads()
    half = cuda.blockDim.x // 2
    while half > 0:
        if place < half and values[place + half] > values[place]:
            values[place] = values[place + half]
        cuda.syncthreads()
        half //= 2
    return values[0]


def extremes(velocity, acceleration, temperature, temperature_range, exchange_rate, extremes):
    """Largest |v|^2 and |a|^2, number of particles where a value is not finite, largest rate and way out of range."""
    device.fill(extremes, 0)
    reduce_extremes(velocity, acceleration, temperature, temperature_range, exchange_rate, extremes)


@cuda_kernel(rows_of="velocity")
def reduce_extremes(velocity, acceleration, temperature, temperature_range, exchange_rate, extremes):
    """Largest |v|^2 and |a|^2, number of broken particles, largest rate and way out of the range of temperatures."""
    i = cuda.grid(1)
    real = extremes.dtype.type
    zero = real(0)
    speed, force, rate, excess, broken = zero, zero, zero, zero, False
    if i < velocity.shape[0]:
        speed, force, rate, excess, broken = particle.squares(
            i, velocity, acceleration, temperature, temperature_range, exchange_rate
        )
        if not speed >= zero:  # no number: counted, but it must not hide the others' largest
            speed = zero
        if not force >= zero:
            force = zero
        if not rate >= zero:
            rate = zero
        if not excess >= zero:
            excess = zero
    # What was read too early costs a look at the block and no more: the extremes only grow.
    larger = speed > extremes[0] or force > extremes[1] or rate > extremes[3] or excess > extremes[4]
    if cuda.syncthreads_or(np.int32(broken or larger)) == 0:
        return
    speeds = cuda.shared.array(THREADS_PER_BLOCK, extremes.dtype)
    forces = cuda.shared.array(THREADS_PER_BLOCK, extremes.dtype)
    largest_speed = largest_of_block(speeds, speed)
    largest_force = largest_of_block(forces, force)
    count = cuda.syncthreads_count(1 if broken else 0)
    if exchange_rate is not None:
        largest_rate = largest_of_block(cuda.shared.array(THREADS_PER_BLOCK, extremes.dtype), rate)
        if cuda.threadIdx.x == 0:
            cuda.atomic.max(extremes, 3, largest_rate)
    if temperature_range is not None:
        largest_excess = largest_of_block(cuda.shared.array(THREADS_PER_BLOCK, extremes.dtype), excess)
        if cuda.threadIdx.x == 0:
            cuda.atomic.max(extremes, 4, largest_excess)
    if cuda.threadIdx.x == 0:
        if largest_speed > extremes[0]:
            cuda.atomic.max(extremes, 0, largest_speed)
        if largest_force > extremes[1]:
            cuda.atomic.max(extremes, 1, largest_force)
        if count > 0:
            cuda.atomic.add(extremes, 2, real(count))


def kick_drift(acceleration, build_position, bounds, timestep, displacement, velocity, position):
    """Leap-frog step; `displacement` is the largest squared way since the list [m^2] and the number of particles
    that a wall's plane stopped."""
    device.fill(displacement, 0)
    step_and_reduce(acceleration, build_position, bounds, timestep, displacement, velocity, position)


@cuda_kernel
def step_and_reduce(acceleration, build_position, bounds, timestep, displacement, velocity, position):
    """Leap-frog step of every particle, the largest squared way and the number of stopped particles."""
    i = cuda.grid(1)
    real = displacement.dtype.type
    squared, stopped = real(0), False
    if i < position.shape[0]:
        squared, stopped = particle.kick_drift(i, position, velocity, acceleration, build_position, bounds, timestep)
    shared = cuda.shared.array(THREADS_PER_BLOCK, displacement.dtype)
    largest = largest_of_block(shared, squared)
    stops = cuda.syncthreads_count(1 if stopped else 0)
    if cuda.threadIdx.x == 0:
        cuda.atomic.max(displacement, 0, largest)
        if stops > 0:
            cuda.atomic.add(displacement, 1, real(stops))
