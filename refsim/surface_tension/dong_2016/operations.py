"""Operations of Dong et al. 2016; arrays position, velocity, normals (n, 3); mass, density, pressure (n,); SI."""

from refsim.core.operation import SYMMETRY, operations
from refsim.neighbours.sums import Fields, neighbours, wall_particles
from refsim.sph.operations import fused_with_momentum
from refsim.surface_tension.dong_2016 import reference as ref

operation = operations(paper="Dong, Zhang & Chen 2016")


@operation(
    "D(3)", outputs="number_density density", optional="number_density walls", invariants=SYMMETRY, packed="number_pair"
)
def density(position, mass, walls, smoothing, fluid, rows=None):
    """Densities m_i delta_i [kg/m^dim] and number densities delta_i [1/m^dim], i itself included."""
    i = Fields(position=position, mass=mass)
    around, at_walls = (neighbours(i, j, smoothing, rows=rows) for j in (i, wall_particles(walls, fluid)))
    number = around(ref.number_density) + at_walls(ref.number_density_at_walls)
    return {"density": ref.density(around.i, number), "number_density": number}


@operation(
    "D(4), D(5)", adds="acceleration", optional="walls viscosity", tolerance=12.0,
    reason="one rounding in each of distance, slope, two squared volumes, quotients, product and sum; the size"
    " counts V_i^2 |p_i| and V_j^2 |p_j|",
    invariants=f"{SYMMETRY} linear_momentum angular_momentum galilean dissipation",
    broken={0: "dissipation", 1: "angular_momentum"}, packed="momentum_pair",
)  # fmt: skip
def momentum(position, velocity, mass, density, pressure, walls, smoothing, fluid, viscosity, rows=None):
    """Acceleration [m/s^2] by pressure, that of walls (Akinci et al. 2012) and viscosity."""
    i = Fields(position=position, velocity=velocity, mass=mass, density=density, pressure=pressure)
    around, at_walls = (neighbours(i, j, smoothing, rows=rows) for j in (i, wall_particles(walls, fluid)))
    a = around(ref.pressure_force) + at_walls(ref.wall_pressure_force, s=fluid.gradient_share, k=fluid.wall_share)
    if viscosity is not None:
        a += around.others(ref.viscous_force, mu=viscosity.coefficient)
    return {"acceleration": a}


@operation(
    "D(6), D(7); D(8) to D(11) with Dong E21", adds="acceleration",
    variants=("normal_correction surface_normal", "", "molecular_force"), tolerance=12.0,
    reason="one rounding in each of distance, powers, kernel, quotients, product and sum",
    invariants=f"{SYMMETRY} linear_momentum angular_momentum", broken={1: "angular_momentum", 2: "angular_momentum"},
    programs=fused_with_momentum(
        "period", "normal_correction surface_normal walls period", own_smoothing=True
    ),
    packed="tension_pair",
)  # fmt: skip
def tension(position, mass, density, surface_normal, smoothing, molecular_force, normal_correction, rows=None):
    """Acceleration F/m [m/s^2] by pair force and correction, each unless None; surface_normal = h n_i."""
    i = Fields(position=position, mass=mass, density=density, normal=surface_normal)
    around, a = neighbours(i, i, smoothing, rows=rows).others, 0.0
    if molecular_force is not None:
        a = around(ref.molecular_force, k=molecular_force.stiffness, d0=molecular_force.rest_distance)
    if normal_correction is not None:
        of = {"lam": normal_correction.coefficient, "symmetric": bool(normal_correction.symmetric)}
        a = a + around(ref.normal_correction, **of)
    return {"acceleration": a}
