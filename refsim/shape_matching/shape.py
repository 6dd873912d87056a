"""How far a step stretches a body that turns, and how far apart its particles stand, on the host."""

import itertools
import math

import numpy as np

from refsim.core.effect import Nodes
from refsim.scene.solids import cell_key

SAMPLE = 1000  # nodes of a body whose neighbours are looked at


def widest_stretch(solids: Nodes, half_width: int) -> float:
    """Largest S [1/m^2] of the bodies: one that turns is stretched by S (v dt)^2/alpha, v of its fastest particle.

    A body in one region, with a particle at a distance r from its axis, is pulled back by alpha (r - r0) in a step:
    2 (1 - cos(omega dt)) r = alpha (r - r0), about (v dt/r)^2/alpha. In a wider one the goals average over regions, of
    a variance w (w + 1) d^2/3 along each axis: a longitudinal wave goes sqrt(alpha w (w + 1)/3) d in a step, and spin
    stretches a bar by (v/c)^2/3. Regions at surfaces are smaller, so that thin bars stretch up to twice as far.
    S = 1/r^2 + 2/(w (w + 1) d^2), about the axis in which r is least. 0 for particles that stand alone.
    """
    stretch = 0.0
    for begin, end in itertools.pairwise(solids.lattice.first):
        place = solids.lattice.cell[begin:end] - solids.lattice.cell[begin]
        place = solids.spacing * (place - place.mean(0))
        moment = place.T @ place
        # what is as wide along all axes has those of the lattice, which rounding does not turn
        _, axes = np.linalg.eigh(np.where(np.abs(moment) > 1e-9 * np.trace(moment), moment, 0.0))
        squared = (place**2).sum(1)
        arms = [math.sqrt((squared - (place @ axis) ** 2).max()) for axis in axes.T]
        arms = [arm for arm in arms if arm > 0.25 * solids.spacing]
        if arms:
            wide = 2 / (half_width * (half_width + 1) * solids.spacing**2)
            stretch = max(stretch, 1 / min(arms) ** 2 + wide)
    return stretch


def apart(solids: Nodes, position: np.ndarray, solid: np.ndarray) -> np.ndarray:
    """Mean distance [spacings] of neighbours along the lattice's axes in each body; 1 where it has none.

    position  of each node (S, 3) [m]; solid (S,) whether it still belongs to its body
    """
    lattice, mean = solids.lattice, []
    for begin, end in itertools.pairwise(lattice.first):
        some = np.unique(np.linspace(begin, end - 1, SAMPLE).astype(int))
        distance = [np.zeros(0)]
        for axis in np.eye(3, dtype=lattice.cell.dtype):
            key = cell_key(lattice.cell[some] + axis)
            other = np.minimum(begin + np.searchsorted(lattice.key[begin:end], key), end - 1)
            pair = (lattice.key[other] == key) & solid[some] & solid[other]
            distance.append(np.linalg.norm(position[other[pair]] - position[some[pair]], axis=1))
        together = np.concatenate(distance)
        mean.append(together.mean() / solids.spacing if len(together) else 1.0)
    return np.array(mean)
