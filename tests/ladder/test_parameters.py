"""Every constant that the host prepares for kernels, against a program of its own, written from the papers.

The reference takes the same numbers as the kernels, so that comparing the two says nothing of them. Here each member of
each parameter group that an effect hands out is computed again from the published formula: kernels are normalised by
quadrature, lattices are summed, nothing is taken from refsim's own tables. Lengths and densities are not one.
"""

import functools
import itertools
import math

import msgspec
import numpy as np
import pytest
import trimesh

import refsim as rs
from refsim.boundary.sampling import relaxation_step
from refsim.boundary.signed_distance import band_grid
from refsim.core import cases
from refsim.core.effect import EFFECTS, Discretisation, Effect
from refsim.core.period import period_group
from refsim.scene.solids import voxelised
from refsim.surface_energy import Tension, surface_term
from tests import layers, pairs
from tests.running import rows

D, H, RHO, C, MU = 0.14, 0.37, 870.0, 60.0, 0.4  # spacing [m], support radius [m], rho0, c [m/s], mu [Pa s]
SIGMA = 0.8  # [N/m]
RTOL = 1e-6  # the host's quadrature of the clamped attraction runs over a kink and is 3e-7 off; the others 1e-9
SETS = {
    "wendland": ("wendland_c2", "wendland_c2"), "mueller": ("poly6", "spiky"),
    "cubic_spline": ("cubic_spline", "cubic_spline"),
}  # fmt: skip
NUMBERS = {"poly6": 0, "spiky": 1, "cubic_spline": 2, "wendland_c2": 3}


# The smoothing kernels: shapes of the published kernels in q = r/h, normalised by quadrature.
_NODE, _WEIGHT = np.polynomial.legendre.leggauss(40)


def integral(f, edges=(0.0, 0.3, 0.5, 0.8, 1.0)):
    """Integral of f over [edges[0], edges[-1]], by Gauss quadrature between the edges."""
    total = 0.0
    for a, b in itertools.pairwise(edges):
        total += 0.5 * (b - a) * (_WEIGHT * f(0.5 * (a + b) + 0.5 * (b - a) * _NODE)).sum()
    return float(total)


def sphere(dim):
    """Surface of the unit sphere."""
    return 2 * math.pi if dim == 2 else 4 * math.pi


def shape(name, q):
    """w(q) with W(r) = norm/h^dim w(r/h): poly6 and spiky of Mueller et al. 2003, Monaghan's spline, Wendland C2."""
    q = np.asarray(q) * 1.0
    inner, outer = 6 * (q**3 - q**2) + 1, 2 * (1 - q) ** 3
    w = {
        "poly6": (1 - q**2) ** 3, "spiky": (1 - q) ** 3, "cubic_spline": np.where(q.real < 0.5, inner, outer),
        "wendland_c2": (1 - q) ** 4 * (1 + 4 * q),
    }[name]  # fmt: skip
    return np.where(q.real < 1, w, 0.0)


def norm(name, dim):
    """Such that the integral of W over space is one."""
    return 1 / (sphere(dim) * integral(lambda q: shape(name, q) * q ** (dim - 1)))


def kernel(name, r, dim, h=H):
    """W(r) [1/m^dim]."""
    return norm(name, dim) / h**dim * shape(name, np.asarray(r) / h)


def slope(name, r, dim, h=H):
    """W'(r) [1/m^(dim+1)], by differences in the complex plane, so that nothing cancels."""
    return norm(name, dim) / h ** (dim + 1) * shape(name, np.asarray(r) / h + 1e-30j).imag / 1e-30


def offsets(dim):
    """Places of the infinite lattice around the origin [m], the origin itself first."""
    places = D * np.array(list(itertools.product(range(-3, 4), repeat=dim)), dtype=float)
    return places[np.argsort((places**2).sum(1), kind="stable")]


def lengths(places):
    return np.sqrt((places**2).sum(-1))


def rest_number_density(dim, sums="wendland_c2"):
    """delta0: J(8) on the undisturbed lattice."""
    return float(kernel(sums, lengths(offsets(dim)), dim).sum())


def mass(dim):
    """m = rho0/delta0."""
    return RHO / rest_number_density(dim)


def sharp_tension(force, dim):
    """sigma [N/m] of a pair force m^2 C(r) between sharp half spaces, Kirkwood & Buff 1949; C > 0 repels."""
    power, factor = (4, math.pi / 8) if dim == 3 else (3, 1 / 3)
    edges = np.array([0.0, D / H, 0.5, 0.8, 1.0]) if D / H < 0.5 else np.array([0.0, 0.5, 0.8, 1.0])
    return -factor * RHO**2 * integral(lambda r: r**power * force(r), H * np.sort(edges))


def bulk_pressure(force, dim):
    """P_int [Pa] of the virial of the bulk, for g(r) = 1."""
    power, factor = (3, 2 * math.pi / 3) if dim == 3 else (2, math.pi / 2)
    return -factor * RHO**2 * integral(lambda r: r**power * force(r), H * np.array([0.0, D / H, 0.5, 0.8, 1.0]))


