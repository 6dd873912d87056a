"""What the contract tells of wrong answers, and how it chooses what it tries: in numbers."""

import contextlib
import math
import types

import numba
import numpy as np
import pytest

from refsim import InputError
from refsim.contract import Programs, Target, answers, drawn, inputs, properties, trajectories, whole_runs
from refsim.contract.answers import seconds_of_many
from refsim.contract.apart import LibraryDescription, Request
from refsim.contract.report import junit, report, text, verdict
from refsim.contract.target import Outcome, told_values
from refsim.contract.trajectories import Snapshot
from refsim.core.operation import REGISTRY
from refsim.scene.files import parse_scene
from refsim.smoothing import Smoothing
from refsim.smoothing.shapes import WENDLAND_C2
from tests.contract.test_recorded_contract import SCENE


@pytest.mark.parametrize("radius", [0.2, 0.004])
def test_columns_of_a_gpu_hold_what_rows_do(radius):
    """Of 400 points, so that numbers above 100 are among them."""
    place = np.random.default_rng(7).random((400, 3)) * (1, 1, 0)
    rows, columns = (
        inputs.listed(place, place, radius, True, types.SimpleNamespace(name=name, asarray=np.asarray))
        for name in ("cpu", "cuda")
    )
    for i, (start, count) in enumerate(zip(rows.start, rows.count, strict=True)):
        assert (rows.entries[start : start + count] == columns.entries[i::400][:count]).all()
    assert (rows.count == columns.count).all()
    distance = np.linalg.norm(place[:, None] - place, axis=2) + np.eye(400)
    assert (rows.count == (distance < radius).sum(1)).all()


def test_what_a_program_left_is_known_and_the_default_kernel_is_that_of_runs():
    for dtype in ("float32", "int32", "uint32"):
        values = np.array([inputs.unset(np.dtype(dtype)), 3], dtype)
        assert inputs._unset(values).tolist() == [True, False]
    for shape in range(1, 5):
        kernel = Smoothing(*[1.0] * 5, np.int32(shape), 2)
        assert isinstance(inputs.as_in_runs(kernel).shape, tuple) == (shape == WENDLAND_C2)


def test_numbers_have_digits_enough_to_show_the_error():
    """Two more than the size of the largest over that of the error: 9 of a number, 7 of a component at least."""
    usual = {"output": "a", "row": 3, "bound": 2.5e-7, "neighbours": 1}
    for error, got, digits in ((0.5, 1.5, 9), (1e-7, 1.0000001, 9), (1e-9, 1.000000001, 11), (2e-12, 1 + 2e-12, 14)):
        text = told_values(usual | {"got": got, "expected": 1.0, "error": error})
        assert text == (
            f"a of particle 3: got {got:.{digits}g}, expected {1.0:.{digits}g}, error {error:.3g}, bound 2.5e-07,"
            " 1 neighbour"
        )
    right = [300.0, -4.0, 0.0]
    for error, digits in ((7.0, 7), (3e-3, 7), (3e-5, 9)):
        got = [v + error for v in right]
        text = told_values(usual | {"got": got, "expected": right, "error": error, "bound": None, "neighbours": 12})
        told = ", ".join(f"{v:.{digits}g}" for v in got)
        assert text.startswith(
            f"a of particle 3: got ({told}), expected (300, -4, 0), error {error:.3g}, 12 neighbours"
        )
    for error, expected in ((math.inf, 1.0), (0.0, 1.0), (2.0, 1.0), (1.0, math.inf)):
        assert f"expected {expected:.9g}," in told_values(usual | {"got": 1 / 3, "expected": expected, "error": error})
        assert "got 0.333333333," in told_values(usual | {"got": 1 / 3, "expected": expected, "error": error})
    assert told_values({}) == ""


@pytest.mark.parametrize("few, many, power", [
    (1e-3, 3e-3, 1.0), (1e-3, 9e-3, 2.0), (1e-3, 8.1e-2, 2.0), (1e-3, 1e-3, 1.0), (1e-3, 3e-3 * 3**0.4, 1.4),
    (0.0, 0.0, 1.0), (0.0, 5e-6, math.log(5, 3)),
])  # fmt: skip
def test_seconds_of_many_particles_follow_from_two_sizes(few, many, power, monkeypatch):
    """The shorter of two calls each; a millionth of a second at least."""
    sizes = dict(zip(answers.SIZES, (1000, 3000)))
    calls = {1000: iter((few + 3.0, few)), 3000: iter((many, many + 2.0))}
    target = types.SimpleNamespace(
        prepared=lambda name: (types.SimpleNamespace(case=types.SimpleNamespace(count=sizes[name])), None, None)
    )
    monkeypatch.setattr(answers, "_seconds", lambda target, given: next(calls[given[0].case.count]))
    assert seconds_of_many(target) == pytest.approx(max(many, 1e-6) * (70_000 / 3000) ** power, rel=1e-6)


