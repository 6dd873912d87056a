"""Commands that are asked to stop: one sentence, what is kept, and no process that outlives the command."""

import contextlib
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import time
import weakref

import pytest

from refsim import Simulation
from refsim.core.stopping import handling_signals, held_back
from tests.running import ROOT, awaited, rows
from tests.tank_file import tank

SCENE = tank(100.0)
SWEEP = rows(__file__, "sweep")
pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")


def start(folder, *words, options=()):
    """The command `refsim` in a folder, the head of a group of processes."""
    signals = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"  # not in a background
    signals += "; signal.signal(signal.SIGHUP, signal.SIG_DFL)\n"  # nor under nohup
    program = signals + "import sys; sys.argv[0] = 'refsim'\nfrom refsim.__main__ import main\nsys.exit(main())"
    return subprocess.Popen(
        [sys.executable, *options, "-c", program, *words], cwd=folder, text=True, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, env={**os.environ, "PYTHONPATH": str(ROOT)}, start_new_session=True,
    )  # fmt: skip


def ended(process, within):
    """What a process has written, once every process of its group has closed the pipes."""
    try:
        return process.communicate(timeout=within)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)


@pytest.fixture
def sweeping(tmp_path):
    """A sweep whose first run is under way."""
    (tmp_path / "tank.toml").write_text(SCENE)
    (tmp_path / "sounds.toml").write_text(SWEEP)
    process = start(
        tmp_path, "sweep", "sounds.toml", "--jobs", "1", "--output", "kept", "--quiet", "--checkpoint-every", "0.1"
    )
    awaited(lambda: list(tmp_path.glob("kept/running/*/checkpoint.h5")), process)
    return process


def test_a_signal_that_is_held_back_comes_after_the_block():
    whole = []

    def act():
        with held_back():
            signal.raise_signal(signal.SIGINT)
            whole.append(True)

    with pytest.raises(KeyboardInterrupt):
        act()
    assert whole


def test_a_sweep_that_is_asked_to_stop_ends_with_its_processes(sweeping):
    began = time.monotonic()
    sweeping.send_signal(signal.SIGHUP)  # to the parent alone
    out, err = ended(sweeping, 30)
    assert time.monotonic() - began < 5, "less than 2 s on an idle machine"
    assert (sweeping.returncode, out) == (3, "")
    assert err == (
        "refsim: Interrupted; the results of the finished runs are kept in kept, and the same command goes on from"
        " there. [interrupted]\n"
    )


def test_the_processes_of_a_killed_sweep_end_with_it(sweeping):
    sweeping.kill()
    ended(sweeping, 30)  # the pipes are closed only when no process is left


def test_a_study_that_is_asked_to_stop_says_what_is_kept(tmp_path):
    (tmp_path / "tank.toml").write_text(SCENE)
    process = start(
        tmp_path, "study", "tank.toml", "--observable", "kinetic_energy", "--backend", "numpy", "--knobs", "step"
    )
    assert "runs to do" in process.stderr.readline()
    process.send_signal(signal.SIGTERM)
    _, err = ended(process, 30)
    assert process.returncode == 3
    assert "the results of the finished runs are kept in tank_study" in err
    assert "[interrupted]" in err
    assert "Traceback" not in err


def test_a_signal_during_the_imports_ends_with_the_exit_code_of_a_stop(tmp_path):
    process = start(tmp_path, "list", "--json", options=("-X", "importtime"))
    while "numpy" not in process.stderr.readline():
        pass
    process.send_signal(signal.SIGINT)
    out, err = ended(process, 30)
    assert process.returncode == 3
    found = json.loads(out)
    assert (found["reason"], found["exit_code"]) == ("interrupted", 3)
    assert f"refsim: {found['error']} [interrupted]\n" in err
    assert "Traceback" not in err


@pytest.mark.parametrize("name, times", [("SIGINT", 1), ("SIGTERM", 20)])
def test_a_batch_system_may_ask_more_than_once(tmp_path, name, times):
    """The first signal ends the run with a checkpoint; no other one disturbs that, until the process is gone."""
    (tmp_path / "tank.toml").write_text(SCENE)
    process = start(tmp_path, "run", "tank.toml", "--backend", "numpy", "--quiet", "--checkpoint-every", "0.1")
    awaited((tmp_path / "tank_run" / "report.json").exists, process)
    while times > 0 and process.poll() is None:
        process.send_signal(getattr(signal, name))
        time.sleep(0.01)
        times -= 1
    out, err = ended(process, 60)
    assert (process.returncode, out) == (3, "")
    assert "The run was interrupted after step" in err
    assert "go on with: refsim run --resume tank_run" in err
    assert "[interrupted]" in err
    assert "Traceback" not in err
    report = json.loads((tmp_path / "tank_run" / "report.json").read_text())
    assert (report["reason"], Simulation.resume(tmp_path / "tank_run").steps) == ("interrupted", report["steps"])


@pytest.mark.skipif(not os.path.exists("/proc/self/task"), reason="the system does not list a process's children")
@pytest.mark.parametrize("name", ["SIGTERM", "SIGINT"])
def test_experiments_that_are_asked_to_stop_end_with_their_processes(tmp_path, name):
    """SIGTERM twice, to the command alone; Ctrl-C to a script and its processes, which have begun to import."""
    words = ["-m", "validation", "run", "flows", "--quick", "--jobs", "2", "--only", "cavity", "--figures", "."]
    words = words if name == "SIGTERM" else ["scripts/reproduce.py", "--quick"]
    for package in ("refsim", "validation"):  # results are kept beside them
        (tmp_path / package).symlink_to(ROOT / package)
    (tmp_path / "scripts").mkdir()
    shutil.copy(ROOT / "scripts" / "reproduce.py", tmp_path / "scripts")
    signals = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); import os, sys; "
    process = subprocess.Popen(
        [sys.executable, "-c", signals + "os.execv(sys.executable, [sys.executable, *sys.argv[1:]])", *words],
        cwd=tmp_path, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
    )  # fmt: skip
    children = pathlib.Path(f"/proc/{process.pid}/task/{process.pid}/children")
    awaited(lambda: b"spawn_main" in b"".join(map(command_line, children.read_text().split())), process)
    time.sleep(0.3)
    if name == "SIGINT":
        os.killpg(process.pid, signal.SIGINT)
    else:
        process.send_signal(signal.SIGTERM)
        time.sleep(0.1)
        process.send_signal(signal.SIGTERM)
    _, err = ended(process, 60)
    assert process.returncode == 3, err
    assert "Interrupted: what" in err
    assert "Traceback" not in err
    assert "leaked" not in err


def command_line(pid):
    with contextlib.suppress(OSError):
        return pathlib.Path(f"/proc/{pid}/cmdline").read_bytes()
    return b""


def test_a_closed_terminal_is_ignored_under_nohup():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with handling_signals():
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGTERM)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_signal_that_python_drops_comes_again():
    """In the callback of a weak reference an exception is dropped."""
    met = []

    class Mortal:
        pass

    def gone(_):
        met.append("callback")
        os.kill(os.getpid(), signal.SIGTERM)
        for _ in range(1000):  # in which the handler raises
            pass

    mortal = [Mortal()]
    kept = weakref.ref(mortal[0], gone)

    def let_go():
        mortal.clear()
        for _ in range(100):
            time.sleep(0.05)

    with pytest.raises(KeyboardInterrupt), handling_signals():
        let_go()
    assert met == ["callback"]
    assert kept() is None
