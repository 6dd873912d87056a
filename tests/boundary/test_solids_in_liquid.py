"""Solids and meshes in a liquid with an advanced density: lift, rise, weight, momentum; what is refused."""

import msgspec
import numpy as np
import pytest
import trimesh

import refsim as rs
from refsim import make_plan
from refsim.core.operation import REGISTRY
from tests.running import advanced
from validation.experiments.liquid import runs
from validation.running import Context

SMALL = ((3, 3), 2, (8, 7), 2.6, runs.ARTIFICIAL)  # body, cells below it, tank, h/d, alpha


def submerged(*given, dtype="float32"):
    """The experiment's scene; in single precision, whose kernels other tests need, too."""
    return msgspec.structs.replace(runs.submerged(*given), dtype=dtype)


def test_liquid_solid_and_walls_balance_their_momentum():
    """The sum of all forces is the weight and the walls' push, to rounding."""
    simulation = rs.Simulation(submerged(*SMALL, dtype="float64"), "numpy")
    advanced(simulation, 3)
    simulation.evaluate()
    mass, force = simulation.field("mass"), simulation.field("mass") @ simulation.field("acceleration")
    weight = np.array([0.0, 0.0, -runs.GRAVITY]) * mass.sum()
    size = (mass[:, None] * np.abs(simulation.field("acceleration"))).sum()
    assert np.abs(force - weight - runs.pushed(simulation)).max() <= 1e-13 * size


def test_solids_feel_a_tank_that_sways():
    """Their pressure is that of the acceleration in the tank's frame, 1 m/s^2 along x here."""
    sway = rs.Motion(of="gravity", kind="formula", direction=(1.0, 0.0, 0.0), formula="-0.5*t**2")
    simulation = rs.Simulation(msgspec.structs.replace(submerged(*SMALL, dtype="float64"), motion=(sway,)), "numpy")
    advanced(simulation, 3)
    simulation.evaluate()
    plan, operation = simulation.plan, REGISTRY["two_way_coupling.extrapolation"]
    names = ("position", "velocity", "followed_velocity", "phase", "density", "pressure")
    given = {name: simulation.field(name) for name in names} | {"lean": (1.0, 0.0, -runs.GRAVITY)}
    given |= {"smoothing": plan.shared["smoothing"], "delay": plan.parameters["two_way_coupling"]["delay"]}
    found = operation.program("numpy")(*(given[name] for name in operation.arguments("numpy")))["pressure"][0]
    assert simulation.field("pressure") == pytest.approx(found, rel=1e-9, abs=1e-6)


def test_a_detected_surface_has_its_number_density():
    scene = submerged(*SMALL)
    scene = msgspec.structs.replace(scene, effects=(*scene.effects, rs.SurfaceDetection()))
    simulation = rs.Simulation(scene, "cpu")
    inner = np.abs(simulation.field("position") - 0.5).max(1) < 0.2
    assert not simulation.field("surface")[inner].any()
    assert simulation.field("surface")[simulation.field("position")[:, 2] > 0.9].all()


@pytest.mark.parametrize(("changed", "words"), [
    ({"viscosity": "laplacian"}, "'laplacian' would brake their rotation; set viscosity = 'central'"),
    ({"gradient": "corrected"}, "two_way_coupling, whose solids bear the opposite of plain pair forces"),
    ({"tensile_control": "everywhere"}, "two_way_coupling, whose solids bear the opposite of plain pair forces"),
    ({"literal": ("M2",)}, "density_weighted and literal belong to a summed density"),
    ({"density_weighted": True}, "density_weighted and literal belong to a summed density"),
])  # fmt: skip
def test_what_does_not_fit_is_refused_in_a_sentence(changed, words):
    scene = submerged(*SMALL)
    owner = rs.WeaklyCompressible if {"viscosity", "gradient", "tensile_control"} & set(changed) else rs.TwoWayCoupling
    effects = tuple(msgspec.structs.replace(e, **changed) if isinstance(e, owner) else e for e in scene.effects)
    with pytest.raises(rs.InputError) as refused:
        make_plan(msgspec.structs.replace(scene, effects=effects))
    assert words in str(refused.value)
    assert str(refused.value).count(". ") == 0


