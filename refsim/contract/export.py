"""Test vectors for programs in any language: inputs, answer and bound of every case, as npz files and one JSON index.

In FILE.npz (a zip file of uncompressed npy files) an array is called CASE/NAME: an argument by its name, a member of a
parameter group by GROUP.MEMBER, what stands in an output before the call by before/OUTPUT, what must stand there after
it by answer/OUTPUT and the largest error allowed in each row by bound/OUTPUT. A row with a NaN in its answer must not
be finite, one with an infinite bound may be anything. An argument without an array is None.
"""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from refsim.contract import describe, properties
from refsim.contract.answers import CLOUDS, DENSE, FEW, LARGE, exact_forms, extended, sampled
from refsim.contract.bounds import Bounds, oracle, takes_neighbours
from refsim.contract.inputs import Inputs, arguments_of_others, shape_acts, unset, varied, with_kernel, without_walls
from refsim.contract.target import Answer, Target
from refsim.core import cases
from refsim.core.errors import InputError
from refsim.core.operation import REGISTRY, Operation
from refsim.core.versions import VERSION
from refsim.core.writing import made_by, write_file
from refsim.smoothing import SHAPES

FORMAT = 2
REPLAY = "replay.npz"  # of `write_replay`
INDEX, SCHEMA, READER = "vectors.json", "vectors.schema.json", "refsim_vectors.h"


class VectorCase(msgspec.Struct, frozen=True):
    """One case of a file. The answer is worked out by hand in step T1 of the ladder, else it is the reference's.

    like  in T5 the case that holds the same particles, described otherwise
    """

    name: str
    step: str
    like: str
    particles: int
    dim: int
    spacing: float
    support_radius: float


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

    adds   outputs to whose values before the operation adds
    exact  outputs that agree exactly: their bound is 0, or infinite where a rounding may decide
    """

    name: str
    paper: str
    equation: str
    arguments: list[describe.Argument]
    outputs: list[str]
    adds: list[str]
    exact: list[str]
    files: list[VectorFile]


class Vectors(msgspec.Struct, frozen=True):
    """The index of a folder of test vectors."""

    format: int
    refsim: str
    operations: list[VectorOperation]


def export(
    folder: Path,
    names: Sequence[str] = (),
    dtypes: Sequence[str] = (),
    variants: Sequence[int] = (),
    begins: Callable[[str], None] = lambda name: None,
) -> Vectors:
    """Write the vectors of the operations (all by default), with a reader for C++, into a new or empty folder and
    return their index; `begins` is told each operation's name.

    Raises InputError for a folder that cannot be written or holds files.
    """
    cases.discover()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise InputError(f"--export {folder}: the folder holds files; give a new one.")
    except OSError as error:
        raise InputError(f"--export {folder} cannot be written: {error.strerror}; give another folder.") from None
    exported = []
    for name in names or REGISTRY:
        begins(name)
        operation = extended(name)
        chosen = [k for k in range(len(operation.variants)) if not variants or k in variants]
        both = dtypes or ("float32", "float64")
        files = [_written(folder, operation, dtype, variant) for dtype in both for variant in chosen]
        told = describe.arguments(operation, "numpy")
        outputs, adds, exact = map(list, (operation.outputs, operation.adds, operation.exact))
        exported.append(VectorOperation(name, operation.paper, operation.equation, told, outputs, adds, exact, files))
    vectors = Vectors(FORMAT, VERSION, exported)
    write_file(folder / INDEX, msgspec.json.format(msgspec.json.encode(vectors), indent=1))
    write_file(folder / SCHEMA, msgspec.json.format(msgspec.json.encode(msgspec.json.schema(Vectors)), indent=1))
    write_file(folder / READER, resources.files("refsim.contract").joinpath(READER).read_bytes())
    return vectors


def flat(name: str, value: Any) -> dict[str, Any]:
    """{name: array or number}; members of groups by "group.member", nothing for None."""
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return {k: v for field, part in zip(value._fields, value) for k, v in flat(f"{name}.{field}", part).items()}
    return {} if value is None else {name: value}


def _written(folder: Path, operation: Operation, dtype: str, number: int) -> VectorFile:
    arrays: dict[str, np.ndarray] = {}
    told = []
    for vector in _vectors(Target(operation, "numpy", dtype, number)):
        case = vector.inputs.case
        arrays |= vector.arrays(operation)
        sizes = case.count, case.dim, case.spacing, case.support_radius
        told.append(VectorCase(vector.name, vector.step, vector.like, *sizes))
    file = f"{operation.name}/variant_{number}_{dtype}.npz"
    (folder / operation.name).mkdir(exist_ok=True)
    write_file(folder / file, made_by(np.savez, allow_pickle=False, **arrays))
    overrides = operation.variants[number]
    without = [name for name in operation.optional if overrides.get(name, name) is None]
    return VectorFile(file, dtype, number, describe.variants(operation)[number], without, told)


@dataclass(frozen=True)
class _Vector:
    """One case: see VectorCase."""

    name: str
    step: str
    inputs: Inputs
    answer: Answer  # in the oracle's form, without scales where it is exact
    like: str = ""
    free: Mapping[str, np.ndarray] = field(default_factory=dict)  # rows of each output that may be anything
    measured: Inputs | None = None  # on which the bound is measured where `inputs` hold a NaN
    rows: np.ndarray | None = None  # of particles that the answer has; others may be anything
    invariants: Mapping[str, float] = field(default_factory=dict)  # largest size of a total of m a; 0 of dissipation

    def arrays(self, operation: Operation) -> dict[str, np.ndarray]:
        """The arrays of the file that belong to the case, by name."""
        values: dict[str, Any] = {}
        for name in arguments_of_others(operation, "numpy"):
            values |= flat(name, self.inputs[name])
        outputs = [name for name in operation.outputs if not self.inputs.dropped(name)]
        before = {name: self.inputs.output(operation, name) for name in outputs}
        for name, start in before.items():
            if name not in (*operation.adds, *operation.arguments("numpy")):  # which is neither read nor added to
                before[name] = np.full_like(start, unset(start.dtype))
            elif self.step == "T4" and name in operation.adds:
                before[name] = 0 * start
        values |= {f"before/{name}": value for name, value in before.items()}
        values |= {f"invariant/{name}": np.float64(value) for name, value in self.invariants.items()}
        bounds = Bounds(operation, self.measured or self.inputs, self.rows)
        for name in (name for name in outputs if name in self.answer):
            answer, scale = np.asarray(self.answer[name][0], dtype=float), self.answer[name][1]
            *_, largest = bounds.growing(name, answer, scale, bounds.rows_of(name, before[name]))
            bound = np.where(self.free.get(name, False), np.inf, largest.max(tuple(range(1, largest.ndim))))
            if self.rows is not None and self.inputs.per_particle(name):
                (some, most), count = (answer, bound), self.inputs.case.count
                answer, bound = np.zeros((count, *some.shape[1:])), np.full(count, np.inf)
                answer[self.rows], bound[self.rows] = some, most
            start = before[name].astype(float) if name in operation.adds else 0.0
            values[f"answer/{name}"] = start + answer
            values[f"bound/{name}"] = bound
        prefix = f"{self.name}/" if self.name else ""
        return {f"{prefix}{name}": np.asarray(value, order="C") for name, value in values.items()}


def _vectors(target: Target) -> Iterator[_Vector]:
    """The cases of one variant in one precision, in the order of the ladder's steps."""
    operation = target.operation
    for name, exact, inputs in exact_forms(operation, operation.variants[target.variant], target.dtype):
        yield _Vector(name, "T1", inputs, {name: (value, None) for name, value in exact.expected.items()})
    dense = [DENSE] if takes_neighbours(operation) else []
    hard = [(name, name, "") for name in (*cases.COMMON, *cases.IN_PLANE, *dense, *operation.cases)]
    kernels = itertools.product(SHAPES if shape_acts(operation) else (), CLOUDS.values())
    for name, case, kernel in (*hard, *((f"{case}_{kernel}", case, kernel) for kernel, case in kernels)):
        inputs = target.varied(Inputs(cases.CASES[case](), target.dtype))
        inputs = with_kernel(operation, inputs, kernel) if kernel else inputs
        yield _Vector(name, "T2", inputs, oracle(operation, inputs))
    for case in LARGE.values():
        inputs, rows = target.varied(Inputs(cases.CASES[case](), target.dtype)), sampled(case)
        yield _Vector(case, "T3", inputs, oracle(operation, inputs, rows), rows=rows)
    for case in CLOUDS.values():
        yield from _conserved(target, case)
    for case in CLOUDS.values():
        usual, like = properties.Usual(target, properties.on_grid(target, case)), f"{case}_on_a_grid"
        others = properties.descriptions(usual)
        if others:
            yield _Vector(like, "T5", usual.inputs, usual.expected)
        for name, described in others.items():
            inputs = described()[0]
            yield _Vector(f"{like}_{name.replace(' ', '_')}", "T5", inputs, oracle(operation, inputs), like)
    for case in CLOUDS.values():
        usual = properties.Usual(target, properties.on_grid(target, case))
        for name in properties.spoilable(operation, usual.inputs):
            given, right = properties.Spoiled(usual, name), usual.inputs
            at = f"{case}_nan_in_{name}"
            yield _Vector(at, "T9", given.inputs, given.answer, free=given.free, measured=right)
    for case in FEW.values():
        for group, member, inputs in varied(operation, target.varied(Inputs(cases.CASES[case](), target.dtype))):
            answer = oracle(operation, inputs)
            if all(len(value) == len(inputs.output(operation, name)) for name, (value, _) in answer.items()):
                yield _Vector(f"{case}_other_{group}.{member}", "T10", inputs, answer)


