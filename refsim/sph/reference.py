"""NumPy oracle of weakly compressible SPH: all pairs, float64.

Each function returns {output: (value, scale)}; scale is the sum of the absolute terms behind the value.
Arrays: position, velocity (n, 3); mass, density, pressure (n,); SI units. With a `period` separations x_ij are those to
the nearest image. `rows` picks particles.
"""

import math

import numpy as np

from refsim.core.operation import SYMMETRY, Program, operations, without
from refsim.neighbours.reference import Sums, other_particles, pair_blocks, rows_of
from refsim.smoothing.reference import kernel_gradient, kernel_slope, kernel_value, viscosity_laplacian

operation = operations(paper="Jiang & Zhu 2023")
_WARMTH = "temperature temperature_range exchange_rate"
_CROWDING = "density rest_density density_bounds"


@operation(
    "summed density, J(7), J(8) and its first moment", outputs="number_density asymmetry density",
    optional="number_density asymmetry walls period",
    variants=("number_density asymmetry walls period", "period", "number_density asymmetry", "asymmetry period"),
    invariants=SYMMETRY, broken={2: "rotation"}, packed="density_pair",
)  # fmt: skip
def density(position, mass, walls, smoothing, fluid, period=None, rows=None):
    """Densities [kg/m^dim], number densities [1/m^dim] and asymmetries [m^(1 - dim)], self included.

    J(7) rho_i = sum_j m_j W_ij + sum_b rho0 V_b W_ib;  J(8) delta_i = sum_j W_ij + sum_b (rho0 V_b/m_i) W_ib;
    asymmetry: |sum_j W_ij x_ij + sum_b (rho0 V_b/m_i) W_ib x_ib|, the first moment of the sum J(8).
    """
    mass = np.asarray(mass, dtype=float)
    wanted = rows_of(mass, rows)
    rho, delta, reach = np.zeros(len(wanted)), np.zeros(len(wanted)), np.zeros(len(wanted))
    moment = np.zeros((len(wanted), 3))
    for place, separation, distance in pair_blocks(position, position, rows, period):
        w = kernel_value(distance, smoothing)
        rho[place] += w @ mass
        delta[place] += w.sum(1)
        moment[place] += (w[..., None] * separation).sum(1)
        reach[place] += (w * distance).sum(1)
    if walls is not None:
        for place, separation, distance in pair_blocks(position, walls.position, rows, period):
            filled = float(fluid.rest_density) * kernel_value(distance, smoothing) * np.asarray(walls.volume, float)
            rho[place] += filled.sum(1)
            share = filled / wanted[place, None]
            delta[place] += share.sum(1)
            moment[place] += (share[..., None] * separation).sum(1)
            reach[place] += (share * distance).sum(1)
    asymmetry = np.linalg.norm(moment, axis=1)
    return {"density": (rho, rho), "number_density": (delta, delta), "asymmetry": (asymmetry, reach)}


