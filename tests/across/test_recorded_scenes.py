"""Small scenes of every kind: what their plans say, what they start with and what four steps make of it."""

import pathlib

import pytest

import refsim
from refsim import InputError, Simulation, make_plan
from refsim.commands.plan import describe_plan
from refsim.core.writing import plain
from refsim.engine.conserved_totals import conserved_totals
from refsim.scene.files import parse_scene
from refsim.scene.refine import notes, refined, spaced
from refsim.study.cost import neighbour_list

EXAMPLES = pathlib.Path(refsim.__file__).parent / "examples"  # of the package that is tested
FOLDER = pathlib.Path(__file__).with_name("small_scenes")
SCENES = {  # words: text of a scene file, in which EXAMPLES stands for the folder of the packaged ones
    path.stem.replace("_", " "): "\n" + path.read_text(encoding="utf-8").replace("EXAMPLES", str(EXAMPLES))
    for path in sorted(FOLDER.glob("*.toml"))
}
STEPS = 4


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
