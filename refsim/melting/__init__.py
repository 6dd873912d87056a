"""Melting: particles at a solid's surface that reach the melting point become liquid (Shao & Song 2017, section 2)."""

import math
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Literal, NamedTuple

import msgspec
import numpy as np

from refsim.core.capabilities import FollowsScene, KeepsLedger, SumsDensity
from refsim.core.effect import Discretisation, Effect, Field, InitialState, Others, Pass, int32
from refsim.core.errors import InputError
from refsim.heat import MELTING_POINT
from refsim.shape_matching.phases import FLUID
from refsim.sph import liquid_of

MELTED = Field("melted", "-", "1 for nodes that melted in this step", dtype="int32", rows="solids")
MELTED_COUNT = Field("melted_count", "-", "number of nodes that melted in this step", dtype="int32", rows=1)
REBUILD = Field("rebuild", "-", "1 for nodes whose region is rebuilt", dtype="int32", rows="solids")


class MeltingRule(NamedTuple):
    """Melting as the kernels take it."""

    into_liquid: int  # 1 if the melt takes density and mass of the scene's liquid
    liquid_density: float  # [kg/m^3]
    liquid_mass: float  # [kg]
    liquid_conductivity: float  # [W/(m K)]
    liquid_heat_capacity: float  # [J/(kg K)]


class Melting(Effect, KeepsLedger, SumsDensity, FollowsScene, frozen=True, kw_only=True):
    """Particles at the surface of solids become liquid at the melting point of their body.

    bookkeeping  of the melt: "immiscible" keeps mass and rest density, so the melt is as dense as its solid; "water"
                 gives it mass, rest density, conductivity and heat capacity of the scene's liquid, and the total mass
                 changes; by default "water", and "immiscible" in a liquid whose density is summed
    """

    name: ClassVar[str] = "melting"
    ledger_units: ClassVar[Mapping[str, str]] = {"solid_particles": "-", "solid_mass": "kg", "rest_volume": "m^3"}
    ledger_expected: ClassVar[Mapping[str, str]] = {
        "solid_particles": "falls as solids melt", "solid_mass": "falls as solids melt", "rest_volume": "stays",
    }  # fmt: skip
    in_papers: ClassVar[Mapping[str, str]] = {"bookkeeping": "immiscible"}
    needed: ClassVar[tuple[str, ...]] = ("shape_matching", "two_way_coupling", "heat_conduction")

    bookkeeping: Literal["immiscible", "water"] | None = None

    def with_scene_defaults(self, others: Others) -> "Melting":
        summed = not liquid_of(others).with_scene_defaults(others).advances()
        return msgspec.structs.replace(self, bookkeeping=self.bookkeeping or ("immiscible" if summed else "water"))

    def sums_density(self, standing: bool) -> bool:
        return self.bookkeeping == "immiscible"  # a melt that keeps its rest density makes two liquids

    def check(self, grid: Discretisation, others: Others) -> None:
        if others["heat_conduction"].melting_point is None:  # type: ignore[attr-defined]
            raise InputError(f"{self.name}: heat_conduction has no melting_point; set it.")

    def _provided(self, others: Others) -> set[str]:
        """Names of the fields that other effects provide."""
        return {f.name for effect in others.values() if effect.name != self.name for f in effect.fields(others)}

    def fields(self, others: Others) -> tuple[Field, ...]:
        return (MELTED, MELTED_COUNT, REBUILD, MELTING_POINT)

    def initial(self, grid: Discretisation, state: InitialState, others: Others) -> Mapping[str, np.ndarray]:
        if "melting_point" in self._provided(others):
            return {}
        heat: Any = others["heat_conduction"]
        return {"melting_point": heat.of_particles("melting_point", state)}

    def passes(self, others: Others) -> tuple[Pass, ...]:
        latent = "enthalpy" in self._provided(others)
        absent = {name: None for name in ("conductivity", "heat_capacity") if name not in self._materials(others)}
        absent |= {} if latent else {"enthalpy": None, "latent_heat": None}
        return (
            Pass(
                "melting.melt",
                writes=("melted", "melted_count"),
                updates=("mass", "rest_density", *self._materials(others), "phase"),
                stage="begin",
                names=absent,
            ),
            Pass("melting.detach", writes=("rebuild",), updates=("direct",), stage="begin"),
            Pass("shape_matching.regions", updates=("region", "region_count"), stage="begin"),
            Pass("shape_matching.classify", updates=("phase",), stage="begin"),
        )

    def _materials(self, others: Others) -> tuple[str, ...]:
        """Thermal properties that the melt takes from the liquid."""
        wanted = ("conductivity", "heat_capacity") if self.bookkeeping == "water" else ()
        return tuple(name for name in wanted if name in self._provided(others))

    def ledger(self, field: Callable[[str], np.ndarray]) -> dict[str, float]:
        """Number and mass [kg] of solid particles, and the volume at rest densities [m^3], which melting conserves."""
        mass, density, phase = (np.asarray(field(name), dtype=float) for name in ("mass", "rest_density", "phase"))
        return {
            "solid_particles": int((phase != FLUID).sum()),
            "solid_mass": math.fsum(mass[phase != FLUID]),
            "rest_volume": math.fsum(mass / density),
        }

    def prepare(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        liquid = liquid_of(others)
        heat: Any = others["heat_conduction"]
        last = [float(np.ravel(values)[-1]) for values in (heat.conductivity, heat.heat_capacity)]  # the last part's
        numbers = map(grid.real, (liquid.rest_density, liquid.particle_mass(grid), *last))
        return {"melting": MeltingRule(int32(self.bookkeeping == "water"), *numbers)}
