"""What the gauges of a scene read from a run.

A value belongs to the state between two steps. What it follows from is computed there by the passes of the scene, and
the sums that make a number of it are added on the host in float64, in the order of the particles.
"""

import dataclasses
import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from refsim.backends.arrays import Backend
from refsim.core.capabilities import PullsAtLines, effects_with
from refsim.core.checked import suggestion
from refsim.core.effect import Effect, Pass
from refsim.core.errors import InputError
from refsim.core.operation import REGISTRY
from refsim.core.walls import WallParticles, with_list
from refsim.engine.binding import bind_pass
from refsim.engine.launching import bring, launch_pass, ready
from refsim.engine.state import State
from refsim.gauges import SURFACE, Gauge, GaugeSeries, Sampled, due
from refsim.gauges.checks import shares_of_faces
from refsim.motion.operations import turning
from refsim.neighbours import NeighbourSearch
from refsim.neighbours.reference import pair_blocks
from refsim.scene.plan import Plan
from refsim.smoothing.reference import kernel_value
from refsim.sph import WallFrameGravity, acceleration_of, gravity_of, liquid_of

LEAST_OPEN = 0.1  # of the space around a point that walls leave to the liquid, below which it counts as wall
OF_LIQUID = ("one_way_coupling.wall_pressure",)  # forces of walls whose own pressure is a sum over the liquid
FRICTION = ("one_way_coupling.wall_viscosity", "adami_2012.hold")


class Share(NamedTuple):
    """Wall particles on whose force a gauge counts, with their volumes, for some components and passes."""

    volume: Any  # (m,) [m^dim] on the backend
    components: list[int]
    passes: tuple[tuple[Effect, Pass], ...]


