"""Tuples of numbers entry by entry, and 3 x 3 matrices as tuples of nine, row by row: for formulas.

An array with the fields of particles or nodes has a row for each; `three` and `nine` read one, `put` writes one.
"""

import ast
import functools
import inspect
import re

from refsim.backends.compile import formula, overloaded
from refsim.backends.written import function_of, source_of


def entrywise(function):
    """A formula of tuples from one of their entries; arguments that are no tuples are the same for all entries."""
    names = list(inspect.signature(function).parameters)
    overloaded(function, lambda *kinds: function, forceinline=True)

    @functools.cache
    def unrolled(*lengths):
        """The formula for tuples of these lengths, 0 for what is no tuple."""
        *before, last = source_of(function).tree.body
        docstring = [f"    {ast.unparse(part)}" for part in before[:1]]
        entry = f"({ast.unparse(last.value)})" if len(before) < 2 else f"entry({', '.join(names)})"
        tuples = re.compile(rf"\b({'|'.join(name for name, length in zip(names, lengths) if length)})\b")
        entries = (tuples.sub(rf"\1[{k}]", entry) for k in range(max(lengths)))
        head = f"def {function.__name__}({', '.join(names)}):"
        text = "\n".join([head, *docstring, f"    return ({', '.join(entries)},)\n"])
        path = f"<{function.__module__}.{function.__name__} {lengths}>"
        return function_of(text, function.__name__, path, {**function.__globals__, "entry": function})

    def for_kinds(kinds):
        """That for types of Numba, or for kinds of `refsim.backends.written`."""
        return unrolled(*(len(getattr(kind, "types", getattr(kind, "parts", ()))) for kind in kinds))

    @functools.wraps(function)
    def every(*values):
        return unrolled(*[len(value) if isinstance(value, tuple) else 0 for value in values])(*values)

    every.written = for_kinds
    return overloaded(every, lambda *kinds: for_kinds(kinds), forceinline=True)


@entrywise
def added(a, b):
    """a + b."""
    return a + b


@entrywise
def difference(a, b):
    """a - b."""
    return a - b


@entrywise
def scaled(a, factor):
    """factor a."""
    return factor * a


@entrywise
def over(a, divisor):
    """a/divisor."""
    return a / divisor


@entrywise
def two_of(u, a, v, b):
    """u a + v b."""
    return u * a + v * b


@entrywise
def three_of(u, a, v, b, w, c):
    """u a + v b + w c."""
    return u * a + v * b + w * c


@entrywise
def converted(a, real):
    """The entries as `real`."""
    return real(a)


@entrywise
def least_of(a, b, c):
    """The least of three."""
    return min(a, b, c)


@entrywise
def greatest_of(a, b, c):
    """The greatest of three."""
    return max(a, b, c)


# Rows of arrays


@formula
def three(values, i):
    """Row i of an array (n, 3)."""
    return values[i, 0], values[i, 1], values[i, 2]


@formula
def triple(values, i, k):
    """The k-th vector in row i of an array (n, 3 m)."""
    return values[i, 3 * k], values[i, 3 * k + 1], values[i, 3 * k + 2]


@formula
def nine(values, i):
    """Row i of an array (n, 9)."""
    return (
        values[i, 0], values[i, 1], values[i, 2], values[i, 3], values[i, 4], values[i, 5], values[i, 6], values[i, 7],
        values[i, 8],
    )  # fmt: skip


@formula
def put(values, i, numbers):
    """values[i, :] = numbers."""
    for c in range(len(numbers)):
        values[i, c] = numbers[c]


@formula
def dot(a, b):
    """a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@formula
def cross(a, b):
    """a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


# Matrices


@formula
def outer(a, b):
    """a b^T."""
    return (
        a[0] * b[0], a[0] * b[1], a[0] * b[2], a[1] * b[0], a[1] * b[1], a[1] * b[2], a[2] * b[0], a[2] * b[1],
        a[2] * b[2],
    )  # fmt: skip


@formula
def symmetric(s):
    """The matrix of (xx, xy, xz, yy, yz, zz)."""
    return s[0], s[1], s[2], s[1], s[3], s[4], s[2], s[4], s[5]


@formula
def transposed(m):
    """M^T."""
    return m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]


@formula
def times(m, v):
    """M v."""
    return (
        m[0] * v[0] + m[1] * v[1] + m[2] * v[2],
        m[3] * v[0] + m[4] * v[1] + m[5] * v[2],
        m[6] * v[0] + m[7] * v[1] + m[8] * v[2],
    )


@formula
def less_times(a, m, v):
    """a - M v."""
    return (
        a[0] - m[0] * v[0] - m[1] * v[1] - m[2] * v[2],
        a[1] - m[3] * v[0] - m[4] * v[1] - m[5] * v[2],
        a[2] - m[6] * v[0] - m[7] * v[1] - m[8] * v[2],
    )


@formula
def product(a, b):
    """A B."""
    turned = transposed(b)
    x, y, z = times(a, turned[0:3]), times(a, turned[3:6]), times(a, turned[6:9])
    return x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]


@formula
def trace(m):
    """tr M."""
    return m[0] + m[4] + m[8]


@formula
def determinant(m):
    """det M."""
    return m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) + m[2] * (m[3] * m[7] - m[4] * m[6])
