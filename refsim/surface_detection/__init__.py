"""Free-surface detection in one or two steps (Jiang & Zhu 2023, (12) and (13)).

Motion compresses the surface of a liquid: the number density there reaches that of the bulk, and no threshold on it
distinguishes the two (Jiang & Zhu E23). The neighbours of a surface particle stand on one side. The first of the two
steps therefore also uses the first moment of the neighbourhood, which the density pass sums in the same loop: an
improvement on the paper's threshold alone.

Another effect that needs the detected sets takes the scene's settings, or the default ones, from
`detection_in(others)` and lists their passes, fields and parameter groups; a pass that both effects list runs once.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from refsim.core.capabilities import FindsSurface, HasErrata
from refsim.core.checked import Positive, Printed
from refsim.core.effect import Discretisation, Effect, Field, Others, Pass, int32
from refsim.core.errors import InputError
from refsim.smoothing import lattice, smoothing
from refsim.sph import ASYMMETRY, LIQUID, NUMBER_DENSITY, PRESSURE, WeaklyCompressible, liquid_of
from refsim.surface_normal import color_gradient_pass, corrected_pass, normal_term

NEAR_SURFACE = Field("near_surface", "-", "1 in the near-surface set N, J(12)", dtype="uint8")
SCAN_CANDIDATES = Field("scan_candidates", "-", "1 where the fan scan of two steps looks", dtype="uint8")
SURFACE = Field("surface", "-", "1 in the surface set S", dtype="uint8")

THRESHOLD = 0.98  # the paper's lambda of J(12)
SPARSE = 0.9  # lambda of the first step where asymmetry stands beside it; the lower end of the paper's range
NORMALS = {"color": color_gradient_pass, "corrected": corrected_pass}
# Support radii [spacings] at which at least 97 % of the surface of liquid is found whose particles stand a tenth of a
# spacing off a lattice, in 2D and 3D (`tests/surface_detection/test_detection.py`)
RIGHT = 2.0, 6.0
TOLD = 1.1  # of the outermost layer's number density, the least of an inner corner's at which J(12) tells the two
TOWARDS_SECOND = 0.75  # of the way from the outermost layer's number density to an inner corner's
# First moments of a particle on a lattice's face; more than M from 1.5 to 1.85 spacings on, by kernel
FACE_MOMENTS = 2.0


class NearSurfaceLimit(NamedTuple):
    """J(12), and the limit of the first moment (Jiang & Zhu E23), as the kernels take them."""

    number_density: float  # lambda delta0 [1/m^dim]
    asymmetry: float  # least first moment [m^(1 - dim)]; unused by J(12) alone


class FanScan(NamedTuple):
    """J(13) as the kernels take it."""

    radius: float  # s [m]
    support_radius: float  # h [m], in which neighbours are counted
    smallest_normal: float  # shorter normals have no direction, in the normal's unit
    printed: int  # the printed "<" of the second line (Jiang & Zhu E5)


def near_surface_pass(on_demand: bool = False, output: Field = NEAR_SURFACE) -> Pass:
    """The pass that writes the near-surface set N into field `output`, J(12); it reads `number_density`."""
    return Pass(
        "surface_detection.near_surface", writes=(output,), on_demand=on_demand, fields=(NUMBER_DENSITY,),
        names={"asymmetry": None, "near_surface": output.name},
    )  # fmt: skip


def half_space_moment(fluid: WeaklyCompressible, grid: Discretisation) -> float:
    """First moment of J(8) [m^(1 - dim)] of a particle on the plane surface of undisturbed liquid.

    delta0 times the integral of x W over a half space: 2 int r^2 W dr in 2D, pi int r^3 W dr in 3D.
    """
    from refsim.smoothing.reference import kernel_value

    h = grid.support_radius
    node, weight = np.polynomial.legendre.leggauss(32)
    r = 0.5 * h * (node + 1)
    w = 0.5 * h * weight * kernel_value(r, smoothing(fluid.sum_kernel(), h, grid.dim))
    integral = 2.0 * w @ r**2 if grid.dim == 2 else np.pi * w @ r**3
    return float(fluid.rest_number_density(grid) * integral)


class LatticeFace(NamedTuple):
    """What J(8) gives at a plane face of the undisturbed lattice."""

    outer: float  # number density of a particle of the outermost layer, over delta0
    second: float  # that of a particle of the second layer
    corner: float  # that of a particle of the second layer below three faces, two in 2D
    moment: float  # first moment of a particle of the outermost layer [m^(1 - dim)]


def lattice_face(fluid: WeaklyCompressible, grid: Discretisation) -> LatticeFace:
    """The sums of J(8) over a cubic (square) lattice that ends at a plane face, or at one across each axis."""
    from refsim.smoothing.reference import kernel_value

    h, d = grid.support_radius, grid.spacing
    steps = lattice(int(h / d) + 1, grid.dim)
    weight = kernel_value(d * np.sqrt((steps**2).sum(1)), smoothing(fluid.sum_kernel(), h, grid.dim))
    x, inside = steps[:, 0], (steps <= 1).all(1)
    outer, second, corner = (float(weight[part].sum() / weight.sum()) for part in (x <= 0, x <= 1, inside))
    return LatticeFace(outer, second, corner, float(d * weight[x > 0] @ x[x > 0]))


def plane_moment(fluid: WeaklyCompressible, grid: Discretisation) -> float:
    """First moment [m^(1 - dim)] of a particle on a plane surface, of which `asymmetry` is a share."""
    return min(half_space_moment(fluid, grid), FACE_MOMENTS * lattice_face(fluid, grid).moment)


class SurfaceDetection(Effect, FindsSurface, HasErrata, frozen=True, kw_only=True):
    """Marks the particles of the free surface in field `surface`.

    method       "number_density" (S = N, J(12)), "fan_scan" (J(13) for every particle) or "two_step" (J(13) where the
                 neighbourhood is sparse or lopsided)
    threshold    lambda of J(12); the paper's range is 0.90 to 0.99, its choice 0.98. By default, where J(12) is used
                 alone, 0.98, or at support radii where 0.98 does not tell the outermost layer of a lattice from the
                 next (below 1.4 and, for S = N, from 2.7 to 3 spacings on), three quarters of the way from the density
                 of the one to that of the other. In two steps 0.90: denser surface particles are found by their
                 asymmetry
    asymmetry    least first moment of a lopsided neighbourhood, as a share of that of a particle on a plane surface: of
                 the continuum's, or, below about 1.8 spacings, twice that of a particle on the face of a lattice
    scan_radius  s of J(13): "half" of the support radius, or the "full" one, which doubles the list radius
    scan_normal  "color" (J(19)) or "corrected" (J(20))
    each_step    detect in every step; by default only when the state is read
    release_pressure  the pressure of surface particles is zero, the condition on a free surface of particle methods for
                 incompressible liquids; every step then depends on the detected set
    literal      readings of Jiang & Zhu: misprints "E5" (the "<" of J(13)), "E10" (V_j = m_j/rho_i); their own choices
                 "E6" (s = h), "E23" (J(12) alone is the first step, so that only N is scanned); "paper" for their own
                 choices, these and scan_normal = "corrected", "all" for every printed text

    A particle with fewer than 3 neighbours within the support radius is surface, whatever its normal. With 3 or more
    neighbours, a particle whose normal is zero is not surface (Jiang & Zhu E20). Wall
    particles count as neighbours and occupy the scan region.
    """

    name: ClassVar[str] = "surface_detection"
    source: ClassVar[str] = "Jiang & Zhu"
    errata: ClassVar[tuple[str, ...]] = ("E5", "E6", "E10", "E23")
    improvements: ClassVar[tuple[str, ...]] = ("E6", "E23")
    paper: ClassVar[Mapping[str, Any]] = {"scan_normal": "corrected"}  # Jiang & Zhu E33: J(13) scans along J(20)
    needed: ClassVar[tuple[str, ...]] = (LIQUID,)

    method: Literal["number_density", "fan_scan", "two_step"] = "two_step"
    threshold: Positive | None = None
    asymmetry: Positive = 0.25
    scan_radius: Literal["half", "full"] = "half"
    scan_normal: Literal["color", "corrected"] = "color"
    each_step: bool = False
    release_pressure: bool = False
    literal: Printed = ()

    def check(self, grid: Discretisation, others: Others) -> None:
        if self.threshold is not None and self.threshold > 1.2:
            raise InputError(
                f"{self.name}: threshold = {self.threshold} would mark every particle as near the surface; give a"
                " number up to 1.2 (the paper uses 0.90 to 0.99)."
            )

    def passes(self, others: Others) -> tuple[Pass, ...]:
        if not self.release_pressure:
            return self.detection_passes(on_demand=not self.each_step)
        release = Pass("surface_detection.release_pressure", updates=("pressure",), fields=(PRESSURE,))
        return (*self.detection_passes(), release)

    def near_passes(self) -> tuple[Pass, ...]:
        return (near_surface_pass(),)

    def near_groups(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        return {"near_surface_limit": self.prepare(grid, others)["near_surface_limit"]}

    def detection_passes(self, on_demand: bool = False) -> tuple[Pass, ...]:
        """Passes that end with field `surface`, in every step or on demand."""
        if self.method == "number_density":
            return (near_surface_pass(on_demand, output=SURFACE),)
        first, candidates = [], None  # the field that marks the particles to scan; None: all are scanned
        if self._lopsided():
            candidates = SCAN_CANDIDATES.name
            first = [
                Pass(
                    "surface_detection.candidates", writes=(SCAN_CANDIDATES,), on_demand=on_demand,
                    names={"near_surface": candidates, "near_surface_limit": "candidate_limit"},
                    fields=(ASYMMETRY, NUMBER_DENSITY),
                )
            ]  # fmt: skip
        elif self.method == "two_step":
            first, candidates = [near_surface_pass(on_demand)], NEAR_SURFACE.name
        normal = NORMALS[self.scan_normal](candidates, on_demand)
        names = {"surface_normal": normal.writes[0], "candidates": candidates}
        scan = Pass("surface_detection.fan_scan", writes=(SURFACE,), on_demand=on_demand, names=names)
        return (*first, normal, scan)

    def notes(self, grid: Discretisation, others: Others) -> tuple[str, ...]:
        """Where the detector is not right: supports beyond those measured, and limits that fail on the lattice."""
        fluid, ratio, said = liquid_of(others), grid.support_radius / grid.spacing, []
        low, high = self.supports(fluid, grid)
        if not low * (1 - 1e-9) <= ratio <= high * (1 + 1e-9):
            said.append(
                f"{self.name}: method = {self.method!r} finds the surface at support radii of {low:g} to {high:g}"
                f" spacings; at {ratio:.3g} it finds that of a lattice, but once particles have moved it misses some of"
                " them, or marks others inside (docs/surface_detection.md#how-it-fails)."
            )
        face = lattice_face(fluid, grid)
        share = self._lambda(SPARSE) if self._lopsided() else self._near(face)
        lopsided = self._lopsided() and face.moment >= self.asymmetry * plane_moment(fluid, grid)
        if self.method != "fan_scan" and face.outer > share and not lopsided:
            said.append(
                f"{self.name}: threshold = {share:g} is below the {face.outer:.3g} of a lattice's outermost layer with"
                " this support radius, which is not found then; give a larger one, or leave it out."
            )
        if self.method == "number_density" and self.threshold is not None and share >= face.second:
            said.append(
                f"{self.name}: threshold = {share:g} also marks the second layer of a lattice, which has"
                f" {face.second:.3g} with this support radius; give {face.outer:.3g} to {face.second:.3g}, or leave it"
                " out."
            )
        return tuple(said)

    def supports(self, fluid: WeaklyCompressible, grid: Discretisation) -> tuple[float, float]:
        """Least and largest support radius [spacings] at which the method finds the surface of liquid in motion."""
        low, high = RIGHT
        if self.method != "number_density":
            return low, high
        radii = [0.1 * k for k in range(round(10 * low), round(10 * high) + 1)]
        faces = {r: lattice_face(fluid, dataclasses.replace(grid, support_radius=r * grid.spacing)) for r in radii}
        return low, max(r for r, face in faces.items() if face.corner >= TOLD * face.outer)

    def list_radius(self, grid: Discretisation) -> float:
        scanned = self.method != "number_density"
        return grid.support_radius * (2.0 if scanned and self._full() else 1.0)

    def prepare(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        real, fluid = grid.real, liquid_of(others)
        h, delta0 = grid.support_radius, fluid.rest_number_density(grid)
        face = lattice_face(fluid, grid)
        # Up to rounding, a normal without direction is zero; normals are dimensionless or, J(20), in 1/m.
        smallest = max(1e-12, 64.0 * float(np.finfo(grid.dtype).eps))
        if self.scan_normal == "corrected":
            smallest /= h
        return {
            **normal_term(fluid, grid, own_density="E10" in self.printed()),
            "near_surface_limit": NearSurfaceLimit(real(self._near(face) * delta0), real(np.inf)),
            "candidate_limit": NearSurfaceLimit(
                real(self._lambda(SPARSE) * delta0), real(self.asymmetry * plane_moment(fluid, grid))
            ),
            "fan_scan": FanScan(
                real(h if self._full() else 0.5 * h), real(h), real(smallest), int32("E5" in self.printed())
            ),
        }

    def _lopsided(self) -> bool:
        """Whether the first step uses the asymmetry of the neighbourhood."""
        return self.method == "two_step" and "E23" not in self.printed()

    def _lambda(self, usual: float) -> float:
        return usual if self.threshold is None else self.threshold

    def _near(self, face: LatticeFace) -> float:
        """lambda of J(12): the paper's where it tells the outermost layer of a lattice from the next, else one between.

        As a first step it need not exclude the second layer, which is scanned.
        """
        bulk = 1.0
        if self.method == "number_density":
            bulk = face.corner if face.corner > face.outer else face.second
        fits = face.outer < THRESHOLD < bulk
        return self._lambda(THRESHOLD if fits else face.outer + TOWARDS_SECOND * (bulk - face.outer))

    def _full(self) -> bool:
        return self.scan_radius == "full" or "E6" in self.printed()


def detection_in(others: Others) -> SurfaceDetection:
    """The scene's surface detection, or one with the default settings where the scene has none."""
    detection = others.get(SurfaceDetection.name)
    return detection if isinstance(detection, SurfaceDetection) else SurfaceDetection()
