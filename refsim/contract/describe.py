"""What an operation takes and gives, in words: arguments, parameter groups, variants; and a stub of its program."""

import functools
import inspect
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any

import msgspec
import numpy as np

from refsim.backends.arrays import Backend
from refsim.contract.inputs import Inputs, arguments_of_others, fields, period_of, prepare, value_of, with_variant
from refsim.core import cases
from refsim.core.operation import REGISTRY, Operation

SHOWN_IN = "cloud_3d"  # the case whose arguments are shown
MEMBER = re.compile(r"^    (\w+): [^#\n]+?(?:  # (.*))?$", re.MULTILINE)


@dataclass(frozen=True)
class Argument:
    """An argument of an operation's program, or a member of a group ("smoothing.shape")."""

    name: str
    role: str  # "in", "out" or "add to"; "" for a member
    kind: str  # type and shape in a float32 run of n particles, and on a grid of so many nodes
    optional: bool  # None in some variants
    meaning: str
    unit: str  # that the meaning names, "-" for none


def arguments(operation: Operation, arrays: str) -> list[Argument]:
    """Everything that a program on `arrays` ("cpu", "cuda") is given, the members of groups behind their group."""
    cases.discover()
    names = arguments_of_others(operation, arrays)
    case, place = cases.CASES[SHOWN_IN](), Backend(arrays)  # on the host, so that no GPU is needed
    period = period_of(operation, Inputs(case, "float32"))
    inputs, near, walls = prepare(case, place, "float32", "all_pairs", period)
    given = {name: value_of(operation, name, inputs, near, walls, place) for name in names}
    sizes = {case.count: "n", len(given.get("nodes", ())): "nodes"}
    described = []

    def add(name: str, role: str, value: Any, optional: bool, meaning: str) -> None:
        kind, units = "None" if value is None else type(value).__name__, re.findall(r"\[([^\]]+)\]", meaning)
        if hasattr(value, "dtype") and np.ndim(value):
            kind = f"{value.dtype} ({', '.join(sizes.get(size, str(size)) for size in value.shape)})"
        described.append(Argument(name, role, kind, optional, meaning, units[-1] if units else "-"))

    for name, value in given.items():
        role = "add to" if name in operation.adds else "out" if name in operation.outputs else "in"
        optional, group, field = name in operation.optional, type(value), fields().get(name)
        if hasattr(value, "_fields"):
            add(name, role, value, optional, f"{group.__module__}.{group.__name__}")
            said = member_meanings(group)
            for member, part in zip(value._fields, value):
                add(f"{name}.{member}", "", part, False, said[member])
        else:
            meaning = f"{field.meaning} [{field.unit}]" if field else _arguments().get(name, "")
            add(name, role, value, optional, meaning)
    return described


def member_meanings(group: type) -> dict[str, str]:
    """{member of a parameter group: meaning, unit, and what its integers stand for}; from the comments beside them."""
    said = {name: comment or "" for name, comment in MEMBER.findall(inspect.getsource(group))}
    for member in group._fields:  # type: ignore[attr-defined]
        meaning = _arguments()["lists"].get(member) or said.get(member, "")
        codes = cases.CODES.get((group, member))
        if codes:
            numbers = ", ".join(f"{number} {name}" for name, number in codes.items())
            meaning = f"{meaning}: {numbers}" if meaning and member != "shape" else numbers
        said[member] = meaning
    return said


def variants(operation: Operation) -> list[str]:
    """One line for each variant: what it leaves out, and what else differs from the first case's own arguments."""
    cases.discover()
    usual = Inputs(cases.CASES[SHOWN_IN](), "float32")
    lines = []
    for overrides in operation.variants:
        left_out = [name for name in operation.optional if overrides.get(name, name) is None]
        given = [name for name in operation.optional if name not in left_out]
        changed = list(_changed(usual, with_variant(usual, overrides), overrides))
        parts = [f"with {', '.join(given)}"] if given else []
        parts += [f"without {', '.join(left_out)}"] if left_out else []
        lines.append("; ".join([*parts, *changed]) or "as it is")
    return lines


