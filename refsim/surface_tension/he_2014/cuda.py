"""CUDA kernels of He et al. 2014."""

from refsim.backends.compile import cuda, cuda_kernel
from refsim.neighbours.rows import cuda_row
from refsim.sph.kernels import wall_sum
from refsim.surface_tension.he_2014 import particle


@cuda_kernel
def color(position, mass, density, neighbours, walls, smoothing, color):
    """c_i, walls counted as liquid."""
    i = cuda.grid(1)
    if i < color.shape[0]:
        c = particle.color(i, cuda_row(neighbours, i), position, mass, density, neighbours.entries, smoothing)
        if walls is not None:
            c += wall_sum(i, position, walls, smoothing)
        color[i] = c


@cuda_kernel
def squared_gradient(position, mass, density, color, neighbours, gradient_smoothing, color_gradient_squared):
    """|grad c_i|^2."""
    i = cuda.grid(1)
    if i < color_gradient_squared.shape[0]:
        color_gradient_squared[i] = particle.squared_gradient(
            i, cuda_row(neighbours, i), position, mass, density, color, neighbours.entries, gradient_smoothing
        )


@cuda_kernel
def tension(
    position, mass, density, color_gradient_squared, neighbours, gradient_smoothing, surface_energy, air_pressure,
    acceleration,
):  # fmt: skip
    """Surface energy and air pressure; added to the acceleration."""
    i = cuda.grid(1)
    if i < acceleration.shape[0]:
        ax, ay, az = particle.tension(
            i, cuda_row(neighbours, i), position, mass, density, color_gradient_squared, neighbours.entries,
            gradient_smoothing, surface_energy, air_pressure,
        )  # fmt: skip
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az
