"""Formulas of time, with their first and second derivatives.

A formula is read by Python's parser, and only what is named here is taken from it: nothing of it is executed.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from typing import NamedTuple

from refsim.core.checked import suggestion
from refsim.core.errors import InputError

LONGEST = 1000  # characters of a formula


class Jet(NamedTuple):
    """A function of time at one time: its value, first and second derivative; of a number alone, these are 0."""

    value: float
    first: float = 0.0
    second: float = 0.0

    def __add__(self, other: Jet) -> Jet:  # type: ignore[override]
        return Jet(*(a + b for a, b in zip(tuple(self), tuple(other))))

    def __neg__(self) -> Jet:
        return Jet(-self.value, -self.first, -self.second)

    def __sub__(self, other: Jet) -> Jet:
        return self + -other

    def __mul__(self, other: Jet) -> Jet:  # type: ignore[override]
        u, v = self, other
        return Jet(
            u.value * v.value,
            u.first * v.value + u.value * v.first,
            u.second * v.value + 2 * u.first * v.first + u.value * v.second,
        )

    def __truediv__(self, other: Jet) -> Jet:
        v = other.value
        return self * other.through(1 / v, -1 / v**2, 2 / v**3)

    def power(self, other: Jet) -> Jet:
        """self**other: of a constant exponent, or of a positive base."""
        n, v = other.value, self.value
        if other.first == 0 and other.second == 0:
            slope = n * v ** (n - 1) if n != 0 else 0.0
            bend = n * (n - 1) * v ** (n - 2) if n not in (0, 1) else 0.0
            return self.through(v**n, slope, bend)
        return FUNCTIONS["exp"](other * FUNCTIONS["log"](self))

    def through(self, value: float, slope: float, bend: float) -> Jet:
        """f(self), of a function with this value and these derivatives."""
        return Jet(value, slope * self.first, bend * self.first**2 + slope * self.second)


FUNCTIONS: dict[str, Callable[[Jet], Jet]] = {
    "sin": lambda x: x.through(math.sin(x.value), math.cos(x.value), -math.sin(x.value)),
    "cos": lambda x: x.through(math.cos(x.value), -math.sin(x.value), -math.cos(x.value)),
    "tan": lambda x: FUNCTIONS["sin"](x) / FUNCTIONS["cos"](x),
    "exp": lambda x: x.through(*(math.exp(x.value),) * 3),
    "log": lambda x: x.through(math.log(x.value), 1 / x.value, -1 / x.value**2),
    "sqrt": lambda x: x.through(root := math.sqrt(x.value), 0.5 / root, -0.25 / root**3),
    "tanh": lambda x: x.through(h := math.tanh(x.value), 1 - h * h, -2 * h * (1 - h * h)),
}
OPERATORS: dict[type, Callable[[Jet, Jet], Jet]] = {
    ast.Add: Jet.__add__, ast.Sub: Jet.__sub__, ast.Mult: Jet.__mul__, ast.Div: Jet.__truediv__, ast.Pow: Jet.power,
}  # fmt: skip


def parsed(text: str, owner: str) -> Callable[[Jet], Jet]:
    """The formula as a function of time. Raises InputError, which begins with `owner`, for anything else."""
    if len(text) > LONGEST:
        raise InputError(f"{owner}: formula has {len(text)} characters; give at most {LONGEST}.")
    try:
        tree = ast.parse(text.strip(), mode="eval")
        return _function(tree.body, owner)
    except (SyntaxError, ValueError):
        raise InputError(f"{owner}: formula {text!r} cannot be read; write one of t, as 0.01*sin(2*pi*t).") from None
    except (RecursionError, MemoryError):
        raise InputError(f"{owner}: formula is nested too deeply; write a shorter one.") from None


def _function(node: ast.expr, owner: str) -> Callable[[Jet], Jet]:
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
        number = Jet(float(node.value))
        return lambda t: number
    if isinstance(node, ast.Name):
        if node.id == "t":
            return lambda t: t
        if node.id == "pi":
            return lambda t: Jet(math.pi)
        raise InputError(f"{owner}: formula has the unknown name {node.id!r}; {suggestion(node.id, ('t', 'pi'))}")
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
        inner, negative = _function(node.operand, owner), isinstance(node.op, ast.USub)
        return lambda t: -inner(t) if negative else inner(t)
    if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        left, right, operator = _function(node.left, owner), _function(node.right, owner), OPERATORS[type(node.op)]
        return lambda t: operator(left(t), right(t))
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and len(node.args) == 1 and not node.keywords:
        if node.func.id not in FUNCTIONS:
            raise InputError(
                f"{owner}: formula has the unknown function {node.func.id!r}; {suggestion(node.func.id, FUNCTIONS)}"
            )
        argument, function = _function(node.args[0], owner), FUNCTIONS[node.func.id]
        return lambda t: function(argument(t))
    raise InputError(
        f"{owner}: formula has {ast.unparse(node)!r}, which is not arithmetic of t; use + - * / **, pi and"
        f" {', '.join(FUNCTIONS)}."
    )
