"""Density counted on the grid over that of the volume ratio, and its maximum, on a CPU."""

import math

import numpy as np

from refsim.backends.chunks import CHUNKS, limits
from refsim.backends.compile import formula, kernel
from refsim.backends.tuples import three
from refsim.mpm.formulas import fraction
from refsim.mpm.kernels import stencil_weights
from refsim.sparse_grid.formulas import node_coordinates, step_node


@formula
def particle_crowding(i, position, volume_ratio, node_mass, cell, background, counting, blocks):
    """q = J sum_j B_j(x_p) m_j/(rho0 h^d), dimensionless: density counted on the grid over that of J_i."""
    jx, jy, jz = node_coordinates(blocks, cell[i])
    x, y, z = three(position, i)
    f = fraction(x, jx, background), fraction(y, jy, background), fraction(z, jz, background)
    wx, wy, wz = stencil_weights(f, background)
    total = type(background.cell_size)(0)
    for kz in range(background.layers):
        for ky in range(3):
            for kx in range(3):
                node = step_node(blocks, cell[i], kx, ky, kz)
                total += wz[kz] * wy[ky] * wx[kx] * (node_mass[node] / counting.cell_mass)
    return volume_ratio[i] * total


@kernel
def count_chunk(chunk, position, volume_ratio, node_mass, cell, background, counting, blocks, crowding, partial):
    """Counted density over that of J for the particles of a chunk, and the largest; a NaN counts as infinite."""
    real = type(background.cell_size)
    greatest = real(0)
    begin, end = limits(chunk, crowding.shape[0])
    for i in range(begin, end):
        own = particle_crowding(i, position, volume_ratio, node_mass, cell, background, counting, blocks)
        crowding[i] = own
        greatest = max(greatest, own if own < real(math.inf) else real(math.inf))
    partial[chunk] = greatest


def count(position, volume_ratio, node_mass, background, counting, grid, greatest_crowding, crowding):
    """Counted density over that of J for every particle, and the largest; dimensionless."""
    partial = np.zeros(CHUNKS, crowding.dtype)
    count_chunk(
        position, volume_ratio, node_mass, grid.cells["particles"], background, counting, grid.blocks, crowding, partial
    )
    greatest_crowding[0] = partial.max()
