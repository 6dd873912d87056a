"""Scenes drawn by seeds: what their plans hold and say, the memory that they take, and what some steps make of them."""

import random

import numpy as np
import pytest

from refsim import InputError, RunStopped, make_plan
from refsim.scene.files import scene_from_dict
from refsim.study.cost import bytes_of
from tests.across.test_recorded_scenes import EXAMPLES, of_others, of_plan, of_run
from tests.recorded import numbers

GROUPS, EACH = 8, 8
D = 0.1


class Draw(random.Random):
    """Numbers of a scene, in few digits."""

    def some(self, *others, share=0.5):
        return self.choice(others) if self.random() < share else None

    def vector(self, size, dim=3):
        return [round(self.uniform(-size, size), 3) if k < dim else 0.0 for k in range(3)]

    def between(self, lower, upper):
        return [round(self.uniform(a, b), 4) for a, b in zip(lower, upper)]


def parts(draw, dim, low, cells):
    """Liquid in the lower part of a box, and above it a ball, a box or a cloud."""
    box = {"shape": "box", "lower": low, "cells": cells, "velocity": draw.vector(0.3, dim)}
    if draw.random() < 0.2:
        box["size"] = [round(n * D * draw.choice((0.98, 1.0, 1.01)), 4) for n in cells[:dim]] + [D] * (3 - dim)
    top = [low[0] + 0.25, low[1] + cells[1] * D + 0.3, low[2] + 0.25 * (dim == 3)]
    place = [[round(top[k] + D * (i, j, 0)[k], 3) for k in range(3)] for i in range(3) for j in range(2)]
    other = draw.some(
        {"shape": "ball", "center": top, "radius": draw.choice((0.16, 0.21)), "velocity": draw.vector(0.2, dim)},
        {"shape": "box", "lower": top, "cells": [2, 3, 1 if dim == 2 else 2]},
        {"shape": "cloud", "position": place, "mass": [draw.choice((9.0, 10.0, 11.0)) * (0.1 if dim == 3 else 1)] * 6},
        share=0.4,
    )
    return [box, *([other] if other else [])]


def solids(draw, low, cells):
    """Bodies above the liquid, one upon the other."""
    x, _, z = (low[k] + 0.05 for k in range(3))
    floor, made = low[1] + cells[1] * D + 0.05, []
    for kind in draw.sample(["box", "ball", "torus", "mesh", "cells"], draw.randint(1, 3)):
        more = draw.some({"density": draw.choice((400.0, 700.0))}, {"mass": 4.0}) or {}
        more |= draw.some({"velocity": draw.vector(0.2), "spin": draw.vector(2.0)}) or {}
        middle = [x + 0.2, floor + 0.2, z + 0.2]
        made.append({"shape": kind} | more | {
            "box": {"lower": [x, floor, z], "upper": [x + 0.3, floor + 0.2, z + 0.3]},
            "ball": {"center": middle, "radius": 0.16}, "cells": {"cells": [[1, 20, 1], [2, 20, 1], [2, 21, 1]]},
            "torus": {"center": middle, "radius": 0.15, "tube_radius": 0.06, "axis": draw.vector(1.0)},
            "mesh": {"file": str(EXAMPLES / "cube.obj"), "center": middle, "size": 0.3, "rotation": draw.vector(40)},
        }[kind])  # fmt: skip
        floor += 0.5
    return made


