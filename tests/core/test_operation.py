"""Operations are registered on their references."""

import math
import sys
import types

import pytest

from refsim.core import operation as core


@pytest.fixture
def reference(monkeypatch):
    """A function of the package `made_up`, with a registry of its own."""
    monkeypatch.setattr(core, "REGISTRY", {})

    def speed(distance):
        return {"speed": (distance, distance)}

    speed.__module__ = "made_up.operations"
    return speed


def test_names_follow_from_the_folder_and_the_function(reference):
    assert core.operation("v = x/t", paper="standard", outputs="speed")(reference) is reference
    (found,) = core.REGISTRY.values()
    plain = core.Operation("made_up.speed", "made_up", "standard", "v = x/t", "speed", ("speed",))
    assert found == plain


def test_operations_that_share_a_reference(reference):
    of_galilei = core.operations(paper="Galilei 1638", optional="walls period", reason="one product")
    of_galilei("first", adds="speed way", exact="way", entrywise=True)(
        of_galilei("second", "other.name", outputs="speed", variants=("walls", ""), broken={0: "rotation"})(reference)
    )
    second, first = core.REGISTRY.values()
    assert (first.name, second.name) == ("made_up.speed", "other.name")
    assert (first.outputs, first.exact, first.entrywise) == (("speed", "way"), ("way",), ("speed",))
    assert (first.variants, second.variants) == (({"walls": None, "period": None}, {}), ({"walls": None}, {}))
    assert second.broken == {0: ("rotation",)}
    assert first.tolerance_reason == second.tolerance_reason == "one product"
    with pytest.raises(ValueError, match="registered twice"):
        of_galilei("again", outputs="speed")(reference)


def test_values_of_variants_are_made_in_the_cases(reference, monkeypatch):
    cases = types.ModuleType("made_up.cases")
    cases.long_way = lambda case, grid: math.pi
    monkeypatch.setitem(sys.modules, "made_up.cases", cases)
    program = core.Program("fast", variants=("walls",))
    variant = core.without("walls", distance="long_way")
    core.operation("", paper="", outputs="speed", variants=(variant,), programs={"cpu": "slow", "cuda": program})(
        reference
    )
    (found,) = core.REGISTRY.values()
    assert found.variants[0]["walls"] is None
    assert found.variants[0]["distance"](None, None) == math.pi
    assert found.programs == {"cpu": core.Program("slow"), "cuda": core.Program("fast", variants=({"walls": None},))}
