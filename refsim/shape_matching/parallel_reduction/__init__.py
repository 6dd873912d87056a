"""Region sums by parallel reduction: the threads of a block share a region (Shao & Song 2017, section 3.2).

Contents: operations parallel_reduction.match, parallel_reduction.pull, parallel_reduction.region_motion,
parallel_reduction.damp.
"""

from __future__ import annotations

import dataclasses

from refsim.core.operation import REGISTRY, register

for _name in ("match", "pull", "region_motion", "damp"):
    _plain = REGISTRY[f"shape_matching.{_name}"]
    register(
        dataclasses.replace(
            _plain,
            name=f"parallel_reduction.{_name}",
            folder="refsim.shape_matching.parallel_reduction",
            paper="Shao & Song 2017",
            rarely=True,
        )
    )
