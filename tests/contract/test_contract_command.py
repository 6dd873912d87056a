"""`refsim contract`: a third party's programs, found, bound, judged and reported; the page's example works."""

import ctypes
import inspect
import json
import pathlib
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest

from refsim import contract
from refsim.__main__ import main
from refsim.core.errors import InputError
from refsim.core.operation import REGISTRY

PAGE = pathlib.Path(__file__).parents[2] / "docs" / "contract.md"
FILE = re.compile(r"^```\w+\n(?:# file: |/\* file: )(\S+)(?: \*/)?\n(.*?)^```$", re.MULTILINE | re.DOTALL)
GRAVITY = "def gravity(field, acceleration):\n    acceleration += field\n"
QUICK = ("--dtype", "float64", "--step", "T1", "--step", "T7")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Where the command stands; what it finds there is forgotten afterwards."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    known = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - known:
        if str(tmp_path) in str(getattr(sys.modules[name], "__file__", "")):
            del sys.modules[name]


def refsim(capsys, *arguments):
    """(exit code, standard output, standard error) of `refsim contract`."""
    code = main(["contract", *arguments])
    said = capsys.readouterr()
    return code, said.out, said.err


# The page's example


def compiled(folder, compiler, change=lambda text: text):
    for name, text in FILE.findall(PAGE.read_text()):
        (folder / name).write_text(change(text) if name.endswith(".c") else text)
    for dtype, real in (("float32", "float"), ("float64", "double")):
        command = [compiler, "-O2", "-shared", "-fPIC", f"-DREAL={real}", "viscosity.c", "-o", f"viscosity_{dtype}.so"]
        subprocess.run([*command, "-lm"], check=True, cwd=folder)
    return "my_library.py"


@pytest.fixture
def compiler():
    found = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if found is None:
        pytest.skip("no C compiler (cc, gcc or clang) is on the path")
    return found


def test_the_pages_c_library_holds(folder, compiler, capsys):
    code, out, _ = refsim(capsys, compiled(folder, compiler))
    assert code == 0, out
    (row,) = (line for line in out.splitlines() if line.startswith("sph.viscosity"))
    assert row.split()[-1] == "holds"
    assert re.search(r"1 of 1 operations hold; (\d+) of \1 trials passed", out)
    assert "sph.viscosity  2/2" in PAGE.read_text()


def test_the_pages_slip_is_found_where_masses_differ(folder, compiler, capsys):
    def slip(text):
        assert text.count("mass[j]") == 1
        return text.replace("mass[j]", "mass[i]")

    arguments = ("--dtype", "float64", "--step", "T2", "--step", "T4", "--json")
    code, out, _ = refsim(capsys, compiled(folder, compiler, slip), *arguments)
    assert code == 4
    found = json.loads(out)["operations"]["sph.viscosity"]
    assert not found["holds"]
    passed = {o["trial"]: o["passed"] for o in found["outcomes"]}
    assert not passed["cloud_3d"]
    assert not passed["linear_momentum in cloud_3d"]
    assert passed["lattice_3d"]  # of equal masses: the error does not show
    assert "mass[i]" in PAGE.read_text().partition("```c\n")[2].partition("```\n\n")[2]


# Where programs may be


def test_programs_are_found_by_file_module_name_and_entry_point(folder):
    (folder / "someones_backend.py").write_text(GRAVITY + "FAST = {'sph.gravity': gravity}\nPROGRAMS = dict(FAST)\n")
    made = folder / "someone-1.0.dist-info"
    made.mkdir()
    (made / "METADATA").write_text("Metadata-Version: 2.1\nName: someone\nVersion: 1.0\n")
    (made / "entry_points.txt").write_text("[refsim.contract]\nsomeone = someones_backend:FAST\n")
    sys.path.insert(0, str(folder))
    for source in ("someones_backend.py", "someones_backend.py:FAST", "someones_backend", "someones_backend:FAST"):
        assert contract.load(source).operations() == ("sph.gravity",), source
    found = contract.load("someone")
    assert found.name == "someone"
    assert all(o.passed for o in contract.trials(found, "sph.gravity", ("float64",), steps=("T1",)))


def test_refsims_own_programs_come_through_the_same_door():
    through = list(contract.trials(contract.load("cpu"), "sph.gravity", ("float32",), steps=("T1", "T2")))
    target = contract.Target(REGISTRY["sph.gravity"], "cpu", "float32")
    assert through == contract.climb(target, ("T1", "T2"))
    assert len(through) > 20


