"""Why answers are wrong: a sign of each wrong answer, and a vote over all trials of an operation.

A sign is what values and further calls show, or a guess of what the program computes, with an amount that is fitted.
Traits are what wrong rows and trials have alone. Where most wrong answers share no sign, it is said what differs alone.
"""

import contextlib
import functools
import re
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from refsim.contract.bounds import errors, oracle, size, takes_neighbours
from refsim.contract.inputs import Inputs, kernel_of, period_of, scaled, shape_acts, subset, with_kernel, without_walls
from refsim.contract.target import RACE, REPEATS, Judged, Outcome, Target, named_worst, on_one_core, worst
from refsim.core.errors import InputError
from refsim.neighbours.reference import pair_blocks
from refsim.smoothing.shapes import NORMALISATION, SHAPES

CLOSE = 1e-6  # share of its effect by which an answer may differ from a guess
CAPACITY = 8  # neighbours, rows or particles, from which on their number may spoil an answer
STARTS = 0.0, 2.0, 0.5, 1.3, 1.001  # amounts from which one is fitted; 1 is right
REFUSED = (ArithmeticError, TypeError, ValueError, LookupError, AttributeError, InputError)  # of altered inputs
Signs = Iterator[tuple[str, Any]]  # words, # for an amount; inputs or answer by amount and row, None where it is so
SAID = {  # {words of an amount: better ones}
    r"(gives \w+) -1 times as large as right": r"\1 with the opposite sign",
    r"counts the particle itself 0 times": "leaves out the particle itself",
    r"the part of (\w+) is 0 times .*": r"the answer is that without \1",
    r"has -1 times ": "has -",
}


def judgement(target: Target, judged: Judged) -> Outcome:
    """The outcome of an answer with its traits; of a wrong one with its sign and the values of its worst row."""
    error, told, more = worst(judged.ratios), named_worst(judged.ratios, judged.rows), dict[str, Any]()
    with np.errstate(all="ignore"):  # which a library may have changed for the whole process
        traits = traits_of(target, judged)
        if not error <= 1 and not target.faults:
            began, sought, wrong = time.process_time(), target.sought, Diagnosis(target, judged)
            traits["sought"] = sought.wanted(len(judged.inputs["position"]))
            more = {"sign": wrong.sign(traits["sought"]), "values": wrong.values()}
            told = more["sign"] or f"{wrong.name} is wrong in {wrong.wrong.sum()} of {len(wrong.wrong)} rows"
            sought.answers, sought.seconds = sought.answers + 1, sought.seconds + time.process_time() - began
    telling = any(np.any(np.asarray(value) != 0) for value, _ in judged.answer.values())
    return target.outcome(error, told, telling=telling, traits=traits, **more)


def traits_of(target: Target, judged: Judged) -> dict[str, Any]:
    """{trait: (share of right rows that have it, whether all wrong ones do); of a number, #: (its most, its least)}."""
    inputs, operation, x = judged.inputs, target.operation, judged.inputs["position"]
    rows = np.arange(len(x)) if judged.rows is None else judged.rows
    wrong, telling, taken = np.zeros(len(rows), bool), np.zeros(len(rows), bool), operation.arguments("numpy")
    for name in (n for n, r in judged.ratios.items() if inputs.per_particle(n) and 0 < len(r) == len(rows)):
        wrong |= ~(columns(judged.ratios[name]) <= 1).all(1)
        telling |= (columns(judged.answer[name][0]) != 0).any(1)
    of_rows: dict[str, Any] = {}
    if takes_neighbours(operation) and len(rows):
        near = within(operation, inputs, x, rows)
        of_rows["with up to # neighbours"] = near.sum(1) - 1
        of_rows["with particles' numbers up to #"] = len(x) - 1 - np.argmax(near[:, ::-1], 1)
        if period_of(operation, inputs) is not None:
            of_rows["with neighbours across a border"] = (near & ~within(operation, inputs, x, rows, False)).any(1)
        if "walls" in taken and inputs["walls"] is not None:
            of_rows["near walls"] = within(operation, inputs, inputs["walls"].position, rows).any(1)
    of_rows |= {"up to row #": rows, "in odd rows": rows % 2}
    there = [f"with {n}" for n in operation.optional if n in taken and inputs[n] is not None]
    there += [*(f"with the kernel {name}" for name in target.kernel.split()), f"in {inputs.case.dim} dimensions"]
    of_all = dict.fromkeys([*there, f"in {target.dtype}"], 1) | {"with up to # particles": len(x)}
    traits: dict[str, Any] = {}
    for key, values in of_rows.items():
        most, right, bad = np.max if "#" in key else np.mean, values[telling & ~wrong], values[wrong]
        traits[key] = float(most(right)) if len(right) else None, float(bad.min()) if len(bad) else None
    return traits | {key: (v, None) if worst(judged.ratios) <= 1 else (None, v) for key, v in of_all.items()}


