"""Every solver of the liquid with every kind of wall: no wall force is lost or taken twice."""

import numpy as np
import pytest
import trimesh

import refsim as rs
from refsim import contract, make_plan
from refsim.core import cases
from refsim.core.operation import REGISTRY

SPACING, SUPPORT = 0.01, 0.027
LIQUID = rs.WeaklyCompressible(sound_speed=20.0, dynamic_viscosity=0.5, density="summation")
BOX = rs.BoxWalls(lower=(-0.03, -0.03, 0.03), upper=(0.03, 0.03, 0.1))
DONG = rs.Dong2016(surface_tension=1.0, solver="hu_adams")
SOLVERS = {
    "shared": (LIQUID,), "dong_2016": (LIQUID, DONG), "iisph": (LIQUID, rs.ImplicitPressure()),
    "two_way_coupling": (LIQUID, rs.TwoWayCoupling(), rs.ShapeMatching()),
}  # fmt: skip
WALLS = {"box": (BOX,), "mesh": (None,), "box and mesh": (BOX, None), "printed mesh": ("E30",)}


@pytest.fixture(scope="module")
def plate(tmp_path_factory):
    path = tmp_path_factory.mktemp("meshes") / "plate.obj"
    trimesh.creation.box((0.1, 0.1, 0.06)).export(path)
    return str(path)


def scene(effects, **changes):
    """Liquid so near the upper face of the plate, z = 0.03 m, that it is pressed."""
    solid = ()
    if any(effect.name == "shape_matching" for effect in effects):
        solid = (rs.SolidBox(lower=(-0.0201, -0.0201, 0.0699), upper=(0.0001, 0.0001, 0.0901), density=900.0),)
    liquid = rs.Box(lower=(-0.02, -0.02, 0.03 + 0.3 * SPACING), cells=(4, 4, 3))
    return rs.Scene(spacing=SPACING, support_radius=SUPPORT, fluid=(liquid,), solid=solid, effects=effects, **changes)


def effects(solver, walls, plate):
    meshes = {None: rs.MeshBoundary(file=plate), "E30": rs.MeshBoundary(file=plate, literal=("E30",))}
    return (*SOLVERS[solver], rs.Gravity(), *(meshes.get(wall, wall) for wall in WALLS[walls]))


def takes_wall_share(name):
    """Whether the reference's answer follows the share of the pressure with which walls push."""
    operation, made = REGISTRY[name], contract.Inputs(cases.CASES["cloud_3d"](), "float64")
    answers = []
    for share in (1.0, 2.0):
        given = made.replaced(fluid=made["fluid"]._replace(wall_share=np.float64(share)))
        answers.append(operation.program("numpy")(*(given[argument] for argument in operation.arguments("numpy"))))
    (first, other) = ({output: value for output, (value, _) in answer.items()} for answer in answers)
    return any(not np.array_equal(first[output], other[output]) for output in first)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_mesh_adds_the_other_half_of_the_pressure_where_walls_push_with_one(solver, plate):
    """Patent P6: p_i of the solver's own pass and p_b of the mesh's; neither without the other."""
    cases.discover()
    launched = make_plan(scene(effects(solver, "mesh", plate))).launches()
    takers = {name for name in launched if "fluid" in REGISTRY[name].arguments("numpy") and takes_wall_share(name)}
    assert len(takers) == (solver in ("shared", "dong_2016"))
    assert ("one_way_coupling.wall_pressure" in launched) == bool(takers)


@pytest.mark.parametrize("walls, acts", [(WALLS["box"], 1), (WALLS["mesh"], 1), ((), 0)])
def test_adhesion_acts_at_walls_of_every_kind(walls, acts, plate):
    """And nowhere else."""
    given = (rs.MeshBoundary(file=plate) if wall is None else wall for wall in walls)
    launched = make_plan(scene((LIQUID, rs.Akinci2013(gamma=0.1, adhesion=2.0), *given))).launches()
    assert launched.count("akinci_2013.adhesion") == acts
