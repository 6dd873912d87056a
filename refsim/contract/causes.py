"""Why answers are wrong: signs of each wrong answer, and a vote over all trials of an operation.

A sign is what the values show, how the program answers to fewer particles, or altered inputs, with an amount that is
fitted, from which the oracle makes the program's answer. What wrong rows and trials have alone is found beside the
right ones. Where most wrong answers share no sign, what differs is told, and nothing else.
"""

import collections
import contextlib
import itertools
import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from refsim.contract.bounds import errors, oracle, size, takes_neighbours
from refsim.contract.inputs import Inputs, distances, period_of, subset, without_walls
from refsim.contract.parameters import KERNELS, groups_of, kernel_of, scaled, shape_acts, with_kernel
from refsim.contract.target import MOST_SEEKING, MOST_SOUGHT, Judged, Outcome, Target, named_worst, on_one_core, worst
from refsim.core.errors import InputError
from refsim.smoothing import SHAPES
from refsim.smoothing.shapes import NORMALISATION

CLOSE = 1e-6  # share of its effect by which an answer may differ from what a sign predicts
NEAR = 1e-3  # by which an amount may differ from one that is told in words
MOST_PARTICLES = 400  # of inputs for which oracle and program are called again
REPEATS = 6  # calls with the same inputs
CAPACITY = 8  # neighbours, rows or particles, from which on their number may spoil an answer
MOST_PAIRS = 80  # neighbours of a row whose shares are computed
REFUSED = (ArithmeticError, TypeError, ValueError, LookupError, AttributeError, InputError)  # of altered inputs
NUMBER = re.compile(r"\d[\d.,]*(?:e[+-]\d+)?")
SOUGHT = ("plain", "unsteady", "shown", "predicted", "by_rows", "sized", "probed")  # kinds of signs
NUMBERED = {
    "neighbours": "with up to # neighbours", "numbers": "with particles' numbers up to #", "row": "up to row #",
    "particles": "with up to # particles",
}  # fmt: skip


def judgement(target: Target, judged: Judged) -> Outcome:
    """The outcome of an answer with its traits; of a wrong one with its signs and the values of its worst row."""
    error, told, more = worst(judged.ratios), named_worst(judged.ratios, judged.rows), dict[str, Any]()
    with np.errstate(all="ignore"):  # which a library may have changed for the whole process
        traits = traits_of(target, judged)
        if not error <= 1 and not target.faults:
            began, sought, wrong = time.process_time(), target.sought, Diagnosis(target, judged)
            most = MOST_SOUGHT if len(judged.inputs["position"]) >= CAPACITY else 3  # few particles say less
            traits["sought"] = sought.answers < most and sought.seconds < MOST_SEEKING
            signs = tuple(wrong.signs(traits["sought"]))
            told, more = signs[0] if signs else wrong.headline, {"signs": signs, "values": wrong.values()}
            sought.answers, sought.seconds = sought.answers + 1, sought.seconds + time.process_time() - began
    return target.outcome(error, told, telling=judged.telling, traits=traits, **more)


def traits_of(target: Target, judged: Judged) -> dict[str, Any]:
    """{what may decide whether a row is wrong: (some values of right rows, least of a wrong one or None)}."""
    inputs, operation, x = judged.inputs, target.operation, judged.inputs["position"]
    rows = np.arange(len(x)) if judged.rows is None else judged.rows
    wrong, telling = np.zeros(len(rows), bool), np.zeros(len(rows), bool)
    for name, ratio in judged.ratios.items():
        if 0 < len(rows) == len(ratio) == len(judged.answer[name][0]):
            wrong |= ~(np.asarray(ratio).reshape(len(rows), -1) <= 1).all(1)
            telling |= np.any(judged.answer[name][0].reshape(len(rows), -1) != 0, axis=1)
    given = [name for name in operation.arguments("numpy") if inputs[name] is not None]
    numbers = {"row": rows, "in odd rows": rows % 2, "at negative coordinates": (x[rows] < 0).any(1)}
    if takes_neighbours(operation) and len(rows):
        period, reach = period_of(operation, inputs), reach_of(operation, inputs)
        near = [d < reach for _, d in distances(x, x, rows, period)]
        numbers["neighbours"] = np.concatenate([found.sum(1) for found in near]) - 1
        numbers["numbers"] = np.concatenate([len(x) - 1 - np.argmax(found[:, ::-1], 1) for found in near])
        beside = {"near walls": (inputs["walls"].position, period)} if "walls" in given else {}
        beside |= {} if period is None else {"with neighbours across a border": (x, None)}
        for name, (source, box) in beside.items():
            near = [(d < reach).sum(1) for _, d in distances(x, source, rows, box)]
            numbers[name] = np.concatenate(near) if box is period else numbers["neighbours"] + 1 - np.concatenate(near)
    shapes = [int(inputs[name].shape) for name in KERNELS if name in shape_acts(operation)]
    whole = {f"in {inputs.case.dim} dimensions": 1, f"in {target.dtype}": 1, "particles": len(x)}
    whole |= {f"with {n}": 1 for n in operation.optional if n in given and (n != "walls" or len(inputs[n].position))}
    whole |= {f"with the kernel {name}": 1 for name, number in SHAPES.items() if number in shapes}
    passed, found = worst(judged.ratios) <= 1, dict[str, Any]()
    for name, values in numbers.items():
        right = np.sort(values[telling & ~wrong])
        some = right[np.linspace(0, len(right) - 1, min(len(right), 11)).astype(int)].tolist()
        found[name] = some, float(values[wrong].min()) if wrong.any() else None
    return found | {name: ([value], None) if passed else ([], value) for name, value in whole.items()}


