"""Surface energy of a particle liquid on the background grid: the thesis's chapter 3 and force (4.18).

`refsim.surface_energy.reconstruction` runs the operations one after another; the effect is in `.effect`.

Interior particles are those of the liquid; samples stand on its surface. Symbols are those of the thesis.
"""

from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from refsim.core.capabilities import HasErrata
from refsim.core.checked import NotNegative, Positive, Printed
from refsim.core.effect import Effect, int32
from refsim.core.errors import InputError
from refsim.core.operation import Program, add_program
from refsim.sparse_grid import inverse_cell

REACH = 2  # [h] up to which the nearest particle is looked for
LARGEST_INSET = 0.75  # cells, of an inset that follows the volume


class SurfaceTerm(NamedTuple):
    """The surface as the kernels take it; lengths without a unit are in units of h."""

    cell_size: float  # h [m]
    inverse_cell: Any  # 1/h [1/m], float64
    radius_squared: float  # (r/h)^2 of the spheres around the particles
    offset: float  # epsilon/h of the fit's second points
    relaxation: float  # omega of the fit
    iterations: int  # of the fit
    inset: float  # (r - delta)/h by which vertices are moved back
    disk: float  # r_s/h, least distance of samples
    tension: float  # k [N/m], negative as printed (thesis M1)


class Dice(NamedTuple):
    """Random numbers of the Poisson-disk samples."""

    seed: int  # seed of the random numbers [-]
    candidates: int  # number of candidates


class Tension(Effect, HasErrata, frozen=True, kw_only=True):
    """Parameters of the reconstruction of the surface and of its tension: base of the effect `SurfaceEnergy`.

    surface_tension   k [N/m] (in the plane N, per metre of depth)
    quadrature        "facets": a sample to each facet; "poisson": Poisson-disk samples, not on a GPU
    disk_radius       least distance of Poisson-disk samples, in cells, at most 1
    seed              of the Poisson-disk samples
    offset            epsilon of the fit, in cells
    iterations        sweeps of the fit
    relaxation        omega of the fit, between 0 and 2
    normals           "mls" (3.17), "gradient" (3.9), or, to compare, "facets" and "offsets"
    inset             distance of the liquid's surface from its outermost particles, in cells: the surface is moved
                      back to it; a negative one leaves it at r
    enclose_volume    the inset is the distance at which the surface encloses the liquid's present volume, at most 0.75
                      cells; `inset` is used where the volume is not known
    smallest          particles of the smallest component that has tension; 0 takes 3^dim
    literal           readings of the thesis: misprints "M1" (sign), "M14" (no fit); its own choices "M31" (surface at
                      r), "M32" (15 cases of a cell); "paper" for its own choices, with its embedding; "all" for both
    """

    source: ClassVar[str] = "thesis"
    errata: ClassVar[tuple[str, ...]] = ("M1", "M14", "M31", "M32")
    improvements: ClassVar[tuple[str, ...]] = ("M31", "M32")

    surface_tension: NotNegative
    quadrature: Literal["facets", "poisson"] = "facets"
    disk_radius: Positive = 0.5
    seed: int = 0
    offset: Positive = 0.5
    iterations: int = 10
    relaxation: Positive = 1.0
    normals: Literal["mls", "gradient", "facets", "offsets"] = "mls"
    inset: float = 0.25
    enclose_volume: bool = False
    smallest: int = 0
    literal: Printed = ()

    def radius(self, dim: int) -> float:
        """r/h of the spheres around the particles."""
        return dim**0.5

    def least_component(self, dim: int) -> int:
        """Particles of the smallest component that has tension."""
        return self.smallest or 3**dim

    def inset_distance(self) -> float | None:
        """delta/h, None where the surface stays at r."""
        return None if "M31" in self.printed() or self.inset < 0 else self.inset

    def check_parameters(self, dim: int) -> None:
        """Raise InputError if a parameter is out of its range."""
        owner = self.name or "surface_energy"
        self.printed()
        limits = (
            ("disk_radius", self.disk_radius, 0.05, 1.0, "of a cell"), ("offset", self.offset, 0.0, 2.0, "of a cell"),
            ("relaxation", self.relaxation, 0.0, 2.0, "so that the fit converges"),
            ("inset", max(self.inset, 0.0), 0.0, self.radius(dim), "less than the level set's radius"),
        )  # fmt: skip
        for name, number, low, high, why in limits:
            if not low - 1e-12 <= number <= high or (name == "relaxation" and number >= high):
                raise InputError(f"{owner}: {name} = {number} is not possible; give {low:.4g} to {high:.4g}, {why}.")
        if self.iterations < 0 or self.least_component(dim) < 1:
            raise InputError(
                f"{owner}: iterations = {self.iterations} and smallest = {self.smallest} are not possible; give zero or"
                " more iterations, and one particle or more."
            )


def surface_term(tension: Tension, dim: int, dtype: str, cell_size: float) -> SurfaceTerm:
    """Parameter group of the kernels, for cells of `cell_size` [m]."""
    real = np.dtype(dtype).type
    printed = tension.printed()
    inset = tension.inset_distance()
    return SurfaceTerm(
        cell_size=real(cell_size), inverse_cell=inverse_cell(cell_size, dtype), radius_squared=real(dim),
        offset=real(tension.offset), relaxation=real(tension.relaxation),
        iterations=int32(0 if "M14" in printed else tension.iterations),
        inset=real(0.0 if inset is None else tension.radius(dim) - inset), disk=real(tension.disk_radius),
        tension=real(-tension.surface_tension if "M1" in printed else tension.surface_tension),
    )  # fmt: skip


for _name in ("classify", "facets"):
    add_program(f"isosurface.{_name}", "cuda:recorded", Program("kernels_cuda", folder="refsim.surface_energy"))
