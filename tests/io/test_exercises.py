"""Exercises of the lessons: wrong answers, three and more to each, are told what is wrong with them."""

import functools
import importlib.util
import json
import pathlib
import re

import matplotlib
import numpy as np
import pytest

from refsim.io.exercises import HELPERS, Exercises, Wrong, called, compare, mask, number, numbers
from refsim.io.lessons import cells, judges, lessons, notebook
from refsim.smoothing import reference, smoothing

ROOT = pathlib.Path(__file__).parents[2]
LESSONS = lessons()
every = pytest.mark.parametrize("name", LESSONS)
SLOW = ("3_cost_of_accuracy", "6_melting", "8_mesh_in_water")  # to compile

# By lesson and exercise: a wrong answer, as the lesson's names give it, and some of what is said of it.
MISTAKES = {
    "0_smoothed_sum": {
        1: {
            "0.5": "straight line",
            "1 / 16": "factor 1 + 4 q is missing",
            "3": "factor (1 - q)^4 is missing",
            "16 / 3": "upside down",
            "kernel(h / 2, h)": "divide it by W(0)",
            "0.9": "put q = 1/2",
            "kernel": "call it, with brackets",
        },
        2: {
            "1": "half of the disc is empty",
            "0": "they count",
            "0.25": "that is a corner",
            "smoothed_sum((0, 0.5), particles, np.ones(400), 1, h)": "not multiplied by the area",
        },
        3: {
            "48": "in each of two directions",
            "24": "more of them fit",
            "6": "more, not fewer",
            "192": "two dimensions",
        },
        4: {
            "0.06": "goes with h²",
            "0.48": "must be smaller",
            "0.24": "has a quarter of it",
            "120": "look at the units",
        },
    },
    "1_surface_particles": {
        1: {
            "0.98": "too high",
            "0.8": "too low",
            "90": "not per cent",
            "0.9 * rest": "divide by `rest`",
        },
        2: {
            "lambda fluid, walls: np.flatnonzero(surface)": "these are indices",
            "lambda fluid, walls: ~surface": "turn the comparison around",
            "lambda fluid, walls: lopsided(fluid, walls[:1], 0.24)": "wall particles are neighbours",
            "lambda fluid, walls: lopsided(fluid, walls, 0.1)": "raise the limit",
            "lambda fluid, walls: lopsided(fluid, walls, 0.4)": "lower the limit",
            "lambda fluid, walls: density / rest": "compare them with a limit",
            "lambda fluid, walls: fluid > 0.05": "one value for each",
            "lambda fluid, walls: density < 0": "marks no particle",
            "lambda fluid: surface": "stops with TypeError",
            "surface": "a function is asked for",
        },
        3: {
            "0.5": "lies between two particles",
            "2**0.5": "the radius is half of it",
            "1": "how far is the middle",
            "d / 2**0.5": "divide by d",
        },
    },
    "2_cube_and_ball": {
        1: {
            "lambda F, n, h: n**2 / 3 * moment(F, h, 3)": "the sign is not",
            "lambda F, n, h: -(n**2) * moment(F, h, 3)": "factor 1/3 is missing",
            "lambda F, n, h: -n / 3 * moment(F, h, 3)": "squared",
            "lambda F, n, h: -(n**2) / 3 * moment(F, h, 2)": "yours has the second",
            "lambda F, n, h: -(n**2) / 3 * moment(F, h, 3) * 2000 / h": "the length of a piece",
            "lambda F, n, h: None": "end the function with `return`",
        },
        2: {"6": "at a smaller h/d", "2.6": "differ by 6 %", "3": "4.5 % off", "4 * d": "divide by d"},
        3: {
            "-13.75": "the sign is wrong",
            "159.9": "this is P in Pa",
            "6.88": "a disc has sigma/R",
            "8.75": "pi/2 is missing",
            "0.0727": "upside down",
        },
    },
    "3_cost_of_accuracy": {
        1: {"10": "steps are missing", "100": "this is 3D", "1000": "this is order 1", "10**0.5": "third power"},
        2: {
            "lambda s: s.field('position')[:, 0].argmax()": "number of the particle",
            "lambda s: s.field('position')[:, 0].mean()": "mean of x",
            "lambda s: s.field('position')[:, 1].max()": "this is the height",
            "lambda s: s.field('position')[:, 0]": "asked for: one number",
        },
        3: {
            "(limit, order)": "three coarsest",
            "extrapolate(spacing[1:], value[1:])[::-1]": "the limit stands first",
            "extrapolate(spacing[[0, 1, 3]], value[[0, 1, 3]])": "neighbouring spacings",
            "limit": "asked for",
        },
    },
    "4_stable_or_not": {
        1: {
            "lambda k: [[1, 1], [-k, 1]]": "old velocity",
            "lambda k: [[1, 1], [-k, 1 - k]]": "the place moves first",
            "lambda k: [[1 - k**2, 1], [-(k**2), 1]]": "the square of the product already",
            "lambda k: [[1 - k, -k], [1, 1]]": "rows and columns",
            "lambda k: [[1 + k, 1], [k, 1]]": "pulls back",
        },
        2: {
            "(4, 4, 8, 8)": "the particles alone",
            "(2, 4, 2, 4)": "the steps alone",
            "(8, 8, 16, 16)": "viscous step shrinks with h²",
            "(16, 16, 32, 32)": "acoustic step shrinks with h",
        },
        3: {
            "('compressed', 2.2)": "too small",
            "('energy_gained', 0.5)": "take more",
            "('energy_gained', 3.0)": "one of 0.2",
            "'energy_gained'": "give a pair",
        },
    },
    "5_equation_to_kernel": {
        1: {
            "row(lambda q, m, s, i: s * (weight(q) * m * (np.arange(len(m)) != i)).sum())": "the particle itself",
            "row(lambda q, m, s, i: (weight(q) * m).sum())": "factor of the kernel",
            "row(lambda q, m, s, i: s * (weight(q) * m[i]).sum())": "m_i in place of m_j",
            "row(lambda q, m, s, i: s * ((1 - q) ** 4 * (1 + 4 * q) * m).sum())": "no cut at r = h",
            "lambda position, mass, smoothing, density: 2 * mass": "nothing is written",
        },
        2: {"100": "n² pairs", "1e6": "computed once", "1e4 / 3600": "hours", "150": "sorting"},
        3: {
            "0": "depends on its order",
            "2.2e-16": "one rounding",
            "4e-16": "what you measured",
            "4.8e-6": "single precision",
        },
    },
    "6_melting": {
        1: {
            "1.79": "not twice as long",
            "1.27": "root of two",
            "7.2": "third power",
            "12900": "in seconds",
            "0.9": "of 20 mm",
        },
        2: {
            "lambda s: s.field('enthalpy').astype(float).sum()": "counts with its mass",
            "lambda s: (s.field('mass').astype(float) * s.field('enthalpy'))[: ice.count].sum()": "the ice alone",
            "lambda s: (s.field('mass').astype(float) * s.field('enthalpy')).mean()": "this is a mean",
            "lambda s: s.field('mass') * s.field('enthalpy')": "one number",
        },
        3: {
            "ice.parted()": "thin bridge",
            "3 * ice.parted()": "not three times",
            "0.012": "without latent",
        },
    },
    "7_particles_and_grid": {
        1: {
            "lambda v, m: v.sum(0)": "masses are missing",
            "lambda v, m: (m[:, None] * v).sum()": "keep x and y apart",
            "lambda v, m: m @ v / m.sum()": "centre of mass",
            "lambda v, m: m[:, None] * v": "add them up",
            "lambda v, m: m * v": "stops with ValueError",
        },
        2: {
            "[spun(False, steps)[0][-1] for steps in (25, 50, 100, 200)]": "do the others last 2 s",
            "(1, 1, 1, 1)": "this is APIC",
            "(0.307, 0.582, 0.768, 0.875)": "the order is",
            "(0.125, 0.232, 0.418, 0.693)": "lost",
        },
        3: {
            "lambda a, b: (a**2).sum() / (b**2).sum()": "upside down",
            "lambda a, b: abs(b).sum() / abs(a).sum()": "square the velocities",
            "lambda a, b: 1 - (b**2).sum() / (a**2).sum()": "lost",
            "lambda a, b: b.sum() ** 2 / a.sum() ** 2": "square of a sum",
        },
    },
    "8_mesh_in_water": {
        1: {"8": "full grid", "2": "two directions", "0.27": "how much it shrinks", "16": "one power less"},
        2: {"1130": "r enters squared", "4520": "fill a volume", "565": "with the radius r", "141": "more, not fewer"},
        3: {
            "lambda start, way: signed(start + way) < 0": "the end alone",
            "lambda start, way: sum(signed(start + t * way) < 0 for t in (0.2, 0.4, 0.6, 0.8, 1)) > 0": "jumps over",
            "lambda start, way: np.ones(len(start), bool)": "stop at the length",
            "lambda start, way: np.flatnonzero(signed(start + way) < 0)": "these are indices",
        },
    },
}
# Names that mistakes need and a lesson has not.
BESIDE = """
def lopsided(fluid, walls, limit):
    offset = np.vstack([fluid, walls])[None] - fluid[:, None]
    near = np.linalg.norm(offset, axis=2) < h
    return np.linalg.norm((offset * near[..., None]).sum(1), axis=1) / near.sum(1) > limit * h

def moment(F, h, power):
    r = np.linspace(0, h, 2001)
    return np.trapezoid(r**power * F(r), r)

def weight(q):
    return (1 - np.minimum(q, 1)) ** 4 * (1 + 4 * np.minimum(q, 1))

def row(one):
    def program(position, mass, smoothing, density):
        for i in range(len(mass)):
            q = np.linalg.norm(position - position[i], axis=1) * smoothing.inverse_radius
            density[i] = one(q, mass, smoothing.value_scale, i)
    return program
"""


