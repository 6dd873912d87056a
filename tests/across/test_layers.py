"""The order of the packages: each imports only what stands before it, and modules import each other in no circle.

Functions take at most ten arguments.

Modules of `validation/` import each other in no circle either, and refsim imports none of them.
"""

import ast
import functools
import graphlib
import pathlib
import re

import refsim
from refsim.core.operation import REGISTRY
from tests.running import python

ROOT = pathlib.Path(refsim.__file__).parent
VALIDATION = ROOT.parent / "validation"
MOST_ARGUMENTS = 10
BY_NAME = ("import_module", "__import__", "resolve_name", "find_spec", "run_module")
BELOW = ("core", "backends", "smoothing", "neighbours", "sparse_grid", "winding_number", "gauges", "motion", "scene")
ABOVE = ("io", "engine", "contract", "cluster", "study", "sweep", "render", "commands", "pytest_plugin", "examples")


def modules(root=ROOT):
    """{module: path} of the package."""
    found = {}
    for path in root.rglob("*.py"):
        parts = (root.name, *path.relative_to(root).with_suffix("").parts)
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@functools.cache
def nodes(path):
    return list(ast.walk(ast.parse(path.read_text())))


def last_name(function):
    return getattr(function, "attr", getattr(function, "id", ""))


@functools.cache
def imports(*roots):
    """{module: modules that it imports}, at its top, inside its functions, and by a name that is written out."""
    paths = {module: path for root in roots or (ROOT,) for module, path in modules(root).items()}
    found = {}
    for module, path in paths.items():
        found[module] = set()
        for node in nodes(path):
            if isinstance(node, ast.Import):
                found[module] |= {alias.name for alias in node.names} & paths.keys()
            elif isinstance(node, ast.ImportFrom) and node.module in paths:
                for alias in node.names:
                    inside = f"{node.module}.{alias.name}"
                    found[module].add(inside if inside in paths else node.module)
            elif isinstance(node, ast.Call) and last_name(node.func) in BY_NAME:
                given = {arg.value for arg in node.args if isinstance(arg, ast.Constant)}
                found[module] |= {name.partition(":")[0] for name in given if isinstance(name, str)} & paths.keys()
    return found


def floor(module):
    """Place of a module's package in the order; all methods, which are neither BELOW nor ABOVE, share one."""
    package = module.split(".")[1]
    if package in BELOW:
        return BELOW.index(package)
    return len(BELOW) + (1 + ABOVE.index(package) if package in ABOVE else 0)


def upwards(found):
    """Imports of a package that stands later in the order."""
    for module, others in found.items():
        if module not in ("refsim", "refsim.__main__"):
            for other in others:
                if other == "refsim" or floor(other) > floor(module):
                    yield f"{module} imports {other}"


def test_packages_and_modules_import_only_what_stands_before_them_and_in_no_circle():
    every = imports(ROOT, VALIDATION)
    found, packages = {module: every[module] for module in modules()}, {}
    above = modules(VALIDATION).keys()
    assert not [f"{module} imports {other}" for module, others in found.items() for other in others & above]
    assert not list(upwards(found))
    for module, others in found.items():
        if module not in ("refsim", "refsim.__main__"):
            own = module.split(".")[1]
            packages.setdefault(own, set()).update({other.split(".")[1] for other in others} - {own})
    for graph in (packages, every):
        graphlib.TopologicalSorter(graph).prepare()


WRITES = ("savefig", "savez", "savez_compressed", "savetxt", "write_bytes", "write_text", "to_csv", "tofile", "imsave")
WRITER = "refsim.core.writing"


