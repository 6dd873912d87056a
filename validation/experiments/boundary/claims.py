"""What the patent claims against its rivals: steps, noise, neighbour queries and cost; the rivals stand in `rivals`."""

from __future__ import annotations

from collections.abc import Callable

from validation.claims import Measure
from validation.experiment import Options, Results, Run
from validation.experiments.boundary import flow_runs, rivals
from validation.results import real

STARTS = (0.8, 1.0, 1.2)  # shares of the runner's step at which noise is compared
CALMED = 2.0  # [s], by when the tanks rest
BLOCK = (20, 20, 16)  # particles of the tank that is timed


def _rests(*couplings: str) -> Callable[[Options], list[Run]]:
    def runs(options: Options) -> list[Run]:
        return [
            Run(f"rival_{coupling}_{share:g}", rivals.rest,
                {"coupling": coupling, "share": share, "backend": options.backend}, 10.0)
            for coupling in couplings for share in rivals.SHARES
        ]  # fmt: skip

    return runs


def _calmed(*couplings: str) -> Callable[[Options], list[Run]]:
    def runs(options: Options) -> list[Run]:
        return [
            Run(f"rival_noise_{coupling}_{share:g}", rivals.rest,
                {"coupling": coupling, "share": share, "backend": options.backend, "seconds": CALMED}, 15.0)
            for coupling in couplings for share in STARTS
        ]  # fmt: skip

    return runs


def largest_share(results: Results, coupling: str) -> float:
    """The largest step, as a share of the runner's, up to which all steps hold; 0 for none."""
    largest = 0.0
    for share in rivals.SHARES:
        found = results.get(f"rival_{coupling}_{share:g}")
        if found is None or not found.values["holds"]:
            break
        largest = share
    return largest


def _steps_over(rival: str) -> Measure:
    def values(results: Results) -> list[float]:
        other = largest_share(results, rival)
        return [largest_share(results, "own") / other if other else float("inf")]

    return Measure(_rests("own", rival), values)


def _noise_over(rival: str) -> Measure:
    def values(results: Results) -> list[float]:
        found = []
        for share in STARTS:
            own, other = (results[f"rival_noise_{c}_{share:g}"].values["noise"] for c in ("own", rival))
            found.append(real(own) / real(other))
        return found

    return Measure(_calmed("own", rival), values)


def _cost(options: Options) -> list[Run]:
    parameters = {"cells": BLOCK, "steps": 40, "backend": options.backend}
    return [Run("rival_cost", rivals.cost, parameters, 40.0)]


def _share_over(rival: str) -> Measure:
    def values(results: Results) -> list[float]:
        return [own / other for own, other in zip(_of_step(results, "own"), _of_step(results, rival))]

    return Measure(_cost, values, timed=True)


def _of_step(results: Results, coupling: str) -> list[float]:
    return [real(share) for share in results["rival_cost"].values["shares"][coupling]]


def _own_share(results: Results) -> list[float]:
    return _of_step(results, "own")


def _queries(results: Results) -> list[float]:
    own, other = (results[f"rival_{c}_1"].values["searches"] for c in ("own", "forcing"))
    return [real(own) / real(other)]


def _pours(options: Options) -> list[Run]:
    return [
        Run(f"flow_pour_{shape}_{arm}", flow_runs.pour, {"shape": shape, "arm": arm, "backend": options.backend}, 8.0)
        for shape in flow_runs.POUR for arm in ("cohesion", "difference")
    ]  # fmt: skip


def _holes(results: Results) -> list[float]:
    """Holes half-way and at the end, of the normal difference over those of cohesion, shape by shape."""
    counts = {key: sum(real(results[key].values["frames"][k]["holes"]) for k in (2, 5)) for key in results}
    return [
        counts[f"flow_pour_{shape}_difference"] / max(counts[f"flow_pour_{shape}_cohesion"], 1.0)
        for shape in flow_runs.POUR
    ]


def _marked(options: Options) -> list[Run]:
    return [
        Run(f"flow_marked_{int(everywhere)}", flow_runs.marked_cost,
            {"everywhere": everywhere, "backend": options.backend}, 9.0)
        for everywhere in (False, True)
    ]  # fmt: skip


def _marked_ratio(results: Results) -> list[float]:
    marked, every = (real(results[f"flow_marked_{k}"].values["seconds"]) for k in (0, 1))
    return [marked / every]


COUPLING_NO_NET = Measure(_pours, _holes, quick=False)
COUPLING_STEP_OVER_DISTANCE = _steps_over("distance")
COUPLING_STEP_OVER_FORCING = _steps_over("forcing")
COUPLING_NOISE_OVER_DISTANCE = _noise_over("distance")
COUPLING_NOISE_OVER_FORCING = _noise_over("forcing")
COUPLING_QUERIES = Measure(_rests("own", "forcing"), _queries)
COUPLING_SHARE_OF_STEP = Measure(_cost, _own_share, timed=True)
COUPLING_SHARE_OVER_DISTANCE = _share_over("distance")
COUPLING_SHARE_OVER_FORCING = _share_over("forcing")
COUPLING_MARKED_REGION = Measure(_marked, _marked_ratio, timed=True)
