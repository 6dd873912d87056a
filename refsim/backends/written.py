"""A kernel written out as a file of its own: a plain loop over the rows, and the functions that it calls.

The text names Numba's public decorators and nothing of refsim. It is written for arguments of certain kinds: what is
None there, and what only then acts, is left out, and so are lanes and smoothing kernels other than the chosen one.
`refsim show OPERATION --backend cpu` prints it with an example, and a run with REFSIM_PLAIN=1 compiles it.
"""

import ast
import builtins
import functools
import inspect
import json
import linecache
import math
import operator
import re
import textwrap
import types
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np

WIDTH = 100
NUMBER, UNCLEAR = "number", "number or None"  # kinds, beside Known, Array and Group
HEAD = {
    "cpu": "from numba import njit, prange\n\nFAST = {fast}  # sums in any order, so that loops vectorise",
    "cuda": "from numba import cuda",
}
ARRAY_MAKERS = (np.empty, np.zeros, np.ones, np.full)
COMPARED: dict[type, Callable[[Any, Any], bool]] = {
    ast.Is: operator.is_, ast.IsNot: operator.is_not, ast.Eq: operator.eq, ast.NotEq: operator.ne, ast.Lt: operator.lt,
    ast.LtE: operator.le, ast.Gt: operator.gt, ast.GtE: operator.ge,
}  # fmt: skip


class NotPlain(Exception):
    """What a kernel names cannot be written out."""


class Known(NamedTuple):
    """A value that is known where the text is written; a `fixed` one (None, a length, a function) is not passed on."""

    value: Any
    fixed: bool = True


class Array(NamedTuple):
    """An array of so many dimensions."""

    ndim: int


class Group(NamedTuple):
    """A tuple; `names` are those of a named one's members, `made` is its class."""

    parts: tuple[Any, ...]
    names: tuple[str, ...] = ()
    tuple_class: Any = None


NONE = Known(None)


def kind_of(value: Any) -> Any:
    """The kind of an argument."""
    if value is None:
        return NONE
    if hasattr(value, "numbered") and isinstance(value.shape, tuple):
        return Group(
            tuple(Known(len(v)) if isinstance(v, tuple) else NUMBER for v in value), value._fields, type(value)
        )
    if isinstance(value, tuple):
        return Group(tuple(map(kind_of, value)), getattr(value, "_fields", ()), type(value))
    return Array(value.ndim) if getattr(value, "ndim", 0) else NUMBER


def is_fixed(kind: Any) -> bool:
    """Whether a value of this kind is not passed on."""
    return isinstance(kind, Known) and kind.fixed


def holds_arrays(kind: Any) -> bool:
    """Whether a value of this kind is an array or a tuple with one."""
    return isinstance(kind, Array) or (isinstance(kind, Group) and any(map(holds_arrays, kind.parts)))


def merged(kinds: Iterable[Any]) -> Any:
    """The kind of what is one of these."""
    groups: list[Any] = list(
        dict.fromkeys(NUMBER if isinstance(kind, Known) and not kind.fixed else kind for kind in kinds)
    )
    if len(groups) == 1:
        return groups[0]
    if groups and all(isinstance(kind, Group) and len(kind.parts) == len(groups[0].parts) for kind in groups):
        return Group(tuple(map(merged, zip(*(kind.parts for kind in groups)))), groups[0].names)
    return UNCLEAR if NONE in groups or UNCLEAR in groups or not groups else NUMBER


class Source(NamedTuple):
    """A function as it stands in its file."""

    tree: ast.FunctionDef
    space: dict[str, Any]
    assigned: frozenset[str]  # names that are assigned once


@functools.cache
def source_of(function: Callable) -> Source:
    """The source of a function, without its decorators."""
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(function))).body
    if not isinstance(tree, ast.FunctionDef):
        raise NotPlain(function.__name__)
    tree.decorator_list = []
    stored = [node.id for node in ast.walk(tree) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)]
    return Source(tree, function.__globals__, frozenset(name for name in stored if stored.count(name) == 1))


def function_of(text: str, name: str, path: str, space: dict[str, Any]) -> Any:
    """The function of this name of a text, which `inspect` and tracebacks find under `path`; `space` is around it."""
    linecache.cache[path] = (len(text), None, text.splitlines(keepends=True), path)
    exec(compile(text, path, "exec"), space)
    return space[name]


