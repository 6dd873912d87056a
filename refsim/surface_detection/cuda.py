"""CUDA kernels of surface detection."""

from refsim.backends.compile import cuda, cuda_kernel
from refsim.neighbours.rows import cuda_row
from refsim.surface_detection import formulas, particle


@cuda_kernel
def near_surface(number_density, asymmetry, near_surface_limit, near_surface):
    """J(12); where `asymmetry` is given, also who has neighbours on one side only (E23)."""
    i = cuda.grid(1)
    if i < near_surface.shape[0]:
        found = formulas.is_near_surface(number_density[i], near_surface_limit)
        if asymmetry is not None:
            found = found or formulas.is_lopsided(asymmetry[i], near_surface_limit)
        near_surface[i] = found


@cuda_kernel
def fan_scan(position, surface_normal, candidates, neighbours, walls, fan_scan, thin_feature, surface):
    """J(13); zero where a particle is no candidate. A normal without direction counts as an occupied region.

    Where `thin_feature` is given, a candidate in a thin neighbourhood is surface whatever the scan says (E20).
    """
    i = cuda.grid(1)
    if i < surface.shape[0]:
        near, occupied, thin = particle.ENOUGH, True, False
        if candidates is None or candidates[i] != 0:
            nx, ny, nz, directed = particle.unit(surface_normal, i, fan_scan.smallest_normal)
            near, occupied = particle.scan_row(
                i,
                cuda_row(neighbours, i),
                position,
                position,
                neighbours.entries,
                (nx, ny, nz),
                fan_scan,
                0,
                not directed,
            )
            if walls is not None:
                near, occupied = particle.scan_row(
                    i,
                    cuda_row(walls, i),
                    position,
                    walls.position,
                    walls.entries,
                    (nx, ny, nz),
                    fan_scan,
                    near,
                    occupied,
                )
            if thin_feature is not None and occupied and near >= particle.ENOUGH:
                sums = particle.moments_row(
                    i,
                    cuda_row(neighbours, i),
                    position,
                    position,
                    neighbours.entries,
                    fan_scan,
                    particle.own_moments(fan_scan),
                )
                if walls is not None:
                    sums = particle.moments_row(
                        i, cuda_row(walls, i), position, walls.position, walls.entries, fan_scan, sums
                    )
                thin = formulas.is_thin(*sums, thin_feature)
        surface[i] = near < particle.ENOUGH or not occupied or thin


@cuda_kernel
def release_pressure(surface, pressure):
    """p = 0 on S."""
    i = cuda.grid(1)
    if i < pressure.shape[0]:
        pressure[i] = formulas.released_pressure(pressure[i], surface[i])
