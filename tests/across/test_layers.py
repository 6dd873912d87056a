"""The order of the packages: each imports only what stands before it, and modules import each other in no circle."""

import ast
import graphlib
import pathlib

import refsim

ROOT = pathlib.Path(refsim.__file__).parent
ORDER = (
    "core", "backends", "smoothing", "neighbours", "sparse_grid", "winding_number", "scene", "sph", "heat",
    "shape_matching", "isosurface", "surface_normal", "surface_detection", "surface_tension", "surface_energy",
    "melting", "mpm", "boundary", "io", "engine", "contract", "cluster", "study", "sweep", "render",
    "commands", "pytest_plugin", "examples",
)  # fmt: skip


def modules(root=ROOT):
    """{module: path} of the package."""
    found = {}
    for path in root.rglob("*.py"):
        parts = ("refsim", *path.relative_to(root).with_suffix("").parts)
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports(root=ROOT):
    """{module: modules that it imports}, at its top and inside its functions."""
    paths = modules(root)
    found = {}
    for module, path in paths.items():
        found[module] = set()
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                found[module] |= {alias.name for alias in node.names} & paths.keys()
            elif isinstance(node, ast.ImportFrom) and node.module in paths:
                for alias in node.names:
                    inside = f"{node.module}.{alias.name}"
                    found[module].add(inside if inside in paths else node.module)
    return found


def upwards(found):
    """Imports of a package that stands later in ORDER."""
    for module, others in found.items():
        if module not in ("refsim", "refsim.__main__"):
            own = ORDER.index(module.split(".")[1])
            for other in others:
                if other == "refsim" or ORDER.index(other.split(".")[1]) > own:
                    yield f"{module} imports {other}"


def test_packages_import_only_what_stands_before_them():
    assert not list(upwards(imports()))


def test_no_modules_import_each_other_in_a_circle():
    graphlib.TopologicalSorter(imports()).prepare()


def test_an_upward_import_is_noticed(tmp_path):
    for folder in ("core", "scene"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "__init__.py").write_text("")
    (tmp_path / "scene" / "files.py").write_text("")
    (tmp_path / "core" / "walls.py").write_text("def look():\n    from refsim.scene import files\n")
    assert list(upwards(imports(tmp_path))) == ["refsim.core.walls imports refsim.scene.files"]