def first_cause(outcomes: Sequence[Outcome]) -> str:
    """What most wrong answers of an operation have in common, in words; "" where none is wrong."""
    failed = [o for o in outcomes if not (o.passed or o.not_judged)]
    wrong = [o for o in failed if o.traits] or failed
    voting = [o for o in wrong if o.traits.get("sought", not o.values)] or wrong
    votes, words = collections.Counter[str](), dict[str, str]()
    for o in voting:
        for sign in o.signs or (() if o.values else (o.words,)):
            key = NUMBER.sub("#", sign)
            votes[key], words[key] = votes[key] + 1, words.get(key, sign)
    best = max(votes, key=lambda key: votes[key], default="")
    differs = f"{len(failed)} of {sum(not o.not_judged for o in outcomes)} trials are wrong"
    first = words[best] if votes[best] > 0.45 * len(voting) else differs
    return "; ".join([first, *conditions(outcomes, [o for o in wrong if o.traits])]) if failed else ""


def conditions(outcomes: Sequence[Outcome], wrong: Sequence[Outcome]) -> list[str]:
    """From which number of neighbours, rows or particles on answers are wrong, or with what alone, and from which."""
    told = [o for o in outcomes if o.traits and (o in wrong or (o.passed and o.telling))]
    if not wrong or (words := numbered(told, wrong)):
        return words if wrong else []
    found = {key: apart(key, told, wrong) for key in wrong[0].traits.keys() - {"sought", *NUMBERED}}
    alone = sorted((share, key) for key, (_, _, share, without) in found.items() if without > 1)
    keys = [key for share, key in alone[:2] if share <= 2 * alone[0][0] + 0.1]
    words = numbered([o for o in told if all(key in o.traits for key in keys)], wrong)
    return [*(f"wrong only {key}" for key in keys), *words]


def numbered(told: Sequence[Outcome], wrong: Sequence[Outcome]) -> list[str]:
    """Words of the number from which on answers are wrong."""
    for key, words in NUMBERED.items():
        most, least, *_ = apart(key, told, wrong)
        if CAPACITY <= most < least:
            words = f"right {words.replace('#', f'{most:,.0f}')}, wrong from {least:,.0f} on"
            return [f"{words}: is a list, a block or an index too short?"]
    return []


def apart(key: str, told: Sequence[Outcome], wrong: Sequence[Outcome]) -> tuple[float, float, float, int]:
    """(largest of right rows, least of wrong ones, share of right rows not below, trials with rows below it)."""
    least = min(o.traits.get(key, ((), None))[1] or 0 for o in wrong)
    right = [np.asarray(o.traits.get(key, ([0.0],))[0]) for o in told]
    below = [float((values < least).mean()) for values in right if len(values)]
    most = max((float(values.max(initial=0)) for values in right), default=0.0)
    return most, least, 1 - sum(below) / max(len(below), 1), sum(share > 0 for share in below)


