"""Surface normals, inward: colour gradient and corrected normals (Jiang & Zhu 2023, (19) and (20)).

The package has no effect: effects that need normals declare the field, list the pass and return `normal_term` among
their parameter groups.

Walls count as occupied. In J(19) a wall particle contributes h V_b grad W_ib, so that liquid at a wall has no
spurious normal. In J(20) it has the number density of particle i and so adds nothing to the sum; its volume enters the
denominator.
"""

from typing import NamedTuple

from refsim.core.effect import Discretisation, Field, Pass, int32
from refsim.sph import NUMBER_DENSITY, WeaklyCompressible

SURFACE_NORMAL = Field("surface_normal", "-", "colour-gradient normal n, inward, J(19)", 3)
CORRECTED_NORMAL = Field("corrected_normal", "1/m", "corrected normal n*, inward, J(20)", 3)


class NormalTerm(NamedTuple):
    """Parameters of the normals as the kernels take them."""

    rest_number_density: float  # delta0 [1/m^dim]
    own_density: int  # V_j = m_j/rho_i as printed (Jiang & Zhu E10) instead of m_j/rho_j


class AxialPart(NamedTuple):
    """Parameters of an area term whose pairs act along e_ij alone."""

    factor: float  # s of s ((n_i - n_j) . e_ij) e_ij [-]


def axial_part(direction: str, grid: Discretisation) -> dict[str, AxialPart | None]:
    """Parameter group of an area term, for `Effect.prepare`: None where pairs act along n_i - n_j.

    s = (dim + 2)/2: along e_ij alone, normals that vary linearly over h have 2/(dim + 2) of the tension.
    """
    return {"axial": AxialPart(grid.real((grid.dim + 2) / 2)) if direction == "axial" else None}


def normal_term(fluid: WeaklyCompressible, grid: Discretisation, own_density: bool = False) -> dict[str, NormalTerm]:
    """Parameter group of both normals, for `Effect.prepare`; own_density=True takes Jiang & Zhu E10 as printed."""
    return {"normal_term": NormalTerm(grid.real(fluid.rest_number_density(grid)), int32(own_density))}


def color_gradient_pass(candidates: str | None = None, on_demand: bool = False) -> Pass:
    """The pass that writes field `surface_normal`, J(19); zero in rows where the uint8 field `candidates` is."""
    names = {"candidates": candidates}
    return Pass("surface_normal.color_gradient", writes=(SURFACE_NORMAL,), on_demand=on_demand, names=names)


def corrected_pass(candidates: str | None = None, on_demand: bool = False) -> Pass:
    """The pass that writes field `corrected_normal`, J(20); it reads field `number_density`, for every row."""
    return Pass(
        "surface_normal.corrected", writes=(CORRECTED_NORMAL,), on_demand=on_demand, names={"candidates": candidates},
        fields=(NUMBER_DENSITY,),
    )  # fmt: skip
