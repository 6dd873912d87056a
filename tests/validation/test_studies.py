"""Exact answers of the solved scenes against other programs, and studies that find them."""

import numpy as np
import pytest

from validation.measure import studies
from validation.measure.studies import SOLVED, sloshed


def conducted(start, held, seconds, cell, conductivity, density, heat_of, temperature_of):
    """Temperatures [degrees C] of cells in a row after `seconds`, explicitly; the first `held` stay as they were."""
    heat = heat_of(start)
    capacity = np.diff(heat_of(np.array([-2.0, -1.0])))[0]
    count = int(np.ceil(seconds / (0.4 * density * capacity * cell**2 / conductivity)))
    for _ in range(count):
        flux = conductivity * -np.diff(temperature_of(heat)) / cell  # W/m^2
        change = np.concatenate([[0.0], flux]) - np.concatenate([flux, [0.0]])
        change[:held] = 0.0
        heat = heat + seconds / count * change / (density * cell)
    return heat


def test_the_slab_by_finite_volumes():
    cells = 200
    start = np.where(np.arange(cells) < cells // 2, 100.0, 0.0)
    heat = conducted(start, 0, 20.0, 0.1 / cells, 400.0, 8960.0, lambda t: 385.0 * t, lambda h: h / 385.0)
    at = 385.0 * SOLVED["slab"].answer()
    assert heat[cells // 4 - 1 : cells // 4 + 1].mean() == pytest.approx(at, rel=1e-4)


@pytest.mark.parametrize(("name", "wall", "cold", "until", "length", "conductivity", "capacity", "density", "latent"), [
    ("melting_wall", 50.0, 0.0, 3000.0, 0.1, 0.6, 4186.0, 1000.0, 333e3),
    ("candle", 90.0, 40.0, 600.0, 0.05, 0.25, 2500.0, 900.0, 200e3),
])  # fmt: skip
def test_melting_by_finite_volumes(name, wall, cold, until, length, conductivity, capacity, density, latent):
    def heat_of(t):
        return np.where(t > 0, latent + capacity * t, capacity * t)

    def temperature_of(h):
        return np.where(h > latent, (h - latent) / capacity, np.minimum(h, 0.0) / capacity)

    means = []
    for cells in (125, 250):  # the wall's temperature stands half a cell from the face: an error of first order
        held = cells // 5
        start = np.where(np.arange(cells) < held, wall, -cold)
        heat = conducted(start, held, until, length / cells, conductivity, density, heat_of, temperature_of)
        means.append(heat.mean())
    assert 2 * means[1] - means[0] == pytest.approx(SOLVED[name].answer(), rel=2e-4)


def test_the_sloshing_water_is_that_of_its_level():
    """In shallow water, by the wave equation of the level in cells of equal width."""
    length, depth, push, rate, until, cells, steps = 1.0, 0.02, 0.2, 4.0, 2.0, 200, 4000
    level, speed, moved = np.zeros(cells), np.zeros(cells + 1), 0.0
    width, dt = length / cells, until / steps
    for k in range(steps):  # velocities stand on faces, half a step behind the level
        slope = np.diff(level) / width
        speed[1:-1] -= dt * (9.81 * slope + push * np.sin(rate * k * dt))
        level -= dt * depth * np.diff(speed) / width
        moved += dt * speed[1:-1].sum() / cells
    assert sloshed(until, length, depth, push, rate) == pytest.approx(moved, rel=0.01)


def test_the_rod_is_that_of_its_modes():
    """Kinetic energy of a rod on a foot, summed over its modes."""
    n = np.arange(1, 4001, 2)
    height, pull, sound, time = 1.0, 9.81, 10.0, 0.05
    speed = 8 * pull * height / (np.pi**2 * n**2 * sound) * np.sin(n * np.pi * sound * time / (2 * height))
    energy = 0.5 * 1000.0 * 0.4 * height / 2 * (speed**2).sum()
    assert SOLVED["column"].answer() == pytest.approx(energy, rel=1e-6)


def test_a_study_finds_the_exact_answer_and_foresees_a_finer_run():
    """At coarser levels than the page's, so that NumPy is fast enough."""
    slab = SOLVED["slab"]
    found = slab.study("slab", levels=3, finer=1, backend="numpy", knobs=("spacing",))
    limit, answer = found.convergence, slab.answer()
    assert limit.asymptotic
    assert 1.5 < limit.order < 2.2
    assert abs(limit.value - answer) < limit.uncertainty
    finer = studies.further(found, slab, None, "numpy")
    finest = found.of("spacing")[-1][1]
    assert finer.run.particles > finest.particles
    assert abs(finer.run.value - finer.value) < 0.2 * abs(finer.run.value - finest.value)
    assert abs(finer.run.value - answer) < abs(finest.value - answer)


def test_the_pool_over_the_torus_is_that_of_its_volume():
    """Of an incompressible liquid by the mesh's volume; compressed, it sinks by g H^2/(3 c^2) or so."""
    trimesh = pytest.importorskip("trimesh")
    file = studies.SCENES / "torus.obj"
    ring = trimesh.load(file)
    depth = (0.6**3 + ring.volume) / 0.8**2
    centre = (0.5 * 0.8**2 * depth**2 - 0.2 * ring.volume) / 0.6**3
    assert studies.poured(0.6**3, 0.8, file, 1e6) == pytest.approx(centre, rel=1e-5)
    assert SOLVED["torus"].answer() == pytest.approx(centre - 9.81 * depth**2 / (3 * 40.0**2), rel=5e-4)
