"""Why an answer is wrong, in words: hypotheses that the oracle tries, and calls of the program on fewer particles.

A cause is named only where what it predicts is what the program gave. The oracle predicts by altered inputs: for all
rows (half the support radius), or for some of the wrong ones (m_i in place of m_j). The program itself is called on the
worst particle alone, then with more and more of its neighbours: the first that spoils the answer is the pair that
matters.
"""

import contextlib
import os
import time
from collections.abc import Callable, Iterator
from functools import cache, cached_property, partial
from typing import Any

import numpy as np

from refsim.contract.bounds import errors, oracle, size, takes_neighbours
from refsim.contract.inputs import Inputs, period_of
from refsim.contract.parameters import KERNELS, followed, groups_of, kernel_of, shape_acts, with_kernel
from refsim.contract.target import MOST_SEEKING, Judged, Outcome, Target, named_worst, worst
from refsim.core.walls import WallParticles
from refsim.neighbours.reference import nearest_image
from refsim.smoothing import SHAPES, smoothing

SAME = 1e-3  # relative spread of a factor that is the same for all particles
SMALL = 1e-3  # share of the largest value below which a value says nothing about a factor
LOOKED_AT = 4  # wrong rows in which a cause that is predicted row by row must agree
NEAR = 1e-4  # share of its effect by which an answer may differ from what a cause predicts
CAPACITY = 8  # neighbours from which on their number, and not one of them, may spoil an answer
MOST_PARTICLES = 400  # of inputs with which causes are sought
MOST_LISTED = 5000  # for which lists of all pairs are made
MOST_PAIRS = 80  # neighbours of a particle up to which the part of each is computed
SYMBOLS = {"mass": "m", "density": "rho", "pressure": "p", "velocity": "v", "volume": "V", "temperature": "T"}
REPEATS = 6  # calls with the same inputs
ENOUGH = 1.0  # s of the processor for such calls
ROUNDINGS = 8  # of a sum over all particles, up to which an error may be one of its rounding
REFUSED = (TypeError, ValueError, IndexError, KeyError, AttributeError)  # of an oracle that gets altered inputs
SMALLEST_SINGLE = 4e-9  # share of the terms from which on an error may be one of single precision


def judgement(target: Target, judged: Judged) -> Outcome:
    """The outcome of an answer; of a wrong one with its cause and the values of its worst row."""
    error = worst(judged.found)
    if error <= 1 or target.faults:
        return target.outcome(error, named_worst(judged.found, judged.rows), telling=judged.telling)
    began = time.process_time()
    with np.errstate(all="ignore"):  # which a library may have changed for the whole process
        words, values = Wrong(target, judged).told(target.sought.seconds < MOST_SEEKING)
    target.sought.seconds += time.process_time() - began
    return target.outcome(error, words, telling=judged.telling, values=values)


