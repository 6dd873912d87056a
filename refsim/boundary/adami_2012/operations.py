"""Operations of walls after Adami, Hu & Adams 2012."""

import numpy as np

from refsim.boundary.adami_2012 import reference as ref
from refsim.core.operation import SYMMETRY, operations
from refsim.core.terms import Terms, maximum, where
from refsim.motion.operations import felt
from refsim.neighbours.sums import Fields, neighbours, wall_particles
from refsim.sph.operations import moving, symmetric
from refsim.sph.reference import across

operation = operations(paper="Adami, Hu & Adams 2012")
_CORRECTION, _FILM = "correction_diagonal correction_mixed", "phase suction film_factor"


def _mean(around, term, share, **given):
    """Sum of a term over the sum of W, 0 without any; its size counts the terms, as a wall particle has no list."""
    weight, count = around(share), around(lambda i, j, ij: Terms(share(i, j, ij).value > 0))
    average = where(weight.value > 0, around(term, **given) / where(weight.value > 0, weight, 1), 0)
    return Terms(average.value, ((1 + count) * Terms(average.size, rank=average.rank)).value, average.rank)


def _borne(pressure, density, fluid):
    """Pressure [Pa] that walls bear."""
    i = Fields(pressure=pressure, density=density)
    p = ref.borne(i, float(fluid.internal_pressure), float(fluid.rest_density))
    return maximum(p, 0) if fluid.clamp else p


@operation(
    "(27)", outputs="wall_pressure", entrywise=True,
    variants=(
        "phase wet borne turning period", "phase wet turning", "phase borne period", "turning period",
        "phase wet borne period",
    ),
    tolerance=16.0, reason="one rounding in each of distance, kernel, head, product and sum, and those of the quotient",
)  # fmt: skip
def extrapolation(
    position, density, pressure, phase, wet, borne, walls, smoothing, lean, fluid, turning=None, period=None
):  # fmt: skip
    """Pressure of each wall particle [Pa]; 0 where neither liquid nor a wet solid is within reach."""
    liquid = np.ones(len(pressure), bool) if phase is None else np.asarray(phase) == 0
    film = 0.0 if wet is None else 1e-3 * np.asarray(wet, dtype=float)
    pushing = pressure if phase is not None else _borne(pressure, density, fluid)
    heavy = np.asarray(density, dtype=float) * (1.0 if borne is None else borne)
    j = Fields(
        position=position, pressure=pushing, liquid=liquid, share=np.where(liquid, 1.0, film),
        heavy=np.where(liquid, heavy, float(fluid.rest_density)),
    )  # fmt: skip
    still = Fields(position=walls.position, velocity=np.zeros_like(walls.position))
    around = neighbours(wall_particles(walls, felt=felt(still, lean, turning)), j, smoothing, period=period)
    return {"wall_pressure": _mean(around, ref.wall_pressure, ref.share)}


@operation(
    "adjoint of (27)", paper="this project", outputs="wall_strain", entrywise=True, optional="phase period",
    tolerance=16.0, reason="one rounding in each of distance, slope, volume, projection, product and sum, and those of"
    " the quotient",
)  # fmt: skip
def strain(position, velocity, mass, advanced_excess, phase, walls, wall_normal, smoothing, fluid, period=None):
    """What `sph.continuity` takes from each wall particle [m^(2 dim)/s]; 0 where no liquid is within reach."""
    rho = float(fluid.rest_density) + np.asarray(advanced_excess, dtype=float)
    liquid = 1.0 if phase is None else np.asarray(phase) == 0
    f = Fields(position=position, velocity=velocity, mass=mass, density=rho, share=liquid)
    around = neighbours(wall_particles(walls), f, smoothing, period=period)
    u = _mean(around, ref.velocity, ref.share)
    sliding = around.of(wall_particles(walls, along=u - across(u, Terms(wall_normal, rank=1))), f)
    return {"wall_strain": around.i.volume * _mean(sliding, ref.strain, ref.share)}


@operation(
    "J(10) with wall particles", paper="Adami, Hu & Adams 2012; Jiang & Zhu 2023", adds="acceleration",
    variants=(f"{_CORRECTION} {_FILM} period", f"{_CORRECTION} {_FILM}", f"{_FILM} period", f"{_CORRECTION} period"),
    tolerance=8.0, invariants=SYMMETRY, broken={1: "rotation", 2: "rotation"},
)  # fmt: skip
def wall_force(
    position, density, pressure, phase, suction, film_factor, wall_pressure, correction_diagonal, correction_mixed,
    walls, smoothing, fluid, period=None, rows=None,
):  # fmt: skip
    """Acceleration [m/s^2] of liquid, and of solids by a film; without a correction B = I."""
    i = Fields(
        position=position, density=density, pressure=_borne(pressure, density, fluid),
        liquid=1.0 if phase is None else np.asarray(phase) == 0, suction=0.0 if suction is None else suction,
        wider=1.0 if film_factor is None else film_factor,
    )  # fmt: skip
    w = wall_particles(walls, pressure=wall_pressure)
    a = neighbours(i, w, smoothing, period=period, rows=rows)(ref.wall_force)
    if correction_diagonal is not None:
        a = Fields(b=symmetric(correction_diagonal, correction_mixed)).at(rows).b @ a
    return {"acceleration": a}


@operation(
    "no slip", paper="this project; Espanol & Revenga 2003", adds="acceleration",
    variants=("wall_motion period", "", "wall_motion"), tolerance=16.0,
    reason="those of sph.central_viscosity, and the power of 1 - r/h", invariants=SYMMETRY,
    broken={1: "translation rotation", 2: "rotation"},
)  # fmt: skip
def hold(position, velocity, density, walls, smoothing, holding, wall_motion=None, period=None, rows=None):
    """Acceleration [m/s^2] by walls that hold the liquid, at rest or moving by `wall_motion` beyond its planes."""
    i = Fields(position=position, velocity=velocity, density=density)
    w = wall_particles(walls, velocity=moving(walls, wall_motion))
    at_walls = neighbours(i, w, smoothing, period=period, rows=rows)
    return {"acceleration": at_walls(ref.holding_force, k=holding.coefficient, n=int(holding.steepness))}
