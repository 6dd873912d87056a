"""Cells that a body leaves: shares and centres by loops over points, and what fills them in numbers."""

import math
import types

import numpy as np
import pytest

from refsim.core.effect import Discretisation
from refsim.scene import filling
from refsim.scene.filling import AROUND, PARTS, Room, room_in, room_of_block

D = 0.2


def ball(points):
    return ((points - [0.5, 0.4, 0.3]) ** 2).sum(1) < 0.37**2


@pytest.mark.parametrize("dim", [2, 3])
def test_rooms_of_blocks_have_cells_around_them(dim):
    lower, cells, step = np.array([0.1, 0.2, 0.3 * (dim == 3)]), np.array([3, 2, 4 if dim == 3 else 1]), np.full(3, D)
    room = room_of_block(lower, cells, step, dim)
    around = math.ceil(filling.REACH) + 1
    expected = {}
    for i in range(-around, cells[0] + around):
        for j in range(-around, cells[1] + around):
            for k in range(-around * (dim == 3), cells[2] + around * (dim == 3)):
                at = lower + (np.array([i, j, k]) + 0.5) * D
                within = 0 <= i < cells[0] and 0 <= j < cells[1] and 0 <= k < cells[2]
                expected[tuple(np.round(at if dim == 3 else at * [1, 1, 0], 9))] = float(within)
    assert {tuple(np.round(p, 9)): s for p, s in zip(room.place, room.share)} == expected
    assert np.array_equal(room.centre, room.place)


def test_what_lies_in_a_body_is_counted_by_points():
    """Whole where the points about a cell are all within, none where none is, else by a lattice of points in it."""
    room = room_of_block(np.zeros(3), np.array([4, 4, 3]), np.full(3, D), 3)
    room = Room(room.place, np.where(np.arange(len(room.place)) % 3 == 0, 0.5, 1.0) * (room.share > 0), room.centre)
    found, cut = room_in(room, D, ball), 0
    about = [np.array([x, y, z]) * AROUND * D for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)]
    steps = [((k + 0.5) / PARTS - 0.5) * D for k in range(PARTS)]
    for place, own, share, centre in zip(room.place, room.share, found.share, found.centre):
        near = ball(place + about)
        inner = np.array([place + np.array([x, y, z]) for x in steps for y in steps for z in steps])
        within = inner[ball(inner)]
        part = len(within) / len(inner) if near.any() and not near.all() else float(near.all())
        middle = within.mean(0) if 0 < part < 1 else place
        assert share == pytest.approx(own * part, abs=1e-12)
        assert centre == pytest.approx(middle, abs=1e-12)
        cut += 0 < part < 1
    assert cut > 20


def test_what_fills_a_room_is_as_ever(recorded):
    """A block beside solids whose cells lie between its own, in two and three dimensions."""
    found = {}
    for dim in (2, 3):
        cells = np.array([5, 4, 3 if dim == 3 else 1])
        room = room_of_block(np.zeros(3), cells, np.full(3, D), dim)
        for shift in (0.0, 0.31, 0.77):
            cell = np.indices((2, 2, 2 if dim == 3 else 1)).reshape(3, -1).T + shift * (np.arange(3) < dim)
            cell[:, 2] -= 0.5 * (dim == 2)
            solids = types.SimpleNamespace(lattice=types.SimpleNamespace(cell=cell))
            grid = Discretisation(dim, "float64", D, 0.52, 0, 0.0, None, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
            found[f"{dim} {shift}"] = np.sort(filling.filled(room, grid, {}, solids), axis=0)
            inside = room_in(room, D, ball) if dim == 3 else room
            found[f"{dim} {shift} ball"] = np.sort(filling.filled(inside, grid, {}, solids), axis=0)
    recorded(found)


def test_a_cell_of_which_one_place_lies_in_a_body_has_its_centre_there():
    corner, place = np.full(3, AROUND * D), np.array([0.125, -0.375, 0.375]) * D
    room = Room(np.zeros((1, 3)), np.full(1, 0.5), np.zeros((1, 3)))
    for known, share, centre in (([corner, place], 0.5 / PARTS**3, place), ([corner], 0.0, 0 * place)):
        found = room_in(room, D, lambda points, known=known: (points[:, None] == known).all(2).any(1))
        assert found.share == pytest.approx([share])
        assert found.centre == pytest.approx(centre[None])
