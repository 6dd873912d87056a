"""Transfers of MPM on particles and samples that are handed in: what they keep, and what a reading loses."""

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import spsolve

from refsim import Box, MpmLiquid, Scene
from refsim.backends.arrays import Backend, Scratch
from refsim.core.operation import REGISTRY
from refsim.mpm import READINGS, Embedding, Liquid
from refsim.mpm.grid import MpmGrid
from refsim.scene.plan import make_plan
from refsim.sparse_grid.reference import node_table

CELL = 0.2  # h [m]
DENSITY, MODULUS = 1000.0, 1e5
NAMES = ("node_mass", "node_momentum", "node_velocity")


class Transfers:
    """One step of the transfers, operation by operation, on the CPU in float64.

    position, velocity (n, 3), affine (n, 9) or (n, 3, 3), ratio and mass (n,); cells of 0.2 m
    samples  sample_position (s, 3) [m] and sample_nearest (s,) int32; None without a surface
    reading  index in `refsim.mpm.READINGS`
    """

    def __init__(
        self, position: Any, velocity: Any, affine: Any, samples: Mapping[str, Any] | None = None, reading: int = 0,
        ratio: Any = None, mass: Any = None, step: float = 1e-4, dim: int = 3,
    ) -> None:  # fmt: skip
        n = len(position)
        self.step = step
        scene = Scene(
            spacing=0.5 * CELL, support_radius=1.5 * CELL, dtype="float64", dim=dim,
            fluid=(Box(cells=(2, 2, 2 if dim == 3 else 1)),), effects=(MpmLiquid(bulk_modulus=MODULUS),),
        )  # fmt: skip
        background = MpmLiquid(bulk_modulus=MODULUS).background(make_plan(scene).grid)
        self.mass = np.random.default_rng(3).uniform(0.5, 1.5, n) if mass is None else np.asarray(mass)
        self.values: dict[str, Any] = {
            "position": np.array(position), "velocity": np.array(velocity), "affine": np.array(affine).reshape(n, 9),
            "mass": self.mass, "volume_ratio": np.ones(n) if ratio is None else np.array(ratio),
            "background": background, "liquid": Liquid(DENSITY, MODULUS, *np.zeros(3, np.int32)),
            "timestep": np.array([step, step]), "grid": MpmGrid(dim, "float64", CELL, Backend("cpu")),
            "scratch": Scratch(Backend("cpu")), "cell": np.zeros(n, np.int32), "displacement": np.zeros(3),
            "step_extremes": np.zeros(4),
        }  # fmt: skip
        self.embedded = samples is not None and reading > 0
        if samples is not None:
            s = len(samples["sample_position"])
            self.values |= {"surface_sample": samples["sample_position"], "sample_owner": samples["sample_nearest"]}
        if self.embedded:
            self.values |= {
                "embedding": Embedding(np.int32(reading)), "carrier_first": np.zeros(n + 1, np.int32),
                "carrier_position": np.zeros((2 * s, 3)), "carrier_owner": np.zeros(2 * s, np.int32),
                "carrier_moment": np.zeros((2 * s, 12)), "cluster_share": np.zeros(n),
                "inverse_spread": np.zeros((n, 6)),
            }  # fmt: skip
            self.run("mpm.embed")
        self.run("mpm.cells")
        self.values |= {name: getattr(self.values["grid"], name) for name in NAMES}

    def run(self, name: str) -> None:
        """Launch one operation."""
        optional = REGISTRY[name].optional
        REGISTRY[name].bind("cpu", lambda key: self.values.get(key) if key in optional else self.values[key])()

    def to_grid(self) -> tuple[np.ndarray, np.ndarray]:
        """Particles to nodes: (m_j (N,) [kg], (mv)_j (N, 3) [kg m/s])."""
        self.run("mpm.particle_to_grid")
        if self.embedded:
            self.run("mpm.carriers_to_grid")
        return self.values["node_mass"].copy(), self.values["node_momentum"].copy()

    def back(self) -> None:
        """Nodes to particles."""
        self.run("mpm.grid_update")
        if self.embedded:
            self.run("mpm.grid_to_carriers")
        self.run("mpm.grid_to_particle")

    @property
    def gradients(self) -> np.ndarray:
        """A (n, 3, 3) [1/s]."""
        return self.values["affine"].reshape(-1, 3, 3)

    @property
    def nodes(self) -> np.ndarray:
        """Positions of the nodes (N, 3) [m]."""
        return CELL * node_table(self.values["grid"].blocks)


