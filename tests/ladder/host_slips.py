"""Injects one slip after another into host code (step limits, initial values, ledgers, energies) and judges each.

Run as `NUMBA_DISABLE_JIT=1 python tests/ladder/host_slips.py [GROUP...]`: prints one JSON object, see `judged`. With
`--publish` every group is judged, the numbers go to validation/host_slips.json and into docs/nightly.md, and the exit
code is 4 if a slip survived that is not among HARMLESS.

A slip changes one node of a function's syntax tree: a sign, a factor, a condition that is negated, operands that change
places, an index. The function gets the code of its altered source, and the group's tests are called until one fails.
"""

from __future__ import annotations
import __future__

import argparse
import ast
import datetime
import functools
import gc
import importlib
import importlib.util
import inspect
import json
import pathlib
import signal
import sys
import textwrap
import warnings

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

VALUES = ROOT / "tests" / "across" / "test_host_values.py"
RECORD = ROOT / "validation" / "host_slips.json"
PAGE = ROOT / "docs" / "nightly.md"
BEGIN, END = "<!-- host slips -->\n", "<!-- end of host slips -->"
SECONDS = 20  # after which a slip has made a test endless, which is noticed
EXIT_FAILED = 4
WORDS, LONGEST = 24, 100  # letters of the expression by which a slip is named
KINDS = ("sign", "factor", "condition", "operands", "index")

# group -> functions, each "module:qualified name"; the group's tests are those of test_host_values.py with its name
GROUPS = {
    "reports": ("refsim.engine.stock:stock",),
    "energy": (
        "refsim.core.energy:amount",
        "refsim.core.energy:compression_energy",
        "refsim.core.energy:compression_amount",
        "refsim.core.energy:_zero_pressure",
        "refsim.core.energy:pair_potential",
        "refsim.engine.audit:StateOfRun.pair_sum",
        "refsim.engine.audit:Auditor.energies",
        "refsim.engine.audit:Auditor._unsure",
        "refsim.surface_tension.cohesion:PairCohesion.pair_account",
        "refsim.surface_tension.cohesion:PairCohesion.pair_mass",
        "refsim.sph:WeaklyCompressible.energy",
        "refsim.sph:Gravity.energy",
        "refsim.boundary.two_way_coupling:TwoWayCoupling.energy",
        "refsim.mpm:MpmLiquid.energy",
    ),
    "steps": (
        "refsim.core.effect:StepLimit.constant",
        "refsim.core.effect:StepLimit.crossing",
        "refsim.core.effect:StepLimit.falling",
        "refsim.core.effect:StepLimit.exchanging",
        "refsim.core.effect:StepLimit.at",
        "refsim.engine.stepping:step_limits",
        "refsim.engine.stepping:stable_steps",
        "refsim.sph:WeaklyCompressible.step_limits",
        "refsim.sph.iisph:ImplicitPressure.step_limits",
        "refsim.boundary.two_way_coupling:TwoWayCoupling.step_limits",
        "refsim.boundary.one_way_coupling:MeshBoundary.step_limits",
        "refsim.surface_tension.cohesion:PairCohesion.step_limits",
        "refsim.surface_tension.cohesion:capillary_limit",
        "refsim.surface_tension.normal_difference_2014:NormalDifference2014.step_limits",
        "refsim.heat:HeatConduction.step_limits",
        "refsim.heat:HeatConduction.greatest_diffusivity",
        "refsim.mpm:MpmLiquid.step_limits",
        "refsim.mpm:MpmLiquid._viscous_factor",
        "refsim.mpm:MpmLiquid.sound_speed",
        "refsim.surface_energy.effect:SurfaceEnergy.step_limits",
    ),
    "start": (
        "refsim.scene.particles:_solid_particles",
        "refsim.scene.particles:lattice_mass",
        "refsim.scene.shapes:Ball.positions",
        "refsim.scene.solids:SolidBall.inside",
        "refsim.scene.solids:SolidBall.extent",
        "refsim.scene.solids:SolidTorus.inside",
        "refsim.scene.solids:SolidTorus.extent",
        "refsim.sph:lattice_number_density",
        "refsim.sph:WeaklyCompressible.rest_number_density",
        "refsim.sph:WeaklyCompressible.particle_mass",
        "refsim.sph:WeaklyCompressible.particle_volume",
        "refsim.mpm:MpmLiquid.particle_mass",
        "refsim.mpm:MpmLiquid.initial",
        "refsim.heat:HeatConduction.particle_mass",
        "refsim.heat:HeatConduction.initial",
        "refsim.heat:HeatConduction.of_particles",
        "refsim.heat:HeatConduction._reservoir",
        "refsim.heat:HeatConduction._range",
        "refsim.heat:enthalpy_of",
        "refsim.heat:temperature_at",
        "refsim.boundary.two_way_coupling:TwoWayCoupling.initial",
        "refsim.shape_matching:ShapeMatching.initial",
    ),
    "ledgers": (
        "refsim.melting:Melting.ledger",
        "refsim.heat:HeatConduction.ledger",
        "refsim.heat:HeatConduction._stored",
        "refsim.heat:HeatConduction.balance",
        "refsim.boundary.one_way_coupling:MeshBoundary.ledger",
    ),
    "groups": (
        "refsim.sph:WeaklyCompressible.shares",
        "refsim.sph:WeaklyCompressible.prepare",
        "refsim.sph:central_coefficient",
        "refsim.sph:WeaklyCompressible.greatest_speed",
        "refsim.boundary.two_way_coupling:TwoWayCoupling.prepare",
        "refsim.boundary.one_way_coupling:MeshBoundary.prepare",
        "refsim.melting:Melting.prepare",
        "refsim.mpm:MpmLiquid.background",
        "refsim.mpm:MpmLiquid.prepare",
        "refsim.mpm:MpmWalls.domain",
        "refsim.mpm:MpmWalls.nodes",
        "refsim.mpm:MpmWalls.stand",
        "refsim.backends.tuples:determinant",
        "refsim.surface_energy.effect:SurfaceEnergy.contact_pull",
    ),
    "verdicts": (
        "refsim.engine.stepping:check_extremes",
        "refsim.engine.audit:Auditor.look",
        "refsim.mpm:MpmLiquid.verdict",
        "refsim.surface_energy.effect:SurfaceEnergy.verdict",
        "refsim.surface_energy.effect:SurfaceEnergy.remark",
        "refsim.surface_tension.cohesion:compression",
        "refsim.surface_tension.cohesion:PairCohesion.balanced_pressure",
        "refsim.surface_tension.cohesion:PairCohesion.collapse_number",
        "refsim.surface_tension.cohesion:PairCohesion.check_collapse",
        "refsim.sph:WeaklyCompressible.largest_mass_ratio",
    ),
}

