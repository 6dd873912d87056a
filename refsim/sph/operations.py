"""Operations of weakly compressible SPH: which equations make each, its kernels, variants, tolerance and why."""

import math

import numpy as np

from refsim.core.operation import SYMMETRY, Program, operations, without
from refsim.core.terms import Terms, length, maximum, where
from refsim.motion.operations import felt
from refsim.neighbours.sums import Fields, neighbours, wall_particles
from refsim.sph import reference as ref

operation = operations(paper="Jiang & Zhu 2023")
SHIFT = "way longest_shift drawn_body"
_PRESSURES = (
    "one rounding in each of distance, kernel, product and sum, and a few in the kernel's polynomial; the size counts"
    " |p_i| and |p_j|, not |p_i + p_j|"
)
_WARMTH = "temperature temperature_range exchange_rate"
_CROWDING = "density rest_density density_bounds"


def fused_with_momentum(*variants, own_smoothing=False):
    """Programs of a tension that one loop sums with `sph.momentum`, or with `sph.central_momentum`, which has no walls.

    variants       of the former, each the names that it leaves out, or those and what it overrides
    own_smoothing  whether the tension's `smoothing` is another than theirs
    """
    walled = tuple(without(variant) if isinstance(variant, str) else variant for variant in variants)
    plain, *more = ({name: value for name, value in variant.items() if name != "walls"} for variant in walled)
    wall_less = plain, *(variant | without("central_viscosity velocity") for variant in more)
    programs = {}
    for name, part, tried in (("fused", "momentum", walled), ("central", "central_momentum", wall_less)):
        names = {f"sph.{part}.smoothing" if own_smoothing else "smoothing": "gradient_smoothing", "volume": "mass"}
        of = {"function": f"tension_and_{part}", "also": (f"sph.{part}",), "names": names, "variants": tried}
        programs[f"cpu:{name}"] = Program("kernels", **of)
        programs[f"cuda:{name}"] = Program("kernels", **of, packed=f"tension_and_{part}_pair")
    return programs


def volume_of(volume, density):
    """V [m^dim]: `volume` itself, or where a density is given m/rho of the mass that it is then."""
    volume = np.asarray(volume, dtype=float)
    return volume if density is None else volume / np.asarray(density, dtype=float)


def moving(walls, wall_motion):
    """Velocities [m/s] of wall particles: 0, or that of `wall_motion` beyond its planes; None without walls."""
    if walls is None:
        return None
    x = np.asarray(walls.position, dtype=float)
    if wall_motion is None:
        return np.zeros(x.shape)
    lower, upper, velocity = (np.asarray(part, dtype=float) for part in wall_motion)
    return np.where(((x < lower) | (x > upper)).any(1)[:, None], velocity, 0.0)


def symmetric(diagonal, mixed):
    """Matrices (n, 3, 3) from their diagonals (xx, yy, zz) and the rest (xy, xz, yz), (n, 3) each."""
    entries = np.concatenate([np.asarray(diagonal, dtype=float), np.asarray(mixed, dtype=float)], axis=1)
    return entries[:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]


@operation(
    "summed density, J(7), J(8) and its first moment", outputs="number_density asymmetry density",
    variants=("number_density asymmetry walls period", "period", "number_density asymmetry", "asymmetry period"),
    invariants=SYMMETRY, broken={2: "rotation"}, packed="density_pair",
)  # fmt: skip
def density(position, mass, walls, smoothing, fluid, period=None, rows=None):
    """Densities J(7) [kg/m^dim], number densities J(8) [1/m^dim], asymmetries [m^(1 - dim)] of liquid and walls."""
    i, b = Fields(position=position, mass=mass), wall_particles(walls, fluid)
    around, at_walls = (neighbours(i, j, smoothing, period=period, rows=rows) for j in (i, b))
    return {
        "density": around(ref.summed_density) + at_walls(ref.summed_density),
        "number_density": around(ref.number_density) + at_walls(ref.number_density_at_walls),
        "asymmetry": length(around(ref.first_moment) + at_walls(ref.first_moment_at_walls)),
    }


