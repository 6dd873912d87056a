"""What accuracy costs: statistics, the report, its sentence and picture, comparing reports, and tiny real panels."""

import io
import json
import math
import sys

import numpy as np
import pytest

from refsim.core.errors import InputError, RunStopped
from validation import accuracy, accuracy_picture, results
from validation.__main__ import main
from validation.checks import ACCURACY, Check, Checks
from validation.experiment import Band, Experiment, Options, Panel, Picture, Run, discover
from validation.experiments.boundary import tank_runs
from validation.experiments.dam_break import accuracy as dam_panels
from validation.experiments.dam_break import accuracy_runs as dam_runs
from validation.experiments.droplet import accuracy as drop_panels
from validation.experiments.droplet import accuracy_runs as drop_runs
from validation.experiments.laplace import accuracy as tension_panels
from validation.experiments.melting import float_runs
from validation.experiments.mpm_droplet import accuracy as mpm_panels
from validation.experiments.mpm_droplet import frequency_runs
from validation.experiments.solutions import pressure_runs
from validation.experiments.surface_reconstruction import accuracy as surface_panels
from validation.gpu_readings import gpu_runs, keep, reported, without_gpu
from validation.metrics import shapes
from validation.metrics.droplet import radius_variation_scale
from validation.perform import EXIT_FAILED, EXIT_STOPPED, exit_code, write_data
from validation.reading import Reading, distribution, environment, first_kept, kept_error, measured
from validation.report import report
from validation.results import Result
from validation.running import Context
from validation.start_up import start_up
from validation.work_precision import (
    BETTER,
    REPEATS,
    SAME,
    UNSURE,
    WORSE,
    error_verdict,
    instability,
    order_from_errors,
    order_from_values,
    pareto,
    time_verdict,
)

STEADY = (1.0, 1.01, 0.99, 1.0, 1.005)


# Statistics


def test_pareto_front_holds_what_nothing_beats():
    errors = [0.3, 0.1, 0.2, 0.05, 0.05, float("nan"), 0.01]
    seconds = [1.0, 2.0, 3.0, 4.0, 5.0, 0.1, float("nan")]
    points = [{"error": e, "seconds": s} for e, s in zip(errors, seconds)]
    assert pareto(points) == [0, 1, 3]  # 2 is beaten by 1, 4 equals 3 but is slower; no failure, no missing time
    assert pareto([]) == []
    assert pareto([{"error": 1.0, "seconds": 1.0}] * 2) == [0]


@pytest.mark.parametrize(
    ("seconds", "said"),
    [
        (STEADY, ""),
        ((1.0, 1.0, 1.0, 1.0), "only 4 of 5"),
        ((1.0, 1.2, 0.8, 1.1, 0.9), "scatters by 15 %"),
        ((1.0, 1.0, 1.0, 1.0, 3.0), "2.2 times the fast"),
        ((1.0,) * 20 + (3.0,), ""),  # one hiccup among many does not move the median
        ((0.0,) * 5, "no time"),
    ],
)
def test_unstable_times_are_flagged(seconds, said):
    found = instability(seconds)
    assert said in found
    assert bool(said) == bool(found)


def test_order_from_errors():
    size = [0.4, 0.2, 0.1, 0.05]
    fine = order_from_errors(size, [3 * s**2 * (1 + 0.01 * k) for k, s in enumerate(size)], 2.0)
    assert fine.asymptotic
    assert fine.order == pytest.approx(2.0, abs=0.02)
    assert fine.low < fine.order < fine.high
    assert "not in the asymptotic range" not in fine.words
    for error in ([0.1, 0.02, 0.05, 0.04], [0.1, 0.099, 0.098, 0.097]):  # rises on the way; hardly falls
        rough = order_from_errors(size, error, 2.0)
        assert not rough.asymptotic
        assert "not in the asymptotic range" in rough.words
    free = order_from_errors(size, [0.1 * s**1.5 for s in size], None)
    assert free.asymptotic
    assert "no theory" in free.words
    assert "2 of 3 sizes" in order_from_errors(size[:2], [0.2, 0.1], 2.0).words


def test_order_from_values_needs_no_reference():
    size = [0.4, 0.25, 0.1, 0.08]  # unequal ratios
    found = order_from_values(size, [1.7 + 0.3 * s**2 for s in size], 2.0)
    assert found.asymptotic
    assert found.order == pytest.approx(2.0, abs=1e-6)
    assert found.limit == pytest.approx(1.7, abs=1e-9)
    assert found.uncertainty == pytest.approx(1.25 * 0.3 * 0.08**2, rel=1e-6)
    first = order_from_values(size, [1.7 + 0.3 * s for s in size], 2.0)
    assert first.order == pytest.approx(1.0, abs=1e-6)
    assert "not in the asymptotic range" in first.words
    wild = order_from_values([0.4, 0.2, 0.1], [1.0, 1.2, 1.1], 2.0)
    assert math.isnan(wild.order)
    assert "not in the asymptotic range" in wild.words
    assert "last refinement changes 0.1" in wild.words


