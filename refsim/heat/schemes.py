"""The schemes of heat conduction: which kernels are launched one after another, on either backend."""

import numpy as np

from refsim.heat import kernels, stages, weights
from refsim.heat.operations import Body, Melting, Step
from refsim.heat.shapes import ONE_ROUND, ROUNDS, Places, StageState, Substance, Tensors


def weighed(body, neighbours, step, scratch, temperature=None):
    """As `weights.weigh_exchanges`, on the backend of the scratch memory."""
    if scratch.backend.name != "cuda":
        return weights.weigh_exchanges(body, neighbours, step, scratch, temperature)
    from refsim.heat import weights_cuda  # loads numba.cuda

    return weights_cuda.weigh_exchanges(body, neighbours, step, scratch, temperature)


def compensation(
    position, velocity, volume, reservoir, neighbours, conduction, period, scratch, compensation_x, compensation_rest
):  # fmt: skip
    """A of every particle: five sums over neighbours at the start, one in a step in which something moves."""
    n, real = volume.shape[0], volume.dtype
    rounds = scratch.array("heat rounds", 3, np.int32)
    scratch.backend.assign(rounds, 0)
    kernels.note_rounds(velocity, compensation_x, rounds)
    given = Tensors(compensation_x, compensation_rest)
    made = Tensors(*(scratch.array(f"heat made {part}", (n, 3), real) for part in Tensors._fields))
    places = Places(position, volume, reservoir, conduction, period)
    host = scratch.backend.name != "cuda"  # a GPU decides by itself
    if host and not rounds.any():
        return
    shares = tuple(real.type(weight or ONE_ROUND) for weight in ROUNDS)
    kernels.compensate(rounds, np.int32(0), shares[0], places, neighbours, given, *made)
    kernels.take_over(rounds, made, *given)
    if not host:
        from refsim.heat import weights_cuda

        weights_cuda.start_anew(rounds, shares[1:], places, neighbours, given, made)
    elif rounds[1]:
        for k, weight in enumerate(shares[1:], 1):  # an even number: the last one writes where the first has read
            kernels.compensate(rounds, np.int32(k), weight, places, neighbours, given, *made)
            given, made = made, given


# What the schemes share


def copied(values, name, scratch):
    """A copy of an array in scratch memory."""
    target = scratch.array(name, values.shape[0], values.dtype)
    kernels.copy(values, target)
    return target


def plan_of(length, scratch, real):
    """(table (stages, 4) of coefficients, array (1,) of their number), not yet written."""
    return scratch.array(f"heat table {length}", (length, 4), real), scratch.array("heat number", 1, np.int32)


def run_stages(plan, exchanges, inverse, flow_start, substance, scratch, enthalpy, temperature):
    """Take the stages of a plan (table, number) one after the other, from the state and into it."""
    state = temperature if substance is None else enthalpy
    n, real = state.shape[0], state.dtype
    change = scratch.array("heat change", n, real)
    values = [scratch.array(f"heat buffer {k}", n, real) for k in range(2)]
    warm, now, source = [None] * 2, state, temperature
    if substance is not None:  # values are gains of enthalpy
        warm = [scratch.array(f"heat warm {k}", n, real) for k in range(2)]
        now = scratch.array("heat nothing", n, real)
        scratch.backend.assign(now, 0)
    for k in range(plan[0].shape[0]):
        new, target = values[k % 2], warm[k % 2]
        stage = StageState(state, now, source, flow_start, change, temperature)
        kernels.advance(exchanges, stage, inverse, substance, plan, np.int32(k), target, new)
        now = new
        source = new if substance is None else target


def substance_of(body, melting):
    """What turns enthalpies into temperatures; None without latent heat."""
    return None if melting.melting_point is None else Substance(body.heat_capacity, *melting)


def known(largest, enthalpy, temperature, scratch):
    """The largest s_i on the host; None if it is not finite, or beyond every step that a scene may take.

    The solver couples all particles, so no temperature is valid then: all are set to NaN.
    """
    most = float(scratch.host(largest)[0])
    if most < stages.LARGEST_SUM:
        return most
    scratch.backend.assign(temperature, np.nan)
    if enthalpy is not None:
        scratch.backend.assign(enthalpy, np.nan)
    return None


# The schemes


def explicit(body: Body, melting: Melting, neighbours, step: Step, scratch, enthalpy, temperature):
    """Forward Euler."""
    _, inverse, _, flow = weighed(body, neighbours, step, scratch, temperature)
    kernels.step_forward(inverse, flow, substance_of(body, melting), enthalpy, temperature)


def one_sided(body: Body, neighbours, step: Step, scratch, temperature):
    """M(4) read literally (R1): every particle by itself, forwards, then backwards."""
    exchanges, inverse, *_ = weighed(body, neighbours, step, scratch)
    for backwards in (0, 1):
        old = copied(temperature, "heat start", scratch)
        kernels.sweep(exchanges, inverse, step.conduction, np.int32(backwards), old, temperature)


def implicit(body: Body, melting: Melting, neighbours, step: Step, scratch, enthalpy, temperature):
    """Backward Euler by Chebyshev's iteration; Chernoff's formula with latent heat.

    With `planned_passes` a GPU finds the number of passes itself, so that a step waits for nothing.
    """
    exchanges, inverse, largest, flow = weighed(body, neighbours, step, scratch, temperature)
    start = None if enthalpy is None else copied(temperature, "heat start", scratch)
    passes = int(step.conduction.planned_passes)
    if not passes or scratch.backend.name != "cuda":
        most = known(largest, enthalpy, temperature, scratch)
        if most is None:
            return
        passes = stages.chebyshev_passes(most, float(step.conduction.tolerance))
    plan = plan_of(passes, scratch, temperature.dtype)
    kernels.plan_chebyshev(largest, step.conduction, *plan)
    run_stages(plan, exchanges, inverse, flow, None, scratch, None, temperature)
    if enthalpy is not None:
        kernels.take_up(start, substance_of(body, melting), enthalpy, temperature)


def runge_kutta_legendre(body: Body, melting: Melting, neighbours, step: Step, scratch, enthalpy, temperature):
    """RKL2 on temperatures, RKL1 on enthalpies."""
    exchanges, inverse, largest, flow = weighed(body, neighbours, step, scratch, temperature)
    most = known(largest, enthalpy, temperature, scratch)
    if most is None:
        return
    found = list(stages.legendre_stages(most) if enthalpy is None else stages.first_legendre_stages(most))
    plan = plan_of(len(found), scratch, temperature.dtype)
    for array, values in zip(plan, (np.array(found, temperature.dtype), len(found))):
        scratch.backend.assign(array, values)
    run_stages(plan, exchanges, inverse, flow, substance_of(body, melting), scratch, enthalpy, temperature)
