"""Timed runs: the droplet of table 1 until it is steady, and the same work in another program."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from refsim import Akinci2013, Cloud, Scene, WeaklyCompressible
from validation.checks import Checks
from validation.experiment import Experiment, Options, Results, Run
from validation.experiments.droplet import runs as droplet_runs
from validation.peers import splishsplash
from validation.results import Result
from validation.running import Context, stage_seconds

_GROUP_OF = {
    "neighbours": "neighbours", "sph.density": "density", "sph.state": "density", "sph.pressure": "forces",
    "sph.momentum": "forces", "sph.gravity": "forces", "sph.kick_drift": "forces",
}  # fmt: skip


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
            "step": median, "mean": float(spent.mean()), "spread": float(np.median(np.abs(spent - median))),
            "stages": {name: seconds / len(spent) for name, seconds in stage_seconds(self.simulation).items()},
            "bytes": sum(self.plan.field_bytes().values()), "launches": len(self.plan.launches()),
            "rebuilds": self._rebuilds() - self.before,
        }  # fmt: skip


def spinning_block(side: int, tension: float = 0.0) -> Scene:
    """The scene of the comparison with SPlisHSPlasH: side^3 particles turning at 5 rad/s, pressure and viscosity.

    tension  gamma of Akinci et al. 2013 [m^4/(kg s^2)], for cohesion and area term as that program takes it; 0 for none
    """
    spacing = 1.0 / splishsplash.CELLS
    steps = (np.arange(side) + 0.5) * spacing
    position = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    velocity = np.cross([0.0, 0.0, splishsplash.SPIN], position - position.mean(0))
    liquid = WeaklyCompressible(
        rest_density=splishsplash.DENSITY, sound_speed=(splishsplash.STIFFNESS / splishsplash.DENSITY) ** 0.5,
        dynamic_viscosity=splishsplash.VISCOSITY * splishsplash.DENSITY, density="summation",
    )  # fmt: skip
    return Scene(
        name="spinning_block", spacing=spacing, support_radius=2.0 * spacing, step=splishsplash.STEP,
        fluid=(Cloud(position=position, velocity=velocity),),
        effects=(liquid, *((Akinci2013(gamma=tension),) if tension else ())),
    )  # fmt: skip


def against_splishsplash(
    context: Context, side: int, steps: int, rounds: int, threads: int, tension: float = 0.0
) -> Result:
    """Seconds per particle and step of both programs on the spinning block, in turn, medians over all rounds."""
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
        "missing": "", "version": version, "particles": side**3, "threads": threads, "rounds": rounds, "steps": steps,
        "refsim": spread(own), "peer": spread(other), "ratios": ratios, "ratio": float(np.median(ratios)),
        "stages": clocks[-1]["stages"], "rebuilds": [clock["rebuilds"] for clock in clocks],
    }  # fmt: skip
    return Result(values)


# Seconds to steady state (table 1). The paper's 30.3 s are on an unnamed machine with unstated parameters (Jiang & Zhu
# E17): absolute times are only shown.


PAPER_COUNT = 5039
STEADY = {  # variant of the tension and whether the surface is detected, which the paper's text needs for its force
    "steady_default": ("default", False), "steady_default_detection": ("default", True),
    "steady_soft": ("soft", False), "steady_soft_detection": ("soft", True), "steady_text": ("text", True),
    "steady_one_sided": ("one_sided", False),
}  # fmt: skip
PEER_TENSION = 0.05  # of Akinci et al. 2013 beside SPlisHSPlasH: present, and too weak to break the block up
PEERS = {
    "peer_splishsplash": ("peer_ratio", "splishsplash", "with viscosity"),
    "peer_splishsplash_akinci": ("peer_ratio_akinci", "splishsplash_akinci", "with viscosity and Akinci 2013"),
}


def planned(options: Options) -> list[Run]:
    """The runs under the options."""
    slow = "takes a minute with the others; run without --quick" if options.quick else ""
    reason = "" if options.peers else "measured with --peers"
    steady = {"shape": "cut", "count": PAPER_COUNT, "backend": options.backend}
    peer = {"side": 47, "steps": 30, "rounds": 3 if options.quick else 5, "threads": options.threads or 2}
    return [
        *(Run(key, droplet_runs.relax, {**steady, "variant": variant, "detection": detection}, 14.0, slow,
              timed=True) for key, (variant, detection) in STEADY.items()),
        Run("peer_splishsplash", against_splishsplash, peer, 60.0, reason),
        Run("peer_splishsplash_akinci", against_splishsplash, {**peer, "tension": PEER_TENSION}, 90.0, reason),
    ]  # fmt: skip


def checks(results: Results, check: Checks) -> None:
    """Absolute times are shown; the ratio to the peer is judged."""
    for key, result in results.items():
        if key.startswith("steady_"):
            steady, name = result.values["steady"], key.removeprefix("steady_")
            words = WORDS[name.removesuffix("_detection")] + ", detection on" * name.endswith("_detection")
            check("steady_seconds", float("nan") if steady is None else steady["wall"], name, words)
    for key, (ratio, name, words) in PEERS.items():
        if key not in results or results[key].values["missing"]:
            continue
        values = results[key].values
        check(ratio, values["ratio"], name, "SPlisHSPlasH")
        for part, program in (("refsim", "refsim"), ("peer", "SPlisHSPlasH")):
            run = part if key == "peer_splishsplash" else f"{part}_akinci"
            check("peer_time", 1e6 * values[part]["median"], run, f"{program}, {words}")


WORDS = {
    "default": "all pairs", "soft": "soft pairs", "text": "the paper's text, detection on",
    "one_sided": "the paper's words: force on surface particles only",
}  # fmt: skip


EXPERIMENT = Experiment(
    name="timing", title="seconds to steady state (table 1), other programs", runs=planned, checks=checks,
)  # fmt: skip