@operation(
    "continuity equation with diffusion, shifts and return to the counted density",
    paper="Colagrossi & Landrini 2003; Molteni & Colagrossi 2009; Fourtakas et al. 2019; Sun et al. 2019",
    outputs="acceleration filling pressure density_excess density",
    variants=(
        "walls wall_strain wall_normal central_viscosity acceleration diffusion turning borne period rest_density phase"
        " shift recount filling pressure",
        "walls wall_strain wall_normal period shift turning",
        "period rest_density phase central_viscosity turning", "period shift filling pressure",
        "period shift filling borne turning",
        "walls wall_strain wall_normal rest_density phase recount filling turning",
    ),
    tolerance=12.0, reason="one rounding in each of distance, slope, volume, velocity difference, projection,"
    " quotients, product and sum",
    invariants=f"{SYMMETRY} linear_momentum angular_momentum galilean",
    broken={
        0: "linear_momentum angular_momentum", 1: "rotation", 2: "rotation galilean",
        3: "translation rotation galilean", 4: "translation rotation galilean", 5: "rotation angular_momentum",
    },
    programs={
        "cuda:fused": Program(
            "kernels", "continuity_and_sums", packed="continuity_and_sums_pair", also=("sph.density",),
            names={
                "smoothing": "gradient_smoothing", "sph.density.smoothing": "smoothing",
                "sph.density.density": "summed_density",
            },
            variants=(
                "walls wall_strain wall_normal period rest_density phase shift central_viscosity",
                "diffusion turning borne period number_density recount filling",
            ),
        )
    },
    packed="continuity_pair",
)  # fmt: skip
def continuity(
    position, velocity, volume, rest_density, phase, advanced_excess, borne, wall_strain, shift, walls, wall_normal,
    smoothing, fluid, central_viscosity, diffusion, lean, turning, recount, period, timestep, rows=None,
):  # fmt: skip
    """Density [kg/m^dim] a step after rho0 + advanced_excess, its excess over rho0, and the filling [-], 1 in solids.
    The viscosity [m/s^2] and all sums are over the volumes before the step.

    `timestep` [s] has the step's length second. Walls move along themselves alone, which is no strain. Solids (`phase`
    not 0) keep their rest density and take no part in the diffusion.
    """
    dt = float(timestep[1])
    rest = np.asarray(fluid.rest_density if rest_density is None else rest_density, dtype=float)
    density = rest + np.asarray(advanced_excess, dtype=float)
    i = Fields(
        position=position, velocity=velocity, volume=volume, excess=advanced_excess, density=density, rest=rest,
        mass=density * np.asarray(volume, dtype=float),
        liquid=1.0 if phase is None else np.asarray(phase) == 0,
        borne=0.0 if borne is None else borne,
        felt=felt(Fields(position=position, velocity=np.zeros_like(position)), lean, turning),
        shift=None if shift is None or dt == 0 else np.asarray(shift, dtype=float) / dt,
    )  # fmt: skip
    b = wall_particles(walls, velocity=moving(walls, None), strain=wall_strain, normal=wall_normal)
    around, at_walls = (neighbours(i, j, smoothing, period=period, rows=rows) for j in (i, b))
    here, spread, released = around.i, 0.0, 0.0
    strain = around(ref.strain) + at_walls(ref.strain if wall_normal is None else ref.strain_across)
    if shift is not None and dt != 0:
        strain += around(ref.transport) + at_walls(ref.transport_at_walls)
    held = (around(ref.filling_of_solids) + at_walls(ref.filling)) / int(smoothing.dim)
    liquid, share = around(ref.filling_of_liquid) / int(smoothing.dim), 1.0
    filled = ref.of_what_is_left(liquid, held)
    if walls is not None and wall_strain is not None:
        strain += ref.interior(filled) * at_walls(ref.handed_on) / here.volume
    if recount is not None:
        share = (around(ref.told_volume) + at_walls(ref.told_volume)) * float(recount.whole)
        strain += ref.returned(filled, share, float(recount.rate))
    if diffusion is not None:
        spread = around(ref.diffusion, delta_h_c=diffusion.coefficient, stretch=float(diffusion.stretch))
        released = float(diffusion.release) * ref.lone(liquid + held)
    excess = ref.advanced(here, strain, spread, released, dt)
    k = 0.0 if central_viscosity is None else float(central_viscosity.coefficient)
    return {
        "acceleration": around.others(ref.central_viscous_force, k=k), "filling": where(here.liquid, share, 1.0),
        "density_excess": excess, "density": here.rest + excess, **state(here.rest + excess, fluid),
    }  # fmt: skip