def first_cause(outcomes: Sequence[Outcome]) -> str:
    """What most wrong answers of an operation have in common, in words; "" where none is wrong."""
    failed = [o for o in outcomes if not (o.passed or o.not_judged)]
    wrong = [o for o in failed if o.traits]
    voting = [o for o in wrong or failed if o.traits.get("sought", not o.values)] or wrong or failed
    said = [sentence for o in voting if (sentence := o.sign or ("" if o.values else o.words))]
    kinds = [re.sub(r"\d[\d.,]*(e[+-]\d+)?", "#", sentence) for sentence in said]
    best = max(kinds, key=kinds.count, default="")
    first = f"wrong in {len(failed)} of {sum(not o.not_judged for o in outcomes)} trials"
    first = said[kinds.index(best)] if kinds.count(best) > 0.45 * len(voting) else first
    return "; ".join([first, *conditions(outcomes, wrong)]) if failed else ""


def conditions(outcomes: Sequence[Outcome], wrong: Sequence[Outcome], alone: Sequence[str] = ()) -> list[str]:
    """What wrong rows have alone, and from which number of neighbours, rows or particles on they are wrong."""
    told, shares = [o for o in outcomes if o.traits.keys() > {*alone} and (o.telling or not o.passed)], []
    for key in (key for key in wrong[0].traits if key != "sought") if wrong else ():
        least = min(o.traits.get(key, (0, 0))[1] or 0 for o in wrong)
        right = [most for o in told if (most := o.traits.get(key, (0, 0))[0]) is not None]
        if "#" in key and CAPACITY <= max(right, default=0) < least:
            condition = f"right {key.replace('#', f'{max(right):,.0f}')}, wrong from {least:,.0f} on"
            return [*(f"wrong only {k}" for k in alone), f"{condition}: is a list, a block or an index too short?"]
        if "#" not in key and least == 1 and sum(share < 1 for share in right) > 1:
            shares.append((sum(right) / len(right), key))
    first = sorted(shares)[: 2 if len(wrong) > 2 and not alone else 0]  # fewer have much alone
    keys = [key for share, key in first if share <= 2 * first[0][0] + 0.1]
    return conditions(outcomes, wrong, keys) if keys else [f"wrong only {key}" for key in alone]