@operation(
    "continuity equation with diffusion and shifts",
    paper="Colagrossi & Landrini 2003; Molteni & Colagrossi 2009; Fourtakas et al. 2019; Sun et al. 2019",
    outputs="density_excess density",
    optional="walls wall_strain wall_motion diffusion lean period rest_density phase shift",
    variants=(
        "walls wall_strain wall_motion diffusion lean period rest_density phase shift",
        "walls wall_strain wall_motion period shift",
        "period wall_motion rest_density phase", "period shift", "walls wall_strain wall_motion rest_density phase",
    ),
    tolerance=12.0, reason="one rounding in each of distance, slope, volume, velocity difference, projection,"
    " quotients, product and sum", invariants=f"{SYMMETRY} galilean",
    broken={1: "rotation", 2: "rotation galilean", 3: "translation rotation galilean", 4: "rotation"},
    programs={
        "cuda:fused": Program(
            "kernels", "continuity_and_sums", packed="continuity_and_sums_pair", also=("sph.density",),
            names={
                "smoothing": "gradient_smoothing", "sph.density.smoothing": "smoothing",
                "sph.density.density": "summed_density",
            },
            variants=(
                "walls wall_strain wall_motion period rest_density phase shift", "diffusion lean period number_density",
            ),
        )
    },
    packed="continuity_pair",
)  # fmt: skip
def continuity(
    position, velocity, mass, rest_density, phase, advanced_excess, wall_strain, shift, walls, wall_motion, smoothing,
    fluid, diffusion, lean, period, timestep, rows=None,
):  # fmt: skip
    """Density [kg/m^dim] a step after rho0 + advanced_excess, and its excess over rho0.

    d rho_i/dt = rho_i sum_j V_j (v_i - v_j).grad W_ij + rho_i sum_b [V_b (v_i - v_b).grad W_ib + f s_b W_ib/V_i] + D_i;
    V_j = m_j/rho_j, s_b `wall_strain`, f from 0 at -sum V x.grad W/dim = 0.75 (liquid and walls) to 1 at 0.85;
    D_i = delta h_s c sum_j V_j psi_ij.grad W_ij, psi_ij = 2 (rho_j - rho_i - rho0 g.x_ji/c^2) x_ji/|x_ij|^2, g `lean`.
    Shifts s [m] of the step before add (-rho div s + div(rho s))/dt, over liquid and walls, whose s is 0:
    sum_j V_j (rho_i s_i - rho_i s_j + rho_j s_j + rho_i s_i).grad W_ij/dt.
    rho is at least 0.95 rho0: a liquid that is pulled further apart breaks.
    `timestep` [s] has the step's length second; v_b = 0, or that of `wall_motion` beyond its planes. Solids (`phase`
    not 0) keep their rest density and take no part in D_i.
    """
    rest, dt = fluid.rest_density if rest_density is None else rest_density, float(timestep[1])
    before = np.asarray(advanced_excess, dtype=float)
    rest = np.broadcast_to(np.asarray(rest, dtype=float), before.shape)
    liquid = np.ones(before.shape, bool) if phase is None else np.asarray(phase) == 0
    velocity = np.asarray(velocity, dtype=float)
    volume = np.asarray(mass, dtype=float) / (rest + before)
    spreading = volume * liquid
    total = rest + before
    e, v, rest, changing, own_volume = (rows_of(values, rows) for values in (before, velocity, rest, liquid, volume))
    strain, spread, around, given = (Sums(len(e)) for _ in range(4))
    move = np.zeros_like(velocity) if shift is None or dt == 0 else np.asarray(shift, dtype=float) / dt
    s = rows_of(move, rows)
    for place, separation, distance in pair_blocks(position, position, rows, period):
        apart = np.where(distance > 0, distance, 1.0)
        gradient = (kernel_slope(distance, smoothing) / apart)[..., None] * separation
        if shift is not None:
            ratio = (total[None, :] / (rest + e)[place, None])[..., None]
            carried = 2 * s[place, None, :] + (ratio - 1) * move[None, :, :]
            most = 2 * np.abs(s)[place, None, :] + (ratio + 1) * np.abs(move)[None, :, :]
            sized = volume[None, :] * (np.abs(gradient) * most).sum(-1)
            strain.add(place, volume[None, :] * (gradient * carried).sum(-1), sized)
        parting = v[place, None, :] - velocity[None, :, :]
        size = volume[None, :] * (np.abs(gradient) * (np.abs(v)[place, None, :] + np.abs(velocity)[None, :, :])).sum(-1)
        strain.add(place, volume[None, :] * (gradient * parting).sum(-1), size)
        around.add(place, -volume[None, :] * distance * kernel_slope(distance, smoothing))
        if diffusion is not None:
            slope = float(diffusion.stretch) * np.array([float(part) for part in lean])
            difference = before[None, :] - e[place, None] + separation @ slope
            most = np.abs(before)[None, :] + np.abs(e)[place, None] + np.abs(separation) @ np.abs(slope)
            psi = -2 * separation / (apart**2)[..., None]
            factor = float(diffusion.coefficient) * spreading[None, :] * (psi * gradient).sum(-1)
            spread.add(place, factor * difference, np.abs(factor) * most)
    if walls is not None:
        x, wall_volume = np.asarray(walls.position, dtype=float), np.asarray(walls.volume, dtype=float)
        wall_velocity = np.zeros((len(wall_volume), 3))
        if wall_motion is not None:
            lower, upper, moving = (np.asarray(part, dtype=float) for part in wall_motion)
            wall_velocity[((x < lower) | (x > upper)).any(1)] = moving
        for place, separation, distance in pair_blocks(position, x, rows, period):
            gradient = kernel_gradient(separation, distance, smoothing)
            parting = (v + 2 * s)[place, None, :] - wall_velocity[None, :, :]
            most = (np.abs(v) + 2 * np.abs(s))[place, None, :] + np.abs(wall_velocity)[None, :, :]
            sized = wall_volume[None, :] * (np.abs(gradient) * most).sum(-1)
            strain.add(place, wall_volume[None, :] * (gradient * parting).sum(-1), sized)
            around.add(place, -wall_volume[None, :] * distance * kernel_slope(distance, smoothing))
            if wall_strain is not None:
                given.add(place, kernel_value(distance, smoothing) * np.asarray(wall_strain)[None, :])
        share = np.clip((around.value / int(smoothing.dim) - 0.75) / 0.1, 0, 1)
        strain.value += share * given.value / own_volume
        strain.scale += (share + 10 * around.scale) * given.scale / own_volume  # 10 is the slope of f
    excess = changing * np.maximum(e + dt * ((rest + e) * strain.value + spread.value), -0.05 * rest)
    size = np.abs(e) + dt * ((rest + np.abs(e)) * strain.scale + spread.scale)
    return {"density_excess": (excess, size), "density": (rest + excess, rest + size)}