@operation(
    "V = m/rho", "sph.volume", paper="standard", outputs="volume", variants=("rest_density", ""),
    reason="one rounding in each of sum and quotient", invariants="reordering",
)  # fmt: skip
def volume_before(mass, rest_density, advanced_excess, fluid, rows=None):
    """Volumes [m^dim] with the densities of the step before."""
    rest = fluid.rest_density if rest_density is None else rest_density
    i = Fields(mass=mass, excess=advanced_excess, rest=rest).at(rows)
    return {"volume": i.mass / (i.rest + i.excess)}


@operation(
    "rho of the step before, and what is borne of the weight", paper="standard", outputs="borne advanced_excess",
    variants=("acceleration lean turning borne", "turning", ""), tolerance=8.0,
    reason="one rounding in each product, sum and quotient, twice", invariants="reordering",
)  # fmt: skip
def keep_density(position, velocity, density_excess, acceleration, lean, turning, rows=None):
    """advanced_excess = rho - rho0 [kg/m^dim] when the next step begins, and b [-] of `borne_share`."""
    i = Fields(position=position, velocity=velocity, excess=density_excess, acceleration=acceleration).at(rows)
    kept = {"advanced_excess": i.excess}
    if lean is not None:
        kept["borne"] = ref.borne(i, felt(i, lean, turning))
    return kept


@operation(
    "J(9)", paper="Jiang & Zhu 2023; Tait", outputs="pressure",
    reason="one rounding for each factor of the power, counted in the scale by the exponent", invariants="reordering",
)  # fmt: skip
def state(density, fluid, rows=None):
    """Pressure [Pa] from density [kg/m^dim] by J(9) or Tait; what is negative then becomes 0 if `clamp`."""
    i, rest = Fields(density=density).at(rows), float(fluid.rest_density)
    p = ref.state(i, float(fluid.stiffness), rest, int(fluid.exponent))
    p += ref.internal_pressure(i, float(fluid.internal_pressure), rest)
    return {"pressure": maximum(p, 0) if fluid.clamp else p}


@operation(
    "J(10), J(11) with Jiang & Zhu E3", adds="acceleration",
    variants=("walls viscosity period", "period", "", "walls period"), tolerance=8.0, reason=_PRESSURES,
    invariants=f"{SYMMETRY} linear_momentum galilean dissipation", broken={0: "dissipation", 2: "rotation"},
    packed="momentum_pair",
)  # fmt: skip
@operation(
    "J(10), averaged pressure force (p_i + p_j)/(rho_i rho_j)", "sph.pressure", adds="acceleration",
    variants=("viscosity walls period", "viscosity", "viscosity period"), tolerance=8.0, reason=_PRESSURES,
    invariants=f"{SYMMETRY} linear_momentum angular_momentum", broken={1: "rotation angular_momentum"},
    packed="momentum_pair",
)  # fmt: skip
def momentum(position, velocity, mass, density, pressure, walls, smoothing, fluid, viscosity, period=None, rows=None):
    """Acceleration [m/s^2] by pressure, that of walls (Akinci et al. 2012) and viscosity."""
    i = Fields(position=position, velocity=velocity, mass=mass, density=density, pressure=pressure)
    b, s = wall_particles(walls, fluid), float(fluid.gradient_share)
    around, at_walls = (neighbours(i, j, smoothing, period=period, rows=rows) for j in (i, b))
    a = around(ref.pressure_force, s=s) + at_walls(ref.wall_pressure_force, s=s, k=fluid.wall_share)
    if viscosity is not None:
        a += around.others(ref.viscous_force, mu=viscosity.coefficient)
    return {"acceleration": a}


