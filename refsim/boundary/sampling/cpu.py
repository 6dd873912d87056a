"""CPU kernels of boundary sampling."""

from refsim.backends.compile import cpu_kernel, prange
from refsim.boundary.sampling import particle
from refsim.neighbours.rows import cpu_row

PART = 256  # particles that a thread takes one after the other


@cpu_kernel
def areas(facet_corner, facets_of_mesh, facet_area):
    """Area of every facet."""
    for f in prange(facet_area.shape[0]):
        facet_area[f] = particle.area(f, facet_corner, facets_of_mesh)


@cpu_kernel
def place(facet_corner, facets_of_mesh, facet_last, sample_seed, placed):
    """Places of the particles before the relaxation."""
    for i in prange(placed.shape[0]):
        x, y, z = particle.place(i, facet_corner, facets_of_mesh, facet_last, sample_seed)
        placed[i, 0], placed[i, 1], placed[i, 2] = x, y, z


@cpu_kernel
def relax(position, neighbours, distance_field, relaxation, relaxed_position, way):
    """One step of the relaxation."""
    count = way.shape[0]
    for part in prange((count + PART - 1) // PART):
        block = -1  # neighbours in the list's order stand in the same block of the field, or near it
        for i in range(part * PART, min((part + 1) * PART, count)):
            row = cpu_row(neighbours, i)
            x, y, z, way[i], block = particle.relax(
                i, row, position, neighbours.entries, distance_field, relaxation, block
            )
            relaxed_position[i, 0], relaxed_position[i, 1], relaxed_position[i, 2] = x, y, z