def gauges(draw, dim, low, high, solid):
    """Up to four of any kind; an axis along which a patch is flat is drawn."""
    made = []
    for k in range(draw.randint(0, 4)):
        axis, (lower, upper) = draw.randrange(dim), (list(low), [(a + b) / 2 for a, b in zip(low, high)])
        kind, face = draw.choice(("force", "pressure", "at", "level", "flux")), draw.choice("+-") + "xyz"[axis]
        if kind == "flux":
            lower[axis] = upper[axis] = round(low[axis] + draw.uniform(0.05, 0.35), 3)
        elif kind == "pressure":
            upper[axis] = lower[axis] = (low if face[0] == "-" else high)[axis]
        elif kind == "level":
            for c in {*range(dim)} - {axis}:
                lower[c] = upper[c] = round(low[c] + draw.uniform(0.05, 0.35), 3)
        body = draw.choice([face, face, "box_walls", f"solid {draw.randint(1, 2)}" if solid else face])
        made.append({"name": f"g{k}", "kind": "pressure" if kind == "at" else kind} | {
            "force": {"on": body} | (draw.some({"about": draw.vector(0.5, dim)}) or {}),
            "at": {"at": draw.between(low, upper)},
        }.get(kind, {"lower": lower, "upper": upper}))  # fmt: skip
        made[-1] |= draw.some({"every": 0.004}, {"every": 0.006, "instants": 3}, share=0.4) or {}
    return made


def motions(draw, dim, moving):
    """Of gravity, of faces and of the whole tank, by each law."""
    made = []
    for of in draw.sample(["gravity", "gravity", "turn", "moving_faces"], draw.choice((0, 0, 1, 2))):
        if of == "moving_faces" and not moving:
            continue
        way = draw.vector(1.0, dim) if of == "gravity" else [0.0, 1.0, 0.0]
        if of == "turn":
            way = [0.0, 0.0, 1.0] if dim == 2 else draw.vector(1.0)
        made.append({"of": of, "direction": way} | draw.choice([
            {"kind": "sway", "amplitude": 0.02, "period": 0.7} | (draw.some({"ramp": 0.4}) or {}),
            {"kind": "table", "times": [0.0, 0.03, 0.06], "values": [0.0, 0.002, draw.choice((0.0, 0.003))]},
            {"kind": "formula", "formula": draw.choice(("0.02*sin(7*t)", "t**2/(1 + t)", "0.01*(1 - cos(5*t))"))},
        ]) | ({"pivot": draw.vector(0.3, dim)} if of == "turn" else {}))  # fmt: skip
    return made


def effects(draw, dim, low, high, period, solid, table):
    """A liquid with its walls, and some of what it may have beside them."""
    continuity = draw.random() < 0.4
    density = {"density": "continuity" if continuity else "summation"}
    more = draw.some(
        {"state": "tait"}, {"artificial_viscosity": 0.05}, {"gradient": "corrected"}, {"kernels": "mueller"}
    )
    liquid = {"sound_speed": draw.choice((15.0, 30.0)), "dynamic_viscosity": draw.choice((0.0, 5.0)), **density}
    liquid |= {} if solid and "gradient" in (more or {}) else more or {}
    made = {"weakly_compressible": liquid}
    if draw.random() < 0.8 or table["motion"]:
        made["gravity"] = {"acceleration": draw.vector(9.0, dim)} if draw.random() < 0.7 else {}
    opened = [f"{s}{'xyz'[k]}" for k in range(dim) if period[k] for s in "-+"]
    opened += draw.some(["+y"]) or []
    rough = [{"viscosity": 3.0}, *([{"no_slip": True}] if liquid["dynamic_viscosity"] else [])]
    walls = {"lower": low, "upper": high, "open_faces": opened} | (draw.some(*rough) or {})
    if liquid.get("gradient") == "corrected":
        walls["model"] = "extrapolated"
    if any(m["of"] == "moving_faces" for m in table["motion"]) and "no_slip" not in walls:
        walls |= {"moving_faces": ["+x"], "velocity": [0.0, 0.1, 0.0], "viscosity": 2.0}
    if table["gauge"] or table["motion"] or draw.random() < 0.85:
        made["box_walls"] = walls
    if solid:
        made |= {"shape_matching": {}} | (draw.some({"two_way_coupling": {}}, share=0.8) or {})
    parts = [5.0] * len(solid) + [20.0, 30.0][: len(table["fluid"])]
    heat = {"melting_point": 10.0, "latent_heat": 3e3, "temperature": parts}
    made |= draw.some({"heat_conduction": {"temperature": 40.0}}, {"heat_conduction": heat}, share=0.3) or {}
    made |= {} if any(period) or solid else draw.some(
        {"becker_teschner_2007": {"surface_tension": 0.07}}, {"akinci_2013": {"surface_tension": 0.07}},
        {"iisph": {}}, {"particle_shifting": {}}, {"surface_detection": {}},
        {"csf_wang_2019": {"surface_tension": 0.07}}, {"jiang_zhu_2023": {"surface_tension": 0.07}}, share=0.5,
    ) or {}  # fmt: skip
    return made