def ball(dim: int = 3, radius: float = 0.9, seed: int = 1) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Jittered lattice cut by a sphere, and samples 1.6 cells outside it with their nearest particles."""
    random = np.random.default_rng(seed)
    plane = np.arange(3) < dim
    axis = np.arange(-12, 12) * 0.1 + 0.05
    position = np.array(list(itertools.product(axis, axis, axis if dim == 3 else [0.0])))
    position = position[(position**2).sum(1) < radius**2] + 0.02 * random.uniform(-1, 1, 3) * plane
    position += 0.01 * random.normal(size=position.shape) * plane
    normal = random.normal(size=(400 if dim == 3 else 60, 3)) * plane
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    place = (radius + 1.6 * CELL) * normal
    nearest = ((place[:, None] - position[None]) ** 2).sum(2).argmin(1).astype(np.int32)
    return position, {
        "sample_position": place, "sample_normal": normal, "sample_nearest": nearest,
        "sample_area": random.uniform(0.01, 0.02, len(normal)),
    }  # fmt: skip


def turning(position: np.ndarray, dim: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Velocities c + G x (n, 3), G for each particle (n, 3, 3), and G."""
    plane = np.arange(3) < dim
    g = np.array([[0.3, -2.0, 0.7], [1.5, -0.4, 0.2], [-0.6, 0.9, 0.5]]) * plane[:, None] * plane
    c = np.array([0.5, -1.0, 2.0]) * plane
    return c + position @ g.T, np.tile(g, (len(position), 1, 1)), g


def round_trip(reading: str, step: float = 1e-4, seed: int = 1) -> dict[str, float]:
    """What a reading of the embedding keeps of an affine field after the transfers to the grid and back.

    grid_mass, grid_momentum  relative errors on the nodes
    momentum                  relative error of the particles' momentum after both transfers
    velocity, gradient        relative errors of v, and of A on particles with samples
    power                     power of the liquid's force over the loss of its energy
    """
    position, samples = ball(seed=seed)
    velocity, affine, g = turning(position, 3)
    ratio = 1 + 0.05 * np.sin(3 * position[:, 0]) + 0.04 * position[:, 1]
    index = READINGS.index(reading)
    pressed = Transfers(position, velocity, affine, samples, index, ratio=ratio, step=step)
    calm = Transfers(position, velocity, affine, samples, index, step=step)
    _, momentum = pressed.to_grid()
    mass, still = calm.to_grid()
    calm.back()
    total = calm.mass @ velocity
    size = calm.mass.sum() * abs(velocity).max()
    owners = np.unique(samples["sample_nearest"])
    rate = np.trace(calm.gradients, axis1=1, axis2=2)
    power = ((momentum - still) * calm.values["node_velocity"]).sum() / step
    work = MODULUS * (calm.mass / DENSITY * (ratio - 1) * ratio * rate).sum()
    return {
        "grid_mass": abs(mass.sum() / calm.mass.sum() - 1),
        "grid_momentum": float(abs(still.sum(0) - total).max() / size),
        "momentum": float(abs(calm.mass @ calm.values["velocity"] - total).max() / size),
        "velocity": float(abs(calm.values["velocity"] - velocity).max() / abs(velocity).max()),
        "gradient": float(abs(calm.gradients - g)[owners].max() / abs(g).max()),
        "power": float(-power / work),
    }


def backward_euler(t: Transfers, ratio: np.ndarray, heavy: np.ndarray) -> np.ndarray:
    """Velocities (m, 2) [m/s] of the nodes `heavy` after an implicit step; `t` holds those without pressure."""
    n, table = len(ratio), node_table(t.values["grid"].blocks)
    place = t.values["position"][:, :2] / CELL
    base = np.floor(place - 0.5).astype(int)
    weight, _ = splines(place[:, :, None] - base[:, :, None] - np.arange(3))
    number = {(int(x), int(y)): k for k, (x, y, _) in enumerate(table[heavy])}
    rows, columns, entries = [], [], []
    for i in range(3):
        for j in range(3):
            node = np.array([number.get((int(a) + i, int(b) + j), -1) for a, b in base])
            there = node >= 0
            arm = CELL * (base + [i, j] - place)
            for c in range(2):  # tr A_p = (4/h^2) sum_j B_j (x_j - x_p).v_j
                rows.append(np.flatnonzero(there))
                columns.append(2 * node[there] + c)
                entries.append((4 / CELL**2 * weight[:, 0, i] * weight[:, 1, j] * arm[:, c])[there])
    trace = csr_array(
        (np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))), shape=(n, 2 * len(heavy))
    )
    inertia = np.repeat(t.values["node_mass"][heavy], 2)
    volume = t.mass / DENSITY
    stiffness = trace.T @ diags_array(t.step**2 * volume * MODULUS * ratio**2) @ trace
    push = t.step * trace.T @ (volume * MODULUS * (1 - ratio) * ratio)
    known = inertia * t.values["node_velocity"][heavy, :2].ravel() + push
    return spsolve((diags_array(inertia) + stiffness).tocsc(), known).reshape(-1, 2)


def splines(u: NDArray) -> tuple[NDArray, NDArray]:
    """(B, B') of the quadratic spline at u cells from a node."""
    a = np.abs(u)
    value = np.where(a < 0.5, 0.75 - a**2, np.where(a < 1.5, 0.5 * (1.5 - a) ** 2, 0.0))
    return value, np.where(a < 0.5, -2 * u, np.where(a < 1.5, -np.sign(u) * (1.5 - a), 0.0))
