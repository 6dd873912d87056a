"""Scalar formulas of weakly compressible SPH: Jiang & Zhu 2023, equations (7) to (11); Tait; walls."""

from refsim.backends.compile import formula
from refsim.backends.tuples import dot, scaled

LEAST_FILLED, FILLED = 0.5, 0.8  # det M without and with the whole correction; a lattice has 0.9 to 1
STRETCHED = 0.05  # share of rho0 by which an advanced density is less at most


@formula
def state_pressure(density, fluid):
    """J(9) and Tait: p = (rho0 c^2 / g) ((rho/rho0)^g - 1) + P_int (rho/rho0)^2 [Pa]; g = 1 is J(9) with k = c^2.

    P_int balances the cohesion of the bulk (0 without a cohesive effect) and is added before the clamp.
    """
    real = type(density)
    ratio = density / fluid.rest_density
    power = ratio
    for _ in range(1, fluid.exponent):
        power *= ratio
    pressure = fluid.stiffness * (power - real(1)) + cohesive_part(density, fluid)
    if fluid.clamp and pressure < real(0):
        return real(0)
    return pressure


@formula
def cohesive_part(density, fluid):
    """p_c = P_int (rho/rho0)^2 [Pa], the part of the pressure that balances the cohesion of the bulk."""
    ratio = density / fluid.rest_density
    return fluid.internal_pressure * ratio * ratio


@formula
def borne_pressure(pressure, density, fluid):
    """p_b = p - P_int (rho/rho0)^2 [Pa], which walls bear: they exert no cohesion that the rest would balance."""
    borne = pressure - cohesive_part(density, fluid)
    if fluid.clamp and borne < type(borne)(0):
        return type(borne)(0)
    return borne


@formula
def film_pressure(both, least):
    """p_i + p_j >= s_i + s_j [Pa] of a film's sides: under tension it breaks, but where liquid near it is, too."""
    return least if both < least else both


@formula
def volume_of(mass, density):
    """V = m/rho [m^dim]; `mass` itself, the volume of a wall's particle, without a density."""
    volume = mass
    if density is not None:
        volume = mass / density
    return volume


@formula
def continuity_pair(volume_j, approach, slope):
    """Continuity equation for one neighbour: (d rho_i/dt)/rho_i = V_j (v_i - v_j).x_ij W'(r)/r [1/s].

    `approach` = (v_i - v_j).x_ij [m^2/s], `slope` = W'(r)/r; Colagrossi & Landrini 2003.
    """
    return volume_j * slope * approach


@formula
def across(v, n):
    """n n.v, what moves across a wall of normal n [m/s]; all of v at an edge, where n = 0."""
    part = dot(v, n)
    return scaled(n, part) if dot(n, n) > type(part)(0) else v


@formula
def shift_approach(own, other):
    """Sun et al. 2019 for one neighbour: what the shifts add to `approach` dt [m^2].

    (2 s_i + (rho_j/rho_i - 1) s_j).x_ij, since -rho div s + div(rho s) is summed with s_j - s_i and with rho_j s_j +
    rho_i s_i; `own` = s_i.x_ij, `other` = (rho_j/rho_i - 1) s_j.x_ij.
    """
    return own + own + other


LOOSE, SURROUNDED = 0.75, 0.85  # the liquid's share of the space that walls leave: 1 far from a surface, 1/2 at it
NARROW = 0.1  # least space that walls leave


@formula
def surrounded_share(around, held):
    """f = (s - 0.75)/0.1 in 0 to 1 [-], share of the walls' strain and of the return; s = l/(1 - b) [-].

    l = -sum_j V_j r W'/dim over liquid, b over walls and solids, whose parts above a surface surround nothing.
    """
    real = type(around)
    share = (around / max(real(1) - held, real(NARROW)) - real(LOOSE)) / real(SURROUNDED - LOOSE)
    return min(max(share, real(0)), real(1))


LONE, JOINED = 0.2, 0.3  # of the space around: as much as this fills and less, and more; 0.24 and more at a corner


@formula
def lone_share(around):
    """a = (0.3 - s)/0.1 in 0 to 1 [-]: how lone a particle is, around which a share s is filled."""
    real = type(around)
    return min(max((real(JOINED) - around) / real(JOINED - LONE), real(0)), real(1))


FALLING, BORNE = 0.25, 0.75  # share of its weight that pressure takes off falling liquid at most, off borne at least


@formula
def borne_share(weight, falling):
    """b = (s - 1/4)/(1/2) in 0 to 1 [-], s = 1 - g.a/g^2 the share of its weight that something takes off a particle.

    `weight` = g^2, `falling` = g.a [m^2/s^4]; 1 without weight.
    """
    real = type(weight)
    if not weight > real(0):
        return real(1)
    share = (real(1 - FALLING) - falling / weight) / real(BORNE - FALLING)
    return min(max(share, real(0)), real(1))


