"""Shao & Song 2017, Adami, Hu & Adams 2012: the terms of one pair, and what follows from sums. Solids are k and s."""

from refsim.core.terms import clip, length, log, maximum, minimum, where
from refsim.sph.reference import central_viscous_force
from refsim.sph.reference import state as state


def filled_by_solids(i, k, ik):
    """sum_k W_ik [1/m^dim] over solid particles."""
    return k.counted * ik.W


def share(total, least_volume):
    """Shao & Song (1) phi_k = 1/(V_min sum_k' W_kk'), with M4 k' runs over all of the solid; dimensionless."""
    return 1 / (total * least_volume)


def summed_density(i, j, ij):
    """Shao & Song (1) rho_i = m_i sum_j phi_j W_ij [kg/m^dim], phi_j = 1 in the liquid, i itself included."""
    return i.mass * j.phi * ij.W


def density_at_walls(i, b, ib):
    """rho_i += rho0_i sum_b V_b W_ib [kg/m^dim], as phi_b = V_b rho0_i/m_i."""
    return i.rest * b.volume * ib.W


def pressure_force(i, j, ij):
    """Liquid i, liquid j: a_i = -(1/m_i) sum_j (V_i^2 p_i + V_j^2 p_j) grad W_ij [m/s^2]."""
    push = i.volume * i.volume * i.pressure + j.volume * j.volume * j.pressure
    return -i.liquid * j.liquid * push / i.mass * ij.gradient


def weighted_pressure_force(i, j, ij):
    """The same with both pressures = (rho_j p_i + rho_i p_j)/(rho_i + rho_j), rho = m/V [m/s^2]."""
    rho_i, rho_j = i.mass / i.volume, j.mass / j.volume
    between = rho_j / (rho_i + rho_j) * i.pressure + rho_i / (rho_i + rho_j) * j.pressure
    return -i.liquid * j.liquid * (i.volume * i.volume + j.volume * j.volume) * between / i.mass * ij.gradient


def solid_pressure_force(i, k, ik, printed):
    """Shao & Song (2) with M1, M2: F_ik = -V_i^2 p_i phi_k grad W_ik of liquid i, F_ki = -F_ik; a = F/m [m/s^2].

    As printed without one m_i.
    """
    push_i, push_k = (p.volume * p.volume * p.pressure / (p.mass if printed else 1) for p in (i, k))
    return -(i.liquid * k.solid * push_i * k.phi + i.solid * k.liquid * push_k * i.phi) / i.mass * ik.gradient


def wall_pressure_force(i, b, ib):
    """Liquid i at walls: a_i = -sum_b rho0_i V_b p_i/rho_i^2 grad W_ib [m/s^2]."""
    return -i.liquid * i.rest * b.volume * i.pressure / (i.density * i.density) * ib.gradient


def viscous_force(i, j, ij, mu, printed):
    """(3) with M3: F_ik = mu V_i^2 phi_k (v_k - v_i) lap W_ik of liquid i and solid k, F_ki = -F_ik; a = F/m [m/s^2].

    Between liquids mu V_i V_j (v_j - v_i) lap W_ij; as printed without one V_i.
    """
    first, second = (p.volume if printed else p.volume * p.volume for p in (i, j))
    between = i.liquid * j.solid * first * j.phi + i.solid * j.liquid * second * i.phi
    both = i.liquid * j.liquid * i.volume * j.volume + between
    return mu * both / i.mass * ij.laplacian * (j.velocity - i.velocity)


def pull(k, felt, tau):
    """g - a_k [m/s^2], a_k = (v_k - u_k)/tau; in a tank that turns g holds the inertia of what moves with v_k."""
    return felt - (k.velocity - k.followed) / tau


def film_pull(pull, felt):
    """(g - a_k) l [m/s^2], l = |g|/|g - a_k|, at most 1: with more a light body that rises were pushed the faster."""
    much, most = length(pull), length(felt)
    longer = much.value > most.value
    return pull * where(longer, most / where(longer, much, 1), 1)


def weight_of_liquid(k, f, kf):
    """sum_f W_kf [1/m^dim] over liquid f."""
    return f.liquid * kf.W


def pressure_and_head(k, f, kf):
    """(27) p_k = sum_f W_kf (p_f + rho_f (g - a_k).x_kf) / sum_f W_kf; the first sum [Pa/m^dim]."""
    return weight_of_liquid(k, f, kf) * (f.pressure + f.density * (k.pull @ kf.x))


def pressure_alone(k, f, kf):
    """sum_f W_kf p_f [Pa/m^dim]."""
    return weight_of_liquid(k, f, kf) * f.pressure


def weight_of_film(k, s, ks):
    """sum_s W_ks w_s [1/m^dim] over other particles, w_s the wetness in the step before."""
    return where(k.place.value != s.place.value, s.wet * ks.W, 0)


def weight_of_wet(k, s, ks):
    """sum_s W_ks [1/m^dim] over those with w_s > 0."""
    return where((k.place.value != s.place.value) & (s.wet.value > 0), ks.W, 0)


def film_pressure(k, s, ks):
    """p_k = sum_s W_ks w_s (p_s + rho0 (g - a_k).x_ks) / sum_s W_ks w_s; the first sum [Pa/m^dim]."""
    return weight_of_film(k, s, ks) * (s.pressure + s.density * (k.pull @ ks.x))


