"""What one particle and one node do in melting."""

from collections import namedtuple

from refsim.backends.compile import formula, kernel
from refsim.backends.reductions import reduction
from refsim.backends.runtime import simulated
from refsim.neighbours.rows import first_lane, lane_slots, over_lanes
from refsim.shape_matching.phases import EMPTY, FLUID, SURFACE

# What decides whether particles melt; without latent heat enthalpies and latent heats are None
Heated = namedtuple("Heated", "identity temperature enthalpy melting_point latent_heat")
# What melting changes of a particle; conductivity and heat capacity may be None
Molten = namedtuple("Molten", "mass rest_density conductivity heat_capacity phase")


@reduction(into="melted_count", how="count", rows="molten.phase")
def melt(i, heated: Heated, melting, melted, molten: Molten):
    """Melt particle i if it is at a body's surface and T_i >= Tm_i [deg C], by its own values; whether it melted."""
    gone = molten.phase[i] == SURFACE and heated.temperature[i] >= heated.melting_point[i]
    gone = gone and has_taken_up(i, heated.enthalpy, heated.latent_heat)
    if heated.identity[i] < melted.shape[0]:
        melted[heated.identity[i]] = gone
    if gone:
        molten.phase[i] = FLUID
        if melting.into_liquid:
            molten.mass[i] = melting.liquid_mass
            molten.rest_density[i] = melting.liquid_density
            set_if_there(i, melting.liquid_conductivity, molten.conductivity)
            set_if_there(i, melting.liquid_heat_capacity, molten.heat_capacity)
    return gone


@formula
def has_taken_up(i, enthalpy, latent_heat):
    """Whether particle i has the latent heat, where there is one."""
    if enthalpy is not None:
        return enthalpy[i] >= latent_heat[i]
    return True


@formula
def set_if_there(i, value, values):
    """values[i] = value, where there is such an array."""
    if values is not None:
        values[i] = value


@kernel(lanes=1 if simulated() else 4)
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
            if melted[max(other, 0)] and other != EMPTY:  # in this order, reads need not wait for each other
                held = 1
    held = over_lanes(held, lane)
    if first_lane(lane):
        rebuild[s] = 1 if held > 0 else 0
