"""Programs in C, Fortran, Rust or Zig without glue: declarations of an operation's function, and the library's loader.

The function is called `sph_density` for sph.density. It takes the number n of particles, with a grid that of its nodes,
then the arguments in their order: arrays and parameter groups as pointers, NULL for None, numbers by value.
"""

import ctypes
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from refsim.contract.describe import Argument, arguments, function_of
from refsim.contract.programs import Programs, check_names
from refsim.core.operation import REGISTRY, Operation

TYPES = {  # {type of an argument: in C, in Fortran, for ctypes}; REAL and real_kind are of the precision
    "float32": ("REAL", "real(real_kind)", None),
    "float64": ("double", "real(c_double)", ctypes.c_double),
    "float": ("double", "real(c_double)", ctypes.c_double),
    "int": ("int64_t", "integer(c_int64_t)", ctypes.c_int64),
    "bool": ("uint8_t", "integer(c_int8_t)", ctypes.c_uint8),
}
KIND = re.compile(r"(\w+)(?: \((.*)\))?")


def parts(operation: Operation) -> dict[str, tuple[Argument, list[Argument]]]:
    """(argument, members of a group) by name."""
    groups: dict[str, tuple[Argument, list[Argument]]] = {}
    for row in arguments(operation, "cpu"):
        group, _, member = row.name.partition(".")
        if member:
            groups[group][1].append(row)
        else:
            groups[group] = (row, [])
    ours = {name for name, (row, members) in groups.items() if not members and not row.kind[0].islower()}
    return {name: part for name, part in groups.items() if name not in ours}  # no memory of refsim's


def sizes(operation: Operation) -> list[str]:
    """Names of the numbers that stand before the arguments."""
    return ["n"] + ["node_count"] * any("(nodes" in row.kind for row, _ in parts(operation).values())


def split(kind: str) -> tuple[str, list[str]]:
    """(type, sizes) of an argument's kind, "float32 (n, 3)"."""
    match = KIND.fullmatch(kind)
    assert match is not None
    shape = [size.strip() for size in (match[2] or "").split(",") if size.strip()]
    return match[1], ["node_count" if size == "nodes" else size for size in shape]


def typed(kind: str) -> tuple[str, str, Any]:
    """The type of the numbers of a kind in C, in Fortran and for ctypes."""
    name = split(kind)[0]
    return TYPES.get(name) or (f"{name}_t", f"integer(c_{name.removeprefix('u')}_t)", np.ctypeslib.as_ctypes_type(name))


def argument_comment(row: Argument) -> str:
    """What an argument or member is, in one comment; numbers of rows that differ from run to run are left out."""
    shape = split(row.kind)[1]
    sizes = f" ({', '.join(shape)})" if shape and not shape[0].isdecimal() else ""
    return f"{split(row.kind)[0]}{sizes}: {row.meaning}"[:125]


def header(operation: Operation) -> str:
    """The C header of the function that computes an operation."""
    real = "#define REAL double /* or float, with -DREAL=float */"
    lines = ["#include <stdint.h>", "#ifndef REAL", real, "#endif", ""]
    taken = [f"int64_t {size}" for size in sizes(operation)]
    for argument, (row, members) in parts(operation).items():
        const = "const " if row.role == "in" else ""
        if not members:
            pointer = "*" if split(row.kind)[1] else ""
            taken.append(
                f"{const if pointer else ''}{typed(row.kind)[0]} {pointer}{argument} /* {argument_comment(row)} */"
            )
            continue
        lines += [f"#ifndef REFSIM_{argument.upper()}", f"#define REFSIM_{argument.upper()}", "typedef struct {"]
        for m in members:
            kind = f"const {typed(m.kind)[0]} *" if split(m.kind)[1] else f"{typed(m.kind)[0]} "
            lines.append(f"    {kind}{m.name.partition('.')[2]}; /* {argument_comment(m)} */")
        lines += ["    int64_t rows; /* of its first array */", f"}} refsim_{argument};", "#endif", ""]
        taken.append(f"const refsim_{argument} *{argument}{' /* or NULL */' if row.optional else ''}")
    comment = f"/* {operation.name}: {operation.paper}, {operation.equation}"
    written = f"   {'adds to' if operation.adds else 'assigns'} {', '.join(operation.outputs)} */"
    listed = ",\n    ".join(taken)
    return "\n".join([*lines, comment, written, f"void {function_of(operation)}(\n    {listed}\n);\n"])


