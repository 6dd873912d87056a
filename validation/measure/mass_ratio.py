"""Which ratio of particle masses keeps the energy: the largest rise that the audit sees, by ratio and kind of scene.

`python -m validation measure mass_ratio` prints it. Every scene is a body left to itself, in float64 and with the
runner's own steps. The number is the greatest rise of the energy above its lowest value so far, as a share of what was
turned over, in audits every 2 steps.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import msgspec
import numpy as np

from refsim import (
    Cloud,
    EnergyAudit,
    MpmLiquid,
    RunStopped,
    Scene,
    ShapeMatching,
    Simulation,
    SolidBox,
    TwoWayCoupling,
    WeaklyCompressible,
)

SPACING, SUPPORT, DENSITY, SOUND, SPEED = 0.1, 0.2, 1000.0, 10.0, 0.5
LEAST = DENSITY * SOUND * SUPPORT / 250  # viscosity [Pa s] from which on equal masses gain no energy
RATIOS = (1.0, 1.2, 1.5, 2.0, 2.2, 2.5, 3.0, 4.0, 6.0, 10.0, 30.0, 100.0, 1000.0)
SEED, SIDE = 5, 8
INNER = ((SIDE // 2) * SIDE + SIDE // 2) * SIDE + SIDE // 2  # a particle in the middle of the cube


def block() -> tuple[np.ndarray, np.ndarray]:
    """Places of a cube on the lattice (n, 3) [m], and velocities that press it together [m/s]."""
    axis = (np.arange(SIDE) - 0.5 * (SIDE - 1)) * SPACING
    place = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    return place, -SPEED * place / (0.5 * SIDE * SPACING)


def masses(ratio: float, how: str, one: float, place: np.ndarray) -> np.ndarray:
    """Masses [kg]: a light half, one heavy particle, or any between `one`/ratio and `one` at random."""
    if how == "half":
        return np.where(place[:, 0] > 0, one / ratio, one)
    if how == "one":
        mass = np.full(len(place), one)
        mass[INNER] *= ratio
        return mass
    if how == "one light":
        mass = np.full(len(place), one)
        mass[INNER] /= ratio
        return mass
    return one * ratio ** -np.random.default_rng(SEED).random(len(place))


def liquid(
    how: str, state: str = "tait", viscosity: float = LEAST, kernels: str = "wendland"
) -> Callable[[float], Scene]:
    """Weakly compressible liquid on one lattice."""

    def made(ratio: float) -> Scene:
        place, velocity = block()
        fluid = WeaklyCompressible(
            sound_speed=SOUND, dynamic_viscosity=viscosity, state=state, kernels=kernels, density_bound=1e6,
            density="summation",  # type: ignore[arg-type]
        )  # fmt: skip
        cloud = Cloud(position=place, velocity=velocity, mass=masses(ratio, how, DENSITY * SPACING**3, place))
        return Scene(spacing=SPACING, support_radius=SUPPORT, fluid=(cloud,), effects=(fluid,), dtype="float64")

    return made


def mpm(how: str) -> Callable[[float], Scene]:
    """The same block by the material point method."""

    def made(ratio: float) -> Scene:
        place, velocity = block()
        fluid = MpmLiquid(rest_density=DENSITY, bulk_modulus=DENSITY * SOUND**2)
        cloud = Cloud(position=place, velocity=velocity, mass=masses(ratio, how, DENSITY * SPACING**3, place))
        return Scene(spacing=SPACING, support_radius=SUPPORT, fluid=(cloud,), effects=(fluid,), dtype="float64")

    return made


def solids(heavy: bool, weighted: bool = False) -> Callable[[float], Scene]:
    """Two cubes of other densities than the liquid, 1 and `ratio`, between which a block of liquid is pressed."""

    def made(ratio: float) -> Scene:
        place, velocity = block()
        away = 0.5 * SIDE * SPACING
        sides = []
        for sign, factor in ((-1, 1.0), (1, ratio if heavy else 1 / ratio)):
            low = sign * away if sign > 0 else -away - 3 * SPACING
            sides.append(SolidBox(
                lower=(low, -0.2, -0.2), upper=(low + 3 * SPACING, 0.2, 0.2), velocity=(-sign * SPEED, 0, 0),
                density=DENSITY * factor,
            ))  # fmt: skip
        fluid = WeaklyCompressible(sound_speed=SOUND, dynamic_viscosity=LEAST, state="tait", density="summation")
        return Scene(
            spacing=SPACING, support_radius=SUPPORT, fluid=(Cloud(position=place, velocity=velocity),),
            solid=tuple(sides), effects=(fluid, ShapeMatching(), TwoWayCoupling(density_weighted=weighted)),
            dtype="float64",
        )  # fmt: skip

    return made


def liquids(ratio: float) -> Scene:
    """Two liquids, as melting leaves them: `two_liquids` gives half of the block 1/`ratio` of the mass and density."""
    place, velocity = block()
    far = SolidBox(lower=(3.0, 0.0, 0.0), upper=(3.3, 0.3, 0.3), density=DENSITY)
    fluid = WeaklyCompressible(sound_speed=SOUND, dynamic_viscosity=LEAST, state="tait", density="summation")
    effects = (fluid, ShapeMatching(), TwoWayCoupling())
    cloud = Cloud(position=place, velocity=velocity)
    return Scene(
        spacing=SPACING, support_radius=SUPPORT, fluid=(cloud,), solid=(far,), effects=effects, dtype="float64"
    )  # fmt: skip


def two_liquids(run: Simulation, ratio: float) -> None:
    """Make particles beyond x = 0 of the block lighter, in mass and in rest density."""
    x = run.field("position")[:, 0]
    light = (x > 0) & (x < 2.0)
    for name in ("mass", "rest_density"):
        values = run.field(name)
        values[light] /= ratio
        run.set_field(name, values)


KINDS: dict[str, Callable[[float], Scene]] = {
    "liquid, light half": liquid("half"), "liquid, light half, linear": liquid("half", "linear"),
    "liquid, light half, no viscosity": liquid("half", viscosity=0.0), "liquid, one heavy particle": liquid("one"),
    "liquid, one heavy, linear": liquid("one", "linear"),
    "liquid, one heavy, mueller": liquid("one", viscosity=250 / 80 * LEAST, kernels="mueller"),
    "liquid, one heavy, no viscosity": liquid("one", viscosity=0.0), "liquid, one light particle": liquid("one light"),
    "liquid, random": liquid("random"), "liquid, random, no viscosity": liquid("random", viscosity=0.0),
    "mpm, light half": mpm("half"), "mpm, random": mpm("random"), "solids, one heavier": solids(True),
    "solids, one lighter": solids(False), "two liquids": liquids,
}  # fmt: skip


def rise(scene: Scene, ratio: float, until: float = 0.2) -> tuple[float, str]:
    """(greatest share by which the energy rose, why the run stopped or "")."""
    run = Simulation(msgspec.structs.replace(scene, energy_audit=EnergyAudit(every=2, bound=1e9)))
    if any(part.lower == (3.0, 0.0, 0.0) for part in scene.solid):  # type: ignore[union-attr]
        two_liquids(run, ratio)
    reason = ""
    try:
        while run.time < until:
            run.step()
    except RunStopped as stop:
        reason = stop.reason
    assert run.auditor is not None
    return run.auditor.greatest_share, reason


def perform(given: argparse.Namespace) -> None:
    """Print the table."""
    for name, made in KINDS.items():
        for ratio in RATIOS if not given.kinds or any(word in name for word in given.kinds) else ():
            share, reason = rise(made(ratio), ratio)
            print(f"{name:36s} {ratio:7g} {share:12.3g} {reason}", flush=True)
