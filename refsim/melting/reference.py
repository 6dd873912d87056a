"""NumPy oracle of melting."""

import numpy as np

from refsim.core.operation import operations

operation = operations(paper="Shao & Song 2017")

FLUID, SURFACE = 0, 1
EMPTY = -1


@operation(
    "Shao & Song, section 2: T >= T_melt at surfaces, with M12, M13",
    outputs="melted mass rest_density conductivity heat_capacity phase melted_count", exact="melted melted_count phase",
    optional="enthalpy latent_heat conductivity heat_capacity", reason="copies",
)  # fmt: skip
def melt(
    identity, temperature, enthalpy, melting_point, latent_heat, melting, phase, mass, rest_density, conductivity,
    heat_capacity, melted,
):  # fmt: skip
    """M = {i at a body's surface, T_i >= Tm_i [deg C] (with latent heat: H_i >= Lh_i [J/kg])} becomes liquid.

    melted (S,): 1 for nodes in M; melted_count (1,): number of M; phase 0 in M. Bookkeeping (Shao & Song M13): as
    "water" mass = rho_w V_min [kg], rest density rho_w [kg/m^3], conductivity [W/(m K)] and heat capacity [J/(kg K)] of
    water in M; otherwise all are kept.
    """
    phase, mass, rho = np.array(phase), np.array(mass, dtype=float), np.array(rest_density, dtype=float)
    ready = (phase == SURFACE) & (np.asarray(temperature) >= np.asarray(melting_point))
    if enthalpy is not None:
        ready &= np.asarray(enthalpy) >= np.asarray(latent_heat)
    by_node = np.zeros(len(phase), int)
    by_node[np.asarray(identity)] = ready
    phase[ready] = FLUID
    materials = {"mass": mass, "rest_density": rho}
    for name, values in (("conductivity", conductivity), ("heat_capacity", heat_capacity)):
        if values is not None:
            materials[name] = np.array(values, dtype=float)
    if melting.into_liquid:
        liquid = {
            "mass": melting.liquid_mass, "rest_density": melting.liquid_density,
            "conductivity": melting.liquid_conductivity, "heat_capacity": melting.liquid_heat_capacity,
        }  # fmt: skip
        for name, values in materials.items():
            values[ready] = float(liquid[name])
    melted, count = by_node[: len(melted)], np.array([ready.sum()])
    return {
        "melted": (melted, np.full(melted.shape, np.inf)),
        "melted_count": (count, np.full(1, np.inf)),
        "phase": (phase, np.full(phase.shape, np.inf)),
        **{name: (values, 0 * values) for name, values in materials.items()},
    }


@operation("Shao & Song, section 2 and figure 3, with M16 to M18", outputs="direct rebuild", exact="direct rebuild")
def detach(melted, melted_count, region, direct):
    """direct = -1 in every slot of a melted node and in every slot that holds one (Shao & Song M16).

    rebuild: flag of the regions that held a melted node and are rebuilt (Shao & Song M17).
    """
    gone = np.append(np.asarray(melted), 0) != 0  # the last one stands for empty slots, -1
    direct = np.where(gone[np.asarray(direct)], EMPTY, direct)
    direct[gone[:-1]] = EMPTY
    rebuild = gone[np.asarray(region)].any(1).astype(int)
    return {"direct": (direct, np.full(direct.shape, np.inf)), "rebuild": (rebuild, np.full(rebuild.shape, np.inf))}
