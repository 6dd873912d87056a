"""Whole runs: resumed bit for bit, stopped with a named reason, nothing lost on the way."""

import json
import math
import os

import msgspec
import numpy as np
import pytest

import refsim as rs
from refsim import simulate
from refsim.__main__ import main
from refsim.engine import driver, stepping
from refsim.engine.checkpoints import load_checkpoint
from refsim.engine.conserved_totals import check_particles
from refsim.io.checkpoint import read_checkpoint, whole_checkpoint, write_checkpoint
from refsim.io.results import open_run
from refsim.scene.files import scene_to_toml
from tests.commands.test_stopping import start
from tests.running import advanced, answer_of, awaited


def tank(dtype="float32", step=0.0, literal=(), viscosity=0.05, velocity=(0.0, 0.0, 0.0), **changes):
    """A small 2D dam break: walls, gravity, viscosity."""
    return rs.Scene(
        name="tank", spacing=0.01, support_radius=0.02, dim=2, dtype=dtype, end_time=0.05, step=step,
        fluid=(rs.Box(cells=(8, 16, 1), velocity=velocity),),
        effects=(
            rs.WeaklyCompressible(
                sound_speed=20.0, dynamic_viscosity=viscosity, state="tait", literal=literal, density="summation"
            ),
            rs.Gravity(acceleration=(0.0, -9.81, 0.0)),
            rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(0.3, 0.3, 0.0), open_faces=("+y",)),
        ),
        **changes,
    )  # fmt: skip


def load(path):
    with np.load(path) as file:
        return dict(file)


def assert_same_run(first, second):
    """Everything that outlives a step is equal, bit for bit."""
    a, b = first.snapshot(), second.snapshot()
    assert a.arrays.keys() == b.arrays.keys()
    for name, array in a.arrays.items():
        assert array.tobytes() == b.arrays[name].tobytes(), name
    clocks = [json.loads(snapshot.attributes["clock"]) for snapshot in (a, b)]
    for clock in clocks:
        clock["search_log"].pop("list_bytes", None)
    assert clocks[0] == clocks[1]
    assert a.attributes["scene"] == b.attributes["scene"]


# -- resuming what does not fit
def test_another_backend_goes_on_and_says_so(tmp_path):
    advanced(rs.Simulation(tank()), 20).checkpoint(tmp_path / "c.h5")
    resumed = rs.Simulation.resume(tmp_path / "c.h5", backend="numpy")
    assert any("not bit for bit" in note for note in resumed.notes)
    straight = advanced(rs.Simulation(tank()), 30)
    advanced(resumed, 10)
    assert np.abs(resumed.field("position") - straight.field("position")).max() < 1e-5
    resumed.checkpoint(tmp_path / "n.h5")
    back = rs.Simulation.resume(tmp_path / "n.h5", backend="cpu")  # a checkpoint without a list
    advanced(back, 10)
    assert back.search.log.missed_neighbours == 0


def test_a_number_that_is_not_finite_never_replaces_a_checkpoint_and_reasons_are_listed(tmp_path):
    run = rs.Simulation(tank(), "numpy")
    run.checkpoint(tmp_path / "c.h5")
    before = (tmp_path / "c.h5").read_bytes()
    run.previous_length = math.nan
    with pytest.raises(rs.RunStopped, match="beside its fields is not finite") as caught:
        run.checkpoint(tmp_path / "c.h5")
    assert (caught.value.reason, (tmp_path / "c.h5").read_bytes()) == ("non_finite", before)
    with pytest.raises(ValueError, match="not one of the reasons"):
        rs.RunStopped("bored", "x")


def test_other_versions_are_noted(tmp_path):
    rs.Simulation(tank(), "numpy").checkpoint(tmp_path / "c.h5")
    saved = read_checkpoint(tmp_path / "c.h5")
    clock = json.loads(saved.attributes["clock"])
    clock["versions"]["numpy"] = "1.0"
    write_checkpoint(tmp_path / "c.h5", saved.arrays, saved.attributes | {"clock": json.dumps(clock)})
    note = rs.Simulation.resume(tmp_path / "c.h5").notes[-1]
    assert "numpy 1.0 -> " in note


