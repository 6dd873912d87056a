"""Flow beyond the sound speed: noted before a run, noted and stopped in it; tension and viscosity of drops."""

import math

import pytest

import refsim as rs
from refsim import make_plan
from refsim.core.operation import REGISTRY
from refsim.surface_tension.calibration import BESIDE, SETTINGS
from refsim.surface_tension.cohesion import KEEPS_DENSITY
from validation.timed import step_launches

DOWN = rs.Gravity(acceleration=(0.0, -9.81, 0.0))
COLUMN = rs.Box(cells=(5, 40, 1))  # 2 m high at a spacing of 0.05 m
CUBE = rs.BoxWalls(lower=(0.0,) * 3, upper=(1.0,) * 3)
TANK = rs.BoxWalls(lower=(0.0, -1.0, 0.0), upper=(0.5, 6.0, 0.0))  # H = 3 m


def scene(*effects, sound=2.0, fluid=(COLUMN,), **settings):
    """Liquid in the plane with a sound speed [m/s]."""
    liquid = rs.WeaklyCompressible(sound_speed=sound, dynamic_viscosity=1.1, density="summation")
    settings = {"dim": 2, "spacing": 0.05, "support_radius": 0.13, "end_time": 1.0} | settings
    return rs.Scene(fluid=fluid, effects=(liquid, *effects), **settings)


def flow_notes(made):
    """Notes on a flow near the sound speed, of a scene."""
    return [note for note in make_plan(made).notes if "a tenth of the sound speed" in note]


HEIGHTS = {  # scenes and H [m]: in a tank, tilted to a corner, without a floor (the liquid's extent), in free space
    "tank": (lambda c: scene(DOWN, TANK, sound=c), 3.0),
    "corner": (lambda c: scene(rs.Gravity(acceleration=(3.0, -4.0, 0.0)), TANK, sound=c), 0.8 * 3.0 + 0.6 * 0.5),
    "no floor": (  # to the lowest particle of the side walls
        lambda c: scene(DOWN, rs.BoxWalls(lower=(0, -1, 0), upper=(0.5, 6, 0), open_faces=("-y",)), sound=c), 3.025,
    ),
    "free": (lambda c: scene(DOWN, sound=c), 2.0),
    "space": (lambda c: scene(rs.Gravity(), CUBE, sound=c, dim=3, fluid=(rs.Box(cells=(4, 4, 8)),)), 0.4),
}  # fmt: skip


@pytest.mark.parametrize("name", HEIGHTS)
def test_flow_of_a_fall_is_noted_and_the_advice_suffices(name):
    made, height = HEIGHTS[name]
    pull = 5.0 if name == "corner" else 9.81
    speed = math.sqrt(2 * pull * height)
    (note,) = flow_notes(made(9.9 * speed))
    assert f"a flow of {speed:.3g} m/s (sqrt(2 g H)" in note
    assert f"H = {height:.3g} m" in note
    advised = float(note.split("sound_speed of at least ")[1].split()[0])
    assert 10 * speed <= advised <= 10.1 * speed
    assert not flow_notes(made(advised))


def drop(*effects, sound=1.0, dim=3):
    liquid = rs.WeaklyCompressible(rest_density=1.0, sound_speed=sound, dynamic_viscosity=1.0, density="summation")
    cells = (6, 6, 6 if dim == 3 else 1)
    return rs.Scene(dim=dim, spacing=1.0, support_radius=2.6, fluid=(rs.Box(cells=cells),), effects=(liquid, *effects))


def stiff_notes(made):
    return [note for note in make_plan(made).notes if "sigma/(rho0 c^2 d)" in note]


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("model", [name for name in SETTINGS if name not in BESIDE])
def test_a_tension_too_large_for_its_sound_speed_is_noted(model, dim):
    limit = {"csf": 0.015, "he": 0.004}.get(model, KEEPS_DENSITY)
    effect = SETTINGS[model][1]
    (note,) = stiff_notes(drop(effect(1.01 * limit), dim=dim))
    assert f"= {1.01 * limit:.2g} is above {limit:g}" in note
    advised = float(note.split("sound_speed of at least ")[1].split()[0])
    assert 1.0 < advised < 1.02
    assert not stiff_notes(drop(effect(1.01 * limit), sound=advised, dim=dim))
    assert not stiff_notes(drop(effect(limit), dim=dim))
    assert not stiff_notes(drop(effect(100 * limit), rs.ImplicitPressure(), dim=dim))


# In the run
def test_a_crushed_liquid_is_noted_and_stops_by_name():
    walls, crushed = rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(0.25, 3.0, 0.0)), (rs.Box(cells=(5, 20, 1)),)
    simulation = rs.Simulation(scene(DOWN, walls, dtype="float64", fluid=crushed), "numpy")
    densest = []

    def advance():
        for _ in range(400):
            simulation.step()
            densest.append(simulation.field("density").max())  # of the state after the step

    with pytest.raises(rs.RunStopped, match=r"denser than 1\.5 times the rest density") as stopped:
        advance()
    assert stopped.value.reason == "compressed"
    assert max(densest[:-1]) <= 1500 < densest[-1]
    first = next(step for step, density in enumerate(densest, 2) if density > 1100)
    assert simulation.field("density").max() == densest[-1]  # the state was not moved
    (note,) = [n for n in simulation.notes if "denser than 1.1 times" in n]
    assert note.startswith(f"weakly_compressible: from step {first} on")


MU = 0.7


@pytest.mark.parametrize(("dim", "factor", "unit"), [(2, 4, math.pi), (3, 5, 4 * math.pi / 3)])
def test_the_note_says_how_fast_a_drop_s_rotation_is_braked(dim, factor, unit):
    """Of large drops, whose pairs are all there."""
    liquid = rs.WeaklyCompressible(rest_density=1.0, sound_speed=20.0, dynamic_viscosity=MU, viscosity="laplacian")
    drop = rs.Scene(spacing=1.0, support_radius=2.6, dim=dim, fluid=(rs.Ball(radius=2.0),), effects=(liquid,))
    plan = make_plan(drop.with_(weakly_compressible__density="summation"))
    rate = factor * MU / (plan.grid.count / unit) ** (2 / dim)
    assert sum(f"{factor} nu/R^2 = {rate:.3g} per second" in note for note in plan.notes) == 1


@pytest.mark.parametrize("backend", ["cpu", "cuda"])
@pytest.mark.parametrize("viscosity", [0.0, MU])
def test_a_default_step_reads_its_neighbours_twice(viscosity, backend):
    """Pressure, viscosity, if there is any, and shifting are one loop behind that of the density."""
    fluid = rs.WeaklyCompressible(sound_speed=20.0, dynamic_viscosity=viscosity)
    plan = make_plan(rs.Scene(spacing=0.1, support_radius=0.2, fluid=(rs.Box(cells=(3, 3, 3)),), effects=(fluid,)))
    launched = [REGISTRY[name] for name in step_launches(plan, backend) if name in REGISTRY]
    summed = [operation.name for operation in launched if "neighbours" in operation.arguments("cpu")]
    assert summed == ["sph.continuity", "particle_shifting.crowding"]