def writes_of_their_own(parts):
    """Calls that write into a named file, which may be half written when they end."""
    for node in parts:
        name = last_name(node.func) if isinstance(node, ast.Call) else ""
        if name not in (*WRITES, "open", "fdopen", "save", "export"):
            continue
        words, function = ast.unparse(node), ast.unparse(node.func)
        given = [*node.args, *(keyword.value for keyword in node.keywords)]
        modes = [str(value.value) for value in given if isinstance(value, ast.Constant)]
        opened = name in ("open", "fdopen") and any(re.fullmatch(r"[rbt]*[wax+][rwaxbt+]*", mode) for mode in modes)
        by_name = name in WRITES or function == "np.save" or (function.endswith(".export") and node.args)
        if by_name or (opened and not re.search("os.(devnull|dup)", words)):  # which are no files
            yield words


def test_package_commands_and_cases_load_no_numba():
    """It takes longer to load than most commands take; only what compiles or runs kernels does."""
    code = (
        "import sys; sys.modules['numba'] = None; import refsim.contract.report; from refsim.commands import discover;"
        " from refsim.core import cases; discover(); cases.discover()"
    )
    python("-c", code)


def test_importing_refsim_loads_what_describes_scenes_alone():
    """What runs, reads and studies them, and what few of them need, takes a third as long again."""
    loads = "import sys, numpy, msgspec; before = set(sys.modules); import refsim; print(*set(sys.modules) - before)"
    later = "numba numpy.polynomial csv difflib hashlib html json logging shutil subprocess tempfile tomllib zipfile"
    later += " refsim.engine refsim.io refsim.study refsim.cluster refsim.commands refsim.scene.plan refsim.scene.files"
    assert not set(python("-c", loads).stdout.split()) & set(later.split())
    named = "import refsim, refsim.study.runs; assert callable(refsim.study) and refsim.Simulation and refsim.open_run"
    python("-c", named)


def test_every_file_is_written_through_one_module():
    """A new file is then whole, or the old one is; of the package, the experiments and the scripts."""
    places = modules() | modules(VALIDATION) | {f"scripts.{p.stem}": p for p in (ROOT.parent / "scripts").glob("*.py")}
    found = {m: list(writes_of_their_own(nodes(path))) for m, path in places.items() if m != WRITER}
    assert not {m: calls for m, calls in found.items() if calls and ".examples." not in m}


def test_a_write_of_its_own_is_found():
    found = 'open(path, "w")', 'path.open(mode="ab")', 'os.fdopen(handle, "w")', "np.save(path, x)", "mesh.export(path)"
    harmless = 'open(path)\nopen(path, "rb")\nmade_by(figure.savefig, format="png")\nmesh.export(file_type="obj")'
    assert list(writes_of_their_own(ast.walk(ast.parse("\n".join((*found, harmless)))))) == [
        call.replace('"', "'") for call in found
    ]


def long_signatures():
    """Functions with more than MOST_ARGUMENTS that may be given by place, `self` not counted.

    The registry's programs and pair functions are none of them: their arguments are bound by name.
    """
    bound = {
        (f"{entry.folder or operation.folder}.{entry.module}", entry.function or operation.function)
        for operation in REGISTRY.values()
        for entry in map(operation.entry, operation.names())
    }
    for module, path in modules(ROOT).items():
        for node in nodes(path):
            if isinstance(node, ast.FunctionDef) and (module, node.name) not in bound:
                names = [a.arg for a in (*node.args.posonlyargs, *node.args.args) if a.arg not in ("self", "cls")]
                if len(names) > MOST_ARGUMENTS and "pair" not in map(ast.unparse, node.decorator_list):
                    yield f"{module}.{node.name} takes {len(names)}"


def test_functions_take_at_most_ten_arguments():
    assert not list(long_signatures())


def test_functions_of_references_have_at_most_twelve_statements():
    """An equation is one expression, as a rule; what is longer has parts with names."""
    found = {}
    for path in ROOT.glob("**/reference.py"):
        for function in nodes(path):
            if isinstance(function, ast.FunctionDef):
                inner = sum(isinstance(node, ast.stmt) for node in ast.walk(function)) - 1
                found[f"{path.parent.name}.{function.name}"] = inner - (ast.get_docstring(function) is not None)
    assert len(found) > 200
    assert not {name: count for name, count in found.items() if count > 12}
