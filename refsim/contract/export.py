"""Test vectors for programs in any language: inputs, answer and bound of every case, as npz files and one JSON index.

In FILE.npz (a zip file of uncompressed npy files) an array is called CASE/NAME: an argument by its name, a member of a
parameter group by GROUP.MEMBER, what stands in an output before the call by before/OUTPUT, the answer by
answer/OUTPUT and the largest error allowed by bound/OUTPUT. An argument without an array is None.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from refsim.contract import describe
from refsim.contract.answers import CLOUDS, DENSE, exact_forms, exact_inputs
from refsim.contract.bounds import allowed, oracle, takes_neighbours
from refsim.contract.features import extended
from refsim.contract.inputs import Inputs, with_variant
from refsim.contract.parameters import shape_acts, with_kernel
from refsim.contract.target import Target
from refsim.core import cases
from refsim.core.errors import InputError
from refsim.core.operation import REGISTRY, Operation
from refsim.core.versions import VERSION
from refsim.smoothing import SHAPES

FORMAT = 1
REPLAY = "replay.npz"  # of `write_replay`
INDEX, SCHEMA = "vectors.json", "vectors.schema.json"


class VectorArgument(msgspec.Struct, frozen=True):
    """An argument, or a member of a group ("smoothing.shape"); `kind` is its type in a run of n particles."""

    name: str
    role: str
    kind: str
    optional: bool
    meaning: str
    unit: str


class VectorCase(msgspec.Struct, frozen=True):
    """One case of a file. A closed form is an answer worked out by hand, else it is the reference's."""

    name: str
    particles: int
    dim: int
    spacing: float
    support_radius: float
    closed_form: bool


class VectorFile(msgspec.Struct, frozen=True):
    """The cases of one variant in one precision; `without` names the arguments that are None."""

    file: str
    dtype: str
    variant: int
    says: str
    without: list[str]
    cases: list[VectorCase]


class VectorOperation(msgspec.Struct, frozen=True):
    """An operation; an error is the length of a row's difference, and the bound holds for each row.

    adds   outputs whose answer is what the operation adds to the values before
    exact  outputs that agree exactly: their bound is 0, or infinite where a rounding may decide
    """

    name: str
    paper: str
    equation: str
    arguments: list[VectorArgument]
    outputs: list[str]
    adds: list[str]
    exact: list[str]
    files: list[VectorFile]


class Vectors(msgspec.Struct, frozen=True):
    """The index of a folder of test vectors. `not_exported` has operations that take more than arrays and numbers."""

    format: int
    refsim: str
    operations: list[VectorOperation]
    not_exported: dict[str, str]


def export(
    folder: Path, names: Sequence[str] = (), dtypes: Sequence[str] = (), variants: Sequence[int] = ()
) -> Vectors:
    """Write the vectors of the operations (all by default) into a new or empty folder and return their index.

    Raises InputError for a folder that cannot be written or holds files.
    """
    cases.discover()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise InputError(f"--export {folder}: the folder holds files; give a new one.")
    except OSError as error:
        raise InputError(f"--export {folder} cannot be written: {error.strerror}; give another folder.") from None
    found, left_out = [], {}
    for name in names or REGISTRY:
        operation = extended(name)
        objects = _objects(operation)
        if objects:
            left_out[name] = f"its argument {objects[0]} is an object of refsim"
            continue
        files = [
            _written(folder, operation, dtype, variant)
            for dtype in dtypes or ("float32", "float64")
            for variant in range(len(operation.variants))
            if not variants or variant in variants
        ]
        told = [VectorArgument(a.name, a.role, a.kind, a.optional, a.meaning, a.unit) for a in _arguments(operation)]
        outputs, adds, exact = map(list, (operation.outputs, operation.adds, operation.exact))
        found.append(VectorOperation(name, operation.paper, operation.equation, told, outputs, adds, exact, files))
    vectors = Vectors(FORMAT, VERSION, found, left_out)
    (folder / INDEX).write_bytes(msgspec.json.format(msgspec.json.encode(vectors), indent=1))
    (folder / SCHEMA).write_bytes(msgspec.json.format(msgspec.json.encode(msgspec.json.schema(Vectors)), indent=1))
    return vectors


