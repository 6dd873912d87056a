"""Frames come back bit for bit, ParaView's own reader opens them, and kills and full disks cost no frame."""

import errno
import os
import xml.etree.ElementTree
from contextlib import closing

import numpy as np
import pytest
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkStringOutputWindow
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

from refsim.core.errors import InputError, RunStopped
from refsim.io.frames import Frame, Origin, ParticleWriter, frame_files, read_origin, vtp_bytes
from refsim.io.results import open_run

FIELDS = {
    "density": (1, "float32"), "velocity": (3, "float32"), "energy": (1, np.float64), "phase": (1, np.int32),
    "surface": (1, "uint8"), "pair": (2, "int64"),
}  # fmt: skip


def frame(step, n=50):
    """(time, position, fields) of step `step`, different at every step."""
    rng = np.random.default_rng(step)
    fields = {}
    for name, (components, dtype) in FIELDS.items():
        shape = (n,) if components == 1 else (n, components)
        fields[name] = rng.integers(0, 256, shape).astype(dtype)
        if np.dtype(dtype).kind == "f":
            fields[name] = rng.normal(size=shape).astype(dtype)
    return 0.1 * step, rng.normal(size=(n, 3)).astype(np.float32), fields


def assert_frame(found, expected):
    time, position, fields = expected
    assert found.time == time
    assert found.fields.keys() == {"position", *fields}
    for left, right in [(found.position, position), *((found[name], fields[name]) for name in fields)]:
        assert (left.dtype, left.shape) == (right.dtype, right.shape)
        assert left.tobytes() == right.tobytes()


def write_frames(writer, frames):
    for time, position, fields in frames:
        writer.append([Frame(time, position, fields)])


def assert_vtp(file, position, fields, time=None):
    """VTK's reader, which reports errors through a window, finds this frame."""
    messages, before = vtkStringOutputWindow(), vtkOutputWindow.GetInstance()
    vtkOutputWindow.SetInstance(messages)
    try:
        reader = vtkXMLPolyDataReader()
        reader.SetFileName(str(file))
        reader.Update()
        data, n = reader.GetOutput(), len(position)
    finally:
        vtkOutputWindow.SetInstance(before)
    assert messages.GetOutput() == ""
    assert data.GetNumberOfPoints() == data.GetNumberOfVerts() == data.GetNumberOfCells() == n
    assert time is None or data.GetFieldData().GetArray("TimeValue").GetValue(0) == time
    if n:
        table, verts = data.GetPointData(), data.GetVerts()
        found = {table.GetArrayName(i): vtk_to_numpy(table.GetArray(i)) for i in range(table.GetNumberOfArrays())}
        found |= {"position": vtk_to_numpy(data.GetPoints().GetData())}
        expected = {"position": position, **fields}
        assert found.keys() == expected.keys()
        for name, array in expected.items():
            assert found[name].dtype == array.dtype, name
            assert np.array_equal(found[name], array), name
        assert vtk_to_numpy(verts.GetConnectivityArray()).tolist() == list(range(n))
        assert vtk_to_numpy(verts.GetOffsetsArray()).tolist() == list(range(n + 1))


def assert_files(path, frames):
    """Both readers find these frames, the collection names them, and nothing else lies in their folder."""
    for found, expected in zip(open_run(path), frames, strict=True):
        assert_frame(found, expected)
    entries = xml.etree.ElementTree.parse(path).findall("Collection/DataSet")
    assert [float(entry.attrib["timestep"]) for entry in entries] == [time for time, _, _ in frames]
    for entry, (time, position, fields) in zip(entries, frames):
        assert_vtp(path.parent / entry.attrib["file"], position, fields, time)
    assert sorted(path.with_suffix("").iterdir()) == [*frame_files(path), path.with_suffix("") / "origin.h5"]


# -- what is written is what is read
@pytest.mark.parametrize("counts", [[50], [50] * 6, [30, 60, 1, 0, 0, 45, 60], [0, 5, 3], [7, 0]])
@pytest.mark.parametrize("at_once", [1, 4])
def test_every_frame_comes_back_bit_for_bit(tmp_path, counts, at_once):
    path = tmp_path / "run.pvd"
    frames = [frame(step, n) for step, n in enumerate(counts)]
    with closing(ParticleWriter(path, FIELDS)) as writer:
        assert writer.last_time is None
        for first in range(0, len(frames), at_once):
            some = frames[first : first + at_once]
            writer.append([Frame(*one) for one in some])
            assert writer.last_time == some[-1][0]
            assert_files(path, frames[: first + len(some)])  # whole while the writer is at work
        writer.append([])
    assert sorted(file.name for file in tmp_path.iterdir()) == ["run", "run.pvd"]
    path.unlink()  # nothing is read from the collection
    assert_frame(open_run(path)[-1], frames[-1])


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("n", [0, 1, 37])
def test_single_frame_through_the_real_reader(tmp_path, dtype, n):
    path = tmp_path / "frame.vtp"
    _, position, fields = frame(3, n)
    position = position.astype(dtype)
    fields |= {"a<b & c": position[:, 0]}
    path.write_bytes(vtp_bytes(position, fields))
    assert_vtp(path, position, fields)


