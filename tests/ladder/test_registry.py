"""Rules: every kernel is tested against a reference, every program and docstring is there, no virial is unbalanced."""

import ast
import functools
import importlib
import inspect
import pathlib
import re
import sys
import types

import numpy as np
import pytest

import refsim
from refsim import contract
from refsim.backends.compile import CudaKernel, Kernel
from refsim.contract.bounds import oracle
from refsim.contract.inputs import Inputs, fields, with_variant
from refsim.core import cases
from refsim.core.effect import EFFECTS
from refsim.core.operation import REGISTRY
from refsim.surface_tension.cohesion import PairCohesion
from tests.running import python

ROOT = pathlib.Path(refsim.__file__).parent
IMPORT_SECONDS = 0.3
JUDGES = ("reference", "operations")  # modules: equations; what registers them and sums
IMPORTED = {  # by them, beside each other, numpy and math
    "reference": ("refsim.core.terms",),
    "operations": ("typing", "refsim.core.operation", "refsim.core.terms", "refsim.neighbours.sums"),
}
UNIT = re.compile(r"\[[^\]]*\]|dimensionless|flags?\b", re.IGNORECASE)
EQUATION = re.compile(r"=|[<>]|\bsum_|\b[A-Z]\(\d+\)")


def modules(root):
    """(file, module) of a package's folder; examples and what runs by itself are left out."""
    for path in sorted(root.rglob("*.py")):
        words = path.relative_to(root.parent).with_suffix("").parts
        if "examples" not in words and words[-1] != "__main__":
            yield path.relative_to(root), importlib.import_module(".".join(words).removesuffix(".__init__"))


def plain(thing):
    """The function that a kernel, a program or a function with a cache is made of; any other thing as it is."""
    return inspect.unwrap(getattr(thing, "py_func", thing)) if callable(thing) else thing


def own(module):
    """{name: thing} of the functions, classes and kernels of a module."""
    return {n: v for n, v in vars(module).items() if getattr(plain(v), "__module__", None) == module.__name__}


def named(code):
    """Names in the code of a function and of those within it."""
    return {*code.co_names}.union(*(named(part) for part in code.co_consts if isinstance(part, types.CodeType)))


def inside(thing):
    """What a function names, a class has, and a container holds."""
    if inspect.isclass(thing):
        return [getattr(value, "__func__", getattr(value, "fget", value)) for value in vars(thing).values()]
    if isinstance(thing, dict | list | tuple | set | frozenset):
        return list(thing.values() if isinstance(thing, dict) else thing)
    if isinstance(thing, functools.partial):
        return [thing.func, *thing.args]
    if not inspect.isfunction(thing):
        return []
    names, known = named(thing.__code__), thing.__globals__
    found = [*(known[n] for n in names & known.keys()), *(sys.modules[n] for n in names & sys.modules.keys())]
    for home in found:  # also what is imported within a function
        if inspect.ismodule(home) and home.__name__.startswith("refsim"):
            found += [getattr(home, name) for name in names if hasattr(home, name)]
    return found + [cell.cell_contents for cell in thing.__closure__ or ()]


def reached(roots):
    """What the roots reach, directly or through others: {identity: thing}."""
    waiting, seen = list(roots), {}
    while waiting:
        thing = plain(waiting.pop())
        if id(thing) not in seen:
            seen[id(thing)] = thing
            waiting += inside(thing)
    return seen


def stray_kernels(operations, root):
    """Kernels that no program of an operation and no run reaches."""
    there = list(modules(root))
    found = reached([*(o.program(name) for o in operations for name in o.names()), refsim.Simulation])
    names = set().union(*(named(thing.__code__) for thing in found.values() if inspect.isfunction(thing)))
    for path, module in there:
        kept = names if id(module) in found else ()  # of a module that an object keeps
        for name, thing in own(module).items():
            kernel = isinstance(thing, Kernel | CudaKernel) or hasattr(thing, "py_func")
            if kernel and (thing.__name__ != name or (id(plain(thing)) not in found and name not in kept)):
                yield f"{path}: nothing reaches kernel {name}, or it has another name"


def mixed_files(operations, root):
    """Bodies of both backends beside code of one, and files named after a backend."""
    for path, module in modules(root):
        if path.stem in ("cpu", "cuda", "particle", "node"):
            yield f"{path} is not named by what it does"
        if path.stem == "kernels":
            for name in sorted(vars(module).keys() & {"cuda", "over_rows"}):
                yield f"{path} names {name}, which only one backend has"


LISTED = ("neighbours", "liquid_near_walls")


def unequal_signatures(operations, root):
    """Programs that do not name the same arguments, or whose outputs do not stand last.

    Those of a `kernels_cuda` are stages of one whole on a GPU: they also take what the stages before them take.
    """
    taken = {o.name: {program: list(o.arguments(program)) for program in o.names()} for o in operations}
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
    listed = {(o.folder, o.function) for o in operations}
    holding = {f"{o.entry(p).folder or o.folder}.{o.entry(p).module}" for o in operations for p in o.names()[1:]}
    for path, module in modules(root):
        folder = module.__name__.rpartition(".")[0]
        apart = path.with_name("operations.py")  # without it a reference judges a search, and has no equations
        for name, thing in own(module).items():
            words = inspect.getdoc(plain(thing)) or ""
            equation = path.stem == "reference" and (root / apart).exists() and inspect.isfunction(thing)
            formula = path.stem in ("formulas", *JUDGES) and hasattr(thing, "ordered")
            program = path.stem in ("formulas", *JUDGES) and (folder, name) in listed
            if formula or equation or program:
                if not UNIT.search(words):
                    yield f"{path}: the docstring of {name} has no unit"
                if path.stem != "operations" and not EQUATION.search(words):
                    yield f"{path}: the docstring of {name} has no equation"
            body = isinstance(thing, Kernel) and path.stem == "kernels" and (folder, name) in listed
            if module.__name__ in holding and not words and not name.startswith("_"):
                yield f"{path}: {name} has no docstring"
            elif body and not UNIT.search(words):
                yield f"{path}: the docstring of {name} has no unit"
    for operation in operations:
        if not (operation.paper and operation.equation and operation.reason):
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


RULES = (stray_kernels, mixed_files, unequal_signatures, wordless, overreaching_references, unbalanced_virials)


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
    own = {"PYTHONPYCACHEPREFIX": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "", "OPENBLAS_NUM_THREADS": "1"}
    spent = []
    for _ in range(8):
        spent.append(float(python("-c", "import refsim, time; print(time.process_time())", **own).stdout))
        if spent[-1] < IMPORT_SECONDS:
            break
    assert min(spent) < IMPORT_SECONDS
