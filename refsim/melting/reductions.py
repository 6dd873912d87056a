"""CPU kernels of melting."""

from refsim.backends.compile import cpu_kernel, prange
from refsim.melting import particle


@cpu_kernel
def melt(
    identity,
    temperature,
    enthalpy,
    melting_point,
    latent_heat,
    melting,
    melted,
    melted_count,
    mass,
    rest_density,
    conductivity,
    heat_capacity,
    phase,
):
    """Melt what is hot at surfaces."""
    count = 0
    for i in prange(phase.shape[0]):
        count += particle.melt(
            i,
            identity,
            temperature,
            enthalpy,
            melting_point,
            latent_heat,
            melting,
            melted,
            mass,
            rest_density,
            conductivity,
            heat_capacity,
            phase,
        )
    melted_count[0] = count


@cpu_kernel
def detach(melted, melted_count, region, direct, rebuild):
    """Take melted nodes out of the tables; mark the regions to be filled anew."""
    for s in prange(rebuild.shape[0]):
        rebuild[s] = particle.detach(s, 0, 1, melted, melted_count, region, direct)
