"""Maxima over all particles, and the leap-frog step that yields the largest displacement: CUDA kernels.

A tree in shared memory, then one atomic for each block. Maxima do not depend on the order of the blocks, nor do sums of
whole numbers (up to 2^24 in float32), so results repeat bit for bit.
"""

import numpy as np

from refsim.backends import device
from refsim.backends.compile import THREADS_PER_BLOCK, cuda, cuda_formula, cuda_kernel
from refsim.backends.primitives import largest_of_block
from refsim.sph.reductions import squares, stepped


def extremes(
    velocity, acceleration, temperature, temperature_range, exchange_rate, density, rest_density, density_bounds,
    extremes,
):  # fmt: skip
    """Largest |v|^2 and |a|^2, number of particles with a value that is not finite, largest rate and excess, numbers of
    particles above the two bounds of the density."""
    device.fill(extremes, 0)
    reduce_extremes(
        velocity, acceleration, temperature, temperature_range, exchange_rate, density, rest_density, density_bounds,
        extremes,
    )  # fmt: skip


@cuda_kernel(rows_of="velocity")
def reduce_extremes(
    velocity, acceleration, temperature, temperature_range, exchange_rate, density, rest_density, density_bounds,
    extremes,
):  # fmt: skip
    """The extremes of all particles into `extremes`, which is zero before."""
    i = cuda.grid(1)
    real = extremes.dtype.type
    zero = real(0)
    speed, force, rate, excess, broken, dense, crushed = zero, zero, zero, zero, False, False, False
    if i < velocity.shape[0]:
        speed, force, rate, excess, broken, dense, crushed = squares(
            i, velocity, acceleration, temperature, temperature_range, exchange_rate, density, rest_density,
            density_bounds,
        )  # fmt: skip
        if not speed >= zero:  # a NaN is counted, but must not hide the largest of the other particles
            speed = zero
        if not force >= zero:
            force = zero
        if not rate >= zero:
            rate = zero
        if not excess >= zero:
            excess = zero
    # The extremes only grow: a value read too early costs a reduction of this block and nothing else.
    larger = speed > extremes[0] or force > extremes[1] or rate > extremes[3] or excess > extremes[4]
    if cuda.syncthreads_or(np.int32(broken or larger or dense)) == 0:
        return
    speeds = cuda.shared.array(THREADS_PER_BLOCK, extremes.dtype)
    forces = cuda.shared.array(THREADS_PER_BLOCK, extremes.dtype)
    largest_speed = largest_of_block(speeds, speed)
    largest_force = largest_of_block(forces, force)
    count = cuda.syncthreads_count(1 if broken else 0)
    if density_bounds is not None:
        above, far_above = cuda.syncthreads_count(1 if dense else 0), cuda.syncthreads_count(1 if crushed else 0)
        if cuda.threadIdx.x == 0 and above > 0:
            cuda.atomic.add(extremes, 5, real(above))
            cuda.atomic.add(extremes, 6, real(far_above))
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


def kick_drift(
    acceleration, build_position, bounds, timestep, shift, displacement, position_residual, velocity, position
):  # fmt: skip
    """Leap-frog step; `displacement` is the largest squared displacement since the list was built [m^2] and the number
    of particles that a wall's plane stopped."""
    device.fill(displacement, 0)
    step_and_reduce(
        acceleration, build_position, bounds, timestep, shift, displacement, position_residual, velocity, position
    )


@cuda_formula
def reduce_step(squared, stopped, displacement):
    """Add one step of the block's threads to `displacement`: the largest square [m^2], and how many are stopped."""
    # It only grows: a value read too early costs a reduction of this block and nothing else.
    if cuda.syncthreads_or(np.int32(squared > displacement[0] or stopped)) == 0:
        return
    shared = cuda.shared.array(THREADS_PER_BLOCK, displacement.dtype)
    largest = largest_of_block(shared, squared)
    stops = cuda.syncthreads_count(1 if stopped else 0)
    if cuda.threadIdx.x == 0:
        cuda.atomic.max(displacement, 0, largest)
        if stops > 0:
            cuda.atomic.add(displacement, 1, displacement.dtype.type(stops))


@cuda_kernel
def step_and_reduce(
    acceleration, build_position, bounds, timestep, shift, displacement, position_residual, velocity, position
):  # fmt: skip
    """Leap-frog step; the largest displacement and the stops go into `displacement`, which is zero before."""
    i = cuda.grid(1)
    real = displacement.dtype.type
    squared, stopped = real(0), False
    if i < position.shape[0]:
        squared, stopped = stepped(
            i, position, position_residual, velocity, acceleration, build_position, bounds, timestep, shift
        )
    reduce_step(squared, stopped, displacement)


# Where the outputs are zero already, these kernels do for the programs.
extremes.cleared, kick_drift.cleared = reduce_extremes, step_and_reduce  # type: ignore[attr-defined]
