"""Operations are registered on their references."""

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
