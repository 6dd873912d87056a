"""Every two effects in one small scene: the backends agree after two steps, and what goes together is on file.

Kernels run as Python here: to compile each combination of optional arguments would take minutes. The mesh, which all
scenes have in the same place, comes with boundary particles that compiled kernels have placed.
"""

import itertools
import json
import pickle

import pytest

from refsim import InputError, make_plan
from refsim.core.effect import EFFECTS
from tests import pairs
from tests.running import python

RUN = """
import json, pickle, sys
from refsim import MeshBoundary
from tests import pairs
placed = pickle.load(sys.stdin.buffer)
MeshBoundary.placed = lambda effect, grid: placed
found = {" ".join(pair): [list(part) for part in pairs.compare(*pair, "cpu", steps=2)] for pair in PAIRS}
print(json.dumps(found))
"""
LONGEST = "shape_matching", "surface_energy"  # half of the sixth's time, as a surface in space is Python here


def test_every_effect_is_paired():
    assert set(pairs.EFFECTS) == set(EFFECTS)


@pytest.mark.parametrize("some", [slice(5, None, 6), pytest.param(slice(None), marks=pytest.mark.slow)], ids=str)
def test_backends_agree_on_pairs(some):
    """A sixth of them but the longest, with every effect, and at night all; `tests.pairs.compare` states the bound."""
    chosen = [pair for pair in list(pairs.pairs())[some] if some.step is None or pair != LONGEST]
    assert {name for pair in chosen for name in pair} == set(pairs.EFFECTS)
    plan = make_plan(pairs.scene("weakly_compressible", "mesh_boundary"))
    placed = pickle.dumps(pairs.EFFECTS["mesh_boundary"].placed(plan.grid))
    program = RUN.replace("PAIRS", str(chosen))
    done = python("-W", "ignore", "-c", program, given=placed, NUMBA_DISABLE_JIT="1")
    found = json.loads(done.stdout.splitlines()[-1])
    assert list(found) == list(map(" ".join, chosen))
    assert all(len(parts) >= 5 for parts in found.values())
    bad = {pair: [part for part in parts if not part[1] <= part[2]] for pair, parts in found.items()}
    assert {pair: parts for pair, parts in bad.items() if parts} == {}


@pytest.mark.parametrize("pair", list(itertools.combinations(pairs.EFFECTS, 2)), ids=" ".join)
def test_what_goes_together_is_on_file(pair):
    """A pair that is refused by mistake would drop out of the comparison."""
    words = pairs.refused(*pair)
    if words:
        with pytest.raises(InputError, match=words):
            make_plan(pairs.scene(*pair))
    elif "mesh_boundary" not in pair:  # whose particles take seconds; the comparison has them
        make_plan(pairs.scene(*pair))
