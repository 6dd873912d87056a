"""Signs of wrong answers: each guess in numbers, lists that are kept, rows beyond their bounds."""

import types

import numpy as np
import pytest

from refsim.contract import Target, causes
from refsim.contract.answers import CLOUDS
from refsim.contract.bounds import errors, oracle
from refsim.contract.causes import SIGNS, Diagnosis, traits_of
from refsim.contract.properties import on_grid
from refsim.contract.target import Judged, Sought
from refsim.core.operation import REGISTRY
from tests import running


def judged(operation, variant, dim, kind, rows=None):
    """A wrong answer: every third row scaled, the last rows, one number more in all rows, or of another sign."""
    target = Target(REGISTRY[operation], "numpy", "float64", variant, seed=1, dims=(2, 3))
    inputs = on_grid(target, CLOUDS[dim])
    answer = oracle(target.operation, inputs, rows)
    before = {n: np.array(inputs.output(target.operation, n), float) for n in answer}
    after = {n: np.array(value) for n, (value, _) in oracle(target.operation, inputs).items()}
    for name in target.operation.adds:
        after[name] += before[name]
    value = after[[*answer][-1]]
    of = np.arange(len(value))
    if kind == "thirds":
        value[::3] *= 1.5
    elif kind == "last":
        value[of > 0.6 * len(of)] *= 0.5
    elif kind == "more":
        value += 0.3 * np.abs(value).mean()
    else:
        value[of % 5 == 2] *= -1.0
    ratios = errors(target.operation, inputs, before, after, rows, answer)
    return target, Judged(inputs, before, after, answer, ratios, rows)


@pytest.mark.parametrize("operation, variant, dim, kind", running.rows(__file__, "guesses"))
def test_guesses_are_as_ever(operation, variant, dim, kind, recorded, monkeypatch):
    """How far each differs from the right answer in three rows, over the size of that; of some rows alone, too."""
    found = {}
    for rows in (None, np.arange(100)[::-1]):
        target, given = judged(operation, variant, dim, kind, rows)
        w = Diagnosis(target, given)
        found[f"arrays {rows is None}"] = [w.ratio > 1, w.number, w.before, w.after, w.right, w.error, w.order, w.wrong]
        bound = w.bound / np.finfo(float).eps
        found[f"bound {rows is None}"] = bound[np.isfinite(bound)] if operation == "sph.density" else len(bound)
        found[f"values {rows is None}"] = {k: v for k, v in w.values().items() if k != "bound"}
        found[f"traits {rows is None}"] = list(traits_of(target, given).values())
        monkeypatch.setattr(w, "right_on", lambda *keep, rows=None: len(keep) == 1)
        for seek in SIGNS:
            told, differ = [], []
            for sentence, made in seek(w):
                told.append(("#" in sentence, made is None))
                for k in w.order[[0, len(w.order) // 2, -1]] if made else ():
                    guess = made(1.7, k)
                    guess = w.answer(guess, w.number[k]) if hasattr(guess, "case") else guess
                    differ.append(np.arcsinh((guess - w.right[k]) / np.abs(w.right).max()))
            found[f"{seek.__name__} {rows is None}"] = np.array(told, float), np.array(differ)
    recorded(found)


@pytest.mark.parametrize("answers, count, asked", [(0, 12, 9), (2, 12, 7), (0, 7, 0), (0, 8, 5), (1, 8, 0)])
def test_a_kept_list_is_looked_for_with_fewer_particles_in_two_orders(answers, count, asked):
    """Right for the first so many and wrong for them in the other order; of four or fewer nothing is asked."""
    calls = []

    def right_on(*keep):
        calls.append(keep)
        return keep[0] == 0

    launch = lambda inputs, before: (None, {"density": np.zeros(count)})  # noqa: E731
    target = types.SimpleNamespace(quiet=lambda: types.SimpleNamespace(launch=launch), sought=Sought(answers))
    w = types.SimpleNamespace(
        name="density", number=np.arange(count), after=np.zeros((count, 1)), bound=np.full(count, 1e-9), sums=True,
        inputs={"position": range(count)}, target=target, judged=types.SimpleNamespace(before={}), right_on=right_on,
    )  # fmt: skip
    assert len(list(causes.unsteady(w))) == (asked > 0)
    assert calls == ([tuple(range(asked)), tuple(range(asked))[::-1]] if asked else [])
    w.sums = False
    assert not list(causes.unsteady(w))
    w.after = np.where(np.arange(count) == count - 1, 1.1e-9, 0.0)[:, None]
    assert len(list(causes.unsteady(w))) == 6
    assert w.target.sought.unsteady
    w.after *= 0.9
    assert not list(causes.unsteady(w))


def test_flags_that_are_right_have_no_error():
    operation = REGISTRY["surface_detection.near_surface"]
    inputs = on_grid(Target(operation, "numpy", "float64", seed=1, dims=(2, 3)), CLOUDS[2])
    answer = oracle(operation, inputs)
    after = {name: np.array(value) for name, (value, _) in answer.items()}
    assert not errors(operation, inputs, after, after, None, answer)["near_surface"].any()


def test_a_row_is_wrong_beyond_its_bound(monkeypatch):
    """Of ratios about 1 and no number; on some particles a program is right with an error of at most its bound."""
    target, given = judged("sph.density", 2, 2, "thirds")
    (name,) = (n for n, ratio in given.ratios.items() if (ratio > 1).any())
    ratios = np.tile([0.5, 1.0, 1.01, 1.9, np.nan], len(given.ratios[name]))[: len(given.ratios[name])]
    w = Diagnosis(target, given._replace(ratios={name: ratios}))
    assert w.name == name
    assert w.wrong.tolist() == (~(ratios <= 1)).tolist()
    known = ratios > 0
    assert w.bound[known] == pytest.approx(w.error[known] / ratios[known])
    assert w.error[ratios == 0.5].any()
    assert set(w.order) == set(np.flatnonzero(w.wrong))
    assert (np.diff(w.error[w.order]) <= 0).all()
    asked = []
    for ratio, expected in ((0.3, True), (1.0, True), (1.01, False), (1.7, False)):
        monkeypatch.setattr(
            causes, "errors", lambda *given, ratio=ratio: asked.append(given) or {name: np.array([ratio])}
        )
        assert w.right_on(3, 1, 2) == expected
    _, inputs, _, after, _, answer = asked[0]
    assert (inputs["position"] == given.inputs["position"][[3, 1, 2]]).all()
    assert after[name].shape == answer[name][0].shape == (3,)
