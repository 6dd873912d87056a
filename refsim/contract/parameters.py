"""Other values for the members of parameter groups, one member at a time."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from refsim.contract.inputs import Inputs
from refsim.core.cases import TAKES, VARIATIONS, Variation
from refsim.core.operation import Fused, Operation
from refsim.smoothing import SHAPES, smoothing

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
                changed = group._replace(**{member: type(value)(_other(rule, member, value))})
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
    shapes = kernel.split()
    made = {}
    for name, shape in zip(KERNELS, (shapes[0], shapes[-1])):
        if name in operation.arguments("numpy"):
            smoothing_kernel = inputs[name]
            made[name] = smoothing(
                shape, float(smoothing_kernel.support_radius), int(smoothing_kernel.dim), inputs.dtype
            )
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


def _other(rule: Variation, member: str, value: Any) -> Any:
    if member in rule.other:
        return rule.other[member](value)
    if isinstance(value, (float, np.floating)):
        return 0.9 * float(value)
    return 1 if value == 0 else value - 1
