"""Smoothed particle hydrodynamics in a hundred lines: a dam break in 2D, NumPy alone.

    python sph_by_hand.py          # a column of 10 x 20 particles collapses for 1 s; about half a minute

Each particle carries mass m. A smoothed sum over its neighbours gives its density, the density gives its pressure, and
differences of pressure and velocity give forces. All quantities are in SI units.
"""

import numpy as np

SPACING = 0.05  # d, distance of the particles at the start [m]
SUPPORT = 2.6 * SPACING  # h, distance beyond which particles do not feel each other [m]
DENSITY = 1000.0  # rho0, at rest [kg/m^3]
SOUND = 40.0  # c, about ten times sqrt(2 g H): then the density varies by about 1 % [m/s]
VISCOSITY = 0.05  # alpha of Monaghan's artificial viscosity [-]
GRAVITY = np.array([0.0, -9.81])  # [m/s^2]
TANK = np.array([2.0, 1.5])  # width and height of the box [m]
STEP = 0.2 * SUPPORT / SOUND  # a sound wave crosses a fifth of the support in it [s]


def kernel(r):
    """W(r), Wendland's C2 function in 2D [1/m^2]: a hill of radius h whose integral is 1. r [m]."""
    q = np.minimum(r / SUPPORT, 1.0)
    return 7 / (np.pi * SUPPORT**2) * (1 - q) ** 4 * (4 * q + 1)


def kernel_slope(r):
    """dW/dr over r [1/m^4]: times the vector between two particles, it is the gradient of W."""
    q = np.minimum(r / SUPPORT, 1.0)
    return -140 / (np.pi * SUPPORT**4) * (1 - q) ** 3


def pairs(x, others):
    """Vectors and distances from each of `others` (m, 2) to each particle x (n, 2): (n, m, 2) and (n, m) [m]."""
    vector = x[:, None] - others[None]
    return vector, np.linalg.norm(vector, axis=2)


def wall_particles():
    """Three layers of particles that do not move, below and beside the box (m, 2) [m]."""
    layers = 3
    columns = np.arange(-layers, round(TANK[0] / SPACING) + layers)
    rows = np.arange(-layers, round(TANK[1] / SPACING))
    i, j = (a.ravel() for a in np.meshgrid(columns, rows))
    outside = (i < 0) | (j < 0) | (i >= round(TANK[0] / SPACING))
    return SPACING * (np.stack([i[outside], j[outside]], axis=1) + 0.5)


def density(x, walls, mass):
    """Smoothed sum of masses, rho_i = sum_j m W(x_i - x_j), over liquid and walls (n,) [kg/m^3]."""
    return mass * (kernel(pairs(x, x)[1]).sum(1) + kernel(pairs(x, walls)[1]).sum(1))


def pressure(rho):
    """Equation of state p = c^2 (rho - rho0), without tension (n,) [Pa]."""
    return np.maximum(SOUND**2 * (rho - DENSITY), 0.0)


def acceleration(x, v, walls, mass):
    """What pressure, viscosity and gravity do (n, 2) [m/s^2].

    Pressure: -sum_j m (p_i/rho_i^2 + p_j/rho_j^2) grad W; a wall particle has the pressure of the particle that it
    pushes. Viscosity: particles that approach each other are slowed down (Monaghan 1992). Both act along the line
    between two particles and are opposite for them, so that momentum and angular momentum are kept.
    """
    rho = density(x, walls, mass)
    share = pressure(rho) / rho**2
    vector, r = pairs(x, x)
    approach = np.minimum(np.einsum("ijk,ijk->ij", v[:, None] - v[None], vector), 0.0)
    damping = -VISCOSITY * SOUND * SUPPORT * approach / (r**2 + 0.01 * SUPPORT**2)
    push = share[:, None] + share[None] + damping / (0.5 * (rho[:, None] + rho[None]))
    a = -mass * np.einsum("ij,ijk->ik", push * kernel_slope(r), vector)
    vector, r = pairs(x, walls)
    return a - mass * np.einsum("ij,ijk->ik", 2 * share[:, None] * kernel_slope(r), vector) + GRAVITY


def dam_break(columns=10, rows=20, until=1.0, report=print):
    """Let a column of liquid collapse: times [s], the fronts at them (s,) [m] and the last places (n, 2) [m]."""
    i, j = np.meshgrid(np.arange(columns), np.arange(rows))
    x = SPACING * (np.stack([i.ravel(), j.ravel()], axis=1) + 0.5)
    v, walls, mass = np.zeros_like(x), wall_particles(), DENSITY * SPACING**2
    times, fronts = [], []
    for step in range(round(until / STEP)):
        v += STEP * acceleration(x, v, walls, mass)
        x += STEP * v
        times.append((step + 1) * STEP)
        fronts.append(x[:, 0].max() + 0.5 * SPACING)
        if step % 100 == 99:
            report(
                f"{times[-1]:.2f} s: front at {fronts[-1]:.2f} m, {len(x)} particles, fastest {np.abs(v).max():.2f} m/s"
            )
    return np.array(times), np.array(fronts), x


if __name__ == "__main__":
    dam_break()
