"""Solution of the pressure equation by relaxed Jacobi iteration: the launches, on either backend."""

from refsim.sph.iisph.kernels import displace, halve, keep, predict, push, relax


def solve(
    position, velocity, mass, density, neighbours, walls, smoothing, fluid, implicit, timestep, own_displacement,
    diagonal, advected_density, pair_displacement, density_error, new_pressure, pressure, acceleration,
):  # fmt: skip
    """Relax the pressures until the mean compression is at most `tolerance` rho0, then add their acceleration.

    At least `least` and at most `most` iterations.
    """
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


def _mean(values):
    """Mean of an array on either backend; 0 of none."""
    here = values.copy_to_host() if hasattr(values, "copy_to_host") else values
    return float(here.mean()) if len(here) else 0.0
