"""What no scene can have: values of particles drawn at random, lists, steps, masses, and bodies of files."""

import contextlib
import math
import re
from contextlib import nullcontext
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
import trimesh
from scipy.optimize import brentq

from refsim import InputError, Motion, SolidMesh, WeaklyCompressible
from refsim.core.capabilities import LimitsMassRatio
from refsim.motion import _looked_at, check_motions
from refsim.neighbours.limits import MOST_NEIGHBOURS
from refsim.scene import checks, meshes
from refsim.scene.checks import FLAT, GREATEST, LONGEST, POSITIVE, check_fixed_step, check_list, check_values
from refsim.scene.files import describe
from tests.across.test_recorded_scenes import EXAMPLES

FIELDS = {**dict.fromkeys(FLAT, 3), **dict.fromkeys(POSITIVE, 1), "temperature": 1}


def first_refused(name, values, dim, dtype):
    """(particle, how many, kind) by a loop over particles; None where all are possible."""
    most = LONGEST if name == "position" else GREATEST
    rows = values.reshape(len(values), -1)
    with np.errstate(over="ignore"):
        far = [k for k, row in enumerate(rows) if not all(abs(v) <= most for v in row.astype(dtype))]
    if far:
        return far[0], len(far), "finite"
    low = [k for k, row in enumerate(rows) if name in POSITIVE and row[0] <= 0]
    deep = [k for k, row in enumerate(rows) if name in FLAT and dim == 2 and row[2] != 0]
    return (low[0], None, "positive") if low else (deep[0], None, "2D") if deep else None


