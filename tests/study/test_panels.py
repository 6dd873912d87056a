"""Panels: the rules that choose a setting, packaged scenes and observables, and what was measured of them."""

import math

import msgspec
import pytest

from refsim.core.errors import InputError
from refsim.scene.plan import make_plan
from refsim.study.advice import own_error
from refsim.study.choice import (
    REPEATS,
    Candidate,
    candidates,
    choose,
    instability,
    kinds,
    least_error,
    physics,
    unsettled,
)
from refsim.study.observables import observable_of
from refsim.study.panels import FOLDER, OWN, About, Panel, Place, Point, abouts, as_text, panel, parse
from refsim.study.panels import measured as measuring
from refsim.study.panels.making import STIRRED_DROPS
from refsim.study.panels.measured import measured, merged
from refsim.study.panels.scenes import packaged, scene_of
from refsim.study.runs import Reading, Setting, measure

STEADY = [1.0, 1.01, 0.99, 1.0, 1.005]
SCATTERED = [1.0, 1.3, 0.7, 1.2, 0.8]
SKEWED = [1.0, 1.0, 1.0, 1.01, 1.09, 1.08, 1.06, 1.0]  # a small deviation from the median, a wide middle half
STIRRED = [made.__name__ for made in STIRRED_DROPS]  # whose scenes take seconds
SOLIDS = ("boundary_sampling", "signed_distance")  # whose particles are those of a mesh, beside a little water


def point(key, error, seconds, scatter=STEADY, **more):
    knobs = more.pop("knobs", {"dtype": "float32"})
    given = {"value": error, "error": error, "seconds": [seconds * s for s in scatter], "particles": 100}
    return Point(key, f"keeps {error}", 0, knobs, **(given | more))


def made(*points, **about):
    words = dict.fromkeys(("words", "relative", "observed", "reference", "page"), "a")
    return Panel("a", About(**words, base="b", **about), (Place("m", 1, "2026-01-01"),), {p.key: p for p in points})


def chosen(of, error):
    return choose(candidates(of), error)


def key(choice):
    return choice.advised and choice.advised.point.key


def test_the_cheapest_that_keeps_the_error_is_advised():
    of = made(point("rough", 0.2, 1.0), point("fine", 0.01, 5.0), point("best", 0.001, 50.0), point("slow", 0.01, 9.0))
    assert key(chosen(of, 0.5)) == "rough"
    choice = chosen(of, 0.01)
    assert (key(choice), choice.seconds, choice.notes) == ("fine", 5.0, ())
    none = chosen(of, 0.0001)
    assert none.advised is None
    assert none.why == "not reached: keeps 0.001 has an error of 0.1 % after 50 s"
    assert chosen(made(), 0.1).why == "not measured"


@pytest.mark.parametrize("scatter", [SCATTERED, SKEWED, STEADY[:4]])
def test_an_unsettled_timing_is_never_advised_and_never_passed_over_in_silence(scatter):
    cheap = point("cheap", 0.01, 1.0, scatter)
    choice = chosen(made(cheap, point("settled", 0.01, 1.015)), 0.05)
    assert key(choice) == "settled"
    assert choice.notes[0].startswith("passed over: keeps 0.01 was read at ")
    none = chosen(made(cheap), 0.05)
    assert none.advised is None
    assert none.why.startswith("not advised: one setting reaches it, none in a settled time; keeps 0.01 was read at ")


def test_a_costlier_setting_is_not_advised_where_an_unsettled_one_is_faster_beyond_its_scatter():
    cheap = point("cheap", 0.01, 1.0, SCATTERED)
    choice = chosen(made(cheap, point("settled", 0.01, 3.0)), 0.05)
    assert choice.advised is None
    assert choice.why == (
        "not advised: keeps 0.01 was read at 1 s (700 ms to 1.3 s), but scatters by 30 %; keeps 0.01 in a settled 3 s"
        " costs more"
    )
    assert key(chosen(made(cheap, point("settled", 0.01, 1.2)), 0.05)) == "settled"


@pytest.mark.parametrize(
    ("seconds", "said"),
    [(STEADY, ""), (STEADY[:4], "only 4 of 5"), (SCATTERED, "scatters by 30"), ([0.0] * 5, "no time")],
)
def test_unstable_times_are_flagged(seconds, said):
    assert instability(seconds).startswith(said)
    assert bool(unsettled(seconds)) == bool(said)
    assert instability([1.0] * 8 + [2.0, 2.0]).startswith("slow repeats take 2.0 times")


