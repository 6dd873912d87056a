"""`refsim plan`: what a run of a scene would allocate and launch, without running it."""

import argparse
import math
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from typing import Any

import msgspec
import numpy as np

from refsim.commands import CommandResult, command, in_bytes, in_time, planned, table, takes
from refsim.core import capabilities
from refsim.core.capabilities import HoldsOtherMemory, effects_with
from refsim.core.effect import BASE, Effect, Extremes
from refsim.core.errors import InputError
from refsim.core.operation import BACKENDS, PROCEDURES, REGISTRY
from refsim.core.tables import vector
from refsim.engine.limits import stable_steps, step_limits
from refsim.scene.files import load_scene
from refsim.scene.plan import Plan
from refsim.sph import acceleration_of
from refsim.study.cost import STEPS, Cost, bytes_of, measured, neighbour_list


def describe_plan(plan: Plan, backend: str) -> dict[str, Any]:
    """Everything that `refsim plan` shows, as plain values: bytes, seconds, metres."""
    grid, scene = plan.grid, plan.scene
    per_particle, whole = plan.field_bytes(), plan.bytes_of_fields()
    fields: dict[str, dict[str, Any]] = {
        name: {key: getattr(f, key) for key in ("unit", "meaning", "components", "state")}
        | {"dtype": str(f.numpy_dtype(grid.dtype)), "brought_by": _owner(plan, name)}
        | {"bytes_per_particle": per_particle.get(name, 0), "bytes": whole[name]}
        for name, f in plan.fields.items()
    }
    passes = [
        {"operation": p.operation, "effect": effect.name, "kernel": kernel_name(p.operation, backend, p.algorithm)}
        | {key: list(getattr(p, key)) for key in ("reads", "writes", "updates")}
        | {"when": "on demand" if p.on_demand else "at the start" if p.stage == "start" else "every step"}
        for effect, p in plan.all_passes()
        if effect is not None
    ]
    loop_operations = ["sph.extremes", *(p.operation for effect, p in plan.motion if effect is None)]
    runner = [{"operation": name, "kernel": kernel_name(name, backend)} for name in loop_operations]
    steps = _first_step(plan)
    others = (effect.other_memory() for effect in effects_with(plan.effects, HoldsOtherMemory))
    return {
        "scene": scene.name,
        "backend": backend,
        "dtype": grid.dtype,
        "dim": grid.dim,
        "particles": grid.count,
        "wall_particles": 0 if plan.walls is None else len(plan.walls.position),
        **{key: getattr(grid, key) for key in ("spacing", "support_radius")},
        **{key: list(getattr(grid, key)) for key in ("period", "origin")},
        "fields": fields,
        "passes": passes,
        "runner": [one | {"when": "every step"} for one in runner],
        "effects": {name: _brings(plan, name, steps) for name in plan.effects},
        "neighbour_list": neighbour_list(plan, backend),
        "bytes": bytes_of(plan, backend),
        "not_counted": list(filter(None, others)),
        "step": steps,
        "end_time": scene.end_time,
        **{f"{kind}s": _listed(getattr(scene, kind)) for kind in ("gauge", "motion")},
        "margins": [
            {"of": of, **dict(zip(m._fields[:-1], m)), "factor": m.factor if math.isfinite(m.factor) else None}
            for of, m in _margins(plan, steps)
        ],
        "defaults": list(_defaults(plan)),
        "notes": list(plan.notes),
    }


def _listed(parts: Iterable[Any]) -> list[dict[str, Any]]:
    """Gauges or motions as their keys in a scene file, without those that are left out."""
    return [{key: v for key, v in msgspec.to_builtins(part).items() if v not in (None, "")} for part in parts]


