"""What no scene can have: values of particles drawn at random, lists, steps, masses, and bodies of files."""

from contextlib import nullcontext
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
import trimesh

from refsim import InputError, Motion, SolidMesh
from refsim.motion import _looked_at
from refsim.scene.checks import check_fixed_step, check_list
from refsim.scene.files import describe
from tests.across.test_recorded_scenes import EXAMPLES


def scene(**given):
    return SimpleNamespace(**{"spacing": 0.1, "support_radius": 0.26, "skins": (0.25,), "period": (0, 0, 0)} | given)


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
