"""CUDA kernels of melting."""

from refsim.backends import device
from refsim.backends.compile import cuda, cuda_kernel
from refsim.backends.primitives import sum_of_lanes
from refsim.melting import particle
from refsim.shape_matching.kernels import LANES


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
    """Melt what is hot at surfaces. A count of whole numbers does not depend on the order in which they come."""
    device.fill(melted_count, 0)
    melt_and_count(
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
    )


@cuda_kernel
def melt_and_count(
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
    """Melt what is hot at surfaces, and count it."""
    i = cuda.grid(1)
    gone = False
    if i < phase.shape[0]:
        gone = particle.melt(
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
    count = cuda.syncthreads_count(1 if gone else 0)
    if cuda.threadIdx.x == 0 and count > 0:
        cuda.atomic.add(melted_count, 0, count)


@cuda_kernel(lanes=LANES)
def detach(melted, melted_count, region, direct, rebuild):
    """Take melted nodes out of the tables; mark the regions to be filled anew."""
    s, lane = cuda.grid(1) // LANES, cuda.grid(1) % LANES
    if s < rebuild.shape[0]:
        held = sum_of_lanes(particle.detach(s, lane, LANES, melted, melted_count, region, direct), lane, LANES)
        if lane == 0:
            rebuild[s] = held > 0