def test_errors_that_are_kept():
    error = [1.0, 0.5, 0.02, 0.4, 0.03, 0.05, 0.04, 0.03, 0.05]
    assert kept_error(error) == 0.05
    assert first_kept(error, 0.05) == 4  # not 2: it was left again
    assert first_kept(error, 0.04) is None
    assert first_kept([0.1, 0.1], 0.2) == 0
    assert math.isnan(kept_error([0.1, 0.2, float("nan")]))
    assert first_kept([0.1, float("nan")], 1.0) is None
    assert first_kept([], 1.0) is None


def test_distributions_are_of_magnitudes():
    found = distribution(np.concatenate([np.full(98, -0.1), [1.0, -2.0]]))
    assert found["median"] == pytest.approx(0.1)
    assert 1.0 <= found["p99"] < found["max"] == 2.0
    assert math.isnan(distribution([])["max"])


def test_environment_names_what_computes():
    found = environment(3, "cpu")
    assert found["threads"] == 3
    assert {"numba", "numpy", "python", "refsim"} <= set(found["versions"])
    assert {"commit", "changed"} == set(found["source"])
    assert {"processor", "cores", "clock_mhz", "load", "device", "timer"} <= set(found)
    json.dumps(found)


# A panel made up for the tests


def reading(key, error, seconds, group="ours", **more):
    knobs = {"program": group, "spacing": 0.1, "step": 1.0, **more.pop("knobs", {})}
    seconds = [seconds * s for s in STEADY] if isinstance(seconds, float) else seconds
    parts = {"list": [0.25 * s for s in seconds], "step": [0.75 * s for s in seconds]}
    given = {"value": error, "parts": parts, "per_step": [s / 100 for s in seconds], "particles": 1000,
             "launches": 5, "bytes": 40, "beside": {"output": [0.1 * s for s in seconds]}, **more}  # fmt: skip
    return Reading(key, f"setting {key}", knobs, error=error, seconds=seconds, **given)


READINGS = (
    reading("rough", 0.08, 1.0),
    reading("middle", 0.02, 4.0, knobs={"spacing": 0.05}),
    reading("wasteful", 0.05, 8.0),
    reading("fine", 0.005, 16.0, knobs={"spacing": 0.025}, launches=7, bytes=48, particles=64000),
    reading("theirs", 0.03, 10.0, "theirs"),
    Reading("wild", "setting wild", {"program": "ours"}, stopped="diverged at 0.1 s", spent=2.0, expected=True),
)
CALLS = []


def give(context, which):
    CALLS.append(which)
    return measured(list(CHOSEN[which]), 1, "cpu")


CHOSEN = {"all": READINGS}


def panel(which="all", **more):
    given = {
        "name": "made_up", "title": "A panel for tests", "observable": "deviation", "reference": "made up",
        "stated": 0.02, "runs": lambda options: [Run("one", give, {"which": which})],
        "space": ("rough", "middle", "fine"),
        "time": "nothing is stepped", "arithmetic": ("middle", "fine"), "tolerance": "no solver iterates",
        "effects": (("the fine thing", "middle", "fine"),), "group": "program",
        "omissions": lambda options: ["the moon: too far away"], **more,
    }  # fmt: skip
    return Panel(**given)


@pytest.fixture
def options(tmp_path):
    CALLS.clear()
    return Options(results=tmp_path / "results", figures=tmp_path / "figures")


def perform(made, options):
    return accuracy.perform_panels([("fake", made)], options, stream=io.StringIO())


def made_report(readings=READINGS, **more):
    found = {"one": measured(readings, 1, "cpu")}
    return accuracy.make_report(panel(**more), found, Options())


def test_report_tells_front_failures_sources_and_effects():
    made = made_report(band=lambda points: Band(0.01, "made up"))
    assert made["front"] == ["rough", "middle", "fine"]
    assert made["points"]["wild"]["stopped"] == "diverged at 0.1 s"
    assert math.isnan(made["points"]["wild"]["error"])
    source = {s["source"]: s for s in made["sources"]}
    assert list(source) == ["space", "time", "solver tolerance", "arithmetic", "reference"]
    assert source["space"]["size"] == pytest.approx(0.015)
    assert source["space"]["order"]["order"] == pytest.approx(2.0, abs=1e-9)
    assert source["time"]["words"] == "nothing is stepped"
    assert source["reference"]["size"] == 0.01
    (effect,) = made["effects"]
    assert effect["seconds"] == pytest.approx(0.12)
    assert effect["share"] == pytest.approx(3.0)
    assert (effect["launches"], effect["bytes"]) == (2, 8)
    assert (effect["error_without"], effect["error_with"]) == (0.02, 0.005)
    rows = {row["group"]: row for row in made["headline"]["rows"]}
    assert rows["ours"]["key"] == "middle"
    assert rows["ours"]["seconds"] == pytest.approx(4.0)
    assert not rows["theirs"]["reached"]
    assert [row["key"] for row in made["headline"]["equal_numbers"]] == ["rough", "theirs"]
    assert "the moon: too far away" in made["omissions"]
    assert any(line.startswith("energy:") for line in made["omissions"])
    (where,) = made["where"]
    assert where["threads"] == 1
    text = "\n".join(str(table) for table in accuracy.tables(made))
    for part in ("failed: diverged at 0.1 s", "front", "the fine thing", "+300 %", "the moon", made["advice"]):
        assert part in text


