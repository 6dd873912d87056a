"""A release of Numba that has renamed a private name: loops are plain, kernels are not kept, or launched publicly."""

import importlib.util
import json

import pytest

from refsim.backends.fast import private
from refsim.backends.fast.private import FEATURES
from tests.running import python

# Density over a list of all pairs.
PROGRAM = """
import dataclasses, json, sys
from refsim.backends.fast import private
(feature,) = sys.argv[1:]
if feature:
    each = private.FEATURES[feature]
    private.FEATURES[feature] = dataclasses.replace(each, names=(*each.names[:-1], each.names[-1] + "_gone"))
from refsim import contract
from refsim.core.operation import REGISTRY
values = contract.bindings("sph.density", "cpu", "float32", "cloud_3d", lists="all_pairs")
REGISTRY["sph.density"].program("cpu")(*values.values())
print(json.dumps({"said": private.lost(), "density": values["density"].tolist()}))
"""


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """What a process says that has lost a feature."""
    cache = tmp_path_factory.mktemp("cache")

    def tell(feature):
        own = {"REFSIM_CACHE_DIR": str(cache / feature)} if feature else {}  # what is whole, other tests have compiled
        answer = python("-c", PROGRAM, feature, **own)
        return json.loads(answer.stdout.splitlines()[-1]) | {"warned": answer.stderr}

    return tell


@pytest.fixture(scope="module")
def whole(told):
    return told("")


@pytest.mark.parametrize("feature", [name for name in FEATURES if name != "launch"])  # "launch": test_launching.py
def test_without_a_feature_kernels_give_the_same_and_it_is_said(feature, told, whole):
    found = told(feature)
    assert found["density"] == pytest.approx(whole["density"], rel=1e-5)  # a plain loop sums in another order
    (sentence,) = found["said"].values()
    assert sentence == f"This version of Numba lacks {FEATURES[feature].names[-1]}_gone: {FEATURES[feature].costs}."
    assert (sentence in found["warned"]) == (feature == "fast")
    assert not whole["said"]
    assert not whole["warned"]


@pytest.mark.parametrize(("feature", "name"), [(f, n) for f, each in FEATURES.items() for n in each.names])
def test_each_name_is_there_or_said(feature, name, monkeypatch):
    if feature == "launch" and importlib.util.find_spec("numba_cuda") is None:
        pytest.skip("numba-cuda, whose names these are, is not installed")
    monkeypatch.setattr(private, "_lost", {})
    monkeypatch.setitem(FEATURES, feature, private.Feature((name, f"{name}_gone"), "much"))
    private.names.cache_clear()
    assert private.names(feature) is None
    assert private.lost() == {feature: f"This version of Numba lacks {name}_gone: much."}
    private.names.cache_clear()


def test_flags_that_numba_does_not_know_are_left_out(monkeypatch):
    options = {"no_cfunc_wrapper": True, "_nrt": False, "forceinline": True, "fastmath": True}
    assert private.supported(options) == options
    from numba.core import compiler

    monkeypatch.delattr(compiler, "Flags")
    assert private.supported(options) == {"fastmath": True}