@operation(
    "rho of the step before, restored", paper="Colagrossi & Landrini 2003", outputs="advanced_excess",
    optional="number_density phase restoring",
    variants=("number_density phase restoring", "number_density restoring", ""), tolerance=8.0,
    reason="one rounding in each of the number density's share, its slope of 10, differences and products",
    invariants="reordering",
)  # fmt: skip
def keep_density(density_excess, number_density, phase, fluid, restoring, timestep, rows=None):
    """advanced_excess = e = rho - rho0 [kg/m^dim] when the next step begins.

    With `restoring` e + rate dt f (rho0 (delta/delta0 - 1) - e), delta the number density J(8); f grows from 0 at
    (delta - W(0))/(delta0 - W(0)) = 0.75 to 1 at 0.85. Solids (`phase` not 0) keep theirs.
    """
    e = rows_of(density_excess, rows)
    if restoring is None:
        return {"advanced_excess": (e, np.abs(e))}
    rate, own, inverse, volume = (float(part) for part in restoring)
    n = rows_of(number_density, rows)
    rest = float(fluid.rest_density)
    liquid = np.ones(e.shape) if phase is None else rows_of(phase, rows) == 0
    around = (n - own) * inverse
    inside = liquid * np.clip(10 * around - 7.5, 0, 1)
    step = rate * float(timestep[1])
    lacking = rest * (n * volume - 1) - e
    size = np.abs(e) + step * liquid * ((n * volume + 1) * rest + np.abs(e)) * (1 + 10 * (n + own) * inverse)
    return {"advanced_excess": (e + step * inside * lacking, size)}


@operation(
    "J(9)", paper="Jiang & Zhu 2023; Tait", outputs="pressure",
    reason="one rounding for each factor of the power, counted in the scale by the exponent", invariants="reordering",
)  # fmt: skip
def state(density, fluid, rows=None):
    """Pressure [Pa] from density [kg/m^dim]: J(9) p = c^2 (rho - rho0), or Tait with exponent g.

    P_int (rho/rho0)^2, which balances the cohesion of the bulk, is added; negative values then become 0 if `clamp`.
    """
    ratio = rows_of(density, rows) / float(fluid.rest_density)
    power = np.power(ratio, int(fluid.exponent))
    cohesion = float(fluid.internal_pressure) * ratio**2
    pressure = float(fluid.stiffness) * (power - 1) + cohesion
    if fluid.clamp:
        pressure = np.maximum(pressure, 0)
    return {"pressure": (pressure, float(fluid.stiffness) * int(fluid.exponent) * (power + 1) + cohesion)}


