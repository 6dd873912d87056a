"""The operations of melting."""

import numpy as np

from refsim.core.operation import operations
from refsim.core.terms import certain
from refsim.melting import reference as ref

operation = operations(paper="Shao & Song 2017")


@operation(
    "Shao & Song, section 2: T >= T_melt at surfaces, with M12, M13",
    outputs="melted mass rest_density conductivity heat_capacity phase melted_count", exact="melted melted_count phase",
    optional="enthalpy latent_heat conductivity heat_capacity", reason="copies",
)  # fmt: skip
def melt(
    identity, temperature, enthalpy, melting_point, latent_heat, melting, phase, mass, rest_density, conductivity,
    heat_capacity, melted,
):  # fmt: skip
    """melted (S,): 1 for nodes that become liquid; their number; phase 0; what they are made of (M13).

    As "water" they have mass rho_w V_min [kg], rest density rho_w [kg/m^3], conductivity [W/(m K)] and heat capacity
    [J/(kg K)] of water; otherwise all are kept.
    """
    ready = ref.melts(np.asarray(phase), np.asarray(temperature), np.asarray(melting_point))
    if enthalpy is not None:
        ready &= ref.has_taken_up(np.asarray(enthalpy), np.asarray(latent_heat))
    by_node = np.zeros(len(ready), int)
    by_node[np.asarray(identity)] = ready
    made = {
        "mass": (mass, melting.liquid_mass), "rest_density": (rest_density, melting.liquid_density),
        "conductivity": (conductivity, melting.liquid_conductivity),
        "heat_capacity": (heat_capacity, melting.liquid_heat_capacity),
    }  # fmt: skip
    kept = ~(ready & bool(melting.into_liquid))
    made = {n: np.where(kept, np.asarray(own, float), float(of)) for n, (own, of) in made.items() if own is not None}
    return {
        "melted": certain(by_node[: len(melted)]), "melted_count": certain(np.array([ready.sum()])),
        "phase": certain(np.where(ready, ref.FLUID, phase)), **{name: (v, 0 * v) for name, v in made.items()},
    }  # fmt: skip


@operation("Shao & Song, section 2 and figure 3, with M16 to M18", outputs="direct rebuild", exact="direct rebuild")
def detach(melted, melted_count, region, direct):
    """Direct neighbours that are left, and flags of the regions that are rebuilt."""
    gone = np.asarray(melted) != 0
    rebuild = ref.rebuilt(np.asarray(region), gone).astype(int)
    return {"direct": certain(ref.detached(np.asarray(direct), gone)), "rebuild": certain(rebuild)}
