"""Evidence of GPU runs adds up: each task of a device's report is kept with its date, commit and digest."""

import importlib.util
import json
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def gpu_check():
    spec = importlib.util.spec_from_file_location("gpu_check", ROOT / "scripts" / "gpu_check.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def answer(gpu_check, task, value=1.0, **more):
    about = {"date": "2026-11-22 10:00 UTC", "commit": "abc1234", "digest": gpu_check.digest(task), "seconds": 1.0}
    return {"task": task, "rows": [gpu_check.row("12 trials", value)], "error": None, **about, **more}


def test_runs_add_up(gpu_check, tmp_path):
    stem = gpu_check.report_of("NVIDIA H200", tmp_path)
    assert stem.name == "nvidia_h200"
    stem.with_suffix(".md").write_text("# NVIDIA H200\n\n## Whole check\n\nold\n\n## Another\n\nkept\n")
    stem.with_suffix(".json").write_text(json.dumps({"another": 1}))
    gpu_check.write([answer(gpu_check, "pairing sph.density float32")], stem, "NVIDIA H200")
    late = answer(gpu_check, "pairing sph.density float32", error="not run: no time was left")
    more = answer(gpu_check, "pairing sph.momentum float32", date="2026-11-23 10:00 UTC", digest="of other code")
    gpu_check.write([late, more], stem, "NVIDIA H200")
    kept = gpu_check.stored(stem)
    assert set(kept) == {"pairing sph.density float32", "pairing sph.momentum float32"}
    assert not kept["pairing sph.density float32"]["error"], "a task without time takes no other's place"
    assert gpu_check.holds(kept["pairing sph.density float32"])
    assert not gpu_check.holds(kept["pairing sph.momentum float32"])
    page = stem.with_suffix(".md").read_text()
    assert "2 of 2 tasks pass." in page
    assert "changed, 1: pairing sph.momentum float32." in page
    assert "old" not in page
    assert page.endswith("## Another\n\nkept\n")
    assert json.loads(stem.with_suffix(".json").read_text())["another"] == 1


def test_a_pairing_depends_on_its_operation_only(gpu_check):
    assert gpu_check.digest("pairing sph.density float32") == gpu_check.digest("pairing sph.momentum float64")
    digests = {
        gpu_check.digest(f"pairing {name} float32") for name in ("sph.density", "heat.explicit", "akinci_2013.tension")
    }
    assert len(digests | {gpu_check.digest("run dam_break float32 1000")}) == 4
