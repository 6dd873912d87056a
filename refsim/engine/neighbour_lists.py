"""Building the neighbour lists of a run, and sorting its particles by cell before."""

import functools
import math
from typing import Any

from refsim.core.errors import RunStopped
from refsim.core.walls import with_list
from refsim.engine.state import State
from refsim.neighbours import NeighbourSearch, Particles
from refsim.sph import LONGEST_SHIFT, WAY

SORT_EVERY = 50  # steps between two sortings of particles that no neighbour list sorts


def update(state: State) -> None:
    """Rebuild the lists where one may lack a pair, or reaches too far; the particles are put into cell order before.

    Raises RunStopped where the audit of the old list finds that it lacked a neighbour.
    """
    if state.lists.outlasts(state.steps) or not state.lists.needs_no_look():
        state.timings.run("neighbours", functools.partial(_look, state))


def look_ahead(state: State) -> bool:
    """Launch the comparison of displacements behind a step, if it will probably be needed, which is told; for a GPU."""
    lists = state.lists
    expected = lists.expects_look()
    if lists.search is not None and lists.built:
        lists.search.look_ahead(_particles(state), expected and not lists.brief)
    return expected


def _particles(state: State) -> Particles:
    return Particles(state.fields["position"], state.build_position, state.fields["velocity"], state.timestep)


def _look(state: State) -> None:
    lists, search = state.lists, state.lists.search
    assert search is not None
    if lists.built and not lists.outlasts(state.steps) and lists.keeps(_particles(state)):
        return
    # The audit steps positions back by velocities and shifts, which must be those that led to them.
    if lists.built and lists.auditable and not (lists.velocities_set or lists.ways_renewed):
        position, velocity = state.fields["position"], state.fields["velocity"]
        neighbours, bounds = state.shared["neighbours"], state.shared.get("bounds")
        shift = tuple(state.fields.get(name) for name in (WAY.name, LONGEST_SHIFT.name, "drawn_body"))
        search.audit(position, velocity, state.timestep, neighbours, bounds, None if shift[0] is None else shift)
    if lists.built:
        lists.choose_skin(state.steps)
    sort(state, search, before_build=True)
    rebuild(state)
    missed = search.log.missed_neighbours
    if missed:
        raise RunStopped(
            "missed_neighbours",
            f"The neighbour list lacked {missed} neighbours of the audited particles up to step {state.steps} at"
            f" {state.time:.6g} s; give the scene a larger skin than {search.skin}.",
        )


def rebuild(state: State) -> None:
    """Build the lists from the particles' present order and `build_position`."""
    lists, position = state.lists, state.build_position
    assert lists.search is not None
    near = lists.search.build(position)
    at_walls = None if lists.walls is None else lists.search.build_against(position, lists.static)
    around = lists.search.build_around(position, lists.static) if lists.around_walls else None
    lists.after_build(state.steps)
    state.outdate()
    new = (near, at_walls, around)
    if lists.latest is None or any(list_ is not old for list_, old in zip(new, lists.latest)):
        lists.latest, state.bound = new, False
        state.shared["neighbours"] = near
        if around is not None:
            state.shared["liquid_near_walls"] = with_list(state.fields["position"], None, around)
        if lists.walls is not None:
            state.shared["walls"] = with_list(*lists.walls, at_walls)


# The order of the particles in memory: cell by cell, so that neighbouring threads read contiguous memory


def sort(state: State, search: NeighbourSearch, before_build: bool = False) -> None:
    """Put the particles into the cell order of `search` and note their positions in `build_position`."""
    names = state.plan.ordered_fields
    arrays = [state.fields[name] for name in names]
    renumbered = functools.partial(renumber, state)
    moved = search.sort(state.fields["position"], arrays, state.build_position, before_build, renumbered)
    state.bound = state.bound and all(new is old for new, old in zip(moved, arrays))  # on a GPU they are the same
    state.fields |= zip(names, moved)
    if not search.looks_ahead:
        renumber(state)


def sort_now_and_then(state: State) -> None:
    """Sort particles that no neighbour list sorts, where it is due and no attended group gives the order."""
    order = state.order
    if order.cells is not None and not order.attended and _due(state):
        state.timings.run("sorting", functools.partial(sort, state, order.cells))


def attend(state: State) -> None:
    """Have groups that need it make arrays from the positions before the step."""
    moved = math.isinf(state.lists.squared_displacement)  # set between two steps
    for each in state.order.attended:
        if each.attend(state.fields["position"], moved=moved):
            state.bound = False


def follow(state: State) -> None:
    """Where sorting is due, put the particles into the order that an attended group gives."""
    for each in state.order.attended if state.order.cells is not None and _due(state) else ():
        order = each.order(state.fields["position"])
        if order is not None:
            state.timings.run("sorting", functools.partial(_follow, state, order))


def _due(state: State) -> bool:
    return state.steps % SORT_EVERY == 0


def _follow(state: State, order: Any) -> None:
    arrays, rows = [state.fields[name] for name in state.plan.ordered_fields], state.order.rows
    if rows is None or rows.order is not order or not rows.belongs_to(arrays):
        from refsim.backends import device

        state.order.rows = rows = device.Rows(arrays, order)
    rows.launch()
    renumber(state)


def renumber(state: State) -> None:
    """Bring the table of each particle's row up to the present order, where the scene has one."""
    state.outdate()
    if "place" in state.fields:
        state.backend.invert(state.fields["identity"], state.fields["place"])
