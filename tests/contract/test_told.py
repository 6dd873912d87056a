"""What the contract tells of wrong answers, and how it chooses what it tries: in numbers."""

import itertools
import math
import types

import numpy as np
import pytest

from refsim import InputError
from refsim.contract import Programs, Target, answers, drawn, properties, whole_runs
from refsim.contract.answers import seconds_of_many
from refsim.contract.parameters import groups_of, scaled
from refsim.contract.properties import on_grid
from refsim.contract.target import Outcome, told_values
from refsim.contract.trajectories import Snapshot
from refsim.core.operation import REGISTRY
from refsim.scene.files import parse_scene
from tests.contract.test_recorded_contract import SCENE


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


@pytest.mark.parametrize("operation", ["sph.density", "sph.momentum", "two_way_coupling.forces"])
@pytest.mark.parametrize("share", [0.5, 1.3])
def test_every_support_radius_is_scaled(operation, share):
    inputs = on_grid(Target(REGISTRY[operation], "numpy", "float64", seed=1), "cloud_3d")
    made, found = scaled(REGISTRY[operation], inputs, share), 0
    for name, group in groups_of(REGISTRY[operation], inputs).items():
        if "support_radius" in group._fields:
            found += 1
            assert float(made[name].support_radius) == pytest.approx(share * float(group.support_radius))
        if "value_scale" in group._fields:
            assert float(made[name].value_scale) == pytest.approx(float(group.value_scale) / share**3)
    assert found


@pytest.mark.parametrize("most, taken", [(None, 1), (1, 1), (9, 1), (0, 0), (-1, 0), (True, 0), (2.0, 0)])
def test_a_number_of_particles_is_one_from_1_on(most, taken):
    programs = Programs({}, most_particles=most)
    if taken:
        assert programs.checked() is programs
    else:
        with pytest.raises(InputError, match="most_particles"):
            programs.checked()


def test_a_wrong_answer_has_words_beyond_its_bound():
    target = Target(REGISTRY["sph.density"], "numpy")
    for error, words in ((0.5, "density of particle 2"), (1.0, "density of particle 2"), (1.5, "bad: density")):
        outcome = properties._told(target, {"density": np.array([0.0, 0.1, error])}, "bad")
        assert isinstance(outcome, Outcome)
        assert outcome.words.startswith(words)
        assert (outcome.passed, outcome.error) == (error <= 1, error)


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


@pytest.mark.parametrize("dtype, far", itertools.product(("float32", "float64"), (0.0, 40.0)))
def test_a_shaken_start_is_moved_by_what_its_precision_shows(dtype, far):
    """By a millionth of the spacing, or two roundings of the farthest coordinate from the middle of the scene."""
    text = SCENE.replace("float64", dtype).replace("lower = [0.0", f"lower = [{far}")
    scene = parse_scene(text, "scene.toml")
    starts = {}

    class Run(whole_runs.Simulation):
        def set_field(self, name, values):
            starts["moved"] = np.abs(values.astype(float) - self.field(name).astype(float))
            starts["most"] = np.abs(self.plan.grid.local(self.field(name))).max()
            super().set_field(name, values)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(whole_runs, "Simulation", Run)
        whole_runs.run_of(scene, 1, [0.0], "numpy")
    amount = max(1e-6 * 0.02, 2 * np.finfo(dtype).eps * starts["most"])
    rounding = np.finfo(dtype).eps * (far + 0.2)
    assert 0.9 * amount - rounding < starts["moved"][:, :2].max() <= amount + rounding
    assert not starts["moved"][:, 2].any()
