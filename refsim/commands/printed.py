"""A program of an operation as a file that runs by itself: its loop, and a hundred random particles as an example."""

import contextlib
import importlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from refsim.backends.written import NotPlain, class_text, kind_of, literal, wrapped_line, written
from refsim.contract import bindings
from refsim.core.errors import RefsimError
from refsim.core.operation import Operation, backend_of
from refsim.smoothing.shapes import Smoothing

COUNT, CASE = 100, "cloud_3d"
MOST_NUMBERS = 9  # of an array that is written as it is
NEIGHBOURS = {
    "cpu": '''\
def neighbours_of(position, radius):
    """All pairs nearer than `radius` [m]; neighbours of i are entries[start[i] : start[i] + count[i]]."""
    near = ((position[:, None] - position) ** 2).sum(2) < radius**2
    np.fill_diagonal(near, False)
    count = near.sum(1)
    return NeighbourRows(np.cumsum(count) - count, count.astype(np.int32), near.nonzero()[1].astype(np.uint32))''',
    "cuda": '''\
def neighbours_of(position, radius):
    """All pairs nearer than `radius` [m]; the k-th neighbour of i is entries[k * n + i]."""
    near = ((position[:, None] - position) ** 2).sum(2) < radius**2
    np.fill_diagonal(near, False)
    columns = np.argsort(~near, axis=1, kind="stable").T  # the neighbours of each particle first
    return NeighbourColumns(near.sum(1).astype(np.int32), columns.astype(np.uint32).ravel())''',
}
EXAMPLE = '''\
def example(count={count}):
    """What `{name}` takes, of random particles."""
    rng = np.random.default_rng(1)
    {lines}
    {arguments}


if __name__ == "__main__":
    given = example()
    {name}{launch}(*given)
    {told}
'''


def kernel_of(operation: Operation, program: str) -> Any:
    """The kernel that a program is; None where it is a function that launches kernels, or reduces rows."""
    from refsim.backends.compile import Kernel  # which loads Numba, as no other command needs it
    from refsim.backends.reductions import Reduction

    entry = operation.entry(program)
    candidate = getattr(
        importlib.import_module(f"{entry.folder or operation.folder}.{entry.module}"),
        entry.function or operation.function,
    )
    return (
        candidate
        if isinstance(candidate, Kernel) and not isinstance(candidate, Reduction) and not entry.packed
        else None
    )


def printed(operation: Operation, program: str) -> str | None:
    """The text of the file; None where the program has none. Without an example where random particles are no input."""
    from refsim.backends.compile import ANY_ORDER

    kernel, backend = kernel_of(operation, program), backend_of(program)
    if kernel is None:
        return None
    example = ""
    try:
        given = bindings(operation, "cpu", "float32", CASE, names=kernel.arguments)
        given = {name: _plainly(value, backend) for name, value in given.items()}
        kinds = {name: kind_of(value) for name, value in given.items()}
        with contextlib.suppress(NotPlain):
            example = _example(operation, kernel, given, backend)
        flags = ANY_ORDER - {"reassoc"} if kernel.options["cpu"]["ordered"] else ANY_ORDER
        text = written(kernel.plain_wrapper(backend), kinds, backend, flags, example)
    except (NotPlain, KeyError, RefsimError):
        return None
    return f'"""{operation.name}: {operation.equation} ({operation.paper})."""\n\n{text}'


def _plainly(value: Any, backend: str) -> Any:
    """A value with a known smoothing kernel, and the GPU's list in place of a CPU's."""
    from refsim.neighbours.rows import NeighbourColumns, NeighbourRows

    if isinstance(value, Smoothing):
        return value.fixed()
    if backend == "cuda" and isinstance(value, NeighbourRows):
        return NeighbourColumns(value.count, value.entries)
    return value


def _example(operation: Operation, kernel: Any, given: Mapping[str, Any], backend: str) -> str:
    """What makes the arguments, and runs the kernel. Raises NotPlain where random particles are no input."""
    taken = {name: value for name, value in given.items() if value is not None}
    if kernel.rows not in taken:
        raise NotPlain(kernel.rows)
    rows, radius = len(taken[kernel.rows]), next((n for n in taken if hasattr(taken[n], "support_radius")), "")
    order = sorted(taken, key=lambda name: (name != radius, name == "neighbours"))
    lines = [wrapped_line(f"    {name} = {_made(operation, name, taken[name], rows, radius)}") for name in order]
    classes = {type(value).__name__: type(value) for value in taken.values() if isinstance(value, tuple)}
    outputs = [name for name in operation.outputs if name in taken]
    told = (f'print("mean of |{name}|:", np.abs(given[{list(taken).index(name)}]).mean())' for name in outputs)
    main = EXAMPLE.format(
        count=COUNT, name=kernel.__name__, lines="\n".join(lines).lstrip(), told="\n    ".join(told),
        arguments=wrapped_line(f"    return ({', '.join(taken)}{',' * (len(taken) == 1)})").lstrip(),
        launch="[1, 128]" if backend == "cuda" else "",
    )  # fmt: skip
    return "\n\n\n".join([*map(class_text, classes.values()), *[NEIGHBOURS[backend]] * ("neighbours" in taken), main])


def _made(operation: Operation, name: str, value: Any, rows: int, radius: str) -> str:
    """An expression for an argument; `radius` is the group with the support radius.

    Raises NotPlain for one that random particles do not have.
    """
    if name == "neighbours":
        return f"neighbours_of(position, {radius}.support_radius)"
    if isinstance(value, tuple):
        numbers = value.numbered() if isinstance(value, Smoothing) else value
        if any(getattr(member, "ndim", 0) or isinstance(member, tuple) for member in numbers):
            raise NotPlain(name)
        members = zip(type(value)._fields, numbers)  # type: ignore[attr-defined]
        return f"{type(value).__name__}({', '.join(f'{n}={literal(v)}' for n, v in members)})"
    if not getattr(value, "ndim", 0):
        return literal(value)
    kind, per_row = f"np.{value.dtype.name}", len(value) == rows
    shape = ", ".join(["count", *map(str, value.shape[1:])]) if per_row else ""
    shape = f"({shape})" if value.ndim > 1 else shape or str(value.shape)
    if name in operation.outputs and (per_row or value.size <= MOST_NUMBERS):
        return f"np.zeros({shape if per_row else value.shape}, {kind})"
    if name == "position" and per_row:
        return f"rng.uniform(0, {f'2.4 * {radius}.support_radius' if radius else 1.0}, (count, 3)).astype({kind})"
    if value.size <= MOST_NUMBERS and not per_row:
        return literal(value)
    if not per_row or not np.isfinite(np.asarray(value, dtype=float)).all():
        raise NotPlain(name)
    if value.dtype.kind in "iub":
        return f"rng.integers({int(value.min())}, {min(int(value.max()), COUNT - 1) + 1}, {shape}).astype({kind})"
    low, high = (float(f"{end:.3g}") for end in (value.min(), value.max()))
    return f"rng.uniform({low}, {high}, {shape}).astype({kind})"
