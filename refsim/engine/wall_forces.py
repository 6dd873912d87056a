"""Forces of wall particles on the liquid, launched for a choice of them alone."""

import dataclasses
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim.core.effect import Effect, Pass
from refsim.core.operation import REGISTRY
from refsim.engine.launching import launch_pass
from refsim.engine.state import State

OF_LIQUID = ("one_way_coupling.wall_pressure",)  # forces of walls whose own pressure is a sum over the liquid
FRICTION = ("one_way_coupling.wall_viscosity", "adami_2012.hold")


class WallForces:
    """The passes by which the walls of a run push its liquid.

    passes  of the forces, with their effects
    """

    def __init__(self, run: State) -> None:
        self.passes: tuple[tuple[Effect, Pass], ...] = tuple(part for part in run.plan.passes if _of_walls(part[1]))
        self._rows_of = -1
        self._rows: Any = None

    def volumes(self, run: State, values: NDArray[np.float64]) -> Any:
        """Volumes (m,) [m^dim] of wall particles in the order of the plan, as `acceleration` takes them."""
        return run.backend.asarray(run.lists.in_list_order(values).astype(run.plan.grid.dtype))

    def rows(self, run: State) -> Any:
        """Rows (m,) of the particles that have wall particles within reach, on the backend."""
        search = run.search
        if self._rows is None or (search is not None and self._rows_of != search.log.rebuilds):
            near = np.ones(run.plan.grid.count) if search is None else run.backend.host(run.shared["walls"].count)
            self._rows = run.backend.asarray(np.flatnonzero(near).astype(np.int32))
            self._rows_of = 0 if search is None else search.log.rebuilds
        return self._rows

    def acceleration(
        self, run: State, passes: Iterable[tuple[Effect, Pass]], volume: Any, rows: Any, **given: Any
    ) -> NDArray[np.float64]:
        """Acceleration (m, 3) [m/s^2] of these rows of the liquid by wall particles of these volumes.

        given  arrays by which fields are replaced
        """
        summed = run.backend.zeros((run.plan.grid.count, 3), run.plan.grid.dtype)
        walls = run.shared["walls"]
        _push(run, passes, summed, walls._replace(volume=volume), given)
        total = taken(run, summed, rows)
        if run.backend.name != "numpy":
            return total
        run.backend.assign(summed, 0.0)  # the oracles sum over the liquid, too
        _push(run, passes, summed, walls._replace(volume=np.zeros_like(volume)), given)
        return total - summed


def taken(run: State, array: Any, rows: Any) -> NDArray[np.float64]:
    """Rows of an array of the backend, on the host in float64."""
    return run.backend.taken(array, rows).astype(float)


def _push(
    run: State, passes: Iterable[tuple[Effect, Pass]], acceleration: Any, walls: Any, given: dict[str, Any]
) -> None:
    for effect, p in passes:
        arguments: dict[str, Any] = {"acceleration": acceleration, "walls": walls, **given}
        near = run.shared["neighbours"]
        if near is not None and p.operation not in OF_LIQUID:
            arguments["neighbours"] = near._replace(count=run.backend.zeros(near.count.shape, near.count.dtype))
        launch_pass(run, dataclasses.replace(p, algorithm="plain"), arguments, run.parameters[effect.name])


def _of_walls(p: Pass) -> bool:
    """Whether a pass of the forces adds what walls do to the liquid."""
    if "acceleration" not in p.written or p.operation not in REGISTRY or p.names.get("walls", "walls") is None:
        return False
    return "walls" in REGISTRY[p.operation].arguments("numpy")