def module(operation: Operation) -> str:
    """The Fortran module with the interface of the function, which a submodule implements by `module procedure`."""
    lines = [f"! {operation.name}: {operation.paper}, {operation.equation}"[:130]]
    lines += [f"module refsim_{function_of(operation)}", "  use iso_c_binding", "  implicit none"]
    lines += ["  integer, parameter :: real_kind = c_double  ! or c_float"]
    taken = [f"      integer(c_int64_t), value :: {', '.join(sizes(operation))}"]
    for argument, (row, members) in parts(operation).items():
        optional = ", optional" if row.optional else ""
        if members:
            lines.append(f"  type, bind(c) :: refsim_{argument}")
            for m in members:
                kind = "type(c_ptr)" if split(m.kind)[1] else typed(m.kind)[1]
                lines += [f"    ! {argument_comment(m)}", f"    {kind} :: {m.name.partition('.')[2]}"]
            lines += ["    ! of its first array", "    integer(c_int64_t) :: rows", "  end type"]
            taken.append(f"      type(refsim_{argument}), intent(in){optional} :: {argument}")
            continue
        intent, shape = "in" if row.role == "in" else "inout", ", ".join(reversed(split(row.kind)[1]))
        by = f", intent({intent}){optional} :: {argument}({shape})" if shape else f", value :: {argument}"
        taken += [f"      ! {argument_comment(row)}", f"      {typed(row.kind)[1]}{by}"]
    listed = ", &\n        ".join([*sizes(operation), *parts(operation)])
    lines += ["  interface", f"    module subroutine {function_of(operation)}( &\n        {listed}) bind(c)", *taken]
    return "\n".join([*lines, "    end subroutine", "  end interface", "end module", ""])


def library(file: str, names: Sequence[str], **declared: Any) -> Programs:
    """The programs of a compiled library; `{dtype}` in its file's name stands for "float32" and "float64".

    declared  as of Programs. Raises InputError for an operation that does not exist.
    """
    check_names(names)
    return Programs({name: _program(file, REGISTRY[name]) for name in names}, **({"name": file} | declared))


def _program(file: str, operation: Operation) -> Callable[..., None]:
    def call(**given: Any) -> None:
        real = next(v.dtype for v in given.values() if isinstance(v, np.ndarray) and v.dtype.kind == "f")
        taken, wanted = parts(operation), [ctypes.c_int64(len(given[operation.outputs[-1]]))]
        if len(sizes(operation)) > 1:
            nodes = len(given["nodes"])
            rows = next(len(given[k]) for k, (row, _) in taken.items() if "(n" in row.kind and "(nodes" not in row.kind)
            wanted = [ctypes.c_int64(rows), ctypes.c_int64(nodes)]
        values = [_value(given[name], row, members, real) for name, (row, members) in taken.items()]
        getattr(ctypes.CDLL(str(Path(file.format(dtype=real)).resolve())), function_of(operation))(*wanted, *values)

    return call


def _type(kind: str, real: np.dtype) -> Any:
    return ctypes.c_void_p if split(kind)[1] else typed(kind)[2] or np.ctypeslib.as_ctypes_type(real)


def _value(value: Any, row: Argument, members: Sequence[Argument], real: np.dtype) -> Any:
    if value is None:
        return ctypes.c_void_p(None)
    if not members:
        return ctypes.c_void_p(value.ctypes.data) if np.ndim(value) else _type(row.kind, real)(value)
    fields = [(m.name.partition(".")[2], _type(m.kind, real)) for m in members]
    arrays = [part for part in value if np.ndim(part)]
    made = type(row.name, (ctypes.Structure,), {"_fields_": [*fields, ("rows", ctypes.c_int64)]})
    taken = [part.ctypes.data if np.ndim(part) else kind(part) for part, (_, kind) in zip(value, fields)]
    return ctypes.byref(made(*taken, len(arrays[0]) if arrays else 0))