@pytest.mark.parametrize("other, words", [
    (tank("float64"), "dtype = float32 and the scene has float64"),
    (tank(viscosity=0.06), "effects.weakly_compressible.dynamic_viscosity = 0.05"),
    (tank(velocity=(1.0, 0.0, 0.0)), "velocity differs"),
])  # fmt: skip
def test_a_scene_that_is_not_the_checkpoints_is_refused(tmp_path, other, words):
    rs.Simulation(tank(), "numpy").checkpoint(tmp_path / "c.h5")
    with pytest.raises(rs.InputError, match=words):
        rs.Simulation.resume(tmp_path / "c.h5", scene=other)


@pytest.mark.parametrize("counts", [(40, 7), (0,), (0, 3)])
def test_clouds_come_out_of_the_checkpoint(tmp_path, counts):
    """Each with its own particles, none of them too: beside a box in their midst, and a file that is gone."""
    random = np.random.default_rng(5)
    np.save(tmp_path / "points.npy", 2.0 + 0.05 * random.random((5, 3)))
    clouds = [rs.Cloud(position=0.05 * random.random((n, 3)), mass=1e-3 * np.arange(1.0, n + 1)) for n in counts]
    file = rs.Cloud(file=str(tmp_path / "points.npy"), velocity=(1.0, 0.0, 0.0))
    fluid = (*clouds[:1], rs.Box(lower=(1.0, 1.0, 1.0), cells=(3, 3, 3)), *clouds[1:], file)
    liquid = rs.WeaklyCompressible(sound_speed=20.0, density_bound=1e6, density="summation")
    run = rs.Simulation(rs.Scene(spacing=0.01, support_radius=0.02, fluid=fluid, effects=(liquid,)), "numpy")
    run.checkpoint(tmp_path / "c.h5")
    (tmp_path / "points.npy").unlink()
    again = rs.Simulation.resume(tmp_path / "c.h5").plan
    assert [len(part.position) for part in again.scene.fluid if isinstance(part, rs.Cloud)] == [*counts, 5]
    assert again.state.sizes == run.plan.state.sizes
    for name in ("position", "velocity", "mass"):
        assert np.array_equal(getattr(again.state, name), getattr(run.plan.state, name))


LOST = object()
NUMBERS = "numbers are not those of a run of this refsim"
# (what is changed, what it is instead, words of the refusal)
SPOILED = [
    ("scene", "spacing = 0.01", "the scene in"),
    ("clock", LOST, NUMBERS), ("clock", lambda text: text.replace('"steps"', '"strides"'), NUMBERS),
    ("clock", lambda text: text.replace('"numpy"', '"quantum"', 1), NUMBERS),
    ("clock", lambda text: text.replace('"origin": [0.0,', '"origin": [1.0,'), r"relative to \[1\.0, "),
    ("field.velocity", LOST, "its velocity is nothing, and a run of its scene has float32"),
    ("build_position", LOST, "its build_position is nothing"),
    *((name, lambda a: a[:-1], "a run of its scene has") for name in ("field.velocity", "build_position")),
    ("field.mass", lambda a: a.astype("float64"), "a run of its scene has float32"),
]  # fmt: skip


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory):
    """A checkpoint of the tank after three steps."""
    path = tmp_path_factory.mktemp("checkpoint") / "c.h5"
    advanced(rs.Simulation(tank(), "numpy"), 3).checkpoint(path)
    return read_checkpoint(path)


@pytest.mark.parametrize("name, value, words", SPOILED)
def test_a_checkpoint_that_does_not_fit_its_scene_is_refused(tmp_path, checkpoint, name, value, words):
    saved = checkpoint
    given = saved.arrays | saved.attributes
    given[name] = value(given[name]) if callable(value) else value
    given = {key: part for key, part in given.items() if part is not LOST}
    arrays, attributes = (
        {key: given[key] for key in part if key in given} for part in (saved.arrays, saved.attributes)
    )
    write_checkpoint(tmp_path / "c.h5", arrays, attributes)
    with pytest.raises(rs.InputError, match=words) as caught:
        load_checkpoint(tmp_path / "c.h5")
    assert "\n" not in str(caught.value)


# -- runs that are interrupted
class Killed(BaseException):
    """What nothing in refsim catches, as a kill is."""


