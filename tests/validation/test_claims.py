"""The claims: what is written is complete, agrees with its tests and its page, and is judged as it says."""

import dataclasses
import json
import math
import pathlib
import re
import types

import numpy as np
import pytest

from refsim import HeatConduction
from validation import checks
from validation import claims as claiming
from validation.__main__ import main
from validation.claims import CONFIRMED, FEW, MIXED, NOT_TESTABLE, REFUTED, STARTS, Claim, Found, read_claims
from validation.experiment import Experiment, Family, Measure, Options, Run, alike, discover, measures
from validation.experiments.dam_break import claims as dam_break
from validation.experiments.droplet import claims as droplet
from validation.experiments.heat import claims as heat
from validation.experiments.melting import scene as melting_scene
from validation.experiments.models import claims as models
from validation.filling import Recorded, filled, filled_page
from validation.perform import EXIT_FAILED, EXIT_FINE, EXIT_INPUT
from validation.results import Result
from validation.running import Context

ROOT = pathlib.Path(__file__).resolve().parents[2]
CLAIMS = read_claims()
TESTABLE = [name for name, claim in CLAIMS.items() if claim.rule]
MEASURED = [name for name in TESTABLE if CLAIMS[name].starts]
HEAT = ("heat", "melting")  # systems of one paper, which prints one K


# What is written


def test_every_claim_has_a_measure_of_its_own_and_no_measure_is_left_over():
    measured = {name for experiment in discover().values() for name in experiment.claims}
    assert measured == set(TESTABLE)
    for name in TESTABLE:
        assert name in discover()[CLAIMS[name].experiment].claims


def few(claim):
    return claim.starts < (1 if claim.fixed else FEW if claim.complete else STARTS)


@pytest.mark.parametrize("name", MEASURED)
def test_what_is_written_follows_from_the_numbers_beside_it(name):
    claim = CLAIMS[name]
    low, high = claim.spread
    assert low <= claim.measured <= high
    if few(claim):
        assert claim.verdict == NOT_TESTABLE
    else:
        assert claim.judge([low, *[claim.measured] * (claim.starts - 2), high][: claim.starts]) == claim.verdict


def test_a_claim_without_numbers_or_with_few_starts_says_so():
    for claim in CLAIMS.values():
        if few(claim):
            assert claim.verdict == NOT_TESTABLE
            assert claim.reason, claim.name
        assert not (claim.fixed and claim.starts >= FEW), f"{claim.name}: nothing differs, and yet many starts"
        assert claim.over or not claim.starts
        assert "{" not in claim.reason


@pytest.mark.parametrize("name", TESTABLE)
def test_the_null_model_of_a_family_refutes_every_claim(name):
    """Without its effect a claim must fail, by its own measure and its own bar."""
    claim, how = CLAIMS[name], discover()[CLAIMS[name].experiment].claims[name]
    assert how.family is not None, "put it into a family of FAMILIES"
    values = list(how.family.model(how))
    assert values, "the null model gave nothing"
    assert not any(map(claim.keeps, values))
    if claim.starts:
        assert claim.null == pytest.approx(float(np.median(values)), rel=1e-3, abs=1e-12)


def test_titles_readings_and_families_are_said():
    titles = [claim.title for claim in CLAIMS.values()]
    assert len(set(titles)) == len(titles)  # they are headings of one page
    assert all(claim.reading for claim in CLAIMS.values())
    for experiment in discover().values():
        families = {how.family for how in experiment.claims.values()}
        assert all(family.fails.endswith(".") and family.null for family in families)


def test_one_reading_of_the_printed_conductivities_holds_everywhere():
    """K of the figures is in hundredths in the scenes of melting, in the claims on heat, and in their words."""
    setting = melting_scene.figure_5(0.3)
    (conduction,) = (e for e in melting_scene.made(setting).effects if isinstance(e, HeatConduction))
    assert conduction.conductivity[0] == pytest.approx(melting_scene.SCALE * setting.bodies[0][2])
    rows = heat.delivered(Context(), "pair_exchange").values["rows"]
    assert [row["K"] for row in rows] == pytest.approx([melting_scene.SCALE * k for k in (10, 30, 50, 70)])
    for claim in CLAIMS.values():
        if claim.system in HEAT and "K of the figures" in claim.reading:
            assert "in hundredths of a m^2/s" in claim.reading
        if claim.system in HEAT and re.search(r"\bK =", claim.what):
            assert "in hundredths of a m^2/s" in claim.reading


