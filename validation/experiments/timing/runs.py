"""Timed runs: the droplet's step with and without each effect, and the same work in another program."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from refsim import Akinci2013, Cloud, Gravity, Scene, WeaklyCompressible
from validation.checks import Checks
from validation.experiment import Experiment, Options, Results, Run
from validation.experiments.droplet import runs as droplet_runs
from validation.experiments.droplet.scene import VARIANTS, droplet_scene, particles
from validation.peers import splishsplash
from validation.results import Result
from validation.running import Context, stage_seconds

SPIN = 2.0  # rad/s: without tension nothing else would move, and the list would never be rebuilt
ROUNDS = 4
GROUPS = ("neighbours", "density", "forces", "detection", "tension")
_GROUP_OF = {
    "neighbours": "neighbours",
    "sph.density": "density",
    "sph.state": "density",
    "sph.pressure": "forces",
    "sph.momentum": "forces",
    "sph.gravity": "forces",
    "sph.kick_drift": "forces",
}


def grouped(stages: dict[str, float]) -> dict[str, float]:
    """Seconds by group: list, density, forces and integration, surface detection with its normals, tension.

    Normals of the tension count as tension; those that only the detection needs cannot be separated from them.
    """
    detects = any(name.startswith("surface_detection.") for name in stages)
    tense = any(name.startswith("jiang_zhu_2023.") for name in stages)
    sums: dict[str, float] = {}
    for name, seconds in stages.items():
        group = _GROUP_OF.get(name)
        if group is None:
            group = "detection" if name.startswith("surface_detection.") or (detects and not tense) else "tension"
        sums[group] = sums.get(group, 0.0) + seconds
    return sums


def step_costs(
    context: Context, steps: int, backend: str, threads: int | None, count: int = 4913, named: Sequence[str] = ()
) -> Result:
    """Seconds of a step of the droplet, scene by scene (all, or the named ones); and the price of each effect."""
    position, spacing, _ = particles("cube", count)
    gravity = Gravity(acceleration=(0.0, 0.0, -1.0))

    def scene(**changes: Any) -> Scene:
        return droplet_scene(position, spacing, **{"spin": SPIN, **changes})

    scenes: dict[str, tuple[str, Scene]] = {
        "pressure": ("pressure alone", scene(viscosity=0.0, effects=())),
        "liquid": ("pressure and viscosity", scene(effects=())),
        "gravity": ("with gravity", scene(effects=(gravity,))),
        "detection": ("with detection", scene(effects=(), detection=True)),
        "default": ("with tension of all pairs", scene()),
        "default_detection": ("with tension of all pairs and detection", scene(detection=True)),
        "soft": ("with soft tension", scene(**VARIANTS["soft"].changes)),
        "either": ("with tension of surface pairs", scene(**VARIANTS["either"].changes)),
    }
    scenes = {name: scene for name, scene in scenes.items() if name in named or not named}
    clocks = {name: Clock(context, made, backend, threads) for name, (_, made) in scenes.items()}
    for k in range(ROUNDS):  # in turn, so that a disturbance of the machine does not fall on one scene alone
        for clock in clocks.values():
            clock.run(steps // ROUNDS)
        context.progress((k + 1) / ROUNDS)
    found = {name: {"words": scenes[name][0], **clock.values()} for name, clock in clocks.items()}
    pairs = (
        ("viscosity", "pressure", "liquid"),
        ("gravity", "liquid", "gravity"),
        ("surface detection in every step", "liquid", "detection"),
        ("tension, all pairs", "liquid", "default"),
        ("tension, soft pairs", "liquid", "soft"),
        ("tension, surface pairs, with detection", "liquid", "either"),
        ("surface detection beside the tension", "default", "default_detection"),
    )
    prices = [
        {
            "words": words,
            "seconds": found[with_it]["step"] - found[without]["step"],
            "spread": found[with_it]["spread"] + found[without]["spread"],
            "bytes": found[with_it]["bytes"] - found[without]["bytes"],
            "launches": found[with_it]["launches"] - found[without]["launches"],
        }
        for words, without, with_it in pairs
        if {without, with_it} <= set(found)
    ]
    values = {"particles": len(position), "steps": steps, "scenes": found, "prices": prices}
    return Result(values)


class Clock:
    """A simulation under the clock: median seconds of a step, mean seconds by stage, bytes and launches."""

    def __init__(self, context: Context, scene: Scene, backend: str, threads: int | None = None, warm: int = 3) -> None:
        self.simulation = context.simulation(scene, backend, threads)
        self.plan = self.simulation.plan
        for _ in range(warm):
            self.simulation.step()
        self.simulation.timings.stages.clear()
        self.before, self.spent = self._rebuilds(), []

    def run(self, steps: int) -> None:
        """Time so many more steps."""
        for _ in range(steps):
            began = time.perf_counter()
            self.simulation.step()
            self.simulation.backend.synchronize()
            self.spent.append(time.perf_counter() - began)

    def _rebuilds(self) -> int:
        search = self.simulation.search
        return 0 if search is None else search.log.rebuilds

    def values(self) -> dict[str, Any]:
        """What was measured; bytes are those of a particle's fields."""
        spent = np.array(self.spent)
        median = float(np.median(spent))
        return {
            "step": median,
            "mean": float(spent.mean()),
            "spread": float(np.median(np.abs(spent - median))),
            "stages": {name: seconds / len(spent) for name, seconds in stage_seconds(self.simulation).items()},
            "bytes": sum(self.plan.field_bytes().values()),
            "launches": len(self.plan.launches()),
            "rebuilds": self._rebuilds() - self.before,
        }


