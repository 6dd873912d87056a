"""Host code against numbers computed here: reports, energies, step limits, initial values, ledgers.

Parameter groups are computed anew in tests/ladder/test_parameters.py. Nothing is compiled.
"""

import itertools
import math
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

import refsim as rs
from refsim import make_plan
from refsim.backends.tuples import determinant
from refsim.core.capabilities import BalancesCohesion
from refsim.core.effect import Discretisation, Extremes, InitialState, StepLimit
from refsim.engine.conserved_totals import conserved_totals
from refsim.engine.limits import stable_steps, step_limits
from refsim.engine.stepping import check_extremes
from refsim.heat import enthalpy_of, temperature_at
from refsim.heat.shapes import lattice_sum
from refsim.mpm import LARGEST_VOLUME, LEAST_VOLUME
from refsim.scene.particles import lattice_mass
from refsim.sph import DensityBounds, lattice_number_density
from refsim.surface_energy.effect import CROWDED, OVERFULL
from refsim.surface_tension.cohesion import capillary_limit, compression
from refsim.surface_tension.normal_difference_2014 import stiffest_wave

H, SPACING = 0.21, 0.1
LIQUID = rs.WeaklyCompressible(sound_speed=13.0, rest_density=900.0, dynamic_viscosity=0.7, density="summation")
GRAVITY = rs.Gravity(acceleration=(1.0, -2.0, -9.0))


def grid(dim=3, **options):
    given = {"dim": dim, "dtype": "float64", "spacing": SPACING, "support_radius": H, "count": 3}
    return Discretisation(**given | options)


def named(*effects):
    return {effect.name: effect for effect in effects}


def near(value, relative=1e-12):
    return pytest.approx(value, rel=relative, abs=1e-300)


class Balanced(BalancesCohesion):
    """An effect whose cohesion the equation of state balances by 700 Pa."""

    name = "balanced"

    def balanced_pressure(self, grid, others):
        return 700.0

    def replaces(self):
        return ()


def fields(**values):
    return lambda name: np.array(values[name])


# Reports
def test_reports_sum_mass_momenta_and_energies():
    place = [[0.3, 0.1, -0.4], [1.2, 0.8, 0.9]]
    velocity = [[1.0, -2.0, 0.5], [0.25, 3.0, -4.0]]
    cloud = rs.Cloud(position=place, velocity=velocity, mass=[2.0, 5.0])
    walls = rs.BoxWalls(lower=(0.0, 0.0, -1.0), upper=(2.0, 2.0, 2.0), open_faces=("-x",))
    made = rs.Scene(
        spacing=SPACING, support_radius=H, fluid=(cloud,), effects=(LIQUID, GRAVITY, walls), dtype="float64"
    )  # fmt: skip
    plan = make_plan(made)
    simulation = rs.Simulation(plan, "numpy")
    for found in (conserved_totals(plan), conserved_totals(simulation)):
        assert (found["particles"], found["mass"], found["momentum"]) == (2, 7.0, near([3.25, 11.0, -19.0]))
        spins = [2 * (0.1 * 0.5 - 0.4 * 2), 2 * (-0.4 * 1 - 0.3 * 0.5), 2 * (-0.3 * 2 - 0.1)]
        others = [5 * (-0.8 * 4 - 0.9 * 3), 5 * (0.9 * 0.25 + 1.2 * 4), 5 * (1.2 * 3 - 0.8 * 0.25)]
        assert found["angular_momentum"] == near([a + b for a, b in zip(spins, others)])
        assert found["kinetic_energy"] == near(5.25 + 2.5 * 25.0625)
        assert found["greatest_speed"] == near(math.sqrt(25.0625))
        heights = [2 * (9 * -0.4 + 2 * 0.1 - 0.3), 5 * (9 * 0.9 + 2 * 0.8 - 1.2)]  # m g z, up is plus
        assert (found["potential_energy"], found["outside_walls"]) == (near(sum(heights)), 0)
        assert "effects" not in found
    simulation.fields["position"][0, 1] = 2.5  # above the upper wall
    assert conserved_totals(simulation)["outside_walls"] == 1
    simulation.fields["position"][0, 2] = 2.5  # along another axis, too: one particle
    assert conserved_totals(simulation)["outside_walls"] == 1
    simulation.fields["position"][1, 2] = -1.5  # below the lower one
    assert conserved_totals(simulation)["outside_walls"] == 2
    simulation.fields["position"][...] = [[0.0, 2.0, -1.0], [2.0, 0.0, 2.0]]  # on the walls is not behind them
    assert conserved_totals(simulation)["outside_walls"] == 0


def test_reports_leave_out_what_a_scene_has_not():
    found = conserved_totals(
        make_plan(rs.Scene(spacing=SPACING, support_radius=H, fluid=(rs.Box(cells=(2, 1, 1)),), effects=(LIQUID,)))
    )
    assert (found["outside_walls"], found["greatest_speed"]) == (0, 0.0)
    assert not {"potential_energy", "effects"} & set(found)


