"""Whether a scene's flow stays far enough below the sound speed of its liquid, judged before the run."""

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from refsim.core.capabilities import HasPlanes, effects_with
from refsim.core.effect import Discretisation, InitialState, Others
from refsim.core.walls import WallParticles

SLOW = 0.1  # |v|/c up to which density changes by about 1 %


def fall_height(
    grid: Discretisation, state: InitialState, walls: WallParticles | None, others: Others, pull: np.ndarray
) -> float:
    """H [m] that liquid can fall or stand along an acceleration (3,) [m/s^2]; 0 where there is none, or no liquid.

    From the liquid's top down to the lowest point of the walls' planes; where none holds it from below, to the lowest
    of all particles, of walls, meshes and solids, too.
    """
    size = float(np.linalg.norm(pull))
    solid = 0 if grid.solids is None else len(grid.solids.lattice.key)
    if size == 0 or len(state.position) == solid:
        return 0.0
    down = pull / size
    half = 0.5 * grid.spacing * np.abs(down).sum()  # to the farthest corner of a particle's cell
    depth = state.position @ down
    floor = math.inf
    for effect in effects_with(others, HasPlanes):
        lower, upper = effect.domain(grid)
        floor = min(floor, sum(d * (upper if d > 0 else lower)[axis] for axis, d in enumerate(down) if d != 0))
    if not math.isfinite(floor):
        floor = max(depth.max() + half, -math.inf if walls is None else (walls.position @ down).max())
    return max(0.0, float(floor - depth[solid:].min() + half))


def fast_flow(
    name: str, sound_speed: float, advice: Callable[[float], str], grid: Discretisation, state: InitialState,
    walls: WallParticles | None, others: Others, acceleration: Sequence[float],
) -> Iterator[str]:  # fmt: skip
    """A note of effect `name` where the flow may exceed a tenth of the sound speed [m/s].

    The flow's speed is the larger of that of the fastest particle or wall at the start and of sqrt(2 g H), H of
    `fall_height`; `advice` says what gives a sound speed [m/s]. Along a period gravity drives a flow, and nothing
    falls.
    """
    fastest = max(
        float(np.sqrt((state.velocity**2).sum(1).max(initial=0.0))),
        *(effect.wall_speed() for effect in effects_with(others, HasPlanes)), 0.0,
    )  # fmt: skip
    pull = np.where(np.array(grid.period) > 0, 0.0, acceleration)
    height = fall_height(grid, state, walls, others, pull)
    falling = math.sqrt(2 * float(np.linalg.norm(pull)) * height)
    speed = max(fastest, falling)
    if speed > SLOW * sound_speed * (1 + 1e-6):
        what = "the fastest particle or wall at the start"
        if falling > fastest:
            what = f"sqrt(2 g H) of liquid that can fall or stand H = {height:.3g} m high"
        yield (
            f"{name}: a flow of {speed:.3g} m/s ({what}) is above a tenth of the sound speed of {sound_speed:.3g} m/s,"
            f" so that the liquid is compressed by more than about 1 %: take {advice(speed / SLOW)}"
        )


def at_least(name: str, value: float, unit: str) -> str:
    """Words for a parameter and its least value, rounded up to three digits, so that the number told suffices."""
    digit = 10.0 ** (math.floor(math.log10(value)) - 2)
    rounded = float(f"{math.ceil(value / digit * (1 - 1e-12)) * digit:.3g}")
    return f"a {name} of at least {rounded:g} {unit}"