@pytest.mark.parametrize("stop", [rs.RunStopped("diverged", "It diverged."), MemoryError(), KeyboardInterrupt()])
def test_frames_that_are_held_are_written_when_a_run_stops(tmp_path, monkeypatch, stop):
    monkeypatch.setattr(driver, "HELD_FOR", math.inf)
    written = []
    append = driver.ParticleWriter.append
    monkeypatch.setattr(
        driver.ParticleWriter, "append", lambda writer, frames: (written.append(len(frames)), append(writer, frames))
    )

    def progress(simulation):
        if simulation.steps == 5:
            raise stop

    with pytest.raises((rs.RunStopped, KeyboardInterrupt)):
        simulate(tank(), backend="numpy", output=tmp_path, every=1e-9, progress=progress)
    assert written == [1, 4]  # the first one with the first checkpoint; no frame of the step that stopped
    assert len(open_run(tmp_path)) == 5


@pytest.mark.parametrize(("name", "least"), [("HELD_FOR", 0.0), ("HELD_BYTES", 0)])
def test_frames_are_held_no_longer_than_stated(tmp_path, monkeypatch, name, least):
    monkeypatch.setattr(driver, "HELD_FOR", math.inf)
    monkeypatch.setattr(driver, name, least)
    seen = []

    def progress(simulation):
        if simulation.steps:
            seen.append(len(open_run(tmp_path)))
        if simulation.steps == 4:
            raise Killed

    with pytest.raises(Killed):
        simulate(tank(), backend="numpy", output=tmp_path, every=1e-9, progress=progress)
    assert seen == [1, 2, 3, 4]


def killed_after(steps, scene, out, **options):
    """A run to its end_time on the references that is killed after so many steps."""

    def progress(simulation):
        if simulation.steps == steps:
            raise Killed

    with pytest.raises(Killed):
        simulate(scene, backend="numpy", output=out, progress=progress, **options)


@pytest.mark.parametrize("interval", [0.0, 1e9], ids=["every step", "the first alone"])
@pytest.mark.parametrize("steps", [0, 1, 5])
def test_frames_of_a_killed_run_have_the_times_of_the_uninterrupted_one(tmp_path, steps, interval):
    """Also where the run is killed before its second checkpoint."""
    scene = tank("float64")
    scene = msgspec.structs.replace(scene, end_time=8.5 * rs.Simulation(scene, "numpy").step().length)
    every = scene.end_time / 4.3
    simulate(scene, backend="numpy", output=tmp_path / "whole", every=every)
    out = tmp_path / "killed"
    killed_after(steps, scene, out, every=every, checkpoint_every=interval)
    if steps == 0:  # before the first checkpoint
        with pytest.raises(rs.InputError, match=r"checkpoint\.h5 does not exist"):
            whole_checkpoint(out)
        report = simulate(scene, backend="numpy", output=out, every=every)
        assert report.resumed_at_step is None
    else:
        resumed = rs.Simulation.resume(out)
        assert resumed.steps == (steps - 1 if interval == 0 else 0)
        report = simulate(resumed, output=out, every=every)
        assert report.resumed_at_step is not None
    whole, after = (open_run(folder) for folder in (tmp_path / "whole", out))
    assert [frame.time for frame in after] == [frame.time for frame in whole]
    for a, b in zip(after, whole):
        assert a.position.tobytes() == b.position.tobytes()
    assert_same_run(rs.Simulation.resume(tmp_path / "whole"), rs.Simulation.resume(out))


def test_no_frame_is_lost_where_steps_divide_the_interval(tmp_path):
    """The sum of steps is a rounding short of a frame's time."""
    scene = rs.Scene(
        spacing=0.1, support_radius=0.2, step=5e-3, end_time=9.0, fluid=(rs.Box(cells=(2, 2, 2)),),
        effects=(rs.Gravity(acceleration=(0.0, 0.0, -1e-3)),),
    )  # fmt: skip
    simulate(scene, backend="numpy", output=tmp_path, every=0.1)
    times = [frame.time for frame in open_run(tmp_path)]
    np.testing.assert_allclose(times, np.arange(91) * 0.1, atol=1e-9)


def test_a_running_run_keeps_its_checkpoints(tmp_path, capsys):
    """Neither --overwrite nor --resume touches a folder whose run is still writing."""
    path, out = tmp_path / "tank.toml", tmp_path / "out"
    path.write_text(scene_to_toml(tank()))
    looked = []

    def progress(simulation):
        if simulation.steps == 2:
            before = {file: file.read_bytes() for file in out.rglob("*.*")}
            for command in ([path, "--overwrite"], ["--resume", out]):
                words = ["run", *map(str, command), "--output", str(out), "--backend", "numpy", "--quiet"]
                looked.append(answer_of(capsys, words, 2).err)
            assert {file: file.read_bytes() for file in out.rglob("*.*")} == before

    simulate(tank(), 0.001, backend="numpy", output=out, checkpoint_every=0.0, progress=progress)
    assert len(looked) == 2
    assert all("are being written by another process" in words for words in looked)