def test_reports_take_what_effects_keep_account_of():
    heat = rs.HeatConduction(temperature=3.0, heat_capacity=5.0)
    cube = rs.Scene(spacing=0.5, support_radius=1.1, fluid=(rs.Box(cells=(2, 2, 1)),), effects=(heat,), dim=2)
    found = conserved_totals(make_plan(cube))
    assert found["effects"] == {"heat_conduction": {"heat": near(4 * 1000 * 0.25 * 15, 1e-6)}}
    literal = rs.HeatConduction(temperature=3.0, literal=("M11",), scheme="explicit")
    cube = rs.Scene(spacing=0.5, support_radius=1.1, fluid=(rs.Box(cells=(2, 2, 1)),), effects=(literal,), dim=2)
    assert conserved_totals(make_plan(cube))["effects"]["heat_conduction"]["heat"] == near(4 * 0.25 * 3.0, 1e-6)


# Step limits
def test_steps_by_what_particles_do():
    seen = Extremes(speed=3.0, acceleration=8.0, rate=5.0)
    assert (StepLimit.constant(0.25).at(seen), StepLimit.crossing(2.0, 1.0).at(seen)) == (0.25, 0.5)
    assert (StepLimit.falling(2.0).at(seen), StepLimit.exchanging(2.0).at(seen)) == (0.5, near(0.4))
    assert StepLimit(2.0, 1.0, 2.0, 3.0, 4.0).at(seen) == near(2.0 / (1 + 6 + 12 + 20))
    still = Extremes(speed=0.0, acceleration=0.0)
    assert StepLimit.crossing(2.0).at(still) == math.inf
    limits = {"a": StepLimit.constant(0.25), "b": StepLimit.falling(2.0)}
    assert stable_steps(limits, still) == {"a": 0.25}


def test_steps_of_a_plan_always_have_a_limit():
    def plan(*effects, end_time=None):
        scene = SimpleNamespace(end_time=end_time, motion=())
        return SimpleNamespace(grid=grid(), effects=named(*effects), scene=scene)

    moving = StepLimit.crossing(SPACING / 2)  # where no effect names a limit by the speed
    falling = {"force": StepLimit.falling(H / 32), "motion": moving}
    assert step_limits(plan()) == falling | {"resting": StepLimit.constant(1.0)}
    slow = rs.MpmLiquid(bulk_modulus=1e-6)
    assert set(step_limits(plan(slow))) == {"force", "acoustic", "advection", "resting"}
    assert set(step_limits(plan(slow, end_time=1e4))) == {"force", "acoustic", "advection"}
    assert step_limits(plan(end_time=7.0))["resting"] == StepLimit.constant(7.0)
    assert set(step_limits(plan(LIQUID))) == {"force", "acoustic", "viscous"}
    fall = StepLimit.falling(H / 32).at(Extremes(speed=0.0, acceleration=9.81))
    assert fall == near(0.25 * math.sqrt(H / 2 / 9.81))


def test_steps_of_the_weakly_compressible_liquid():
    """Acoustic: 0.4 h/(c + |v|); viscous: (h/2)^2 rho0/(8 mu), a third along the line of centres."""
    found = LIQUID.step_limits(grid(), named(LIQUID))
    assert set(found) == {"acoustic", "viscous"}
    assert found["acoustic"].at(Extremes(speed=2.0, acceleration=0.0)) == near(0.4 * 0.21 / 15)
    assert found["viscous"].at(Extremes(speed=2.0, acceleration=0.0)) == near(0.105**2 * 900 / 0.7 / 8)
    central = rs.WeaklyCompressible(
        sound_speed=13.0, rest_density=900.0, dynamic_viscosity=0.7, viscosity="central", density="summation"
    )
    assert central.step_limits(grid(), named(central))["viscous"].length == near(0.105**2 * 900 / 0.7 / 24)
    stiffened = LIQUID.step_limits(grid(), named(LIQUID, Balanced()))["acoustic"]
    assert stiffened.speed == near(math.sqrt(169 + 1400 / 900))
    assert set(LIQUID.step_limits(grid(), named(LIQUID, rs.ImplicitPressure()))) == {"viscous"}
    thin = rs.WeaklyCompressible(sound_speed=13.0, density="summation")
    assert set(thin.step_limits(grid(), named(thin))) == {"acoustic"}
    solver = rs.ImplicitPressure(courant=0.3)
    assert solver.step_limits(grid(), {}) == {"courant": (near(0.063), 0.0, 1.0, 0.0, 0.0)}


