"""Particle fields: named arrays of one dtype; only those of the plan are allocated."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Field:
    """A named particle array.

    rows        number of rows where it is not that of the particles, or "solids" or "walls" until the plan has counted
                the nodes of the scene's solids or its wall particles: such a table is never reordered
    """

    name: str
    unit: str
    meaning: str
    components: int = 1  # 1 for a scalar (n,), 3 for a vector (n, 3)
    dtype: str = "real"  # "real" (the run's dtype) or a NumPy dtype name
    state: bool = False  # True where the value outlives the step: it is reordered with the particles and checkpointed
    rows: int | str | None = None

    def shape(self, count: int) -> tuple[int, ...]:
        """Array shape for `count` particles."""
        rows = self.rows if isinstance(self.rows, int) else count
        return (rows,) if self.components == 1 else (rows, self.components)

    def unit_in(self, dim: int) -> str:
        """The unit in `dim` dimensions, where `unit` has both: "kg (kg/m in 2D)"."""
        in_space, _, in_plane = self.unit.removesuffix(" in 2D)").partition(" (")
        return in_plane if in_plane and dim == 2 else in_space

    def numpy_dtype(self, real: str) -> np.dtype:
        """NumPy dtype in a run of dtype `real`."""
        return np.dtype(real if self.dtype == "real" else self.dtype)


POSITION = Field("position", "m", "particle position x", 3, state=True)
POSITION_RESIDUAL = Field(
    "position_residual", "m", "what rounding takes from the position: x lies at position + residual", 3, state=True
)
VELOCITY = Field("velocity", "m/s", "velocity v, half a step behind the position", 3, state=True)
ACCELERATION = Field("acceleration", "m/s^2", "sum of all accelerations", 3)
MASS = Field("mass", "kg (kg/m in 2D)", "particle mass m", state=True)
IDENTITY = Field("identity", "-", "the particle's number at the start; never changes", dtype="int32", state=True)
PLACE = Field("place", "-", "row that holds the particle of this number; for tables in the first order", dtype="int32")

BASE = (POSITION, VELOCITY, ACCELERATION, MASS, IDENTITY)