@operation(
    "renormalised gradient", paper="Bonet & Lok 1999", outputs="correction_diagonal correction_mixed",
    variants=("walls period", "period", ""), tolerance=16.0, invariants="translation reordering", packed="filling_pair",
    reason="one rounding in each of distance, slope, volume and products, and those of the determinant and its minors",
)  # fmt: skip
def gradient_correction(position, mass, density, walls, smoothing, period=None, rows=None):
    """Matrices B over liquid and walls, dimensionless: diagonal (xx, yy, zz) and the rest (xy, xz, yz)."""
    i = Fields(position=position, volume=np.asarray(mass, dtype=float) / np.asarray(density, dtype=float))
    around, at_walls = (neighbours(i, j, smoothing, period=period, rows=rows) for j in (i, wall_particles(walls)))
    m = around(ref.filled_matrix) + at_walls(ref.filled_matrix)
    if int(smoothing.dim) == 2:
        m.value[:, 2, 2] = 1.0
    b = ref.renormalised(m)
    at = {"correction_diagonal": ((0, 1, 2), (0, 1, 2)), "correction_mixed": ((0, 0, 1), (1, 2, 2))}
    return {name: (b.value[:, *entries], b.size[:, *entries]) for name, entries in at.items()}


@operation("p_j - p_i where p_i < 0", paper="Sun et al. 2018", outputs="own_pressure", optional="near_surface",
    invariants="reordering",
)  # fmt: skip
def own_pressure(pressure, near_surface, rows=None):
    """Pressure of a particle in its own force [Pa], its absolute value away from the surface."""
    flags = 0.0 if near_surface is None else near_surface
    return {"own_pressure": ref.own_pressure(Fields(pressure=pressure, near_surface=flags).at(rows))}


@operation(
    "J(10) with renormalised gradients", paper="Jiang & Zhu 2023; Bonet & Lok 1999; Sun et al. 2018",
    adds="acceleration", tolerance=12.0,
    reason="one rounding in each of distance, slope, volume, pressures, two products with a matrix, mean and sum",
    variants=("correction_diagonal correction_mixed period", "period", ""), invariants=SYMMETRY,
    broken={1: "rotation", 2: "rotation"}, packed="corrected_pressure_pair",
)  # fmt: skip
def corrected_pressure(
    position, mass, density, pressure, own_pressure, correction_diagonal, correction_mixed, smoothing, fluid,
    period=None, rows=None,
):  # fmt: skip
    """Acceleration [m/s^2] by pressure with renormalised gradients; without a correction B = I."""
    correction = np.broadcast_to(np.eye(3), (len(pressure), 3, 3))
    if correction_diagonal is not None:
        correction = symmetric(correction_diagonal, correction_mixed)
    i = Fields(
        position=position, mass=mass, density=density, pressure=pressure, own_pressure=own_pressure,
        correction=correction,
    )  # fmt: skip
    around = neighbours(i, i, smoothing, period=period, rows=rows)
    return {"acceleration": around(ref.corrected_pressure_force, s=fluid.gradient_share)}