def lattice_pressure(force, dim):
    """P_int [Pa] of the virial of the lattice: -(1/2 dim) n sum_j r f, f = m^2 C, n = 1/(volume of a particle)."""
    r = lengths(offsets(dim)[1:])
    return -RHO / mass(dim) / (2 * dim) * float((r * mass(dim) ** 2 * force(r)).sum())


def smoothing_group(name, dim):
    # Mueller et al. 2003: lap W = A (h - r), exact on quadratic fields: (1/2 dim) int r^2 lap W dV = 1.
    second = sphere(dim) * integral(lambda q: q ** (dim + 1) * (1 - q))
    return {
        "support_radius": H, "inverse_radius": 1 / H, "value_scale": norm(name, dim) / H**dim,
        "slope_scale": norm(name, dim) / H ** (dim + 1), "laplacian_scale": 2 * dim / second / H ** (dim + 2),
        "shape": NUMBERS[name], "dim": dim,
    }  # fmt: skip


@functools.cache
def along_centres(dim):
    """(dim + 2) mu along the line of centres, over what layers of the lattice feel that slide along each other."""
    felt = layers.friction(H / D, dim) @ np.arange(1, math.ceil(H / D) + 1) ** 2
    return (dim + 2) * MU / (felt * mass(dim) / RHO / D**dim)


def holding(dim):
    return {"holding": {"coefficient": lambda k, group: holds(k, dim), "steepness": 3}}


def holds(k, dim):
    """Whether liquid between walls of whole cells does not slip that feel a friction of k times (1 - r/h)^3."""
    volume = mass(dim) / RHO / D**dim
    both = ((along_centres(dim), 0), (k, 3))
    of_liquid, of_wall = (volume * s / (dim + 2) * layers.friction(H / D, dim, n) for s, n in both)
    return layers.judged(layers.drag(of_liquid, of_wall, 24), MU)[1] == pytest.approx(1, rel=1e-5)


# What each effect is to hand out, from its paper's equations: {group: {member: value}}.
def viscous(dim, viscosity=MU, central=False):
    """J(11), or zeta = 5 eta/3 of Espanol & Revenga 2003 in 3D."""
    return {
        "viscosity": {"coefficient": viscosity} if viscosity and not central else None,
        "central_viscosity": {"coefficient": along_centres(dim)} if central else None,
    }


def balanced(dim, of):
    """P_int [Pa] of the liquid's attraction."""
    forces = {
        "": lambda r: 0.0 * r, "air": lambda r: 200.0 * slope("wendland_c2", r, dim) / RHO**2,
        "molecules": lambda r: 0.3 * molecular_shape(r, D),
        "cohesion": lambda r: jiang_zhu(dim)["cohesion"]["gamma"] * jiang_zhu_shape(r, dim, {2: 0.75, 3: 0.6}[dim]),
    }  # fmt: skip
    return (lattice_pressure if of == "molecules" else bulk_pressure)(forces[of], dim)


def liquid(dim, kernels="wendland", exponent=1, clamp=1, pressure="", gradient=1.0, wall=2.0, **viscosity):
    """Jiang & Zhu 2023, J(9) (Tait's equation with exponent 7), J(10), J(11); walls with p_b = p_i push twice."""
    sums, gradients = SETS[kernels]
    fluid = {
        "rest_density": RHO, "stiffness": RHO * C**2 / exponent, "exponent": exponent, "clamp": clamp,
        "internal_pressure": balanced(dim, pressure), "gradient_share": gradient, "wall_share": wall,
    }  # fmt: skip
    groups = {
        "smoothing": smoothing_group(sums, dim), "gradient_smoothing": smoothing_group(gradients, dim), "fluid": fluid,
        "density_bounds": {"rest_density": RHO, "dense": 1.1, "crushed": 1.5},
    }  # fmt: skip
    return groups | viscous(dim, **viscosity)


def normal_term(dim, printed=0, sums="wendland_c2"):
    """J(20): delta0; Jiang & Zhu E10: the printed volume m_j/rho_i."""
    return {"normal_term": {"rest_number_density": rest_number_density(dim, sums), "own_density": printed}}


def half_space_moment(dim, sums="wendland_c2"):
    """delta0 int x W over the half space x > 0 [m^(1-dim)]; in polar coordinates, x = r cos."""
    angles = integral(np.cos, (-math.pi / 2, 0.0, math.pi / 2))  # in the plane
    if dim == 3:
        angles = 2 * math.pi * integral(lambda t: np.cos(t) * np.sin(t), (0.0, math.pi / 2))
    radial = integral(lambda r: r**dim * kernel(sums, r, dim), H * np.array([0.0, 0.5, 1.0]))
    return rest_number_density(dim, sums) * angles * radial


