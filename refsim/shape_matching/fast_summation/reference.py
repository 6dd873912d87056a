"""NumPy oracle of shape matching with region sums by fast summation: that of the plain sums."""

from refsim.shape_matching.reference import damp as _damp
from refsim.shape_matching.reference import match as _match
from refsim.shape_matching.reference import pull as _pull
from refsim.shape_matching.reference import region_motion as _region_motion


def match(solid_position, region_share, region, region_count, boxes, matching, rotation):
    """c = sum m x/M [m], R = argmax tr(R^T A), as `shape_matching.match`, however sums are taken."""
    return _match(solid_position, region_share, region, matching, rotation)


def pull(
    velocity,
    solid_position,
    region,
    region_count,
    region_anchor,
    rotation,
    place,
    boxes,
    matching,
    timestep,
    acceleration,
):
    """a_i += alpha (g_i - x_i)/(t dt) [m/s^2], as `shape_matching.pull`."""
    return _pull(
        velocity, solid_position, region, region_count, region_anchor, rotation, place, matching, timestep, acceleration
    )


def region_motion(solid_position, solid_velocity, region_share, region, region_count, region_center, boxes, matching):
    """v_c = sum m v/M [m/s], omega = I^-1 L [1/s], as `shape_matching.region_motion`."""
    return _region_motion(solid_position, solid_velocity, region_share, region, region_center, matching)


def damp(
    solid_position,
    solid_velocity,
    region,
    region_count,
    region_center,
    region_velocity,
    region_spin,
    place,
    boxes,
    matching,
    timestep,
    acceleration,
):
    """v_i += (beta/cnt_i) sum_r [...] over the kick [m/s^2], as `shape_matching.damp`."""
    return _damp(
        solid_position,
        solid_velocity,
        region,
        region_count,
        region_center,
        region_velocity,
        region_spin,
        place,
        matching,
        timestep,
        acceleration,
    )
