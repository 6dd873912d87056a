"""Limits and first capacities of the neighbour search; the lists grow where these are too small."""

MOST_NEIGHBOURS = 4096  # a particle with more is inside a collapsed clump
NEIGHBOUR_CAPACITY = 48  # entries per particle that a list on the CPU begins with
WALL_CAPACITY = 4  # the same of the list of wall particles near each particle
SKINS = 0.1, 0.2, 0.05  # shares of the radius by which a list reaches further, unless the scene says otherwise
GPU_SKINS = 0.1, 0.02  # the same on a GPU
FEW_STEPS = 4  # that a list served: the next one is the widest, until one serves more than twice as many
MANY_STEPS = 20  # that a list served while particles hardly moved: the next one is the narrowest, see `engine.lists`
PARTICLES_PER_CELL = 6  # for which a GPU's table of occupied cells has entries at first


def with_margin(most: int) -> int:
    """Entries per particle of a GPU's list whose longest row has `most`."""
    return most + most // 8 + 4