def drawn(seed):
    """The table of a scene: most can run, one in four has a number that is changed."""
    draw = Draw(seed)
    dim = draw.choice((2, 3))
    low = draw.choice(([0.0, 0.0, 0.0], [0.2, -0.3, 0.0 if dim == 2 else 0.1]))
    cells = [draw.choice((6, 8)), draw.randint(4, 7), 1] if dim == 2 else [draw.randint(4, 5), 4, draw.randint(4, 5)]
    high = [round(a + n * D, 3) if k < dim else 0.0 for k, (a, n) in enumerate(zip(low, cells))]
    high[1] = round(high[1] + draw.choice((0.0, 1.7, 1.7, 1.7)), 3)
    period = [0.8 if draw.random() < 0.6 and cells[0] == 8 else 0.0, 0.0, 0.0]
    table = {"spacing": D, "support_radius": draw.choice((0.2, 0.26, 0.3)), "dim": dim, "end_time": 0.05}
    fluid = parts(draw, dim, low, cells)[: 1 if high[1] < low[1] + 1.0 else 2]
    table |= {"dtype": draw.choice(("float64", "float64", "float32")), "fluid": fluid}
    table |= {"period": period, "period_lower": low} if any(period) else {}
    solid = solids(draw, low, cells) if dim == 3 and high[1] > low[1] + 1.0 and draw.random() < 0.6 else []
    table |= {"solid": solid} if solid else {}
    table["motion"] = motions(draw, dim, moving=not any(period))
    table["gauge"] = gauges(draw, dim, low, high, solid)
    table |= draw.some({"step": 0.001}, {"step_factor": 0.5}, {"skin": 0.1}, share=0.3) or {}
    table["effects"] = effects(draw, dim, low, high, period, solid, table)
    if "box_walls" in table["effects"] and draw.random() < 0.15:
        table["effects"]["box_walls"]["upper"] = [round(v - 0.07, 3) for v in high]
    return table


def told(table, run):
    """Sums of the numbers of each thing that a plan holds and a run makes, or those of the sentence that refuses it."""
    try:
        plan = make_plan(scene_from_dict(table, "drawn"))
    except InputError as error:
        return str(error)
    found = of_plan(plan) | {f"bytes on {name}": bytes_of(plan, name) for name in ("numpy", "cpu", "cuda")}
    found |= {"shared": plan.shared, **{f"groups of {name}": given for name, given in plan.parameters.items()}}
    if run and plan.grid.count < 150 and plan.grid.dtype == "float64":
        try:
            found |= of_run(plan) | of_others(plan.scene)
        except RunStopped as error:
            found["stopped"] = str(error)
    return [[v for v in numbers(value) if not isinstance(v, str)] for value in found.values()]


@pytest.mark.parametrize("group", range(GROUPS))
def test_drawn_scenes_plan_and_run_as_ever(group, recorded):
    found, taken = {}, 0
    for k in range(EACH):
        found[f"{k}"] = said = told(drawn(f"{group}.{k}"), k < 3)
        if isinstance(said, list):
            found[f"{k}"] = [(len(values), sums(values)) for values in said]
            taken += 1
    recorded(found)
    assert taken >= EACH // 4


def sums(values):
    """The sum, that of sizes, and one in which the order counts."""
    values = np.clip(np.array(values, float), -1e9, 1e9)
    return values.sum(), np.abs(values).sum(), np.cos(np.arange(len(values))) @ values