def test_repeats_are_pooled_into_medians():
    rounds = {
        f"r{k}": measured([reading("a", 0.01 * (1 + k), [1.0 + k])], 1, "cpu") for k in (4, 0, 1, 2, 3)
    }  # fmt: skip
    point = accuracy.pooled(rounds)["a"]
    assert sorted(point["all_seconds"]) == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert (point["seconds"], point["mad"], point["error"]) == (3.0, 1.0, 0.03)
    assert point["parts"]["step"]["median"] == pytest.approx(2.25)
    assert "scatters" in point["unstable"]
    few = accuracy.pooled(dict(list(rounds.items())[:3]))["a"]
    assert few["unstable"] == f"only 3 of {REPEATS} repeats"


def test_time_to_an_error_is_read_off_the_curve():
    error = [1.0, 0.03, 0.5, 0.03, 0.02, 0.02, 0.02, 0.02, 0.02]
    curves = [{"wall": [factor * k for k in range(9)], "error": error} for factor in (1.0, 2.0, 3.0)]
    found = {
        f"r{k}": measured([reading("a", 0.02, [4.0 + k], curve=c)], 1, "cpu") for k, c in enumerate(curves)
    }  # fmt: skip
    point = accuracy.pooled(found)["a"]
    assert accuracy.time_to(point, 0.03) == {"seconds": 6.0, "mad": 3.0}
    assert accuracy.time_to(point, 0.01) is None
    late = {**point, "curves": [{"wall": list(range(9)), "error": [1.0] * 8 + [0.01]}]}
    assert accuracy.time_to(late, 0.02) is None  # there at the end, but not for long enough


def test_advice_follows_the_data():
    first = made_report()["advice"]
    assert "For deviation 0.02 take setting middle: 4 s" in first
    assert "theirs keeps 0.03 after 10 s" in first
    assert "0.005 costs 16 s with setting fine" in first
    assert first.count(".") - first.count("0.") == 1  # one sentence
    swapped = [*READINGS, reading("quick", 0.01, 0.5)]
    assert "take setting quick: 500 ms" in made_report(swapped)["advice"]
    rival = [*READINGS[:4], reading("theirs", 0.01, 10.0, "theirs")]
    assert "theirs takes 2.5 times as long" in made_report(rival)["advice"]
    assert "nothing is advised: not reached: setting fine keeps 0.5 % after 16 s" in made_report(stated=0.001)["advice"]
    assert "nothing to choose" in made_report(READINGS[-1:])["advice"]
    shaky = [reading("middle", 0.02, [4.0, 6.0, 2.0, 5.0, 3.0])]
    assert "nothing is advised: one setting reaches it, none in a settled time" in made_report(shaky)["advice"]
    cheaper = [*READINGS, reading("shaky", 0.02, [1.0, 1.5, 0.7, 1.2, 0.8])]
    assert "nothing is advised: setting shaky was read at 1 s" in made_report(cheaper)["advice"]
    wide = made_report(band=lambda points: Band(0.04, "data disagree"))["advice"]
    assert "below the uncertainty of the reference (4 %)" in wide
    assert "costs 16 s" not in wide
    narrow = made_report(band=lambda points: Band(0.01, "data disagree"))["advice"]
    assert "less than the reference can tell (0.01)" in narrow


def test_what_fails_elsewhere_is_drawn_but_not_advised():
    def check(error, **more):
        knobs = {"checks": {"program": "ours", "spacing": 0.05}}
        return Reading("check", "turned about", knobs, error=error, shown=False, **more)

    made = made_report([*READINGS, check(0.04)], check_bar=0.05)
    assert "take setting middle" in made["advice"]
    made = made_report([*READINGS, check(0.3)], check_bar=0.05)
    assert made["points"]["middle"]["elsewhere"] == "turned about it keeps 0.3"
    assert made["points"]["fine"]["elsewhere"] == ""
    assert "middle" in made["front"]
    assert "take setting fine" in made["advice"]
    assert made["headline"]["rows"][0]["key"] == "fine"
    assert "turned about it keeps 0.3" in "\n".join(map(str, accuracy.tables(made)))
    made = made_report([*READINGS, check(float("nan"), stopped="torn: in two")], check_bar=0.05)
    assert made["points"]["middle"]["elsewhere"] == "turned about: torn: in two"


