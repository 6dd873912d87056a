"""What a wall particle takes from the liquid, and a liquid particle from the walls."""

from refsim.backends.compile import kernel
from refsim.backends.tuples import dot, over, scaled, three
from refsim.motion.formulas import felt
from refsim.neighbours.forces import force
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.neighbours.rows import add_vector
from refsim.smoothing.formulas import gradient_factor, kernel_value, safe_distance, viscosity_laplacian
from refsim.sph.formulas import across, borne_pressure, corrected, film_pressure
from refsim.sph.kernels import LIQUID_PHASE, wall_moves

FILM = 1e-3  # weight of a film on solids where there is liquid, too


@pair
def weighted_pair(r, x_ij, density_j, pressure_j, phase_j, wet_j, borne_j, smoothing, lean, fluid):
    """Adami 2012 (27): W p, p = p_f + b_f rho_f (g - a_w).(x_w - x_f) [Pa/m^dim], and W [1/m^dim]; the same of a film
    on solids, with less weight and all its head. Without solids p_f is what walls bear. `lean` is g - a_w.
    """
    w, p, head = kernel_value(r, smoothing), pressure_j, dot(lean, x_ij)
    of_liquid = density_j * head
    if borne_j is not None:
        of_liquid *= borne_j
    if phase_j is None:
        p = borne_pressure(p, density_j, fluid)
        return w * (p + of_liquid), w
    if phase_j == LIQUID_PHASE:
        p += of_liquid
    elif wet_j is None:
        w = type(r)(0)
    else:
        w *= type(r)(FILM) * wet_j
        p += fluid.rest_density * head
    return w * p, w


@kernel
def extrapolation(
    i, density, pressure, phase, wet, borne, liquid_near_walls, walls, smoothing, lean, turning, fluid, period,
    wall_pressure,
):  # fmt: skip
    """Adami 2012 (27): pressure of wall particle i [Pa]; 0 where neither liquid nor a film is within reach."""
    total, weights = neighbour_sum(
        weighted_pair, i, None, liquid_near_walls, walls.position, period, density, pressure, phase, wet, borne,
        smoothing, felt(i, walls.position, None, lean, turning), fluid,
    )  # fmt: skip
    zero = type(smoothing.support_radius)(0)
    wall_pressure[i] = total / weights if weights > zero else zero


@pair
def straining_pair(r, x_ij, velocity_j, mass_j, advanced_excess_j, phase_j, smoothing, fluid):
    """V_f v_f.grad_f W_fw [1/s], W [1/m^dim], V_f grad_f W_fw [1/m] and W v_f; none by solids."""
    w = kernel_value(r, smoothing)
    f = -mass_j / (fluid.rest_density + advanced_excess_j) * gradient_factor(r, smoothing)
    if phase_j is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
        if phase_j != LIQUID_PHASE:
            w, f = type(r)(0), type(r)(0)
    g, v = scaled(x_ij, f), scaled(velocity_j, w)
    return dot(velocity_j, g), w, g[0], g[1], g[2], v[0], v[1], v[2]


@kernel
def strain(
    i, velocity, mass, advanced_excess, phase, liquid_near_walls, walls, wall_normal, smoothing, fluid, period,
    wall_strain,
):  # fmt: skip
    """V_w sum_f V_f (v_f - t).grad_f W_fw / sum_f W_fw of wall particle i [m^(2 dim)/s]; 0 without liquid.

    t is the part along the wall of the mean of v_f with W_fw.
    """
    zero = type(smoothing.support_radius)(0)
    sums = neighbour_sum(
        straining_pair, i, None, liquid_near_walls, walls.position, period, velocity, mass, advanced_excess, phase,
        smoothing, fluid,
    )  # fmt: skip
    strained, weights, gradient, n = sums[0], sums[1], sums[2:5], three(wall_normal, i)
    wall_strain[i] = zero
    if weights > zero:
        u = over(sums[5:8], weights)
        sliding = dot(gradient, u) - dot(gradient, across(u, n))
        wall_strain[i] = walls.volume[i] * (strained - sliding) / weights


@pair
def push_pair(
    r, x_ij, density_i, pressure_i, phase_i, suction_i, film_factor_i, wall_pressure_j, volume_j, smoothing, fluid
):  # fmt: skip
    """J(10) of a wall particle, -V_w (p_i + p_w) grad W_iw [N/m^3], p_i as walls bear it; of solids by a film."""
    p = borne_pressure(pressure_i, density_i, fluid) + wall_pressure_j
    if phase_i is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
        if phase_i != LIQUID_PHASE:
            p = film_pressure(p, suction_i + suction_i) * film_factor_i
    f = -volume_j * p * gradient_factor(r, smoothing)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


@kernel(lanes=True)
def wall_force(
    i, lane, position, density, pressure, phase, suction, film_factor, wall_pressure, correction_diagonal,
    correction_mixed, neighbours, walls, smoothing, fluid, period, acceleration,
):  # fmt: skip
    """J(10) of liquid and solids with the walls; added to the acceleration [m/s^2]."""
    force = neighbour_sum(
        push_pair, i, lane, walls, position, period, density, pressure, phase, suction, film_factor, wall_pressure,
        walls.volume, smoothing, fluid,
    )  # fmt: skip
    if correction_diagonal is not None:
        force = corrected(correction_diagonal[i], correction_mixed[i], force)
    add_vector(acceleration, i, lane, over(force, density[i]))


@pair
def holding_pair(r, x_ij, velocity_i, place_j, volume_j, smoothing, holding, wall_motion):
    """Viscosity along the line of centres times (1 - r/h)^n of a wall particle, at rest or moving [N/m^3]."""
    parting = -dot(velocity_i, x_ij)
    if wall_motion is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
        if wall_moves(place_j, wall_motion):
            parting += dot(wall_motion.velocity, x_ij)
    near, apart = type(r)(1) - r * smoothing.inverse_radius, safe_distance(r, smoothing)
    f = holding.coefficient * volume_j * viscosity_laplacian(r, smoothing)
    for _ in range(holding.steepness):
        f *= near
    f = f * parting / (apart * apart)  # a product with 1/r^2 may overflow: its factors are taken in any order
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


hold = force(holding_pair, "hold", divided="density", period=True, around="walls")
