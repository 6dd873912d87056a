"""Filling: the particles of a part of the liquid in the room that bodies leave it, packed so that no gap stays."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from refsim.core.capabilities import BringsWalls, effects_with
from refsim.core.effect import Discretisation, Effect, Nodes
from refsim.smoothing import smoothing

PARTS = 4  # of a cell's edge, where a surface cuts the cell
AROUND = 0.75  # spacings from a cell's centre, along each axis, of points that show whether a surface may cut it
LEAST = 1e-3  # share of a cell that counts
SAME = 0.25  # share of a cell up to which a body overlaps a part whose surface it has
REACH = 3.0  # support radius of the packing [spacings]
NEAR = 3.0  # spacings from a cut cell up to which particles are packed
STEPS, LONGEST, AT_REST = 200, 0.1, 2e-3  # of the packing; longest displacement of one, and at its end [spacings]


class Room(NamedTuple):
    """Cells of a lattice, those around a part among them.

    place   (n, 3) [m]
    share   (n,) that the part takes of each, 0 around it
    centre  (n, 3) of what it takes [m]
    """

    place: np.ndarray
    share: np.ndarray
    centre: np.ndarray


def room_of_block(lower: np.ndarray, cells: np.ndarray, step: np.ndarray, dim: int) -> Room:
    """Room of a block of cells with edges `step` [m]."""
    around = np.where(np.arange(3) < dim, int(np.ceil(REACH)) + 1, 0)
    index = np.indices(cells + 2 * around).reshape(3, -1).T - around
    place = lower + (index + 0.5) * step
    place[:, dim:] = 0.0
    return Room(place, ((index >= 0) & (index < cells)).all(1).astype(float), place)


def room_in(room: Room, spacing: float, inside: Callable[[np.ndarray], np.ndarray]) -> Room:
    """What of the room's cells, of the spacing [m], lies in a body; `inside` says which places (n, 3) [m] do."""
    around = (np.indices((3, 3, 3)).reshape(3, -1).T - 1) * (AROUND * spacing)
    held = inside((room.place[:, None] + around).reshape(-1, 3)).reshape(len(room.place), -1)
    share, centre = held.all(1).astype(float), room.place.copy()
    fine = ((np.indices((PARTS,) * 3).reshape(3, -1).T + 0.5) / PARTS - 0.5) * spacing
    cut = np.flatnonzero(held.any(1) & ~held.all(1))
    for few in np.array_split(cut, 1 + len(cut) // 4096):
        within = inside((room.place[few, None] + fine).reshape(-1, 3)).reshape(len(few), -1)
        share[few] = within.mean(1)
        centre[few] += (within[..., None] * fine).sum(1) / np.maximum(within.sum(1), 1)[:, None]
    return Room(room.place, room.share * share, centre)


def filled(
    room: Room, grid: Discretisation, effects: Mapping[str, Effect], solids: Nodes | None
) -> np.ndarray:  # fmt: skip
    """Places (n, 3) [m] of particles, a cell's volume each, that fill what bodies leave of the room."""
    taken, centre = _bodies(room.place, grid, effects, solids)
    open_share, open_centre = _rest(room.place, (taken, centre))
    # Where the part's own surface cuts a cell, a body there is what contains it
    bounded = room.share < np.where(room.share < 1, open_share + SAME, open_share)
    left = np.where(bounded, room.share, open_share)
    place = np.where(bounded[:, None], room.centre, open_centre)
    whole, cut = left > 1 - LEAST, (left > LEAST) & (left <= 1 - LEAST)
    if not cut.any():
        return room.place[whole]
    places = np.flatnonzero(cut)
    best = places[np.argsort(-left[places], kind="stable")][: round(float(left[cut].sum()))]
    kept = np.sort(np.concatenate([np.flatnonzero(whole), best]))
    beyond, outer = _rest(room.place, (taken, centre), (left, place))
    still = [(centre[taken > LEAST], taken[taken > LEAST]), (outer[beyond > LEAST], beyond[beyond > LEAST])]
    kept_out, volume = (np.concatenate(parts) for parts in zip(*still))
    return _packed(place[kept], room.place[cut], kept_out, volume, grid)


def _rest(place: np.ndarray, *parts: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Share (n,) of the cells at (n, 3) [m] that parts, (share, centre) each, leave, and its centre (n, 3) [m]."""
    share = np.clip(1 - sum(part for part, _ in parts), 0.0, 1.0)
    moment = sum(part[:, None] * (centre - place) for part, centre in parts)
    return share, np.where(share[:, None] > LEAST, place - moment / np.maximum(share, LEAST)[:, None], place)


def _bodies(
    place: np.ndarray, grid: Discretisation, effects: Mapping[str, Effect], solids: Nodes | None
) -> tuple[np.ndarray, np.ndarray]:
    """Share (n,) that meshes and solids take of the cells at (n, 3) [m], and its centre (n, 3) [m]."""
    from scipy.spatial import cKDTree

    bodies = [effect.taken(grid, place) for effect in effects_with(effects, BringsWalls)]
    if solids is not None:
        nodes = (solids.lattice.cell + 0.5) * grid.spacing
        pairs = cKDTree(place).sparse_distance_matrix(cKDTree(nodes), grid.spacing * (1 - LEAST), np.inf, "ndarray")
        apart = (nodes[pairs["j"]] - place[pairs["i"]]) / grid.spacing
        each = (1 - np.abs(apart)).prod(1)  # the part that two cells have in common has its centre between theirs
        share = np.bincount(pairs["i"], each, len(place))
        middle = [np.bincount(pairs["i"], 0.5 * each * axis * grid.spacing, len(place)) for axis in apart.T]
        bodies.append((share, place + np.stack(middle, 1) / np.maximum(share, LEAST)[:, None]))
    total = np.zeros(len(place))
    moment = np.zeros_like(place)
    for share, centre in bodies:
        total += share
        moment += share[:, None] * (centre - place)
    return total, place + moment / np.maximum(total, LEAST)[:, None]


def _packed(
    place: np.ndarray, cut: np.ndarray, still: np.ndarray, volume: np.ndarray, grid: Discretisation
) -> np.ndarray:  # fmt: skip
    """Places (n, 3) [m] of which those near the `cut` cells are shifted to even distances.

    still, volume  places (m, 3) [m] of what stays, and its volumes [spacing^dim]
    """
    from scipy.spatial import cKDTree

    from refsim.smoothing.reference import kernel_slope

    d, reach = grid.spacing, REACH * grid.spacing
    kernel = smoothing("wendland_c2", reach, grid.dim)
    near = cKDTree(cut).query(place)[0] < NEAR * d
    place, moving = place.copy(), place[near]
    still = np.concatenate([place[~near], still])
    volume = np.concatenate([np.ones(np.count_nonzero(~near)), volume]) * d**grid.dim
    kept = cKDTree(moving).query(still)[0] < reach + NEAR * d
    still, volume = cKDTree(still[kept]), volume[kept]
    for _ in range(STEPS):
        tree = cKDTree(moving)
        moving_pairs, beside = (tree.sparse_distance_matrix(other, reach, 2, "ndarray") for other in (tree, still))
        i = np.concatenate([moving_pairs["i"], beside["i"]])
        apart = moving[i] - np.concatenate([moving[moving_pairs["j"]], still.data[beside["j"]]])
        each = np.concatenate([np.full(len(moving_pairs), d**grid.dim), volume[beside["j"]]])
        r = np.concatenate([moving_pairs["v"], beside["v"]])
        slope = each * kernel_slope(r, kernel) / np.maximum(r, 1e-9 * d)
        shift = -0.5 * (0.5 * reach) ** 2 * np.stack([np.bincount(i, slope * a, len(moving)) for a in apart.T], 1)
        length = np.linalg.norm(shift, axis=1)
        moving = moving + shift * np.minimum(1.0, LONGEST * d / np.maximum(length, 1e-300))[:, None]
        if length.max() < AT_REST * d:
            break
    place[near] = moving
    return place
