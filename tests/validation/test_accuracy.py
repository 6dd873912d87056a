"""Panels and times: the pages that their records make, what is measured anew, benchmarks from end to end."""

import itertools
import os
import re
import subprocess
import sys
import tomllib
from dataclasses import replace

import msgspec
import pytest

from refsim import make_plan
from refsim.study.panels import FOLDER, OWN, abouts, panel, parse
from refsim.study.panels.scenes import PACKED, STARTS
from validation import accuracy, accuracy_page, limits, panel_runs, timed, times
from validation.reading import reading


def test_the_page_is_what_the_stored_points_make():
    assert accuracy_page.page() == accuracy_page.PAGE.read_text(), "python -m validation accuracy --draw"


def test_a_column_of_seconds_has_one_machine():
    """Panels of two processors have two tables, two GPUs have two columns; a panel of two processors is refused."""
    known = [panel("droplet"), panel("vortex_decay"), panel("melt_front")]
    text = "\n".join(accuracy_page.tables(known))
    assert text.count("| observable |") == len(re.findall("^CPU: (.*)", text, re.MULTILINE)) == 2
    assert text.count("| NVIDIA H100 80GB HBM3 | NVIDIA H200 |") == 1
    row = next(line for line in text.splitlines() if "80 spacings" in line)
    assert [cell.strip() for cell in row.split("|")][-5:-1] == ["1.21 s", "", "307 ms", ""]
    other = [msgspec.structs.replace(place, machine=f"machine {k}") for k, place in enumerate(known[0].places)]
    with pytest.raises(ValueError, match="droplet was not timed on one processor"):
        accuracy_page.tables([replace(known[0], places=tuple(other))])


@pytest.mark.parametrize("name", abouts())
def test_every_panel_can_be_measured_anew(name):
    """By its packaged scene or by NAME.zip; other programs' points by a run that is there."""
    written = tomllib.loads((FOLDER / f"{name}.toml").read_text())
    assert ("spacing" in written) != (name in PACKED)
    assert written["panel"].get("start", "shaken") in STARTS
    programs = {p.program for p in panel(name).points.values()} - {OWN}
    assert bool(programs) == callable(getattr(panel_runs, name, None))


def test_a_panel_is_measured_and_stored(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(accuracy, "STORED", tmp_path)
    monkeypatch.setattr(accuracy.accuracy_page, "write", lambda: None)
    keys = ("n6_w2_s200", "n4_w2_s200")
    few = replace(panel("spinning_body"), points={key: panel("spinning_body").points[key] for key in keys})
    one = type("One", (), {"cache_clear": lambda self: None, "__call__": lambda self, name: few})()
    monkeypatch.setattr(accuracy, "panel", one)
    monkeypatch.setattr(accuracy, "broken", lambda judged: [])
    given = few.reference()
    read = lambda of, point, scene: reading(given.value + given.scale * point.error, 1.0, 3, 200)  # noqa: E731
    monkeypatch.setattr(sys.modules["refsim.study.panels.measured"], "reading_of", read)
    assert accuracy.perform(["spinning_body"], readings=2, write=True) == 0
    stored = parse((tmp_path / "spinning_body.json").read_text())
    found = {key: point for key, point in stored.points.items() if point.place >= 0}
    assert found.keys() == set(keys)
    for key, point in found.items():
        assert point.error == pytest.approx(few.points[key].error)
        assert len(point.seconds) == 2
        assert stored.places[point.place].commit


# Scenes
@pytest.mark.parametrize("name", timed.ladders())
def test_a_ladder_only_adds(name):
    """No rung launches less, or holds less, than the one before it; the small scenes have the same effects."""

    def of(rungs):
        plans = [make_plan(rung.scene) for rung in rungs]
        return [(len(timed.step_launches(plan, "cuda")), sum(plan.field_bytes().values())) for plan in plans]

    rungs = of(timed.ladders()[name].rungs)
    for before, after in itertools.pairwise(rungs):
        assert after[0] >= before[0]
        assert after[1] >= before[1]
    assert rungs[-1][1] > rungs[0][1]
    assert of(timed.ladders(True)[name].rungs) == rungs


# Benchmarks, store, pages
@pytest.mark.slow
def test_benchmarks_become_stored_times(tmp_path):
    """Of every kind, on the CPU and in the CUDA simulator, with kernels that run as Python."""
    file, names = tmp_path / "times.json", ("effects", "scaling", "kernels", "device")
    chosen = "sph-0-cpu or (test_steps and Dong) or (sph.density and float32 and not cuda)"
    chosen += " or copy or arithmetic or (test_kernel and 60k) or 60k-jiang_zhu or sph-0-cuda"
    words = [*(f"tests/times/bench_{name}.py" for name in names), "--edge", "3", "--particles", "50", "-k", chosen]
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "--tiny", "--benchmark-json", str(file), *words]
    own = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    own |= {"PYTHONPATH": f"{times.ROOT}{os.pathsep}{times.ROOT / 'tests'}"}
    own |= {"NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(command, cwd=times.ROOT, env=own, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-3000:]
    assert "tests/times" not in file.read_text().partition('"benchmarks"')[0], "the machine has its words only"
    found = times.read(file)
    assert set(found) == {"effects cpu", "scaling cpu", "effects cuda", "device cuda"}
    (one,) = found["effects cpu"]["readings"].values()
    assert one["particles"] == 27
    assert min(one["seconds"]) > 0
    cores = len(os.sched_getaffinity(0))
    assert len(found["scaling cpu"]["readings"]) == sum(count <= cores for count in (1, 2, 4, 8, 16, 32))
    assert "| Dong | 27 |" in "\n".join(times.scaling_table(found))
    there = found["device cuda"]["readings"]
    assert set(there) >= {"copy", "arithmetic", "60k jiang_zhu", "60k list"}
    assert set(there) >= {f"60k {kernel}" for kernel in limits.STEP_KERNELS}
    assert there["60k density"]["particles"] == 27
    # In the cube of 3^3 within 2 d, without pairs at 2 d exactly: 3, 5 or more of 26 on corners, edges, faces, inside.
    assert 12 < there["60k density"]["neighbours"] <= there["60k density"]["entries"]
    assert there["60k density"]["neighbours"] < 26
    assert found["effects cuda"]["readings"]["sph: liquid"]["kernels"] == 12


def test_the_page_is_what_the_command_makes():
    assert times.page(times.stored()) == times.PAGE.read_text(), "python -m validation times"
