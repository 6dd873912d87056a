"""Penetration correction, which keeps particles out of a solid: patent CN104318598A, P8, as printed and swept.

There is no effect of this name: `mesh_boundary` (`refsim.boundary.one_way_coupling`) adds the pass, which replaces the
leap-frog.
"""

from typing import Any, NamedTuple

import numpy as np

from refsim.core.effect import Field, int32

CORRECTIONS = Field(
    "corrections", "-", "number of penetration corrections of the particle, patent P8", dtype="int32", state=True
)


class Penetration(NamedTuple):
    """The correction as the kernels take it."""

    restitution: float  # c_r
    rebound: float  # largest D_r
    swept: int  # test the whole path, not only the end of the step
    printed: int  # reflect also velocities that point out of the solid (patent E27)
    lower: Any  # (3,) corners of the box around all marked cells [m]
    upper: Any  # (3,) the box's other corner [m]


def penetration_groups(
    solid_field: Any, dtype: str, restitution: float, rebound: float, swept: bool, printed: bool
) -> dict[str, Any]:
    """Parameter groups of the pass, for `Effect.prepare`: the narrow band and the correction."""
    lower, upper = marked_box(solid_field)
    real = np.dtype(dtype).type
    solid_field = solid_field._replace(
        distance=np.asarray(solid_field.distance, dtype=dtype),
        spacing=real(solid_field.spacing),
        band=real(solid_field.band),
    )
    group = Penetration(
        real(restitution), real(rebound), int32(swept), int32(printed),
        np.nextafter(lower.astype(dtype), real(-np.inf)), np.nextafter(upper.astype(dtype), real(np.inf)),
    )  # fmt: skip
    return {"solid_field": solid_field, "penetration": group}


def marked_box(solid_field: Any) -> tuple[np.ndarray, np.ndarray]:
    """Corners (3,), (3,) [m] of the box around all blocks of a narrow band."""
    keys = np.asarray(solid_field.keys)
    origin = np.array([solid_field.origin_x, solid_field.origin_y, solid_field.origin_z], dtype=float)
    if not len(keys):
        return origin, origin
    block = np.stack([(keys >> shift & 0x1FFFFF) - (1 << 20) for shift in (0, 21, 42)], axis=1)
    h = float(solid_field.spacing)
    return origin + 4 * h * block.min(0), origin + 4 * h * (block.max(0) + 1)
