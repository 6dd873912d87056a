"""What heat does in closed form, and an operation stepped by hand on particles that stand still.

Everywhere k = rho = c = 1 (SI units) and the melting point is 0 deg C.
"""

import math
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.special import erf, erfcx

from refsim.backends.arrays import Scratch, choose
from refsim.core.effect import Discretisation
from refsim.core.operation import REGISTRY
from refsim.core.period import period_group
from refsim.heat import HeatConduction
from refsim.heat.operations import Body, Step
from refsim.neighbours.rows import NeighbourRows


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


SUPPORT = 2.5  # support radius over spacing


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
    """Particles at rest with a scheme that steps their temperatures; k = rho = c = 1. Options go to the effect."""

    def __init__(
        self, scheme: str, position: np.ndarray, spacing: float, temperature: np.ndarray,
        period: tuple[float, float, float], **options: Any,
    ) -> None:  # fmt: skip
        n = len(position)
        effect = HeatConduction(scheme=scheme, conductivity=1.0, heat_capacity=1.0, density=1.0, **options)
        self.scheme = scheme
        conduction = effect.conduction(Discretisation(3, "float64", spacing, SUPPORT * spacing, n))
        self.conduction = conduction._replace(sweep_share=np.float64(1.0))  # as printed (Shao & Song M8)
        volume, one = np.full(n, spacing**3), np.ones(n)
        self.temperature = np.array(temperature, dtype=float)
        self.arguments: dict[str, Any] = dict.fromkeys(
            ("reservoir", "melting_point", "latent_heat", "compensation_x", "compensation_rest", "enthalpy")
        )
        self.arguments |= {
            "position": position, "mass": volume, "volume": volume, "heat_capacity": one, "conductivity": one,
            "conduction": self.conduction, "temperature": self.temperature, "scratch": Scratch(choose("cpu")),
            "period": period_group(period, "float64"),
            "neighbours": neighbour_rows(position, SUPPORT * spacing, period),
        }  # fmt: skip
        operation = REGISTRY[f"heat.{effect.scheme}"]
        self.program, self.names = operation.program("cpu"), operation.arguments("cpu")

    def step(self, seconds: float) -> None:
        """One step of so many seconds."""
        self.arguments["timestep"] = np.array([0.0, seconds])
        self.program(*(self.arguments[name] for name in self.names))

    def run(self, until: float, steps: int) -> None:
        """Equal steps until a time [s], or until no temperature is finite any more."""
        for _ in range(steps):
            self.step(until / steps)
            if not np.isfinite(self.temperature).all():
                break

    def weighed(self, seconds: float) -> tuple[Any, ...]:
        """Exchanges, 1/C_i and the largest s_i of a step, without a flow, as schemes have them."""
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
    return Conductor(scheme, position, spacing, cosine(x, cells * spacing, 0.0), period, **options), x
