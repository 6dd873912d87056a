"""Solutions that the liquid is held against, of its own equation of state p = c^2 (rho - rho0) where it matters."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FRICTION = {"laplacian": 1.0, "central": 2.0}  # work of the viscous forces in a flow without curl, over mu |grad v|^2


def hydrostatic(height: NDArray, top: float, density: float, gravity: float, sound: float) -> NDArray:
    """Pressure [Pa] at rest, rho0 c^2 (exp(g (H - y)/c^2) - 1), which is rho0 g (H - y) as c grows; 0 above H."""
    return density * sound**2 * np.expm1(gravity * np.clip(top - height, 0.0, None) / sound**2)


def wave(k: float, depth: float, gravity: float, viscosity: float, form: str) -> tuple[float, float]:
    """(angular frequency, rate of decay) [1/s] of a standing wave of small amplitude between walls that slip.

    omega^2 = g k tanh(k H), less gamma^2. gamma = 2 nu k^2 (Lamb 1932, art. 348, 349) follows from the work 2 mu D:D in
    the potential flow, at any depth; J(11) does half of it.
    """
    gamma = FRICTION[form] * viscosity * k**2
    return math.sqrt(gravity * k * math.tanh(k * depth) - gamma**2), gamma


def swing(time: NDArray, gamma: float, omega: float) -> NDArray:
    """exp(-gamma t) cos(omega t)."""
    return np.exp(-gamma * time) * np.cos(omega * time)


def fitted(time: NDArray, part: NDArray, gamma: float, omega: float) -> tuple[float, float, float, float]:
    """(amplitude, gamma, omega, root mean square of the rest) of A exp(-gamma t) cos(omega t + phase)."""
    from scipy.optimize import curve_fit

    def model(t: NDArray, size: float, decay: float, rate: float, phase: float) -> NDArray:
        return size * np.exp(-decay * t) * np.cos(rate * t + phase)

    (size, decay, rate, phase), _ = curve_fit(model, time, part, (part[0], gamma, omega, 0.0))
    rest = part - model(time, size, decay, rate, phase)
    return float(size), float(decay), float(rate), float(np.sqrt(np.mean(rest**2)))


def ellipse(time: NDArray, radius: float, pull: float, strain: float, friction: float) -> tuple[NDArray, NDArray]:
    """Semi-axes (a, b) [m] of a free ellipse in the force -Omega^2 x, a = b = `radius` and v = sigma (x, -y) at first.

    Incompressible, p = 0 on the surface (Monaghan & Rafiee 2013):
    a' = sigma a, b' = -sigma b, sigma' = (sigma^2 + Omega^2) (b^2 - a^2)/(a^2 + b^2) - 8 f sigma/(a^2 + b^2).
    The last term is the power of viscous forces in this flow, f = 2 nu for a Newtonian liquid [m^2/s].
    """
    from scipy.integrate import solve_ivp

    def change(t: float, state: NDArray) -> list[float]:
        a, b, sigma = state
        both = a * a + b * b
        rate = (sigma**2 + pull**2) * (b * b - a * a) / both - 8 * friction * sigma / both
        return [sigma * a, -sigma * b, rate]

    start = (radius, radius, strain)
    found = solve_ivp(change, (0.0, time[-1]), start, t_eval=time, rtol=1e-10, atol=1e-12)
    return found.y[0], found.y[1]


def couette(height: NDArray, time: float, gap: float, speed: float, viscosity: float, terms: int = 400) -> NDArray:
    """Velocity [m/s] at `height` [m] between a plate at rest and one that moves from time 0 on (Morris et al. 1997)."""
    n = np.arange(1, terms + 1) * np.pi
    decay = np.exp(-(n**2) * viscosity * time / gap**2)
    part = 2 * np.cos(n) / n * decay * np.sin(np.outer(height / gap, n))
    return speed * (height / gap + part.sum(1))


def poiseuille(height: NDArray, time: float, gap: float, push: float, viscosity: float, terms: int = 400) -> NDArray:
    """Velocity [m/s] at `height` [m] between plates at rest, pushed by `push` [m/s^2] from time 0 on (as above)."""
    n = np.arange(1, 2 * terms, 2) * np.pi
    decay = np.exp(-(n**2) * viscosity * time / gap**2)
    part = 4 / n**3 * decay * np.sin(np.outer(height / gap, n))
    return push * gap**2 / viscosity * (0.5 * height / gap * (1 - height / gap) - part.sum(1))


def peak(time: NDArray, values: NDArray) -> float:
    """Time of the largest of values at equal distances, by the parabola through it and its neighbours."""
    k = int(np.clip(np.argmax(values), 1, len(values) - 2))
    before, here, after = values[k - 1 : k + 2]
    return float(time[k] + 0.5 * (time[k + 1] - time[k]) * (before - after) / (before - 2 * here + after))


def spin_down(time: NDArray, rate: float, terms: int = 200) -> NDArray:
    """L/L(0) of a disc that J(11) brakes from a rigid rotation; rate = nu/R^2 [1/s].

    v_t = nu (v'' + v'/r - v/r^2) with v'(R) = 0, where the force density mu lap v has no flux: modes J_1(alpha r/R),
    J_1'(alpha) = 0. The first alone decays with 3.39 nu/R^2; the start is 4 nu/R^2 for a layer that is thin.
    """
    from scipy.special import jnp_zeros, jv

    alpha = jnp_zeros(1, terms)
    share = 4 * (jv(2, alpha) / alpha) ** 2 / (0.5 * (1 - 1 / alpha**2) * jv(1, alpha) ** 2)
    return np.exp(-np.outer(time, rate * alpha**2)) @ (share / share.sum())


# Solutions with a surface tension: Prosperetti's capillary wave, and the meniscus at a vertical wall.


def prosperetti(time: NDArray, square: float, damping: float, velocity: bool = False) -> NDArray:
    """a(t)/a(0) of a wave of small amplitude on deep viscous liquid, beneath nothing, that starts at rest.

    With `velocity` omega_0 a(t)/a'(0) of one that starts flat, with the velocities of a potential flow.
    square   omega_0^2 = sigma k^3/rho + g k [1/s^2]; damping  nu k^2 [1/s]
    Prosperetti, Phys. Fluids 24 (1981) 1217, eq. (22) with one liquid (beta = 0):
    a = a(0) 4 n^2/(8 n^2 + w) erfc(sqrt(n t))
        + sum_i z_i/Z_i (w a(0)/(z_i^2 - n) - a'(0)) exp((z_i^2 - n) t) erfc(z_i sqrt(t)),
    n = nu k^2, w = omega_0^2, with the four roots of z^4 + 2 n z^2 + 4 n^1.5 z + n^2 + w = 0 and
    Z_i the product of z_j - z_i over the others. exp(z^2 t) erfc(z sqrt(t)) is Faddeeva's function of i z sqrt(t).
    """
    from scipy.special import erfc, wofz

    n, w = damping, square
    roots = np.roots([1.0, 0.0, 2 * n, 4 * n**1.5, n**2 + w])
    found = np.zeros_like(time, dtype=complex)
    if not velocity:
        found += 4 * n**2 / (8 * n**2 + w) * erfc(np.sqrt(n * time))
    for i, z in enumerate(roots):
        share = -math.sqrt(w) if velocity else w / (z**2 - n)
        others = np.prod(np.delete(roots, i) - z)
        found += z / others * share * np.exp(-n * time) * wofz(1j * z * np.sqrt(time))
    return found.real


def meniscus(length: float, angle: float) -> tuple[float, float]:
    """(height [m], area [m^2]) of the liquid that a vertical wall lifts above the level far from it.

    length  sqrt(sigma/(rho g)) [m]; angle  of contact [rad]. Height sqrt(2 (1 - sin angle)) length, negative above 90
    degrees; the wall carries the lifted weight, rho g area = sigma cos(angle) (Landau & Lifshitz 1987, section 61).
    """
    return math.copysign(math.sqrt(2 * (1 - math.sin(angle))), math.cos(angle)) * length, math.cos(angle) * length**2