def test_figure_has_failures_as_crosses_with_their_reason(options):
    made = panel(band=lambda points: Band(0.01, "made up"))
    (outcome,) = perform(made, options)
    (drawn,) = outcome.drawn.values()
    assert drawn.name == "accuracy_cost_made_up.png"
    assert drawn.stat().st_size > 10_000
    data = json.loads((options.figures / "accuracy_cost_made_up.json").read_text())
    assert data["schema"] == accuracy.SCHEMA
    import matplotlib.pyplot as plt

    from validation.drawing import style

    with style():
        figure = accuracy_picture.answer_picture(data)
        main = figure.axes[0]
        crosses = [line for line in main.lines if line.get_marker() == "x"]
        assert len(crosses) == 1
        assert crosses[0].get_ydata()[0] == pytest.approx(2.0)
        assert crosses[0].get_xdata()[0] > 8.0  # [%], right of every point
        assert "diverged" in crosses[0].get_label()
        plt.close(figure)
        figure = accuracy_picture.parts_picture(data)
        words = " ".join(text.get_text() for axes in figure.axes for text in axes.texts).replace("\n", " ")
        assert "3  " in words
        assert "the moon" in words
        plt.close(figure)


def test_expected_failures_are_fine_and_others_are_not(options, monkeypatch):
    assert exit_code(perform(panel(), options)) == 0
    unasked = Reading("wild", "setting wild", {"program": "ours"}, stopped="diverged at 0.1 s", spent=2.0)
    monkeypatch.setitem(CHOSEN, "unasked", [*READINGS[:2], unasked])
    outcomes = perform(panel("unasked"), options)
    assert exit_code(outcomes) == EXIT_STOPPED
    text = io.StringIO()
    report(outcomes, text)
    assert "setting wild: diverged at 0.1 s" in text.getvalue()
    judged = panel(checks=lambda made, check: check.made.append(Check("a", "a", 1.0, "", "", "at most 0", "fail")))
    assert exit_code(perform(judged, options)) == EXIT_FAILED


def test_results_are_reused_and_reports_stay_the_same(options):
    perform(panel(), options)
    before = (options.figures / "accuracy_cost_made_up.json").read_text()
    perform(panel(), options)
    assert CALLS == ["all"]
    assert (options.figures / "accuracy_cost_made_up.json").read_text() == before


# Comparison


def point(seconds=1.0, mad=0.01, error=0.1, error_mad=0.0, unstable=""):
    return {"seconds": seconds, "mad": mad, "error": error, "error_mad": error_mad, "unstable": unstable}


@pytest.mark.parametrize(
    ("old", "new", "verdict"),
    [
        (point(), point(1.04), SAME),  # less than 5 %
        (point(), point(1.10), WORSE),
        (point(), point(0.90), BETTER),
        (point(mad=0.05), point(1.10, 0.05), SAME),  # less than the noise
        (point(mad=0.05), point(1.40, 0.05), WORSE),
        (point(), point(2.0, unstable="scatters"), UNSURE),
    ],
)
def test_time_verdicts_know_the_noise(old, new, verdict):
    assert time_verdict(old, new) == verdict


def test_error_verdicts():
    assert error_verdict(point(), point(error=0.1005)) == SAME
    assert error_verdict(point(), point(error=0.11)) == WORSE
    assert error_verdict(point(error_mad=0.01), point(error=0.11, error_mad=0.01)) == SAME
    assert error_verdict(point(), point(error=float("nan"))) == WORSE
    assert error_verdict(point(error=float("nan")), point()) == BETTER
    assert error_verdict(point(error=float("nan")), point(error=float("nan"))) == SAME


@pytest.fixture
def written(tmp_path):
    def write(name, readings=READINGS, where=None, **more):
        made = made_report(readings, **more)
        if where:
            made["where"] = [{**made["where"][0], **where}]
        picture = Picture(name, lambda found: made, None)
        return str(write_data(picture, {}, tmp_path))

    return write


def test_two_reports_are_compared(written, capsys):
    slower = [reading("middle", 0.02, 5.0), reading("rough", 0.08, 1.0), reading("new", 0.3, 1.0)]
    old = written("old")
    assert main(["accuracy", "--compare", old, old]) == 0
    assert "nothing got worse" in capsys.readouterr().out
    assert main(["accuracy", "--compare", old, written("new", slower)]) == EXIT_FAILED
    said = capsys.readouterr().out
    assert "Verdict: worse (middle: time)" in said
    assert "1.25" in said
    assert "only in the old report: fine, theirs, wasteful, wild" in said
    assert "only in the new report: new" in said
    moved = written("moved", slower, where={"processor": "another"})
    assert main(["accuracy", "--compare", old, moved]) == 0
    assert "times are not compared" in capsys.readouterr().out


