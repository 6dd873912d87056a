"""The exchanges of all particles on a CPU; `weights_cuda` finds them on a GPU.

The neighbour list reaches further than the support radius: a CPU keeps a list of its own of the pairs within it.
"""

import math

import numpy as np

from refsim.backends.compile import formula, kernel
from refsim.backends.fast.staging import AT_A_TIME, buffer, gathered
from refsim.backends.reductions import CHUNKS, limits
from refsim.backends.tuples import three
from refsim.heat.formulas import missing_factor
from refsim.heat.kernels import flow_to, inverse_capacity, weight_at
from refsim.heat.shapes import ExchangeRows
from refsim.neighbours.formulas import to_nearest_image
from refsim.neighbours.rows import row_of


def weigh_exchanges(body, neighbours, step, scratch, temperature):
    """(exchanges, 1/C_i [K/J], array (1,) of the largest s_i, infinite where a sum is not finite, dt Q_i [J])."""
    n, real, capacity = len(body.volume), body.volume.dtype, len(neighbours.entries)
    exchanges = ExchangeRows(
        neighbours.start,
        scratch.array("heat count", n, np.int32),
        scratch.array("heat entries", capacity, np.int32),
        scratch.array("heat weight", capacity, real),
    )
    inverse = scratch.array("heat inverse", n, real)
    largest = scratch.array("heat largest", 1, real)
    partial = scratch.array("heat largest of chunks", CHUNKS, real)
    exchange_weights(body, neighbours, step, exchanges, inverse, partial)
    largest[0] = partial.max()
    start = scratch.array("heat flow", n, real)
    if temperature is not None:
        flow(exchanges, temperature, start)
    return exchanges, inverse, largest, start


@formula
def compensate_block(i, at, size, position, compensation_x, compensation_rest, neighbours, period, exchanges, places):
    """Multiply the weights of staged neighbours of particle i by their factors f_ij, where there is a compensation."""
    if compensation_x is not None:
        xx, xy, xz, yy, yz, zz = (
            buffer(compensation_x), buffer(compensation_x), buffer(compensation_x), buffer(compensation_rest),
            buffer(compensation_rest), buffer(compensation_rest),
        )  # fmt: skip
        gathered(neighbours.entries, at, size, (compensation_x, compensation_rest), (xx, xy, xz, yy, yz, zz))
        own_x, own_rest, place = three(compensation_x, i), three(compensation_rest, i), three(position, i)
        x, y, z = places
        for m in range(size):
            dx, dy, dz = to_nearest_image(place[0] - x[m], place[1] - y[m], place[2] - z[m], period)
            exchanges.weight[at + m] *= missing_factor(
                (dx, dy, dz), own_x, own_rest, (xx[m], xy[m], xz[m]), (yy[m], yz[m], zz[m])
            )


@formula
def weigh_and_pack(i, body, neighbours, seconds, conduction, period, exchanges):
    """Write the exchanges of particle i, those nearer than h, one after the other; their sum of g [J/K]."""
    position, volume, conductivity = body.position, body.volume, body.conductivity
    first, stride, count = row_of(neighbours, i)
    x, y, z = buffer(position), buffer(position), buffer(position)
    volumes, conductivities = buffer(volume), buffer(conductivity)
    for begin in range(np.uint64(0), count, np.uint64(AT_A_TIME)):
        left = min(count - begin, np.uint64(AT_A_TIME))
        arrays, buffers = (position, volume, conductivity), (x, y, z, volumes, conductivities)
        gathered(neighbours.entries, first + begin, left, arrays, buffers)
        for m in range(left):  # a loop of its own, which vectorises
            dx, dy, dz = position[i, 0] - x[m], position[i, 1] - y[m], position[i, 2] - z[m]
            dx, dy, dz = to_nearest_image(dx, dy, dz, period)
            q = math.sqrt(dx * dx + dy * dy + dz * dz) * conduction.inverse_radius
            exchanges.weight[first + begin + m] = weight_at(
                q, volume[i], volumes[m], conductivity[i], conductivities[m], seconds, conduction
            )
        compensate_block(
            i, first + begin, left, position, body.compensation_x, body.compensation_rest, neighbours, period,
            exchanges, (x, y, z),
        )  # fmt: skip
    total = type(conduction.support_radius)(0)
    kept = np.uint64(0)
    for k in range(count):
        g = exchanges.weight[first + k * stride]
        exchanges.entries[first + kept * stride] = neighbours.entries[first + k * stride]
        exchanges.weight[first + kept * stride] = g
        total += g
        kept += np.uint64(g != type(g)(0))
    exchanges.count[i] = kept
    return total


@kernel
def exchange_weights(chunk, conductor, neighbours, step, exchanges, inverse, partial):
    """The exchanges of the particles of a chunk with weights [J/K], their 1/C_i [K/J], and its largest s_i."""
    real = partial.dtype.type
    begin, end = limits(chunk, inverse.shape[0])
    most = real(0)
    for i in range(begin, end):
        total = weigh_and_pack(i, conductor, neighbours, step.timestep[1], step.conduction, step.period, exchanges)
        inverse[i] = inverse_capacity(i, conductor, step.conduction)
        diagonal = inverse[i] * total
        if not diagonal < real(np.inf):
            diagonal = real(np.inf)
        most = max(most, diagonal)
    partial[chunk] = most


@kernel
def flow(i, exchanges, temperature, flow):
    """dt Q_i = sum_j g (T_j - T_i) [J]."""
    flow[i] = flow_to(i, None, temperature[i], temperature, exchanges)
