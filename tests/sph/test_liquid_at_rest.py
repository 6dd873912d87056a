"""The liquid with an advanced density: tanks rest and weigh what they hold, vortices decay as they should."""

import math

import numpy as np
import pytest

import refsim as rs
from refsim import make_plan, simulate
from refsim.commands.plan import describe_plan
from refsim.core.capabilities import with_scene_defaults
from tests.running import advanced, run_to
from validation import pairs

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


def jittered(simulation, size, seed=3):
    """The simulation with each particle moved by up to `size` spacings along each axis."""
    grid, position = simulation.plan.grid, simulation.field("position")
    moves = np.random.default_rng(seed).uniform(-size, size, position.shape) * grid.spacing
    moves[:, grid.dim :] = 0
    simulation.set_field("position", position + moves)
    return simulation


def test_a_step_alone_advances_the_density(tmp_path):
    """Not a field that is read, nor velocities that are set: these strain the liquid from the next step on."""
    simulation = jittered(rs.Simulation(tank(8, 2.6, 2), "cpu"), 0.1)
    first = advanced(simulation, 3).field("density")
    simulation.evaluate()
    assert np.array_equal(simulation.field("density"), first)
    simulation.set_field("velocity", simulation.field("velocity") - 100 * simulation.field("position"))
    simulation.checkpoint(tmp_path / "strained.h5")
    runs = (simulation, rs.Simulation.resume(tmp_path / "strained.h5"))
    for run in runs:
        assert np.array_equal(run.field("density"), first)
        run.step()
    later = simulation.field("density")
    assert np.array_equal(later, runs[1].field("density"))
    assert np.median(later / first) > 1 + 100 * simulation.last.length


def test_liquid_begins_with_the_pressure_of_rest_and_a_falling_box_without():
    resting = rs.Simulation(tank(8, 2.6, 2), "cpu")
    depth = DEPTH - resting.field("position")[:, 1]
    assert resting.field("pressure") == pytest.approx(DENSITY * G * depth, rel=1e-9)
    scene = tank(8, 2.6, 2)
    raised = rs.Scene(
        dim=2, spacing=scene.spacing, support_radius=scene.support_radius, effects=scene.effects,
        fluid=(rs.Box(lower=(0.0, 0.5, 0.0), cells=(8, 8, 1)),),
    )  # fmt: skip
    assert not rs.Simulation(raised, "cpu").field("pressure").any()


@pytest.mark.parametrize(("gradient", "error"), [("plain", 0.026), ("corrected", 0.0)])
def test_the_correction_gives_the_gradient_of_a_linear_pressure(gradient, error):
    """Of which a lattice delivers 0.974 at h = 2.6 d; a shaken liquid keeps its momentum to rounding."""
    scene = rs.Scene(
        dim=2, spacing=0.1, support_radius=0.26, dtype="float64", fluid=(rs.Box(cells=(14, 14, 1)),),
        effects=(rs.WeaklyCompressible(sound_speed=10.0, density="continuity", gradient=gradient),),
    )  # fmt: skip
    simulation = rs.Simulation(scene, "cpu")
    x = simulation.field("position")
    simulation.set_field("advanced_excess", 0.05 * (x[:, 1] - x[:, 1].mean()))
    simulation.evaluate()
    inner = (np.abs(x[:, :2] - 0.7) < 0.2).all(1)
    upward = simulation.field("acceleration")[inner, 1]
    assert upward == pytest.approx(np.full(inner.sum(), (1 - error) * -0.05 * 100 / DENSITY), rel=1e-3)
    simulation = jittered(simulation, 0.1)
    simulation.evaluate()
    force = simulation.field("mass")[:, None] * simulation.field("acceleration")
    assert np.abs(force.sum(0)).max() <= 1e-13 * np.abs(force).sum()


@pytest.mark.parametrize("pull", [-1.0, 1.0])
def test_tensile_control_pushes_apart_what_a_negative_pressure_pulls_together(pull):
    """Two particles in a periodic box; where the pressure is positive nothing changes."""
    pushes = {}
    for control in ("none", "everywhere"):
        scene = rs.Scene(
            dim=2, spacing=0.1, support_radius=0.26, dtype="float64", period=(1.0, 1.0, 0.0),
            fluid=(rs.Cloud(position=np.array([[0.5, 0.5, 0.0], [0.6, 0.5, 0.0]])),),
            effects=(rs.WeaklyCompressible(sound_speed=10.0, density="continuity", tensile_control=control),),
        )  # fmt: skip
        simulation = rs.Simulation(scene, "cpu")
        simulation.set_field("advanced_excess", np.array([2.0 * pull, 5.0]))
        simulation.evaluate()
        pushes[control] = simulation.field("acceleration")[0, 0] * simulation.field("density")[0]
    assert pushes["everywhere"] == pytest.approx(pushes["none"] * (1 if pull > 0 else 7 / 3), rel=1e-12)


