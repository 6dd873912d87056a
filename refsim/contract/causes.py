"""Why answers are wrong: signs of each wrong answer, and a vote over all trials of an operation.

A sign is what altered inputs give by the oracle in all rows, what the arrays show, or how the program answers to fewer
particles. Which trials and rows are wrong alone is found beside the right ones. Where most wrong answers share no sign,
what differs is told, and nothing else.
"""

import collections
import contextlib
import itertools
import re
import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from refsim.contract.bounds import errors, oracle, takes_neighbours
from refsim.contract.inputs import Inputs, distances, period_of, subset, without_walls
from refsim.contract.parameters import KERNELS, groups_of, kernel_of, scaled, shape_acts, with_kernel
from refsim.contract.target import MOST_SEEKING, MOST_SOUGHT, Judged, Outcome, Target, named_worst, on_one_core, worst
from refsim.core.operation import Operation
from refsim.smoothing import SHAPES
from refsim.smoothing.shapes import NORMALISATION

NEAR = 1e-3  # share of its effect by which an answer may differ from what a sign predicts
MOST_PARTICLES = 400  # of inputs for which oracle and program are called again
REPEATS = 6  # calls with the same inputs
CAPACITY = 8  # neighbours, rows or particles, from which on their number may spoil an answer
NONE = 2**40  # above all numbers of rows and neighbours
REFUSED = (ArithmeticError, TypeError, ValueError, LookupError, AttributeError)  # of an oracle that gets altered inputs
NUMBER = re.compile(r"\d[\d.e+,]*")
SHARES = {"0 in place of": 0.0, "the opposite sign of": -1.0, "half of": 0.5, "twice": 2.0}
NUMBERED = {"neighbours": "with up to # neighbours", "row": "up to row #", "particles": "with up to # particles"}


def judgement(target: Target, judged: Judged) -> Outcome:
    """The outcome of an answer with its traits; of a wrong one with its signs and the values of its worst row."""
    error, told, more = worst(judged.found), named_worst(judged.found, judged.rows), dict[str, Any]()
    with np.errstate(all="ignore"):  # which a library may have changed for the whole process
        traits = traits_of(target, judged)
        if not error <= 1 and not target.faults:
            began, sought, wrong = time.process_time(), target.sought, Wrong(target, judged)
            most = MOST_SOUGHT if len(judged.inputs["position"]) >= CAPACITY else 3  # few particles say less
            traits["sought"] = sought.answers < most and sought.seconds < MOST_SEEKING
            signs = tuple(wrong.signs(traits["sought"]))
            told, more = signs[0] if signs else wrong.words, {"signs": signs, "values": wrong.values()}
            sought.answers, sought.seconds = sought.answers + 1, sought.seconds + time.process_time() - began
    return target.outcome(error, told, telling=judged.telling, traits=traits, **more)


def traits_of(target: Target, judged: Judged) -> dict[str, Any]:
    """What the inputs have, and (largest of a right row, least of a wrong one) of numbers of rows and neighbours."""
    inputs, operation, found = judged.inputs, target.operation, judged.found.values()
    x = inputs["position"]
    given = [n for n in operation.optional if n in operation.arguments("numpy") and inputs[n] is not None]
    keys = [f"with {name}" for name in given if name != "walls" or len(inputs["walls"].position)]
    shapes = [int(inputs[name].shape) for name in KERNELS if name in shape_acts(operation)]
    keys += [f"with the kernel {name}" for name, number in SHAPES.items() if number in shapes]
    rows = np.arange(len(x)) if judged.rows is None else judged.rows
    bad = [~(np.asarray(r).reshape(len(rows), -1) <= 1).all(1) for r in found if 0 < len(rows) == len(r)]
    wrong = np.any(bad, axis=0) if bad else np.zeros(len(rows), bool)
    numbers = {"particles": (np.array([len(x)]), np.array([not worst(judged.found) <= 1]))}
    numbers |= {"row": (rows, wrong)} if judged.rows is None else {}
    if takes_neighbours(operation) and len(rows):
        near = [
            (d < reach_of(operation, inputs)).sum(1) - 1
            for _, d in distances(x, x, judged.rows, period_of(operation, inputs))
        ]
        numbers["neighbours"] = np.concatenate(near), wrong
    traits: dict[str, Any] = dict.fromkeys((f"in {inputs.case.dim} dimensions", f"in {target.dtype}", *keys), True)
    for name, (of_rows, off) in numbers.items():
        traits[name] = [int(of_rows[~off].max(initial=-1)), int(of_rows[off].min(initial=NONE))]
    return traits


