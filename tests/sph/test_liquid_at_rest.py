"""The liquid with an advanced density: tanks rest and weigh what they hold, and the pressure with which it starts."""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import refsim as rs
from refsim import make_plan, simulate
from refsim.smoothing import lattice, smoothing
from refsim.smoothing.reference import kernel_value
from refsim.sph.resting import RestingColumn
from tests.running import advanced

G, DENSITY, DEPTH = 9.81, 1000.0, 1.0
SOUND = 10 * math.sqrt(G * DEPTH)


def tank(cells, ratio, dim, dtype="float64", effects=(), **liquid):
    """Water 1 m deep in a box of its own width; the viscosity is that of an artificial viscosity of 0.02."""
    spacing = DEPTH / cells
    up = dim - 1
    pull, upper = [0.0, 0.0, 0.0], [DEPTH] * 3
    pull[up], upper[up] = -G, 2 * DEPTH
    viscosity = DENSITY * 0.02 * 0.5 * ratio * spacing * SOUND / (2 * (dim + 2))
    liquid = {"density": "continuity", "viscosity": "central"} | liquid
    return rs.Scene(
        dim=dim, dtype=dtype, spacing=spacing, support_radius=ratio * spacing,
        fluid=(rs.Box(cells=(cells, cells, cells if dim == 3 else 1)),),
        effects=(
            rs.WeaklyCompressible(sound_speed=SOUND, dynamic_viscosity=viscosity, **liquid),
            rs.Gravity(acceleration=tuple(pull)),
            rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=tuple(upper), model="extrapolated"), *effects,
        ),
    )  # fmt: skip


@pytest.mark.parametrize(("kernels", "ratio"), [("wendland", 2.13), ("cubic_spline", 2.13), ("wendland", 3.0)])
def test_walls_above_the_surface_leave_a_tank_in_space_at_rest(kernels, ratio):
    """Its mean speed after 8 steps over that of a fall, with a quick return to the counted density.

    Where the walls above the surface count as what surrounds it these are 0.019, 0.025 and 0.020.
    """
    simulation = rs.Simulation(tank(4, ratio, 3, kernels=kernels, restoring=0.01), "numpy")
    speed = np.linalg.norm(advanced(simulation, 8).field("velocity"), axis=1).mean()
    assert speed < 0.015 * G * simulation.time


@pytest.mark.parametrize(("dim", "ratio"), [(2, 2.0), (3, 2.6)])
def test_a_fast_particle_does_not_make_the_others_shift_too_far(dim, ratio):
    """A step takes away 1.75 of the wave of a lattice that the shift changes most; twice as much, and it would stay."""
    scene = rs.Scene(
        dim=dim, dtype="float64", spacing=1.0, support_radius=ratio, period=(6.0, 6.0, 6.0 * (dim == 3)),
        fluid=(rs.Box(cells=(6, 6, 6 if dim == 3 else 1)),), effects=(rs.WeaklyCompressible(sound_speed=1.0),),
    )  # fmt: skip
    taken = []
    for wave in list(itertools.product((0, 1), repeat=dim))[1:]:
        simulation = rs.Simulation(scene, "numpy")
        place, fast = simulation.field("position"), simulation.field("velocity")
        crest = 1e-4 * np.cos(np.pi * (place[:, :dim] - 0.5) @ wave)
        place[:, 0] += crest
        fast[0, 1] = 5.0
        simulation.set_field("position", place)
        simulation.set_field("velocity", fast)
        simulation.step()
        taken.append(-simulation.field("shift")[:, 0] @ crest / (crest @ crest))
    assert max(taken) == pytest.approx(1.75, rel=1e-3)


@pytest.mark.parametrize(
    ("reach", "axes", "diagonals"),
    [(2.6, 0.109, 0.004), (3.0, 0.023, -0.011), (3.2, -0.024, -0.005), (4.0, 0.009, 0.004)],
)
def test_a_lattice_resists_shear(reach, axes, diagonals):
    """With N''/4 p, N(e) of a lattice exp(e) times as long along one direction, and as much narrower."""
    x, e = lattice(math.ceil(reach) + 1, 2)[:, :2], 1e-3
    turned = x @ np.array([[1.0, -1.0], [1.0, 1.0]]) / math.sqrt(2)
    for places, wanted in ((x, axes), (turned, diagonals)):
        r = [np.linalg.norm(places * np.exp([s, -s]), axis=1) for s in (e, 0.0, -e)]
        filled = [kernel_value(distance, smoothing("wendland_c2", reach, 2)).sum() for distance in r]
        assert (filled[0] - 2 * filled[1] + filled[2]) / e**2 / 4 == pytest.approx(wanted, abs=6e-4)


