"""The rules that choose a setting, on made-up points; the page and the packaged table are what the command makes."""

import json

import pytest

from validation import answers, answers_page
from validation.answers import Observable, Reference, candidates, choose, uncertainty
from validation.drawing import style

STEADY = [1.0, 1.01, 0.99, 1.0, 1.005]
PLAIN = Observable("a", "of b")


def point(error, seconds, scatter=STEADY, value=None, **more):
    knobs = more.pop("knobs", {"dtype": "float32"})
    made = {
        "words": f"keeps {error}", "knobs": knobs, "shown": True, "stopped": "", "error": error, "error_mad": 0.0,
        "value": error if value is None else value, "seconds": seconds, "mad": 0.0,
        "all_seconds": [seconds * s for s in scatter],
        "starts": [seconds * s for s in scatter],
        "unstable": "", "elsewhere": "", "curves": [], "curve": {}, "bytes": 8, "particles": 100, "steps": 10,
        "per_step": seconds / 10,
    }  # fmt: skip
    return made | more


def chosen(points, error, observable=PLAIN, band=None):
    found = candidates(points, observable)
    return choose(found, error, uncertainty(points, observable, band))


def test_the_cheapest_that_keeps_the_error_is_advised():
    points = {
        "rough": point(0.2, 1.0),
        "fine": point(0.01, 5.0),
        "finest": point(0.001, 50.0),
        "slow": point(0.01, 9.0),
    }
    assert chosen(points, 0.5).advised.key == "rough"
    choice = chosen(points, 0.01)
    assert (choice.advised.key, choice.seconds, choice.notes) == ("fine", 5.0, ())
    none = chosen(points, 0.0001)
    assert none.advised is None
    assert none.why == "not reached: keeps 0.001 keeps 0.1 % after 50 s"
    assert chosen({}, 0.1).why == "not measured"


SCATTERED = [1.0, 1.3, 0.7, 1.2, 0.8]
SKEWED = [1.0, 1.0, 1.0, 1.01, 1.09, 1.08, 1.06, 1.0]  # a small deviation from the median, a wide middle half


@pytest.mark.parametrize("scatter", [SCATTERED, SKEWED, STEADY[:4]])
def test_an_unsettled_timing_is_never_advised_and_never_passed_over_in_silence(scatter):
    points = {"cheap": point(0.01, 1.0, scatter), "settled": point(0.01, 1.015)}
    choice = chosen(points, 0.05)
    assert choice.advised.key == "settled"
    assert choice.notes[0].startswith("passed over: keeps 0.01 was read at ")
    del points["settled"]
    none = chosen(points, 0.05)
    assert none.advised is None
    assert none.why.startswith("not advised: one setting reaches it, none in a settled time; keeps 0.01 was read at ")


def test_a_costlier_setting_is_not_advised_where_an_unsettled_one_is_faster_beyond_its_scatter():
    points = {"cheap": point(0.01, 1.0, SCATTERED), "settled": point(0.01, 3.0)}
    choice = chosen(points, 0.05)
    assert choice.advised is None
    assert choice.why == (
        "not advised: keeps 0.01 was read at 1 s (700 ms to 1.3 s), but scatters by 30 %; keeps 0.01 in a settled 3 s"
        " costs more"
    )
    points["settled"] = point(0.01, 1.2)
    assert chosen(points, 0.05).advised.key == "settled"


def test_an_error_that_a_finer_spacing_does_not_keep_is_kept_by_chance():
    points = {
        "coarse": point(0.002, 1.0, knobs={"spacing": 0.2}),
        "middle": point(0.02, 2.0, knobs={"spacing": 0.1}),
        "fine": point(0.004, 4.0, knobs={"spacing": 0.05}),
    }
    assert chosen(points, 0.05).advised.key == "coarse"
    choice = chosen(points, 0.01)
    assert choice.advised.key == "fine"
    assert choice.notes == ("passed over: keeps 0.002 keeps 0.2 % by chance, keeps 0.02 2 %",)


