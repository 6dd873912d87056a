"""Largest stable steps of a plan, and what a step did."""

import math
from dataclasses import dataclass

from refsim.core.effect import Extremes, StepLimit
from refsim.motion import pace
from refsim.scene.plan import Plan


@dataclass(frozen=True)
class StepOutcome:
    """What a step did: its length [s], the limit that set it, and how far particles have moved."""

    length: float
    limiter: str
    limits: dict[str, float]  # all largest stable steps [s]
    step_displacement: float  # [m] that no particle exceeds in this step; `shifted` [m] of it beside dt v
    shifted: float
    velocity_change: float  # [m/s] by accelerations, which no particle exceeds in this step
    squared_displacement: float  # largest since the neighbour list was built [m^2]
    stopped: int  # number of particles that a wall's plane stopped
    dense: int  # number of particles above the first bound of the liquid's density, before the step


def step_limits(plan: Plan) -> dict[str, StepLimit]:
    """Largest stable steps of a plan by what limits them.

    Some limit sees the particles' speed, and particles at rest have one: the run's time, and that of what moves them.
    """
    grid, effects = plan.grid, plan.effects
    limits = {"force": StepLimit(grid.support_radius / 32, acceleration_share=1.0)}  # 0.25 sqrt((h/2)/|a|)
    for effect in effects.values():
        limits |= effect.step_limits(grid, effects)
    if not any(limit.speed_share > 0 for limit in limits.values()):
        limits["motion"] = StepLimit.crossing(grid.spacing / 2)
    end = plan.scene.end_time or 1.0
    longest = min([end, *(0.25 * pace(motion, end) for motion in plan.scene.motion)])
    if not min(stable_steps(limits, Extremes(0.0, 0.0)).values(), default=math.inf) <= longest:
        limits["resting"] = StepLimit.constant(longest)
    return limits


def stable_steps(limits: dict[str, StepLimit], extremes: Extremes) -> dict[str, float]:
    """Largest stable steps [s] at these extremes, by what limits them."""
    at = {name: limit.at(extremes) for name, limit in limits.items()}
    return {name: step for name, step in at.items() if math.isfinite(step)}
