"""Whole files of docs/contract, libraries in C and Fortran by printed declarations, and test vectors read in C++."""

import importlib.util
import json
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
from refsim.backends.arrays import unavailable
from refsim.contract import native
from refsim.contract.export import VectorCase, Vectors, flat
from refsim.contract.inputs import Inputs, arguments_of_others
from refsim.core import cases
from refsim.core.errors import InputError
from refsim.core.operation import REGISTRY
from tests.running import answer_of

FOLDER = pathlib.Path(__file__).parents[2] / "docs" / "contract"
OPERATIONS = ["sph.density", "sph.momentum", "becker_teschner_2007.cohesion"]
LEFT_OUT = ("number_density", "asymmetry", "period", "walls")
STEPS = {"T1", "T2", "T3", "T4", "T5", "T6", "T7", "T9", "T10", "T11"}


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


def holds(name, code, operations):
    assert list(operations) == OPERATIONS[: 2 if name == "warp_backend" else 3]
    failed = [o for operation in operations.values() for o in operation["outcomes"] if not o["passed"]]
    assert code == 0, failed
    assert all(o["not_judged"] for o in failed)
    assert {o["not_judged"] for o in failed} == {f"with {n}" for n in LEFT_OUT}
    for name, operation in operations.items():
        tried = {(o["step"], o["dtype"]) for o in operation["outcomes"] if o["passed"]}
        steps = STEPS if name == "sph.momentum" else STEPS - {"T4"}  # the others promise no conservation
        assert tried == {(step, dtype) for step in steps for dtype in ("float32", "float64")}


@pytest.mark.slow
def test_the_c_library_holds(folder, compiler, capsys):
    compiled(folder, compiler)
    holds("c_library", *judged(capsys, "c_library.py"))


def test_warp_holds(folder, capsys):
    if importlib.util.find_spec("warp") is None:
        pytest.skip("warp is not installed")
    holds("warp_backend", *judged(capsys, "warp_backend.py"))


def test_cuda_c_on_arrays_of_cupy_holds(folder, capsys):
    if importlib.util.find_spec("cupy") is None or unavailable("cuda") is not None:
        pytest.skip("CuPy is not installed, or there is no GPU here")
    code, operations = judged(capsys, "cupy_backend.py")
    failed = [o for operation in operations.values() for o in operation["outcomes"] if not o["passed"]]
    assert {o["not_judged"] for o in failed} == {f"with {n}" for n in LEFT_OUT}, failed
    assert code == 0
    for name, steps in (("sph.density", STEPS - {"T4"}), ("sph.gravity", STEPS - {"T4", "T9", "T10"})):
        tried = {(o["step"], o["dtype"]) for o in operations[name]["outcomes"] if o["passed"]}
        assert tried == {(step, dtype) for step in steps for dtype in ("float32", "float64")}


@pytest.mark.slow
@pytest.mark.parametrize("ranks", [2, 4])
def test_ranks_of_mpi_hold_and_need_their_ghosts(ranks, folder, capsys, monkeypatch):
    if importlib.util.find_spec("mpi4py") is None or shutil.which("mpirun") is None:
        pytest.skip("mpi4py or an MPI is not installed")
    for name in ("ALLOW_RUN_AS_ROOT", "ALLOW_RUN_AS_ROOT_CONFIRM", "MCA_rmaps_base_oversubscribe"):
        monkeypatch.setenv(f"OMPI_{name}", "1")  # up to Open MPI 4
        monkeypatch.setenv(f"PRTE_{name}", "1")
    monkeypatch.setenv("PRTE_MCA_rmaps_default_mapping_policy", ":oversubscribe")
    text = (folder / "mpi_ranks.py").read_text().replace("RANKS = 4", f"RANKS = {ranks}")
    for near, code in (("low - h", 0), ("low", 4)):
        (folder / "own.py").write_text(text.replace("low - h", near))
        found, operations = judged(capsys, "own.py")
        assert found == code, operations


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


def test_the_only_wanted_output_is_returned_as_an_array_also_beside_optional_ones():
    def density(position, mass, smoothing):
        given = {}
        exec(FILES["mine.py"], given)
        answer = np.zeros_like(mass)
        given["density"](position, mass, smoothing, answer)
        return answer

    programs = contract.Programs({"sph.density": density}, dtypes=("float64",), kernels=("wendland_c2",))
    first, *_ = contract.trials(programs, "sph.density", variants=(0,), steps=("T1",))
    assert first.passed, str(first)


