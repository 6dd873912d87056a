"""Liquid, walls and solids twice in one place: refused or noted from the particles that are counted at the start."""

import numpy as np
import pytest

import refsim
from refsim import Ball, Box, BoxWalls, Cloud, Gravity, InputError, MpmLiquid, Scene, WeaklyCompressible, make_plan

D = 0.01
COUNTED = "are counted at"


def liquid(dim=2, **more):
    """One that says nothing of its flow."""
    return WeaklyCompressible(sound_speed=50.0, dynamic_viscosity=50.0, **more)


def scene(*fluid, dim=2, effects=(), **more):
    effects = effects or (liquid(),)
    return Scene(dim=dim, spacing=D, support_radius=2.6 * D, fluid=fluid, effects=effects, end_time=1.0, **more)


def block(dim, n=10, shift=(0.0, 0.0, 0.0)):
    lower = [s * D for s in shift[:dim]] + [0.0] * (3 - dim)
    return Box(cells=(n, n, n if dim == 3 else 1), lower=tuple(lower))


def notes(made):
    return [note for note in make_plan(made).notes if COUNTED in note]


def lattice(dim, n=12):
    axes = np.meshgrid(*[D * (np.arange(n) + 0.5)] * dim, indexing="ij")
    return np.pad(np.stack(axes, -1).reshape(-1, dim), ((0, 0), (0, 3 - dim)))


LIQUIDS = {
    "advanced": lambda: (liquid(),),
    "summed": lambda: (liquid(density="summation"),),
    "mpm": lambda: (MpmLiquid(rest_density=1000.0, bulk_modulus=1e6),),
}


@pytest.mark.parametrize("kind", LIQUIDS)
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("share", [0.1, 0.3, 0.5, 0.7])
def test_two_blocks_in_one_place_are_refused_with_the_place(dim, share, kind):
    made = scene(block(dim), block(dim, 9, (share,) * 3), dim=dim, effects=LIQUIDS[kind]())
    with pytest.raises(InputError, match=r"2 times the particles of a lattice .* at \(0\.0[45].* move them apart"):
        make_plan(made)


@pytest.mark.parametrize(("dim", "axes"), [(2, 2), (3, 2), (3, 3)])
def test_a_shared_edge_or_corner_is_noted(dim, axes):
    """It is too small for the splines that count all liquid; half a spacing of it fills no place twice."""

    def told(shared):
        shift = [10.0 - shared] * axes + [0.0] * (dim - axes)
        return [n for n in make_plan(scene(block(dim), block(dim, shift=shift), dim=dim)).notes if "press each" in n]

    assert not told(0.5)
    assert len(told(1.3)) == len(told(1.6)) == 1


@pytest.mark.parametrize("dim", [2, 3])
def test_blocks_that_touch_are_none_of_it(dim):
    assert not notes(scene(block(dim), block(dim, 10, (10.0, 0.0, 0.0)), dim=dim))
    assert not notes(scene(block(dim), block(dim, 10, (10.0, 0.37, 0.21)), dim=dim))  # shifted along the face
    assert not notes(scene(block(dim), block(dim, 10, (10.5, 0.0, 0.0)), dim=dim))  # half a spacing beyond
    assert not notes(scene(block(dim), Ball(center=(0.15, 0.15, 0.15 * (dim == 3)), radius=0.03), dim=dim))


@pytest.mark.parametrize("dim", [2, 3])
def test_rows_that_are_too_near_have_a_note(dim):
    (note,) = notes(scene(block(dim), block(dim, 10, (9.5, 0.0, 0.0)), dim=dim))
    assert "1.1" in note
    with pytest.raises(InputError, match="times the particles"):
        make_plan(scene(block(dim), block(dim, 10, (9.2, 0.0, 0.0)), dim=dim))


def test_rows_across_a_period_and_in_a_wall_are_counted_by_their_volumes():
    """Particles nearer than a spacing whose mass is less by as much, and heavier ones on the lattice."""
    border = {"period": (0.195, 0.2, 0.0)}
    tall = Box(cells=(20, 20, 1))
    with pytest.raises(InputError, match="outside the periodic box"):
        make_plan(scene(tall, **border))
    assert not notes(scene(tall, period=(0.2, 0.2, 0.0)))
    assert not notes(scene(Box(cells=(21, 21, 1)), period=(0.21, 0.21, 0.0)))
    (note,) = notes(scene(Cloud(position=lattice(2, 20) - (0.002, 0.0, 0.0)), period=(0.1955, 0.2, 0.0)))
    assert COUNTED in note
    fine = Box(cells=(22, 22, 1), size=(0.2, 0.2, 1.0))
    assert not notes(scene(fine))
    position = lattice(2)
    assert not notes(scene(Cloud(position=0.8 * position, mass=np.full(len(position), 0.64 * 1000 * D**2))))
    assert not notes(scene(Cloud(position=position, mass=np.full(len(position), 1.4 * 1000 * D**2))))
    walls = BoxWalls(lower=(0.0, 0.0, 0.0), upper=(0.1, 0.2, 0.0))
    near = Box(cells=(10, 10, 1), lower=(-0.0045, 0.0, 0.0))
    (note,) = notes(scene(near, effects=(liquid(), walls)))
    assert "walls" in note


@pytest.mark.parametrize("dim", [2, 3])
def test_a_cloud_that_is_no_lattice_has_no_note(dim):
    random = np.random.default_rng(3)
    shaken = lattice(dim, 20 if dim == 3 else 60)
    shaken[:, :dim] += random.uniform(-0.25, 0.25, (len(shaken), dim)) * D
    assert not notes(scene(Cloud(position=shaken), dim=dim))
    with pytest.raises(InputError, match="times the particles"):
        make_plan(scene(Cloud(position=np.concatenate([shaken, shaken + (0.3 * D, 0.0, 0.0)])), dim=dim))


@pytest.mark.parametrize("model", ["extrapolated", "mirrored"])
@pytest.mark.parametrize("dim", [2, 3])
def test_a_tank_is_filled_by_its_liquid(dim, model):
    walls = BoxWalls(lower=(0.0, 0.0, 0.0), upper=(0.1, 0.2, 0.1 * (dim == 3)), model=model)
    gravity = Gravity(acceleration=(0.0, -9.81, 0.0))
    density = {} if model == "extrapolated" else {"density": "summation"}
    assert not notes(scene(block(dim), dim=dim, effects=(liquid(**density), gravity, walls)))


def test_liquid_in_a_solid_is_refused():
    body = refsim.SolidBox(lower=(0.03, 0.03, 0.03), upper=(0.07, 0.07, 0.07), density=500.0)
    around = (liquid(), refsim.ShapeMatching(), refsim.TwoWayCoupling())
    outside = lattice(3, 10)
    outside = outside[(np.abs(outside - 0.05) > 0.02).any(1)]
    assert not notes(scene(Cloud(position=outside), dim=3, solid=(body,), effects=around))
    with pytest.raises(InputError):
        make_plan(scene(block(3), dim=3, solid=(body,), effects=around))
    nearer = np.concatenate([outside, outside[np.isclose(outside[:, 0], 0.025)] + (0.45 * D, 0, 0)])
    with pytest.raises(InputError):
        make_plan(scene(Cloud(position=nearer), dim=3, solid=(body,), effects=around))