@pytest.mark.parametrize("name", MEASURED)
def test_every_value_behind_a_claim_is_published(name):
    claim = CLAIMS[name]
    published = json.loads((ROOT / "figures" / "claims.json").read_text())[name]
    values = [math.inf if value is None else value for value in published["values"]]
    assert len(values) == claim.starts
    assert float(f"{np.median(values):.4g}") == claim.measured
    assert [float(f"{x:.4g}") for x in (min(values), max(values))] == list(claim.spread)
    assert published["verdict"] == claim.verdict
    assert published["machine"]["processor"]
    assert published["date"]
    assert published["commit"]


@pytest.mark.parametrize("system", sorted({claim.system for claim in CLAIMS.values()}))
def test_the_page_shows_the_claims(system):
    page = (ROOT / "docs" / "claims.md").read_text()
    between = re.search(rf"<!-- claims of {system} -->\n(.*?)<!-- end of {system} -->", page, re.DOTALL)
    assert between, "write the two marks, then run python -m validation claims --write"
    assert between[1].strip() == claiming.page_table(CLAIMS, system).strip()


def test_numbers_on_the_pages_are_those_of_the_records():
    known = claiming.records(CLAIMS)
    for page in sorted((ROOT / "docs").glob("*.md")):
        text = page.read_text()
        assert filled_page(text, known, lambda name: claiming.finding(CLAIMS[name])) == text, (
            f"{page.name}: run python -m validation claims --write"
        )


def test_reasons_and_pages_are_filled():
    record = Recorded(0.866, (0.8, 1.13), 3, [0.8, 0.866, None], lambda value: value < 0.9)
    reason = "{low.less:.0f} to {high.more:.0f} % in {keeping} of {starts}: {values[1]}, {values[2]}"
    assert filled(reason, {}, record) == "20 to 13 % in 2 of 3: 0.866, infinite"
    mark, kept = "<!-- {one.median.percent:.0f} -->%s<!-- . --> %%\n", "| it is so | kept | one |"
    page = filled_page(
        mark % 7 + "| it is so | by hand | `one` |\n" + kept, {"one": record}, lambda name: f"found of {name}"
    )
    assert page == mark % 87 + "| it is so | found of one | `one` |\n" + kept
    for wrong in ("{two.low}", "{low.half}", "{values[9]}", "{picture[none][rows]}"):
        with pytest.raises(ValueError, match="names what no record holds"):
            filled(wrong, {}, record)


def test_the_issue_of_each_claim_is_there():
    """Both outcomes and reasons occur: a page on which every claim holds would have measured nothing."""
    assert {claim.verdict for claim in CLAIMS.values()} == {CONFIRMED, REFUTED, MIXED, NOT_TESTABLE}
    assert all(claim.reason for claim in CLAIMS.values() if claim.verdict == NOT_TESTABLE)


# How it is judged


def claim(**changes):
    given = {
        "name": "one",
        "experiment": "e",
        "system": "s",
        "title": "It is small",
        "says": "It is small.",
        "where": "here",
        "reading": "as printed",
        "verdict": CONFIRMED,
    }
    tested = {"what": "a size", "rule": "at_most", "bound": 1.0}
    return Claim(**{**given, **tested, **changes})


@pytest.mark.parametrize(
    ("values", "verdict"),
    [
        ([0.5, 1.0, 0.7, 0.5, 0.5], CONFIRMED),
        ([1.2, 1.1, 2.0, 2.0, math.inf], REFUTED),
        ([0.5, 1.1, 1.2, 1.2, 1.2], MIXED),
        ([math.nan, 2.0, 2.0, 2.0, 2.0], REFUTED),
        ([math.inf, 0.1, 0.1, 0.1, 0.1], MIXED),
        ([0.5, 0.5, 0.5, 0.5], NOT_TESTABLE),
        ([], NOT_TESTABLE),
    ],
)
def test_all_starts_confirm_none_refutes_and_few_judge_nothing(values, verdict):
    assert claim().judge(values) == verdict


def test_three_starts_judge_where_there_are_no_others():
    assert claim(complete=True).judge([0.5] * 3) == CONFIRMED
    assert claim(complete=True).judge([0.5] * 2) == NOT_TESTABLE


