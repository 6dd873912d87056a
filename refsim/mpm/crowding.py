"""Density counted on the grid over that of the volume ratio, and its maximum."""

import math

from refsim.backends.reductions import reduction
from refsim.backends.tuples import three
from refsim.mpm.formulas import fraction
from refsim.mpm.kernels import stencil_weights
from refsim.sparse_grid.formulas import node_coordinates, step_node


@reduction(into="greatest_crowding", how="largest", rows="crowding")
def count_all(i, position, volume_ratio, node_mass, cell, background, counting, blocks, crowding):
    """q = J sum_j B_j(x_p) m_j/(rho0 h^d), dimensionless: density counted on the grid over that of J_i.

    In the largest a NaN counts as infinite.
    """
    jx, jy, jz = node_coordinates(blocks, cell[i])
    x, y, z = three(position, i)
    f = fraction(x, jx, background), fraction(y, jy, background), fraction(z, jz, background)
    wx, wy, wz = stencil_weights(f, background)
    real = type(background.cell_size)
    total = real(0)
    for kz in range(background.layers):
        for ky in range(3):
            for kx in range(3):
                node = step_node(blocks, cell[i], kx, ky, kz)
                total += wz[kz] * wy[ky] * wx[kx] * (node_mass[node] / counting.cell_mass)
    ratio = volume_ratio[i] * total
    crowding[i] = ratio
    return ratio if ratio < real(math.inf) else real(math.inf)


def count(position, volume_ratio, node_mass, background, counting, grid, greatest_crowding, crowding):
    """Counted density over that of J for every particle, and the largest; dimensionless."""
    cell = grid.cells["particles"]
    count_all(position, volume_ratio, node_mass, cell, background, counting, grid.blocks, crowding, greatest_crowding)
