"""Melting: what becomes of mass and rest density."""

import pytest

import refsim as rs
from refsim import make_plan
from tests.running import advanced

LIQUID = rs.WeaklyCompressible(sound_speed=40.0, dynamic_viscosity=50.0, state="tait", density="summation")
BODY = rs.SolidBox(lower=(0.4, 0.4, 0.8), upper=(1.4, 1.4, 1.8), density=917.0)


def scene(solid=(BODY,), highest=5.0, slope=0.0, melting=None, **options):
    """A body above a basin; constant temperatures, `highest` [deg C] at x = 0, decreasing by `slope` [K/m]."""
    values = {"spacing": 0.2, "support_radius": 0.5, "step": 0.004} | options

    def made(temperature):
        heat = rs.HeatConduction(temperature=temperature, conductivity=0.0, melting_point=0.0, scheme="explicit")
        effects = (
            LIQUID, rs.Gravity(), rs.BoxWalls(lower=(0, 0, 0), upper=(1.8, 1.8, 3)),
            rs.ShapeMatching(summation="gather"), rs.TwoWayCoupling(), heat, melting or rs.Melting(),
        )  # fmt: skip
        return rs.Scene(fluid=(rs.Box(cells=(9, 9, 4)),), solid=solid, effects=effects, **values)

    if not slope:
        return made(highest)
    x = make_plan(made(highest)).state.position[:, 0]
    return made(tuple((highest - slope * x).tolist()))


# Bookkeeping
@pytest.mark.parametrize(("bookkeeping", "change"), [("immiscible", 0.0), ("water", 83.0)])
def test_mass_and_rest_density_of_the_melt(bookkeeping, change):
    """Kept, or those of the liquid: the density of 125 particles of ice increases by 83 kg/m^3."""
    simulation = rs.Simulation(scene(melting=rs.Melting(bookkeeping=bookkeeping), dtype="float64"), "numpy")
    volume = 1 / simulation.plan.effects["weakly_compressible"].rest_number_density(simulation.plan.grid)
    before = simulation.field("mass").sum()
    advanced(simulation, 4)
    assert simulation.field("mass").sum() - before == pytest.approx(125 * change * volume, abs=1e-9 * before)
    assert (simulation.field("rest_density")[:125] == (1000.0 if change else 917.0)).all()