def _defaults(plan: Plan) -> Iterator[str]:
    """What the scene leaves open and has otherwise than the papers, and what an artificial viscosity is worth."""
    for name, effect in plan.effects.items():
        if isinstance(effect, capabilities.Joins) and name not in {e.name for e in plan.scene.effects}:
            yield f"{name} joins the liquid, which names no density; the papers have none"
        if isinstance(effect, capabilities.FollowsStart):
            yield from effect.start_defaults(plan.scene.effects)
    for effect in plan.scene.effects:
        for name, printed in effect.in_papers.items() if isinstance(effect, capabilities.FollowsScene) else ():
            value = getattr(plan.effects.get(effect.name), name, printed)  # a box with all faces open is left out
            if getattr(effect, name) is None and value != printed:
                yield f"{name} of {effect.name} is {value!r}; the papers have {printed!r}"
        if alpha := getattr(effect, "artificial_viscosity", 0):
            whole = plan.effects[effect.name].dynamic_viscosity  # type: ignore[attr-defined]
            added = whole - effect.dynamic_viscosity
            yield f"artificial_viscosity = {alpha:g} adds {added:.3g} Pa s: the dynamic viscosity is {whole:.3g} Pa s"


def kernel_name(operation: str, backend: str, algorithm: str = "") -> str:
    """module.function that the backend launches for an operation."""
    if operation in PROCEDURES:
        procedure = PROCEDURES[operation]
        return f"{procedure.owner}.{procedure.method}: {len(procedure.operations)} operations"
    registered = REGISTRY[operation]
    return ".".join(registered.place(registered.chosen(backend, algorithm)))


def _owner(plan: Plan, name: str) -> list[str]:
    if any(f.name == name for f in BASE):
        return ["every scene"]
    return [e.name for e in plan.effects.values() if any(f.name == name for f in e.fields(plan.effects))]


def _brings(plan: Plan, name: str, steps: dict[str, Any]) -> dict[str, Any]:
    effect = plan.effects[name]
    base = {f.name for f in BASE}
    extremes = Extremes(steps["speed"], steps["acceleration"])
    limits = {k: limit.at(extremes) for k, limit in effect.step_limits(plan.grid, plan.effects).items()}
    walls = effect.walls(plan.grid, plan.effects) if isinstance(effect, capabilities.BringsWalls) else None
    return {
        "fields": [f.name for f in effect.fields(plan.effects) if f.name not in base],
        "passes": [p.operation for p in effect.passes(plan.effects) if p.operation in plan.launches(True)],
        "list_radius": effect.list_radius(plan.grid),
        "wall_particles": 0 if walls is None else len(walls.position),
        "step_limits": limits,
        "literal": _literal(effect),
        **_tension(plan, effect),
    }


def _tension(plan: Plan, effect: Effect) -> dict[str, dict[str, Any]]:
    """Numbers of a surface tension; R is the radius of a ball (disc) as large as the smallest body of liquid."""
    if not isinstance(effect, capabilities.HasTension):
        return {}
    sigma, source = effect.acting_tension(plan.grid, plan.effects)
    if sigma == 0:
        return {}
    liquid: Any = plan.effects[effect.needed[0]]
    density, radius, pull = liquid.rest_density, plan.grid.drop_radius, math.hypot(*acceleration_of(plan.effects))
    told = {"sigma [N/m]": sigma, "of": source, "R [m]": radius}
    if radius:
        told["jump [Pa]"] = (plan.grid.dim - 1) * sigma / radius
        told["Ohnesorge"] = liquid.dynamic_viscosity / math.sqrt(density * sigma * radius)
    if pull:
        told |= {
            "capillary length [m]": math.sqrt(sigma / (density * pull)),
            "Bond": density * pull * radius**2 / sigma,
        }
    return {"tension": told}


def _literal(effect: Effect) -> dict[str, Any]:
    """What `literal` of an effect takes from its source: errata as printed, and by "paper" parameters."""
    if not (isinstance(effect, capabilities.HasErrata) and effect.literal):
        return {}
    printed = [erratum for erratum in effect.errata if erratum in effect.printed()]
    by_paper = dict(effect.paper) if "paper" in effect.literal else {}
    return {"source": effect.source, "printed": printed, "parameters": by_paper}


def _first_step(plan: Plan) -> dict[str, Any]:
    """Step limits at the start, from the initial speeds and gravity; other forces are not computed yet."""
    speed = float(np.sqrt((plan.state.velocity**2).sum(1).max(initial=0.0)))
    force = math.hypot(*acceleration_of(plan.effects))
    limits = stable_steps(step_limits(plan), Extremes(speed, force))
    limiter = min(limits, key=lambda name: limits[name])
    length = limits[limiter] * plan.scene.step_factor
    if plan.scene.step > 0:
        length, limiter = plan.scene.step, "fixed"
    step = {"length": length, "limiter": limiter, "limits": limits, "speed": speed, "acceleration": force}
    return step | {"steps_to_end_at_least": math.ceil(plan.scene.end_time / length)}


