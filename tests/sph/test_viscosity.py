"""Viscosity along the difference of velocities (J(11)) and along the line of centres: what each delivers and keeps."""

import math

import numpy as np
import pytest

import refsim as rs
from refsim import make_plan
from refsim.core.effect import Discretisation
from refsim.core.operation import REGISTRY
from refsim.engine.binding import step_launches

MU = 0.7


def liquid(form, viscosity=MU, **changes):
    return rs.WeaklyCompressible(**{"rest_density": 1.0, "sound_speed": 20.0, "density": "summation", **changes},
                              dynamic_viscosity=viscosity, viscosity=form)  # fmt: skip


def drop(form, dim, *effects, radius=6.0, viscosity=MU, spin=0.1, **changes):
    """A ball or disc cut from the lattice that turns as a rigid body, spacing 1 m, rho0 = 1 kg/m^3, float64."""
    grid = Discretisation(dim, "float64", 1.0, 2.6, 0)
    position = rs.Ball(radius=radius).positions(grid)
    velocity = np.cross([0.0, 0.0, spin], position)
    fluid = liquid(form, viscosity)
    return rs.Scene(
        spacing=1.0, support_radius=2.6, dim=dim, dtype="float64", fluid=(rs.Cloud(position=position,
        velocity=velocity),),
        effects=(fluid, *effects), **changes,
    )  # fmt: skip


def test_the_note_is_said_where_a_drop_can_turn():
    """Not without viscosity, along the line of centres, between walls, or by solvers with a viscosity of their own."""

    def told(form, *effects, viscosity=MU):
        notes = make_plan(drop(form, 3, *effects, viscosity=viscosity, radius=2.0)).notes
        return [note for note in notes if "brakes free rotation" in note]

    for dim, factor, unit in ((2, 4, math.pi), (3, 5, 4 * math.pi / 3)):  # of large drops, whose pairs are all there
        plan = make_plan(drop("laplacian", dim, radius=2.0))
        rate = factor * MU / (plan.grid.count / unit) ** (2 / dim)
        assert sum(f"{factor} nu/R^2 = {rate:.3g} per second" in note for note in plan.notes) == 1
    (note,) = told("laplacian")
    assert "viscosity = 'central' conserves it" in note
    assert told("laplacian", rs.ImplicitPressure()) == [note]
    assert told("central") == told("laplacian", viscosity=0.0) == []
    assert told("laplacian", rs.BoxWalls(lower=(-9, -9, -9), upper=(9, 9, 9))) == []
    assert told("laplacian", rs.Dong2016(surface_tension=1.0, solver="hu_adams")) == []


def test_what_the_choice_does_not_go_with_is_refused():
    place = {"spacing": 0.1, "support_radius": 0.26, "fluid": (rs.Cloud(position=[[0.0, 0.0, 0.0]]),)}
    solid = (rs.SolidBox(lower=(0.1, 0.1, 0.4), upper=(0.4, 0.4, 0.6)),)
    with pytest.raises(rs.InputError, match="two_way_coupling: its viscous force is Shao & Song"):
        make_plan(rs.Scene(**place, solid=solid, effects=(liquid("central"), rs.ShapeMatching(), rs.TwoWayCoupling())))
    with pytest.raises(rs.InputError, match=r"printed sign of J\(11\), which viscosity = 'central' does not use"):
        make_plan(rs.Scene(**place, effects=(liquid("central", literal=("E3",)),)))


@pytest.mark.parametrize("backend", ["cpu", "cuda"])
@pytest.mark.parametrize("viscosity", [0.0, MU])
def test_a_default_step_reads_its_neighbours_twice(viscosity, backend):
    """Pressure, viscosity, if there is any, and shifting are one loop behind that of the density."""
    fluid = rs.WeaklyCompressible(sound_speed=20.0, dynamic_viscosity=viscosity)
    plan = make_plan(rs.Scene(spacing=0.1, support_radius=0.2, fluid=(rs.Box(cells=(3, 3, 3)),), effects=(fluid,)))
    launched = [REGISTRY[name] for name in step_launches(plan, backend) if name in REGISTRY]
    summed = [operation.name for operation in launched if "neighbours" in operation.arguments("cpu")]
    assert summed == ["sph.continuity", "particle_shifting.crowding"]
