"""Melting of all particles and their number: one parallel loop; `reductions_cuda` has the CUDA kernel."""

from refsim.backends.compile import cpu_kernel, prange
from refsim.melting.kernels import melted_now


@cpu_kernel
def melt(
    identity, temperature, enthalpy, melting_point, latent_heat, melting, melted, melted_count, mass, rest_density,
    conductivity, heat_capacity, phase,
):  # fmt: skip
    """Melt the particles at surfaces that are hot enough; `melted_count` is their number."""
    count = 0
    for i in prange(phase.shape[0]):
        count += melted_now(
            i, identity, temperature, enthalpy, melting_point, latent_heat, melting, melted, mass, rest_density,
            conductivity, heat_capacity, phase,
        )  # fmt: skip
    melted_count[0] = count
