"""The liquid with an advanced density: tanks rest and weigh what they hold, vortices decay as they should."""

import itertools
import math

import numpy as np
import pytest

import refsim as rs
from refsim import make_plan, simulate
from tests.running import advanced

G, DENSITY, DEPTH = 9.81, 1000.0, 1.0
SOUND = 10 * math.sqrt(G * DEPTH)


def tank(cells, ratio, dim, dtype="float64", effects=(), **liquid):
    """Water 1 m deep in a box of its own width; the viscosity is that of an artificial viscosity of 0.02."""
    spacing = DEPTH / cells
    up = dim - 1
    pull, upper = [0.0, 0.0, 0.0], [DEPTH] * 3
    pull[up], upper[up] = -G, 2 * DEPTH
    viscosity = DENSITY * 0.02 * 0.5 * ratio * spacing * SOUND / (2 * (dim + 2))
    liquid = {"density": "continuity", "viscosity": "central"} | liquid
    return rs.Scene(
        dim=dim, dtype=dtype, spacing=spacing, support_radius=ratio * spacing,
        fluid=(rs.Box(cells=(cells, cells, cells if dim == 3 else 1)),),
        effects=(
            rs.WeaklyCompressible(sound_speed=SOUND, dynamic_viscosity=viscosity, **liquid),
            rs.Gravity(acceleration=tuple(pull)),
            rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=tuple(upper), model="extrapolated"), *effects,
        ),
    )  # fmt: skip


@pytest.mark.parametrize(("kernels", "ratio"), [("wendland", 2.13), ("cubic_spline", 2.13), ("wendland", 3.0)])
def test_walls_above_the_surface_leave_a_tank_in_space_at_rest(kernels, ratio):
    """Its mean speed after 8 steps over that of a fall, with a quick return to the counted density.

    Where the walls above the surface count as what surrounds it these are 0.019, 0.025 and 0.020.
    """
    simulation = rs.Simulation(tank(4, ratio, 3, kernels=kernels, restoring=0.01), "numpy")
    speed = np.linalg.norm(advanced(simulation, 8).field("velocity"), axis=1).mean()
    assert speed < 0.015 * G * simulation.time


@pytest.mark.parametrize(("dim", "ratio"), [(2, 2.0), (3, 2.6)])
def test_a_fast_particle_does_not_make_the_others_shift_too_far(dim, ratio):
    """A step takes away 1.75 of the wave of a lattice that the shift changes most; twice as much, and it would stay."""
    scene = rs.Scene(
        dim=dim, dtype="float64", spacing=1.0, support_radius=ratio, period=(6.0, 6.0, 6.0 * (dim == 3)),
        fluid=(rs.Box(cells=(6, 6, 6 if dim == 3 else 1)),), effects=(rs.WeaklyCompressible(sound_speed=1.0),),
    )  # fmt: skip
    taken = []
    for wave in list(itertools.product((0, 1), repeat=dim))[1:]:
        simulation = rs.Simulation(scene, "numpy")
        place, fast = simulation.field("position"), simulation.field("velocity")
        crest = 1e-4 * np.cos(np.pi * (place[:, :dim] - 0.5) @ wave)
        place[:, 0] += crest
        fast[0, 1] = 5.0
        simulation.set_field("position", place)
        simulation.set_field("velocity", fast)
        simulation.step()
        taken.append(-simulation.field("shift")[:, 0] @ crest / (crest @ crest))
    assert max(taken) == pytest.approx(1.75, rel=1e-3)


def test_a_lone_particle_gives_off_its_pressure():
    """Spray that keeps what it had when it left the liquid bounces as balls do that lose nothing."""
    liquid = rs.WeaklyCompressible(sound_speed=10.0)
    scene = rs.Scene(spacing=1.0, support_radius=2.6, fluid=(rs.Box(cells=(1, 1, 1)),), effects=(liquid,))
    simulation = rs.Simulation(scene, "numpy")
    simulation.set_field("advanced_excess", np.array([100.0], np.float32))
    advanced(simulation, 20)
    assert 0 <= simulation.field("pressure")[0] < 0.01 * 100 * 10.0**2


def without_walls(**changes):
    return lambda: make_plan(
        rs.Scene(
            dim=2, spacing=0.1, support_radius=0.26, fluid=(rs.Box(cells=(4, 4, 1)),),
            effects=(rs.WeaklyCompressible(sound_speed=10.0, **changes),),
        )
    )  # fmt: skip


@pytest.mark.parametrize("model", ["extrapolated", "mirrored"])
def test_a_run_stops_where_planes_hold_the_liquid(tmp_path, monkeypatch, model):
    """Any share is too much here; the checkpoint before stays. A film between mirrored walls goes on."""
    for bound in ("STOPPED", "HELD"):
        monkeypatch.setattr(f"refsim.engine.counting.{bound}", -1.0)
    scene = rs.Scene(
        dim=2, spacing=0.02, support_radius=0.052, step=1e-4, fluid=(rs.Box(cells=(10, 10, 1)),),
        effects=(
            rs.WeaklyCompressible(sound_speed=20.0, density="summation"), rs.Gravity(acceleration=(0.0, -9.81, 0.0)),
            rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(0.2, 0.5, 0.0), model=model),
        ),
    )  # fmt: skip
    if model == "mirrored":
        assert simulate(scene, 0.0105, backend="numpy").steps > 100
        return
    with pytest.raises(rs.RunStopped) as stopped:
        simulate(scene, 1.0, backend="numpy", output=tmp_path, checkpoint_every=0.0)
    assert (stopped.value.reason, stopped.value.exit_code) == ("held_by_planes", 3)
    assert rs.Simulation.resume(tmp_path / "checkpoint.h5").steps == 99


def with_mirrored_walls():
    return make_plan(tank(6, 2.6, 2).with_(box_walls__model="mirrored"))


def with_clamped_tension():
    return make_plan(tank(6, 2.6, 2, effects=(rs.SurfaceDetection(),), tensile_control="inside", clamp_pressure=True))


def test_shifting_of_no_strength_asks_for_nothing():
    scene = tank(6, 2.6, 2, effects=(rs.ParticleShifting(surface="none"),)).with_(box_walls__open_faces=("+y",))
    with pytest.raises(rs.InputError, match="but the scene is open along y"):
        make_plan(scene)
    make_plan(scene.with_(particle_shifting__strength=0.0))


@pytest.mark.parametrize(("make", "words"), [
    (without_walls(density="continuity", diffusion=-0.1), "diffusion = -0.1 is not possible; give 0 to 0.17"),
    (without_walls(density="continuity", diffusion=0.5), "diffusion = 0.5 is not possible; give 0 to 0.17"),
    (without_walls(tensile_control="everywhere", density="continuity"), "but the scene is open along x"),
    (without_walls(tensile_control="inside", density="continuity"), "needs effect 'surface_detection'; add it"),
    (with_clamped_tension, "tensile_control acts on negative pressures, which clamp_pressure sets to zero"),
    (with_mirrored_walls, "needs an extrapolated pressure at all walls; set model = 'extrapolated' in box_walls"),
])  # fmt: skip
def test_bad_input_is_refused_in_a_sentence(make, words):
    with pytest.raises(rs.InputError) as refused:
        make()
    assert words in str(refused.value)
    assert str(refused.value).count(". ") == 0