class Gauges:
    """The gauges of a run and what they have measured.

    wall_passes  those by which walls push the liquid, with their effects
    shares       of each gauge that measures the force on a wall, by its number
    """

    def __init__(self, run: State) -> None:
        plan = run.plan
        self.gauges: tuple[Gauge, ...] = plan.scene.gauge
        self.dim = plan.grid.dim
        self.rows: list[list[list[float]]] = [[] for _ in self.gauges]
        self.points = [gauge.points(plan.grid) for gauge in self.gauges]
        ends = np.cumsum([len(points.place) for points in self.points])
        self.slices = [slice(end - len(points.place), end) for points, end in zip(self.points, ends)]
        self.places = np.concatenate([points.place for points in self.points])
        self.wall_passes: tuple[tuple[Effect, Pass], ...] = tuple(part for part in plan.passes if _of_walls(part[1]))
        on_walls = [k for k, g in enumerate(self.gauges) if g.does.needs == "force" and not g.on.startswith("solid")]
        self.shares = {k: tuple(self._split(run, self.gauges[k])) for k in on_walls}
        ends_at_walls = {effect.unopposed for effect in effects_with(plan.effects, PullsAtLines)}
        self.line_passes = tuple(part for part in plan.passes if part[1].operation in ends_at_walls)
        self._tree: Any = None  # of the wall particles
        self._rows: Any = None
        self._rows_of = self._listed_at = -1
        self._static: Any = None
        self._open: NDArray[np.float64] | None = None
        self._of_one: dict[str, Any] = {}  # substance
        if "rest_density" not in plan.fields:
            rest = np.full(plan.grid.count, liquid_of(plan.effects).rest_density, plan.grid.dtype)
            self._of_one["rest_density"] = run.backend.asarray(rest)

    # When

    def begin(self, run: State) -> None:
        """Measure the start."""
        if not all(self.rows):
            self.after_step(run)

    def after_step(self, run: State) -> None:
        """Measure what is due."""
        wanted = [
            k for k, gauge in enumerate(self.gauges)
            if due(gauge.every / max(1, gauge.instants), run.time, self.rows[k][-1][0] if self.rows[k] else None)
        ]  # fmt: skip
        if wanted:
            with run.timings.of_host("gauges"):
                self._measure(run, wanted)

    def _measure(self, run: State, wanted: list[int]) -> None:
        needs = {self.gauges[k].does.needs for k in wanted}
        fields = {"position", *(("density", "pressure") if "pressure" in needs else ())}
        for k in wanted:
            if k in self.shares:
                of = (*self.line_passes, *(part for share in self.shares[k] for part in share.passes))
                fields |= {name for _, p in of for name in p.reads}
            elif self.gauges[k].does.needs == "force":
                fields.add("acceleration")
        ready(run)
        bring(run, fields)
        pressure = self._pressure(run) if "pressure" in needs else np.zeros(0)
        fill, flow = self._sample(run) if needs - {"force"} else (np.zeros(0), np.zeros((0, 3)))
        if len(pressure):
            pressure = np.where(fill < SURFACE, np.maximum(pressure, 0), pressure)
        for k in wanted:
            gauge, part = self.gauges[k], self.slices[k]
            if k in self.shares:
                values = self._wall(run, k)
            elif gauge.does.needs == "force":
                values = self._body(run, gauge)
            else:
                values = gauge.does.read(self.points[k], Sampled(pressure[part], fill[part], flow[part]))
                if gauge.does.needs == "pressure":
                    self._note_pressure(run, gauge, values[0])
            self.rows[k].append([run.time, *values])

    def _note_pressure(self, run: State, gauge: Gauge, pressure: float) -> None:
        """Add a note to the run where a gauge reads a pressure [Pa] that no liquid with a surface has at a wall.

        Below zero by more than the weight of a support radius of liquid and than rho0 c^2/10^4 (1 % of rho0 g H at
        c = 10 sqrt(g H)); above that of an impact, rho0 c v with the speed v of the fastest particle, and twice the
        weight of the liquid.
        """
        plan = run.plan
        liquid, pull = liquid_of(plan.effects), np.array(acceleration_of(plan.effects))
        if getattr(plan.effects.get("particle_shifting"), "surface", "") == "none":
            return  # without a surface the zero of the pressure is the start's
        density, sound, weight = liquid.rest_density, liquid.sound_speed, float(np.linalg.norm(pull))
        tall = float(np.ptp(plan.state.position @ pull)) + weight * plan.grid.spacing
        least = -density * max(weight * plan.grid.support_radius, 1e-4 * sound**2)
        speed = math.sqrt(float(run.backend.host(run.extremes)[0]))
        most = density * (sound * speed + 2 * tall + 1e-4 * sound**2)
        if least <= pressure <= most:
            return
        what = f"below zero by more than {-least:.3g} Pa, so that liquid pulls there"
        if pressure > most:
            what = f"above the {most:.3g} Pa of rho0 c v, v = {speed:.3g} m/s of the fastest particle, and twice the"
            what += " weight"
        advice = f"take {gauge.columns(self.dim)[0][0]}_mean" if gauge.instants else "give it instants, and take means"
        reads = f"gauge {gauge.name}: at {run.time:.6g} s it reads {pressure:.4g} Pa"
        run.add_note(f"gauge {gauge.name}", f"{reads}, {what}: {advice}, or a smaller spacing")

    # At points

    def _at_points(self, run: State, p: Pass, outputs: dict[str, tuple[int, ...]], **given: Any) -> list[NDArray]:
        """What a pass writes at all points, by its name with the shape of an entry.

        The lists hold particles that had been near a point when they were built. Liquid that moves as a whole keeps its
        lists: once a particle has moved by more than the skin, the reference sums over all near the points.
        """
        grid, search, shared = run.plan.grid, run.search, run.shared
        fields: dict[str, Any] = {**run.fields, **self._of_one}
        skin = math.inf if search is None else 2 * search.allowed_displacement
        listed = run.lists.squared_displacement <= skin**2
        backend = run.backend if listed else Backend("numpy")
        place, dtype = grid.local(self.places), np.dtype(grid.dtype)
        written = {name: backend.zeros((len(place), *shape), dtype) for name, shape in outputs.items()}
        if search is not None and listed:
            launch_pass(run, p, self._listed(run, search, place), given, written, fields)
            values = (np.asarray(backend.host(each), dtype=float) for each in written.values())
            return [self._static.in_first_order(each) for each in values]
        if not listed:
            taken = REGISTRY[p.operation].arguments(REGISTRY[p.operation].chosen(backend.name, ""))
            free = [axis for axis in range(3) if run.plan.scene.period[axis] == 0]
            x, reach = run.host("position").astype(float), run.plan.scene.support_radius
            near = ((x >= place.min(0) - reach) & (x <= place.max(0) + reach))[:, free].all(1)
            names = {p.names.get(name, name) for name in taken}
            fields = {name: run.backend.host(fields[name])[near] for name in fields if name in names}
            turning = run.motions and run.motions.turning
            shared = {**run.plan.shared, **({} if turning is None else {"turning": run.backend.host(turning)})}
        points = {"walls": WallParticles(place.astype(dtype), np.zeros(len(place), dtype))}
        run.timings.run(p.operation, bind_pass(p, backend, (points, written, given, fields, shared)))
        return [each.astype(float) for each in written.values()]

    def _listed(self, run: State, search: NeighbourSearch, place: NDArray) -> dict[str, Any]:
        """The points and the liquid near each, as the operations take them."""
        if self._static is None:
            self._static = search.static_set(place)
        if self._listed_at != search.log.rebuilds:
            self._near = search.build_around(run.build_position, self._static, "gauges")
            self._listed_at = search.log.rebuilds
        around = WallParticles(self._static.position, self._static.position)  # of which only the places are read
        return {"walls": around, "liquid_near_walls": with_list(run.fields["position"], None, self._near)}

    def _pressure(self, run: State) -> NDArray[np.float64]:
        """Pressure [Pa] at all points, extrapolated from the liquid near them; 0 where there is none."""
        lean = WallFrameGravity(*map(run.plan.grid.real, _gravity(run)))
        return self._at_points(run, Pass("adami_2012.extrapolation"), {"wall_pressure": ()}, lean=lean)[0]

    def _sample(self, run: State) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Share of the space that the liquid fills (m,) and its flow (m, 3) [m/s] at all points.

        Both are relative to the space that walls leave.
        """
        resting = Pass("gauges.sample", names={"density": "rest_density"})
        fill, flow = self._at_points(run, resting, {"fill": (), "flow": (3,)})
        share = self._liquid_share(run.plan)
        return fill / share, flow / share[:, None]

    def _liquid_share(self, plan: Plan) -> NDArray[np.float64]:
        """Share of the space around each point that walls leave to the liquid; infinite where it is nearly none."""
        if self._open is None:
            filled = np.zeros(len(self.places))
            if plan.walls is not None and len(self.places):
                reach, free = plan.scene.support_radius, [axis for axis in range(3) if plan.scene.period[axis] == 0]
                low, high = self.places.min(0) - reach, self.places.max(0) + reach
                inside = ((plan.walls.position >= low) & (plan.walls.position <= high))[:, free].all(1)
                near, volume = plan.walls.position[inside], plan.walls.volume[inside]
                for rows, _, distance in pair_blocks(self.places, near, None, plan.shared["period"]):
                    filled[rows] += (volume * kernel_value(distance, plan.shared["smoothing"])).sum(1)
            left = 1 - filled
            self._open = np.where(left > LEAST_OPEN, left, np.inf)
        return self._open

    # On walls and solids

    def _split(self, run: State, gauge: Gauge) -> Iterable[Share]:
        """The launches that make a force: equal shares of components together."""
        plan = run.plan
        grid, dim = plan.grid, plan.grid.dim
        of_friction = tuple(part for part in self.wall_passes if part[1].operation in FRICTION)
        of_pressure = tuple(part for part in self.wall_passes if part[1].operation not in FRICTION)
        first, last = plan.wall_rows[_owner(run, gauge)]
        pressure, friction = self._shares_of(run, gauge)
        for passes, share in ((of_pressure, pressure), (of_friction, friction)):
            columns: dict[bytes, list[int]] = {}
            for axis in range(dim):
                columns.setdefault(share[:, axis].tobytes(), []).append(axis)
            for axes in columns.values():
                if passes and share[:, axes[0]].any():
                    volume = np.zeros(len(plan.walls.volume))
                    volume[first:last] = plan.walls.volume[first:last] * share[:, axes[0]]
                    listed = run.lists.in_list_order(volume).astype(grid.dtype)
                    yield Share(run.backend.asarray(listed), axes, passes)

    def _shares_of(self, run: State, gauge: Gauge) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The gauge's shares (m, dim) of the pressure and of the friction on the wall particles that it counts on."""
        plan, owner = run.plan, _owner(run, gauge)
        first, last = plan.wall_rows[owner]
        whole = np.ones((last - first, plan.grid.dim))
        if gauge.on == owner:
            return whole, whole
        position = plan.walls.position[first:last]
        pressure, friction = shares_of_faces(plan.effects[owner], position, acceleration_of(plan.effects), plan.grid)
        return pressure[gauge.on], friction[gauge.on]

    def _of_lines(self, run: State, gauge: Gauge) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Forces (n, 3) [N] on the wall by surfaces that end at it, and where they act (n, 3) [m].

        The opposite of the sum R of forces that have none: -R w_i/sum_j w_j, w_i = |m_i a_i| sum_b V_b W_ib.
        """
        from scipy.spatial import cKDTree

        plan = run.plan
        grid, (first, last) = plan.grid, plan.wall_rows[_owner(run, gauge)]
        pull = run.host("mass").astype(float)[:, None] * _forced(run, self.line_passes)
        drawn = np.flatnonzero(pull.any(1))
        place = grid.absolute(run.host("position")[drawn].astype(float))
        if self._tree is None:
            self._tree = cKDTree(plan.walls.position)
        near = self._tree.query_ball_point(place, grid.support_radius, return_sorted=True)
        i, b = np.repeat(np.arange(len(drawn)), [len(each) for each in near]), np.concatenate([[], *near]).astype(int)
        r = np.linalg.norm(place[i] - plan.walls.position[b], axis=1)
        size = np.linalg.norm(pull[drawn], axis=1)
        weight = size[i] * plan.walls.volume[b] * kernel_value(r, plan.shared["smoothing"])
        share = np.zeros((len(plan.walls.volume), 3))
        share[first:last, : grid.dim] = self._shares_of(run, gauge)[1]
        borne = np.zeros((len(drawn), 3))
        np.add.at(borne, i, weight[:, None] * share[b])
        return -pull.sum(0) * borne / (weight.sum() or 1.0), place

    def _wall(self, run: State, k: int) -> list[float]:
        """Force and torque of the liquid on a wall: the reaction to the forces of the wall on the liquid."""
        rows = self._near_walls(run)
        mass, place = (run.backend.taken(run.fields[name], rows).astype(float) for name in ("mass", "position"))
        place = run.plan.grid.absolute(place)
        push = np.zeros((len(mass), 3))
        for share in self.shares[k]:
            acceleration = _pushed(run, share.passes, share.volume, rows)
            if run.backend.name == "numpy":  # the oracles sum over the liquid, too
                acceleration -= _pushed(run, share.passes, np.zeros_like(share.volume), rows)
            push[:, share.components] -= mass[:, None] * acceleration[:, share.components]
        if self.line_passes:
            of_lines, places = self._of_lines(run, self.gauges[k])
            push, place = np.vstack([push, of_lines]), np.vstack([place, places])
        about = np.array(self.gauges[k].about or (0.0, 0.0, 0.0))
        return _row(push, place - about, run.plan.grid.dim)

    def _near_walls(self, run: State) -> Any:
        """Rows (m,) of the particles that have wall particles within reach, on the backend."""
        search = run.search
        if self._rows is None or (search is not None and self._rows_of != search.log.rebuilds):
            near = np.ones(run.plan.grid.count) if search is None else run.backend.host(run.shared["walls"].count)
            self._rows = run.backend.asarray(np.flatnonzero(near).astype(np.int32))
            self._rows_of = 0 if search is None else search.log.rebuilds
        return self._rows

    def _body(self, run: State, gauge: Gauge) -> list[float]:
        """Force and torque on a solid of all that acts on its particles but the frame and the solid itself."""
        number = int(gauge.on.split()[1]) - 1
        first = int(np.sum(run.plan.state.sizes[:number]))
        identity = run.host("identity")
        held = (identity >= first) & (identity < first + run.plan.state.sizes[number])
        if "phase" in run.fields:
            from refsim.shape_matching.phases import FLUID

            held &= run.host("phase") != FLUID
        particles = np.flatnonzero(held)
        particles = particles[np.argsort(identity[particles])]
        acceleration, velocity, place = (
            run.host(name)[particles].astype(float) for name in ("acceleration", "velocity", "position")
        )
        if gravity_of(run.plan.effects) is not None:
            acceleration -= np.array(_gravity(run), run.plan.grid.dtype).astype(float)
        if run.motions is not None and run.motions.turning is not None:
            frame = run.backend.host(run.motions.turning)
            acceleration -= turning(place, velocity, frame)["acceleration"].value
        mass, place = run.host("mass")[particles].astype(float), run.plan.grid.absolute(place)
        push = mass[:, None] * acceleration
        centre = mass @ place / mass.sum() if len(particles) else np.zeros(3)
        about = centre if gauge.about is None else np.array(gauge.about)
        return _row(push, place - about, run.plan.grid.dim)

    # Reading, stopping and going on

    def series(self, name: str) -> GaugeSeries:
        """What the gauge of this name has measured. Raises InputError where there is none."""
        names = [gauge.name for gauge in self.gauges]
        if name not in names:
            raise InputError(f"gauge: the scene has no gauge {name!r}; {suggestion(name, names)}")
        k = names.index(name)
        gauge = self.gauges[k]
        table = gauge.values(self.table(k))
        columns, units = zip(*gauge.columns(self.dim))
        return GaugeSeries(name, gauge.kind, table[:, 0], table[:, 1:], columns, units)

    def table(self, k: int) -> NDArray[np.float64]:
        """Times and values at which gauge `k` was read, (rows, 1 + columns)."""
        width = 1 + len(self.gauges[k].does.columns(self.dim))
        return np.array(self.rows[k], dtype=float).reshape(-1, width)

    def tables(self) -> dict[str, NDArray[np.float64]]:
        """Times and values at which every gauge was read, by its name."""
        return {gauge.name: self.table(k) for k, gauge in enumerate(self.gauges)}

    def restore(self, tables: dict[str, NDArray[np.float64]]) -> None:
        """Go on after these tables, by the gauges' names."""
        self.rows = [tables[gauge.name].tolist() for gauge in self.gauges]