@operation(
    "J(10), J(11) with Jiang & Zhu E3", adds="acceleration", optional="walls viscosity period",
    variants=("walls viscosity period", "period", "", "walls period"), tolerance=8.0,
    invariants=f"{SYMMETRY} linear_momentum galilean dissipation", broken={0: "dissipation", 2: "rotation"},
    packed="momentum_pair",
)  # fmt: skip
@operation(
    "J(10), averaged pressure force (p_i + p_j)/(rho_i rho_j)", "sph.pressure", adds="acceleration",
    optional="walls viscosity period", variants=("viscosity walls period", "viscosity", "viscosity period"),
    tolerance=8.0, invariants=f"{SYMMETRY} linear_momentum angular_momentum", broken={1: "rotation angular_momentum"},
    packed="momentum_pair",
)  # fmt: skip
def momentum(position, velocity, mass, density, pressure, walls, smoothing, fluid, viscosity, period=None, rows=None):
    """Acceleration [m/s^2] by pressure and viscosity.

    J(10) a_i = -(s/rho_i) sum_j m_j (p_i + p_j)/rho_j grad W_ij, s = 1 (Jiang & Zhu E24) or as printed 1/2;
    J(11) a_i += (mu/rho_i) sum_j (m_j/rho_j) (v_j - v_i) lap W_ij (sign of Jiang & Zhu E3);
    Akinci 2012 walls: a_i -= k s sum_b rho0 V_b p_i/rho_i^2 grad W_ib, k = 2 for p_b = p_i.
    """
    velocity = np.asarray(velocity, dtype=float)
    volume = np.asarray(mass, dtype=float) / np.asarray(density, dtype=float)
    p = np.asarray(pressure, dtype=float)
    rho_i, p_i, v_i = rows_of(density, rows), rows_of(pressure, rows), rows_of(velocity, rows)
    sums = Sums(len(rho_i), 3)
    share = float(fluid.gradient_share)
    for place, separation, distance in pair_blocks(position, position, rows, period):
        gradient = kernel_gradient(separation, distance, smoothing)
        both = share * (p_i[place, None] + p[None, :])
        sums.add(place, -(volume[None, :] * both / rho_i[place, None])[..., None] * gradient)
        if viscosity is not None:
            factor = volume[None, :] * viscosity_laplacian(distance, smoothing) / rho_i[place, None]
            factor = factor * other_particles(place, len(velocity), rows) * float(viscosity.coefficient)
            sums.add(place, factor[..., None] * (velocity[None, :, :] - v_i[place, None, :]))
    if walls is not None:
        wall_mass = float(fluid.rest_density) * np.asarray(walls.volume, dtype=float)
        for place, separation, distance in pair_blocks(position, walls.position, rows, period):
            gradient = kernel_gradient(separation, distance, smoothing)
            factor = float(fluid.wall_share) * share * wall_mass[None, :] * (p_i / rho_i**2)[place, None]
            sums.add(place, -factor[..., None] * gradient)
    return {"acceleration": sums.total()}


def symmetric(diagonal, mixed):
    """Matrices (n, 3, 3) from their diagonals (xx, yy, zz) and the rest (xy, xz, yz), (n, 3) each."""
    diagonal, mixed = np.asarray(diagonal, dtype=float), np.asarray(mixed, dtype=float)
    found = np.zeros((len(diagonal), 3, 3))
    for k, (a, b) in enumerate(((0, 1), (0, 2), (1, 2))):
        found[:, k, k] = diagonal[:, k]
        found[:, a, b] = found[:, b, a] = mixed[:, k]
    return found