def test_steps_beside_solids():
    """As the liquid's, with the lightest substance."""
    light = SimpleNamespace(bodies=(SimpleNamespace(density=500.0), SimpleNamespace(density=2000.0)))
    found = rs.TwoWayCoupling().step_limits(grid(solids=light), named(LIQUID))
    assert found["acoustic"] == (near(0.4 * 0.21), 13.0, 1.0, 0.0, 0.0)
    assert found["viscous"] == (near(0.105**2 * 500 / 0.7 / 8), 1.0, 0.0, 0.0, 0.0)
    assert set(rs.TwoWayCoupling().step_limits(grid(), named(LIQUID))) == {"acoustic"}
    thin = rs.WeaklyCompressible(sound_speed=13.0, density="summation")
    assert set(rs.TwoWayCoupling().step_limits(grid(solids=light), named(thin))) == {"acoustic"}
    mesh = rs.MeshBoundary(file="none", viscosity=0.6)
    assert mesh.step_limits(grid(), named(LIQUID)) == {"wall friction": (near(0.105**2 * 900 / 0.6 / 8), 1, 0, 0, 0)}
    assert rs.MeshBoundary(file="none").step_limits(grid(), named(LIQUID)) == {}


def test_steps_with_tension():
    """0.25 sqrt(rho0 (h/2)^3/(2 pi sigma)); that of the normals by its stiffest wave."""
    wanted = 0.25 * math.sqrt(900 * 0.105**3 / (2 * math.pi * 0.07))
    assert capillary_limit(0.07, grid(), named(LIQUID)) == {"capillary": (near(wanted), 1.0, 0.0, 0.0, 0.0)}
    assert capillary_limit(0.0, grid(), named(LIQUID)) == {}
    effect = rs.BeckerTeschner2007(kappa=2.0)
    sigma = effect.nominal_tension(grid(), named(LIQUID))
    assert effect.step_limits(grid(), named(LIQUID)) == capillary_limit(sigma, grid(), named(LIQUID)) != {}
    assert rs.NormalDifference2014(area_acceleration=0.0).step_limits(grid(), named(LIQUID)) == {}
    found = {}
    for strength in (1.0, 4.0):
        effect = rs.NormalDifference2014(area_acceleration=strength)
        found[strength] = effect.step_limits(grid(), named(LIQUID))["normal_tension"].length
    assert found[1.0] == near(2 * found[4.0])
    wave = stiffest_wave("wendland_c2", 2.1, 3)  # omega^2 d/gamma; half of the step 2/omega
    assert found[4.0] == near(1 / math.sqrt(wave * 4.0 / 0.1))
    mueller = msgspec.structs.replace(LIQUID, kernels="mueller")  # poly6, and spiky for its gradient
    own = effect.step_limits(grid(), named(mueller))["normal_tension"].length
    assert own == near(1 / math.sqrt(stiffest_wave("spiky", 2.1, 3) * 4.0 / 0.1))


def test_steps_of_conduction():
    """number d^2 rho c/k; the largest k, the smallest c and the lightest substance."""
    heat = rs.HeatConduction(conductivity=(0.6, 2.0), heat_capacity=(4000.0, 500.0), largest_number=7.0)
    assert heat.greatest_diffusivity(grid(), named(LIQUID)) == near(2.0 / (900 * 500))
    assert heat.greatest_diffusivity(grid(), {}) == near(2.0 / (1000 * 500))
    ice = SimpleNamespace(of_bodies=lambda name: {"density": np.array([800.0, 950.0])}[name])
    assert heat.greatest_diffusivity(grid(solids=ice), named(LIQUID)) == near(2.0 / (800 * 500))
    found = heat.step_limits(grid(), named(LIQUID))
    assert found == {"conduction": (near(7 * 0.01 * 900 * 500 / 2.0), 1, 0, 0, 0)}
    printed = rs.HeatConduction(conductivity=(0.6, 2.0), scheme="explicit", literal=("M11",))
    assert printed.greatest_diffusivity(grid(), named(LIQUID)) == 2.0
    assert rs.HeatConduction(conductivity=0.0).step_limits(grid(), named(LIQUID)) == {}
    explicit = rs.HeatConduction(conductivity=2.0, heat_capacity=500.0, scheme="explicit", largest_number=7.0)
    found = explicit.step_limits(grid(), named(LIQUID))
    each = lattice_sum(explicit.conduction(grid()), grid())
    assert (found["exchange"].length, found["exchange"].rate_share) == (near(1.0), 1.0)
    assert found["conduction"].length == near(0.01 * 900 * 500 / 2.0 / each)
    for largest, number in ((7.0, 3.0), (2.0, 2.0)):
        legendre = rs.HeatConduction(
            conductivity=2.0, heat_capacity=500.0, scheme="runge_kutta_legendre", largest_number=largest,
            melting_point=0.0, latent_heat=1.0,
        )  # fmt: skip
        found = legendre.step_limits(grid(), named(LIQUID))
        assert found["conduction"].length == near(number * 0.01 * 900 * 500 / 2.0)
        assert found["exchange"].length == near(3.0 * lattice_sum(legendre.conduction(grid()), grid()))


