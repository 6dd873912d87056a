"""Inputs and closed forms of two-way coupling."""

import math

import numpy as np

from refsim.boundary.two_way_coupling import Coupling, Delay, Overlapping, TwoWayCoupling
from refsim.core import cases
from refsim.core.cases import REST_DENSITY, Case, Exact, at, closed_form, example, groups, particles, takes, vectors
from refsim.core.walls import WallParticles, planes
from refsim.shape_matching.phases import FLUID, INTERIOR, SURFACE
from refsim.smoothing.cases import for_each_kernel
from refsim.sph import CentralViscosity, Fluid, ViscosityTerm, WallFrameGravity

example(TwoWayCoupling(), brings="relative_contribution rest_density volume")


@particles("phase")
def _phase(case, random):
    """Liquid, surfaces and interiors of solids, mixed at random."""
    return random.choice(np.array([FLUID, SURFACE, INTERIOR], np.int32), case.count, p=[0.5, 0.35, 0.15])


@particles("rest_density")
def _rest_density(case, random):
    """Solids of 0.2 to 10 times water's density; liquids near the density of the cases."""
    liquid = _phase(case, case.random("phase")) == FLUID
    solid = REST_DENSITY * np.exp(random.uniform(np.log(0.2), np.log(10), case.count))
    return np.where(liquid, REST_DENSITY * random.uniform(0.8, 1.1, case.count), solid)


@particles("relative_contribution")
def _contribution(case, random):
    phase = _phase(case, case.random("phase"))
    phi = random.uniform(0.5, 1.6, case.count)
    return np.select([phase == FLUID, phase == SURFACE], [1.0, phi], 0.0)


@groups("coupling")
def _coupling(case, grid):
    printed = np.int32(case.literal)
    least, stiffness = grid.real(grid.spacing**grid.dim), grid.real(20.0**2 / 7)
    weighted = np.int32(case.dim == 2)
    return {"coupling": Coupling(least, stiffness, np.int32(7), printed, printed, printed, weighted)}


@particles("solid_number")
def _solid_number(case, random):
    """Three solids, mixed at random."""
    return random.integers(1, 4, case.count).astype(np.int32)


@particles("wet")
def _wet(case, random):
    """None in the liquid and in a third of the solids."""
    solid = _phase(case, case.random("phase")) != FLUID
    return np.where(solid, np.maximum(random.uniform(-1.0, 2.0, case.count), 0.0), 0.0)


@particles("told_wet")
def _told_wet(case, random):
    """None in the liquid and in a third of the solids, and next to none in some."""
    return _wet(case, random) * random.choice([1.0, 1e-3, 1e-24], case.count)


@particles("suction")
def _suction(case, random):
    """None in the liquid and in half of the solids."""
    solid = _phase(case, case.random("phase")) != FLUID
    return np.where(solid, np.minimum(4e4 * random.uniform(-1.0, 1.0, case.count), 0.0), 0.0)


particles(told_pressure=lambda case, random: 4e4 * random.uniform(-0.5, 1.0, case.count), told_suction=_suction)
# of centimetres a second
particles(followed_velocity=lambda case, random: 0.05 * vectors(case, random))
# none yet, and near those of the cases
particles(
    film_factor=lambda case, random: random.choice([1.0, 1.5, 8.0], case.count),
    allowed_closeness=lambda case, random: random.choice([1e3, 3.0, 1.0, 0.9], case.count),
    contact_pressure=lambda case, random: -_suction(case, random),
    plane_pressure=lambda case, random: (
        -_suction(case, random)[:, None] * random.choice([0.0, 1.0, 2.0], (case.count, 3))
    ),
)


@groups("overlapping")
def _overlapping(case, grid):
    numbers = 1 / case.spacing, 1 / case.spacing**case.dim, 2e4, 0.05 * case.support_radius
    return {"overlapping": Overlapping(*map(grid.real, numbers))}


# four crossings of the support radius at 20 m/s
groups(delay=lambda case, grid: Delay(grid.real(4 * case.support_radius / 20.0)))


