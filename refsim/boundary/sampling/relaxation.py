"""The relaxation on a CPU, where a thread takes successive particles and starts each look-up where the last one ended.

`kernels` has the CUDA kernel, whose threads take one particle each.
"""

from refsim.backends.compile import cpu_kernel, formula
from refsim.backends.rows import over_rows
from refsim.boundary.sampling.kernels import relaxed_particle

PART = 256  # successive particles of a thread


@formula(inlined=True)
def relax_part(part, position, neighbours, distance_field, relaxation, relaxed_position, step_length):
    """The particles of one part."""
    count = step_length.shape[0]
    block = -1  # successive particles of the sorted list lie in the same block of the field, or near it
    for i in range(part * PART, min((part + 1) * PART, count)):
        x, y, z, step_length[i], block = relaxed_particle(i, position, neighbours, distance_field, relaxation, block)
        relaxed_position[i, 0], relaxed_position[i, 1], relaxed_position[i, 2] = x, y, z


@cpu_kernel
def relax(position, neighbours, distance_field, relaxation, relaxed_position, step_length):
    """One step of the relaxation: new positions [m] and lengths of the steps [m]."""
    count = step_length.shape[0]
    parts = (count + PART - 1) // PART
    over_rows(relax_part, parts, (position, neighbours, distance_field, relaxation, relaxed_position, step_length))