def test_steps_of_the_grid_liquid():
    """a h/(c + |v|), 0.3 h/|v|, rho0 h^2/(16 mu), sqrt(0.3 h/|g|)."""
    liquid = rs.MpmLiquid(
        bulk_modulus=3600.0, rest_density=900.0, cell_size=0.3, dynamic_viscosity=0.7, acoustic_number=0.4
    )
    assert liquid.sound_speed() == 2.0
    found = liquid.step_limits(grid(), named(liquid, rs.Gravity(acceleration=(0.1, -0.2, 0.2))))
    assert found == {
        "acoustic": (near(0.12), 2.0, 1.0, 0.0, 0.0), "advection": (near(0.09), 0.0, 1.0, 0.0, 0.0),
        "viscous": (near(900 * 0.09 / (16 * 0.7)), 1.0, 0.0, 0.0, 0.0),
        "gravity": (near(math.sqrt(0.09 / 0.3)), 1.0, 0.0, 0.0, 0.0),
    }  # fmt: skip
    plain = rs.MpmLiquid(bulk_modulus=3600.0)
    assert set(plain.step_limits(grid(), named(plain))) == {"acoustic", "advection"}
    weightless = rs.Gravity(acceleration=(0.0, 0.0, 0.0))
    assert set(plain.step_limits(grid(), named(plain, weightless))) == {"acoustic", "advection"}


def test_steps_of_the_grid_liquids_surface():
    """b sqrt(rho0 h^3/(2 pi k)); for a surface at r also 0.08 (soft: 0.03) min(h/c, sqrt(...))."""
    others = named(rs.MpmLiquid(bulk_modulus=3600.0, rest_density=900.0, cell_size=0.3))

    def found(**options):
        limits = rs.SurfaceEnergy(**options).step_limits(grid(), others)
        return {name: limit.length for name, limit in limits.items()}

    def period(tension):
        return math.sqrt(900 * 0.027 / (2 * math.pi * tension))

    assert found(surface_tension=0.0) == {}
    assert found(surface_tension=2.0, capillary_number=0.4) == {"capillary": near(0.4 * period(2.0))}
    assert set(found(surface_tension=2.0, inset=-1.0)) == {"capillary"}
    alone = found(surface_tension=2.0, inset=-1.0, embedding="none")
    assert alone["surface_at_r"] == near(0.08 * 0.3 / 2.0)
    assert set(found(surface_tension=107.0, inset=-1.0)) == {"capillary"}
    for tension in (109.0, 900.0):  # beyond 0.1 lambda h = 108
        soft = found(surface_tension=tension, inset=-1.0)
        assert soft["surface_at_r"] == near(0.03 * min(0.15, period(tension)))
    assert set(found(surface_tension=900.0)) == {"capillary"}


# Initial values
def test_start_of_a_solid_is_its_rigid_motion():
    """v + omega x (x - x_c), the mass of its substance; about +z a point at +x moves to +y."""
    boxes = (
        rs.SolidBox(lower=(0.0, 0.0, 0.0), upper=(0.4, 0.2, 0.2), spin=(0.0, 0.0, 3.0), density=500.0),
        rs.SolidBox(lower=(1.0, 0.0, 0.0), upper=(1.3, 0.2, 0.2), velocity=(1.0, 2.0, 3.0), spin=(2.0, 0.0, -1.0)),
    )
    made = rs.Scene(
        spacing=SPACING, support_radius=H, dtype="float64", fluid=(rs.Box(lower=(2.0, 0.0, 0.0), cells=(1, 1, 1)),),
        solid=boxes, effects=(LIQUID, rs.ShapeMatching(), rs.TwoWayCoupling()),
    )  # fmt: skip
    plan = make_plan(made)
    state = plan.state
    assert state.sizes == (16, 12, 1)
    x, v = state.position, state.velocity
    first, second = slice(0, 16), slice(16, 28)
    assert sorted({round(c, 9) for c in x[first, 0]}) == [0.05, 0.15, 0.25, 0.35]
    assert (v[first, 0], v[first, 1]) == (near(-3.0 * (x[first, 1] - 0.1)), near(3.0 * (x[first, 0] - 0.2)))
    assert not v[first, 2].any()
    away = x[second] - [1.15, 0.1, 0.1]
    assert (v[second, 0], v[second, 1]) == (near(1.0 + away[:, 1]), near(2.0 - away[:, 0] - 2 * away[:, 2]))
    assert v[second, 2] == near(3.0 + 2 * away[:, 1])
    volume = 1 / LIQUID.rest_number_density(plan.grid)
    assert (state.mass[first], state.mass[second]) == (near(500.0 * volume), near(917.0 * volume))
    assert state.values["rest_density"].tolist() == [500.0] * 16 + [917.0] * 12 + [900.0]
    assert state.values["phase"].tolist() == [1] * 28 + [0]
    assert (state.values["rotation"] == [1.0, 0.0, 0.0, 0.0]).all()
    assert len(state.values["rotation"]) == 28
    loose = rs.ShapeMatching(stiffness=0.0, damping=0.0)
    assert set(loose.initial(plan.grid, state, {})) == {"phase"}
    pulled = rs.ShapeMatching(stiffness=1.0, damping=0.0).initial(plan.grid, state, {})
    assert set(pulled) == {"phase", "rotation"}
    assert rs.TwoWayCoupling().initial(grid(), state, named(LIQUID))["rest_density"].tolist() == [900.0] * 3


