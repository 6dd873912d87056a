"""Small scenes of every kind, and drawn ones: what their plans say, the memory that they take, what four steps make.

Drawn scenes stand in drawn_scenes.jsonl, one a line: most can run, one in four has a number that was changed.
"""

import json
import pathlib

import numpy as np
import pytest

import refsim
from refsim import InputError, RunStopped, Simulation, make_plan
from refsim.commands.plan import describe_plan
from refsim.core.writing import plain
from refsim.engine.conserved_totals import conserved_totals
from refsim.scene.files import parse_scene, scene_from_dict
from refsim.scene.refine import notes, refined, spaced
from refsim.study.cost import bytes_of, neighbour_list
from tests.recorded import numbers

EXAMPLES = pathlib.Path(refsim.__file__).parent / "examples"  # of the package that is tested
FOLDER = pathlib.Path(__file__).with_name("small_scenes")
SCENES = {  # words: text of a scene file, in which EXAMPLES stands for the folder of the packaged ones
    path.stem.replace("_", " "): "\n" + path.read_text(encoding="utf-8").replace("EXAMPLES", str(EXAMPLES))
    for path in sorted(FOLDER.glob("*.toml"))
}
DRAWN = (
    (FOLDER.parent / "drawn_scenes.jsonl").read_text(encoding="utf-8").replace("EXAMPLES", str(EXAMPLES)).splitlines()
)
STEPS, GROUP = 4, 8


def of_plan(plan):
    """What a plan says, by its kind; the machine's own numbers are left out."""
    told = describe_plan(plan, "cpu")
    fields, state = told.pop("fields"), plan.state
    starts = {name: getattr(state, name) for name in ("position", "velocity", "mass", "sizes")}
    return {
        **{key: value for key, value in told.items() if key not in ("passes", "runner", "gauges", "motions")},
        "bytes of fields": {name: field["bytes"] for name, field in fields.items()}, "start": starts,
        "walls": None if plan.walls is None else (plan.walls.position, plan.walls.volume),
        "list on a GPU": neighbour_list(plan, "cuda"), "rows of walls": plan.wall_rows,
    }  # fmt: skip


def of_run(plan):
    """The state after some steps, in every field, with gauges, limits, totals and notes."""
    run = Simulation(plan, "numpy")
    start = conserved_totals(run)
    lengths = [run.step().length for _ in range(STEPS)]
    exact = plan.grid.dtype == "float64"  # what single precision rounds is the machine's
    fields = {f"field {name}": run.field(name) for name in plan.particle_fields if exact}
    gauges = {f"gauge {g.name}": (run.gauge(g.name).time, run.gauge(g.name).values) for g in plan.scene.gauge}
    balances = {"balances": [plain(vars(b)) for b in vars(run.balances).values() if hasattr(b, "__dict__")]}
    totals = {"totals": (start, conserved_totals(run)), "steps": (lengths, run.limiters, run.last)}
    return fields | gauges | balances | totals | {"density": run.counting.report()}


def of_others(scene):
    """The scene at other spacings, as far as it has them."""
    try:
        factors = spaced(scene, 3, 1, 1.5)
    except InputError as error:
        return {"no other spacing": str(error)}
    made = [refined(scene, f) for f in factors]
    return {"spacings": (factors, notes(scene, factors)), "refined": made}


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_plans_and_runs_as_ever(name, recorded):
    scene = parse_scene(SCENES[name], name)
    plan = make_plan(scene)
    found = of_plan(plan) | of_run(plan) | of_others(scene)
    recorded(found)


def told(line, run):
    """Sums of the numbers of each thing that a plan holds and a run makes, or the sentence that refuses the scene."""
    try:
        plan = make_plan(scene_from_dict(json.loads(line), "drawn"))
    except InputError as error:
        return str(error)
    found = of_plan(plan) | {f"bytes on {name}": bytes_of(plan, name) for name in ("numpy", "cpu", "cuda")}
    found |= {"shared": plan.shared, **{f"groups of {name}": given for name, given in plan.parameters.items()}}
    if run and plan.grid.count < 150 and plan.grid.dtype == "float64":
        try:
            found |= of_run(plan) | of_others(plan.scene)
        except RunStopped as error:
            found["stopped"] = str(error)
    every = [[v for v in numbers(value) if not isinstance(v, str)] for value in found.values()]
    return [(len(values), sums(values)) for values in every]


def sums(values):
    """The sum, that of sizes, and one in which the order counts."""
    values = np.clip(np.array(values, float), -1e9, 1e9)
    return values.sum(), np.abs(values).sum(), np.cos(np.arange(len(values))) @ values


@pytest.mark.parametrize("group", range(len(DRAWN) // GROUP))
def test_drawn_scenes_plan_and_run_as_ever(group, recorded):
    recorded({f"{k}": told(line, k < 3) for k, line in enumerate(DRAWN[GROUP * group : GROUP * (group + 1)])})
