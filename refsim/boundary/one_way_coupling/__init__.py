"""One-way coupling of a liquid with a solid given as a triangle mesh (patent CN104318598A: patent P5 to P8).

Boundary particles are placed on the solid's surface and in layers below it, as deep as the liquid's kernel reaches. All
passes of the liquid treat them as wall particles: they contribute to its density (patent P5) and mirror its pressure
(P6). This effect adds their own pressure, extrapolated from the liquid, their friction (P6), their adhesion, and the
correction of particles that would enter the solid (P8, `refsim.boundary.penetration`).
"""

import functools
import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import msgspec
import numpy as np

from refsim.boundary import adami_2012
from refsim.boundary.adami_2012 import ParticleWalls
from refsim.boundary.akinci_2012 import lattice_layers, wall_kernel_sums
from refsim.boundary.penetration import CORRECTIONS, penetration_groups
from refsim.core.capabilities import CorrectsPositions, HasErrata, HoldsOtherMemory, KeepsLedger
from refsim.core.checked import NotNegative, Printed, Share
from refsim.core.effect import Discretisation, Field, InitialState, Others, Pass
from refsim.core.errors import InputError
from refsim.core.walls import WallParticles
from refsim.scene.shapes import HOLLOW
from refsim.smoothing import Smoothing, smoothing
from refsim.sph import acceleration_of, lean, liquid_of, pressure_is_replaced

# Least spacing of boundary particles and distances, in spacings of the liquid: guards against wrong units
FINEST = 0.01
EVEN = 2.5  # spacings of a support below which liquid that fills an uneven vessel is noted for its pressure

if TYPE_CHECKING:
    from refsim.boundary.one_way_coupling.placing import PlacedSolid


