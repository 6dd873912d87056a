"""What the contract tells of wrong answers, and how it chooses what it tries: in numbers."""

import math
import types

import numpy as np

from refsim.contract import drawn, inputs, properties
from refsim.contract.apart import LibraryDescription, Request
from refsim.contract.report import report, text, verdict
from refsim.contract.target import Outcome
from refsim.core.operation import REGISTRY
from refsim.smoothing import Smoothing
from refsim.smoothing.shapes import WENDLAND_C2


def test_what_a_program_left_is_known_and_the_default_kernel_is_that_of_runs():
    for dtype in ("float32", "int32", "uint32"):
        whole = {"a": np.full(2, inputs.unset(np.dtype(dtype)), dtype)}
        given = whole, {"a": np.append(whole["a"][1:], np.array([3], dtype))}
        assert [list(inputs.unwritten(x, y)) for x in given for y in given] == [["a"], [], [], []]
    for shape in range(1, 5):
        kernel = Smoothing(*[1.0] * 5, np.int32(shape), 2)
        assert isinstance(inputs.as_in_runs(kernel).shape, tuple) == (shape == WENDLAND_C2)


def test_seeds_take_turns_with_numbers_beyond_16_bits(monkeypatch):
    monkeypatch.setattr(drawn, "many", lambda target, name: name)
    found = [drawn._many(types.SimpleNamespace(seed=seed)) for seed in (0, 1, 2, 3, 4, 5, 6, None)]
    assert found == [f"many_{2**16 + d}" for d in (-1, -1, 0, 0, 1, 1, -1, -1)]
    made = drawn.cases.CASES[f"many_{2**16}"]()
    assert (made.dim, made.position.shape) == (3, (2**16, 3))


# Steps whose outcome follows from calls
def outcome(error, words=""):
    return types.SimpleNamespace(error=error, words=words)


BITS = np.array([[3.0, 0.0, -4.0], [1.0, 1.0, 0.0], [0.5, 0.0, 0.0]], np.float32)


def test_a_common_velocity_may_change_no_bit(monkeypatch):
    for name in ("on_grid", "without_walls"):
        monkeypatch.setattr(properties, name, lambda *_: "usual")
    monkeypatch.setattr(properties, "CONSERVED", {"galilean": (lambda inputs: ["moved"], "changed")})
    for change, error in ((0.0, 0.0), (1e-7, math.inf)):
        values = {"usual": BITS, "moved": BITS + np.float32(change) * BITS}
        target = types.SimpleNamespace(launch=lambda given, v=values: (None, {"force": v[given]}), outcome=outcome)
        found = properties._conserved(target, "galilean", "case")
        assert (found.error, found.words) == (error, "" if not error else "changed")


# Reports
def drawn_outcome(rng, name):
    passed, left = bool(rng.random() < 0.7), str(rng.choice(["", "", "", "", "with walls", "above 900 particles"]))
    error = float(rng.choice([0.2, 3.5, math.inf, 1e9])) if not passed else float(rng.uniform(0, 1))
    values = {"output": "a", "row": 7, "got": 1.0, "expected": 1.5, "error": 0.5, "bound": None, "neighbours": 4}
    words = "" if passed else str(rng.choice(["misses 3 of 9", "misses 4 of 7", "is late", "gives 2.5 times", ""]))
    return Outcome(
        name, str(rng.choice(["T1", "T2", "T2", "T3", "T7", "T11"])), f"case {rng.integers(9)}", "numpy",
        str(rng.choice(["float32", "float64"])), int(rng.integers(0, 4)), passed and not left, error, words, left,
        str(rng.choice(["", "wendland_c2", "cubic_spline wendland_c2"])), int(rng.integers(2, 4)),
        bool(rng.random() < 0.9), values if not passed and rng.random() < 0.6 else {}, seconds=float(rng.random()),
    )  # fmt: skip


def test_reports_of_drawn_outcomes_are_as_ever(recorded):
    """What holds, is lacking, failed and is grouped, as data and as text."""
    found, names = {}, ["sph.density", "sph.momentum"]
    for number in range(15):
        rng = np.random.default_rng(number)
        outcomes = {n: [drawn_outcome(rng, n) for _ in range(rng.choice([0, 3, 12, 30]))] for n in names}
        if number % 4 == 0:
            outcomes = {n: [o for o in given if o.passed or o.not_judged] for n, given in outcomes.items()}
        offered = None if number % 5 == 4 else names
        declared = {
            "dtypes": ["float32", "float64"], "dims": [2, 3][: 1 + number % 2], "kernels": ["wendland_c2", "mueller"],
            "left_out": ["walls", "period", "number_density", "asymmetry"][: number % 5],
        }  # fmt: skip
        request = Request(
            "lib", allow_untried=bool(number % 3 == 1), steps=((), ("T1",), ("T2", "T7"))[number % 7 % 3],
            dtypes=(("float32",), ())[number % 2], variants=((), (1,))[number % 6 == 5],
        )  # fmt: skip
        data = report(LibraryDescription("lib", "numpy", names, offered, declared), request, outcomes, 3.25)
        operations = data.pop("operations")
        told = {n: {k: v for k, v in o.items() if k not in ("outcomes", "cause")} for n, o in operations.items()}
        told = {n: (o, len(o["gaps"]), verdict(o) == "holds", verdict(o)[0] == "n") for n, o in told.items()}
        data["operations"] = operations
        assert len(data["not_offered"]) == (0 if offered is None else len(REGISTRY) - 2)
        lines = text(data, outcomes).splitlines()
        lines = lines if offered is None else lines[:-1]  # the last counts refsim's operations
        found[f"{number}"] = data["holds"], told, "\n".join(lines)
        found[f"{number} lines"] = [len(line.split()) for line in lines][:40]
    recorded(found)
