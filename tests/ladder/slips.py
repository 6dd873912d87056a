"""Injects one slip after another into an operation's programs and asks the contract to notice each.

Run as `NUMBA_DISABLE_JIT=1 python slips.py OPERATION...`: kernels are then Python functions, and a slip is put in by
giving a function the code of its altered source. The operations must share one program. Prints one JSON object, see
`inject`. Kinds: sign, factor, index, condition.
"""

import ast
import contextlib
import copy
import functools
import inspect
import json
import sys
import textwrap
import warnings

import numpy as np

from refsim.contract import Target
from refsim.contract.ladder import climbing, on_case
from refsim.core import cases
from refsim.core.operation import REGISTRY
from refsim.smoothing import SHAPES, formulas, reference, smoothing

SHARED = ("refsim.backends.", "refsim.neighbours.rows")  # what every kernel stands on has tests of its own
FIRST_CASES = ("three_particles", "cloud_2d", "cloud_3d", "printed_readings")
NEGATED = {ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq}
SWAPPED = {
    ast.Add: ("sign", ast.Sub),
    ast.Sub: ("sign", ast.Add),
    ast.Mult: ("factor", ast.Div),
    ast.Div: ("factor", ast.Mult),
}


def functions_behind(operation):
    """The operation's kernel and every function of refsim that it calls, directly or through others."""
    found, waiting = {}, [operation.program("cpu")]
    while waiting:
        function = inspect.unwrap(waiting.pop())
        key = (function.__module__, function.__qualname__)
        if key in found:
            continue
        found[key] = function
        for node in ast.walk(parsed(function)):
            for name in [node.func, *node.args] if isinstance(node, ast.Call) else []:  # some are handed over
                with contextlib.suppress(Exception):
                    called = inspect.unwrap(eval(ast.unparse(name), dict(function.__globals__)))
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
    """(kind, number, change) for every place where something can slip: `change` alters node `number` of a copy."""
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
    other = {"j": "i", "b": "i", "i": "j" if "j" in names else ""}
    for number, node in enumerate(nodes):
        if isinstance(node, (ast.BinOp, ast.AugAssign)) and type(node.op) in SWAPPED:
            kind, replacement = SWAPPED[type(node.op)]
            yield kind, number, lambda n, r=replacement: setattr(n, "op", r())
        elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Subscript):
            yield "sign", number, lambda n: setattr(n, "value", ast.UnaryOp(ast.USub(), n.value))
            if not flags:  # 1.01 is 1 there
                yield "factor", number, lambda n: setattr(n, "value", scaled(n.value))
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            yield "sign", number, lambda n: setattr(n, "op", ast.UAdd())
        elif isinstance(node, ast.Compare) and type(node.ops[0]) in NEGATED:
            yield "condition", number, lambda n: setattr(n, "ops", [NEGATED[type(n.ops[0])]()])
            if isinstance(parents[node], ast.Return):
                yield "factor", number, lambda n: setattr(n, "comparators", [scaled(n.comparators[0])])
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
            if in_index(node):
                yield "index", number, lambda n: setattr(n, "value", (n.value + 1) % 3)
            else:
                yield "factor", number, lambda n: setattr(n, "value", n.value * 1.01 if n.value % 1 else n.value + 1)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and in_index(node) and other.get(node.id):
            yield "index", number, lambda n: setattr(n, "id", other[n.id])


def scaled(node):
    return ast.BinOp(node, ast.Mult(), ast.Constant(1.01))


def altered(function, number, change):
    """Code of the function with one node changed, and the changed line's text."""
    tree = parsed(function)
    node = list(ast.walk(tree))[number]
    line = ast.unparse(copy.deepcopy(statement(tree, node)))
    change(node)
    after = ast.unparse(statement(tree, node))
    tree.body[0].decorator_list = []
    ast.fix_missing_locations(tree)
    space = dict(function.__globals__)
    exec(compile(tree, function.__code__.co_filename, "exec"), space)
    return space[function.__name__].__code__, f"{line.splitlines()[0]}  ->  {after.splitlines()[0]}"


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
    """Smoothing kernels that no operation takes by default are judged as in test_formulas: by their oracle."""
    for shape in SHAPES:
        for dim in (2, 3):
            kernel = smoothing(shape, 0.7, dim)
            r = 0.7 * np.array([0.0, 0.2, 0.4, 0.4999, 0.5001, 0.503, 0.6, 0.9, 1.0, 1.3])
            for name in ("kernel_value", "kernel_slope", "viscosity_laplacian"):
                own = np.array([getattr(formulas, name)(x, kernel) for x in r])
                other = getattr(reference, name)(r, kernel)
                if not np.abs(own - other).max() <= 1e-13 * np.abs(other).max():
                    return False
    return True


@functools.cache
def programs_with():
    """The operations whose programs call a function, by its module and name."""
    found = {}
    for operation in REGISTRY.values():
        for function in functions_behind(operation):
            found.setdefault((function.__module__, function.__qualname__), []).append(operation)
    return found


def noticed(operation, deep):
    """Whether a step of the ladder fails or raises. `deep` takes the steps that need more time."""
    variants = [Target(operation, "cpu", "float64", number) for number in range(len(operation.variants))]
    try:
        if not shapes_agree():
            return True
        for target in variants:
            if not deep and not all(outcome.passed for outcome in climbing(target, ("T1",))):
                return True
        for target in variants:
            for name in (*cases.COMMON, *operation.cases) if deep else FIRST_CASES:
                if not on_case(target, name, lists="all_pairs").passed:
                    return True
            if deep and not all(outcome.passed for outcome in climbing(target, ("T4", "T5", "T7", "T9"))):
                return True
    except Exception:
        return True
    return False


def inject(operations):
    """Every slip that can be made in the program that the operations share.

    {"noticed": {operation: {kind: number}}, "survived": [slips that no operation with the same function notices]}
    """
    for operation in operations:
        assert not noticed(operation, False), f"{operation.name} fails before any slip"
        assert not noticed(operation, True), f"{operation.name} fails before any slip"
    users = programs_with()  # while every function's source can still be read
    caught = {operation.name: {} for operation in operations}
    survived = []
    for function in functions_behind(operations[0]):
        right = function.__code__
        for kind, number, change in sites(parsed(function), bool(operations[0].exact)):
            code, words = altered(function, number, change)
            function.__code__ = code
            try:
                by = [operation for operation in operations if noticed(operation, False)]
                for operation in by:
                    caught[operation.name][kind] = caught[operation.name].get(kind, 0) + 1
                others = [o for o in users[function.__module__, function.__qualname__] if o not in operations]
                if not by and not any(
                    noticed(operation, deep)
                    for among, deep in ((operations, True), (others, False), (others, True))
                    for operation in among
                ):
                    survived.append(f"{function.__name__}: {words}")
            finally:
                function.__code__ = right
    return {"noticed": caught, "survived": survived}


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    cases.discover()
    print(json.dumps(inject([REGISTRY[name] for name in sys.argv[1:]])))
