"""Observables of the panels on particles of which the value is known, and the scenes of their settings."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from refsim.study.panels import FOLDER, abouts, drops, observables, panel
from refsim.study.panels.scenes import PACKED, scene_of

RANDOM = np.random.default_rng(5)


def standing(**given):
    """A simulation of which fields and what else an observable takes are known."""
    fields = {name: np.asarray(value) for name, value in given.pop("fields", {}).items()}
    plan = SimpleNamespace(**given.pop("plan", {}))
    return SimpleNamespace(field=lambda name: fields[name].copy(), evaluate=lambda: None, plan=plan, **given)


def test_forces_and_fronts_are_shares_and_kept_values_the_last_ones(monkeypatch):
    asked = []
    monkeypatch.setattr(
        observables, "column_of", lambda *given: asked.append(given) or SimpleNamespace(side_force=lambda: 4.0)
    )
    plan = {"effects": "these", "state": SimpleNamespace(mass=np.array([1.0, 2.0]))}
    run = standing(plan=plan, gauge=lambda name: {"force_x": np.array([-9.0, -7.0, -6.0])} if name == "wall" else None)
    assert (observables.wall_force(run), asked) == (1.5, [("these", 3.0)])
    monkeypatch.setattr(observables, "observable_of", lambda name, plan: lambda run: 0.7)
    assert observables.front(standing()) == pytest.approx(1.4)
    assert observables.kept(np.zeros(6), [9.0, 8.0, 7.0, 6.0, 5.0, 5.5]) == 5.5
    assert math.isnan(observables.kept(np.zeros(6), [9.0, 8.0, 7.0, 6.0, np.inf, 5.5]))


@pytest.mark.parametrize("dim", [2, 3])
def test_the_pressure_in_balls_is_that_of_the_parts_of_lines_in_them(dim, monkeypatch):
    """Drawn virials of drawn pairs; lines by ten thousand points each."""
    random = np.random.default_rng(dim)
    position, h = random.normal(size=(40, 3)) * [1, 1, dim == 3] + 7.0 * (np.arange(3) < dim), 0.9
    pairs = np.array([(a, b) for a in range(40) for b in range(40) if 0 < math.dist(position[a], position[b]) < h])
    virials = random.normal(size=len(pairs))
    monkeypatch.setattr(drops, "pair_virials", lambda run: (*pairs.T, virials))
    run = standing(fields={"position": position}, plan={"grid": SimpleNamespace(dim=dim, support_radius=h)})
    x, along = position - sum(position) / 40, np.linspace(0.0, 1.0, 10001)[:, None]
    expected = []
    for radius in (0.5, 0.9, 1.6):
        volume = math.pi * radius**2 * (4 * radius / 3 if dim == 3 else 1)
        within = [(((x[a] + along * (x[b] - x[a])) ** 2).sum(1) < radius**2).mean() for a, b in pairs]
        expected.append(sum(part * one for part, one in zip(within, virials)) / (dim * volume))
    assert drops.inner_pressure(run, (0.5, 0.9, 1.6)) == pytest.approx(sum(expected) / 3, rel=1e-3)


@pytest.mark.parametrize("name", ["cuda", "cpu"])
def test_a_detector_is_judged_by_what_it_finds_and_the_seconds_of_its_stages(name, monkeypatch):
    """The wall's seconds of its stages, on a CPU by the processor's share in all, 0.5 of 2 s."""
    clock = {"wall": 100.0, "processor": 7.0}
    own = SimpleNamespace(perf_counter=lambda: clock["wall"], process_time=lambda: clock["processor"])
    monkeypatch.setattr(observables, "time", own)
    with np.load(str(FOLDER / "detection_2d.npz")) as stored:
        surface = stored["surface"].copy()
    true, false = np.flatnonzero(surface), np.flatnonzero(~surface)
    surface[true[:30]], surface[false[:10]] = False, True
    hits = len(true) - 30
    stages = {"surface_detection.scan": 1.0, "surface_normal.sum": 2.0, "sph.density": 5.0}

    def evaluate():
        stages.update({"surface_detection.scan": 1.25, "surface_normal.sum": 4.0, "sph.density": 9.0})
        clock.update(wall=102.0, processor=7.5)

    run = standing(
        plan={"scene": SimpleNamespace(name="detection_2d")}, fields={"surface": surface.astype(int)},
        timings=SimpleNamespace(stages=stages), backend=SimpleNamespace(name=name),
    )  # fmt: skip
    run.evaluate = evaluate
    spent, error = observables.detection_2d(run)
    assert error == pytest.approx(1 - 2 * hits / (len(true) - 20 + len(true)), rel=1e-12)
    assert spent == pytest.approx(2.25 if name == "cuda" else 2.25 / 4, rel=1e-12)
    assert observables.detection_2d.seconds([(9.0, 0), (1.0, 0), (3.0, 0), (4.0, 0)]) == 3.0
    assert observables.detection_2d.seconds([(9.0, 0)]) == 9.0
    assert observables.detection_2d.reduce(None, [(9.0, 0.5), (1.0, 0.25)]) == 0.25


def test_pressures_of_iisph_act_by_both_masses_and_those_of_a_cube_over_its_bottom(monkeypatch):
    position, mass = np.array([[0.0, 0, 0], [3, 4, 0], [99, 0, 0]]), np.array([2.0, 7.0, 1.0])
    given = {
        "position": position,
        "mass": mass,
        "pressure": np.array([8.0, 5.0, 1.0]),
        "density": np.array([2.0, 1, 1]),
    }
    plan = SimpleNamespace(
        grid=SimpleNamespace(support_radius=6.0), effects={"iisph": 1}, shared={"gradient_smoothing": 0}
    )
    monkeypatch.setattr(drops, "_accelerations", lambda run, i, j: np.array([[1.0, 0, 0], [0, 2, 0]]))
    monkeypatch.setattr(drops, "kernel_slope", lambda r, smoothing: -r)
    i, j, half = drops.pair_virials(SimpleNamespace(plan=plan, field=given.get))
    both = 2 * 7 * (8 / 4 + 5) * 25
    assert (i.tolist(), j.tolist(), half.tolist()) == ([0, 1], [1, 0], [(-2 * 3 + both) / 2, (7 * 2 * 4 + both) / 2])
    resting = SimpleNamespace(pressure=lambda y: 100 * y)
    monkeypatch.setattr(
        observables, "column_of", lambda effects, mass: resting if mass == pytest.approx(600.0) else None
    )
    plan = {
        "effects": {}, "state": SimpleNamespace(mass=np.array([2.0, 4.0])),
        "scene": SimpleNamespace(fluid=[SimpleNamespace(lower=(1.0, 2.0, 3.0))]),
    }  # fmt: skip
    place = np.array([[0.0, 0, 3.5], [0.0, 0, 4.0]])
    where, _, known = observables.tank_pressure(standing(plan=plan, fields={"position": place, "pressure": [1.0, 2.0]}))
    exact, chosen, bottom = known(where)
    assert (exact.tolist(), chosen, bottom) == ([50.0, 100.0], slice(None), pytest.approx(981.0))


def test_a_drop_is_measured_against_its_models_flat_surface(monkeypatch):
    entries = [
        {"model": model, "dim": dim, **observables.BASE, "flat_laplace": 0.5 + dim}
        for model in ("dong", "akinci") for dim in (3, 2)
    ]  # fmt: skip
    entries[-1]["flat_laplace"] = 0.75
    monkeypatch.setattr(observables, "sigma_map", lambda: entries)
    monkeypatch.setattr(observables, "liquid_of", lambda effects: SimpleNamespace(dynamic_viscosity=0.06))
    asked = []
    monkeypatch.setattr(drops, "inside", lambda run, radius: asked.append(radius) or (1.0, 3.0))
    monkeypatch.setattr(observables, "inner_pressure", lambda run, reach: float(reach.sum()))
    run = standing(plan={"effects": {"akinci_2013": 1, "gravity": 1}}, steps=0)
    assert observables._drop(run) == (3.0, 0.75)
    assert asked == [pytest.approx((0.06 / 0.03) ** 2)]
    pressure, size, flat = observables.surface_tension_jump(run)
    assert (pressure, size, flat) == (pytest.approx(3.0 * np.linspace(0.4, 0.7, 7).sum()), 3.0, 0.75)
    assert observables.surface_tension_jump.reduce(None, [(1.0, 2.0, 4.0), (3.0, 2.0, 4.0)]) == 1.0


# Scenes
def chosen(of):
    """The base and a setting of each other kind: with the fewest particles among those with the same names of knobs."""
    own, kinds = [p for p in of.points.values() if p.program == "refsim" and not p.gpu], {}
    for point in sorted(own, key=lambda p: (p.particles or 0, p.key)):
        kinds.setdefault((*sorted(point.setting), *sorted(map(str, point.knobs))), point)
    return {p.key: p for p in [of.points[of.about.base], *list(kinds.values())[:3]]}


@pytest.mark.parametrize("name", sorted(abouts().keys() - PACKED))
def test_scenes_of_settings_are_those_that_were_measured(name, recorded):
    """Whoever changes one measures its panel anew."""
    of = panel(name)
    recorded({key: scene_of(of, point) for key, point in chosen(of).items()})
