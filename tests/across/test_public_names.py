"""docs/public_names.md: names, options, versions, exit codes and folders are those of the code."""

import pathlib
import re

import pytest

import refsim
from refsim.contract import export
from refsim.core.effect import EFFECTS
from refsim.core.errors import InputError, RunStopped
from refsim.core.operation import REGISTRY
from refsim.io import checkpoint, transactions
from refsim.scene import files
from validation.perform import EXIT_FAILED, EXIT_FINE

ROOT = pathlib.Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "public_names.md").read_text()


def row(name):
    """Cells of the row of the table of what is public."""
    (line,) = re.findall(rf"^\| {name} +\|(.*)\|$", PAGE, re.MULTILINE)
    return [cell.strip() for cell in line.split("|")]


@pytest.mark.parametrize(
    "name, version",
    [
        ("Python", refsim.__version__),
        ("command line", refsim.__version__),
        ("exit codes", refsim.__version__),
        ("operations", refsim.__version__),
        ("scene files", files.VERSION),
        ("test vectors", export.FORMAT),
        ("checkpoints", checkpoint.VERSION),
        ("particle files", int(re.search(rb"version (\d+)", transactions.HEAD.pattern)[1])),
    ],
)
def test_the_versions_are_those_of_the_code(name, version):
    assert row(name)[1].removesuffix(", of the package") == str(version)


def test_the_exit_codes_are_those_of_the_code():
    codes = [EXIT_FINE, InputError.exit_code, RunStopped.exit_code, EXIT_FAILED]
    assert row("exit codes")[0].startswith(f"{', '.join(map(str, codes))},")


def test_nothing_is_deprecated_that_the_page_does_not_name():
    assert "No public name is deprecated now." in PAGE
    warning = [path for path in (ROOT / "refsim").rglob("*.py") if "DeprecationWarning" in path.read_text()]
    assert not warning, "name it on docs/public_names.md"


def test_the_patent_names_every_folder_that_follows_it():
    section = PAGE.partition("## The patent CN104318598A")[2]
    assert "not legal advice" in section
    following = {o.folder.replace(".", "/") for o in REGISTRY.values() if "CN104318598A" in o.paper}
    assert len(following) > 3
    assert {f"`{folder}/`" for folder in following} == set(re.findall(r"`refsim/[\w/]+`", section))
    named = set(re.findall(r"`(\w+)`", section)) & set(EFFECTS)
    assert {"mesh_boundary", "normal_difference_2014"} <= named