@operation(
    "renormalised gradient", paper="Bonet & Lok 1999", outputs="correction_diagonal correction_mixed",
    optional="walls period", variants=("walls period", "period", ""),
    tolerance=16.0, invariants="translation reordering", packed="filling_pair",
    reason="one rounding in each of distance, slope, volume and products, and those of the determinant and its minors",
)  # fmt: skip
def gradient_correction(position, mass, density, walls, smoothing, period=None, rows=None):
    """B_i = I + s (M_i^-1 - I), M_i = -sum_j V_j x_ij grad W_ij - sum_b V_b x_ib grad W_ib: diagonal, (xy, xz, yz).

    s = (det M_i - 0.5)/0.3, at least 0 and at most 1. In 2D M_zz = 1. Dimensionless.
    """
    volume = np.asarray(mass, dtype=float) / np.asarray(density, dtype=float)
    sums = Sums(len(volume) if rows is None else len(rows), 3, 3)

    def add(places, volumes):
        for place, separation, distance in pair_blocks(position, places, rows, period):
            steep = -volumes[None, :] * kernel_slope(distance, smoothing) / np.where(distance > 0, distance, 1.0)
            sums.add(place, steep[..., None, None] * separation[..., :, None] * separation[..., None, :])

    add(position, volume)
    if walls is not None:
        add(walls.position, np.asarray(walls.volume, dtype=float))
    filled, size = sums.value, sums.scale
    if int(smoothing.dim) == 2:
        filled[:, 2, 2] = 1.0
    determinant = np.linalg.det(filled)
    share = np.clip((determinant - 0.5) / 0.3, 0, 1)
    whole = share > 0
    inverse = np.linalg.inv(np.where(whole[:, None, None], filled, np.eye(3)))
    matrix = np.eye(3) + share[:, None, None] * (inverse - np.eye(3))
    a, b, c = (np.roll(size, -k, axis=2) for k in range(3))  # the determinant's terms without their signs
    terms = sum(a[:, 0, k] * (b[:, 1, k] * c[:, 2, k] + c[:, 1, k] * b[:, 2, k]) for k in range(3))
    size = np.abs(inverse) @ size @ np.abs(inverse) + (terms / 0.3)[:, None, None] * (np.abs(inverse) + np.eye(3))
    scale = np.where(whole[:, None, None], np.abs(matrix) + size, np.eye(3) + terms[:, None, None])
    pick = ((0, 1, 2), (0, 1, 2)), ((0, 0, 1), (1, 2, 2))
    return {
        name: (matrix[:, *at], scale[:, *at]) for name, at in zip(("correction_diagonal", "correction_mixed"), pick)
    }


@operation("p_j - p_i where p_i < 0", paper="Sun et al. 2018", outputs="own_pressure", optional="near_surface",
    invariants="reordering",
)  # fmt: skip
def own_pressure(pressure, near_surface, rows=None):
    """Pressure of a particle in its own force [Pa]: q = -p where p < 0 and `near_surface` is 0, else p."""
    p = rows_of(pressure, rows)
    inside = np.ones(len(p), bool) if near_surface is None else rows_of(near_surface, rows) == 0
    return {"own_pressure": (np.where(inside, np.abs(p), p), np.abs(p))}


