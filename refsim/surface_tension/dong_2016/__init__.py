"""Lennard-Jones-like cohesion with a normal-difference correction (Dong, Zhang & Chen 2016, D(3) to D(11)).

The normals of D(11) are those of J(19) without the factor h. With solver = "hu_adams" density, pressure and viscosity
after Hu & Adams 2006, as in the paper, replace those of weakly_compressible.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from refsim.core.capabilities import HasErrata, Margin
from refsim.core.checked import NotNegative, Positive, Printed
from refsim.core.effect import Discretisation, Others, Pass, int32
from refsim.core.errors import InputError
from refsim.sph import liquid_of
from refsim.surface_normal import color_gradient_pass, normal_term
from refsim.surface_tension import cohesion
from refsim.surface_tension.dong_2016.reference import force_function
from refsim.surface_tension.jiang_zhu_2023 import CORRECTED_DENSITY

# lambda rho0 d/sigma of the nominal sigma by default: drops become round and come to rest; in the default liquid
# they have one tension by jump and by frequency (docs/liquid.md)
CORRECTION_RATIO, MEASURED_RATIO = 3.0, {2: 60.0, 3: 24.0}
# Values of it up to which drops come to rest at their density, and from which on they fly apart (docs/dong_2016.md).
LARGEST_CORRECTION, SHATTERING_CORRECTION = 24.0, 96.0


class MolecularForce(NamedTuple):
    """Parameters of D(7) in kernels."""

    stiffness: float  # k [N/kg^2]
    rest_distance: float  # d0 [m]
    rest_share: float  # (1 - d0/h)^2
    scale: float  # 1/(e (2 - e)), e = d0/h


class NormalCorrection(NamedTuple):
    """Parameters of D(9) in kernels."""

    coefficient: float  # lambda/h [m/s^2], for normals with the factor h
    symmetric: int  # 0: V_j = m_j/rho_j (Dong E21)


class Dong2016(cohesion.PairCohesion, HasErrata, frozen=True, kw_only=True):
    """Surface tension of a free liquid surface by a Lennard-Jones-like pair force.

    surface_tension   sigma [N/m]: that of measured drops in the default liquid; else nominal, turned into k by a sum
                      over the neighbours on the lattice
    stiffness         k of D(7) [N/kg^2], instead of sigma
    rest_distance     d0 of D(7) [m]; left out, the spacing
    correction        lambda of D(9) [m^2/s^2]; left out, 3 sigma/(rho0 d) with the nominal sigma; with that of
                      measured drops 24, in 2D 60 times
    filter_density    one Shepard filter of all densities in every step, as in the paper; not without tension. Left out,
                      it is on but for the default liquid, whose density a surface leaves whole
    solver            "shared" (density, pressure and viscosity of weakly_compressible, so that the models differ by
                      their tension alone) or "hu_adams" (D(3) to D(5))
    literal           other readings of formulas that are lost: "E21" (V_j = m_j/rho_j in D(9), which loses momentum),
                      also as "all"; "paper" takes D(3) to D(5), too, and balances nothing

    Pair force and correction conserve linear momentum; the correction does not conserve angular momentum.
    """

    name: ClassVar[str] = "dong_2016"
    scales: ClassVar[tuple[str, ...]] = ("surface_tension", "stiffness", "correction")
    coefficient_name: ClassVar[str] = "stiffness"
    source: ClassVar[str] = "Dong"
    errata: ClassVar[tuple[str, ...]] = ("E21",)
    improvements: ClassVar[tuple[str, ...]] = errata
    paper: ClassVar[Mapping[str, Any]] = {"solver": "hu_adams", "balance_pressure": False}
    in_papers: ClassVar[Mapping[str, Any]] = {"filter_density": True}
    lattice: ClassVar[bool] = True
    with_spacing: ClassVar[tuple[str, ...]] = ("rest_distance",)

    stiffness: NotNegative | None = None
    rest_distance: Positive | None = None
    correction: NotNegative | None = None
    filter_density: bool | None = None
    solver: Literal["shared", "hu_adams"] = "shared"
    literal: Printed = ()

    def check_others(self, grid: Discretisation, others: Others) -> None:
        if self._rest_distance(grid) >= grid.support_radius:
            raise InputError(
                f"{self.name}: rest_distance = {self._rest_distance(grid)} m is not below the support radius of"
                f" {grid.support_radius} m, so that no pair would attract; give a smaller one, or a larger"
                " support_radius."
            )
        if self.surface_tension and self.unit_tension(grid, others) <= 0:
            raise InputError(
                f"{self.name}: with rest_distance = {self._rest_distance(grid)} m the pair force has no surface tension"
                " on the lattice; give it as stiffness."
            )

    def correction_coefficient(self, grid: Discretisation, others: Others) -> float:
        """lambda [m^2/s^2], given or from sigma."""
        if self.correction is not None:
            return self.correction
        sigma = max(0.0, self.nominal_tension(grid, others))
        ratio = CORRECTION_RATIO if self._measured_at(grid, others) is None else MEASURED_RATIO[grid.dim]
        return ratio * sigma / (liquid_of(others).rest_density * grid.spacing)

    def force_of(self, coefficient: float, r: NDArray, grid: Discretisation, others: Others) -> NDArray:
        """L(r) [N/kg^2] of D(7)."""
        h = grid.support_radius
        return coefficient * force_function(np.maximum(h - r, 0), h, self._rest_distance(grid))

    def replaces(self) -> tuple[str, ...]:
        return ("sph.density", "sph.pressure", "sph.momentum") if self.solver == "hu_adams" else ()

    def passes(self, others: Others) -> tuple[Pass, ...]:
        passes: list[Pass] = []
        if self.solver == "hu_adams":
            passes += [
                Pass("dong_2016.density", writes=("density", "number_density")),
                Pass("dong_2016.momentum", updates=("acceleration",), names={"smoothing": "gradient_smoothing"}),
            ]
        if self._filters():  # an update of `density`: precedes every pass that reads it
            passes += [
                Pass(
                    "dong_2016.shepard_filter", writes=(CORRECTED_DENSITY,), updates=("density",),
                    names={"near_surface": None},
                ),
                Pass("jiang_zhu_2023.replace_density", updates=("density",)),
            ]  # fmt: skip
        if self._corrects():
            passes.append(color_gradient_pass())
        if self.coheres() or self._corrects():
            names = {} if self._corrects() else {"surface_normal": None}
            passes.append(Pass("dong_2016.tension", updates=("acceleration",), names=names))
        return tuple(passes)

    def prepare(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        real, fluid = grid.real, liquid_of(others)
        share = self._rest_distance(grid) / grid.support_radius
        groups: dict[str, Any] = normal_term(fluid, grid)
        if self.solver == "hu_adams":
            groups |= fluid.prepare(grid, others)
        force = correction = None
        if self.coheres():
            strength, far = self.coefficient(grid, others), self._rest_distance(grid)
            force = MolecularForce(*map(real, (strength, far, (1 - share) ** 2, 1 / (share * (2 - share)))))
        if self._corrects():
            coefficient = self.correction_coefficient(grid, others) / grid.support_radius
            correction = NormalCorrection(real(coefficient), int32("E21" not in self.printed()))
        return groups | {"molecular_force": force, "normal_correction": correction}

    def own_notes(self, grid: Discretisation, others: Others) -> Iterator[str]:
        if self._corrects():
            yield from cohesion.angular_momentum_note(self.name, "correction", others)

    def margins(self, grid: Discretisation, others: Others) -> Iterator[Margin]:
        yield from super().margins(grid, others)
        if self.coheres():
            share = grid.support_radius / grid.spacing
            consequence = (
                f"with a support radius of {share:.3g} spacings only the neighbours along the diagonals of the lattice"
                " attract: drops were found to freeze in the shape they have and to tremble, with up to 14 % of their"
                " initial kinetic energy"
            )
            yield Margin("support_radius/spacing", share, math.sqrt(3), least=True, beyond=consequence)
        unmeasured = self._corrects() and self.coheres() and self._measured_at(grid, others) is None
        if unmeasured and (sigma := self.nominal_tension(grid, others)) > 0:
            value = self.correction_coefficient(grid, others) * liquid_of(others).rest_density * grid.spacing / sigma
            fate = "fly apart" if value >= SHATTERING_CORRECTION else "swell"
            consequence = (
                f"correction = {value:.3g} sigma/(rho0 d) is above {LARGEST_CORRECTION:g}, up to which drops come to"
                f" rest at their density: they {fate}; a shorter step does not help"
            )
            yield Margin("correction rho0 d/sigma", value, LARGEST_CORRECTION, beyond=consequence)

    def _rest_distance(self, grid: Discretisation) -> float:
        return grid.spacing if self.rest_distance is None else self.rest_distance

    def _corrects(self) -> bool:
        """Whether the correction is computed: not if its coefficient is zero."""
        return self.correction != 0 and (self.coheres() or self.correction is not None)

    def _filters(self) -> bool:
        """Whether densities are filtered: not where nothing else of the model acts."""
        return self.filter_density is not False and (self.coheres() or self._corrects() or self.solver == "hu_adams")