def _arguments(operation: Operation) -> Iterator[describe.Argument]:
    """What is written of the operation: its reference's arguments and its outputs."""
    names = (*operation.arguments("numpy"), *operation.outputs)
    for argument in describe.arguments(operation, "numpy"):
        if argument.name.partition(".")[0] in names:
            yield argument


def _objects(operation: Operation) -> list[str]:
    """Arguments that are neither arrays nor numbers nor groups of these."""
    inputs = Inputs(cases.CASES[describe.SHOWN_IN](), "float32")
    parts = (_flat(name, inputs[name]) for name in operation.arguments("numpy"))
    return [key for part in parts for key, value in part.items() if np.asarray(value).dtype.kind == "O"]


def _flat(name: str, value: Any) -> dict[str, Any]:
    """{name: array or number}; members of groups by "group.member", nothing for None."""
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return {k: v for field, part in zip(value._fields, value) for k, v in _flat(f"{name}.{field}", part).items()}
    return {} if value is None else {name: value}


def _written(folder: Path, operation: Operation, dtype: str, number: int) -> VectorFile:
    overrides = operation.variants[number]
    arrays: dict[str, np.ndarray] = {}
    told = []
    for name, case, kernel in _given(operation):
        inputs = with_variant(Inputs(cases.CASES[case](), dtype), overrides)
        inputs = with_kernel(operation, inputs, kernel) if kernel else inputs
        arrays |= _vector(name, operation, inputs, oracle(operation, inputs))
        told.append(_case(name, inputs.case, False))
    for maker, exact in exact_forms(operation, overrides):
        inputs = exact_inputs(operation, overrides, exact, dtype)
        arrays |= _vector(maker, operation, inputs, {name: (value, None) for name, value in exact.expected.items()})
        told.append(_case(maker, exact.case, True))
    file = f"{operation.name}/variant_{number}_{dtype}.npz"
    (folder / operation.name).mkdir(exist_ok=True)
    np.savez(folder / file, allow_pickle=False, **arrays)
    without = [name for name in operation.optional if overrides.get(name, name) is None]
    return VectorFile(file, dtype, number, describe.variants(operation)[number], without, told)


def _given(operation: Operation) -> Iterator[tuple[str, str, str]]:
    """(name, case, kernel or "") of the hard inputs, in space and in the plane, and of the clouds with every kernel."""
    dense = [DENSE] if takes_neighbours(operation) else []
    for name in (*cases.COMMON, *cases.in_plane(), *dense, *operation.cases):
        yield name, name, ""
    for kernel in SHAPES if shape_acts(operation) else ():
        for name in CLOUDS.values():
            yield f"{name}_{kernel}", name, kernel


def _case(name: str, case: cases.Case, closed_form: bool) -> VectorCase:
    return VectorCase(name, case.count, case.dim, case.spacing, case.support_radius, closed_form)


def _vector(
    case: str, operation: Operation, inputs: Inputs, answer: Mapping[str, tuple[Any, Any]]
) -> dict[str, np.ndarray]:
    values: dict[str, Any] = {}
    for name in operation.arguments("numpy"):
        values |= _flat(name, inputs[name])
    before = {name: inputs.output(operation, name) for name in operation.outputs if not inputs.dropped(name)}
    values |= {f"before/{name}": value for name, value in before.items()}
    bounds = allowed(operation, inputs, before, answer)
    for name, (value, _) in answer.items():
        if name in before:
            values[f"answer/{name}"] = np.asarray(value, dtype=float)
            values[f"bound/{name}"] = bounds[name]
    return {f"{case}/{name}": np.asarray(value) for name, value in values.items()}


def write_replay(target: Target) -> None:
    """Write the last call of a target into `replay.npz`: arguments, outputs before and after, answer and bound."""
    if "launch" not in target.last:
        return
    inputs, before, after = target.last["launch"]
    with np.errstate(all="ignore"):
        vector = _vector("", target.operation, inputs, oracle(target.operation, inputs))
    told = {name.removeprefix("/"): value for name, value in vector.items()}
    for kind, values in (("before", before), ("got", after)):
        told |= {f"{kind}/{name}": value for name, value in values.items()}
    np.savez(REPLAY, allow_pickle=False, **{k: v for k, v in told.items() if v.dtype.kind != "O"})
