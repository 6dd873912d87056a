"""Inputs and closed forms of weakly compressible SPH."""

import math

import numpy as np

from refsim import sph
from refsim.core import cases
from refsim.core.walls import WallParticles, planes
from refsim.smoothing import SHAPES, Smoothing, smoothing
from refsim.smoothing.cases import for_each_kernel

cases.example(
    sph.WeaklyCompressible(sound_speed=12.0, dynamic_viscosity=0.3, density="summation"), brings="density pressure"
)
cases.example(sph.Gravity(acceleration=(1.0, -9.81, 0.0)))

FLUID = sph.LIQUID

cases.EFFECTS_OF_CASES.append(
    lambda case: sph.WeaklyCompressible(
        rest_density=cases.REST_DENSITY, sound_speed=20.0, dynamic_viscosity=0.5, state=case.state,
        clamp_pressure=case.clamp, kernels=case.kernels, literal=("all",) if case.literal else (),
    )
)  # fmt: skip
cases.particles(
    # within a tenth of the rest density
    density=lambda case, random: cases.REST_DENSITY * random.uniform(0.9, 1.1, case.count),
    # between a corner of the lattice and slightly compressed
    number_density=lambda case, random: (
        case.effects[FLUID].rest_number_density(case.grid("float64")) * random.uniform(0.4, 1.05, case.count)
    ),
)


@cases.particles("asymmetry")
def _asymmetry(case, random):
    """From none to that of a particle with neighbours on one side only."""
    grid = case.grid("float64")
    scale = case.effects[FLUID].rest_number_density(grid) * grid.support_radius
    return 0.12 * scale * random.uniform(0.0, 1.0, case.count)


# within a hundredth of the rest density; matrices near that of a lattice and far from it
cases.particles("advanced_excess", "density_excess")(
    lambda case, random: 0.01 * cases.REST_DENSITY * random.uniform(-1.0, 1.0, case.count)
)
cases.particles("correction_diagonal", "correction_mixed")(
    lambda case, random: random.uniform(0.7, 1.6, (case.count, 3))
)
cases.particles(
    borne=lambda case, random: random.uniform(0.0, 1.0, case.count),
    # of some thousandths of a spacing
    shift=lambda case, random: 0.003 * case.spacing * cases.vectors(case, random),
    # of either sign and of its own
    own_pressure=lambda case, random: 4e4 * random.uniform(-0.5, 1.0, case.count),
    # of either sign, so that no result depends on clamping
    pressure=lambda case, random: 4e4 * random.uniform(-0.5, 1.0, case.count),
)

cases.groups("smoothing", "gradient_smoothing", "fluid")(
    lambda case, grid: case.effects[FLUID].shares(grid, case.effects)
)
cases.groups(
    # within the cases' densities, so that some particles are above them
    density_bounds=lambda case, grid: sph.DensityBounds(*map(grid.real, (cases.REST_DENSITY, 1.0, 1.05))),
    # delta = 0.1, c = 20 m/s
    diffusion=lambda case, grid: sph.Diffusion(
        *map(grid.real, (grid.support_radius, cases.REST_DENSITY / 400, 20 / grid.support_radius))
    ),
    # half of the way back in a second
    recount=lambda case, grid: sph.Recount(grid.real(0.5), grid.real(0.99)),
    field=lambda case, grid: np.array([0.3, -9.81, 1.7], dtype=grid.dtype),
)
cases.prepared("viscosity", lambda case: case.effects[FLUID])

CENTRAL = sph.WeaklyCompressible(sound_speed=20.0, dynamic_viscosity=0.5, viscosity="central")
cases.prepared("central_viscosity", lambda case: CENTRAL)


def short_steps(case, grid):
    """Steps in which positions change by less than their rounding."""
    return np.array([8e-7, 1e-6], grid.dtype) * grid.real(case.spacing)


def _smoothing_follows(group, inputs, kernel):
    """The factors; and for the gradients' kernel the support radius, which is that of the scene as well."""
    lengths = {} if group is kernel else {"support_radius": kernel.support_radius, "dim": kernel.dim}
    group = group._replace(**lengths)
    shape = next(name for name, number in SHAPES.items() if number == group.shape)
    made = smoothing(shape, float(group.support_radius), int(group.dim))._asdict()
    return lengths | {name: made[name] for name in ("inverse_radius", "value_scale", "slope_scale", "laplacian_scale")}