def _margins(plan: Plan, steps: dict[str, Any]) -> Iterator[tuple[str, capabilities.Margin]]:
    """Settings beside the limits that were measured for them, by effect."""
    for name, effect in plan.effects.items():
        if isinstance(effect, capabilities.KnowsLimits):
            yield from ((name, margin) for margin in effect.margins(plan.grid, plan.effects))
    ratio = float(plan.state.mass.max() / plan.state.mass.min())
    for name, effect in plan.effects.items():
        if ratio > 1 + 1e-6 and isinstance(effect, capabilities.LimitsMassRatio):
            largest = effect.largest_mass_ratio(plan.effects)
            if math.isfinite(largest):
                yield name, capabilities.Margin("heaviest particle over the lightest", ratio, largest)
    if plan.scene.step > 0:
        yield "every scene", capabilities.Margin("step [s]", plan.scene.step, min(steps["limits"].values()))


@command("plan", "show what a scene would allocate and launch")
@takes("scene", help="scene file (TOML)")
@takes("--backend", default="cpu", help=f"whose kernels are named: {', '.join(BACKENDS)} (cpu)")
@takes("--time", action="store_true", help="time ten steps of the scene on one thread, and say what a run takes")
def execute(options: argparse.Namespace) -> CommandResult:
    """Plan a scene file."""
    if options.backend not in BACKENDS:
        raise InputError(f"there is no backend {options.backend!r}; choose one of {', '.join(BACKENDS)}.")
    plan = planned(load_scene(options.scene), options.scene, options.backend)
    summary = describe_plan(plan, options.backend)
    if not options.time:
        return CommandResult(summary, _text(summary))
    cost = measured(plan, options.backend)
    summary["time"] = {**asdict(cost), "processor": cost.processor, "wall": cost.wall}
    return CommandResult(summary, f"{_text(summary)}\n\n{_time(cost)}")


def _time(cost: Cost) -> str:
    """What a run would take."""
    rows = (
        ("start", f"{in_time(cost.start)} by the clock, kernels compiled or loaded"),
        ("steps", f"{in_time(cost.processor)} of the processor: {cost.steps:,} of {cost.length:.3g} s"),
        ("wall", f"{in_time(cost.wall)}, {cost.ratio:.3g} times as much, as in the steps that were timed"),
        ("memory", in_bytes(cost.bytes)),
    )
    without = "later list builds and frames not counted"
    return f"Time here, backend {cost.backend}, one CPU thread, from {STEPS} steps; {without}\n{table(rows)}"


