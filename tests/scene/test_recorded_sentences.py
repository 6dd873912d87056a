"""What scenes are refused for or noted on, in numbers; motions and gauges drawn at random; parts of solids."""

import math
import tracemalloc

import msgspec
import numpy as np
import pytest

from refsim import Ball, Box, InputError, make_plan
from refsim.core.effect import Discretisation
from refsim.gauges import due
from refsim.neighbours import coincident_pairs
from refsim.scene import solids
from refsim.scene.files import parse_scene
from refsim.scene.particles import fitting_share
from refsim.scene.refine import _cells, fitting, misfit, notes, refined, resting_step, spaced
from refsim.scene.scene import Scene
from tests.across.test_recorded_scenes import SCENES, of_plan
from tests.running import rows

CHANGES = rows(__file__, "changes")


@pytest.mark.parametrize("name", CHANGES)
def test_changed_scenes_are_refused_or_noted_on_with_the_same_numbers(name, recorded):
    found = {}
    for old, new in CHANGES[name]:
        key = f"{old} -> {new}"
        text = SCENES[name].replace(old, new, 1)
        assert text != SCENES[name], old
        try:
            plan = make_plan(parse_scene(text, "scene"))
            found[key] = "taken", plan.notes, plan.grid.count, of_plan(plan)["step"]
        except InputError as error:
            found[key] = str(error)
    recorded(found)


def test_numbers_that_memory_or_indices_do_not_hold_are_refused_at_their_bound(monkeypatch, recorded):
    grid, found = Discretisation(2, "float64", 0.1, 0.26, 0), {}
    for total, cells, each in (
        (None, 2**31 - 1, 1), (None, 2**31, 1), (1000, 10, 100), (1000, 11, 100), (1000, math.inf, 100),
    ):  # fmt: skip
        monkeypatch.setattr(solids, "host_memory", lambda total=total: {"total": total})
        for of in (None, grid):
            try:
                solids.countable("it", [1.0, cells], each, grid=of)
                found[f"{total} {cells} {of is None}"] = "taken"
            except InputError as error:
                found[f"{total} {cells} {of is None}"] = str(error)
    for mass in (2.999999, 3.000001, 0.33333, 0.33334):
        try:
            found[f"share {mass}"] = fitting_share("it", mass, 1.0)
        except InputError as error:
            found[f"share {mass}"] = str(error)
    assert fitting_share("it", 5.0, 0.0) == 1.0
    recorded(found)


# Other spacings
def test_other_spacings_of_drawn_scenes_are_as_ever(recorded):
    random, found = np.random.default_rng(8), {}
    effects = parse_scene(SCENES["tank"], "tank").effects
    for k in range(12):
        cells = tuple(int(n) for n in random.integers(2, 40, 2))
        second = Box(lower=(5.0, 0.0, 0.0), cells=(int(random.integers(1, 9)), 4, 1))
        parts = [Box(cells=(*cells, 1)), second][: 1 + k % 2]
        if k % 3 == 2:
            parts.append(Ball(center=(9.0, 9.0, 0.0), radius=0.3))
        scene = Scene(
            name="drawn", dim=2, spacing=0.1, support_radius=0.26, fluid=tuple(parts), end_time=0.1,
            effects=effects[:1], step=0.001 * (k % 2),
        )  # fmt: skip
        for count, finer, ratio in ((3, 1, 1.5), (2, 0, 2.0), (3, 2, 1.2), (1, 1, 1.5), (2, 1, 1.05), (2, 1, 4.2)):
            key = f"{k} {count} {finer} {ratio}"
            try:
                factors = spaced(scene, count, finer, ratio)
                made = [refined(scene, f, ["effects.weakly_compressible.dynamic_viscosity"]) for f in factors]
                found[key] = factors, notes(scene, factors), [(s.spacing, s.step, s.fluid, s.effects) for s in made]
            except InputError as error:
                found[key] = str(error)
        found[f"fitting {k}"] = [(fitting(scene, w), misfit(scene, w)) for w in (0.4, 0.77, 1.31, 2.2)]
        found[f"resting {k}"] = resting_step(scene, 0.07, 0.2)
    recorded(found)
    for low, high, spacing in (
        (0.0, 1.0, 0.1), (0.05, 0.35, 0.1), (0.051, 0.349, 0.1), (-0.2, -0.1, 0.3), (0.0, 0.7, 0.2),
    ):  # fmt: skip
        centres = spacing * (np.arange(-50, 50) + 0.5)
        within = ((centres > low + 1e-9) & (centres < high - 1e-9)).sum()
        assert _cells(low, high, spacing) == max(1, within), (low, high, spacing)


def test_places_that_stand_twice_are_found_in_both_precisions():
    random = np.random.default_rng(5)
    for dtype in ("float32", "float64"):
        place = random.integers(0, 7, (150, 3)).astype(dtype) - 3
        place[place == 0] *= random.choice([-1.0, 1.0], (place == 0).sum()).astype(dtype)  # 0 and -0 are one place
        found = coincident_pairs(place)
        groups: dict[tuple, list] = {}
        for k, x in enumerate(place):
            groups.setdefault(tuple(x + 0.0), []).append(k)
        assert len(found) == sum(len(group) - 1 for group in groups.values()) > 10
        assert all(a < b and (place[a] == place[b]).all() for a, b in found)
        assert coincident_pairs(np.unique(place, axis=0)) == []


def test_a_plan_takes_few_bytes_a_particle():
    """Beside what it returns a plan holds little at once: 10 million particles are planned in 1.5 GiB."""
    text = SCENES["a tank that turns"].partition("motion = ")[0].replace("[5, 4, 4]", "[90, 90, 90]")
    scene = parse_scene(f"{text}[effects.weakly_compressible]\nsound_speed = 30.0\n[effects.gravity]\n", "block")
    make_plan(msgspec.structs.replace(scene, fluid=(Box(cells=(4, 4, 4)),)))  # loads what it needs
    tracemalloc.start()
    plan = make_plan(scene)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak / plan.grid.count < 260


def test_gauges_are_due_once_on_each_multiple():
    for every in (0.0, 0.01, 0.3):
        times = np.random.default_rng(1).uniform(0, 0.02, 400).cumsum()
        last, read = None, []
        for time in times:
            if due(every, time, last):
                read.append(time)
                last = time
        if every == 0:
            assert read == list(times)
        else:
            assert len(read) == len({math.floor(t / every) for t in times})
    assert not due(0.0, 1.0, 1.0)
    assert due(0.1, 0.3, 0.2)  # 0.3/0.1 is less than 3
    assert not due(0.1, 0.29, 0.2)
