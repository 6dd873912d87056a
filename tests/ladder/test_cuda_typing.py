"""Every CUDA kernel compiles to PTX, with and without its optional arguments, in both dtypes; no GPU is needed.

In float32 no kernel may contain a float64 instruction unless it is declared here: one bare `2.0` in a formula would
make a GPU several times slower without changing a digit that any other test sees.
"""

import contextlib
import importlib
import os
import pathlib
import re
import sys
import tomllib
import types as python_types

import numpy as np
import pytest

from refsim.backends import arrays as backend
from refsim.backends import runtime
from refsim.backends.arrays import Scratch
from refsim.contract.inputs import Inputs, with_variant
from refsim.core import cases
from refsim.core.operation import REGISTRY, backend_of
from refsim.core.walls import ListedColumns
from refsim.neighbours.rows import NeighbourColumns

CAPABILITY = (8, 0)
IN_DOUBLE = {  # kernel: why
    name: why
    for why, names in tomllib.loads(pathlib.Path(__file__).with_name("in_double.toml").read_text()).items()
    for name in names
}
CASE = "cloud_2d"
COMPILED = set()  # what was looked at already
DTYPES = ("float32", "float64")
REQUIRED = bool(os.environ.get("REFSIM_REQUIRE_CUDA_TOOLS"))  # in .ci/run, which compiles more variants


def telling(operation):
    """Variants in which, taken together, each optional argument is given and left out, if it is in any."""
    holds = [{(n, v.get(n, "given") is None) for n in {*operation.optional, *v}} for v in operation.variants]
    left, chosen = set().union(*holds), {0}
    left -= holds[0]
    while left:
        best = max(range(len(holds)), key=lambda k: len(holds[k] & left))
        chosen.add(best)
        left -= holds[best]
    return chosen


def launched():
    """(name, program, variant, dtype, by day): by day the first variant in float32 and, where REQUIRED, the `telling`
    ones; at night the others, and the first in float64, which branches nowhere of its own."""
    for name, operation in REGISTRY.items():
        for program in operation.names():
            own = operation.as_computed_by(program)
            for variant in range(len(own.variants)) if backend_of(program) == "cuda" else ():
                for dtype in DTYPES[: 1 if variant else 2]:
                    by_day = dtype == "float32" and variant in (telling(own) if REQUIRED else (0,))
                    yield name, program, variant, dtype, by_day


LAUNCHED = list(launched())

pytestmark = pytest.mark.skipif(runtime.simulated(), reason="the CUDA simulator compiles nothing")


def cuda_compiler():
    """numba.cuda, if it can compile; else skip, or fail where $REFSIM_REQUIRE_CUDA_TOOLS requires it."""
    try:
        importlib.import_module("numba_cuda")  # the target that the kernels are written for; Numba's own is deprecated
        cuda = importlib.import_module("numba.cuda")
        cuda.compile_ptx(lambda: None, (), cc=CAPABILITY)
    except Exception as error:
        reason = f"no CUDA compiler here ({type(error).__name__}: {error}); pip install 'refsim[cuda]' brings one"
        (pytest.fail if REQUIRED else pytest.skip)(reason)
    return cuda


@pytest.fixture(scope="module")
def compiler():
    """numba.cuda with a stand-in for the device, whose compute capability is all that the compiler needs."""
    cuda = cuda_compiler()
    device = python_types.SimpleNamespace(compute_capability=CAPABILITY)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(importlib.import_module("numba.cuda.dispatcher"), "get_current_device", lambda: device)
        yield cuda


class Zeros(backend.Backend):
    """Host arrays whose values are set: nothing is launched that would set them, and programs look at some."""

    empty = backend.Backend.zeros


def operation_arguments(name, program, variant, dtype):
    """Everything that the operation's program takes, by name, as host arrays of the right type."""
    operation = REGISTRY[name].as_computed_by(program)
    cases.discover()
    inputs = with_variant(Inputs(cases.CASES[CASE](), dtype), operation.variants[variant])
    count, entries = np.zeros(len(inputs["position"]), np.int32), np.zeros(4, np.int32)

    def value(argument):
        if argument in operation.outputs:
            return inputs.output(operation, argument)
        if argument == "scratch":
            return Scratch(Zeros("cuda"))
        if argument == "neighbours":
            return NeighbourColumns(count, entries)
        if argument == "liquid_near_walls":
            return ListedColumns(inputs["position"], None, count, entries)
        if argument == "walls" and inputs["walls"] is not None:
            return ListedColumns(*inputs["walls"], count, entries)
        if argument == "grid":
            inputs["grid"].on_device = True
        return inputs[argument]

    return {argument: value(argument) for argument in operation.arguments(program)}


