"""Programs called by name: a program's parameters are found in the operation's arguments, its answer is checked."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from refsim.contract.inputs import arguments_of_others
from refsim.contract.target import ProgramFailed
from refsim.core.errors import InputError
from refsim.core.operation import Operation

MOST_TOLD = 300  # characters of a message from an external program
OWNED = "owned"  # number of the particles that a rank owns; those behind them are ghosts
Convert = Callable[[Any], Any]


def error_line(error: BaseException, how: str = "") -> str:
    """An exception of another's code on one line of printable characters."""
    try:
        text = str(error)[:MOST_TOLD]
    except Exception:  # its own __str__ raises
        text = ""
    text = " ".join("".join(c if c.isprintable() else " " for c in text).split()).rstrip(".")
    return f"{how} {type(error).__name__}: {text or 'no message'}".strip()


def by_name(
    program: Callable[..., Any], operation: Operation, owner: str, arrays: str, convert: Convert | None
) -> Callable[..., Any]:
    """The program as a function of its `arguments`, all that others are given; `takes` names those that it reads.

    owner   name of the library, for messages
    arrays  "cpu" or "cuda": whose arrays it takes
    convert applied to each array before the program gets it

    Raises ProgramFailed, when it is called, for what it raises and for an answer of a wrong shape or dtype; at once
    InputError for a parameter that the operation has not.
    """
    names = (*arguments_of_others(operation, arrays), OWNED)
    label = f"{owner}: its program for {operation.name}"
    ordered, named = _parameters(program, names, label)

    def call(*values: Any, owned: int | None = None) -> None:
        given, how = dict(zip(names, (*values, owned))), "it raised"
        try:
            taken = given if convert is None else {n: converted(given[n], convert) for n in (*ordered, *named)}
            returned = program(*[taken[n] for n in ordered], **{n: taken[n] for n in named})
            how = "its answer raised"  # an object of its own kind
            if returned is not None:
                _hand_over(returned, operation, given, arrays)
        except (KeyboardInterrupt, ProgramFailed):
            raise
        except BaseException as error:  # SystemExit is a failure of the program, and no end of the ladder
            raise ProgramFailed(error_line(error, how)) from error

    call.arguments = names[:-1]  # type: ignore[attr-defined]
    call.takes = frozenset({*ordered, *named})  # type: ignore[attr-defined]
    return call


def _parameters(program: Callable[..., Any], names: Sequence[str], label: str) -> tuple[list[str], list[str]]:
    """(positional, keyword) arguments that the program takes."""
    try:
        parameters = inspect.signature(getattr(program, "py_func", program)).parameters.values()
    except (TypeError, ValueError):
        raise InputError(f"{label} does not state its parameters; wrap it in a Python function with names.") from None
    ordered: list[str] = []
    named: list[str] = []
    for p in parameters:
        if p.kind is p.VAR_KEYWORD:
            named += [n for n in names if n not in ordered and n not in named]
        elif p.name in names:
            (named if p.kind is p.KEYWORD_ONLY else ordered).append(p.name)
        elif p.kind is p.VAR_POSITIONAL or p.default is p.empty:
            star = "*" if p.kind is p.VAR_POSITIONAL else ""
            known = ", ".join(names)
            raise InputError(f"{label} takes {star}{p.name}, which the operation does not have; it has {known}.")
        elif p.kind is not p.KEYWORD_ONLY:
            break  # what stands behind it keeps its default, too
    return ordered, named


def _hand_over(returned: Any, operation: Operation, given: Mapping[str, Any], arrays: str) -> None:
    """Write what a program returned into the outputs; ProgramFailed if it does not fit."""
    wanted = {name: given[name] for name in operation.outputs if given[name] is not None}
    if not isinstance(returned, Mapping):
        if len(wanted) != 1:
            kind = type(returned).__name__
            raise ProgramFailed(f"it returned {kind}; wanted is {{name: array}} for {', '.join(wanted)}")
        returned = dict.fromkeys(wanted, returned)
    for name in returned:
        if name not in operation.outputs:
            known = ", ".join(operation.outputs)
            raise ProgramFailed(f"it returned {name!r}, which is no output; those are {known}")
    for name, target in wanted.items():
        if name not in returned:
            raise ProgramFailed(f"it did not return {name}; it must, or write all outputs in place")
        values = to_numpy(returned[name])
        if values is None:
            kind = type(returned[name]).__name__
            raise ProgramFailed(
                f"it returned {name} as {kind}; wanted is a NumPy array, or one with __dlpack__ or"
                " __cuda_array_interface__"
            )
        if values.shape != target.shape or values.dtype != target.dtype:
            raise ProgramFailed(
                f"it returned {name} as {values.dtype} of shape {values.shape}; wanted is {target.dtype} of shape"
                f" {target.shape}"
            )
        if arrays == "cuda":
            target.copy_to_device(target.copy_to_host() + values if name in operation.adds else values)
        elif name in operation.adds:
            target += values
        else:
            target[...] = values


CPU = 1  # device types of DLPack


def to_numpy(values: Any) -> np.ndarray | None:
    """A copy as a NumPy array on the host; None for what is no array.

    Accepted are NumPy arrays, arrays on a GPU with `__cuda_array_interface__` (CuPy, Torch, Warp, Numba), and arrays in
    host memory with `__dlpack__` (Torch, JAX, Warp, CuPy's on the host).
    """
    if isinstance(values, np.ndarray):
        return np.array(values)
    if hasattr(values, "__cuda_array_interface__"):
        from numba import cuda

        return cuda.as_cuda_array(values).copy_to_host()
    if hasattr(values, "__dlpack__") and int(values.__dlpack_device__()[0]) == CPU:
        return np.array(np.from_dlpack(values))
    return None


def converted(value: Any, convert: Convert) -> Any:
    """An argument with `convert` applied to each array in it, those of groups included."""
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return type(value)(*(converted(part, convert) for part in value))
    of_numpy = isinstance(value, np.ndarray) and value.ndim > 0
    return convert(value) if of_numpy or hasattr(value, "copy_to_host") else value
