"""The weights of all pairs and the largest sum of them on a GPU, and the first rounds of a compensation."""

import math

import numpy as np

from refsim.backends import device
from refsim.backends.compile import THREADS_PER_BLOCK, cuda, cuda_kernel, formula
from refsim.backends.primitives import four_of, largest_of_block, wait_for_all
from refsim.heat.kernels import compensate_one, factor_in, inverse_capacity, weight_at
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
