"""The weights of all pairs and sums over all particles on a GPU: a tree in each block, then one over the blocks.

Sums are taken in float64, in an order that does not change, so that results repeat bit for bit.
"""

import math

import numpy as np

from refsim.backends import device
from refsim.backends.compile import THREADS_PER_BLOCK, cuda, cuda_kernel, formula
from refsim.backends.primitives import four_of, largest_of_block, sum_of_block, wait_for_all
from refsim.heat.kernels import compensate_one, factor_in, inverse_capacity, weight_at
from refsim.heat.reductions import flow_along, new_direction, new_solution, step_ratio
from refsim.heat.shapes import ExchangeColumns
from refsim.neighbours.formulas import to_nearest_image
from refsim.neighbours.rows import over_lanes, row_of


def weigh_exchanges(body, neighbours, step, scratch, temperature):
    """(exchanges, 1/C_i [K/J], array (1,) of the largest s_i, infinite where a sum is not finite, dt Q_i [J])."""
    n, real, capacity = body.volume.shape[0], body.volume.dtype, neighbours.entries.shape[0]
    weights = scratch.array("heat weight", capacity, real)
    exchanges = ExchangeColumns(neighbours.count, neighbours.entries, weights, neighbours.lanes)
    inverse = scratch.array("heat inverse", n, real)
    largest = scratch.array("heat largest", 1, real)
    flow = scratch.array("heat flow", n, real)
    placed = scratch.array("placed", (n, 4), real)
    device.side_by_side(
        lambda: device.packed((body.position,), (body.volume,), (placed,)), lambda: device.fill(largest, 0)
    )
    exchange_weights(placed, body, step, temperature, exchanges, inverse, largest, flow)
    return exchanges, inverse, largest, flow


@formula
def entry_or_zero(values, i, real):
    """values[i]; 0 where there are none."""
    value = real(0)
    if values is not None:
        value = values[i]
    return value


@cuda_kernel(rows_of="inverse", lanes="exchanges")
def exchange_weights(placed, conductor, step, temperature, exchanges, inverse, largest, flow):
    """The weights of every particle's neighbours [J/K], 0 beyond h, 1/C_i [K/J], the largest s_i, and dt Q_i [J]."""
    conductivity, conduction = conductor.conductivity, step.conduction
    lanes = len(exchanges.lanes)
    i, lane = cuda.grid(1) // lanes, cuda.grid(1) % lanes
    real = largest.dtype.type
    diagonal = real(0)
    if i < inverse.shape[0]:
        first, stride, count = row_of(exchanges, i, (lane, lanes))
        total = given = type(conduction.support_radius)(0)
        x, y, z, own_volume = four_of(placed, i)
        own_conductivity, own_temperature = conductivity[i], entry_or_zero(temperature, i, real)
        if count > 0:
            j = exchanges.entries[first]
            following = after = j
            if count > 1:
                following = exchanges.entries[first + stride]
            if count > 2:
                after = exchanges.entries[first + np.uint64(2) * stride]
            xj, yj, zj, volume_j = four_of(placed, j)
            conductivity_j, temperature_j = conductivity[j], entry_or_zero(temperature, j, real)
            for k in range(count):
                at = first + k * stride
                xn, yn, zn, next_volume = four_of(placed, following)
                next_conductivity = conductivity[following]
                next_temperature = entry_or_zero(temperature, following, real)
                following = after
                if k + np.uint64(3) < count:
                    after = exchanges.entries[at + np.uint64(3) * stride]
                dx, dy, dz = to_nearest_image(x - xj, y - yj, z - zj, step.period)
                q = math.sqrt(dx * dx + dy * dy + dz * dz) * conduction.inverse_radius
                g = weight_at(q, own_volume, volume_j, own_conductivity, conductivity_j, step.timestep[1], conduction)
                g *= factor_in(conductor, i, exchanges.entries[at], step.period)
                exchanges.weight[at] = g
                total += g
                given += g * (temperature_j - own_temperature)
                xj, yj, zj, volume_j = xn, yn, zn, next_volume
                conductivity_j, temperature_j = next_conductivity, next_temperature
        total, given = over_lanes(total, (lane, lanes)), over_lanes(given, (lane, lanes))
        if lane == 0:
            flow[i] = given
            inverse[i] = inverse_capacity(i, conductor, conduction)
            diagonal = inverse[i] * total
            if not diagonal < real(np.inf):
                diagonal = real(np.inf)
    shared = cuda.shared.array(THREADS_PER_BLOCK, largest.dtype)
    most = largest_of_block(shared, diagonal)
    if cuda.threadIdx.x == 0:
        cuda.atomic.max(largest, 0, most)


