"""Particle files come back bit for bit, ParaView's own readers open them, and kills and full disks cost no frame."""

import dataclasses
import errno
import itertools
import os
import random
import types
from contextlib import suppress

import h5py
import numpy as np
import pytest
import vtk
from vtk.util.numpy_support import vtk_to_numpy

from refsim.core.errors import InputError, RunStopped
from refsim.io import transactions, vtkhdf
from refsim.io.frames import Frame, ParticleWriter, read_particles
from refsim.io.vtp import write_vtp

posix = pytest.mark.skipif(os.name != "posix", reason="signals and file size limits of POSIX")

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
    assert found.fields.keys() == fields.keys()
    for left, right in [(found.position, position), *((found.fields[name], fields[name]) for name in fields)]:
        assert (left.dtype, left.shape) == (right.dtype, right.shape)
        assert left.tobytes() == right.tobytes()


def write_frames(writer, frames):
    for time, position, fields in frames:
        writer.write(time, position, **fields)


class Messages:
    """What VTK says while this is active; it reports errors through a window, not through exceptions."""

    def __enter__(self):
        self.file = vtk.vtkStringOutputWindow()
        self.before = vtk.vtkOutputWindow.GetInstance()
        vtk.vtkOutputWindow.SetInstance(self.file)
        return self

    def __exit__(self, *_):
        vtk.vtkOutputWindow.SetInstance(self.before)

    @property
    def text(self):
        return self.file.GetOutput()


def arrays_of(data):
    points = vtk_to_numpy(data.GetPoints().GetData())
    table = data.GetPointData()
    names = [table.GetArrayName(i) for i in range(table.GetNumberOfArrays())]
    return points, {name: vtk_to_numpy(table.GetArray(name)) for name in names}


def assert_vtk(path, frames, seed=0):
    """The real reader finds these frames, in whatever order it is asked."""
    with Messages() as messages:
        reader = vtk.vtkHDFReader()
        reader.SetFileName(str(path))
        reader.UpdateInformation()
        key = vtk.vtkStreamingDemandDrivenPipeline.TIME_STEPS()
        if len(frames) > 1:
            assert reader.GetOutputInformation(0).Get(key) == tuple(time for time, _, _ in frames)
        order = list(range(len(frames)))
        random.Random(seed).shuffle(order)
        for step in order:
            time, position, fields = frames[step]
            reader.UpdateTimeStep(time)
            data = reader.GetOutput()
            assert isinstance(data, vtk.vtkPolyData)
            n = len(position)
            assert data.GetNumberOfPoints() == data.GetNumberOfVerts() == data.GetNumberOfCells() == n
            if n == 0:
                continue
            points, found = arrays_of(data)
            assert points.dtype == position.dtype
            assert np.array_equal(points, position)
            assert found.keys() == fields.keys()
            for name, array in fields.items():
                assert found[name].dtype == array.dtype, name
                assert np.array_equal(found[name], array), name
            verts = data.GetVerts()
            assert vtk_to_numpy(verts.GetConnectivityArray()).tolist() == list(range(n))
            assert vtk_to_numpy(verts.GetOffsetsArray()).tolist() == list(range(n + 1))
    assert messages.text == ""


def assert_file(path, frames):
    """Both readers find these frames."""
    for found, expected in zip(read_particles(path), frames, strict=True):
        assert_frame(found, expected)
    assert_vtk(path, frames)


