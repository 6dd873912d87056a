"""What must hold for any scene: random liquids, drawn from seeds, conserve, repeat and do not depend on where they are.

Whole steps of whole scenes; the contract asks the same of single operations.
"""

import msgspec
import numpy as np
import pytest

from refsim import BoxWalls, Cloud, Gravity, JiangZhu2023, Scene, Simulation, WeaklyCompressible
from tests.running import advanced

SEEDS = range(4)
SPACING, H = 0.1, 0.22


def scene(seed, **options):
    """A random blob of liquid with random settings; float64, so that conservation shows to round-off.

    Seeds 0 and 1 have viscosity, 0 and 3 tension; odd ones are in space.
    """
    random = np.random.default_rng(seed)
    dim = 2 + seed % 2
    count = int(random.integers(40, 90))
    position, velocity = np.zeros((2, count, 3))
    position[:, :dim] = relaxed(random, count, dim, 0.5 * SPACING * count ** (1 / dim))
    velocity[:, :dim] = random.normal(scale=0.3, size=(count, dim))
    liquid = WeaklyCompressible(
        sound_speed=12.0, dynamic_viscosity=0.4 * (seed < 2), state=str(random.choice(["linear", "tait"])),
        clamp_pressure=bool(random.integers(2)), density_bound=100.0, density="summation",
    )  # fmt: skip
    mass = 1000 * SPACING**dim * random.uniform(0.8, 1.2, count)
    return Scene(
        spacing=SPACING, support_radius=H, dim=dim, dtype="float64", step=2e-4, skin=0.1, **options,
        fluid=(Cloud(position=position, velocity=velocity, mass=mass),),
        effects=(liquid, JiangZhu2023(surface_tension=0.5)) if seed % 3 == 0 else (liquid,),
    )  # fmt: skip


def relaxed(random, count, dim, side):
    """Random places at least half a spacing apart."""
    kept = []
    while len(kept) < count:
        x = random.uniform(-side, side, dim) * 1.15
        if all(np.linalg.norm(x - y) > 0.5 * SPACING for y in kept):
            kept.append(x)
    return np.array(kept)


def run(scene, steps=12, backend="cpu"):
    return advanced(Simulation(scene, backend), steps)


def state(simulation):
    return simulation.field("position"), simulation.field("velocity"), simulation.field("mass")


def cloud_of(scene):
    return scene.fluid[0]


def changed(scene, **parts):
    return msgspec.structs.replace(scene, fluid=(msgspec.structs.replace(cloud_of(scene), **parts),))


@pytest.mark.parametrize("seed", SEEDS)
def test_mass_and_momenta_stay(seed):
    """The angular one without viscosity and area term: with central forces x cross v is kept between the steps, too."""
    begun = scene(seed)
    x, v, m = state(run(begun))
    first = cloud_of(begun)
    assert np.array_equal(m, first.mass)
    total, before = ((m[:, None] * speeds).sum(0) for speeds in (v, first.velocity))
    assert np.abs(total - before).max() < 1e-12 * (m[:, None] * np.abs(v)).sum()
    assert np.abs(x - first.position).max() > 1e-4  # something moved
    if seed == 2:
        spin, kick = ((m[:, None] * np.cross(*at)).sum(0) for at in ((x, v), (first.position, first.velocity)))
        scale = (m * np.linalg.norm(x, axis=1) * np.linalg.norm(v, axis=1)).sum()
        assert np.abs(spin - kick).max() < 1e-10 * scale


@pytest.mark.parametrize("seed", SEEDS)
def test_nothing_depends_on_place_speed_or_naming(seed):
    begun = scene(seed)
    x, v, _ = state(run(begun))
    first = cloud_of(begun)
    scale = np.abs(x).max()

    shift = np.array([3.0, -5.0, 0.0])
    moved = state(run(changed(begun, position=first.position + shift)))
    assert np.abs(moved[0] - shift - x).max() < 1e-9 * scale

    wind = np.array([1.5, 0.5, 0.0])
    blown = run(changed(begun, velocity=first.velocity + wind))
    assert np.abs(blown.field("position") - wind * blown.time - x).max() < 1e-9 * scale

    order = np.random.default_rng(seed).permutation(len(x))
    parts = {"position": first.position[order], "velocity": first.velocity[order], "mass": first.mass[order]}
    shuffled = state(run(changed(begun, **parts)))
    assert np.abs(shuffled[0] - x[order]).max() < 1e-9 * scale

    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    turned = state(run(changed(begun, position=first.position @ turn.T, velocity=first.velocity @ turn.T)))
    assert np.abs(turned[0] @ turn - x).max() < 1e-9 * scale
    assert np.abs(turned[1] @ turn - v).max() < 1e-7


@pytest.mark.parametrize("seed", [1, 2])
def test_units_do_not_matter(seed):
    """A liquid a thousand times smaller and as much faster in its own time runs through the same shapes."""
    begun = scene(seed)
    factor = 2.0**-10
    liquid = begun.effects[0]
    first = cloud_of(begun)
    dim = begun.dim
    small = changed(begun, position=first.position * factor, mass=first.mass * factor**dim)
    small = msgspec.structs.replace(
        small, spacing=SPACING * factor, support_radius=H * factor, step=begun.step * factor,
        effects=(msgspec.structs.replace(liquid, dynamic_viscosity=liquid.dynamic_viscosity * factor),),
    )  # fmt: skip
    x, v, _ = state(run(begun))
    y, w, _ = state(run(small))
    assert np.abs(y / factor - x).max() < 1e-9
    assert np.abs(w - v).max() < 1e-8


def test_walls_hold_random_spray():
    """Particles flung about in a closed box stay in it, and the log says how often a plane had to stop one."""
    random = np.random.default_rng(3)
    position = random.uniform(0.05, 0.95, (60, 3))
    position[:, 2] = 0
    velocity = random.normal(scale=20.0, size=(60, 3))
    velocity[:, 2] = 0
    simulation = run(
        Scene(
            spacing=0.05, support_radius=0.12, dim=2, fluid=(Cloud(position=position, velocity=velocity),),
            effects=(
                WeaklyCompressible(sound_speed=50.0, density_bound=100.0, density="summation"),
                Gravity(acceleration=(0.0, -9.81, 0.0)), BoxWalls(lower=(0, 0, 0), upper=(1, 1, 1)),
            ),
        ),
        steps=150,
    )  # fmt: skip
    x = simulation.field("position")
    assert simulation.time > 0.05
    assert (x[:, :2] >= 0).all()
    assert (x[:, :2] <= 1).all()
    assert not x[:, 2].any()
    assert simulation.stopped_at_walls > 0
    assert simulation.search.log.missed_neighbours == 0