class Named:
    """What stands in the text under a name that is chosen at the end, when all local names are known."""

    def __init__(self, wanted: str, value: Any = None) -> None:
        self.wanted, self.value, self.nodes = wanted, value, list[Any]()
        self.locals: set[str] = set()
        self.takes_arrays = False
        self.tree: ast.FunctionDef | None = None
        self.result: Any = NUMBER

    def node(self) -> ast.Name:
        """The name where it is used."""
        self.nodes.append(ast.Name(self.wanted, ast.Load()))
        return self.nodes[-1]


class Writer:
    """The functions, constants and classes of one text, in the order in which they must stand."""

    def __init__(self, backend: str) -> None:
        self.backend, self.written_parts, self.order = backend, dict[Any, Named](), list[Named]()

    def function(self, function: Callable, kinds: dict[str, Any], wanted: str) -> Named:
        """A function for arguments of these kinds."""
        key = (function, tuple(kinds.items()))
        if key not in self.written_parts:
            made = self.written_parts[key] = Named(wanted, function)
            made.takes_arrays = any(map(holds_arrays, kinds.values()))
            body = Body(self, source_of(function), kinds)
            made.tree, made.result, made.locals = body.written(), body.result, body.locals
            self.order.append(made)
        return self.written_parts[key]

    def constant(self, name: str, value: Any) -> Named:
        """A number, a tuple or a table of them, or a class."""
        key = (name, value.tobytes() if isinstance(value, np.ndarray) else value)
        if key not in self.written_parts:
            self.written_parts[key] = Named(name, value)
            self.order.append(self.written_parts[key])
        return self.written_parts[key]

    def text(self, fast: Iterable[str], example: str) -> str:
        """The whole text, and an example behind it."""
        used = self._used()
        self.order = [named for named in self.order if id(named) in used]
        taken = {"np", "math", "njit", "prange", "cuda", "FAST", "NamedTuple", *vars(builtins)}
        for named in reversed(self.order):
            name, more = named.wanted, 2
            while name in taken | used[id(named)]:
                name, more = f"{named.wanted}_{more}", more + 1
            taken.add(name)
            named.wanted = name
            for node in named.nodes:
                node.id = name
        parts = [HEAD[self.backend].format(fast="{" + json.dumps(sorted(fast))[1:-1] + "}")]
        parts += ["\n".join(self._constants())] if self._constants() else []
        parts += ["\n" + class_text(named.value) for named in self.order if isinstance(named.value, type)]
        parts += ["\n" + self._function(named) for named in self.order if named.tree is not None]
        body = "\n\n".join([*parts, *(["\n" + example.rstrip()] if example else [])])
        lines = {"math.": "import math", "(NamedTuple)": "from typing import NamedTuple", "np.": "\nimport numpy as np"}
        head = "\n".join(line for word, line in lines.items() if word in body)
        return f"{head}\n{'' if 'np.' in body else chr(10) * bool(head)}{body}\n".lstrip()

    def _used(self) -> dict[int, set[str]]:
        """Of what the text needs, by its id, the local names of the functions that use it."""
        of = {id(node): named for named in self.order for node in named.nodes}
        used, waiting = {id(self.order[-1]): set[str]()}, [self.order[-1]]
        while waiting:
            user = waiting.pop()
            for named in [of[id(n)] for n in ast.walk(user.tree) if id(n) in of] if user.tree else []:
                if id(named) not in used:
                    waiting.append(named)
                used.setdefault(id(named), set()).update(user.locals)
        return used

    def _constants(self) -> list[str]:
        simple = [n for n in self.order if n.tree is None and not isinstance(n.value, type)]
        return [wrapped_line(f"{named.wanted} = {literal(named.value)}") for named in simple]

    def _function(self, named: Named) -> str:
        assert named.tree is not None
        named.tree.name = named.wanted
        text = ast.unparse(ast.fix_missing_locations(named.tree))
        exact = getattr(named.value, "ordered", False)
        # A call of a function that is not inlined counts references to its arrays, one by one, and between threads.
        how = "parallel=True, " if "prange(" in text else "forceinline=True, " * named.takes_arrays
        options = {
            "cpu": f'@njit({how}{"fastmath=FAST, " * (not exact)}error_model="numpy")',
            "cuda": "@cuda.jit" if named is self.order[-1] else "@cuda.jit(device=True)",
        }
        head, quotes, docstring = text.partition('"""')
        docstring, end, code = docstring.partition('"""')
        return "\n".join(
            [options[self.backend], _wrapped_lines(head) + quotes + docstring + end + _wrapped_lines(code)]
        )


