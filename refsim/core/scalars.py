"""Numbers in the types that kernels take."""

import math
from typing import Any

import numpy as np


def int32(value: Any) -> Any:
    """`value` as a 32-bit integer: the whole numbers of parameter groups."""
    return np.int32(value)


def rounded_up(value: float, digits: int = 3) -> float:
    """A positive number with so many digits that is not below `value`, so that the number in a message suffices."""
    unit = 10.0 ** (math.floor(math.log10(value)) + 1 - digits)
    return float(f"{math.ceil(value / unit * (1 - 1e-12)) * unit:.{digits}g}")
