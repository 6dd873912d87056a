"""Operations of one-way coupling."""

import numpy as np

from refsim.boundary.one_way_coupling import reference as ref
from refsim.core.operation import SYMMETRY, operation
from refsim.motion.operations import felt
from refsim.neighbours.sums import Fields, neighbours, wall_particles
from refsim.sph.operations import moving


@operation(
    "patent P6, viscous force, with E30", paper="patent CN104318598A, 2014; Akinci et al. 2012", adds="acceleration",
    variants=("wall_motion period", "", "wall_motion"), tolerance=8.0,
    reason="one rounding in each of distance, Laplacian, mass, product and sum, and the squared density",
    invariants=SYMMETRY, broken={1: "translation rotation", 2: "rotation"},
)  # fmt: skip
def wall_viscosity(
    position, velocity, density, walls, smoothing, fluid, wall_viscosity, wall_motion=None, period=None, rows=None
):
    """Acceleration [m/s^2] by walls at rest, or that move by `wall_motion` beyond its planes."""
    i = Fields(position=position, velocity=velocity, density=density)
    b = wall_particles(walls, fluid, velocity=moving(walls, wall_motion))
    at_walls = neighbours(i, b, smoothing, period=period, rows=rows)
    return {"acceleration": at_walls(ref.wall_viscous_force, mu=wall_viscosity.coefficient)}


@operation(
    "patent P6, pressure, with E30", "one_way_coupling.wall_pressure",
    paper="patent CN104318598A, 2014; Adami, Hu & Adams 2012", adds="acceleration", variants=("turning", ""),
    tolerance=16.0,
    reason="as sph.pressure, with the roundings of a mean of the liquid's pressure and of its extrapolation to the"
    " wall",
    invariants="translation reordering", broken={1: "translation"},
)  # fmt: skip
def extrapolated_wall_pressure(position, density, pressure, walls, smoothing, fluid, lean, turning=None, rows=None):
    """Acceleration [m/s^2] by the pressure that the liquid's extrapolates to."""
    still = Fields(position=position, velocity=np.zeros_like(position))
    i = Fields(position=position, density=density, pressure=pressure, felt=felt(still, lean, turning))
    around = neighbours(i, i, smoothing, rows=rows)
    mean = around(ref.pressure_and_head) / around(ref.weight)
    inner = Fields(position=around.i.position, density=around.i.density, felt=around.i.felt, mean=mean)
    at_walls = neighbours(inner, wall_particles(walls, fluid), smoothing)
    given = {"s": float(fluid.gradient_share), "rho0": float(fluid.rest_density), "clamp": float(fluid.clamp)}
    return {"acceleration": at_walls(ref.extrapolated_pressure_force, **given)}
