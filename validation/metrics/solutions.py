"""Solutions that the liquid is held against, of its own equation of state p = c^2 (rho - rho0) where it matters."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

# work of the viscous forces in a flow without curl, over mu |grad v|^2
FRICTION = {"laplacian": 1.0, "central": 2.0}


def wave(k: float, depth: float, gravity: float, viscosity: float, form: str) -> tuple[float, float]:
    """(angular frequency, rate of decay) [1/s] of a standing wave of small amplitude in potential flow, walls slip.

    omega^2 = g k tanh(k H), less gamma^2. gamma = 2 nu k^2 (Lamb 1932, art. 348, 349) follows from the work 2 mu D:D in
    the potential flow, at any depth; J(11) does half of it.
    """
    gamma = FRICTION[form] * viscosity * k**2
    return math.sqrt(gravity * k * math.tanh(k * depth) - gamma**2), gamma


def standing_wave(
    time: NDArray, k: float, depth: float, gravity: float, viscosity: float, sound: float, form: str, modes: int = 28
) -> tuple[NDArray, NDArray]:
    """(part of the velocity in the flow of the start, level at the crest [s] over the start's velocity there), linear.

    It starts flat, with the velocities of the potential flow. Unlike the latter the liquid has no stress at its
    surface: a layer of sqrt(2 nu/omega) there slows the decay, by 0.7 sqrt(nu k^2/omega) on deep water.
    v_t = -grad q + viscous forces, q_t = -c^2 div v + g w for p = c^2 (rho - rho0), q = g level at the surface; in
    Legendre polynomials of the height with the natural condition of the viscous work: 2 mu D:D + mu (div v)^2, with
    J(11) mu |grad v|^2.
    time  equally spaced, from 0
    """
    from numpy.polynomial import legendre
    from scipy.linalg import expm, null_space

    points = modes + 20
    node, weight = legendre.leggauss(points)
    z, weight = 0.5 * depth * (node + 1), 0.5 * depth * weight
    along = legendre.legvander(node, modes)
    along_slope = np.stack([legendre.legval(node, legendre.legder(row)) for row in np.eye(modes + 1)], 1) * 2 / depth
    still = null_space((-1.0) ** np.arange(modes + 1)[None, :])  # w = 0 on the floor
    none = np.zeros((points, modes + 1)), np.zeros((points, modes))
    u, w = np.hstack([along, none[1]]), np.hstack([none[0], along @ still])  # times sin(k x) and cos(k x)
    u_z, w_z = np.hstack([along_slope, none[1]]), np.hstack([none[0], along_slope @ still])
    top = np.concatenate([np.zeros(modes + 1), np.ones(modes + 1) @ still])
    density = np.exp(gravity * (depth - z) / sound**2)

    def product(a: NDArray, b: NDArray, factor: NDArray | float = 1.0) -> NDArray:
        return a.T @ ((weight * factor)[:, None] * b)

    squeeze = k * u + w_z
    work = (
        product(squeeze, squeeze) + 2 * (k**2 * product(u, u) + product(w_z, w_z)) + product(u_z - k * w, u_z - k * w)
    )
    if form == "laplacian":
        work = sum(product(part, part) for part in (k * u, k * w, u_z, w_z))
    inverse = np.linalg.inv(product(u, u, density) + product(w, w, density))
    push = (density[:, None] * (squeeze - gravity / sound**2 * w)).T * weight
    count = len(top)
    rates = np.zeros((count + points + 1,) * 2)
    rates[:count, :count], rates[:count, count:-1] = -viscosity * inverse @ work, inverse @ push
    rates[:count, -1] = -gravity * inverse @ top
    rates[count:-1, :count], rates[-1, :count] = gravity * w - sound**2 * squeeze, top
    start = np.concatenate([-np.cosh(k * z), np.sinh(k * z)]) / math.sinh(k * depth)
    state = np.zeros(count + points + 1)
    state[:count] = np.linalg.lstsq(np.vstack([u, w]), start, rcond=None)[0]
    twice = np.tile(weight, 2) * start
    part = twice @ np.vstack([u, w]) / (twice @ start)
    onward, states = expm(rates * (time[1] - time[0])), []
    for _ in time:
        states.append((part @ state[:count], state[-1]))
        state = onward @ state
    return tuple(np.array(states).T)  # type: ignore[return-value]


def fitted(time: NDArray, part: NDArray, gamma: float, omega: float) -> tuple[float, float]:
    """(gamma, omega) [1/s] of A exp(-gamma t) cos(omega t + phase)."""
    from scipy.optimize import curve_fit

    def model(t: NDArray, size: float, decay: float, rate: float, phase: float) -> NDArray:
        return size * np.exp(-decay * t) * np.cos(rate * t + phase)

    (_, decay, rate, _), _ = curve_fit(model, time, part, (part[0], gamma, omega, 0.0))
    return float(decay), float(rate)


def beside_linear(
    time: NDArray, part: NDArray, k: float, depth: float, gravity: float, viscosity: float, sound: float, form: str
) -> tuple[float, float, NDArray]:
    """Period and decay over those of `standing_wave`, both fitted alike, and that solution, for part(0) = 1."""
    often = np.linspace(0.0, time[-1], 8 * len(time))
    exact = np.interp(time, often, standing_wave(often, k, depth, gravity, viscosity, sound, form)[0])
    omega, gamma = wave(k, depth, gravity, viscosity, form)
    (decay, rate), (own_decay, own_rate) = (fitted(time, values, gamma, omega) for values in (part, exact))
    return own_rate / rate, decay / own_decay, exact


def ellipse(time: NDArray, radius: float, pull: float, strain: float, friction: float) -> tuple[NDArray, NDArray]:
    """Semi-axes (a, b) [m] of a free ellipse in the force -Omega^2 x, a = b = `radius` and v = sigma (x, -y) at first.

    Incompressible, p = 0 on the surface (Monaghan & Rafiee 2013):
    a' = sigma a, b' = -sigma b, sigma' = (sigma^2 + Omega^2) (b^2 - a^2)/(a^2 + b^2) - 8 f sigma/(a^2 + b^2).
    The last term is the power of viscous forces in this flow, f = 2 nu for a Newtonian liquid [m^2/s].
    """

    def change(t: float, state: NDArray) -> list[float]:
        a, b, sigma = state
        both = a * a + b * b
        rate = (sigma**2 + pull**2) * (b * b - a * a) / both - 8 * friction * sigma / both
        return [sigma * a, -sigma * b, rate]

    start = (radius, radius, strain)
    orbit = solve_ivp(change, (0.0, time[-1]), start, t_eval=time, rtol=1e-10, atol=1e-12)
    return orbit.y[0], orbit.y[1]


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
    amplitude = np.zeros_like(time, dtype=complex)
    if not velocity:
        amplitude += 4 * n**2 / (8 * n**2 + w) * erfc(np.sqrt(n * time))
    for i, z in enumerate(roots):
        share = -math.sqrt(w) if velocity else w / (z**2 - n)
        others = np.prod(np.delete(roots, i) - z)
        amplitude += z / others * share * np.exp(-n * time) * wofz(1j * z * np.sqrt(time))
    return amplitude.real


def meniscus(length: float, angle: float) -> tuple[float, float]:
    """(height [m], area [m^2]) of the liquid that a vertical wall lifts above the level far from it.

    length  sqrt(sigma/(rho g)) [m]; angle  of contact [rad]. Height sqrt(2 (1 - sin angle)) length, negative above 90
    degrees; the wall carries the lifted weight, rho g area = sigma cos(angle) (Landau & Lifshitz 1987, section 61).
    """
    return math.copysign(math.sqrt(2 * (1 - math.sin(angle))), math.cos(angle)) * length, math.cos(angle) * length**2


def standing_flow(k: float, top: float) -> Callable[[NDArray], NDArray]:
    """Velocities (n, 3) at positions, of a standing wave in potential flow: 1 m/s upwards at the crest, depth `top`."""

    def flow(x: NDArray) -> NDArray:
        made = np.zeros_like(x)
        made[:, 0] = -np.sin(k * x[:, 0]) * np.cosh(k * x[:, 1]) / math.sinh(k * top)
        made[:, 1] = np.cos(k * x[:, 0]) * np.sinh(k * x[:, 1]) / math.sinh(k * top)
        return made

    return flow


def swaying_linear(time: NDArray, amplitude: float, viscosity: float, modes: int = 20) -> NDArray:
    """Level [m] over its rest at the probe by linear theory (Faltinsen, J. Ship Res. 22 (1978) 193), X = A cos(w t).

    a'' + 4 nu k^2 a' + g k tanh(k h) a = 4 tanh(k h) X''/(L k) for the odd modes a cos(k x), at rest at the start.
    """
    omega, total = 2 * math.pi / PERIOD, np.zeros(len(time))
    for n in range(1, 2 * modes, 2):
        k = n * math.pi / LENGTH
        pull = -4 * math.tanh(k * DEPTH) / (LENGTH * k) * amplitude * omega**2
        brake, stiff = 4 * viscosity * k**2, GRAVITY * k * math.tanh(k * DEPTH)

        def rate(t: float, y: NDArray) -> list[float]:
            return [y[1], pull * math.cos(omega * t) - brake * y[1] - stiff * y[0]]  # noqa: B023  (used at once)

        solution = solve_ivp(rate, (0.0, float(time[-1])), (0.0, 0.0), t_eval=time, rtol=1e-8, atol=1e-12)
        total += solution.y[0] * math.cos(k * PROBE)
    return total


def swaying_potential(time: NDArray, amplitude: float, viscosity: float, modes: int = 48, order: int = 3) -> NDArray:
    """Level [m] over its rest at the probe by nonlinear potential flow, X = A cos(w t), to an order in the level.

    West et al., J. Geophys. Res. 92 (1987) 11803, in cosines between the walls; modes from the 14th on fade.
    """
    x, k = (np.arange(modes) + 0.5) * LENGTH / modes, np.arange(modes) * math.pi / LENGTH
    cosine, sine, lift = np.cos(np.outer(x, k)), np.sin(np.outer(x, k)), np.tanh(k * DEPTH)
    parts = 2 / modes * cosine.T
    parts[0] *= 0.5
    fade, brake = np.exp(-36 * (np.arange(modes) / 14) ** 8), 2 * viscosity * k**2
    omega = 2 * math.pi / PERIOD

    def rate(t: float, y: NDArray) -> NDArray:
        e, p = fade * y.reshape(2, modes)
        level, slope, speed = cosine @ e, -sine @ (k * e), -sine @ (k * p)

        def taylor(m: int, first: int) -> NDArray:  # of the potential's derivatives at rest, up to the level
            terms = range(first, m + 1)
            rise = [cosine @ (phi[m - j] * k ** (j + 1 - first) * lift ** ((j + 1 - first) % 2)) for j in terms]
            return sum((level**j / math.factorial(j) * part for j, part in zip(terms, rise)), np.zeros(modes))

        phi = [p]
        for m in range(1, order):
            phi.append(-fade * (parts @ taylor(m, 1)))
        up = sum((taylor(m, 0) for m in range(order)), np.zeros(modes))
        push = -amplitude * omega**2 * math.cos(omega * t) * (x - 0.5 * LENGTH)
        pull = -GRAVITY * level - 0.5 * speed**2 + 0.5 * up**2 * (1 + slope**2) - push
        rise = parts @ (up * (1 + slope**2) - speed * slope)
        return np.concatenate([fade * rise - brake * e, fade * (parts @ pull) - brake * p])

    solution = solve_ivp(rate, (0.0, float(time[-1])), np.zeros(2 * modes), t_eval=time, rtol=1e-6, atol=1e-9)
    return np.cos(k * PROBE) @ solution.y[:modes]


# Faltinsen, Rognebakke, Lukovsky & Timokha, J. Fluid Mech. 407 (2000) 201, figure 7: crests and troughs [s, m] of the
# level 0.05 m from the left wall of a tank 1.73 m long, 0.6 m deep, that sways as 0.032 m cos(2 pi t/1.3 s) (digitised
# by the PySPH project)
GRAVITY = 9.81  # m/s^2
LENGTH, DEPTH, PERIOD, SWAY, PROBE = 1.73, 0.6, 1.3, 0.032, 0.05  # m, m, s, m, m
