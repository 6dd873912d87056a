"""The audit of the energy: each part against another program, what gains energy stops, no bit of a run changes."""

import math

import msgspec
import numpy as np
import pytest

import refsim as rs
from refsim import make_plan
from refsim.__main__ import main
from refsim.scene.files import scene_to_toml
from tests.motion.test_motions import tank
from tests.running import advanced, run_to
from validation.experiments.liquid import runs

AUDIT = rs.EnergyAudit(every=20)
EXPLODING = rs.WeaklyCompressible(
    sound_speed=20.0, dynamic_viscosity=20.0, state="tait", literal=("E3",), density="summation"
)


def lattice(side=6, seed=3, spacing=0.1, shaken=0.1):
    """Places of a cube, shaken by a share of the spacing."""
    axes = np.meshgrid(*[np.arange(side) * spacing] * 3, indexing="ij")
    place = np.stack(axes, axis=-1).reshape(-1, 3)
    return place + shaken * spacing * np.random.default_rng(seed).standard_normal(place.shape)


def cloud(**options):
    return rs.Cloud(position=lattice(), **options)


def scene(*effects, fluid=None, audit=AUDIT, **options):
    options = {"dtype": "float64", **options}
    return rs.Scene(
        spacing=0.1, support_radius=0.21, fluid=(fluid or cloud(),), effects=effects, energy_audit=audit, **options
    )


def dam(audit=AUDIT):
    """The dam break of docs/scene_files.md with a quarter of the particles."""
    return rs.Scene(
        dim=2, spacing=0.01, support_radius=0.026, fluid=(rs.Box(cells=(10, 20, 1)),), energy_audit=audit,
        effects=(
            rs.WeaklyCompressible(sound_speed=20.0, dynamic_viscosity=2.2, state="tait", density="summation"),
            rs.Gravity(acceleration=(0.0, -9.81, 0.0)),
            rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(0.4, 0.4, 0.0), open_faces=("+y",)),
        ),
    )  # fmt: skip


def growing(audit=AUDIT):
    """Viscosity with its printed sign (Jiang & Zhu E3) pushes particles away from their neighbours' velocity."""
    place = lattice(shaken=0.0)
    block = rs.Cloud(position=place, velocity=0.1 * np.random.default_rng(8).standard_normal(place.shape))
    return scene(EXPLODING, fluid=block, audit=audit)


# Each part against another program
PAIRS = {
    "jiang_zhu_2023": rs.JiangZhu2023(surface_tension=1.0, area_term="none", density_correction=False),
    "dong_2016": rs.Dong2016(surface_tension=1.0, correction=0.0, filter_density=False),
    "becker_teschner_2007": rs.BeckerTeschner2007(surface_tension=1.0),
    "tartakovsky_meakin_2005": rs.TartakovskyMeakin2005(surface_tension=1.0),
}


@pytest.mark.parametrize("name", PAIRS)
def test_cohesion_is_the_potential_of_its_force(name):
    """Moving a particle changes the energy by minus the force of the reference times the displacement."""
    fluid = rs.WeaklyCompressible(sound_speed=40.0, density="summation")
    shift = 1e-6

    def at(shift, *effects):
        place = lattice()
        place[100] += shift
        simulation = rs.Simulation(scene(fluid, *effects, fluid=rs.Cloud(position=place)), "numpy")
        found = {n: p.value for n, p in simulation.auditor.energies(simulation).items()}
        return found, simulation.field("acceleration")[100] * simulation.field("mass")[100]

    ahead, behind = (at((sign * shift, 0, 0), PAIRS[name])[0]["cohesion"] for sign in (1, -1))
    plain = msgspec.structs.replace(PAIRS[name], balance_pressure=False)
    pull = at((0, 0, 0), plain)[1] - at((0, 0, 0))[1]
    assert -(ahead - behind) / (2 * shift) == pytest.approx(pull[0], rel=2e-5, abs=1e-7 * np.abs(pull).max())


