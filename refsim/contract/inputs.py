"""All that an operation names, on one case, on one backend: what the steps of the ladder run on."""

import functools
import importlib
import itertools
import sys
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from refsim.backends.arrays import Backend, Scratch, choose, on_backend
from refsim.core import cases
from refsim.core.cases import TAKES, VARIATIONS, Variation
from refsim.core.effect import Field
from refsim.core.operation import REGISTRY, Fused, Operation
from refsim.core.period import Period
from refsim.core.walls import WallParticles, with_list
from refsim.neighbours import NeighbourSearch
from refsim.neighbours.reference import pair_blocks
from refsim.smoothing import SHAPES, Smoothing, smoothing
from refsim.smoothing.shapes import WENDLAND_C2

LISTS = ("search", "all_pairs")


def unset(dtype: np.dtype) -> Any:
    """The value that stands in outputs which no program has written: NaN, or the largest integer."""
    return np.nan if dtype.kind == "f" else np.iinfo(dtype).max


def unwritten(before: Mapping[str, np.ndarray], after: Mapping[str, np.ndarray], given: Any = ()) -> Iterator[str]:
    """Names of outputs in which every entry is as unset as it was; those of `given` were set by the trial."""
    for name, values in before.items():
        both = (values, after[name]) if name not in given and values.size else ()
        if both and all(np.array_equal(v, np.full_like(v, unset(v.dtype)), equal_nan=True) for v in both):
            yield name


@functools.cache
def fields() -> dict[str, Field]:
    """All fields that some method's package declares, by name."""
    folders = {operation.folder for operation in REGISTRY.values()}
    for folder in folders:
        importlib.import_module(folder)
    packages = {folder.partition(".")[0] for folder in folders}
    modules = [module for name, module in sorted(sys.modules.items()) if name.partition(".")[0] in packages]
    return {v.name: v for module in modules for v in vars(module).values() if isinstance(v, Field)}


class Inputs:
    """Arguments by name on the host, already rounded to `dtype`, so that every program gets the same numbers.

    case       what they are made from
    order      permutation of the particles (into cell order); none by default
    overrides  values that replace the case's own; None drops an optional argument
    """

    def __init__(
        self, case: cases.Case, dtype: str, order: np.ndarray | None = None, overrides: Mapping[str, Any] | None = None
    ) -> None:
        cases.discover()
        self.case, self.dtype, self.order = case, dtype, order
        self._values: dict[str, Any] = dict(overrides or {})
        self._derived: set[str] = set()  # made from others that may be replaced

    def replaced(self, **overrides: Any) -> "Inputs":
        """The same with other values; arrays must stand in this object's order of particles."""
        kept = {name: value for name, value in self._values.items() if name not in self._derived}
        return Inputs(self.case, self.dtype, self.order, {**kept, **overrides})

    def __getitem__(self, name: str) -> Any:
        """The argument `name`; the walls come as WallParticles. KeyError where nothing makes it."""
        if name not in self._values:
            self._values[name] = self._made(name)
        return self._values[name]

    def dropped(self, name: str) -> bool:
        """Whether the argument is None here."""
        return name in self._values and self._values[name] is None

    def per_particle(self, name: str) -> bool:
        """Whether the argument has one row for each particle."""
        if name in cases.PARTICLES:
            return True
        return name in fields() and name not in cases.GROUPS and fields()[name].rows is None

    def output(self, operation: Operation, name: str) -> Any:
        """Values that output `name` has before the launch: its own where it is read, else values that show neglect."""
        if self.dropped(name):
            return None
        if name in operation.adds or name in operation.arguments("numpy") or not self.per_particle(name):
            return np.array(self[name])
        kind = fields()[name]
        dtype = kind.numpy_dtype(self.dtype)
        return np.full(kind.shape(len(self["position"])), unset(dtype), dtype)

    def _made(self, name: str) -> Any:
        if name == "walls":
            return self["wall_particles"]
        if name == "place":
            return np.argsort(self["identity"], kind="stable").astype(np.int32)
        if name in cases.DERIVED:
            self._derived.add(name)
            return cases.DERIVED[name](self, name)
        if name in cases.PARTICLES:
            values = np.asarray(cases.PARTICLES[name](self.case, self.case.random(name)))
            values = values.astype(self.dtype) if values.dtype.kind == "f" else values
            return values if self.order is None else values[self.order]
        if name in cases.GROUPS:
            made = cases.GROUPS[name](self.case, self.case.grid(self.dtype))
            return made[name]
        raise KeyError(
            f"nothing makes the argument {name!r}: mark a function with refsim.core.cases.particles or .groups in the"
            " method folder's cases.py"
        )


