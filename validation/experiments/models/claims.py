"""What Jiang & Zhu 2023 say of the models that they compare with (figure 6 and table 1), measured on their drops.

Starts are the lattice cube of 4,913 particles and cubes of 5,039 cut from turned lattices.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from validation.experiment import Family, Measure, Options, Results, Run, alike
from validation.experiments.models import runs
from validation.metrics.droplet import nearest_neighbour_distance
from validation.metrics.shapes import lattice_ball, lattice_cube
from validation.results import real

ROUND = 1.005  # area over that of a ball up to which a drop at rest is one
STARTS = {
    "cube": ("cube", 4913, 1), "cut": ("cut", 5039, 1), "cut_2": ("cut", 5039, 2), "cut_3": ("cut", 5039, 3),
    "cut_4": ("cut", 5039, 4),
}  # fmt: skip


def drop(options: Options, model: str, start: str) -> Run:
    """A run of the experiment, or the same from another rotation."""
    shape, count, seed = STARTS[start]
    parameters = {"model": model, "shape": shape, "count": count, "backend": options.backend}
    if seed != 1:
        parameters["seed"] = seed
    return Run(f"{start}_{model}", runs.relax, parameters, estimate=40.0)


def measured(value: Callable[[Mapping], float], *models: str, timed: bool = False) -> Measure:
    """The value of a model's drop, or of a first model's over that of a second's, start by start.

    Infinite where the first is (never at rest), whether or not the second is.
    """

    def planned(options: Options) -> list[Run]:
        return [drop(options, model, start) for start in STARTS for model in models]

    def values(results: Results) -> list[float]:
        found = []
        for start in STARTS:
            parts = [value(results[f"{start}_{model}"].values) for model in models]
            found.append(parts[0] if len(parts) == 1 or math.isinf(parts[0]) else parts[0] / parts[1])
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


def whole_area(values: Mapping) -> float:
    """Area of the drop's surface and of the thrown particles, each a ball, over that of one ball of all liquid."""
    found, count = values["surface"]["end"], values["particles"]
    thrown = found["thrown"]
    return area(values) * (1 - thrown / count) ** (2 / 3) + thrown / count ** (2 / 3)


def gap(values: Mapping) -> float:
    """Distance from the surface to the nearest particle, 99th percentile [d]."""
    return real(values["surface"]["end"]["gap"])


def expansion(values: Mapping) -> float:
    """Growth of the distance of the farthest particle from the middle over the last third of the time."""
    extent = values["series"]["extent"]
    return real(extent[-1]) / real(extent[2 * (len(extent) - 1) // 3]) - 1


def seconds(values: Mapping) -> float:
    """Wall seconds until at rest as a ball; infinite where that never comes, as for a star that has frozen."""
    return real(values["rest"]["wall"]) if values["rest"] is not None and whole_area(values) <= ROUND else math.inf


RIVAL_CSF_UNEVEN = measured(nearest, "csf")
RIVAL_CSF_GAPS = measured(gap, "csf", "jiang_zhu")
RIVAL_CSF_EXPANDS = measured(expansion, "csf")
RIVAL_CSF_AREA = measured(whole_area, "csf")
RIVAL_CSF_ROUGH = measured(roughness, "csf", "jiang_zhu")
RIVAL_BECKER_CLUSTERS = measured(nearest, "becker_teschner_printed")
RIVAL_BECKER_AREA = measured(whole_area, "becker_teschner")
RIVAL_BECKER_ROUGH = measured(roughness, "becker_teschner", "jiang_zhu")
RIVAL_AKINCI_ROUGH = measured(roughness, "akinci", "jiang_zhu")
RIVAL_AKINCI_AREA = measured(whole_area, "akinci")
RIVAL_IISPH_AREA = measured(whole_area, "akinci_iisph")
RIVAL_IISPH_ROUGH = measured(roughness, "akinci_iisph", "jiang_zhu")
OWN_DROP_ROUND = measured(whole_area, "jiang_zhu")
SOONER_THAN_CSF = measured(seconds, "jiang_zhu", "csf", timed=True)
SOONER_THAN_BECKER = measured(seconds, "jiang_zhu", "becker_teschner", timed=True)
SOONER_THAN_AKINCI = measured(seconds, "jiang_zhu", "akinci", timed=True)
SOONER_THAN_IISPH = measured(seconds, "jiang_zhu", "akinci_iisph", timed=True)

# Null models


def _shape(made: Callable[..., np.ndarray], side: int) -> Callable[[Measure], Sequence[float]]:
    """The measures of `runs.surface` and of nearest neighbours on particles at rest on a lattice, with spacing 1."""

    def model(measure: Measure) -> list[float]:
        place = made(side).astype(float)
        radius = (3 * len(place) / (4 * math.pi)) ** (1 / 3)
        near = float(np.quantile(nearest_neighbour_distance(place), 0.05))
        end = runs.surface(place, 1.0, radius)
        return measure.of({"": {"surface": {"end": end}, "particles": len(place), "end": {"nn_5": near}}})

    return model


FAMILIES = (
    Family(
        ("rival_csf_uneven", "rival_becker_clusters"),
        "Particles could be as far apart as on a lattice.", "a ball cut from a lattice", _shape(lattice_ball, 4913),
    ),
    Family(
        ("rival_csf_area", "rival_becker_area", "rival_akinci_area", "rival_iisph_area"),
        "The rival's drop could be a ball.", "a ball cut from a lattice", _shape(lattice_ball, 4913),
    ),
    Family(("own_drop_round",), "The drop could keep edges.", "a cube", _shape(lattice_cube, 17)),
    Family(
        ("rival_csf_gaps",), "The surface could be as near to particles as that of the paper's drop.",
        "both drops are alike", alike({"surface": {"end": {"gap": 1.2}}}),
    ),
    Family(
        ("rival_csf_expands",), "The liquid could keep its extent.", "a drop that does not move",
        alike({"series": {"extent": [1.0] * 30}}),
    ),
    Family(
        ("rival_csf_rough", "rival_becker_rough", "rival_akinci_rough", "rival_iisph_rough"),
        "The rival's drop could be as smooth as the paper's.", "both drops are alike",
        alike({"end": {"radius_variation": 0.01}}),
    ),
    Family(
        ("sooner_than_csf", "sooner_than_becker", "sooner_than_akinci", "sooner_than_iisph"),
        "The paper's drop could come to rest as late as the rival's, or never.", "both take the same time",
        alike({"rest": {"wall": 2.0}, "surface": {"end": {"area": 1.0, "thrown": 0}}, "particles": 4913}),
    ),
)  # fmt: skip
