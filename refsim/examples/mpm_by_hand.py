"""The material point method in a hundred lines: a bouncing elastic block, NumPy alone.

    python mpm_by_hand.py          # a block of 32 x 32 particles for 1 s; about half a minute

Particles carry mass, velocity and deformation; a grid carries nothing from step to step. In each step particles give
mass and momentum to the nodes around them, stress included, the nodes move, and particles take their velocity back
(Hu et al., ACM Trans. Graph. 37(4) 150, 2018). All quantities are in SI units.
"""

import numpy as np

CELLS = 32  # of the grid along each edge of a box of 1 m
WIDTH = 1.0 / CELLS  # of a cell [m]
DENSITY = 1000.0  # at rest [kg/m^3]
YOUNG, POISSON = 1.0e5, 0.3  # stiffness [Pa] and ratio [-] of the block
LAMBDA = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))  # Lame's constants [Pa]
MU = YOUNG / (2 * (1 + POISSON))
GRAVITY = np.array([0.0, -9.81])  # [m/s^2]
STEP = 0.2 * WIDTH / np.sqrt((LAMBDA + 2 * MU) / DENSITY)  # a sound wave crosses a fifth of a cell in it [s]
WALL = 2  # cells at each side in which the box stops the nodes


def weights(x):
    """The nine nodes around each particle and their quadratic B-spline weights; x (n, 2) [m].

    Returns nodes (n, 9, 2), weights (n, 9), which sum to 1, and vectors from the particles to the nodes (n, 9, 2) [m].
    """
    base = np.floor(x / WIDTH - 0.5).astype(int)
    f = x / WIDTH - base  # 0.5 to 1.5: distance from the first node, in cells
    w = np.stack([0.5 * (1.5 - f) ** 2, 0.75 - (f - 1) ** 2, 0.5 * (f - 0.5) ** 2])  # (3, n, 2)
    i, j = (a.ravel() for a in np.meshgrid([0, 1, 2], [0, 1, 2], indexing="ij"))
    nodes = base[:, None] + np.stack([i, j], axis=1)
    return nodes, (w[i, :, 0] * w[j, :, 1]).T, WIDTH * nodes - x[:, None]


def stress(deformation):
    """Kirchhoff stress of fixed corotated elasticity, 2 mu (F - R) F^T + lambda (J - 1) J I; F (n, 2, 2), [Pa]."""
    u, _, vt = np.linalg.svd(deformation)
    rotation = u @ vt  # of the polar decomposition F = R S
    volume = np.linalg.det(deformation)  # J, present over first volume
    pressure = LAMBDA * (volume - 1) * volume
    return 2 * MU * (deformation - rotation) @ deformation.swapaxes(1, 2) + pressure[:, None, None] * np.eye(2)


def to_grid(x, v, affine, deformation, mass, volume):
    """Momentum (CELLS + 1, CELLS + 1, 2) [kg m/s] and mass [kg] of the nodes, the impulse of the stress included."""
    nodes, weight, vector = weights(x)
    push = -STEP * volume * 4 / WIDTH**2 * stress(deformation) + mass * affine
    given = mass * v[:, None] + np.einsum("nab,nkb->nka", push, vector)
    grid_mass = np.zeros((CELLS + 1, CELLS + 1))
    momentum = np.zeros((CELLS + 1, CELLS + 1, 2))
    at = nodes[..., 0], nodes[..., 1]
    np.add.at(grid_mass, at, weight * mass)
    np.add.at(momentum, at, weight[..., None] * given)
    return momentum, grid_mass


def move_nodes(momentum, grid_mass):
    """Velocity of the nodes after gravity and the walls, through which nothing moves outwards [m/s]."""
    velocity = momentum / np.maximum(grid_mass, 1e-12)[..., None] + STEP * GRAVITY
    for axis in (0, 1):
        along = np.moveaxis(velocity[..., axis], axis, 0)
        along[: WALL + 1] = np.maximum(along[: WALL + 1], 0.0)
        along[-WALL - 1 :] = np.minimum(along[-WALL - 1 :], 0.0)
    return velocity


def to_particles(x, velocity):
    """Velocities (n, 2) [m/s] and their gradients (n, 2, 2) [1/s] that particles take from the nodes (APIC)."""
    nodes, weight, vector = weights(x)
    node_velocity = velocity[nodes[..., 0], nodes[..., 1]]
    gradient = 4 / WIDTH**2 * np.einsum("nk,nka,nkb->nab", weight, node_velocity, vector)
    return np.einsum("nk,nka->na", weight, node_velocity), gradient


def bounce(side=32, until=1.0, height=0.3, report=print):
    """Let a block fall; times (s,) [s], heights of its centre (s,) [m] and the last places (n, 2) [m]."""
    spacing = 0.25 / side
    i, j = (a.ravel() for a in np.meshgrid(np.arange(side), np.arange(side)))
    x = np.array([0.375, height]) + spacing * (np.stack([i, j], axis=1) + 0.5)
    v, affine = np.zeros_like(x), np.zeros((len(x), 2, 2))
    deformation = np.tile(np.eye(2), (len(x), 1, 1))
    volume, mass = spacing**2, DENSITY * spacing**2
    times, heights = [], []
    for step in range(round(until / STEP)):
        velocity = move_nodes(*to_grid(x, v, affine, deformation, mass, volume))
        v, affine = to_particles(x, velocity)
        x = x + STEP * v
        deformation = (np.eye(2) + STEP * affine) @ deformation
        times.append((step + 1) * STEP)
        heights.append(x[:, 1].mean())
        if step % 200 == 199:
            report(f"{times[-1]:.2f} s: centre at {heights[-1]:.3f} m, volume {np.linalg.det(deformation).mean():.4f}")
    return np.array(times), np.array(heights), x


if __name__ == "__main__":
    bounce()