def test_seeds_take_turns_with_numbers_beyond_16_bits(monkeypatch):
    monkeypatch.setattr(drawn, "many", lambda target, name: name)
    found = [drawn._many(types.SimpleNamespace(seed=seed)) for seed in (0, 1, 2, 3, 4, 5, 6, None)]
    assert found == [f"many_{2**16 + d}" for d in (-1, -1, 0, 0, 1, 1, -1, -1)]
    made = drawn.cases.CASES[f"many_{2**16}"]()
    assert (made.dim, made.position.shape) == (3, (2**16, 3))


@pytest.mark.parametrize("most, taken", [(None, 1), (1, 1), (9, 1), (0, 0), (-1, 0), (True, 0), (2.0, 0)])
def test_a_number_of_particles_is_one_from_1_on(most, taken):
    programs = Programs({}, most_particles=most)
    if taken:
        assert programs.checked() is programs
    else:
        with pytest.raises(InputError, match="most_particles"):
            programs.checked()


# Whole runs
def test_a_frame_is_asked_for_within_half_the_widest_gap(monkeypatch):
    frames = [Snapshot(t, np.zeros((1, 3))) for t in (0.0, 1.0, 3.0, 4.0)]
    monkeypatch.setattr(whole_runs, "trajectory", lambda folder: frames)

    def begin(*_):
        raise KeyError("begun")

    monkeypatch.setattr(whole_runs, "Simulation", begin)
    scene = parse_scene(SCENE, "scene.toml")
    for at, begun in ((4.997, 1), (5.003, 0), (4.0, 1), (0.2, 0), (0.49, 0), (0.51, 1), (None, 1)):
        with pytest.raises(KeyError if begun else InputError):
            whole_runs.compare(scene, "folder", at=at)


def test_a_component_that_a_frame_lacks_is_zero():
    arrays = {"x": np.array([1.0, 2.0]), "z": np.array([3.0, 4.0])}
    assert trajectories._columns(arrays, "xyz").tolist() == [[1, 0, 3], [2, 0, 4]]


def test_a_parameter_is_a_hundredth_larger_or_else_smaller(monkeypatch):
    """Numbers and velocities, but no places; smaller where no run takes it larger, and left out where neither."""
    scene = parse_scene(SCENE, "scene.toml")
    usual = {"sound_speed": 15.0, "dynamic_viscosity": 1.0, "rest_density": 1000.0}

    def plan(altered):
        liquid = next(e for e in altered.effects if e.name == "weakly_compressible")
        if liquid.sound_speed > 15.0 or liquid.dynamic_viscosity != 1.0:
            raise InputError("not so")

    monkeypatch.setattr(whole_runs, "make_plan", plan)
    found = dict(whole_runs.off_by_little(scene))
    for name, share in (("sound_speed", 0.99), ("rest_density", 1.01)):
        liquid = next(e for e in found[f"weakly_compressible.{name}"].effects if e.name == "weakly_compressible")
        assert getattr(liquid, name) == pytest.approx(share * usual[name])
    pull = next(e for e in found["gravity.acceleration"].effects if e.name == "gravity")
    assert pull.acceleration == pytest.approx((0.0, -9.81 * 1.01, 0.0))
    assert "weakly_compressible.dynamic_viscosity" not in found


# Steps whose outcome follows from calls
def outcome(error, words=""):
    return types.SimpleNamespace(error=error, words=words)


BITS = np.array([[3.0, 0.0, -4.0], [1.0, 1.0, 0.0], [0.5, 0.0, 0.0]], np.float32)


@pytest.mark.parametrize("changes, same_bits, error, words", [
    ({}, True, 0.0, ""), ({1: 2e-7}, False, 0.0, ""), ({1: 2e-7}, True, math.inf, "other bits .* (1 rows)"),
    ({0: 6e-5, 2: 1e-7}, False, math.inf, "other values of force .* (2 rows, by 1.2e-05"),
    ({0: 5.9e-5}, False, 0.0, ""), ({2: 0.25}, True, math.inf, "other values of force .* (1 rows, by 0.05"),
])  # fmt: skip
def test_calls_that_differ_are_a_race_beyond_a_hundred_roundings(changes, same_bits, error, words, monkeypatch):
    """Of the largest row, 5: below 100 eps, 6e-5, it is an order of sums; every second call shares one core."""
    given, cores = [BITS.copy() for _ in range(4)], []
    for row, amount in changes.items():
        given[2][row, 0] += amount * 5 / 5
    calls = iter({"force": values, "count": np.arange(3)} for values in given)
    target = types.SimpleNamespace(
        prepared=lambda case: (case, 1, 2), launch=lambda *inputs: (None, next(calls)), loader=True, dtype="float32",
        place=types.SimpleNamespace(name="numpy"), same_bits=same_bits, outcome=outcome,
    )  # fmt: skip
    monkeypatch.setattr(properties, "on_one_core", lambda wanted: cores.append(wanted) or contextlib.nullcontext())
    found = properties._repeated(target, "case", (None,) * 4)
    assert found.error == error
    for part in filter(None, words.split(" .* ")):
        assert part in found.words
    assert bool(found.words) == bool(words)
    assert cores == [False, True, False, True]