cases.codes(Smoothing, shape=SHAPES)
cases.VARIATIONS[Smoothing] = cases.Variation(_smoothing_follows, other={"dim": lambda dim: 5 - dim})
cases.VARIATIONS[sph.Fluid] = cases.Variation(
    other={"exponent": lambda g: g + 1, "internal_pressure": lambda p: 3e4}, usual=("rest_density",)
)
cases.readings(fluid="gradient_share wall_share")
cases.takes("sph.continuity", "sph.state", fluid="rest_density stiffness exponent clamp internal_pressure")
cases.takes("sph.pressure", "sph.momentum", fluid="rest_density gradient_share wall_share")
cases.takes("sph.central_momentum", "sph.corrected_pressure", fluid="gradient_share")
cases.takes("sph.volume", fluid="rest_density")
cases.takes("sph.viscosity", "sph.central_viscosity", smoothing="support_radius dim")

# Closed forms: h = 2 m

PAIR = cases.at("pair", [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
FLAT_PAIR = cases.at("flat_pair", [[0.0, 0.0, 0.0], [0.6, 0.8, 0.0]], dim=2)
WATER = sph.Fluid(1000.0, 4e5, 1, 0)
AT_REST = {
    "mass": [2.0, 3.0], "volume": [2.0, 3.0], "density": np.full(2, 1000.0), "pressure": np.zeros(2),
    "velocity": np.zeros((2, 3)), "fluid": WATER,
}  # fmt: skip


@for_each_kernel("sph.density")
def two_particles_and_a_wall(w):
    """rho_1 = m_1 W(0) + m_2 W(h/2) + rho0 V_b W(h/2); the wall is opposite to 2, and as far from it as h."""
    wall = cases.at("pair_on_wall", PAIR.position, [[0.0, -1.0, 0.0]])
    mass, reach = np.array([2.0, 3.0]), w.share * w.at_zero
    filled = np.array([1000 * 0.5 * reach, 0.0])
    return cases.Exact(
        wall, {"mass": mass, "walls": WallParticles(wall.wall_position, np.array([0.5])), "fluid": WATER},
        {
            "density": mass * w.at_zero + mass[::-1] * reach + filled,
            "number_density": w.at_zero + reach + filled / mass,
            "asymmetry": np.abs(reach - filled / mass),
        },
    )  # fmt: skip


@for_each_kernel("sph.density", dims=(2, 3))
def two_particles(w):
    """rho_1 = m_1 W(0) + m_2 W(h/2), without a wall."""
    mass = np.array([2.0, 3.0])
    return cases.Exact(
        w.pair, {"mass": mass},
        {"density": w.at_zero * (mass + w.share * mass[::-1]), "number_density": np.full(2, w.at_zero * (1 + w.share)),
         "asymmetry": np.full(2, w.at_zero * w.share)},
    )  # fmt: skip


EXCESS = np.array([100.0, -20.0])


def _continued(excess, case=None, solid=0, **given):
    """Excess of particles of 2 and 3 kg, at rest by default, after 0.25 s; the last `solid` keep 900 kg/m^3."""
    case, excess = PAIR if case is None else case, np.array(excess)
    density = np.where(np.arange(case.count) < case.count - solid, 1000.0, 900.0) + excess
    inputs = {
        "mass": np.array([2.0, 3.0])[: case.count], "velocity": np.zeros((case.count, 3)), "fluid": WATER,
        "advanced_excess": EXCESS[: case.count], "timestep": [0.5, 0.25], "phase": None, "rest_density": None,
        "shift": None, "recount": None, "filling": None, "diffusion": None, "borne": None, "turning": None,
        "lean": sph.WallFrameGravity(0.0, 0.0, 0.0),
    }  # fmt: skip
    inputs |= given
    before = density - excess + np.array(inputs["advanced_excess"])
    inputs.setdefault("volume", np.array(inputs["mass"]) / before)
    return cases.Exact(case, inputs, {"density_excess": excess, "density": density})


NEARING = [[7.0, 2.0, 0.0], [3.0, 0.0, -5.0]]  # m/s


@for_each_kernel("sph.continuity")
def compressed_pair(w):
    """v_1 - v_2 = (4, 2, 5), 2 of it towards the second: d rho_1/dt = rho_1 V_2 2 |W'(h/2)|; for 0.25 s.

    a_1 = 2 k V_2 F/rho_1 (0, -2, 0) as in `braked_along_the_line`, with the densities before the step.
    """
    rate = (1000 + EXCESS) * np.array([3.0 / 980.0, 2.0 / 1100.0]) * 2 * w.slope
    brake = 2 * 2.5 / (1100.0 * 980.0) * 45 / (2 * math.pi * 32) * 0.5 * 2 * np.array([-3.0, 2.0])
    found = _continued(EXCESS + 0.25 * rate, velocity=NEARING, central_viscosity=sph.CentralViscosity(2.5))
    return cases.Exact(found.case, found.inputs, found.expected | {"acceleration": np.outer(brake, [0.0, 1.0, 0.0])})


@for_each_kernel("sph.continuity")
def shifted_pair(w):
    """At rest: d rho_1 = V_2 (2 rho_1 s_1 + (rho_2 - rho_1) s_2).grad W, shifts across the pair do nothing."""
    across = np.array([2 * 1100 * 0.002 - 120 * 0.001, -(2 * 980 * 0.001 + 120 * 0.002)])
    change = across * np.array([3.0 / 980.0, 2.0 / 1100.0]) * w.slope
    return _continued(EXCESS + change, shift=[[0.3, 0.002, 0.0], [0.0, 0.001, -0.4]])


cases.closed_form(  # a pair that parts fast has 0.95 rho0
    "sph.continuity",
    torn_pair=lambda: _continued([-50.0, -50.0], velocity=[[0.0, -7e4, 0.0], [0.0, 7e4, 0.0]]),
)


@for_each_kernel("sph.continuity")
def diffusing_pair(w):
    """d rho_1/dt = 2 k V_2 (rho_2 - rho_1 - b_1 b_2 s) |W'(h/2)|, s = 80 the difference at rest; for 0.25 s."""
    slope = 2 * 0.5 * w.slope
    difference = -120.0 - 0.8 * 0.625 * 80.0
    rate = slope * difference * np.array([3.0 / 980.0, -2.0 / 1100.0])
    return _continued(
        EXCESS + 0.25 * rate, diffusion=sph.Diffusion(0.5, 4.0), lean=sph.WallFrameGravity(3.5, 20.0, -1.5),
        borne=[0.8, 0.625],
    )  # fmt: skip


@for_each_kernel("sph.continuity")
def between_walls(w):
    """V_b v.n n.e |W'(h/2)| of one and V_b v.e |W'(h/2)| of an edge.

    Nothing of their strain, as they surround a particle without liquid.
    """
    place = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    rate = 1100 * w.slope * (75 * 0.002 - 50 * 0.8 * (0.8 * 0.002 - 0.6 * 1.0))
    return _continued(
        [100.0 + 0.25 * rate], cases.at("between_walls", [0, 0, 0], place), velocity=[[1.0, 0.002, 0.0]],
        walls=WallParticles(place, np.array([50.0, 75.0])), wall_strain=[0.02, -0.01],
        wall_normal=[[-0.6, 0.8, 0.0], [0.0, 0.0, 0.0]],
    )  # fmt: skip


def _half_surrounded(w, change, shares=(0.6, 0.25), **given):
    """The first particle's `change` at rest between another of V_j and a wall particle of V_b: l = 0.6, b = 0.25."""
    place, large = np.array([[0.0, -1.0, 0.0], [0.0, 9.0, 0.0]]), 3 * np.array(shares) / w.slope
    inputs = {
        "mass": [2.0, 980 * large[0]], "walls": WallParticles(place, np.full(2, large[1])), "wall_strain": None,
        "wall_normal": None,
    }  # fmt: skip
    case = cases.at("half_surrounded", PAIR.position, place)
    return _continued(EXCESS + np.array([change(*large), 0.0]), case, **inputs | given)


@for_each_kernel("sph.continuity")
def strained_by_a_wall(w):
    """d rho = rho f s_b W(h/2)/V dt, f = (0.6/(1 - 0.25) - 0.75)/0.1 = 0.5; the second has too little around it."""
    strained = 0.25 * 1100 * 0.5 * 1100 / 2 * 0.02 * w.share * w.at_zero
    return _half_surrounded(w, lambda v_j, v_b: strained, wall_strain=[0.02, -0.01], wall_normal=[[0.0, 1.0, 0.0]] * 2)


@for_each_kernel("sph.continuity")
def given_off_to_the_space_around(w):
    """1/(1 + a rate dt) of the excess is left, rate = 4/s: a = 0.5 at l + b = 0.15 + 0.1, 1 with nothing around."""
    rate = {"diffusion": sph.Diffusion(0.0, 0.0, 4.0)}
    exact = _half_surrounded(w, lambda *v: 0.0, (0.15, 0.1), **rate)
    return _continued(EXCESS / [1.5, 2.0], exact.case, **exact.inputs)


@for_each_kernel("sph.continuity")
def counted_by_walls(w):
    """s = (V W(0) + (V_j + V_b) W(h/2)) w; d rho = f rho rate (s - 1) dt, f = 0.5."""
    whole = 0.125 * w.at_zero

    def filling(v_j, v_b):
        return whole * (2 / 1100 + (v_j + v_b) * w.share)

    exact = _half_surrounded(
        w, lambda *v: 0.25 * 0.5 * 1100 * 0.5 * (filling(*v) - 1), recount=sph.Recount(0.5, 0.125), filling=np.zeros(2)
    )
    v_j, v_b = exact.inputs["mass"][1] / 980, exact.inputs["walls"].volume[0]
    return cases.Exact(
        exact.case, exact.inputs,
        {"filling": [filling(v_j, v_b), whole * (v_j + 2 / 1100 * w.share)]} | exact.expected,
    )  # fmt: skip


@for_each_kernel("sph.continuity")
def liquid_beside_a_solid(w):
    """The solid's 3 kg of 900 kg/m^3 come nearer: rho_1 V_2 2 |W'(h/2)|, no diffusion; the solid keeps its density."""
    rate = 1100 * 3.0 / 900.0 * 2 * w.slope
    return _continued(
        [100 + 0.25 * rate, 0.0], solid=1, velocity=NEARING, advanced_excess=[100.0, 0.0],
        diffusion=sph.Diffusion(0.5, 2.0), lean=sph.WallFrameGravity(3.5, 20.0, -1.5), rest_density=[1000.0, 900.0],
        phase=[0, 1],
    )  # fmt: skip


def _pressed(density, fluid, pressure):
    return cases.Exact(PAIR, {"density": density, "fluid": fluid}, {"pressure": pressure})


@cases.closed_form("sph.keep_density")
def kept():
    """Of g^2 = 20 m^2/s^4 the first has g.a = 10, half of its weight; the second falls with 1.2 g."""
    inputs = {
        "density_excess": [1.5, -2.25], "acceleration": [[5.0, 9.0, 0.0], [0.0, 8.0, -6.0]],
        "lean": sph.WallFrameGravity(2.0, 0.0, -4.0), "turning": None,
    }  # fmt: skip
    return cases.Exact(PAIR, inputs, {"advanced_excess": [1.5, -2.25], "borne": [0.5, 1.0 - 1.0]})


cases.closed_form(
    "sph.volume",
    filled=lambda: cases.Exact(  # 3 kg of a solid of 900 kg/m^3
        PAIR,
        {"mass": [2.2, 3.0], "advanced_excess": [100.0, 0.0], "rest_density": [1000.0, 900.0], "fluid": WATER},
        {"volume": [2.2 / 1100, 3.0 / 900]},
    ),
)
cases.closed_form(
    "sph.state",
    linear_state=lambda: _pressed([1250.0, 500.0], WATER, [1e5, -2e5]),  # p = c^2 (rho - rho0) with c^2 = 400
    # P_int (rho/rho0)^2 on top: at the rest density the pressure is P_int, at 1.5 rho0 it is 2e5 + 2.25 P_int
    balanced_cohesion=lambda: _pressed([1000.0, 1500.0], sph.Fluid(1000.0, 4e5, 1, 1, 800.0), [800.0, 201800.0]),
)


@cases.closed_form("sph.state")
def clamped_tait():
    """p = B ((rho/rho0)^7 - 1), 2^7 = 128; negative values become zero, small positive ones remain."""
    fluid = sph.Fluid(1000.0, 100.0, 7, 1)
    three = cases.Case("three", 3, np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 2.0, 0.0]]))
    small = 100 * (1.0009765625**7 - 1)
    return cases.Exact(
        three, {"density": [2000.0, 500.0, 1000.9765625], "fluid": fluid}, {"pressure": [12700.0, 0.0, small]}
    )