# Runs
def test_a_scene_that_gains_energy_stops_and_its_last_good_checkpoint_stays(tmp_path):
    """A checkpoint never holds a state beyond the bound, also between two audits."""
    simulation = rs.Simulation(growing(), "numpy")
    with pytest.raises(rs.RunStopped, match=r"the bound of energy_audit, 0\.05:") as stop:
        advanced(simulation, 2000)
    assert (stop.value.reason, simulation.steps % AUDIT.every) == ("energy_gained", 0)
    assert np.isfinite(simulation.field("velocity")).all()
    simulation = rs.Simulation(growing(audit=rs.EnergyAudit(every=1000000, bound=0.3)), "numpy")
    simulation.step()
    simulation.checkpoint(tmp_path / "good.h5")
    before = (tmp_path / "good.h5").read_bytes()
    advanced(simulation, 60)
    with pytest.raises(rs.RunStopped, match="bound") as stop:
        simulation.checkpoint(tmp_path / "good.h5")
    assert (stop.value.reason, (tmp_path / "good.h5").read_bytes()) == ("energy_gained", before)


def test_what_shifts_lift_is_no_gain_of_energy(tmp_path):
    """Their part is minus what the places change the energy of gravity by beside dt v, also after a checkpoint."""
    pull, water = (0.0, 0.0, -9.81), rs.WeaklyCompressible(sound_speed=20.0, dynamic_viscosity=20.0)
    simulation = rs.Simulation(scene(water, rs.Gravity(acceleration=pull)), "numpy")
    lifted = 0.0
    for step in range(6):
        before = simulation.field("position")
        simulation.step()
        shift = simulation.field("position") - before - simulation.last.length * simulation.field("velocity")
        lifted -= float((simulation.field("mass") * (shift @ pull)).sum())
        if step == 3:
            simulation.checkpoint(tmp_path / "middle.h5")
            simulation = rs.Simulation.resume(tmp_path / "middle.h5")
    parts = {name: part.value for name, part in simulation.auditor.energies(simulation).items()}
    assert abs(lifted) > 1e-3
    assert parts["shifting"] == pytest.approx(-lifted, rel=1e-9)


# What drives a run is counted
FACES = rs.Motion(of="moving_faces", kind="formula", direction=(1.0, 0.0, 0.0), formula="0.1*sin(2*pi*t/0.4)")
MOVED = {"viscosity": 2.0, "moving_faces": ("-y",), "velocity": (0.5, 0.0, 0.0)}


def driven(motion, walls):
    return tank(10, motion, walls=walls, end_time=2.0).with_(energy_audit=AUDIT)


def test_a_face_gives_its_velocity_times_the_momentum():
    """A floor that moves along a period drags a shallow layer without weight: nothing else pushes it along."""
    given = {"viscosity": 50.0, "moving_faces": ("-y",), "velocity": (0.5, 0.0, 0.0), "open_faces": ("-x", "+x", "+y")}
    liquid, _, walls = driven((), given).effects
    scene = msgspec.structs.replace(
        driven((), given), period=(1.0, 0.0, 0.0), fluid=(rs.Box(cells=(10, 3, 1)),), effects=(liquid, walls)
    )
    simulation = rs.Simulation(scene, "numpy")
    advanced(simulation, 40)
    simulation.auditor.look(simulation)
    half = 0.5 * simulation.previous_length * simulation.field("acceleration")
    gained = simulation.field("mass") @ (simulation.field("velocity") + half)[:, 0]
    assert gained > 1.0
    assert -simulation.auditor.state.now["driving"] == pytest.approx(0.5 * gained, rel=1e-6)


def ice(cells_below, deep):
    """A cube of 3 cells in water, `cells_below` it, `deep` in all."""
    return runs.submerged((3, 3), cells_below, (8, deep), 2.6, runs.ARTIFICIAL).with_(dtype="float32")


@pytest.mark.parametrize(
    "scene, backend", [(driven((FACES,), MOVED), "numpy"), (ice(3, 6), "cpu")], ids=["faces", "ice"]
)
def test_work_is_kept_in_checkpoints_and_changes_no_bit(tmp_path, scene, backend):
    plain, whole, first = (rs.Simulation(scene.with_(energy_audit=a), backend) for a in (None, AUDIT, AUDIT))
    advanced(first, 13)
    first.checkpoint(tmp_path / "cut.h5")
    resumed = rs.Simulation.resume(tmp_path / "cut.h5")
    advanced(resumed, 8)
    for simulation in (plain, whole):
        advanced(simulation, 21)
    assert resumed.auditor.saved() == whole.auditor.saved()
    assert whole.auditor.saved().work > 0
    assert plain.field("velocity").tobytes() == whole.field("velocity").tobytes()