def first_cause(outcomes: Sequence[Outcome]) -> str:
    """What most wrong answers of an operation have in common, in words; "" where none is wrong."""
    failed = [o for o in outcomes if not (o.passed or o.not_judged)]
    wrong = [o for o in failed if o.traits] or failed
    voting = [o for o in wrong if o.traits.get("sought", not o.values)] or wrong
    votes, words = collections.Counter[str](), dict[str, str]()
    for o in voting:
        for place, sign in enumerate(o.signs or (() if o.values else (o.words,))):
            key = NUMBER.sub("#", sign)
            votes[key] += 100 - min(place, 9)  # of as many the more specific first
            words.setdefault(key, sign)
    best = max(votes, key=lambda key: votes[key], default="")
    differs = f"{len(failed)} of {sum(not o.not_judged for o in outcomes)} trials are wrong"
    first = words[best] if 2 * votes[best] > 90 * len(voting) else differs
    return "; ".join([first, *conditions(outcomes, [o for o in wrong if o.traits])]) if failed else ""


def conditions(outcomes: Sequence[Outcome], wrong: Sequence[Outcome]) -> Iterator[str]:
    """From which number of neighbours, rows or particles on trials are wrong; else with what alone."""
    right = [o for o in outcomes if o.passed and o.telling and o.traits]
    for name, words in NUMBERED.items():
        most = max((o.traits[name][0] for o in (*right, *wrong) if name in o.traits), default=NONE)
        least = min((o.traits[name][1] for o in wrong if name in o.traits), default=0)
        if CAPACITY <= most < least < NONE:
            yield f"right {words.replace('#', f'{most:,}')}, wrong from {least:,} on: is a list, or a block, cut off?"
            return
    alone = []
    for key in {key for key, value in (wrong[0].traits.items() if wrong else ()) if value is True} - {"sought"}:
        without = sum(key not in o.traits for o in right)
        if without > 1 and all(key in o.traits for o in wrong):
            alone.append(((len(right) - without) / len(right), key))
    yield from (f"wrong only {key}" for share, key in sorted(alone)[:2] if share <= 2 * min(alone)[0] + 0.1)


