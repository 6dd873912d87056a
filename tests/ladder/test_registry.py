"""Rules: every kernel is tested against a reference, every program and docstring is there, no virial is unbalanced."""

import ast
import functools
import importlib
import os
import pathlib
import re
import subprocess
import sys

import numpy as np
import pytest

import refsim
from refsim import contract
from refsim.backends.compile import Kernel
from refsim.contract.bounds import oracle
from refsim.contract.inputs import Inputs, fields, with_variant
from refsim.core import cases
from refsim.core.effect import EFFECTS
from refsim.core.operation import REGISTRY
from refsim.surface_tension.cohesion import PairCohesion

ROOT = pathlib.Path(refsim.__file__).parent
LADDER = pathlib.Path(__file__).parent
KERNELS = ("kernel", "cpu_kernel", "cuda_kernel", "reduction")
COMPILED_ONLY = "test_cuda_typing.py"  # runs no kernel
IMPORT_SECONDS = 0.3
JUDGES = ("reference", "operations")  # modules: equations; what registers them and sums
IMPORTED = {  # by them, beside each other, numpy and math
    "reference": ("refsim.core.terms",),
    "operations": ("typing", "refsim.core.operation", "refsim.core.terms", "refsim.neighbours.sums"),
}
UNIT = re.compile(r"\[[^\]]*\]|dimensionless|flags?\b", re.IGNORECASE)
EQUATION = re.compile(r"=|[<>]|\bsum_|\b[A-Z]\(\d+\)")


@functools.cache
def parsed(path, changed):
    return ast.parse(path.read_text())


def tree_of(path):
    return parsed(path, path.stat().st_mtime_ns)


def functions(path):
    """{name: node} of a module's functions and classes, also of those under a condition."""
    found = {}
    for node in tree_of(path).body:
        for part in ast.walk(node) if isinstance(node, ast.If) else (node,):
            if isinstance(part, (ast.FunctionDef, ast.ClassDef)):
                found[part.name] = part
    return found


def decorator(node, *names):
    """The first of a function's decorators with one of the names, with or without arguments; None without any."""
    for found in node.decorator_list if isinstance(node, ast.FunctionDef) else ():
        plain = found.func if isinstance(found, ast.Call) else found
        if isinstance(plain, ast.Name) and plain.id in names:
            return found
    return None


@functools.cache
def names_in(node):
    return {part.id for part in ast.walk(node) if isinstance(part, ast.Name)} | {
        part.attr for part in ast.walk(node) if isinstance(part, ast.Attribute)
    }


@functools.cache
def made(path, root):
    """{name: kernel} of the kernels that a module makes by calls, and does not write."""
    if path.stem != "kernels":
        return {}
    module = importlib.import_module(".".join(path.relative_to(root.parent).with_suffix("").parts))
    own = {n: v for n, v in vars(module).items() if isinstance(v, Kernel) and v.__module__ == module.__name__}
    return {name: kernel for name, kernel in own.items() if name not in functions(path)}


def path_of(package, root):
    """File or folder of a dotted name below refsim."""
    return root.joinpath(*package.split(".")[1:])


def source_of(package, root):
    """The source of a module or package; None where there is none."""
    path = path_of(package, root)
    found = (path.with_suffix(".py"), path / "__init__.py")
    return next((file for file in found if file.exists()), None)


def folder_of(operation, root):
    return path_of(operation.folder, root)


def by_folder(operations, root):
    found = {}
    for operation in operations:
        found.setdefault(folder_of(operation, root), []).append(operation)
    return found


def where(operation, program, root):
    """(file, name) of a program of an operation."""
    entry = operation.entry(program)
    package = f"{entry.folder or operation.folder}.{entry.module}"
    return path_of(package, root).with_suffix(".py"), entry.function or operation.function


def programs(operations, root):
    """(operation, name of a program, its file, its name there) of all programs."""
    for operation in operations:
        for program in operation.names():
            yield operation, program, *where(operation, program, root)


def imported(path, root):
    """What a module imports from refsim, by the names it uses: ({module}, (module, name)) for each."""
    return imports_of(tree_of(path), root)