def test_start_of_a_solid_without_a_liquid_fills_the_lattice():
    body = rs.SolidBox(lower=(0.0, 0.0, 0.0), upper=(0.2, 0.2, 0.2), density=500.0)
    made = rs.Scene(spacing=SPACING, support_radius=H, fluid=(), solid=(body,), effects=(rs.ShapeMatching(),))
    assert make_plan(made).state.mass == near(0.5)
    heavier = rs.SolidBox(lower=(0.0, 0.0, 0.0), upper=(0.2, 0.2, 0.2), density=500.0, mass=4.2)
    assert make_plan(made.with_(solid=(heavier,))).state.mass == near(4.2 / 8)
    with pytest.raises(rs.InputError, match="nothing holds its solids together"):
        make_plan(rs.Scene(spacing=SPACING, support_radius=H, fluid=(), solid=(body,), effects=(LIQUID,)))


def test_start_of_round_bodies():
    """Points just inside and just outside of a ball and of a ring, along its axis and across."""
    ball = rs.SolidBall(center=(1.0, 2.0, 3.0), radius=0.5)
    for away in np.eye(3):
        points = np.array([[1.0, 2.0, 3.0] + s * away for s in (0.499, -0.499, 0.501, -0.501)])
        assert ball.inside(points).tolist() == [True, True, False, False]
    assert np.array(ball.extent()).tolist() == [[0.5, 1.5, 2.5], [1.5, 2.5, 3.5]]
    ring = rs.SolidTorus(center=(1.0, 2.0, 3.0), radius=0.5, tube_radius=0.125, axis=(0.0, 3.0, 0.0))
    assert np.array(ring.extent()).tolist() == [[0.375, 1.375, 2.375], [1.625, 2.625, 3.625]]
    for x, y, own in (
        (0.0, 0.0, False), (0.374, 0.0, False), (0.376, 0.0, True), (0.624, 0.0, True), (0.626, 0.0, False),
        (0.5, 0.124, True), (0.5, -0.124, True), (0.5, 0.126, False), (0.59, 0.08, True), (0.59, 0.09, False),
    ):  # fmt: skip
        for across in ([1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.6, 0.0, 0.8]):
            point = np.array([1.0, 2.0, 3.0]) + x * np.array(across) + [0.0, y, 0.0]
            assert ring.inside(point[None]).tolist() == [own]
    for dim, words in ((2, "4e\\+10"), (3, "8e\\+15")):
        with pytest.raises(rs.InputError, match=words):
            rs.Ball(radius=1e4).positions(grid(dim))
    exact = rs.Ball(radius=0.5).positions(grid(2, spacing=1.0))
    assert (len(exact), len(rs.Ball(radius=5.0).positions(grid(2, spacing=2.0)))) == (0, 16)


def test_start_of_lattice_masses():
    """rho0 over the lattice's number density; rho d^dim on a background grid and for heat alone."""
    for dim in (2, 3):
        steps = np.arange(-3, 4) * SPACING
        axes = [steps, steps, steps if dim == 3 else [0.0]]
        r = np.sqrt(sum(a**2 for a in np.meshgrid(*axes))).ravel() / H
        r = r[r < 1]
        norm = {2: 7 / math.pi, 3: 21 / (2 * math.pi)}[dim] / H**dim
        number = norm * ((1 - r) ** 4 * (1 + 4 * r)).sum()
        assert lattice_number_density("wendland_c2", H, SPACING, dim) == near(number)
        assert LIQUID.particle_volume(grid(dim)) == near(1 / number)
        assert LIQUID.particle_mass(grid(dim)) == near(900 / number)
        assert rs.MpmLiquid(bulk_modulus=1.0, rest_density=700.0).particle_mass(grid(dim)) == near(700 * 0.1**dim)
        assert rs.HeatConduction(density=600.0).particle_mass(grid(dim)) == near(600 * 0.1**dim)
    assert lattice_mass(grid(), {}) == 1.0
    heat = rs.HeatConduction()
    assert lattice_mass(grid(), named(heat)) == heat.particle_mass(grid())
    assert lattice_mass(grid(), named(heat, LIQUID)) == LIQUID.particle_mass(grid())
    assert lattice_mass(grid(), named(LIQUID, heat)) == LIQUID.particle_mass(grid())