MISTAKES = {
    "no such module": ("nowhere.to.be_found", None, "There is no module 'nowhere.to.be_found'"),
    "no such file": ("nowhere.py", None, "there is no file nowhere.py; give the path of a Python file."),
    "its own import fails": ("own.py", "import a_thing_that_is_not_there", "own.py cannot be imported: ModuleNotFound"),
    "it raises": ("own.py", "1 / 0", "own.py cannot be imported: ZeroDivisionError: division by zero."),
    "syntax": ("own.py", "def", "own.py cannot be imported: SyntaxError"),
    "no programs": ("own.py", "", "own.py has no PROGRAMS; write PROGRAMS = {'sph.density': function} in it."),
    "not a mapping": ("own.py", "PROGRAMS = 3", "own.py is int; give a mapping"),
    "empty": ("own.py", "PROGRAMS = {}", "own.py has no program for any operation"),
    "unknown operation": ("own.py", "PROGRAMS = {'sph.densty': len}", "did you mean sph.density?"),
    "no function": ("own.py", "PROGRAMS = {'sph.density': 3}", "its program for sph.density is 3; give a function."),
    "no such dtype": (
        "own.py",
        "from refsim.contract import Programs\nPROGRAMS = Programs({'sph.gravity': len}, dtypes=('float16',))",
        "there is no dtype 'float16'; choose from float32, float64.",
    ),
    "no such arrays": (
        "own.py",
        "from refsim.contract import Programs\nPROGRAMS = Programs({'sph.gravity': len}, arrays='fpga')",
        "there are no arrays of 'fpga'; take one of cpu, cuda.",
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_gets_one_sentence_and_code_2(name, folder, capsys):
    source, text, said = MISTAKES[name]
    if text is not None:
        (folder / source).write_text(text + "\n")
    code, out, err = refsim(capsys, source)
    assert code == 2
    assert out == ""
    assert said in err
    assert err.startswith("refsim: ")
    assert err.count("\n") == 1


def test_a_missing_operation_is_named(folder, capsys):
    (folder / "own.py").write_text(GRAVITY + "PROGRAMS = {'sph.gravity': gravity}\n")
    code, _, err = refsim(capsys, "own.py", "sph.density")
    assert (code, err) == (2, "refsim: own.py has no program for sph.density; it has programs for sph.gravity.\n")
    code, _, err = refsim(capsys, "own.py", "sph.gravty")
    assert code == 2
    assert "did you mean sph.gravity?" in err


def judged(program, operation="sph.gravity", steps=("T1", "T7"), **options):
    programs = contract.Programs({operation: program}, dtypes=("float64",), name="mine")
    return list(contract.trials(programs, operation, steps=steps, **options))


WRONG = {
    "shape": (lambda field, acceleration: np.zeros(3), "returned acceleration as float64 of shape (3,); wanted is"),
    "dtype": (lambda field, acceleration: np.zeros(acceleration.shape, np.float32), "as float32 of shape"),
    "a list": (lambda acceleration: acceleration.tolist(), "as list; wanted is a NumPy array"),
    "other output": (lambda acceleration: {"velocity": acceleration}, "'velocity', which is no output"),
    "none of them": (lambda acceleration: {}, "did not return acceleration"),
}


class Unsigned:
    """A program whose parameters cannot be read, as those of many compiled functions."""

    __signature__ = "unknown"

    def __call__(self, *values):
        return None


MISFIT = {
    "parameter": (lambda gravity, acceleration: None, "takes gravity, which the operation does not have; it has"),
    "any number": (lambda *values: None, "takes *values, which the operation does not have"),
    "no signature": (Unsigned(), "does not state its parameters"),
}


@pytest.mark.parametrize("name", WRONG)
def test_an_answer_of_a_wrong_form_fails_every_trial(name):
    program, said = WRONG[name]
    found = judged(program)
    assert len(found) >= 2
    for outcome in found:
        assert not outcome.passed
        assert said in outcome.words


@pytest.mark.parametrize("name", MISFIT)
def test_a_parameter_that_the_operation_has_not_is_bad_input(name):
    program, said = MISFIT[name]
    with pytest.raises(InputError, match=re.escape(said)):
        judged(program)


def test_a_misfit_is_told_before_anything_is_judged(folder, capsys):
    (folder / "own.py").write_text(f"{GRAVITY}PROGRAMS = {{'sph.gravity': gravity, 'sph.density': lambda weight: 1}}\n")
    code, out, err = refsim(capsys, "own.py", *QUICK)
    assert (code, out) == (2, "")
    assert "takes weight, which the operation does not have" in err
    assert err.count("\n") == 1


def test_parts_of_the_ladder_that_are_not_there_are_bad_input():
    with pytest.raises(InputError, match="there is no step 'T8'; choose from T1"):
        judged(lambda field: None, steps=("T8",))
    with pytest.raises(InputError, match=r"sph.gravity has no variant 5; it has 0 to 0"):
        judged(lambda field: None, variants=(5,))
    with pytest.raises(InputError, match="mine does not compute in 'float32'; choose from float64"):
        judged(lambda field: None, dtypes=("float32",))


# Judging


def test_programs_may_return_or_write_and_name_what_they_want():
    def written(acceleration, field, unused=3):
        acceleration += field

    def returned(**given):
        return np.broadcast_to(given["field"], given["acceleration"].shape).copy()

    for program in (written, returned):
        found = judged(program, steps=("T1", "T2", "T7"))
        assert len(found) > 20
        assert all(o.passed for o in found), program


def test_several_outputs_are_returned_by_name_in_every_variant():
    def density(position, mass, walls, smoothing, fluid):
        answer = REGISTRY["sph.density"].program("numpy")(position, mass, walls, smoothing, fluid)
        return {name: value for name, (value, _) in answer.items()}

    found = judged(density, "sph.density", ("T1",))
    assert {o.variant for o in found} == {0, 1, 2}
    assert all(o.passed for o in found)
    (first, *_) = judged(lambda mass: mass, "sph.density", ("T1",))
    assert "it returned ndarray; wanted is {name: array} for number_density, asymmetry" in first.words


@pytest.mark.parametrize(
    "program",
    [
        lambda field, acceleration: None,
        lambda field, acceleration: np.full_like(acceleration, np.nan),
        lambda field, acceleration: acceleration.__setitem__(slice(None), field),
    ],
    ids=["nothing", "nan", "assigned"],
)
def test_a_wrong_program_fails(program):
    def quiet(field, acceleration):
        with np.errstate(all="ignore"):
            return program(field, acceleration)

    assert not all(o.passed for o in judged(quiet, steps=("T1", "T2", "T7")))


def test_a_program_that_raises_or_crashes_costs_its_own_operation(folder, capsys):
    (folder / "own.py").write_text(
        "import ctypes\n"
        "def crashing(density):\n    ctypes.string_at(0)\n"
        "def raising(velocity):\n    raise ValueError('too few\\nparticles')\n"
        f"{GRAVITY}"
        "def talking(field, acceleration):\n    print('here I am')\n    gravity(field, acceleration)\n"
        "PROGRAMS = {'sph.state': crashing, 'sph.extremes': raising, 'sph.gravity': talking}\n"
    )
    code, out, _ = refsim(capsys, "own.py", *QUICK, "--json")
    assert code == 4
    found = json.loads(out)  # what the program prints is no part of the report
    operations = found["operations"]
    assert {name: o["holds"] for name, o in operations.items()} == {
        "sph.state": False, "sph.extremes": False, "sph.gravity": True,
    }  # fmt: skip
    (crash,) = operations["sph.state"]["outcomes"]
    assert crash["step"] == "T1"
    assert crash["trial"] != "the rest of the step"  # the case is named
    assert "the program ended its process (signal SIG" in crash["words"]
    assert operations["sph.extremes"]["outcomes"][0]["words"] == "it raised ValueError: too few particles"
    assert len(found["not_offered"]) == len(REGISTRY) - 3


# What a program may not touch


def ended(program):
    """Outcomes of T2 by trial."""
    return {o.trial: o for o in judged(program, steps=("T2",))}


def right_but(action):
    def program(field, acceleration, identity=None, position=None):
        acceleration += field
        action(field, acceleration)

    return program


def beside(offset):
    def write(field, acceleration):
        place = acceleration.ctypes.data + (acceleration.nbytes if offset >= 0 else 0) + offset
        ctypes.c_ubyte.from_address(place).value ^= 1

    return write


DESTROYED = {
    "input": (lambda field, a: field.__setitem__(0, -1), "it changed its input field (row 0 first)"),
    "input to NaN": (lambda field, a: field.fill(np.nan), "it changed its input field (row 0 first)"),
    "sign of zero": (lambda field, a: np.copysign(field, -1, out=field), "it changed its input field"),
    "behind": (beside(0), "it wrote behind the end of acceleration"),
    "far behind": (beside(4000), "it wrote behind the end of acceleration"),
    "before": (beside(-8), "it wrote before the start of acceleration"),
}


@pytest.mark.parametrize("name", DESTROYED)
def test_a_right_answer_that_destroys_something_fails(name):
    action, said = DESTROYED[name]
    found = ended(right_but(action))
    assert len(found) > 20
    for outcome in found.values():
        assert not outcome.passed
        assert said in outcome.words
        assert outcome.error <= 1  # the answer itself is right


def test_lists_that_a_program_changed_are_whole_in_the_next_trial():
    def destroying(position, neighbours, density, number_density=None, asymmetry=None):
        density[:] = 1
        neighbours.count[:] = 0

    broken = judged(destroying, "sph.density", ("T2",))
    assert any("it changed its input neighbours.count" in o.words for o in broken)
    sound = contract.climb(contract.Target(REGISTRY["sph.density"], "cpu", "float64"), ("T2",))
    assert all(o.passed for o in sound)


@pytest.mark.parametrize("backend", ["numpy", "cpu"])
def test_refsims_own_programs_are_held_to_the_same(backend, monkeypatch):
    program = REGISTRY["sph.gravity"].program(backend)

    def destroying(*values):
        answer = program(*values)
        values[0][...] = 7
        return answer

    destroying.__signature__ = inspect.signature(getattr(program, "py_func", program))
    monkeypatch.setattr(type(REGISTRY["sph.gravity"]), "program", lambda self, name: destroying)
    (first, *_) = contract.climb(contract.Target(REGISTRY["sph.gravity"], backend, "float64"), ("T1",))
    assert not first.passed
    assert "it changed its input" in first.words


# Libraries that break their process


AT_IMPORT = {
    "sys.exit": ("import sys\nsys.exit(0)", "cannot be imported: SystemExit: 0."),
    "os._exit": ("import os\nos._exit(0)", "cannot be imported: the program ended its process (exit code 0)."),
    "crash": ("import ctypes\nctypes.string_at(0)", "the program ended its process (signal SIGSEGV)."),
    "endless": ("while True: pass", "cannot be imported: its import did not end within 2 s (--time-limit)."),
    "interrupt": ("raise KeyboardInterrupt", "cannot be imported: KeyboardInterrupt"),
    "words": ("class E(Exception):\n def __str__(self): return 1/0\nraise E", "cannot be imported: E: no message."),
}


@pytest.mark.parametrize("name", AT_IMPORT)
def test_a_library_that_cannot_be_imported_is_bad_input(name, folder, capsys):
    text, said = AT_IMPORT[name]
    (folder / "own.py").write_text(text + "\n")
    code, out, err = refsim(capsys, "own.py", "--time-limit", "2")
    assert (code, out) == (2, "")
    assert said in err
    assert err.startswith("refsim: ")
    assert err.count("\n") == 1


def test_a_program_that_does_not_return_costs_its_own_operation(folder, capsys):
    (folder / "own.py").write_text(
        "import ctypes, os, sys\n"
        "def endless(density):\n    ctypes.pythonapi.pause()\n"
        "def leaving(velocity):\n    sys.exit(0)\n"
        "def gone(pressure):\n    os._exit(0)\n"
        f"{GRAVITY}"
        "PROGRAMS = {'sph.state': endless, 'sph.extremes': leaving, 'sph.gravity': gravity}\n"
    )
    code, out, err = refsim(capsys, "own.py", *QUICK, "--time-limit", "2", "--json")
    assert code == 4
    assert err == ""
    operations = json.loads(out)["operations"]
    assert {name: o["holds"] for name, o in operations.items()} == {
        "sph.state": False, "sph.extremes": False, "sph.gravity": True,
    }  # fmt: skip
    (late,) = operations["sph.state"]["outcomes"]
    assert "the program did not return within 2 s (--time-limit)" in late["words"]
    assert operations["sph.extremes"]["outcomes"][0]["words"] == "it raised SystemExit: 0"


@pytest.mark.parametrize(
    "options",
    [("--dtype", "float16"), ("--step", "T8"), ("--variant", "-1"), ("--variant", "99"), ("sph.gravty",)]
    + [("--time-limit", text) for text in ("0", "-1", "nan", "inf")],
)
def test_options_are_checked_before_a_process_is_started(options, folder, capsys, monkeypatch):
    monkeypatch.setattr("multiprocessing.get_context", lambda name: pytest.fail("a process was started"))
    code, out, err = refsim(capsys, "own.py", *options)
    assert (code, out) == (2, "")
    assert err.count("\n") == 1


def test_arguments_of_an_operation_are_told(capsys):
    code, out, _ = refsim(capsys, "sph.density", "--arguments")
    assert code == 0
    lines = {line.split()[0]: line for line in out.splitlines() if line}
    assert "float32 (n, 3)" in lines["position"]
    assert "or None" in lines["walls"]
    assert "out" in lines["density"]
    assert "refsim.smoothing.shapes.Smoothing" in lines["smoothing"]
    code, out, _ = refsim(capsys, "sph.density", "--arguments", "--json")
    listed = json.loads(out)["operations"]["sph.density"]
    names = [row["name"] for row in listed]
    assert [n for n in names if not n.startswith(".")] == list(REGISTRY["sph.density"].arguments("cpu"))
    assert refsim(capsys, "sph.densty", "--arguments")[0] == 2


def test_the_page_shows_what_the_command_prints(capsys):
    _, out, _ = refsim(capsys, "sph.viscosity", "--arguments")
    shown = PAGE.read_text().partition("```text\n")[2].partition("\n```")[0].splitlines()
    assert all(line in out.splitlines() for line in shown if line != "..." and ".entries" not in line)
