"""Tuples and small matrices against NumPy, in compiled code and in plain Python."""

import numpy as np
import pytest

from refsim.backends import tuples
from refsim.backends.compile import cpu_kernel
from refsim.backends.tuples import added, converted, difference, nine, over, put, scaled, three, three_of, two_of

A, B = np.random.default_rng(3).normal(size=(2, 3, 3))
V = np.array([1.5, -0.25, 3.0])


@cpu_kernel
def combine(vectors, matrices, answer, results):
    """A row of `answer` or `results` for each formula."""
    v, a, b = three(vectors, 0), nine(matrices, 0), nine(matrices, 1)
    put(answer, 0, added(scaled(v, 2.0), over(v, 4.0)))
    put(answer, 1, difference(two_of(1.0, v, 2.0, v), three_of(1.0, v, 2.0, v, 3.0, v)))
    put(answer, 2, tuples.times(a, v))
    put(answer, 3, tuples.less_times(v, a, v))
    put(answer, 4, (tuples.trace(a), tuples.determinant(a), 0.0))
    put(answer, 5, converted(v, np.float32))
    put(results, 0, tuples.product(a, b))
    put(results, 1, tuples.transposed(a))
    put(results, 2, tuples.outer(v, tuples.times(a, v)))
    put(results, 3, tuples.symmetric((a[0], a[1], a[2], a[4], a[5], a[8])))


@pytest.mark.parametrize("program", [combine, getattr(combine, "py_func", combine)], ids=["compiled", "python"])
def test_tuples_are_vectors_and_matrices(program):
    answer, results = np.zeros((6, 3)), np.zeros((4, 9))
    program(V[None], np.stack([A.ravel(), B.ravel()]), answer, results)
    expected = [2.25 * V, -3 * V, A @ V, V - A @ V, [np.trace(A), np.linalg.det(A), 0], V]
    upper = np.triu(A)
    matrices = [A @ B, A.T, np.outer(V, A @ V), upper + upper.T - np.diag(np.diag(A))]
    np.testing.assert_allclose(answer, expected, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(results, [m.ravel() for m in matrices], rtol=1e-13, atol=1e-13)
