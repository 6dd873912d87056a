"""CPU kernels of implicit incompressible SPH, and their iteration."""

from refsim.backends.compile import cpu_kernel, prange
from refsim.neighbours.rows import cpu_row
from refsim.sph.iisph import formulas, particle


@cpu_kernel
def predict(
    position, velocity, mass, density, acceleration, neighbours, walls, smoothing, fluid, timestep, own_displacement,
    diagonal, advected_density,
):  # fmt: skip
    """d_ii, a_ii and rho_adv."""
    for i in prange(advected_density.shape[0]):
        gx, gy, gz, squares, flow = particle.predict(
            i, cpu_row(neighbours, i), position, velocity, mass, acceleration, neighbours.entries, smoothing, timestep
        )
        kick, drift = timestep[0], timestep[1]
        if walls is not None:
            bx, by, bz = particle.wall_gradient(i, cpu_row(walls, i), position, walls, smoothing, fluid)
            flow += bx * (velocity[i, 0] + kick * acceleration[i, 0])
            flow += by * (velocity[i, 1] + kick * acceleration[i, 1])
            flow += bz * (velocity[i, 2] + kick * acceleration[i, 2])
            gx += bx
            gy += by
            gz += bz
        rho = density[i]
        share = -kick * drift / (rho * rho)
        own_displacement[i, 0] = share * gx
        own_displacement[i, 1] = share * gy
        own_displacement[i, 2] = share * gz
        diagonal[i] = formulas.diagonal(gx * gx + gy * gy + gz * gz, squares, rho, kick * drift)
        advected_density[i] = rho + drift * flow


@cpu_kernel
def displace(position, mass, density, pressure, neighbours, smoothing, timestep, pair_displacement):
    """s_i = sum_j d_ij p_j."""
    for i in prange(pair_displacement.shape[0]):
        sx, sy, sz = particle.displace(
            i, cpu_row(neighbours, i), position, mass, density, pressure, neighbours.entries, smoothing
        )
        square = timestep[0] * timestep[1]
        pair_displacement[i, 0] = square * sx
        pair_displacement[i, 1] = square * sy
        pair_displacement[i, 2] = square * sz


@cpu_kernel
def relax(
    position, mass, density, pressure, own_displacement, pair_displacement, diagonal, advected_density, neighbours,
    walls, smoothing, fluid, implicit, timestep, density_error, new_pressure,
):  # fmt: skip
    """One Jacobi step, and the compression that the pressures of before leave."""
    for i in prange(new_pressure.shape[0]):
        square = timestep[0] * timestep[1]
        total = particle.compress(
            i, cpu_row(neighbours, i), position, mass, density, pressure, own_displacement, pair_displacement,
            neighbours.entries, smoothing, square,
        )  # fmt: skip
        if walls is not None:
            bx, by, bz = particle.wall_gradient(i, cpu_row(walls, i), position, walls, smoothing, fluid)
            total += bx * pair_displacement[i, 0] + by * pair_displacement[i, 1] + bz * pair_displacement[i, 2]
        missing = fluid.rest_density - advected_density[i]
        p, a = pressure[i], diagonal[i]
        left = total + a * p - missing
        density_error[i] = max(left, left - left)  # a NaN stays
        new_pressure[i] = formulas.relaxed_pressure(p, missing, total, a, implicit, square)


@cpu_kernel
def push(position, mass, density, pressure, neighbours, walls, smoothing, fluid, acceleration):
    """Pressure force; added to the acceleration."""
    for i in prange(acceleration.shape[0]):
        ax, ay, az = particle.push(
            i, cpu_row(neighbours, i), position, mass, density, pressure, neighbours.entries, smoothing
        )
        if walls is not None:
            bx, by, bz = particle.wall_gradient(i, cpu_row(walls, i), position, walls, smoothing, fluid)
            share = pressure[i] / (density[i] * density[i])
            ax -= share * bx
            ay -= share * by
            az -= share * bz
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az


@cpu_kernel
def halve(pressure):
    """p <- p/2, the start of the next solution."""
    for i in prange(pressure.shape[0]):
        pressure[i] = pressure[i] / (pressure.dtype.type(1) + pressure.dtype.type(1))


@cpu_kernel
def keep(new_pressure, pressure):
    """p <- the relaxed p."""
    for i in prange(pressure.shape[0]):
        pressure[i] = new_pressure[i]


def _mean(values):
    """Mean of an array; 0 of none."""
    return float(values.mean()) if len(values) else 0.0


def solve(
    position, velocity, mass, density, neighbours, walls, smoothing, fluid, implicit, timestep, own_displacement,
    diagonal, advected_density, pair_displacement, density_error, new_pressure, pressure, acceleration,
):  # fmt: skip
    """Iterate the pressures until the mean compression is small, then push; at least `least`, at most `most` times."""
    predict(
        position, velocity, mass, density, acceleration, neighbours, walls, smoothing, fluid, timestep,
        own_displacement, diagonal, advected_density,
    )  # fmt: skip
    halve(pressure)
    allowed = float(implicit.tolerance) * float(fluid.rest_density)
    for count in range(1, int(implicit.most) + 1):
        displace(position, mass, density, pressure, neighbours, smoothing, timestep, pair_displacement)
        relax(
            position, mass, density, pressure, own_displacement, pair_displacement, diagonal, advected_density,
            neighbours, walls, smoothing, fluid, implicit, timestep, density_error, new_pressure,
        )  # fmt: skip
        keep(new_pressure, pressure)
        if count >= int(implicit.least) and not _mean(density_error) > allowed:
            break
    push(position, mass, density, pressure, neighbours, walls, smoothing, fluid, acceleration)
