"""A coefficient of zero costs nothing: no pass, no field, no byte, no neighbour, no limit of the step, no bit.

Every effect stands in one of two lists: with the coefficients whose zero makes it the identity, or with the reason why
it has none. Every number of an effect that may be zero stands in one of three: those coefficients, the coefficients of
a term of its own, or what is no coefficient.
"""

import math
import pathlib
import tomllib

import msgspec
import pytest

import refsim as rs
from refsim import make_plan
from refsim.commands.plan import describe_plan
from refsim.core.capabilities import PullsParticles
from refsim.core.effect import EFFECTS, Extremes
from tests import pairs
from tests.across.test_composition import scene

PEBBLE = pathlib.Path(__file__).parents[2] / "refsim" / "examples" / "pebble.obj"
FACES = ("-x", "+x", "-y", "+y", "-z", "+z")
TANK = {"lower": (-0.2, -0.2, -0.2), "upper": (0.8, 0.8, 0.8)}
LIQUID = rs.WeaklyCompressible(  # its surface pulls it together: it moves
    sound_speed=12.0, clamp_pressure=False, density_bound=10.0, density="summation"
)
DEFAULT = rs.WeaklyCompressible(sound_speed=12.0)
MPM = rs.MpmLiquid(bulk_modulus=144e3, initial_ratio=0.98)
PULL = rs.Gravity()
FROZEN = {"melting_point": 0.0, "temperature": -5.0}
SHAPE = rs.ShapeMatching()
LIMP = rs.ShapeMatching(stiffness=0.0, damping=0.0)

HEAT = ("temperature", "heat_capacity")  # of which the report's ledger is made; other effects melt by them


def zeroed(effect):
    """The effect with all coefficients that it names at zero, without a filter, which acts whatever they are."""
    zeros = {n: value for n in effect.scales if (value := getattr(effect, n)) is not None}
    zeros = {n: (0.0,) * 3 if isinstance(value, tuple) else type(value)(0) for n, value in zeros.items()}
    filters = {"filter_density"} & {*effect.__struct_fields__}
    return msgspec.structs.replace(effect, **zeros, **dict.fromkeys(filters, False))


# (effect with zeros, the rest of the scene, fields that stay as its own state)
IDENTITIES = {
    name: [(zeroed(effect), (rest,), ()) for rest in ((MPM,) if name == "surface_energy" else
        (LIQUID, DEFAULT) if isinstance(effect, PullsParticles) else (LIQUID,))]
    for name, effect in pairs.EFFECTS.items() if effect.scales
} | {
    "heat_conduction": [(rs.HeatConduction(conductivity=0.0), (LIQUID,), HEAT),
        (rs.HeatConduction(conductivity=(0.0,), latent_heat=3e5, held=(0,), **FROZEN), (),
        (*HEAT, "enthalpy", "melting_point", "latent_heat", "reservoir"))],
    # which particles are solid, and which of them are at a surface, is what coupling and melting need
    "shape_matching": [(LIMP, (LIQUID,), ("phase", "place", "direct"))],
    "box_walls": [(rs.BoxWalls(open_faces=FACES, **TANK), (LIQUID, PULL), ())],
    "mpm_walls": [(rs.MpmWalls(open_faces=FACES, **TANK), (MPM, PULL), ())],
}  # fmt: skip
LISTED = tomllib.loads(pathlib.Path(__file__).with_name("zeros.toml").read_text(encoding="utf-8"))
WITHOUT, OTHERS, TERMS = LISTED["without"], LISTED["others"], LISTED["terms"]
BESIDE = {"liquid": LIQUID, "tank": rs.BoxWalls(**TANK)}
BASES = {"weakly_compressible": LIQUID, "mpm_liquid": MPM, "mesh_boundary": rs.MeshBoundary(
    file=str(PEBBLE), center=(0.2, 0.2, -0.4), size=0.4)}  # fmt: skip
CASES = [(name, k) for name, cases in IDENTITIES.items() for k in range(len(cases))]


def both(name, k):
    """(scene without the effect, scene with its zeros)."""
    effect, rest, _ = IDENTITIES[name][k]
    if not isinstance(effect, rs.ShapeMatching):
        return scene(*rest), scene(*rest, effect)
    with_it = scene(*rest, effect)  # a solid must have its effect: without it the same particles are liquid
    start = make_plan(with_it).state
    solid = slice(0, start.sizes[0])
    cloud = rs.Cloud(position=start.position[solid], mass=start.mass[solid])
    return msgspec.structs.replace(scene(*rest), fluid=(cloud, *with_it.fluid)), with_it