def spinning_block(side: int, tension: float = 0.0) -> Scene:
    """The scene of the comparison with SPlisHSPlasH: side^3 particles turning at 5 rad/s, pressure and viscosity.

    tension  gamma of Akinci et al. 2013 [m^4/(kg s^2)], for cohesion and area term as that program takes it; 0 for none
    """
    spacing = 1.0 / splishsplash.CELLS
    steps = (np.arange(side) + 0.5) * spacing
    position = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    velocity = np.cross([0.0, 0.0, splishsplash.SPIN], position - position.mean(0))
    return Scene(
        name="spinning_block",
        spacing=spacing,
        support_radius=2.0 * spacing,
        step=splishsplash.STEP,
        fluid=(Cloud(position=position, velocity=velocity),),
        effects=(
            WeaklyCompressible(
                rest_density=splishsplash.DENSITY,
                sound_speed=(splishsplash.STIFFNESS / splishsplash.DENSITY) ** 0.5,
                dynamic_viscosity=splishsplash.VISCOSITY * splishsplash.DENSITY,
            ),
            *((Akinci2013(gamma=tension),) if tension else ()),
        ),
    )


def against_splishsplash(
    context: Context, side: int, steps: int, rounds: int, threads: int, tension: float = 0.0
) -> Result:
    """Seconds per particle and step of both programs on the spinning block, in turn, medians over all rounds."""
    missing = splishsplash.missing()
    if missing:
        return Result({"missing": missing})
    own, other, version, clocks = [], [], "", []
    for k in range(rounds):
        peer = splishsplash.run(side, steps, threads, tension)
        if "missing" in peer:
            return Result({"missing": peer["missing"]})
        clock = Clock(context, spinning_block(side, tension), "cpu", threads)
        clock.run(steps)
        other.append(peer["seconds"] / peer["particles"])
        clocks.append(clock.values())
        own.append(clocks[-1]["mean"] / side**3)
        version = peer["version"]
        context.progress((k + 1) / rounds)
    ratios = [b / a for a, b in zip(own, other)]

    def spread(values: list[float]) -> dict[str, float]:
        return {"median": float(np.median(values)), "low": min(values), "high": max(values)}

    values = {
        "missing": "",
        "version": version,
        "particles": side**3,
        "threads": threads,
        "rounds": rounds,
        "steps": steps,
        "refsim": spread(own),
        "peer": spread(other),
        "ratios": ratios,
        "ratio": float(np.median(ratios)),
        "stages": clocks[-1]["stages"],
        "rebuilds": [clock["rebuilds"] for clock in clocks],
    }
    return Result(values)


