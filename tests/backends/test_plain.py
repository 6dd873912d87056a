"""Kernels are written once: loops and files around a body, the plain road, a Numba that has renamed a private name."""

import importlib.util
import json
import pathlib
import re

import numpy as np
import pytest

from refsim.backends.fast import private
from refsim.backends.fast.private import FEATURES
from refsim.backends.plain import PlainKernel
from refsim.backends.written import kind_of
from refsim.commands.show import printed
from refsim.core.operation import REGISTRY
from refsim.sph.kernels import gravity
from tests.backends.launched import launch
from tests.running import python

PROGRAM = """
import json, sys
from refsim import contract
from refsim.core import cases
from refsim.core.operation import REGISTRY
cases.discover()
answers = {}
for name in sys.argv[1:] or REGISTRY:
    for variant in range(len(REGISTRY[name].variants) if len(sys.argv) == 1 else 1):
        answers[f"{name} {variant}"] = str(contract.run(name, "cpu", "float64", "two_particles", variant))
program = REGISTRY["sph.density"].program("cpu")
print(json.dumps([type(program).__name__, answers]))
"""
SOME = {operation.folder: name for name, operation in REGISTRY.items()}.values()


@pytest.mark.parametrize("names", [SOME, pytest.param((), marks=pytest.mark.slow)], ids=["some", "all"])
def test_operations_keep_the_contract_as_python(names):
    """One of each folder on the plain road, and at night all."""
    run = python("-c", PROGRAM, *names, REFSIM_PLAIN="1", NUMBA_DISABLE_JIT="1")
    kind, answers = json.loads(run.stdout.splitlines()[-1])
    assert kind == "PlainKernel"
    assert len(answers) == len(names) or len(answers) > 250
    assert not [answer for answer in answers.values() if not answer.startswith("pass")]


def test_combinations_of_optional_terms_are_right_as_python():
    """Those that tests/ladder/test_pairing.py compiles at night: closed forms, and few particles of unequal masses."""
    program = """
from refsim import contract
from refsim.core import cases
from refsim.core.operation import REGISTRY, backend_of
from refsim.neighbours import formulas
key = formulas.cell_key
formulas.cell_key = lambda *cell: key(*map(int, cell))  # NumPy's int32 does not grow to hold a key
cases.discover()
for operation in REGISTRY.values():
    for program in operation.names():
        combinations = len(operation.as_computed_by(program).variants) if backend_of(program) == "cpu" else 0
        for variant in range(program not in ("cpu:fused", "cpu:central"), combinations):
            for outcome in contract.climb(contract.Target(operation, program, "float64", variant), ("T1",)):
                print(outcome.passed, outcome)
            for case in ("few_2d", "few"):
                outcome = contract.run(operation, program, "float64", case, variant)
                print(outcome.passed, outcome)
"""
    lines = python("-c", program, NUMBA_DISABLE_JIT="1").stdout.splitlines()
    assert len(lines) > 400
    assert [line for line in lines if not line.startswith("True")] == []


def test_functions_that_take_arrays_are_inlined():
    """A call that is not counts references to each array, for each row."""
    heads = re.findall(r"@njit\((.*)\)\ndef (\w+)\(", printed(REGISTRY["sph.density"], "cpu"))
    inlined = {name for options, name in heads if "forceinline=True" in options}
    assert inlined == {"sum_of_density_pair", "put_sums", "density_of_row"}


def test_one_thread_needs_no_parallel_loop():
    loops = PlainKernel(gravity.wrapper("cpu"), "refsim.sph.kernels", ())
    kinds = tuple(map(kind_of, (np.zeros(3), np.zeros((4, 3)))))
    assert ["parallel" in loops.of(kinds, alone).targetoptions for alone in (True, False)] == [False, True]


# Density over a list of all pairs.
DENSITY = """
import dataclasses, json, sys
from refsim.backends.fast import private
(feature,) = sys.argv[1:]
if feature:
    each = private.FEATURES[feature]
    private.FEATURES[feature] = dataclasses.replace(each, names=(*each.names[:-1], each.names[-1] + "_gone"))
from refsim import contract
from refsim.core.operation import REGISTRY
values = contract.bindings("sph.density", "cpu", "float32", "cloud_3d", lists="all_pairs")
values["smoothing"] = values["smoothing"].fixed()  # as in a run
REGISTRY["sph.density"].program("cpu")(*values.values())
print(json.dumps({"said": private.lost(), "density": values["density"].tolist()}))
"""


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """What a process says that has lost a feature."""
    cache = tmp_path_factory.mktemp("cache")

    def tell(feature):
        own = {"REFSIM_CACHE_DIR": str(cache / feature)} if feature else {}  # what is whole, other tests have compiled
        answer = python("-c", DENSITY, feature, **own)
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


BODY = """
from refsim.backends.compile import kernel

@kernel
def doubled(i, values, out):
    out[i] = 2 * values[i]

@kernel
def broken(i, values, out):
    out[i] = values.nowhere
"""
TWICE = """
import numpy as np, sys
from tiny import body
out = np.zeros(5)
body.doubled(np.arange(5.0), out)
assert list(out) == [0, 2, 4, 6, 8]
print(body.doubled.on("cpu").__code__.co_filename, sum(body.doubled.on("cpu").stats.cache_hits.values()))
try:
    body.broken(np.arange(5.0), out)
except Exception as error:
    print("body.py" in str(error), "values.nowhere" in str(error))
"""


@pytest.fixture
def run(tmp_path):
    (tmp_path / "tiny").mkdir()
    (tmp_path / "tiny" / "__init__.py").touch()
    (tmp_path / "tiny" / "body.py").write_text(BODY)

    def again():
        code, out, err = launch(tmp_path, TWICE).ended()
        assert code == 0, err
        return out.split()

    return tmp_path / "cache", again


def test_loops_are_files_of_the_cache_folder_and_found_again(run):
    cache, again = run
    place, hits, *error = again()
    assert pathlib.Path(place).parent.parent == cache
    assert "over_rows(body, out.shape[0], (values, out,))" in pathlib.Path(place).read_text()
    assert error == ["True", "True"], "a typing error does not point at the body"
    stamp = pathlib.Path(place).stat().st_mtime_ns
    _, hits, *_ = again()
    assert (int(hits), pathlib.Path(place).stat().st_mtime_ns) == (1, stamp)
