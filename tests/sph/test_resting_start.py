"""The pressure with which liquid at rest starts, of any parts that make it."""

import math

import numpy as np
import pytest
import trimesh
from scipy.integrate import solve_ivp

import refsim as rs
from refsim.sph.resting import RestingColumn

D, PULL, SOUND = 0.1, 9.81, 40.0
BODY = ((3, 2, 2), (6, 4, 5))  # lowest and first free cell of a solid


def tank(parts, cells, dim=3, solid=(), file=""):
    """A tank of so many cells with liquid in `parts`: (lowest cell, cells) of boxes, or cells (n, 3) of a cloud."""
    liquid = [
        rs.Box(lower=tuple(D * np.array(p[0])), cells=p[1]) if isinstance(p, tuple)
        else rs.Cloud(position=(np.array(p) + 0.5) * D * [1, 1, dim - 2])
        for p in parts
    ]  # fmt: skip
    pull = (0.0, -PULL, 0.0) if dim == 2 else (0.0, 0.0, -PULL)
    more = [rs.ShapeMatching(), rs.TwoWayCoupling()] if solid else []
    more += [rs.MeshBoundary(file=file)] if file else []
    upper = D * np.array(cells) * (1, *((1, 2) if dim == 3 else (2, 0)))
    return rs.Scene(
        dim=dim, spacing=D, support_radius=3 * D, dtype="float64", fluid=tuple(liquid), solid=solid,
        effects=(
            rs.WeaklyCompressible(sound_speed=SOUND), rs.Gravity(acceleration=pull),
            rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=tuple(upper)), *more,
        ),
    )  # fmt: skip


def started(scene):
    """Of the liquid, in the order of places: pressure over rho0 g d at the start, and place in spacings."""
    state = rs.make_plan(scene).state
    first = len(state.position) - sum(state.sizes[len(scene.solid) :])
    place = np.round(state.position[first:] / D - 0.5, 6)
    order = np.lexsort(place.T)
    return state.values["advanced_excess"][first:][order] * SOUND**2 / (1000 * PULL * D), place[order]


def cells(low, size):
    return np.array(low) + np.indices(size).reshape(3, -1).T


@pytest.mark.parametrize("spacing", [1e-6, 1.0])
def test_a_given_mass_stays_however_small_it_is(spacing):
    """1e-9 kg/m in a tank, whose particles without a mass get that of their pressure."""
    places = spacing * (cells((0, 0, 0), (4, 4, 1)) + 0.5) * [1, 1, 0]
    mass = np.full(16, 1.01 * 1000 * spacing**2)
    walls = rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(4 * spacing, 8 * spacing, 0.0))
    scene = rs.Scene(
        dim=2, spacing=spacing, support_radius=3 * spacing, dtype="float64",
        fluid=(rs.Cloud(position=places, mass=mass),),
        effects=(rs.WeaklyCompressible(sound_speed=10.0), rs.Gravity(acceleration=(0.0, -0.1 / spacing, 0.0)), walls),
    )  # fmt: skip
    np.testing.assert_array_equal(rs.make_plan(scene).state.mass, mass)


def test_each_column_of_a_step_has_its_own_surface_and_liquid_in_the_air_none():
    """A tower on a pool, which is not in balance: under it its weight, beside it none; in the air the rest density."""
    found, place = started(tank([((0, 0, 0), (9, 9, 2)), ((3, 3, 2), (3, 3, 4))], (9, 9, 6)))
    under = ((place[:, :2] >= 3) & (place[:, :2] < 6)).all(1)
    assert np.abs(found - np.where(under, 6, 2) + 0.5 + place[:, 2]).max() < 1e-9
    found, place = started(tank([((0, 0, 0), (5, 4, 2)), ((1, 1, 4), (2, 2, 2))], (5, 4, 6)))
    assert np.abs(found - np.where(place[:, 2] >= 4, 0, 1.5 - place[:, 2])).max() < 1e-9


def around(size):
    """Boxes below, above and beside a body in a tank of 9 x 6 x `size` cells."""
    (a, b, c), (d, e, f) = BODY
    return [
        ((0, 0, 0), (9, 6, c)), ((0, 0, f), (9, 6, size - f)),
        ((0, 0, c), (a, 6, f - c)), ((d, 0, c), (9 - d, 6, f - c)), ((a, 0, c), (d - a, b, f - c)),
        ((a, e, c), (d - a, 6 - e, f - c)),
    ]  # fmt: skip


@pytest.mark.parametrize("kind", ["solid", "mesh"])
def test_liquid_under_a_body_bears_the_column_beside_it(kind, tmp_path):
    low, high = D * np.array(BODY)
    solid, file = (rs.SolidBox(lower=tuple(low), upper=tuple(high)),), ""
    if kind == "mesh":
        solid, file = (), str(tmp_path / "body.stl")
        trimesh.creation.box(bounds=[low, high]).export(file)
    found, place = started(tank(around(8), (9, 6, 8), solid=solid, file=file))
    assert len(found) == 9 * 6 * 8 - 3 * 2 * 3
    assert np.abs(found - 7.5 + place[:, 2]).max() < 1e-9


G, RHO = 9.81, 1000.0


def integrated(load, sound, k):
    """(height, force on a side, pressure at half the height) by steps down the column, p from rho."""

    def density(p):
        return RHO * (1 + k * p / (RHO * sound**2)) ** (1 / k)

    def down(s, y):
        return [density(y[0]) * G, y[0]]

    def full(s, y):
        return y[0] - load * G

    full.terminal = True
    found = solve_ivp(down, (0, 10 * load / RHO), [0.0, 0.0], rtol=1e-12, atol=1e-12, events=full, dense_output=True)
    height = found.t_events[0][0]
    return height, found.y_events[0][0][1], found.sol(0.5 * height)[0]


@pytest.mark.parametrize("k", [1, 7])
@pytest.mark.parametrize(("load", "sound"), [(1000.0, 10 * math.sqrt(G)), (300.0, 4.0), (2e4, 1500.0)])
def test_the_column_is_the_solution_of_its_equation(load, sound, k):
    height, force, middle = integrated(load, sound, k)
    column = RestingColumn(load, G, RHO, sound, k)
    assert column.height() == pytest.approx(height, rel=1e-9)
    assert column.side_force() == pytest.approx(force, rel=1e-9)
    assert column.pressure(0.5 * height) == pytest.approx(middle, rel=1e-9)
    assert column.pressure(0.0) == pytest.approx(load * G, rel=1e-12)
    assert column.pressure(np.array([height, 2 * height])) == pytest.approx(0.0, abs=1e-9 * load * G)