# What the method costs: seconds to steady state (table 1), the stages of a step, and each effect's price.
#
# The paper's 30.3 s are on an unnamed machine with unstated parameters (Jiang & Zhu E17): absolute times are only
# shown.


PAPER_COUNT = 5039
STEADY = {  # variant of the tension and whether the surface is detected, which the paper's text needs for its force
    "steady_default": ("default", False), "steady_default_detection": ("default", True),
    "steady_soft": ("soft", False), "steady_soft_detection": ("soft", True), "steady_text": ("text", True),
    "steady_one_sided": ("one_sided", False),
}  # fmt: skip
PEER_TENSION = 0.05  # of Akinci et al. 2013 beside SPlisHSPlasH: present, and too weak to break the block up
QUICK_SCENES = ("liquid", "gravity", "detection", "default", "default_detection")
PEERS = {
    "peer_splishsplash": ("peer_ratio", "splishsplash", "with viscosity"),
    "peer_splishsplash_akinci": ("peer_ratio_akinci", "splishsplash_akinci", "with viscosity and Akinci 2013"),
}


def planned(options: Options) -> list[Run]:
    """The runs under the options."""
    backend, threads = options.backend, options.threads
    slow = "takes a minute with the others; run without --quick" if options.quick else ""
    reason = "" if options.peers else "measured with --peers"
    few = {"steps": 100, "named": QUICK_SCENES} if options.quick else {}
    steady = {"shape": "cut", "count": PAPER_COUNT, "backend": backend}
    peer = {"side": 47, "steps": 30, "rounds": 3 if options.quick else 5, "threads": threads or 2}
    return [
        *(Run(key, droplet_runs.relax, {**steady, "variant": variant, "detection": detection}, 14.0, slow,
              timed=True) for key, (variant, detection) in STEADY.items()),
        Run("steps", step_costs, {"steps": 200, "backend": backend, "threads": threads, **few}, 16.0),
        Run("peer_splishsplash", against_splishsplash, peer, 60.0, reason),
        Run("peer_splishsplash_akinci", against_splishsplash, {**peer, "tension": PEER_TENSION}, 90.0, reason),
    ]  # fmt: skip


def checks(results: Results, check: Checks) -> None:
    """Absolute times are shown; the ratio to the peer is judged."""
    for key, result in results.items():
        if key.startswith("steady_"):
            steady = result.values["steady"]
            words = described(key)
            seconds = float("nan") if steady is None else steady["wall"]
            check("steady_seconds", seconds, key.removeprefix("steady_"), words)
    if "steps" in results:
        for name, row in results["steps"].values["scenes"].items():
            check("step_time", 1e3 * row["step"], name, row["words"])
    for key, (ratio, name, words) in PEERS.items():
        if key not in results or results[key].values["missing"]:
            continue
        values = results[key].values
        check(ratio, values["ratio"], name, "SPlisHSPlasH")
        for part, program in (("refsim", "refsim"), ("peer", "SPlisHSPlasH")):
            run = part if key == "peer_splishsplash" else f"{part}_akinci"
            check("peer_time", 1e6 * values[part]["median"], run, f"{program}, {words}")


def described(key: str) -> str:
    """A run to steady state in words."""
    words = {
        "default": "all pairs", "soft": "soft pairs", "text": "the paper's text, detection on",
        "one_sided": "the paper's words: force on surface particles only",
    }  # fmt: skip
    variant = key.removeprefix("steady_")
    if variant.endswith("_detection"):
        return f"{words[variant.removesuffix('_detection')]}, detection on"
    return words[variant]


EXPERIMENT = Experiment(
    name="timing",
    title="seconds to steady state (table 1), the stages of a step, what each effect costs, other programs",
    runs=planned,
    checks=checks,
)
