"""The plugin of pytest: one trial is one test, what is not judged is skipped, a case's arrays come from a fixture."""

import importlib.metadata
import os
import subprocess
import sys
import xml.etree.ElementTree

PROGRAMS = """
from refsim.contract import Programs

def gravity(field, acceleration):
    acceleration += 2 * field if len(acceleration) == 3 else field

PROGRAMS = Programs({"sph.gravity": gravity}, dtypes=("float64",), dims=(3,))
"""
TESTS = """
import pytest
from mine import PROGRAMS

@pytest.mark.contract(steps=("T2",))
def test_contract(contract_trial):
    contract_trial()

def test_arrays(contract_arrays):
    given = contract_arrays("sph.density", "cloud_3d", "float32")
    assert given["position"].shape == (150, 3)
    assert given["position"].dtype == "float32"
    assert given["walls"] is None
"""
KNOWN = any(e.value == "refsim.pytest_plugin" for e in importlib.metadata.entry_points(group="pytest11"))


def run(folder):
    """(exit code, {test: outcome}, {test: message}) of pytest in the folder."""
    plugin = () if KNOWN else ("-p", "refsim.pytest_plugin")
    command = [sys.executable, "-m", "pytest", "-q", *plugin, "-W", "error", "--junit-xml", "out.xml"]
    path = os.pathsep.join([str(folder), *sys.path])
    own = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}  # not xdist's
    done = subprocess.run(command, cwd=folder, env=own | {"PYTHONPATH": path}, capture_output=True, text=True)
    outcomes, messages = {}, {}
    for test in xml.etree.ElementTree.parse(folder / "out.xml").iter("testcase"):
        kinds = [child.tag for child in test if child.tag in ("failure", "skipped", "error")]
        outcomes[test.get("name")] = kinds[0] if kinds else "passed"
        messages[test.get("name")] = " ".join(child.get("message", "") for child in test)
    return done.returncode, outcomes, messages


def test_one_trial_is_one_test(tmp_path):
    (tmp_path / "mine.py").write_text(PROGRAMS)
    (tmp_path / "test_mine.py").write_text(TESTS)
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    code, outcomes, messages = run(tmp_path)
    assert code == 1
    trial = "test_contract[sph.gravity-float64-variant0-T2-{}]".format
    assert outcomes["test_arrays"] == outcomes[trial("cloud_3d")] == "passed"
    assert [name for name, outcome in outcomes.items() if outcome == "failure"] == [trial("three_particles")]
    assert (
        "your program gives acceleration 2 times as large as right, in all rows" in messages[trial("three_particles")]
    )
    assert outcomes[trial("cloud_2d")] == "skipped"
    assert "not judged: in 2 dimensions" in messages[trial("cloud_2d")]
    assert "not judged: float32" in messages["test_contract[sph.gravity-float32-variant0---every_trial]"]
    assert len(outcomes) > 20
