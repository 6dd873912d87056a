"""The operation of the penetration correction: float64, all particles at once."""

import numpy as np

from refsim.boundary.penetration import reference as ref
from refsim.boundary.signed_distance.reference import Sampled
from refsim.core.operation import operation, without
from refsim.sph.operations import SHIFT, at_planes, farthest, shifts, stepped

PUSHES, LEFT = 16, 128
ROUNDING = 4e-7  # of a position, relative, in float32


@operation(
    "leap-frog and patent P8 with E26 to E28", paper="patent CN104318598A, 2014",
    outputs="corrections position_residual velocity position displacement", exact="corrections",
    variants=(
        without(f"bounds position_residual {SHIFT}", timestep="long_steps"), SHIFT, "",
        without(f"bounds {SHIFT}", penetration="as_printed"),
        without("bounds", timestep="long_steps"),
    ),
    reason="one rounding in each product and sum; the scale counts those of distance and normal",
    invariants="reordering", cases="towards_edges outside_the_grid",
)  # fmt: skip
def kick_drift(
    acceleration, identity, build_position, bounds, timestep, way, longest_shift, drawn_body, solid_field, penetration,
    corrections, position_residual, velocity, position,
):  # fmt: skip
    """Leap-frog for v [m/s] and x [m], with shifts; patent P8 where a particle would enter the solid.

    Swept: x becomes the first point of the path with phi < 0; P8 is repeated, up to 16 times in all, while
    phi < -h/128. position_residual, displacement: as `sph.kick_drift`; a corrected place has no residual. The scale
    counts distance and normal; it is infinite where a distance on the path is within rounding of 0.
    """
    old_x, count = np.asarray(position, dtype=float), np.asarray(corrections, dtype=np.int64)
    sampled = Sampled(solid_field, 1 / float(solid_field.inverse_spacing))
    box = tuple(np.asarray(corner, dtype=float) for corner in (penetration.lower, penetration.upper))
    shift = shifts(way, longest_shift, drawn_body)
    (v, v_scale), (x, x_scale), rest = stepped(acceleration, timestep, shift, position_residual, velocity, position)
    hit, jumped, grazing = np.zeros((3, len(x)), dtype=bool)
    margin, exact = np.full((2, len(x)), np.inf)
    if penetration.swept and len(x):
        begun = np.where(ref.in_box(old_x, *box), sampled(old_x)[0], np.inf)
        share, least = ref.entry(old_x, x - old_x, sampled, *box)
        margin, exact = np.where(begun >= 0, least, np.inf), np.abs(begun) / sampled.band
        hit = (begun >= 0) & (share < 1)
        x = np.where(hit[:, None], old_x + np.where(hit, share, 0.0)[:, None] * (x - old_x), x)
    # A normal is a difference of distances over a spacing: its error by rounding of the position, in units of 1/eps.
    largest = np.abs(old_x).max(1, initial=0.0)
    size = largest + np.abs(box[1]).max() + sampled.band
    tilt = 1e-3 + 2 * ROUNDING * largest / sampled.h  # of a normal, by rounding
    total, doubt = np.sqrt((v_scale**2).sum(1)), size / sampled.h
    rebound, printed = ref.rebound(identity, count, float(penetration.rebound)), bool(penetration.printed)
    looked = np.flatnonzero(ref.in_box(x, *box))
    for push in range(PUSHES if penetration.swept else 1):
        if not len(looked):
            break
        phi, slope = sampled(x[looked])
        short = phi + (sampled.h / LEFT if push else 0.0)  # a push may leave a little
        margin[looked] = np.minimum(margin[looked], np.abs(short))
        steep = np.sqrt((slope**2).sum(1))
        inside = (short < 0) & (steep > 0)
        looked, phi, steep = looked[inside], phi[inside], steep[inside]
        n = slope[inside] / steep[:, None]
        along = (v[looked] * n).sum(1)
        grazing[looked] |= (not printed) & (np.abs(along) < tilt[looked] * total[looked])
        v[looked] = ref.reflected(v[looked], n, float(penetration.restitution), printed)
        x[looked] = ref.pushed(x[looked], n, phi, steep, rebound[looked])
        v_scale[looked] += (4 * doubt[looked] * (1 + 1 / steep) * total[looked])[:, None]
        x_scale[looked] += (8 * size[looked] * (1 + 1 / steep))[:, None]
        doubt[looked] *= 8 * (1 + 1 / steep)  # the next push depends on this one
        jumped[looked] = True
    margin = np.minimum(4 * margin / size, exact)  # a position is rounded by eps/2 in each coordinate
    certain = margin > 4 * ROUNDING
    v_scale = np.where((certain & ~grazing)[:, None] | np.isnan(v_scale), v_scale, np.inf)
    x_scale = np.where(certain[:, None] | np.isnan(x_scale), x_scale, np.inf)
    x, v, rest, stopped = at_planes(bounds, np.asarray(position), x, v, rest)
    answer = {"corrections": (count + jumped, margin), "velocity": (v, v_scale), "position": (x, x_scale)}
    if rest is not None:
        value, scale = (np.where((hit | jumped)[:, None], 0.0, part) for part in rest)
        answer["position_residual"] = value, np.where(certain[:, None], scale, np.inf)
    moved = x - np.asarray(build_position, dtype=float)
    value, scale = ((part**2).sum(1).max(initial=0) for part in (moved, np.abs(moved) + x_scale))
    far, doubtful = farthest(shift), 0.0 if certain.all() else np.inf
    return answer | {"displacement": (np.array([value, stopped.sum(), far]), np.array([scale, doubtful, far]))}