@for_each_kernel("sph.pressure", "sph.momentum", "sph.central_momentum", dims=(2, 3), across=6.0)
def pressed_pair(w):
    """Equal pressures p push two particles apart with 2 (m_j p/rho^2) |W'(h/2)|, here 6 p/rho^2 on the first."""
    push = 2 * 200.0 / 1000.0**2 * w.slope * (w.pair.position[1] - w.pair.position[0])
    return cases.Exact(w.pair, AT_REST | {"pressure": np.full(2, 200.0)}, {"acceleration": [-3 * push, 2 * push]})


@for_each_kernel("sph.pressure")
def pressed_against_a_wall(w):
    """One wall particle below: a = 2 rho0 V_b (p/rho^2) |W'(h/2)| upwards, half of it as printed (Jiang & Zhu E24)."""
    case = cases.at("on_wall", [0, 0, 0], [[0.0, -1.0, 0.0]])
    walls = WallParticles(case.wall_position, np.array([0.25]))
    push = 2 * 1000 * 0.25 * 200.0 / 900.0**2 * w.slope
    inputs = {
        "mass": [2.0], "density": [900.0], "pressure": [200.0], "velocity": np.zeros((1, 3)), "fluid": WATER,
        "walls": walls,
    }  # fmt: skip
    return cases.Exact(case, inputs, {"acceleration": [[0.0, push, 0.0]]})