def _text(summary: dict[str, Any]) -> str:
    walls = f" and {summary['wall_particles']:,} of walls" if summary["wall_particles"] else ""
    around = "".join(f", periodic along {axis} over {m:g} m" for axis, m in zip("xyz", summary["period"]) if m)
    if any(summary["origin"]):
        around += f", positions relative to {vector(summary['origin'])} m"
    fields = [
        (name, f["bytes_per_particle"], in_bytes(f["bytes"]), f["unit"], ", ".join(f["brought_by"]), f["meaning"])
        for name, f in summary["fields"].items()
    ]
    passes = [
        (number, p["operation"], p.get("effect", "(runner)"), p["when"], p["kernel"])
        for number, p in enumerate(summary["passes"] + summary["runner"], 1)
    ]
    effects = []
    for name, e in summary["effects"].items():
        reach = f"{e['list_radius']:.4g} m" if e["list_radius"] else "-"
        count = f"{e['wall_particles']:,}" if e["wall_particles"] else "-"
        effects.append((name, reach, count, ", ".join(e["step_limits"]) or "-"))
    lines = [
        f"{summary['scene']}: {summary['particles']:,} particles{walls} in {summary['dim']}D, {summary['dtype']},"
        f" backend {summary['backend']}",
        f"spacing {summary['spacing']:g} m, support radius {summary['support_radius']:.4g} m{around}",
        f"\nFields\n{table(fields, ('field', 'B/particle', 'bytes', 'unit', 'brought by', 'meaning'), right=(1, 2))}",
        f"\nPasses, in order\n{table(passes, ('', 'operation', 'effect', 'when', 'kernel'), right=(0,))}",
        f"\nEffects\n{table(effects, ('effect', 'neighbours to', 'wall particles', 'step limits'))}",
    ]
    tensions = []
    for name, e in summary["effects"].items():
        if e["literal"]:
            lines.append(f"As in {e['literal']['source']}: {name} with {_taken(e['literal'])}")
        if "tension" in e:
            tensions.append({"effect": name, **{k: v if k == "of" else f"{v:.3g}" for k, v in e["tension"].items()}})
    tables = {"Surface tension, R of the smallest body of liquid": tensions}
    tables |= {"Gauges": summary["gauges"], "Motions": summary["motions"]}
    for title, parts in tables.items():
        if parts:
            keys = tuple(dict.fromkeys(key for part in parts for key in part))
            rows = [tuple(_short(part.get(key, "-")) for key in keys) for part in parts]
            lines.append(f"\n{title}\n{table(rows, keys)}")
    listed = summary["neighbour_list"]
    lines.append(
        f"\nNeighbour list: radius {listed['radius']:.4g} m, reaching to {listed['reach']:.4g} m,"
        f" {listed['neighbours_on_a_lattice']} neighbours on the lattice, about {in_bytes(listed['bytes'])};"
        f" rebuilt when a particle has moved {listed['built_anew_after']:.3g} m"
        if listed
        else "\nNeighbour list: none"
    )
    b = summary["bytes"]
    grid = f", background grid {in_bytes(b['background_grid'])}" if "background_grid" in b else ""
    lines.append(
        f"Memory: {in_bytes(b['total'])}, {b['total'] / summary['particles']:.0f} B a particle (fields"
        f" {in_bytes(b['fields'])}, list {in_bytes(b['neighbour_list'])}, positions at its last build"
        f" {in_bytes(b['positions_at_list_build'])}, walls {in_bytes(b['walls'])}{grid})"
    )
    if summary["not_counted"]:
        lines.append(f"Not counted, since it follows the run: {'; '.join(summary['not_counted'])}")
    step = summary["step"]
    limits = ", ".join(f"{name} {value:.3g} s" for name, value in sorted(step["limits"].items(), key=lambda i: i[1]))
    lines += [
        f"First step: {step['length']:.3g} s, set by {step['limiter']}"
        f" (limits, before any force but gravity: {limits})",
        f"To {summary['end_time']:g} s: at least {step['steps_to_end_at_least']:,} steps",
    ]
    margins = []
    for m in summary["margins"]:
        limit = f"{'at least' if m['least'] else 'at most'} {m['limit']:.3g}"
        margins.append((m["setting"], m["of"], f"{m['value']:.3g}", limit, _margin(m["factor"])))
    if margins:
        head = ("setting", "of", "here", "measured to hold", "margin")
        lines += ["", "Measured limits (docs/stability.md)", table(margins, head, right=(2, 3, 4)), ""]
    lines += [f"Default: {default}" for default in summary["defaults"]]
    return "\n".join([*lines, *(f"Note: {note}" for note in summary["notes"])])


def _short(value: Any) -> str:
    """A value of a gauge or motion; of many numbers, how many they are."""
    if isinstance(value, list | tuple):
        return ", ".join(f"{v:g}" for v in value) if len(value) <= 3 else f"{len(value)} numbers"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _taken(literal: dict[str, Any]) -> str:
    """Errata and parameters that `literal` takes, in words."""
    values = [f"{name} = {value!r}" for name, value in literal["parameters"].items()]
    return ", ".join([*literal["printed"], *values]) or "nothing else"


def _margin(factor: float | None) -> str:
    """How far a setting is from its limit, as a factor."""
    if factor is None:
        return "any"
    if factor >= 1:
        return f"{factor:.2g} times"
    return f"beyond, {1 / factor:.2g} times" if factor > 0 else "beyond"