def test_the_nearest_is_none_that_keeps_its_error_by_chance():
    points = {
        "coarse": point(0.002, 1.0, knobs={"spacing": 0.2}),
        "fine": point(0.004, 4.0, knobs={"spacing": 0.1}),
    }
    choice = chosen(points, 0.001)
    assert choice.advised is None
    assert choice.nearest.key == "fine"


def test_cells_of_the_table_are_short_and_the_notes_say_the_rest():
    found = answers.table()
    lines = [line for line in answers_page.markdown(found) if line.startswith("|")]
    for line in lines[2:]:
        _, _, errors, *cells, _ = line.split("|")
        assert "%" in errors
        assert len(cells) == 6
        assert max(map(len, cells[1:])) <= 50
        assert len(cells[0]) <= 80 or "no meaning" in cells[0]
    front = next(row for row in found["observables"] if row["name"] == "front")
    noted = "\n".join(answers_page.notes(front))
    for cell in front["answers"]:
        for note in cell["cpu"]["notes"]:
            assert note in noted or note.startswith("below the uncertainty")
        if "read" in cell["cpu"]:
            assert cell["cpu"]["read"]["unsettled"] in noted


def test_float64_is_advised_only_where_it_changes_the_error():
    pair = {"single": {"dtype": "float32"}, "double": {"dtype": "float64"}}

    def points(single, double, mad=0.0):
        return {
            "single": point(single, 3.0, knobs=pair["single"], error_mad=mad),
            "double": point(double, 1.0, knobs=pair["double"], error_mad=mad),
        }

    assert chosen(points(0.02, 0.02), 0.05).advised.key == "single"
    assert chosen(points(0.02, 0.0199), 0.05).advised.key == "single"
    assert chosen(points(0.02, 0.01), 0.05).advised.key == "double"
    assert chosen(points(0.02, 0.01, mad=0.01), 0.05).advised.key == "single"
    alone = {"double": point(0.02, 1.0, knobs=pair["double"])}
    assert chosen(alone, 0.05).advised.key == "double"


def test_what_the_runner_warns_of_and_what_fails_elsewhere_is_no_candidate():
    points = {
        "long": point(0.01, 1.0, knobs={"dtype": "float32", "step": 1.4}),
        "lucky": point(0.01, 2.0, elsewhere="from a turned cube it keeps 0.1"),
        "stopped": point(0.01, 0.5, stopped="diverged"),
        "hidden": point(0.01, 0.5, shown=False),
        "extra_effect": point(0.01, 0.5),
        "cuda_extra_effect": point(0.01, 0.5),
        "good": point(0.01, 3.0, knobs={"dtype": "float32", "step": 1.0}),
    }
    observable = Observable("a", "of b", other_scenes=("extra_",))
    assert chosen(points, 0.05, observable).advised.key == "good"
    del points["good"]
    assert chosen(points, 0.05, observable).why == "not reached: no setting may be advised"


def test_an_error_below_the_reference_s_uncertainty_is_marked():
    points = {"fine": point(0.001, 1.0)}
    assert chosen(points, 0.05, band={"width": 0.02}).notes == ()
    assert chosen(points, 0.01, band={"width": 0.02}).notes == ("below the uncertainty of the reference (2 %)",)
    scaled = Observable("a", "of b", scale=100.0)
    assert candidates(points, scaled)[0].error == pytest.approx(1e-5)
    assert candidates(points, scaled)[0].own == 0.001
    assert uncertainty(points, scaled, {"width": 2.0}) == 0.02


def test_errors_are_taken_from_the_converged_value():
    """v(d) = 2 + d: the limit is 2 and the error d/2; the uncertainty is 3 times the last correction."""
    points = {f"d{n}": point(9.9, 1.0, value=2 + 1 / n, knobs={"spacing": 1 / n}) for n in (5, 10, 20)}
    observable = Observable("a", "of b", converged=Reference("d10", "d20", 1.0))
    found = {c.key: c.error for c in candidates(points, observable)}
    assert found == pytest.approx({"d5": 0.1, "d10": 0.05, "d20": 0.025})
    assert candidates(points, observable)[0].own == pytest.approx(0.2)
    assert uncertainty(points, observable, None) == pytest.approx(3 * 0.05 / 2)
    assert chosen(points, 0.06, observable).advised.key in ("d10", "d20")
    assert chosen(points, 0.03, observable).advised.key == "d20"
    assert chosen(points, 0.03, observable).notes


