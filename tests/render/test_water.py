"""Clear water: the length of each pixel's ray in it, and what is seen through it."""

import numpy as np
import pytest
import trimesh

from refsim.render.water import LARGEST, crossings, in_water, shaded

AXES = np.eye(3)[[0, 2, 1]] * [[1], [1], [-1]]  # right x, up z; the viewer stands at negative y
SHAPE = (60, 80)
METRES = 0.05


def seen(*meshes, behind=np.inf):
    """(length in water, whether there is any, nearest distance), (60, 80) each, of meshes about the origin."""
    made = trimesh.util.concatenate(meshes)
    right, upward, towards = AXES
    x = np.asarray(made.vertices)
    place = np.stack([0.5 * SHAPE[1] + x @ right / METRES, 0.5 * SHAPE[0] - x @ upward / METRES], axis=1)
    found = crossings(place, -x @ towards, np.asarray(made.faces), SHAPE)
    opaque = np.full(SHAPE[0] * SHAPE[1], behind, dtype=float)
    length, first = in_water(found, opaque)
    near = np.full(len(first), np.inf)
    near[first >= 0] = found.depth[first[first >= 0]]
    return length.reshape(SHAPE), (first >= 0).reshape(SHAPE), near.reshape(SHAPE)


def test_a_box_is_as_thick_as_it_is_deep():
    length, wet, near = seen(trimesh.creation.box((1.02, 0.7, 1.42)))  # facets of more than LARGEST pixels
    assert 1.42 / METRES < LARGEST * 2
    assert (wet.sum(), length[wet], near[wet]) == (20 * 28, pytest.approx(0.7), pytest.approx(-0.35))
    assert not length[~wet].any()


def test_a_balls_volume_is_the_sum_over_the_pixels():
    ball = trimesh.creation.icosphere(subdivisions=5, radius=1.1)
    length, _, _ = seen(ball)
    assert length.sum() * METRES**2 == pytest.approx(ball.volume, rel=2e-3)


def test_gaps_between_two_bodies_do_not_count():
    front, back = trimesh.creation.box((1.02, 0.3, 1.02)), trimesh.creation.box((1.02, 0.5, 1.02))
    back.apply_translation((0, 2.0, 0))
    length, wet, _ = seen(front, back)
    assert length[wet] == pytest.approx(0.8)


def test_an_opaque_body_ends_the_water():
    box = trimesh.creation.box((1.02, 0.8, 1.02))
    length, wet, _ = seen(box, behind=0.1)
    assert length[wet] == pytest.approx(0.5)
    length, wet, _ = seen(box, behind=-1.0)
    assert not wet.any()
    assert not length.any()


def image_through(thickness, colour=(0.16, 0.47, 0.78), normal=(0.0, -1.0, 0.0), behind=None):
    """What is seen of an image through water of even thickness [m]."""
    behind = np.full((*SHAPE, 3), 0.8) if behind is None else behind
    maps = [np.broadcast_to(np.asarray(v, dtype=float), (*SHAPE, 3)) for v in (normal, colour)]
    everywhere = np.ones(SHAPE, bool)
    light = np.array([0.0, 0.0, 1.0])
    lit = ([behind], np.full(SHAPE, thickness), *maps, everywhere, tuple(AXES), AXES[1], light, METRES, everywhere)
    return shaded(*lit)[0]


def test_a_film_is_clear_and_deep_water_has_its_own_colour():
    film, deep = image_through(0.0), image_through(50.0)
    assert np.abs(film - 0.8).max() < 0.02
    r, g, b = deep[30, 40]
    assert r < g < b < 0.6


def test_refraction_moves_what_is_behind_against_the_slope():
    behind = np.full((*SHAPE, 3), 0.9)
    behind[:, 40:] = 0.2
    tilted = np.array([0.5, -1.0, 0.0]) / np.sqrt(1.25)
    straight, bent = (image_through(0.8, normal=n, behind=behind)[30, :, 2] for n in ((0.0, -1.0, 0.0), tilted))
    middle = 0.5 * (straight[5] + straight[75])
    assert (straight > middle).sum() == 40
    assert (bent > 0.5 * (bent[5] + bent[75])).sum() > 40


def test_a_picture_without_background_is_exact_on_white():
    pytest.importorskip("pyvista")
    from refsim.render.looks import Camera
    from refsim.render.space import Body, Stage

    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.8)
    water = Body(np.asarray(ball.vertices), np.asarray(ball.faces), (0.16, 0.47, 0.78), water=True)
    corner = np.ones(3)
    stage = Stage(-corner, corner, np.array([0.0, 0.0, 1.0]), Camera(), (64, 64), half_height=1.0)
    clear, on_white = stage.draw_clear([water]), stage.draw([water]) / 255.0
    assert clear[..., :3] * clear[..., 3:] + 1.0 - clear[..., 3:] == pytest.approx(on_white, abs=0.01)
    r, _, b = on_white[32, 32]
    assert b > r + 0.1
