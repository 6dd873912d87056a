"""Surface normals, inward: the term of one pair in each sum. Walls b are particles of volume V_b."""


def volume(i, j, printed):
    """V_j = m_j/rho_j [m^dim], printed m_j/rho_i (Jiang & Zhu E10)."""
    return j.mass / (i.density if printed else j.density)


def color_gradient(i, j, ij, printed):
    """J(19) n_i = h sum_j V_j grad W_ij; dimensionless."""
    return ij.h * volume(i, j, printed) * ij.gradient


def wall_color_gradient(i, b, ib):
    """J(19) over walls, n_i += h sum_b V_b grad W_ib; dimensionless."""
    return ib.h * b.volume * ib.gradient


def density_rise(i, j, ij, delta0, printed):
    """J(20) n*_i = sum_j (delta_j - delta_i)/delta0 V_j grad W_ij / sum_k V_k W_ik [1/m]; walls: delta_b = delta_i."""
    return (j.number - i.number) / delta0 * volume(i, j, printed) * ij.gradient


def filled(i, j, ij):
    """J(15) sum_k (m_k/rho_k) W_ik, i itself included; dimensionless."""
    return j.mass / j.density * ij.W


def wall_filled(i, b, ib):
    """J(15) over walls, sum_b V_b W_ib; dimensionless."""
    return b.volume * ib.W


def normals_apart(i, j, ij, along=None):
    """d = n_i - n_j, or with a factor s along e_ij alone, s ((n_i - n_j).e_ij) e_ij; dimensionless, or [1/m]."""
    apart = i.normal - j.normal
    return apart if along is None else along * (apart @ ij.e) * ij.e
