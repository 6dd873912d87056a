"""Free-surface tension by pair forces on surface particles (Jiang & Zhu 2023, (14) to (18) and (21)).

In the paper tension acts on surface particles only. By default all pairs act here and the equation of state balances
their cohesion in the bulk; the tension at the surface remains: an improvement (Jiang & Zhu E9). Other pair modes
confine the force to the surface. "soft" weights a pair by (w_i + w_j)/2, where w rises with |h grad c| from 0 in the
bulk to 1 at the surface: a drop that is symmetric at the start becomes round, in any other drop the surface layer
becomes a rigid crust. With the modes by the surface set S drops do not come to rest.
"""

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, Literal, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from refsim import surface_normal
from refsim.core.capabilities import HasErrata, Margin
from refsim.core.checked import NotNegative, Positive, Printed
from refsim.core.effect import Discretisation, Field, Others, Pass, int32
from refsim.core.errors import InputError
from refsim.smoothing.shapes import NORMALISATION, POLY6
from refsim.sph import liquid_of
from refsim.surface_detection import SurfaceDetection, detection_in, near_surface_pass
from refsim.surface_tension import cohesion
from refsim.surface_tension.jiang_zhu_2023.modes import AREA_TERMS, PAIR_MODES

CORRECTED_DENSITY = Field("corrected_density", "kg/m^3 (kg/m^2 in 2D)", "density rho* near the surface, J(14)")
SURFACE_WEIGHT = Field("surface_weight", "-", "soft surface weight w, 0 in the bulk, 1 at the surface")

ALPHA = {2: 0.75, 3: 0.6}  # of J(17); 0.6 in 2D is the printed reading (Jiang & Zhu E7)
BETA = 0.9
INNER = 0.8  # support of the repulsive kernel, as a share of h
MARKED_MODES = ("one_sided", "either", "both")  # modes that need the surface set S
# Area coefficients up to which a drop stays in one piece and comes to rest (docs/stability.md): eps_r of J(21), and
# eps'/(gamma rho0) of J(18). A shorter step does not raise them.
LARGEST_AREA = {
    "corrected": {"mueller": 0.012, "wendland": 0.006, "cubic_spline": 0.006},
    "color": {"mueller": 0.003, "wendland": 0.0015, "cubic_spline": 0.0015},
}
AXIAL_SHARE = 2 / 3  # of these with area_direction "axial": beyond it drops of 5,000 particles throw some off
# P_int/(rho0 c^2) of the pair force between all particles, from which on drops boil with pair_mode = "soft".
LARGEST_SOFT = 0.015
AREA_RATIO = 0.01  # eps_r, by default
# rho0 c h/mu up to which a drop gains no energy if the equation of state does not balance the pair force.
LEAST_VISCOUS = 55.0
AKINCI_RATIO = 1e-3  # eps'/(gamma rho0) of Akinci et al. 2013 for water


class PairSelection(NamedTuple):
    """Which pairs act."""

    mode: int  # of PAIR_MODES


class SoftThresholds(NamedTuple):
    """Parameters of the soft surface weight in kernels; |h grad c| is dimensionless."""

    lower: float  # |h grad c| at which the weight begins to rise from 0 [-]
    upper: float  # |h grad c| at which the weight reaches 1 [-]
    inverse_width: float  # 1/(upper - lower) [-]


class Cohesion(NamedTuple):
    """Parameters of J(16) and J(17) in kernels."""

    gamma: float  # [m^4/(kg s^2)]; negative for the printed sign (Jiang & Zhu E4)
    alpha: float  # alpha of J(16) [-]
    beta: float  # beta of J(16) [-]
    amplitude: float  # gamma W_poly6(0, h)
    inner_share: float  # W_poly6(0, 0.8 h)/W_poly6(0, h)
    inner_stretch: float  # 1/0.8


class AreaTerm(NamedTuple):
    """Parameters of J(21) or J(18) in kernels."""

    kind: int  # of AREA_TERMS
    coefficient: float  # eps of J(21) [N/m^5; N/m^4 in 2D], or eps' of J(18) [m/s^2]


def corrected_density_passes() -> tuple[Pass, ...]:
    """J(12), J(14) and J(15) near the surface; an update of `density`, which precedes every pass that reads it."""
    return (
        near_surface_pass(),
        Pass("jiang_zhu_2023.corrected_density", writes=(CORRECTED_DENSITY,), updates=("density",)),
        Pass("jiang_zhu_2023.replace_density", updates=("density",)),
    )