def test_start_of_the_grid_liquid():
    three = InitialState(np.zeros((3, 3)), np.zeros((3, 3)), np.ones(3), (3,))
    found = rs.MpmLiquid(bulk_modulus=1.0, initial_ratio=0.9).initial(grid(), three, {})
    assert (set(found), found["volume_ratio"].tolist()) == ({"volume_ratio", "step_extremes"}, [0.9] * 3)
    assert found["step_extremes"].tolist() == [0.9, 0.9, 0.0, 0.0]
    for dim in (2, 3):
        liquid = rs.MpmLiquid(bulk_modulus=1.0, initial_ratio=0.9, volume="gradient", literal=("M13",))
        found = liquid.initial(grid(dim), three, {})
        side = 0.9 ** (1 / dim)
        assert found["deformation"] == near(np.tile(np.diag([side, side, side if dim == 3 else 1.0]).ravel(), (3, 1)))
        assert found["affine"].tolist() == np.tile(np.diag([1.0, 1.0, float(dim == 3)]).ravel(), (3, 1)).tolist()
    edge = (2**20 - 18) * 0.2  # cells of two spacings
    for reach, out in ((edge * (1 - 1e-9), False), (edge * (1 + 1e-9), True), (-edge * (1 + 1e-9), True)):
        place = np.zeros((3, 3))
        place[1, 2] = reach
        state = InitialState(place, place, np.ones(3), (3,))
        if out:
            with pytest.raises(rs.InputError, match="particle 1 is outside the background grid"):
                rs.MpmLiquid(bulk_modulus=1.0).initial(grid(), state, {})
        else:
            rs.MpmLiquid(bulk_modulus=1.0).initial(grid(), state, {})


def test_start_of_enthalpy_and_temperature():
    """Solid up to and at the melting point, where H = 0; liquid from L on."""
    t = np.array([-3.0, 5.0, 5.0 + 1e-12, 9.0])
    h = enthalpy_of(t, np.full(4, 2.0), np.full(4, 5.0), np.full(4, 30.0))
    assert h == near([-16.0, 0.0, 30.0 + 2 * (t[2] - 5.0), 38.0])
    back = temperature_at(np.array([-16.0, 0.0, 15.0, 30.0, 38.0]), 2.0, 5.0, 30.0)
    assert back.tolist() == [-3.0, 5.0, 5.0, 5.0, 9.0]


def test_start_of_heat():
    four = InitialState(np.zeros((4, 3)), np.zeros((4, 3)), np.ones(4), (1, 3))
    heat = rs.HeatConduction(temperature=(-10.0, 30.0), conductivity=0.5, heat_capacity=(2.0, 4.0), held=(1,))
    found = heat.initial(grid(count=4), four, {})
    assert found["temperature"].tolist() == [-10.0, 30.0, 30.0, 30.0]
    assert (found["heat_capacity"].tolist(), found["conductivity"].tolist()) == ([2.0, 4.0, 4.0, 4.0], [0.5] * 4)
    assert (found["reservoir"].tolist(), found["volume"]) == ([0, 1, 1, 1], near([0.001] * 4))
    spare = 0.1 * 40 + 4096 * 2.0**-52 * 30
    assert found["temperature_range"] == near([-10 - spare, 30 + spare], 1e-15)
    cold = rs.HeatConduction(temperature=(-30.0, 10.0), conductivity=0.5, scheme="explicit")
    spare = 0.01 * 40 + 4096 * 2.0**-52 * 30
    assert cold.initial(grid(count=4), four, {})["temperature_range"] == near([-30 - spare, 10 + spare], 1e-15)
    assert "volume" not in cold.initial(grid(count=4), four, named(LIQUID))
    assert set(rs.HeatConduction(conductivity=0.0).initial(grid(count=4), four, {})) == {"temperature", "heat_capacity"}
    printed = rs.HeatConduction(temperature=(-30.0, 10.0), scheme="explicit", literal=("M9",))
    spare = 40 + 4096 * 2.0**-52 * 30
    assert printed.initial(grid(count=4), four, {})["temperature_range"] == near([-30 - spare, 10 + spare], 1e-15)
    each = rs.HeatConduction(temperature=(1.0, 2.0, 3.0, 4.0)).of_particles("temperature", four)
    assert each.tolist() == [1.0, 2.0, 3.0, 4.0]
    with pytest.raises(rs.InputError, match="3 numbers for 2 parts and 4 particles"):
        rs.HeatConduction(temperature=(1.0, 2.0, 3.0)).of_particles("temperature", four)
    for number in (-1, 2):
        with pytest.raises(rs.InputError, match="give numbers from 0 to 1"):
            rs.HeatConduction(held=(number,)).initial(grid(count=4), four, {})
    first = rs.HeatConduction(held=(0,)).initial(grid(count=4), four, {})
    assert first["reservoir"].tolist() == [1, 0, 0, 0]


