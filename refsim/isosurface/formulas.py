"""Scalar formulas of isosurfaces on a grid."""

from refsim.backends.compile import formula
from refsim.sparse_grid.formulas import step_node

UNKNOWN = 2  # state of a node; 0 is outside, 1 is inside


@formula
def crossing_share(value, next_value, level):
    """Share t of the edge at which a value linear along it takes the level: t = (c - f0)/(f1 - f0), dimensionless."""
    return (level - value) / (next_value - value)


@formula
def bits_below(bits, axis):
    """Set bits below bit `axis` of three: n = b_0 + .. + b_(axis-1), dimensionless."""
    below = bits & ((1 << axis) - 1)
    return (below & 1) + (below >> 1)


@formula
def state_at(blocks, node_state, node, dx, dy, dz):
    """State (flag) of the node a step away; s = UNKNOWN if there is no node."""
    there = step_node(blocks, node, dx, dy, dz)
    if there < 0:
        return UNKNOWN
    return int(node_state[there])