def detection(dim, share=0.98, sparse=0.9, asymmetry=0.25, printed=0, sums="wendland_c2"):
    """J(12) delta_i <= lambda delta0; the asymmetry over that on a plane; J(13) with s = h/2 (Jiang & Zhu E6).

    Printed: the corrected normal, of 1/m, and E5, E6, E10.
    """
    delta0 = rest_number_density(dim, sums)
    return normal_term(dim, printed, sums) | {
        "near_surface_limit": {"number_density": share * delta0, "asymmetry": math.inf},
        "candidate_limit": {"number_density": sparse * delta0, "asymmetry": asymmetry * half_space_moment(dim, sums)},
        "fan_scan": {
            "radius": H if printed else H / 2, "support_radius": H, "printed": printed,
            "smallest_normal": 1e-12 / H if printed else 1e-12,
        },
    }  # fmt: skip


def jiang_zhu_shape(r, dim, alpha):
    """J(17) C(r) = alpha W_poly6(r, 0.8 h) - beta W_poly6(r, h)."""
    return alpha * kernel("poly6", r, dim, 0.8 * H) - 0.9 * kernel("poly6", r, dim)


def jiang_zhu(dim, gamma=None, alpha=None, sign=1, mode=1, area=None, soft=(0.3, 1.0), axial=False):
    """J(16) with gamma from sigma, J(17) with alpha = 0.6 (0.75 in 2D, Jiang & Zhu E7) and beta = 0.9, J(18), J(21).

    eps is eps_r gamma rho0^2 h^(1-dim) of J(21), kind 0; of J(18) that of Akinci et al. 2013 or given, kind 1.
    """
    alpha = alpha or {2: 0.75, 3: 0.6}[dim]
    gamma = gamma or SIGMA / sharp_tension(lambda r: jiang_zhu_shape(r, dim, alpha), dim)
    at_zero = kernel("poly6", 0.0, dim), kernel("poly6", 0.0, dim, 0.8 * H)
    cohesion = {
        "gamma": sign * gamma, "alpha": alpha, "beta": 0.9, "amplitude": sign * gamma * at_zero[0],
        "inner_share": at_zero[1] / at_zero[0], "inner_stretch": 1 / 0.8,
    }  # fmt: skip
    if area is not None:
        corrected, given = area.get("ratio"), area.get("acceleration", 1e-3 * gamma * RHO)
        eps = corrected * gamma * RHO**2 / H ** (dim - 1) if corrected else given
        area = {"kind": int(not corrected), "coefficient": eps}
    return detection(dim) | {
        "pairs": {"mode": mode}, "soft": {"lower": soft[0], "upper": soft[1], "inverse_width": 1 / (soft[1] - soft[0])},
        "cohesion": cohesion, "area": area, "axial": along_axis(dim) if axial else None,
    }  # fmt: skip


def along_axis(dim):
    return {"factor": {2: 2.0, 3: 2.5}[dim]}


def akinci_shape(r, dim):
    """Akinci, Akinci & Teschner 2013, (2): C(r), 1/h^9 in space; 1/h^8 in the plane. Positive attracts."""
    r = np.asarray(r, dtype=float)
    far = (H - r) ** 3 * r**3
    inner = 2 * far - H**6 / 64
    return 32 / (math.pi * H ** (dim + 6)) * np.where(r > H / 2, far, inner)


def akinci(dim, gamma=None, area=None, beta=0.0, axial=False):
    """Their (1) with gamma from sigma, (3) with eps, (7) whose A(r) is 0.007/h^(13/4) (-4 r^2/h + 6 r - 2 h)^(1/4)."""
    gamma = gamma if gamma is not None else SIGMA / sharp_tension(lambda r: -akinci_shape(r, dim), dim)
    at = 0.75 * H  # where (-4 r^2/h + 6 r - 2 h)^(1/4) is (h/4)^(1/4)
    adhesion = 0.007 / H**3.25 * (-4 * at**2 / H + 6 * at - 2 * H) ** 0.25 * 4**0.25 * (1 if dim == 3 else H)
    eps = 1e-3 * gamma * RHO if area is None else area
    return normal_term(dim) | {
        "spline": {"gamma": gamma, "amplitude": gamma * 32 / (math.pi * H**dim)} if gamma else None,
        "area_term": {"coefficient": eps} if eps else None, "adhesion": {"beta": beta, "amplitude": beta * adhesion},
        "axial": along_axis(dim) if axial else None,
    }  # fmt: skip


def becker_teschner(dim, kappa=None, least=D):
    """Becker & Teschner 2007: a_i = -(kappa/m_i) sum_j m_j W(max(r, d)) x_ij with the cubic spline."""

    def force(r):
        return -kernel("cubic_spline", np.maximum(r, least), dim) * r / mass(dim)

    kappa = kappa or SIGMA / sharp_tension(force, dim)
    at_zero = float(kernel("cubic_spline", 0.0, dim))
    return {"attraction": {"kappa": kappa, "strength": kappa * at_zero, "least_q": least / H}}


def half_space_normal(dim, kernels):
    """|n_k| of layer k of a lattice half space, n = sum_j V grad W / sum_j V W, by summing particle by particle."""
    sums, gradients = SETS[kernels]
    found = []
    for depth in range(5):
        weight, total = 0.0, 0.0
        for x in offsets(dim):
            r = float(lengths(x))
            if x[-1] + 1e-9 >= -depth * D and r < H:  # the half space ends above layer 0: its layers go up
                weight += float(kernel(sums, r, dim))
                total += float(slope(gradients, r, dim)) * x[-1] / r if r > 0 else 0.0
        found.append(abs(total) / weight)
    return np.array(found)


