"""Walls after Adami, Hu & Adams 2012: the term of one pair in each sum."""

from refsim.core.terms import clip, maximum, where
from refsim.sph.reference import internal_pressure, steepness


def share(w, j, wj):
    """Sum under (27), sum_j W_wj s_j [1/m^dim]; s_j = 1 of liquid and wet_j/1000 of solids.

    Where no liquid is within reach of a wall, a film of melt carries the pressure of solids.
    """
    return j.share * wj.W


def borne(i, p_int, rest):
    """p_b = p - P_int (rho/rho0)^2 [Pa]: walls do not bear the part that balances cohesion, as they exert none."""
    return i.pressure - internal_pressure(i, p_int, rest)


def wall_pressure(w, j, wj):
    """(27) p_w = sum_j W_wj s_j p_wj / sum_j W_wj s_j [Pa], p_wj = p_j + b_j rho_j (g - a_w).(x_w - x_j).

    b_j is the share of its weight that is borne, as liquid that falls has no head; of solids b_j rho_j is rho0.
    felt = g - a_w, which in a tank that turns differs from place to place.
    """
    return j.share * wj.W * (j.pressure + j.heavy * (wj.x @ w.felt))


def velocity(w, f, wf):
    """u_w = sum_f W_fw v_f/sum_f W_fw, the liquid's velocity at a wall particle; the first sum [1/(m^(dim-1) s)]."""
    return f.share * wf.W * f.velocity


def strain(w, f, wf):
    """s_w = V_w sum_f V_f (v_f - t_w).grad_f W_fw / sum_f W_fw, the adjoint of (27); the first sum [1/s].

    t_w is the part of u_w along the wall, 0 at edges: the sum of grad W has such a part, too, where the liquid ends,
    and to slide is no strain. With s_w the density does the work that p_w does on the liquid.
    """
    return -f.share * f.mass / f.density * ((f.velocity - w.along) @ wf.gradient)


def wall_force(i, w, iw):
    """a_i = -(1/rho_i) B_i sum_w V_w (p_i + p_w) grad W_iw [m/s^2]; g_i max(p_i + p_w, 2 s_i) by the film at solids."""
    both = i.pressure + w.pressure
    both = where(i.liquid, both, i.wider * maximum(both, 2 * i.suction))
    return -w.volume * both / i.density * iw.gradient


def holding_force(i, w, iw, k, n):
    """a_i = (2 k/rho_i) sum_w V_w F_iw (1 - r/h)^n e_iw e_iw.(v_w - v_i) [m/s^2], F of the liquid's viscosity."""
    shape = 2 * k * w.volume / i.density * steepness(iw.r, iw.h, iw.dim) * clip(1 - iw.r / iw.h, 0, 1) ** n
    return shape * (iw.e @ (w.velocity - i.velocity)) * iw.e
