"""What the patent claims against its rivals: steps, noise, neighbour queries and cost; the rivals stand in `rivals`."""

from __future__ import annotations

from collections.abc import Callable

from validation.cases.boundary import flow_runs, rivals
from validation.claims import Measure
from validation.harness import Options, Results, Run
from validation.results import real

COMMON = 0.25  # share of the runner's step at which noise is compared
BLOCK = (20, 20, 16)  # particles of the tank that is timed


def _rests(*couplings: str) -> Callable[[Options], list[Run]]:
    def runs(options: Options) -> list[Run]:
        return [
            Run(f"rival_{coupling}_{share:g}", rivals.rest,
                {"coupling": coupling, "share": share, "backend": options.backend}, 10.0)
            for coupling in couplings for share in rivals.SHARES
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
        own, other = (results[f"rival_{c}_{COMMON:g}"].values["noise"] for c in ("own", rival))
        return [real(own) / real(other)]

    return Measure(_rests("own", rival), values)


def _cost(options: Options) -> list[Run]:
    parameters = {"cells": BLOCK, "steps": 40, "backend": options.backend}
    return [Run("rival_cost", rivals.cost, parameters, 40.0)]


def _share_over(rival: str) -> Measure:
    def values(results: Results) -> list[float]:
        shares = results["rival_cost"].values["shares"]
        return [real(shares["own"]) / real(shares[rival])]

    return Measure(_cost, values, timed=True)


def _own_share(results: Results) -> list[float]:
    return [real(results["rival_cost"].values["shares"]["own"])]


def _queries(results: Results) -> list[float]:
    own, other = (results[f"rival_{c}_{COMMON:g}"].values["queries"] for c in ("own", "forcing"))
    return [real(own) / real(other)]


def _marked(options: Options) -> list[Run]:
    return [
        Run(f"flow_marked_{int(everywhere)}", flow_runs.marked_cost,
            {"everywhere": everywhere, "backend": options.backend}, 9.0)
        for everywhere in (False, True)
    ]  # fmt: skip


def _marked_ratio(results: Results) -> list[float]:
    marked, every = (real(results[f"flow_marked_{k}"].values["seconds"]) for k in (0, 1))
    return [marked / every]


STEP_OVER_DISTANCE = _steps_over("distance")
STEP_OVER_FORCING = _steps_over("forcing")
NOISE_OVER_DISTANCE = _noise_over("distance")
NOISE_OVER_FORCING = _noise_over("forcing")
QUERIES = Measure(_rests("own", "forcing"), _queries)
SHARE_OF_STEP = Measure(_cost, _own_share, timed=True)
SHARE_OVER_DISTANCE = _share_over("distance")
SHARE_OVER_FORCING = _share_over("forcing")
MARKED_REGION = Measure(_marked, _marked_ratio, timed=True)