@cases.closed_form("sph.momentum", "sph.viscosity", across=6.0)
def sheared_pair():
    """Viscosity mu m_j/(rho_i rho_j) 45/(pi h^6) (h - r) (v_j - v_i) reduces the difference of velocities."""
    factor = 0.5 / 1000.0**2 * 45 / (math.pi * 64)
    inputs = AT_REST | {"velocity": [[1.0, 0.0, 0.0], [-1.0, 0.0, 4.0]], "viscosity": sph.ViscosityTerm(0.5)}
    return cases.Exact(PAIR, inputs, {"acceleration": factor * np.array([[-6.0, 0.0, 12.0], [4.0, 0.0, -8.0]])})


@for_each_kernel("sph.gradient_correction", dims=(2,))
def filled_in_the_plane(w):
    """Two neighbours at h/2 along x, two of less mass along y: M = diag(1.4, 0.56). The others see less: I."""
    place = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    case = cases.at("cross", place, dim=2)
    density = np.array([1000.0, 500.0, 500.0, 1000.0, 1000.0])
    a, b = 1.4, 0.56
    mass = density * np.array([0.002, a, a, b, b]) / (2 * w.slope)
    share = (a * b - 0.5) / 0.3
    assert 0 < share < 1
    diagonal = np.ones((5, 3))
    diagonal[0, :2] = 1 + share * (1 / a - 1), 1 + share * (1 / b - 1)
    inputs = {"mass": mass, "density": density, "walls": None}
    return cases.Exact(case, inputs, {"correction_diagonal": diagonal, "correction_mixed": np.zeros((5, 3))})


