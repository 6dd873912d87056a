"""Layers of particles, unit spacing, that slide along each other and along walls."""

import math

import numpy as np
from scipy.integrate import quad

from refsim.core.terms import Terms
from refsim.sph.reference import steepness


def friction(reach, dim, n=0):
    """c_k of layers k = 1, 2, ... apart, so that each particle feels mu sum_k c_k (u_k - u): the mean over offsets of

    2 (dim + 2) F (x/r)^2 (1 - r/h)^n, summed over the neighbours.
    """

    def pair(x, away):
        r = math.hypot(x, away)
        return 2 * (dim + 2) * float(steepness(Terms(r), reach, dim).value) * (x / r) ** 2 * (1 - r / reach) ** n

    far = math.ceil(reach)
    rows = np.arange(-far, far + 1) if dim == 3 else np.zeros(1)
    found = []
    for k in range(1, far + 1):
        ends = [(math.hypot(k, row), math.sqrt(max(reach**2 - k**2 - row**2, 0))) for row in rows]
        found.append(sum(2 * quad(pair, 0, end, (away,), epsabs=1e-12, epsrel=1e-12)[0] for away, end in ends))
    return np.array(found)


def drag(liquid, wall, count):
    """Force (count, count) on each layer between two walls of whole cells by the velocity of each."""
    layer = np.arange(count)
    apart = np.abs(layer[:, None] - layer)
    force = np.array([0, *liquid, *[0] * count])[apart]
    beyond = [wall[k:].sum() + wall[count - 1 - k :].sum() for k in layer]
    return force - np.diag(force.sum(1) + beyond)


def judged(drag, mu):
    """Flow over H^3/(12 mu), and stress between plates in motion over mu U/H."""
    count = len(drag)
    lower = np.arange(count) < count / 2
    flow = np.linalg.solve(drag, -np.ones(count)).sum()
    pulled = -drag.sum(1) * ~lower  # by the upper plate, which moves with 1
    stress = -(drag.sum(1) * np.linalg.solve(drag, -pulled))[lower].sum()
    return flow / (count**3 / (12 * mu)), stress / (mu / count)