def test_the_pressure_of_ice_that_emerges_works_on_the_water():
    """Its work is 0.13 of what is turned over, without which the energy rises by 0.06 in place of 0.03."""
    simulation = rs.Simulation(ice(3, 6).with_(energy_audit=rs.EnergyAudit(every=5)), "cpu")
    run_to(simulation, 1.0)
    audit = simulation.auditor.report()
    assert audit["greatest_share"] <= 0.035
    assert -audit["now"]["driving"] > 0.1 * audit["turned_over"]


@pytest.mark.parametrize("of", ["gravity", "turn"])
def test_dust_in_a_driven_frame_has_the_energy_of_the_work(of):
    """Single particles in a frame that sways or turns: kinetic and potential energy change by the work, exactly."""
    pivot = (0.3, -0.2, 0.0) if of == "turn" else None
    axis = (0.0, 0.0, 1.0) if of == "turn" else (1.0, 2.0, 0.0)
    motion = rs.Motion(of=of, kind="formula", direction=axis, pivot=pivot, formula="0.3*sin(5*t) + t**2")
    place = np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 0.0], [-0.4, 2.0, 0.0]])
    dust = rs.Scene(
        dim=2, dtype="float64", spacing=0.1, support_radius=0.21, step=5e-4, motion=(motion,), end_time=0.5,
        fluid=(rs.Cloud(position=place, velocity=(0.3, -1.0, 0.0)),), energy_audit=AUDIT,
        effects=(rs.WeaklyCompressible(sound_speed=50.0), rs.Gravity(acceleration=(0.0, -9.81, 0.0))),
    )  # fmt: skip
    simulation = rs.Simulation(dust, "numpy")
    simulation.step()
    begun = math.fsum(part.value for part in simulation.auditor.energies(simulation).values())
    advanced(simulation, 900)
    found = {name: part.value for name, part in simulation.auditor.energies(simulation).items()}
    assert abs(found["driving"]) > 1.0
    assert math.fsum(found.values()) == pytest.approx(begun, abs=2e-3 * abs(found["driving"]))


# What cannot be counted, and how an audit is requested
REFUSED = {
    "akinci_2013": rs.Akinci2013(surface_tension=0.1), "csf_wang_2019": rs.CsfWang2019(surface_tension=0.1),
    "he_2014": rs.He2014(surface_tension=0.1), "normal_difference_2014": rs.NormalDifference2014(area_acceleration=0.1),
    "jiang_zhu_2023": rs.JiangZhu2023(surface_tension=0.1, pair_mode="soft"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_forces_without_an_energy_are_refused(name):
    with pytest.raises(rs.InputError, match=f"effect '{name}' have no energy that can be computed"):
        make_plan(scene(rs.WeaklyCompressible(sound_speed=10.0, density="summation"), REFUSED[name]))
    make_plan(scene(rs.WeaklyCompressible(sound_speed=10.0, density="summation"), REFUSED[name], audit=None))


def test_what_is_not_counted_is_said(tmp_path, capsys):
    file = tmp_path / "scene.toml"
    file.write_text(scene_to_toml(dam()))
    assert main(["plan", str(file)]) == 0
    said = capsys.readouterr().out
    assert "Energy audit: every 20 steps" in said
    assert "counts kinetic, compression, gravity; not counted: box_walls: half of the walls' pressure force" in said
    fluid = rs.WeaklyCompressible(sound_speed=10.0, density="summation")
    implicit = rs.Simulation(scene(fluid, rs.ImplicitPressure(), fluid=rs.Box(cells=(4, 4, 4))), "cpu")
    assert implicit.auditor.uncounted() == ("iisph: work of the pressure on the compression that tolerance leaves",)
    assert not implicit.auditor.staggered
