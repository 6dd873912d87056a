"""What heat does in closed form, a melting sphere by another program (one dimension, thousands of thin shells), and an
operation stepped by hand on particles that stand still.

Everywhere k = rho = c = 1 (SI units) and the melting point is 0 deg C.
"""

from __future__ import annotations

import math
import time
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.special import erf, erfcx

from refsim.backends.arrays import choose
from refsim.backends.scratch import Scratch
from refsim.core.effect import Discretisation
from refsim.core.operation import REGISTRY
from refsim.core.period import period_group
from refsim.heat import HeatConduction, enthalpy_of
from refsim.heat.operations import Body, Step
from refsim.neighbours.rows import NeighbourColumns, NeighbourRows


def cosine(x: np.ndarray, length: float, until: float) -> np.ndarray:
    """50 + 50 cos(pi x/length) [deg C] in an insulated slab, after so many seconds."""
    wave = math.pi / length
    return 50 + 50 * np.cos(wave * x) * math.exp(-(wave**2) * until)


def stefan_root(wall: float, start: float, latent: float) -> float:
    """lambda of Neumann's solution, front s = 2 lambda sqrt(t): a wall at `wall` > 0 deg C, ice at `start` <= 0 deg C.

    Ste/(exp(l^2) erf l) - cold/(exp(l^2) erfc l) = sqrt(pi) l, Ste = wall/L, cold = -start/L (Alexiades & Solomon 1993,
    section 2.2).
    """
    ste, cold = wall / latent, -start / latent

    def miss(root: float) -> float:
        return ste * math.exp(-(root**2)) / erf(root) - cold / erfcx(root) - math.sqrt(math.pi) * root

    return float(brentq(miss, 1e-9, 10.0, xtol=1e-15))


class Melting(NamedTuple):
    """How a shell melts from its held surface: times [s] and ice volume over the first one."""

    time: np.ndarray
    ice: np.ndarray

    def at(self, time: np.ndarray) -> np.ndarray:
        """Ice volume over the first one, at times [s]."""
        return np.interp(time, self.time, self.ice)