def test_one_start_judges_where_nothing_can_differ():
    assert claim(fixed="a closed form").judge([0.5]) == CONFIRMED
    assert claim(fixed="a closed form").judge([1.5]) == REFUTED
    assert claim(fixed="a closed form").judge([]) == NOT_TESTABLE


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"measured": 1.0, "spread": (1.0, 1.0)}, "······●······"),
        ({"measured": 0.5, "spread": (0.25, 1.4)}, "···───│─────●"),
        ({"rule": "at_least", "measured": 1.2, "spread": (0.9, 1.3)}, "·····─│─●····"),
        ({"rule": "equals", "measured": 0.999, "spread": (0.999, 1.0)}, "·····●│······"),
        ({"measured": math.inf, "spread": (math.inf, math.inf)}, "●·····│······"),
        ({"bound": -0.5, "measured": -1.0, "spread": (-1.0, 0.5)}, "──────│──●···"),
        ({"bound": 0.0, "rule": "equals", "measured": 0.0, "spread": (0.0, 0.0)}, "······●······"),
    ],
)
def test_what_keeps_the_bar_is_drawn_right_of_it(changes, line):
    assert claiming.drawn(claim(starts=3, **changes)) == f"`{line}`"


@pytest.mark.parametrize("name", [name for name in MEASURED if CLAIMS[name].verdict != NOT_TESTABLE])
def test_the_drawing_of_a_claim_says_what_its_verdict_says(name):
    """A mark left of the bar where a start misses it, at the bar or right of it where one keeps it."""
    left, middle, right = claiming.drawn(CLAIMS[name])[1:-1].partition("│")
    if not middle:  # the median stands on the bar
        assert CLAIMS[name].keeps(CLAIMS[name].measured)
        return
    assert bool(left.strip("·")) == (CLAIMS[name].verdict in (REFUTED, MIXED)), name
    assert bool(right.strip("·")) <= (CLAIMS[name].verdict in (CONFIRMED, MIXED)), name


def test_sentences_of_a_source_stand_once(own):
    """Claims of one sentence share it, and their reading where they are read alike."""
    both = {name: claim(name=name, starts=3, measured=0.5, spread=(0.5, 0.5)) for name in ("one", "two")}
    both["two"] = dataclasses.replace(both["two"], reason="it is two")
    page = claiming.page_table(both, "s")
    assert page.count("> It is small. (here)") == 1
    assert "Reading: as printed. (`one`, `two`)\n\n- It is two. (`two`)" in page
    both["two"] = dataclasses.replace(both["two"], reading="as adopted")
    assert "- Reading: as adopted. It is two. (`two`)" in claiming.page_table(both, "s")


def test_a_null_model_of_a_comparison_gives_every_run_the_same():
    def runs(options):
        return [Run(key, number_of, {"value": 1.0}) for key in ("own", "rival")]

    ratio = Measure(runs, lambda results: [results["own"].values["value"] / results["rival"].values["value"]])
    assert list(alike({"value": 3.0})(ratio)) == [1.0]
    assert ratio.of({"": {"value": 1.0}, "own": {"value": 2.0}}) == [2.0]


def test_a_family_that_names_no_measure_is_refused():
    module = types.ModuleType("made")
    module.SMALL = Measure(lambda options: [], lambda results: [])
    module.FAMILIES = (Family(("small", "tall"), "It could be large.", "a large one", alike({})),)
    with pytest.raises(ValueError, match="tall"):
        measures(module)
    module.FAMILIES = (Family(("small",), "It could be large.", "a large one", alike({})),)
    assert measures(module)["small"].family is module.FAMILIES[0]


def test_a_drop_at_rest_on_few_starts_is_not_left_out():
    """Starts from which neither drop comes to rest count: the claim that one is sooner does not hold there."""
    how = discover()["models"].claims["sooner_than_csf"]
    keys = [run.key for run in how.runs(Options())]
    round_ = {"surface": {"end": {"area": 1.0, "thrown": 0}}, "particles": 4913}
    rest = {key: {"wall": 1.0} if key.startswith("cube_") and key.endswith("zhu") else None for key in keys}
    still = {key: {"rest": rest[key], **round_} for key in keys}
    assert how.of(still) == [0.0, *[math.inf] * 4]
    assert CLAIMS["sooner_than_csf"].judge(how.of(still)) == MIXED


