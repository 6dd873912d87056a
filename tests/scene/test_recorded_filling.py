"""Cells that a body leaves: shares and centres by loops over points, and what fills them in numbers."""

import numpy as np
import pytest

from refsim.core.effect import Discretisation, Lattice, Nodes
from refsim.scene.shapes import AROUND, COLUMNS, DEEP, CellShares, filled, shares_in, shares_of_block

D = 0.2


def ball(points):
    return ((points - [0.5, 0.4, 0.3]) ** 2).sum(1) < 0.37**2


def test_what_fills_a_room_is_as_ever(recorded):
    """A block beside solids whose cells lie between its own, in two and three dimensions."""
    found = {}
    for dim in (2, 3):
        cells = np.array([5, 4, 3 if dim == 3 else 1])
        block = shares_of_block(np.zeros(3), cells, np.full(3, D), dim)
        for shift in (0.0, 0.31, 0.77):
            cell = np.indices((2, 2, 2 if dim == 3 else 1)).reshape(3, -1).T + shift * (np.arange(3) < dim)
            solids = Nodes(Lattice(cell, None, None, None, dim), (), D)
            grid = Discretisation(dim, "float64", D, 0.52, 0, 0.0, None, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
            found[f"{dim} {shift}"] = np.sort(filled(block, grid, {}, solids), axis=0)
            inside = shares_in(block, D, ball) if dim == 3 else block
            found[f"{dim} {shift} ball"] = np.sort(filled(inside, grid, {}, solids), axis=0)
    recorded(found)


def test_a_cell_of_which_one_place_lies_in_a_body_has_its_centre_there():
    corner, place = np.full(3, AROUND * D), np.array([0.5, 0.5, 0.5 / DEEP]) / COLUMNS * D - 0.5 * D
    block = CellShares(np.zeros((1, 3)), np.full(1, 0.5), np.zeros((1, 3)))
    for known, share, centre in (([corner, place], 0.5 / (COLUMNS * DEEP), place), ([corner], 0.0, 0 * place)):
        found = shares_in(block, D, lambda points, known=known: (points[:, None] == known).all(2).any(1))
        assert found.share == pytest.approx([share])
        assert found.centre == pytest.approx(centre[None])