def test_an_error_that_a_finer_spacing_does_not_keep_is_kept_by_chance():
    coarse, middle, fine = (
        point(str(d), error, 0.2 / d, knobs={"spacing": d}) for d, error in ((0.2, 0.002), (0.1, 0.02), (0.05, 0.004))
    )
    of = made(coarse, middle, fine)
    assert key(chosen(of, 0.05)) == "0.2"
    choice = chosen(of, 0.01)
    assert key(choice) == "0.05"
    assert choice.notes == ("passed over: keeps 0.002 has an error of 0.2 % by chance, keeps 0.02 of 2 %",)
    none = chosen(made(coarse, fine), 0.001)
    assert none.advised is None
    assert none.nearest.point.key == "0.05"


def test_float64_is_advised_only_where_it_changes_the_error():
    def advised(single, double, mad=0.0):
        both = (("float32", single, 3.0), ("float64", double, 1.0))
        of = made(*(point(d, e, s, knobs={"dtype": d}, error_mad=mad) for d, e, s in both))
        return key(chosen(of, 0.05))

    assert (advised(0.02, 0.02), advised(0.02, 0.0199), advised(0.02, 0.01)) == ("float32", "float32", "float64")
    assert advised(0.02, 0.01, mad=0.01) == "float32"
    assert key(chosen(made(point("float64", 0.02, 1.0, knobs={"dtype": "float64"})), 0.05)) == "float64"


def test_a_setting_that_was_stopped_is_no_candidate():
    stopped, good = point("stopped", 0.01, 0.5, failed="diverged"), point("good", 0.01, 3.0)
    assert (key(chosen(made(stopped, good), 0.05)), chosen(made(stopped), 0.05).why) == ("good", "not measured")
    coarse, fine = point("coarse", 0.01, 1.0, knobs={"spacing": 2}), point("fine", 0.01, 2.0, knobs={"spacing": 1})
    found = kinds(made(coarse, msgspec.structs.replace(fine, failed="diverged")))
    assert choose(found["cpu"], 0.05, physics(found)).notes[0].endswith("by chance, keeps 0.01 stops")


def test_an_answer_is_given_where_error_and_uncertainty_of_the_reference_allow_it():
    of = made(point("coarse", 0.03, 1.0), point("fine", 0.001, 5.0), uncertainty=0.02)
    assert [key(chosen(of, error)) for error in (0.06, 0.04, 0.02)] == ["coarse", "fine", None]
    assert chosen(of, 0.02).why == "not reached: keeps 0.001 has an error of 2.1 % after 5 s"
    assert least_error(kinds(of)["cpu"], 2.0, kinds(of)["cpu"]) == pytest.approx(0.05)
    falling = made(point("run", 0.01, 4.0, reached=[(0.5, 1.0), (0.05, 2.0), (0.01, 4.0)]), uncertainty=0.02)
    assert [chosen(falling, error).seconds for error in (0.6, 0.06, 0.04)] == [1.0, 4.0, 4.0]


def test_errors_are_taken_from_the_converged_value():
    """v(d) = 2 + d: the limit is 2 and the error d/2; the uncertainty is 1.25 times the error of the finest."""
    points = [point(f"d{n}", 9.9, 1.0, value=2 + 1 / n, knobs={"spacing": 1 / n}) for n in (5, 10, 20)]
    of = made(*points, limit_of=("d5", "d10", "d20"))
    assert {c.point.key: c.error for c in candidates(of)} == pytest.approx({"d5": 0.1, "d10": 0.05, "d20": 0.025})
    assert (of.reference(), key(chosen(of, 0.06))) == (pytest.approx((2.0, 2.0, 1.25 * 0.025)), "d20")
    assert chosen(of, 0.05).advised is None


def test_kinds_of_machines_and_programs_stand_apart():
    gpu = point("cuda_ours", 0.01, 1.0, knobs={"backend": "cuda"})
    found = kinds(made(point("ours", 0.01, 3.0), gpu, point("theirs", 0.01, 1.0, program="other")))
    assert {kind: [c.point.key for c in some] for kind, some in found.items()} == {
        "cpu": ["ours"], "gpu": ["cuda_ours"], "peer": ["theirs"], "stopped": [],
    }  # fmt: skip


