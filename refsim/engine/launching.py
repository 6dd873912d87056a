"""The passes of a run: bound to its arrays, launched in a step, and on the present state for what is read of it."""

from collections.abc import Callable, Collection, Generator, Iterable, Iterator
from typing import Any

from refsim.core.effect import Effect, Pass
from refsim.engine.binding import bind_pass
from refsim.engine.neighbour_lists import attend, update
from refsim.engine.state import State
from refsim.sph import WAY


def bind(state: State) -> None:
    """Look up the arrays that every pass of a step takes."""
    plan = state.plan
    state.start_calls = [(p.operation, _call(state, (effect,), p)) for effect, p in plan.start]
    state.begin_calls = [(p.operation, _call(state, (effect,), p)) for effect, p in plan.begin]
    state.force_calls = [(p.operation, p.on_demand, _call(state, effects, p)) for effects, p in state.force_passes]
    state.motion_calls = [(p.operation, _call(state, (effect,), p)) for effect, p in plan.motion]
    state.extremes_call = _call(state, (), Pass("sph.extremes"))
    state.bound = True
    state.bindings += 1


def _call(state: State, effects: Iterable[Effect | None], p: Pass) -> Callable[[], None]:
    """A pass as a call without arguments; those of no effect are the loop's own."""
    groups: dict[str, Any] = {}
    for effect in effects:
        groups |= {} if effect is None else state.parameters[effect.name]
    of_loop = {name: getattr(state, name) for name in ("extremes", "displacement", "timestep", "build_position")}
    return bind_pass(p, state.backend, (groups, state.shared, state.fields, of_loop))


def start(state: State) -> None:
    """Fill the tables that follow from the state."""
    for name, call in state.start_calls:
        state.timings.run(name, call)


def ready(state: State) -> None:
    """Have lists that hold every pair, and passes that take them."""
    update(state)
    attend(state)
    if not state.bound:
        bind(state)


def launch(state: State, only: Collection[int] | None = None) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Launch the passes of a step, or those of these numbers; after each, its operation and the fields it wrote."""
    whole = only is None or needed(state, "acceleration") <= set(only)  # also where no pass adds to it
    first = next((k for k, (_, p) in enumerate(state.force_passes) if "acceleration" in p.writes), None)
    if whole and first is None:
        state.backend.assign(state.fields["acceleration"], 0.0)
        _push(state)
    for k, ((name, rare, call), (_, p)) in enumerate(zip(state.force_calls, state.force_passes)):
        if (not rare) if only is None else k in only:
            state.timings.run(name, call)
            if whole and k == first:
                _push(state)
            yield name, (*p.writes, *p.updates)


def _push(state: State) -> None:
    """Add the user's own forces."""
    for force in state.own_forces:
        force(state.time, state.fields)


def replay(
    state: State, on_demand: bool = False, only: Collection[int] | None = None
) -> Generator[tuple[str, tuple[str, ...]], None, None]:
    """Run the passes on the present state one by one; after each, its operation and the fields it wrote.

    What outlives the step (warm starts, say) is put back at the end, so that the run is not changed. only: numbers
    of the passes to run, in place of all
    """
    ready(state)
    if only is None:
        only = [k for k, (_, p) in enumerate(state.force_passes) if on_demand or not p.on_demand]
    touched = set().union(*(state.force_passes[k][1].written for k in only))
    kept = {name: state.host(name) for name, f in state.plan.fields.items() if f.state and name in touched}
    state.current -= touched
    state.lists.ways_renewed |= WAY.name in touched
    state.foreseen = False
    try:
        yield from launch(state, only)
        state.current |= touched
    finally:
        for name, values in kept.items():
            state.backend.assign(state.fields[name], values)


def refresh(state: State, on_demand: bool = False) -> None:
    """Run the passes on the present state unless all of their fields belong to it."""
    if not all(p.written <= state.current for _, p in state.force_passes if on_demand or not p.on_demand):
        for _ in replay(state, on_demand):
            pass


def bring(state: State, names: Iterable[str]) -> None:
    """Run the passes on which these fields depend, and no others, unless the fields belong to the present state."""
    stale = [name for name in names if name not in state.current]
    only = frozenset().union(*(needed(state, name) for name in stale))
    if only or "acceleration" in stale:
        for _ in replay(state, only=only):
            pass


def needed(state: State, name: str) -> frozenset[int]:
    """Numbers of the passes on which a field depends that follows from the state; none for other fields."""
    if name not in state.needs:
        wanted, taken, more = {name}, set[int](), {-1}
        while more and not state.plan.fields[name].state:
            more = {k for k, (_, p) in enumerate(state.force_passes) if p.written & wanted} - taken
            taken |= more
            wanted.update(*((*p.written, *p.reads) for k, (_, p) in enumerate(state.force_passes) if k in more))
        state.needs[name] = frozenset(taken)
    return state.needs[name]


def launch_pass(state: State, p: Pass, *arrays: dict[str, Any]) -> None:
    """Launch a pass outside a step: what it takes stands in `own`, or with all passes."""
    state.timings.run(p.operation, bind_pass(p, state.backend, (*arrays, state.shared, state.fields)))
