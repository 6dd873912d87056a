"""Operations of two-way coupling: which equations make each, its kernels, variants, tolerance and why.

Arrays: position, velocity (n, 3); mass, density, pressure, volume, rest_density (n,) in SI units; phase (n,): 0 liquid,
1 solid at its body's surface, 2 solid inside. `rows` picks particles.
"""

import numpy as np

from refsim.boundary.two_way_coupling import reference as ref
from refsim.core.operation import SYMMETRY, operations
from refsim.core.terms import Terms, length, maximum, minimum, where
from refsim.gauges.operations import in_each
from refsim.motion.operations import felt
from refsim.neighbours.sums import Fields, neighbours, wall_particles
from refsim.smoothing.reference import kernel_value

operation = operations(paper="Shao & Song 2017")
_FORCES = (
    "one rounding in each of distance, kernel, product and sum, and a few in the kernel's polynomial; the size counts"
    " both pressures, not their sum"
)

FLUID, SURFACE, INTERIOR = 0, 1, 2


def kinds(phase):
    """Flags of the liquid and of solids."""
    liquid = np.asarray(phase) == FLUID
    return {"liquid": liquid, "solid": ~liquid}


@operation(
    "Shao & Song (1), phi, with M4", outputs="relative_contribution",
    reason="one rounding in each of distance, kernel, sum and quotient", invariants=SYMMETRY,
    packed="contribution_pair",
)  # fmt: skip
def contribution(position, phase, smoothing, coupling, rows=None):
    """Weights in Shao & Song (1), dimensionless: 1 in the liquid, 0 inside solids, phi_k at their surfaces.

    With Shao & Song M4 the sum runs over all solid particles; as printed, over those at surfaces alone.
    """
    surface = np.asarray(phase) == SURFACE
    counted = surface if coupling.printed_volume else np.asarray(phase) != FLUID
    i = Fields(position=position, counted=counted, surface=surface, **kinds(phase))
    around = neighbours(i, i, smoothing, rows=rows)
    with np.errstate(divide="ignore", invalid="ignore"):  # where there are no solids
        phi = ref.share(around(ref.filled_by_solids), float(coupling.least_volume))
    return {"relative_contribution": where(around.i.surface, phi, around.i.liquid)}


@operation(
    "Shao & Song (1), p = B ((rho/rho0)^7 - 1), V = m/rho", outputs="density pressure volume", optional="walls",
    tolerance=8.0, reason="one rounding in each of distance, kernel, product and sum; the scale counts the power's",
    invariants=SYMMETRY, packed="density_pair",
)  # fmt: skip
def density(position, mass, rest_density, phase, relative_contribution, walls, smoothing, coupling, rows=None):
    """Density [kg/m^dim], self and walls included, pressure [Pa] and volume [m^dim]; solids keep rho0_i, with p = 0."""
    i = Fields(position=position, mass=mass, rest=rest_density, phi=relative_contribution, **kinds(phase))
    around, at_walls = (neighbours(i, j, smoothing, rows=rows) for j in (i, wall_particles(walls)))
    here = around.i
    rho = where(here.liquid, around(ref.summed_density) + at_walls(ref.density_at_walls), here.rest)
    p = ref.state(Fields(density=rho), here.rest * float(coupling.stiffness), here.rest, int(coupling.exponent))
    return {"density": rho, "pressure": where(here.liquid, maximum(p, 0), 0), "volume": here.mass / rho}