def test_a_lone_particle_gives_off_its_pressure():
    """Spray that keeps what it had when it left the liquid bounces as balls do that lose nothing."""
    liquid = rs.WeaklyCompressible(sound_speed=10.0)
    scene = rs.Scene(spacing=1.0, support_radius=2.6, fluid=(rs.Box(cells=(1, 1, 1)),), effects=(liquid,))
    simulation = rs.Simulation(scene, "numpy")
    simulation.set_field("advanced_excess", np.array([100.0], np.float32))
    advanced(simulation, 20)
    assert 0 <= simulation.field("pressure")[0] < 0.01 * 100 * 10.0**2


@pytest.mark.parametrize("model", ["extrapolated", "mirrored"])
def test_a_run_stops_where_planes_hold_the_liquid(tmp_path, monkeypatch, model):
    """Any share is too much here; the checkpoint before stays. A film between mirrored walls goes on."""
    for bound in ("STOPPED", "HELD"):
        monkeypatch.setattr(f"refsim.engine.counting.{bound}", -1.0)
    scene = rs.Scene(
        dim=2, spacing=0.02, support_radius=0.052, step=1e-4, fluid=(rs.Box(cells=(10, 10, 1)),),
        effects=(
            rs.WeaklyCompressible(sound_speed=20.0, density="summation"), rs.Gravity(acceleration=(0.0, -9.81, 0.0)),
            rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(0.2, 0.5, 0.0), model=model),
        ),
    )  # fmt: skip
    if model == "mirrored":
        assert simulate(scene, 0.0105, backend="numpy").steps > 100
        return
    with pytest.raises(rs.RunStopped) as stopped:
        simulate(scene, 1.0, backend="numpy", output=tmp_path, checkpoint_every=0.0)
    assert (stopped.value.reason, stopped.value.exit_code) == ("held_by_planes", 3)
    assert rs.Simulation.resume(tmp_path / "checkpoint.h5").steps == 99


def test_shifting_of_no_strength_asks_for_nothing():
    idle = rs.ParticleShifting(surface="none", strength=0.0)
    make_plan(tank(6, 2.6, 2, effects=(idle,)).with_(box_walls__open_faces=("+y",)))


def test_a_drop_that_falls_above_a_tank_does_not_stir_it():
    """It moves as without the drop: v_max is that of each body."""
    alone = tank(4, 2.6, 2, "float64", density=None).with_(step=2e-3, box_walls__upper=(DEPTH, 4.0, 0.0))
    drop = rs.Box(lower=(0.0, 3.0, 0.0), cells=(2, 2, 1), velocity=(0.0, -3.0, 0.0))
    runs = (rs.Simulation(scene, "numpy") for scene in (alone, alone.with_(fluid=(*alone.fluid, drop))))
    one, other = (advanced(run, 6).field("position")[:16] for run in runs)
    np.testing.assert_allclose(one, other, atol=1e-12)


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


PULL, WATER = 9.81, 1000.0


def integrated(load, sound, k):
    """(height, force on a side, pressure at half the height) by steps down the column, p from rho."""

    def density(p):
        return WATER * (1 + k * p / (WATER * sound**2)) ** (1 / k)

    def down(s, y):
        return [density(y[0]) * PULL, y[0]]

    def full(s, y):
        return y[0] - load * PULL

    full.terminal = True
    found = solve_ivp(down, (0, 10 * load / WATER), [0.0, 0.0], rtol=1e-12, atol=1e-12, events=full, dense_output=True)
    height = found.t_events[0][0]
    return height, found.y_events[0][0][1], found.sol(0.5 * height)[0]


@pytest.mark.parametrize("k", [1, 7])
@pytest.mark.parametrize(("load", "sound"), [(1000.0, 10 * math.sqrt(PULL)), (300.0, 4.0), (2e4, 1500.0)])
def test_the_column_is_the_solution_of_its_equation(load, sound, k):
    height, force, middle = integrated(load, sound, k)
    column = RestingColumn(load, PULL, WATER, sound, k)
    assert column.height() == pytest.approx(height, rel=1e-9)
    assert column.side_force() == pytest.approx(force, rel=1e-9)
    assert column.pressure(0.5 * height) == pytest.approx(middle, rel=1e-9)
    assert column.pressure(0.0) == pytest.approx(load * PULL, rel=1e-12)
    assert column.pressure(np.array([height, 2 * height])) == pytest.approx(0.0, abs=1e-9 * load * PULL)