def basin(folder, offset, cells=(8, 8, 6), **changes):
    """Water on a mesh, its top `offset` spacings above a plane of the lattice, between box walls without a floor."""
    spacing = 1.0 / cells[2]
    wide, deep = np.array([*cells[:2], 0]) * spacing, 8 * spacing
    block = trimesh.creation.box(bounds=[-deep * np.ones(3), wide + [deep, deep, offset * spacing]])
    block.export(folder / "block.obj")
    return rs.Scene(
        dtype="float64", spacing=spacing, support_radius=3 * spacing,
        fluid=(rs.Box(lower=(0.0, 0.0, offset * spacing), cells=cells),),
        effects=(
            rs.WeaklyCompressible(
                sound_speed=runs.SOUND, dynamic_viscosity=80.0, viscosity="central", density="continuity"
            ),
            rs.Gravity(acceleration=(0.0, 0.0, -runs.GRAVITY)),
            rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(*wide[:2], 2.0), open_faces=("-z",), model="extrapolated"),
            rs.MeshBoundary(file=str(folder / "block.obj"), **({"model": "extrapolated"} | changes)),
        ),
    )  # fmt: skip


def test_a_mesh_carries_the_liquid_on_it(tmp_path):
    """Between planes of the lattice: the first layer stays half a spacing above it, and it bears rho g depth."""
    offset = 0.3
    simulation = rs.Simulation(basin(tmp_path, offset), "cpu", threads=2)
    spacing, weights, pressures = simulation.plan.grid.spacing, [], []
    below = (np.array([3.0, 3.0, offset]) * spacing - simulation.plan.walls.position) / spacing
    first = (np.abs(below) < [2, 2, 0.6]).all(1)
    assert below[first, 2] == pytest.approx(0.5)
    head = runs.DENSITY * runs.GRAVITY * (runs.DEPTH + 0.5 * spacing)
    while simulation.time < 1.2:
        simulation.step()
        if simulation.time > 0.8 and simulation.steps % 5 == 0:
            simulation.evaluate()
            weights.append(runs.pushed(simulation)[2])
            pressures.append(simulation.field("wall_pressure")[first].mean())
    assert np.mean(pressures) == pytest.approx(head, rel=0.01)
    assert np.mean(weights) == pytest.approx(simulation.field("mass").sum() * runs.GRAVITY, rel=0.01)
    assert simulation.field("position")[:, 2].min() > (offset + 0.35) * spacing
    assert np.sqrt((simulation.field("velocity") ** 2).sum(1).mean()) <= 1e-3 * runs.SOUND
    assert not simulation.field("corrections").any()


def test_a_slope_bears_rho_g_depth():
    """One of 45 degrees, whose surface cuts the cells of the lattice; the liquid on it rests."""
    found = runs.on_mesh(Context(), 0.0, True, 6, 16, "cpu").values
    assert found["mesh_pressure_off"] <= 0.01
    assert found["mesh_weight_off"] <= 0.005
    assert found["moving"] <= 1e-3


def test_cells_of_a_mesh_and_of_the_box_fill_space_once(tmp_path):
    """Volumes of both in a column beside the liquid: as many as the column has cells."""
    plan = make_plan(basin(tmp_path, 0.3))
    spacing, place = plan.grid.spacing, plan.walls.position
    column = np.abs(place[:, :2] - [-0.5 * spacing, 2.5 * spacing]).max(1) < 0.1 * spacing
    low = column & (np.abs(place[:, 2] + 0.5 * spacing) < 3.5 * spacing)
    assert plan.walls.volume[low].sum() == pytest.approx(7 * spacing**3, rel=1e-2)


def test_options_of_the_patent_and_an_extrapolated_pressure_exclude_each_other(tmp_path):
    with pytest.raises(rs.InputError, match="belong to model = 'mirrored'; leave them out with 'extrapolated'"):
        make_plan(basin(tmp_path, 0.0, layers=2))
    with pytest.raises(rs.InputError, match="needs an extrapolated pressure at all walls"):
        make_plan(basin(tmp_path, 0.0, model="mirrored"))
