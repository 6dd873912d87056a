"""Inputs and closed forms of surface detection."""

import numpy as np

from refsim.cases import VARIATIONS, Case, Exact, Variation, closed_form, groups, particles, takes
from refsim.surface_detection import FanScan, NearSurfaceLimit, SurfaceDetection


@particles("surface", "near_surface")
def _marks(case, random):
    return (random.random(case.count) < 0.5).astype(np.uint8)


@groups("near_surface_limit", "fan_scan")
def _detection(case, grid):
    literal = ("all",) if case.literal else ()
    groups = SurfaceDetection(literal=literal).prepare(grid, case.effects)
    return groups | {"near_surface_limit": groups["candidate_limit"]}


VARIATIONS[NearSurfaceLimit] = Variation(other={"asymmetry": lambda least: 0.5 * least})
VARIATIONS[FanScan] = Variation(
    other={"support_radius": lambda h: 0.5 * h, "smallest_normal": lambda least: 1.0}  # longer than some normals
)
takes("surface_detection.near_surface", near_surface_limit="number_density")  # J(12) stands alone


@closed_form("surface_detection.near_surface")
def thresholds():
    """At the limit a particle still counts as near the surface."""
    case = Case("thresholds", 3, np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 2.0, 0.0]]))
    return Exact(
        case,
        {"number_density": np.array([0.5, 0.75, 1.0]), "near_surface_limit": NearSurfaceLimit(0.75, 1.0),
         "asymmetry": None},
        {"near_surface": np.array([1, 1, 0], np.uint8)},
    )  # fmt: skip


@closed_form("surface_detection.candidates")
def sparse_or_lopsided():
    """Either is enough, and at the limit it counts: sparse alone, lopsided alone, both, neither."""
    case = Case("sides", 2, np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 2.0, 0.0], [0.0, 3.0, 0.0]]))
    return Exact(
        case,
        {"number_density": np.array([0.5, 1.0, 0.75, 1.0]), "asymmetry": np.array([0.125, 0.25, 0.5, 0.125]),
         "near_surface_limit": NearSurfaceLimit(0.75, 0.25)},
        {"near_surface": np.array([1, 1, 1, 0], np.uint8)},
    )  # fmt: skip


@closed_form("surface_detection.fan_scan")
def one_in_the_way():
    """h = 2, s = 1, normals along -y: particle 0 looks to +y.

    Particle 1 at 45 degrees off that axis and 2 behind leave the fan open; 3 stands in the ball of radius s around
    the scan's centre. 0 and 3 have three neighbours, 0 is blocked by 3, and 3 has nobody above.
    """
    position = np.array([[0.0, 0.0, 0.0], [1.0, 0.3, 0.0], [-0.4, -1.0, 0.0], [0.0, 1.5, 0.0]])
    case = Case("fan", 2, position, spacing=1.0, support_radius=2.0)
    return Exact(
        case,
        {"surface_normal": np.array([[0.0, -2.0, 0.0]] * 4), "candidates": np.array([1, 0, 1, 1], np.uint8),
         "fan_scan": FanScan(1.0, 2.0, 1e-6, np.int32(0))},
        {"surface": np.array([0, 0, 1, 1], np.uint8)},
    )  # fmt: skip


def _printed_fan(*directions):
    """A particle that looks to +y, with others 0.9 m away at these angles [degrees] off that axis; E5 as printed."""
    angle = np.radians(directions)
    around = 0.9 * np.stack([np.sin(angle), np.cos(angle), 0 * angle], axis=1)
    count = len(directions) + 1
    return (
        Case("printed_fan", 2, np.concatenate([np.zeros((1, 3)), around]), spacing=1.0, support_radius=2.0),
        {"surface_normal": np.array([[0.0, -2.0, 0.0]] * count), "candidates": np.eye(1, count, dtype=np.uint8)[0],
         "fan_scan": FanScan(1.0, 2.0, 1e-6, np.int32(1))},
    )  # fmt: skip


@closed_form("surface_detection.fan_scan")
def printed_cone_of_three():
    """As printed, who stands in the cone does not count: three of them leave particle 0 at the surface."""
    return Exact(*_printed_fan(-10, 5, 40), {"surface": np.array([1, 0, 0, 0], np.uint8)})


@closed_form("surface_detection.fan_scan")
def printed_beside_the_cone():
    """As printed, one who stands 50 degrees off the axis, outside the cone, occupies it."""
    return Exact(*_printed_fan(-10, 5, 50), {"surface": np.array([0, 0, 0, 0], np.uint8)})


@closed_form("surface_detection.release_pressure")
def released():
    """Zero on the surface, of either sign elsewhere."""
    case = Case("released", 2, np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 2.0, 0.0]]))
    return Exact(
        case,
        {"surface": np.array([1, 0, 0], np.uint8), "pressure": np.array([3.0, 5.0, -2.0])},
        {"pressure": np.array([0.0, 5.0, -2.0])},
    )