def launches(monkeypatch, program, arguments):
    """The launches [(kernel, arguments)] of a program, none of which takes place; its own arrays are NumPy's."""
    from refsim.backends import device
    from refsim.backends.compile import CudaKernel, Kernel

    seen = []
    with monkeypatch.context() as patch:
        patch.setattr(backend, "fill", device.fill)
        patch.setattr(backend, "largest", lambda values: 0)
        patch.setattr(device, "empty", np.empty)
        patch.setattr(device, "largest", lambda values: 0)
        patch.setattr(CudaKernel, "__call__", lambda kernel, *values: seen.append((kernel, values)))
        patch.setattr(Kernel, "__call__", lambda kernel, *values: kernel.program("cuda")(*values))  # arrays are NumPy's
        patch.setattr(device, "cupy_or_numpy", lambda: np)  # what CuPy does is nothing to compile
        patch.setattr(device, "as_cupy", lambda array: array)
        patch.setattr(device, "as_numba", lambda array: array)
        program(*arguments)
    return seen


def support_launches(dtype):
    """Launches of the kernels of searches and array moves, with the types that the searches hand them."""
    from refsim.backends import device
    from refsim.core.period import period_group
    from refsim.core.walls import planes
    from refsim.mpm import sorting_cuda as mpm_sorting
    from refsim.neighbours import cell_boxes_cuda as cell_boxes
    from refsim.neighbours import cell_list
    from refsim.neighbours import cell_list_cuda as search
    from refsim.neighbours import cell_order_cuda as cell_order
    from refsim.neighbours import cell_table_cuda as cell_table
    from refsim.neighbours import columns_cuda as columns
    from refsim.neighbours.formulas import periodic_cells
    from refsim.sparse_grid import Blocks
    from refsim.sparse_grid import block_search_cuda as sparse
    from refsim.sparse_grid import block_table_cuda as table

    n, real = 5, np.dtype(dtype).type
    vectors, scalars, integers = np.zeros((n, 3), dtype), np.zeros(n, dtype), np.zeros(n, np.int32)
    shifts = vectors, scalars, integers
    fours = np.zeros((n, 4), dtype)
    keys, ranges, one = np.zeros(n, np.int64), np.zeros((n, 9), np.int32), real(1)
    listed, shared = (NeighbourColumns(integers, integers, (np.int32(0),) * lanes) for lanes in (1, 4))
    blocks = Blocks(keys, np.zeros((n, 27), np.int32))
    period, planes = period_group((1.0, 0.0, 2.0), dtype), planes(-1.0, 1.0, dtype=dtype)
    cells = periodic_cells(period, 0.2)
    return [
        (cell_list.cell_keys.on("cuda"), (vectors, 1.0, None, keys, None)),
        (cell_list.cell_keys.on("cuda"), (vectors, 1.0, None, keys, integers)),
        (cell_list.cell_keys.on("cuda"), (vectors, 1.0, cells, keys, integers)),
        (cell_table.occupied_cells, (keys, keys, integers, integers, integers)),
        (columns.cell_ranges, (keys, integers, keys, integers, None, ranges, ranges)),
        (columns.cell_ranges, (keys, integers, keys, integers, cells, ranges, ranges)),
        (columns.pack_places, (vectors, fours)),
        (columns.build_list, (vectors, integers, ranges, ranges, fours, one, 1, None, integers, listed)),
        (columns.build_list, (vectors, integers, ranges, ranges, fours, one, 1, None, integers, shared)),
        (columns.build_list, (vectors, integers, ranges, ranges, fours, one, 1, period, integers, listed)),
        (device.pack_all, ((vectors, vectors), (scalars, scalars), (fours, fours), fours)),
        (device.gather_all, ((scalars, scalars), keys, (scalars, scalars))),
        (device.gather_all, ((vectors, vectors), keys, (vectors, vectors))),
        (device.copy_all, ((scalars, scalars), (scalars, scalars), scalars)),
        (device.copy_all, ((vectors, vectors), (vectors, vectors), vectors)),
        (cell_order.clear_counts, (integers, integers)), (cell_order.box_of_cells, (keys, integers)),
        (cell_order.count_cells, (keys, *4 * (integers,))), (cell_order.fill_buckets, 6 * (integers,)),
        (cell_order.order_buckets, (*5 * (integers,), keys)), (device.add_up_tiles, (integers, integers)),
        (device.add_up_within, (integers, integers, integers)),
        (cell_boxes.near_cells, (keys, integers, None, n, integers)),
        (cell_boxes.near_cells, (keys, integers, keys, n, integers)),
        (cell_boxes.cell_boxes, (vectors, vectors, vectors, scalars, integers, integers, scalars, vectors, vectors)),
        (cell_boxes.join_boxes, (integers, vectors, vectors, vectors, vectors)),
        (cell_boxes.join_boxes, (None, vectors, vectors, vectors, vectors)),
        (cell_boxes.compare_all, (vectors, vectors, scalars)),
        (cell_boxes.compare_boxes, (vectors, vectors, keys, integers, one, scalars, integers)),
        (search.count_missed, (vectors, vectors, None, scalars, None, None, listed, (1, 8), one, integers)),
        (search.count_missed, (vectors, vectors, shifts, scalars, None, period, listed, (1, 8), one, integers)),
        (search.count_missed, (vectors, vectors, None, scalars, planes, None, listed, (1, 8), one, integers)),
        (sparse.block_keys, (vectors, 1.0, 3, keys)), (sparse.point_nodes, (vectors, 1.0, 0.5, blocks, integers)),
        (sparse.count_points, 3 * (integers,)),
        (table.clear_table, (integers, keys)), (table.enter_keys, (keys, keys, integers, keys)),
        (table.enter_reached, (keys, -1, 4, 4, integers, keys, keys)),
        (table.find_neighbours, (keys, blocks.neighbour)),
        (mpm_sorting.mark_complete, (blocks.neighbour, np.zeros(n, np.uint8))),
        (mpm_sorting.enter_points, (vectors, 1.0, 2, keys, keys, integers)),
        (mpm_sorting.count_cells, (vectors, 1.0, blocks, np.zeros(n, np.uint8), *4 * (integers,))),
        (mpm_sorting.count_cells, (vectors, 1.0, blocks, np.zeros(n, np.uint8), integers, None, *2 * (integers,))),
        (sparse.begin_lists, (integers, integers)), (mpm_sorting.count_gaps, (integers, integers)),
        (sparse.fill_cells, 4 * (integers,)), (sparse.sort_cells, 4 * (integers,)),
        (device.fill_scalars, (one, scalars)), (device.fill_scalars, (np.int32(0), integers)),
        (device.gather_all, ((integers,), keys, (integers,))), (device.invert, (integers, integers)),
        (device.choose_step, (scalars, np.zeros((2, 4)), 1.0, 0.0, 1e-6, 9.0, 0.0, scalars, np.zeros(10))),
        (device.send_clock, (scalars, np.zeros(15), np.zeros(15))),
    ]  # fmt: skip