# Test vectors
VECTORS = ("sph.density", "mpm.particle_to_grid", "surface_detection.near_surface", "sph.central_viscosity")


@pytest.fixture(scope="module")
def vectors(tmp_path_factory):
    """(folder of vectors, their index) of four operations' plain variants."""
    made = tmp_path_factory.mktemp("of_contract") / "vectors"
    assert main(["contract", "--export", str(made), "--variant", "0", *VECTORS]) == 0
    return made, msgspec.json.decode((made / "vectors.json").read_bytes(), type=Vectors)


def test_vectors_say_what_they_hold(vectors):
    made, index = vectors
    density, to_grid, near, viscosity = index.operations
    assert {a.name: a.unit for a in density.arguments}["mass"] == "kg (kg/m in 2D)"
    assert {a.name: a.kind for a in to_grid.arguments}["nodes"] == "int32 (nodes, 3)"
    names = {case.name for case in density.files[0].cases}
    assert names >= {"cloud_2d_cubic_spline", "dense_cluster", "far_away_2d", "few_2d_other_smoothing.support_radius"}
    assert near.exact == ["near_surface"]
    for operation in index.operations:
        assert [(file.variant, file.dtype) for file in operation.files] == [(0, "float32"), (0, "float64")]
        for file in operation.files:
            steps = {case.step for case in file.cases}
            assert steps >= {"T2", "T3", "T5", "T10"}
            assert ("T4" in steps) == (operation is viscosity)
            with np.load(made / file.file) as arrays:
                assert {name.partition("/")[0] for name in arrays} == {case.name for case in file.cases}
                assert all(array.dtype.kind in "fiub" for array in arrays.values())
                for case in file.cases:
                    for output in (o for o in operation.outputs if o not in file.without):
                        before, answer, bound = (
                            arrays[f"{case.name}/{kind}/{output}"] for kind in ("before", "answer", "bound")
                        )
                        assert output in operation.adds or np.isnan(before).all() or before.dtype.kind != "f"
                        assert bound.shape == answer.shape[:1]
                        assert (bound >= 0).all()
                        assert case.step == "T9" or not np.isnan(answer).any()
                    assert not any(f"{case.name}/{name}" in arrays for name in file.without)
    schema = json.loads((made / "vectors.schema.json").read_text())
    assert schema["$defs"]["VectorCase"]["properties"].keys() == set(VectorCase.__struct_fields__)


def test_conservation_is_read_in_cpp(vectors, tmp_path):
    made, _ = vectors
    if shutil.which("g++") is None:
        pytest.skip("g++ is not on the path")
    source = pathlib.Path(__file__).with_name("conserved.cpp")
    command = ["g++", "-std=c++11", "-Wall", "-Wextra", "-Werror", f"-I{made}", source, "-o", "conserved"]
    subprocess.run(command, cwd=tmp_path, check=True)
    for dtype in ("float32", "float64"):
        file = made / f"sph.central_viscosity/variant_0_{dtype}.npz"
        said = subprocess.run([tmp_path / "conserved", file], capture_output=True, text=True, check=True).stdout
        found = [line.split() for line in said.splitlines()]
        assert len(found) == 8, said
        assert {kept for _, kept, *_ in found} == {"linear_momentum", "angular_momentum", "dissipation"}
        assert all(right == "1" for *_, right, _ in found), said
        assert all(wrong == "0" for _, kept, _, wrong in found if kept != "dissipation"), said


def test_every_operation_has_vectors():
    """None of them takes an object of refsim."""
    cases.discover()
    inputs = Inputs(cases.CASES["cloud_3d"](), "float32")
    for operation in REGISTRY.values():
        for name in arguments_of_others(operation, "numpy"):
            assert all(np.asarray(part).dtype.kind in "fiub" for part in flat(name, inputs[name]).values()), name


FLAGS = "-DCMAKE_CXX_FLAGS=-Wall -Wextra -Werror", "-DCMAKE_CXX_FLAGS_RELEASE=-O1"
SLIPS = {"density": ("mass[j] * scale", "mass[i] * scale"), "particle_to_grid": ("place - 0.5", "place")}