def test_without_the_converged_spacings_errors_are_the_panel_s_own():
    """As with --quick."""
    observable = Observable("a", "of b", converged=Reference("d10", "d20", 1.0))
    points = {"d10": point(0.01, 1.0, value=2.1, knobs={"spacing": 0.1})}
    assert [c.error for c in candidates(points, observable)] == [0.01]
    assert uncertainty(points, observable, {"width": 0.02}) == 0.02
    assert chosen(points, 0.05, observable).advised.key == "d10"


def test_seconds_are_read_off_the_curve_at_the_error():
    curve = {"wall": [0.0, 1.0, 2.0, 3.0, 4.0, 5.0], "error": [0.5, 0.2, 0.04, 0.02, 0.01, 0.01]}
    points = {"run": point(0.01, 4.0, curves=[curve])}
    assert chosen(points, 0.05).seconds == 2.0
    assert chosen(points, 0.01).seconds == 4.0


def test_programs_stand_apart():
    data = {
        "points": {"ours": point(0.01, 3.0), "theirs": point(0.01, 1.0, knobs={"program": "other"})},
        "band": None, "where": [], "dates": ["2026-01-01"],
    }  # fmt: skip
    row = answers.answer("a", data, Observable("a", "of b", meaning=(0.001, "why not")))
    cells = {cell["error"]: cell for cell in row["answers"]}
    assert cells[0.05]["cpu"]["seconds"] == 3.0
    assert cells[0.05]["peer"] == {
        "setting": "keeps 0.01", "seconds": 1.0, "program": "other", "keeps": 0.01,
    }  # fmt: skip
    assert cells[0.001] == {"error": 0.001, "no_meaning": "why not"}
    assert cells[0.05]["gpu"] is None


# What is published


def test_the_page_and_the_packaged_table_are_what_the_command_makes():
    found = answers.table()
    again = "python -m validation accuracy --write"
    assert answers_page.TABLE.read_text() == answers.as_json(found), again
    text = answers_page.PAGE.read_text()
    assert answers_page.page(text, found) == text, again
    assert json.loads(answers_page.TABLE.read_text()) == found


def test_every_panel_has_an_answer_and_no_advised_point_is_unsettled():
    from validation.accuracy import panels
    from validation.experiment import discover

    assert set(answers.OBSERVABLES) == set(panels(discover()))
    for name in answers.OBSERVABLES:
        row = answers.answer(name, answers.report(name), answers.OBSERVABLES[name])
        found = {c.key: c for c in candidates(answers.report(name)["points"], answers.OBSERVABLES[name])}
        for cell in row["answers"]:
            for side in ("cpu", "gpu"):
                if (cell.get(side) or {}).get("key"):
                    advised = found[cell[side]["key"]]
                    assert advised.settled
                    assert advised.error <= cell["error"]


def test_the_picture_names_what_the_table_advises_and_draws_the_unsettled_hollow():
    from validation.accuracy_picture import answer_picture

    with style():
        figure = answer_picture(answers.report("front"))
        import matplotlib.pyplot as plt

        plt.close(figure)
    axes = figure.axes[0]
    row = answers.answer("front", answers.report("front"), answers.OBSERVABLES["front"])
    said = " ".join(" ".join(text.get_text().split()) for text in axes.texts)
    for cell in row["answers"]:
        if "setting" in cell["cpu"]:
            assert cell["cpu"]["setting"] in said
    assert "uncertainty of the reference" in said
    found = candidates(answers.report("front")["points"], answers.OBSERVABLES["front"])
    hollow = [line for line in axes.lines if line.get_markerfacecolor() == "white" and len(line.get_xdata()) == 1]
    assert len(hollow) == sum(not c.settled for c in found)
