"""What one neighbour and one particle do at the boundary particles of a mesh."""

from refsim.backends.compile import kernel
from refsim.backends.tuples import added, dot, scaled
from refsim.motion.formulas import felt
from refsim.neighbours.forces import force
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.neighbours.rows import add_vector
from refsim.smoothing.formulas import kernel_slope, kernel_value, safe_distance, viscosity_laplacian
from refsim.sph.kernels import own_share, wall_moves


@pair
def wall_viscosity_pair(
    r, velocity_i, density_i, place_j, volume_j, smoothing, fluid, wall_viscosity, wall_motion
):  # fmt: skip
    """Patent P6 with E30, viscous part: mu Psi_b/rho_i^2 lap W_ib (v_b - v_i) [m/s^2], b at rest or moving.

    From F_ib = mu (m_i/rho_i) (Psi_b/rho_i) (v_b - v_i) lap W_ib, Psi_b = rho0 V_b.
    """
    wall_mass = fluid.rest_density * volume_j
    g = wall_viscosity.coefficient * wall_mass / (density_i * density_i) * viscosity_laplacian(r, smoothing)
    a = scaled(velocity_i, -g)
    if wall_motion is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
        if wall_moves(place_j, wall_motion):
            v = wall_motion.velocity
            a = added(a, scaled((v[0], v[1], v[2]), g))
    return a[0], a[1], a[2]


wall_viscosity = force(wall_viscosity_pair, period=True, around="walls")


@pair
def head_pair(r, x_ij, density_j, pressure_j, smoothing, lean):
    """W_ij and W_ij (p_j + rho_j g.x_ij)."""
    w = kernel_value(r, smoothing)
    return w, w * (pressure_j + density_j * dot(lean, x_ij))


@pair
def wall_push_pair(r, x_ij, density_i, volume_j, smoothing, fluid, mean, lean):
    """Patent P6 with E30: a_i = -s Psi_b p_b/rho_i^2 W'(r) e_ib [m/s^2], p_b = p~_i + rho0 g.(x_b - x_i).

    `mean` is p~_i, the mean pressure of the liquid around x_i, extrapolated to x_i (Adami, Hu & Adams 2012, (27)).
    """
    pressure = mean - fluid.rest_density * dot(lean, x_ij)
    if fluid.clamp and pressure < type(r)(0):
        pressure = type(r)(0)
    wall_mass = fluid.rest_density * volume_j
    f = -fluid.gradient_share * wall_mass * pressure / (density_i * density_i) * kernel_slope(r, smoothing)
    f /= safe_distance(r, smoothing)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


@kernel
def extrapolated_wall_pressure(
    i, position, density, pressure, neighbours, walls, smoothing, fluid, lean, turning, acceleration
):  # fmt: skip
    """Patent P6 with the boundary particles' pressures p_b (patent E30); added to the acceleration [m/s^2]."""
    if walls.count[i] > 0:
        w0, pull = own_share(smoothing), felt(i, position, None, lean, turning)
        weights, total = neighbour_sum(
            head_pair, i, None, neighbours, position, None, density, pressure, smoothing, pull
        )
        mean = (total + w0 * pressure[i]) / (weights + w0)
        a = neighbour_sum(
            wall_push_pair, i, None, walls, position, None, density, walls.volume, smoothing, fluid, mean, pull
        )
        add_vector(acceleration, i, None, a)
