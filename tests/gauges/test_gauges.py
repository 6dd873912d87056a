"""Gauges say what the liquid does, on each backend; the space that walls leave around them; noted pressures."""

import math
from types import SimpleNamespace
from typing import get_args, get_type_hints

import numpy as np
import pytest

import refsim as rs
from refsim import Gauge, Gravity, WeaklyCompressible
from refsim.core.period import period_group
from refsim.engine.driver import simulate
from refsim.engine.gauges import Gauges
from refsim.gauges import KINDS as gauge_kinds
from refsim.motion import KINDS as motion_kinds
from refsim.smoothing import smoothing
from refsim.smoothing.reference import kernel_value
from tests.running import advanced, answer_of, run_to
from tests.sph.test_liquid_at_rest import DEPTH
from tests.sph.test_liquid_at_rest import tank as water

GAUGES = (
    rs.Gauge(name="floor", kind="force", on="-y", every=0.02), rs.Gauge(name="left", kind="force", on="-x", every=0.02),
    rs.Gauge(name="right", kind="force", on="+x", every=0.02),
    rs.Gauge(name="walls", kind="force", on="box_walls", every=0.02),
    rs.Gauge(name="point", kind="pressure", at=(0.5, 0.5, 0.0), every=0.02),
    rs.Gauge(name="patch", kind="pressure", lower=(0.0, 0.0, 0.0), upper=(0.0, DEPTH, 0.0), every=0.02),
    rs.Gauge(name="level", kind="level", lower=(0.5, 0.0, 0.0), upper=(0.5, 2 * DEPTH, 0.0), every=0.02),
    rs.Gauge(name="at_wall", kind="level", lower=(0.0, 0.0, 0.0), upper=(0.0, 2 * DEPTH, 0.0), every=0.02),
    rs.Gauge(name="flux", kind="flux", lower=(0.5, 0.0, 0.0), upper=(0.5, 1.5 * DEPTH, 0.0), every=0.02),
)  # fmt: skip


def tank(cells=8, gauges=GAUGES):
    """Water 1 m deep in a box of its own width, open above the water."""
    return water(cells, 3.0, 2, "float32").with_(gauge=gauges)


def test_gauges_repeat_bit_for_bit_and_change_nothing():
    read = []
    for threads in (1, 2):
        simulation = run_to(rs.Simulation(tank(8), "cpu", threads=threads), 0.2)
        read.append((simulation.gauge("floor").values, simulation.gauge("level").values, simulation.field("velocity")))
    alone = run_to(rs.Simulation(tank(8, ()), "cpu"), 0.2)
    assert all(np.array_equal(a, b) for a, b in zip(*read))
    assert np.array_equal(read[0][2], alone.field("velocity"))


@pytest.mark.parametrize(("dim", "dtype"), [(2, "float32"), (2, "float64"), (3, "float32")])
def test_air_above_a_surface_has_no_pressure(dim, dtype):
    """To a support radius above it; a patch half of which is dry reads a quarter of rho g H."""
    above, scene = [[0.5] * 3 for _ in range(4)], water(4, 2.6, dim, dtype)
    for k, point in enumerate(above):
        point[dim - 1] = DEPTH * (1 + 0.15 * k)
    upper = (0.0, 2 * DEPTH, 0.0) if dim == 2 else (0.0, DEPTH, 2 * DEPTH)
    gauges = [Gauge(name=f"at_{k}", kind="pressure", at=tuple(point)) for k, point in enumerate(above)]
    patch = Gauge(name="patch", kind="pressure", lower=(0.0, 0.0, 0.0), upper=upper)
    simulation = advanced(rs.Simulation(scene.with_(gauge=(*gauges, patch)), "numpy"), 1)
    found = [float(simulation.gauge(gauge.name).values[-1, 0]) for gauge in (*gauges, patch)]
    weight = 1000.0 * 9.81 * DEPTH
    assert found[1:4] == [0.0, 0.0, 0.0]
    assert 0.0 <= found[0] < 0.1 * weight
    assert found[4] == pytest.approx(0.25 * weight, rel=0.1)


@pytest.mark.parametrize("backend", ["numpy", "cpu"])
def test_gauges_see_liquid_that_falls_as_a_whole(backend):
    """Whose lists of neighbours are kept: all of it passes a patch, and its top and pressure are found where it is."""
    gauges = (
        rs.Gauge(name="flux", kind="flux", lower=(-0.2, -0.4, 0.0), upper=(0.8, -0.4, 0.0)),
        rs.Gauge(name="level", kind="level", lower=(0.2, -3.0, 0.0), upper=(0.2, 1.0, 0.0)),
        rs.Gauge(name="pressure", kind="pressure", at=(0.2, -0.8, 0.0)),
    )
    liquid = rs.WeaklyCompressible(sound_speed=20.0, dynamic_viscosity=20.0)
    effects = (liquid, rs.Gravity(acceleration=(0.0, -9.81, 0.0)))
    block = rs.Box(cells=(5, 5, 1))
    scene = rs.Scene(dim=2, spacing=0.1, support_radius=0.26, fluid=(block,), effects=effects, gauge=gauges)
    simulation = rs.Simulation(scene, backend)
    while simulation.time < 0.5:
        simulation.step()
        top = simulation.field("position")[:, 1].max() + 0.05
        assert simulation.gauge("level").values[-1] == pytest.approx([top], abs=0.01)
    flux = simulation.gauge("flux")
    assert np.trapezoid(flux["flux"], flux.time) == pytest.approx(-0.25, rel=0.03)
    assert np.ptp(simulation.gauge("pressure").values) > 0.0


