"""What transfers take together: fields of particles and of embedded points, and what a step is made of."""

from collections import namedtuple

SETS = ("particles", "carriers", "samples")  # of points


# Fields of the particles before the step, as both transfers to the grid read them; the acceleration may be None
Particles = namedtuple("Particles", "position velocity mass affine volume_ratio acceleration")
# Fields of the particles that the transfer from the grid writes; deformation and position_residual may be None
Moved = namedtuple("Moved", "velocity affine volume_ratio deformation position_residual position")
# The liquid, its background grid and the step
Medium = namedtuple("Medium", "liquid background timestep")
# Shares and spreads of the particles with embedded points, and their reading; or three times None
Cluster = namedtuple("Cluster", "cluster_share inverse_spread embedding")
# Embedded points and the particles that own them
Owned = namedtuple("Owned", "carrier_position carrier_owner")
# Embedded points by owner, and their moments; or three times None
Carriers = namedtuple("Carriers", "carrier_first carrier_position carrier_moment")
# Nodes before the update; node_pull may be None
Nodes = namedtuple("Nodes", "node_mass node_momentum node_pull")
# Points by block (CPU) or by cell (GPU): those of bin i are point[first[i] : first[i + 1]], int32
Bins = namedtuple("Bins", "first point")
# Points sorted into blocks: their numbers by bin, their cells, and the blocks
Places = namedtuple("Places", "bins cell blocks")
# Samples of the surface (s, 3) [m], their numbers (s,) by owner, and the place (n + 1,) of the first of each owner
Samples = namedtuple("Samples", "position order first")
