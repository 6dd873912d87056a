"""Checkpoints come back bit for bit, and no kill, full disk or damage leaves a run without a whole one."""

import errno
import os
import random

import h5py
import numpy as np
import pytest

from refsim.core.errors import InputError, RunStopped
from refsim.core.writing import replace_file
from refsim.io.checkpoint import previous_path, read_checkpoint, whole_checkpoint, write_checkpoint

posix = pytest.mark.skipif(os.name != "posix", reason="pipes and devices")


def state(step, n=1000):
    """Arrays of every dtype in use, all of them different at every step."""
    rng = np.random.default_rng(step)
    return {
        "position": rng.normal(size=(n, 3)).astype(np.float32), "velocity": rng.normal(size=(n, 3)),
        "order": rng.integers(-(2**31), 2**31, n, dtype=np.int32),
        "key": rng.integers(-(2**63), 2**63 - 1, n, dtype=np.int64), "phase": rng.integers(0, 256, n, dtype=np.uint8),
        "surface": rng.random(n) < 0.5,
    }  # fmt: skip


def test_every_dtype_comes_back_bit_for_bit(tmp_path):
    arrays = state(0) | {
        "edge32": np.array([-0.0, 1e-45, np.finfo(np.float32).max], np.float32),
        "edge64": np.array([-0.0, 5e-324, np.finfo(np.float64).max]), "empty": np.empty((0, 3), np.float32),
        "scalar": np.array(0.1), "columns": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        "strided": np.arange(10, dtype=np.int32)[::3],
    }  # fmt: skip
    attributes = {"time": 0.1 + 0.2, "limit": float("inf"), "step": 2**70, "on": True, "scene": "é\n\0='x'" * 20000}
    write_checkpoint(tmp_path / "checkpoint.h5", arrays, attributes)
    back = read_checkpoint(tmp_path / "checkpoint.h5")
    assert back.arrays.keys() == arrays.keys()
    for name, array in arrays.items():
        found = back.arrays[name]
        assert (found.dtype, found.shape, found.tobytes()) == (array.dtype, array.shape, array.tobytes()), name
    assert back.attributes == attributes
    assert {name: type(value) for name, value in back.attributes.items()} == {
        name: type(value) for name, value in attributes.items()
    }


@pytest.mark.parametrize("keep", [1, 2])
def test_keeps_as_many_as_asked(tmp_path, keep):
    path = tmp_path / "checkpoint.h5"
    for step in range(5):
        write_checkpoint(path, state(step), {"step": step}, keep=keep)
    files = [path, previous_path(path)][:keep]
    assert sorted(tmp_path.iterdir()) == sorted(files)
    assert [read_checkpoint(file).attributes["step"] for file in files] == [4, 3][:keep]
    assert whole_checkpoint(tmp_path)[0] == path


def test_rotates_without_hard_links(tmp_path, monkeypatch):
    def no_links(*_):
        raise OSError(errno.EPERM, "no hard links here")

    monkeypatch.setattr(os, "link", no_links)
    test_keeps_as_many_as_asked(tmp_path, 2)


def test_a_whole_checkpoint_lies_there_between_any_two_calls(tmp_path, monkeypatch):
    """Look at the folder before and after every call that changes a name."""
    path = tmp_path / "checkpoint.h5"
    for step in range(3):
        write_checkpoint(path, state(step), {"step": step})
    seen = []

    def watched(name):
        real = getattr(os, name)

        def call(*arguments):
            for _ in range(2):
                seen.append(whole_checkpoint(tmp_path)[1].attributes["step"])
                if len(seen) % 2:
                    real(*arguments)

        monkeypatch.setattr(os, name, call)

    watched("link")
    watched("replace")
    write_checkpoint(path, state(3), {"step": 3})
    assert len(seen) >= 6
    assert (seen, set(seen)) == (sorted(seen), {2, 3})


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.complex128])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_non_finite_values_never_replace_a_good_checkpoint(tmp_path, dtype, value):
    path = tmp_path / "checkpoint.h5"
    write_checkpoint(path, state(0), {"step": 0})
    before = path.read_bytes()
    bad = np.zeros((5, 3), dtype)
    bad[3, 1] = value
    with pytest.raises(RunStopped, match=r"'force'.*1 non-finite.*\(3, 1\)") as caught:
        write_checkpoint(path, state(1) | {"force": bad}, {"step": 1})
    assert (caught.value.reason, caught.value.exit_code) == ("non_finite", 3)
    assert ([file.name for file in tmp_path.iterdir()], path.read_bytes()) == (["checkpoint.h5"], before)


# -- files that are not whole checkpoints
def refuse(path, words):
    with pytest.raises(InputError, match=words) as caught:
        read_checkpoint(path)
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    return message