cases.readings(coupling="printed_volume printed_pressure printed_viscosity")
takes("two_way_coupling.push", fluid="gradient_share")
takes("two_way_coupling.hold", smoothing="support_radius dim")
takes("two_way_coupling.overlap", smoothing="support_radius")
takes(
    "two_way_coupling.contact", smoothing="support_radius", fluid="rest_density",
    overlapping="inverse_spacing inverse_volume",
)  # fmt: skip
takes("two_way_coupling.spread", fluid="rest_density")
takes("two_way_coupling.close_films", fluid="rest_density")
takes("two_way_coupling.contribution", coupling="least_volume printed_volume")
takes("two_way_coupling.density", coupling="stiffness exponent")
takes("two_way_coupling.pressure", coupling="printed_pressure density_weighted")
takes("two_way_coupling.forces", coupling="printed_pressure printed_viscosity density_weighted")


# Closed forms: h = 2 m; the viscosity kernel's Laplacian at h/2 is 45/(64 pi).

PAIR = at("coupled_pair", [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
WATER_AND_ICE = np.array([FLUID, SURFACE], np.int32)
TURNING = [0.0, 0.0, 3.0, 0.0, 0.0, 0.25, 1.0, 0.0, 7.0]  # 3/s about z by (1, 0) m, faster by 1/4 s^-2


def _coupled(**changes):
    return Coupling(0.5, 100.0, 7, *np.zeros(4, np.int32))._replace(**changes)


def _weighed(wanted, phase, where=PAIR, **changes):
    """Phi, 0 inside solids and 1 in the liquid."""
    inputs = {"phase": phase, "coupling": _coupled(**changes)}
    return Exact(where, inputs, {"relative_contribution": wanted})


for_each_kernel(
    "two_way_coupling.contribution",
    # V_k = 1/(W(0) + W(h/2)) over both solids (Shao & Song M4), phi = V_k/V_min
    surface_beside_inside=lambda w: _weighed(
        [1 / ((1 + w.share) * w.at_zero * 0.5), 0.0, 1.0],
        [SURFACE, INTERIOR, FLUID],
        at("coupled_three", [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 2.0, 0.0]]),
    ),
    # as printed V_k = 1/W(0): the interior is not counted
    printed_surface_beside_inside=lambda w: _weighed(
        [1 / (w.at_zero * 0.5), 0.0], [SURFACE, INTERIOR], printed_volume=1
    ),
)


@for_each_kernel("two_way_coupling.density")
def liquid_beside_solid(w):
    """rho = m (W(0) + phi W(h/2)); the solid keeps its rest density."""
    inputs = {
        "mass": [2.0, 3.0], "rest_density": [1000.0, 900.0], "phase": WATER_AND_ICE,
        "relative_contribution": [1.0, 4.0], "walls": None,
    }  # fmt: skip
    return Exact(PAIR, inputs, {"density": [2 * w.at_zero * (1 + 4 * w.share), 900.0]})


def _substances(w, stiffness):
    """(2^7 - 1) c^2/g rho0 at twice the rest density, none in the solid, none below the rest density; V = m/rho."""
    apart = Case("substances", 3, np.array([[0.0, 0.0, 0.0], [0.0, 9.0, 0.0], [0.0, 18.0, 0.0]]), 1.0, 2.0)
    inputs = {
        "mass": np.array([400.0, 100.0, 150.0]) / w.at_zero, "rest_density": np.full(3, 200.0),
        "phase": [FLUID, SURFACE, FLUID], "relative_contribution": [1.0, 4.0, 1.0],
        "walls": None, "coupling": _coupled(stiffness=stiffness),
    }  # fmt: skip
    return Exact(
        apart, inputs,
        {"density": [400.0, 200.0, 150.0], "pressure": [127 * 200 * stiffness, 0.0, 0.0],
         "volume": np.array([1.0, 0.5, 1.0]) / w.at_zero},
    )  # fmt: skip


for_each_kernel(
    "two_way_coupling.density",
    tait_of_two_substances=lambda w: _substances(w, 100.0),  # 2.54 MPa
    tait_of_soft_substances=lambda w: _substances(w, 1e-5),  # a quarter of a pascal
)


def _pushed(force, viscosity=None, given=None, **changes):
    """Liquid of 2 kg and 0.5 m^3 at 40 Pa, solid of 3 kg with phi = 0.25 that moves past it; F [N] on the liquid."""
    inputs = {
        "mass": [2.0, 3.0], "phase": WATER_AND_ICE, "pressure": [40.0, 7.0], "volume": [0.5, 9.0],
        "relative_contribution": [1.0, 0.25], "velocity": [[0.0, 0.0, 0.0], [8.0, 0.0, 0.0]],
        "coupling": _coupled(**changes), "viscosity": viscosity, "walls": None,
    } | (given or {})  # fmt: skip
    force, (first, second) = np.array(force), inputs["mass"]
    return Exact(PAIR, inputs, {"acceleration": [force / first, -force / second]})


TWO_LIQUIDS = {
    "mass": [2.0, 12.0], "phase": [FLUID, FLUID], "pressure": [40.0, 8.0], "volume": [0.5, 1.0],
    "relative_contribution": np.ones(2), "velocity": np.zeros((2, 3)),
}  # fmt: skip
for_each_kernel(
    "two_way_coupling.pressure",
    # F = -V^2 p phi |W'|: 0.25 m^6 * 40 Pa * 0.25, repulsive; the solid's own pressure has no effect
    solid_pushes_liquid=lambda w: _pushed([0.0, -2.5 * w.slope, 0.0]),
    # Shao & Song (2) as printed lacks one m_i = 2 kg
    printed_push=lambda w: _pushed([0.0, -1.25 * w.slope, 0.0], printed_pressure=1),
    # rho = 4 and 12 kg/m^3, p = 40 and 8 Pa: (12 * 40 + 4 * 8)/16 = 32 Pa; F = -(0.25 + 1) m^6 * 32 Pa |W'|
    two_liquids_by_one_pressure=lambda w: _pushed([0.0, -40.0 * w.slope, 0.0], None, TWO_LIQUIDS, density_weighted=1),
)


DRAG = 3 * 0.0625 * 8 * 45 / (64 * math.pi)  # mu V^2 phi v lap W: 3 Pa s * 0.25 m^6 * 0.25 * 8 m/s * 45/(64 pi)
for_each_kernel(
    "two_way_coupling.forces",
    solid_drags_liquid=lambda w: _pushed([DRAG, -2.5 * w.slope, 0.0], ViscosityTerm(3.0)),
    # Shao & Song (3) as printed lacks one V_i = 0.5 m^3
    printed_drag=lambda w: _pushed([2 * DRAG, -2.5 * w.slope, 0.0], ViscosityTerm(3.0), printed_viscosity=1),
)


def _held(**changes):
    """Liquid of 1000 kg/m^3 at 300 Pa below a solid's particle, which gains 2 m/s in each of 0.5 s upwards."""
    inputs = {
        "velocity": [[0.0, 0.0, 0.0], [0.0, 3.0, 0.0]], "phase": WATER_AND_ICE,
        "followed_velocity": [[0.0, 0.0, 0.0], [0.0, 2.0, 0.0]], "density": [1000.0, 900.0],
        "lean": WallFrameGravity(1.0, -9.0, 0.0), "delay": Delay(0.5), "pressure": [300.0, 7.0], "turning": None,
    }  # fmt: skip
    return inputs | changes


def _taken(found, wet, suction, case=PAIR, **changes):
    return Exact(case, _held(**changes), {"pressure": found, "wet": [0.0, wet], "suction": [0.0, suction]})


for_each_kernel(
    "two_way_coupling.extrapolation",
    # p = 300 Pa + 1000 kg/m^3 (-9 - 2) m/s^2 * 1 m; the liquid's pressure stays
    solid_that_rises=lambda w: _taken([300.0, 300.0 - 11000.0], w.share, 0.0),
    # gravity, centrifugal and Euler acceleration add up to (-9 + 9 + 0.25) m/s^2; Coriolis' is across
    in_a_tank_that_turns=lambda w: _taken([300.0, 300.0 + 1000.0 * (0.25 - 2.0)], w.share, 0.0, turning=TURNING),
    # four times -300 Pa
    liquid_under_tension=lambda w: _taken([-300.0, -300.0 - 11000.0], w.share, -1200.0, pressure=[-300.0, 7.0]),
    # 0 Pa beside another solid's particle
    solid_in_the_air=lambda w: _taken(np.zeros(2), 0.0, 0.0, phase=[SURFACE, SURFACE]),
)


@closed_form("two_way_coupling.extrapolation")
def liquid_h_away():
    """Liquid that rounding alone takes within h."""
    return _taken([300.0, 0.0], 0.0, 0.0, at("far", [[0.0, 0.0, 0.0], [0.0, 2 - 1e-8, 0.0]]))


UPWARDS = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]])