def continuum(dim, kernels="wendland", normalise=True, plain=0, threshold=0.5, gradient=None, cotangent=0.0):
    """Brackbill, Kothe & Zemach 1992 with one-sided normals: sigma, |n| > threshold/h, and the lost share of |n|."""
    share = 1 / float(half_space_normal(dim, kernels).sum() * D) if normalise else 1.0
    return detection(dim, sums=SETS[kernels][0]) | {
        "continuum": {
            "tension": SIGMA, "threshold": threshold / H, "factor": dim if plain else dim - 1, "share": share,
            "plain": plain,
        },
        "marangoni": gradient and dict(zip("xyz", gradient)),
        "wetting": {"cotangent": lambda found, group: abs(found - cotangent) < 1e-8},
    }  # fmt: skip


def molecular_shape(r, d0):
    """D(7) L(r)/k, after Mueller et al. 2004."""
    far = (H - d0) ** 2
    return ((H - r) ** 4 - far * (H - r) ** 2) / (H**2 * d0 * (2 * H - d0)) * (r < H)


def dong(dim, d0=D, stiffness=None, correction=None, symmetric=1):
    """D(6) and D(7) with k from sigma = -(n/32) sum_j r^2 f_j (in the plane n/(6 pi)); D(9) with lambda."""
    r = lengths(offsets(dim)[1:])
    number, unit = rest_number_density(dim), float((r**2 * mass(dim) ** 2 * molecular_shape(r, d0)).sum())
    unit *= -number / 32 if dim == 3 else -number / (6 * math.pi)
    stiffness = SIGMA / unit if stiffness is None else stiffness
    correction = 3 * stiffness * unit / (RHO * D) if correction is None else correction
    force = {
        "stiffness": stiffness, "rest_distance": d0, "rest_share": (H - d0) ** 2 / H**2,
        "scale": H**2 / (d0 * (2 * H - d0)),
    }  # fmt: skip
    # The normal of the kernels is h n of D(11).
    both = normal_term(dim) | {"molecular_force": force if stiffness else None}
    return both | {"normal_correction": {"coefficient": correction / H, "symmetric": symmetric} if correction else None}


def he_unit_tension(dim, kernels):
    """sigma [N/m] of kappa = 1 N: a column of a lattice slab, its pair forces' work, layer by layer."""
    sums, gradients = SETS[kernels]
    volume, near = D**dim, [x for x in offsets(dim) if 0 < lengths(x) < H * (1 - 1e-12)]
    layers = 40  # a slab with two surfaces

    def color(k):
        inside = [0.0, *(lengths(x) for x in near if 0 <= k + round(x[-1] / D) < layers)]
        return volume * float(kernel(sums, np.array(inside), dim).sum())

    def there(k):
        return [(x, k + round(x[-1] / D)) for x in near if 0 <= k + round(x[-1] / D) < layers]

    c = [color(k) for k in range(layers)]
    pull = {round(float(lengths(x)), 12): float(slope(gradients, lengths(x), dim)) for x in near}
    steep = []
    for k in range(layers):
        total = sum(volume * c[j] * pull[round(float(lengths(x)), 12)] * x[-1] / lengths(x) for x, j in there(k))
        steep.append((total / c[k]) ** 2)
    sigma = 0.0
    for k in range(layers):  # F_i<-j = (kappa/4) V^2 (|grad c_i|^2 + |grad c_j|^2) grad_i W, x_ij = -x
        for x, j in there(k):
            size = float(lengths(x))
            factor = 0.25 * volume**2 * (steep[k] + steep[j]) * pull[round(size, 12)] / size
            sigma += 0.5 * factor * (x[-1] ** 2 - (x[:-1] ** 2).sum() / (dim - 1)) / D ** (dim - 1)
    return sigma / 2


def he(dim, kappa=None, air=None, kernels="wendland"):
    """He et al. 2014: (kappa/4)(|grad c_i|^2 + |grad c_j|^2); p_atm."""
    kappa = kappa or SIGMA / he_unit_tension(dim, kernels)
    return {"gradient_energy": {"kappa": kappa, "quarter": kappa / 4}, "air_pressure": air and {"pressure": air}}


def cosine(dim):
    """Tartakovsky & Meakin 2005: F = s cos(3 pi r/(2 h)) e_ij, independent of the masses."""
    unit = sharp_tension(lambda r: np.cos(1.5 * math.pi * r / H) / mass(dim) ** 2, dim)
    return {"cosine_force": {"strength": SIGMA / unit, "wave_number": 3 * math.pi / (2 * H)}}