@operation(
    "Shao & Song (2), (3) with M1 to M3", adds="acceleration", optional="walls viscosity", tolerance=8.0,
    reason=_FORCES, invariants=f"{SYMMETRY} linear_momentum galilean dissipation", broken={0: "dissipation"},
    packed="force_pair",
)  # fmt: skip
@operation(
    "Shao & Song (2) with M1, M2", "two_way_coupling.pressure", adds="acceleration",
    variants=("viscosity walls", "viscosity"), tolerance=8.0, reason=_FORCES,
    invariants=f"{SYMMETRY} linear_momentum angular_momentum", packed="force_pair",
)  # fmt: skip
def forces(
    position, velocity, mass, density, rest_density, phase, pressure, volume, relative_contribution, walls, smoothing,
    coupling, viscosity, rows=None,
):  # fmt: skip
    """Accelerations F_i/m_i [m/s^2] of liquid and solids."""
    i = Fields(
        position=position, velocity=velocity, mass=mass, pressure=pressure, volume=volume, phi=relative_contribution,
        density=density, rest=rest_density, **kinds(phase),
    )  # fmt: skip
    around, at_walls = (neighbours(i, j, smoothing, rows=rows) for j in (i, wall_particles(walls)))
    liquids = ref.weighted_pressure_force if coupling.density_weighted else ref.pressure_force
    a = around(liquids) + around(lambda i, k, ik: ref.solid_pressure_force(i, k, ik, coupling.printed_pressure))
    a += at_walls(ref.wall_pressure_force)
    if viscosity is not None:
        mu, printed = float(viscosity.coefficient), coupling.printed_viscosity
        a += around.others(lambda i, j, ij: ref.viscous_force(i, j, ij, mu, printed))
    return {"acceleration": a}


@operation(
    "(27)", paper="Adami, Hu & Adams 2012", outputs="wet suction pressure", entrywise=True, variants=("turning", ""),
    tolerance=16.0, reason="one rounding in each of distance, kernel, head, product and sum, and those of the quotient",
    packed="held_pair",
)  # fmt: skip
def extrapolation(
    position, velocity, followed_velocity, phase, density, smoothing, lean, turning, delay, pressure, rows=None
):
    """Pressure of each solid's particle [Pa], 0 where no liquid is within reach; the liquid's stays.

    wet, dimensionless, is the sum of the weights over W(0), suction [Pa] four times the mean pressure of the liquid
    where that is negative; both are 0 in the liquid.
    """
    i = Fields(
        position=position, velocity=velocity, followed=followed_velocity, density=density, pressure=pressure,
        **kinds(phase),
    )  # fmt: skip
    around, solid = near_solids(i, smoothing, lean, turning, delay, rows)
    weights = around(ref.weight_of_liquid)
    wet = weights / float(kernel_value(0.0, smoothing))
    wet = where(solid.liquid.value + (wet.value <= 1e-20), 0, wet)  # rounding alone takes such liquid within h
    p, alone = (
        in_each(around(term), around, ref.weight_of_liquid) / positive(weights)
        for term in (ref.pressure_and_head, ref.pressure_alone)
    )
    return {
        "wet": wet,
        "suction": where(wet.value != 0, 4.0 * minimum(alone, 0), 0),
        "pressure": where(solid.liquid, solid.pressure, where(wet.value != 0, p, 0)),
    }


@operation(
    "pressure of a film", paper="this project", outputs="wet suction pressure", entrywise=True,
    variants=("turning", ""), tolerance=16.0,
    reason="one rounding in each of distance, kernel, head, product and sum, and those of the quotient",
)  # fmt: skip
def spread(
    position, velocity, followed_velocity, phase, told_wet, told_pressure, told_suction, smoothing, fluid, lean,
    turning, delay, wet, suction, pressure, rows=None,
):  # fmt: skip
    """What `extrapolation` tells [-, Pa], of solids' particles k with wet_k = 0: a film too thin for particles carries
    the pressure between bodies in contact.

    It comes from solids' particles s that were wet in the step before, a quarter of whose wetness is passed on.
    """
    i = Fields(
        position=position, velocity=velocity, followed=followed_velocity, wet=told_wet, pressure=told_pressure,
        suction=told_suction, density=float(fluid.rest_density), place=np.arange(len(told_wet)), **kinds(phase),
    )  # fmt: skip
    around, solid = near_solids(i, smoothing, lean, turning, delay, rows)
    before = Fields(wet=wet, suction=suction, pressure=pressure).at(rows)
    weights, whole = around(ref.weight_of_film), around(ref.weight_of_wet)
    dry = (solid.liquid.value == 0) & (before.wet.value == 0) & (weights.value > 1e-20 * whole.value)
    p, alone = (
        in_each(around(term), around, ref.weight_of_film) / positive(weights)
        for term in (ref.film_pressure, ref.suction)
    )
    return {
        "wet": where(dry, 0.25 * weights / positive(whole), before.wet),
        "suction": where(dry, alone, before.suction),
        "pressure": where(dry, p, before.pressure),
    }