def test_what_was_measured_is_held_against_what_is_written():
    assert Found(claim(), [0.5] * 5).holds
    assert not Found(claim(), [1.5] * 5).holds
    assert not Found(claim(), [0.5, *[1.5] * 4]).holds
    assert Found(claim(verdict=REFUTED), [1.5] * 5).holds
    assert Found(claim(), missing="not now").holds


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('verdict="not testable"\nwhere="y"\ntitle="t"\nreading="r"', "a reason"),
        ('verdict="not testable"\nwhere="y"\ntitle="t"\nreason="z"', "reading"),
        ('verdict="perhaps"\nwhere="y"', "lacks"),
        ('verdict="not testable"\nreason="z"', "lacks"),
        ('verdict="not testable"\nwhere="y"\nreason="z"\nmood="good"', "unknown"),
    ],
)
def test_an_incomplete_claim_is_refused(text, words, tmp_path):
    (tmp_path / "e").mkdir()
    (tmp_path / "e" / "expected.toml").write_text(f'[claim.a]\nsystem="s"\nsays="x"\n{text}')
    with pytest.raises(ValueError, match=words):
        read_claims(tmp_path)


# The command


def number_of(context, value):
    return Result({"value": value})


@pytest.fixture
def own(tmp_path, monkeypatch):
    """A file, a page and one measure of our own; its values are set by the test."""
    (tmp_path / "e").mkdir()
    (tmp_path / "e" / "expected.toml").write_text(
        '[claim.small]\nsystem = "s"\ntitle = "It is small"\nsays = "It is small indeed."\nwhere = "(1)"\n'
        'reading = "as printed"\nwhat = "its size"\nunit = "m"\nat_most = 1\nmeasured = 0.5\nspread = [0.5, 0.5]\n'
        'starts = 5\nover = "seeds"\nnull = nan\nverdict = "confirmed"\n\n'
        '[claim.nice]\nsystem = "s"\ntitle = "It is nice"\nsays = "It is nice indeed."\nwhere = "(2)"\n'
        'reading = "as printed"\nverdict = "not testable"\nreason = "No measure."\n'
    )
    (tmp_path / "claims.md").write_text("# Page\n<!-- claims of s -->\n<!-- end of s -->\nmore\n")
    values = [0.25, 0.5, 0.75, 0.5, 0.5]

    def runs(options):
        return [Run(f"size_{k}", number_of, {"value": value}) for k, value in enumerate(values)]

    large = Family(("small",), "It could be large.", "a large one", alike({"value": 9.0}))
    one = Measure(runs, lambda results: [result.values["value"] for result in results.values()], family=large)
    monkeypatch.setattr(checks, "FOLDER", tmp_path)
    monkeypatch.setattr(claiming, "PAGE", tmp_path / "claims.md")
    monkeypatch.setattr(claiming, "discover", lambda: {"e": Experiment("e", "title", claims={"small": one})})
    folders = ["--results", str(tmp_path / "results"), "--figures", str(tmp_path / "figures")]
    return values, folders, tmp_path


def test_the_command_measures_stores_and_writes(own, capsys):
    values, folders, folder = own
    assert main(["claims", "--write", *folders]) == EXIT_FINE
    printed = capsys.readouterr().out
    assert "0.5 (0.25 to 0.75)" in printed
    assert "No measure." in printed
    written = read_claims()["small"]
    assert (written.measured, written.spread, written.starts) == (0.5, (0.25, 0.75), 5)
    page = (folder / "claims.md").read_text()
    assert page.startswith("# Page\n")
    assert page.endswith("more\n")
    assert written.null == 9.0
    sentence = "It is small: **confirmed**. Its size: 0.5 m (0.25 to 0.75), 5 seeds. (`small`)"
    cells = [sentence, "`······│·────●`", "at most 1", "9"]
    assert f"| {' | '.join(cells)} |" in page
    assert "| It is nice: **not testable**. No measure. (`nice`) |  |  |  |" in page
    assert "- It could be large. Null model: a large one. (`small`)" in page
    assert "> It is small indeed. ((1))\n\nReading: as printed. (`small`)" in page
    assert json.loads((folder / "figures" / "claims.json").read_text())["small"]["values"] == values
    assert len(list((folder / "results" / "e").iterdir())) == 5


def test_a_verdict_that_no_longer_holds_is_told_and_can_be_written(own, capsys):
    values, folders, folder = own
    values[2] = 1.5
    assert main(["claims", *folders]) == EXIT_FAILED
    assert "confirmed  now mixed" in capsys.readouterr().out
    assert read_claims()["small"].verdict == CONFIRMED
    assert main(["claims", "--write", *folders]) == EXIT_FINE
    assert read_claims()["small"].verdict == MIXED
    assert "It is small: **mixed**." in (folder / "claims.md").read_text()