# -- going on after a resume
@pytest.mark.parametrize("counts", [[20] * 8, [5, 0, 30, 2, 0, 40, 1, 9]])
@pytest.mark.parametrize("resume_time", [np.inf, -1.0, 0.25, 9.0])
def test_append_drops_later_frames(tmp_path, resume_time, counts):
    path = tmp_path / "run.pvd"
    old = [frame(step, n) for step, n in enumerate(counts)]
    with closing(ParticleWriter(path, FIELDS)) as writer:
        write_frames(writer, old)
    kept = [one for one in old if one[0] <= resume_time]
    new = [frame(step + 100, n) for step, n in enumerate(counts[::-1])]
    with closing(ParticleWriter(path, FIELDS, resume_time=resume_time)) as writer:
        assert writer.last_time == (kept[-1][0] if kept else None)
        write_frames(writer, new)
    assert_files(path, kept + new)


def test_a_new_run_takes_the_place_of_the_old_one_with_its_first_frame(tmp_path, disk):
    path = tmp_path / "run.pvd"
    with closing(ParticleWriter(path, FIELDS)) as writer:
        write_frames(writer, [frame(step) for step in range(3)])
    with closing(ParticleWriter(path, {"a": (1, "int32")})) as writer:
        assert_files(path, [frame(step) for step in range(3)])
        disk.error = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        new = (5.0, np.zeros((2, 3)), {"a": np.arange(2, dtype="int32")})
        for disk.space in range(6):  # the opens, writes and fsyncs of both files
            with pytest.raises(RunStopped, match="disk is full"):
                write_frames(writer, [new])
            assert_files(path, [frame(step) for step in range(3)])
        disk.space = 10**9
        write_frames(writer, [new])
    assert_files(path, [new])


def test_what_made_the_frames_is_said_until_another_origin_replaces_it(tmp_path):
    path = tmp_path / "run.pvd"
    for append, origin, scene in (
        (False, Origin("one"), "one"), (True, None, "one"), (True, Origin("two"), "two"), (False, None, ""),
    ):  # fmt: skip
        with closing(ParticleWriter(path, FIELDS, resume_time=0.0 if append else None, origin=origin)) as writer:
            write_frames(writer, [frame(step) for step in range(int(append), 2)])
        assert read_origin(path).scene == scene


# -- bad input
def test_damage_anywhere_is_told(tmp_path):
    """A flipped bit at the ends of the head and at seeded places, zeros, a file cut."""
    path, rng = tmp_path / "run.pvd", np.random.default_rng(5)
    with closing(ParticleWriter(path, FIELDS)) as writer:
        write_frames(writer, [frame(step) for step in range(3)])
    file = frame_files(path)[1]
    whole = file.read_bytes()
    for place in [*range(160), len(whole) - 1, *rng.integers(len(whole), size=200)]:
        damaged = bytearray(whole)
        damaged[place] ^= 1 << rng.integers(8)
        for content in (damaged, whole[:place], whole[:place] + bytes(len(whole) - place)):
            if content != whole:
                file.write_bytes(content)
                with pytest.raises(InputError, match=rf"^frame {file} .*; move it away, or run the scene again\.$"):
                    _ = open_run(path)[1].position
    assert_frame(open_run(path)[1], frame(1)) if file.write_bytes(whole) else None


def test_one_writer_at_a_time(tmp_path):
    path = tmp_path / "run.pvd"
    with closing(ParticleWriter(path, FIELDS)) as writer:
        write_frames(writer, [frame(0)])
        with pytest.raises(InputError, match="another process"):
            ParticleWriter(path, FIELDS, resume_time=np.inf)
        write_frames(writer, [frame(1)])
    with closing(ParticleWriter(path, FIELDS, resume_time=np.inf)) as writer:
        write_frames(writer, [frame(2)])
    assert len(open_run(path)) == 3


# -- kills and full disks
class Stop(BaseException):
    """Stands for a kill between two calls of the system."""


@pytest.mark.parametrize("error", [Stop(), OSError(errno.ENOSPC, "full"), OSError(errno.EIO, "broken")])
def test_a_stop_between_any_two_calls(tmp_path, disk, error):
    """Each frame is there whole or not at all, none that was reported is lost, and a writer goes on from there."""
    disk.error = error
    frames = [frame(step, 100 + step) for step in range(6)]
    outcomes, died, allowed = set(), True, -1
    while died:
        allowed += 1
        path = tmp_path / f"run{allowed}.pvd"
        writer = ParticleWriter(path, FIELDS)
        write_frames(writer, frames[:2])
        disk.space, died = allowed, False
        try:
            writer.append([Frame(*one) for one in frames[2:4]])
        except (Stop, RunStopped):
            died = True
        disk.space = 10**9
        found = open_run(path)
        outcomes.add(len(found))
        assert len(found) >= (2 if died else 4)
        for one, expected in zip(found, frames):
            assert_frame(one, expected)
        if isinstance(error, OSError):  # the same writer goes on when there is space
            writer.append([Frame(*one) for one in frames[2:5]]) if died else write_frames(writer, frames[4:5])
            assert_files(path, frames[:5])
        writer.close()
        with closing(ParticleWriter(path, FIELDS, resume_time=0.1)) as writer:
            assert writer.last_time == 0.1
            write_frames(writer, frames[5:])
        assert_files(path, [*frames[:2], frames[5]])
    assert allowed > 6
    assert outcomes == {2, 3, 4}