@operation(
    "J(10) with renormalised gradients", paper="Jiang & Zhu 2023; Bonet & Lok 1999; Sun et al. 2018",
    adds="acceleration", optional="correction_diagonal correction_mixed period", tolerance=12.0,
    reason="one rounding in each of distance, slope, volume, pressures, two products with a matrix, mean and sum",
    variants=("correction_diagonal correction_mixed period", "period", ""), invariants=SYMMETRY,
    broken={1: "rotation", 2: "rotation"}, packed="corrected_pressure_pair",
)  # fmt: skip
def corrected_pressure(
    position, mass, density, pressure, own_pressure, correction_diagonal, correction_mixed, smoothing, fluid,
    period=None, rows=None,
):  # fmt: skip
    """Acceleration [m/s^2] a_i = -(s/rho_i) sum_j V_j (q_i + p_j) (B_i + B_j)/2 grad W_ij, q the own pressure.

    B = I without a correction, which has its diagonal (xx, yy, zz) and the rest (xy, xz, yz); s of J(10).
    """
    volume = np.asarray(mass, dtype=float) / np.asarray(density, dtype=float)
    rho_i, own, p = rows_of(density, rows), rows_of(own_pressure, rows), np.asarray(pressure, dtype=float)
    matrix = np.broadcast_to(np.eye(3), (len(p), 3, 3))
    if correction_diagonal is not None:
        matrix = symmetric(correction_diagonal, correction_mixed)
    matrix_i = rows_of(matrix, rows)
    sums = Sums(len(rho_i), 3)
    for place, separation, distance in pair_blocks(position, position, rows, period):
        gradient = kernel_gradient(separation, distance, smoothing)
        mean = 0.5 * (matrix_i[place, None] + matrix[None, :])
        factor = float(fluid.gradient_share) * volume[None, :] / rho_i[place, None]
        force = -factor * (own[place, None] + p[None, :])
        size = factor * (np.abs(own)[place, None] + np.abs(p)[None, :])
        sums.add(
            place, force[..., None] * np.einsum("nmab,nmb->nma", mean, gradient),
            size[..., None] * np.einsum("nmab,nmb->nma", np.abs(mean), np.abs(gradient)),
        )  # fmt: skip
    return {"acceleration": sums.total()}


@operation(
    "J(11) with Jiang & Zhu E3, viscosity by a Laplacian", "sph.viscosity", adds="acceleration", optional="period",
    tolerance=8.0, invariants=f"{SYMMETRY} linear_momentum galilean dissipation", broken={1: "rotation"},
    packed="viscous_pair",
)  # fmt: skip
def viscous(position, velocity, mass, density, smoothing, viscosity, period=None, rows=None):
    """Acceleration [m/s^2] a_i = (mu/rho_i) sum_j (m_j/rho_j) (v_j - v_i) lap W_ij, J(11) with Jiang & Zhu E3."""
    v = np.asarray(velocity, dtype=float)
    volume = np.asarray(mass, dtype=float) / np.asarray(density, dtype=float)
    rho_i, v_i = rows_of(density, rows), rows_of(velocity, rows)
    sums = Sums(len(rho_i), 3)
    for place, _, distance in pair_blocks(position, position, rows, period):
        factor = volume[None, :] * viscosity_laplacian(distance, smoothing) / rho_i[place, None]
        factor = factor * other_particles(place, len(v), rows) * float(viscosity.coefficient)
        sums.add(place, factor[..., None] * (v[None, :, :] - v_i[place, None, :]))
    return {"acceleration": sums.total()}


@operation(
    "momentum equation with zeta = 5 eta/3, viscous part", "sph.central_viscosity", paper="Espanol & Revenga 2003",
    adds="acceleration", optional="period", tolerance=12.0,
    reason="one rounding in each of squared distance (twice), Laplacian, volume, velocity difference, projection,"
    " quotient, product and sum", invariants=f"{SYMMETRY} linear_momentum angular_momentum galilean dissipation",
    broken={1: "rotation angular_momentum"},
    packed="central_pair",
)  # fmt: skip
def central_viscous(position, velocity, mass, density, smoothing, central_viscosity, period=None, rows=None):
    """Acceleration [m/s^2] a_i = (2 k/rho_i) sum_j (m_j/rho_j) F_ij e_ij e_ij.(v_j - v_i), k = (dim + 2) mu.

    Espanol & Revenga 2003 with zeta = 5 eta/3 in 3D, where only the part along e_ij is left. F = -W'/r =
    6 A (1 - r/h)/h^2 is that of W = A (1 - r/h)^2 (1 + 2 r/h), whose integral is one: A = 10/(3 pi h^2) in 2D and
    15/(4 pi h^3) in 3D.
    """
    h, dim = float(smoothing.support_radius), int(smoothing.dim)
    amplitude = 10 / (3 * np.pi * h**2) if dim == 2 else 15 / (4 * np.pi * h**3)
    v = np.asarray(velocity, dtype=float)
    volume = np.asarray(mass, dtype=float) / np.asarray(density, dtype=float)
    rho_i, v_i = rows_of(density, rows), rows_of(velocity, rows)
    sums = Sums(len(rho_i), 3)
    for place, separation, distance in pair_blocks(position, position, rows, period):
        steepness = np.where(distance < h, 6 * amplitude * (1 - distance / h) / h**2, 0.0)
        factor = 2 * float(central_viscosity.coefficient) * volume[None, :] * steepness / rho_i[place, None]
        factor = factor * other_particles(place, len(v), rows)
        unit = separation / np.where(distance > 0, distance, 1.0)[..., None]
        parts = unit * (v[None, :, :] - v_i[place, None, :])
        size = np.abs(factor * np.abs(parts).sum(-1))[..., None] * np.abs(unit)
        sums.add(place, (factor * parts.sum(-1))[..., None] * unit, size)
    return {"acceleration": sums.total()}


