"""Numbers that carry their size, the sum of the absolute terms behind them, and decisions that carry their margin.

The size is what a bound of rounding needs: of a number from outside its absolute value, of a sum or difference the sum
of the sizes, of a product their product, of a quotient a/b size(a) size(b)/b^2, of a power x^n |n x^(n-1)| size(x).
`rank` is 0 for numbers, 1 for vectors, 2 for matrices, whose entries stand last: a number times a vector is a vector,
`a @ b` the product of vectors or matrices. A comparison is a Decision; its margin is the difference over the larger
size, positive where it holds: `&` takes the smaller margin, `|` the larger, `~` the negative.
Both unpack as a reference returns them: `value, size = terms`, `flags, margin = decision`.
"""

import numpy as np

SMALL = 1e-3  # times sizes: more than roundings change, so that what is smaller counts as second order


class Decision:
    """Flags with the relative distance from flipping, `margin`, positive where they hold."""

    __array_ufunc__ = None  # NumPy leaves mixed operations to the methods below

    def __init__(self, margin, holds=None):
        self.margin = np.asarray(margin, dtype=float)
        self.holds = self.margin > 0 if holds is None else np.asarray(holds)

    def __iter__(self):
        return iter((self.holds.astype(np.uint8), np.abs(self.margin)))

    def __and__(self, other):
        return Decision(np.minimum(self.margin, other.margin), self.holds & other.holds)

    def __or__(self, other):
        return Decision(np.maximum(self.margin, other.margin), self.holds | other.holds)

    def __invert__(self):
        return Decision(-self.margin, ~self.holds)


class Terms:
    """Numbers, vectors or matrices with the sum of the absolute terms behind each entry."""

    __array_ufunc__ = None
    __slots__ = ("rank", "stated_size", "value")

    def __init__(self, value, size=None, rank=0):
        self.value = np.asarray(value, dtype=float)
        self.stated_size, self.rank = size, rank  # a size that is not given is the absolute value

    @property
    def size(self):
        return np.abs(self.value) if self.stated_size is None else self.stated_size

    def __iter__(self):
        return iter((self.value, self.size))

    def at(self, rows):
        """Those of some rows."""
        return Terms(self.value[rows], None if self.stated_size is None else self.stated_size[rows], self.rank)

    def __add__(self, other):
        a, b = alike(self, other)
        return Terms(a.value + b.value, a.size + b.size, a.rank)

    def __sub__(self, other):
        a, b = alike(self, other)
        return Terms(a.value - b.value, a.size + b.size, a.rank)

    def __mul__(self, other):
        a, b = alike(self, other)
        if a.stated_size is b.stated_size is None:
            return Terms(a.value * b.value, None, a.rank)
        size = a.size * b.size
        if a.stated_size is not None and b.stated_size is not None:
            size = size - (1 - SMALL) * (a.size - np.abs(a.value)) * (b.size - np.abs(b.value))
        return Terms(a.value * b.value, size, a.rank)

    def __truediv__(self, other):
        a, b = alike(self, other)
        if b.stated_size is not None:
            return a * Terms(1 / b.value, b.size / b.value**2, b.rank)
        return Terms(a.value / b.value, None if a.stated_size is None else a.size / b.size, a.rank)

    def __matmul__(self, other):
        a, b = self, terms(other)
        products = {(1, 1): np.vecdot, (2, 2): np.matmul, (2, 1): lambda m, v: (m @ v[..., None])[..., 0]}
        product = products[a.rank, b.rank]
        return Terms(product(a.value, b.value), product(a.size, b.size), a.rank + b.rank - 2)

    def __pow__(self, n):
        return Terms(self.value**n, abs(n) * np.abs(self.value) ** (n - 1) * self.size, self.rank)

    def __bool__(self):
        raise TypeError("Terms are no condition: use `where`.")

    def __neg__(self):
        return Terms(-self.value, self.stated_size, self.rank)

    def __rsub__(self, other):
        return terms(other) - self

    def __rtruediv__(self, other):
        return terms(other) / self

    __radd__, __rmul__ = __add__, __mul__

    def __le__(self, other):
        return _compared(self, other, np.less_equal)

    def __lt__(self, other):
        return _compared(self, other, np.less)

    def __ge__(self, other):
        return _compared(terms(other), self, np.less_equal)

    def __gt__(self, other):
        return _compared(terms(other), self, np.less)