@pytest.mark.parametrize("name", FIELDS)
def test_values_that_are_not_possible_are_named(name):
    rng, seen = np.random.default_rng(len(name)), set()
    most = LONGEST if name == "position" else GREATEST
    for trial in range(150):
        dim, dtype = 2 + trial % 2, ("float32", "float64")[trial // 2 % 2]
        values = rng.uniform(0.5, 2.0, (9, FIELDS[name]))
        values[:, 2:] = values[:, 2:] if dim == 3 or rng.random() < 0.2 else 0.0
        for _ in range(rng.integers(0, 3)):
            place = rng.integers(9), rng.integers(FIELDS[name])
            values[place] = rng.choice([np.nan, np.inf, 0.0, -1.0, 0.999 * most, -1.001 * most, 1.001 * most, 1e-9])
        values = values if FIELDS[name] == 3 else values[:, 0]
        expected = first_refused(name, values, dim, dtype)
        seen.add(expected and expected[2])
        if expected is None:
            check_values("here", name, values, dim, dtype)
            continue
        with pytest.raises(InputError) as caught:
            check_values("here", name, values, dim, dtype)
        words = str(caught.value)
        particle, count, kind = expected
        assert kind in words
        assert int(re.search(r"particle (\d+)", words)[1]) == particle
        assert count is None or f"({count} such" in words
        if kind == "2D":
            assert f"{FLAT[name][0]} = {values[particle, 2]} {FLAT[name][1]}" in words
    assert len(seen) > 1


def test_particles_at_one_place_are_named_and_counted():
    rng = np.random.default_rng(2)
    position = rng.uniform(size=(40, 3))
    checks.check_coincident(position, "float64")
    position[[7, 31]] = position[[3, 12]]
    for dtype, more in (("float64", 0.0), ("float32", 1e-12)):
        with pytest.raises(InputError, match=r"particles (3 and 7|7 and 3) are .*\(2 such pairs"):
            checks.check_coincident(position + more * (np.arange(40) > 20)[:, None], dtype)


def scene(**given):
    return SimpleNamespace(**{"spacing": 0.1, "support_radius": 0.26, "skins": (0.25,), "period": (0, 0, 0)} | given)


@pytest.mark.parametrize("dim, volume", [(2, lambda r: math.pi * r**2), (3, lambda r: 4 / 3 * math.pi * r**3)])
def test_a_list_has_room_for_so_many_neighbours(dim, volume):
    """Spacings that a list reaches over with its skin: as many as fit into a disc or ball of that radius."""
    for share, wanted in ((0.99, 1), (1.01, 0)):
        reach = brentq(lambda r: volume(r) - MOST_NEIGHBOURS, 1, 100) * share
        where = nullcontext() if wanted else pytest.raises(InputError, match=f"over {reach:.3g} spacings")
        with where:
            check_list(scene(dim=dim), 0.1 * reach / 1.25)
        check_list(scene(dim=dim, support_radius=9.0), 0.1 * reach / 1.25)  # of a support that is checked before


def test_a_period_is_longer_than_two_lists_with_their_skins():
    for axis in range(3):
        for length, wanted in ((0.649, 0), (0.651, 1)):
            period = [length if k == axis else 0.0 for k in range(3)]
            with nullcontext() if wanted else pytest.raises(InputError, match=f"along {'xyz'[axis]} .* 0.325 m"):
                check_list(scene(dim=3, period=period), 0.26)


def test_a_fixed_step_is_held_against_the_shortest_at_rest():
    """Steps that are shorter for particles that move do not count; 1.6 times the stable one is taken."""
    limits = {
        name: SimpleNamespace(at=lambda e, s=s: s / (1 + e.speed + e.acceleration))
        for name, s in (("a", 0.4), ("b", 0.1))
    }
    effects = {"x": SimpleNamespace(step_limits=lambda *_: limits), "y": SimpleNamespace(step_limits=lambda *_: {})}
    check_fixed_step(scene(step=0.1599), None, effects)
    with pytest.raises(InputError, match=r"0.161 s is 1.61 times .*\(0.1 s, b\)"):
        check_fixed_step(scene(step=0.161), None, effects)
    limits["c"] = SimpleNamespace(at=lambda e: 0.9e-30)
    with pytest.raises(InputError, match=r"9e-31 s \(c\)"):
        check_fixed_step(scene(step=0.0), None, effects)
    check_fixed_step(scene(step=9.0), None, {"y": effects["y"]})


class Limited(LimitsMassRatio):
    def largest_mass_ratio(self, others):
        return 1.5


def test_masses_may_differ_by_the_measured_ratio_and_meshes_hold_what_they_count():
    for more, noted in ((0.0, 0), (0.99e-6, 0), (1.005e-6, 1), (0.1, 1)):
        state = SimpleNamespace(mass=np.array([2.0, 3.0 * (1 + more), 2.5]))
        assert len(list(checks.unequal_masses(state, {"limited": Limited(), "other": object()}))) == noted
    head = b"\0" * 80 + (3).to_bytes(4, "little")
    for more in (150, 151, 400):
        assert len(meshes._plain(head + b"x" * more, "stl", "a.stl")) == 84 + 150
    for less, held in ((149, 2), (100, 2), (99, 1), (0, 0)):
        with pytest.raises(InputError, match=f"counts 3 triangles and holds {held};"):
            meshes._plain(head + b"x" * less, "stl", "a.stl")


def test_walls_fill_a_cell_once(monkeypatch):
    """Liquid counts with its share of a lattice's volume, at most whole; what walls fill is added, at most whole."""
    asked = []

    class Cells:
        def __init__(self, place, grid):
            asked.append(place)

        def filled(self, volume, first=0):
            asked.append(volume)
            return np.array([held[0] if first else 0.9, 0.1])

        def at_particles(self, filled, count):
            asked.append(filled)
            return filled

    monkeypatch.setattr(checks, "Cells", Cells)
    monkeypatch.setattr(checks, "CROWDED", 0.5)
    monkeypatch.setattr(checks, "TWICE", 0.5)
    monkeypatch.setattr(checks, "effects_with", lambda *_: [liquid])
    liquid = SimpleNamespace(of_liquid=True, starting_share=lambda: 0.5, particle_mass=lambda grid: 2.0)
    grid = SimpleNamespace(solids=None, spacing=0.1, dim=2, count=3, local=lambda x: x + 1.0, absolute=lambda x: x)
    state = SimpleNamespace(mass=np.array([2.0, 9.0, 4.0]), position=np.zeros((3, 3)), sizes=(3,))
    walls = SimpleNamespace(position=np.ones((2, 3)), volume=np.array([0.004, 0.03]))
    held = [0.0]
    for held[0], total in ((0.3, 1.2), (2.7, 1.9)):
        asked.clear()
        with contextlib.suppress(InputError):
            list(checks.crowded(grid, state, walls, SimpleNamespace(fluid=()), {}))
        place, liquid_volume, wall_volume, filled = asked
        assert place.tolist() == [[0.0] * 3] * 3 + [[2.0] * 3] * 2
        assert liquid_volume == pytest.approx([0.005, 0.01, 0.01])
        assert wall_volume == pytest.approx([0.004, 0.01])
        assert filled == pytest.approx([total, 0.2])


def test_a_body_is_known_where_a_ray_misses_one_of_its_faces(monkeypatch):
    """A ray along an edge may count one crossing of two; points of its column are then decided by solid angles."""
    body = SolidMesh(file=str(EXAMPLES / "cube.obj"), center=(0.1, 0.2, 0.3), size=1.0)
    axes = [np.linspace(c - 0.72, c + 0.72, 9) for c in body.center]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    expected = (np.abs(points - body.center) < 0.5).all(1)
    assert (body.inside(points) == expected).all()
    rays = type(trimesh.creation.box().ray)
    every = rays.intersects_location

    def some(self, *given, **named):
        place, ray, face = every(self, *given, **named)
        there = ~((ray % 3 == 0) & (place[:, 2] > body.center[2]))
        return place[there], ray[there], face[there]

    monkeypatch.setattr(rays, "intersects_location", some)
    assert (body.inside(points) == expected).all()


class Told(msgspec.Struct):
    """A body.
    width  of it [m],
           without its rim
    height, depth  of its box
    """

    width: float
    height: float
    depth: float


def test_meanings_begin_behind_the_first_line_and_looks_between_times():
    other = "of its box"
    assert describe(Told) == {"width": "of it [m], without its rim", "height": other, "depth": other}
    motion = Motion(of="gravity", kind="table", direction=(1, 0, 0), times=(0.0, 1.0, 4.0), values=(0.0, 0.1, 0.0))
    found = _looked_at(motion, 10.0)
    assert found[-2:] == [0.5, 2.5]
    assert np.diff(found[:-2]) == pytest.approx(10.0 / (len(found) - 3))


@pytest.mark.parametrize("way, taken", [((0, 0, 2.0), 1), ((0, 0, -1.0), 1), ((0, 1e-3, 1.0), 0), ((1.0, 0, 0), 0)])
def test_a_periodic_tank_turns_about_its_period(way, taken):
    grid = SimpleNamespace(dim=3, period=(0.0, 0.0, 1.0))
    turn = Motion(of="turn", kind="sway", direction=way, amplitude=1e-3, period=1.0, pivot=(0.0, 0.0, 0.0))
    with nullcontext() if taken else pytest.raises(InputError, match="two ends of the period along z"):
        check_motions([turn], 1.0, grid, {"weakly_compressible": WeaklyCompressible(sound_speed=30.0)})