@cases.closed_form("sph.own_pressure")
def turned():
    """Of a negative pressure inside; not of one at the surface, nor of a small positive one."""
    inputs = {"pressure": np.array([-3.0, -3.0, 0.5]), "near_surface": np.array([0, 1, 0], np.uint8)}
    return cases.Exact(cases.at("turned", np.eye(3)), inputs, {"own_pressure": [3.0, -3.0, 0.5]})


@for_each_kernel("sph.corrected_pressure")
def pushed_askew(w):
    """B_1 = I, B_2 turns y into (1, 3, 2): along (0.5, 2, 1) by V_j (q_i + p_j) |W'(h/2)|/rho_i."""
    push = w.slope * np.array([2.0 * (50.0 + 300.0) / 1000.0, 4.0 * (-100.0 + 200.0) / 500.0])
    inputs = {
        "mass": [4000.0, 1000.0], "density": [1000.0, 500.0], "fluid": WATER, "pressure": [200.0, 300.0],
        "own_pressure": [50.0, -100.0], "correction_diagonal": [[1.0, 1.0, 1.0], [9.0, 3.0, 9.0]],
        "correction_mixed": [[0.0, 0.0, 0.0], [1.0, 9.0, 2.0]],
    }  # fmt: skip
    return cases.Exact(PAIR, inputs, {"acceleration": push[:, None] * np.array([[-0.5, -2.0, -1.0], [0.5, 2.0, 1.0]])})