# -- what is written is what is read
@pytest.mark.parametrize("counts", [[50], [50] * 6, [30, 60, 1, 0, 0, 45, 60], [0, 5, 3], [7, 0], [200, 199, 300]])
def test_every_frame_comes_back_bit_for_bit(tmp_path, monkeypatch, counts):
    monkeypatch.setattr(vtkhdf, "CHUNK_ROWS", 64)  # less than a frame has
    path = tmp_path / "run.vtkhdf"
    frames = [frame(step, n) for step, n in enumerate(counts)]
    with ParticleWriter(path, FIELDS) as writer:
        assert writer.last_time is None
        for number, (time, position, fields) in enumerate(frames):
            writer.write(time, position, **fields)
            assert writer.last_time == time
            assert len(read_particles(path)) == number + 1  # whole while the writer is at work
            assert_vtk(path, frames[: number + 1], seed=number)
    assert [file.name for file in tmp_path.iterdir()] == ["run.vtkhdf"]
    for found, expected in zip(read_particles(path), frames, strict=True):
        assert_frame(found, expected)
    assert_frame(read_particles(path, slice(-1, None))[0], frames[-1])


@pytest.mark.parametrize("counts", [[50] * 6, [0, 1, 60, 30, 0, 45]])
def test_frames_that_are_appended_at_once_come_back_as_those_written_one_by_one(tmp_path, counts):
    frames = [frame(step, n) for step, n in enumerate(counts)]
    for name, groups in {"single": range(7), "several": (0, 3, 4, 6), "all": (0, 6)}.items():
        path = tmp_path / f"{name}.vtkhdf"
        with ParticleWriter(path, FIELDS) as writer:
            for first, end in itertools.pairwise(groups):
                writer.append([Frame(*one) for one in frames[first:end]])
                assert (writer.last_time, len(read_particles(path))) == (frames[end - 1][0], end)
            writer.append([])
        assert_file(path, frames)


def test_frames_that_do_not_fit_are_refused_whole(tmp_path):
    path = tmp_path / "run.vtkhdf"
    first, second = (Frame(*frame(step)) for step in range(2))
    with ParticleWriter(path, FIELDS) as writer:
        for bad in ([first, first], [second, first], [first, dataclasses.replace(second, fields={})],
                    [first, dataclasses.replace(second, position=second.position.astype("float64"))]):  # fmt: skip
            with pytest.raises(ValueError, match=r"time|fields|position"):
                writer.append(bad)
        assert not path.exists()
        writer.append([first, second])
    assert len(read_particles(path)) == 2


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("n", [0, 1, 37])
def test_single_frame_through_the_real_reader(tmp_path, dtype, n):
    path = tmp_path / "frame.vtp"
    _, position, fields = frame(3, n)
    position = position.astype(dtype)
    write_vtp(path, position, inside=position[:, 0] > 0, **{"a<b & c": position[:, 0]}, **fields)
    with Messages() as messages:
        reader = vtk.vtkXMLPolyDataReader()
        reader.SetFileName(str(path))
        reader.Update()
        data = reader.GetOutput()
    assert messages.text == ""
    assert data.GetNumberOfPoints() == data.GetNumberOfVerts() == n
    if n:
        points, found = arrays_of(data)
        assert points.dtype == dtype
        assert np.array_equal(points, position)
        expected = fields | {"inside": (position[:, 0] > 0).view(np.uint8), "a<b & c": position[:, 0]}
        assert found.keys() == expected.keys()
        for name, array in expected.items():
            assert found[name].dtype == array.dtype, name
            assert np.array_equal(found[name], array), name
        assert vtk_to_numpy(data.GetVerts().GetConnectivityArray()).tolist() == list(range(n))
        assert vtk_to_numpy(data.GetVerts().GetOffsetsArray()).tolist() == list(range(n + 1))


# -- going on after a resume
@pytest.mark.parametrize("counts", [[20] * 8, [5, 0, 30, 2, 0, 40, 1, 9]])
@pytest.mark.parametrize("resume_time", [None, -1.0, 0.25, 9.0])
def test_append_drops_later_frames(tmp_path, resume_time, counts):
    path = tmp_path / "run.vtkhdf"
    old = [frame(step, n) for step, n in enumerate(counts)]
    with ParticleWriter(path, FIELDS) as writer:
        write_frames(writer, old)
    kept = [one for one in old if resume_time is None or one[0] <= resume_time]
    new = [frame(step + 100, n) for step, n in enumerate(counts[::-1])]
    with ParticleWriter(path, FIELDS, append=True, resume_time=resume_time) as writer:
        assert (writer.last_time, len(read_particles(path))) == ((kept[-1][0] if kept else None), len(kept))
        write_frames(writer, new)
    assert_file(path, kept + new)