def modules_of(backend):
    """The modules of the programs for a backend."""
    entries = (
        (o, o.entry(name)) for o in REGISTRY.values() for name in (backend, *o.programs) if backend_of(name) == backend
    )
    return {f"{entry.folder or o.folder}.{entry.module}" for o, entry in entries}


def kernels_of(module_name):
    """A GPU's kernels of a module; of a module with another one for GPUs beside it, of the bodies that this imports.

    A module of programs for the CPU alone has none.
    """
    from refsim.backends.compile import CudaKernel, Kernel

    def values(name):
        return vars(importlib.import_module(name)).values()

    kernels = {v for v in values(module_name) if isinstance(v, CudaKernel)}
    made = {v for v in kernels if v.function.__module__.startswith(module_name)}
    bodies = {v for v in values(module_name) if isinstance(v, Kernel) and v.__module__ == module_name}
    if module_name in modules_of("cpu") - modules_of("cuda"):
        bodies = set()
    with contextlib.suppress(ModuleNotFoundError):
        bodies &= {v for v in values(f"{module_name}_cuda") if isinstance(v, Kernel)}
    return made | {v.on("cuda") for v in bodies}


def slots(kind):
    """Number of values that a launch passes for an argument of this Numba type."""
    from numba import types

    if isinstance(kind, types.Array):
        return 5 + 2 * kind.ndim
    return sum(map(slots, kind)) if isinstance(kind, types.BaseTuple) else 1


def as_if_on_device(value):
    """The value with stand-ins for device arrays in it."""
    if isinstance(value, np.ndarray):
        names = {name: getattr(value, name) for name in ("dtype", "ndim", "size", "shape", "strides")}
        place = python_types.SimpleNamespace(value=value.ctypes.data)
        return python_types.SimpleNamespace(
            copy_to_host=None, is_c_contiguous=lambda: True, device_ctypes_pointer=place, **names
        )
    if isinstance(value, tuple):
        parts = map(as_if_on_device, value)
        return value._make(parts) if hasattr(value, "_make") else tuple(parts)
    return value