@functools.cache
def imports_of(tree, root):
    modules, members = {}, {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "refsim":
            for alias in node.names:
                own = alias.asname or alias.name
                module = source_of(f"{node.module}.{alias.name}", root)
                if module is not None:
                    modules.setdefault(own, set()).add(module)
                elif source_of(node.module, root) is not None:
                    members.setdefault(own, set()).add((source_of(node.module, root), alias.name))
    return modules, members


def reached_by(path, node, root):
    """(file, name) of what a function or class of a module names: there, in modules it imports, or imported itself."""
    used = names_in(node)
    modules, members = imported(path, root)
    yield from ((path, name) for name in used)
    for name in used & members.keys():
        yield from members[name]
    for alias in used & modules.keys():
        yield from ((module, name) for module in modules[alias] for name in used)


def entries(operations, root):
    """(file, name) of what is tested: programs of operations, and what the ladder's tests call."""
    for _, _, path, name in programs(operations, root):
        yield path, name
    for path in sorted(LADDER.glob("test_*.py")):
        if path.name != COMPILED_ONLY:
            yield from reached_by(path, tree_of(path), root)


def stray_kernels(operations, root):
    """Kernels that neither a program of an operation nor what the ladder's tests call can reach."""
    waiting, reached = list(entries(operations, root)), set()
    while waiting:
        path, name = waiting.pop()
        if (path, name) in reached or not path.exists():
            continue
        reached.add((path, name))
        own = functions(path)
        if name in own:
            waiting += reached_by(path, own[name], root)
        elif path.name == "__init__.py":
            waiting += imported(path, root)[1].get(name, ())  # handed on under the package's name
    for path in sorted(root.rglob("*.py")):
        for name, node in functions(path).items():
            if decorator(node, *KERNELS) and (path, name) not in reached:
                yield f"{path.relative_to(root)}: no operation and no test of the ladder reaches kernel {name}"
        for name, kernel in made(path, root).items():
            if (path, name) not in reached or kernel.__name__ != name:
                yield f"{path.relative_to(root)}: nothing reaches kernel {name}, or it has another name"


def missing_forms(operations, root):
    """Operations one of whose programs is not where they say."""
    for operation, program, path, name in programs(operations, root):
        if not path.exists() or name not in functions(path) | made(path, root):
            yield f"{operation.name}: its program {program} is no {name} in {path.relative_to(root)}"


def mixed_files(operations, root):
    """Bodies of both backends beside code of one, and files named after a backend."""
    for path in sorted(root.rglob("*.py")):
        if path.stem in ("cpu", "cuda", "particle", "node"):
            yield f"{path.relative_to(root)} is not named by what it does"
        if path.stem == "kernels":
            for name in sorted(names_in(tree_of(path)) & {"cuda", "over_rows"}):
                yield f"{path.relative_to(root)} names {name}, which only one backend has"


def arguments(path, name, root):
    """What a program takes, by name: a body without the row's number and the lane, of a named tuple the members."""
    if name in made(path, root):
        return made(path, root)[name].arguments
    node = functions(path)[name]
    names = [n for a in node.args.args if a.arg != "rows" for n in members(path, a.annotation, root) or (a.arg,)]
    found = decorator(node, "kernel", "reduction")
    if found is None:
        return names
    options = {option.arg: option.value for option in getattr(found, "keywords", ())}
    into = [options["into"].value] if "into" in options else []  # which a body does not take
    return [*names[2 if "lanes" in options else 1 :], *into]


def members(path, annotation, root):
    """Names of the members of the named tuple that an annotation names; none of any other."""
    name = getattr(annotation, "id", "")
    for file, _ in ((path, name), *imported(path, root)[1].get(name, ())):
        found = functions(file).get(name)
        if isinstance(found, ast.ClassDef):
            return [part.target.id for part in found.body if isinstance(part, ast.AnnAssign)]
    return []


LISTED = ("neighbours", "liquid_near_walls")


def unequal_signatures(operations, root):
    """Programs that do not name the same arguments, or whose outputs do not stand last.

    Those of a `kernels_cuda` are stages of one whole on a GPU: they also take what the stages before them take.
    """
    taken = {}
    for operation, program, path, name in programs(operations, root):
        taken.setdefault(operation.name, {})[program] = arguments(path, name, root)
    known = {name for found in taken.values() for program in found.values() for name in program}
    for operation in operations:
        found = taken[operation.name]
        reference, cpu, cuda = (found[program] for program in ("numpy", "cpu", "cuda"))
        if cpu != cuda and operation.entry("cuda").module != "kernels_cuda":
            yield f"{operation.name}: its program for the CPU takes {cpu}, that for CUDA {cuda}"
        beside = set(cpu) - set(reference)
        held = {"position"} if "liquid_near_walls" in cpu else set()  # in the list itself
        if not set(reference) - held <= set(cpu) or not beside <= {*LISTED, "scratch", *operation.outputs}:
            yield f"{operation.name}: its reference takes {reference}, the programs {cpu}"
        if not {*operation.adds, *operation.exact} <= set(operation.outputs) or not set(operation.optional) <= set(cpu):
            yield f"{operation.name}: adds, exact or optional name what the programs do not have"
        for program, names in found.items():
            if program != "numpy" and tuple(names[-len(operation.outputs) :]) != operation.outputs:
                yield f"{operation.name}: outputs {operation.outputs} do not stand last in {program}, {names}"
            entry = operation.entry(program)
            if not {*(n.partition(".")[0] for n in entry.work), *(n.rpartition(".")[2] for n in entry.names)} <= known:
                yield f"{operation.name}: {program} names work space or arguments that no program takes"


def wordless(operations, root):
    """Formulas, references and programs whose docstring lacks an equation or a unit, operations that cite nothing."""
    owners = by_folder(operations, root)
    for path in sorted([*root.rglob("formulas.py"), *root.rglob("reference.py"), *root.rglob("operations.py")]):
        listed = {operation.function for operation in owners.get(path.parent, ())}
        apart = path.with_name("operations.py").exists()  # else it is the judge of a search, no equations
        asked = (("unit", UNIT),) if path.stem == "operations" else (("equation", EQUATION), ("unit", UNIT))
        for name, node in functions(path).items():
            equation = path.stem == "reference" and apart and isinstance(node, ast.FunctionDef)
            if decorator(node, "formula") or name in listed or equation:
                words = ast.get_docstring(node) or ""
                for what, pattern in asked:
                    if not pattern.search(words):
                        yield f"{path.relative_to(root)}: the docstring of {name} has no {what}"
    for path in sorted({path for _, program, path, _ in programs(operations, root) if program != "numpy"}):
        for name, node in functions(path).items() if path.exists() else ():
            if not ast.get_docstring(node) and not name.startswith("_"):
                yield f"{path.relative_to(root)}: {name} has no docstring"
    for _, program, path, name in programs(operations, root):
        body = functions(path).get(name) if path.exists() and path.stem == "kernels" else None
        if program in ("cpu", "cuda") and body is not None and not UNIT.search(ast.get_docstring(body) or ""):
            yield f"{path.relative_to(root)}: the docstring of {name} has no unit"
    for operation in operations:
        if not (operation.paper and operation.equation and operation.tolerance_reason):
            yield f"{operation.name} does not give its paper, its equation and the reason for its tolerance"


def overreaching_references(operations, root):
    """References and operations that import more than numpy, math, each other, what sums and what registers."""
    for path in sorted([*root.rglob("reference.py"), *root.rglob("operations.py")]):
        for node in ast.walk(ast.parse(path.read_text())):
            modules = []
            if isinstance(node, ast.Import):
                modules = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                modules = [f"{node.module}.{n.name}" if n.name in JUDGES else node.module for n in node.names]
            for module in modules:
                judge = (module or "").startswith("refsim.") and module.rpartition(".")[2] in JUDGES
                if not judge and module not in ("numpy", "math", *IMPORTED[path.stem]):
                    yield f"{path.relative_to(root)} imports {module}"


WALLLESS = ("lattice_3d", "unequal_masses", "two_particles")


def at_rest(operation, variant, case):
    """The operation's inputs in a case, all velocities zero."""
    inputs = with_variant(Inputs(cases.CASES[case](), "float64"), variant)
    moving = [n for n in operation.arguments("numpy") if n in fields() and fields()[n].unit in ("m/s", "1/s")]
    return inputs.replaced(**{name: 0 * inputs[name] for name in moving if not inputs.dropped(name)})


def virial(operation, variant, case):
    """sum_i m_i a_i.x_i about the centre of mass over the sum of its absolute terms; dimensionless."""
    inputs = at_rest(operation, variant, case)
    mass, position = inputs["mass"][:, None], inputs["position"]
    terms = mass * oracle(operation, inputs)["acceleration"][0] * (position - (mass * position).sum(0) / mass.sum())
    return abs(terms.sum()) / max(np.abs(terms).sum(), 1e-300)


def effects_of(folder):
    """The effects of a folder, or of the next one above it that has any."""
    found = [effect for effect in EFFECTS.values() if f"{effect.__module__}.".startswith(f"{folder}.")]
    return found or (effects_of(folder.rpartition(".")[0]) if folder.count(".") > 1 else [])


def unbalanced_virials(operations, root):
    """Forces between particles at rest whose virial is not zero, and whose effect has no answer to its pressure."""
    cases.discover()
    for operation in operations:
        if "acceleration" not in operation.adds or not {*LISTED} & {*operation.arguments("cpu")}:
            continue
        largest = max(virial(operation, variant, case) for variant in operation.variants for case in WALLLESS)
        if largest > 1e-9 and not any(issubclass(e, PairCohesion) or e.virial for e in effects_of(operation.folder)):
            yield (
                f"{operation.name}: its force between particles at rest has a virial: derive its effect from"
                " refsim.surface_tension.cohesion.PairCohesion, or say in `virial` of the effect why it needs none"
            )


RULES = (
    stray_kernels, missing_forms, mixed_files, unequal_signatures, wordless, overreaching_references,
    unbalanced_virials,
)  # fmt: skip


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.__name__)
def test_rule(rule):
    problems = list(rule(list(REGISTRY.values()), ROOT))
    assert not problems, "\n".join(problems)


