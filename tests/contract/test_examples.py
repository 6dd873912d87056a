"""The whole files of docs/contract: a C library, Warp and Taichi under the contract, and test vectors read in C."""

import importlib.util
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys

import msgspec
import numpy as np
import pytest

from refsim import contract
from refsim.__main__ import main
from refsim.contract.export import Vectors
from refsim.contract.features import extended

FOLDER = pathlib.Path(__file__).parents[2] / "docs" / "contract"
OPERATIONS = ["sph.density", "sph.momentum", "becker_teschner_2007.cohesion"]
QUICK = ("--dtype", "float32", "--step", "T1", "--step", "T2", "--step", "T4", "--step", "T7", "--step", "T9")


@pytest.fixture
def compiler():
    found = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if found is None:
        pytest.skip("no C compiler (cc, gcc or clang) is on the path")
    return found


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A copy of the page's files, in which the command stands."""
    for path in FOLDER.iterdir():
        if path.is_file():
            shutil.copy(path, tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    return tmp_path


def compiled(folder, compiler):
    for dtype, real in (("float32", "float"), ("float64", "double")):
        command = [compiler, "-O2", "-shared", "-fPIC", f"-DREAL={real}", "sph.c", "-o", f"sph_{dtype}.so", "-lm"]
        assert " ".join(command[1:]) in re.sub(" +", " ", (folder / "c_library.py").read_text())
        subprocess.run(command, check=True, cwd=folder)


def judged(capsys, *arguments):
    """(exit code, operations of the report) of `refsim contract`."""
    code = main(["contract", *arguments, "--json"])
    return code, json.loads(capsys.readouterr().out)["operations"]


def holds(code, operations):
    assert list(operations) == OPERATIONS
    failed = [o for operation in operations.values() for o in operation["outcomes"] if not o["passed"]]
    assert code == 0, failed
    assert all(o["not_judged"] for o in failed)
    assert {o["not_judged"] for o in failed} >= {"with number_density", "with walls"}
    assert all(operation["trials"] > 20 for operation in operations.values())


def test_the_c_library_holds(folder, compiler, capsys):
    compiled(folder, compiler)
    holds(*judged(capsys, "c_library.py", *QUICK))


@pytest.mark.parametrize("name", ["warp", "taichi"])
def test_the_other_frameworks_hold(name, folder, capsys):
    if importlib.util.find_spec(name) is None:
        pytest.skip(f"{name} is not installed")
    holds(*judged(capsys, f"{name}_backend.py", *QUICK))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["c_library", "warp_backend", "taichi_backend"])
def test_the_examples_hold_in_all_steps(name, folder, compiler, capsys):
    package = name.removesuffix("_backend")
    if package != name and importlib.util.find_spec(package) is None:
        pytest.skip(f"{package} is not installed")
    compiled(folder, compiler)
    holds(*judged(capsys, f"{name}.py"))


def test_a_slip_is_found_where_masses_differ(folder, compiler, capsys):
    text = (folder / "sph.c").read_text()
    assert text.count("sum[c] -= mass[j] * s * d[c]") == 1
    (folder / "sph.c").write_text(text.replace("sum[c] -= mass[j] * s", "sum[c] -= mass[i] * s"))
    compiled(folder, compiler)
    arguments = ("c_library.py", OPERATIONS[2], "--dtype", "float64", "--step", "T1", "--step", "T2")
    code, operations = judged(capsys, *arguments)
    assert code == 4
    passed = {o["trial"]: o["passed"] for o in operations[OPERATIONS[2]]["outcomes"]}
    assert not passed["cloud_3d"]
    assert passed["lattice_3d"]  # of equal masses: the error does not show


# Arrays of other libraries


class OfDlpack:
    """An array of another library, by the protocol alone."""

    def __init__(self, values):
        self.values = values

    def __dlpack__(self, **options):
        return self.values.__dlpack__(**options)

    def __dlpack_device__(self):
        return self.values.__dlpack_device__()