@pytest.mark.parametrize("of", ["gravity", "turn"])
def test_the_frame_exerts_no_force_on_a_solid(of):
    """Nothing touches the solid, which the frame accelerates by 3 to 10 m/s^2."""
    place = {"pivot": (0.0, 0.0, 0.0)} if of == "turn" else {}
    motion = rs.Motion(of=of, kind="sway", direction=(0.0, 0.0, 1.0), amplitude=0.3, period=1.0, **place)
    liquid = rs.WeaklyCompressible(sound_speed=20.0, dynamic_viscosity=20.0)
    scene = rs.Scene(
        spacing=0.1, support_radius=0.26, dtype="float64", fluid=(rs.Box(cells=(2, 2, 2)),), motion=(motion,),
        solid=(rs.SolidBox(lower=(1.0, 0.0, 0.0), upper=(1.2, 0.2, 0.2), density=500.0),),
        effects=(liquid, rs.Gravity(), rs.ShapeMatching(), rs.TwoWayCoupling()),
        gauge=(rs.Gauge(name="body", kind="force", on="solid 1"),),
    )  # fmt: skip
    simulation = advanced(rs.Simulation(scene, "numpy"), 3)
    assert simulation.gauge("body").values == pytest.approx(0.0, abs=1e-9)  # N, of a body of 4 kg


def test_a_pressure_in_a_tank_that_turns_needs_no_list():
    """The turn presses with 40 m/s^2 on the side; the same with the list of a run and without one that holds."""
    turn = rs.Motion(of="turn", kind="formula", direction=(0.0, 0.0, 1.0), pivot=(-10.0, 0.0, 0.0), formula="2*t")
    gauge = rs.Gauge(name="side", kind="pressure", at=(1.0, 0.25, 0.0))
    simulation = advanced(rs.Simulation(tank(10, (gauge,)).with_(motion=(turn,)), "cpu"), 3)
    listed = simulation.gauges._pressure(simulation)
    simulation.lists.squared_displacement = np.inf
    assert simulation.gauges._pressure(simulation) == pytest.approx(listed, rel=1e-4)


def test_a_simulation_without_gauges_has_none():
    simulation = rs.Simulation(tank(5, ()), "numpy")
    assert simulation.gauges is None
    with pytest.raises(rs.InputError, match="has no gauge 'floor'"):
        simulation.gauge("floor")


def test_a_restart_goes_on_without_a_gap(tmp_path):
    scene = tank(6, (*GAUGES, rs.Gauge(name="each", kind="flux", lower=(0.2, 0.0, 0.0), upper=(0.2, 1.0, 0.0))))
    whole = run_to(rs.Simulation(scene, "cpu"), 0.25)
    simulate(scene, 0.13, output=tmp_path / "run", progress=False)
    resumed = rs.Simulation.resume(tmp_path / "run", scene=scene)
    simulate(resumed, 0.25, output=tmp_path / "run", progress=False)
    run = rs.open_run(tmp_path / "run")
    assert set(run.gauges) == {gauge.name for gauge in scene.gauge}
    for name in run.gauges:
        stored, known = run.gauge(name), whole.gauge(name)
        assert np.array_equal(stored.time, known.time)
        assert np.array_equal(stored.values, known.values)
        assert (stored.columns, stored.units) == (known.columns, known.units)
    assert len(run.gauge("each")) == whole.steps + 1


def test_series_are_files(tmp_path, capsys):
    from refsim.__main__ import main

    simulate(tank(5), 0.1, output=tmp_path / "run", progress=False)
    floor = rs.open_run(tmp_path / "run").gauge("floor")
    assert (floor.columns, floor.units) == (("force_x", "force_y", "torque_z"), ("N/m", "N/m", "N"))
    assert np.array_equal(floor["force_y"], floor.values[:, 1])
    assert "force_y [N/m]" in repr(floor)
    floor.to_csv(tmp_path / "floor.csv")
    lines = (tmp_path / "floor.csv").read_text().splitlines()
    assert lines[0] == "time [s],force_x [N/m],force_y [N/m],torque_z [N]"
    assert np.array_equal(np.loadtxt(lines[1:], delimiter=",")[:, 1:], floor.values)
    assert main(["render", str(tmp_path / "run"), "--gauges", "-o", str(tmp_path / "gauges.png")]) == 0
    assert (tmp_path / "gauges.png").stat().st_size > 10_000
    with pytest.raises(rs.InputError, match="no gauge 'flor'; did you mean floor"):
        rs.open_run(tmp_path / "run").gauge("flor")
    file = tmp_path / "run" / "gauges.hdf5"
    file.write_bytes(file.read_bytes()[:-1] + b"x")
    assert "is damaged" in answer_of(capsys, ["render", str(tmp_path / "run"), "--gauges"], 2).err


