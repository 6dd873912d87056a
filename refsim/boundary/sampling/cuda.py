"""CUDA kernels of boundary sampling."""

from refsim.backends.compile import cuda, cuda_kernel
from refsim.boundary.sampling import particle
from refsim.neighbours.rows import cuda_row


@cuda_kernel
def areas(facet_corner, facets_of_mesh, facet_area):
    """Area of every facet."""
    f = cuda.grid(1)
    if f < facet_area.shape[0]:
        facet_area[f] = particle.area(f, facet_corner, facets_of_mesh)


@cuda_kernel
def place(facet_corner, facets_of_mesh, facet_last, sample_seed, placed):
    """Places of the particles before the relaxation."""
    i = cuda.grid(1)
    if i < placed.shape[0]:
        x, y, z = particle.place(i, facet_corner, facets_of_mesh, facet_last, sample_seed)
        placed[i, 0], placed[i, 1], placed[i, 2] = x, y, z


@cuda_kernel
def relax(position, neighbours, distance_field, relaxation, relaxed_position, way):
    """One step of the relaxation."""
    i = cuda.grid(1)
    if i < way.shape[0]:
        row = cuda_row(neighbours, i)
        x, y, z, length, _ = particle.relax(i, row, position, neighbours.entries, distance_field, relaxation, -1)
        relaxed_position[i, 0], relaxed_position[i, 1], relaxed_position[i, 2] = x, y, z
        way[i] = length
