"""Why answers are wrong: a sign of each wrong answer, and a vote over all trials of an operation.

A sign is what the values show, what other calls of the program show, or what the oracle answers to altered inputs, with
an amount that is fitted. Traits are what wrong rows and trials have alone. Where most wrong answers share no sign, the
cause says what differs and nothing else.
"""

import collections
import contextlib
import functools
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
MOST_PARTICLES = 400  # of inputs for which oracle and program are called again
REPEATS = 6  # calls with the same inputs
CAPACITY = 8  # neighbours, rows or particles, from which on their number may spoil an answer
MOST_PAIRS = 80  # neighbours of a row whose shares are computed
STARTS = 0.0, 2.0, 0.7, 1.3, 1.001  # amounts from which one is fitted; 1 is right
REFUSED = (ArithmeticError, TypeError, ValueError, LookupError, AttributeError, InputError)  # of altered inputs
NUMBER = re.compile(r"\d[\d.,]*(?:e[+-]\d+)?")


def judgement(target: Target, judged: Judged) -> Outcome:
    """The outcome of an answer with its traits; of a wrong one with its sign and the values of its worst row."""
    error, told, more = worst(judged.ratios), named_worst(judged.ratios, judged.rows), dict[str, Any]()
    with np.errstate(all="ignore"):  # which a library may have changed for the whole process
        traits = traits_of(target, judged)
        if not error <= 1 and not target.faults:
            began, sought, wrong = time.process_time(), target.sought, Wrong(target, judged)
            most = MOST_SOUGHT if len(judged.inputs["position"]) >= CAPACITY else 3  # few particles say less
            traits["sought"] = sought.answers < most and sought.seconds < MOST_SEEKING
            sign = wrong.sign(traits["sought"])
            told = sign or f"your program gives a wrong {wrong.name} in {wrong.wrong.sum()} of {len(wrong.wrong)} rows"
            more = {"sign": sign, "values": wrong.values()}
            sought.answers, sought.seconds = sought.answers + 1, sought.seconds + time.process_time() - began
    return target.outcome(error, told, telling=judged.telling, traits=traits, **more)