def test_arrays_of_other_libraries_are_given_and_taken():
    given = []

    def gravity(field, acceleration):
        given.extend((type(field), type(acceleration)))
        return OfDlpack(np.broadcast_to(np.from_dlpack(field), np.from_dlpack(acceleration).shape).copy())

    programs = contract.Programs({"sph.gravity": gravity}, dtypes=("float64",), convert=OfDlpack)
    assert all(o.passed for o in contract.trials(programs, "sph.gravity", steps=("T1", "T2")))
    assert set(given) == {OfDlpack}
    assert contract.to_numpy([1.0]) is None


def test_arrays_in_groups_are_converted():
    def density(position, neighbours, walls, smoothing, density):
        kinds.update(map(type, (position, *neighbours, walls.position, density)))
        assert isinstance(smoothing.support_radius, np.float64)
        density.values[:] = 0

    kinds = set()
    programs = contract.Programs({"sph.density": density}, dtypes=("float64",), convert=OfDlpack)
    outcomes = list(contract.trials(programs, "sph.density", variants=(1,), steps=("T1",)))
    assert kinds == {OfDlpack}
    assert all(o.words == "your program does not write number_density, asymmetry" for o in outcomes)


ON_DEVICE = """
import numpy as np
from numba import cuda
from refsim import contract

def written(field, acceleration):
    acceleration.copy_to_device(acceleration.copy_to_host() + field.copy_to_host())

def returned(field, acceleration):
    return cuda.to_device(np.broadcast_to(field.copy_to_host(), acceleration.shape).copy())

def wrong(field, acceleration):
    return cuda.to_device(np.zeros((len(acceleration), 3), np.float32))

for program in (written, returned, wrong):
    mine = contract.Programs({"sph.gravity": program}, arrays="cuda", dtypes=("float32",))
    print(all(o.passed for o in contract.trials(mine, "sph.gravity", steps=("T1", "T7"))))
"""


def test_arrays_on_a_device_are_written_and_returned():
    """Under Numba's simulator, whose arrays have the interface of those on a GPU."""
    environment = dict(os.environ, NUMBA_ENABLE_CUDASIM="1", NUMBA_DISABLE_JIT="1")
    done = subprocess.run([sys.executable, "-c", ON_DEVICE], capture_output=True, text=True, env=environment)
    assert done.stdout.split() == ["True", "True", "False"], done.stderr


# Test vectors


@pytest.fixture
def vectors(tmp_path, capsys):
    """(folder of vectors, their index) of two operations."""
    made = tmp_path / "vectors"
    assert main(["contract", "--export", str(made), "sph.density", "mpm.count", "surface_detection.near_surface"]) == 0
    said = capsys.readouterr().out
    assert "Not exported, as they take objects of refsim: mpm.count." in said
    return made, msgspec.json.decode((made / "vectors.json").read_bytes(), type=Vectors)


def test_vectors_say_what_they_hold(vectors):
    made, index = vectors
    assert list(index.not_exported) == ["mpm.count"]
    density, near = index.operations
    assert {a.name: a.unit for a in density.arguments}["mass"] == "kg (kg/m in 2D)"
    assert len(density.files) == 2 * len(extended("sph.density").variants)
    assert {case.name for case in density.files[0].cases} >= {"cloud_2d_cubic_spline", "dense_cluster", "far_away_2d"}
    assert near.exact == ["near_surface"]
    for operation in index.operations:
        for file in operation.files:
            with np.load(made / file.file) as arrays:
                assert {name.partition("/")[0] for name in arrays} == {case.name for case in file.cases}
                for case in file.cases:
                    written = [o for o in operation.outputs if o not in file.without]
                    for output in written:
                        before = arrays[f"{case.name}/before/{output}"]
                        assert output in operation.adds or np.isnan(before).all() or before.dtype.kind != "f"
                        answer, bound = (arrays[f"{case.name}/{kind}/{output}"] for kind in ("answer", "bound"))
                        assert bound.shape == answer.shape[:1]
                        assert (bound >= 0).all()
                    assert not any(f"{case.name}/{name}" in arrays for name in file.without)
    schema = json.loads((made / "vectors.schema.json").read_text())
    assert schema["$defs"]["VectorCase"]["properties"].keys() == VECTOR_CASE
    assert {case.closed_form for case in density.files[0].cases} == {True, False}


