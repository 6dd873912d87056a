"""The main job: what it runs."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from validation.experiment import Options, discover

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "reproduce.py"


def load_script():
    spec = importlib.util.spec_from_file_location("reproduce", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_main_job_is_made_of_runs_that_are_there():
    script, known = load_script(), discover()
    for group in script.MAIN:
        for name, keys in group.items():
            runs = {run.key: run for run in known[name].runs(Options(quick=True))}
            assert set(keys) <= set(runs)
            assert not [key for key in keys if runs[key].skip]
    first, second = script.planned(known, Options(quick=True))
    assert [(part.name, [run.key for run in part.runs]) for part in first + second] == [
        (name, list(keys)) for group in script.MAIN for name, keys in group.items()
    ]
    assert next(iter(script.MAIN[0].items()))[1][0] == "detection_2d"


def test_full_leaves_no_run_out():
    script, known, options = load_script(), discover(), Options()
    groups = script.planned(known, options)
    assert [part.name for part in groups[0]] == list(script.MAIN[0])
    there = {part.name: [run.key for run in part.runs] for parts in groups for part in parts}
    assert there == {name: [run.key for run in each.runs(options)] for name, each in known.items()}
