"""Melting of all particles and their number on a CPU; `reductions_cuda` has the CUDA kernel."""

import numpy as np

from refsim.backends.chunks import CHUNKS, limits
from refsim.backends.compile import kernel
from refsim.melting.kernels import melted_now


def melt(
    identity, temperature, enthalpy, melting_point, latent_heat, melting, melted, melted_count, mass, rest_density,
    conductivity, heat_capacity, phase,
):  # fmt: skip
    """Melt the particles at surfaces that are hot enough; `melted_count` is their number."""
    partial = np.zeros(CHUNKS, np.int32)
    melt_chunk(
        identity, temperature, enthalpy, melting_point, latent_heat, melting, melted, mass, rest_density, conductivity,
        heat_capacity, phase, partial,
    )  # fmt: skip
    melted_count[0] = partial.sum()


@kernel
def melt_chunk(
    chunk, identity, temperature, enthalpy, melting_point, latent_heat, melting, melted, mass, rest_density,
    conductivity, heat_capacity, phase, partial,
):  # fmt: skip
    """Melt the particles of a chunk; their number."""
    begin, end = limits(chunk, phase.shape[0])
    count = 0
    for i in range(begin, end):
        count += melted_now(
            i, identity, temperature, enthalpy, melting_point, latent_heat, melting, melted, mass, rest_density,
            conductivity, heat_capacity, phase,
        )  # fmt: skip
    partial[chunk] = count
