"""Types: users' programs can be checked against the public names; functions have types but in the kinds left out."""

import importlib.util
import os
import pathlib
import re
import subprocess
import sys
import tomllib

import pytest

import refsim

ROOT = pathlib.Path(__file__).parents[2]
PAGES = ("README.md", *(f"docs/{name}.md" for name in ("gauges", "meshes", "study", "surface_energy", "sweep")))
PYTHON = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
CONFIGURATION = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]
with_mypy = pytest.mark.skipif(importlib.util.find_spec("mypy") is None, reason="mypy is not installed (extra test)")


def strict(folder, *scripts):
    """What mypy says of a user's scripts. Packages that refsim's own check skips are skipped: a user may lack them."""
    (skipped,) = [o["module"] for o in CONFIGURATION["mypy"]["overrides"] if o.get("follow_imports") == "skip"]
    (folder / "mypy.ini").write_text(f"[mypy]\n[mypy-{','.join(skipped)}]\nfollow_imports = skip\n")
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file=mypy.ini", f"--cache-dir={os.devnull}"]
    return subprocess.run(
        [*command, "--follow-imports=silent", *map(str, scripts)],
        env=os.environ | {"MYPYPATH": str(ROOT)}, cwd=folder, capture_output=True, text=True,
    ).stdout  # fmt: skip


@with_mypy
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
