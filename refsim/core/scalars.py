"""Numbers in the types that kernels take."""

from __future__ import annotations

from typing import Any

import numpy as np


def int32(value: Any) -> Any:
    """`value` as a 32-bit integer: the whole numbers of parameter groups."""
    return np.int32(value)
