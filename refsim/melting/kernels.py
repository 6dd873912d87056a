"""What one particle and one node do in melting."""

from refsim.backends.compile import formula, kernel
from refsim.backends.runtime import simulated
from refsim.melting.formulas import melts
from refsim.neighbours.rows import first_lane, lane_slots, over_lanes
from refsim.shape_matching.phases import EMPTY, FLUID, SURFACE

LANES = 1 if simulated() else 8  # CUDA threads that share a node; the simulator has no shuffles


@formula
def melted_now(
    i, identity, temperature, enthalpy, melting_point, latent_heat, melting, melted, mass, rest_density, conductivity,
    heat_capacity, phase,
):  # fmt: skip
    """Melt particle i if it is at a body's surface and hot enough; returns whether it melted.

    The decision takes the particle's own values only, so it does not depend on the order of the particles.
    """
    gone = phase[i] == SURFACE and melts(temperature[i], melting_point[i])
    if enthalpy is not None:
        gone = gone and enthalpy[i] >= latent_heat[i]
    if identity[i] < melted.shape[0]:
        melted[identity[i]] = gone
    if gone:
        phase[i] = FLUID
        if melting.into_liquid:
            mass[i] = melting.liquid_mass
            rest_density[i] = melting.liquid_density
            if conductivity is not None:
                conductivity[i] = melting.liquid_conductivity
            if heat_capacity is not None:
                heat_capacity[i] = melting.liquid_heat_capacity
    return gone


@kernel(lanes=LANES)
def detach(s, lane, melted, melted_count, region, direct, rebuild):
    """Remove melted nodes from the direct neighbours of node s; rebuild is a flag, 1 if one was in its region."""
    start, step = lane_slots(lane)
    held = 0
    if melted_count[0] > 0:
        for slot in range(start, 27, step):
            other = direct[s, slot]
            if other != EMPTY and (melted[s] or melted[other]):
                direct[s, slot] = EMPTY
        for slot in range(start, region.shape[1], step):
            other = region[s, slot]
            if other != EMPTY and melted[other]:
                held = 1
    held = over_lanes(held, lane)
    if first_lane(lane):
        rebuild[s] = 1 if held > 0 else 0
