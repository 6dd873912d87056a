"""Slips of host code: what a key covers, what is read, which end a prediction is for, what is counted."""

import os
import shutil
import sys
from pathlib import Path

import pytest

import refsim
from refsim import Box, Gravity, Scene, SolidMesh, WeaklyCompressible, make_plan
from refsim.study import runs
from refsim.study.observables import observable_of
from tests.running import rows


def block(**more):
    effects = (WeaklyCompressible(sound_speed=20.0, density="summation"), Gravity())
    given = {"spacing": 0.01, "support_radius": 0.026, "end_time": 0.002, "effects": effects}
    return Scene(**{**given, "fluid": (Box(cells=(4, 4, 4)),), **more})


def key(scene, observable):
    return runs.key_of(runs.Setting("spacing", "a", 1.0, scene, "numpy"), observable, None, None)


# What a key covers
def test_a_key_follows_the_body_of_an_observable_and_a_function_has_none(tmp_path):
    plan, file, keys = make_plan(block()), tmp_path / "own.py", []
    for body in ("return 1.0", "return 2.0"):
        file.write_text(f"def value(simulation):\n    {body}\n")
        keys.append(key(block(), observable_of(f"{file}:value", plan)))
    assert len(set(keys)) == 2
    with pytest.raises(refsim.InputError, match="runs of a function are not kept; leave folder out, or give FILE"):
        refsim.study(block(), lambda simulation: 1.0, backend="numpy", folder=tmp_path)


def test_a_key_follows_the_file_of_a_mesh_and_so_does_the_mesh(tmp_path):
    import trimesh

    file, found = tmp_path / "box.stl", []
    body = SolidMesh(file=str(file), center=(0.0, 0.0, 0.0))
    scene = block(solid=(body,), fluid=(), effects=(WeaklyCompressible(sound_speed=20.0, density="summation"),))
    observable = observable_of("kinetic_energy", make_plan(block()))
    for size in (1, 2):
        file.write_bytes(trimesh.creation.box((0.1 * size, 0.1, 0.1)).export(file_type="stl"))
        os.utime(file, ns=(size, size))
        found.append((key(scene, observable), float(body.extent()[1][0])))
    assert found[0][0] != found[1][0]
    assert [reach for *_, reach in found] == pytest.approx([0.05, 0.1])


HELPERS = rows(__file__, "helpers")


@pytest.mark.parametrize("where", HELPERS)
def test_a_key_follows_the_modules_that_an_observable_imports(where, tmp_path, monkeypatch):
    """And what is read is what they hold now, although they were imported before."""
    begin, place, between = HELPERS[where]
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    for name in ("helper", "first", "own_part", "own_part.helper", "own_part.first"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    helper, file, plan = tmp_path / place, tmp_path / "own.py", make_plan(block())
    helper.parent.mkdir(exist_ok=True)
    if between:
        (helper.parent / "first.py").write_text(f"{between}\n")
    scale = "first.helper.SCALE" if where == "through another" else "helper.SCALE"
    file.write_text(
        "import sys, os\nhere = os.path.dirname(os.path.abspath(__file__))\nsys.path.insert(0, here)\n"
        f"{begin}def value(simulation):\n{'' if begin else '    import helper'}\n    return {scale}\n"
    )
    keys, values = [], []
    for size in ("1.0", "1000.0", "1000.0"):
        helper.write_text(f"SCALE = {size}\n")
        observable = observable_of(f"{file}:value", plan)
        keys.append(key(block(), observable))
        values.append(observable(None))
    assert values == [1.0, 1000.0, 1000.0]
    assert keys[0] != keys[1] == keys[2]


def test_the_digest_of_the_sources_covers_a_line_of_each_package(tmp_path):
    """Every package counts but those that are said not to, and of these the modules that are said to."""
    root = Path(refsim.__file__).parent
    copy = tmp_path / "refsim"
    shutil.copytree(root, copy, ignore=shutil.ignore_patterns("__pycache__", "*.toml", "*.md", "*.html"))
    digest = runs.source_digest.__wrapped__
    whole = digest(copy)
    assert whole == runs.source_digest(root)
    packages = sorted(path.name for path in copy.iterdir() if (path / "__init__.py").exists())
    assert {"heat", "sph", "mpm", "boundary", "engine", "neighbours"} <= set(packages)
    for package in packages:
        module = max((copy / package).rglob("*.py"), key=lambda path: (path.name == "kernels.py", str(path)))
        before = module.read_text()
        module.write_text(before + "\nCHANGED = 1\n")
        counts = package not in ("cluster", "commands", "contract", "render", "study", "sweep")
        assert (digest(copy) != whole) == counts, module
        module.write_text(before)
    (copy / "study" / "observables.py").write_text("")
    assert digest(copy) != whole