def touching(position, phase, solid_number, walls, bounds, overlapping, smoothing, rows, bears=(None,) * 4, **own):
    """Pairs with other particles, and with walls: meshes, and planes across x, y and z. `share` is o, `bears` b."""
    kind = kinds(phase)
    beyond = np.zeros((0 if walls is None else len(walls.volume), 3))
    if walls is not None and bounds is not None:
        place = np.asarray(walls.position)
        beyond = 1.0 * ((place < np.asarray(bounds.lower)) | (place > np.asarray(bounds.upper)))
    planes = beyond.sum(1)
    shares = [planes == 0, *beyond.T / np.maximum(planes, 1)]
    found = []
    for pressure, share in zip(bears, shares):
        i = Fields(position=position, part=solid_number, share=kind["solid"], bears=pressure, **kind, **own)
        if walls is not None:
            share = share * np.asarray(walls.volume, dtype=float) * float(overlapping.inverse_volume)
        w = wall_particles(walls, part=-1, share=share, velocity=Terms(np.zeros(3), rank=1))
        found += [neighbours(i, j, smoothing, rows=rows) for j in ((i, w) if not found else (w,))]
    return found


@operation(
    "contact", paper="this project", outputs="allowed_closeness contact_pressure plane_pressure",
    variants=("walls bounds", "bounds", ""), entrywise=True, tolerance=16.0,
    reason="one rounding in each of distance, closeness, product, sum and logarithm",
)  # fmt: skip
def overlap(
    position, velocity, phase, solid_number, walls, bounds, smoothing, overlapping, allowed_closeness, rows=None
):  # fmt: skip
    """Least closeness to a solid's particle so far, at least 1, and what presses apart what is closer [Pa]: other
    solids and meshes, and planes across x, y and z, each by its share of the closeness."""
    own = {"velocity": velocity, "allowed": allowed_closeness}
    around, *at_walls = touching(position, phase, solid_number, walls, bounds, overlapping, smoothing, rows, **own)
    inverse, _, stiffness, delay = map(float, overlapping)
    solid, before, none = around.i.solid.value > 0, around.i.allowed, 0 * around.i.solid

    def summed(term):
        others, *planes = (none + at(term, d=1 / inverse) for at in at_walls)
        return [around(term, d=1 / inverse) + others, *planes]

    close, growth = summed(ref.closeness), summed(ref.growth)
    most = maximum(maximum(close[0], close[1]), maximum(close[2], close[3]))
    allowed = minimum(before, maximum(most, 1))
    total, push = close[0] + close[1] + close[2] + close[3], []
    for c, rate in zip(close, growth):
        near = solid & (c.value > allowed.value)
        c = where(near, c, 1)
        push.append(where(near, ref.pressed(c, allowed, rate, stiffness, delay) * c / where(near, total, 1), 0))
    return {
        "allowed_closeness": where(solid, allowed, before), "contact_pressure": push[0],
        "plane_pressure": tuple(np.stack(parts, 1) for parts in zip(*push[1:])),
    }  # fmt: skip


@operation(
    "force of contact", paper="this project", adds="acceleration", variants=("walls bounds", "bounds", ""),
    tolerance=8.0, reason="one rounding in each of distance, closeness, product and sum",
    invariants=f"{SYMMETRY} linear_momentum angular_momentum", broken={2: "translation rotation"},
)  # fmt: skip
def contact(
    position, mass, phase, solid_number, contact_pressure, plane_pressure, walls, bounds, smoothing, fluid, overlapping,
    rows=None,
):  # fmt: skip
    """Accelerations [m/s^2] of solids by others and by walls that they touch."""
    bears = contact_pressure, *np.transpose(plane_pressure)
    around, *at_walls = touching(
        position, phase, solid_number, walls, bounds, overlapping, smoothing, rows, bears, mass=mass
    )  # fmt: skip
    cell, rho0 = 1 / float(overlapping.inverse_volume), float(fluid.rest_density)
    given = {"d": 1 / float(overlapping.inverse_spacing), "cell": cell, "least": rho0 * cell}
    return {"acceleration": sum((at(ref.contact_of_walls, **given) for at in at_walls), around(ref.contact, **given))}


