"""The density that particles are told beside that which is counted of them: where it is counted, when it is told."""

import msgspec
import numpy as np
import pytest

from refsim import BoxWalls, Cloud, Gravity, Scene, Simulation, WeaklyCompressible
from refsim.engine import counting
from refsim.engine.counting import Counted, counted

D, SOUND = 0.05, 20.0


@pytest.fixture
def often(monkeypatch):
    """Looks at every fourth step."""
    monkeypatch.setattr(counting, "EVERY", 4)


def lattice(dim, n):
    axes = np.meshgrid(*[D * (np.arange(n) + 0.5)] * dim, indexing="ij")
    return np.pad(np.stack(axes, -1).reshape(-1, dim), ((0, 0), (0, 3 - dim)))


def block(dim=2, n=16, period=(0.0, 0.0, 0.0), effects=(), **liquid):
    water = WeaklyCompressible(sound_speed=SOUND, dynamic_viscosity=20.0, **liquid)
    return Scene(
        dim=dim, spacing=D, support_radius=2.6 * D, dtype="float64", end_time=0.012, period=period,
        fluid=(Cloud(position=lattice(dim, n)),), effects=(water, *effects),
    )  # fmt: skip


def test_only_what_has_liquid_around_it_is_counted():
    """A sheet, a drop, a film in a narrow tank and air under a lid have no inside; a tank has, up to its walls."""
    assert counted(Simulation(block(n=6), "numpy")) is None
    assert counted(Simulation(block(density="summation"), "numpy")) is None
    walls = BoxWalls(lower=(0.0, 0.0, 0.0), upper=(16 * D, 40 * D, 0.0))
    free, held = (counted(Simulation(block(effects=more), "numpy")) for more in ((), (walls,)))
    assert held.cells > 1.4 * free.cells
    assert abs(held.difference) < 1e-9
    round_about = counted(Simulation(block(period=(16 * D, 16 * D, 0.0)), "numpy"))
    assert round_about.cells == 64
    assert abs(round_about.difference) < 1e-9
    lid = BoxWalls(lower=(0.0, 0.0, 0.0), upper=(8 * D, 8 * D, 12 * D))
    found = counted(Simulation(block(3, 8, effects=(lid, Gravity())), "numpy"))
    assert abs(found.difference) < 1e-6
    assert found.cells == 18
    walls = BoxWalls(lower=(0.0, 0.0, 0.0), upper=(4 * D, 40 * D, 0.0))
    film = lattice(2, 4)
    drops = film + (0.0, 20 * D, 0.0)
    water = WeaklyCompressible(sound_speed=SOUND, dynamic_viscosity=20.0)
    made = Scene(
        dim=2, spacing=D, support_radius=2.6 * D, fluid=(Cloud(position=np.concatenate([film, drops])),),
        effects=(water, walls),
    )  # fmt: skip
    assert counted(Simulation(made, "numpy")) is None


def test_air_between_surfaces_is_no_torn_liquid():
    """Sheets of 4 cells and more, 4 to 6 apart over a period. Torn rows with gaps of 3 cells do count."""
    draw = np.random.default_rng(60)
    for _ in range(16):
        thick, air = draw.integers(4, 15), draw.integers(4, 7)
        place = lattice(2, 14)
        place = place[place[:, 1] < thick * D] + (0.0, D * draw.random(), 0.0)
        found = counted(Simulation(sheets(place, (thick + air) * D), "numpy"))
        assert found is None or abs(found.difference) < 0.01, (thick, air, found)
    rows = lattice(2, 14)
    rows = rows[(rows[:, 1] / D).astype(int) % 4 < 1]
    assert counted(Simulation(sheets(rows, 16 * D), "numpy")).difference < -0.7


def sheets(place, period):
    return msgspec.structs.replace(block(period=(14 * D, period, 0.0)), fluid=(Cloud(position=place),))


def test_what_is_gone_at_the_next_look_is_not_told(often, monkeypatch):
    """A gap of four spacings through which a block falls on a pool counts as liquid that lacks a third."""
    found = iter([-0.3, 0.0, -0.03, -0.3])
    monkeypatch.setattr(counting, "counted", lambda run: Counted(1e3, 1e3, next(found), 0.0, 0.0, 100))
    simulation = Simulation(block(n=4), "numpy")
    told = []
    for _ in range(16):
        simulation.step()
        told.append(any("is counted inside" in note for note in simulation.notes))
    assert told.index(True) == 15
