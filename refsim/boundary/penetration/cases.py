"""Inputs, hard cases and closed forms of the penetration correction."""

import functools
import math

import numpy as np

from refsim.boundary.penetration import Penetration, marked_box, penetration_groups
from refsim.boundary.signed_distance import DistanceField, signed_distance
from refsim.boundary.signed_distance.cases import field_at
from refsim.core.cases import Exact, at, closed_form, cloud, groups, hard_input, other, particles, readings, takes
from refsim.scene.surface_mesh import surface_mesh
from refsim.sparse_grid import inverse_cell
from refsim.winding_number.cases import FACES, OCTAHEDRON

UNIT = 0.625  # spacing of the bands [spacings of the case]


@functools.cache
def octahedron() -> DistanceField:
    """Band of an octahedron of radius 1.7, nodes UNIT apart, about the origin."""
    return signed_distance(surface_mesh(1.7 * OCTAHEDRON, FACES), UNIT, dtype="float64").field


# some particles have been corrected before
particles(corrections=lambda case, random: random.integers(0, 4, case.count).astype(np.int32))


@groups("solid_field", "penetration")
def _solid(case, grid):
    """An octahedron, a little off the middle of the particles, so that some are inside.

    Where float32 resolves positions to a fraction of a spacing only, it lies beside them: too many would otherwise be
    within rounding of its surface.
    """
    middle = np.median(case.position, axis=0) if case.count else np.zeros(3)
    coarse = case.count > 0 and np.abs(middle).max() > 1e5 * case.spacing
    center = middle + case.spacing * np.array([5.13 if coarse else 0.13, -0.21, 0.07])
    whole, size, spacing = octahedron(), case.spacing, grid.real(UNIT * case.spacing)
    field = whole._replace(
        distance=(whole.distance * size).astype(grid.dtype), spacing=spacing, band=grid.real(whole.band * size),
        inverse_spacing=np.float64(inverse_cell(spacing, grid.dtype)),
        **{f"origin_{axis}": np.float64(x) for axis, x in zip("xyz", center)},
    )  # fmt: skip
    return penetration_groups(field, grid.dtype, 0.4, 0.1, True, False)


as_printed = other("penetration", swept=0, printed=1)


def long_steps(case, grid):
    """Time steps in which a particle moves by about a quarter of a spacing."""
    return np.array([0.8, 1.0], dtype=grid.dtype) * grid.real(0.25 * case.spacing)


readings(penetration="printed")
takes("penetration.kick_drift", solid_field="origin_x origin_y origin_z")


# Around an octahedron whose edges are sharper than the band's spacing resolves
hard_input("towards_edges", 3, lambda: cloud("towards_edges", 120, 3, 0.12))
# Mostly far outside the box of the band, so that paths begin outside it
hard_input("outside_the_grid", 3, lambda: 6 * cloud("outside_the_grid", 120, 3))


BLOCKS = [(x, y, z) for z in (-1, 0) for y in (-1, 0) for x in (-1, 0)]  # around the origin


def _slab() -> DistanceField:
    """phi = z, linear, so that interpolation is exact: the solid fills z < 0; 8 blocks around the origin, h = 1 m."""
    return field_at(BLOCKS, np.concatenate([np.repeat(4.0 * z + np.arange(4), 16) for _, _, z in BLOCKS]))


def _step(begin, speed, position, velocity, corrections=1, field=None, **changes):
    """One particle before and after 1 s without acceleration, onto the slab or in another field; c_r = 1/2, D_r = 0."""
    slab, start = _slab(), np.array([begin])
    inputs = {
        "velocity": np.array([speed]), "acceleration": np.zeros((1, 3)), "timestep": [0.0, 1.0], "way": None,
        "longest_shift": None, "drawn_body": None, "build_position": start, "corrections": np.zeros(1, np.int32),
        "identity": np.zeros(1, np.int32),
        "solid_field": field or slab,
        "penetration": Penetration(0.5, 0.0, 1, 0, *marked_box(slab))._replace(**changes),
    }  # fmt: skip
    moved = np.array(position) - begin
    after = {"position": [position], "velocity": [velocity], "corrections": [corrections]}
    return Exact(at("onto_a_slab", start), inputs, after | {"displacement": [moved @ moved, 0.0, 0.0]})


def _flat():
    """phi = z/5, as flat as over a rounded edge."""
    return _slab()._replace(distance=0.2 * _slab().distance)


