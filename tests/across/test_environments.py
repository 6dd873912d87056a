"""The script that installs the wheel in other environments: what it finds, and what it refuses."""

import importlib.util
import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).parents[2]
spec = importlib.util.spec_from_file_location("environments", ROOT / "scripts" / "environments.py")
environments = sys.modules.setdefault(spec.name, importlib.util.module_from_spec(spec))
spec.loader.exec_module(environments)


def test_the_lowest_versions_are_those_of_the_configuration():
    required = environments.settings()["options"]["install_requires"].split()
    found = environments.constraints()
    assert [line.replace("==", ">=") for line in found] == required
    assert all(re.fullmatch(r"[\w-]+==[\d.]+", line) for line in found)


def test_lowest_versions_and_extras_go_with_the_oldest_python_only():
    found = environments.environments()
    first = [e.version for e in found if e.version == environments.oldest()][:1]
    for kind in (environments.LOWEST, environments.EXTRAS):
        assert [e.version for e in found if e.kind == kind] == first
    assert all(e.version >= environments.oldest() for e in found)


def test_extras_are_all_but_that_of_a_gpu():
    assert set(environments.extras().split(",")) == {"cluster", "docs", "results", "test", "view"}


def test_an_unknown_environment_is_bad_input(capsys):
    assert environments.main(["--only", "2.7"]) == 2
    assert capsys.readouterr().err.startswith("There is no environment '2.7'; found: ")