def _changed(usual: Inputs, inputs: Inputs, overrides: Mapping[str, Any]) -> Iterator[str]:
    """What the overrides that are not None change: members of groups with their values, else the name."""
    for name, override in overrides.items():
        if override is None:
            continue
        value, before = inputs[name], usual[name]
        if not hasattr(value, "_fields"):
            yield f"another {name}"
            continue
        for member, one, other in zip(value._fields, value, before):
            if (np.ndim(one) == 0 and one != other) or (isinstance(override, Mapping) and member in override):
                codes = {number: word for word, number in cases.CODES.get((type(value), member), {}).items()}
                word = f" ({codes[int(one)]})" if codes else ""
                yield f"{name}.{member} = {one:g}{word}"


@functools.cache
def _arguments() -> dict[str, Any]:
    """What arguments mean that are no particle fields, by name, and in "lists" members of groups."""
    return msgspec.toml.decode((resources.files("refsim.contract") / "arguments.toml").read_bytes())


# A stub


def template(names: Sequence[str], arrays: str = "cpu") -> str:
    """A Python file with a program for each of the operations, whose computation is missing."""
    operations = [REGISTRY[name] for name in names]
    functions = "\n\n".join(_function(operation, arrays) for operation in operations)
    entries = "".join(f'        "{operation.name}": {function_of(operation)},\n' for operation in operations)
    optional = sorted({name for operation in operations for name in operation.optional} - {"walls"})
    choices = {
        'kernels=("wendland_c2",)': "smoothing kernels; all by default",
        "dims=(3,)": "2 and 3 by default",
        'dtypes=("float32",)': "float32 and float64 by default",
        "most_particles=3000": "of a call; of any number by default",
    }
    if any("walls" in operation.arguments("numpy") for operation in operations):
        choices["walls=False"] = "wall particles are not done"
    if optional:
        names_left_out = " ".join(f'"{name}",' for name in optional)
        choices[f"without=({names_left_out})"] = "optional arguments that are not done"
    declared = "".join(f"    # {given},  # {meaning}\n" for given, meaning in choices.items())
    return (
        f'"""Programs for {", ".join(names)}; judged by `refsim contract` with the name of this file."""\n\n'
        "from refsim.contract import Programs\n\n\n"
        f"{functions}\n\n"
        "# What is declared here is judged; what is left out is reported as not judged.\n"
        f"PROGRAMS = Programs(\n    {{\n{entries}    }},\n{declared})\n"
    )


def function_of(operation: Operation) -> str:
    """The name of the function that computes an operation in another's code."""
    return operation.name.replace(".", "_")


def _function(operation: Operation, arrays: str) -> str:
    rows = arguments(operation, arrays)
    widths = [max(len(text) for text in column) for column in zip(*((r.name, r.role, r.kind) for r in rows))]
    told = []
    for r in rows:
        name = f"  .{r.name.partition('.')[2]}" if not r.role else r.name
        none = "; None in some variants" if r.optional else ""
        line = f"{name:{widths[0] + 2}}  {r.role:6}  {r.kind:{widths[2]}}  {r.meaning}{none}"
        told.append(line.rstrip())
    said = inspect.getdoc(operation.program("numpy")) or ""
    said = "\n\n".join([said, *(f"{f.__name__}: {inspect.getdoc(f)}" for f in operation.equations())])
    outputs = ", ".join(operation.outputs)
    verb = "add to" if operation.adds else "assign"
    taken = ", ".join(row.name for row in rows if row.role)
    signature = f"def {function_of(operation)}({taken}):"
    if len(signature) > 110:
        signature = f"def {function_of(operation)}(\n" + textwrap.indent(textwrap.fill(taken, 100), "    ") + ",\n):"
    body = f'"""{operation.name}: {operation.paper}, {operation.equation}.\n\n{said}\n\n' + "\n".join(told) + '\n"""'
    body = body.replace("\\", "\\\\")
    missing = f"# The computation is missing: {verb} {outputs} in place."
    return f"{signature}\n{textwrap.indent(body, '    ', lambda line: bool(line.strip()))}\n    {missing}\n"