# function -> (start of the altered line, why it changes no answer)
HARMLESS: dict[str, list[tuple[str, str]]] = {
    "refsim.core.energy:_zero_pressure": [
        ("60 if internal_pressure > 0 else 0  ->  61", "60 halvings reach the rounding"),
        (
            "60 if internal_pressure > 0 else 0  ->  60 if internal_pressure > 0 else 1",
            "without cohesion the end stays",
        ),
    ],
    "refsim.core.energy:pair_potential": [
        ("0.5 * (edge[1:] + edge[:-1])[:, None] + half * node", "the nodes of Gauss lie symmetrically"),
        ("np.polynomial.legendre.leggauss(8)", "eight nodes reach the rounding, and so do nine"),
    ],
    "refsim.scene.shapes:Ball.positions": [
        ("math.ceil(self.radius / grid.spacing) + 1  ->  math.ceil(self.radius / grid.spacing) + 2", "cut off again"),
        ("np.arange(-reach, reach) + 0.5", "the same places beside one more that is cut off"),
        ("np.stack(np.meshgrid(*axes", "any negative number stands for what is left"),
    ],
    "refsim.mpm:MpmWalls.nodes": [
        (f"self.{side}[axis] / cell_size {sign} 1e-06", "a hundredth of the slack is far below it")
        for side, sign in (("lower", "+"), ("upper", "-"))
    ],
}

NEGATED = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
}  # fmt: skip
SWAPPED = {
    ast.Add: ("sign", ast.Sub),
    ast.Sub: ("sign", ast.Add),
    ast.Mult: ("factor", ast.Div),
    ast.Div: ("factor", ast.Mult),
}
EXTREMES = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum"}


