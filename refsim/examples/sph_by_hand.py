"""Smoothed particle hydrodynamics in a hundred lines: a dam break in 2D, NumPy alone.

    python sph_by_hand.py          # a column of 10 x 20 particles collapses for 1 s; about half a minute

Each particle carries mass m. A smoothed sum over its neighbours gives its density, the density gives its pressure, and
differences of pressure and velocity give forces. All quantities are in SI units, in 2D those of a metre of depth.
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
    vector = x[:, None] - others
    return vector, np.linalg.norm(vector, axis=2)


def wall_particles():
    """Three layers of particles that do not move, below and beside the box (m, 2) [m]."""
    wide, high = (round(edge / SPACING) for edge in TANK)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(-3, wide + 3), np.arange(-3, high)))
    return SPACING * (np.stack([i, j], axis=1) + 0.5)[(i < 0) | (j < 0) | (i >= wide)]


def density(r, rest, mass):
    """Smoothed sum of masses, rho_i = sum_j m W(r_ij) (n + m,) [kg/m^3]; `rest` (m,) is that of walls over walls."""
    share = mass * kernel(r)
    return np.concatenate([share.sum(1), rest + share[:, len(r) :].sum(0)])


def pressure(rho):
    """Equation of state p = c^2 (rho - rho0), without tension [Pa]."""
    return np.maximum(SOUND**2 * (rho - DENSITY), 0.0)


def acceleration(x, v, rest, mass):
    """What pressure, viscosity and gravity do (n, 2) [m/s^2]; x and v (n + m, 2) have the walls' particles at the end.

    Pressure: -sum_j m (p_i/rho_i^2 + p_j/rho_j^2) grad W. Viscosity (Monaghan 1992) slows down what approaches. A wall
    is liquid that does not move, with a pressure of its own: it gives back no more energy than it took.
    """
    fluid = slice(len(x) - len(rest))
    vector, r = pairs(x[fluid], x)
    rho = density(r, rest, mass)
    share = pressure(rho) / rho**2
    approach = np.minimum(np.einsum("ijk,ijk->ij", v[fluid, None] - v, vector), 0.0)
    damping = -VISCOSITY * SOUND * SUPPORT * approach / (r**2 + 0.01 * SUPPORT**2)
    push = share[fluid, None] + share + damping / (0.5 * (rho[fluid, None] + rho))
    return -mass * np.einsum("ij,ijk->ik", push * kernel_slope(r), vector) + GRAVITY


def energy(x, v, rest, mass):
    """Kinetic, potential and compression energy (3,) [J/m]; the last is the integral of p/rho^2 over the density."""
    liquid = x[: len(x) - len(rest)]
    s = np.maximum(density(pairs(liquid, x)[1], rest, mass) / DENSITY, 1.0)
    return mass * np.array([(v**2).sum() / 2, -(liquid @ GRAVITY).sum(), SOUND**2 * (np.log(s) + 1 / s - 1).sum()])


def dam_break(columns=10, rows=20, until=1.0, report=print, every=100):
    """Let a column of liquid collapse; times [s] and fronts at them [m], last places, energies every so many steps."""
    i, j = (a.ravel() for a in np.meshgrid(np.arange(columns), np.arange(rows)))
    walls, mass, n = wall_particles(), DENSITY * SPACING**2, len(i)
    x = np.concatenate([SPACING * (np.stack([i, j], axis=1) + 0.5), walls])
    v, rest = np.zeros_like(x), mass * kernel(pairs(walls, walls)[1]).sum(1)
    fronts, energies = [], []
    for step in range(1, round(until / STEP) + 1):
        x += 0.5 * STEP * v
        v[:n] += STEP * acceleration(x, v, rest, mass)
        x += 0.5 * STEP * v
        fronts.append(x[:n, 0].max() + 0.5 * SPACING)
        if step % every == 0:
            energies.append(e := energy(x, v, rest, mass))
            told = "{:.0f} = {:.0f} kinetic + {:.0f} potential + {:.0f} of compression".format(sum(e), *e)
            report(f"{step * STEP:.2f} s: front at {fronts[-1]:.2f} m, energy [J/m] {told}")
    return STEP * np.arange(1, len(fronts) + 1), np.array(fronts), x[:n], np.array(energies)


if __name__ == "__main__":
    dam_break()
