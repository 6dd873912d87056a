"""Gauges say what the liquid does: weights, pressures, levels and fluxes that are known, on each backend."""

from typing import get_args, get_type_hints

import numpy as np
import pytest

import refsim as rs
from refsim import make_plan
from refsim.engine.driver import simulate
from refsim.gauges import KINDS as gauge_kinds
from refsim.motion import KINDS as motion_kinds
from tests.running import rows, run_to
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


def test_gauges_that_are_not_there_or_of_one_name_are_refused(tmp_path):
    simulation = rs.Simulation(tank(5, ()), "numpy")
    assert simulation.gauges is None
    with pytest.raises(rs.InputError, match="has no gauge 'floor'"):
        simulation.gauge("floor")
    from refsim.__main__ import main

    with pytest.raises(rs.InputError, match="two gauges have the name 'floor'"):
        make_plan(tank(5, (GAUGES[0], GAUGES[0])))
    text = 'spacing = 0.1\nsupport_radius = 0.2\n[[fluid]]\nshape = "box"\ncells = [2, 2, 2]\n[[gauge]]\nname = "a"\n'
    file = tmp_path / "scene.toml"
    file.write_text(text + 'kind = "force"\non = "-x"\n')
    assert main(["plan", str(file)]) == 2
    file.write_text(text + 'kind = "forces"\n')
    assert main(["plan", str(file)]) == 2
    with pytest.raises(rs.InputError, match="gauge few: instants lie between two values; give every"):
        make_plan(tank(5, (rs.Gauge(name="few", kind="force", on="-x", instants=4),)))


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
    assert main(["render", str(tmp_path / "run"), "--gauges"]) == 2
    assert "is damaged" in capsys.readouterr().err


@pytest.mark.parametrize(("gauge", "words"), rows(__file__, "bad_gauges"))
def test_bad_gauges_are_refused_in_a_sentence(gauge, words):
    with pytest.raises(rs.InputError, match=words) as caught:
        make_plan(tank(5, (rs.Gauge(**gauge),)))
    assert str(caught.value).startswith(("gauge ", "[[gauge]] number 1: ", "Gauge: "))


@pytest.mark.parametrize(("part", "kinds"), [(rs.Gauge, gauge_kinds), (rs.Motion, motion_kinds)])
def test_a_scene_may_name_the_kinds_that_there_are_and_give_their_keys(part, kinds):
    assert set(get_args(get_type_hints(part)["kind"])) == kinds.keys()
    for kind in kinds.values():
        assert set(kind.takes) <= set(part.__struct_fields__)
