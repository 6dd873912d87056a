"""Scalar formulas of heat conduction: Shao & Song 2017, equation (4), as M(4), and what completes it."""

from refsim.backends.compile import formula
from refsim.backends.tuples import added, difference, dot, product, symmetric, times, two_of
from refsim.heat.shapes import DRAWN_BACK, FLOOR, LARGEST_FACTOR, LEAST_FACTOR, MUELLER, SMALLEST, SPIKY


@formula
def laplacian_shape(q, conduction):
    """L_ij = scale * l(q) of M(4), q = r/h < 1: (1 - q)^2/max(q, 1/10) spiky, 1 - q Mueller; dimensionless.

    Below a tenth of h the quotient stays constant, so that one close pair does not make the whole system stiff.
    The true Laplacian of poly6, 4 q^2 (1 - q^2) - dim (1 - q^2)^2, is negative for small q (Shao & Song M5 as printed).
    """
    real = type(q)
    a = real(1) - q
    if conduction.laplacian == SPIKY:
        return a * a / max(q, real(0.1))
    if conduction.laplacian == MUELLER:
        return a
    a = real(1) - q * q
    return real(4) * q * q * a - real(conduction.dim) * a * a


@formula
def mean_conductivity(conductivity_i, conductivity_j, conduction):
    """2 k_ij = k_i + k_j as in M(4), or 4 k_i k_j/(k_i + k_j), twice the harmonic mean [W/(m K)]."""
    real = type(conductivity_i)
    both = conductivity_i + conductivity_j
    if conduction.harmonic and both > real(0):
        return real(4) * (conductivity_i / both) * conductivity_j
    return both


@formula
def pair_weight(q, volume_i, volume_j, conductivity_i, conductivity_j, seconds, conduction):
    """g = dt G_ij = dt V_i V_j 2 k_ij L_ij [J/K], the heat that a pair exchanges for each kelvin of difference.

    Volumes are taken in units of the spacing's, so that no power of a length exceeds the range of float32.
    """
    volumes = (volume_i * conduction.inverse_volume) * (volume_j * conduction.inverse_volume)
    mean = mean_conductivity(conductivity_i, conductivity_j, conduction)
    return volumes * mean * laplacian_shape(q, conduction) * (conduction.scale * seconds)


@formula
def missing_factor(away, compensation_x_i, compensation_rest_i, compensation_x_j, compensation_rest_j):
    """f_ij = e.(A_i + A_j).e/2 within 1/10 and 10, e = x_ij/r; 1 without A. Dimensionless.

    `away` is along x_ij, in any unit. A_i, of (xx, xy, xz) and (yy, yz, zz), makes up for neighbours that are missing.
    """
    real = type(away[0])
    value = real(1)
    if compensation_x_i is not None:
        x, rest = added(compensation_x_i, compensation_x_j), added(compensation_rest_i, compensation_rest_j)
        along = dot(away, times(symmetric((*x, *rest)), away))
        value = real(0.5) * along / max(dot(away, away), real(SMALLEST))
        if value < real(LEAST_FACTOR):  # false for NaN, which minima and maxima would hide on a GPU
            value = real(LEAST_FACTOR)
        elif value > real(LARGEST_FACTOR):
            value = real(LARGEST_FACTOR)
    return value


@formula
def moment_share(q, volume_j, conduction):
    """V_j L_ij h^2, of which the moment S_i = sum_j V_j L_ij f_ij x_ij x_ij^T is made; dimensionless."""
    h = conduction.support_radius
    shape = volume_j * conduction.inverse_volume * laplacian_shape(q, conduction)
    return shape * (conduction.scale * conduction.inverse_volume * h * h)


@formula
def inverse_moment(s):
    """P = (1 + c) (S + c I)^-1, c = 1/20, of S = (xx, xy, xz, yy, yz, zz): I for S = I; dimensionless."""
    real = type(s[0])
    xx, xy, xz, yy, yz, zz = s[0] + real(FLOOR), s[1], s[2], s[3] + real(FLOOR), s[4], s[5] + real(FLOOR)
    ax, ay, az = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    f = real(1 + FLOOR) / (xx * ax + xy * ay + xz * az)
    return f * ax, f * ay, f * az, f * (xx * zz - xz * xz), f * (xy * xz - xx * yz), f * (xx * yy - xy * xy)


@formula
def compensated(a, p, s, weight):
    """A' = A + w ((P (I - S) + (I - S) P)/2 - (A - P)/100), symmetric (xx, xy, xz, yy, yz, zz); dimensionless.

    The last term bounds A where the neighbours determine nothing. A' = P where A is 0, which no A is otherwise.
    """
    real = type(weight)
    one, half = real(1), real(0.5)
    left = one - s[0], -s[1], -s[2], one - s[3], -s[4], one - s[5]
    b = product(symmetric(p), symmetric(left))
    change = b[0], half * (b[1] + b[3]), half * (b[2] + b[6]), b[4], half * (b[5] + b[7]), b[8]
    change = two_of(one, change, real(DRAWN_BACK), difference(p, a))
    after = two_of(one, a, weight, change)
    if a[0] == real(0):
        after = p
    return after


@formula
def pair_share(weight, inverse_i, inverse_j):
    """M(4): g/(1 + g (1/C_i + 1/C_j)) [J/K], the backward Euler exchange of a pair that is alone."""
    return weight / (type(weight)(1) + weight * (inverse_i + inverse_j))


@formula
def temperature_of(enthalpy, heat_capacity, melting_point, latent_heat):
    """T = Tm + H/c for H < 0, Tm up to the latent heat L, Tm + (H - L)/c above [degrees C]; H = 0 is solid at Tm."""
    beyond = enthalpy
    if enthalpy >= type(enthalpy)(0):
        beyond = enthalpy - latent_heat
        if enthalpy <= latent_heat:  # false for NaN, which minima and maxima would hide on a GPU
            beyond = type(enthalpy)(0)
    return melting_point + beyond / heat_capacity
