"""CPU kernels of two-way coupling."""

from refsim.backends.compile import cpu_kernel, prange
from refsim.boundary.two_way_coupling import particle
from refsim.boundary.two_way_coupling.formulas import tait_pressure
from refsim.neighbours.rows import cpu_row
from refsim.shape_matching.phases import FLUID, INTERIOR
from refsim.sph.kernels import own_share, wall_sum


@cpu_kernel
def contribution(position, phase, neighbours, smoothing, coupling, relative_contribution):
    """phi of (1)."""
    for i in prange(relative_contribution.shape[0]):
        row = cpu_row(neighbours, i)
        total = particle.solid_sum(i, row, position, phase, neighbours.entries, smoothing, coupling)
        relative_contribution[i] = particle.contribution(i, total, phase, smoothing, coupling)


@cpu_kernel
def density(
    position, mass, rest_density, phase, relative_contribution, neighbours, walls, smoothing, coupling,
    density, pressure, volume,
):  # fmt: skip
    """(1), Tait, and V = m/rho; solids keep their rest density and have no pressure."""
    for i in prange(volume.shape[0]):
        rho = rest_density[i]
        p = type(rho)(0)
        if phase[i] == FLUID:
            row = cpu_row(neighbours, i)
            total = particle.weighted_sum(i, row, position, relative_contribution, neighbours.entries, smoothing)
            rho = mass[i] * (total + relative_contribution[i] * own_share(smoothing))
            if walls is not None:
                rho += rest_density[i] * wall_sum(i, position, walls, smoothing)
            p = tait_pressure(rho, rest_density[i], coupling)
        density[i] = rho
        pressure[i] = p
        volume[i] = mass[i] / rho


@cpu_kernel
def forces(
    position, velocity, mass, density, rest_density, phase, pressure, volume, relative_contribution, neighbours, walls,
    smoothing, coupling, viscosity, acceleration,
):  # fmt: skip
    """(2) and (3) with the reaction, and the liquid's own forces; added to the acceleration."""
    for i in prange(acceleration.shape[0]):
        if phase[i] != INTERIOR:
            fx, fy, fz = particle.force(
                i, cpu_row(neighbours, i), position, velocity, mass, phase, pressure, volume, relative_contribution,
                neighbours.entries, smoothing, coupling, viscosity,
            )  # fmt: skip
            ax, ay, az = fx / mass[i], fy / mass[i], fz / mass[i]
            if walls is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
                if phase[i] == FLUID:
                    bx, by, bz = particle.wall_pressure(i, position, density, rest_density, pressure, walls, smoothing)
                    ax += bx
                    ay += by
                    az += bz
            acceleration[i, 0] += ax
            acceleration[i, 1] += ay
            acceleration[i, 2] += az