def found(place):
    """The function behind "module:qualified name", without its decorators."""
    module, _, name = place.partition(":")
    owner, _, last = name.rpartition(".")
    within = functools.reduce(getattr, owner.split(".") if owner else [], importlib.import_module(module))
    function = inspect.getattr_static(within, last)
    return inspect.unwrap(getattr(function, "__func__", function))


def parsed(function):
    """The function's tree without decorators, docstring, annotations and defaults, which are no part of its code."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    top = tree.body[0]
    top.decorator_list, top.returns = [], None
    if ast.get_docstring(top) is not None and len(top.body) > 1:
        del top.body[0]
    for node in ast.walk(tree):
        if isinstance(node, ast.arg):
            node.annotation = None
    return tree


def sites(tree):
    """(kind, number, change) for every slip, messages of errors left out: `change` alters node `number` of a copy."""
    nodes, parents = list(ast.walk(tree)), {}
    for node in nodes:
        parents |= dict.fromkeys(ast.iter_child_nodes(node), node)

    def above(node):
        while node in parents:
            yield parents[node], node
            node = parents[node]

    for number, node in enumerate(nodes):
        path = list(above(node))
        if any(isinstance(up, (ast.Raise, ast.JoinedStr, ast.arguments)) for up, _ in path):
            continue
        if isinstance(node, (ast.BinOp, ast.AugAssign)) and type(node.op) in SWAPPED:
            kind, replacement = SWAPPED[type(node.op)]
            yield kind, number, lambda n, r=replacement: setattr(n, "op", r())
            if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div):
                yield "operands", number, exchanged
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            yield "sign", number, lambda n: setattr(n, "op", ast.UAdd())
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            yield "condition", number, lambda n: setattr(n, "operand", ast.UnaryOp(ast.Not(), n.operand))
        elif isinstance(node, ast.Compare):
            for k, op in enumerate(node.ops):
                if type(op) in NEGATED:
                    yield "condition", number, lambda n, k=k: n.ops.__setitem__(k, NEGATED[type(n.ops[k])]())
        elif isinstance(node, ast.BoolOp):
            other = ast.Or if isinstance(node.op, ast.And) else ast.And
            yield "condition", number, lambda n, o=other: setattr(n, "op", o())
        elif isinstance(node, (ast.If, ast.IfExp)) and isinstance(node.test, (ast.Name, ast.Attribute, ast.Call)):
            yield "condition", number, lambda n: setattr(n, "test", ast.UnaryOp(ast.Not(), n.test))
        elif isinstance(node, ast.Call) and name_of(node.func) in EXTREMES:
            yield "operands", number, renamed
        elif isinstance(node, ast.Call) and name_of(node.func) == "cross":
            yield "operands", number, lambda n: n.args.reverse()
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
            if any(isinstance(up, ast.Subscript) and below is up.slice for up, below in path):
                yield "index", number, lambda n: setattr(n, "value", n.value + 1)
            else:
                yield "factor", number, lambda n: setattr(n, "value", n.value * 1.01 if n.value % 1 else n.value + 1)


def exchanged(node):
    node.left, node.right = node.right, node.left


def name_of(node):
    return node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""


def renamed(call):
    setattr(call.func, "id" if isinstance(call.func, ast.Name) else "attr", EXTREMES[name_of(call.func)])


def altered(function, number, change):
    """Code of the function with one node changed, and the expression around it before and after."""
    tree = parsed(function)
    node = list(ast.walk(tree))[number]
    parents = {child: above for above in ast.walk(tree) for child in ast.iter_child_nodes(above)}
    around = node
    while len(ast.unparse(around)) < WORDS and len(ast.unparse(parents[around])) < LONGEST:
        around = parents[around]
    before = ast.unparse(around)
    change(node)
    ast.fix_missing_locations(tree)
    space = dict(function.__globals__)
    flags = __future__.annotations.compiler_flag
    exec(compile(tree, function.__code__.co_filename, "exec", flags, True), space)
    return space[function.__name__].__code__, f"{before}  ->  {ast.unparse(around)}"


def tests_of(group):
    """The tests that judge a group: `test_<group>_...` of test_host_values.py."""
    spec = importlib.util.spec_from_file_location("host_values", VALUES)
    module = sys.modules.get(spec.name)
    if module is None:
        module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    return [value for name, value in vars(module).items() if name.startswith(f"test_{group}_")]


def forget():
    """Empty the caches of functions of refsim: what a slip has computed must not outlast it."""
    for cached in CACHED or CACHED.extend(
        value for value in gc.get_objects() if isinstance(value, functools._lru_cache_wrapper)
        and str(getattr(value, "__module__", "")).startswith("refsim.")
    ) or CACHED:  # fmt: skip
        cached.cache_clear()


CACHED: list = []


def noticed(tests):
    """Whether a test fails, raises or takes too long."""
    forget()
    signal.alarm(SECONDS)
    try:
        for test in tests:
            test()
    except (Exception, pytest.fail.Exception):
        return True
    finally:
        signal.alarm(0)
    return False


def too_long(signum, frame):
    raise TimeoutError


def judged(group):
    """{"planted": {kind: number}, "caught": {kind: number}, "survived": [slips]} of a group."""
    tests = tests_of(group)
    assert tests, f"{group}: no tests"
    functions = [found(place) for place in GROUPS[group]]
    signal.signal(signal.SIGALRM, too_long)
    assert not noticed(tests), f"{group}: a test fails before any slip"
    planted, caught, survived = dict.fromkeys(KINDS, 0), dict.fromkeys(KINDS, 0), []
    for place, function in zip(GROUPS[group], functions):
        right = function.__code__
        last = tests[0]
        for kind, number, change in sites(parsed(function)):
            code, words = altered(function, number, change)
            planted[kind] += 1
            function.__code__ = code
            try:
                order = [last, *(test for test in tests if test is not last)]
                last = next((test for test in order if noticed([test])), None)
                if last is not None:
                    caught[kind] += 1
                else:
                    survived.append(f"{place}: {words}")
                    last = tests[0]
            finally:
                function.__code__ = right
    forget()
    return {"planted": planted, "caught": caught, "survived": survived}


def harmless(slip):
    """Why a slip changes no answer; None if it is not known to be harmless."""
    place, _, line = slip.partition(": ")
    return next((why for start, why in HARMLESS.get(place, ()) if line.startswith(start)), None)


def table(record):
    """The record as the page shows it."""
    total = dict.fromkeys(("functions", "planted", "caught", "same"), 0)
    lines = ["| host code | functions | slips planted | noticed | change no answer | not noticed |", "| --- " * 6 + "|"]
    for group, entry in record["groups"].items():
        same = sum(harmless(slip) is not None for slip in entry["survived"])
        planted, caught = sum(entry["planted"].values()), sum(entry["caught"].values())
        numbers = {"functions": entry["functions"], "planted": planted, "caught": caught, "same": same}
        total = {key: total[key] + value for key, value in numbers.items()}
        lines.append(row(group, numbers))
    lines.append(row("all", total))
    return f"Judged on {record['date']} at commit {record['commit'][:10]}.\n\n" + "\n".join(lines) + "\n"


def row(name, numbers):
    left = numbers["planted"] - numbers["caught"] - numbers["same"]
    return f"| {' | '.join(map(str, (name, *numbers.values(), left)))} |"


def publish(groups):
    """Put what was found into the record and the page."""
    from validation.attack.campaign import commit

    record = {
        "date": f"{datetime.datetime.now(datetime.UTC):%Y-%m-%d}",
        "commit": commit("validation/host_slips.json", "docs/nightly.md"),
        "groups": groups,
    }
    RECORD.write_text(json.dumps(record, indent=1) + "\n")
    before, _, rest = PAGE.read_text().partition(BEGIN)
    PAGE.write_text(f"{before}{BEGIN}\n{table(record)}\n{END}{rest.partition(END)[2]}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("groups", nargs="*", choices=[*GROUPS, []], metavar="GROUP", help="these; all by default")
    parser.add_argument("--publish", action="store_true", help="judge every group; write the record and the page")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    names = GROUPS if given.publish or not given.groups else given.groups
    answer = {name: {"functions": len(GROUPS[name]), **judged(name)} for name in names}
    if given.publish:
        publish(answer)
    print(json.dumps(answer, indent=1))
    left = [slip for entry in answer.values() for slip in entry["survived"] if harmless(slip) is None]
    return EXIT_FAILED if given.publish and left else 0


if __name__ == "__main__":
    sys.exit(main())
