"""Published numbers computed anew: what holds, what deviates, and what is chosen."""

import dataclasses
import json
import math

import pytest

from validation import claims, verify
from validation.__main__ import main
from validation.claims import Claim
from validation.experiment import Experiment, Measure, Options, Run, discover
from validation.perform import EXIT_FAILED, EXIT_FINE, EXIT_INPUT
from validation.results import Result
from validation.verify import Selection, Value

SELECTION = verify.read()
CLAIMS = claims.read_claims()


def made(context, value):
    return Result({"value": value})


def known(*starts):
    runs = [Run(f"start_{k}", made, {"value": value}) for k, value in enumerate(starts)]
    measure = Measure(lambda options: runs, lambda results: [each.values["value"] for each in results.values()])
    return {"fake": Experiment("fake", "for tests", runs=lambda options: runs, claims={"steady": measure})}


STEADY = Claim(
    "steady", "fake", "fake", "Steady", "It is steady.", "here", "plain", "confirmed", "size", "m", "at_most", 3.0, 2.0,
    (1.9, 2.1), 5,
)  # fmt: skip
FIRST = Value("first", "fake", "start_0", "value", "first size", "m", 2.0, (1.9, 2.1), "nothing")


def found(starts, claim=STEADY, value=FIRST, rounding=()):
    selection = Selection(("steady",), frozenset(rounding), {"first": value})
    both = verify.verify((), selection=selection, known=known(*starts), published={"steady": claim})
    return {each.name: each.why for each in both}


def test_what_is_within_the_published_spread_holds():
    assert found([2.0, 2.0, 2.0, 1.95, 2.3]) == {"steady": "", "first": ""}
    assert found([1.899, 1.899, 1.899, 2.0, 2.0]) == {"steady": "", "first": ""}, (
        "spreads are published with four digits"
    )


def test_an_altered_number_is_noticed():
    why = found(5 * [2.2])
    assert why["steady"].startswith("steady: size is 2.2, published is confirmed, 2 m (1.9 to 2.1); find what changed")
    assert why["first"].startswith("first: first size is 2.2, published is 2 m (1.9 to 2.1); find what changed it")
    other = dataclasses.replace(STEADY, measured=2.2, spread=(2.15, 2.25))
    assert "published is confirmed, 2.2 m (2.15 to 2.25)" in found(5 * [2.0], claim=other)["steady"]
    one = dataclasses.replace(FIRST, measured=2.2, spread=(2.2, 2.2))
    assert found(5 * [2.0], value=one)["first"]


def test_another_verdict_is_noticed_even_where_numbers_are_rounding():
    assert "the verdict is mixed" in found([2.0, 2.0, 2.0, 2.0, 4.0])["steady"]
    assert found(5 * [1e-3], rounding=["steady"])["steady"] == ""
    assert "the verdict is refuted" in found(5 * [4.0], rounding=["steady"])["steady"]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_deviates(value):
    assert not verify.within(value, (1.9, 2.1))


def test_a_stopped_run_is_said(monkeypatch):
    def stop(context, value):
        from refsim.core.errors import RunStopped

        raise RunStopped("diverged", "It stopped here.")

    monkeypatch.setitem(globals(), "made", stop)
    assert found([2.0, 2.0, 2.0]) == {
        name: f"{name}: It stopped here. (reason: diverged)" for name in ("steady", "first")
    }


# What is chosen


def test_every_system_with_claims_has_some():
    assert {CLAIMS[name].system for name in SELECTION.claims} == {claim.system for claim in CLAIMS.values()}
    assert "solutions" in {value.experiment for value in SELECTION.values.values()}, "the base liquid"


def test_what_is_chosen_can_be_compared_on_any_machine():
    for name in SELECTION.claims:
        claim, how = CLAIMS[name], discover()[CLAIMS[name].experiment].claims[name]
        runs = how.runs(Options())
        assert claim.starts
        assert runs
        assert not how.timed, f"{name}: times differ between machines"
        assert not any(run.alone or run.skip for run in runs)
        if name in SELECTION.rounding:
            assert max(map(abs, claim.spread)) < 1e-12, f"{name}: this is more than rounding"
    for value in SELECTION.values.values():
        assert len(verify._run_of(discover()[value.experiment], value.run)) == 1


def test_the_command_compares_with_what_is_written(monkeypatch, capsys):
    assert main(["verify", "repulsion_3d", "--jobs", "1", "--json"]) == EXIT_FINE
    assert json.loads(capsys.readouterr().out)["repulsion_3d"]["now"] == [pytest.approx(1.968, abs=5e-4)]
    altered = dataclasses.replace(CLAIMS["repulsion_3d"], measured=1.978, spread=(1.978, 1.978))
    monkeypatch.setattr(claims, "read_claims", lambda: {**CLAIMS, "repulsion_3d": altered})
    assert main(["verify", "repulsion_3d", "--jobs", "1"]) == EXIT_FAILED
    told = capsys.readouterr()
    assert "deviates" in told.out
    assert "run `python -m validation claims repulsion_3d --write`" in told.err


def test_a_draw_is_repeated_by_its_seed(capsys):
    first = verify.drawn(5, seed=3)
    assert first == verify.drawn(5, seed=3) != verify.drawn(5, seed=4)
    assert not set(first.claims) & set(SELECTION.claims)
    everything = verify.drawn(10_000, seed=1).claims
    assert len(everything) > 30
    assert not any(discover()[CLAIMS[name].experiment].claims[name].timed for name in everything)
    assert main(["verify", "--draw", "0"]) == EXIT_INPUT
    assert main(["verify", "repulsion_3d", "--draw", "1"]) == EXIT_INPUT
    assert main(["verify", "--draw", "1", "--seed", "5", "--jobs", "1"]) == EXIT_FINE
    assert "seed 5: " in capsys.readouterr().err


def test_only_what_is_chosen_can_be_named(capsys):
    assert main(["verify", "repulsion_3"]) == EXIT_INPUT
    assert "There is no verified number 'repulsion_3'; did you mean 'repulsion_3d'?" in capsys.readouterr().err


@pytest.mark.parametrize(
    "text",
    [
        'claims = ["a"]\nrounding = ["b"]\n[value]\n',
        "claims = []\nrounding = []\n",
        'claims = []\nrounding = []\n[value.a]\nwhat = "size"\nspread = [1, 2]\nmeasured = 1\n',
    ],
)
def test_an_incomplete_entry_is_refused(tmp_path, text):
    path = tmp_path / "verify.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match="needs"):
        verify.read(path)


def test_continuous_integration_verifies():
    from pathlib import Path

    script = (Path(__file__).parents[2] / ".ci" / "run").read_text()
    assert "\npython -m validation verify\n" in script
