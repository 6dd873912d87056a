"""Host code against numbers computed here: steps on a grid and beside solids, initial values, verdicts.

Parameter groups are computed anew in tests/ladder/test_parameters.py. Nothing is compiled.
"""

import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest

import refsim as rs
from refsim.backends.tuples import determinant
from refsim.core.effect import Discretisation, InitialState
from refsim.heat import enthalpy_of, temperature_at
from refsim.mpm import LARGEST_VOLUME, LEAST_VOLUME
from refsim.surface_tension.cohesion import compression

H, SPACING = 0.21, 0.1
LIQUID = rs.WeaklyCompressible(sound_speed=13.0, rest_density=900.0, dynamic_viscosity=0.7, density="summation")


def grid(dim=3, **options):
    given = {"dim": dim, "dtype": "float64", "spacing": SPACING, "support_radius": H, "count": 3}
    return Discretisation(**given | options)


def named(*effects):
    return {effect.name: effect for effect in effects}


def near(value, relative=1e-12):
    return pytest.approx(value, rel=relative, abs=1e-300)


def fields(**values):
    return lambda name: np.array(values[name])


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


def test_start_of_enthalpy_and_temperature():
    """Solid up to and at the melting point, where H = 0; liquid from L on."""
    t = np.array([-3.0, 5.0, 5.0 + 1e-12, 9.0])
    h = enthalpy_of(t, np.full(4, 2.0), np.full(4, 5.0), np.full(4, 30.0))
    assert h == near([-16.0, 0.0, 30.0 + 2 * (t[2] - 5.0), 38.0])
    back = temperature_at(np.array([-16.0, 0.0, 15.0, 30.0, 38.0]), 2.0, 5.0, 30.0)
    assert back.tolist() == [-3.0, 5.0, 5.0, 5.0, 9.0]


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


def test_groups_of_deformation_have_the_determinant_of_linear_algebra():
    """Every permutation's sign: a matrix of the six products alone, and any other."""
    for order in itertools.permutations(range(3)):
        sign = 1 if order in ((0, 1, 2), (1, 2, 0), (2, 0, 1)) else -1
        matrix = np.zeros((3, 3))
        matrix[range(3), order] = (2.0, 3.0, 5.0)
        assert determinant(tuple(matrix.ravel())) == 30.0 * sign
    matrix = np.random.default_rng(4).standard_normal((3, 3))
    assert determinant(tuple(matrix.ravel())) == near(np.linalg.det(matrix))


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