def limits(plan):
    at = Extremes(1.0, 10.0)
    return {k: v.at(at) for e in plan.effects.values() for k, v in e.step_limits(plan.grid, plan.effects).items()}


def changed(name, **parameters):
    """The pair scene of an effect alone, with other parameters of it."""
    whole = pairs.scene(name, name)
    effects = (msgspec.structs.replace(e, **parameters) if e.name == name else e for e in whole.effects)
    return msgspec.structs.replace(whole, effects=tuple(effects))


@pytest.mark.parametrize("name", pairs.EFFECTS)
def test_a_zero_leaves_out_what_it_belongs_to(name):
    """A parameter that may be zero stands in a list; an effect has scales, or a reason why it has none."""
    effect, listed, identities = pairs.EFFECTS[name], {*TERMS, *OTHERS}, IDENTITIES.get(name, ())
    for f in msgspec.structs.fields(effect):
        if not any(kind in str(f.type) for kind in ("float", "int")) or isinstance(getattr(effect, f.name), tuple):
            continue
        try:
            make_plan(changed(name, **{f.name: 0}))
        except (rs.InputError, ZeroDivisionError):
            continue
        assert f"{name}.{f.name}" in listed or any(getattr(case[0], f.name) == 0 for case in identities), f.name
    assert (name in IDENTITIES) != (name in WITHOUT), name


@pytest.mark.parametrize("name, k", CASES)
def test_the_plan_is_that_of_a_scene_without(name, k):
    without, with_it = map(make_plan, both(name, k))
    own = IDENTITIES[name][k][2]
    assert with_it.launches(True) == without.launches(True)
    assert [p for _, p in with_it.motion] == [p for _, p in without.motion]
    started = {p.operation for _, p in with_it.start} - {p.operation for _, p in without.start}
    # the surfaces of solids are found once, when a run begins
    assert started == (
        {"shape_matching.direct_neighbours", "shape_matching.classify"} if own and "phase" in own else set()
    )
    numbers = [{n: str([g for g in plan.parameters.get(n, {}).values() if isinstance(g, tuple)])
                for n in without.effects} for plan in (with_it, without)]  # fmt: skip
    assert numbers[0] == numbers[1]
    assert (set(with_it.fields) - set(without.fields), with_it.list_radius) == (set(own), without.list_radius)
    assert limits(with_it) == limits(without)
    assert (with_it.walls is None) == (without.walls is None)
    assert set(with_it.shared) - set(without.shared) <= {"lattice"}
    assert any(e.host_in_step for e in with_it.effects.values()) == any(
        e.host_in_step for e in without.effects.values()
    )
    for backend in ("cpu", "cuda"):
        here, there = (describe_plan(plan, backend) for plan in (with_it, without))
        more = sum(math.prod(f.shape(with_it.grid.count)) * f.numpy_dtype("float32").itemsize
                   for f in with_it.fields.values() if f.name in own)  # fmt: skip
        moved = sum(with_it.field_bytes()[n] for n in own if n in with_it.field_bytes() and with_it.fields[n].state)
        lists = moved * with_it.grid.count if backend == "cuda" and with_it.list_radius else 0  # spare arrays
        assert here["bytes"]["total"] == there["bytes"]["total"] + more + lists
        assert (here["step"]["limits"], here["not_counted"]) == (there["step"]["limits"], there["not_counted"])


@pytest.mark.parametrize("place", TERMS)
def test_a_term_of_zero_is_left_out(place):
    name, of = place.partition(".")[0], TERMS[place]
    usual = msgspec.structs.asdict(BASES[name]) if name in BASES else {}
    effects = (msgspec.convert(usual | of["both"] | of[which], EFFECTS[name]) for which in ("zero", "acts"))
    without, with_it = (make_plan(scene(*map(BESIDE.get, of["rest"]), effect)) for effect in effects)
    for own, of_plan in ((of["passes"], lambda plan: plan.launches(True)), (of["fields"], lambda plan: plan.fields)):
        assert set(own.split()) <= set(of_plan(with_it))
        assert not set(own.split()) & set(of_plan(without))
