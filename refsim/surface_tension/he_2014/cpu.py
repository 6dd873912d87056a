"""CPU kernels of He et al. 2014."""

from refsim.backends.compile import cpu_kernel, prange
from refsim.neighbours.rows import cpu_row
from refsim.sph.kernels import wall_sum
from refsim.surface_tension.he_2014 import particle


@cpu_kernel
def color(position, mass, density, neighbours, walls, smoothing, color):
    """c_i, walls counted as liquid."""
    for i in prange(color.shape[0]):
        c = particle.color(i, cpu_row(neighbours, i), position, mass, density, neighbours.entries, smoothing)
        if walls is not None:
            c += wall_sum(i, position, walls, smoothing)
        color[i] = c


@cpu_kernel
def squared_gradient(position, mass, density, color, neighbours, gradient_smoothing, color_gradient_squared):
    """|grad c_i|^2."""
    for i in prange(color_gradient_squared.shape[0]):
        color_gradient_squared[i] = particle.squared_gradient(
            i, cpu_row(neighbours, i), position, mass, density, color, neighbours.entries, gradient_smoothing
        )


@cpu_kernel
def tension(
    position, mass, density, color_gradient_squared, neighbours, gradient_smoothing, surface_energy, air_pressure,
    acceleration,
):  # fmt: skip
    """Surface energy and air pressure; added to the acceleration."""
    for i in prange(acceleration.shape[0]):
        ax, ay, az = particle.tension(
            i, cpu_row(neighbours, i), position, mass, density, color_gradient_squared, neighbours.entries,
            gradient_smoothing, surface_energy, air_pressure,
        )  # fmt: skip
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az
