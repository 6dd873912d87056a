"""The same work in another program: seconds of a step of a spinning block."""

import numpy as np

from refsim import Akinci2013, Cloud, Scene, WeaklyCompressible
from validation.checks import Checks
from validation.experiment import Experiment, Options, Results, RunSpec
from validation.peers import in_turns, splishsplash
from validation.results import Result
from validation.running import Context, take_steps


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
    rebuilds = []

    def own() -> float:
        simulation = context.simulation(spinning_block(side, tension), "cpu", threads)
        assert simulation.search is not None
        take_steps(simulation, 3)
        before = simulation.search.log.rebuilds
        seconds = take_steps(simulation, steps) / steps
        rebuilds.append(simulation.search.log.rebuilds - before)
        return seconds

    turns = in_turns(rounds, lambda: splishsplash.run(side, steps, threads, tension), own, context.progress, side**3)
    return Result({**turns, "threads": threads, "steps": steps, "rebuilds": rebuilds})


PEER_TENSION = 0.05  # of Akinci et al. 2013 beside SPlisHSPlasH: present, and too weak to break the block up
PEERS = {
    "peer_splishsplash": ("peer_ratio", "splishsplash", "with viscosity"),
    "peer_splishsplash_akinci": ("peer_ratio_akinci", "splishsplash_akinci", "with viscosity and Akinci 2013"),
}


def planned(options: Options) -> list[RunSpec]:
    """The runs under the options."""
    reason = "" if options.peers else "measured with --peers"
    peer = {"side": 47, "steps": 30, "rounds": 3 if options.quick else 5, "threads": options.threads or 2}
    return [
        RunSpec("peer_splishsplash", against_splishsplash, peer, 60.0, reason),
        RunSpec("peer_splishsplash_akinci", against_splishsplash, {**peer, "tension": PEER_TENSION}, 90.0, reason),
    ]


def checks(results: Results, check: Checks) -> None:
    """Absolute times are shown; the ratio to the peer is judged."""
    for key, (ratio, name, label) in PEERS.items():
        if key not in results or results[key].values["missing"]:
            continue
        values = results[key].values
        check(ratio, values["ratio"], name, "SPlisHSPlasH")
        for part, program in (("refsim", "refsim"), ("peer", "SPlisHSPlasH")):
            run = part if key == "peer_splishsplash" else f"{part}_akinci"
            check("peer_time", 1e6 * values[part]["median"], run, f"{program}, {label}")


EXPERIMENT = Experiment(
    name="timing", title="seconds of a step beside another program", runs=planned, checks=checks,
)  # fmt: skip