def _gravity(run: State) -> Sequence[float]:
    """Acceleration of gravity now, (3,) [m/s^2]."""
    return acceleration_of(run.plan.effects) if run.motions is None else run.motions.gravity.tolist()


def _row(push: NDArray[np.float64], arm: NDArray[np.float64], dim: int) -> list[float]:
    """The values of a force's columns from forces (n, 3) [N] with arms (n, 3) [m]."""
    force, torque = push.sum(0), np.cross(arm, push).sum(0)
    if dim == 2:
        return [float(force[0]), float(force[1]), float(torque[2])]
    return [*map(float, force), *map(float, torque)]


def _pushed(run: State, passes: Iterable[tuple[Effect, Pass]], volume: Any, rows: Any) -> NDArray[np.float64]:
    """Acceleration (m, 3) [m/s^2] of these rows of the liquid by wall particles of these volumes [m^dim]."""
    summed = run.backend.zeros((run.plan.grid.count, 3), run.plan.grid.dtype)
    near = run.shared["neighbours"]
    for effect, p in passes:
        arguments: dict[str, Any] = {"acceleration": summed, "walls": run.shared["walls"]._replace(volume=volume)}
        if near is not None and p.operation not in OF_LIQUID:
            arguments["neighbours"] = near._replace(count=run.backend.zeros(near.count.shape, near.count.dtype))
        launch_pass(run, dataclasses.replace(p, algorithm="plain"), arguments, run.parameters[effect.name])
    return run.backend.taken(summed, rows).astype(float)


def _forced(run: State, passes: Iterable[tuple[Effect, Pass]]) -> NDArray[np.float64]:
    """Acceleration (n, 3) [m/s^2] by these passes."""
    summed = run.backend.zeros((run.plan.grid.count, 3), run.plan.grid.dtype)
    for effect, p in passes:
        launch_pass(run, p, {"acceleration": summed}, run.parameters[effect.name])
    return run.backend.host(summed).astype(float)


def _owner(run: State, gauge: Gauge) -> str:
    """Name of the walls on which the force of a gauge acts."""
    return gauge.on if gauge.on in run.plan.wall_rows else "box_walls"


def _of_walls(p: Pass) -> bool:
    """Whether a pass of the forces adds what walls do to the liquid."""
    if "acceleration" not in p.updates or p.operation not in REGISTRY or p.names.get("walls", "walls") is None:
        return False
    return "walls" in REGISTRY[p.operation].arguments("numpy")
