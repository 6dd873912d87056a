"""The virial of the pair forces is that of the forces which the programs compute."""

import numpy as np
import pytest

import refsim as rs
from refsim.core.effect import Discretisation
from refsim.engine.launching import launch
from refsim.study.panels.virial import pair_virials
from refsim.surface_tension.cohesion import PairCohesion
from validation import pairs

TENSIONS = (
    rs.JiangZhu2023(surface_tension=1.0), rs.JiangZhu2023(surface_tension=1.0, pair_mode="soft", area_ratio=0.2),
    rs.Akinci2013(surface_tension=1.0, area_acceleration=20.0), rs.Dong2016(surface_tension=1.0),
    rs.BeckerTeschner2007(surface_tension=1.0), rs.TartakovskyMeakin2005(surface_tension=1.0),
    rs.He2014(surface_tension=1.0, air_pressure=3.0),
)  # fmt: skip


def blob(*effects, dim=3, clamp=True):
    grid = Discretisation(dim, "float64", 0.1, 0.26, 0)
    points = rs.Ball(radius=0.42 if dim == 3 else 0.6).positions(grid)
    points[:, :dim] += np.random.default_rng(2).uniform(-0.02, 0.02, (len(points), dim))
    fluid = rs.WeaklyCompressible(rest_density=1.0, sound_speed=20.0, clamp_pressure=clamp, density="summation")
    return rs.Simulation(
        rs.Scene(
            spacing=0.1, support_radius=0.26, dim=dim, fluid=(rs.Cloud(position=points),), effects=(fluid, *effects)
        ),
        "numpy",
    )


@pytest.mark.parametrize("tension", TENSIONS, ids=lambda effect: effect.name + getattr(effect, "pair_mode", ""))
def test_sum_of_pairs_is_the_sum_of_the_forces(tension):
    """sum_pairs x_ij.F_ij = sum_i x_i.F_i, with the accelerations of the programs."""
    simulation = blob(tension)
    simulation.evaluate()
    x, a, m = (simulation.field(name).astype(float) for name in ("position", "acceleration", "mass"))
    _, _, virial = pair_virials(simulation)
    assert virial.sum() == pytest.approx((m[:, None] * x * a).sum(), abs=2e-6 * np.abs(virial).sum())
    assert abs(virial.sum()) > 1e-3 * np.abs(virial).sum()


BALANCED = [e for e in pairs.EFFECTS.values() if e.virial or isinstance(e, PairCohesion)]
OF_SURFACES = [effect for effect in BALANCED if "surface_tension" in type(effect).__module__]
OF_SURFACES += [rs.JiangZhu2023(surface_tension=1.0, balance_pressure=False)]


def pull_across(effect, width):
    """(force [N/m] of the effect's own passes across the middle of a sheet of 20 x `width` particles, the sum of the
    forces on single particles, the plan)."""
    fluid = rs.WeaklyCompressible(rest_density=1000.0, sound_speed=1000.0, density="summation")
    sheet = rs.Box(cells=(20, width, 1))
    scene = rs.Scene(spacing=0.1, support_radius=0.26, dim=2, dtype="float64", fluid=(sheet,), effects=(fluid, effect))
    simulation = rs.Simulation(scene, "numpy")
    simulation.evaluate()
    passes = enumerate(simulation.force_passes)
    own = [k for k, (of, p) in passes if of[0].name == effect.name and "acceleration" in p.updates]
    simulation.fields["acceleration"][:] = 0
    assert list(launch(simulation, own))
    right = simulation.field("position")[:, 0] > 1.0
    force = simulation.field("mass") * simulation.fields["acceleration"][:, 0]
    return -force[right].sum(), np.abs(force).sum(), simulation.plan


@pytest.mark.parametrize("effect", OF_SURFACES, ids=lambda effect: effect.name)
def test_the_pressure_of_the_bulk_is_what_the_effect_says(effect):
    """The part of the pull across a sheet that grows with its width; zero for a force that acts at surfaces alone."""
    (narrow, _, _), (wide, size, plan) = pull_across(effect, 18), pull_across(effect, 28)
    measured = (wide - narrow) / (10 * plan.grid.spacing)
    told = effect.internal_pressure(plan.grid, plan.effects) if isinstance(effect, PairCohesion) else 0.0
    assert measured == pytest.approx(told, rel=0.1, abs=1e-9 * size)  # told for neighbours spread evenly