def suction(k, s, ks):
    """s_k = sum_s W_ks w_s s_s / sum_s W_ks w_s, the least pressure of a film; the first sum [Pa/m^dim]."""
    return weight_of_film(k, s, ks) * s.suction


def nearness(k, s, ks, d):
    """n_ks = 1 + 0.8 (1 - r_ks^2/d^2), at least 0, of another solid or a wall; dimensionless."""
    return where(k.part.value != s.part.value, maximum(1.8 - 0.8 / d**2 * ks.r**2, 0), 0)


def closeness(k, s, ks, d):
    """C_k = sum_s o_s n_ks^3, dimensionless; o_s = 1 of solids, V_b/d^dim of meshes or planes across an axis."""
    return k.solid * s.share * nearness(k, s, ks, d) ** 3


def gradient(k, s, ks, d):
    """grad n_ks^3 = -4.8/d^2 n_ks^2 x_ks [1/m]."""
    return -4.8 / d**2 * k.solid * nearness(k, s, ks, d) ** 2 * ks.x


def growth(k, s, ks, d):
    """dC_k/dt = sum_s o_s (v_k - v_s).grad n_ks^3 [1/s], walls at rest."""
    return s.share * ((k.velocity - s.velocity) @ gradient(k, s, ks, d))


def pressed(close, allowed, growth, stiffness, delay):
    """s_k = K (ln(C/C_0) + tau (dC/dt)/C) [Pa], at least 0: solids and walls closer than C_0 overlap."""
    return stiffness * maximum(log(close / allowed) + delay * growth / close, 0)


def contact(k, s, ks, d, cell, least):
    """a_k = -(d^dim/m_k) sum_s l (b_k + b_s) grad n_ks^3 [m/s^2], b = s C/C_all, C_all all its C; `cell` = d^dim.

    l = min(m_k, m_s, rho0 d^dim)/(rho0 d^dim), as a step of the liquid is too long for light bodies as stiff; `least` =
    rho0 d^dim [kg].
    """
    lightness = minimum(minimum(k.mass, s.mass) / least, 1)
    return -cell / k.mass * lightness * s.share * (k.bears + s.bears) * gradient(k, s, ks, d)


def contact_of_walls(k, b, kb, d, cell, least):
    """a_k = -(d^dim/m_k) sum_b 2 l o_b b_k grad n_kb^3 [m/s^2], b_k of meshes or of planes across an axis, l of k."""
    return -2 * cell / k.mass * minimum(k.mass / least, 1) * k.bears * b.share * gradient(k, b, kb, d)


def around(k, j, kj):
    """G_k = sum_j V_j grad W_kj [1/m] over all particles, V = m/rho of solids and liquid."""
    return j.volume * kj.gradient


def of_film(k, s, ks):
    """G_film = sum_s V_s grad W_ks [1/m], the part of G_k by other solids and walls."""
    return where(k.part.value != s.part.value, s.solid * around(k, s, ks), 0)


def most_of_film(k, s, ks):
    """F = sum_s V_s |grad W_ks| [1/m] over other solids and walls."""
    return where(k.part.value != s.part.value, s.solid * s.volume * length(ks.gradient), 0)


def film_factor(whole, film, most, k, head, h):
    """g_k = 1 - G_film.G/|G_film|^2 in 1 to 8, dimensionless: along G_film even pressure then pushes to no side.

    |G_film|^2 >= F^2/8, as films on two sides that face each other have a sum near 0. Near a surface what is missing
    may be air: g_k - 1 has the share 1/(1 + (P/p_k)^4), P = rho0 |g| h/2, g as felt at k; and, as liquid is not even,
    q^2/(q^2 + 0.0036), q = -h G_film.G/|G_film|.
    """
    square = maximum(film @ film, most * most / 8)
    square = where(square.value > 0, square, 1)
    lacking = maximum(-(film @ whole), 0)
    much, under = (h * lacking) ** 2, k.pressure.value > 0
    wider = clip(lacking / square, 0, 7) * much / (much + 0.0036 * square)
    return 1 + where(under, wider / (1 + (head / where(under, k.pressure, 1)) ** 4), 0)


def push(i, j, ij, s):
    """J(10) a_i = -(s/rho_i) sum_j V_j (p_i + p_j) grad W_ij [m/s^2], V = m/rho; 0 within one solid.

    Between two solids a film acts with (g_i + g_j)/2 max(p_i + p_j, s_i + s_j).
    """
    both = i.pressure + j.pressure
    both = where(i.solid * j.solid, 0.5 * (i.wider + j.wider) * maximum(both, i.suction + j.suction), both)
    return where(i.part.value != j.part.value, -s * j.mass / j.density * both / i.density * ij.gradient, 0)


def hold(i, j, ij, k):
    """Liquid and solid: a_i = (2 k/rho_i) sum_j (m_j/rho_j) F_ij e_ij e_ij.(v_j - v_i) [m/s^2], k = (dim + 2) mu.

    With the liquid's own viscous force it is that of the harmonic mean 2 mu_i mu_j/(mu_i + mu_j), mu_j infinite.
    """
    return (i.liquid * j.solid + i.solid * j.liquid) * central_viscous_force(i, j, ij, k)


def follow(i, dt, tau):
    """u <- u + (v - u) dt/tau [m/s], dt between the velocities; of even acceleration it is (v - u)/tau."""
    return i.followed + dt / tau * (i.velocity - i.followed)