def test_append_refuses_what_does_not_fit(tmp_path):
    path = tmp_path / "run.vtkhdf"
    with ParticleWriter(path, FIELDS) as writer:
        write_frames(writer, [frame(0)])
    before = path.read_bytes()
    for fields in ({}, FIELDS | {"density": (1, "float64")}, FIELDS | {"velocity": (2, "float32")}):
        with pytest.raises(InputError, match=r"velocity \(3 x float32\)"):
            ParticleWriter(path, fields, append=True)
    assert ([file.name for file in tmp_path.iterdir()], path.read_bytes()) == (["run.vtkhdf"], before)
    for content, words in [
        (before[:-10], "cut short"),
        (b"time = 3", "not a particle file"),
        (before[4096:], "without the digest"),  # as they were written before there was one
    ]:
        path.write_bytes(content)
        for use in (lambda: ParticleWriter(path, FIELDS, append=True), lambda: read_particles(path)):
            with pytest.raises(InputError, match=words):
                use()
        assert path.read_bytes() == content


# -- bad input
def test_frames_that_do_not_fit_are_refused_and_leave_the_file_alone(tmp_path):
    path = tmp_path / "run.vtkhdf"
    _, position, fields = frame(1)
    with ParticleWriter(path, FIELDS) as writer:
        write_frames(writer, [frame(0)])
        before = path.read_bytes()
        for time, place, extra, words in [
            (0.0, position, {}, "not later"),
            (float("nan"), position, {}, "not later"),
            (1.0, position[:, :2], {}, "position"),
            (1.0, position.astype(int), {}, "position"),
            (1.0, position.astype(np.float64), {}, "float32 as in the first frame"),
            (1.0, position, {"density": fields["density"][:-1]}, "'density'"),
            (1.0, position, {"density": fields["density"].astype(np.float64)}, "'density'"),
            (1.0, position, {"velocity": fields["density"]}, "'velocity'"),
            (1.0, position, {"heat": fields["density"]}, "heat"),
        ]:
            with pytest.raises(ValueError, match=words):
                writer.write(time, place, **(fields | extra))
        assert path.read_bytes() == before
        write_frames(writer, [frame(1)])
    with pytest.raises(ValueError, match="closed"):
        writer.write(2.0, position, **fields)
    writer.close()
    assert len(read_particles(path)) == 2


def test_declarations_and_paths_that_cannot_be(tmp_path):
    for fields in ({"a": (0, "float32")}, {"a/b": (1, "float32")}, {"a": (1, "float16")}, {"": (1, "int32")}):
        with pytest.raises(ValueError, match="cannot be written"):
            ParticleWriter(tmp_path / "run.vtkhdf", fields)
    with pytest.raises(InputError, match="folder that exists"):
        ParticleWriter(tmp_path / "no" / "run.vtkhdf", {})
    with pytest.raises(InputError, match="folder that exists"):
        write_vtp(tmp_path / "no" / "run.vtp", np.zeros((1, 3)))
    with pytest.raises(ValueError, match="'a'"):
        write_vtp(tmp_path / "run.vtp", np.zeros((2, 3)), a=np.zeros(3))
    assert not list(tmp_path.iterdir())


def test_a_path_without_a_file_is_told(tmp_path):
    for path, words in ((tmp_path / "run.vtkhdf", "does not exist"), (tmp_path, "cannot be read")):
        with pytest.raises(InputError, match=words):
            read_particles(path)