class Body:
    """One function for arguments of certain kinds."""

    def __init__(self, writer: Writer, source: Source, kinds: dict[str, Any]) -> None:
        self.writer, self.source, self.kinds = writer, source, dict(kinds)
        self.argument_kinds, self.returned = kinds, list[Any]()
        self.locals = set(kinds)

    def written(self) -> ast.FunctionDef:
        """The function without the arguments that are not passed on."""
        tree = self.source.tree
        kept = [ast.arg(a.arg) for a in tree.args.args if not is_fixed(self.argument_kinds[a.arg])]
        body = self.block(tree.body)
        return ast.FunctionDef(tree.name, ast.arguments([], kept, None, [], [], None, []), body, [])

    @property
    def result(self) -> Any:
        """The kind of what it returns."""
        same = len(set(self.returned)) == 1 and isinstance(self.returned[0], Known)
        return self.returned[0] if same else merged(self.returned) if self.returned else NUMBER

    # Statements

    def block(self, statements: Iterable[ast.stmt]) -> list[Any]:
        """The statements of a block."""
        return self.statements(statements) or [ast.Pass()]

    def statements(self, statements: Iterable[ast.stmt]) -> list[Any]:
        """Statements, up to the first that leaves the block."""
        body: list[ast.stmt] = []
        for statement in statements:
            body += getattr(self, f"do_{type(statement).__name__}", self.unknown)(statement)
            if body and isinstance(body[-1], (ast.Return, ast.Break, ast.Continue)):
                break
        return body

    def unknown(self, node: ast.AST) -> Any:
        """What no kernel has."""
        raise NotPlain(f"{type(node).__name__}: {ast.unparse(node)}")

    def do_Expr(self, node: ast.Expr) -> list[Any]:
        if isinstance(node.value, ast.Constant):
            return [node]
        if isinstance(node.value, ast.Call) and isinstance(node.value.func, ast.Name):
            function = self.value_of(node.value.func)
            if getattr(function, "written", None) == "loop":
                return self.looped(*node.value.args)
        return [ast.Expr(self.value(node.value)[0])]

    def looped(self, body: ast.expr, rows: ast.expr, arguments: ast.expr) -> list[Any]:
        """The loop of `over_rows`. Numba's parallel loops take no tuples of tuples: these are made within."""
        count, (_, group) = self.value(rows)[0], self.value(arguments)
        assert isinstance(arguments, ast.Tuple)
        self.kinds["i"] = NUMBER
        self.locals.add("i")
        before: list[Any] = []
        values = [self.unpacked(self.value(node)[0], kind, before) for node, kind in zip(arguments.elts, group.parts)]
        function = self.value_of(body)
        call, _ = self.called(function, [(ast.Name("i", ast.Load()), NUMBER), *zip(values, group.parts)])
        rows_of = ast.Call(ast.Name("prange", ast.Load()), [count], [])
        return [*before, ast.For(ast.Name("i", ast.Store()), rows_of, [ast.Expr(call)], [])]

    def unpacked(self, value: ast.expr, kind: Any, before: list[Any]) -> Any:
        """A tuple of tuples, or a member of one, as what makes it of numbers and arrays, taken `before` the loop."""
        if is_fixed(kind):
            return ast.Constant(kind.value)
        flat = not isinstance(kind, Group) or not any(isinstance(part, Group) for part in kind.parts)
        if flat and isinstance(value, ast.Name):
            return value
        if flat and not (isinstance(kind, Group) and kind.names):
            name = re.sub(r"\W+", "_", ast.unparse(value)).strip("_")
            self.locals.add(name)
            before.append(ast.Assign([ast.Name(name, ast.Store())], value))
            return ast.Name(name, ast.Load())
        members: list[ast.expr] = [ast.Attribute(value, name, ast.Load()) for name in kind.names]
        members = members or [ast.Subscript(value, ast.Constant(k), ast.Load()) for k in range(len(kind.parts))]
        parts = [self.unpacked(member, part, before) for member, part in zip(members, kind.parts)]
        if not kind.names:
            return ast.Tuple(parts, ast.Load())
        return ast.Call(self.writer.constant(kind.tuple_class.__name__, kind.tuple_class).node(), parts, [])

    def do_Assign(self, node: ast.Assign) -> list[Any]:
        value, kind = self.value(node.value)
        target = node.targets[0]
        if len(node.targets) > 1:
            return [ast.Assign([self.stored(target, NUMBER) for target in node.targets], value)]
        if isinstance(target, ast.Name) and is_fixed(kind) and target.id in self.source.assigned:
            self.kinds[target.id] = kind
            return []
        stored = self.stored(target, kind)
        return [] if ast.unparse(stored) == ast.unparse(value) else [ast.Assign([stored], value)]

    def stored(self, target: ast.expr, kind: Any) -> Any:
        """The target of an assignment of what has this kind."""
        if isinstance(target, ast.Name):
            self.locals.add(target.id)
            once = target.id in self.source.assigned
            self.kinds[target.id] = kind if once or not isinstance(kind, Known) else merged([kind, NUMBER])
            if isinstance(kind, Known) and not kind.fixed:
                self.kinds[target.id] = NUMBER
            return target
        if isinstance(target, ast.Tuple):
            whole = isinstance(kind, Group) and len(kind.parts) == len(target.elts)
            kinds = kind.parts if whole else [NUMBER] * len(target.elts)
            return ast.Tuple([self.stored(part, kind) for part, kind in zip(target.elts, kinds)], ast.Store())
        target_node = self.value(target)[0]
        target_node.ctx = ast.Store()
        return target_node

    def do_AugAssign(self, node: ast.AugAssign) -> list[Any]:
        value = self.value(node.value)[0]
        if isinstance(node.target, ast.Name):
            return [ast.AugAssign(node.target, node.op, value)]
        return [ast.AugAssign(self.stored(node.target, NUMBER), node.op, value)]

    def do_If(self, node: ast.If) -> list[Any]:
        test, kind = self.value(node.test)
        if isinstance(kind, Known):
            return self.statements(node.body if kind.value else node.orelse)
        before = dict(self.kinds)
        body = self.block(node.body)
        after, self.kinds = self.kinds, before
        other = self.block(node.orelse) if node.orelse else []
        names = {**after, **self.kinds}
        self.kinds = {n: merged([s[n] for s in (after, self.kinds) if n in s]) for n in names}
        return [ast.If(test, body, other)]

    def do_For(self, node: ast.For) -> list[Any]:
        over, kind = self.value(node.iter)
        target = self.stored(node.target, merged(kind.parts) if isinstance(kind, Group) else NUMBER)
        return [ast.For(target, over, self.block(node.body), [])]

    def do_While(self, node: ast.While) -> list[Any]:
        return [ast.While(self.value(node.test)[0], self.block(node.body), [])]

    def do_Return(self, node: ast.Return) -> list[Any]:
        value, kind = (None, NUMBER) if node.value is None else self.value(node.value)
        self.returned.append(kind)
        return [ast.Return(value)]

    def do_Break(self, node: ast.stmt) -> list[Any]:
        return [node]

    do_Continue = do_Break

    # Expressions: (what is written, its kind)

    def value(self, node: ast.expr) -> tuple[Any, Any]:
        """An expression."""
        expression, kind = getattr(self, f"of_{type(node).__name__}", self.unknown)(node)
        if is_fixed(kind) and (kind.value is None or isinstance(kind.value, (bool, int))):
            expression = ast.Constant(kind.value)
        elif is_fixed(kind) and getattr(kind.value, "__module__", "") in ("numpy", "math", "builtins"):
            place = {"numpy": "np.", "math": "math.", "builtins": ""}[kind.value.__module__]
            expression = ast.Name(place + kind.value.__name__, ast.Load())
        return expression, kind

    def value_of(self, node: ast.expr) -> Any:
        """What an expression stands for, if that is known."""
        kind = self.value(node)[1]
        return kind.value if isinstance(kind, Known) else None

    def of_Constant(self, node: ast.Constant) -> tuple[Any, Any]:
        return node, NONE if node.value is None else Known(node.value, False)

    def of_Name(self, node: ast.Name) -> tuple[Any, Any]:
        if node.id in self.kinds:
            return ast.Name(node.id, ast.Load()), self.kinds[node.id]
        if node.id in self.source.space:
            return self.outside(node.id, self.source.space[node.id])
        return ast.Name(node.id, ast.Load()), Known(getattr(builtins, node.id))

    def outside(self, name: str, value: Any) -> tuple[Any, Any]:
        """What stands outside of functions."""
        if value is None:
            return ast.Constant(None), NONE
        if isinstance(value, types.ModuleType):
            short = {"numpy": "np", "math": "math"}.get(value.__name__, "cuda")
            return ast.Name(short, ast.Load()), Known(value)
        if callable(value):
            return ast.Name(name, ast.Load()), Known(value)
        if isinstance(value, (int, float, np.generic)):
            return self.writer.constant(name, value).node(), Known(value, False)
        if isinstance(value, (tuple, np.ndarray)):
            return self.writer.constant(name, value).node(), kind_of(value)
        raise NotPlain(name)

    def of_Attribute(self, node: ast.Attribute) -> tuple[Any, Any]:
        base, kind = self.value(node.value)
        plain = ast.Attribute(base, node.attr, ast.Load())
        if isinstance(kind, Known) and isinstance(kind.value, types.ModuleType):
            if kind.value.__name__.startswith("numba"):
                return plain, NUMBER
            value = getattr(kind.value, node.attr)
            if kind.value in (np, math):
                return plain, Known(value, callable(value))
            return self.outside(node.attr, value)
        if isinstance(kind, Group) and node.attr in kind.names:
            return plain, kind.parts[kind.names.index(node.attr)]
        if isinstance(kind, Array):
            return plain, Group((NUMBER,) * kind.ndim) if node.attr == "shape" else kind if node.attr == "T" else NUMBER
        return plain, NUMBER

    def of_Subscript(self, node: ast.Subscript) -> tuple[Any, Any]:
        (base, kind), (index, at) = self.value(node.value), self.value(node.slice)
        result: Any = NUMBER
        if isinstance(kind, Group):
            if isinstance(node.slice, ast.Slice):
                first, last = (self.value_of(end) if end else None for end in (node.slice.lower, node.slice.upper))
                result = Group(kind.parts[first:last])
            elif isinstance(at, Known):
                result = kind.parts[at.value]
            else:
                result = merged(kind.parts)
        elif isinstance(kind, Array):
            indices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
            left = kind.ndim - sum(not isinstance(part, ast.Slice) for part in indices)
            result = Array(left) if left > 0 else NUMBER
        return ast.Subscript(base, index, ast.Load()), result

    def of_Slice(self, node: ast.Slice) -> tuple[Any, Any]:
        return ast.Slice(*(part and self.value(part)[0] for part in (node.lower, node.upper))), NUMBER

    def of_Tuple(self, node: ast.Tuple) -> tuple[Any, Any]:
        parts = [self.value(part) for part in self.spread(node.elts)]
        return ast.Tuple([part for part, _ in parts], ast.Load()), Group(tuple(kind for _, kind in parts))

    def spread(self, nodes: Iterable[ast.expr]) -> list[ast.expr]:
        """Expressions with the members of a tuple in place of a starred one."""
        elements: list[ast.expr] = []
        for node in nodes:
            if isinstance(node, ast.Starred):
                kind = self.value(node.value)[1]
                elements += [ast.Subscript(node.value, ast.Constant(k), ast.Load()) for k in range(len(kind.parts))]
            else:
                elements.append(node)
        return elements

    def of_BinOp(self, node: ast.BinOp) -> tuple[Any, Any]:
        (left, first), (right, second) = self.value(node.left), self.value(node.right)
        both = isinstance(first, Group) and isinstance(second, Group)
        return ast.BinOp(left, node.op, right), Group(first.parts + second.parts) if both else NUMBER

    def of_UnaryOp(self, node: ast.UnaryOp) -> tuple[Any, Any]:
        value, kind = self.value(node.operand)
        if isinstance(kind, Known) and isinstance(node.op, (ast.Not, ast.USub)):
            result = not kind.value if isinstance(node.op, ast.Not) else -kind.value
            return ast.UnaryOp(node.op, value), Known(result, False)
        return ast.UnaryOp(node.op, value), NUMBER

    def of_BoolOp(self, node: ast.BoolOp) -> tuple[Any, Any]:
        ends, left = isinstance(node.op, ast.Or), []
        for part in node.values:
            value, kind = self.value(part)
            if not isinstance(kind, Known):
                left.append(value)
            elif bool(kind.value) == ends:
                return ast.Constant(ends), Known(ends, False)
        if not left:
            return ast.Constant(not ends), Known(not ends, False)
        return ast.BoolOp(node.op, left) if len(left) > 1 else left[0], NUMBER

    def of_Compare(self, node: ast.Compare) -> tuple[Any, Any]:
        (left, kind), (right, other) = self.value(node.left), self.value(node.comparators[0])
        compared = COMPARED.get(type(node.ops[0]))
        if len(node.ops) == 1 and compared is not None:
            if isinstance(kind, Known) and isinstance(other, Known):
                truth = compared(kind.value, other.value)
                return ast.Constant(truth), Known(truth, False)
            if other == NONE and kind != UNCLEAR:
                truth = isinstance(node.ops[0], ast.IsNot)
                return ast.Constant(truth), Known(truth, False)
        return ast.Compare(left, node.ops, [right, *(self.value(part)[0] for part in node.comparators[1:])]), NUMBER

    def of_IfExp(self, node: ast.IfExp) -> tuple[Any, Any]:
        test, kind = self.value(node.test)
        if isinstance(kind, Known):
            return self.value(node.body if kind.value else node.orelse)
        (body, first), (other, second) = self.value(node.body), self.value(node.orelse)
        return ast.IfExp(test, body, other), merged([first, second])

    def of_Call(self, node: ast.Call) -> tuple[Any, Any]:
        if node.keywords:
            return self.unknown(node)
        name, kind = self.value(node.func)
        function: Any = kind.value if isinstance(kind, Known) else None
        given = [self.value(part) for part in self.spread(node.args)]
        kinds = [kind for _, kind in given]
        if function is len and isinstance(kinds[0], Group):
            return node, Known(len(kinds[0].parts))
        if function is isinstance and self.value_of(node.args[1]) is tuple:
            return node, Known(isinstance(kinds[0], Group))
        if function is hasattr and isinstance(kinds[0], Group):
            return node, Known(self.value_of(node.args[1]) in kinds[0].names)
        if self.writer.backend in getattr(function, "written_on", {}):
            function = function.written_on[self.writer.backend]()
        if hasattr(function, "written"):  # for arguments of these kinds: a sum over neighbours, entries of tuples
            function = function.written(kinds)
        if isinstance(function, types.FunctionType) and not str(function.__module__).startswith("numpy"):
            return self.called(function, given)
        if isinstance(function, type) and hasattr(function, "_fields"):
            made = self.writer.constant(function.__name__, function)
            return ast.Call(made.node(), [part for part, _ in given], []), Group(
                tuple(kinds), function._fields, function
            )
        result: Any = NUMBER
        if function in ARRAY_MAKERS:
            result = Array(len(kinds[0].parts) if isinstance(kinds[0], Group) else 1)
        return ast.Call(name, [part for part, _ in given], []), result

    def called(self, function: Callable, given: list[tuple[Any, Any]]) -> tuple[Any, Any]:
        """A call of another function of the text."""
        arguments = source_of(function).tree.args
        names = [a.arg for a in arguments.args]
        bound = dict(zip(names, given))
        for name, default in zip(names[len(names) - len(arguments.defaults) :], arguments.defaults):
            bound.setdefault(name, self.value(default))
        if len(given) > len(names) or set(bound) != set(names):
            raise NotPlain(f"a call of {function.__name__}")
        kinds = {
            n: NUMBER if isinstance(bound[n][1], Known) and not is_fixed(bound[n][1]) else bound[n][1] for n in names
        }
        wanted = getattr(function, "shown_as", function.__name__).lstrip("_")
        made = self.writer.function(function, kinds, wanted)
        if isinstance(made.result, Known) and isinstance(made.result.value, bool):
            return ast.Constant(made.result.value), made.result
        passed_on = _arguments_returned(made.tree)
        if passed_on is not None and passed_on <= set(bound):
            values = made.tree.body[-1].value  # type: ignore[union-attr]
            if isinstance(values, ast.Name):
                return bound[values.id]
            return ast.Tuple([bound[part.id][0] for part in values.elts], ast.Load()), made.result
        passed = [bound[n][0] for n in names if not is_fixed(kinds[n])]
        return ast.Call(made.node(), passed, []), made.result