@functools.cache
def taught(name):
    """The names of a lesson after its code, without the worked answers."""
    matplotlib.use("Agg")
    from matplotlib import pyplot

    known = {"__name__": name}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pyplot, "show", lambda: pyplot.close("all"))
        for kind, code in cells(LESSONS[name]):
            if kind == "code":
                exec(code, known)
    exec(BESIDE, known)
    return known


@every
def test_each_exercise_has_a_cell_a_judge_and_a_worked_answer(name):
    pieces = cells(LESSONS[name])
    asked = [
        int(found) for kind, text in pieces if kind == "markdown" for found in re.findall(r"^\*\*(\d)\. ", text, re.M)
    ]
    assert asked == list(judges(LESSONS[name])) == list(range(1, len(asked) + 1))
    assert len(asked) >= 3
    for exercise in asked:
        for kind in ("code", "answer"):
            assert sum(f"check({exercise}, " in text for k, text in pieces if k == kind) == 1, (exercise, kind)
    assert list(MISTAKES[name]) == asked
    assert all(len(wrong) >= 3 for wrong in MISTAKES[name].values())


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) if n in SLOW else n for n in LESSONS])
def test_wrong_answers_are_told_what_is_wrong(name):
    known = taught(name)
    said = [verdict.words for verdict in known["check"].verdicts.values()]
    assert all("replace the three dots" in words or "nothing is written" in words for words in said), said
    for exercise, mistakes in MISTAKES[name].items():
        for answer, words in mistakes.items():
            verdict = known["check"].verdict(exercise, eval(answer, known))
            assert not verdict.right, (exercise, answer)
            assert words in verdict.words, (exercise, answer)


