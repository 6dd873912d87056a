"""Inputs and closed forms of surface detection."""

import numpy as np

from refsim.core import cases
from refsim.core.cases import VARIATIONS, Case, Exact, Variation, closed_form, example, groups, particles, takes
from refsim.surface_detection import FanScan, NearSurfaceLimit, SurfaceDetection

example(SurfaceDetection(each_step=True), brings="asymmetry number_density scan_candidates surface surface_normal")


particles("surface", "near_surface")(lambda case, random: (random.random(case.count) < 0.5).astype(np.uint8))


@groups("near_surface_limit", "fan_scan")
def _detection(case, grid):
    literal = ("all",) if case.literal else ()
    groups = SurfaceDetection(literal=literal).prepare(grid, case.effects)
    return groups | {"near_surface_limit": groups["candidate_limit"]}


VARIATIONS[NearSurfaceLimit] = Variation(other={"asymmetry": lambda least: 0.5 * least})
VARIATIONS[FanScan] = Variation(
    other={"support_radius": lambda h: 0.5 * h, "smallest_normal": lambda least: 1.0}  # longer than some normals
)
cases.readings(fan_scan="printed")
takes("surface_detection.near_surface", near_surface_limit="number_density")  # J(12) alone


def _marked(expected, density, asymmetry, limit):
    count = len(expected)
    case = Case(f"row_of_{count}", 3, np.eye(3)[[1]] * np.arange(count)[:, None])
    inputs = {"number_density": density, "asymmetry": asymmetry, "near_surface_limit": limit}
    return Exact(case, inputs, {"near_surface": np.array(expected, np.uint8)})


closed_form(
    "surface_detection.near_surface",  # at the limit a particle still counts as near the surface
    thresholds=lambda: _marked([1, 1, 0], [0.5, 0.75, 1.0], None, NearSurfaceLimit(0.75, 1.0)),
)
closed_form(
    "surface_detection.candidates",  # either suffices, the limits included: sparse alone, lopsided alone, both, neither
    sparse_or_lopsided=lambda: _marked(
        [1, 1, 1, 0], [0.5, 1.0, 0.75, 1.0], [0.125, 0.25, 0.5, 0.125], NearSurfaceLimit(0.75, 0.25)
    ),
)


def _scanned(position, surface, candidates, printed=0):
    """In the plane with h = 2, s = 1 and normals along -y: particles look to +y."""
    case = Case("scanned", 2, np.array(position), spacing=1.0, support_radius=2.0)
    inputs = {
        "surface_normal": np.array([(0.0, -2.0, 0.0)] * case.count), "candidates": np.array(candidates, np.uint8),
        "fan_scan": FanScan(1.0, 2.0, 1e-6, printed),
    }  # fmt: skip
    return Exact(case, inputs, {"surface": np.array(surface, np.uint8)})


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


@closed_form("surface_detection.release_pressure")
def released():
    """Zero on the surface, unchanged with either sign elsewhere."""
    case = Case("released", 2, np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 2.0, 0.0]]))
    return Exact(case, {"surface": [1, 0, 0], "pressure": [3.0, 5.0, -2.0]}, {"pressure": [0.0, 5.0, -2.0]})
