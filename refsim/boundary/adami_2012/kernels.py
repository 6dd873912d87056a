"""What a wall particle takes from the liquid, and a liquid particle from the walls."""

from refsim.backends.compile import kernel
from refsim.backends.tuples import dot, over
from refsim.motion.formulas import felt
from refsim.neighbours.forces import force
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.neighbours.rows import add_vector
from refsim.smoothing.formulas import gradient_factor, kernel_value, safe_distance, viscosity_laplacian
from refsim.sph.formulas import borne_pressure, corrected, film_pressure
from refsim.sph.kernels import LIQUID_PHASE, wall_moves

FILM = 1e-3  # weight of a film on solids where there is liquid, too


@pair
def weighted_pair(r, x_ij, density_j, pressure_j, phase_j, wet_j, smoothing, lean, fluid):
    """Adami 2012 (27): W p, p = p_f + rho_f (g - a_w).(x_w - x_f) [Pa/m^dim], and W [1/m^dim]; the same of a film on
    solids, with less weight. Without solids p_f is what walls bear. `lean` is g - a_w.
    """
    w, p, head = kernel_value(r, smoothing), pressure_j, dot(lean, x_ij)
    if phase_j is None:
        p = borne_pressure(p, density_j, fluid)
        return w * (p + density_j * head), w
    if phase_j == LIQUID_PHASE:
        p += density_j * head
    elif wet_j is None:
        w = type(r)(0)
    else:
        w *= type(r)(FILM) * wet_j
        p += fluid.rest_density * head
    return w * p, w


@kernel
def extrapolation(
    i, density, pressure, phase, wet, liquid_near_walls, walls, smoothing, lean, turning, fluid, period, wall_pressure
):
    """Adami 2012 (27): pressure of wall particle i [Pa]; 0 where neither liquid nor a film is within reach."""
    total, weights = neighbour_sum(
        weighted_pair, i, None, liquid_near_walls, walls.position, period, density, pressure, phase, wet, smoothing,
        felt(i, walls.position, None, lean, turning), fluid,
    )  # fmt: skip
    zero = type(smoothing.support_radius)(0)
    wall_pressure[i] = total / weights if weights > zero else zero


@pair
def straining_pair(r, x_ij, velocity_j, mass_j, advanced_excess_j, phase_j, smoothing, fluid):
    """V_f v_f.grad_f W_fw [1/s], and W [1/m^dim]; none by solids."""
    w = kernel_value(r, smoothing)
    volume = mass_j / (fluid.rest_density + advanced_excess_j)
    strain = -volume * dot(velocity_j, x_ij) * gradient_factor(r, smoothing)
    if phase_j is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
        if phase_j != LIQUID_PHASE:
            w, strain = type(r)(0), type(r)(0)
    return strain, w


@kernel
def strain(i, velocity, mass, advanced_excess, phase, liquid_near_walls, walls, smoothing, fluid, period, wall_strain):
    """V_w sum_f V_f v_f.grad_f W_fw / sum_f W_fw of wall particle i [m^(2 dim)/s]; 0 without liquid."""
    zero = type(smoothing.support_radius)(0)
    total, weights = neighbour_sum(
        straining_pair, i, None, liquid_near_walls, walls.position, period, velocity, mass, advanced_excess, phase,
        smoothing, fluid,
    )  # fmt: skip
    volume = walls.volume[i]
    wall_strain[i] = volume * total / weights if weights > zero else zero


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