def _arguments_returned(tree: Any) -> set[str] | None:
    """Names of the arguments that a function returns as they are; None where it does anything else."""
    statements = [s for s in tree.body if not (isinstance(s, ast.Expr) and isinstance(s.value, ast.Constant))]
    if len(statements) != 1 or not isinstance(statements[0], ast.Return):
        return None
    value = statements[0].value
    parts = value.elts if isinstance(value, ast.Tuple) else [value]
    names = {part.id for part in parts if isinstance(part, ast.Name)}
    return names if all(isinstance(part, ast.Name) for part in parts) else None


def written(
    function: Callable, kinds: dict[str, Any], backend: str, fast: Iterable[str] = (), example: str = ""
) -> str:
    """The text of a kernel's loop for arguments of these kinds.

    fast  flags of the sums; `example` stands at the end. Raises NotPlain where the kernel names what has no plain form.
    """
    writer = Writer(backend)
    writer.function(function, kinds, function.__name__)
    return writer.text(fast, example)


def literal(value: Any) -> str:
    """A constant as Python."""
    if isinstance(value, np.ndarray):
        return f"np.array({value.tolist()}, np.{value.dtype.name})"
    if isinstance(value, tuple):
        return f"({', '.join(map(literal, value))}{',' if len(value) == 1 else ''})"
    return f"np.{value.dtype.name}({value.item()!r})" if isinstance(value, np.generic) else repr(value)


