"""Injects one slip after another into an operation's programs and asks the contract to notice each.

Run as `NUMBA_DISABLE_JIT=1 python slips.py OPERATION...`: kernels are then Python functions, and a slip is put in by
giving a function the code of its altered source: another sign, factor, index or condition. The operations must share
one program. Prints the slips that no trial notices as a JSON list.
"""

import argparse
import ast
import contextlib
import copy
import functools
import inspect
import itertools
import json
import math
import pathlib
import signal
import sys
import textwrap
import time
import tomllib
import warnings
from unittest import mock

import numpy as np

from refsim.backends.fast import rows
from refsim.contract import Target
from refsim.contract.answers import on_case
from refsim.contract.bounds import takes_neighbours
from refsim.contract.programs import climb
from refsim.core import cases
from refsim.core.errors import RunStopped
from refsim.core.operation import REGISTRY
from refsim.mpm.grid import MpmGrid
from refsim.smoothing import SHAPES, formulas, reference, smoothing
from refsim.sparse_grid import block_search

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
from tests.running import python  # noqa: E402

SECONDS = {False: 60, True: 600}  # of processor time, after which a slip has made a trial (shallow, deep) endless
PATIENCE = 10.0  # times the processor time without a slip, plus a second: likewise
SHARED = (
    "refsim.backends.",
    "refsim.neighbours.forces",
    "refsim.neighbours.pairs",
    "refsim.neighbours.rows",
)  # have tests of their own
FIRST_CASES = ("three_particles", "cloud_2d", "cloud_3d", "printed_readings")
HARMLESS = tomllib.loads(pathlib.Path(__file__).with_name("harmless.toml").read_text())  # slips, and why

NEGATED = {ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq}
SWAPPED = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult}


def functions_behind(operation):
    """The operation's kernel and every function of refsim that it names, directly or through others."""
    found, waiting = {}, [operation.program("cpu")]
    while waiting:
        function = inspect.unwrap(waiting.pop())
        key = (function.__module__, function.__qualname__)
        if key in found:
            continue
        found[key] = function
        for node in ast.walk(parsed(function)):
            if not isinstance(node, (ast.Name, ast.Attribute)):  # some are handed over, or chosen
                continue
            with contextlib.suppress(Exception):
                called = inspect.unwrap(eval(ast.unparse(node), dict(function.__globals__)))
                if (
                    inspect.isfunction(called)
                    and called.__module__.startswith("refsim.")
                    and not called.__module__.startswith(SHARED)
                ):
                    waiting.append(called)
    return list(found.values())


def parsed(function):
    return ast.parse(textwrap.dedent(inspect.getsource(function)))


def sites(tree, flags=False):
    """(number, change) for every place where something can slip: `change` alters node `number` of a copy."""
    nodes = list(ast.walk(tree))
    parents = {child: node for node in nodes for child in ast.iter_child_nodes(node)}

    def in_index(node):
        while node in parents:
            above = parents[node]
            if isinstance(above, ast.Subscript) and node is above.slice:
                return True
            if isinstance(above, ast.stmt):
                return False
            node = above
        return False

    names = {n.id for n in nodes if isinstance(n, ast.Name)}
    taken = {n.arg for n in nodes if isinstance(n, ast.arg)}
    other = {"j": "i", "b": "i", "i": "j" if "j" in names else ""}
    skipped = {part for node in nodes if of_type(node) for part in ast.walk(node)}  # of which only the type is taken
    skipped |= {part for node in getattr(tree.body[0], "decorator_list", ()) for part in ast.walk(node)}  # left out
    for number, node in enumerate(nodes):
        if node in skipped:
            continue
        if isinstance(node, (ast.BinOp, ast.AugAssign)) and type(node.op) in SWAPPED:
            yield number, lambda n: setattr(n, "op", SWAPPED[type(n.op)]())
        elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Subscript) and not zero(node.value):
            yield number, lambda n: setattr(n, "value", ast.UnaryOp(ast.USub(), n.value))
            if not flags:  # 1.01 is 1 there
                yield number, lambda n: setattr(n, "value", scaled(n.value))
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            yield number, lambda n: setattr(n, "op", ast.UAdd())
        elif isinstance(node, ast.Compare) and type(node.ops[0]) in NEGATED:
            yield number, lambda n: n.ops.__setitem__(0, NEGATED[type(n.ops[0])]())
            if isinstance(parents[node], ast.Return):
                yield number, lambda n: setattr(n, "comparators", [scaled(n.comparators[0])])
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
            if in_index(node):
                yield number, lambda n: setattr(n, "value", (n.value + 1) % 3)
            else:
                yield number, lambda n: setattr(n, "value", n.value * 1.01 if n.value % 1 else n.value + 1)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and in_index(node) and other.get(node.id):
            yield number, lambda n: setattr(n, "id", other[n.id])
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and partner(node.id) in taken:
            yield number, lambda n: setattr(n, "id", partner(n.id))