def test_start_of_latent_heat():
    """What melts may take the liquid's heat capacity and be warmer by the ratio of the two."""
    four = InitialState(np.zeros((4, 3)), np.zeros((4, 3)), np.ones(4), (1, 3))
    for capacity, ratio in (((2.0, 4.0), 1.0), ((6.0, 4.0), 1.5)):
        heat = rs.HeatConduction(
            temperature=(-10.0, 30.0), heat_capacity=capacity, melting_point=(5.0, 7.0), latent_heat=50.0,
        )  # fmt: skip
        found = heat.initial(grid(count=4), four, {})
        assert (found["melting_point"].tolist(), found["latent_heat"].tolist()) == ([5.0, 7.0, 7.0, 7.0], [50.0] * 4)
        assert found["enthalpy"] == near([-15.0 * capacity[0], *[50 + 23 * 4.0] * 3])
        spare = 0.1 * 40 + 4096 * 2.0**-52 * 30
        assert found["temperature_range"] == near([-10 - spare, 30 + spare + 25 * (ratio - 1)], 1e-15)
    frozen = rs.HeatConduction(temperature=-10.0, heat_capacity=(6.0, 4.0), melting_point=5.0, latent_heat=50.0)
    spare = 4096 * 2.0**-52 * 10
    assert frozen.initial(grid(count=4), four, {})["temperature_range"] == near([-10 - spare, -10 + spare], 1e-15)

    three = rs.HeatConduction(heat_capacity=(8.0, 2.0, 4.0), melting_point=5.0, latent_heat=50.0)
    for cold, warm in (([-10.0, 30.0], [-20.0, 40.0]), ([-20.0, 40.0], [-10.0, 30.0])):  # of T and of H
        enthalpy = enthalpy_of(np.array(warm), 4.0, np.full(2, 5.0), 50.0)
        field = fields(
            temperature=cold, enthalpy=enthalpy, heat_capacity=[4.0] * 2, melting_point=[5.0] * 2, latent_heat=50.0
        )
        spare = 0.1 * 60 + 4096 * 2.0**-52 * 40
        assert three._range(field, "float64") == near([-20 - spare, 40 + spare + 35], 1e-15)

    class Heater:
        name = "heater"

        def passes(self, others):
            return (SimpleNamespace(writes=(), updates=("temperature",)),)

        def fields(self, others):
            return ()

    found = frozen.initial(grid(count=4), four, {"heat_conduction": frozen, "heater": Heater()})
    assert found["temperature_range"].tolist() == [-1e30, 1e30]


# Ledgers
def test_ledgers_of_melting():
    """Number and mass of solid particles; the rest volume is the sum of m/rho."""
    field = fields(mass=[2.0, 3.0, 5.0], rest_density=[500.0, 500.0, 1000.0], phase=[1, 0, 2])
    found = rs.Melting().ledger(field)
    assert found == {"solid_particles": 2, "solid_mass": 7.0, "rest_volume": near(0.004 + 0.006 + 0.005)}


def test_ledgers_of_heat():
    """m c T, or m H with latent heat, V T as printed; without reservoirs."""
    field = fields(
        mass=[2.0, 3.0, 5.0], heat_capacity=[4.0, 6.0, 7.0], temperature=[10.0, -1.0, 2.0], reservoir=[0, 1, 0],
        enthalpy=[8.0, 9.0, 11.0], volume=[0.5, 0.25, 2.0],
    )  # fmt: skip
    assert rs.HeatConduction().ledger(field) == {"heat": 80.0 - 18.0 + 70.0}
    assert rs.HeatConduction(held=(1,)).ledger(field) == {"heat": 80.0 + 70.0}
    assert rs.HeatConduction(melting_point=0.0, latent_heat=3.0).ledger(field) == {"heat": 16.0 + 27.0 + 55.0}
    printed = rs.HeatConduction(literal=("M11",), scheme="explicit")
    assert printed.ledger(field) == {"heat": 5.0 - 0.25 + 4.0}
    still = rs.HeatConduction(literal=("M11",), scheme="explicit", conductivity=0.0)
    assert still.ledger(field) == {"heat": 80.0 - 18.0 + 70.0}
    total, size, exchangeable = rs.HeatConduction().balance(field)  # what the particle above the mean can give
    assert (total, size, exchangeable) == near((132.0, 168.0, 8 * (10 - 132 / 61)))


def test_ledgers_of_corrected_positions():
    found = rs.MeshBoundary(file="none").ledger(fields(corrections=[0, 3, 1, 0, 0]))
    assert found == {"corrections": 4.0, "corrected_particles": 2.0}
    assert rs.MeshBoundary(file="none", correction="none").ledger(fields(corrections=[1])) == {}


# Parameter groups


def test_groups_of_deformation_have_the_determinant_of_linear_algebra():
    """Every permutation's sign: a matrix of the six products alone, and any other."""
    for order in itertools.permutations(range(3)):
        sign = 1 if order in ((0, 1, 2), (1, 2, 0), (2, 0, 1)) else -1
        matrix = np.zeros((3, 3))
        matrix[range(3), order] = (2.0, 3.0, 5.0)
        assert determinant(tuple(matrix.ravel())) == 30.0 * sign
    matrix = np.random.default_rng(4).standard_normal((3, 3))
    assert determinant(tuple(matrix.ravel())) == near(np.linalg.det(matrix))