def near_solids(i, smoothing, lean, turning, delay, rows):
    """(pairs of `rows`, which have g - a_k [m/s^2] as `pull`, and of all particles; the fields of `rows`)."""
    solid = i.at(rows)
    pull = ref.pull(solid, felt(solid, lean, turning), float(delay.tau))
    own = {"place": solid.place} if hasattr(i, "place") else {}
    if own:  # films
        pull = ref.film_pull(pull, felt(solid, lean, turning))
    return neighbours(Fields(position=solid.position, pull=pull, **own), i, smoothing), solid


def positive(weights):
    """Weights [in their unit], 1 where there are none."""
    return where(weights.value > 0, weights, 1)


@operation(
    "closed films", paper="this project", outputs="film_factor", variants=("walls turning", "turning", ""),
    tolerance=16.0, entrywise=True, reason="one rounding in each of distance, slope, volume, product, sum and quotient",
    invariants=SYMMETRY, broken={2: "translation rotation"},
)  # fmt: skip
def close_films(
    position, velocity, phase, solid_number, mass, density, pressure, walls, smoothing, fluid, lean, turning, rows=None
):  # fmt: skip
    """Factor with which films push a solid's particle, dimensionless; 1 in the liquid."""
    volume = np.asarray(mass, dtype=float) / np.asarray(density, dtype=float)
    i = Fields(
        position=position, velocity=velocity, volume=volume, pressure=pressure, part=solid_number, **kinds(phase)
    )  # fmt: skip
    around = neighbours(i, i, smoothing, rows=rows)
    at_walls = neighbours(i, wall_particles(walls, solid=1.0, part=-1), smoothing, rows=rows)
    sums = (around(part) + at_walls(part) for part in (ref.around, ref.of_film, ref.most_of_film))
    h = float(smoothing.support_radius)
    head = float(fluid.rest_density) * h / 2 * length(felt(i.at(rows), lean, turning))
    return {"film_factor": where(around.i.solid, ref.film_factor(*sums, around.i, head, h), 1)}


@operation(
    "J(10)", paper="Jiang & Zhu 2023; Adami, Hu & Adams 2012", adds="acceleration", tolerance=8.0,
    invariants=f"{SYMMETRY} linear_momentum angular_momentum", packed="push_pair",
)  # fmt: skip
def push(position, phase, solid_number, mass, density, pressure, suction, film_factor, smoothing, fluid, rows=None):
    """Accelerations [m/s^2] of liquid and solids; particles of one solid (`solid_number`) do not push each other."""
    part = np.where(np.asarray(phase) == FLUID, -1 - np.arange(len(pressure)), np.asarray(solid_number, dtype=int))
    i = Fields(
        position=position, mass=mass, density=density, pressure=pressure, suction=suction, part=part,
        wider=film_factor, **kinds(phase),
    )  # fmt: skip
    around = neighbours(i, i, smoothing, rows=rows)
    return {"acceleration": around(ref.push, s=fluid.gradient_share)}


@operation(
    "harmonic mean of the viscosities", paper="Cleary & Monaghan 1999; Espanol & Revenga 2003", adds="acceleration",
    tolerance=12.0, reason="those of sph.central_viscosity",
    invariants=f"{SYMMETRY} linear_momentum angular_momentum galilean dissipation", packed="hold_pair",
)  # fmt: skip
def hold(position, velocity, phase, mass, density, smoothing, central_viscosity, rows=None):
    """Accelerations [m/s^2] by which liquid that a solid holds doubles the viscous force between them."""
    i = Fields(position=position, velocity=velocity, mass=mass, density=density, **kinds(phase))
    around = neighbours(i, i, smoothing, rows=rows)
    return {"acceleration": around.others(ref.hold, k=central_viscosity.coefficient)}


@operation(
    "u, film of the step before", paper="standard", outputs="followed_velocity told_wet told_pressure told_suction",
    invariants="reordering",
)  # fmt: skip
def follow(velocity, wet, pressure, suction, delay, timestep, followed_velocity, rows=None):
    """Velocity [m/s] that follows that of a particle, and what the next step's `spread` takes."""
    told = Fields(velocity=velocity, followed=followed_velocity, wet=wet, pressure=pressure, suction=suction).at(rows)
    return {
        "followed_velocity": ref.follow(told, float(timestep[0]), float(delay.tau)), "told_wet": told.wet,
        "told_pressure": told.pressure, "told_suction": told.suction,
    }  # fmt: skip