def refused(path, monkeypatch):
    """The sentence that refuses a damaged file, to read and to append, before HDF5 sees it or it changes."""
    files = {one: one.read_bytes() for one in path.parent.iterdir()}
    with monkeypatch.context() as patch:
        patch.setattr(h5py, "File", lambda *_, **__: pytest.fail("HDF5 was given a damaged file"))
        with pytest.raises(InputError) as one:
            read_particles(path)
        with pytest.raises(InputError) as two:
            ParticleWriter(path, FIELDS, append=True, resume_time=0.1)
    assert (str(one.value), {one: one.read_bytes() for one in path.parent.iterdir()}) == (str(two.value), files)
    return str(one.value)


def test_damage_anywhere_is_told_before_hdf5_sees_it(tmp_path, monkeypatch):
    """A flipped bit in each page, at its ends and at seeded places, zeros over pages, pages exchanged, a file cut."""
    path, rng = tmp_path / "run.vtkhdf", np.random.default_rng(5)
    with ParticleWriter(path, FIELDS) as writer:
        write_frames(writer, [frame(step) for step in range(3)])
    whole = path.read_bytes()
    pages = range(0, len(whole), 4096)
    assert len(pages) == 15
    damaged = []
    places = [place for first in pages for place in (first, min(first + 4096, len(whole)) - 1)]
    for place in [*places, *range(120), *rng.integers(len(whole), size=100)]:
        damaged.append(bytearray(whole))
        damaged[-1][place] ^= 1 << rng.integers(8)
    for first in pages:
        damaged.append(bytearray(whole))
        damaged[-1][first : first + 100] = rng.bytes(len(whole[first : first + 100]))
        damaged.append(bytearray(whole[:first]))
    exchanged = bytearray(whole)
    exchanged[4096:8192], exchanged[8192:12288] = whole[8192:12288], whole[4096:8192]
    for content in [*damaged, exchanged]:
        path.write_bytes(content)
        words = refused(path, monkeypatch)
        assert words.startswith(f"particle file {path} ")
        assert words.endswith(transactions.ADVICE)
        assert "\n" not in words


def test_a_damaged_file_is_not_mended_from_a_journal(tmp_path, monkeypatch):
    """A writer died before its pages were in place, and the file was damaged elsewhere: both files stay as they are."""
    path = tmp_path / "run.vtkhdf"
    writer = ParticleWriter(path, FIELDS)
    write_frames(writer, [frame(0), frame(1)])
    with monkeypatch.context() as patch:
        patch.setattr(transactions, "_apply", lambda *_: (_ for _ in ()).throw(Stop))
        with pytest.raises(Stop):
            write_frames(writer, [frame(2)])
    writer._close_files()
    whole = path.read_bytes()
    changed = bytearray(whole)
    changed[whole.index(frame(0)[1].tobytes())] ^= 1
    path.write_bytes(changed)
    assert "does not match its digest" in refused(path, monkeypatch)
    path.write_bytes(whole)
    assert len(read_particles(path)) == 3


def test_a_reader_leaves_the_journal_of_a_living_writer_alone(tmp_path, monkeypatch):
    path, journal = tmp_path / "run.vtkhdf", tmp_path / "run.vtkhdf.journal"
    writer = ParticleWriter(path, FIELDS)
    write_frames(writer, [frame(0), frame(1)])
    with monkeypatch.context() as patch:
        patch.setattr(transactions, "_apply", lambda *_: (_ for _ in ()).throw(Stop))
        with pytest.raises(Stop):
            write_frames(writer, [frame(2)])
    held = journal.read_bytes()
    assert held
    with suppress(InputError):  # the file is between two states
        read_particles(path)
    assert journal.read_bytes() == held
    writer.close()
    assert len(read_particles(path)) == 3  # completed by the reader, now that the writer has ended
    assert journal.read_bytes() == b""
    assert not journal.with_name("run.vtkhdf.journal.lock").exists()