def implicit(dim, relaxation=0.25, tolerance=1e-3, least=2, most=100):
    """Ihmsen et al. 2014: -a_ii/dt^2 = (m/rho0)^2 (|sum_j grad W|^2 + sum_j |grad W|^2); sum_j grad W = 0."""
    squares = float((slope("wendland_c2", lengths(offsets(dim)[1:]), dim) ** 2).sum())
    return viscous(dim) | {
        "implicit": {
            "relaxation": relaxation, "tolerance": tolerance, "least": least, "most": most,
            "least_diagonal": 1e-6 * squares / rest_number_density(dim) ** 2,
        },
    }  # fmt: skip


def coupling(dim, exponent=1, m2=0, m3=0, m4=0, weighted=0):
    """Shao & Song 2017, (1) to (3), M2 to M4 as printed: V_min = 1/sum_j W_ij in the bulk, Tait's B/rho0 = c^2/g."""
    return {
        "viscosity": {"coefficient": MU},
        "coupling": {
            "least_volume": 1 / rest_number_density(dim), "stiffness": C**2 / exponent, "exponent": exponent,
            "printed_volume": m4, "printed_pressure": m2, "printed_viscosity": m3, "density_weighted": weighted,
        },
    }  # fmt: skip


def heat_weight(name, q, dim):
    """L_ij of Shao & Song's (4) [1/m^(dim+2)]: -W'/r of spiky, Laplacian of Mueller or poly6 (Shao & Song M5)."""
    r = np.asarray(q, dtype=float) * H
    if name == "spiky":
        return -slope("spiky", r, dim) / r
    if name == "mueller":
        return smoothing_group("spiky", dim)["laplacian_scale"] * (1 - q)
    second = (slope("poly6", r * (1 + 1e-5), dim) - slope("poly6", r * (1 - 1e-5), dim)) / (2e-5 * r)
    return second + (dim - 1) * slope("poly6", r, dim) / r


def heat(dim, name="spiky", factor=None, planned=None, largest=10.0, **changes):
    """Shao & Song's (4), whose L_ij is made consistent: sum_j V_j L_ij r^2/dim = 1 on the lattice (Shao & Song M6)."""
    r = lengths(offsets(dim)[1:])
    r = r[r < H * (1 - 1e-12)]
    weight = D**dim * heat_weight(name, r / H, dim)
    factor = 1 / float((weight * r**2).sum() / dim) if factor is None else factor
    half = heat_weight(name, 0.5, dim)  # coefficient of l(q), from L at q = 1/2
    number, profile = {"spiky": (0, 0.5), "mueller": (1, 0.5), "poly6": (2, 0.75 - 0.5625 * dim)}[name]
    tolerance = changes.get("tolerance", 4e-3)
    # Chebyshev's iteration: s = dt sum_j G_ij/C_i, rho = s/(1 + s), sigma = rho/(1 + sqrt(1 - rho^2)).
    s = 3 * largest * 2 * factor * float(np.abs(weight).sum()) * D**2
    rho = s / (1 + s)
    passes = math.ceil(math.log(tolerance / 2) / math.log(rho / (1 + math.sqrt(1 - rho**2))))
    group = {
        "support_radius": H, "inverse_radius": 1 / H, "inverse_volume": 1 / D**dim,
        "scale": factor * float(half) / profile * D ** (2 * dim), "factor": factor, "tolerance": 4e-3,
        "sweep_share": 0.5, "laplacian": number, "harmonic": 1, "unit_capacity": 0, "frozen": 0,
        "planned_passes": passes if planned is None else planned, "dim": dim,
    }  # fmt: skip
    return {"conduction": group | changes}


def matching(dim, width=2, stiffness=1.0, damping=0.1):
    """Rivers & James 2007: alpha, beta and w; floors of undetermined twists and of the inertia of thin regions."""
    group = {
        "half_width": width, "spacing": D, "stiffness": stiffness, "damping": damping, "twist_floor": 1e-6,
        "inertia_floor": 1e-9, "precision": 0.05 * 2.0**-52, "eps": 2.0**-52,
    }  # fmt: skip
    return {"matching": group}


def melting(dim, into=0):
    """What melts becomes liquid; with `into` of its mass and density, too."""
    return {
        "melting": {
            "into_liquid": into, "liquid_density": RHO, "liquid_mass": mass(dim), "liquid_conductivity": 0.7,
            "liquid_heat_capacity": 2100.0,
        }
    }  # fmt: skip


CELLS = {2: 0.33, 3: 0.31}  # h of the background grid [m], by dimension


def material_points(dim, share=1.0, m3=0, m4=0, m5=0, m6=False, reading=0, walls=False):
    """MLS-MPM (Hu et al. 2018) with quadratic splines: D^-1 = 4/h^2; viscosity 4 mu/(rho0 h^2)."""
    h, modulus = CELLS[dim], 3.1e6
    deep = dim == 3
    return {
        "background": {
            "cell_size": h, "inverse_cell": 1 / h, "inverse_moment": 4 / h**2, "layers": 3 if deep else 1,
            "width": 6 if deep else 10, "least_mass": 1e-24 * RHO * D**dim,
            "least_speed": 1e-200 * math.sqrt(modulus / RHO),
        },
        "liquid": {
            "rest_density": RHO, "stress": share * modulus, "linear_stress": m4, "unit_volume": m3, "timeless": m5,
        },
        "field": None, "planes": wall_nodes(dim) if walls else None, "embedding": {"reading": reading},
        "counting": {"cell_mass": RHO * h**dim},
        "kernel_gradient": {"on": 1} if m6 else None, "viscous_stress": {"factor": 4 * MU / (RHO * h**2)},
    }  # fmt: skip