@pytest.mark.parametrize(
    "rate, effects, told", [(0.01, (rs.Gravity(),), False), (0.03, (rs.Gravity(),), True), (0.03, (), False)]
)
def test_a_fast_return_is_told_where_liquid_should_rest(rate, effects, told):
    walls = rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(0.6, 0.8, 0.0))
    liquid = rs.WeaklyCompressible(sound_speed=20.0, dynamic_viscosity=50.0, density="continuity", restoring=rate)
    scene = rs.Scene(
        dim=2, spacing=0.1, support_radius=0.26, fluid=(rs.Box(cells=(6, 4, 1)),), effects=(liquid, walls, *effects)
    )
    assert any("does not stay at rest" in note for note in rs.make_plan(scene).notes) == told


def test_shifting_beside_a_surface_brings_the_slow_return():
    """Not where the density takes the shifts, nor where it is summed, nor where a rate is given.

    A tension without shifting brings a faster one: in a container that with which it rests, in a free drop 0.3.
    """
    shifting, tension = rs.ParticleShifting(), rs.Akinci2013(surface_tension=0.07)
    walls, advanced = rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(0.8, 0.8, 0.8)), {"density": "continuity"}
    floating = rs.Gravity(acceleration=(0.0, 0.0, 0.0))
    for effects, given, rate in (
        ((shifting,), {}, 0.003), ((shifting, tension), advanced, 0.003), ((), {}, 0.003),
        ((), advanced, 0.0), ((tension,), advanced, 0.3), ((tension, walls), advanced, 0.3),
        ((tension, walls, floating), advanced, 0.3), ((tension, walls, rs.Gravity()), advanced, 0.01),
        ((walls, rs.Gravity()), advanced, 0.0), ((shifting,), {"restoring": 0.0}, 0.0),
        ((shifting,), {"density": "summation"}, 0.0), ((rs.ParticleShifting(strength=0.0),), {}, 0.0),
        ((rs.ParticleShifting(surface="none"),), {}, 0.0),
    ):  # fmt: skip
        liquid = rs.WeaklyCompressible(sound_speed=20.0, **given)
        assert with_scene_defaults((liquid, *effects))["weakly_compressible"].restoring == rate, (given, effects)


def test_solids_and_particles_beside_a_mesh_are_shifted_as_they_should():
    """Solids stay where their motion brings them; what a mesh corrects moves by dt v and the shift."""
    for other in ("shape_matching", "mesh_boundary"):
        shifted, plain = (
            rs.Simulation(made, "numpy")
            for made in (pairs.scene("particle_shifting", other), pairs.scene("weakly_compressible", other))
        )
        shifted.step()
        shift = shifted.field("shift")
        solid = shifted.field("phase") != 0 if other == "shape_matching" else np.zeros(len(shift), bool)
        assert np.abs(shift[~solid]).max() > 1e-7
        assert not shift[solid].any()
        if other == "mesh_boundary":
            plain.step()
            apart = shifted.field("position") - plain.field("position")
            assert apart == pytest.approx(shift, abs=1e-12)


def test_a_free_surface_that_shifting_is_not_told_of_is_refused():
    """A tank that is open above, one with a lid a cell over the water, and none where the water fills it."""
    for height, open_faces in ((0.9, ()), (0.9, ("+y",)), (0.8, ())):
        scene = rs.Scene(
            dim=2, spacing=0.1, support_radius=0.26, fluid=(rs.Box(cells=(8, 8, 1)),),
            effects=(
                rs.WeaklyCompressible(sound_speed=20.0), rs.ParticleShifting(surface="none"),
                rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(0.8, height, 0.0), open_faces=open_faces),
            ),
        )  # fmt: skip
        if height == 0.8:
            rs.Simulation(scene, "numpy").step()
            continue
        with pytest.raises(rs.InputError, match="set surface = 'detected'"):
            rs.Simulation(scene, "numpy")


