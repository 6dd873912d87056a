"""Operations of implicit incompressible SPH.

Arrays: position, velocity, acceleration, displacements (n, 3); the others (n,); SI units. `rows` picks particles.
"""

from refsim.core.operation import SYMMETRY, operations
from refsim.core.terms import Terms, where
from refsim.neighbours.sums import Fields, neighbours, wall_particles
from refsim.sph.iisph import reference as ref

operation = operations(paper="Ihmsen et al. 2014")


def _pairs(position, walls, smoothing, fluid, rows=None, **fields):
    """Pairs of liquid and of liquid and walls, whose fields lack positions."""
    i, b = Fields(position=position, **fields), wall_particles(walls, fluid, velocity=0.0)
    return (neighbours(i, j, smoothing, rows=rows) for j in (i, b))


def _predicted(around, at_walls, timestep):
    i, square, drift = around.i, float(timestep[0]) * float(timestep[1]), float(timestep[1])
    total = around(ref.gradients) + at_walls(ref.gradients)
    flow = around(ref.compression) + at_walls(ref.compression)
    return {
        "own_displacement": ref.own_displacement(i, total, square),
        "diagonal": ref.diagonal(i, total, around(ref.squares), square),
        "advected_density": i.density + drift * flow,
    }


def _relaxed(around, at_walls, fluid, implicit, timestep):
    i, square, rest = around.i, float(timestep[0]) * float(timestep[1]), float(fluid.rest_density)
    moved = around(ref.moved, square=square) + at_walls(ref.moved_at_walls)
    solved = ~(-i.diagonal.value <= float(implicit.least_diagonal) * square)
    diagonal = where(solved, i.diagonal, -1)
    pressure = ref.relaxed(i, moved, diagonal, rest, float(implicit.relaxation))
    return {"new_pressure": where(solved, pressure, 0), "density_error": ref.density_error(i, moved, rest)}


@operation(
    "d_ii, a_ii, rho_adv", outputs="own_displacement diagonal advected_density", optional="walls", tolerance=12.0,
    reason="distance, slope, mass, two velocities and their kicks in each term, and a square", invariants=SYMMETRY,
)  # fmt: skip
def predict(position, velocity, mass, density, acceleration, walls, smoothing, fluid, timestep, rows=None):
    """Coefficients d_ii [m/Pa] and a_ii [kg/(m^dim Pa)] of the pressure equation, and rho_adv [kg/m^dim].

    With t the kick and dt the drift of `timestep` in place of dt and dt (s = t dt).
    """
    v = ref.kicked(Fields(velocity=velocity, acceleration=acceleration), float(timestep[0]))
    around, at_walls = _pairs(position, walls, smoothing, fluid, rows, velocity=v, mass=mass, density=density)
    return _predicted(around, at_walls, timestep)


@operation(
    "sum_j d_ij p_j", outputs="pair_displacement", tolerance=12.0,
    reason="distance, slope, mass, pressure, density twice, direction, product, sum", invariants=SYMMETRY,
)  # fmt: skip
def displace(position, mass, density, pressure, smoothing, timestep, rows=None):
    """Displacements [m] by the pressures of the neighbours."""
    around, _ = _pairs(position, None, smoothing, None, rows, mass=mass, density=density, pressure=pressure)
    return {"pair_displacement": around(ref.displacement, square=float(timestep[0]) * float(timestep[1]))}


@operation(
    "pressure update", outputs="density_error new_pressure", optional="walls", tolerance=16.0,
    reason="four displacements, slope, direction and mass in each term, and the quotient by a_ii", invariants=SYMMETRY,
)  # fmt: skip
def relax(
    position, mass, density, pressure, own_displacement, pair_displacement, diagonal, advected_density, walls,
    smoothing, fluid, implicit, timestep, rows=None,
):  # fmt: skip
    """One Jacobi step: new pressures [Pa] and the compression [kg/m^dim] that those of before leave.

    The pressure is 0 where -a_ii <= 1e-6 of the lattice's.
    """
    around, at_walls = _pairs(
        position, walls, smoothing, fluid, rows, mass=mass, density=density, pressure=pressure, own=own_displacement,
        moved=pair_displacement, diagonal=diagonal, advected=advected_density,
    )  # fmt: skip
    return _relaxed(around, at_walls, fluid, implicit, timestep)


@operation(
    "symmetric pressure force p_i/rho_i^2 + p_j/rho_j^2", adds="acceleration", optional="walls", tolerance=12.0,
    reason="distance, slope, two ratios, direction, product, sum",
    invariants=f"{SYMMETRY} linear_momentum angular_momentum",
)  # fmt: skip
def push(position, mass, density, pressure, walls, smoothing, fluid, rows=None):
    """Acceleration [m/s^2] by the pressures."""
    around, at_walls = _pairs(position, walls, smoothing, fluid, rows, mass=mass, density=density, pressure=pressure)
    return {"acceleration": around(ref.pressure_force) + at_walls(ref.wall_pressure_force)}


@operation(
    "all steps of one solution",
    outputs="own_displacement diagonal advected_density pair_displacement density_error new_pressure pressure"
    " acceleration", adds="acceleration", halo_depth=8, optional="walls", tolerance=32.0,
    reason="the roundings of every step, which the scale carries on", invariants=SYMMETRY,
)  # fmt: skip
def solve(position, velocity, mass, density, walls, smoothing, fluid, implicit, timestep, pressure, acceleration):
    """All steps of a solution, in turn; p = 0.5 p(before) at first [Pa], a_i = push [m/s^2].

    The sizes carry the roundings of earlier steps on: those of each pressure enter the sums of the next.
    """
    v = ref.kicked(Fields(velocity=velocity, acceleration=acceleration), float(timestep[0]))
    liquid = {"mass": mass, "density": density}
    around, at_walls = _pairs(position, walls, smoothing, fluid, velocity=v, **liquid)
    made, square = _predicted(around, at_walls, timestep), float(timestep[0]) * float(timestep[1])
    liquid |= {n: made[k] for n, k in zip(("own", "diagonal", "advected"), made)}

    def pairs(**fields):
        i = Fields(**liquid, **fields)
        return around.of(i, i), at_walls.of(i, getattr(at_walls, "j", None))

    p = 0.5 * Terms(pressure)
    for count in range(1, int(implicit.most) + 1):
        moved = pairs(pressure=p)[0](ref.displacement, square=square)
        step = _relaxed(*pairs(pressure=p, moved=moved), fluid, implicit, timestep)
        p, error = step["new_pressure"], step["density_error"].value
        left = error.mean() if error.size else 0.0
        if count >= int(implicit.least) and not left > float(implicit.tolerance) * float(fluid.rest_density):
            break
    around, at_walls = pairs(pressure=p)
    pushed = around(ref.pressure_force) + at_walls(ref.wall_pressure_force)
    return {**made, **step, "pair_displacement": moved, "pressure": p, "acceleration": pushed}
