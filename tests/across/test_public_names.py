"""What docs/public_names.md promises, name by name and by types; `scene.schema.json` holds the keys of scene files.

Run as a program, this file writes `public_names.txt` anew. CHANGELOG.md then names what changed.
"""

import argparse
import difflib
import importlib.util
import inspect
import os
import pathlib
import re
import subprocess
import sys
import tomllib

import msgspec
import pytest

import refsim
from refsim.__main__ import make_parser
from refsim.commands import discover
from refsim.core import errors

STORED = pathlib.Path(__file__).with_name("public_names.txt")


def call(name, function):
    """The name with its arguments and defaults. Types are left out: their text differs between versions of Python."""
    signature = inspect.signature(function)
    arguments = [argument.replace(annotation=inspect.Parameter.empty) for argument in signature.parameters.values()]
    shown = f"{name}{signature.replace(parameters=arguments, return_annotation=inspect.Signature.empty)}"
    return re.sub(r"<function <lambda> at \w+>", "...", shown)


def python_names():
    for name in refsim.__all__:
        thing = getattr(refsim, name)
        if inspect.ismodule(thing) or not callable(thing):
            yield name
            continue
        raised = inspect.isclass(thing) and issubclass(thing, Exception)  # refsim raises them
        yield name if raised else call(name, thing)
        settings = inspect.isclass(thing) and issubclass(thing, msgspec.Struct)  # its attributes are its arguments
        bases = thing.__mro__ if inspect.isclass(thing) and not settings else ()
        own = {part for base in bases if base.__module__.startswith("refsim") for part in vars(base)}
        for part in sorted(own):
            value = getattr(thing, part, None)
            if not part.startswith("_"):
                yield call(f"  .{part}", value) if inspect.isfunction(value) else f"  .{part}"


def command_line():
    discover()
    for action in make_parser()._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, command in sorted(action.choices.items()):
                yield f"refsim {name}"
                for option in command._actions:
                    yield "  " + (", ".join(option.option_strings) or option.dest)


def listing():
    return "\n".join((*python_names(), "", *command_line(), "", "why a run stops", *sorted(errors.REASONS), ""))


def test_public_names_are_those_that_are_stored():
    stored, found = STORED.read_text(encoding="utf-8").splitlines(), listing().splitlines()
    changed = list(difflib.unified_diff(stored, found, "public_names.txt", "refsim", lineterm="", n=0))
    assert not changed, "what docs/public_names.md promises has changed:\n" + "\n".join(changed)


if __name__ == "__main__":
    STORED.write_text(listing(), encoding="utf-8")


ROOT = pathlib.Path(__file__).parents[2]
PAGES = ("README.md", *(f"docs/{name}.md" for name in ("gauges", "meshes", "study", "surface_energy", "sweep")))
PYTHON = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
CONFIGURATION = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]


def strict(folder, *scripts):
    """What mypy says of a user's scripts. Packages that refsim's own check skips are skipped: a user may lack them."""
    (skipped,) = [o["module"] for o in CONFIGURATION["mypy"]["overrides"] if o.get("follow_imports") == "skip"]
    (folder / "mypy.ini").write_text(f"[mypy]\n[mypy-{','.join(skipped)}]\nfollow_imports = skip\n")
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file=mypy.ini", f"--cache-dir={os.devnull}"]
    return subprocess.run(
        [*command, "--follow-imports=silent", *map(str, scripts)],
        env=os.environ | {"MYPYPATH": str(ROOT)}, cwd=folder, capture_output=True, text=True,
    ).stdout  # fmt: skip


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("mypy") is None, reason="mypy is not installed (extra test)")
def test_programs_of_users_are_typed(tmp_path):
    """Those on the pages, which test_docs.py runs, and one with mistakes."""
    scripts = []
    for name in PAGES:
        scripts.append(tmp_path / f"{pathlib.Path(name).stem}_page.py")
        scripts[-1].write_text("\n".join(PYTHON.findall((ROOT / name).read_text())))
    wrong = tmp_path / "wrong.py"
    wrong.write_text(
        "import refsim\nrefsim.Scene(spacing='0.1', support_radius=1.0, fluid=())\nrefsim.open_run(3).at('x')\n"
    )
    found = strict(tmp_path, *scripts, wrong)
    assert re.search(r'wrong\.py:2: error: Argument "spacing" to "Scene"', found)
    assert found.count("wrong.py:3: error: Argument 1") == 2
    assert found.splitlines()[-1] == f"Found 3 errors in 1 file (checked {len(scripts) + 1} source files)"


def test_files_that_are_left_out_are_there():
    """Each name in a pattern of pyproject.toml is that of a file."""
    for pattern in CONFIGURATION["ruff"]["lint"]["per-file-ignores"]:
        before, names, after = re.fullmatch(r"([^{]*)(?:{(.*)})?(.*)", pattern).groups("")
        for name in names.split(","):
            assert any(ROOT.glob(before + name + after)), before + name + after


def test_public_names_are_listed_and_there():
    assert (ROOT / "refsim" / "py.typed").exists()
    assert sorted(refsim.__all__) == refsim.__all__
    assert all(hasattr(refsim, name) for name in refsim.__all__)