def test_bad_reports_get_a_sentence_and_code_2(written, tmp_path, capsys):
    junk = tmp_path / "junk.json"
    junk.write_text('{"schema": "something else"}')
    assert main(["accuracy", "--compare", written("old"), str(junk)]) == 2
    assert "no report of schema" in capsys.readouterr().err
    assert main(["accuracy", "--compare", str(tmp_path / "none"), str(junk)]) == 2
    with pytest.raises(InputError, match="two reports of one panel"):
        accuracy.compare(made_report(), made_report(name="other"))


# Panels that are there


def test_two_panels_of_one_name_are_refused():
    both = {name: Experiment(name, "title", panels=(panel(),)) for name in ("mine", "yours")}
    with pytest.raises(ValueError, match="two panels are called 'made_up'"):
        accuracy.panels(both)


def test_every_panel_has_what_the_figure_needs(tmp_path):
    panels = {name: panel for name, (_, panel) in accuracy.panels(discover()).items()}
    assert {"detection_2d", "detection_3d", "droplet", "front"} <= set(panels)
    for made in panels.values():
        for options in (Options(), Options(quick=True)):
            runs = made.runs(options)
            assert len({run.key for run in runs}) == len(runs)
            for run in runs:
                results.result_folder(tmp_path, made.name, run.key, run.function, run.parameters)
        for sequence in (made.space, made.time, made.arithmetic, made.tolerance):
            assert len(sequence) > 1


def test_settings_of_the_panels_are_all_there():
    detectors = dam_panels.detector_settings("float32")
    count = {method: sum(key.startswith(f"{method}_0") for key in detectors) for method in dam_panels.METHODS}
    assert count == {"number_density": 5, "fan_scan": 0, "two_step": 20, "two_step_printed": 20}
    assert sum(key.startswith("fan_scan_") for key in detectors) == 4
    assert all(s["like"] in detectors for s in detectors.values() if s["like"])
    named = {*detectors, *dam_panels.detector_settings("float64")}
    for made in dam_panels.PANELS[:2]:
        assert set(made.arithmetic) <= named
        assert {key for _, *pair in made.effects for key in pair} <= named
    for made, given in (
        (drop_panels.PANELS[0], drop_panels.settings(Options())),
        (dam_panels.PANELS[2], dam_panels.front_settings(Options())),
    ):
        keys = {s["key"] for s in given}
        assert len(keys) == len(given)
        for wanted in (made.space, made.time, made.arithmetic, [k for _, *pair in made.effects for k in pair]):
            assert set(wanted) <= keys
        assert len({s["words"] for s in given}) == len(given)


def test_lines_and_sources_join_settings_that_are_measured():
    for (made,), given in (
        (mpm_panels.PANELS[:1], mpm_panels.settings(Options())),
        (surface_panels.PANELS, surface_panels.settings(Options())),
    ):
        on_gpu = {f"cuda_{key}" for key in sys.modules[made.runs.__module__].settings(Options(backend="cuda"))}
        for wanted in (made.space, made.time, made.arithmetic, *(keys for _, keys in made.lines)):
            if not isinstance(wanted, str):
                assert set(wanted) <= set(given) | on_gpu
        assert {key for _, *pair in made.effects for key in pair} <= set(given)


LIQUIDS = {  # panel: (the run's function of one setting, what it keeps at the coarsest, arguments that shorten it)
    "tank_pressure": (tank_runs.rested, 0.4, {}),
    "implicit_pressure": (pressure_runs.rested, 0.1, {}),
    "coupling": (float_runs.floated, 0.3, {}),
    "surface_tension_jump": (tension_panels.drop, 0.3, {}),
    "mpm_frequency": (frequency_runs.swung, 0.1, {"periods": 0.6}),
}


@pytest.mark.parametrize("name", LIQUIDS)
def test_the_coarsest_point_of_a_liquid_is_measured(name):
    """Its error is finite and no larger than what the method keeps there; steps and seconds are counted."""
    once, bar, shorter = LIQUIDS[name]
    made = accuracy.panels(discover())[name][1]
    (run,) = made.runs(Options(quick=True))
    full = {key for each in made.runs(Options()) for key in each.parameters["settings"]}
    for wanted in (made.space, made.time, made.arithmetic, made.tolerance, *(keys for _, keys in made.lines)):
        if not isinstance(wanted, str):
            assert {key for key in wanted if not key.startswith("cuda_")} <= full
    settings = run.parameters["settings"]
    assert set(settings) <= full
    found = once(Context(threads=1), next(iter(settings.values())), 0, **shorter)
    assert not found.stopped
    assert 0 < found.error < bar
    assert found.steps > 10
    assert found.seconds > 0
    assert found.particles > 50