def test_a_damaged_checkpoint_is_passed_over_and_the_run_says_so(tmp_path, capsys):
    out = tmp_path / "out"
    killed_after(3, tank(), out, checkpoint_every=0.0)
    newest = out / "checkpoint.h5"
    content = bytearray(newest.read_bytes())
    content[3803] ^= 1
    newest.write_bytes(content)
    for place in (out, newest):
        resumed = rs.Simulation.resume(place)
        assert resumed.source == out / "checkpoint.previous.h5"
        assert "does not match its digest): resumed from" in resumed.notes[-1]
    assert "note: checkpoint" in answer_of(capsys, ["run", "--resume", str(out), "--until", "0.001", "--quiet"]).err
    assert rs.Simulation.resume(out).source == newest


# -- runs that stop
def test_a_diverging_run_stops_with_its_reason(tmp_path, capsys):
    path, out = tmp_path / "bad.toml", tmp_path / "out"
    scene = tank(step=0.0003, viscosity=50.0, literal=("E3",)).with_(weakly_compressible__density_bound=100.0)
    path.write_text(scene_to_toml(scene))
    command = ["run", str(path), "--until", "5", "--output", str(out), "--quiet", "--checkpoint-every", "0"]
    told = answer_of(capsys, [*command, "--json"], 3)
    found = json.loads(told.out)
    report = json.loads((out / "report.json").read_text())
    assert found["reason"] == found["report"]["reason"] == report["reason"] == "diverged"
    assert "Traceback" not in told.err
    saved = read_checkpoint(out / "checkpoint.h5")
    assert all(np.isfinite(array).all() for array in saved.arrays.values() if array.dtype.kind == "f")
    assert json.loads(saved.attributes["clock"])["steps"] <= report["steps"]

    post = json.loads((out / "postmortem.json").read_text())
    assert (post["reason"], post["step"]) == ("diverged", report["steps"])
    assert np.linalg.norm(post["particle"]["velocity"]) > 200
    near = load(out / "postmortem.npz")
    assert near["identity"][0] == post["particle"]["identity"]
    assert len(near["identity"]) == post["neighbourhood"]["particles"]

    words = post["replay"].split()  # the command that replays it does
    assert words[0] == "refsim"
    assert main([*words[1:], "--quiet"]) == 3
    again = json.loads((out / "replay" / "postmortem.json").read_text())
    assert (again["particle"], again["message"]) == (post["particle"], post["message"])
    assert read_checkpoint(out / "checkpoint.h5").attributes == saved.attributes


def spoiled(simulation, name, field, value):
    """The run computes `value` for one particle in the pass `name`."""
    for k, (operation, rare, call) in enumerate(simulation.force_calls):
        if operation == name:

            def spoil(call=call):
                call()
                row = int(np.flatnonzero(simulation.fields["identity"] == 77)[0])
                simulation.fields[field][row] = value

            simulation.force_calls[k] = (operation, rare, spoil)


@pytest.mark.parametrize("spoil, cause", [
    (lambda run: spoiled(run, "sph.state", "pressure", np.nan), "sph.state wrote pressure"),
    (lambda run: run.fields["position"].__setitem__(77, np.inf), "sph.kick_drift wrote position"),
])  # fmt: skip
def test_what_is_not_finite_names_its_particle_and_pass_and_leaves_the_checkpoint(tmp_path, spoil, cause):
    simulation = rs.Simulation(tank(), "numpy")

    def progress(simulation):
        if simulation.steps == 3:
            spoil(simulation)

    with pytest.raises(rs.RunStopped) as caught, np.errstate(all="ignore"):
        simulate(simulation, 1.0, output=tmp_path, progress=progress, checkpoint_every=0.0, every=1.0)
    assert (caught.value.reason, load_checkpoint(tmp_path / "checkpoint.h5").clock.steps) == ("non_finite", 2)
    post = json.loads((tmp_path / "postmortem.json").read_text())
    assert (post["cause"], post["step"], post["particle"]["identity"]) == (cause, 3, 77)
    assert post["last_step_limits"]["acoustic"] > 0
    near = load(tmp_path / "postmortem.npz")
    assert 4 < len(near["identity"]) < 128
    if "pressure" in cause:
        assert (post["bad_particles"], post["particle"]["pressure"], near["identity"][0]) == (1, "nan", 77)


