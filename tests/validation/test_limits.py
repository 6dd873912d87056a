"""The limits of the device: least work, page and pictures from stored readings, scaling with threads."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from refsim import make_plan
from refsim.smoothing import formulas as smoothing
from refsim.sph import formulas as liquid
from refsim.surface_tension.jiang_zhu_2023 import formulas as tension
from validation import limits, limits_page, scaling
from validation.drawing import style

AGAIN = "python -m validation limits"


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
    plan = make_plan(limits.spinning_cube(3))
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


SIMULATED = """
import json
from validation.simulator_threads import install
install()
from validation import limits
print(json.dumps({name: limits.MEASURES[name](*size) for name, size in
                  (("speeds", ()), ("kernels", ("60k",)), ("table", ()))}))
"""


def test_the_measurements_run_in_the_simulator():
    environment = os.environ | {
        "NUMBA_ENABLE_CUDASIM": "1",
        "NUMBA_DISABLE_JIT": "1",
        "PYTHONPATH": f"{limits_page.ROOT}{os.pathsep}{limits_page.ROOT / 'tests'}",
    }
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", SIMULATED], capture_output=True, text=True, env=environment, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    found = {name: {row[0]: row[1] for row in rows} for name, rows in json.loads(done.stdout.splitlines()[-1]).items()}
    assert min(found["speeds"].values()) > 0
    own = found["kernels"]
    assert own["particles"] == 27
    # In the cube of 3^3 within 2 d, without pairs at 2 d exactly: 3, 5 or more of 26 on corners, edges, faces, inside.
    assert own["neighbours"] <= own["entries"]
    assert 12 < own["neighbours"] < 26
    assert all(own[name] > 0 for name in (*limits.STEP_KERNELS, "list"))
    assert found["table"]["new table"] > 0
    assert found["table"]["blocks"] >= 8


def test_a_surface_is_measured_beside_a_step():
    found = {name: value for name, value, *_ in limits.mpm_surface("cpu")}
    assert found["particles"] == 8
    assert found["surface over plain step"] == pytest.approx(found["surface and force"] / found["plain step"], rel=2e-3)


@pytest.mark.skipif(bool(limits.warp_sph.missing()), reason=limits.warp_sph.missing())
def test_accelerations_of_the_disturbed_cube_are_warps():
    assert 0 < limits.disturbed_difference(5, "cpu", "cpu") < limits.LARGEST_DIFFERENCE


def test_without_warp_its_task_is_left_out_with_a_reason(monkeypatch):
    monkeypatch.setattr(limits.warp_sph, "missing", lambda: "no Warp here")
    assert {task for task in limits.tasks() if limits.left_out(task)} == {f"limits warp {s}" for s in limits.SIZES}
    with pytest.raises(RuntimeError, match="no Warp here"):
        limits.disturbed_difference(3, "cpu", "cpu")


def report(folder, name, date, tasks, error=None):
    device = {"task": "device", "rows": [{"name": "device", "value": name}], "error": None, "date": date}
    made = [
        {"task": task, "rows": [{"name": k, "value": v} for k, v in rows.items()], "error": error, "date": date}
        for task, rows in tasks.items()
    ]
    (folder / f"{name}.json").write_text(json.dumps({"whole check": {"tasks": [device, *made]}}))


SYSTEMS = tuple(scaling.scenes())
KERNELS = {"particles": 1000, "neighbours": 32.0, "entries": 50.0, "list": 2.0} | dict.fromkeys(
    limits.STEP_KERNELS, 1.0
)
MEASURED = {
    "limits speeds": {"copy speed": 4000.0, "arithmetic speed": 60000.0},
    "limits kernels 60k": KERNELS,
    "limits warp 60k": {
        "particles": 1000, "refsim": 2.0, "steps a list serves": 10.0, "Warp, each step": 6.0, "Warp, with skin": 5.0,
        "Warp, with skin, graph": 4.0,
    },
    "timing 60k jiang_zhu": {"step": 0.09},
    "timing 8M jiang_zhu": {"step per particle": 0.5},
}  # fmt: skip


def test_the_tables_are_made_of_the_newest_report(tmp_path):
    assert limits_page.newest(tmp_path) == ("", {})
    report(tmp_path, "newer", "2026-02-01 10:00 UTC", MEASURED)
    report(tmp_path, "older", "2026-01-01 10:00 UTC", {"timing 60k jiang_zhu": {"step": 7.0}})
    report(tmp_path, "broken", "2026-03-01 10:00 UTC", {"limits speeds": {"copy speed": 1.0}}, error="ended")
    device, tasks = limits_page.newest(tmp_path)
    assert device == "newer, 2026-02-01"
    bytes_, operations_ = limits_page.shares(tasks, "60k", "density")
    assert bytes_ == pytest.approx(1000 * 224 / 4e12 / 1e-3)
    assert operations_ == pytest.approx(1000 * (8 * 50 + 11 * 32) / 6e13 / 1e-3)
    whole = sum(limits.least(k, 1000, 32, 50).bytes for k in limits.STEP_KERNELS) + 216e3 / 10
    assert limits_page.shares(tasks, "60k", "step")[0] == pytest.approx(whole / 4e12 / 2e-3)
    assert limits_page.shares(tasks, "8M", "density") is None
    text = "\n".join(limits_page.markdown(device, tasks))
    assert "| 0.09 ms a step | 0.1 | yes | 0.07 | Warp 4 ms, refsim 2 ms in turns |" in text
    assert "| 2 G particle-steps/s | 2.5 | no | 3.5 | not measured yet | not measured yet |" in text
    assert "4.00 TB/s" in text
    with style():
        figure = limits_page.picture(tasks)
    assert limits_page.NOT_YET not in [words.get_text() for axes in figure.axes for words in axes.texts]


def test_what_is_missing_is_said():
    text = "\n".join(limits_page.markdown("", {}))
    assert text.count(limits_page.NOT_YET) >= len(limits_page.LINES)
    import matplotlib.pyplot as plt

    with style():
        for figure in (limits_page.picture({}), scaling.picture(None)):
            assert limits_page.NOT_YET in {words.get_text() for axes in figure.axes for words in axes.texts}
            plt.close(figure)


def test_the_page_is_what_the_command_makes():
    text = limits_page.PAGE.read_text()
    assert limits_page.page(text) == text, AGAIN


def test_scenes_of_all_systems_have_about_as_many_particles():
    for name, scene in scaling.scenes(20).items():
        plan = make_plan(scene())
        assert 0.7 * 20**3 < plan.grid.count < 1.3 * 20**3, name
        assert plan.grid.dtype == "float32", name
        if name == "mesh coupling":
            gap = plan.state.position[:, 2].min() - plan.walls.position[:, 2].max()
            assert 0 < gap < plan.grid.support_radius, "the liquid touches the mesh"


def test_threads_are_timed_in_turns(monkeypatch):
    some = {name: scaling.scenes(4)[name] for name in ("SPH with Akinci", "Dong")}
    before = scaling.cores()
    monkeypatch.setattr(scaling, "scenes", lambda edge: some)
    found = scaling.measure(4, (1, 2), rounds=3)
    assert scaling.cores() == before, "the process may use all of its cores again"
    counts = [str(count) for count in (1, 2) if count <= len(before)]
    for system in found["systems"].values():
        assert list(system["seconds"]) == counts
        assert all(len(readings) == 3 and min(readings) > 0 for readings in system["seconds"].values())
    assert "| SPH with Akinci | 64 |" in "\n".join(scaling.markdown(found))


def test_a_partial_measurement_does_not_replace_a_whole_one(monkeypatch, tmp_path):
    def of(counts, names=SYSTEMS):
        system = {"particles": 1, "start": 1.0, "seconds": {str(c): [1.0 / c] for c in counts}}
        return {"machine": "m", "date": "d", "systems": dict.fromkeys(names, system)}

    assert scaling.complete(of((1, 2)), None)
    assert not scaling.complete(of((1, 2), ("Dong",)), None)
    assert not scaling.complete(of((1, 2)), of((1, 2, 4)))
    kept = tmp_path / "cpu_scaling.json"
    kept.write_text(json.dumps(of((1, 2, 4))))
    monkeypatch.setattr(scaling, "STORED", kept)
    monkeypatch.setattr(scaling, "measure", lambda: of((1, 2)))
    with pytest.raises(RuntimeError, match=r"cpu_scaling\.json is kept"):
        scaling.renew()
    assert json.loads(kept.read_text()) == of((1, 2, 4))
    with style():
        figure = scaling.picture(of((1, 2, 4)))
    import matplotlib.pyplot as plt

    plt.close(figure)
