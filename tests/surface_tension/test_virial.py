"""The virial of the pair forces is that of the forces which the programs compute."""

import numpy as np
import pytest

import refsim as rs
from refsim.core.effect import Discretisation
from refsim.study.panels.virial import pair_virials

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