def no_memory():
    raise MemoryError


@pytest.mark.parametrize(
    "backend, reason, spoil",
    [
        ("cpu", "missed_neighbours", lambda patch, run: patch(run.search, "allowed_displacement", 0.02)),  # 40 times
        ("numpy", "step_too_small", lambda patch, run: patch(stepping, "stable_steps", lambda *_: {"force": 1e-12})),
        ("numpy", "out_of_memory", lambda patch, run: patch(run, "step", no_memory)),
    ],
)
def test_a_run_that_cannot_go_on_ends_with_its_reason(tmp_path, monkeypatch, backend, reason, spoil):
    simulation = advanced(rs.Simulation(tank(), backend), 1)
    spoil(monkeypatch.setattr, simulation)
    with pytest.raises(rs.RunStopped) as caught:
        simulate(simulation, 1.0, output=tmp_path)
    assert caught.value.reason == json.loads((tmp_path / "report.json").read_text())["reason"] == reason
    post = tmp_path / "postmortem.json"
    assert post.exists() == (reason != "out_of_memory")
    assert reason != "step_too_small" or json.loads(post.read_text())["cause"] == "greatest acceleration"


@pytest.mark.parametrize("spoil, words", [
    (lambda fields: fields["identity"].__setitem__(3, 4), "1 of 128 particles are missing and 0 have"),
    (lambda fields: fields["mass"].__setitem__(3, 4.0), "1 have another mass"),
])  # fmt: skip
def test_no_particle_is_lost_silently(spoil, words):
    simulation = rs.Simulation(tank(), "numpy")
    check_particles(simulation)
    spoil(simulation.fields)
    with pytest.raises(rs.RunStopped, match=words):
        check_particles(simulation)


def test_a_disk_that_refuses_the_held_frames_leaves_the_reason_and_the_post_mortem(tmp_path, monkeypatch):
    simulation = rs.Simulation(tank(), "numpy")

    def full(writer, frames):
        raise rs.RunStopped("disk_full", "frames were not written because the disk is full")

    def progress(simulation):
        if simulation.steps == 3:
            monkeypatch.setattr(driver.ParticleWriter, "append", full)
            spoiled(simulation, "sph.state", "pressure", np.nan)

    with pytest.raises(rs.RunStopped) as caught, np.errstate(invalid="ignore"):
        simulate(simulation, 1.0, output=tmp_path, progress=progress, every=1e-9)
    assert caught.value.reason == "non_finite"
    assert json.loads((tmp_path / "postmortem.json").read_text())["cause"] == "sph.state wrote pressure"
    assert json.loads((tmp_path / "report.json").read_text())["reason"] == "non_finite"
    assert whole_checkpoint(tmp_path)[0] == tmp_path / "checkpoint.h5"


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_a_killed_run_loses_at_most_the_interval(tmp_path):
    """SIGKILL in the middle; the resumed run ends bit for bit where one that was never killed ends."""
    out, report = tmp_path / "tank_run", tmp_path / "tank_run" / "report.json"
    (tmp_path / "tank.toml").write_text(scene_to_toml(tank()))
    process = start(tmp_path, "run", "tank.toml", "--until", "100", "--quiet", "--checkpoint-every", "0")
    awaited(lambda: report.exists() and json.loads(report.read_text())["steps"] >= 20, process)
    process.kill()
    process.communicate()
    known = json.loads(report.read_text())["steps"]
    resumed = rs.Simulation.resume(out)
    assert resumed.steps >= known
    end = resumed.time + 0.005
    assert main(["run", "--resume", str(out), "--until", repr(end), "--quiet"]) == 0
    final = rs.Simulation.resume(out)
    whole = advanced(rs.Simulation(tank()), final.steps)
    whole.evaluate(on_demand=False)  # as before each checkpoint, which looks at the list and so decides on a rebuild
    assert_same_run(whole, final)
    times = [frame.time for frame in open_run(out)]
    assert times == sorted(set(times))