def traits_of(target: Target, judged: Judged) -> dict[str, Any]:
    """{what may decide whether a row is wrong: (some values of right rows, least of a wrong one or None)}."""
    inputs, operation, x = judged.inputs, target.operation, judged.inputs["position"]
    rows = np.arange(len(x)) if judged.rows is None else judged.rows
    wrong, telling, numbers = np.zeros(len(rows), bool), np.zeros(len(rows), bool), dict[str, Any]()
    for name, ratio in judged.ratios.items():
        if 0 < len(rows) == len(ratio) == len(judged.answer[name][0]):
            wrong |= ~(columns(ratio) <= 1).all(1)
            telling |= np.any(columns(judged.answer[name][0]) != 0, axis=1)
    if takes_neighbours(operation) and len(rows):
        period = period_of(operation, inputs)
        near = within(operation, inputs, x, rows, period)
        numbers["with up to # neighbours"] = near.sum(1) - 1
        numbers["with particles' numbers up to #"] = len(x) - 1 - np.argmax(near[:, ::-1], 1)
        if "walls" in operation.arguments("numpy") and inputs["walls"] is not None:
            numbers["near walls"] = within(operation, inputs, inputs["walls"].position, rows, period).sum(1)
        if period is not None:
            numbers["with neighbours across a border"] = (near & ~within(operation, inputs, x, rows)).sum(1)
    numbers |= {"up to row #": rows, "in odd rows": rows % 2, "at negative coordinates": (x[rows] < 0).any(1)}
    shapes = [int(inputs[name].shape) for name in KERNELS if name in shape_acts(operation)]
    given = [n for n in operation.optional if n in operation.arguments("numpy") and inputs[n] is not None]
    whole = {f"with {n}": 1 for n in given if n != "walls" or len(inputs[n].position)}
    whole |= {f"with the kernel {name}": 1 for name, number in SHAPES.items() if number in shapes}
    whole |= {f"in {inputs.case.dim} dimensions": 1, f"in {target.dtype}": 1, "with up to # particles": len(x)}
    found: dict[str, Any] = {}
    for name, values in numbers.items():
        right = np.sort(values[telling & ~wrong])[::-1]
        some = right[:: max(1, len(right) // 10)].tolist()
        found[name] = some, float(values[wrong].min()) if wrong.any() else None
    return found | {name: ([n], None) if worst(judged.ratios) <= 1 else ([], n) for name, n in whole.items()}


def first_cause(outcomes: Sequence[Outcome]) -> str:
    """What most wrong answers of an operation have in common, in words; "" where none is wrong."""
    failed = [o for o in outcomes if not (o.passed or o.not_judged)]
    wrong = [o for o in failed if o.traits]
    voting = [o for o in wrong or failed if o.traits.get("sought", not o.values)] or wrong or failed
    said = [o.sign or ("" if o.values else o.words) for o in voting]
    votes = collections.Counter(NUMBER.sub("#", words) for words in said if words)
    best = max(votes, key=lambda words: votes[words], default="")
    first = next((words for words in said if NUMBER.sub("#", words) == best), "")
    if votes[best] <= 0.45 * len(voting):
        told = sum(not o.not_judged for o in outcomes)
        first = f"{len(failed)} of {told} trials {'is' if len(failed) == 1 else 'are'} wrong"
    return "; ".join([first, *conditions(outcomes, wrong)]) if failed else ""


def conditions(outcomes: Sequence[Outcome], wrong: Sequence[Outcome]) -> list[str]:
    """From which number of neighbours, rows or particles on answers are wrong, or with what alone, and from which."""
    told = [o for o in outcomes if o.traits and (o.telling or not o.passed)]
    words = numbered(told, wrong)
    if words or len(wrong) < 3:  # fewer have much alone
        return words
    found = {key: apart(key, told, wrong) for key in wrong[0].traits if key != "sought" and "#" not in key}
    alone = sorted((share, key) for key, (_, _, share, without) in found.items() if without > 1)
    keys = [key for share, key in alone[:2] if share <= 2 * alone[0][0] + 0.1]
    words = numbered([o for o in told if all(key in o.traits for key in keys)], wrong)
    return [*(f"wrong only {key}" for key in keys), *words]


def numbered(told: Sequence[Outcome], wrong: Sequence[Outcome]) -> list[str]:
    """Words of the number from which on answers are wrong."""
    for key in (key for key in wrong[0].traits if "#" in key) if wrong else ():
        most, least, *_ = apart(key, told, wrong)
        if CAPACITY <= most < least:
            words = f"right {key.replace('#', f'{most:,.0f}')}, wrong from {least:,.0f} on"
            return [f"{words}: is a list, a block or an index too short?"]
    return []


def apart(key: str, told: Sequence[Outcome], wrong: Sequence[Outcome]) -> tuple[float, float, float, int]:
    """(largest of right rows, least of wrong ones, share of right rows not below, trials with rows below it)."""
    least = min(o.traits.get(key, ((), None))[1] or 0 for o in wrong)
    right = [np.asarray(o.traits.get(key, ([0.0],))[0]) for o in told]
    below = [float((values < least).mean()) for values in right if len(values)]
    most = max((float(values.max(initial=0)) for values in right), default=0.0)
    return most, least, 1 - sum(below) / max(len(below), 1), sum(share > 0 for share in below)


class Wrong:
    """The worst output of a wrong answer. Arrays have one row for each particle that is compared."""

    def __init__(self, target: Target, judged: Judged) -> None:
        self.target, self.judged, self.inputs, self.operation = target, judged, judged.inputs, target.operation
        self.name = max(judged.ratios, key=lambda n: float(np.max(judged.ratios[n], initial=0.0)))
        self.ratio, self.per_particle = columns(judged.ratios[self.name]).max(1), self.inputs.per_particle(self.name)
        self.sums = self.per_particle and takes_neighbours(self.operation)
        sampled = self.per_particle and judged.rows is not None
        self.number = np.asarray(judged.rows) if sampled else np.arange(len(self.ratio))
        self.before, self.after = (columns(given[self.name])[self.number] for given in (judged.before, judged.after))
        self.right, self.adds = columns(judged.answer[self.name][0]), self.name in self.operation.adds
        self.off = self.after - self.right - (self.before if self.adds else 0)
        self.wrong, self.error = ~(self.ratio <= 1), size(self.off)
        bound = self.error / np.where(self.ratio > 0, self.ratio, np.nan)
        self.bound = np.where(np.isfinite(bound), bound, np.nanmedian(bound) if np.isfinite(bound).any() else 0.0)

    def sign(self, deep: bool) -> str:
        """The first sign that there is, or ""; with `deep` oracle and program are called."""
        deep = self.per_particle and deep and len(self.inputs["position"]) <= MOST_PARTICLES
        for seek, calls in SIGNS.items():
            with contextlib.suppress(*REFUSED):
                if (deep or not calls) and (words := next(seek(self), "")):
                    return words
        return ""

    def agrees(self, answer: Any, rows: Any = slice(None)) -> bool:
        """Whether an answer for some rows is the program's, and differs in the wrong ones from the right one."""
        change, wrong = answer - self.right[rows], self.wrong[rows]
        close = size(self.off[rows] - change) <= np.maximum(8 * self.bound[rows], CLOSE * size(change))
        return bool(close.all()) and (size(change) > 16 * self.bound[rows])[wrong].sum() >= min(2, wrong.sum())

    def fitted(self, answer: Callable[[float], Any], rows: Any = slice(None)) -> float | None:
        """The amount, not 1, with which an answer is the program's in some rows, by the secant from several."""
        right, off, wrong = self.right[rows], self.off[rows], self.wrong[rows]
        for amount in STARTS:
            before, last = 1.0, np.zeros_like(right)
            for _ in range(8):
                found = answer(amount)
                if abs(amount - 1) > 1e-6 and self.agrees(found, rows):
                    return amount
                slope, missed = ((found - right - last) / (amount - before))[wrong], (right + off - found)[wrong]
                step = float((missed * slope).sum() / (slope**2).sum()) if missed.size > 2 else 0.0
                nearer = ((missed - step * slope) ** 2).sum() <= 0.9 * (off[wrong] ** 2).sum()
                if not (nearer and 1e-9 < abs(step) < 10):  # of two numbers or one any amount would
                    break
                before, last, amount = amount, found - right, amount + step
        return None

    def answer(self, inputs: Inputs, rows: Any) -> np.ndarray:
        """The oracle's answer to altered inputs in some rows."""
        return columns(oracle(self.operation, inputs, np.atleast_1d(rows))[self.name][0])

    def some(self, keep: Any) -> Inputs:
        """The inputs with some of the particles."""
        return subset(self.operation, self.inputs, np.array(keep, dtype=int))

    def right_on(self, keep: Any, rows: Any = None) -> bool:
        """Whether the program is right for some of the particles, in all rows or in some."""
        quiet, inputs = self.target.quiet(), self.some(keep)
        before, after = quiet.launch(inputs, complete=False)
        answer = {self.name: oracle(self.operation, inputs, rows)[self.name]}
        return bool(worst(errors(self.operation, inputs, before, after, rows, answer)) <= 1) and not quiet.faults

    def near(self, i: int, share: float = 1.0) -> np.ndarray:
        """Numbers of the other particles within `share` of the support radius of particle i."""
        x, period = self.inputs["position"], period_of(self.operation, self.inputs)
        found = np.flatnonzero(within(self.operation, self.inputs, x, np.array([i]), period, share))
        return found[found != i]

    def values(self) -> dict[str, Any]:
        """The worst row in numbers."""
        k = int(np.argmax(self.ratio))
        i, right = int(self.number[k]), self.right[k]
        got, expected = (v.tolist() if len(v) > 1 else float(v[0]) for v in (right + self.off[k], right))
        bound = float(self.error[k] / self.ratio[k]) if np.isfinite(self.ratio[k]) else None
        told = {"output": self.name, "row": i, "got": got, "expected": expected, "error": float(self.error[k])}
        return told | {"bound": bound, "neighbours": len(self.near(i)) if self.sums else 0}


def unwritten(w: Wrong) -> Iterator[str]:
    """An output that is not written, not finite, overwritten, or wrong in its last rows."""
    broken, first = ~np.isfinite(w.off).all(1), int(np.argmax(w.wrong))
    if np.array_equal(w.before, w.after, equal_nan=True):
        yield f"your program {'adds nothing to' if w.adds else 'does not change'} {w.name}"
    elif broken.any():
        yield f"your program gives {w.name} that is NaN or infinite ({broken.sum()} of {broken.size} rows)"
    elif w.adds and np.any(w.before) and w.agrees(w.right - w.before):
        yield f"your program overwrites {w.name}; it must add to what stands there"
    elif w.judged.rows is None and 2 * first > len(w.wrong) > CAPACITY and w.wrong[first:].all():
        yield f"the last rows of {w.name} are wrong, from row {first} on"


def unsteady(w: Wrong) -> Iterator[str]:
    """Other values in another call: with the same inputs, or after a call with others."""
    for number in range(REPEATS):
        with on_one_core(number % 2 == 0):
            other = columns(w.target.quiet().launch(w.inputs, before=w.judged.before)[1][w.name])[w.number]
        if (size(other - w.after) > w.bound).any():
            words = f"your program gives other values of {w.name} for the same inputs: a race between threads,"
            w.target.sought.unsteady = f"{words} or memory that is read before it is written"
            yield w.target.sought.unsteady
            return
    fewer = np.arange(len(w.inputs["position"]) - 3 - w.target.sought.answers)  # a number that was not yet there
    if w.sums and len(fewer) > 4 and w.right_on(fewer) and not w.right_on(fewer[::-1]):
        yield f"{w.name} depends on the calls before: is a list of neighbours kept from other positions?"


def shown(w: Wrong) -> Iterator[str]:
    """One factor, one amount, other rows, one component."""
    if w.name in w.operation.exact or (np.abs(w.right) > 1e-3 * np.abs(w.right).max()).sum() < 2:
        return
    kernel, dim, gives = kernel_of(w.operation, w.inputs), w.inputs.case.dim, f"your program gives {w.name}"
    norms = NORMALISATION[int(kernel.shape)] if kernel else {2: -1.0, 3: 1.0}
    known = {norms[5 - dim] / norms[dim]: f"with the kernel's normalisation for {5 - dim} dimensions"}
    factor = w.fitted(lambda s: np.where(w.wrong, s, 1)[:, None] * w.right)
    order, bad = np.argsort(np.argsort(w.right + w.off, 0), 0), (np.abs(w.off) > w.bound[:, None]).any(0)
    if factor is not None:
        words = said("# times as large as right", {-1.0: "with the opposite sign"} | known)(factor)
        yield f"{gives} {words}, in {'all' if w.wrong.all() else 'the wrong'} rows"
    elif w.agrees(w.right + np.median(w.off, 0)):
        yield f"{gives} with the same amount too much or too little in all rows"
    elif w.agrees(np.take_along_axis(np.sort(w.right, 0), order, 0)):
        yield f"your program gives the right values of {w.name} in other rows"
    elif len(bad) == 3 and (~bad & np.any(w.right, axis=0)).any():
        yield f"{w.name} is wrong in {', '.join('xyz'[c] for c in np.flatnonzero(bad))} alone"


def altered(w: Wrong, find: Callable[[Wrong], Iterator[tuple[Any, Any]]], most: int = 40) -> Iterator[str]:
    """Alterations that give the program's answer in three wrong rows, then in `most`."""
    order = np.argsort(-w.error, kind="stable")[: w.wrong.sum()]
    rows = np.unique(order[[0, min(1, len(order) - 1), len(order) // 2]])
    others = order[:: 1 + len(order) // most] if most > len(rows) else rows
    for say, made in find(w):
        with contextlib.suppress(*REFUSED):
            answer = lambda s, k=rows, made=made: np.array([made(s, int(n)).ravel() for n in k])  # noqa: E731
            amount = w.fitted(answer, rows) if callable(say) else 0.0 if w.agrees(answer(0.0), rows) else None
            if amount is not None and w.agrees(answer(amount, others), others):
                yield say(amount) if callable(say) else say


def alterations(w: Wrong) -> Iterator[tuple[Any, Any]]:
    """(words, or words of an amount; the answer of an amount in the k-th row); 1 is right."""
    operation, inputs, other, taken = w.operation, w.inputs, w.inputs.replaced, w.operation.arguments("numpy")

    def of(made: Callable[..., Inputs]) -> Callable[..., np.ndarray]:
        return lambda s, k: w.answer(made(s), w.number[k])

    def put(n: str, own: int, others: int, value: Callable[..., Any]) -> Callable[..., np.ndarray]:
        """Answers with a value of amount and particle in place of its own field n, of the others' or of both."""

        def made(s: float, i: int) -> Inputs:
            place = np.where(np.arange(len(inputs[n])) == i, own, others).reshape(-1, *[1] * (inputs[n].ndim - 1))
            return other(**{n: np.where(place, value(s, i), inputs[n]).astype(inputs[n].dtype)})

        return lambda s, k: w.answer(made(s, int(w.number[k])), w.number[k])

    if any(name in taken for name in KERNELS):
        yield lambda s: in_place_of("h")(2 ** (s - 1)), of(lambda s: scaled(operation, inputs, 2 ** (s - 1)))
        for shape in (n for n in SHAPES if shape_acts(operation) and SHAPES[n] != kernel_of(operation, inputs).shape):
            yield f"the answer is that of the kernel {shape}", of(lambda _, n=shape: with_kernel(operation, inputs, n))
    for n in (n for n in operation.optional if n in taken and inputs[n] is not None):
        less = of(lambda _, n=n: without_walls(inputs) if n == "walls" else other(**{n: None}))
        say = said(f"the part of {n} is # times as large as right", {0: f"the answer is that without {n}"})
        yield say, lambda s, k, less=less: s * w.right[k] + (1 - s) * less(0, k)
    for n, group in groups_of(operation, inputs).items():
        for m, v in group._asdict().items() if n not in (*KERNELS, "period") else ():
            changed = lambda s, g=group, m=m, v=v: g._replace(**{m: type(v)(s * v)})  # noqa: E731
            yield in_place_of(f"{n}.{m}"), of(lambda s, n=n, changed=changed: other(**{n: changed(s)}))
    yield "the answer is that in the plane z = 0", of(lambda _: other(position=inputs["position"] * [1, 1, 0]))
    for axis, turn in zip("xyz", 1 - 2 * np.eye(3)) if "walls" in taken and inputs["walls"] is not None else ():
        walls = inputs["walls"]._replace(position=(inputs["walls"].position * turn).astype(inputs.dtype))
        yield f"the wall particles are mirrored: {axis} has the wrong sign", of(lambda _, b=walls: other(walls=b))
    for words, p in {"m_j/rho_j in place of m_j": -1.0, "m_j in place of m_j/rho_j": 1.0}.items():
        if "mass" in taken and "density" in taken:
            yield f"the answer has {words}", of(lambda _, p=p: other(mass=inputs["mass"] * inputs["density"] ** p))
    if w.sums:
        say = said(
            "your program counts the particle itself # times", {0: "your program leaves out the particle itself"}
        )
        yield say, lambda s, k: w.right[k] + (s - 1) * w.answer(without_walls(w.some([w.number[k]])), 0)
    fields = (n for n in taken if n != "position" and inputs.per_particle(n) and inputs[n] is not None)
    for n, v in ((n, inputs[n]) for n in fields if inputs[n].dtype.kind == "f"):
        before, behind = (f"{n} of the particle {word}" for word in ("before", "behind"))
        changes = {"1": v**0, "the square": v**2, before: np.roll(v, 1, 0), behind: np.roll(v, -1, 0)}
        yield f"the answer has {n}_i in place of {n}_j", put(n, 0, 1, lambda _, i, v=v: v[i])
        for name, own, others in ((n, 1, 1), (f"{n}_j", 0, 1), (f"{n}_i", 1, 0))[: 3 if w.sums else 1]:
            yield in_place_of(name), put(n, own, others, lambda s, _, v=v: s * v)
            for word, x in changes.items():
                yield f"the answer has {word} in place of {name}", put(n, own, others, lambda *_, x=x: x)


def recounts(w: Wrong) -> Iterator[tuple[Any, Any]]:
    """The same of sums in which neighbours count another number of times."""

    @functools.cache
    def shares(k: int) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of neighbours of the k-th row relative to its own, and what each brings."""
        i = w.number[k]
        near = w.near(i)[:MOST_PAIRS]
        pairs = [w.answer(without_walls(w.some(keep)), 0) for keep in ([i], *([i, j] for j in near))]
        return near - i, np.concatenate(pairs[1:]) - pairs[0]

    for word, t in (("is missing", -1), ("is counted twice", 1)) if w.sums else ():
        nearest = lambda k, t=t: np.argmin(np.abs(w.off[k] - t * shares(k)[1]).sum(1))  # noqa: E731
        words = f"off by one: in each wrong row one neighbour {word}"
        yield words, lambda s, k, t=t, f=nearest: w.right[k] + t * shares(k)[1][f(k)]
    for word, t in (("lower", -1), ("higher", 1)) if w.sums else ():
        say = said(f"your program counts neighbours of {word} numbers # times", {})
        yield say, lambda s, k, t=t: w.right[k] + (s - 1) * shares(k)[1][t * shares(k)[0] > 0].sum(0)


def rounding(w: Wrong) -> Iterator[str]:
    """Errors of the size of single precision, or, in it, of the rounding of a sum over all particles."""
    terms = np.maximum(np.maximum(size(columns(w.judged.answer[w.name][1]) + 0 * w.right), size(w.right)), 1e-300)
    share, mixed = np.quantile((w.error / terms)[w.wrong], 0.9), 0.2 < (w.off[w.wrong, 0] > 0).mean() < 0.8
    least, most = (1e-13, 3e-6) if mixed else (4e-9, 2e-6)
    summed = mixed and w.error.max() <= 8 * terms.mean() * len(w.inputs["position"]) * np.finfo("f4").eps
    if least < share < most if w.target.dtype == "float64" else summed:
        yield f"the error of {w.name} has the size of rounding in float32: is something summed in single precision?"


def beyond(w: Wrong) -> Iterator[str]:
    """Whether the program counts particles that the list has, and the support radius has not."""
    i = int(w.number[np.argmax(w.ratio)])
    further = np.setdiff1d(w.near(i, 1 + w.inputs.case.skin), w.near(i))
    if w.right_on([i], [0]) and not all(w.right_on([i, j], [0]) for j in further[:2]):
        yield f"{w.name} counts particles beyond the support radius: there is no cut at r = h"


SIGNS: dict[Callable[[Wrong], Iterator[str]], bool] = {  # in this order; True: it calls program or oracle
    unwritten: False,
    unsteady: True,
    shown: False,
    lambda w: altered(w, alterations): True,
    rounding: False,
    lambda w: altered(w, recounts, 3): True,
    beyond: True,
}


def said(words: str, known: Mapping[float, str]) -> Callable[[float], str]:
    """Words of an amount, #, with others for some amounts."""
    return lambda s: next((w for amount, w in known.items() if abs(s - amount) < 1e-3), words.replace("#", f"{s:.5g}"))


def in_place_of(n: str) -> Callable[[float], str]:
    """Words of a quantity that is so many times as large as right."""
    zero, minus = (f"the answer has {word} in place of {n}" for word in ("0", f"-{n}"))
    return said(f"the answer has # times {n} in place of {n}", {0: zero, -1: minus})


def columns(values: Any) -> np.ndarray:
    """Numbers with a row for each particle or entry, or one row."""
    values = np.asarray(values, float)
    return values.reshape(len(values) if values.ndim else 1, -1)


def within(operation: Any, inputs: Inputs, source: Any, rows: Any, period: Any = None, share: float = 1) -> np.ndarray:
    """Whether sources are within `share` of the support radius of the particles `rows`."""
    reach = share * float(getattr(kernel_of(operation, inputs), "support_radius", inputs.case.list_radius))
    return np.concatenate([d < reach for _, d in distances(inputs["position"], source, rows, period)])
