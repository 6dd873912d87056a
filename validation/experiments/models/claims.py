"""What Jiang & Zhu 2023 say of the models that they compare with (figure 6 and table 1), measured on their drops.

Starts are the lattice cube of 4,913 particles and cubes of 5,039 cut from turned lattices.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from validation.claims import Measure
from validation.experiment import Options, Results, Run
from validation.experiments.models import runs
from validation.results import real

STARTS = {"cube": ("cube", 4913, 1), "cut": ("cut", 5039, 1), "cut_2": ("cut", 5039, 2), "cut_3": ("cut", 5039, 3)}


def drop(options: Options, model: str, start: str) -> Run:
    """A run of the experiment, or the same from another rotation."""
    shape, count, seed = STARTS[start]
    parameters = {"model": model, "shape": shape, "count": count, "backend": options.backend}
    if seed != 1:
        parameters["seed"] = seed
    return Run(f"{start}_{model}", runs.relax, parameters, estimate=40.0)


def measured(value: Callable[[Mapping], float], *models: str, timed: bool = False) -> Measure:
    """The value of a model's drop, or of a first model's over that of a second's, start by start.

    A start from which neither is finite (never at rest) is left out.
    """

    def planned(options: Options) -> list[Run]:
        return [drop(options, model, start) for start in STARTS for model in models]

    def values(results: Results) -> list[float]:
        found = []
        for start in STARTS:
            parts = [value(results[f"{start}_{model}"].values) for model in models]
            if len(parts) == 1 or any(map(math.isfinite, parts)):
                found.append(parts[0] if len(parts) == 1 else parts[0] / parts[1])
        return found

    return Measure(planned, values, quick=False, timed=timed)


def nearest(values: Mapping) -> float:
    """Nearest neighbour, 5th percentile [d]."""
    return real(values["end"]["nn_5"])


def roughness(values: Mapping) -> float:
    """Radius variation at the end."""
    return real(values["end"]["radius_variation"])


def area(values: Mapping) -> float:
    """Area of the surface over that of a ball of the same volume; infinite where the drop is torn."""
    found = real(values["surface"]["end"]["area"])
    return math.inf if math.isnan(found) else found


def gap(values: Mapping) -> float:
    """Distance from the surface to the nearest particle, 99th percentile [d]."""
    return real(values["surface"]["end"]["gap"])


def expansion(values: Mapping) -> float:
    """Growth of the distance of the farthest particle from the middle over the last third of the time."""
    extent = values["series"]["extent"]
    return real(extent[-1]) / real(extent[2 * (len(extent) - 1) // 3]) - 1


def seconds(values: Mapping) -> float:
    """Wall seconds until at rest; infinite where that never comes."""
    return math.inf if values["rest"] is None else real(values["rest"]["wall"])


RIVAL_CSF_UNEVEN = measured(nearest, "csf")
RIVAL_CSF_GAPS = measured(gap, "csf", "jiang_zhu")
RIVAL_CSF_EXPANDS = measured(expansion, "csf")
RIVAL_CSF_AREA = measured(area, "csf")
RIVAL_CSF_ROUGH = measured(roughness, "csf", "jiang_zhu")
RIVAL_BECKER_CLUSTERS = measured(nearest, "becker_teschner")
RIVAL_BECKER_CLUSTERS_PRINTED = measured(nearest, "becker_teschner_printed")
RIVAL_BECKER_AREA = measured(area, "becker_teschner")
RIVAL_BECKER_ROUGH = measured(roughness, "becker_teschner", "jiang_zhu")
RIVAL_AKINCI_ROUGH = measured(roughness, "akinci", "jiang_zhu")
RIVAL_AKINCI_AREA = measured(area, "akinci")
RIVAL_IISPH_AREA = measured(area, "akinci_iisph")
RIVAL_IISPH_ROUGH = measured(roughness, "akinci_iisph", "jiang_zhu")
OWN_DROP_ROUND = measured(area, "jiang_zhu")
SOONER_THAN_CSF = measured(seconds, "jiang_zhu", "csf", timed=True)
SOONER_THAN_BECKER = measured(seconds, "jiang_zhu", "becker_teschner", timed=True)
SOONER_THAN_AKINCI = measured(seconds, "jiang_zhu", "akinci", timed=True)
SOONER_THAN_IISPH = measured(seconds, "jiang_zhu", "akinci_iisph", timed=True)