class Diagnosis:
    """The worst output of a wrong answer. Arrays have one row for each particle that is compared."""

    def __init__(self, target: Target, judged: Judged) -> None:
        self.target, self.judged, self.inputs, self.operation = target, judged, judged.inputs, target.operation
        self.name = max(judged.ratios, key=lambda n: float(np.max(judged.ratios[n], initial=0.0)))
        ratio = np.asarray(judged.ratios[self.name])
        self.ratio, self.every = ratio.reshape(len(ratio), -1).max(1), np.arange(len(ratio))
        sampled = judged.rows is not None and len(judged.rows) == len(ratio)
        self.number = np.asarray(judged.rows) if sampled else self.every
        rows = slice(None) if len(judged.after[self.name]) == len(ratio) else self.number
        given = (judged.before[self.name][rows], judged.after[self.name][rows], *judged.answer[self.name])
        *values, scale = (np.asarray(v, float).reshape(np.shape(v)[0] if np.ndim(v) else 1, -1) for v in given)
        (self.before, self.after, self.right), self.adds = values, self.name in self.operation.adds
        self.got = self.after - self.before if self.adds else self.after
        self.scale = size(np.broadcast_to(scale, self.right.shape))
        self.wrong, self.off = ~(self.ratio <= 1), self.got - self.right
        self.error, self.worst = size(self.off), int(np.argmax(self.ratio))
        bound = self.error / np.where(self.ratio > 0, self.ratio, np.nan)
        self.bound = np.where(np.isfinite(bound), bound, np.nanmedian(bound) if np.isfinite(bound).any() else 0.0)
        self.taken, self.count = self.operation.arguments("numpy"), len(self.inputs["position"])
        self.per_particle = self.inputs.per_particle(self.name)
        self.sums = self.per_particle and takes_neighbours(self.operation)
        per = [n for n in self.taken if n != "position" and self.inputs.per_particle(n) and self.inputs[n] is not None]
        self.fields = [n for n in per if self.inputs[n].dtype.kind == "f"]
        self.headline = f"your program gives a wrong {self.name} in {self.wrong.sum()} of {self.wrong.size} rows"

    def signs(self, deep: bool) -> list[str]:
        """The first sign that there is; with `deep` oracle and program are called."""
        deep = self.per_particle and deep and self.count <= MOST_PARTICLES
        for seek in SOUGHT if deep else ("plain", "shown", "sized"):
            with contextlib.suppress(*REFUSED):
                if found := list(itertools.islice(getattr(self, seek)(), 1)):
                    return found
        return []

    def plain(self) -> Iterator[str]:
        """An output that is not written, not finite, overwritten, or wrong in its last rows."""
        name, broken = self.name, ~np.isfinite(self.got).all(1)
        first = int(np.argmax(self.wrong))
        if np.array_equal(self.before, self.after, equal_nan=True):
            yield f"your program {'adds nothing to' if self.adds else 'does not change'} {name}"
        elif broken.any():
            alone = not self.sums or any(not len(self.near(i, 1e-12)) for i in self.number[broken])
            where = "" if alone else ", where two particles coincide (r = 0)"
            yield f"your program gives {name} that is NaN or infinite ({broken.sum()} of {broken.size} rows){where}"
        elif self.adds and np.any(self.before) and self.agrees(self.right - self.before, self.every):
            yield f"your program overwrites {name}; it must add to what stands there"
        elif (
            self.per_particle
            and self.judged.rows is None
            and 2 * first > self.count > CAPACITY
            and self.wrong[first:].all()
        ):
            yield f"the last rows of {name} are wrong, from row {first} on"

    def shown(self) -> Iterator[str]:
        """What the values have in common: one factor, one amount, other rows, one component."""
        name, some = self.name, self.wrong if self.wrong.sum() > 3 else self.every >= 0
        if name in self.operation.exact or (np.abs(self.right) > NEAR * np.abs(self.right).max()).sum() < 2:
            return
        factor = float((self.got * self.right)[some].sum() / (self.right[some] ** 2).sum())
        kernel, dim = kernel_of(self.operation, self.inputs), self.inputs.case.dim
        times = np.where(some, factor, 1.0)[:, None]
        if abs(factor - 1) > 1e-6 and self.agrees(times * self.right, self.every):
            words = "with the opposite sign" if abs(factor + 1) < NEAR else f"{factor:.5g} times as large as right"
            norms = {2: 0.0, 3: 1.0} if kernel is None else NORMALISATION[int(kernel.shape)]
            if abs(factor * norms[dim] - norms[5 - dim]) < NEAR * norms[dim]:
                words = f"with the kernel's normalisation for {5 - dim} dimensions"
            yield f"your program gives {name} {words}, in {'all' if some.all() else 'the wrong'} rows"
        elif self.agrees(self.right + np.median(self.off, 0), self.every):
            yield f"your program gives {name} with the same amount too much or too little in all rows"
        elif not np.allclose(self.got, self.right) and np.allclose(np.sort(self.got, 0), np.sort(self.right, 0)):
            yield f"your program gives the right values of {name} in other rows"
        elif self.right.shape[1] == 3:
            bad = (np.abs(self.off) > self.bound[:, None]).any(0)
            if (~bad & np.any(self.right, axis=0)).any():
                yield f"{name} is wrong in {', '.join('xyz'[c] for c in np.flatnonzero(bad))} alone"

    def sized(self) -> Iterator[str]:
        """What the size of the errors says."""
        terms = np.maximum(np.maximum(self.scale, size(self.right)), 1e-300)
        signs = np.sign(self.off[self.wrong, 0])
        mixed = min((signs > 0).sum(), (signs < 0).sum()) > 0.2 * len(signs)
        summed = 8 * terms.mean() * self.count * np.finfo("f4").eps  # the rounding of a sum over all particles
        share, (least, most) = (
            np.quantile((self.error / terms)[self.wrong], 0.9),
            (1e-13, 3e-6) if mixed else (4e-9, 2e-6),
        )
        if self.target.dtype == "float64" and least < share < most:
            yield f"the error of {self.name} has the size of single precision: is something computed in float32?"
        elif self.target.dtype == "float32" and mixed and self.error.max() <= summed:
            yield f"the error of {self.name} has the size of the rounding of a sum over all particles in float32"

    # What the program gives for the same and for fewer particles

    def right_on(self, keep: Any, row: int | None = None) -> bool:
        """Whether the program is right for some of the particles, in all rows or one."""
        quiet, inputs, rows = self.target.quiet(), self.some(keep), None if row is None else np.array([row])
        before, after = quiet.launch(inputs, complete=False)
        answer = {self.name: oracle(self.operation, inputs, rows)[self.name]}
        return bool(worst(errors(self.operation, inputs, before, after, rows, answer)) <= 1) and not quiet.faults

    def unsteady(self) -> Iterator[str]:
        """Other values in another call: with the same inputs, or after a call with others."""
        for number in range(REPEATS):
            with on_one_core(number % 2 == 0):
                other = self.target.quiet().launch(self.inputs, before=self.judged.before)[1][self.name]
            if (size(other[self.number].reshape(self.after.shape) - self.after) > self.bound).any():
                words = f"your program gives other values of {self.name} for the same inputs: a race between threads,"
                self.target.sought.unsteady = f"{words} or memory that is read before it is written"
                yield self.target.sought.unsteady
                return
        fewer = np.arange(self.count - 3 - self.target.sought.answers)  # a number that was not yet there
        if self.sums and len(fewer) > 4 and self.right_on(fewer) and not self.right_on(fewer[::-1]):
            yield f"{self.name} depends on the calls before: is a list of neighbours kept from other positions?"

    def probed(self) -> Iterator[str]:
        """What the program makes of the worst particle alone, with one beyond its reach, and with all within."""
        i, reach = int(self.number[self.worst]), self.near(int(self.number[self.worst]), 1.0 + self.inputs.case.skin)
        if not self.right_on([i], 0):
            yield f"{self.name} is wrong for a particle alone"
        elif not all(self.right_on([i, j], 0) for j in reach[len(self.near(i)) :][:2]):
            yield f"{self.name} counts particles beyond the support radius: there is no cut at r = h"
        elif self.right_on([i, *reach], 0):
            yield f"{self.name} is right for a particle with its neighbours, and wrong with particles out of reach"

    # What the oracle predicts

    def predicted(self) -> Iterator[str]:
        """Altered inputs that give the program's answer in all rows."""
        for say, inputs in self.altered():
            yield from self.fitted(say, lambda s, given=inputs: self.answer(given(s), self.number), self.every)

    def by_rows(self) -> Iterator[str]:
        """The same of what differs from row to row, in some of the wrong rows."""
        order = [int(k) for k in np.argsort(-self.error, kind="stable") if self.wrong[k]]
        rows = np.array([*order[:2], order[len(order) // 2]][: len(order)])
        for same in zip(*(self.of_row(int(k)) for k in rows if self.sums)):
            yield from self.fitted(same[0][0], lambda s, same=same: np.array([given(s) for _, given in same]), rows)

    def fitted(self, say: Any, answer: Any, rows: np.ndarray) -> Iterator[str]:
        """The words with which an answer is the program's in some rows; their amount by the secant from several."""
        right, off, wrong = self.right[rows], self.off[rows], self.wrong[rows]
        fits = callable(say) and wrong.sum() * right[0].size > 2  # of fewer numbers any amount would
        for amount in (0.0, 2.0, 0.7, 1.3, 1.001) if callable(say) else (0.0,):
            before, last = 1.0, np.zeros_like(right)
            with contextlib.suppress(*REFUSED):
                for _ in range(6):
                    change = answer(amount) - right
                    slope = (change - last) / (amount - before)
                    along = slope[wrong] / (slope[wrong] ** 2).sum()
                    step = float(((off - change)[wrong] * along).sum()) if fits else 0.0
                    for more in (0.0, step):
                        if abs(amount + more - 1) > 1e-6 and self.agrees(right + change + more * slope, rows):
                            yield say(amount + more) if callable(say) else say
                            return
                    missed = (off - change - step * slope)[wrong]
                    if not 1e-9 < abs(step) < 10 or (missed**2).sum() > 0.9 * (off[wrong] ** 2).sum():
                        break
                    before, last, amount = amount, change, amount + step

    def altered(self) -> Iterator[tuple[Any, Any]]:
        """(words, or words of an amount, and inputs of one); 1 is right."""
        operation, inputs, taken, other = self.operation, self.inputs, self.taken, self.inputs.replaced
        if any(name in taken for name in KERNELS):
            yield lambda s: in_place_of("h")(2 ** (s - 1)), lambda s: scaled(operation, inputs, 2 ** (s - 1))
            for shape in SHAPES if shape_acts(operation) else ():
                yield f"the answer is that of the kernel {shape}", lambda _, k=shape: with_kernel(operation, inputs, k)
        for words, power in (("m_j/rho_j in place of m_j", -1.0), ("m_j in place of m_j/rho_j", 1.0)):
            if "mass" in taken and "density" in taken:
                yield f"the answer has {words}", lambda _, p=power: other(mass=inputs["mass"] * inputs["density"] ** p)
        for name in (n for n in operation.optional if n in taken and inputs[n] is not None):
            say = said(f"the part of {name} is # times as large as right", {0: f"the answer is that without {name}"})
            yield say, lambda _, n=name: without_walls(inputs) if n == "walls" else other(**{n: None})
        for name, group in groups_of(operation, inputs).items():
            members = {m: v for m, v in group._asdict().items() if np.ndim(v) == 0 and name not in (*KERNELS, "period")}
            for member, value in members.items():
                changed = lambda s, g=group, m=member, v=value: g._replace(**{m: type(v)(s * v)})  # noqa: E731
                yield in_place_of(f"{name}.{member}"), lambda s, n=name, made=changed: other(**{n: made(s)})
        for name, v in ((name, inputs[name]) for name in self.fields):
            yield in_place_of(name), lambda s, n=name, v=v: other(**{n: v * v.dtype.type(s)})
            yield f"the answer has 1 in place of {name}", lambda _, n=name, v=v: other(**{n: v**0})
            yield f"the answer has the square of {name}", lambda _, n=name, v=v: other(**{n: v**2})
        yield "the answer is that in the plane z = 0", lambda _: other(position=inputs["position"] * [1, 1, 0])
        for axis, turn in zip("xyz", 1 - 2 * np.eye(3)) if "walls" in taken and inputs["walls"] is not None else ():
            mirrored = inputs["walls"]._replace(position=(inputs["walls"].position * turn).astype(inputs.dtype))
            yield f"the wall particles are mirrored: {axis} has the wrong sign", lambda _, w=mirrored: other(walls=w)

    def of_row(self, k: int) -> Iterator[tuple[Any, Any]]:
        """(words, the k-th row of an amount): of the particle itself, of its values and others', of its neighbours."""
        i, right, inputs = int(self.number[k]), self.right[k], self.inputs
        alone = self.answer(without_walls(self.some([i])))
        known = {0: "your program leaves out the particle itself"}
        yield said("your program counts the particle itself # times", known), lambda s: right + (s - 1) * alone

        def others(name: str, values: Any, own: Any) -> np.ndarray:
            values = np.broadcast_to(values, inputs[name].shape).astype(inputs[name].dtype)
            values[i] = own
            return self.answer(inputs.replaced(**{name: values}), i)

        for n, v in ((name, inputs[name]) for name in self.fields):
            words = f"the answer has {n}_i in place of {n}_j"
            mixed = said(f"{words}, but for a share of #", {0: words})
            yield mixed, lambda s, n=n, v=v: others(n, s * v + (1 - s) * v[i], v[i])
            yield in_place_of(f"{n}_j"), lambda s, n=n, v=v: others(n, s * v, v[i])
            yield in_place_of(f"{n}_i"), lambda s, n=n, v=v: others(n, v, s * v[i])
            other = {
                f"{n} of the particle before j": np.roll(v, 1, 0),
                f"{n} of the particle behind j": np.roll(v, -1, 0),
            }
            for word, w in (other | {"1": v**0, "the square": v**2}).items():
                yield f"the answer has {word} in place of {n}_j", lambda _, n=n, v=v, w=w: others(n, w, v[i])
        near = self.near(i)[:MOST_PAIRS]
        pairs = np.array([self.answer(without_walls(self.some([i, j]))) - alone for j in near]).reshape(-1, len(right))
        for s, word in ((-1, "is missing"), (1, "is counted twice")) if len(near) else ():
            add = s * pairs[np.argmin(np.abs(self.off[k] - s * pairs).sum(1))]
            yield f"off by one: in each wrong row one neighbour {word}", lambda _, add=add: right + add
        for word, some in (("lower", near < i), ("higher", near > i)) if len(near) else ():
            say, add = said(f"your program counts neighbours of {word} numbers # times", {}), pairs[some].sum(0)
            yield say, lambda s, add=add: right + (s - 1) * add

    def agrees(self, prediction: np.ndarray, rows: np.ndarray) -> bool:
        """Whether a prediction for some rows is the program's answer, and not the right one in the wrong rows."""
        effect, bound = size(prediction - self.right[rows]), self.bound[rows]
        close = size(prediction - self.got[rows]) <= np.maximum(8 * bound, CLOSE * effect)
        return bool(close.all()) and (self.wrong[rows] & (effect > 4 * bound)).sum() >= min(2, int(self.wrong.sum()))

    # Neighbours

    def some(self, keep: Any) -> Inputs:
        """The inputs with some of the particles."""
        return subset(self.operation, self.inputs, np.asarray(keep, dtype=int))

    def answer(self, inputs: Inputs, rows: Any = 0) -> np.ndarray:
        """The oracle's answer to altered inputs in one row, or several."""
        answer = oracle(self.operation, inputs, np.atleast_1d(rows))[self.name][0]
        return answer.ravel() if np.ndim(rows) == 0 else answer.reshape(len(rows), -1)

    def near(self, i: int, share: float = 1.0) -> np.ndarray:
        """Numbers of the particles within `share` of the support radius of particle i, the nearest first."""
        x, period = self.inputs["position"], period_of(self.operation, self.inputs)
        (distance,) = np.concatenate([d for _, d in distances(x, x, np.array([i]), period)])
        reached = distance < share * reach_of(self.operation, self.inputs)
        order = np.argsort(distance, kind="stable")[: int(reached.sum())]
        return order[order != i]

    def values(self) -> dict[str, Any]:
        """The worst row in numbers."""
        k, i = self.worst, int(self.number[self.worst])
        got, right = (v[k].tolist() if len(v[k]) > 1 else float(v[k, 0]) for v in (self.got, self.right))
        bound = float(self.error[k] / self.ratio[k]) if np.isfinite(self.ratio[k]) else None
        told = {"output": self.name, "row": i, "got": got, "expected": right, "error": float(self.error[k])}
        return told | {"bound": bound, "neighbours": len(self.near(i)) if self.sums else 0}


def said(words: str, known: Mapping[int, str]) -> Callable[[float], str]:
    """Words of an amount, #, with others for some amounts."""
    return lambda s: known.get(round(s, 3)) or words.replace("#", f"{s:.5g}")  # type: ignore[call-overload]


def in_place_of(n: str) -> Callable[[float], str]:
    """Words of a quantity that is so many times as large as right."""
    zero, minus = (f"the answer has {word} in place of {n}" for word in ("0", f"-{n}"))
    return said(f"the answer has # times {n} in place of {n}", {0: zero, -1: minus})


def reach_of(operation: Any, inputs: Inputs) -> float:
    """The support radius [m]."""
    return float(getattr(kernel_of(operation, inputs), "support_radius", inputs.case.list_radius))