WALLS = ((-1.0, -0.7, -0.9), (1.2, 1.5, 1.1))


def wall_nodes(dim):
    """Nodes on and beyond the faces of WALLS; rules 3 separating, 1 sticky, 2 slip, 0 none; no walls along z in 2D."""
    h = CELLS[dim]
    lower = [-(2**30)] * 3
    upper = [2**30] * 3
    for axis in range(dim):
        lower[axis], upper[axis] = math.floor(WALLS[0][axis] / h), math.ceil(WALLS[1][axis] / h)
    rules = [1, 3, 2, 0, 3, 3] if dim == 3 else [1, 3, 2, 0, 0, 0]
    return {"lower": lower, "upper": upper, "rules": rules}


def box_walls(dim, top=math.inf):
    """The planes of WALLS but for the open face +y, where they end unless it is upward; none along z in the plane."""
    lower, upper = [*WALLS[0]], [WALLS[1][0], math.inf, WALLS[1][2]]
    if dim == 2:
        lower[2], upper[2] = -math.inf, math.inf
    last = [upper[0] + D / 2, top, upper[2] + D / 2]
    return {"bounds": {"lower": lower, "upper": upper, "first": np.array(lower) - D / 2, "last": last}}


@functools.cache
def steepest_wave(dim):
    """Largest change of sum_j V (1 + 0.2 (W/W(d))^4) grad W over a crest's displacement [1/m^2], of 9^dim waves."""
    x = offsets(dim)[1:, :dim]
    r = lengths(x)

    def crowded(r):
        return (1 + 0.2 * (kernel("wendland_c2", r, dim) / kernel("wendland_c2", D, dim)) ** 4) * slope(
            "wendland_c2", r, dim
        )

    along, across = (crowded(r + 1e-6 * D) - crowded(r - 1e-6 * D)) / (2e-6 * D), crowded(r) / r
    unit = x / r[:, None]
    by_pair = across[:, None, None] * np.eye(dim) + (along - across)[:, None, None] * unit[:, :, None] * unit[:, None]
    waves = np.array(list(itertools.product(np.linspace(0, math.pi / D, 9), repeat=dim)))
    return D**dim * np.linalg.eigvalsh(np.einsum("nw,nab->wab", 1 - np.cos(x @ waves.T), by_pair)).max()


def shifting(dim, strength=2.2, outer=0.9, within=0.95):
    """Sun et al. 2017 (7): A 2 h_s = A h; W(d); the longest shift is v_max dt/2; delta0 of the lattice.

    v_max dt counts up to what takes away 1.75 of the steepest wave.
    """
    neighbour = float(kernel("wendland_c2", D, dim))
    group = {"length": strength * H, "inverse_neighbour": 1 / neighbour, "largest": 0.5, "least": 0.05 / H}
    group |= {"whole": 1 / rest_number_density(dim), "outer": outer, "within": within}
    return {"shifting": group | {"farthest": 1.75 / (strength * H * steepest_wave(dim))}}


def surface_of_run(dim):
    """Cells, particles of a full one, and rho0."""
    h = CELLS[dim]

    def holds(surface):
        return np.allclose(
            [surface.cell_size, surface.full, surface.rest_density, surface.dim], [h, (h / D) ** dim, RHO, dim]
        )

    return {"surface": holds}


BLOCK = np.array([0.9, 0.7, 0.5])  # edges of the mesh in `mesh_boundary`, its middle at CENTER [m]
CENTER = np.array([0.3, -0.2, 0.1])


def table(value, group):
    """Tables of a mesh and of boxes of cells are judged by tests/boundary and tests/shape_matching, by their use."""
    return isinstance(value, np.ndarray)


def around(beyond):
    """Whether a box reaches beyond the mesh by its band, and by at most two blocks and a spacing."""
    return (beyond >= 2 * 0.06).all() and (beyond <= 9 * 0.06).all()


def mesh(dim, gravity=(0.0, 0.0, 0.0), swept=1, printed=0):
    """Patent CN104318598A: patent P6 (friction, pressure extrapolated by gravity) and P8; the band at the surface."""
    h = 0.06
    return {
        "lean": dict(zip("xyz", gravity)), "wall_viscosity": {"coefficient": 0.7},
        "adhesion": {"beta": 1.3, "amplitude": 1.3 * akinci(3, beta=1.0)["adhesion"]["amplitude"]},
        "penetration": {
            "restitution": 0.3, "rebound": 0.2, "swept": swept, "printed": printed,
            "lower": lambda low, group: around(CENTER - BLOCK / 2 - low),
            "upper": lambda top, group: around(top - CENTER - BLOCK / 2),
        },
        "solid_field": {
            "keys": table, "neighbour": table, "distance": table, "closest": table, "inside_after": table, "spacing": h,
            "inverse_spacing": 1 / h, "band": lambda band, field: band >= 2 * h, "origin_x": CENTER[0],
            "origin_y": CENTER[1], "origin_z": CENTER[2],
        },
    }  # fmt: skip