def test_physics_decides_once():
    """A setting that keeps an error on one machine only is advised for it on neither."""
    gpu = point("cuda_a", 0.06, 1.0, knobs={"backend": "cuda"})
    found = kinds(made(point("a", 0.04, 3.0), gpu, point("b", 0.01, 9.0)))
    assert {c.point.key: c.error for kind in found for c in found[kind]} == {"a": 0.06, "cuda_a": 0.06, "b": 0.01}
    assert key(choose(found["cpu"], 0.05)) == "b"
    assert choose(found["gpu"], 0.05).advised is None


def test_an_error_kept_by_chance_is_so_on_every_machine():
    """The finer spacing that does not keep it ran on a CPU alone; none advises the coarse one, on a GPU neither."""
    coarse, fine = (point(f"d{d}", error, 1.0, knobs={"spacing": d}) for d, error in ((0.2, 0.002), (0.1, 0.02)))
    gpu = point("cuda_d0.2", 0.001, 0.1, knobs={"spacing": 0.2, "backend": "cuda"})
    found = kinds(made(coarse, fine, gpu))
    assert key(choose(found["gpu"], 0.05, known=physics(found))) == "cuda_d0.2"
    assert key(choose(found["gpu"], 0.05)) == "cuda_d0.2"
    for kind in ("cpu", "gpu"):
        assert choose(found[kind], 0.01, known=physics(found)).advised is None
        assert least_error(found[kind], 9.0, physics(found)) == (0.02 if kind == "cpu" else None)


def test_an_error_is_said_with_what_is_known_of_it():
    of = made(unit="m")
    assert own_error(of, Candidate(point("a", 0.03, 1.0), 0.03, 0.001)) == "3 %"
    assert own_error(of, Candidate(point("a", 0.03, 1.0), 0.03), reached=False) == "at least 3 %"
    for reached in (True, False):
        assert own_error(of, Candidate(point("a", 0.01, 1.0), 0.03, 0.01), reached) == "at most 4 %"
    assert own_error(of, Candidate(point("b", 0.03, 1.0, error_mad=0.002), 0.03)) == "3 % ± 0.3 %"


def test_the_least_error_within_some_seconds():
    falling = point("falling", 0.01, 8.0, reached=[(0.5, 1.0), (0.05, 2.0), (0.01, 8.0)])
    found = kinds(
        made(point("rough", 0.2, 1.0), falling, point("fine", 0.001, 50.0), point("new", 0.1, 0.1, SCATTERED))
    )
    assert [least_error(found["cpu"], s, found["cpu"]) for s in (0.5, 1.5, 3.0, 10.0, 60.0)] == [
        None, 0.2, 0.05, 0.01, 0.001,
    ]  # fmt: skip


# What is stored
@pytest.mark.parametrize("name", abouts())
def test_stored_panels_are_whole(name):
    """Their files are those that are written of them; every point was measured somewhere; the base is among them."""
    of = panel(name)
    assert (FOLDER / f"{name}.json").read_text() == as_text(of)
    assert of.about.base in of.points
    assert {*of.about.bars, *(of.about.limit_of or ())} <= of.points.keys()
    for p in of.points.values():
        assert p.failed or len(p.seconds) >= 5
        assert of.places[p.place].commit
        assert bool(of.places[p.place].device) == p.gpu


@pytest.mark.parametrize("text", ["{}", "[1]", '{"schema": "another"}', "no json"])
def test_another_file_is_refused_with_a_sentence(text):
    with pytest.raises(InputError, match="no stored panel"):
        parse(text)
    with pytest.raises(InputError, match="did you mean front"):
        panel("frnt")


# Packaged scenes
LONG = {  # left to the nights: scenes that take 10 s to make, settings that take 5 s to run
    "mpm_pressure", "tank_pressure", "contact_angle", "droplet", "implicit_pressure", "coupling", "detection_3d",
    "melt_front", "detection_2d", "spinning_body", *SOLIDS, "surface_normals",
}  # fmt: skip
AGAIN = {("heat", "runge_kutta_legendre_8")}  # which melting has by day


def at_night(given, name):
    return pytest.param(*given, marks=[pytest.mark.slow] if name in LONG or given in AGAIN else [])