def force_function(r: NDArray, support_radius: float, dim: int, alpha: float, beta: float = BETA) -> NDArray:
    """J(17) C(r) = alpha W_poly6(r, 0.8h) - beta W_poly6(r, h) [1/m^dim] at distances r [m]; positive repels."""

    def poly6(radius: float) -> NDArray:
        q = np.asarray(r, dtype=float) / radius
        return np.where(q < 1, NORMALISATION[POLY6][dim] / radius**dim * (1 - q**2) ** 3, 0.0)

    return alpha * poly6(INNER * support_radius) - beta * poly6(support_radius)


class JiangZhu2023(cohesion.PairCohesion, HasErrata, frozen=True, kw_only=True):
    """Surface tension of a free liquid surface by a pair force that changes sign and by area minimisation.

    surface_tension     sigma [N/m]; nominal: turned into gamma by the Kirkwood-Buff integral.
                        A drop of summed density has 2.57 times this by its jump and 1.95 times by its frequency (3D,
                        radius of 10 spacings, h = 2.6 spacings; docs/models.md)
    gamma               coefficient of J(16) [m^4/(kg s^2)], instead of sigma
    pair_mode           "all", "soft" (pairs weighted by their soft surface weights), or by the surface set S:
                        "one_sided" (force on i in S without reaction: does not conserve momentum), "either", "both"
    area_term           "corrected" (J(21) with normals J(20)), "color" (J(18) with normals J(19)) or "none"
    area_ratio          eps_r of J(21), eps = eps_r gamma rho0^2 h^(1 - dim); left out, 0.01 or what drops of the
                        liquid's kernels hold: 0.006, "mueller" 0.012, two thirds of it if axial
    area_direction      of the area term between a pair: "normals" (n_i - n_j, the paper's) or "axial", its part along
                        e_ij with (dim + 2)/2 times eps, which conserves angular momentum
    area_acceleration   eps' of J(18) [m/s^2]; left out, 0.001 gamma rho0
    balance_pressure    with "all": the equation of state balances the cohesion of the bulk by P_int (rho/rho0)^2;
                        without it cohesion compresses the liquid, and J(12) finds no particle near the surface
    density_correction  correct the density near the surface, J(14) and J(15), before the equation of state and the
                        normals. Without it J(21), which divides by both densities, can accelerate a particle that has
                        left the surface outwards. Left out, it is on if there is tension and the density is not that of
                        the default liquid, which a surface leaves whole
    threshold           lambda of J(12), the near-surface set N of the density correction (and, by "E23", of S); left
                        out, that of the scene's surface detection, else the paper's 0.98
    soft_lower          |h grad c| up to which the soft surface weight is 0
    soft_upper          |h grad c| from which it is 1
    literal             readings of the paper: misprints "E4" (sign of J(16)), "E10" (V_j = m_j/rho_i in the normals),
                        "E5" (in the surface detection); its own choices "E7" (alpha = 0.6 in 2D), "E6" and "E23" (in
                        the surface detection); "paper" for its own choices, among them pairs by the surface set
                        (pair_mode "either", nothing balanced) and a scan along J(20), "all" for every printed text

    Pair modes by S detect the surface in every step, by the scene's surface detection or in two steps. Pair force and
    area term conserve linear momentum except for "one_sided" (J(18): for equal masses); the area term does not conserve
    angular momentum (Jiang & Zhu E12). It does not vanish at r = h: where a pair crosses r = h, the acceleration jumps
    by (eps/rho_i) V_j |n*_i - n*_j| in J(21), eps' |n_i - n_j| in J(18).
    """

    name: ClassVar[str] = "jiang_zhu_2023"
    ends_abruptly: ClassVar[bool] = True
    scales: ClassVar[tuple[str, ...]] = ("surface_tension", "gamma", "area_acceleration", "density_correction")
    coefficient_name: ClassVar[str] = "gamma"
    source: ClassVar[str] = "Jiang & Zhu"
    errata: ClassVar[tuple[str, ...]] = ("E4", "E5", "E6", "E7", "E10", "E23")
    improvements: ClassVar[tuple[str, ...]] = ("E6", "E7", "E23")
    paper: ClassVar[Mapping[str, Any]] = {"pair_mode": "either", "balance_pressure": False}  # Jiang & Zhu E9
    in_papers: ClassVar[Mapping[str, Any]] = {"density_correction": True}

    gamma: NotNegative | None = None
    pair_mode: Literal["all", "soft", "one_sided", "either", "both"] = "all"
    area_term: Literal["corrected", "color", "none"] = "corrected"
    area_direction: Literal["normals", "axial"] = "normals"
    area_ratio: NotNegative | None = None
    area_acceleration: NotNegative | None = None
    density_correction: bool | None = None
    threshold: Positive | None = None
    soft_lower: NotNegative = 0.3
    soft_upper: Positive = 1.0
    literal: Printed = ()

    def with_scene_defaults(self, others: Others) -> Any:
        if self.coheres():
            return super().with_scene_defaults(others)
        return msgspec.structs.replace(self, density_correction=bool(self.density_correction))

    def check_others(self, grid: Discretisation, others: Others) -> None:
        if self.soft_upper <= self.soft_lower:
            raise InputError(
                f"{self.name}: soft_upper = {self.soft_upper} is not above soft_lower = {self.soft_lower}; give"
                " soft_lower < soft_upper (0.3 and 1.0 by default)."
            )
        if self._marked() or self._corrects():
            self._detection(others).check(grid, others)

    def signed_gamma(self, grid: Discretisation, others: Others) -> float:
        """gamma [m^4/(kg s^2)], with the printed sign of J(16) if Jiang & Zhu E4 is taken literally."""
        return (-1 if "E4" in self.printed() else 1) * self.coefficient(grid, others)

    def passes(self, others: Others) -> tuple[Pass, ...]:
        passes = [*corrected_density_passes()] if self._corrects() else []
        if not self.coheres():
            return tuple(passes)
        names: dict[str, str | None] = {"surface_weight": None, "surface": None}
        if self.pair_mode == "soft" or self._area() == "color":
            passes.append(surface_normal.color_gradient_pass())
        if self.pair_mode == "soft":
            passes.append(Pass("jiang_zhu_2023.soft_weight", writes=(SURFACE_WEIGHT,)))
            names["surface_weight"] = "surface_weight"
        if self._marked():
            passes += self._detection(others).detection_passes()
            names["surface"] = "surface"
        if self._area() == "corrected":
            passes.append(surface_normal.corrected_pass())
        names["area_normal"] = {"corrected": "corrected_normal", "color": "surface_normal"}.get(self._area())
        operation = "jiang_zhu_2023.cohesion" if self._area() == "none" else "jiang_zhu_2023.tension"
        passes.append(Pass(operation, updates=("acceleration",), names=names))
        return tuple(passes)

    def list_radius(self, grid: Discretisation) -> float:
        if self.coheres() and self._marked():
            return max(grid.support_radius, self._detection({}).list_radius(grid))
        return grid.support_radius if self.coheres() or self._corrects() else 0.0

    def prepare(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        real, h, dim = grid.real, grid.support_radius, grid.dim
        fluid = liquid_of(others)
        gamma = self.signed_gamma(grid, others)
        area = None
        if self._area() == "corrected":
            eps = self.ratio_of_area(others) * abs(gamma) * fluid.rest_density**2 * h ** (1 - dim)
            area = AreaTerm(int32(AREA_TERMS["corrected"]), real(eps))
        elif self._area() == "color":
            given = self.area_acceleration
            eps = AKINCI_RATIO * abs(gamma) * fluid.rest_density if given is None else given
            area = AreaTerm(int32(AREA_TERMS["color"]), real(eps))
        amplitude = gamma * NORMALISATION[POLY6][dim] / h**dim
        groups = self._detection(others).prepare(grid, others)
        groups |= surface_normal.normal_term(
            fluid, grid, own_density="E10" in self.printed()
        ) | surface_normal.axial_part(self.area_direction, grid)
        return groups | {
            "pairs": PairSelection(int32(PAIR_MODES[self.pair_mode])),
            "soft": SoftThresholds(
                *map(real, (self.soft_lower, self.soft_upper, 1 / (self.soft_upper - self.soft_lower)))
            ),
            "cohesion": Cohesion(*map(real, (gamma, self._alpha(dim), BETA, amplitude, INNER**-dim, 1 / INNER))),
            "area": area,
        }

    def margins(self, grid: Discretisation, others: Others) -> Iterator[Margin]:
        yield from super().margins(grid, others)
        if not self.coheres():
            return
        fluid = liquid_of(others)
        if self.pair_mode == "soft":
            given = self._force(grid, others), fluid.rest_density, grid.support_radius, grid.dim
            number = abs(cohesion.of_all_pairs(cohesion.PRESSURE, *given)) / (fluid.rest_density * fluid.sound_speed**2)
            consequence = (
                f"with pair_mode 'soft' the pair force of {number:.2g} rho0 c^2 is above {LARGEST_SOFT:g}, up to which"
                " drops come to rest: take a larger sound_speed"
            )
            yield Margin("pull of the soft pair force/(rho0 c^2)", number, LARGEST_SOFT, beyond=consequence)
        if not (self.balance_pressure and self.acts_on_all_pairs()):
            least = fluid.rest_density * fluid.sound_speed * grid.support_radius / LEAST_VISCOUS
            consequence = (
                f"with unbalanced cohesion and a viscosity of {fluid.dynamic_viscosity:g} Pa s, below rho0 c"
                f" h/{LEAST_VISCOUS:g} = {least:.3g} Pa s, drops may gain kinetic energy"
            )
            yield Margin("dynamic_viscosity [Pa s]", fluid.dynamic_viscosity, least, least=True, beyond=consequence)
        if self._area() != "none":
            value, name, largest = self.ratio_of_area(others), "area_ratio", self._largest_area(others)
            if self._area() == "color":
                unit = abs(self.signed_gamma(grid, others)) * fluid.rest_density
                value = AKINCI_RATIO if self.area_acceleration is None else self.area_acceleration / unit
                name = "area_acceleration/(gamma rho0)"
            consequence = (
                f"{name} = {value:.3g} is above {largest:.3g}, up to which drops with {fluid.kernels} kernels come to"
                " rest in one piece; a shorter step does not help"
            )
            yield Margin(name, value, largest, beyond=consequence)

    def own_notes(self, grid: Discretisation, others: Others) -> Iterator[str]:
        """Notes on pairs that are switched, on an area term that changes angular momentum, and on its own detection."""
        if not self.coheres():
            return
        if self._marked():
            yield (
                f"{self.name}: pair_mode {self.pair_mode!r} switches tension on and off as particles enter and leave"
                " the surface set, so that drops boil or fall apart: 'all' comes to rest"
            )
        if self._area() != "none":
            yield from cohesion.angular_momentum_note(self.name, "area term", others, self.area_direction)
        if self._marked() and SurfaceDetection.name not in others:
            yield from self._detection(others).notes(grid, others)

    def force_of(self, coefficient: float, r: NDArray, grid: Discretisation, others: Others) -> NDArray:
        """C(r) [N/kg^2] of J(16) and J(17)."""
        return coefficient * force_function(r, grid.support_radius, grid.dim, self._alpha(grid.dim))

    def pair_force(self, r: NDArray, grid: Discretisation, others: Others) -> NDArray:
        return self.force_of(self.signed_gamma(grid, others), r, grid, others)

    def acts_on_all_pairs(self) -> bool:
        return self.pair_mode == "all"

    def _detection(self, others: Others) -> SurfaceDetection:
        """Detection of N and S: the scene's, with this effect's threshold and printed readings."""
        detection = detection_in(others)
        wanted = (*detection.literal, *sorted(self.printed() & {"E5", "E6", "E10", "E23"}))
        threshold = detection.threshold if self.threshold is None else self.threshold
        changes = SurfaceDetection.paper if "paper" in self.literal else {}
        literal = tuple(dict.fromkeys(wanted))
        return msgspec.structs.replace(detection, literal=literal, threshold=threshold, **changes)

    def _alpha(self, dim: int) -> float:
        return ALPHA[3] if "E7" in self.printed() else ALPHA[dim]

    def _corrects(self) -> bool:
        return self.coheres() if self.density_correction is None else self.density_correction

    def _marked(self) -> bool:
        return self.pair_mode in MARKED_MODES

    def ratio_of_area(self, others: Others) -> float:
        """eps_r of J(21), given or one with which drops come to rest."""
        return min(AREA_RATIO, self._largest_area(others)) if self.area_ratio is None else self.area_ratio

    def _largest_area(self, others: Others) -> float:
        """Coefficient of the area term up to which drops come to rest in one piece."""
        largest = LARGEST_AREA[self.area_term][liquid_of(others).kernels] if self.area_term != "none" else 0.0
        return largest * (AXIAL_SHARE if self.area_direction == "axial" else 1)

    def _area(self) -> str:
        """The area term that is computed: "none" if its coefficient is zero."""
        left_out = {"corrected": self.area_ratio == 0, "color": self.area_acceleration == 0}
        return "none" if left_out.get(self.area_term, True) else self.area_term