BODIES = (
    rs.SolidBox(lower=(-0.01, -0.01, -0.01), upper=(0.29, 0.29, 0.29), density=900.0),
    rs.SolidBox(lower=(0.69, -0.01, -0.01), upper=(0.99, 0.15, 0.15), density=500.0),
)


def body_lattice(dim):
    """Two cells along each edge of the first body, two in a row for the second; x lowest, then y, then z."""
    first = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    cells = np.array([*first, (5, 0, 0), (6, 0, 0)])
    ascending_in_bodies = lambda key, lattice: (np.diff(key[:8]) > 0).all() and key[8] < key[9]  # noqa: E731
    bodies = {"body": [0] * 8 + [1] * 2, "first": [0, 8, 10], "dim": 3}
    return {"lattice": {"cell": cells, "key": ascending_in_bodies, **bodies}}


def boxes(dim):
    return {"boxes": dict.fromkeys(("node", "cell", "origin", "side", "planes", "first", "second"), table)}


def advanced(dim, slope=0.0):
    """1/(delta0 d^dim) of the lattice; delta h_s c with h_s = h/2, the density's slope rho0 g/c^2 in walls, h/c."""
    return {
        "recount": {"rate": 0.4 * C / H, "whole": 1 / (rest_number_density(dim) * D**dim)},
        "diffusion": {"coefficient": 0.025 * H * C, "stretch": slope * RHO / C**2, "release": C / H},
        "lean": {"x": 0.3, "y": -9.7, "z": 0.0},
    }


def overlapping(dim):
    """Four crossings of the support radius by sound; overlaps push by 0.005 rho0 c^2, after h/c."""
    group = {"inverse_spacing": 1 / D, "inverse_volume": D**-dim, "stiffness": 0.005 * RHO * C**2, "delay": H / C}
    viscous = {"coefficient": along_centres(dim) * mass(dim) / RHO / D**dim}  # of volumes d^dim
    return {"delay": {"tau": 4 * H / C}, "overlapping": group, "central_viscosity": viscous}


def just(dim, **groups):
    return groups


SETUPS, BASES = (rows(__file__, name) for name in ("setups", "bases"))


@pytest.fixture(scope="module", autouse=True)
def beside_the_mesh(tmp_path_factory):
    """Work where the mesh of the setups is."""
    folder = tmp_path_factory.mktemp("meshes")
    trimesh.creation.box(BLOCK).export(folder / "block.obj")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        yield


def is_group(value):
    return isinstance(value, tuple) and hasattr(value, "_fields")


def handed_out(effects, dim, dtype="float64"):
    """Everything that the first effect gives to passes."""
    grid, others = Discretisation(dim, dtype, D, H, 100), {effect.name: effect for effect in effects}
    if "shape_matching" in others:
        grid = Discretisation(dim, dtype, D, H, 100, solids=voxelised(BODIES, grid))
    for effect in effects:
        effect.check(grid, others)
    return effects[0].shares(grid, others) | effects[0].prepare(grid, others)


@functools.cache
def given(name, dim, dtype="float64"):
    """What the setup of that name hands out; a mesh takes seconds."""
    return handed_out(effects_of(name, dim), dim, dtype)


def effects_of(name, dim):
    made = []
    for entry in SETUPS[name]["of"]:
        ((of, other),) = (entry if isinstance(entry, dict) else {entry: {}}).items()
        ((kind, usual),) = BASES.get(of, {of: {}}).items()
        cells = {"cell_size": CELLS[dim]} if of == "mpm" else {}
        made.append(msgspec.convert(usual | cells | other, EFFECTS[kind]))
    return made


def expected_of(name, dim):
    found = {}
    for function, given in SETUPS[name]["gives"].items():
        found |= globals()[function](dim, **given)
    return found


def setups():
    """Names and dimensions."""
    return [(name, dim) for name, setup in SETUPS.items() for dim in setup.get("dims", (2, 3))]


def wrong(got, expected):
    """Members of a group that are not as expected; a callable member asks (value, group)."""
    assert set(got._fields) == set(expected), type(got).__name__
    for name, value in expected.items():
        own = getattr(got, name)
        if callable(value):
            if not value(own, got):
                yield name
        elif not np.allclose(np.asarray(own, float), np.asarray(value, float), rtol=RTOL, atol=0):
            yield name


@pytest.mark.parametrize("name, dim", setups())
def test_every_member_is_the_papers(name, dim):
    got, expected = given(name, dim), expected_of(name, dim)
    groups = {key: value for key, value in got.items() if value is None or is_group(value) or key in expected}
    assert set(groups) == set(expected)
    bad = []
    for key, value in groups.items():
        if is_group(value) and expected[key] is not None:
            bad += [f"{key}.{member}" for member in wrong(value, expected[key])]
        elif callable(expected[key]):
            bad += [key] * (not expected[key](value))
        elif value is None or expected[key] is None or not np.array_equal(value, expected[key]):
            bad += [key] * (value is not expected[key])
    assert not bad


