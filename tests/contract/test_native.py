"""Declarations in C and Fortran that a command prints: one library of each is compiled, loaded and judged."""

import pathlib
import shutil
import subprocess

import pytest

from refsim import contract
from refsim.__main__ import main
from refsim.contract import native
from refsim.core.errors import InputError
from refsim.core.operation import REGISTRY

FOLDER = pathlib.Path(__file__).parent


def printed(capsys, language):
    assert main(["contract", "sph.density", "--header", language]) == 0
    return capsys.readouterr().out


def holds(folder, name, variants, **declared):
    made = native.library(
        str(folder / name), ["sph.density"], kernels=("wendland_c2",), most_particles=3000,
        without=("number_density", "asymmetry", "period"), **declared,
    )  # fmt: skip
    found = list(contract.trials(made, "sph.density", (), variants, ("T1", "T2")))
    judged = [o for o in found if not o.not_judged]
    assert len(judged) > 30
    assert not [str(o) for o in judged if not o.passed]


def test_a_c_library_holds_by_its_header(tmp_path, capsys):
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler is on the path")
    (tmp_path / "density.h").write_text(printed(capsys, "c"))
    for dtype, real in (("float32", "float"), ("float64", "double")):
        options = ["-O2", "-Wall", "-Werror", "-shared", "-fPIC", f"-I{tmp_path}", f"-DREAL={real}"]
        command = [compiler, *options, FOLDER / "density.c", "-o", f"c_{dtype}.so", "-lm"]
        subprocess.run(command, check=True, cwd=tmp_path)
    holds(tmp_path, "c_{dtype}.so", (0, 6))


def test_a_fortran_library_holds_by_its_module(tmp_path, capsys):
    compiler = shutil.which("gfortran")
    if compiler is None:
        pytest.skip("gfortran is not on the path")
    (tmp_path / "density.f90").write_text(printed(capsys, "fortran") + (FOLDER / "density.f90").read_text())
    subprocess.run([compiler, "-O2", "-shared", "-fPIC", "density.f90", "-o", "f.so"], check=True, cwd=tmp_path)
    holds(tmp_path, "f.so", (0,), dtypes=("float64",), walls=False)


@pytest.mark.parametrize("name", ["sph.momentum", "mpm.particle_to_grid", "sph.kick_drift", "heat.explicit"])
def test_declarations_of_other_operations_compile(name, tmp_path):
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler is on the path")
    (tmp_path / "a.c").write_text(native.header(REGISTRY[name]))
    subprocess.run([compiler, "-Wall", "-Werror", "-c", "a.c"], check=True, cwd=tmp_path)
    if shutil.which("gfortran"):
        (tmp_path / "a.f90").write_text(native.module(REGISTRY[name]))
        subprocess.run(["gfortran", "-c", "a.f90"], check=True, cwd=tmp_path)


def test_an_operation_that_is_not_there_is_bad_input():
    with pytest.raises(InputError, match=r"there is no operation sph.densty"):
        native.library("a.so", ["sph.densty"])