def test_implicit_pressure_is_larger_at_walls():
    """The particles at the floor, away from the sides, have two to three times the pressure of the water above them."""
    run = Context(threads=1).simulation(pressure_runs.tank(20, "float64", 1e-3, 1.0), "cpu")
    reach, found = 0.15 * pressure_runs.WIDTH, []
    while run.time < 1.5:
        run.step()
        if run.time > 1.0:
            place, pressure = run.field("position"), run.field("pressure")
            first = (place[:, 1] < 0.5 / 20) & (np.abs(place[:, 0] - 0.5 * pressure_runs.WIDTH) < reach)
            known = pressure_runs.DENSITY * pressure_runs.GRAVITY * (pressure_runs.HEIGHT - place[first, 1])
            found.append(float((pressure[first] / known).mean()))
    assert 2 < np.mean(found) < 3


def test_a_stop_and_a_known_tension(monkeypatch):
    """A drop that does not last is a failure with its reason; a frequency is the root of the tension."""
    setting = {"by": "rayleigh", "model": "akinci", "radius": 8.0, "knobs": {"backend": "cpu", "dtype": "float32"}}
    flat, error = tension_panels.flat_tension("akinci")
    assert 0 < error < 0.1 * flat
    row = {"stopped": "", "rayleigh": 1.21 * flat, "steps": 5, "particles": 9}
    monkeypatch.setattr(tension_panels, "measure", lambda point: row)
    found = tension_panels.drop(Context(threads=1), setting, 0)
    assert (found.value, found.error) == (pytest.approx(1.1), pytest.approx(0.1))
    monkeypatch.setattr(tension_panels, "measure", lambda point: {"stopped": "clumped"})
    assert tension_panels.drop(Context(threads=1), setting, 0).stopped == "clumped"


def test_a_gpus_report_brings_its_points(tmp_path):
    """A stored result of --backend cuda, copied: its points stand beside, with device and date, under names of their
    own; on the GPU itself, for the quick size and without a report there is none."""
    assert gpu_runs("made_up", Options(), tmp_path) == []
    assert len(without_gpu("made_up", Options(), tmp_path)) == 1
    found = measured([reading("middle", 0.02, 0.1)], 1, "cpu")
    where = {**found.values["where"], "backend": "cuda", "device": {"name": "a GPU"}}
    values = results.finite({**found.values, "where": where})
    values["readings"][0]["knobs"]["backend"] = "cuda"
    document = {"runs": {"all": {"about": {"date": "2026-01-02"}, "values": values}}}
    (tmp_path / "accuracy_cost_made_up.json").write_text(json.dumps(document))
    assert gpu_runs("made_up", Options(quick=True), tmp_path) == gpu_runs("made_up", Options(backend="cuda"), tmp_path)
    assert without_gpu("made_up", Options(), tmp_path) == []
    (run,) = gpu_runs("made_up", Options(), tmp_path)
    given = {"one": measured(READINGS, 1, "cpu"), run.key: reported(Context(), **run.parameters, folder=tmp_path)}
    made = accuracy.make_report(panel(lines=(("ours", ("rough", "middle", "missing")),)), given, Options())
    assert made["points"]["cuda_middle"]["words"] == "setting middle, on a GPU"
    assert made["points"]["middle"]["seconds"] == pytest.approx(4.0)
    assert (made["front"], made["front_elsewhere"]) == (["rough", "middle", "fine"], ["cuda_middle"])
    assert "GPU" not in made["advice"]
    assert made["lines"] == [{"words": "ours", "keys": ["rough", "middle"]}]
    assert [(p["device"], p.get("date")) for p in made["where"]] == [(None, None), ({"name": "a GPU"}, "2026-01-02")]


def test_a_gpus_report_is_kept_whole_or_not_at_all(tmp_path):
    """Of backend cuda at the published sizes, with every run that is not skipped; what is kept is read again."""
    found = measured([reading("middle", 0.02, 0.1)], 1, "cpu")
    found.values["readings"][0]["knobs"]["backend"] = "cuda"
    given = {"one": Result(found.values, {}, {"date": "2026-01-02"})}
    runs, cuda = [Run("one", print), Run("other", print, skip="absent")], Options(backend="cuda")
    for options in (Options(), Options(backend="cuda", quick=True)):
        assert keep("made_up", runs, given, options, tmp_path) is None
    assert keep("made_up", [*runs, Run("stopped", print)], given, cuda, tmp_path) is None
    assert not list(tmp_path.iterdir())
    assert keep("made_up", runs, given, cuda, tmp_path) == tmp_path / "accuracy_cost_made_up.json"
    (run,) = gpu_runs("made_up", Options(), tmp_path)
    (read,) = reported(Context(), **run.parameters, folder=tmp_path).values["readings"]
    assert (read["key"], read["error"], read["knobs"]["reported"]) == ("cuda_middle", 0.02, "2026-01-02")