@functools.cache
def class_text(kind: type) -> str:
    """A named tuple with what its source says of its members."""
    if kind.__doc__ == f"{kind.__name__}({', '.join(kind._fields)})":  # type: ignore[attr-defined]
        members = [f"    {name}: object" for name in kind._fields]  # type: ignore[attr-defined]
        return "\n".join([f"class {kind.__name__}(NamedTuple):", *members])
    (tree,) = ast.parse(inspect.getsource(kind)).body
    assert isinstance(tree, ast.ClassDef)
    lines = inspect.getsource(kind).splitlines()
    annotated = [part for part in tree.body if isinstance(part, ast.AnnAssign)]
    head = [f"class {kind.__name__}(NamedTuple):", f'    """{inspect.cleandoc(kind.__doc__ or kind.__name__)}"""', ""]
    members = []
    for part in annotated:
        _, _, said = lines[(part.end_lineno or 1) - 1][part.end_col_offset or 0 :].partition("#")
        default = f" = {ast.unparse(part.value)}" if part.value else ""
        members.append(f"    {ast.unparse(part.target)}: object{default}" + (f"  # {said.strip()}" if said else ""))
    return "\n".join([*head, *members])


def _wrapped_lines(text: str) -> str:
    return "\n".join(map(wrapped_line, text.split("\n")))


def wrapped_line(line: str) -> str:
    """A line of code, broken inside of brackets where it is too long."""
    indent = " " * (len(line) - len(line.lstrip()) + 4)
    lines, outer = list[str](), 0
    while len(line) > WIDTH:
        depth, place, quoted = outer, 0, False
        for k, c in enumerate(line[:WIDTH]):
            quoted ^= c in "\"'"
            depth += 0 if quoted else (c in "([{") - (c in ")]}")
            if c == " " and not quoted and depth > 0 and line[k - 1] in ",+-*/":
                place, outer = k, depth
        if not place:
            break
        lines.append(line[:place])
        line = indent + line[place + 1 :]
    return "\n".join([*lines, line])
