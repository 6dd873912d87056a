"""What accuracy costs in the droplet: its roughness against wall time, with another program beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from validation.checks import Checks
from validation.experiment import Band, Options, Panel, Points, Run
from validation.experiments.droplet import accuracy_runs
from validation.experiments.droplet.runs import ROUND
from validation.experiments.droplet.scene import VARIANTS
from validation.peers import splishsplash
from validation.start_up import start_up
from validation.work_precision import REPEATS

SIDES = (9, 11, 13, 15, 17)  # particles along the cube's side
SMALL, MIDDLE, PAPERS = 11, 13, 17  # where effects are switched, where knobs are turned, and that of 4,913 particles
STEPS = (0.5, 1.4, 2.0)  # of the stable step, beside 1; above 1 fixed steps, of which the scene refuses the longest
MODES = ("soft", "either", "both", "one_sided")
SEEDS = (1, 2, 3, 4, 5)
LATTICE_BALL = 0.0165  # radius variation of a ball of 13^3 particles cut from the lattice: no drop may keep more
REFSIM, PEER = "refsim", "SPlisHSPlasH"
# Cohesion 1 and density 1000 kg/m^3 give a nominal 41 N/m and a capillary time of 2.4 s.
PEER_SETTINGS = {
    "peer": {"tension": 1.0, "viscosity": 0.01, "step": 0.0025, "until": 3.0},  # its own viscosity
    "peer_thin": {"tension": 1.0, "viscosity": 0.005, "step": 0.01, "until": 3.0},  # the best of a dozen settings tried
}


def settings(options: Options) -> list[dict[str, Any]]:
    """All settings of refsim in the panel."""
    made: list[dict[str, Any]] = []
    main = options.backend

    def add(key: str, said: str, side: int, dtype: str = "float32", step: float = 1.0,
            mode: str = "all", knobs: Mapping[str, Any] | None = None, **more: Any) -> None:  # fmt: skip
        words = f"d = L/{side}, {dtype}, {main}, {mode} pairs" + (f", {said}" if said else "")
        own = {"program": REFSIM, "spacing": 1.0 / side, "step": step, "dtype": dtype, "backend": main,
               "pair_mode": mode, **(knobs or {})}  # fmt: skip
        made.append({"key": key, "words": words, "knobs": own, "side": side, "backend": main, **more})

    if options.quick:
        add("d9", "", 9)
        add("d11", "", 11)
        return made
    for side in SIDES:
        add(f"d{side}", "", side)
    for step in STEPS:
        add(f"step{step:g}", step_words(step), MIDDLE, step=step, expected=step > 1.0)
    for side in (SMALL, MIDDLE):
        add(f"d{side}_float64", "", side, dtype="float64")
    for side in (15, PAPERS):
        add(f"d{side}_step1.4", step_words(1.4), side, step=1.4)
    for mode in MODES:
        add(f"mode_{mode}", "", SMALL, mode=mode, variant=mode, expected=True)
    for name, said in (("area", "no area term"), ("correction", "no density correction"),
                       ("balance", "cohesion not balanced, c = 60 m/s"),
                       ("detection", "surface detection in every step")):  # fmt: skip
        add(f"effect_{name}", said, SMALL, changes=accuracy_runs.effect_changes(name), expected=True)
    return made


def step_words(share: float) -> str:
    """A share of the stable step in words."""
    return f"{share:g} of the stable step" + (", fixed" if share > 1.0 else "")


def estimate(setting: Mapping[str, Any]) -> float:
    """Seconds that a setting may take."""
    seconds = 6.5 * (setting["side"] / PAPERS) ** 4 / setting["knobs"]["step"]
    if "variant" in setting:
        seconds *= 2.0
    return seconds * (1.4 if setting["knobs"]["dtype"] == "float64" else 1.0)


def peers() -> dict[str, dict[str, Any]]:
    """SPlisHSPlasH at the paper's number of particles, two of its settings."""
    made = {}
    for key, values in PEER_SETTINGS.items():
        said = f"nu = {values['viscosity']:g} m^2/s, step {1e3 * values['step']:g} ms"
        knobs = {"program": PEER, "dtype": "float32", "backend": "cpu", "spacing": 1.0 / PAPERS, "pair_mode": "all"}
        words = f"{PEER}, DFSPH + Akinci 2013, d = L/{PAPERS}, {said}"
        made[key] = {
            "key": key, "words": words, "knobs": knobs, "settings": {"side": PAPERS, "samples": 120, **values},
        }  # fmt: skip
    return made