@cases.closed_form("sph.central_viscosity", "sph.central_momentum", across=6.0)
def braked_along_the_line():
    """Of v_2 - v_1 = (1, 4, 0) the part along y counts: a_1 = 2 k V_2 F/rho_1 (0, 4, 0), F = 45/(2 pi h^5) (1 - q)."""
    factor = 2 * 2.5 / 1000.0**2 * 45 / (2 * math.pi * 32) * 0.5
    friction = {"central_viscosity": sph.CentralViscosity(2.5)}
    inputs = AT_REST | friction | {"velocity": [[1.0, -1.0, 0.0], [2.0, 3.0, 0.0]]}
    return cases.Exact(PAIR, inputs, {"acceleration": factor * np.array([[0.0, 12.0, 0.0], [0.0, -8.0, 0.0]])})


@cases.closed_form("sph.central_viscosity")
def braked_in_the_plane():
    """Oblique in 2D: e_21 = (0.6, 0.8), e.(v_2 - v_1) = 5, F = 20/(pi h^4) (1 - q)."""
    factor = 2 * 2.0 / (1000.0 * 500.0) * 20 / (math.pi * 16) * 0.5
    friction = {"central_viscosity": sph.CentralViscosity(2.0)}
    inputs = AT_REST | friction | {"density": [1000.0, 500.0], "velocity": [[0.0, 0.0, 0.0], [3.0, 4.0, 0.0]]}
    return cases.Exact(FLAT_PAIR, inputs, {"acceleration": factor * 5 * np.array([[1.8, 2.4, 0.0], [-1.2, -1.6, 0.0]])})


for_each_kernel(  # as in space, 5 m apart in a periodic box of 6 m
    "sph.density", two_particles_across_a_border=lambda w: cases.across_a_border(two_particles(w), 6.0, walls=None)
)
cases.closed_form(
    "sph.gravity",
    falling=lambda: cases.Exact(PAIR, {"field": [0.0, 2.0, -9.75]}, {"acceleration": [[0.0, 2.0, -9.75]] * 2}),
)


@cases.closed_form("sph.extremes")
def largest_squares():
    """3-4-5 triangles; the second temperature lies 5 K below a range from -5 to 9 deg C."""
    inputs = {
        "velocity": [[3.0, 4.0, 0.0], [1.0, 0.0, 0.0]], "acceleration": [[0.0, 0.0, 1.0], [0.0, 5.0, 12.0]],
        "temperature": [12.0, -10.0], "temperature_range": [-5.0, 9.0], "exchange_rate": [0.25, 0.5],
        "density": [1101.0, 1502.0], "rest_density": None, "density_bounds": sph.DensityBounds(1000.0, 1.1, 1.5),
    }  # fmt: skip
    return cases.Exact(PAIR, inputs, {"extremes": [25.0, 169.0, 0.0, 0.5, 5.0, 2.0, 1.0]})