@formula
def diffusion_pair(volume_j, excess_i, excess_j, head, slope, diffusion):
    """Fourtakas et al. 2019 for one neighbour: part of d rho_i/dt [kg/(m^dim s)]; `slope` = W'(r)/r.

    delta h_s c psi_ij.grad W_ij V_j = -2 delta h_s c (rho_j - rho_i + x_ij.g rho0/c^2) W'(r)/r V_j, `head` x_ij.g
    [m^2/s^2], in liquid that is borne: the difference at rest does not count. Molteni & Colagrossi 2009 where it is 0.
    """
    difference = excess_j - excess_i + head * diffusion.stretch
    return volume_j * slope * (-type(slope)(2) * diffusion.coefficient * difference)


@formula
def least_excess(excess, rest_density):
    """e = max(rho - rho0, -STRETCHED rho0) [kg/m^dim]: a liquid that is pulled further apart breaks."""
    least = -type(excess)(STRETCHED) * rest_density
    return least if excess < least else excess


@formula
def pressure_pair(volume_j, pressure_i, pressure_j, slope, fluid):
    """J(10) for one neighbour: factor of e_ij in the force density [N/m^3], -s V_j (p_i + p_j) W'(r).

    s = 1 (Jiang & Zhu E24): s = 1/2 as printed gives half the pressure gradient, as sum_j V_j p_i grad W_ij vanishes.
    """
    return volume_j * slope * (-fluid.gradient_share * (pressure_i + pressure_j))


@formula
def gradient_correction(xx, yy, zz, xy, xz, yz, smoothing):
    """Bonet & Lok 1999: B = I + s (M^-1 - I) of the symmetric M, as (xx, yy, zz, xy, xz, yz); dimensionless.

    s grows from 0 at det M = LEAST_FILLED to 1 at FILLED: a particle at a surface, with neighbours on one side, keeps
    the plain gradient.
    """
    real = type(xx)
    one = real(1)
    if smoothing.dim == 2:
        zz = one
    a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    det = xx * a + xy * b + xz * c
    if det <= real(LEAST_FILLED):
        return one, one, one, real(0), real(0), real(0)
    share = (det - real(LEAST_FILLED)) / real(FILLED - LEAST_FILLED)
    if share > one:
        share = one
    rest, f = one - share, share / det
    d, e = xx * zz - xz * xz, xy * xz - xx * yz
    return rest + f * a, rest + f * d, rest + f * (xx * yy - xy * xy), f * b, f * c, f * e


@formula
def corrected(diagonal, mixed, x):
    """y = B x [as x] of a symmetric B with the diagonal (xx, yy, zz) and the rest (xy, xz, yz)."""
    return (
        diagonal[0] * x[0] + mixed[0] * x[1] + mixed[1] * x[2],
        mixed[0] * x[0] + diagonal[1] * x[1] + mixed[2] * x[2],
        mixed[1] * x[0] + mixed[2] * x[1] + diagonal[2] * x[2],
    )


@formula
def own_pressure(pressure, near_surface):
    """Sun et al. 2018: q = -p where p < 0 away from the surface, so that p_i + p_j becomes p_j - p_i; else p [Pa]."""
    if pressure < type(pressure)(0) and not near_surface:
        return -pressure
    return pressure


@formula
def viscosity_pair(volume_j, viscosity, laplacian):
    """J(11) for one neighbour: factor of (v_j - v_i) in the force density [N s/m^4], mu V_j lap W; Jiang & Zhu E3."""
    return viscosity.coefficient * volume_j * laplacian


@formula
def central_viscosity_pair(volume_j, central_viscosity, laplacian):
    """Espanol & Revenga 2003 for one neighbour: factor of (e.(v_j - v_i)) e in the force density [N s/m^4].

    Their central part alone, 2 (dim + 2) mu V_j F_ij, with F = -W'/r of the kernel W ~ (1 - q)^2 (1 + 2 q), which is
    half of the viscosity Laplacian: (dim + 2) mu V_j lap W.
    """
    return central_viscosity.coefficient * volume_j * laplacian


@formula
def between_ends(x, bounds):
    """Whether the planes of walls act at x: first <= x <= last [m]."""
    beyond = False
    for c in range(3):
        beyond = beyond or x[c] < bounds.first[c] or x[c] > bounds.last[c]
    return not beyond


@formula(ordered=True)
def drifted(x, residual, shift):
    """x + (residual + shift) = place + rest [m]: the sum rounded, and what rounding takes from it (Knuth's two-sum).

    x is the rounded position, `residual` what rounding took from it before, `shift` = dt v.
    """
    shift = shift + residual
    place = x + shift
    added = place - x
    return place, (x - (place - added)) + (shift - added)