def runs(options: Options) -> list[Run]:
    """Every setting in turn, the peer among them (it takes a minute: --quick needs --peers for it); starts last."""
    own, repeats = settings(options), 2 if options.quick else REPEATS
    parameters = {
        "settings": {setting["key"]: setting for setting in own}, "backend": options.backend,
        "peers": peers() if options.backend == "cpu" and (options.peers or not options.quick) else {},
        "threads": options.threads, "repeats": repeats,
    }  # fmt: skip
    made = [Run("drops", accuracy_runs.drops, parameters, repeats * sum(map(estimate, own)))]
    if options.quick:
        return made
    for mode in ("all", *MODES):
        for seed in SEEDS if mode == "all" else SEEDS[:2]:
            key = f"turned_{mode}_{seed}"
            parameters = {
                "key": key, "words": f"from a cube that is turned (seed {seed})",
                "knobs": {"step": 1.0, "dtype": "float32", "checks": {"program": REFSIM, "pair_mode": mode}},
                "side": MIDDLE, "backend": options.backend, "variant": "default" if mode == "all" else mode,
                "shape": "cut", "seed": seed, "shown": False, "expected": True, "threads": options.threads,
                "repeat": 0,
            }  # fmt: skip
            made.append(Run(key, accuracy_runs.roughness, parameters, 3.0))
    knobs = {"program": REFSIM, "source": "arithmetic"}
    rounding = {"key": "rounding", "words": "one evaluation in both precisions", "knobs": knobs, "side": MIDDLE,
                "backend": options.backend, "threads": options.threads}  # fmt: skip
    made.append(Run("rounding", accuracy_runs.force_rounding, rounding, 2.0))
    if options.backend == "cpu":
        knobs = {"program": REFSIM, "spacing": 1.0 / 9, "step": 1.0, "dtype": "float64", "backend": "numpy",
                 "pair_mode": "all"}  # fmt: skip
        words = "d = L/9, float64, numpy, all pairs (its steps, timed one by one)"
        parameters = {"key": "numpy", "words": words, "knobs": knobs, "side": 9, "threads": options.threads,
                      "repeats": REPEATS}  # fmt: skip
        made.append(Run("numpy", accuracy_runs.reference_cost, parameters, 8.0))
        scenes = {
            f"the drop, {dtype}": {
                "module": "validation.experiments.droplet.accuracy_runs",
                "function": "drop_scene",
                "parameters": {"side": 9, "dtype": dtype},
            }
            for dtype in ("float32", "float64")
        }
        parameters = {"scenes": scenes, "backend": options.backend, "threads": options.threads}
        made.append(Run("start", start_up, parameters, 60.0))
    return made


def band(points: Points) -> Band | None:
    """The spread over starts that are turned otherwise: half the range of what they keep."""
    kept = [p["error"] for key, p in points.items() if key.startswith("turned_all_") and not p["stopped"]]
    kept = [e for e in kept if np.isfinite(e)]
    if len(kept) < 3:
        return None
    words = f"cubes cut from lattices turned by {len(kept)} rotations keep {min(kept):.2g} to {max(kept):.2g}"
    return Band(0.5 * (max(kept) - min(kept)), words)


def checks(report: Mapping[str, Any], check: Checks) -> None:
    """Time to the bar against the time that the peer takes to its plateau, in this run."""
    points = report["points"]
    own = [p for p in points.values() if p["shown"] and p["knobs"].get("program") == REFSIM]
    own = [p for p in own if p["to_stated"] and not p["elsewhere"]]
    peers = {key: p for key, p in points.items() if p["knobs"].get("program") == PEER and not p["stopped"]}
    if own:
        best = min(own, key=lambda p: p["to_stated"]["seconds"])
        check("time_to_round", best["to_stated"]["seconds"], "best", best["words"])
        equal = [p for p in own if p["particles"] == PAPERS**3]
        if equal:
            same = min(equal, key=lambda p: p["to_stated"]["seconds"])
            check("time_to_round", same["to_stated"]["seconds"], "equal_number", same["words"])
    if peers:
        for key, p in peers.items():
            check("peer_plateau", p["error"], key, p["words"])
            check("peer_time", p["seconds"], key, p["words"])
        fastest = min(p["seconds"] for p in peers.values())
        ratio = best["to_stated"]["seconds"] / fastest if own else float("nan")
        check("against_peer", ratio)
    elif not report["quick"] and not splishsplash.missing():
        check("against_peer", float("nan"))


def omissions(options: Options) -> list[str]:
    """What is not in the panel."""
    made = ["pair mode 'text' and 'printed': they do not come to rest, see the droplet's own table"]
    made.append("backend numpy above 9^3 particles: the references compare all pairs")
    if options.quick and not options.peers:
        made.append(f"{PEER}: takes a minute; run without --quick, or with --peers")
    return made


PANELS: Sequence[Panel] = (
    Panel(
        name="droplet",
        title="Roughness of a drop that was a cube",
        observable="radius variation",
        reference="the sphere, whose outer radius varies by nothing; a ball cut from the lattice has 0.0094",
        stated=ROUND,
        runs=runs,
        space=[f"d{side}" for side in SIDES],
        time=["step1.4", f"d{MIDDLE}", "step0.5"],
        tolerance="no solver iterates: the equation of state is explicit",
        arithmetic=(f"d{MIDDLE}", f"d{MIDDLE}_float64"),
        space_theory=None,
        time_theory=None,
        check_bar=LATTICE_BALL,
        band=band,
        effects=(
            ("area term J(21)", "effect_area", f"d{SMALL}"),
            ("density correction J(14)", "effect_correction", f"d{SMALL}"),
            ("balance of the cohesion", "effect_balance", f"d{SMALL}"),
            ("surface detection in every step", f"d{SMALL}", "effect_detection"),
            ("float64 for float32", f"d{SMALL}", f"d{SMALL}_float64"),
        ),
        group="program",
        checks=checks,
        omissions=omissions,
    ),
)
assert set(MODES) <= set(VARIANTS)
