"""Smoothing kernels, called from Python: slopes by differences, nothing at the edge, what is refused."""

import pytest

from refsim import InputError
from refsim.smoothing import smoothing
from tests.running import rows


@pytest.mark.parametrize("arguments, words", rows(__file__, "impossible_kernels"))
def test_impossible_kernels_are_refused(arguments, words):
    with pytest.raises(InputError, match=words):
        smoothing(*arguments)