def melting_shell(
    inner: float, outer: float, cells: int, wall: float, start: float, latent: float, until: float
) -> Melting:
    """Ice between two radii [m], insulated inside, its outer surface held at `wall` [deg C].

    Finite volumes of the enthalpy in one dimension, forward Euler: nothing of it is shared with the particles. Written
    in volumes and areas, so that inner = 0 is a sphere and inner >> outer - inner a plane wall.
    """
    faces = np.linspace(inner, outer, cells + 1)
    volume = np.diff(faces**3) / 3
    area = faces[1:] ** 2
    width = (outer - inner) / cells
    weight = area / np.append(np.full(cells - 1, width), width / 2)
    step = 0.2 * width**2
    steps = math.ceil(until / step)
    enthalpy = np.full(cells, float(start))
    step_over_volume = step / volume
    flow, temperature = np.zeros(cells + 1), np.empty(cells)
    times, ice = [], []
    every = max(1, steps // 4000)
    for k in range(steps + 1):
        if k % every == 0:
            solid = 1 - np.clip(enthalpy / latent, 0, 1)
            times.append(k * step)
            ice.append(float(solid @ volume / volume.sum()))
            if ice[-1] == 0.0:
                break
        np.subtract(enthalpy, np.clip(enthalpy, 0.0, latent), out=temperature)
        flow[1:-1] = weight[:-1] * (temperature[1:] - temperature[:-1])
        flow[-1] = weight[-1] * (wall - temperature[-1])
        enthalpy += step_over_volume * (flow[1:] - flow[:-1])
    return Melting(np.array(times), np.array(ice))


SUPPORT = 2.5  # support radius over spacing

SCHEMES = {
    "one_sided": "M(4), each particle by itself (R1)", "pair_exchange": "M(4), both of a pair (R3)",
    "implicit": "implicit (Chebyshev)",
    "conjugate_gradient": "conjugate gradients", "runge_kutta_legendre": "Runge-Kutta-Legendre", "explicit": "explicit",
}  # fmt: skip


def lattice(cells: tuple[int, int, int], spacing: float) -> np.ndarray:
    """Centres (n, 3) [m] of a box of cells whose lower corner is the origin, z fastest."""
    axes = [(np.arange(n) + 0.5) * spacing for n in cells]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def neighbour_rows(position: np.ndarray, reach: float, period: tuple[float, float, float]) -> NeighbourRows:
    """Neighbours within `reach` [m], to the nearest image of a periodic box, in the order of their numbers."""
    from scipy.spatial import cKDTree

    place = np.array(position, dtype=float)
    for axis, length in enumerate(period):
        if length:
            place[:, axis] %= length
    pairs = cKDTree(place, boxsize=period if any(period) else None).query_pairs(reach, output_type="ndarray")
    both = np.concatenate((pairs, pairs[:, ::-1]))
    both = both[np.lexsort((both[:, 1], both[:, 0]))]
    count = np.bincount(both[:, 0], minlength=len(position)).astype(np.int32)
    return NeighbourRows(np.cumsum(count, dtype=np.int64) - count, count, both[:, 1].astype(np.int32))


class Conductor:
    """Particles at rest with a scheme that steps their temperatures.

    k = rho = c = 1 (SI units), unless `conductivity` [W/(m K)] or `volume` [m^3] say otherwise for each particle, so
    that the diffusivity is 1 m^2/s. With `ice` = (melting point [deg C], latent heat [J/kg]) the enthalpy is the state.
    `held` marks particles (n,) whose temperature is held. Further options go to the effect.
    """

    def __init__(
        self, scheme: str, position: np.ndarray, spacing: float, temperature: np.ndarray, *,
        period: tuple[float, float, float] = (0.0, 0.0, 0.0), held: np.ndarray | None = None,
        conductivity: np.ndarray | None = None, volume: np.ndarray | None = None,
        ice: tuple[float, float] | None = None, dtype: str = "float64", backend: str = "cpu", **options: Any,
    ) -> None:  # fmt: skip
        n, real = len(position), np.dtype(dtype)
        self.grid = Discretisation(3, dtype, spacing, SUPPORT * spacing, n)
        materials = {} if ice is None else {"melting_point": ice[0], "latent_heat": ice[1]}
        effect = HeatConduction(scheme=scheme, conductivity=1.0, heat_capacity=1.0, density=1.0, **materials, **options)
        self.scheme, self.spacing, self.seconds = scheme, spacing, 0.0
        self.conduction = effect.conduction(self.grid)
        one = np.ones(n, real)
        self.volume = np.full(n, spacing**3, real) if volume is None else volume.astype(real)
        first = np.array(temperature, real)
        enthalpy = point = latent = None
        if ice is not None:
            point, latent = (np.full(n, v, real) for v in ice)
            enthalpy = enthalpy_of(first, one, point, latent)
        self.held = held
        self.there = choose(backend)
        given = {
            "position": position.astype(real), "mass": self.volume, "volume": self.volume, "heat_capacity": one,
            "conductivity": one if conductivity is None else conductivity.astype(real),
            "reservoir": None if held is None else held.astype(np.uint8),
            "melting_point": point, "latent_heat": latent, "conduction": self.conduction,
            "compensation_x": None, "compensation_rest": None,
            "enthalpy": enthalpy, "temperature": first, "scratch": Scratch(self.there),
            "period": period_group(period, dtype) if any(period) else None,
        }  # fmt: skip
        put = self.there.asarray
        self.arguments = {name: put(value) if isinstance(value, np.ndarray) else value for name, value in given.items()}
        self.arguments["neighbours"] = self._listed(neighbour_rows(position, SUPPORT * spacing, period))
        operation = REGISTRY[effect.operation()]
        self.program, self.names = operation.program(backend), operation.arguments(backend)

    def _listed(self, rows: NeighbourRows) -> NeighbourRows | NeighbourColumns:
        """The rows as the backend takes them."""
        if self.there.name != "cuda":
            return rows
        columns = np.zeros((int(rows.count.max()), len(rows.count)), np.uint32)
        i = np.repeat(np.arange(len(rows.count)), rows.count)
        columns[np.arange(len(i)) - rows.start[i], i] = rows.entries
        return NeighbourColumns(self.there.asarray(rows.count), self.there.asarray(columns.reshape(-1)))

    @property
    def temperature(self) -> np.ndarray:
        """Temperatures (n,) [deg C]."""
        return self.there.host(self.arguments["temperature"])

    @property
    def enthalpy(self) -> np.ndarray | None:
        """Enthalpies (n,) [J/kg] of what melts."""
        return None if self.arguments["enthalpy"] is None else self.there.host(self.arguments["enthalpy"])

    def step(self, seconds: float) -> None:
        """One step of so many seconds."""
        self.arguments["timestep"] = self.there.asarray(np.array([0.0, seconds]))
        self.there.synchronize()
        began = time.perf_counter()
        self.program(*(self.arguments[name] for name in self.names))
        self.there.synchronize()
        self.seconds += time.perf_counter() - began

    def run(self, until: float, steps: int) -> Conductor:
        """Equal steps until a time [s], or until no temperature is finite any more."""
        for _ in range(steps):
            self.step(until / steps)
            if not np.isfinite(self.temperature).all():
                break
        return self

    def heat(self) -> float:
        """Heat of all particles that are not held [J]."""
        one = self.temperature if self.enthalpy is None else self.enthalpy
        whole = self.volume.astype(float) * one.astype(float)
        return math.fsum(whole if self.held is None else whole[~self.held])

    def molten(self) -> np.ndarray:
        """Share of each particle's latent heat that it has taken up, 0 to 1."""
        latent = float(self.there.host(self.arguments["latent_heat"])[0])
        return np.clip(self.enthalpy.astype(float) / latent, 0.0, 1.0)

    def weighed(self, seconds: float) -> tuple[Any, ...]:
        """Exchanges, 1/C_i and the largest s_i of a step, as schemes have them."""
        from refsim.heat import schemes

        given = {**self.arguments, "timestep": np.array([0.0, seconds])}
        body, step = (kind(*(given[name] for name in kind._fields)) for kind in (Body, Step))
        return schemes.weighed(body, given["neighbours"], step, given["scratch"])


def cosine_slab(
    scheme: str, cells: int, across: int, spacing: float, seed: int | None = None, **options: Any
) -> tuple[Conductor, np.ndarray]:
    """Half a cosine in an insulated slab of `cells` spacings [m], periodic across, and the depth of its particles [m].

    across  period along y and z, in spacings; seed: of the particles' numbers, which follow the lattice without one
    """
    position = lattice((cells, across, across), spacing)
    if seed is not None:
        position = np.random.default_rng(seed).permutation(position)
    x, period = position[:, 0], (0.0, across * spacing, across * spacing)
    return Conductor(scheme, position, spacing, cosine(x, cells * spacing, 0.0), period=period, **options), x