def test_files_that_are_no_checkpoints(tmp_path):
    path = tmp_path / "checkpoint.h5"
    refuse(path, "does not exist")
    refuse(tmp_path, "cannot be read")
    path.write_bytes(b"")
    refuse(path, "does not begin as one")
    path.write_text("time = 3")
    refuse(path, "does not begin as one")
    with h5py.File(path, "w") as file:
        file["x"] = 1
    refuse(path, "does not begin as one")
    write_checkpoint(path, state(0), {}, what="file of gauges")
    refuse(path, "does not begin as one")
    assert read_checkpoint(path, "file of gauges").attributes == {}
    write_checkpoint(path, state(0), {})
    path.write_bytes(path.read_bytes().replace(b"\nversion 4\n", b"\nversion 3\n", 1))
    refuse(path, "format version 3, and this refsim reads version 4")


@posix
@pytest.mark.parametrize("make", [os.mkfifo, lambda path: path.symlink_to("/dev/zero")], ids=["pipe", "device"])
def test_what_never_ends_is_refused(tmp_path, make):
    make(tmp_path / "checkpoint.h5")
    refuse(tmp_path / "checkpoint.h5", "is a pipe or a device")
    with pytest.raises(InputError, match="is a pipe or a device"):
        whole_checkpoint(tmp_path)


def test_hdf5_never_sees_a_damaged_file(tmp_path, monkeypatch):
    """HDF5 reads some damaged files without end: one flipped bit, or an end, at any byte is noticed before."""
    path = tmp_path / "checkpoint.h5"
    write_checkpoint(path, {"position": np.zeros((4, 3))}, {"step": 0})
    whole = path.read_bytes()
    monkeypatch.setattr(h5py, "File", lambda *_, **__: pytest.fail("HDF5 was given a damaged file"))
    rng = random.Random(1)
    for place in range(len(whole)):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << rng.randrange(8)
        for content in (damaged, whole[:place])[: 1 + (place % 97 == 0)]:
            path.write_bytes(content)
            refuse(path, "damaged|does not begin as one|format version")


def test_the_previous_checkpoint_is_named_when_it_is_whole(tmp_path):
    path = tmp_path / "checkpoint.h5"
    for step in range(2):
        write_checkpoint(path, state(step), {"step": step})
    path.write_bytes(path.read_bytes()[:-1])
    refuse(path, "is cut short")
    assert whole_checkpoint(tmp_path)[0] == previous_path(path)
    for place in (path, tmp_path):
        file, saved, notes = whole_checkpoint(place)
        assert (file, saved.attributes["step"]) == (previous_path(path), 0)
        assert len(notes) == 1
        assert str(path) in notes[0]
        assert f"resumed from {file}" in notes[0]
    assert whole_checkpoint(tmp_path)[1].attributes["step"] == 0

    previous_path(path).write_bytes(b"")
    refuse(path, "start the run again")
    with pytest.raises(InputError, match="start the run again"):
        whole_checkpoint(tmp_path)
    with pytest.raises(InputError, match="does not exist"):
        whole_checkpoint(tmp_path / "nowhere")


# -- kills and full disks
@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EIO])
def test_the_disk_refuses_the_first_and_the_second_and_the_next_call(tmp_path, disk, number):
    """The two checkpoints before are there, or the new one; when there is space the run goes on."""
    disk.error, reason, allowed = OSError(number, os.strerror(number)), "", -1
    while reason is not None:
        allowed += 1
        path = tmp_path / f"run{allowed}.h5"
        for step in range(2):
            write_checkpoint(path, state(step, n=50), {"step": step})
        disk.space, reason = allowed, None
        try:
            write_checkpoint(path, state(2, n=50), {"step": 2})
        except RunStopped as stop:
            reason = stop.reason
        disk.space = 10**9
        there = [read_checkpoint(file).attributes["step"] for file in (path, previous_path(path))]
        assert there in ([1, 0], [2, 1], [2, 0] if reason else [2, 1])
        assert reason in (None, "write_failed" if number == errno.EIO else "disk_full")
        assert sorted(tmp_path.glob(f"*{path.stem}.*")) == [path, previous_path(path)]
        write_checkpoint(path, state(3, n=50), {"step": 3})
        assert read_checkpoint(path).attributes["step"] == 3
    assert allowed > 3
    assert {file.suffix for file in tmp_path.iterdir()} == {".h5"}


def test_what_another_process_still_writes_stays(tmp_path):
    mine, alive, dead = (tmp_path / f".page.html.{number}.tmp" for number in (os.getpid(), os.getppid(), 2**22 + 1))
    for path in (mine, alive, dead):
        path.touch()
    replace_file(tmp_path / "page.html", b"whole")
    assert {path.name for path in tmp_path.iterdir()} == {"page.html", alive.name}