@pytest.mark.parametrize("totals, error", [
    ([(0.5, 1.0)], 0.5), ([(0.5, 1.0), (3.0, 2.0)], 1.5), ([(3.0, 2.0), (0.2, 2.0)], 1.5), ([(-1.0, 0.0)], 0.0),
    ([(0.0, 0.0)], math.inf), ([(2.0, 0.0)], math.inf),
])  # fmt: skip
def test_the_worst_of_all_motions_tells_of_a_law(totals, error, monkeypatch):
    """A sum over its bound; without bound it has to be negative, as the power of friction is."""
    left = iter(totals)
    monkeypatch.setattr(
        properties, "CONSERVED", {"law": (lambda inputs: [{"position": [0, 0]}] * len(totals), "broken")}
    )
    monkeypatch.setattr(properties, "TOTALS", {"law": lambda given, acceleration, bound: next(left)})
    for name in ("on_grid", "without_walls", "force_bound"):
        monkeypatch.setattr(properties, name, lambda *_: {"position": []})
    begun = []
    target = types.SimpleNamespace(
        launch=lambda given, before: begun.append(before) or (None, {"acceleration": [0.0]}), outcome=outcome
    )
    found = properties._conserved(target, "law", "case")
    assert (found.error, found.words) == (error, "" if error <= 1 else "broken")
    assert all(not before["acceleration"].any() and before["acceleration"].shape == (2, 3) for before in begun)


def test_a_common_velocity_may_change_no_bit(monkeypatch):
    for name in ("on_grid", "without_walls"):
        monkeypatch.setattr(properties, name, lambda *_: "usual")
    monkeypatch.setattr(properties, "CONSERVED", {"galilean": (lambda inputs: ["moved"], "changed")})
    for change, error in ((0.0, 0.0), (1e-7, math.inf)):
        values = {"usual": BITS, "moved": BITS + np.float32(change) * BITS}
        target = types.SimpleNamespace(launch=lambda given, v=values: (None, {"force": v[given]}), outcome=outcome)
        found = properties._conserved(target, "galilean", "case")
        assert (found.error, found.words) == (error, "" if not error else "changed")


@pytest.mark.parametrize("loader, place, threads, expected", [
    (None, "cpu", 1, ["on 1, 1 threads"]), (None, "cpu", 2, ["on 1, 2, 1, 2 threads"]),
    (None, "cpu", 8, ["on 1, 2, 8, 1, 2, 8 threads"]), (None, "numpy", 8, ["again"]),
    (True, "cpu", 8, ["6 calls with large_2d", "6 calls with large_3d"]),
])  # fmt: skip
def test_programs_are_repeated_on_one_two_and_all_threads(loader, place, threads, expected, monkeypatch):
    monkeypatch.setattr(numba.config, "NUMBA_NUM_THREADS", threads)
    monkeypatch.setattr(properties, "LARGE", {2: "large_2d", 3: "large_3d"})
    target = types.SimpleNamespace(loader=loader, place=types.SimpleNamespace(name=place), dims=(2, 3), variant=0)
    assert [trial.name for trial in properties.repeats(target)] == expected


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
    """What holds, is lacking, failed and is grouped, as data, as text and for CI."""
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
        found[f"{number}"] = data["holds"], told, "\n".join(lines), junit(data, outcomes).decode()
        found[f"{number} lines"] = [len(line.split()) for line in lines][:40]
    recorded(found)


def test_a_wrong_answer_has_words_beyond_its_bound():
    target = Target(REGISTRY["sph.density"], "numpy")
    for error, words in ((0.5, "density of particle 2"), (1.0, "density of particle 2"), (1.5, "bad: density")):
        outcome = properties._told(target, {"density": np.array([0.0, 0.1, error])}, "bad")
        assert isinstance(outcome, Outcome)
        assert outcome.words.startswith(words)
        assert (outcome.passed, outcome.error) == (error <= 1, error)
