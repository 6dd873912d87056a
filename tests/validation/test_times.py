"""Times: the least work of a kernel, scenes that are timed, benchmarks from end to end, the store and the pages."""

import itertools
import json
import os
import subprocess
import sys

import numpy as np
import pytest

from refsim import InputError, Simulation, make_plan
from refsim.smoothing import formulas as smoothing
from refsim.sph import formulas as liquid
from refsim.surface_tension.jiang_zhu_2023 import formulas as tension
from validation import limits, timed, times


class Counted:
    """A number that counts what is computed with it."""

    done = 0

    def __init__(self, value):
        self.value = float(getattr(value, "value", value))

    def _made(self, value):
        Counted.done += 1
        return Counted(value)

    def __add__(self, other):
        return self._made(self.value + Counted(other).value)

    def __sub__(self, other):
        return self._made(self.value - Counted(other).value)

    def __mul__(self, other):
        return self._made(self.value * Counted(other).value)

    def __truediv__(self, other):
        return self._made(self.value / Counted(other).value)

    __radd__ = __add__
    __rmul__ = __mul__

    def __neg__(self):
        return Counted(-self.value)  # a sign of a constant

    def __ge__(self, other):
        return self.value >= Counted(other).value

    def __lt__(self, other):
        return self.value < Counted(other).value


def operations(function, *arguments):
    before = Counted.done
    function(*arguments)
    return Counted.done - before


def counted(group):
    """A parameter group with numbers that count; whole numbers stay."""
    values = {k: v if isinstance(v, np.integer) else Counted(v) for k, v in group._asdict().items()}
    return group._replace(**values)


def test_least_operations_are_those_of_the_formulas():
    plan = make_plan(timed.spinning_cube(3))
    kernel, fluid = counted(plan.shared["smoothing"]), counted(plan.shared["fluid"])
    cohesion = counted(plan.parameters["jiang_zhu_2023"]["cohesion"])
    viscosity = counted(plan.parameters["weakly_compressible"]["viscosity"])
    r, one = Counted(0.3 * plan.grid.support_radius), Counted(1.0)
    distance, add_vector = 8, 6  # three differences, their squares and sum; f times a vector, added
    value = operations(smoothing.kernel_value, r, kernel)
    density = 1 + value + 2  # root, W, m W added
    slope = operations(smoothing.kernel_slope, r, kernel)
    pressure = operations(liquid.pressure_pair, one, one, one, one, fluid)
    laplacian = operations(smoothing.viscosity_laplacian, r, kernel) - 2  # q and 1 - q are the slope's
    friction = 1 + laplacian + operations(liquid.viscosity_pair, one, viscosity, one) + 3 + add_vector
    shape = operations(tension.cohesion_pair, one, Counted(0.3), cohesion) - 1  # alpha times inner share: for all pairs
    pull = shape + 1 + add_vector
    forces = 4 + slope + pressure + add_vector + friction + pull
    state = operations(liquid.state_pressure, Counted(900.0), fluid)
    n, neighbours, entries = 10, 33.0, 50.0
    tested = distance * entries
    expected = {
        "density": tested + density * neighbours,
        "forces": tested + forces * neighbours + 9,
        "state": state,
        "list": tested,
    }
    assert {k: limits.least(k, n, neighbours, entries).operations / n for k in expected} == expected


def test_least_bytes_are_those_of_the_fields():
    n, entries = 7, 50.0
    listed = n * (4 + 4 * entries)  # count and entries
    sizes = {"position": 12, "velocity": 12, "mass": 4, "density": 4, "pressure": 4, "acceleration": 12}
    reads = {
        "density": ("position", "mass", "density"),
        "forces": ("position", "velocity", "mass", "density", "pressure", "acceleration", "acceleration"),
        "list": ("position",),
    }
    for kernel, fields in reads.items():
        assert limits.least(kernel, n, 33.0, entries).bytes == listed + n * sum(sizes[field] for field in fields)


@pytest.mark.skipif(bool(limits.warp_sph.missing()), reason=limits.warp_sph.missing())
def test_accelerations_of_the_disturbed_cube_are_warps():
    assert 0 < limits.disturbed_difference(5, "cpu", "cpu") < limits.LARGEST_DIFFERENCE


# Scenes


@pytest.mark.parametrize("name", timed.ladders())
def test_a_ladder_only_adds(name):
    """No rung launches less, or holds less, than the one before it; the small scenes have the same effects."""

    def of(rungs):
        plans = [make_plan(rung.scene) for rung in rungs]
        return [(len(times.step_launches(plan, "cuda")), sum(plan.field_bytes().values())) for plan in plans]

    rungs = of(timed.ladders()[name].rungs)
    for before, after in itertools.pairwise(rungs):
        assert after[0] >= before[0]
        assert after[1] >= before[1]
    assert rungs[-1][1] > rungs[0][1]
    assert of(timed.ladders(True)[name].rungs) == rungs