class Wrong:
    """The worst output of a wrong answer. Arrays have one row for each particle that is compared."""

    def __init__(self, target: Target, judged: Judged) -> None:
        self.target, self.judged, self.inputs = target, judged, judged.inputs
        self.operation = target.operation
        peaks = {name: float(np.max(ratio, initial=0.0)) for name, ratio in judged.found.items()}
        self.name = max(peaks, key=lambda n: peaks[n])
        ratio = np.asarray(judged.found[self.name])
        self.ratio = ratio.reshape(len(ratio), -1).max(1)
        rows = judged.rows if judged.rows is not None and len(judged.rows) == len(self.ratio) else None
        self.number = np.arange(len(self.ratio)) if rows is None else np.asarray(rows)
        self.adds = self.name in self.operation.adds
        self.before, self.after = (np.asarray(v[self.name], dtype=float) for v in (judged.before, judged.after))
        if len(self.after) != len(self.ratio):
            self.before, self.after = self.before[self.number], self.after[self.number]
        self.got = self.after - self.before if self.adds else self.after
        value, scale = judged.answer[self.name]
        self.right = np.asarray(value, dtype=float)
        self.scale = np.broadcast_to(np.asarray(scale, dtype=float), self.right.shape)
        self.wrong = ~(self.ratio <= 1)
        self.error = lengths(self.got - self.right)
        bound = np.where(self.ratio > 0, self.error / np.maximum(self.ratio, 1e-300), np.nan)
        known = bound[np.isfinite(bound)]
        self.bound = np.where(np.isfinite(bound), bound, np.median(known) if len(known) else 0.0)
        self.worst = int(np.argmax(self.ratio))
        self.own = self.inputs.per_particle(self.name)
        self.taken, self.count = self.operation.arguments("numpy"), len(self.inputs["position"])
        self.parts = cache(self._parts)

    def told(self, deep: bool) -> tuple[str, dict[str, Any]]:
        """(cause, values of the worst row); with `deep` the oracle and the program are called to find them."""
        words, partner = self.plain(), None
        if not words and deep and self.own and takes_neighbours(self.operation):
            sampled, small = len(self.number) * self.count <= MOST_PARTICLES**2, self.count <= MOST_PARTICLES
            steps: tuple[tuple[Callable[[], tuple[str, int | None]], bool], ...] = (
                (self.unsteady, not self.target.listed or self.count <= MOST_LISTED), (self.predicted, sampled),
                (lambda: (self.factor(), None), True), (self.reduced, small), (self.rounded, True),
                (self.off_by_one, small), (self.located, small), (self.isolated, small),
            )  # fmt: skip
            for seek in (seek for seek, possible in steps if possible):
                with contextlib.suppress(*REFUSED):
                    words, partner = seek()
                if words:
                    break
        words = words or self.factor() or self.located()[0] or self.single() or self.shared()
        return words, self.values(partner)

    # What the arrays show

    def plain(self) -> str:
        """An output that is not written, or not finite."""
        if np.array_equal(self.before, self.after, equal_nan=True):
            return f"your program {'adds nothing to' if self.adds else 'does not change'} {self.name}"
        broken = ~np.isfinite(self.got)
        if broken.any():
            rows = broken.reshape(len(broken), -1).any(1)
            words = f"your program gives {self.name} that is NaN or infinite ({rows.sum()} of {rows.size} rows)"
            if self.own and takes_neighbours(self.operation) and 0 < rows.sum() < rows.size:
                apart = np.array([np.sort(self.distances(i))[1] for i in self.number[rows][:LOOKED_AT]])
                words += ": where two particles coincide (r = 0)" if (apart == 0).all() else ""
            return words
        stood, wanted = (float(np.abs(v).max(initial=0.0)) for v in (self.before, self.right))
        if self.adds and stood > 10 * SAME * wanted and factor_between(self.after, self.right) == 1:
            return f"your program overwrites {self.name}; it must add to what stands there"
        return ""

    def factor(self) -> str:
        """A factor that serves all rows."""
        if self.got.shape != self.right.shape or self.name in self.operation.exact:
            return ""
        factor = factor_between(self.got, self.right)
        if factor is None or factor == 1:
            return ""
        if factor == 0:
            return f"your program gives 0 for {self.name} everywhere"
        if factor == -1:
            return f"your program gives {self.name} with the opposite sign"
        words = f"your program gives {factor:.4g} times the right {self.name}, everywhere"
        kernel, dim = kernel_of(self.operation, self.inputs), self.inputs.case.dim
        if kernel is not None:
            shape = next(name for name, number in SHAPES.items() if number == kernel.shape)
            own, other = (float(smoothing(shape, 1.0, d).value_scale) for d in (dim, 5 - dim))
            if abs(factor * own / other - 1) <= SAME:
                words += f": the kernel's normalisation has the constant for {5 - dim} dimensions"
        return words

    def single(self) -> str:
        """An error of the size of single precision, or one that comes with the number of particles."""
        share = self.error / np.maximum(np.maximum(size(self.scale).reshape(-1), lengths(self.right)), 1e-300)
        typical, most = float(np.median(share[self.wrong])), 1e-4
        if self.mixed and self.error.max() <= self.total_rounding("float32"):
            most = 1.0
        if self.target.dtype == "float64" and SMALLEST_SINGLE < typical < most and 2 * self.wrong.sum() > len(share):
            return (
                f"the error of {self.name} has the size of single precision: something is computed or summed in float32"
            )
        if self.own and self.count > 2**16 and takes_neighbours(self.operation):
            high = np.array([i >= 2**16 or (self.near(int(i)) >= 2**16).any() for i in self.number])
            if not (self.wrong & ~high).any() and (~high).any():
                return f"{self.name} is wrong where a particle's number exceeds 65,535: is an index held in 16 bits?"
        return ""

    def shared(self) -> str:
        """How many rows are wrong."""
        share = f"{self.wrong.sum()} of {self.wrong.size} rows"
        return f"your program gives a wrong {self.name} in {share}, the worst in row {self.number[self.worst]}"

    # Neighbours

    def distances(self, i: int) -> np.ndarray:
        """Distances [m] of all particles' nearest images from particle i."""
        apart = np.asarray(self.inputs["position"], dtype=float) - np.asarray(self.inputs["position"][i], dtype=float)
        period = period_of(self.operation, self.inputs)
        return size(apart if period is None else nearest_image(apart, period))

    def near(self, i: int) -> np.ndarray:
        """Numbers of the particles that a list holds for particle i, the nearest first."""
        distance = self.distances(i)
        distance[i] = np.inf
        found = np.flatnonzero(distance < self.inputs.case.list_radius * (1 + self.inputs.case.skin))
        return found[np.argsort(distance[found], kind="stable")]

    def inside(self, i: int) -> int:
        """How many of `near` are within the support radius."""
        kernel = kernel_of(self.operation, self.inputs)
        radius = self.inputs.case.list_radius if kernel is None else float(kernel.support_radius)
        return int((self.distances(i)[self.near(i)] < radius).sum())

    @cached_property
    def looked_at(self) -> list[int]:
        """Places of some wrong rows: the worst, and some of the middle."""
        order = [int(k) for k in np.argsort(-self.error, kind="stable") if self.wrong[k]]
        return list(dict.fromkeys((*order[:2], *order[len(order) // 2 :][: LOOKED_AT - 2])))

    # What the program gives for the same and for fewer particles

    def unsteady(self) -> tuple[str, int | None]:
        """Other values in another call."""
        quiet, began = self.target.quiet(), time.process_time()
        for number in range(REPEATS):
            with on_one_core(number % 2 == 0):
                other = quiet.launch(self.inputs, before=self.judged.before)[1][self.name]
            other = other if len(other) == len(self.got) else other[self.number]
            if (lengths(other - self.after) > self.bound).any():
                self.target.sought.unsteady = (
                    f"your program gives other values of {self.name} for the same inputs: a race between threads, or"
                    " memory that is read before it is written"
                )
                break
            if time.process_time() - began > ENOUGH:
                break
        return self.target.sought.unsteady, None

    def holds_on(self, i: int, others: np.ndarray) -> bool:
        """Whether the program is right for particle i among `others`, wall particles as they are."""
        keep = np.sort(np.append(others, i)).astype(int)
        return self.right_on(self.some(keep), np.searchsorted(keep, [i]))

    def right_on(self, inputs: Inputs, rows: np.ndarray | None = None) -> bool:
        """Whether the program is right on altered inputs."""
        quiet = self.target.quiet()
        before, after = quiet.launch(inputs, complete=False)
        answer = {self.name: oracle(self.operation, inputs, rows)[self.name]}
        return bool(worst(errors(self.operation, inputs, before, after, rows, answer)) <= 1) and not quiet.faults

    def reduced(self) -> tuple[str, int | None]:
        """What the program is right without."""
        for name, alter, words in (
            ("period", without_period, "with a period: is the nearest image taken in both directions?"),
            ("walls", without_walls, "with wall particles: their position, side or sign"),
        ):
            given = self.inputs[name] if name in self.taken else None
            if given is None or (name == "walls" and not len(given.position)):
                continue
            if self.right_on(alter(self.inputs)):
                with contextlib.suppress(*REFUSED):
                    return f"{self.name} is wrong only {words}", self.isolated()[1]
                return f"{self.name} is wrong only {words}", None
        return "", None

    def isolated(self) -> tuple[str, int | None]:
        """The first neighbour that spoils the worst row, the nearest first."""
        i = int(self.number[self.worst])
        near, inside = self.near(i), self.inside(i)
        if not self.holds_on(i, near[:0]):
            return f"{self.name} is wrong for a particle alone", None
        if self.holds_on(i, near):
            apart = (
                f"{self.name} is right for a particle and its neighbours alone, and wrong with particles out of reach"
            )
            small = self.error.max() <= self.total_rounding(self.target.dtype)
            return (self.summed if small else f"{apart}: is there a cut at r = h?"), None
        low, high = 0, len(near)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if self.holds_on(i, near[:middle]) else (low, middle)
        partner = int(near[high - 1])
        if high > inside:
            return f"{self.name} counts particles beyond the support radius: there is no cut at r = h", partner
        if high >= CAPACITY and self.holds_on(i, near[high - 1 : high]):
            return self.cut_off(high - 1), partner
        return "", partner

    def cut_off(self, most: int) -> str:
        """Words for a list that is too short."""
        return f"{self.name} is right with up to {most} neighbours and wrong with more: is a list cut off?"

    # What the oracle predicts

    def predicted(self) -> tuple[str, int | None]:
        """The first hypothesis that explains all rows that are looked at."""
        for words, inputs in self.hypotheses():
            if self.explains_all(inputs):
                return words, None
        for name in self.taken:
            taken = name != "position" and self.inputs.per_particle(name) and not self.inputs.dropped(name)
            if taken and self.explains(partial(self.with_own, name)):
                symbol = SYMBOLS.get(name, name)
                return f"the answer has {symbol}_i in place of {symbol}_j", None
        for words, sign in (
            ("leaves out the particle itself (missing self term)", -1),
            ("counts the particle itself twice", 1),
        ):
            if self.explains(partial(self.with_self, sign)):
                return f"your program {words}", None
        return "", None

    def rounded(self) -> tuple[str, int | None]:
        """Errors of both signs, of the size of the rounding of a sum over all particles."""
        return (self.summed if self.mixed and self.error.max() <= self.total_rounding(self.target.dtype) else ""), None

    @cached_property
    def mixed(self) -> bool:
        """Whether errors of both signs are frequent."""
        signs = np.sign((self.got - self.right).reshape(len(self.got), -1)[self.wrong, 0])
        return bool(min((signs > 0).sum(), (signs < 0).sum()) > 0.2 * len(signs))

    def total_rounding(self, dtype: str) -> float:
        """Rounding of a sum over all particles in a precision."""
        total = float(np.maximum(size(self.scale).reshape(-1), lengths(self.right)).mean()) * self.count
        return ROUNDINGS * float(np.finfo(dtype).eps) * total

    @property
    def summed(self) -> str:
        """Words for an error of that size."""
        return (
            f"the error of {self.name} has the size of the rounding of a sum over all particles: is one taken in"
            f" {self.target.dtype}?"
        )

    def off_by_one(self) -> tuple[str, int | None]:
        """One neighbour too few or too many in each wrong row."""
        for words, sign in (("one neighbour is missing", -1), ("one neighbour is counted twice", 1)):
            partner = self.closest(self.worst, sign)
            if partner is not None and self.explains(partial(self.with_best, sign)):
                return f"off by one: in each wrong row {words}", partner
        return "", None

    def hypotheses(self) -> Iterator[tuple[str, Inputs]]:
        """(words, inputs that would give the program's answer in all rows)."""
        operation, inputs, taken = self.operation, self.inputs, self.taken
        yield "the answer is that of half the support radius: h/2 in place of h", scaled(operation, inputs, 0.5)
        yield "the answer is that of twice the support radius: 2 h in place of h", scaled(operation, inputs, 2.0)
        kernels = {name: inputs[name] for name in KERNELS if name in taken}
        if kernels:
            other = 5 - inputs.case.dim
            turned = {name: group._replace(dim=type(group.dim)(other)) for name, group in kernels.items()}
            yield f"the answer has the kernel's normalisation for {other} dimensions", inputs.replaced(**turned)
            for shape in SHAPES if shape_acts(operation) else ():
                yield f"the answer is that of the kernel {shape}", with_kernel(operation, inputs, shape)
        if "mass" in taken and "density" in taken:
            mass, density = inputs["mass"], inputs["density"]
            yield "the answer has m_j/rho_j in place of m_j", inputs.replaced(mass=mass / density)
            yield "the answer has m_j in place of m_j/rho_j", inputs.replaced(mass=mass * density)
        if "period" in taken and inputs["period"] is not None:
            yield "the answer is that without a period", without_period(inputs)
        if "walls" in taken and inputs["walls"] is not None and len(inputs["walls"].position):
            yield "the answer is that without wall particles", without_walls(inputs)
            for axis in range(inputs.case.dim):
                position = inputs["walls"].position * np.where(np.arange(3) == axis, -1, 1).astype(inputs.dtype)
                mirrored = inputs.replaced(walls=inputs["walls"]._replace(position=position))
                yield f"the wall particles are mirrored: {'xyz'[axis]} has the wrong sign", mirrored

    def answer(self, inputs: Inputs, row: int) -> np.ndarray:
        """The oracle's answer to altered inputs in one row."""
        return oracle(self.operation, inputs, np.array([row]))[self.name][0][0]

    def with_own(self, name: str, k: int) -> np.ndarray:
        """The answer in the k-th row where all particles have that particle's value of a field."""
        values, i = self.inputs[name], int(self.number[k])
        own = np.broadcast_to(values[i], values.shape).copy()
        return self.answer(self.inputs.replaced(**{name: own}), i)

    def with_self(self, sign: int, k: int) -> np.ndarray:
        """The right answer with or without what the particle by itself gives, far from walls."""
        return self.right[k] + sign * self.answer(without_walls(self.some(self.number[k : k + 1])), 0)

    def some(self, keep: np.ndarray) -> Inputs:
        """The inputs with some of the particles."""
        return subset(self.operation, self.inputs, keep)

    def with_best(self, sign: int, k: int) -> np.ndarray:
        """The right answer with or without the neighbour that explains it best."""
        near, adds = self.parts(k)
        return np.atleast_1d(self.right[k]) + (sign * adds[self.place(k, sign)] if len(near) else 0.0)

    def explains(self, predict: Callable[[int], Any]) -> bool:
        """Whether what a cause predicts is what the program gave, in the rows that are looked at."""
        rows = self.looked_at
        return self.agrees(np.array([predict(k) for k in rows]).reshape(self.right[rows].shape), rows)

    def explains_all(self, inputs: Inputs) -> bool:
        """Whether altered inputs give what the program gave, in all rows, right ones too."""
        prediction = oracle(self.operation, inputs, self.number)[self.name][0]
        return self.agrees(prediction, list(range(len(self.right))))

    def agrees(self, prediction: np.ndarray, rows: list[int]) -> bool:
        """Whether a prediction for some rows is the program's answer, and not the right one in the wrong rows."""
        effect, bound = lengths(prediction - self.right[rows]), self.bound[rows]
        if not (lengths(prediction - self.got[rows]) <= np.maximum(8 * bound, NEAR * effect)).all():
            return False
        hits = int((self.wrong[rows] & (effect > 4 * bound)).sum())
        return hits >= min(2, int(self.wrong.sum()))

    def _parts(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        """(neighbours within the support, what each adds) of the k-th row, by leaving out one at a time."""
        i = int(self.number[k])
        near = self.near(i)[: self.inside(i)]
        near = near if len(near) <= MOST_PAIRS else near[:0]
        every = np.arange(self.count)
        adds = [self.right[k] - self.answer(self.some(np.delete(every, j)), i - int(j < i)) for j in near]
        return near, np.array(adds).reshape(len(near), -1)

    def place(self, k: int, sign: int) -> int:
        """Place of the neighbour whose absence (-1) or repetition (1) explains the k-th row best."""
        error = np.atleast_1d(self.got[k] - self.right[k])
        return int(np.argmin(np.abs(error - sign * self.parts(k)[1]).sum(1)))

    def closest(self, k: int, sign: int) -> int | None:
        """The number of that neighbour."""
        near, _ = self.parts(k)
        return int(near[self.place(k, sign)]) if len(near) else None

    # Where it is wrong

    def located(self) -> tuple[str, int | None]:
        """A number of neighbours above which all rows are wrong, and below which none is."""
        if not (self.own and takes_neighbours(self.operation)) or self.count > MOST_PARTICLES:
            return "", None
        counted = np.array([self.inside(int(i)) for i in self.number])
        most = counted[~self.wrong].max(initial=-1)
        if most >= CAPACITY and counted[self.wrong].min() > most:
            return self.cut_off(most), None
        return "", None

    def values(self, partner: int | None) -> dict[str, Any]:
        """The worst row in numbers, and the pair that matters."""
        k = self.worst
        got, right = (np.asarray(v[k]).tolist() for v in (self.got, self.right))
        bound = float(self.error[k] / self.ratio[k]) if np.isfinite(self.ratio[k]) else None
        told: dict[str, Any] = {
            "output": self.name, "row": int(self.number[k]), "got": got, "expected": right,
            "error": float(self.error[k]), "bound": bound, "neighbours": 0,
        }  # fmt: skip
        if self.own and takes_neighbours(self.operation):
            i = int(self.number[k])
            told["neighbours"] = self.inside(i)
            near = self.near(i)[: told["neighbours"]]
            if partner is None and len(near) and self.count <= MOST_PARTICLES:
                with contextlib.suppress(*REFUSED):
                    partner = min((self.closest(k, sign) for sign in (-1, 1)), key=lambda j: -1 if j is None else j)
            if partner is None and len(near):
                partner = int(near[0])
            if partner is not None:
                told["pair"] = self.pair(k, partner)
        return told

    def pair(self, k: int, j: int) -> dict[str, Any]:
        """Particle j beside the k-th row's: its distance, and what it adds."""
        i = int(self.number[k])
        distance = float(self.distances(i)[j])
        told: dict[str, Any] = {
            "particle": int(j), "distance": distance, "over_support": distance / self.inputs.case.support_radius,
            "adds": None,
        }  # fmt: skip
        with contextlib.suppress(*REFUSED):
            both = self.answer(self.some(np.array(sorted((i, j)))), int(j < i))
            told["adds"] = (both - self.answer(self.some(np.array([i])), 0)).tolist()
        return told


@contextlib.contextmanager
def on_one_core(wanted: bool) -> Iterator[None]:
    """Threads that a program starts share one core, if `wanted` and on Linux: those that race meet in another order."""
    if not wanted or not hasattr(os, "sched_setaffinity"):
        yield
        return
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)


def factor_between(got: np.ndarray, value: np.ndarray) -> float | None:
    """The factor between two arrays, if one serves all entries of at least two; 1 and -1 up to SAME."""
    if value.size < 2 or not np.any(value):
        return None
    large = np.abs(value) > SMALL * np.abs(value).max()
    ratios = got[large] / value[large]
    factor = float(np.median(ratios))
    if not np.any(got):
        return 0.0
    if len(ratios) < 2 or np.abs(ratios - factor).max() > SAME * abs(factor):
        return None
    for plain in (1.0, -1.0):
        if abs(factor - plain) <= SAME:
            return plain
    return factor


def lengths(values: np.ndarray) -> np.ndarray:
    """Length of each row, of whatever shape."""
    return np.sqrt((np.asarray(values, dtype=float).reshape(len(values), -1) ** 2).sum(1))


# Altered inputs


def subset(operation: Any, inputs: Inputs, keep: np.ndarray) -> Inputs:
    """The same with some of the particles, in their order."""
    names = {*operation.arguments("numpy"), *operation.outputs}
    kept = [n for n in names if inputs.per_particle(n) and not inputs.dropped(n)]
    return inputs.replaced(**{n: inputs[n][keep] for n in kept})


def scaled(operation: Any, inputs: Inputs, share: float) -> Inputs:
    """The same with a support radius of `share` times its own in every group that has one."""
    made: dict[str, Any] = {}
    for name, group in groups_of(operation, inputs).items():
        if name in KERNELS:
            shape = next(s for s, number in SHAPES.items() if number == group.shape)
            made[name] = smoothing(shape, share * float(group.support_radius), int(group.dim))
        elif "support_radius" in group._fields:
            made[name] = group._replace(support_radius=share * float(group.support_radius))
    return followed(operation, inputs.replaced(**made))


def without_period(inputs: Inputs) -> Inputs:
    """The same without a period."""
    return inputs.replaced(period=None)


def without_walls(inputs: Inputs) -> Inputs:
    """The same without wall particles; where they are left out, as they are."""
    if inputs.dropped("walls"):
        return inputs
    return inputs.replaced(walls=WallParticles(np.zeros((0, 3), inputs.dtype), np.zeros(0, inputs.dtype)))