def terms(x):
    """`x` as Terms: an array of one axis is a vector, of two a matrix; a decision is 1 where it holds."""
    if isinstance(x, Decision):
        return Terms(x.holds)
    return x if isinstance(x, Terms) else Terms(x, rank=np.ndim(x))


def alike(a, b):
    """Both as Terms of the larger rank."""
    a, b = terms(a), terms(b)
    return (_raised(a, b.rank), b) if a.rank < b.rank else (a, _raised(b, a.rank))


def _raised(x, rank):
    if x.rank == rank:
        return x
    axes = (..., *(None,) * (rank - x.rank))
    return Terms(x.value[axes], None if x.stated_size is None else x.stated_size[axes], rank)


def _compared(a, b, holds):
    a, b = terms(a), terms(b)
    largest = np.maximum(a.size, b.size)
    return Decision((b.value - a.value) / np.where(largest > 0, largest, 1.0), holds(a.value, b.value))


def where(condition, a, b):
    """a where the condition (flags as Terms, or a Decision) holds, else b."""
    a, b = alike(a, b)
    condition = np.expand_dims(terms(condition).value != 0, tuple(range(-a.rank, 0)))
    return Terms(np.where(condition, a.value, b.value), np.where(condition, a.size, b.size), a.rank)


def maximum(a, b):
    """The larger one; of two so near that a rounding may decide with the larger size."""
    a, b = alike(a, b)
    apart, near = a.value - b.value, SMALL * (a.size + b.size)
    size = np.where(apart > near, a.size, np.where(apart < -near, b.size, np.maximum(a.size, b.size)))
    return Terms(np.maximum(a.value, b.value), size, a.rank)


def minimum(a, b):
    """The smaller one, likewise."""
    return -maximum(-terms(a), -terms(b))


def clip(x, low, high):
    """x between two bounds, likewise."""
    return minimum(maximum(x, low), high)


def cos(x):
    """cos x; it takes over the rounding of x."""
    return Terms(np.cos(x.value), np.abs(np.cos(x.value)) + x.size)


def log(x):
    """ln x of what is positive; it takes over the relative rounding of x."""
    return Terms(np.log(x.value), np.abs(np.log(x.value)) + x.size / x.value)


def length(x):
    """|x| of vectors."""
    return Terms(np.sqrt(np.vecdot(x.value, x.value)), np.sqrt(np.vecdot(x.size, x.size)))


def outer(a, b):
    """a b^T of vectors."""
    return Terms(a.value[..., :, None] * b.value[..., None, :], a.size[..., :, None] * b.size[..., None, :], 2)


def cross(a, b):
    """a x b of vectors."""
    size = sum(np.roll(a.size, -k, -1) * np.roll(b.size, k, -1) for k in (1, 2))
    return Terms(np.cross(a.value, b.value), size, 1)


def transposed(m):
    """m^T of matrices."""
    return Terms(np.swapaxes(m.value, -1, -2), np.swapaxes(m.size, -1, -2), 2)


def trace(m):
    """tr m of matrices."""
    return Terms(np.einsum("...aa", m.value), np.einsum("...aa", m.size))


def determinant(m):
    """det m of matrices; its terms without their signs are its size."""
    a, b, c = (np.roll(m.size, -k, axis=-1) for k in range(3))
    size = sum(a[..., 0, k] * (b[..., 1, k] * c[..., 2, k] + c[..., 1, k] * b[..., 2, k]) for k in range(3))
    return Terms(np.linalg.det(m.value), size)


def inverse(m):
    """m^-1 of matrices; an error E changes it by m^-1 E m^-1."""
    inverted = np.linalg.inv(m.value)
    return Terms(inverted, np.abs(inverted) @ m.size @ np.abs(inverted), 2)


def certain(value):
    """(value, margin) of what no rounding decides."""
    return value, np.full(np.shape(value), np.inf)