def test_one_writer_at_a_time(tmp_path):
    path = tmp_path / "run.vtkhdf"
    with ParticleWriter(path, FIELDS) as writer:
        write_frames(writer, [frame(0)])
        with pytest.raises(InputError, match="another process"):
            ParticleWriter(path, FIELDS, append=True)
        write_frames(writer, [frame(1)])
    with ParticleWriter(path, FIELDS, append=True) as writer:
        write_frames(writer, [frame(2)])
    assert len(read_particles(path)) == 3


# -- kills and full disks
class Stop(BaseException):
    """Stands for a kill between two writes."""


@pytest.fixture
def disk(monkeypatch):
    """After `disk.space` further writes it takes half of one and raises `disk.error`."""
    made, real = types.SimpleNamespace(space=10**9, error=Stop()), transactions.write_all

    def counted(file, data):
        made.space -= 1
        if made.space < 0:
            real(file, memoryview(data)[: 0 if len(data) <= transactions.PAGE else len(data) // 2])
            raise made.error
        real(file, data)

    monkeypatch.setattr(transactions, "write_all", counted)
    return made


def test_a_stop_between_any_two_writes(tmp_path, disk):
    """Die before or in the first, second, ... write of an append: always the old frames or the new ones."""
    frames = [frame(step, 100 + step) for step in range(4)]
    outcomes, died, allowed = set(), True, -1
    while died:
        allowed += 1
        path = tmp_path / f"run{allowed}.vtkhdf"
        writer = ParticleWriter(path, FIELDS)
        write_frames(writer, frames[:2])
        disk.space, died = allowed, False
        try:
            write_frames(writer, frames[2:3])
        except Stop:
            died = True
        disk.space = 10**9
        writer._close_files()
        with h5py.File(path) as file:
            steps = file["VTKHDF/Steps"].attrs["NSteps"]
        assert_vtk(path, frames[:steps])  # as it lies there, before anything of ours has looked at it
        if allowed % 2:
            found = len(read_particles(path))
            outcomes.add(found)
            assert_file(path, frames[:found])
        with ParticleWriter(path, FIELDS, append=True, resume_time=0.1) as writer:
            assert writer.last_time == 0.1
            write_frames(writer, frames[3:])
        assert_file(path, [*frames[:2], frames[3]])
    assert allowed > 4
    assert outcomes == {2, 3}


@pytest.mark.parametrize(("number", "name"), [(errno.ENOSPC, "disk_full"), (errno.EIO, "write_failed")])
def test_every_single_write_refused(tmp_path, disk, number, name):
    """The disk refuses the first, second, ... write of an append; the same writer goes on when there is space."""
    disk.error = OSError(number, os.strerror(number))
    frames = [frame(step, 100 + step) for step in range(4)]
    reason, allowed = "", -1
    while reason is not None:
        allowed += 1
        path = tmp_path / f"run{allowed}.vtkhdf"
        with ParticleWriter(path, FIELDS) as writer:
            write_frames(writer, frames[:2])
            before = path.read_bytes()
            disk.space, reason = allowed, None
            try:
                write_frames(writer, frames[2:3])
            except RunStopped as stop:
                reason = stop.reason
            disk.space = 10**9
            assert_file(path, frames[: 3 if reason is None else 2])
            if allowed < 2:  # what lies behind the old end, and the journal
                assert path.read_bytes() == before
            if reason is not None:
                assert reason == name
                write_frames(writer, frames[2:3])
            write_frames(writer, frames[3:])
        assert_file(path, frames)
    assert allowed > 4


def test_vtp_on_a_full_disk(tmp_path, monkeypatch):
    path = tmp_path / "frame.vtp"
    write_vtp(path, np.zeros((5, 3)))
    before = path.read_bytes()

    def refuse(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", refuse)
    with pytest.raises(RunStopped, match="disk is full"):
        write_vtp(path, np.ones((5, 3)))
    assert ([file.name for file in tmp_path.iterdir()], path.read_bytes()) == (["frame.vtp"], before)
