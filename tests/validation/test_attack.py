"""The attack campaign: it runs, it repeats, it notices; and what it once found does not come back."""

import json
import math

import pytest

from validation.__main__ import main
from validation.attack import BAD, GOOD, KINDS, commands
from validation.attack.campaign import FINDINGS
from validation.attack.pool import carry_out, draw, perform

STORED = sorted(FINDINGS.glob("*.json"))


@pytest.mark.parametrize("path", STORED, ids=lambda path: path.stem)
def test_what_was_found_does_not_come_back(path):
    finding = json.loads(path.read_text())
    outcome, words = carry_out(finding["kind"], finding["trial"])
    assert outcome in GOOD, words


def test_a_tiny_campaign(tmp_path, capsys):
    given = ["--minutes", "5", "--seed", "1", "--jobs", "1", "--scale", "0.002", "--only", "scenes", "checkpoints"]
    code = main(["attack", *given, "--out", str(tmp_path)])
    said = capsys.readouterr()
    assert code == 0, said.err
    found = json.loads((tmp_path / "attack.json").read_text())
    assert {kind: counts["trials"] for kind, counts in found["counts"].items()} == {"scenes": 20, "checkpoints": 9}
    assert found["findings"] == []
    assert found["seed"] == 1
    assert said.out.split()[:2] == ["kind", "trials"]


@pytest.mark.parametrize("trial", [("import", "exit 0"), ("program", "os._exit"), ("harmless", "forks")])
def test_hostile_libraries(trial):
    outcome, words = carry_out("libraries", dict(zip(("group", "name"), trial)))
    assert outcome in GOOD, words


@pytest.mark.parametrize("kind", KINDS)
def test_a_seed_draws_the_same_trials_as_plain_values(kind):
    trials = [draw(kind, 7, n) for n in range(20)]
    assert trials == [draw(kind, 7, n) for n in range(20)]
    assert json.loads(json.dumps(trials)) == trials
    if kind != "libraries":
        assert trials != [draw(kind, 8, n) for n in range(20)]


def test_a_trial_that_kills_its_process_or_does_not_end_is_a_finding(monkeypatch):
    monkeypatch.setitem(KINDS, "breaking", (5, -25.0))  # 30 s less 25 s
    found = {e.number: e for e in perform([("breaking", n) for n in range(5)], 1, 1, math.inf)}
    assert {n: e.outcome for n, e in found.items()} == {0: "0", 1: "died", 2: "hang", 3: "traceback", 4: "0"}
    assert "exit code -6" in found[1].words
    assert "ValueError: no" in found[3].words


def test_a_lost_state_is_noticed():
    whole = commands.reference("--backend", "numpy")
    assert commands.compared(whole["run"], whole) == ("0", "")
    other = whole["state"] | {"position": b"other"}
    assert commands.compared(whole["run"], whole | {"state": other})[0] == "lost"
    assert commands.compared(whole["run"], whole | {"frames": whole["frames"][:-1]})[0] == "lost"


def test_bad_options_and_files_get_one_sentence(tmp_path, capsys):
    assert main(["attack", "--minutes", "-1"]) == 2
    assert "--minutes = -1.0 is not possible" in capsys.readouterr().err
    (tmp_path / "a.json").write_text("{}")
    assert main(["attack", "--replay", str(tmp_path / "a.json")]) == 2
    assert "is no stored finding" in capsys.readouterr().err
    assert set(BAD).isdisjoint(GOOD)
