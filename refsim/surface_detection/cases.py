"""Inputs and closed forms of surface detection."""

import numpy as np

from refsim.core import cases
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
cases.readings(fan_scan="printed")
takes("surface_detection.near_surface", near_surface_limit="number_density")  # J(12) alone


def _marked(count, expected, **given):
    case = Case(f"row_of_{count}", 3, np.eye(3)[[1]] * np.arange(count)[:, None])
    return Exact(case, given, {"near_surface": np.array(expected, np.uint8)})


@closed_form("surface_detection.near_surface")
def thresholds():
    """At the limit a particle still counts as near the surface."""
    limit = NearSurfaceLimit(0.75, 1.0)
    return _marked(3, [1, 1, 0], number_density=[0.5, 0.75, 1.0], near_surface_limit=limit, asymmetry=None)


@closed_form("surface_detection.candidates")
def sparse_or_lopsided():
    """Either suffices, the limits included: sparse alone, lopsided alone, both, neither."""
    density, asymmetry = np.array([0.5, 1.0, 0.75, 1.0]), np.array([0.125, 0.25, 0.5, 0.125])
    limit = NearSurfaceLimit(0.75, 0.25)
    return _marked(4, [1, 1, 1, 0], number_density=density, asymmetry=asymmetry, near_surface_limit=limit)


def _scanned(position, surface, candidates, printed=0, thin=None, normal=(0.0, -2.0, 0.0), **options):
    """h = 2, s = 1, by default in the plane with normals along -y: particles look to +y."""
    options = {"spacing": 1.0, "support_radius": 2.0} | options
    case = Case("scanned", options.pop("dim", 2), np.array(position), **options)
    given = {
        "surface_normal": np.array([normal] * case.count), "candidates": np.array(candidates, np.uint8),
        "fan_scan": FanScan(1.0, 2.0, 1e-6, printed), "thin_feature": thin,
    }  # fmt: skip
    return Exact(case, given, {"surface": np.array(surface, np.uint8)})


@closed_form("surface_detection.fan_scan")
def one_in_the_way():
    """Particle 1, beyond 45 degrees off the axis of 0, and 2, behind, are outside the region; 3 is in the ball of
    radius s around the scan's centre. 0 and 3 have three neighbours; 3 occupies the region of 0, and the region of 3 is
    empty.
    """
    position = [[0.0, 0.0, 0.0], [1.0, 0.3, 0.0], [-0.4, -1.0, 0.0], [0.0, 1.5, 0.0]]
    return _scanned(position, [0, 0, 1, 1], [1, 0, 1, 1])


def _printed_fan(surface, *directions):
    """A particle, with others 0.9 m away at these angles [degrees] off its axis; Jiang & Zhu E5 as printed."""
    angle = np.radians(directions)
    around = 0.9 * np.stack([np.sin(angle), np.cos(angle), 0 * angle], axis=1)
    return _scanned(np.concatenate([np.zeros((1, 3)), around]), [surface, 0, 0, 0], [1, 0, 0, 0], printed=1)


closed_form(
    "surface_detection.fan_scan",
    # as printed, particles in the cone do not count: with three of them particle 0 is surface
    printed_cone_of_three=lambda: _printed_fan(1, -10, 5, 40),
    # as printed, a particle 50 degrees off the axis, outside the cone, occupies the region
    printed_beside_the_cone=lambda: _printed_fan(0, -10, 5, 50),
)


def _crosses(*arms, limit, thin, dim=2, walls=()):
    """`thin` of particles without normals, 10 apart, each between four others, `arms` given as (along, across).

    Along the axis across the variance, in units of h^2, is 2 w_b b^2/(1 + 2 w_a + 2 w_b) for a = along/h, b = across/h
    and w = 1 - a^2, 1 - b^2.
    """
    steps = np.array([[0.0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    position = np.concatenate([[10.0 * k, 0, 0] + steps * [a, b, 1] for k, (a, b) in enumerate(arms)])
    wall = np.array(walls, dtype=float).reshape(-1, 3)
    middle = np.arange(len(position)) % 5 == 0
    feature, surface = ThinFeature(limit, dim), np.repeat(thin, 5) * middle
    return _scanned(position, surface, middle, thin=feature, normal=(0.0, 0.0, 0.0), dim=dim, wall_position=wall)


WALLS = [(0, 0, 1), (10, 0, 1), (10, 0, -1)]
closed_form(
    "surface_detection.fan_scan",
    # b = 0.25 between a = 0.5: variance 0.9375/70 = 0.02679; b = 0.3: 0.0378; and 0.5 each way: 3/32 = 0.0938
    thinner_than_the_limit=lambda: _crosses(
        (1.0, 0.5), (1.0, 0.6), (0.5, 1.0), (1.0, 1.0), limit=0.03, thin=[1, 0, 1, 0]
    ),
    # all neighbours in the plane z = 0 of 3D: no variance across it, whatever the limit
    a_plane_in_space_is_thin=lambda: _crosses((1.0, 1.0), limit=1e-3, thin=[1], dim=3),
    # in space, wall particles 1 m off the plane, w = 3/4: p = 3/19 of the weight on one side, variance p (1 - p)/4 =
    # 12/361 = 0.0332; on both sides 6/22 of it, 6/88 = 0.0682
    a_film_between_two_walls=lambda: _crosses((1.0, 1.0), (1.0, 1.0), limit=0.05, thin=[1, 0], dim=3, walls=WALLS),
)


@closed_form("surface_detection.release_pressure")
def released():
    """Zero on the surface, unchanged with either sign elsewhere."""
    case = Case("released", 2, np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 2.0, 0.0]]))
    return Exact(case, {"surface": [1, 0, 0], "pressure": [3.0, 5.0, -2.0]}, {"pressure": [0.0, 5.0, -2.0]})