def test_unknown_panels_get_a_sentence(tmp_path, capsys):
    assert main(["accuracy", "dropplet", "--results", str(tmp_path)]) == 2
    assert "no panel 'dropplet'; did you mean 'droplet'?" in capsys.readouterr().err
    assert main(["list", "accuracy"]) == 0
    assert "front" in capsys.readouterr().out


def test_misplaced_surface_is_the_distance_between_both_sets():
    x = np.array([[0.0, 0, 0], [1, 0, 0], [3, 0, 0], [7, 0, 0]])
    flags, truth = np.array([1, 1, 0, 0], bool), np.array([1, 0, 1, 0], bool)
    assert sorted(dam_runs.misplaced(x, flags, truth)) == [0.0, 1.0, 2.0]
    assert dam_runs.misplaced(x, truth, truth).max() == 0.0
    assert np.isnan(dam_runs.misplaced(x, np.zeros(4, bool), truth)).all()


def test_stored_states_are_those_that_are_named():
    from validation.experiments.dam_break.state import STORED, load_state

    for name, (columns, depth, moment) in STORED.items():
        state = load_state(name)
        assert state.position.shape == (2 * columns**2 * depth, 3)
        assert state.position.dtype == np.float32
        assert np.isfinite(state.position).all()
        assert state.time == pytest.approx(moment, abs=0.01)


def test_starts_that_cost_more_are_no_noise_of_the_machine():
    seconds, steady, unsteady = [1.0, 2.0, 4.0, 2.0, 3.0], [1.0] * 10, [0.8, 1.2] * 5
    drops = [reading("drop", 0.01, [s], noise=[] if k else steady) for k, s in enumerate(seconds)]
    noisy = [reading("noisy", 0.01, [s], noise=[] if k else unsteady) for k, s in enumerate(seconds)]
    points = accuracy.pooled({"one": measured([*drops, *noisy], 1, "cpu")})
    assert points["drop"]["seconds"] == pytest.approx(2.0)
    assert points["drop"]["all_seconds"] == pytest.approx([2.0] * 10)
    assert points["drop"]["starts"] == seconds
    assert points["drop"]["unstable"] == ""
    assert points["noisy"]["unstable"]


def readings_of(result):
    return {r["key"]: r for r in result.values["readings"]}


def test_tiny_detection():
    settings = {
        key: s for key, s in dam_panels.detector_settings("float32", quick=True).items() if "0.90" in key
    }  # fmt: skip
    found = dam_runs.detectors(Context(), "dam_break_2d", settings, "float32", "cpu", 1, 2)
    by_key = readings_of(found)
    exact, plain = by_key["two_step_0.90_half_color_float32"], by_key["number_density_0.90_float32"]
    assert 0.0 < exact["error"] < 0.12 < plain["error"]
    assert len(exact["seconds"]) == 2
    assert exact["seconds"] == pytest.approx(np.sum(list(exact["parts"].values()), axis=0))
    assert set(plain["parts"]) == {"threshold"}
    assert exact["distribution"]["misplaced surface [spacings]"]["max"] < 10


def test_tiny_front(monkeypatch):
    monkeypatch.setattr(dam_runs, "MEAN", (0.5, 1.0))
    knobs = {"dtype": "float32", "step": 1.0, "spacing": 0.1, "backend": "cpu"}
    found = dam_runs.front(Context(), "d5", "tiny", knobs, 5, {}, "cpu", 1, 0, until=2.6)
    (r,) = found.values["readings"]
    assert not r["stopped"]
    assert 0.0 < r["error"] < 0.6
    assert 1.0 < r["value"] < 2.5
    assert sum(r["parts"][name][0] for name in ("start", "list", "step")) == pytest.approx(r["seconds"][0])
    assert len(r["scene"]) == 16