def test_without_computing_only_stored_results_count(own):
    values, folders, folder = own
    options = Options(results=folder / "results")
    (found, _) = claiming.measure(list(read_claims().values()), options, compute=False)
    assert found.missing == "not measured here"
    main(["claims", *folders])
    (found, _) = claiming.measure(list(read_claims().values()), options, compute=False)
    assert found.values == values


def test_bad_input_gets_a_sentence(own, capsys):
    _, folders, _ = own
    assert main(["claims", "smell", *folders]) == EXIT_INPUT
    assert "no claim or system 'smell'" in capsys.readouterr().err
    assert main(["claims", "--write", "--quick", *folders]) == EXIT_INPUT


def test_processes_give_what_one_gives(tmp_path):
    """Two closed forms of the droplet in two processes, stored and read back."""
    chosen = [CLAIMS["repulsion_3d"], CLAIMS["repulsion_2d"]]
    found = claiming.measure(chosen, Options(quick=True, results=tmp_path), jobs=2)
    assert [each.values[0] for each in found] == pytest.approx([1.968, 0.222], abs=1e-3)
    assert all(each.holds for each in found)
    (folder, *_) = (tmp_path / "droplet").iterdir()
    assert json.loads((folder / "result.json").read_text())["about"]["date"]


# Tiny runs of what the claims measure


def test_the_explicit_scheme_keeps_the_range_up_to_half_and_loses_it_from_one_on():
    assert heat.long_steps(Context(), "explicit", 0.5).values["beyond"] < 1e-9
    assert heat.long_steps(Context(), "explicit", 1.0).values["beyond"] > 1.0


def test_thrown_particles_have_a_surface():
    whole = models.whole_area({"surface": {"end": {"area": 1.0, "thrown": 0}}, "particles": 1000})
    torn = models.whole_area({"surface": {"end": {"area": 1.0, "thrown": 100}}, "particles": 1000})
    assert whole == 1.0
    assert torn == pytest.approx(0.9 ** (2 / 3) + 1.0)


def test_area_term_keeps_momentum_and_turns_the_drop():
    both = droplet.area_force(Context(), 125, 1, "all", "cpu").values
    one_sided = droplet.area_force(Context(), 125, 1, "one_sided", "cpu").values
    assert both["area"]["linear"] < 1e-13 < 1e-4 < both["area"]["angular"]
    assert both["without"]["angular"] < 1e-13
    assert one_sided["area"]["linear"] > 1e-3


def test_density_near_the_surface_gains_by_the_correction():
    error = droplet.surface_density(Context(), 343, 1, "cpu").values["error"]
    assert 0.05 < error["corrected"] < error["raw"]


def test_released_pressure_and_splash_runs():
    """Without a clamp, the pressure that J(12) sets to zero is negative: the noise falls."""
    noise = {}
    for method in ("number_density", "two_step"):
        values = dam_break.released(Context(), 8, 0.2, 1, method, False, "cpu").values
        assert 0 <= values["marked"] < 0.5
        noise[method] = values["noise"]
    assert 0 < noise["number_density"] < noise["two_step"]
    assert dam_break.splash(Context(), 8, 0.5, 1, True, "cpu").values["detached"] >= 0


def test_runs_of_the_published_sizes_are_those_of_the_cases():
    """What a case has computed serves its claims: same key, same parameters."""
    from validation.experiments.dam_break.experiment import EXPERIMENT as DAM_BREAK
    from validation.experiments.droplet.experiment import EXPERIMENT as DROPLET

    for case, measure in ((DROPLET, droplet.AREA_ROUNDS), (DAM_BREAK, dam_break.FIGURE_5_UPPER)):
        known = {run.key: run for run in case.runs(Options())}
        shared = [run for run in measure.runs(Options()) if not run.key.startswith("claim_")]
        assert len(shared) >= 5
        for run in shared:
            assert (run.function, run.parameters) == (known[run.key].function, known[run.key].parameters)


def test_a_drop_that_never_comes_to_rest_is_infinitely_later():
    def results(mine, its):
        return {key: Result({"steady": its}) for key in droplet.FROM} | {
            f"claim_steady_soft_{key}": Result({"steady": mine}) for key in droplet.FROM
        }

    values = droplet.STEADY_SOONER_SOFT.values
    assert values(results({"wall": 3.0}, {"wall": 2.0})) == [1.5] * 5
    assert values(results(None, {"wall": 2.0})) == [math.inf] * 5
    assert values(results({"wall": 3.0}, None)) == [0.0] * 5
    assert values(results(None, None)) == [math.inf] * 5