def of_type(node):
    return isinstance(node, ast.Call) and ast.unparse(node.func) == "type"


def zero(node):
    """Whether a node is zero, of some type; it has no sign and no size."""
    (value,) = node.args if isinstance(node, ast.Call) and len(node.args) == 1 else (node,)
    return ast.unparse(value) in ("0", "zero") and not isinstance(getattr(node, "func", None), ast.Attribute)


def partner(name):
    """The other particle's field: velocity_j for velocity_i."""
    return {"_i": name[:-2] + "_j", "_j": name[:-2] + "_i"}.get(name[-2:])


def scaled(node):
    return ast.BinOp(node, ast.Mult(), ast.Constant(1.01))


def altered(function, number, change):
    """Code of the function with one node changed, and the changed line's text."""
    tree = parsed(function)
    node = list(ast.walk(tree))[number]
    line = ast.unparse(copy.deepcopy(statement(tree, node)))
    change(node)
    after = ast.unparse(statement(tree, node))
    return code_of(function, tree), f"{line.splitlines()[0]}  ->  {after.splitlines()[0]}"


def code_of(function, tree):
    """Code of the function with another source."""
    tree.body[0].decorator_list = []
    space = dict(function.__globals__)
    exec(compile(ast.fix_missing_locations(tree), function.__code__.co_filename, "exec"), space)
    return space[function.__name__].__code__


def statement(tree, node):
    """The smallest statement around a node, without what is nested in it."""
    around = [s for s in ast.walk(tree) if isinstance(s, ast.stmt) and any(part is node for part in ast.walk(s))]
    best = min(around, key=lambda s: len(list(ast.walk(s))))
    if isinstance(best, (ast.If, ast.While)):
        return ast.Expr(best.test)
    if isinstance(best, ast.For):
        return ast.Expr(best.iter)
    return best


def shapes_agree():
    """Smoothing kernels that no operation takes by default are judged by their oracle."""
    for shape in SHAPES:
        for dim in (2, 3):
            kernel = smoothing(shape, 0.7, dim)
            r = 0.7 * np.array([0.0, 0.2, 0.3, 0.3333, 0.3334, 0.4, 0.4999, 0.5001, 0.503, 0.6, 0.9, 1.0, 1.3])
            for name in ("kernel_value", "kernel_slope", "viscosity_laplacian"):
                own = np.array([getattr(formulas, name)(x, kernel) for x in r])
                other = getattr(reference, name)(r, kernel)
                if not np.abs(own - other).max() <= 1e-13 * np.abs(other).max():
                    return False
    return True


def far_points_stop():
    """Points beyond all blocks and at no place stop a run, as in test_mpm; a trial of the contract has an answer."""
    for far in (1e9, -1e9, np.nan):
        grid = MpmGrid(3, "float64", 2.0)
        try:
            REGISTRY["mpm.cells"].program("cpu")(np.array([[1.0, far, 1.0]]), None, None, grid, np.empty(1, np.int32))
        except RunStopped:
            continue
        return False
    return True