def test_tiny_drop_and_a_drop_that_fails(monkeypatch):
    monkeypatch.setattr(drop_runs, "UNTIL", 0.05)
    monkeypatch.setattr(drop_runs, "SAMPLES", 4)
    knobs = {"program": "refsim", "dtype": "float32", "step": 1.0, "spacing": 1 / 9, "backend": "cpu"}
    common = {"side": 9, "backend": "cpu", "threads": 1, "repeat": 0}
    (r,) = drop_runs.roughness(Context(), "d9", "tiny", knobs, **common).values["readings"]
    assert len(r["curve"]["wall"]) == 5
    assert (np.diff(r["curve"]["wall"]) > 0).all()
    assert r["error"] == max(r["curve"]["error"][3:])
    assert r["distribution"]["density of the bulk against rest"]["median"] < 0.1
    wild = {**knobs, "step": 60.0}
    (r,) = drop_runs.roughness(Context(), "w", "wild", wild, **common, expected=True).values["readings"]
    assert r["stopped"].startswith("refused: scene: step = ")
    with pytest.raises(InputError, match="step = "):  # it was not to probe anything
        drop_runs.roughness(Context(), "w", "wild", wild, **common)

    def stop(simulation):
        raise RunStopped("collapsed", "gone")

    with monkeypatch.context() as patched:
        patched.setattr(drop_runs.Simulation, "step", stop)
        (r,) = drop_runs.roughness(Context(), "d9", "tiny", knobs, **common).values["readings"]
    assert r["stopped"] == "collapsed at 0.000 s"
    assert r["spent"] > 0
    assert not r["seconds"]
    rising = iter((0.1, 0.2, 0.3, 0.4, 0.5))
    monkeypatch.setattr(drop_runs, "radius_variation", lambda position: next(rising))
    (r,) = drop_runs.roughness(Context(), "d9", "tiny", knobs, **common).values["readings"]
    assert r["stopped"] == "rougher than its start: keeps 0.5"


def test_shaken_particles_stay_near_and_in_their_plane():
    lattice = shapes.lattice_cube(5, 0.2)
    once, again, other = (shapes.shaken(lattice, 0.2, seed) for seed in (1, 1, 2))
    assert (once == again).all()
    assert not (once == other).any()
    assert np.sqrt(((once - lattice) ** 2).mean()) == pytest.approx(0.002, rel=0.2)
    flat = lattice * (1, 1, 0)
    assert (shapes.shaken(flat, 0.2, 1)[:, 2] == 0).all()


def test_a_missing_peer_is_a_failure_with_its_reason(monkeypatch):
    monkeypatch.setattr(drop_runs.splishsplash, "run_drop", lambda settings, threads: {"missing": "it is not there"})
    found = drop_runs.peer_roughness(Context(), "p", "peer", {}, {"side": 5}, 1, 0)
    (r,) = found.values["readings"]
    assert r["stopped"] == "missing: it is not there"
    assert r["expected"]


def test_a_missing_peer_is_no_point_and_is_told_under_what_is_left_out():
    absent = Reading(
        "peer", "their drop", {"program": "theirs"}, stopped="missing: theirs is not installed", expected=True
    )
    made = accuracy.make_report(panel(), {"one": measured([*READINGS, absent], 1, "cpu")}, Options())
    assert "peer" not in made["points"]
    assert "peer: theirs is not installed (then --fresh)" in made["omissions"]


def test_the_bar_of_the_checks_is_a_ball_cut_from_the_lattice():
    assert pytest.approx(radius_variation_scale(drop_panels.MIDDLE**3).ball, rel=0.01) == drop_panels.LATTICE_BALL


def test_the_bar_against_the_peer_is_judged_by_times(monkeypatch):
    monkeypatch.setattr(drop_panels.splishsplash, "missing", lambda: "")
    peer = reading("peer_fine", 0.03, 10.0, drop_panels.PEER, particles=4913)
    own = reading("d17", 0.004, 2.0, drop_panels.REFSIM, particles=4913)
    (made,) = drop_panels.PANELS

    def verdicts(*readings):
        report = accuracy.make_report(made, {"one": measured(readings, 2, "cpu")}, Options())
        check = Checks("droplet", ACCURACY)
        made.checks(report, check)
        return {m.name: m for m in check.made}

    assert verdicts(own, peer)["against_peer"].value == pytest.approx(0.2)
    assert verdicts(own, peer)["against_peer"].verdict == "pass"
    late = reading("d17", 0.004, 12.0, drop_panels.REFSIM, particles=4913)
    assert verdicts(late, peer)["against_peer"].verdict == "fail"
    rough = reading("d17", 0.006, 2.0, drop_panels.REFSIM, particles=4913)
    assert verdicts(rough, peer)["against_peer"].verdict == "fail"
    assert verdicts(own)["against_peer"].verdict == "fail"  # a peer that is there must be measured


@pytest.mark.slow
def test_starts_are_timed_cold_and_warm():
    scene = {
        "module": "validation.experiments.dam_break.accuracy_runs",
        "function": "front_scene",
        "parameters": {"columns": 4, "dtype": "float32", "effects": {}},
    }
    (start,) = start_up(Context(), {"tiny": scene}, "cpu", 1).values["starts"]
    assert start["cold"] > start["warm"] > start["parts"]["warm"]["first_step"] > 0


def test_reports_survive_json(tmp_path):
    found = {"one": measured(READINGS, 1, "cpu")}
    stored = tmp_path / "one"
    results.save(stored, Result(found["one"].values, {}, {"date": "2020-01-01"}))
    again = {"one": results.load(stored)}
    first, second = (accuracy.make_report(panel(), r, Options()) for r in (found, again))
    assert results.finite(first["points"]) == results.finite(second["points"])
    assert first["advice"] == second["advice"]
