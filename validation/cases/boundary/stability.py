"""Hard cases of meshes as boundaries."""

from __future__ import annotations

from validation.cases.boundary import flow_stability, sampling_stability
from validation.trials import Stability

STABILITY = Stability("Meshes as boundaries", (*sampling_stability.hard_cases(), *flow_stability.hard_cases()))