@cases.closed_form("sph.extremes")
def densities_of_two_substances():
    """1.2 and 1.08 times the own rest density: the second particle is denser than the first bound of the liquid."""
    nothing = {"temperature": None, "temperature_range": None, "exchange_rate": None}
    inputs = nothing | {
        "velocity": np.zeros((2, 3)), "acceleration": np.zeros((2, 3)), "density": [600.0, 1620.0],
        "rest_density": [500.0, 1500.0], "density_bounds": sph.DensityBounds(1000.0, 1.1, 1.5),
    }  # fmt: skip
    return cases.Exact(PAIR, inputs, {"extremes": [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]})


# Up to 1e4 spacings from the origin, where single precision resolves no step
cases.hard_input("slow_and_far", 3, lambda: cases.cloud("slow_and_far", 80, 3) + [1000.0, -300.0, 1.0])


@cases.closed_form("sph.kick_drift")
def carried_on():
    """A shift by 2^-40 m is nothing beside 2^20 m in both precisions: all of it stays in the residual."""
    position = np.array([[2.0**20, -(2.0**20), 0.0]])
    return cases.Exact(
        cases.at("carried_on", position),
        {
            "velocity": [[2.0**-40, 2.0**-40, 0.5]], "acceleration": np.zeros((1, 3)),
            "position_residual": [[2.0**-40, -(2.0**-39), 0.0]], "build_position": position,
            "timestep": [1.0, 1.0], "way": None, "longest_shift": None, "drawn_body": None, "bounds": None,
        },
        {
            "position": position + [0.0, 0.0, 0.5], "velocity": [[2.0**-40, 2.0**-40, 0.5]],
            "position_residual": [[2.0**-39, -(2.0**-40), 0.0]], "displacement": [0.25, 0.0, 0.0],
        },
    )  # fmt: skip


def _leapt(position, after, displacement, **given):
    """The pair after a kick of 0.5 s and a drift of 0.25 s; without acceleration unless given otherwise."""
    inputs = {
        "acceleration": np.zeros((2, 3)), "build_position": PAIR.position, "timestep": [0.5, 0.25], "way": None,
        "longest_shift": None, "drawn_body": None, "bounds": None,
    }  # fmt: skip
    expected = {"velocity": [after, [0.0] * 3], "position": position, "displacement": displacement}
    return cases.Exact(PAIR, inputs | given, expected)


@cases.closed_form("sph.kick_drift")
def one_leap():
    """v = 1 + 0.5 * 2, x = 0 + 0.25 * v; the second particle, at rest, is 2 m from its position at the list's build."""
    return _leapt(
        [[0.5, 0.0, 0.0], [0.0, 1.0, 0.0]], [2.0, 0.0, 0.0], [4.0, 0.0, 0.0],
        velocity=[[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]],
        acceleration=[[2.0, 0.0, 0.0], [0.0, 0.0, 0.0]], build_position=[[0.0, 0.0, 0.0], [0.0, 1.0, 2.0]],
    )  # fmt: skip


@cases.closed_form("sph.kick_drift")
def shifted():
    """x = 0.25 * 2 + 0.125, and -0.5 for the second particle, which is at rest."""
    return _leapt(
        [[0.625, 0.0, 0.0], [0.0, 0.5, 0.0]], [2.0, 0.0, 0.0], [0.390625, 0.0, 0.25],
        velocity=[[2.0, 0.0, 0.0], [0.0, 0.0, 0.0]], way=[[0.25, 0.0, 0.0], [0.0, -0.5, 0.0]],
        longest_shift=[0.5, 1.0], drawn_body=np.array([0, 1], np.int32),
    )  # fmt: skip


@cases.closed_form("sph.kick_drift")
def stopped_by_a_plane():
    """The first particle would pass the plane x = 0.25: it stops there and loses its normal velocity."""
    far = np.full(3, np.inf)
    return _leapt(
        [[0.25, 0.25, 0.0], [0.0, 1.0, 0.0]], [0.0, 1.0, 0.0], [0.125, 1.0, 0.0],
        velocity=[[2.0, 1.0, 0.0], [0.0, 0.0, 0.0]], bounds=planes(-far, [0.25, np.inf, np.inf]),
    )  # fmt: skip
