"""Small scenes of every kind: what their plans say, what they start with and what four steps make of it."""

import pathlib

import pytest

import refsim
from refsim import InputError, Simulation, make_plan
from refsim.commands.plan import describe_plan
from refsim.core.plain import plain
from refsim.engine.conserved_totals import conserved_totals
from refsim.scene.files import parse_scene
from refsim.scene.refine import notes, refined, spaced
from refsim.study.memory import neighbour_list

EXAMPLES = pathlib.Path(refsim.__file__).parent / "examples"  # of the package that is tested
CUBE, PEBBLE = EXAMPLES / "cube.obj", EXAMPLES / "pebble.obj"
SCENES = {
    "tank": """
dim = 2
dtype = "float64"
spacing = 0.1
support_radius = 0.26
end_time = 0.05
fluid = [
    {shape = "box", cells = [8, 6, 1], velocity = [0.3, -0.1, 0.0]},
    {shape = "ball", center = [0.4, 1.0, 0.0], radius = 0.21},
]
motion = [{of = "gravity", kind = "sway", direction = [3.0, 0.0, 0.0], amplitude = 0.1, period = 0.9, ramp = 0.5}]
gauge = [
    {name = "low", kind = "force", on = "-y"},
    {name = "left", kind = "force", on = "-x", about = [0.0, 0.3, 0.0]},
    {name = "all", kind = "force", on = "box_walls"},
    {name = "at", kind = "pressure", at = [0.4, 0.15, 0.0]},
    {name = "on", kind = "pressure", lower = [0.0, 0.0, 0.0], upper = [0.0, 0.5, 0.0]},
    {name = "high", kind = "level", lower = [0.4, 0.0, 0.0], upper = [0.4, 0.9, 0.0], every = 0.003},
    {name = "through", kind = "flux", lower = [0.4, 0.0, 0.0], upper = [0.4, 0.6, 0.0]},
]
energy_audit = {every = 2}
[effects]
weakly_compressible = {sound_speed = 30.0, dynamic_viscosity = 20.0}
gravity = {}
box_walls = {lower = [0.0, 0.0, 0.0], upper = [0.8, 2.0, 0.0], open_faces = ["+y"]}
""",
    "faces that move": """
dim = 2
dtype = "float64"
spacing = 0.1
support_radius = 0.3
end_time = 0.05
fluid = [{shape = "box", lower = [0.0, 0.2, 0.0], cells = [7, 6, 1], size = [0.7, 0.63, 0.1]}]
gauge = [{name = "right", kind = "force", on = "+x"}]
[[motion]]
of = "moving_faces"
kind = "table"
direction = [0.0, 1.0, 0.0]
times = [0.0, 0.02, 0.05]
values = [0.0, 0.002, 0.001]
[effects]
weakly_compressible = {sound_speed = 20.0, dynamic_viscosity = 10.0, density = "summation"}
gravity = {acceleration = [0.5, -9.0, 0.0]}
box_walls = {lower = [0.0, 0.2, 0.0], upper = [0.7, 1.4,
    0.0], moving_faces = ["+x"], no_slip = true, viscosity = 0.0, velocity = [0.0, 0.2, 0.0]}
""",
    "a tank that turns": """
dtype = "float64"
spacing = 0.1
support_radius = 0.26
end_time = 0.05
fluid = [{shape = "box", lower = [0.1, 0.2, 0.3], cells = [5, 4, 4]}]
motion = [
    {of = "turn", kind = "formula", direction = [
        0.0, 2.0, 0.5], pivot = [0.3, 0.1, 0.2], formula = "0.2*sin(9*t) + exp(t) - 1 - t*cos(t)/(2 + t)"},
    {of = "gravity", kind = "formula", direction = [1.0, 1.0, 0.0], formula = "0.1*t**2*sqrt(1 + t)"},
]
gauge = [
    {name = "front", kind = "force", on = "-y", about = [0.1, 0.2, 0.3]},
    {name = "patch", kind = "pressure", lower = [0.1, 0.2, 0.3], upper = [0.6, 0.6, 0.3]},
    {name = "flux", kind = "flux", lower = [0.3, 0.2, 0.3], upper = [0.3, 0.6, 0.7]},
]
energy_audit = {every = 1}
[effects]
weakly_compressible = {sound_speed = 20.0, dynamic_viscosity = 10.0}
box_walls = {lower = [0.1, 0.2, 0.3], upper = [0.6, 0.6, 1.2]}
""",
    "bodies": """
dtype = "float64"
spacing = 0.1
support_radius = 0.26
end_time = 0.05
fluid = [{shape = "box", lower = [0.0, 0.0, 0.0], cells = [8, 8, 2]}]
solid = [
    {shape = "box", lower = [0.1, 0.1, 0.2], upper = [0.3, 0.4, 0.4], density = 500.0, velocity = [
        0.1, 0.0, -0.2], spin = [0.5, 0.0, 1.0]},
    {shape = "ball", center = [0.5, 0.5, 0.75], radius = 0.16, mass = 9.0},
    {shape = "torus", center = [0.4, 0.4, 1.2], radius = 0.2, tube_radius = 0.08, axis = [0.0, 1.0, 1.0]},
    {shape = "cells", cells = [[1, 6, 7], [2, 6, 7], [1, 7, 7], [2, 7, 7]]},
]
gauge = [
    {name = "first", kind = "force", on = "solid 1"},
    {name = "second", kind = "force", on = "solid 2", about = [0.0, 0.0, 0.0]},
    {name = "floor", kind = "force", on = "-z"},
]
[effects]
weakly_compressible = {sound_speed = 30.0, dynamic_viscosity = 30.0}
gravity = {}
box_walls = {lower = [0.0, 0.0, 0.0], upper = [0.8, 0.8, 2.0], open_faces = ["+z"]}
shape_matching = {}
two_way_coupling = {}
heat_conduction = {melting_point = 10.0, latent_heat = 3000.0, temperature = [5.0, 8.0, 9.0, 9.9, 60.0]}
melting = {}
""",
    "a mesh": f"""
dtype = "float64"
spacing = 0.1
support_radius = 0.26
end_time = 0.05
fluid = [{{shape = "box", lower = [0.7, 0.0, 0.0], cells = [4, 5, 5], velocity = [-0.5, 0.0, 0.0]}}]
gauge = [{{name = "cube", kind = "force", on = "mesh_boundary", about = [0.3, 0.3, 0.3]}}]
[effects]
weakly_compressible = {{sound_speed = 20.0, dynamic_viscosity = 10.0}}
gravity = {{}}
mesh_boundary = {{file = "{CUBE}", center = [0.35, 0.25, 0.3], size = 0.6, rotation = [0.0, 10.0, 20.0]}}
""",
    "bodies of meshes": f"""
dtype = "float64"
spacing = 0.1
support_radius = 0.26
end_time = 0.05
solid = [
    {{shape = "mesh", file = "{CUBE}", center = [20.2, 1.2, -1.0], size = 0.45, rotation = [30.0, 0.0, 20.0]}},
    {{shape = "mesh", file = "{PEBBLE}", center = [20.9, 1.3, -1.0], size = 0.5}},
]
[effects]
shape_matching = {{}}
gravity = {{acceleration = [0.0, 0.0, -1.0]}}
""",
    "a period": """
dim = 2
dtype = "float64"
spacing = 0.1
support_radius = 0.26
end_time = 0.05
period = [1.2, 0.0, 0.0]
period_lower = [-0.3, 0.0, 0.0]
fluid = [{shape = "box", lower = [-0.3, 0.0, 0.0], cells = [12, 5, 1], velocity = [0.5, 0.0, 0.0]}]
gauge = [{name = "flux", kind = "flux", lower = [0.2, 0.0, 0.0], upper = [0.2, 0.5, 0.0]}]
[effects]
weakly_compressible = {sound_speed = 20.0, dynamic_viscosity = 10.0}
gravity = {acceleration = [1.0, 0.0, 0.0]}
box_walls = {lower = [-0.3, 0.0, 0.0], upper = [0.9, 0.5, 0.0], open_faces = ["-x", "+x"]}
""",
    "a cloud far away": """
dim = 2
spacing = 0.1
support_radius = 0.26
end_time = 0.05
fluid = [{shape = "cloud", position = [[5000.0, 3.0], [5000.1, 3.0], [5000.0, 3.1], [5000.1, 3.1], [5000.2, 3.05]
    ], velocity = [[0.1, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.0]
    ], mass = [10.0, 10.0, 9.0, 11.0, 12.0]}]
[effects]
weakly_compressible = {sound_speed = 20.0, dynamic_viscosity = 5.0, density = "summation"}
""",
    "material points": """
dim = 2
dtype = "float64"
spacing = 0.1
support_radius = 0.3
end_time = 0.05
fluid = [{shape = "ball", center = [0.55, 0.5, 0.0], radius = 0.4, velocity = [0.0, -1.0, 0.0]}]
[effects]
mpm_liquid = {bulk_modulus = 1e5}
gravity = {}
mpm_walls = {lower = [0.0, 0.0, 0.0], upper = [1.2, 1.2, 0.0]}
surface_energy = {surface_tension = 1.0}
""",
    "an implicit pressure": """
dim = 2
dtype = "float64"
spacing = 0.1
support_radius = 0.26
end_time = 0.05
step = 0.001
fluid = [{shape = "box", cells = [6, 8, 1]}]
[effects]
weakly_compressible = {sound_speed = 30.0, dynamic_viscosity = 20.0, density = "summation"}
iisph = {}
gravity = {}
box_walls = {lower = [0.0, 0.0, 0.0], upper = [0.6, 2.0, 0.0]}
""",
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
    audit = {} if run.auditor is None else {"audit": run.auditor.report()}
    balances = {"balances": [plain(vars(b)) for b in vars(run.balances).values() if hasattr(b, "__dict__")]}
    totals = {"totals": (start, conserved_totals(run)), "steps": (lengths, run.limiters, run.last)}
    return fields | gauges | audit | balances | totals | {"density": run.counting.report()}


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
