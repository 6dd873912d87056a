"""CPU kernels of weakly compressible SPH."""

import math

from refsim.backends.compile import cpu_kernel, prange
from refsim.neighbours.rows import cpu_row
from refsim.sph import formulas, particle


@cpu_kernel
def density(position, mass, neighbours, walls, smoothing, fluid, number_density, asymmetry, density):
    """J(7); J(8) where `number_density` is wanted, and the length of the first moment where `asymmetry` is."""
    for i in prange(density.shape[0]):
        rho, number, moment = particle.kernel_sums(
            i, cpu_row(neighbours, i), position, mass, neighbours.entries, smoothing, asymmetry
        )
        mx, my, mz = moment
        own = particle.own_share(smoothing)
        rho += mass[i] * own
        number += own
        if walls is not None:
            filled = fluid.rest_density * particle.wall_sum(i, cpu_row(walls, i), position, walls, smoothing)
            rho += filled
            number += filled / mass[i]
            if asymmetry is not None:
                bx, by, bz = particle.wall_moment(i, cpu_row(walls, i), position, walls, smoothing)
                weight = fluid.rest_density / mass[i]
                mx += weight * bx
                my += weight * by
                mz += weight * bz
        density[i] = rho
        if number_density is not None:
            number_density[i] = number
        if asymmetry is not None:
            asymmetry[i] = math.sqrt(mx * mx + my * my + mz * mz)


@cpu_kernel
def state(density, fluid, pressure):
    """J(9) or Tait."""
    for i in prange(pressure.shape[0]):
        pressure[i] = formulas.state_pressure(density[i], fluid)


@cpu_kernel
def momentum(position, velocity, mass, density, pressure, neighbours, walls, smoothing, fluid, viscosity, acceleration):
    """J(10) and J(11), walls after Akinci 2012; added to the acceleration."""
    for i in prange(acceleration.shape[0]):
        ax, ay, az = particle.momentum(
            i,
            cpu_row(neighbours, i),
            position,
            velocity,
            mass,
            density,
            pressure,
            neighbours.entries,
            smoothing,
            fluid,
            viscosity,
        )
        if walls is not None:
            bx, by, bz = particle.wall_pressure(
                i, cpu_row(walls, i), position, density, pressure, walls, smoothing, fluid
            )
            ax += bx
            ay += by
            az += bz
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az


@cpu_kernel
def viscous(position, velocity, mass, density, neighbours, smoothing, viscosity, acceleration):
    """J(11); added to the acceleration."""
    for i in prange(acceleration.shape[0]):
        ax, ay, az = particle.viscous(
            i, cpu_row(neighbours, i), position, velocity, mass, density, neighbours.entries, smoothing, viscosity
        )
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az


@cpu_kernel
def central_viscous(position, velocity, mass, density, neighbours, smoothing, central_viscosity, acceleration):
    """Viscosity along the line of centres; added to the acceleration."""
    for i in prange(acceleration.shape[0]):
        ax, ay, az = particle.central_viscous(
            i, cpu_row(neighbours, i), position, velocity, mass, density, neighbours.entries, smoothing,
            central_viscosity,
        )  # fmt: skip
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az


@cpu_kernel
def gravity(field, acceleration):
    """Uniform acceleration."""
    for i in prange(acceleration.shape[0]):
        for c in range(3):
            acceleration[i, c] += field[c]


@cpu_kernel
def extremes(velocity, acceleration, temperature, temperature_range, exchange_rate, extremes):
    """Largest |v|^2 and |a|^2, number of particles where a value is not finite, largest rate and way out of range."""
    speed = extremes.dtype.type(0)
    force = extremes.dtype.type(0)
    rate = extremes.dtype.type(0)
    excess = extremes.dtype.type(0)
    broken = 0
    for i in prange(velocity.shape[0]):
        s, f, r, e, bad = particle.squares(i, velocity, acceleration, temperature, temperature_range, exchange_rate)
        speed = max(speed, s)
        force = max(force, f)
        rate = max(rate, r)
        excess = max(excess, e)
        broken += bad
    extremes[0] = speed
    extremes[1] = force
    extremes[2] = broken
    extremes[3] = rate
    extremes[4] = excess


@cpu_kernel
def kick_drift(acceleration, build_position, bounds, timestep, displacement, velocity, position):
    """Leap-frog step; `displacement` is the largest squared way since the list [m^2] and the number of particles
    that a wall's plane stopped."""
    largest = displacement.dtype.type(0)
    stopped = 0
    for i in prange(position.shape[0]):
        squared, hit = particle.kick_drift(i, position, velocity, acceleration, build_position, bounds, timestep)
        largest = max(largest, squared)
        stopped += hit
    displacement[0] = largest
    displacement[1] = stopped