def update_direction(exchanges, inverse, gradient, dots, old, direction, image, scratch):
    """p = z + beta p_before, A p and p A p."""
    partial = _partial_sums(direction.shape[0] * len(exchanges.lanes), "heat partial turn", scratch)
    direction_blocks(exchanges, inverse, gradient, dots, old, image, partial, direction)
    add_up(partial, np.int32(1), scratch.array("heat one", 1, np.int32), dots)


def update_solution(inverse, direction, image, dots, solution, residual, gradient, scratch):
    """x += alpha p, r -= alpha A p, z = r/C and r z."""
    partial = _partial_sums(direction.shape[0], "heat partial", scratch)
    solution_blocks(inverse, direction, image, dots, residual, gradient, partial, solution)
    add_up(partial, np.int32(0), scratch.array("heat one", 1, np.int32), dots)


def _partial_sums(threads, name, scratch):
    """An entry for each block of so many threads."""
    return scratch.array(name, (threads + solution_blocks.threads - 1) // solution_blocks.threads, np.float64)


@cuda_kernel(lanes="exchanges")
def direction_blocks(exchanges, inverse, gradient, dots, old, image, partial, direction):
    """p = z + beta p_before [K], A p [J], and p A p of each block."""
    lanes = len(exchanges.lanes)
    i, lane = cuda.grid(1) // lanes, cuda.grid(1) % lanes
    total = 0.0
    if i < direction.shape[0]:
        share = step_ratio(dots[0], dots[2], direction.dtype.type)
        direction_i = gradient[i] + share * old[i]
        flow = flow_along(i, (lane, lanes), gradient, old, share, exchanges)
        if lane == 0:
            total = new_direction(i, direction_i, flow, inverse, direction, image)
    shared = cuda.shared.array(THREADS_PER_BLOCK, np.float64)
    whole = sum_of_block(shared, total)
    if cuda.threadIdx.x == 0:
        partial[cuda.blockIdx.x] = whole


@cuda_kernel
def solution_blocks(inverse, direction, image, dots, residual, gradient, partial, solution):
    """x += alpha p, r -= alpha A p, z = r/C [K; J; K], and r z of each block."""
    i = cuda.grid(1)
    total = 0.0
    if i < solution.shape[0]:
        length = step_ratio(dots[0], dots[1], solution.dtype.type)
        total = new_solution(i, length, inverse, direction, image, solution, residual, gradient)
    shared = cuda.shared.array(THREADS_PER_BLOCK, np.float64)
    whole = sum_of_block(shared, total)
    if cuda.threadIdx.x == 0:
        partial[cuda.blockIdx.x] = whole


@cuda_kernel(rows_of="one", block_for_each_row=True)
def add_up(partial, target, one, dots):
    """dots[target] = sum of `partial`; dots[0], if it is that, goes to dots[2] before. One block."""
    total = 0.0
    k = cuda.threadIdx.x
    while k < partial.shape[0]:
        total += partial[k]
        k += cuda.blockDim.x
    shared = cuda.shared.array(THREADS_PER_BLOCK, np.float64)
    whole = sum_of_block(shared, total)
    if cuda.threadIdx.x == 0:
        if target == 0:
            dots[2] = dots[0]
        dots[target] = whole


@cuda_kernel(resident=True)
def start_anew(rounds, weights, places, neighbours, first, second):
    """The rounds of a start behind the first one, from `first` into `second` and back; none without a start."""
    if rounds[1] != 0:
        lanes, last = len(neighbours.lanes), places.volume.shape[0] - 1
        threads = cuda.gridDim.x * cuda.blockDim.x
        for k in range(len(weights)):
            for row in range(cuda.grid(1), (last // threads * lanes + lanes) * threads, threads):
                i, lane = min(row // lanes, last), (row % lanes, lanes)  # all come, since lanes add up together
                if k % 2 == 0:
                    compensate_one(i, lane, weights[k], places, neighbours, first, second.x, second.rest)
                else:
                    compensate_one(i, lane, weights[k], places, neighbours, second, first.x, first.rest)
            wait_for_all(rounds, 2, k + 1)
