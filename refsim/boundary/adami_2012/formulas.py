"""Scalar formulas of walls after Adami, Hu & Adams 2012."""

from refsim.backends.compile import formula


@formula
def extrapolated_pair(pressure_f, density_f, x_wf, lean):
    """Adami 2012 (27) for one liquid particle: p = p_f + rho_f (g - a_w).(x_w - x_f) [Pa]."""
    return pressure_f + density_f * (lean[0] * x_wf[0] + lean[1] * x_wf[1] + lean[2] * x_wf[2])


@formula
def wall_force_pair(volume_w, pressure_i, pressure_w, slope):
    """J(10) with a wall particle: factor of x_iw in the force density [N/m^4], -V_w (p_i + p_w) W'(r)/r."""
    return -volume_w * (pressure_i + pressure_w) * slope