@operation(
    "J(10), momentum equation with zeta = 5 eta/3", paper="Jiang & Zhu 2023; Espanol & Revenga 2003",
    adds="acceleration", optional="period", tolerance=12.0, reason="those of sph.central_viscosity",
    invariants=f"{SYMMETRY} linear_momentum angular_momentum galilean", broken={1: "rotation angular_momentum"},
    packed="central_momentum_pair",
)  # fmt: skip
def central_momentum(
    position, velocity, mass, density, pressure, smoothing, fluid, central_viscosity, period=None, rows=None
):
    """Acceleration [m/s^2] by J(10) and the viscosity along the line of centres, without walls."""
    places = position, velocity, mass, density
    push = momentum(*places, pressure, None, smoothing, fluid, None, period, rows)["acceleration"]
    drag = central_viscous(*places, smoothing, central_viscosity, period, rows)["acceleration"]
    return {"acceleration": (push[0] + drag[0], push[1] + drag[1])}


@operation("J(6), g", paper="standard", adds="acceleration", invariants="reordering")
def gravity(field, rows=None):
    """Uniform acceleration a_i = g [m/s^2], g of J(6); one row for all particles."""
    field = np.asarray(field, dtype=float)[None, :]
    return {"acceleration": (field, np.abs(field))}


@operation(
    "max |v|^2, max |a|^2, max s/dt, max (T - range), number of rho > b rho0", paper="standard", outputs="extremes",
    optional=f"{_WARMTH} {_CROWDING}",
    variants=(
        f"{_WARMTH} {_CROWDING}", f"temperature_range exchange_rate {_CROWDING}", f"{_WARMTH} rest_density",
        "exchange_rate", "",
    ),
)  # fmt: skip
def extremes(
    velocity, acceleration, temperature, temperature_range, exchange_rate, density, rest_density, density_bounds
):
    """E = (max |v|^2 [m^2/s^2], max |a|^2 [m^2/s^4], number of particles with a value that is not finite,
    max rate [1/s], largest excess of a temperature over its range [K], number of particles with rho > a rho0, with
    rho > b rho0), a and b of `density_bounds`, rho0 of the particle or else of the liquid.
    """
    speed = (np.asarray(velocity, dtype=float) ** 2).sum(1)
    force = (np.asarray(acceleration, dtype=float) ** 2).sum(1)
    broken = ~(np.isfinite(speed) & np.isfinite(force))
    if temperature is not None:
        broken |= ~np.isfinite(np.asarray(temperature, dtype=float))
    rate, excess, size = 0.0, 0.0, 0.0
    if exchange_rate is not None:
        rates = np.asarray(exchange_rate, dtype=float)
        broken |= ~np.isfinite(rates)
        rate = np.nanmax(rates, initial=0)
    if temperature_range is not None:
        t = np.asarray(temperature, dtype=float)
        low, high = (float(v) for v in temperature_range)
        excess = np.nanmax(np.where(t > high, t - high, np.where(t < low, low - t, 0.0)), initial=0)
        size = excess + abs(low) + abs(high)
    counts = [0, 0]
    if density_bounds is not None:
        rest = density_bounds.rest_density if rest_density is None else rest_density
        bounds = (np.asarray(rest) * times for times in (density_bounds.dense, density_bounds.crushed))  # in the dtype
        counts = [int((np.asarray(density) > bound).sum()) for bound in bounds]
    value = np.array([speed.max(initial=0), force.max(initial=0), broken.sum(), rate, excess, *counts], dtype=float)
    return {"extremes": (value, np.array([*value[:4], size, *counts]))}