def _conserved(target: Target, case: str) -> Iterator[_Vector]:
    """Inputs without walls, on which totals are held to what is conserved; one beside it has another velocity."""
    usual, operation = without_walls(properties.on_grid(target, case)), target.operation
    kept = [name for name in properties.held(target) if name in properties.CONSERVED]
    momenta, rest = [name for name in kept if name.endswith("momentum")], 0 * usual["velocity"]
    allowances = properties.force_bound(target, usual) if momenta else rest
    totals = {name: properties.total(name, usual, rest, allowances)[1] for name in momenta}
    if kept:
        yield _Vector(f"{case}_alone", "T4", usual, oracle(operation, usual), invariants=totals)
    for name in (name for name in kept if name not in totals):
        for number, inputs in enumerate(properties.CONSERVED[name][0](usual)):
            like, bound = (f"{case}_alone", {}) if name == "galilean" else ("", {name: 0.0})
            yield _Vector(f"{case}_{name}_{number}", "T4", inputs, oracle(operation, inputs), like, invariants=bound)


def write_replay(target: Target) -> None:
    """Write the last call of a target into `replay.npz`: arguments, outputs before and after, answer and bound."""
    if "launch" not in target.last:
        return
    inputs, before, after = target.last["launch"]
    with np.errstate(all="ignore"):
        told = _Vector("", "", inputs, oracle(target.operation, inputs)).arrays(target.operation)
    for kind, values in (("before", before), ("got", after)):
        told |= {f"{kind}/{name}": value for name, value in values.items()}
    write_file(REPLAY, made_by(np.savez, allow_pickle=False, **told))