@functools.cache
def prepared(
    case_name: str, backend_name: str, dtype: str, lists: str = "search", period: Period | None = None
) -> tuple[Inputs, Any, Any]:
    """(inputs in cell order, neighbours, walls with their list) of a case by name; both lists on the backend."""
    cases.discover()
    return prepare(cases.CASES[case_name](), backend_for(backend_name), dtype, lists, period)


def period_of(operation: Operation, inputs: Inputs) -> Period | None:
    """The periodic box of these inputs; None without one, and for an operation that takes none."""
    return inputs["period"] if "period" in operation.arguments("numpy") else None


@functools.cache
def backend_for(name: str) -> Backend:
    """The backend called `name`; InputError where it cannot run here."""
    return choose(name)


def prepare(
    case: cases.Case, backend: Backend, dtype: str, lists: str = "search", period: Period | None = None
) -> tuple[Inputs, Any, Any]:
    """(inputs, neighbours, walls with their list) of a case; `lists` by the backend's "search" or "all_pairs".

    With "none" there are no lists, and the particles are in a random order.
    """
    inputs = Inputs(case, dtype)
    if backend.name == "numpy":
        return inputs, None, inputs["walls"]
    if lists == "none":
        return Inputs(case, dtype, case.random("order").permutation(case.count)), None, None
    if lists == "all_pairs":
        return inputs, *all_pairs(inputs, backend, period)
    search = NeighbourSearch(backend, case.dim, dtype, case.list_radius, case.skin, period)
    order = search.order(backend.asarray(inputs["position"]))
    inputs = Inputs(case, dtype, backend.host(order))
    position = backend.asarray(inputs["position"])
    neighbours = search.build(position)
    walls = inputs["walls"]
    static = search.static_set(walls.position)
    walls = WallParticles(walls.position[static.order], walls.volume[static.order])
    listed_walls = with_list(static.position, backend.asarray(walls.volume), search.build_against(position, static))
    return inputs.replaced(walls=walls), neighbours, listed_walls


def all_pairs(inputs: Inputs, backend: Backend, period: Period | None = None) -> tuple[Any, Any]:
    """(neighbours, walls with their list) from the oracle's pairs, for particles in any order."""
    radius = inputs.case.list_radius * (1 + inputs.case.skin)
    position, walls = inputs["position"], inputs["walls"]
    lists = listed(position, position, radius, True, backend, period)
    if walls is None:
        return lists, None
    near = listed(position, walls.position, radius, False, backend, period)
    return lists, with_list(backend.asarray(walls.position), backend.asarray(walls.volume), near)


