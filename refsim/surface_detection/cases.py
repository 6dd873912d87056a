"""Inputs and closed forms of surface detection."""

import numpy as np

from refsim.core.cases import VARIATIONS, Case, Exact, Variation, closed_form, example, groups, particles, takes
from refsim.surface_detection import FanScan, NearSurfaceLimit, SurfaceDetection, ThinFeature

example(SurfaceDetection(each_step=True), brings="asymmetry number_density scan_candidates surface surface_normal")


@particles("surface", "near_surface")
def _marks(case, random):
    return (random.random(case.count) < 0.5).astype(np.uint8)


@groups("near_surface_limit", "fan_scan", "thin_feature")
def _detection(case, grid):
    literal = ("all",) if case.literal else ()
    groups = SurfaceDetection(literal=literal, thin_features="second_moment").prepare(grid, case.effects)
    return groups | {"near_surface_limit": groups["candidate_limit"]}


VARIATIONS[NearSurfaceLimit] = Variation(other={"asymmetry": lambda least: 0.5 * least})
VARIATIONS[FanScan] = Variation(
    other={"support_radius": lambda h: 0.5 * h, "smallest_normal": lambda least: 1.0}  # longer than some normals
)
VARIATIONS[ThinFeature] = Variation(other={"variance": lambda least: 4 * least, "dim": lambda dim: 5 - dim})
takes("surface_detection.near_surface", near_surface_limit="number_density")  # J(12) alone


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
    """Either suffices, the limits included: sparse alone, lopsided alone, both, neither."""
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

    Particle 1, beyond 45 degrees off that axis, and 2, behind, are outside the region; 3 is in the ball of radius s
    around the scan's centre. 0 and 3 have three neighbours; 3 occupies the region of 0, and the region of 3 is empty.
    """
    position = np.array([[0.0, 0.0, 0.0], [1.0, 0.3, 0.0], [-0.4, -1.0, 0.0], [0.0, 1.5, 0.0]])
    case = Case("fan", 2, position, spacing=1.0, support_radius=2.0)
    return Exact(
        case,
        {"surface_normal": np.array([[0.0, -2.0, 0.0]] * 4), "candidates": np.array([1, 0, 1, 1], np.uint8),
         "fan_scan": FanScan(1.0, 2.0, 1e-6, np.int32(0)), "thin_feature": None},
        {"surface": np.array([0, 0, 1, 1], np.uint8)},
    )  # fmt: skip


def _printed_fan(*directions):
    """A particle that looks to +y, with others 0.9 m away at these angles [degrees] off that axis; Jiang & Zhu E5 as
    printed."""
    angle = np.radians(directions)
    around = 0.9 * np.stack([np.sin(angle), np.cos(angle), 0 * angle], axis=1)
    count = len(directions) + 1
    return (
        Case("printed_fan", 2, np.concatenate([np.zeros((1, 3)), around]), spacing=1.0, support_radius=2.0),
        {"surface_normal": np.array([[0.0, -2.0, 0.0]] * count), "candidates": np.eye(1, count, dtype=np.uint8)[0],
         "fan_scan": FanScan(1.0, 2.0, 1e-6, np.int32(1)), "thin_feature": None},
    )  # fmt: skip


@closed_form("surface_detection.fan_scan")
def printed_cone_of_three():
    """As printed, particles in the cone do not count: with three of them particle 0 is surface."""
    return Exact(*_printed_fan(-10, 5, 40), {"surface": np.array([1, 0, 0, 0], np.uint8)})


@closed_form("surface_detection.fan_scan")
def printed_beside_the_cone():
    """As printed, a particle 50 degrees off the axis, outside the cone, occupies the region."""
    return Exact(*_printed_fan(-10, 5, 50), {"surface": np.array([0, 0, 0, 0], np.uint8)})


def _crosses(*arms, dim=2, walls=()):
    """h = 2, particles without normals, 10 apart, each between four others, `arms` given as (along, across).

    Along the axis across the variance, in units of h^2, is 2 w_b b^2/(1 + 2 w_a + 2 w_b) for a = along/h, b = across/h
    and w = 1 - a^2, 1 - b^2.
    """
    steps = np.array([[0.0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    position = np.concatenate([[10.0 * k, 0, 0] + steps * [a, b, 1] for k, (a, b) in enumerate(arms)])
    wall = np.array(walls, dtype=float).reshape(-1, 3)
    case = Case("crosses", dim, position, spacing=1.0, support_radius=2.0, wall_position=wall)
    middle = (np.arange(len(position)) % 5 == 0).astype(np.uint8)
    given = {"surface_normal": 0 * position, "candidates": middle, "fan_scan": FanScan(1.0, 2.0, 1e-6, np.int32(0))}
    return case, given


@closed_form("surface_detection.fan_scan")
def thinner_than_the_limit():
    """b = 0.25 between a = 0.5: variance 0.9375/70 = 0.02679; b = 0.3: 0.0378; and 0.5 each way: 3/32 = 0.0938."""
    case, given = _crosses((1.0, 0.5), (1.0, 0.6), (0.5, 1.0), (1.0, 1.0))
    given["thin_feature"] = ThinFeature(0.03, np.int32(2))
    return Exact(case, given, {"surface": np.eye(20, dtype=np.uint8)[[0, 10]].sum(0, dtype=np.uint8)})


@closed_form("surface_detection.fan_scan")
def a_plane_in_space_is_thin():
    """All neighbours in the plane z = 0 of 3D: no variance across it, whatever the limit."""
    case, given = _crosses((1.0, 1.0), dim=3)
    given["thin_feature"] = ThinFeature(1e-3, np.int32(3))
    return Exact(case, given, {"surface": np.eye(1, 5, dtype=np.uint8)[0]})


@closed_form("surface_detection.fan_scan")
def a_film_between_two_walls():
    """In space, wall particles 1 m off the plane, w = 3/4: p = 3/19 of the weight on one side, variance p (1 - p)/4 =
    12/361 = 0.0332; on both sides 6/22 of it, 6/88 = 0.0682."""
    case, given = _crosses((1.0, 1.0), (1.0, 1.0), dim=3, walls=[(0, 0, 1), (10, 0, 1), (10, 0, -1)])
    given["thin_feature"] = ThinFeature(0.05, np.int32(3))
    return Exact(case, given, {"surface": np.eye(1, 10, dtype=np.uint8)[0]})


@closed_form("surface_detection.release_pressure")
def released():
    """Zero on the surface, unchanged with either sign elsewhere."""
    case = Case("released", 2, np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 2.0, 0.0]]))
    return Exact(
        case,
        {"surface": np.array([1, 0, 0], np.uint8), "pressure": np.array([3.0, 5.0, -2.0])},
        {"pressure": np.array([0.0, 5.0, -2.0])},
    )