def test_a_run_that_is_not_its_plan_is_told():
    simulation = Simulation(timed.ladders(True)["sph"].rungs[0].scene, "numpy")
    found = timed.launched(simulation)
    assert timed.differences(simulation, found) == []
    (said,) = timed.differences(simulation, found[1:])
    assert "the plan says" in said
    simulation.fields["spare"] = np.zeros(3)
    (said,) = timed.differences(simulation, found)
    assert said.startswith("the fields hold ")


def test_scenes_of_all_systems_have_about_as_many_particles():
    for name, scene in timed.systems(20).items():
        plan = make_plan(scene())
        assert 0.7 * 20**3 < plan.grid.count < 1.3 * 20**3, name
        assert plan.grid.dtype == "float32", name
        if name == "mesh coupling":
            gap = plan.state.position[:, 2].min() - plan.walls.position[:, 2].max()
            assert 0 < gap < plan.grid.support_radius, "the liquid touches the mesh"


# Benchmarks, store, pages


def benchmarks(folder, words, **environment):
    """What `pytest tests/times/...` with these words gives, as it is stored."""
    file = folder / "times.json"
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "--tiny", "--benchmark-json", str(file), *words]
    around = os.environ | {"PYTHONPATH": str(times.ROOT)} | environment
    around = {name: value for name, value in around.items() if not name.startswith("PYTEST_")}
    done = subprocess.run(command, cwd=times.ROOT, env=around, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-3000:]
    assert "tests/times" not in file.read_text().partition('"benchmarks"')[0], "the machine has its words only"
    return times.read(file)


def test_benchmarks_become_stored_times(tmp_path):
    words = ["bench_effects.py", "bench_scaling.py", "bench_kernels.py", "bench_device.py"]
    chosen = "sph-0-cpu or (test_steps and Dong) or (sph.density and float32 and not cuda) or test_surface"
    given = [f"tests/times/{name}" for name in words]
    found = benchmarks(tmp_path, [*given, "--edge", "4", "--particles", "50", "-k", chosen])
    assert set(found) == {"effects cpu", "scaling cpu", "device cpu"}
    surface = found["device cpu"]["readings"]["surface in turns"]
    assert surface["ratio"] == pytest.approx(np.median(surface["own"]) / np.median(surface["plain"]), rel=2e-3)
    (own,) = found["effects cpu"]["readings"].values()
    assert own["particles"] == 27
    assert min(own["seconds"]) > 0
    cores = len(os.sched_getaffinity(0))
    assert len(found["scaling cpu"]["readings"]) == sum(count <= cores for count in (1, 2, 4, 8, 16, 32))
    assert "| Dong | 64 |" in "\n".join(times.scaling_table(found))


def test_benchmarks_of_a_gpu_run_in_the_simulator(tmp_path):
    simulated = {"NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1"}
    chosen = "copy or arithmetic or (test_kernel and 60k) or table or 60k-jiang_zhu or sph-0-cuda"
    given = ["tests/times/bench_device.py", "tests/times/bench_effects.py", "-k", chosen]
    environment = simulated | {"PYTHONPATH": f"{times.ROOT}{os.pathsep}{times.ROOT / 'tests'}"}
    found = benchmarks(tmp_path, given, **environment)
    own = found["device cuda"]["readings"]
    assert set(own) >= {"copy", "arithmetic", "table", "60k jiang_zhu", "60k list"}
    assert set(own) >= {f"60k {kernel}" for kernel in limits.STEP_KERNELS}
    assert own["60k density"]["particles"] == 27
    # In the cube of 3^3 within 2 d, without pairs at 2 d exactly: 3, 5 or more of 26 on corners, edges, faces, inside.
    assert 12 < own["60k density"]["neighbours"] <= own["60k density"]["entries"]
    assert own["60k density"]["neighbours"] < 26
    assert found["effects cuda"]["readings"]["sph: liquid"]["kernels"] == 12


def test_a_part_measured_elsewhere_does_not_replace_a_table():
    def of(machine, *names):
        return {"effects cpu": {"machine": machine, "readings": {name: {"seconds": [machine]} for name in names}}}

    before = of("a", "first", "second")
    assert times.merged({}, before) == before
    assert times.merged(before, of("b", "first", "second")) == of("b", "first", "second")
    assert set(times.merged(before, of("a", "first"))["effects cpu"]["readings"]) == {"first", "second"}
    with pytest.raises(InputError, match="measured on a, and here 1 of its readings are missing"):
        times.merged(before, of("b", "first"))


def test_the_page_is_what_the_command_makes():
    text = times.PAGE.read_text()
    assert times.page(text, times.stored()) == text, "python -m validation times"


def test_the_store_names_no_machine():
    assert {key for part in times.stored().values() for key in part} == {"machine", "cores", "readings"}
    assert "/" not in json.dumps([part["machine"] for part in times.stored().values()])
