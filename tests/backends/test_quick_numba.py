"""What the tests put in the place of Numba's bookkeeping gives what Numba's own gives."""

import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
PROGRAM = """
import hashlib, sys
import numba
import numpy as np
from numba.core import compiler, types
from refsim.backends.compile import formula

if sys.argv[1:] == ["quick"]:
    import quick_numba
    quick_numba.install()

@formula
def kept(values, i, limit):
    best = values[i]
    for k in range(i):
        if values[k] > limit[0] and values[k] < best:
            best = max(best * values[k], type(best)(limit[1]))
    return best

@numba.njit(fastmath={"contract"}, error_model="numpy")
def kernel(values, limit, out):
    for i in range(values.shape[0]):
        out[i] = kept(values, i, limit) + np.sqrt(values[i])

words = [kernel.py_func.__name__]
kernel(np.ones(3), (0.5, 2.0), np.zeros(3))
(code,) = kernel.inspect_llvm().values()
words.append(hashlib.sha256(code.encode()).hexdigest())
written = compiler.run_frontend(kernel.py_func)
for label, block in written.blocks.items():
    for statement in block.body:
        words.append([variable.name for variable in statement.list_vars()])
flags = compiler.Flags()
flags.nrt = True
words.append(flags.values())
words += [flags == flags.copy(), flags == compiler.Flags(), hash(flags) == hash(flags.copy())]
kinds = [types.float32, types.Array(types.float64, 2, "C"), types.UniTuple(types.int32, 2), types.none]
classes = [types.Type, types.Number, types.Float, types.Array, types.Buffer, types.BaseTuple, types.Opaque]
words.append([[isinstance(kind, one) for one in classes] for kind in kinds])
print(len(words), words)
"""


@pytest.fixture(scope="module")
def told():
    """What the program prints with Numba's bookkeeping and with that of the tests."""
    return [
        subprocess.run(
            [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(TESTS)!r})\n{PROGRAM}", *words],
            capture_output=True, text=True, check=True,
        ).stdout
        for words in ((), ("quick",))
    ]  # fmt: skip


def test_code_variables_options_and_classes_are_numbas(told):
    plain, quick = told
    assert int(plain.split()[0]) > 20
    assert quick == plain


def test_this_process_compiles_with_it():
    import quick_numba
    from numba.core import event, ir

    assert ir.Inst._rec_list_vars is quick_numba.variables
    assert event.install_timer is quick_numba.no_timer