@functools.cache
def programs_with():
    """The operations whose programs call a function, by its name. Those that take the grid have it sort its points."""
    found = {}
    for operation in REGISTRY.values():
        sorting = [REGISTRY["mpm.cells"]] if "grid" in operation.arguments("cpu") else []
        for name in {key(f) for user in (operation, *sorting) for f in functions_behind(user)}:
            found.setdefault(name, []).append(operation)
    return found


def key(function):
    """Name of a function, with its module."""
    return f"{function.__module__}.{function.__qualname__}"


@contextlib.contextmanager
def backwards():
    """Loops of threads run from their last part to the first, points are sorted in chunks of one: no answer changes."""

    def reverse(*ends):
        return reversed(range(*ends))

    backwards_rows = mock.patch.object(rows, "range", reverse, create=True)
    with backwards_rows, mock.patch.object(block_search, "LEAST_CHUNK", 1):
        yield


def noticed(operation, deep, seconds=math.inf):
    """Whether a step of the ladder fails, raises or takes `seconds`. `deep` takes the steps that need more time."""
    variants = [Target(operation, "cpu", "float64", number) for number in range(len(operation.variants))]
    signal.setitimer(signal.ITIMER_PROF, min(seconds, SECONDS[deep]))
    try:
        if not shapes_agree() or (operation.name == "mpm.cells" and not far_points_stop()):
            return True
        for target in variants:
            if not deep and not all(outcome.passed for outcome in climb(target, ("T1",))):
                return True
        for target in variants:
            dense = ["dense_cluster"] * (deep and takes_neighbours(operation))
            for name in (*cases.COMMON, *operation.cases, *dense) if deep else FIRST_CASES:
                if not on_case(target, name, lists="all_pairs").passed:
                    return True
            if deep and not all(outcome.passed for outcome in climb(target, ("T4", "T5", "T7", "T9"))):
                return True
        if deep:
            with backwards():
                return not all(
                    on_case(target, name, lists="all_pairs").passed
                    for target in variants
                    for name in ("cloud_2d", "cloud_3d")
                )
    except Exception:
        return True
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    return False


def too_long(number, frame):
    raise TimeoutError("this trial does not end")


def planted(operation):
    """(function, number, change) for every slip of an operation's program."""
    for function in functions_behind(operation):
        for site in sites(parsed(function), bool(operation.exact)):
            yield function, *site


def inject(operations):
    """Slips of the program that the operations share which no operation with the same function notices.

    Slips that change no answer are looked for in few cases only.
    """
    limits = {}
    for operation, deep in itertools.product(operations, (False, True)):
        begun = time.process_time()
        assert not noticed(operation, deep), f"{operation.name} fails before any slip"
        limits[operation.name, deep] = 1 + PATIENCE * (time.process_time() - begun)
    users = programs_with()  # while every function's source can still be read
    survived = []
    for function, number, change in list(planted(operations[0])):
        right, others = function.__code__, [o for o in users[key(function)] if o not in operations]
        code, words = altered(function, number, change)
        slip = f"{function.__name__}: {words}"
        steps = ((operations, False), (others, False), (operations, True), (others, True))
        function.__code__ = code
        try:
            if not any(
                noticed(operation, deep, limits.get((operation.name, deep), math.inf))
                for among, deep in (steps[:2] if harmless(slip) else steps)
                for operation in among
            ):
                survived.append(slip)
        finally:
            function.__code__ = right
    return survived


def harmless(slip):
    """Whether a slip is known to change no answer."""
    return slip.startswith(tuple(HARMLESS))


def programs():
    """Names of the operations that share a program, by program."""
    found = {}
    for name, operation in REGISTRY.items():
        found.setdefault((operation.folder, operation.function), []).append(name)
    return list(found.values())


def judged(names):
    """`inject` in a process of its own."""
    return json.loads(python(__file__, *names, NUMBA_DISABLE_JIT="1").stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("operations", nargs="*", metavar="OPERATION", help="operations that share one program")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    cases.discover()
    signal.signal(signal.SIGPROF, too_long)
    print(json.dumps(inject([REGISTRY[name] for name in given.operations])))


if __name__ == "__main__":
    main()
