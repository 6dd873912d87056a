"""Hard cases of meshes as boundaries."""

from __future__ import annotations

from validation.cases.boundary.sampling_stability import hard_cases
from validation.trials import Stability

STABILITY = Stability("Meshes as boundaries", hard_cases())
