"""The transfers between particles and nodes, by the kernels of the grid's backend."""

import numpy as np

from refsim.mpm.grid_to_particle import gather, gather_carriers, reduce_extremes
from refsim.mpm.groups import Carriers, Cluster, Medium, Moved, Owned, Particles
from refsim.mpm.particle_to_grid import collect, scatter


def on(grid, kernel):
    """A kernel as the grid's backend has it."""
    if not grid.on_device:
        return kernel
    from refsim.mpm import grid_to_particle_cuda, particle_to_grid_cuda  # load numba.cuda

    return getattr(particle_to_grid_cuda if kernel is scatter else grid_to_particle_cuda, kernel.__name__)


def points_to_grid(name, position, carriers, given, grid, node_mass, node_momentum):
    """The points of a set to the nodes; carriers are added to what stands there. A GPU has a bin for each cell."""
    places, scratch, each = grid.places(name), grid.scratch, 64 if grid.on_device else 1
    on(grid, scatter)(places, position, carriers, *given, scratch)
    collect(places.bins, each, grid.blocks, carriers is not None, scratch, node_momentum, node_mass)


def particle_to_grid(
    particles: Particles, medium: Medium, cluster: Cluster, kernel_gradient, grid, node_mass, node_momentum
):
    """(4.10), (4.15), (4.17): m_j and (mv)_j with the impulse of the liquid's stress."""
    given = particles, medium, cluster, kernel_gradient
    points_to_grid("particles", particles.position, None, given, grid, node_mass, node_momentum)


def carriers_to_grid(
    carriers: Owned, particles: Particles, medium: Medium, cluster: Cluster, grid, node_mass, node_momentum
):
    """(4.15) of the embedded points, added to m_j and (mv)_j."""
    given = particles, medium, cluster, None
    points_to_grid("carriers", carriers.carrier_position, carriers, given, grid, node_mass, node_momentum)


def grid_to_particle(
    node_velocity, medium: Medium, cluster: Cluster, carriers: Carriers, build_position, grid, displacement,
    step_extremes, moved: Moved,
):  # fmt: skip
    """(4.12), (4.13) or A of the cluster, (4.16), (4.8): velocity, affine matrix, volume ratio and position."""
    extremes = grid.block_extremes if grid.on_device else np.empty((len(grid.blocks.keys), 5), step_extremes.dtype)
    places = grid.places("particles")
    on(grid, gather)(places, node_velocity, medium, cluster, carriers, build_position, moved, extremes)
    on(grid, reduce_extremes)(extremes, displacement, step_extremes)


def grid_to_carriers(node_velocity, carrier_position, background, grid, carrier_moment):
    """Sums of B v and B v (x_j - x_q)^T about every embedded point."""
    places = grid.places("carriers")
    on(grid, gather_carriers)(places, node_velocity, carrier_position, background, grid.complete, carrier_moment)