def _film(wanted, **changes):
    """Solids' particles 1 m below and beside the one that is dry; the liquid's rest density is 1000 kg/m^3."""
    three = at("film", [[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    inputs = {
        "velocity": np.zeros((3, 3)), "followed_velocity": np.zeros((3, 3)), "lean": WallFrameGravity(1.0, -9.0, 0.0),
        "delay": Delay(0.5), "phase": [SURFACE, SURFACE, INTERIOR], "wet": [3.0, 0.0, 1.0], "turning": None,
        "fluid": Fluid(1000.0, 4e5, 1, 0), "pressure": [1.0, 0.0, 2.0], "suction": [-5.0, 0.0, 0.0],
        "told_wet": [3.0, 7.0, 1.0], "told_pressure": [500.0, 9.0, 2500.0], "told_suction": [-40.0, 9.0, 0.0],
    }  # fmt: skip
    kept = {name: np.array((inputs | changes)[name]) for name in ("wet", "pressure", "suction")}
    kept = {name: np.array([value[0], own, value[2]]) for (name, value), own in zip(kept.items(), wanted)}
    return Exact(three, inputs | changes, kept)


for_each_kernel(
    "two_way_coupling.spread",
    # a quarter of the mean wetness 2; (3 (500 + 9000) + 1 (2500 - 1000))/4 Pa; 3/4 of -40 Pa; what is wet stays
    mean_of_two_that_are_wet=lambda w: _film([0.5, 7500.0, -30.0]),
    # (3 (-9500 + 9000) + 1 (500 - 1000))/4 Pa: the head of gravity goes on below zero
    goes_on_below_zero=lambda w: _film([0.5, -500.0, -30.0], told_pressure=[-9500.0, 9.0, 500.0]),
    # g - a_k = (1, -9 - 2) m/s^2 becomes as long as g
    solid_that_rises=lambda w: _film(
        [0.5, 1000 + 8000 * math.sqrt(82 / 122), -30.0],
        velocity=3.0 * UPWARDS,
        followed_velocity=2.0 * UPWARDS,
    ),
    # beside the axis g is (1 - 9, -9 + 0.25) m/s^2: (3 (500 + 8750) + 1 (2500 + 8000))/4 Pa
    in_a_tank_that_turns=lambda w: _film([0.5, 9562.5, -30.0], turning=TURNING),
    one_was_wet=lambda w: _film([0.75, 9500.0, -40.0], told_wet=[3.0, 7.0, 0.0]),
    all_were_dry=lambda w: _film(np.zeros(3), told_wet=[0.0, 7.0, 1e-21]),
    liquid_keeps_its_pressure=lambda w: _film([0.0, 7.0, 0.0], phase=[SURFACE, FLUID, FLUID], pressure=[5.0, 7.0, 9.0]),
)


def _overlapping_by(pressure, allowed, planes=0.0, where=PAIR, **changes):
    """A solid's particle that moves with 3 m/s down to another one's, 1 m below; d = 2 m, n = 1.6, C = n^3."""
    inputs = {
        "bounds": None,
        "velocity": [[0.0, 0.0, 0.0], [0.0, -3.0, 0.0]], "phase": [SURFACE, INTERIOR], "solid_number": [1, 2],
        "allowed_closeness": [1e3, 1e3], "overlapping": Overlapping(0.5, 5.0, 100.0, 0.25), "walls": None,
    } | changes  # fmt: skip
    found = {"allowed_closeness": allowed, "contact_pressure": pressure}
    found = {name: np.broadcast_to(value, 2) for name, value in found.items()}
    return Exact(where, inputs, found | {"plane_pressure": np.broadcast_to(planes, (2, 3))})


# A particle 1 m off walls across x and y, and one far from both
CORNER = np.array([[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
BESIDE = at("corner", [[0.0, 0.0, 0.0], [9.0, 0.0, 0.0]], CORNER)
IN_CORNER = {
    "solid_number": [1, 1], "velocity": [[0.0, -3.0, 0.0], [0.0, 0.0, 0.0]],
    "walls": WallParticles(CORNER, np.full(2, 0.2)),
    "bounds": planes(np.array([-0.5, -0.5, -np.inf]), np.inf),
}  # fmt: skip
BORNE = 50 * np.array([3 * math.log(1.6), 3 * math.log(1.6) + 0.5625, 0.0])


closed_form(
    "two_way_coupling.overlap",
    # 100 Pa (3 ln 1.6 + 0.25 s 4.8/(4 m * 1.6) 3 m/s)
    solids_that_overlap=lambda: _overlapping_by(
        100 * (3 * math.log(1.6) + 0.5625), 1.0, allowed_closeness=[1.0, 1.0]
    ),
    # 3 ln 1.6 - 3 * 0.5625 is no pull
    solids_that_part=lambda: _overlapping_by(0.0, 1.0, allowed_closeness=[1.0, 1.0], velocity=9.0 * np.eye(3)[[0, 1]]),
    # what is drawn is allowed
    as_drawn=lambda: _overlapping_by(0.0, 1.6**3),
    apart=lambda: _overlapping_by(0.0, 1.0, overlapping=Overlapping(1.25, 5.0, 100.0, 0.25)),
    # neither liquid nor the particle's own solid counts
    beside_liquid=lambda: _overlapping_by(0.0, [9.0, 1.0], phase=WATER_AND_ICE, allowed_closeness=[9.0, 1.5]),
    of_one_solid=lambda: _overlapping_by(0.0, 1.0, solid_number=[2, 2]),
    # planes do not add up, neither what is allowed nor what presses
    drawn_in_a_corner=lambda: _overlapping_by(0.0, [1.6**3, 1.0], where=BESIDE, **IN_CORNER),
    in_a_corner=lambda: _overlapping_by(
        0.0, 1.0, [BORNE, np.zeros(3)], BESIDE, allowed_closeness=[1.0, 1.0], **IN_CORNER
    ),
    # of a mesh they do: 2 n^3 in all
    in_a_mesh=lambda: _overlapping_by(
        [100 * (math.log(2 * 1.6**3) + 0.28125), 0.0], 1.0, where=BESIDE, allowed_closeness=[1.0, 1.0],
        **IN_CORNER | {"bounds": None},
    ),
)  # fmt: skip


def _touching(force, where=PAIR, rest_density=50.0, **changes):
    """Solids of 10 and 30 Pa, 1 m apart, d = 2 m, of cells of 8 m^3; |grad C| = 4.8 * 1.6^2/4 m; F on the second."""
    inputs = {
        "mass": [500.0, 1800.0], "phase": [SURFACE, INTERIOR], "solid_number": [1, 2], "walls": None, "bounds": None,
        "contact_pressure": [10.0, 30.0], "plane_pressure": [[9.0, 20.0, 9.0]] * 2,
        "overlapping": Overlapping(0.5, 0.125, 1.0, 1.0), "fluid": Fluid(rest_density, 1.0, 1, 0),
    } | changes  # fmt: skip
    force = 3.072 * np.array([0.0, force, 0.0])
    return Exact(where, inputs, {"acceleration": [-force / 500, force / 1800]})


WALL = np.array([[0.0, 1.0, 0.0]])
BETWEEN = at("wall_between", [[0.0, 0.0, 0.0], [0.0, 2.0, 0.0]], WALL)
BY_WALL = {
    "contact_pressure": [30.0, 30.0], "solid_number": [2, 2], "walls": WallParticles(WALL, np.array([4.0])),
}  # fmt: skip

closed_form(
    "two_way_coupling.contact",
    solids_push_each_other=lambda: _touching(8 * 40.0),
    # the lighter one has a quarter of the liquid's 2000 kg
    lighter_than_liquid=lambda: _touching(2 * 40.0, rest_density=250.0),
    beside_liquid=lambda: _touching(0.0, phase=WATER_AND_ICE),
    of_one_solid=lambda: _touching(0.0, solid_number=[2, 2]),
    # half of a cell, 1 m from each, with twice its 30 Pa, or the 20 Pa of planes
    wall_between=lambda: _touching(4 * 60.0, BETWEEN, **BY_WALL),
    plane_between=lambda: _touching(
        4 * 40.0, BETWEEN, **BY_WALL | {"bounds": planes(np.array([-9.0, 1.5, -9.0]), 9.0)}
    ),
)  # fmt: skip


SIDES = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])


def _closed(w, wider, lacks, phase=(SURFACE, SURFACE), body=(1, 1), walls=None, pressure=9e9, turning=None):
    """Solids of 0.5 and 2 m^3, the second 1 m above the first; walls 1 m below the first and at the second.

    Half of rho0 |g| h is 9 kPa, 1000 kg/m^3 * 9 m/s^2 * 1 m; -G_film.G/|G_film| is `lacks` m^3 times |W'(h/2)|.
    """
    inputs = {"phase": [*phase], "solid_number": [*body], "mass": [500.0, 1800.0], "density": [1000.0, 900.0]}
    inputs |= {"lean": WallFrameGravity(1.0, -8.0, 4.0), "fluid": Fluid(1000.0, 4e5, 1, 0)}
    inputs |= {"walls": walls and WallParticles(SIDES, np.array(walls)), "pressure": [pressure, 0.0]}
    inputs |= {"velocity": np.zeros((2, 3)), "turning": turning}
    factor = 1 + wider / (1 + 0.0036 / max(2 * lacks * w.slope, 1e-9) ** 2)
    return Exact(at("closed", PAIR.position, SIDES), inputs, {"film_factor": [factor, 1.0]})


for_each_kernel(
    "two_way_coupling.close_films",
    no_film=lambda w: _closed(w, 0.0, 0.0, WATER_AND_ICE),
    # where a film alone pushes it does not push less
    film_alone=lambda w: _closed(w, 0.0, 0.0, body=(1, 2)),
    between_others=lambda w: _closed(w, 0.0, 0.0, body=(1, 2), walls=[0.5, 0.0]),
    # a wall below has a part of the 2 m^3 above, of its own solid or liquid: 2/0.5; 2/0.125 is more than 8
    quarter_of_a_wall=lambda w: _closed(w, 3.0, 1.5, walls=[0.5, 0.0]),
    sixteenth_of_a_wall=lambda w: _closed(w, 7.0, 1.875, walls=[0.125, 0.0]),
    below_liquid=lambda w: _closed(w, 3.0, 1.5, phase=(SURFACE, FLUID), walls=[0.5, 0.0]),
    uneven_liquid=lambda w: _closed(w, 0.05 / 1.95, 0.05, phase=(SURFACE, FLUID), walls=[1.95, 0.0]),
    near_a_surface=lambda w: _closed(w, 1.5, 1.5, walls=[0.5, 0.0], pressure=9e3),
    # (1, -8, 4) + (-9, 0.25, 0) m/s^2, see TURNING
    near_it_in_a_tank_that_turns=lambda w: _closed(
        w, 1.5, 1.5, walls=[0.5, 0.0], pressure=1e3 * math.hypot(8.0, 7.75, 4.0), turning=TURNING
    ),
    above_it=lambda w: _closed(w, 0.0, 1.5, walls=[0.5, 0.0], pressure=-9e3),
    # 1.5 below and 1 above: 0.5 (2 - 0.5)/(2.5^2/8)
    two_walls_that_face_each_other=lambda w: _closed(w, 0.96, 0.75 / math.sqrt(2.5**2 / 8), walls=[1.5, 1.0]),
)  # fmt: skip


def _lifted(w, phase, body, force, pressure=(30.0, 10.0), wide=1.0):
    """`force` [N] over |W'(h/2)| on the second particle, upwards."""
    inputs = {
        "mass": [500.0, 1800.0], "density": [1000.0, 900.0], "phase": phase, "solid_number": np.array(body, np.int32),
        "pressure": [*pressure], "suction": [0.0, -20.0], "film_factor": [1.0, wide], "fluid": Fluid(1000.0, 1.0, 1, 0),
    }  # fmt: skip
    force = np.array([0.0, -force * w.slope, 0.0])
    return Exact(PAIR, inputs, {"acceleration": [force / 500, -force / 1800]})


for_each_kernel(
    "two_way_coupling.push",
    # F = V_i V_k (p_i + p_k) |W'(h/2)| = 0.5 * 2 m^6 * 40 Pa |W'(h/2)| between liquid and solid, also where a solid has
    # melted into liquid, and between two solids; particles of one solid do not push each other
    liquid_lifts_solid=lambda w: _lifted(w, WATER_AND_ICE, [0, 1], 40.0),
    melt_lifts_its_solid=lambda w: _lifted(w, WATER_AND_ICE, [1, 1], 40.0),
    solid_pushes_another=lambda w: _lifted(w, [SURFACE, INTERIOR], [2, 1], 40.0),
    # -20 Pa in place of 20 - 50 Pa
    film_that_breaks=lambda w: _lifted(w, [SURFACE, INTERIOR], [2, 1], -20.0, (20.0, -50.0)),
    film_of_which_half_is_seen=lambda w: _lifted(w, [SURFACE, INTERIOR], [2, 1], 2 * 40.0, wide=3.0),
    one_solid_does_not_push_itself=lambda w: _lifted(w, [SURFACE, INTERIOR], [1, 1], 0.0),
)


@closed_form("two_way_coupling.hold")
def solid_holds_liquid():
    """A solid of 4 kg/m^3 and 2 kg 1 m above liquid of 2 kg/m^3 and 3 kg parts from it with 8 m/s; mu = 0.5 Pa s.

    F = (dim + 2) mu V V lap W 8 m/s = 2.5 * 1.5 * 0.5 * 8 * 45/(64 pi) N for h = 2 m; the motion across has no effect.
    """
    force = 2.5 * 1.5 * 0.5 * 8 * 45 / (64 * math.pi) * np.array([0.0, 1.0, 0.0])
    given = {
        "mass": [3.0, 2.0], "density": [2.0, 4.0], "phase": WATER_AND_ICE, "central_viscosity": CentralViscosity(2.5),
        "velocity": [[0.0, 0.0, 0.0], [5.0, 8.0, 0.0]],
    }  # fmt: skip
    return Exact(PAIR, given, {"acceleration": [force / 3, -force / 2]})


@closed_form("two_way_coupling.follow")
def follows_by_a_third():
    """tau = 0.75 s, dt = 0.25 s: a third of the difference of 3 m/s."""
    told = {"wet": [0.0, 2.0], "pressure": [3.0, -4.0], "suction": [0.0, -5.0]}
    inputs = told | {
        "velocity": [[0.0, 5.0, 0.0], [0.0, 0.0, 0.0]], "delay": Delay(0.75),
        "followed_velocity": [[0.0, 2.0, 0.0], [3.0, 0.0, 0.0]], "timestep": [0.25, 0.5],
    }  # fmt: skip
    kept = {f"told_{name}": value for name, value in told.items()}
    return Exact(PAIR, inputs, kept | {"followed_velocity": [[0.0, 3.0, 0.0], [2.0, 0.0, 0.0]]})
