"""The share of the space that walls leave around a gauge, and pressures that are noted."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from refsim import Gauge, Gravity, WeaklyCompressible
from refsim.core.period import period_group
from refsim.engine.gauges import Gauges
from refsim.smoothing import smoothing
from refsim.smoothing.reference import kernel_value


@pytest.mark.parametrize("lengths", [(0.0, 0.0, 0.0), (1.5, 0.0, 0.0)])
def test_walls_leave_a_share_of_the_space_around_a_point(lengths):
    """By a sum over all wall particles and their images; with less than a tenth a point lies in the wall."""
    rng, kernel = np.random.default_rng(3), smoothing("wendland_c2", 0.26, 2)
    walls = np.column_stack([rng.uniform(0, 1.5, 400), rng.uniform(-0.5, 0.5, 400), np.zeros(400)])
    volume = rng.uniform(0.001, 0.003, 400)
    volume[np.abs(walls[:, 0] - 0.7) < 0.2] *= 3
    places = np.array([[0.05, 0.1, 0.0], [0.7, 0.0, 0.0], [1.4, -0.2, 0.0], [1.1, 0.45, 0.0]])
    plan = SimpleNamespace(
        walls=SimpleNamespace(position=walls, volume=volume),
        scene=SimpleNamespace(support_radius=0.26, period=lengths),
        shared={"period": period_group(lengths, "float64") if any(lengths) else None, "smoothing": kernel},
    )
    expected = []
    for place in places:
        apart = walls - place
        if lengths[0]:
            apart[:, 0] -= 1.5 * np.round(apart[:, 0] / 1.5)
        filled = (volume * kernel_value(np.sqrt((apart**2).sum(1)), kernel)).sum()
        expected.append(1 - filled if 1 - filled > 0.1 else math.inf)
    assert math.inf in expected
    assert sum(v < 0.9 for v in expected) > 1
    gauges = SimpleNamespace(places=places, _open=None)
    assert Gauges._liquid_share(gauges, plan) == pytest.approx(expected)
    assert Gauges._liquid_share(gauges, None) is gauges._open  # the walls stand
    plan.walls = None
    assert (Gauges._liquid_share(SimpleNamespace(places=places, _open=None), plan) == 1).all()


@pytest.mark.parametrize("sound, spacing", [(10.0, 0.1), (300.0, 0.1), (10.0, 0.5)])
def test_a_pressure_is_noted_that_no_liquid_has_at_a_wall(sound, spacing):
    """Above rho c v and twice the weight, or below that of a support radius or rho c^2/10^4."""
    notes, speed = [], 1.3
    liquid = WeaklyCompressible(sound_speed=sound, rest_density=900.0)
    pull = Gravity(acceleration=(3.0, -4.0, 0.0))
    position = np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 0.0], [0.3, 2.0, 7.0]])
    run = SimpleNamespace(
        plan=SimpleNamespace(
            effects={"weakly_compressible": liquid, "gravity": pull}, state=SimpleNamespace(position=position),
            grid=SimpleNamespace(spacing=spacing, support_radius=2.6 * spacing),
        ),
        backend=SimpleNamespace(host=lambda values: values), extremes=np.array([speed**2, 0.0]), time=0.25,
        add_note=lambda key, words: notes.append((key, words)),
    )  # fmt: skip
    deep = max(3 * x - 4 * y for x, y, _ in position) - min(3 * x - 4 * y for x, y, _ in position)
    most = 900 * (sound * speed + 2 * (deep + 5 * spacing) + sound**2 / 1e4)
    least = -900 * max(5 * 2.6 * spacing, sound**2 / 1e4)
    for instants, advice in ((0, "give it instants"), (4, "take pressure_mean")):
        gauge = Gauge(name="at", kind="pressure", at=(0.0, 0.0, 0.0), every=0.1, instants=instants)
        for pressure, words in (
            (0.999 * most, ""), (1.001 * most, "twice the weight"), (0.999 * least, ""), (1.001 * least, "below zero"),
        ):  # fmt: skip
            notes.clear()
            Gauges._note_pressure(SimpleNamespace(dim=2), run, gauge, pressure)
            assert bool(notes) == bool(words)
            for key, said in notes:
                assert key == "gauge at"
                for part in (words, advice, f"{pressure:.4g} Pa", f"{most if pressure > 0 else -least:.3g} Pa"):
                    assert part in said
    run.plan.effects["particle_shifting"] = SimpleNamespace(surface="none")
    notes.clear()
    Gauges._note_pressure(SimpleNamespace(dim=2), run, gauge, 9 * most)
    assert not notes
