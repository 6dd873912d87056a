"""What one particle and one node do in melting; the CPU and the CUDA kernels share these."""

from refsim.backends.compile import formula
from refsim.melting.formulas import melts
from refsim.shape_matching.phases import FLUID, NOBODY, SURFACE


@formula
def melt(
    i, identity, temperature, enthalpy, melting_point, latent_heat, melting, melted, mass, rest_density, conductivity,
    heat_capacity, phase,
):  # fmt: skip
    """Melt particle i if it is at a body's surface and hot enough; whether it was. Decided by its own values alone."""
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


@formula
def detach(s, lane, lanes, melted, melted_count, region, direct):
    """Take melted nodes out of the direct neighbours of node s; 1 if one was in its region, else 0.

    A lane looks at its share of the slots, one out of as many as there are lanes.
    """
    held = 0
    if melted_count[0] > 0:
        for slot in range(lane, 27, lanes):
            other = direct[s, slot]
            if other != NOBODY and (melted[s] or melted[other]):
                direct[s, slot] = NOBODY
        for slot in range(lane, region.shape[1], lanes):
            other = region[s, slot]
            if other != NOBODY and melted[other]:
                held = 1
    return held