@pytest.mark.slow
def test_vectors_are_read_in_cpp_and_by_ctest(vectors, folder):
    made, _ = vectors
    if any(shutil.which(tool) is None for tool in ("g++", "cmake", "ctest")):
        pytest.skip("g++ or cmake is not on the path")

    def tested():
        for command in (
            ["cmake", "-S", ".", "-B", "build", f"-DVECTORS={made}", *FLAGS],
            ["cmake", "--build", "build"],
        ):
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
            assert done.returncode == 0, done.stdout + done.stderr
        done = subprocess.run(["ctest", "--test-dir", "build"], cwd=folder, capture_output=True, text=True)
        return set(re.findall(r"\d - (\S+) \(Failed\)", done.stdout)), done.stdout

    failed, said = tested()
    assert not failed
    assert "100% tests passed, 0 tests failed out of 4" in said
    for name, (right, wrong) in SLIPS.items():
        text = (folder / f"{name}.cpp").read_text()
        assert text.count(right) == 1
        (folder / f"{name}.cpp").write_text(text.replace(right, wrong))
    failed, _ = tested()
    assert len(failed) == 4


# The page's own files
PAGE = FOLDER.parent / "contract.md"
FILES = dict(re.findall(r"^```\w+\n# file: (\S+)\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL))


def test_the_pages_density_holds_as_it_is_declared(folder, capsys):
    (folder / "mine.py").write_text(FILES["mine.py"])
    out = answer_of(capsys, ["contract", "mine.py"]).out
    shown = re.search(r"^```text\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL).group(1)
    told = next(line for line in shown.splitlines() if line.startswith("Not judged")).replace("(3)", "(#)")
    assert re.sub(r"\(\d+\)", "(#)", told).split(": ")[1].split(" (#)")[0] in out
    (row,) = (line.split() for line in out.splitlines() if line.startswith("sph.density"))
    for count in row[1:-2]:
        assert count in next(line for line in shown.splitlines() if line.startswith("sph.density"))


# C and Fortran by printed declarations
HERE = pathlib.Path(__file__).parent


def printed(capsys, language):
    return answer_of(capsys, ["contract", "sph.density", "--header", language]).out


def library_holds(folder, name, variants, **declared):
    made = native.library(
        str(folder / name), ["sph.density"], kernels=("wendland_c2",), most_particles=3000,
        without=("number_density", "asymmetry", "period"), **declared,
    )  # fmt: skip
    found = list(contract.trials(made, "sph.density", (), variants, ("T1", "T2")))
    judged = [o for o in found if not o.not_judged]
    assert len(judged) > 30
    assert not [str(o) for o in judged if not o.passed]


def test_a_c_library_holds_by_its_header(tmp_path, compiler, capsys):
    (tmp_path / "density.h").write_text(printed(capsys, "c"))
    for dtype, real in (("float32", "float"), ("float64", "double")):
        options = ["-O2", "-Wall", "-Werror", "-shared", "-fPIC", f"-I{tmp_path}", f"-DREAL={real}"]
        command = [compiler, *options, HERE / "density.c", "-o", f"c_{dtype}.so", "-lm"]
        subprocess.run(command, check=True, cwd=tmp_path)
    library_holds(tmp_path, "c_{dtype}.so", (0, 6))


def test_a_fortran_library_holds_by_its_module(tmp_path, capsys):
    compiler = shutil.which("gfortran")
    if compiler is None:
        pytest.skip("gfortran is not on the path")
    (tmp_path / "density.f90").write_text(printed(capsys, "fortran") + (HERE / "density.f90").read_text())
    subprocess.run([compiler, "-O2", "-shared", "-fPIC", "density.f90", "-o", "f.so"], check=True, cwd=tmp_path)
    library_holds(tmp_path, "f.so", (0,), dtypes=("float64",), walls=False)


@pytest.mark.parametrize("name", ["sph.momentum", "mpm.particle_to_grid", "sph.kick_drift", "heat.explicit"])
def test_declarations_of_other_operations_compile(name, tmp_path, compiler):
    (tmp_path / "a.c").write_text(native.header(REGISTRY[name]))
    subprocess.run([compiler, "-Wall", "-Werror", "-c", "a.c"], check=True, cwd=tmp_path)
    if shutil.which("gfortran"):
        (tmp_path / "a.f90").write_text(native.module(REGISTRY[name]))
        subprocess.run(["gfortran", "-c", "a.f90"], check=True, cwd=tmp_path)


def test_an_operation_that_is_not_there_is_bad_input():
    with pytest.raises(InputError, match=r"'sph.densty' is not an operation; did you mean sph.density"):
        native.library("a.so", ["sph.densty"])