class MeshBoundary(
    ParticleWalls, CorrectsPositions, HoldsOtherMemory, KeepsLedger, HasErrata, frozen=True, kw_only=True
):
    """A solid at rest, given as a closed triangle mesh, that the liquid flows around.

    file            mesh file (.obj, .off, .ply, .stl); in a scene file, relative to its folder
    center          position of the centre of its bounding box [m]; if omitted, the file's
    size            its longest edge [m]; 0 takes the file's numbers as metres
    rotation        about x, then y, then z, before it is scaled and moved [degrees]
    radius          r of the boundary particles, which are 2 r apart [m]; 0 for half a spacing of the liquid
    layers          of boundary particles, one spacing of the liquid apart; 0 for as many as a particle one spacing off
                    the surface reaches
    model           "extrapolated" (cells of a lattice, as deep as the support, whose pressure is extrapolated from
                    the liquid, Adami et al.) or "mirrored" (boundary particles on the surface and below it, as in the
                    patent); by default extrapolated with an advanced density, else mirrored
    viscosity       mu_b of the friction between liquid and boundary particles [Pa s]; 0 for free slip
    no_slip         friction with which the liquid's velocity at the walls is zero
    adhesion        beta [m^4/(kg s^2)], coefficient of the attraction by boundary particles; 0 for none
    correction      of particles that would enter the solid: "swept" (where their path enters it), "point" (where their
                    step ends, as printed) or "none"
    restitution     c_r of the correction, from 0 (slip) to 1 (elastic)
    rebound         largest D_r of the correction, a fraction of the depth
    field_spacing   of the signed distances [m]; 0 for half a spacing of the liquid
    seed            of the positions of boundary particles
    literal         readings of the patent: its own choices "E27" (velocities that point out of the solid are reflected,
                    too), "E30" (one layer with g = 1, which mirrors the particle's own pressure), also as "all";
                    "paper" takes the correction "point", too
    """

    name: ClassVar[str] = "mesh_boundary"
    ledger_units: ClassVar[Mapping[str, str]] = {"corrections": "-", "corrected_particles": "-"}
    ledger_expected: ClassVar[Mapping[str, str]] = {"corrections": "0 where pressure alone keeps the liquid out"}
    source: ClassVar[str] = "patent"
    errata: ClassVar[tuple[str, ...]] = ("E27", "E30")
    improvements: ClassVar[tuple[str, ...]] = errata
    paper: ClassVar[Mapping[str, Any]] = {"correction": "point"}
    wall_share: ClassVar[float] = 1.0  # the boundary particles' own pressure is a pass of its own
    with_spacing: ClassVar[tuple[str, ...]] = ("radius", "field_spacing")

    file: str
    center: tuple[float, float, float] | None = None
    size: NotNegative = 0.0
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    radius: NotNegative = 0.0
    layers: Annotated[int, msgspec.Meta(ge=0, le=100)] = 0
    model: Literal["mirrored", "extrapolated"] | None = None
    viscosity: NotNegative = 0.0
    no_slip: bool = False
    adhesion: NotNegative = 0.0
    correction: Literal["swept", "point", "none"] = "swept"
    restitution: Share = 0.0
    rebound: NotNegative = 0.1
    field_spacing: NotNegative = 0.0
    seed: int = 0
    literal: Printed = ()

    def check(self, grid: Discretisation, others: Others) -> None:
        if grid.dim != 3:
            raise InputError(f"{self.name}: a mesh is a body in space; set dim to 3 or leave it out.")
        for part in ("radius", "field_spacing"):
            if 0 < getattr(self, part) < FINEST * grid.spacing:
                raise InputError(
                    f"{self.name}: {part} = {getattr(self, part):g} m is below {FINEST:g} spacings of"
                    f" {grid.spacing:g} m; check its unit, or leave it out."
                )
        if self.extrapolates() and self._of_mirrored():
            raise InputError(
                f"{self.name}: radius, layers, adhesion and literal belong to model = 'mirrored'; leave"
                " them out with 'extrapolated'."
            )

    def _of_mirrored(self) -> bool:
        """Whether a parameter is given that mirrored walls alone have."""
        return any((self.radius, self.layers, self.adhesion, *self.literal))

    def sums_density(self, standing: bool) -> bool:
        return self.model == "mirrored" or self._of_mirrored()

    def local(self, grid: Discretisation) -> "MeshBoundary":
        if not any(grid.origin):
            return self
        from refsim.boundary.one_way_coupling.placing import placed_mesh

        middle = self.center or placed_mesh(self.file, None, self.size, self.rotation).origin
        return msgspec.structs.replace(self, center=tuple(map(float, grid.local(middle))))

    def placed(self, grid: Discretisation) -> "PlacedSolid":
        """The solid in its position: boundary particles and narrow band. Raises InputError for a defective mesh."""
        from refsim.boundary.one_way_coupling.placing import placed_solid

        return placed_solid(
            self.file, self.center, self.size, self.rotation, self.radius or 0.5 * grid.spacing,
            self.field_spacing or 0.5 * grid.spacing, self.seed, self._layers(grid), grid.spacing,
        )  # fmt: skip

    def _layers(self, grid: Discretisation) -> int:
        if self.extrapolates():
            return 0
        if "E30" in self.printed():
            return 1
        return self.layers or max(1, math.ceil(grid.support_radius / grid.spacing * (1 - 1e-9)) - 1)

    def walls(self, grid: Discretisation, others: Others) -> WallParticles:
        """Boundary particles (m, 3) [m], layer by layer, and their volumes V_b = g/sum_k W_bk (m,) [m^3].

        With an extrapolated pressure the cells of a lattice in the solid, and what it fills of each.
        """
        if self.extrapolates():
            share, position = self.placed(grid).cells(grid.spacing, adami_2012.layers(grid))
            return WallParticles(position, share * liquid_of(others).particle_volume(grid))
        solid, shape = self.placed(grid), liquid_of(others).sum_kernel()
        parts = (solid.position, *solid.beneath)
        position = np.concatenate(parts)
        factor = np.repeat(self._factors(grid, others, len(parts)), [len(part) for part in parts])
        return WallParticles(position, factor / wall_kernel_sums(position, shape, grid.support_radius, 3))

    def _factors(self, grid: Discretisation, others: Others, layers: int, own: bool = True) -> tuple[float, ...]:
        """g of each layer, the calibrated ones where not `own`."""
        if own and "E30" in self.printed():
            return (1.0,) * layers
        shape, radius = liquid_of(others).sum_kernel(), self.radius or 0.5 * grid.spacing
        return layer_factors(shape, grid.support_radius, grid.spacing, radius, layers)

    def layer_volumes(self, grid: Discretisation, others: Others) -> tuple[float, ...]:
        """All layers lack the same; volumes follow the factors of V_b."""
        if self.extrapolates():
            return ()
        layers = self._layers(grid)
        depth = layer_depth(liquid_of(others).sum_kernel(), grid.support_radius, grid.spacing, layers)
        given, calibrated = (self._factors(grid, others, layers, own) for own in (True, False))
        return tuple(depth / grid.spacing * g / c for g, c in zip(given, calibrated))

    def filled(self, grid: Discretisation, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self.taken(grid, points) if self.extrapolates() else super().filled(grid, points)

    def taken(self, grid: Discretisation, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self.placed(grid).filled(points, grid.spacing)

    def normals(self, grid: Discretisation, points: np.ndarray) -> np.ndarray:
        return self.placed(grid).normals(points, grid.support_radius)

    def corrects_positions(self) -> bool:
        """True where patent P8 moves particles that would enter the solid."""
        return self.correction != "none"

    def _presses(self, others: Others) -> bool:
        """Whether boundary particles have a pressure of their own (patent E30).

        Solvers that replace the liquid's equation of state compute wall forces themselves, without `wall_share`.
        """
        return not (self.extrapolates() or "E30" in self.printed() or pressure_is_replaced(others))

    def fields(self, others: Others) -> tuple[Field, ...]:
        return (*(() if self.correction == "none" else (CORRECTIONS,)), *super().fields(others))

    def initial(self, grid: Discretisation, state: InitialState, others: Others) -> Mapping[str, np.ndarray]:
        inside = int((self.placed(grid).distance(state.position) < 0).sum())
        if inside:
            move = "move the solid or the particles, or set outside = 'bodies' in a box of the fluid"
            remedy = HOLLOW if inside == grid.count else move
            raise InputError(
                f"{self.name}: {inside} particles of the scene start inside the solid of {self.file!r}; {remedy}."
            )
        return {} if self.correction == "none" else {"corrections": np.zeros(grid.count, np.int32)}

    def passes(self, others: Others) -> tuple[Pass, ...]:
        made = [*self.pressure_passes(others)]
        if self._presses(others):
            names = {"smoothing": "gradient_smoothing"}
            made.append(Pass("one_way_coupling.wall_pressure", updates=("acceleration",), names=names))
        made += self.friction_passes()
        if self.adhesion > 0:
            made.append(Pass("akinci_2013.adhesion", updates=("acceleration",)))
        if self.correction != "none":
            moved = ("corrections", "velocity", "position")
            made.append(Pass("penetration.kick_drift", updates=moved, stage="motion"))
        return tuple(made)

    def list_radius(self, grid: Discretisation) -> float:
        return grid.support_radius

    def prepare(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        groups = super().prepare(grid, others)
        if self._presses(others):
            groups |= lean(grid, others)
        if self.adhesion > 0:
            from refsim.surface_tension.akinci_2013 import Adhesion

            amplitude = 0.007 * self.adhesion / grid.support_radius**3
            groups["adhesion"] = Adhesion(grid.real(self.adhesion), grid.real(amplitude))
        if self.correction != "none":
            groups |= penetration_groups(
                self.placed(grid).band.field, grid.dtype, self.restitution, self.rebound, self.correction == "swept",
                "E27" in self.printed(),
            )  # fmt: skip
        return groups

    def other_memory(self) -> str:
        return "distances in a band around the mesh"

    def notes(self, grid: Discretisation, others: Others) -> tuple[str, ...]:
        notes, wide = self.placed(grid).notes, grid.support_radius / grid.spacing
        if self.extrapolates() and wide < EVEN and any(acceleration_of(others)):
            notes += (
                f"at a support_radius of {wide:.3g} spacings liquid that fills a tilted or curved vessel has a wrong"
                " pressure: at 2.2 spacings 13 % too high at the bottom, with a scatter of 20 % (2.6: 4 and 4 %; 3: 3"
                " and 3 %); take a wider one",
            )
        return tuple(f"{self.name}: {note}" for note in notes)

    def ledger(self, field: Callable[[str], np.ndarray]) -> dict[str, float]:
        """Number of corrections, and of particles that were corrected."""
        if self.correction == "none":
            return {}
        corrections = field("corrections")
        return {"corrections": float(corrections.sum()), "corrected_particles": float((corrections > 0).sum())}


@functools.lru_cache(maxsize=64)
def layer_factors(shape: str, support_radius: float, spacing: float, radius: float, layers: int) -> tuple[float, ...]:
    """g of each layer for which liquid on a flat wall has the rest density; lengths in metres, g dimensionless.

    Boundary particles are 2 r apart in a hexagonal packing of area A each, in layers one spacing d apart; the liquid's
    first layer lies d above. All have the same volume s A d, with
    (sum over fluid layers)/(sum over the full lattice) + s d sum_l (integral of W over the plane l) = 1,
    and g = V_b sum_k W_bk, in which other layers are averaged over their plane.
    """
    from refsim.smoothing.reference import kernel_value

    kernel = smoothing(shape, support_radius, 3)
    of_plane = functools.partial(_of_plane, kernel)
    lacking = layer_depth(shape, support_radius, spacing, layers)
    apart = 2 * radius
    far = math.ceil(2 * support_radius / apart) + 1
    a, b = np.meshgrid(np.arange(-far, far + 1), np.arange(-far, far + 1))
    layer = float(kernel_value(apart * np.sqrt(a**2 + a * b + b**2), kernel).sum())
    area = 0.5 * math.sqrt(3) * apart**2
    others = [sum(of_plane(abs(k - m) * spacing) for m in range(layers) if m != k) for k in range(layers)]
    return tuple(lacking * (area * layer + other) for other in others)


def layer_depth(shape: str, support_radius: float, spacing: float, layers: int) -> float:
    """s d [m], volume of a calibrated layer per area; see `layer_factors`."""
    kernel = smoothing(shape, support_radius, 3)
    _, lacking = lattice_layers(shape, support_radius, spacing, 3)
    return lacking / sum(_of_plane(kernel, (k + 1) * spacing) for k in range(layers))


def _of_plane(kernel: Smoothing, away: float) -> float:
    """Integral of W over a plane at distance `away` [1/m]."""
    from refsim.smoothing.reference import kernel_value

    h = float(kernel.support_radius)
    rim = math.sqrt(max(h**2 - away**2, 0.0))
    node, weight = np.polynomial.legendre.leggauss(200)
    rho = 0.5 * rim * (node + 1)
    return float((0.5 * rim * weight * 2 * math.pi * rho * kernel_value(np.hypot(rho, away), kernel)).sum())