def listed(
    query: np.ndarray, source: np.ndarray, radius: float, exclude_self: bool, backend: Backend,
    period: Period | None = None,
) -> Any:  # fmt: skip
    """The sources nearer than `radius` [m] to each query, as the backend's kernels take them."""
    from refsim.neighbours.rows import NeighbourColumns, NeighbourRows  # which load Numba

    counts, indices = [np.zeros(0, int)], [np.zeros(0, int)]
    for place, _, distance in pair_blocks(query, source, period=period):
        near = distance < radius
        if exclude_self:
            near &= np.arange(len(query))[place, None] != np.arange(len(source))[None, :]
        counts.append(near.sum(1))
        indices.append(near.nonzero()[1])
    count, index = np.concatenate(counts).astype(np.int32), np.concatenate(indices).astype(np.uint32)
    start = np.cumsum(count, dtype=np.int64) - count
    if backend.name == "cuda":
        columns = np.zeros((max(count.max(initial=0), 1), len(count)), np.uint32)
        columns[np.arange(len(index)) - start.repeat(count), np.arange(len(count)).repeat(count)] = index
        return NeighbourColumns(backend.asarray(count), backend.asarray(columns.reshape(-1)))
    return NeighbourRows(start, count, np.append(index, np.uint32(0)))


def value_of(operation: Operation, name: str, inputs: Inputs, neighbours: Any, walls: Any, backend: Backend) -> Any:
    """The argument `name` of the operation, on the backend."""
    if name in operation.outputs:
        return on_backend(inputs.output(operation, name), backend)
    if name == "neighbours":
        return neighbours
    if name == "liquid_near_walls":
        case, position = inputs.case, inputs["position"]
        radius = case.list_radius * (1 + case.skin)
        near = listed(inputs["walls"].position, position, radius, False, backend, period_of(operation, inputs))
        return with_list(backend.asarray(position), None, near)
    if name == "scratch":
        return Scratch(backend)
    if name == "walls" and not inputs.dropped(name):
        return walls
    return on_backend(inputs[name], backend)


def as_in_runs(value: Any) -> Any:
    """A value as refsim's own programs for a CPU get it: the default smoothing kernel as in a run, with a shape that
    the compiler knows. All other shapes share a program, which is compiled once.
    """
    return value.fixed() if isinstance(value, Smoothing) and value.shape == WENDLAND_C2 else value


def with_variant(inputs: Inputs, variant: Mapping[str, Any]) -> Inputs:
    """Inputs with a variant's overrides; see Operation."""
    if not variant:
        return inputs.replaced()
    grid = inputs.case.grid(inputs.dtype)

    def made(name: str, override: Any) -> Any:
        if isinstance(override, Mapping):
            group = inputs[name]
            return group._replace(**{key: type(getattr(group, key))(value) for key, value in override.items()})
        return override(inputs.case, grid) if callable(override) else override

    return inputs.replaced(**{name: made(name, override) for name, override in variant.items()})


def arguments_of_others(operation: Operation, arrays: str) -> tuple[str, ...]:
    """Names of what other programs are given on `arrays`, in order: no objects of refsim, but arrays and numbers."""
    cases.discover()
    given = (cases.STAND_INS.get(name, (name,)) for name in operation.arguments(arrays))
    return tuple(dict.fromkeys(itertools.chain.from_iterable(given)))


# Altered inputs


def subset(operation: Operation, inputs: Inputs, keep: np.ndarray) -> Inputs:
    """The same with some of the particles, in this order."""
    names = {*operation.arguments("numpy"), *operation.outputs}
    kept = [n for n in names if inputs.per_particle(n) and not inputs.dropped(n)]
    return inputs.replaced(**{n: inputs[n][keep] for n in kept})


def without_walls(inputs: Inputs) -> Inputs:
    """The same without wall particles; where they are left out, as they are."""
    if inputs.dropped("walls"):
        return inputs
    return inputs.replaced(walls=WallParticles(np.zeros((0, 3), inputs.dtype), np.zeros(0, inputs.dtype)))


# Other values for the members of parameter groups

KERNELS = ("smoothing", "gradient_smoothing")  # arguments that are smoothing kernels


def groups_of(operation: Operation, inputs: Inputs) -> dict[str, Any]:
    """Parameter groups that the operation takes, by argument name."""
    taken = {name: inputs[name] for name in operation.arguments("numpy")}
    return {name: value for name, value in taken.items() if isinstance(value, tuple) and hasattr(value, "_fields")}


