"""What the patent claims: how boundary particles spread; steps, noise and cost against the rivals of `rivals`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from refsim.boundary.sampling import MOST_ITERATIONS, sample
from validation.experiment import Family, Measure, Options, Results, Run, alike
from validation.experiments.boundary import flow_runs, rivals
from validation.experiments.boundary.sampling_runs import evenness, radius_for
from validation.experiments.boundary.sampling_shapes import SHAPES, mesh_of
from validation.results import Result, real
from validation.running import Context

TANKS = {
    "": rivals.CELLS, "_small": (6, 6, 8), "_wide": (8, 8, 6), "_flat": (9, 7, 5), "_narrow": (5, 6, 10),
}  # fmt: skip  # particles, in which largest steps are sought
STARTS = (0.8, 0.9, 1.0, 1.1, 1.2)  # shares of the runner's step at which noise is compared
CALMED = 2.0  # [s], by when the tanks rest
BLOCK = (20, 20, 16)  # particles of the tank that is timed


def _rests(*couplings: str) -> Callable[[Options], list[Run]]:
    def runs(options: Options) -> list[Run]:
        made = []
        for tank, cells in TANKS.items():
            for coupling in couplings:
                for share in rivals.SHARES:
                    given = {"coupling": coupling, "share": share, "backend": options.backend}
                    given |= {"cells": cells} if tank else {}
                    made.append(Run(f"rival{tank}_{coupling}_{share:g}", rivals.rest, given, 10.0))
        return made

    return runs


def _calmed(*couplings: str) -> Callable[[Options], list[Run]]:
    def runs(options: Options) -> list[Run]:
        return [
            Run(f"rival_noise_{coupling}_{share:g}", rivals.rest,
                {"coupling": coupling, "share": share, "backend": options.backend, "seconds": CALMED}, 15.0)
            for coupling in couplings for share in STARTS
        ]  # fmt: skip

    return runs


def largest_share(results: Results, coupling: str, tank: str = "") -> float:
    """The largest step, as a share of the runner's, up to which all steps hold; 0 for none."""
    largest = 0.0
    for share in rivals.SHARES:
        found = results.get(f"rival{tank}_{coupling}_{share:g}")
        if found is None or not found.values["holds"]:
            break
        largest = share
    return largest


def _steps_over(rival: str) -> Measure:
    """The coupling's largest step over the rival's, tank by tank; infinite where the rival holds at none."""

    def values(results: Results) -> list[float]:
        found = []
        for tank in TANKS:
            own, other = (largest_share(results, coupling, tank) for coupling in ("own", rival))
            found.append(own / other if other else float("inf"))
        return found

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
    """Share of a step less the rival's: a rival may cost less than can be timed, and a ratio would divide by it."""

    def values(results: Results) -> list[float]:
        return [own - other for own, other in zip(_of_step(results, "own"), _of_step(results, rival))]

    return Measure(_cost, values, timed=True)


def _of_step(results: Results, coupling: str) -> list[float]:
    return [real(share) for share in results["rival_cost"].values["shares"][coupling]]


def _own_share(results: Results) -> list[float]:
    return _of_step(results, "own")


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
    """Seconds of the marked pass over those of the other, in each fifth of the repeats."""
    marked, every = (results[f"flow_marked_{k}"].values["fifths"] for k in (0, 1))
    return [real(a) / real(b) for a, b in zip(marked, every)]


# P3 and P4: the velocity along the normal keeps particles on the surface, that along the tangent spreads them.

SOLIDS = ("sphere", "torus", "cube", "needle", "plate")
PARTICLES = 1000


def distances(made: object, position: np.ndarray, radius: float) -> float:
    """Largest distance of a place from the trimesh mesh `made` [r]."""
    import trimesh

    return float(trimesh.proximity.closest_point(made, position)[1].max()) / radius


def spread(context: Context, shape: str, backend: str) -> Result:
    """Boundary particles of a solid before and after they have moved: unevenness of their distances, and how far off
    the surface they are [r]."""
    made = SHAPES[shape]()
    mesh = mesh_of(made, shape)
    radius = radius_for(mesh.area, PARTICLES)
    placed, moved = (
        sample(mesh, radius, backend=backend, most_iterations=most).position for most in (0, MOST_ITERATIONS)
    )
    return Result(
        {
            "before": evenness(placed)["variation"], "after": evenness(moved)["variation"],
            "off": distances(made, moved, radius),
        }
    )  # fmt: skip


def _spread_runs(options: Options) -> list[Run]:
    return [Run(f"claim_spread_{s}", spread, {"shape": s, "backend": options.backend}, 5.0) for s in SOLIDS]


def _thrown_off(measure: Measure) -> list[float]:
    """The same measure on random places of a sphere, each moved by r along its normal."""
    place = np.random.default_rng(1).normal(size=(PARTICLES, 3))
    place /= np.linalg.norm(place, axis=1)[:, None]
    made = SHAPES["sphere"]()
    radius = radius_for(made.area, PARTICLES)
    reach = float(np.linalg.norm(np.asarray(made.vertices), axis=1).max())
    found = evenness(place)["variation"]
    return measure.of({"": {"before": found, "after": found, "off": distances(made, place * (reach + radius), radius)}})


COUPLING_NO_NET = Measure(_pours, _holes, quick=False)
COUPLING_STEP_OVER_DISTANCE = _steps_over("distance")
COUPLING_STEP_OVER_FORCING = _steps_over("forcing")
COUPLING_NOISE_OVER_DISTANCE = _noise_over("distance")
COUPLING_NOISE_OVER_FORCING = _noise_over("forcing")
COUPLING_SHARE_OF_STEP = Measure(_cost, _own_share, timed=True)
COUPLING_SHARE_OVER_DISTANCE = _share_over("distance")
COUPLING_SHARE_OVER_FORCING = _share_over("forcing")
COUPLING_MARKED_REGION = Measure(_marked, _marked_ratio, timed=True)
SAMPLING_STAYS_ON_SURFACE = Measure(_spread_runs, lambda found: [real(r.values["off"]) for r in found.values()])
SAMPLING_SPREADS = Measure(
    _spread_runs, lambda found: [real(r.values["after"]) / real(r.values["before"]) for r in found.values()]
)

FAMILIES = (
    Family(
        ("coupling_step_over_distance", "coupling_step_over_forcing"),
        "A rival could hold a tank at a step as long, or longer.",
        "a rival that holds at the same steps", alike({"holds": True}),
    ),
    Family(
        ("coupling_noise_over_distance", "coupling_noise_over_forcing"),
        "The rival's wall could push as evenly.", "a rival with the same noise", alike({"noise": 0.01}),
    ),
    Family(
        ("coupling_no_net",),
        "Liquid poured with the normal difference could have as many holes as with cohesion alone.",
        "both pour the same liquid", alike({"frames": [{"holes": 7}] * 6}),
    ),
    Family(
        ("coupling_share_of_step", "coupling_share_over_distance", "coupling_share_over_forcing"),
        "The coupling could take most of a step, or as much of it as the rivals do.",
        "every coupling takes nine tenths of a step",
        alike({"shares": dict.fromkeys(rivals.COUPLINGS, [0.9] * 3)}),
    ),
    Family(
        ("coupling_marked_region",),
        "Looking cells up could take as long as the test that it saves.", "both passes take the same time",
        alike({"fifths": [0.01] * 5}),
    ),
    Family(
        ("sampling_stays_on_surface", "sampling_spreads"),
        "Particles could leave the surface, or end as unevenly as they begin.",
        "random places on a sphere, moved by r along the normal and not along the tangent", _thrown_off,
    ),
)  # fmt: skip