@pytest.mark.parametrize("name", [at_night((n,), n) for n in abouts()])
def test_settings_of_a_packaged_panel_have_scenes(name):
    """With the particles and, on the same fields, the bytes that were measured."""
    of = panel(name)
    count = 0
    own = [p for p in of.points.values() if p.program == OWN and not p.failed and not p.gpu]
    for p in own[:1] if name in STIRRED else own[:: 1 + len(own) // 20]:
        plan = make_plan(scene_of(of, p))
        assert name in SOLIDS or plan.grid.count == p.particles
        assert plan.scene.dtype == p.knobs["dtype"]
        count += 1
    assert count
    if name not in STIRRED:
        assert scene_of(of, of.points[of.about.base]).spacing == packaged(name).spacing


STORED = {  # relative tolerance of settings whose value is computed here and is the stored one
    ("front", "d10"): 5e-3,
    ("droplet", "d9"): 0.12,  # rounding decides how its symmetry breaks: seeds differ by 30 %
    ("spinning_body", "n6_w2_s50"): 1e-5,
    ("heat", "implicit_8"): 1e-5,
    ("heat", "runge_kutta_legendre_8"): 1e-5,
    ("melt_front", "runge_kutta_legendre_10_2"): 1e-5,
    ("implicit_pressure", "implicit_10"): 1e-3,
    ("implicit_pressure", "rests_10"): 1e-3,
    ("tank_pressure", "n6"): 1e-3,
    ("melting", "runge_kutta_legendre_5_2"): 1e-6,
    ("mpm_pressure", "r5.5"): 5e-3,  # lattices that are turned otherwise differ by so much
    ("contact_angle", "r5"): 2e-2,  # seeds differ by so much
    ("detection_2d", "two_step_0.90_half_color_float32"): 1e-6,
    ("detection_3d", "two_step_0.90_half_color_float32"): 1e-6,
    ("surface_normals", "gradient_0.25_1_float32"): 2e-3,
    ("signed_distance", "h0.16"): 1e-3,
    ("boundary_sampling", "k1000_half"): 1e-2,
    ("coupling", "n4"): 1e-2,
    ("wall_force", "n8"): 1e-4,
    ("vortex_decay", "n50_h3.2"): 2e-3,  # rounding decides how the lattice breaks: of 25 along a side by 2 %
}


@pytest.mark.parametrize(("name", "setting"), [at_night(given, given[0]) for given in STORED])
def test_a_packaged_study_gives_the_stored_value(name, setting, monkeypatch):
    """At night in several readings, whose starts may differ; by day in one, whose start is always the same."""
    monkeypatch.setattr(measuring, "MOST", 1)
    found = measured(panel(name), [setting], threads=1, readings=REPEATS if name in LONG else 1)
    (row,) = found.rows()
    assert row["value"] == pytest.approx(row["stored_value"], rel=STORED[name, setting])
    if name not in SOLIDS:
        assert row["particles"] == panel(name).points[setting].particles
        assert panel(name).points[setting].bytes in (None, row["bytes"])
    assert "stored value" in found.text()
    again = merged(found)
    assert again.points.keys() == panel(name).points.keys()
    assert again.points[setting].place == len(again.places) - 1
    assert parse(as_text(again)).points[setting].value == row["value"]


def test_a_stirred_drop_is_measured():
    """A small one keeps 30 %, from seed to seed."""
    point = panel("surface_tension_jump").points["akinci_r8"]
    found = measured(panel("surface_tension_jump"), [point.key], threads=1, readings=1)
    (row,) = found.rows()
    assert 0 < abs(row["value"] - 1.0) < 0.3
    assert row["particles"] == point.particles
    assert row["steps"] > 10


def test_what_cannot_be_measured_is_said(monkeypatch):
    with pytest.raises(InputError, match="has no setting 'd11'"):
        measured(panel("front"), ["d11"])
    failing = Reading(math.nan, 1.0, 1.0, 0, 5, 3, 0.1, failed="collapsed.")
    monkeypatch.setattr(measuring, "measure", lambda *given, **more: failing)
    found = measured(panel("front"), ["d10"])
    assert found.here.points["d10"].failed == "collapsed."
    assert "d = L/10, float32: collapsed." in found.text()


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
    found = measure(Setting("spacing", "", 1.0, scene, "cpu"), read, threads=1, repeats=1)
    assert (found.value, seen["times"]) == (pytest.approx(0.1), pytest.approx([0.02, 0.08], abs=1e-12))
    assert [value for _, value in found.curve] == seen["values"]
    assert found.curve[0][0] < found.curve[1][0] < found.seconds
    assert found.time >= scene.end_time
    assert found.steps >= 20
    broken_times = observable_of(watching(lambda scene: 1 / 0, reduce), plan)
    assert "cannot be read (ZeroDivisionError" in measure(Setting("", "", 1.0, scene, "cpu"), broken_times).failed