VECTOR_CASE = {"name", "particles", "dim", "spacing", "support_radius", "closed_form"}


def test_vectors_are_read_in_c(vectors, folder, compiler):
    made, _ = vectors
    for name, right in (("right", True), ("wrong", False)):
        text = (folder / "density_vectors.c").read_text()
        slip = text if right else text.replace("mass[j] * pow", "1.000001 * mass[j] * pow")
        (folder / f"{name}.c").write_text(slip)
        subprocess.run([compiler, "-O2", "-Wall", "-Werror", f"{name}.c", "-o", name, "-lm"], check=True, cwd=folder)
        for dtype in ("float32", "float64"):
            file = str(made / "sph.density" / f"variant_0_{dtype}.npz")
            for case in ("cloud_3d", "far_away", "two_particles_in_the_plane"):
                done = subprocess.run([folder / name, file, case], capture_output=True, text=True)
                assert done.returncode == (0 if right or dtype == "float32" else 1), done.stdout
                assert case in done.stdout
    assert subprocess.run([folder / "right", file, "nowhere"], capture_output=True).returncode == 2


def test_vectors_are_read_in_cpp_and_by_ctest(vectors, folder, compiler):
    made, _ = vectors
    if shutil.which("g++"):
        source = (folder / "density_vectors.c").read_text()
        (folder / "density_vectors.cpp").write_text(source)
        subprocess.run(["g++", "-Wall", "-Werror", "density_vectors.cpp", "-o", "in_cpp"], check=True, cwd=folder)
        file = str(made / "sph.density" / "variant_0_float64.npz")
        assert subprocess.run([folder / "in_cpp", file, "cloud_3d"], capture_output=True).returncode == 0
    if shutil.which("cmake") is None or shutil.which("ctest") is None:
        pytest.skip("cmake is not on the path")
    for command in (
        ["cmake", "-S", ".", "-B", "build", f"-DVECTORS={made}"], ["cmake", "--build", "build"],
        ["ctest", "--test-dir", "build"],
    ):  # fmt: skip
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
    assert "100% tests passed" in done.stdout


def test_vectors_are_not_mixed_with_other_files(tmp_path, capsys):
    (tmp_path / "mine.txt").write_text("mine")
    assert main(["contract", "--export", str(tmp_path), "sph.density"]) == 2
    assert "the folder holds files; give a new one." in capsys.readouterr().err
    assert main(["contract", "--export", str(tmp_path / "new"), "sph.densty"]) == 2
    assert not (tmp_path / "new").exists()


# The page's own files

PAGE = FOLDER.parent / "contract.md"
FILES = dict(re.findall(r"^```\w+\n# file: (\S+)\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL))


def test_the_pages_density_holds_as_it_is_declared(folder, capsys):
    (folder / "mine.py").write_text(FILES["mine.py"])
    steps = ("--step", "T2", "--step", "T5", "--step", "T7", "--step", "T9")
    assert main(["contract", "mine.py", *steps]) == 0
    out = capsys.readouterr().out
    shown = re.search(r"^```text\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL).group(1)
    told = next(line for line in shown.splitlines() if line.startswith("Not judged")).replace("(3)", "(#)")
    assert re.sub(r"\(\d+\)", "(#)", told).split(": ")[1].split(" (#)")[0] in out
    (row,) = (line.split() for line in out.splitlines() if line.startswith("sph.density"))
    for count in row[1:-2]:
        assert count in next(line for line in shown.splitlines() if line.startswith("sph.density"))


def test_the_pages_test_file_is_one_of_the_plugin():
    text = FILES["test_mine.py"]
    assert "contract_trial" in text
    compile(text, "test_mine.py", "exec")
