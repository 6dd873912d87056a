"""CUDA kernels of two-way coupling."""

from refsim.backends.compile import cuda, cuda_kernel
from refsim.boundary.two_way_coupling import particle
from refsim.boundary.two_way_coupling.formulas import tait_pressure
from refsim.neighbours.rows import cuda_lane, cuda_lane_row, cuda_share_row, lanes_sum
from refsim.shape_matching.phases import FLUID, INTERIOR
from refsim.sph.kernels import own_share, wall_sum


@cuda_kernel(lanes=True)
def contribution(position, phase, neighbours, smoothing, coupling, relative_contribution):
    """phi of (1)."""
    i, lane = cuda_lane(cuda.grid(1), neighbours)
    if i < relative_contribution.shape[0]:
        row = cuda_lane_row(neighbours, i, lane)
        total = particle.solid_sum(i, row, position, phase, neighbours.entries, smoothing, coupling)
        total = lanes_sum(total, lane, neighbours)
        if lane == 0:
            relative_contribution[i] = particle.contribution(i, total, phase, smoothing, coupling)


@cuda_kernel(lanes=True)
def density(
    position, mass, rest_density, phase, relative_contribution, neighbours, walls, smoothing, coupling,
    density, pressure, volume,
):  # fmt: skip
    """(1), Tait, and V = m/rho; solids keep their rest density and have no pressure."""
    i, lane = cuda_lane(cuda.grid(1), neighbours)
    if i < volume.shape[0]:
        rho = rest_density[i]
        p = type(rho)(0)
        if phase[i] == FLUID:
            row = cuda_lane_row(neighbours, i, lane)
            total = particle.weighted_sum(i, row, position, relative_contribution, neighbours.entries, smoothing)
            total = lanes_sum(total, lane, neighbours)
            rho = mass[i] * (total + relative_contribution[i] * own_share(smoothing))
            if walls is not None:
                filled = wall_sum(i, position, walls, smoothing, (lane, len(neighbours.lanes)))
                rho += rest_density[i] * lanes_sum(filled, lane, neighbours)
            p = tait_pressure(rho, rest_density[i], coupling)
        if lane == 0:
            density[i] = rho
            pressure[i] = p
            volume[i] = mass[i] / rho


@cuda_kernel(lanes=True)
def forces(
    position, velocity, mass, density, rest_density, phase, pressure, volume, relative_contribution, neighbours, walls,
    smoothing, coupling, viscosity, acceleration,
):  # fmt: skip
    """(2) and (3) with the reaction, and the liquid's own forces; added to the acceleration."""
    i, lane = cuda_lane(cuda.grid(1), neighbours)
    if i < acceleration.shape[0] and phase[i] != INTERIOR:
        fx, fy, fz = particle.force(
            i, cuda_lane_row(neighbours, i, lane), position, velocity, mass, phase, pressure, volume,
            relative_contribution, neighbours.entries, smoothing, coupling, viscosity,
        )  # fmt: skip
        ax, ay, az = fx / mass[i], fy / mass[i], fz / mass[i]
        if walls is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
            if phase[i] == FLUID:
                row = cuda_share_row(walls, i, lane, len(neighbours.lanes))
                bx, by, bz = particle.wall_pressure(i, row, position, density, rest_density, pressure, walls, smoothing)
                ax += bx
                ay += by
                az += bz
        ax, ay, az = lanes_sum(ax, lane, neighbours), lanes_sum(ay, lane, neighbours), lanes_sum(az, lane, neighbours)
        if lane == 0:
            acceleration[i, 0] += ax
            acceleration[i, 1] += ay
            acceleration[i, 2] += az
