"""NumPy oracle of the sparse grid: coordinates of nodes by division, nodes by coordinates in one sorted list."""

import numpy as np


def covering(position, cell_size, dim, below, above):
    """Integer coordinates (n, 3) of every node from `below` under to `above` over the cells of position [m]."""
    cells = np.floor(np.asarray(position, dtype=float) / float(cell_size)).astype(int)
    reach = [np.arange(-below, above + 1) if c < dim else np.zeros(1, int) for c in range(3)]
    steps = np.stack(np.meshgrid(*reach, indexing="ij"), axis=-1).reshape(-1, 3)
    cells[:, dim:] = 0
    return np.unique((cells[:, None, :] + steps[None]).reshape(-1, 3), axis=0)


def dimension(blocks):
    """2 or 3."""
    return 3 if blocks.neighbour.shape[1] == 27 else 2


def node_table(blocks):
    """Integer coordinates (64 b, 3) of all nodes, from the keys by repeated division."""
    keys = np.asarray(blocks.keys)
    width = (4, 4, 4) if dimension(blocks) == 3 else (8, 8, 1)
    block = np.stack([keys // 2 ** (21 * c) % 2**21 - 2**20 for c in range(3)], axis=-1)
    local = np.array([(k % width[0], k // width[0] % width[1], k // (width[0] * width[1])) for k in range(64)])
    return (block[:, None, :] * np.array(width) + local[None]).reshape(-1, 3)


class Lookup:
    """Numbers of nodes by their integer coordinates."""

    def __init__(self, blocks):
        self.coordinates = node_table(blocks)
        keys = self._keys(self.coordinates)
        self.order = np.argsort(keys)
        self.keys = keys[self.order]

    @staticmethod
    def _keys(coordinates):
        x, y, z = np.moveaxis(np.asarray(coordinates, dtype=np.int64) + 2**20 + 8, -1, 0)
        return (x * 2**21 + y) * 2**21 + z

    def __call__(self, coordinates):
        """Number of each node (...), -1 where there is none; coordinates (..., 3)."""
        keys = self._keys(coordinates)
        if not len(self.keys):
            return np.full(keys.shape, -1)
        place = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)
        return np.where(self.keys[place] == keys, self.order[place], -1)
