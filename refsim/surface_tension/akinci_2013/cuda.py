"""CUDA kernels of Akinci et al. 2013."""

from refsim.backends.compile import cuda, cuda_kernel
from refsim.neighbours.rows import cuda_lane, cuda_lane_row, cuda_row, lanes_sum
from refsim.sph.kernels import wall_pressure
from refsim.surface_tension.akinci_2013 import particle


@cuda_kernel(lanes=True)
def tension(position, mass, density, area_normal, neighbours, smoothing, fluid, spline, area_term, acceleration):
    """Cohesion and area term with K_ij; added to the acceleration."""
    i, lane = cuda_lane(cuda.grid(1), neighbours)
    if i < acceleration.shape[0]:
        ax, ay, az = particle.tension(
            i, cuda_lane_row(neighbours, i, lane), position, mass, density, area_normal, neighbours.entries, smoothing,
            fluid, spline, area_term,
        )  # fmt: skip
        ax, ay, az = lanes_sum(ax, lane, neighbours), lanes_sum(ay, lane, neighbours), lanes_sum(az, lane, neighbours)
        if lane == 0:
            acceleration[i, 0] += ax
            acceleration[i, 1] += ay
            acceleration[i, 2] += az


@cuda_kernel(lanes=True)
def momentum(
    position, velocity, mass, density, pressure, area_normal, neighbours, walls, gradient_smoothing, fluid, viscosity,
    spline, area_term, acceleration,
):  # fmt: skip
    """Cohesion and area term, J(10) and J(11), walls after Akinci 2012; added to the acceleration."""
    i, lane = cuda_lane(cuda.grid(1), neighbours)
    if i < acceleration.shape[0]:
        ax, ay, az = particle.momentum(
            i, cuda_lane_row(neighbours, i, lane), position, velocity, mass, density, pressure, area_normal,
            neighbours.entries, gradient_smoothing, fluid, viscosity, spline, area_term,
        )  # fmt: skip
        if walls is not None:
            share = lane, len(neighbours.lanes)
            bx, by, bz = wall_pressure(i, position, density, pressure, walls, gradient_smoothing, fluid, share)
            ax += bx
            ay += by
            az += bz
        ax, ay, az = lanes_sum(ax, lane, neighbours), lanes_sum(ay, lane, neighbours), lanes_sum(az, lane, neighbours)
        if lane == 0:
            acceleration[i, 0] += ax
            acceleration[i, 1] += ay
            acceleration[i, 2] += az


@cuda_kernel
def adhesion(position, walls, smoothing, fluid, adhesion, acceleration):
    """Adhesion to wall particles; added to the acceleration."""
    i = cuda.grid(1)
    if i < acceleration.shape[0]:
        ax, ay, az = particle.adhesion(i, cuda_row(walls, i), position, walls, smoothing, fluid, adhesion)
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az
