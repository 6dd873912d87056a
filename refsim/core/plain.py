"""Results as plain values that strict JSON takes."""

import math
from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np


def plain(value: Any) -> Any:
    """`value` with only what strict JSON has: NaN and infinities become their names."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, msgspec.Struct):
        return plain(msgspec.structs.asdict(value))
    return value