@pytest.mark.parametrize("name", REGISTRY)
def test_operation_has_hard_inputs_and_a_closed_form(name):
    cases.discover()
    operation = REGISTRY[name]
    assert len(cases.COMMON) >= 15
    assert set(operation.cases) <= set(cases.CASES)
    assert cases.CLOSED_FORMS.get(name), f"{name} has no closed form in its folder's cases.py"
    assert set(operation.broken) <= set(range(len(operation.variants)))
    for variant in operation.variants:
        assert {key for key, value in variant.items() if value is None} <= set(operation.optional)
    made = contract.bindings(operation, "numpy", "float64", [*cases.COMMON, *operation.cases][-1])
    assert set(made) == set(operation.arguments("numpy"))


def test_what_judges_a_program_is_found_once():
    """A target that gets another smoothing kernel asks again: a sum of parts must not count them twice."""
    for name, operation in REGISTRY.items():
        for program in operation.names():
            once = operation.as_computed_by(program)
            assert once.as_computed_by(program) == once, (name, program)


def test_cases_are_hard():
    """The list of hard inputs of the project holds what its names say."""
    cases.discover()
    made = {name: cases.CASES[name]() for name in cases.COMMON}
    assert {c.dim for c in made.values()} == {2, 3}
    assert {0, 1, 2, 3} <= {c.count for c in made.values()}
    assert any(len(c.wall_position) for c in made.values())
    assert any(not len(c.wall_position) for c in made.values())
    assert {c.support_radius for c in made.values()} >= {1e-6, 1e3}
    for name in ("cloud_2d", "cloud_3d"):
        mass = contract.Inputs(made[name], "float64")["mass"]
        assert mass.max() > 2 * mass.min()
    mass = contract.Inputs(made["unequal_masses"], "float64")["mass"]
    assert mass.max() > 500 * mass.min()
    flung = made["flung_particle"]
    assert abs(flung.position).max() >= 1e6 * flung.spacing
    for dtype in ("float32", "float64"):
        place = {name: contract.Inputs(made[name], dtype)["position"] for name in made}
        assert (place["coincident_pair"][0] == place["coincident_pair"][1]).all()
        gap = abs(place["nearly_coincident"][0] - place["nearly_coincident"][1]).max()
        assert 0 < gap <= 1.01e-12 * made["nearly_coincident"].spacing
        borders = made["on_cell_borders"]
        cell = borders.support_radius * (1 + borders.skin)
        assert (place["on_cell_borders"][:, 0] / cell % 0.5 == 0).all()


def test_import_needs_little_time(tmp_path):
    """Processor time with stored bytecode, because other work on the machine must not count, and without the threads of
    the linear algebra, which wait for work on the processor."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    environment |= {"PYTHONPYCACHEPREFIX": str(tmp_path), "OPENBLAS_NUM_THREADS": "1"}
    spent = []
    for _ in range(8):
        program = "import refsim, time; print(time.process_time())"
        done = subprocess.run(
            [sys.executable, "-c", program], capture_output=True, text=True, check=True, env=environment
        )
        spent.append(float(done.stdout))
        if spent[-1] < IMPORT_SECONDS:
            break
    assert min(spent) < IMPORT_SECONDS
