"""Melting: which particles melt, the tables of nodes, bookkeeping, whole runs, bad input."""

import numpy as np
import pytest

import refsim as rs
from refsim import make_plan
from refsim.core.operation import REGISTRY
from refsim.melting import MeltingRule
from refsim.scene.solids import lattice_of
from refsim.shape_matching.phases import FLUID, SURFACE
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


# Which particles melt
def fresh_tables(phase, place, lattice, width, program="cpu"):
    """direct, region and region_count of nodes of which none has melted."""
    nodes = len(lattice.key)
    direct, region = np.empty((nodes, 27), np.int32), np.empty((nodes, (2 * width + 1) ** 3), np.int32)
    count = np.empty(nodes, np.int32)
    REGISTRY["shape_matching.direct_neighbours"].program(program)(phase, place, lattice, direct)
    REGISTRY["shape_matching.regions"].program(program)(direct, None, lattice, region, count)
    return direct, region, count, lattice


def melting_round(identity, place, temperature, phase, direct, region, count, lattice):
    """One round of melting at 0 deg C on the tables, in place; returns the flags of melted nodes."""
    nodes = len(direct)
    melted, number, rebuild = np.empty(nodes, np.int32), np.empty(1, np.int32), np.empty(nodes, np.int32)
    ones = np.ones(len(phase))
    rule = MeltingRule(np.int32(0), 1000.0, 1.0, 0.6, 4186.0)
    REGISTRY["melting.melt"].program("cpu")(
        identity, temperature, None, 0 * ones, None, rule, melted, ones, ones.copy(), None, None, phase, number
    )
    REGISTRY["melting.detach"].program("cpu")(melted, number, region, direct, rebuild)
    REGISTRY["shape_matching.regions"].program("cpu")(direct, rebuild, lattice, region, count)
    REGISTRY["shape_matching.classify"].program("cpu")(identity, direct, phase)
    assert number[0] == melted.sum()
    return melted


@pytest.mark.parametrize("width", [1, 2, 3])
def test_regions_equal_a_search_after_every_round(width):
    """200 rounds in which random particles melt anywhere; the reference is a breadth-first search."""
    random = np.random.default_rng(width)
    cells = np.stack(np.meshgrid(*[np.arange(6)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    lattice = lattice_of([cells[:120], cells[120:]])  # two bodies that touch
    nodes = len(cells)
    identity = np.arange(nodes, dtype=np.int32)
    phase = np.full(nodes, SURFACE, np.int32)
    direct, region, count, lattice = fresh_tables(phase, identity, lattice, width)
    smaller = 0
    for round_ in range(200):
        solid = np.flatnonzero(phase != FLUID)
        chosen = random.choice(solid, min(len(solid), 1 + round_ % 2), replace=False)
        temperature = np.full(nodes, -1.0)
        temperature[chosen] = 1.0
        phase[solid] = SURFACE  # so that any may melt, not only what lies outside
        melting_round(identity, identity, temperature, phase, direct, region, count, lattice)
        expected = members_by_search(phase != FLUID, lattice, width)
        for s in range(nodes):
            found = region[s][region[s] >= 0]
            assert (set(found.tolist()), count[s]) == (expected[s], len(found))
            smaller += len(found) < (2 * width + 1) ** 3
    assert (phase == FLUID).all() or round_ == 199
    assert smaller


def members_by_search(solid, lattice, width):
    """Members of every region: a breadth-first search over cells, with dictionaries and sets."""
    place = {(b, *cell): s for s, (b, cell) in enumerate(zip(lattice.body.tolist(), lattice.cell.tolist())) if solid[s]}
    steps = [(a, b, e) for a in (-1, 0, 1) for b in (-1, 0, 1) for e in (-1, 0, 1)]
    near = {
        s: [place[c] for a, b, e in steps if (c := (body, x + a, y + b, z + e)) in place]
        for (body, x, y, z), s in place.items()
    }
    members = []
    for s in range(len(solid)):
        found = front = {s} if solid[s] else set()
        for _ in range(width):
            front = {j for m in front for j in near[m]} - found
            found = found | front
        members.append(found)
    return members


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


# Runs


def test_cells_of_a_mesh_outlive_its_file(tmp_path):
    import trimesh

    from refsim import SolidMesh

    path = tmp_path / "ball.stl"
    trimesh.creation.icosphere(subdivisions=3, radius=1.0).export(path)
    mesh = SolidMesh(file=str(path), center=(0.9, 0.9, 1.6), size=1.3, rotation=(10.0, 20.0, 30.0))
    simulation = rs.Simulation(scene(solid=(mesh,)), "numpy")
    volume = 4 / 3 * np.pi * 0.65**3
    assert simulation.plan.grid.solids.lattice.first[1] * 0.2**3 == pytest.approx(volume, rel=0.1)
    simulation.step()
    simulation.checkpoint(tmp_path / "saved.h5")
    path.unlink()
    again = rs.Simulation.resume(tmp_path / "saved.h5")
    simulation.step()
    again.step()
    assert (again.field("position") == simulation.field("position")).all()