def carried(position, residual, shift, size):
    """x + residual + shift [m], and what its rounding to the type of x leaves: ((sum, scale), (rest, scale)).

    size: scale of `shift`. The rest is summed exactly (math.fsum). Where it is within the rounding of `shift` from half
    of the distance to the next number, the sum may be rounded to that one: there its scale is that of x.
    """
    x, r = np.asarray(position, dtype=float), np.asarray(residual, dtype=float)
    kind = np.asarray(position).dtype
    added, small = r + shift, np.abs(r) + size
    place = (x + added).astype(kind).astype(float)
    known, rest = np.isfinite(place), np.full(x.shape, np.nan)
    rest[known] = [math.fsum(parts) for parts in zip(x[known], added[known], -place[known])]
    gap = np.abs(place - np.nextafter(place.astype(kind), kind.type(0)).astype(float))  # towards 0, the smaller one
    close = np.abs(rest) > 0.5 * gap - 32 * np.finfo(kind).eps * small
    return (x + added, np.abs(x) + small), (rest, small + np.where(close, 2 * np.abs(place), 0.0))


def at_planes(bounds, x, v, rest):
    """(x [m], v [m/s], residual or None, flags of those that are stopped) of particles at the walls' planes."""
    if bounds is None:
        return x, v, rest, np.zeros(len(x), dtype=bool)
    lower, upper = np.asarray(bounds.lower, dtype=float), np.asarray(bounds.upper, dtype=float)
    beyond = (x < lower) | (x > upper)
    rest = None if rest is None else tuple(np.where(beyond, 0.0, part) for part in rest)
    return np.clip(x, lower, upper), np.where(beyond, 0.0, v), rest, beyond.any(1)


@operation(
    "leap-frog with a changing step", paper="standard", outputs="position_residual velocity position displacement",
    optional="bounds position_residual shift",
    variants=(
        "bounds position_residual shift", "position_residual shift",
        without("bounds shift", timestep="short_steps"), "shift", "",
    ),
    reason="one rounding in each product and sum", invariants="reordering", cases="slow_and_far",
)  # fmt: skip
def kick_drift(acceleration, build_position, bounds, timestep, shift, position_residual, velocity, position):
    """Leap-frog: v += (dt_previous + dt)/2 a [m/s], x += dt v + shift [m], stopped at the walls' planes `bounds` [m].

    With a residual, x + residual is advanced, and the rest of its rounding is the new one; 0 at a plane.
    displacement: [largest squared displacement since the list was built [m^2], number of stopped particles].
    """
    kick, drift = (float(t) for t in timestep)
    a = np.asarray(acceleration, dtype=float)
    old_v, old_x = np.asarray(velocity, dtype=float), np.asarray(position, dtype=float)
    v = old_v + kick * a
    v_scale = np.abs(old_v) + np.abs(kick * a)
    extra = np.zeros_like(v) if shift is None else np.asarray(shift, dtype=float)
    change, size = drift * v + extra, np.abs(drift) * v_scale + np.abs(extra)
    x, x_scale = old_x + change, np.abs(old_x) + size
    answer, rest = {}, None
    if position_residual is not None:
        (x, x_scale), rest = carried(position, position_residual, change, size)
    x, v, rest, stopped = at_planes(bounds, x, v, rest)
    if rest is not None:
        answer["position_residual"] = rest
    moved = x - np.asarray(build_position, dtype=float)
    squared = (moved**2).sum(1)
    bound = ((np.abs(moved) + x_scale) ** 2).sum(1)
    return answer | {
        "velocity": (v, v_scale),
        "position": (x, x_scale),
        "displacement": (np.array([squared.max(initial=0), stopped.sum()]), np.array([bound.max(initial=0), 0.0])),
    }
