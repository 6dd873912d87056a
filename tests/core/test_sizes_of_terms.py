"""Numbers carry the sum of the absolute terms behind them, decisions their distance from flipping."""

import numpy as np
import pytest

from refsim.core.terms import Terms, clip, cross, determinant, inverse, length, maximum, outer, where


def pair(found):
    value, size = found
    return np.asarray(value).tolist(), np.asarray(size).tolist()


@pytest.mark.parametrize("found, value, size", [
    (Terms(3.0) - 2, 1, 5), (2 - Terms(3.0), -1, 5), ((Terms(3.0) - 2) * -4, -4, 20), (8 / (Terms(3.0) - 1), 4, 8),
    (Terms(-2.0) ** 3, -8, 24), (clip(Terms(0.5) - 2, 0, 1), 0, 0), (clip(Terms(2.0) - 1.9999, 0, 1), 1e-4, 3.9999),
    (maximum(Terms(0.5) - 2, -9.0), -1.5, 2.5), (maximum(Terms(0.5) - 2, -1.4999), -1.4999, 2.5),
    (where(Terms(1) > 2, Terms(3.0), Terms(4.0)), 4, 4), (length(Terms([3.0, 4.0, 0.0], rank=1)), 5, 5),
    (Terms([1.0, -1.0, 0.0], rank=1) @ np.array([2.0, 3.0, 5.0]), -1, 5),
    (determinant(Terms(np.diag([1.0, -2.0, 3.0]), rank=2)), -6, 6),
    (cross(Terms([1.0, 2.0, 3.0], rank=1), Terms([4.0, 5.0, 6.0], rank=1)), [-3, 6, -3], [27, 18, 13]),
])  # fmt: skip
def test_sizes(found, value, size):
    assert pair(found) == (pytest.approx(value), pytest.approx(size))


def test_sizes_of_products_vectors_and_decisions():
    """(3 - 2) (5 - 4): an error of 5e and 9e in the factors changes the product by 14e, not by 45e."""
    value, size = (Terms(3.0) - 2) * (Terms(5.0) - 4)
    assert (value, size) == (1, pytest.approx(13 + 1e-3 * 32))
    numbers, vectors = Terms([2.0, 3.0]), Terms([[1.0, 0.0, -1.0], [0.0, 1.0, 2.0]], rank=1)
    assert pair(numbers * vectors)[0] == [[2, 0, -2], [0, 3, 6]]
    assert outer(vectors, vectors).rank == 2
    matrix = Terms(np.diag([1.0, 2.0, 4.0]), rank=2)
    assert pair(matrix @ vectors)[0] == [[1, 0, -4], [0, 2, 8]]
    assert pair(inverse(matrix))[1] == np.diag([1.0, 0.5, 0.25]).tolist()
    small, large = Terms([1.0, 4.0]), Terms([2.0, 3.0])
    below = small < large
    assert pair(below) == ([1, 0], [0.5, 0.25])
    assert pair(~below) == ([0, 1], [0.5, 0.25])
    assert pair(below & (large > 0)) == ([1, 0], [0.5, 0.25])
    assert pair(below | (small > 3.5)) == ([1, 1], [0.5, 0.125])
    assert pair(Terms(2.0) <= 2) == (1, 0)
