"""Panels: the rules that choose a setting, packaged scenes and observables, and what was measured of them."""

import sys
import zipfile

import msgspec
import pytest

from refsim.core.errors import InputError
from refsim.scene.plan import make_plan
from refsim.study import advice
from refsim.study.advice import cheapest, least, settings
from refsim.study.observables import observable_of
from refsim.study.panels import FOLDER, OWN, Machine, Panel, PanelSpec, Point, abouts, as_text, panel, parse
from refsim.study.panels import measured as measuring
from refsim.study.panels.measured import measured, merged, reading_of
from refsim.study.panels.scenes import packaged, packed, scene_of
from refsim.study.runs import Setting, measure
from tests.running import rows


def point(key, error, seconds=1.0, **more):
    knobs = {"dtype": "float32", **more.pop("knobs", {})}
    given = {"value": error, "error": error, "seconds": [seconds], "particles": 100}
    return Point(key, 0, words=f"keeps {error}", knobs=knobs, **(given | more))


def made(*points, **about):
    words = dict.fromkeys(("words", "relative", "observed", "reference", "page"), "a")
    return Panel(
        "a", PanelSpec(**words, base="b", **about), (Machine("m", 1, "2026-01-01"),), {p.key: p for p in points}
    )


def key(found):
    return found and found[1].key


def test_the_cheapest_within_the_error_is_advised():
    of = made(*(point(f"{k}", e, t, knobs={"way": k}) for k, (e, t) in enumerate(((0.2, 1), (0.01, 5), (0.001, 50)))))
    assert [key(cheapest(of, error)) for error in (0.5, 0.01, 0.005, 1e-4)] == ["0", "1", "2", None]
    assert [key(least(of, seconds=t)) for t in (0.5, 1, 10, 99)] == [None, "0", "1", "2"]
    assert key(cheapest(made(), 0.1)) is None
    with_uncertainty = made(*of.points.values(), uncertainty=0.02)
    assert [key(cheapest(with_uncertainty, error)) for error in (0.03, 0.025, 0.02)] == ["1", "2", None]
    single, double = (point(d, e, 3.0 - e, knobs={"dtype": d}) for d, e in (("float32", 0.02), ("float64", 0.03)))
    of = made(single, double)
    assert key(cheapest(of, 0.05)) == "float32"
    assert key(cheapest(made(msgspec.structs.replace(single, error=0.2), double), 0.05)) == "float64"
    gpu = point("cuda_ours", 0.01, knobs={"backend": "cuda"})
    of = made(point("ours", 0.04, 3.0), gpu, point("theirs", 0.01, program="other"))
    assert {kind: [(e, p.key) for e, p in settings(of, kind)] for kind in ("cpu", "gpu", "peer")} == {
        "cpu": [(0.04, "ours")], "gpu": [(0.04, "cuda_ours")], "peer": [(0.01, "theirs")],
    }  # fmt: skip


# What is stored
@pytest.mark.parametrize("name", abouts())
def test_stored_panels_are_whole(name):
    """Their files are those that are written of them; every point was measured somewhere; the base is among them."""
    of = panel(name)
    assert (FOLDER / f"{name}.json").read_text() == as_text(of)
    assert of.about.base in of.points
    assert {*of.about.bars, *(of.about.limit_of or ())} <= of.points.keys()
    alike = [(p.program, sorted(map(str, p.knobs.items()))) for p in of.points.values()]
    assert all(alike.count(one) == 1 for one in alike), "settings are told apart by their knobs"
    for p in of.points.values():
        assert p.place >= 0
        assert p.failed or p.seconds
        assert of.places[p.place].commit
        assert bool(of.places[p.place].device) == p.gpu


def test_a_panel_is_its_toml_and_its_observable(tmp_path, monkeypatch):
    """Settings that were not measured are no answer, and belie none; what is measured of them is."""
    file = tmp_path / "spinning_body.toml"
    file.write_text((FOLDER / "spinning_body.toml").read_text())
    monkeypatch.setattr(sys.modules["refsim.study.panels"], "FOLDER", tmp_path)
    for cached in (abouts, panel):
        cached.cache_clear()
    try:
        new = panel("spinning_body")
        assert list(abouts()) == ["spinning_body"]
        assert (cheapest(new, 0.5), least(new), new.places) == (None, None, ())
        point, knobs = new.points["n4_w2_s200"], {"backend": "numpy"}  # which compiles nothing
        here = msgspec.structs.replace(point, knobs=point.knobs | knobs)
        read = lambda point, number: reading_of(new, here, scene_of(new, point, number))  # noqa: E731
        known = merged(new, measured(new, [point.key], readings=1, read=read))
        assert key(cheapest(known, 0.01)) == "n4_w2_s200"
        assert [p.key for p in parse(as_text(known)).points.values() if p.place >= 0] == ["n4_w2_s200"]
    finally:
        for cached in (abouts, panel):
            cached.cache_clear()