def test_a_liquid_that_fills_a_closed_box_has_no_surface_without_being_told():
    """Between planes and between periods, named or joined; not under air, in an open box, or where it is named."""
    lower, period = (0.0, 0.0, 0.0), (0.8, 0.8, 0.0)
    for beside, given, expected in (
        ((rs.BoxWalls(lower=lower, upper=(0.8, 0.8, 0.0)),), {}, "none"), ((), {"period": period}, "none"),
        ((rs.ParticleShifting(strength=1.0),), {"period": period}, "none"), ((), {"period": (0.8, 0.0, 0.0)}, None),
        ((rs.ParticleShifting(surface="detected"),), {"period": period}, "detected"),
        ((rs.BoxWalls(lower=lower, upper=(0.8, 0.9, 0.0)),), {}, None), ((), {}, None),
    ):  # fmt: skip
        scene = rs.Scene(
            dim=2, spacing=0.1, support_radius=0.26, fluid=(rs.Box(cells=(8, 8, 1)),),
            effects=(rs.WeaklyCompressible(sound_speed=20.0), *beside), **given,
        )  # fmt: skip
        plan = make_plan(scene)
        assert plan.effects["particle_shifting"].surface == expected
        assert plan.effects["weakly_compressible"].restoring == (0.0 if expected == "none" else 0.003)
        assert ("filling" in plan.fields) == (expected != "none")
        words = [w for w in describe_plan(plan, "cpu")["defaults"] if "fills its closed box" in w]
        assert len(words) == (expected == "none")


def test_it_costs_nothing_where_the_density_is_summed():
    plan = make_plan(tank(8, 2.6, 2, density="summation"))
    assert not {"density_excess", "advanced_excess", "summed_density", "shift"} & set(plan.fields)
    assert not {"sph.continuity", "sph.keep_density"} & set(plan.launches(on_demand=True))


def without_walls(**changes):
    return lambda: make_plan(
        rs.Scene(
            dim=2, spacing=0.1, support_radius=0.26, fluid=(rs.Box(cells=(4, 4, 1)),),
            effects=(rs.WeaklyCompressible(sound_speed=10.0, **changes),),
        )
    )  # fmt: skip


def test_walls_that_do_not_hold_the_liquid_are_noted():
    """A basin at h = 2.6 d in 3D: planes stop particles between mirrored walls, and none where the liquid rests."""
    notes = {}
    for model, density in (("mirrored", "summation"), ("extrapolated", "continuity")):
        scene = rs.Scene(
            spacing=0.02, support_radius=0.052, fluid=(rs.Box(cells=(10, 10, 8)),),
            effects=(
                rs.WeaklyCompressible(sound_speed=20.0, dynamic_viscosity=4.5, density=density, viscosity="laplacian"),
                rs.Gravity(),
                rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(0.2, 0.2, 0.5), open_faces=("+z",), model=model),
            ),
        )  # fmt: skip
        simulation = rs.Simulation(scene, "cpu", threads=2)
        run_to(simulation, 0.5)
        notes[model] = [
            note for note in simulation.notes if "planes have stopped" in note or "carry the weight" in note
        ]
    assert len(notes["mirrored"]) == 2
    assert not notes["extrapolated"]


@pytest.mark.parametrize("model", ["extrapolated", "mirrored"])
def test_a_run_stops_where_planes_hold_the_liquid(tmp_path, monkeypatch, model):
    """Any share is too much here; the checkpoint before stays. A film between mirrored walls goes on."""
    for bound in ("STOPPED", "HELD"):
        monkeypatch.setattr(f"refsim.engine.watching.{bound}", -1.0)
    scene = rs.Scene(
        dim=2, spacing=0.02, support_radius=0.052, step=1e-4, fluid=(rs.Box(cells=(10, 10, 1)),),
        effects=(
            rs.WeaklyCompressible(sound_speed=20.0, density="summation"), rs.Gravity(acceleration=(0.0, -9.81, 0.0)),
            rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(0.2, 0.5, 0.0), model=model),
        ),
    )  # fmt: skip
    if model == "mirrored":
        assert simulate(scene, 0.0105).steps > 100
        return
    with pytest.raises(rs.RunStopped) as stopped:
        simulate(scene, 1.0, output=tmp_path, checkpoint_every=0.0)
    assert (stopped.value.reason, stopped.value.exit_code) == ("held_by_planes", 3)
    assert rs.Simulation.resume(tmp_path / "checkpoint.h5").steps == 99


def with_mirrored_walls():
    return make_plan(tank(6, 2.6, 2).with_(box_walls__model="mirrored"))


def with_clamped_tension():
    return make_plan(tank(6, 2.6, 2, effects=(rs.SurfaceDetection(),), tensile_control="inside", clamp_pressure=True))


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