@pytest.mark.parametrize(("part", "kinds"), [(rs.Gauge, gauge_kinds), (rs.Motion, motion_kinds)])
def test_a_scene_may_name_the_kinds_that_there_are_and_give_their_keys(part, kinds):
    assert set(get_args(get_type_hints(part)["kind"])) == kinds.keys()
    for kind in kinds.values():
        assert set(kind.takes) <= set(part.__struct_fields__)


@pytest.mark.parametrize("lengths", [(0.0, 0.0, 0.0), (1.5, 0.0, 0.0)])
def test_walls_leave_a_share_of_the_space_around_a_point(lengths):
    """By a sum over all wall particles and their images; with less than a tenth a point lies in the wall."""
    rng, kernel = np.random.default_rng(3), smoothing("wendland_c2", 0.26, 2)
    walls = np.column_stack([rng.uniform(0, 1.5, 400), rng.uniform(-0.5, 0.5, 400), np.zeros(400)])
    volume = rng.uniform(0.001, 0.003, 400)
    volume[np.abs(walls[:, 0] - 0.7) < 0.2] *= 3
    places = np.array([[0.05, 0.1, 0.0], [0.7, 0.0, 0.0], [1.4, -0.2, 0.0], [1.1, 0.45, 0.0]])
    plan = SimpleNamespace(
        walls=SimpleNamespace(position=walls, volume=volume),
        scene=SimpleNamespace(support_radius=0.26, period=lengths),
        shared={"period": period_group(lengths, "float64") if any(lengths) else None, "smoothing": kernel},
    )
    expected = []
    for place in places:
        apart = walls - place
        if lengths[0]:
            apart[:, 0] -= 1.5 * np.round(apart[:, 0] / 1.5)
        filled = (volume * kernel_value(np.sqrt((apart**2).sum(1)), kernel)).sum()
        expected.append(1 - filled if 1 - filled > 0.1 else math.inf)
    assert math.inf in expected
    assert sum(v < 0.9 for v in expected) > 1
    gauges = SimpleNamespace(places=places, _open=None)
    assert Gauges._liquid_share(gauges, plan) == pytest.approx(expected)
    assert Gauges._liquid_share(gauges, None) is gauges._open  # the walls stand
    plan.walls = None
    assert (Gauges._liquid_share(SimpleNamespace(places=places, _open=None), plan) == 1).all()


@pytest.mark.parametrize("sound, spacing", [(10.0, 0.1), (300.0, 0.1), (10.0, 0.5)])
def test_a_pressure_is_noted_that_no_liquid_has_at_a_wall(sound, spacing):
    """Above rho c v and twice the weight, or below that of a support radius or rho c^2/10^4."""
    notes, speed = [], 1.3
    liquid = WeaklyCompressible(sound_speed=sound, rest_density=900.0)
    pull = Gravity(acceleration=(3.0, -4.0, 0.0))
    position = np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 0.0], [0.3, 2.0, 7.0]])
    run = SimpleNamespace(
        plan=SimpleNamespace(
            effects={"weakly_compressible": liquid, "gravity": pull}, state=SimpleNamespace(position=position),
            grid=SimpleNamespace(spacing=spacing, support_radius=2.6 * spacing),
        ),
        backend=SimpleNamespace(host=lambda values: values), extremes=np.array([speed**2, 0.0]), time=0.25,
        add_note=lambda key, words: notes.append((key, words)),
    )  # fmt: skip
    deep = max(3 * x - 4 * y for x, y, _ in position) - min(3 * x - 4 * y for x, y, _ in position)
    most = 900 * (sound * speed + 2 * (deep + 5 * spacing) + sound**2 / 1e4)
    least = -900 * max(5 * 2.6 * spacing, sound**2 / 1e4)
    for instants, advice in ((0, "give it instants"), (4, "take pressure_mean")):
        gauge = Gauge(name="at", kind="pressure", at=(0.0, 0.0, 0.0), every=0.1, instants=instants)
        for pressure, words in (
            (0.999 * most, ""), (1.001 * most, "twice the weight"), (0.999 * least, ""), (1.001 * least, "below zero"),
        ):  # fmt: skip
            notes.clear()
            Gauges._note_pressure(SimpleNamespace(dim=2), run, gauge, pressure)
            assert bool(notes) == bool(words)
            for key, said in notes:
                assert key == "gauge at"
                for part in (words, advice, f"{pressure:.4g} Pa", f"{most if pressure > 0 else -least:.3g} Pa"):
                    assert part in said
    run.plan.effects["particle_shifting"] = SimpleNamespace(surface="none")
    notes.clear()
    Gauges._note_pressure(SimpleNamespace(dim=2), run, gauge, 9 * most)
    assert not notes