def test_lesson_0_sums_as_refsim_does():
    known = taught("0_smoothed_sum")
    r = np.linspace(0, 0.2, 101)
    assert np.allclose(known["kernel"](r, 0.13), reference.kernel_value(r, smoothing("wendland_c2", 0.13, 2)))
    sums = [
        known["smoothed_sum"](x, known["particles"], np.ones(400), 0.05, 0.13) for x in ((0.5, 0.5), (0, 0.5), (0, 0))
    ]
    assert np.allclose(sums, (0.99324, 0.49662, 0.24831), atol=1e-5)


@every
def test_the_notebook_that_the_site_offers_is_the_lesson(name):
    """Written by `python scripts/lessons.py --notebooks docs/lessons`."""
    assert (ROOT / "docs" / "lessons" / f"{name}.ipynb").read_text(encoding="utf-8") == notebook(LESSONS[name])


@every
def test_the_notebook_folds_answers_and_hides_judges(name):
    made = json.loads(notebook(LESSONS[name]))["cells"]
    assert "compare(" not in json.dumps(made)
    folded = [cell for cell in made if cell["metadata"]]
    assert folded[0]["source"].endswith("%pip install -q refsim")
    assert all(cell["metadata"]["jupyter"] == {"source_hidden": True} for cell in folded)
    answers = [text.strip() for kind, text in cells(LESSONS[name]) if kind == "answer"]
    assert [cell["source"].partition("\n")[2] for cell in folded[1:]] == answers
    for cell in made:
        if cell["cell_type"] == "markdown":
            assert cell["source"].count("<details>") == cell["source"].count("</details>")


@pytest.mark.parametrize(
    "wrong, words",
    [
        (lambda: number([1, 2]), "asked for: one number"),
        (lambda: number("two"), "this is 'two'"),
        (lambda: number(None), "lacks its `return`"),
        (lambda: number(float("nan")), "no number"),
        (lambda: number(abs), "call it"),
        (lambda: numbers((1, 2, 3), (4,)), r"array of shape \(4,\)"),
        (lambda: mask([1, 4], 5), "these are indices"),
        (lambda: mask(np.ones(5), 5), "compare them"),
        (lambda: mask(np.ones(4, bool), 5), "each of the 5"),
        (lambda: called(3), "a function is asked for"),
        (lambda: called(lambda: 1 / 0), "ZeroDivisionError"),
        (lambda: called(lambda: None), "`return`"),
        (lambda: compare(-2.0, 2.0, {}), "sign is wrong"),
        (lambda: compare(2000.0, 2.0, {}), "1e3 times"),
        (lambda: compare([2.0, 4.0], [1.0, 2.0], {}), "2 times the right ones"),
        (lambda: compare([1.0, 4.0], [1.0, 2.0], {"mine": [1.0, 4.0]}), "mine"),
        (lambda: compare(5.0, 2.0, {}, hint="think"), "think"),
    ],
)
def test_helpers_say_what_is_wrong(wrong, words):
    with pytest.raises(Wrong, match=words):
        wrong()


def test_check_prints_the_verdict(capsys):
    check = Exercises("0_smoothed_sum", {"kernel": None, "h": 1, "d": 1} | {"kernel": lambda r, h: r})
    check(1, 3 / 16)
    check(1, ...)
    assert capsys.readouterr().out.splitlines() == [
        "Exercise 1: right: (1/2)^4 times 3 is 3/16: near particles count most.",
        "Exercise 1: not yet: replace the three dots by your answer.",
    ]
    assert not check.verdicts[1].right
    assert "compare" in HELPERS


def test_binder_installs_the_clone():
    assert (ROOT / "binder" / "requirements.txt").read_text().split() == ["."]
    assert importlib.util.find_spec("refsim") is not None