# Groups that no effect hands out, made by functions of the host
@pytest.mark.parametrize("dim", [2, 3])
def test_the_surface_of_material_points(dim):
    """Thesis, chapter 3: r = sqrt(dim) h, epsilon, omega, delta; lengths in cells. Thesis M1, M14, M31 as printed."""
    h = CELLS[dim]
    given = {"surface_tension": SIGMA, "offset": 0.4, "relaxation": 1.3, "iterations": 7, "inset": 0.2}
    expected = {
        "cell_size": h, "inverse_cell": 1 / h, "radius_squared": dim, "offset": 0.4, "relaxation": 1.3, "iterations": 7,
        "inset": math.sqrt(dim) - 0.2, "disk": 0.3, "tension": SIGMA,
    }  # fmt: skip
    assert not list(wrong(surface_term(Tension(disk_radius=0.3, **given), dim, "float64", h), expected))
    printed = surface_term(Tension(disk_radius=0.3, literal=("M1", "M14", "M31"), **given), dim, "float64", h)
    assert not list(wrong(printed, expected | {"tension": -SIGMA, "iterations": 0, "inset": 0.0}))


def test_the_band_and_the_relaxation():
    """Corner nodes of a block of 4^3 are 1.5 spacings from its middle along each axis; Omega = exp(-r^2/2 sigma^2)."""
    h, radius, width = 0.07, 0.05, 0.8 * 0.05
    half = {"spacing": h, "inverse_spacing": 1 / h, "band": 0.2, "half_diagonal": float(lengths(np.full(3, 1.5 * h)))}
    assert not list(wrong(band_grid(h, 0.2, "float64"), half))
    for printed in (False, True):
        expected = {
            "inverse_width": 1 / (2 * width**2), "cutoff_squared": (3 * width) ** 2, "step": 1.3 * radius,
            "longest": radius / 2, "tangential": not printed, "seed": 11,
        }  # fmt: skip
        assert not list(wrong(relaxation_step(radius, 1.3, 11, printed, "float64"), expected))


def test_a_periodic_box():
    expected = {"x": 0.7, "y": 0.0, "z": 1.9, "inverse_x": 1 / 0.7, "inverse_y": 0.0, "inverse_z": 1 / 1.9}
    assert not list(wrong(period_group((0.7, 0.0, 1.9), "float64"), expected))


def effects_with_groups():
    hooks = (Effect.prepare, Effect.shares)
    return {name for name, effect in EFFECTS.items() if (effect.prepare, effect.shares) != hooks}


def made_by_methods():
    """(effect, group's name, group) of effects without a setup here, whose `cases.py` says what their constants are."""
    cases.discover()
    listed = {effects_of(*setup)[0].name for setup in setups()}
    for name in (cases.EXAMPLES.keys() & effects_with_groups()) - listed:
        for key, group in handed_out(pairs.scene(name, name).effects, 2).items():
            if is_group(group):
                yield name, key, group


def test_constants_of_other_methods_are_those_of_their_cases():
    for name, key, group in made_by_methods():
        effect, _, constants = cases.EXAMPLES[name]
        for member, value in zip(group._fields, group):
            expected = constants.get(key, {}).get(member, getattr(effect, member, None))
            assert expected is not None, f"give example(..., {key}={{{member!r}: ...}}) in cases.py of {name}"
            assert math.isclose(value, expected, rel_tol=RTOL), f"{name}: {key}.{member}"


# None is missing
OF_NO_EFFECT = {"ArtificialViscosity", "LaminarViscosity"}
ELSEWHERE = {"SurfaceTerm", "Dice", "BandGrid", "Relaxation", "Period", "Contour"}  # above; a seed; a level of phi


def test_no_effect_and_no_group_is_missing():
    own = effects_with_groups()
    seen = {}
    for name, dim in setups():
        effect, *_ = effects_of(name, dim)
        for key, value in given(name, dim).items():
            seen.setdefault((effect.name, key), []).append(value)
        assert effect.name in own, name
    others = list(made_by_methods())
    assert {effect for effect, _ in seen} | {effect for effect, _, _ in others} >= own
    never = [key for key, values in seen.items() if all(value is None for value in values)]
    assert not never
    types = {type(value).__name__ for values in seen.values() for value in values if is_group(value)}
    types |= {type(group).__name__ for _, _, group in others}
    cases.discover()
    case = cases.CASES["cloud_3d"]()
    taken = {key: maker(case, case.grid("float64"))[key] for key, maker in cases.GROUPS.items()}
    flat = {type(v).__name__ for v in taken.values() if is_group(v) and not any(isinstance(p, np.ndarray) for p in v)}
    assert flat - types == (ELSEWHERE | OF_NO_EFFECT) & flat
    assert len(flat) > 30