@pytest.mark.parametrize("text", ["{}", "[1]", '{"schema": "another"}', "no json"])
def test_another_file_is_refused_with_a_sentence(text):
    with pytest.raises(InputError, match="no stored panel"):
        parse(text)
    with pytest.raises(InputError, match="did you mean front"):
        panel("frnt")


# Packaged scenes
LONG = rows(__file__, "long_panels")


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (n in LONG)) for n in abouts()])
def test_settings_of_a_packaged_panel_have_scenes(name):
    """With the particles and, on the same fields, the bytes that were measured."""
    of = panel(name)
    count = 0
    own = [p for p in of.points.values() if p.program == OWN and not p.failed]
    for p in own[:: 1 + len(own) // 20]:
        plan = make_plan(scene_of(of, p))
        assert plan.grid.count == p.particles
        assert plan.scene.dtype == p.knobs["dtype"]
        count += 1
    assert count
    assert scene_of(of, of.points[of.about.base]).spacing == packaged(name).spacing


STORED = {(name, setting): tolerance for name, setting, tolerance in rows(__file__, "stored")}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "setting"), STORED)
def test_a_packaged_study_gives_the_stored_value(name, setting):
    """Those that take long in several readings, whose starts may differ."""
    of = panel(name)
    found = measured(of, [setting], readings=advice.READINGS if name in LONG else 1)
    (row,) = measuring.rows(of, found)
    assert row["value"] == pytest.approx(row["stored_value"], rel=STORED[name, setting])
    assert row["particles"] == of.points[setting].particles
    assert of.points[setting].bytes in (None, row["bytes"])
    assert "stored value" in measuring.text(of, found)
    again = merged(of, found)
    assert again.points.keys() == of.points.keys()
    assert again.points[setting].place == len(again.places) - 1
    assert parse(as_text(again)).points[setting].value == row["value"]


@pytest.mark.slow
def test_a_drop_that_was_stirred_is_measured_from_its_packaged_scene():
    """A small one keeps 30 %; what ran on a GPU has the scene of a CPU."""
    of = panel("surface_tension_jump")
    small = of.points["akinci_r8"]
    (row,) = measuring.rows(of, measured(of, [small.key], readings=1))
    assert 0 < abs(row["value"] - 1.0) < 0.3
    assert row["particles"] == small.particles == len(scene_of(of, small, 1).fluid[0].position)
    assert row["steps"] > 10
    with zipfile.ZipFile(str(FOLDER / f"{of.name}.zip")) as stored:
        assert set(stored.namelist()) == {packed(point) for point in of.points.values()}


# Observables that watch a run
def watching(times, reduce):
    def time(simulation):
        return float(simulation.time)

    time.times, time.reduce = times, reduce
    return time


def test_an_observable_is_read_at_its_moments_and_reduced():
    scene = msgspec.structs.replace(packaged("spinning_body"), end_time=0.1)
    plan, seen = make_plan(scene), {}

    def reduce(times, values):
        seen["times"], seen["values"] = times.tolist(), values
        return sum(values)

    read = observable_of(watching(lambda scene: [0.08, 0.02], reduce), plan)
    found = measure(Setting("spacing", "", 1.0, scene, "numpy"), read, repeats=1)
    assert (found.value, seen["times"]) == (pytest.approx(0.1), pytest.approx([0.02, 0.08], abs=1e-12))
    assert found.time >= scene.end_time
    assert found.steps >= 20
    broken_times = observable_of(watching(lambda scene: 1 / 0, reduce), plan)
    assert "cannot be read (ZeroDivisionError" in measure(Setting("", "", 1.0, scene, "numpy"), broken_times).failed


def test_what_is_measured_is_told_of_its_machine(monkeypatch):
    monkeypatch.setattr(measuring, "machine", lambda: "a processor, 8 cores")
    found = measuring._here("numpy")
    assert (found.machine, found.threads, found.device) == ("a processor", 1, "")