@operation(
    "J(11) with Jiang & Zhu E3, viscosity by a Laplacian", "sph.viscosity", adds="acceleration", optional="period",
    tolerance=8.0, invariants=f"{SYMMETRY} linear_momentum galilean dissipation", broken={1: "rotation"},
    packed="viscous_pair",
)  # fmt: skip
def viscous(position, velocity, mass, density, smoothing, viscosity, period=None, rows=None):
    """Acceleration [m/s^2] by viscosity alone."""
    i = Fields(position=position, velocity=velocity, mass=mass, density=density)
    around = neighbours(i, i, smoothing, period=period, rows=rows)
    return {"acceleration": around.others(ref.viscous_force, mu=viscosity.coefficient)}


@operation(
    "momentum equation with zeta = 5 eta/3, viscous part", "sph.central_viscosity", paper="Espanol & Revenga 2003",
    adds="acceleration", optional="period", tolerance=12.0,
    reason="one rounding in each of squared distance (twice), Laplacian, volume, velocity difference, projection,"
    " quotient, product and sum; the size counts |v_i| and |v_j|",
    invariants=f"{SYMMETRY} linear_momentum angular_momentum galilean dissipation",
    broken={1: "rotation angular_momentum"},
    packed="central_pair",
)  # fmt: skip
def central_viscous(position, velocity, mass, density, smoothing, central_viscosity, period=None, rows=None):
    """Acceleration [m/s^2] by the viscosity along the line of centres."""
    i = Fields(position=position, velocity=velocity, mass=mass, density=density)
    around = neighbours(i, i, smoothing, period=period, rows=rows)
    return {"acceleration": around.others(ref.central_viscous_force, k=central_viscosity.coefficient)}


@operation(
    "J(10), momentum equation with zeta = 5 eta/3", paper="Jiang & Zhu 2023; Espanol & Revenga 2003",
    adds="acceleration", variants=("central_viscosity velocity density period", "density period", "density"),
    tolerance=12.0, reason="those of sph.central_viscosity; the size counts |p_i| and |p_j|, too",
    invariants=f"{SYMMETRY} linear_momentum angular_momentum galilean",
    broken={0: "galilean", 2: "rotation angular_momentum"}, packed="central_momentum_pair",
)  # fmt: skip
def central_momentum(
    position, velocity, volume, mass, density, pressure, smoothing, fluid, central_viscosity, period=None, rows=None
):
    """Acceleration [m/s^2] by J(10) and by the viscosity along the line of centres, where there is one; no walls.

    volume  V [m^dim], or m [kg] where a density is given
    """
    own = volume_of(volume, density)
    i = Fields(
        position=position, velocity=velocity, mass=mass, density=np.asarray(mass, dtype=float) / own, pressure=pressure
    )
    around = neighbours(i, i, smoothing, period=period, rows=rows)
    a = around(ref.pressure_force, s=fluid.gradient_share)
    if central_viscosity is not None:
        a += around.others(ref.central_viscous_force, k=central_viscosity.coefficient)
    return {"acceleration": a}


@operation("J(6), g", paper="standard", adds="acceleration", invariants="reordering")
def gravity(field, rows=None):
    """Uniform acceleration a_i = g [m/s^2], g of J(6); one row for all particles."""
    return {"acceleration": Terms(np.asarray(field)[None, :], rank=1)}