def varied(operation: Operation, inputs: Inputs) -> Iterator[tuple[str, str, Inputs]]:
    """(group, member, inputs) with another value of each number in each group, and of what follows from it.

    Places in space lie in no plane, so that the dimension changes where they lie in one, which lies in space.
    """
    for name, group in groups_of(operation, inputs).items():
        rule = VARIATIONS.get(type(group), Variation())
        follows = rule.follow(group, inputs, kernel_of(operation, inputs))
        for member, value in zip(group._fields, group):
            alone = np.ndim(value) == 0 and member not in follows and member not in rule.held
            if alone and (member != "dim" or inputs.case.dim == 2):
                usual = 0.9 * float(value) if isinstance(value, (float, np.floating)) else value - 1 if value else 1
                other = rule.other[member](value) if member in rule.other else usual
                changed = group._replace(**{member: type(value)(other)})
                yield name, member, followed(operation, inputs.replaced(**{name: changed}))


def acts(operation: Operation, name: str, member: str, inputs: Inputs) -> bool:
    """Whether the member of group `name` is said to change the operation's answer."""
    said = _said(operation, name, VARIATIONS.get(type(inputs[name]), Variation()).usual)
    return said is None or member in said


def _said(operation: Operation, name: str, usual: tuple[str, ...] | None) -> tuple[str, ...] | None:
    """Members of group `name` that are said to act, of a fused program those of all parts; None for all."""
    if not isinstance(operation, Fused):
        return TAKES.get((operation.name, name), usual)
    called = operation.together.called
    takers = [(p, arg) for p in operation.parts for arg in p.arguments("numpy") if called(p, arg) == name]
    said = [_said(part, argument, usual) for part, argument in takers]
    return None if None in said else tuple(member for members in said for member in members or ())


def followed(operation: Operation, inputs: Inputs) -> Inputs:
    """The same with the members that follow from others computed anew."""
    made = {}
    for name, group in groups_of(operation, inputs).items():
        values = VARIATIONS.get(type(group), Variation()).follow(group, inputs, kernel_of(operation, inputs))
        if values:
            made[name] = group._replace(**{k: type(getattr(group, k))(v) for k, v in values.items()})
    return inputs.replaced(**made)


def kernel_of(operation: Operation, inputs: Inputs) -> Any:
    """The smoothing kernel whose support radius the operation's other groups are made for; None where it has none."""
    names = [name for name in KERNELS if name in operation.arguments("numpy")]
    return inputs[names[0]] if names else None


def shape_acts(operation: Operation) -> tuple[str, ...]:
    """The smoothing kernels that the operation takes and whose shape changes its answer."""
    there = [name for name in KERNELS if name in operation.arguments("numpy")]
    said = {name: _said(operation, name, None) for name in there}
    return tuple(name for name, members in said.items() if members is None or "shape" in members)


def with_kernel(operation: Operation, inputs: Inputs, kernel: str) -> Inputs:
    """The same with the smoothing kernel of this name, or the two of "value gradient", and what follows from it."""
    words, taken = kernel.split(), operation.arguments("numpy")
    shapes = dict(zip(KERNELS, (words[0], words[-1])))
    given = {name: inputs[name] for name in KERNELS if name in taken}
    made = {n: smoothing(shapes[n], float(k.support_radius), int(k.dim), inputs.dtype) for n, k in given.items()}
    return followed(operation, inputs.replaced(**made)) if made else inputs


def scaled(operation: Any, inputs: Inputs, share: float) -> Inputs:
    """The same with a support radius of `share` times its own in every group that has one."""
    made: dict[str, Any] = {}
    for name, group in groups_of(operation, inputs).items():
        if name in KERNELS:
            shape = next(s for s, number in SHAPES.items() if number == group.shape)
            made[name] = smoothing(shape, share * float(group.support_radius), int(group.dim))
        elif "support_radius" in group._fields:
            made[name] = group._replace(support_radius=share * float(group.support_radius))
    return followed(operation, inputs.replaced(**made))
