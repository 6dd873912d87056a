"""What scenes are refused for or noted on, in numbers; motions and gauges drawn at random; parts of solids."""

import itertools
import math
import tracemalloc

import msgspec
import numpy as np
import pytest

from refsim import Ball, Box, InputError, Motion, SolidBall, SolidBox, SolidMesh, make_plan
from refsim.core.effect import Discretisation
from refsim.gauges import due
from refsim.motion import pace
from refsim.neighbours import coincident_pairs
from refsim.scene import counting, solids
from refsim.scene.counting import Cells
from refsim.scene.files import parse_scene
from refsim.scene.particles import fitting_share
from refsim.scene.refine import _cells, fitting, misfit, notes, refined, resting_step, spaced
from refsim.scene.scene import Scene
from tests.across.test_recorded_scenes import EXAMPLES, SCENES, of_plan
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


# Shapes and solids


def test_bodies_reach_as_far_as_they_say(recorded):
    bodies = [
        SolidBox(lower=(0.1, 0.2, 0.3), upper=(0.5, 0.7, 0.4)), SolidBall(center=(1.0, 2.0, 3.0), radius=0.25),
        SolidMesh(file=str(EXAMPLES / "cube.obj"), center=(1.0, 2.0, 3.0), size=0.5, rotation=(0.0, 0.0, 45.0)),
        SolidMesh(file=str(EXAMPLES / "pebble.obj"), center=(-1.0, 0.3, 0.0), size=0.7),
    ]  # fmt: skip
    random = np.random.default_rng(1)
    for body in bodies:
        low, high = body.extent()
        points = random.uniform(low - 0.2, high + 0.2, (4000, 3))
        within = points[body.inside(points)]
        assert (within >= low).all()
        assert (within <= high).all()
        assert within.min(0) == pytest.approx(low, abs=0.25 * (high - low).max())
        assert within.max(0) == pytest.approx(high, abs=0.25 * (high - low).max())
    assert bodies[2].extent()[1] == pytest.approx([1.25, 2.25, 3.0 + 0.25 / math.sqrt(2)])
    recorded({str(k): (solids.body_cells(body, "it", 0.1), body.extent()) for k, body in enumerate(bodies)})


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


# How full places are
@pytest.mark.parametrize("many", [counting.MANY, 0])
@pytest.mark.parametrize("dim, period", [(2, 0.0), (3, 0.0), (2, 1.2), (3, 0.9)])
def test_a_lattice_fills_its_cells_with_1_and_sums_are_those_of_splines(dim, period, many, monkeypatch):
    monkeypatch.setattr(counting, "MANY", many)  # with 0 few particles make no table of cells
    grid = Discretisation(dim, "float64", 0.1, 0.26, 0, 0.0, None, (period, 0.0, 0.0))
    axes = [0.1 * (np.arange(n) + 0.5) for n in (round(10 * period) or 17, 17, 17)[:dim]]
    place = np.pad(np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, dim), ((0, 0), (0, 3 - dim)))
    cells, volume = Cells(place, grid), np.full(len(place), 0.1**dim)
    found = cells.at_particles(cells.filled(volume), len(place))
    middle = (np.abs(place[:, 1:dim] - place[:, 1:dim].mean(0)) < 0.06).all(1)
    middle &= (np.abs(place[:, 0] - place[:, 0].mean()) < 0.06) | (period > 0)
    assert middle.any()
    assert cells.wide[0] == pytest.approx(period / round(period / 0.2) if period else 0.2)
    if period != 0.9:  # nine spacings are four cells and a half
        assert found[middle] == pytest.approx(1, abs=1e-9)
    random = np.random.default_rng(3)
    few = random.uniform(0, 0.9, (12, 3)) * ([1.0] * dim + [0.0] * (3 - dim))
    sparse, own = Cells(few, grid), random.uniform(1, 2, 12) * 0.1**dim

    def spline(x):
        x = abs(x)
        return 0.75 - x * x if x < 0.5 else 0.5 * (1.5 - x) ** 2 if x < 1.5 else 0.0

    images = [(-1, 0, 1) if period else (0,), (0,), (0,)]

    def weight(x, cell):
        return math.prod(
            sum(spline((x[a] + k * (period if a == 0 else 0)) / w - cell[a]) for k in images[a])
            for a, w in enumerate(sparse.wide)
        )

    numbers = [range(round(period / sparse.wide[0])) if a == 0 and period else range(-2, 8) for a in range(dim)]
    every = list(itertools.product(*numbers))
    full = [sum(v * weight(x, cell) for x, v in zip(few, own)) / math.prod(sparse.wide) for cell in every]
    known = [sum(weight(x, cell) * f for cell, f in zip(every, full)) for x in few]
    assert sparse.at_particles(sparse.filled(own), 12) == pytest.approx(known, rel=1e-9)
    last = [sum(v * weight(x, cell) for x, v in zip(few[4:], own[4:])) / math.prod(sparse.wide) for cell in every]
    known = [sum(weight(x, cell) * f for cell, f in zip(every, last)) for x in few[:5]]
    assert sparse.at_particles(sparse.filled(own[4:], 4), 5) == pytest.approx(known, rel=1e-9)


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


# Motions and gauges
FORMULAS = ("sin(3*t) + 2", "cos(t)*exp(-t)", "tan(t/2) - t", "log(1 + t)**2", "sqrt(2 + t)/(1 + t**3)", "tanh(2*t)",
            "(1 + t)**(0.5*t)", "-t**3 + 4*t**2 - pi", "+t**0", "t**1 - (2 - t)**-2", "2**t")  # fmt: skip


@pytest.mark.parametrize("motion", [
    *(Motion(of="gravity", kind="formula", direction=(1.0, 2.0, 0.0), formula=f) for f in FORMULAS),
    Motion(of="turn", kind="sway", direction=(0.0, 0.0, 1.0), amplitude=0.2, period=0.7),
    Motion(of="gravity", kind="sway", direction=(0.0, 3.0, 0.0), amplitude=0.2, period=0.7, ramp=0.9),
    Motion(of="gravity", kind="table", direction=(0.0, 3.0, 4.0), times=(0.1, 0.4, 0.5, 0.9),
           values=(0.1, 0.3, 0.2, 0.4)),
], ids=lambda motion: motion.formula or motion.kind)  # fmt: skip
def test_motions_have_the_derivatives_of_their_path(motion):
    """By central differences at many times; the pace is the largest speed over the largest acceleration."""
    step, bends = 1e-4, np.array([0.1, 0.4, 0.5, 0.9])
    times = [t for t in np.linspace(0.013, 0.977, 40) if np.abs(bends - t).min() > 2e-3]
    speeds, pulls = [], []
    for time in times:
        before, now, after = (motion.at(time + d).place for d in (-step, 0.0, step))
        found = motion.at(time)
        assert found.velocity == pytest.approx((after - before) / (2 * step), rel=1e-5, abs=1e-5)
        assert found.acceleration == pytest.approx((after - 2 * now + before) / step**2, rel=1e-3, abs=1e-3)
        speeds.append(abs(found.velocity))
        pulls.append(abs(found.acceleration))
    if max(pulls) > 0:
        assert pace(motion, 1.0) == pytest.approx(max(speeds) / max(pulls), rel=0.3)
    assert np.linalg.norm(motion.unit()) == pytest.approx(1)
    assert np.cross(motion.unit(), motion.direction) == pytest.approx(0)


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
