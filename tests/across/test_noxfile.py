"""Sessions of nox: nothing marked slow is left out at night, a task ends at its limit, wheels are tried as promised."""

import os
import pathlib
import subprocess
import sys

import pytest

nox = pytest.importorskip("nox", reason='pip install "refsim[dev]" brings nox')
ROOT = pathlib.Path(__file__).parents[2]
HANGING = """
import noxfile
noxfile.NIGHT["hanging"] = 0.01, ("python", "-c", "import subprocess as s; s.run(['sleep', '98765'])")
noxfile.task("hanging")
"""


@pytest.fixture(scope="module")
def noxfile():
    import importlib.util

    spec = importlib.util.spec_from_file_location("noxfile", ROOT / "noxfile.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def run(*words, file=ROOT / "noxfile.py"):
    around = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST_", "COV_"))}
    command = [sys.executable, "-m", "nox", "-f", str(file), *words]
    return subprocess.run(command, capture_output=True, text=True, env=around | {"PYTHONPATH": str(ROOT)}, cwd=ROOT)


def test_both_tasks_together_run_every_slow_test(noxfile):
    slow, slips = (noxfile.NIGHT[name][1] for name in ("slow", "slips"))
    assert slow[:6] == slips[:6] == ("python", "-m", "pytest", "-q", "-m", "slow")
    assert slow[6:] == ("--ignore", noxfile.SLIPS)
    assert slips[-1] == noxfile.SLIPS
    assert (ROOT / noxfile.SLIPS).exists()


def test_sessions_and_an_unknown_one():
    listed = run("-l").stdout
    assert all(f"- {name} -> " in listed for name in ("slips", "attack", "verify", "lowest", "environments-3.12"))
    assert run("-s", "nigthly").returncode != 0


def test_a_task_ends_at_its_limit_with_what_it_has_started(tmp_path):
    (tmp_path / "noxfile.py").write_text(f"import sys\nsys.path.insert(0, {str(ROOT)!r})\n{HANGING}")
    done = run("-s", "hanging", file=tmp_path / "noxfile.py")
    assert done.returncode == 1
    assert "timeout" in done.stderr
    assert "98765" not in subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True, check=True).stdout


def test_the_oldest_python_is_that_of_the_configuration(noxfile):
    options = noxfile.settings()["options"]
    assert noxfile.PYTHONS[0] == options["python_requires"].removeprefix(">=")
    assert all(line.count(">=") == 1 for line in options["install_requires"].split())