class Wrong:
    """The worst output of a wrong answer. Arrays have one row for each particle that is compared."""

    def __init__(self, target: Target, judged: Judged) -> None:
        self.target, self.judged, self.inputs, self.operation = target, judged, judged.inputs, target.operation
        self.name = max(judged.found, key=lambda n: float(np.max(judged.found[n], initial=0.0)))
        ratio = np.asarray(judged.found[self.name])
        self.ratio, self.every = ratio.reshape(len(ratio), -1).max(1), np.arange(len(ratio))
        sampled = judged.rows is not None and len(judged.rows) == len(ratio)
        self.number = np.asarray(judged.rows) if sampled else self.every
        rows = slice(None) if len(judged.after[self.name]) == len(ratio) else self.number
        self.before, self.after = (np.asarray(v[self.name], float)[rows] for v in (judged.before, judged.after))
        self.adds = self.name in self.operation.adds
        self.got = self.after - self.before if self.adds else self.after
        self.right, scale = (np.asarray(part, dtype=float) for part in judged.answer[self.name])
        self.scale = lengths(np.broadcast_to(scale, self.right.shape))
        self.wrong, self.error = ~(self.ratio <= 1), lengths(self.got - self.right)
        self.worst = int(np.argmax(self.ratio))
        bound = self.error / np.where(self.ratio > 0, self.ratio, np.nan)
        self.bound = np.where(np.isfinite(bound), bound, np.nanmedian(bound) if np.isfinite(bound).any() else 0.0)
        self.taken, self.count = self.operation.arguments("numpy"), len(self.inputs["position"])
        self.own = self.inputs.per_particle(self.name)
        self.sums = self.own and takes_neighbours(self.operation)
        per = [n for n in self.taken if n != "position" and self.inputs.per_particle(n) and self.inputs[n] is not None]
        self.fields = [n for n in per if self.inputs[n].dtype.kind == "f"]
        self.words = f"your program gives a wrong {self.name} in {self.wrong.sum()} of {self.wrong.size} rows"

    def signs(self, deep: bool) -> list[str]:
        """Signs of the first kind that has any; with `deep` oracle and program are called."""
        few = self.own and deep and self.count <= MOST_PARTICLES
        deeper = (self.plain, self.unsteady, self.shown, self.predicted, self.by_rows, self.sized, self.probed)
        for seek in deeper if few else (self.plain, self.shown, self.sized):
            with contextlib.suppress(*REFUSED):
                if found := list(seek()):
                    return found
        return []

    def plain(self) -> Iterator[str]:
        """An output that is not written, not finite, or overwritten."""
        name, broken = self.name, ~np.isfinite(self.got).reshape(len(self.got), -1).all(1)
        if np.array_equal(self.before, self.after, equal_nan=True):
            yield f"your program {'adds nothing to' if self.adds else 'does not change'} {name}"
        elif broken.any():
            apart = [float(self.apart(i).min()) for i in self.number[broken]] if self.sums else [1.0]
            where = "" if any(apart) else ", where two particles coincide (r = 0)"
            yield f"your program gives {name} that is NaN or infinite ({broken.sum()} of {broken.size} rows){where}"
        elif self.adds and np.any(self.before) and self.agrees(self.right - self.before, self.every):
            yield f"your program overwrites {name}; it must add to what stands there"

    def shown(self) -> Iterator[str]:
        """What the values have in common: one factor, one amount, other rows, one component."""
        name, off, large = self.name, self.got - self.right, np.abs(self.right) > NEAR * np.abs(self.right).max()
        if name in self.operation.exact or large.sum() < 2:
            return
        ratios, eps = self.got[large] / self.right[large], float(np.finfo(self.target.dtype).eps)
        factor, kernel, dim = float(np.median(ratios)), kernel_of(self.operation, self.inputs), self.inputs.case.dim
        same = np.abs(ratios - factor).max() < 0.02 * min(abs(factor - 1), abs(factor)) + 8 * eps
        if same and abs(factor - 1) > 1e-6:
            words = "with the opposite sign" if abs(factor + 1) < NEAR else f"{factor:.5g} times as large as right"
            norms = {2: 0.0, 3: 1.0} if kernel is None else NORMALISATION[int(kernel.shape)]
            if abs(factor * norms[dim] - norms[5 - dim]) < NEAR * norms[dim]:
                words = f"with the kernel's normalisation for {5 - dim} dimensions"
            yield f"your program gives {name} {words}, in all rows"
        elif self.agrees(self.right + np.median(off, 0), self.every):
            yield f"your program gives {name} with the same amount too much or too little in all rows"
        elif not np.allclose(self.got, self.right) and np.allclose(np.sort(self.got, 0), np.sort(self.right, 0)):
            yield f"your program gives the right values of {name} in other rows"
        elif self.right.ndim == 2:
            bad = (np.abs(off) > self.bound[:, None]).any(0)
            if (~bad & np.any(self.right, axis=0)).any():
                yield f"{name} is wrong in {', '.join('xyz'[c] for c in np.flatnonzero(bad))} alone"

    def sized(self) -> Iterator[str]:
        """What the size of the errors says, and the numbers of the wrong rows."""
        terms, first = np.maximum(np.maximum(self.scale, lengths(self.right)), 1e-300), int(np.argmax(self.wrong))
        signs = np.sign((self.got - self.right).reshape(len(self.got), -1)[self.wrong, 0])
        mixed = min((signs > 0).sum(), (signs < 0).sum()) > 0.2 * len(signs)
        summed = 8 * terms.mean() * self.count * np.finfo("f4").eps  # the rounding of a sum over all particles
        share, most = np.median((self.error / terms)[self.wrong]), 2e-5 if mixed else 2e-6
        if self.target.dtype == "float64" and 4e-9 < share < most:
            yield f"the error of {self.name} has the size of single precision: is something computed in float32?"
        elif self.target.dtype == "float32" and mixed and self.error.max() <= summed:
            yield f"the error of {self.name} has the size of the rounding of a sum over all particles in float32"
        if self.count > 2**16 and self.sums:
            high = np.array([max(i, *self.near(int(i)), 0) >= 2**16 for i in self.number])
            if high[self.wrong].all() and not high.all():
                yield f"{self.name} is wrong where a particle's number exceeds 65,535: is an index held in 16 bits?"
        if self.own and self.judged.rows is None and self.count > CAPACITY and first and self.wrong[first:].all():
            yield f"the last rows of {self.name} are wrong, from row {self.number[first]} on"

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
            if (lengths(other[self.number] - self.after) > self.bound).any():
                words = "a race between threads, or memory that is read before it is written"
                words = f"your program gives other values of {self.name} for the same inputs: {words}"
                self.target.sought.unsteady = words
                yield words
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
        """The first sign of altered inputs that give the program's answer in all rows."""
        for words, inputs in self.altered():
            with contextlib.suppress(*REFUSED):
                answer = oracle(self.operation, inputs, self.number)[self.name][0]
                part, off = self.right - answer, self.got - self.right
                large = np.abs(part) > NEAR * np.abs(part).max(initial=0.0)
                share = float(np.median(off[large] / part[large])) if "without" in words and large.any() else 0.0
                if self.agrees(answer, self.every):
                    yield words
                    return
                if share and self.agrees(self.right + share * part, self.every):
                    yield f"the part of {words.split()[-1]} is {1 + share:.5g} times as large as right"
                    return

    def by_rows(self) -> Iterator[str]:
        """The first sign of what differs from row to row that gives the answer in some of the wrong rows."""
        order = [int(k) for k in np.argsort(-self.error, kind="stable") if self.wrong[k]]
        rows = np.array([*order[:2], order[len(order) // 2]][: len(order)])
        found = [dict(self.of_row(int(k))) for k in rows if self.sums]
        for words in found[0] if found else ():
            change = np.array([row[words] for row in found]).reshape(self.right[rows].shape) - self.right[rows]
            large, off = np.abs(change) > NEAR * np.abs(change).max(initial=0.0), (self.got - self.right)[rows]
            fitted = len(rows) > 2 and large.any() and "neighbour" not in words
            share = float(np.median(off[large] / change[large])) if fitted else 1.0
            if share > 0 and self.agrees(self.right[rows] + share * change, rows):
                yield words if abs(share - 1) < NEAR else f"{words}, by a share of {share:.3g}"
                return

    def of_row(self, k: int) -> Iterator[tuple[str, np.ndarray]]:
        """(words, the k-th row): a particle's own value for all, without or twice itself, or one of its neighbours."""
        i, right, inputs = int(self.number[k]), np.atleast_1d(self.right[k]), self.inputs
        alone = self.answer(without_walls(self.some([i])))
        for words, sign in (("leaves out the particle itself", -1), ("counts the particle itself twice", 1)):
            yield f"your program {words}", right + sign * alone
        for name in self.fields:
            own = np.broadcast_to(inputs[name][i], inputs[name].shape).copy()
            yield f"the answer has {name}_i in place of {name}_j", self.answer(inputs.replaced(**{name: own}), i)
            other, lone = -inputs[name], inputs[name].copy()
            other[i], lone[i] = inputs[name][i], 0
            yield f"the answer is that without {name}_i", self.answer(inputs.replaced(**{name: lone}), i)
            yield f"the answer has -{name}_j in place of {name}_j", self.answer(inputs.replaced(**{name: other}), i)
        pairs = (self.answer(without_walls(self.some([i, j]))) for j in self.near(i)[:80])
        adds = np.array([np.atleast_1d(both - alone) for both in pairs]).reshape(-1, len(right))
        for words, sign in (("is missing", -1), ("is counted twice", 1)) if len(adds) else ():
            best = int(np.argmin(np.abs(self.got[k] - right - sign * adds).sum(1)))
            yield f"off by one: in each wrong row one neighbour {words}", right + sign * adds[best]

    def altered(self) -> Iterator[tuple[str, Inputs]]:
        """(words, inputs that would give the program's answer in all rows)."""
        operation, inputs, taken = self.operation, self.inputs, self.taken
        other = inputs.replaced
        if any(name in taken for name in KERNELS):
            for words, share in (("half the support radius: h/2", 0.5), ("twice the support radius: 2 h", 2.0)):
                yield f"the answer is that of {words} in place of h", scaled(operation, inputs, share)
            for shape in SHAPES if shape_acts(operation) else ():
                yield f"the answer is that of the kernel {shape}", with_kernel(operation, inputs, shape)
        if "mass" in taken and "density" in taken:
            yield "the answer has m_j/rho_j in place of m_j", other(mass=inputs["mass"] / inputs["density"])
            yield "the answer has m_j in place of m_j/rho_j", other(mass=inputs["mass"] * inputs["density"])
        for name in (n for n in operation.optional if n in taken and inputs[n] is not None):
            without = without_walls(inputs) if name == "walls" else other(**{name: None})
            yield f"the answer is that without {name}", without
        for name, group in groups_of(operation, inputs).items():
            for (member, value), (words, share) in itertools.product(group._asdict().items(), SHARES.items()):
                if name not in (*KERNELS, "period") and np.ndim(value) == 0:
                    changed = group._replace(**{member: type(value)(share * value)})
                    yield f"the answer has {words} {name}.{member}", other(**{name: changed})
        for name, (words, share) in itertools.product(self.fields, SHARES.items()):
            yield f"the answer has {words} {name}", other(**{name: inputs[name] * inputs[name].dtype.type(share)})
        for name in self.fields:
            yield f"the answer has the square of {name}", other(**{name: inputs[name] ** 2})
        yield "the answer is that in the plane z = 0", other(position=inputs["position"] * [1, 1, 0])
        if "walls" in taken and inputs["walls"] is not None:
            for axis, turn in zip("xyz", 1 - 2 * np.eye(3, dtype=inputs.dtype)):
                mirrored = inputs["walls"]._replace(position=inputs["walls"].position * turn)
                yield f"the wall particles are mirrored: {axis} has the wrong sign", other(walls=mirrored)

    def agrees(self, prediction: np.ndarray, rows: np.ndarray) -> bool:
        """Whether a prediction for some rows is the program's answer, and not the right one in the wrong rows."""
        effect, bound = lengths(prediction - self.right[rows]), self.bound[rows]
        close = lengths(prediction - self.got[rows]) <= np.maximum(8 * bound, NEAR * effect)
        return bool(close.all()) and (self.wrong[rows] & (effect > 4 * bound)).sum() >= min(2, int(self.wrong.sum()))

    # Neighbours

    def some(self, keep: Any) -> Inputs:
        """The inputs with some of the particles."""
        return subset(self.operation, self.inputs, np.asarray(keep, dtype=int))

    def answer(self, inputs: Inputs, row: int = 0) -> np.ndarray:
        """The oracle's answer to altered inputs in one row."""
        return oracle(self.operation, inputs, np.array([row]))[self.name][0][0]

    def apart(self, i: int) -> np.ndarray:
        """Distances [m] of all particles' nearest images from particle i, infinite of its own."""
        x, period = self.inputs["position"], period_of(self.operation, self.inputs)
        (found,) = np.concatenate([d for _, d in distances(x, x, np.array([i]), period)])
        return np.where(np.arange(self.count) == i, np.inf, found)

    def near(self, i: int, share: float = 1.0) -> np.ndarray:
        """Numbers of the particles within `share` of the support radius of particle i, the nearest first."""
        distance = self.apart(i)
        return np.argsort(distance, kind="stable")[
            : int((distance < share * reach_of(self.operation, self.inputs)).sum())
        ]

    def values(self) -> dict[str, Any]:
        """The worst row in numbers."""
        k, i = self.worst, int(self.number[self.worst])
        got, right = (np.asarray(v[k]).tolist() for v in (self.got, self.right))
        bound = float(self.error[k] / self.ratio[k]) if np.isfinite(self.ratio[k]) else None
        told = {"output": self.name, "row": i, "got": got, "expected": right, "error": float(self.error[k])}
        return told | {"bound": bound, "neighbours": len(self.near(i)) if self.sums else 0}


def reach_of(operation: Operation, inputs: Inputs) -> float:
    """The support radius [m]."""
    kernel = kernel_of(operation, inputs)
    return float(inputs.case.list_radius if kernel is None else kernel.support_radius)


def lengths(values: np.ndarray) -> np.ndarray:
    """Length of each row, of whatever shape."""
    return np.sqrt((np.asarray(values, dtype=float).reshape(len(values), -1) ** 2).sum(1))