# Verdicts
def test_verdicts_on_speeds_and_accelerations():
    simulation = SimpleNamespace(
        steps=3, time=0.5, fields={}, greatest_speed=10.0, host=lambda name: np.array([-20.0, 30.0]),
        plan=SimpleNamespace(grid=grid(count=4000), shared={"density_bounds": DensityBounds(1000.0, 1.1, 1.5)}),
    )  # fmt: skip

    def reason(broken=0, **options):
        try:
            check_extremes(simulation, broken, Extremes(**{"speed": 10.0, "acceleration": 1e9} | options))
        except rs.RunStopped as stop:
            return stop.reason

    assert reason() is None
    assert (reason(speed=10.0 * (1 + 1e-9)), reason(broken=1)) == ("diverged", "non_finite")
    assert reason(excess=1e-9) == "temperature_out_of_range"
    assert reason(dense=4000, crushed=4) is None  # a thousandth
    assert reason(dense=4000, crushed=5) == "compressed"
    for names, words in (((), "a velocity or an acceleration that"), (("temperature",), "or a temperature that")):
        simulation.fields = dict.fromkeys(names)
        with pytest.raises(rs.RunStopped, match=words):
            check_extremes(simulation, 1, Extremes(speed=1.0, acceleration=1.0))


def test_verdicts_on_particles_of_a_grid_liquid():
    """J from 0.2 to 3, half of itself and half a cell in a step; each bound is allowed."""
    liquid = rs.MpmLiquid(bulk_modulus=3600.0, cell_size=0.5)
    assert (LEAST_VOLUME, LARGEST_VOLUME) == (0.2, 3.0)

    def reason(*seen):
        found = liquid.verdict(grid(), {"step_extremes": np.array(seen)}, 0.125)
        return found and found[0]

    assert reason(0.2, 3.0, 4.0, 0.0625) is None
    assert (reason(0.199, 3.0, 4.0, 0.0625), reason(0.2, 3.001, 4.0, 0.0625)) == ("compressed", "expanded")
    assert (reason(0.2, 3.0, 4.001, 0.0625), reason(0.2, 3.0, 4.0, 0.0626)) == ("volume_jump", "outrun")
    assert "0.502 cells" in liquid.verdict(grid(), {"step_extremes": np.array([1, 1, 0, 0.063])}, 0.125)[1]
    assert "0.75 of itself" in liquid.verdict(grid(), {"step_extremes": np.array([1, 1, 6, 0])}, 0.125)[1]


def test_verdicts_on_crowding():
    surface = rs.SurfaceEnergy(surface_tension=0.4)
    for crowding, remarked, stopped in (
        (CROWDED, False, False), (CROWDED + 1e-9, True, False), (OVERFULL, True, False), (OVERFULL + 1e-9, True, True),
    ):  # fmt: skip
        seen = {"greatest_crowding": np.array([crowding])}
        assert (surface.warning(grid(), seen) is not None) == remarked
        assert (surface.verdict(grid(), seen, 1.0) is not None) == stopped


def test_verdicts_on_cohesion_that_compresses():
    """s = 1 + Pi s^2 at rho0 c^2 (s - 1) = P_int s^2; no solution beyond Pi = 1/4."""
    for number in (0.0, 0.1, 0.24, 0.25):
        s = compression(number)
        assert s == near(1 + number * s * s)
    assert compression(0.1) < 2
    assert math.isnan(compression(0.2500001))
    tait = rs.WeaklyCompressible(sound_speed=13.0, rest_density=900.0, state="tait", density="summation")
    free = rs.BeckerTeschner2007(kappa=1.0, balance_pressure=False)
    held = rs.BeckerTeschner2007(kappa=1.0)
    push = free.internal_pressure(grid(), named(LIQUID))
    assert push > 0
    assert free.collapse_number(grid(), named(LIQUID)) == near(push / (900 * 169))
    assert free.collapse_number(grid(), named(tait)) == 0.0
    assert free.collapse_number(grid(), named(LIQUID, rs.ImplicitPressure())) == 0.0
    assert held.collapse_number(grid(), named(LIQUID)) == 0.0
    assert (free.balanced_pressure(grid(), named(LIQUID)), held.balanced_pressure(grid(), named(LIQUID))) == (0.0, push)
    idle = rs.BeckerTeschner2007(kappa=0.0, balance_pressure=False)
    assert idle.collapse_number(grid(), named(LIQUID)) == 0.0
    assert rs.BeckerTeschner2007(kappa=0.0).balanced_pressure(grid(), named(LIQUID)) == 0.0
    for share, stops in ((0.249, False), (0.251, True)):
        liquid = rs.WeaklyCompressible(
            sound_speed=math.sqrt(push / (900 * share)), rest_density=900.0, density="summation"
        )
        if stops:
            words = f"{2 * math.sqrt(push / 900):.4g} m/s"
            with pytest.raises(rs.InputError, match=words):
                free.check_collapse(grid(), named(liquid))
        else:
            free.check_collapse(grid(), named(liquid))


def test_verdicts_on_masses():
    """Whose density is summed allows 1.5; a solver in its place, any."""
    assert LIQUID.largest_mass_ratio(named(LIQUID)) == 1.5
    assert LIQUID.largest_mass_ratio(named(LIQUID, rs.TwoWayCoupling())) == math.inf