closed_form(
    "penetration.kick_drift",
    # point: z = 1 - 3 = -2 becomes 0, and v_z = -3 becomes 3/2; x and v_x are not changed
    printed_bounce=lambda: _step((0.25, 0.5, 1.0), (1.0, 0.0, -3.0), (1.25, 0.5, 0.0), (1.0, 0.0, 1.5), swept=0),
    # swept, from 1 m at 3 m/s: samples z = 1, 1/4, 0, -1/4, which is 5/12 of the path; there P8 moves it to z = 0
    swept_bounce=lambda: _step((0.25, 0.5, 1.0), (0.0, 0.0, -3.0), (0.25, 0.5, 0.0), (0.0, 0.0, 1.5)),
    # inside at z = -2 and rising: P8 moves it from z = -1 to 0, and v is not changed (patent E27)
    leaving_is_not_reflected=lambda: _step((0.25, 0.5, -2.0), (0.0, 0.0, 1.0), (0.25, 0.5, 0.0), (0.0, 0.0, 1.0)),
    # the printed rule reflects it nevertheless: v_z = 1 becomes -1/2
    printed_leaving=lambda: _step((0.25, 0.5, -2.0), (0.0, 0.0, 1.0), (0.25, 0.5, 0.0), (0.0, 0.0, -0.5), printed=1),
    # from z = -1 m under a flat phi a push of 2|phi| leaves 3/5 of z, the seventh less than h/128
    pushed_until_out=lambda: _step(
        (0.25, 0.5, -0.5), (0.0, 0.0, -0.5), (0.25, 0.5, -(0.6**7)), (0.0, 0.0, 0.25), field=_flat()
    ),
    # without the sweep one push of 2|phi| is all: 3/5 of z is left
    pushed_once=lambda: _step(
        (0.25, 0.5, -0.5), (0.0, 0.0, -0.5), (0.25, 0.5, -0.6), (0.0, 0.0, 0.25), field=_flat(), swept=0
    ),
    # from the first cell of the blocks, 3.5 m deep, 1/4 m further down: to z = 0
    first_cell=lambda: _step((-3.75, -3.75, -3.5), (0.0, 0.0, -0.25), (-3.75, -3.75, 0.0), (0.0, 0.0, 0.125)),
)


@closed_form("penetration.kick_drift")
def from_outside_the_box():
    """From 9 m at 11 m/s, above and beside the box of the blocks, which ends at 4 m: phi is 5 m there and z below it.

    Samples along the path are phi - 1/4 m apart, at least 1/4 m; the first one below z = 0 is put back.
    """
    t, phi = 5 / 11, 5.0
    while phi >= 0:
        t += max(phi - 0.25, 0.25) / math.sqrt(122.0)
        phi = 9 - 11 * t
    return _step((-4.25, 0.5, 9.0), (1.0, 0.0, -11.0), (t - 4.25, 0.5, 0.0), (1.0, 0.0, 5.5))


FAR = np.full(3, 99.0)  # [m], a corner of a box around everything


def _wall():
    """phi = -x: the solid fills x > 0, also beyond the last block."""
    field = field_at(BLOCKS, np.concatenate([np.tile(-4.0 * x - np.arange(4), 16) for x, _, _ in BLOCKS]))
    return field._replace(inside_after=np.array([x == 0 for x, _, _ in BLOCKS], np.uint8))


# Boxes that end at x = 2 m and at y = 0, and one around everything
NARROW, LOW, ALL = ({"lower": -FAR, "upper": np.array(upper)} for upper in ([2.0, 99.0, 99.0], [99.0, 0.0, 99.0], FAR))
closed_form(
    "penetration.kick_drift",
    # beyond the band no distance has a slope: the particle moves on
    deep_inside=lambda: _step(
        (9.0, 0.5, 0.5), (-2.0, 1.0, 0.25), (7.0, 1.5, 0.75), (-2.0, 1.0, 0.25), 0, _wall(), **ALL
    ),
    # it begins inside, so that only the end of its step counts, not where it meets the band: from x = 2 m to 0
    out_of_the_depth=lambda: _step(
        (8.5, 0.5, 0.5), (-6.5, 1.0, 0.25), (0.0, 1.5, 0.75), (-6.5, 1.0, 0.25), 1, _wall(), **ALL
    ),
    # at z = 2.5 m, higher than the box is wide, a particle moves into the wall: samples x = -3/8, -1/8, 1/8, put to 0
    higher_than_wide=lambda: _step(
        (-0.375, 0.5, 2.5), (2.0, 0.0, 0.0), (0.0, 0.5, 2.5), (-1.0, 0.0, 0.0), 1, _wall(), **NARROW
    ),
    # beside the box no distance is looked at: deep inside the wall a particle moves on
    along_the_box=lambda: _step((6.0, 0.5, 0.5), (2.0, 0.0, 0.0), (8.0, 0.5, 0.5), (2.0, 0.0, 0.0), 0, _wall(), **LOW),
)


@closed_form("penetration.kick_drift", over=[(side, axis) for side in ("lower", "upper") for axis in range(3)])
def past_one_side(side, axis):
    """A particle that ends in the slab, past one side of a box that has no others, moves on."""
    x = -2.5 if (side, axis) == ("upper", 2) else 0.25
    y = -2.5 if (side, axis) in (("lower", 1), ("upper", 0)) else 0.5
    end, box = np.array([x, y, -2.0]), {"lower": -FAR, "upper": FAR.copy()}
    box[side][axis] = end[axis] + (0.125 if side == "lower" else -0.125)
    return _step((x, y, 1.0), (0.0, 0.0, -3.0), end, (0.0, 0.0, -3.0), 0, swept=0, **box)