@operation(
    "max |v|^2, max |a|^2, max s/dt, max (T - range), number of rho > b rho0", paper="standard", outputs="extremes",
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
        low, high = (float(v) for v in temperature_range)
        excess = np.nanmax(ref.beyond(Terms(temperature), low, high).value, initial=0)
        size = excess + abs(low) + abs(high)
    counts = [0, 0]
    if density_bounds is not None:
        rest = density_bounds.rest_density if rest_density is None else rest_density
        bounds = (np.asarray(rest) * times for times in (density_bounds.dense, density_bounds.crushed))  # in the dtype
        counts = [int((np.asarray(density) > bound).sum()) for bound in bounds]
    value = np.array([speed.max(initial=0), force.max(initial=0), broken.sum(), rate, excess, *counts], dtype=float)
    return {"extremes": (value, np.array([*value[:4], size, *counts]))}


def carried(position, residual, shift, size):
    """x <- x + residual + shift [m], and what its rounding to the type of x leaves: ((sum, scale), (rest, scale)).

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


def at_planes(bounds, before, x, v, rest):
    """x <- its nearest place between the walls' planes [m]; v [m/s] and residual 0 there; flags of those stopped.

    Only what was `before` [m] between their ends is.
    """
    if bounds is None:
        return x, v, rest, np.zeros(len(x), dtype=bool)
    lower, upper = np.asarray(bounds.lower, dtype=float), np.asarray(bounds.upper, dtype=float)
    acts = ~((before < bounds.first) | (before > bounds.last)).any(1)
    beyond = acts[:, None] & ((x < lower) | (x > upper))
    rest = None if rest is None else tuple(np.where(beyond, 0.0, part) for part in rest)
    return np.where(beyond, np.clip(x, lower, upper), x), np.where(beyond, 0.0, v), rest, beyond.any(1)


def shifts(way, longest_shift, drawn_body):
    """s = L way [m], L the longest shift of a particle's body; None without."""
    if way is None:
        return None
    return Fields(longest=np.asarray(longest_shift)[0 if drawn_body is None else drawn_body]).longest * Fields(w=way).w


def farthest(shift):
    """Largest |s_i|^2 [m^2]; 0 without shifts."""
    return 0.0 if shift is None else (shift.value**2).sum(1).max(initial=0)


def stepped(acceleration, timestep, shift, position_residual, velocity, position):
    """(v [m/s], x [m], (what rounding x leaves [m], its scale) or None) of the leap-frog without walls."""
    kick, drift = (float(t) for t in timestep)
    i = Fields(velocity=velocity, acceleration=acceleration, shift=0.0 if shift is None else shift)
    v = ref.kicked(i, kick)
    change = ref.drifted(i, v, drift)
    if position_residual is None:
        return v, Terms(position, rank=1) + change, None
    total, rest = carried(position, position_residual, *change)
    return v, Terms(*total, 1), rest


@operation(
    "leap-frog with a changing step", paper="standard", outputs="position_residual velocity position displacement",
    variants=(
        f"bounds position_residual {SHIFT}", f"position_residual {SHIFT}",
        without(f"bounds {SHIFT}", timestep="short_steps"), SHIFT, "", "drawn_body",
    ),
    reason="one rounding in each product and sum", invariants="reordering", cases="slow_and_far",
)  # fmt: skip
def kick_drift(
    acceleration,
    build_position,
    bounds,
    timestep,
    way,
    longest_shift,
    drawn_body,
    position_residual,
    velocity,
    position,
):
    """Leap-frog for v [m/s] and x [m], stopped at the walls' planes `bounds` [m].

    With a residual, x + residual is advanced, and the rest of its rounding is the new one; 0 at a plane.
    displacement: [largest squared displacement since the list was built [m^2], number of stopped particles, largest
    squared shift [m^2]].
    """
    shift = shifts(way, longest_shift, drawn_body)
    v, x, rest = stepped(acceleration, timestep, shift, position_residual, velocity, position)
    x_at, v_at, rest, stopped = at_planes(bounds, np.asarray(position), x.value, v.value, rest)
    x, v = Terms(x_at, x.size, 1), Terms(v_at, v.size, 1)
    moved = x.value - np.asarray(build_position, dtype=float)
    squares = (moved**2).sum(1), ((np.abs(moved) + x.size) ** 2).sum(1)
    value, size = (s.max(initial=0) for s in squares)
    far = farthest(shift)
    displacement = np.array([value, stopped.sum(), far]), np.array([size, 0.0, far])
    residual = {} if rest is None else {"position_residual": rest}
    return {"velocity": v, "position": x, "displacement": displacement, **residual}
