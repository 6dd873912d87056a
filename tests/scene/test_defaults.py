"""What a scene has that names no density, viscosity or model of walls, and how it is told."""

import pathlib

import msgspec
import pytest

import refsim as rs
from refsim import make_plan
from refsim.commands.plan import _text, describe_plan
from tests.running import rows

EXAMPLES = pathlib.Path(rs.__file__).parent / "examples"
PEBBLE = str(EXAMPLES / "pebble.obj")
BOX = {"lower": (0.0, 0.0, 0.0), "upper": (0.4, 0.4, 0.4)}
PULL = rs.Gravity(acceleration=(0.0, -9.81, 0.0))
SOLID = (rs.SolidBox(lower=(0.0, 0.0, 0.1), upper=(0.2, 0.2, 0.2)),)
MOLTEN = (rs.HeatConduction(melting_point=0.0),)
COUPLED = (rs.ShapeMatching(), rs.TwoWayCoupling())


def scene(*effects, solid=(), walls=None, **liquid):
    box = () if walls is None else (rs.BoxWalls(**BOX, **walls),)
    return rs.Scene(
        spacing=0.05, support_radius=0.13, solid=solid, fluid=(rs.Box(cells=(4, 4, 4), lower=(0.1, 0.1, 0.2)),),
        effects=(*box, rs.WeaklyCompressible(sound_speed=20.0, dynamic_viscosity=2.0, **liquid), PULL, *effects),
    )  # fmt: skip


@pytest.mark.parametrize(("made", "joins"), [
    (scene(walls={}), True), (scene(*COUPLED, *MOLTEN, rs.Melting(), solid=SOLID, walls={}), True),
    (scene(rs.Akinci2013(surface_tension=0.0), walls={}), True), (scene(walls={}, density="continuity"), False),
    (scene(walls={}, density="summation"), False), (scene(rs.ImplicitPressure(), walls={}), False),
    (scene(walls={}, literal=("E24",)), False), (scene(rs.Akinci2013(surface_tension=0.1), walls={}), True),
    (scene(rs.Akinci2013(surface_tension=0.1)), True), (scene(rs.CsfWang2019(surface_tension=0.1)), True),
    (scene(rs.Akinci2013(surface_tension=0.1, area_acceleration=1.0)), False), (scene(rs.Akinci2013(gamma=0.1)), False),
    (scene(rs.Dong2016(surface_tension=0.1)), True), (scene(rs.Dong2016(surface_tension=0.1, correction=1.0)), False),
    (scene(rs.JiangZhu2023(surface_tension=0.1)), False),
])  # fmt: skip
def test_shifting_joins_a_liquid_that_names_no_density_and_has_none_summed(made, joins):
    plan = make_plan(made)
    assert ("particle_shifting" in plan.effects) == ("particle_shifting.longest_shift" in plan.launches()) == joins
    assert plan.effects["weakly_compressible"].restoring == (0.003 if joins else 0.0)
    off = msgspec.structs.replace(made, effects=(*made.effects, rs.ParticleShifting(strength=0.0)))
    assert "particle_shifting.longest_shift" not in make_plan(off).launches()


@pytest.mark.parametrize(("density", "bookkeeping"), [(None, "water"), ("summation", "immiscible")])
def test_a_melt_is_the_liquid_s_where_that_is_advanced(density, bookkeeping):
    made = scene(*COUPLED, *MOLTEN, rs.Melting(), solid=SOLID, walls={}, density=density)
    assert make_plan(made).effects["melting"].bookkeeping == bookkeeping


def test_a_plan_names_each_default_that_the_papers_have_otherwise_once():
    """An artificial viscosity is worth 0.1 * 1000 kg/m^3 * c h/(4 (dim + 2)) in Pa s."""
    told = describe_plan(
        make_plan(scene(rs.MeshBoundary(file=PEBBLE, center=(0.2, 0.2, 0.1), size=0.1), walls={})), "cpu"
    )
    assert told["defaults"] == rows(__file__, "defaults")
    assert _text(told).count("Default: ") == 5
    assert describe_plan(make_plan(scene(walls={}, density="summation")), "cpu")["defaults"] == []
    made = make_plan(scene(walls={}, density="summation", artificial_viscosity=0.1))
    grid, liquid = made.grid, made.effects["weakly_compressible"]
    worth = 0.1 * 1000.0 * liquid.sound_speed * grid.support_radius / (4 * (grid.dim + 2))
    told = f"artificial_viscosity = 0.1 adds {worth:.3g} Pa s: the dynamic viscosity is {worth + 2:.3g} Pa s"
    assert describe_plan(made, "cpu")["defaults"] == [told]


@pytest.mark.parametrize(("dim", "down"), [(2, 1), (3, 2)])
def test_gravity_pulls_down_by_default_in_the_plane_as_in_space(dim, down):
    cube = rs.Scene(
        dim=dim, spacing=0.1, support_radius=0.26, step=1e-3, fluid=(rs.Box(cells=(2, 2, 1)),), effects=(rs.Gravity(),)
    )
    simulation = rs.Simulation(cube, backend="numpy")
    simulation.step()
    fall = [-9.81 * 0.5e-3 if axis == down else 0.0 for axis in range(3)]  # the first kick is half a step
    assert simulation.field("velocity").mean(0) == pytest.approx(fall, rel=1e-6)
