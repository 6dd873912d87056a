"""`refsim contract`: a third party's programs, found, bound, judged and reported; the page's example works."""

import ctypes
import json
import re
import sys

import numpy as np
import pytest

from refsim import contract
from refsim.__main__ import main
from refsim.core.errors import InputError
from refsim.core.operation import REGISTRY
from tests.running import rows

GRAVITY = "def gravity(field, acceleration):\n    acceleration += field\n"


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


MISTAKES, ENDS = (rows(__file__, name) for name in ("mistakes", "ends"))


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_gets_one_sentence(name, folder):
    source, text, said = MISTAKES[name]
    if text != "-":
        (folder / source).write_text(text + "\n")
    with pytest.raises(InputError, match=re.escape(said)) as told:
        contract.load(source)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("text", ENDS)
def test_an_import_that_ends_its_process_gets_one_sentence_and_code_2(text, folder, capsys):
    (folder / "own.py").write_text(text + "\n")
    code, out, err = refsim(capsys, "own.py", "--time-limit", "2")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err.startswith("refsim: ")
    assert ENDS[text] in err


def test_a_missing_operation_is_named(folder, capsys):
    (folder / "own.py").write_text(GRAVITY + "PROGRAMS = {'sph.gravity': gravity}\n")
    code, _, err = refsim(capsys, "own.py", "sph.density")
    assert (code, err) == (2, "refsim: own.py has no program for sph.density; it has programs for sph.gravity.\n")
    code, _, err = refsim(capsys, "own.py", "sph.gravty")
    assert code == 2
    assert "did you mean sph.gravity?" in err
    assert "name the programs before it: refsim contract mine.py sph.density." in refsim(capsys, "sph.density")[2]


def judged(program, operation="sph.gravity", steps=("T1", "T7"), **options):
    programs = contract.Programs({operation: program}, dtypes=("float64",), name="mine")
    return list(contract.trials(programs, operation, steps=steps, **options))


# A program whose parameters cannot be read, as those of many compiled functions
Unsigned = type("Unsigned", (), {"__signature__": "unknown", "__call__": lambda self, *values: None})
MISFIT = {
    "parameter": (lambda gravity, acceleration: None, "takes gravity, which the operation does not have; it has"),
    "any number": (lambda *values: None, "takes *values, which the operation does not have"),
    "no signature": (Unsigned(), "does not state its parameters"),
}


@pytest.mark.parametrize("name", MISFIT)
def test_a_parameter_that_the_operation_has_not_is_bad_input(name):
    program, said = MISFIT[name]
    with pytest.raises(InputError, match=re.escape(said)):
        judged(program)


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


BROKEN = """
import ctypes, os, sys
import numpy as np

def segfault(field, acceleration):
    if len(acceleration) == 2:
        ctypes.string_at(0)
    acceleration += field

def endless(mass, density, volume):
    if len(volume) == 2:
        ctypes.pythonapi.pause()
    volume[:] = mass / density

def several(corrected_density, density):
    print("here I am")  # is no part of the report
    if len(density) == 1:
        raise ValueError("too few\\nparticles")
    if len(density) == 2:
        sys.exit(7)
    if len(density) == 3:
        return np.zeros(5)
    if len(density) == 60:
        ctypes.c_ubyte.from_address(density.ctypes.data + density.nbytes).value ^= 1
    density[:] = corrected_density

PROGRAMS = {"sph.gravity": segfault, "heat.particle_volume": endless, "jiang_zhu_2023.replace_density": several}
"""


def test_a_broken_program_fails_in_that_trial_and_the_rest_is_judged(folder, capsys):
    (folder / "own.py").write_text(BROKEN)
    code, out, _ = refsim(capsys, "own.py", "--dtype", "float64", "--step", "T2", "--time-limit", "5", "--json")
    assert code == 4
    found = json.loads(out)
    operations = found["operations"]
    said = {
        name: {o["trial"]: o["words"] for o in operation["outcomes"] if not o["passed"]}
        for name, operation in operations.items()
    }
    assert said.pop("sph.gravity") == {"two_particles": "the program ended its process (signal SIGSEGV)"}
    assert said.pop("heat.particle_volume") == {"two_particles": "the program did not return within 5 s (--time-limit)"}
    (several,) = said.values()
    several = {trial: words for trial, words in several.items() if not trial.endswith("_2d")}
    beside = "it wrote behind the end of density"
    assert several == {
        "one_particle": "it raised ValueError: too few particles", "two_particles": "it raised SystemExit: 7",
        "three_particles": "it returned density as float64 of shape (5,); wanted is float64 of shape (3,)",
        **dict.fromkeys(("very_far_away", "tiny_lengths", "huge_lengths", "flung_particle"), beside),
    }  # fmt: skip
    assert len({operation["trials"] for operation in operations.values()}) == 1
    assert len(found["not_offered"]) == len(REGISTRY) - 3


@pytest.mark.parametrize("options", rows(__file__, "options"))
def test_options_are_checked_before_a_process_is_started(options, folder, capsys, monkeypatch):
    monkeypatch.setattr("multiprocessing.get_context", lambda name: pytest.fail("a process was started"))
    code, out, err = refsim(capsys, "own.py", *options.split())
    assert ((code, out), err.count("\n")) == ((2, ""), 1)


def test_arguments_of_an_operation_are_told_as_data(capsys):
    code, out, _ = refsim(capsys, "sph.density", "--arguments", "--json")
    names = [row["name"] for row in json.loads(out)["operations"]["sph.density"]["arguments"]]
    assert [n for n in names if "." not in n] == list(REGISTRY["sph.density"].arguments("cpu"))
    assert (code, refsim(capsys, "sph.densty", "--arguments")[0]) == (0, 2)


def test_a_program_imports_its_neighbours_and_operations_share_processes(folder, capsys):
    (folder / "library").mkdir()
    (folder / "library" / "beside.py").write_text("SHARE = 2\n")
    (folder / "library" / "own.py").write_text(
        "from beside import SHARE\n"
        "def gravity(field, acceleration):\n    acceleration += SHARE * field if len(acceleration) == 3 else field\n"
        "def volume(mass, density, volume):\n    volume[:] = mass / density\n"
        "PROGRAMS = {'sph.gravity': gravity, 'heat.particle_volume': volume}\n"
    )
    given = ("library/own.py", "--step", "T2", "sph.gravity", "--dtype", "float64", "heat.particle_volume", "-j", "2")
    code, out, _ = refsim(capsys, *given, "--json")
    assert code == 4
    operations = json.loads(out)["operations"]
    assert set(operations) == {"sph.gravity", "heat.particle_volume"}
    assert sum(not o["passed"] for o in operations["sph.gravity"]["outcomes"]) == 2
    assert refsim(capsys, *given[:6], "-j", "0")[0] == 2


def test_arguments_and_template_for_a_gpu_need_none(capsys):
    code, out, _ = refsim(capsys, "sph.momentum", "--arguments", "--backend", "cuda")
    assert code == 0
    assert "the k-th neighbour of particle i is entries[k n + i]" in out
    assert refsim(capsys, "--template", "sph.density", "mpm.particle_to_grid", "--backend", "cuda")[0] == 0