class Diagnosis:
    """The worst output of a wrong answer. Arrays have one row for each particle that is compared."""

    def __init__(self, target: Target, judged: Judged) -> None:
        self.target, self.judged, self.inputs, self.operation = target, judged, judged.inputs, target.operation
        self.alone = functools.partial(subset, self.operation, without_walls(self.inputs))
        self.name = max(judged.ratios, key=lambda n: float(np.max(judged.ratios[n], initial=0.0)))
        self.ratio, self.per_particle = columns(judged.ratios[self.name]).max(1), self.inputs.per_particle(self.name)
        self.sums = self.per_particle and takes_neighbours(self.operation)
        self.number = np.arange(len(self.ratio)) if judged.rows is None or not self.per_particle else judged.rows
        self.before, self.after = (columns(given[self.name])[self.number] for given in (judged.before, judged.after))
        self.right, self.adds = columns(judged.answer[self.name][0]), self.name in self.operation.adds
        self.off = self.after - self.right - (self.before if self.adds else 0)
        self.wrong, self.error = ~(self.ratio <= 1), size(self.off)
        bound = self.error / np.where(self.ratio > 0, self.ratio, np.nan)
        self.bound = np.where(np.isfinite(bound), bound, np.nanmedian(bound) if np.isfinite(bound).any() else 0.0)
        self.order = np.argsort(np.where(self.wrong, -self.error, np.inf), kind="stable")[: self.wrong.sum()]

    def sign(self, deep: bool) -> str:
        """The words of the first sign that there is, or ""; with `deep` oracle and program are called."""
        for seek, most in SIGNS.items():
            with contextlib.suppress(*REFUSED):
                for sentence, made in seek(self) if not most or (deep and self.per_particle) else ():
                    with contextlib.suppress(*REFUSED):
                        if made is None or (sentence := self.described(sentence, made, most or len(self.order))):
                            return sentence
        return ""

    def described(self, sentence: str, made: Any, most: int) -> str:
        """The words of a guess that holds in three wrong rows, then in so many, its amount by the secant; else ""."""

        def tried(s: float, rows: np.ndarray) -> tuple[np.ndarray, bool]:
            """By how much a guess differs from the right answer, and whether it does as the program does."""
            guesses, bound = ((made(s, k), self.number[k]) for k in rows), self.bound[rows]
            answer = np.array([self.answer(v, i) if isinstance(v, Inputs) else v for v, i in guesses])
            change = answer - self.right[rows]
            close = size(self.off[rows] - change) <= np.maximum(8 * bound, CLOSE * size(change))
            return change, bool(close.all()) and (size(change) > 16 * bound).sum() >= min(2, len(rows))

        rows, fits = np.unique(self.order[[0, len(self.order) > 1, len(self.order) // 2]]), "#" in sentence
        off, others = self.off[rows], self.order[:: 1 + len(self.order) // most]
        for amount in STARTS[: 1 if not fits else 0 if off.size < 3 else None]:  # of two numbers any amount would
            before, last = 1.0, 0 * off
            for _ in range(8 if fits else 1):
                change, same = tried(amount, rows)
                if abs(amount - 1) > 1e-6 and same:
                    sentence = sentence.replace("#", f"{amount:.5g}") if tried(amount, others)[1] else ""
                    return functools.reduce(lambda told, usual: re.sub(usual, SAID[usual], told), SAID, sentence)
                slope, missed = (change - last) / (amount - before), off - change
                step = float((missed * slope).sum() / (slope**2).sum())
                if not (((missed - step * slope) ** 2).sum() <= 0.9 * (off**2).sum() and 1e-9 < abs(step) < 10):
                    break
                before, last, amount = amount, change, amount + step
        return ""

    def answer(self, inputs: Inputs, row: Any) -> np.ndarray:
        """The oracle's answer to altered inputs in a row."""
        return columns(oracle(self.operation, inputs, np.array([row]))[self.name][0])[0]

    def right_on(self, *keep: int, rows: Any = None) -> bool:
        """Whether the program is right for some of the particles, in all rows or in some."""
        quiet, inputs = self.target.quiet(), subset(self.operation, self.inputs, np.array(keep))
        before, after = quiet.launch(inputs, complete=False)
        answer = {self.name: oracle(self.operation, inputs, rows)[self.name]}
        return bool(worst(errors(self.operation, inputs, before, after, rows, answer)) <= 1) and not quiet.faults

    def near(self, i: int, share: float = 1.0) -> np.ndarray:
        """Numbers of the other particles within `share` of the support radius of particle i."""
        near = within(self.operation, self.inputs, self.inputs["position"], np.array([i]), share=share)
        return np.setdiff1d(np.flatnonzero(near), i)

    def values(self) -> dict[str, Any]:
        """The worst row in numbers."""
        k = int(np.argmax(self.ratio))
        both = np.array([self.right[k] + self.off[k], self.right[k]])
        got, expected = (both if both.shape[1] > 1 else both[:, 0]).tolist()
        told = {"output": self.name, "row": int(self.number[k]), "got": got, "expected": expected}
        near = len(self.near(self.number[k])) if self.sums else 0
        return told | {"error": float(self.error[k]), "bound": float(self.bound[k]) or None, "neighbours": near}


def unsteady(w: Diagnosis) -> Signs:
    """Other values in another call: with the same inputs, or after a call with others."""
    for number in range(REPEATS):
        with on_one_core(number % 2 == 0):
            other = columns(w.target.quiet().launch(w.inputs, before=w.judged.before)[1][w.name])[w.number]
        if (size(other - w.after) > w.bound).any():
            w.target.sought.unsteady = f"your program gives other values of {w.name} for the same inputs: {RACE}"
            yield w.target.sought.unsteady, None
    fewer = range(len(w.inputs["position"]) - 3 - w.target.sought.answers)  # a number that was not yet there
    if w.sums and len(fewer) > 4 and w.right_on(*fewer) and not w.right_on(*fewer[::-1]):
        yield f"{w.name} depends on the calls before: is a list of neighbours kept from other positions?", None


def shown(w: Diagnosis) -> Signs:
    """What the values say: nothing, no numbers, one factor, one amount, other rows, the last rows, one component."""
    broken, first, gives = ~np.isfinite(w.off).all(1), int(np.argmax(w.wrong)), f"your program gives {w.name}"
    rows, bad = "all rows" if w.wrong.all() else "the wrong rows", (np.abs(w.off) > w.bound[:, None]).any(0)
    if np.array_equal(w.before, w.after, equal_nan=True):
        yield f"your program {'adds nothing to' if w.adds else 'does not change'} {w.name}", None
    if broken.any():
        yield f"{gives} that is NaN or infinite ({broken.sum()} of {broken.size} rows)", None
    if w.judged.rows is None and 2 * first > len(w.wrong) > CAPACITY and w.wrong[first:].all():
        yield f"the last rows of {w.name} are wrong, from row {first} on", None
    if w.name in w.operation.exact or (np.abs(w.right) > 1e-3 * np.abs(w.right).max()).sum() < 2:
        return
    if w.adds and np.any(w.before):
        yield f"your program overwrites {w.name}; it must add to it", lambda _, k: w.right[k] - w.before[k]
    if kernel := kernel_of(w.operation, w.inputs):
        norms, dim = NORMALISATION[int(kernel.shape)], 5 - w.inputs.case.dim
        sentence = f"{gives} with the kernel's normalisation for {dim} dimensions, in {rows}"
        yield sentence, lambda _, k: norms[dim] / norms[5 - dim] * w.right[k]
    yield f"{gives} # times as large as right, in {rows}", lambda s, k: s * w.right[k]
    more, rank = np.median(w.off, 0), np.argsort(np.argsort(w.right + w.off, 0), 0)
    yield f"{gives} with the same amount too much or too little in {rows}", lambda _, k: w.right[k] + more
    other = np.take_along_axis(np.sort(w.right, 0), rank, 0)
    yield f"your program gives the right values of {w.name} in other rows", lambda _, k: other[k]
    if len(bad) == 3 and (~bad & np.any(w.right, axis=0)).any():
        yield f"{w.name} is wrong in {', '.join('xyz'[c] for c in np.flatnonzero(bad))} alone", None


def altered(w: Diagnosis) -> Signs:
    """Another kernel, part or field, or the particle itself."""
    operation, inputs, other, taken = w.operation, w.inputs, w.inputs.replaced, w.operation.arguments("numpy")

    def with_altered(n: str, kept: bool | None, value: Callable[..., Any]) -> Callable[[float, int], Inputs]:
        """Inputs with another field n, but in the particle itself or in the others, where it is kept."""
        v, i = inputs[n].T, np.arange(len(inputs[n]))
        return lambda s, k: other(**{n: np.where((i == w.number[k]) != kept, value(v, s, k), v).T})

    yield "the answer has # times h in place of h", lambda s, _: scaled(operation, inputs, abs(s) + 1e-9)
    for n in SHAPES if shape_acts(operation) else ():
        yield f"the answer is that of the kernel {n}", lambda s, _, n=n: with_kernel(operation, inputs, n)
    for n in (n for n in operation.optional if n in taken and inputs[n] is not None):
        part = lambda s, k, n=n: s * w.right[k] + (1 - s) * w.answer(other(**{n: None}), w.number[k])  # noqa: E731
        yield f"the part of {n} is # times as large as right", part
    yield "the answer is that in the plane z = 0", lambda *_: other(position=inputs["position"] * [1, 1, 0])
    for axis, turn in zip("xyz", 1 - 2 * np.eye(3)) if "walls" in taken and inputs["walls"] is not None else ():
        walls = inputs["walls"]._replace(position=(inputs["walls"].position * turn).astype(inputs.dtype))
        yield f"the wall particles are mirrored: {axis} has the wrong sign", lambda *_, walls=walls: other(walls=walls)
    itself = lambda s, k: w.right[k] + (s - 1) * w.answer(w.alone(w.number[k : k + 1]), 0)  # noqa: E731
    yield "your program counts the particle itself # times", itself
    for n in (n for n in taken if n != "position" and inputs.per_particle(n) and inputs[n] is not None):
        own = with_altered(n, True, lambda v, _, k: (0 * v.T + v.T[w.number[k]]).T)
        yield f"the answer has {n}_i in place of {n}_j", own
        for name, kept in ((n, None), (f"{n}_j", True), (f"{n}_i", False))[: 3 if w.sums else 1]:
            before, place = with_altered(n, kept, lambda v, *_: np.roll(v, 1, -1)), f"in place of {name}"
            yield f"the answer has # times {name} {place}", with_altered(n, kept, lambda v, s, _: s * v)
            yield f"the answer has {n} of the particle before {place}", before
            for p, word in ((0, "1"), (2, "the square")):
                yield f"the answer has {word} {place}", with_altered(n, kept, lambda v, *_, p=p: v**p)


def recounted(w: Diagnosis) -> Signs:
    """Rounding in float32, neighbours that count another number of times, particles beyond the support radius."""

    @functools.cache
    def shares(k: int) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of neighbours of the k-th row relative to its own, and what each brings."""
        i, near = w.number[k], w.near(w.number[k])
        alone, *pairs = (w.answer(w.alone(np.array([i, *j])), 0) for j in ((), *zip(near)))
        return near - i, np.array(pairs) - alone

    scale = w.judged.answer[w.name][1]  # None of a closed form
    terms = np.maximum(np.maximum(size(columns(0.0 if scale is None else scale) + 0 * w.right), size(w.right)), 1e-300)
    share, mixed = np.quantile((w.error / terms)[w.wrong], 0.9), 0.2 < (w.off[w.wrong, 0] > 0).mean() < 0.8
    single = 1e-13 < share < 3e-6 if mixed else 4e-9 < share < 2e-6
    summed = mixed and w.error.max() <= 8 * terms.mean() * len(w.inputs["position"]) * np.finfo("f4").eps
    if single if w.target.dtype == "float64" else summed:
        yield f"the error of {w.name} has the size of rounding in float32: a sum in single precision?", None
    for t, word, some in ((-1, "is missing", "lower"), (1, "is counted twice", "higher")) if w.sums else ():
        nearest = lambda k, t=t: min(t * shares(k)[1], key=lambda v: np.abs(w.off[k] - v).sum())  # noqa: E731
        yield f"off by one: one neighbour {word} in each wrong row", lambda _, k, f=nearest: w.right[k] + f(k)
        part = lambda s, k, t=t: w.right[k] + (s - 1) * shares(k)[1][t * shares(k)[0] > 0].sum(0)  # noqa: E731
        yield f"your program counts neighbours of {some} numbers # times", part
    i = int(w.number[np.argmax(w.ratio)])
    further = np.setdiff1d(w.near(i, 1 + w.inputs.case.skin), w.near(i))
    if w.right_on(i, rows=[0]) and not all(w.right_on(i, j, rows=[0]) for j in further[:2]):
        yield f"{w.name} counts particles beyond the support radius: there is no cut at r = h", None


# In this order; behind each the wrong rows in which a guess must hold, 0 for all, where nothing is called
SIGNS = {unsteady: 1, shown: 0, altered: 40, recounted: 3}


def columns(values: Any) -> np.ndarray:
    """Numbers with a row for each particle or entry, or one row."""
    return np.reshape(np.asarray(values, float), (*(np.shape(values)[:1] or (1,)), -1))


def within(operation: Any, inputs: Inputs, source: Any, rows: Any, images: bool = True, share: float = 1) -> np.ndarray:
    """Whether sources, or their nearest images, are within `share` of the support radius of the particles `rows`."""
    reach = share * float(getattr(kernel_of(operation, inputs), "support_radius", inputs.case.list_radius))
    period = period_of(operation, inputs) if images else None
    return np.concatenate([d < reach for *_, d in pair_blocks(inputs["position"], source, rows, period)])