def assert_launches(kernel, values, slots):
    """The short way to launch knows the arguments and hands over as many numbers."""
    from refsim.backends.launching import kinds_of, unfold

    there, numbers = tuple(map(as_if_on_device, values)), []
    assert kinds_of(there) is not None, kernel.__name__
    unfold(there, numbers)
    assert len(numbers) == slots, kernel.__name__


def assert_compiles(cuda, kernel, values, dtype):
    """Compile for the values' types; look at the PTX for parameters and for float64."""
    import numba

    kinds = tuple(numba.typeof(value) for value in values)
    if (kernel, kinds, dtype) in COMPILED:  # several operations launch it
        return
    ptx, _ = cuda.compile_ptx(kernel.function, kinds, cc=CAPABILITY)
    entry = ptx[ptx.index(".entry") :]
    assert entry[: entry.index(")")].count(".param") == sum(map(slots, kinds)), "the launch passes other parameters"
    assert_launches(kernel, values, sum(map(slots, kinds)))
    names = {kernel.__name__, f"{kernel.function.__module__.split('.')[-3]}.{kernel.__name__}"}
    if dtype == "float32" and not names & IN_DOUBLE.keys():
        lines = [line.strip()[:100] for line in ptx.splitlines() if ".param" not in line]  # handed in is not computed
        double = [line for line in lines if re.search(r"\.f64\b", line)]
        assert not double, f"{kernel.__name__} computes in float64: {double[:3]}"
    COMPILED.add((kernel, kinds, dtype))


def at_night(*given, by_day):
    return pytest.param(*given, marks=[] if by_day else [pytest.mark.slow])


@pytest.mark.parametrize(
    ("name", "program", "variant", "dtype"), [at_night(*given, by_day=by_day) for *given, by_day in LAUNCHED]
)
def test_operation_compiles(compiler, monkeypatch, name, program, variant, dtype):
    arguments = operation_arguments(name, program, variant, dtype)
    made = launches(monkeypatch, REGISTRY[name].program(program), arguments.values())
    assert made, "the program launches nothing"
    for kernel, values in made:
        assert_compiles(compiler, kernel, values, dtype)


def test_what_rounding_takes_from_a_position_is_not_cancelled(compiler, monkeypatch):
    """The six additions of the two-sum of each coordinate are all there, and none is fused with a product."""
    import numba

    found = []
    for variant in (0, 2):  # without and with a residual
        values = operation_arguments("sph.kick_drift", "cuda", variant, "float32").values()
        (kernel, given), *_ = launches(monkeypatch, REGISTRY["sph.kick_drift"].program("cuda"), values)[-1:]
        kinds = tuple(numba.typeof(value) for value in given)
        ptx, _ = compiler.compile_ptx(kernel.function, kinds, cc=CAPABILITY)
        found.append(len(re.findall(r"\b(?:add|sub)(?:\.rn)?\.f32\b", ptx)))
    assert found[1] - found[0] == 3 * 6


@pytest.mark.parametrize("dtype", [at_night(d, by_day=d == "float32") for d in DTYPES])
def test_search_and_array_moves_compile(compiler, dtype):
    for kernel, values in support_launches(dtype):
        assert_compiles(compiler, kernel, values, dtype)


def test_no_kernel_is_left_out(compiler, monkeypatch):
    known = {kernel for kernel, _ in support_launches("float32")}
    for name, program, variant, dtype, _ in LAUNCHED:
        if dtype == "float32":
            values = operation_arguments(name, program, variant, dtype).values()
            known |= {kernel for kernel, _ in launches(monkeypatch, REGISTRY[name].program(program), values)}
    listed = {module for module in sys.modules if module.startswith("refsim.")}
    for module in sorted(listed):
        left = sorted(kernel.__name__ for kernel in kernels_of(module) - known)
        assert not left, f"{module}: {', '.join(left)} is neither in an operation nor listed here"


def test_absent_argument_travels_as_a_null_pointer(compiler):
    from numba import types

    from refsim.backends.compile import _AbsentArgument

    assert _AbsentArgument().prepare_args(types.none, None, stream=0, retr=[]) == (types.CPointer(types.void), 0)
    assert _AbsentArgument().prepare_args(types.int32, 7, stream=0, retr=[]) == (types.int32, 7)
