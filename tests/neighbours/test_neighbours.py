"""The neighbour search against all pairs, on every hard input; what a pair function may say."""

import math

import numpy as np
import pytest

import refsim as rs
from refsim.backends.arrays import choose, on_threads
from refsim.core import cases
from refsim.core.period import period_group
from refsim.core.walls import planes
from refsim.neighbours import AUDIT_MARGIN, MOST_NEIGHBOURS, AuditedRows, NeighbourSearch, Particles
from refsim.neighbours.pair_functions import given_to, layout, terms
from refsim.neighbours.pairs import pair
from refsim.neighbours.reference import neighbour_list, pair_blocks
from refsim.neighbours.rows import NeighbourRows
from tests.running import advanced

CPU = choose("cpu")


def search_for(case, dtype, skin=None, **options):
    return NeighbourSearch(CPU, case.dim, dtype, case.support_radius, case.skin if skin is None else skin, **options)


def rows(listed):
    return [np.sort(listed.entries[s : s + c]) for s, c in zip(listed.start, listed.count)]


def listings(listed, sources):
    """(queries, sources): how often a list holds each of so many sources."""
    table = np.zeros((len(listed.start), sources), dtype=np.int64)
    for i, row in enumerate(rows(listed)):
        np.add.at(table[i], row, 1)
    return table


def ordered(case, dtype, **options):
    """(search, positions in cell order, list)."""
    search = search_for(case, dtype, **options)
    position = case.position.astype(dtype)
    position = position[search.order(position)]
    return search, position, search.build(position)


def certain(query, source, reach):
    """(pairs that must be listed, pairs that may be): within and around the reach by what rounding allows."""
    eps = 8 * np.finfo(query.dtype).eps
    for place, _, distance in pair_blocks(query, source):
        yield place, distance < reach * (1 - eps), distance < reach * (1 + eps)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("name", [*cases.COMMON, "large"])
def test_list_holds_all_pairs(name, dtype):
    case = cases.CASES[name]()
    search, position, listed = ordered(case, dtype)
    assert sorted(map(tuple, position)) == sorted(map(tuple, case.position.astype(dtype)))
    own = np.arange(len(position))
    table = listings(listed, len(position))
    for place, needed, allowed in certain(position, position, search.reach):
        other = own[place, None] != own[None, :]
        assert (table[place] <= (allowed & other)).all()
        assert (table[place] >= (needed & other)).all()
    if len(position):
        assert search.log.most_neighbours == listed.count.max()


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("name", [n for n in cases.COMMON if len(cases.CASES[n]().wall_position)] + ["no_particles"])
def test_wall_list_holds_all_pairs(name, dtype):
    case = cases.CASES[name]()
    search = search_for(case, dtype)
    position = case.position.astype(dtype)
    position = position[search.order(position)]
    static = search.static_set(case.wall_position)
    assert np.array_equal(static.position, case.wall_position.astype(dtype)[static.order])
    listed = search.build_against(position, static)
    table = listings(listed, len(static.position))
    for place, needed, allowed in certain(position, static.position, search.reach):
        assert (table[place] <= allowed).all()
        assert (table[place] >= needed).all()
    search.build(position)
    around = listings(search.build_around(position, static), len(position))
    for place, needed, allowed in certain(static.position, position, search.reach):
        assert (around[place] <= allowed).all()
        assert (around[place] >= needed).all()


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize(
    "lengths", [(1.0, 0.0, 0.0), (0.0, 0.45, 0.0), (0.45, 0.7, 0.0), (0.95, 0.67, 0.5), (0.0, 0.0, 0.45)],
    ids=lambda lengths: "-".join(map(str, lengths)),
)  # fmt: skip
def test_list_of_a_periodic_box_holds_all_pairs(lengths, dtype):
    """Two, three and more cells along each axis; particles of the box, and some several periods away from it."""
    dim = 3 if lengths[2] else 2
    random = np.random.default_rng(5)
    position = random.uniform(-0.4, 0.6, (400 if dim == 3 else 150, 3)) * ([1, 1, 1] if dim == 3 else [1, 1, 0])
    position[::3] += random.integers(-3, 4, (len(position[::3]), 3)) * lengths
    search = NeighbourSearch(CPU, dim, dtype, 0.2, 0.1, period_group(lengths, dtype))
    position = position.astype(dtype)
    position = position[search.order(position)]
    listed, own = search.build(position), np.arange(len(position))
    static = search.static_set(position[::2].copy())
    near = search.build_against(position, static)
    eps = 64 * np.finfo(dtype).eps
    for source, found, others in ((position, listed, True), (static.position, near, False)):
        distance = np.concatenate([block for _, _, block in pair_blocks(position, source, period=lengths)])
        table = listings(found, len(source))
        for i, row in enumerate(rows(found)):
            assert (row == found.entries[found.start[i] : found.start[i] + found.count[i]]).all()  # in their order
        other = (own[:, None] != own[None, :]) if others else np.ones_like(table, bool)
        assert (table <= ((distance < search.reach + eps) & other)).all()
        assert (table >= ((distance < search.reach - eps) & other)).all()
    still = np.zeros_like(position)
    assert search.margins(Particles(position, position, still, None), [0.0], False) == [0.0]
    search.audit(position, still, np.zeros(2, dtype), listed)
    assert search.programs.missed == 0
    across = np.abs(position[:, None] - position[None, :]).max(2) > 0.25
    torn = NeighbourRows(listed.start, np.array([0 if across[i][row].any() else len(row) for i, row in
                         enumerate(rows(listed))], np.int32), listed.entries)  # fmt: skip
    search.programs.audit(position, still, np.zeros(2, dtype), torn, AuditedRows(1, len(position)), 0.2)
    assert search.programs.missed > 20


def test_order_is_stable_and_nothing_is_missed_beyond_the_numbered_cells():
    """Particles of one cell keep their order; cells further than 2^20 from the origin share the last number."""
    case = cases.CASES["large"]()
    search, position, _ = ordered(case, "float32")
    assert np.array_equal(search.order(position), np.arange(len(position)))
    together = np.zeros((50, 3), np.float32)
    assert np.array_equal(search.order(together), np.arange(50))
    away = np.array([3e7, -3e7, 1e9])
    position = np.concatenate([cases.cloud("edge", 60, 3, 0.5), cases.cloud("edge", 60, 3, 0.5) + away])
    search = NeighbourSearch(CPU, 3, "float64", 1.0, 0.0)
    position = position[search.order(position)]
    expected = neighbour_list(position, 1.0)
    assert sum(map(len, expected)) > 500
    assert all(np.array_equal(a, b) for a, b in zip(rows(search.build(position)), expected))


def test_list_grows_and_stays_whole_until_it_collapses():
    """From a loose cloud to one so dense that the first capacity is far too small, with one search."""
    search = NeighbourSearch(CPU, 3, "float64", 0.2, 0.1)
    held = []
    for spacing in (0.2, 0.1, 0.035):
        position = cases.cloud("growth", 900, 3, spacing)
        position = position[search.order(position)]
        listed = search.build(position)
        expected = neighbour_list(position, search.reach)
        assert all(np.array_equal(a, b) for a, b in zip(rows(listed), expected))
        held.append(search.log.list_bytes)
    assert held[2] > 4 * held[0]
    assert listed.count.max() > 300
    assert search.log.rebuilds == 3
    position = cases.cloud("clump", MOST_NEIGHBOURS + 2, 3, 1e-5)
    search = NeighbourSearch(CPU, 3, "float64", 1.0, 0.1)
    with pytest.raises(rs.RunStopped, match="collapsed") as stopped:
        search.build(position[search.order(position)])
    assert stopped.value.reason == "collapsed"


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_bits_do_not_depend_on_threads_or_repetition(dtype):
    import numba

    case = cases.CASES["large"]()
    answers = []
    for threads in (1, numba.config.NUMBA_NUM_THREADS, 1):
        with on_threads(threads):
            _, position, listed = ordered(case, dtype)
        used = [listed.entries[s : s + c].tobytes() for s, c in zip(listed.start, listed.count)]
        answers.append((position.tobytes(), listed.start.tobytes(), listed.count.tobytes(), used))
    assert answers[0] == answers[1] == answers[2]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_positions_that_are_no_numbers_harm_no_other_particle(value):
    """The search returns and raises nothing; such a particle has no neighbours, the others keep theirs."""
    position = cases.cloud("broken", 200, 3)
    position[17, 1] = value
    search = NeighbourSearch(CPU, 3, "float64", 0.2, 0.1)
    order = search.order(position)
    listed = rows(search.build(position[order]))
    place = int(np.flatnonzero(order == 17)[0])
    with np.errstate(invalid="ignore"):
        expected = neighbour_list(position[order], search.reach)
    assert len(listed[place]) == 0
    assert all(np.array_equal(a, b) for a, b in zip(listed, expected))


# Skin, rebuilds and the audit
def test_audit_looks_where_the_list_was_last_used_and_leaves_out_what_a_plane_stopped():
    """After a step that halves all distances the list would look short; the audit steps back first, by shifts too."""
    case = cases.CASES["cloud_3d"]()
    search, position, listed = ordered(case, "float32")
    velocity = -0.5 * position
    search.audit(position + velocity, velocity, np.array([0.0, 1.0]), listed)
    assert search.programs.missed == 0
    search.audit(position + 2 * velocity, velocity, np.array([0.0, 1.0]), listed, shift=(velocity, np.ones(1), None))
    assert search.programs.missed == 0
    search.audit(position + velocity, velocity, np.zeros(2), listed)
    assert search.programs.missed > 20
    search.build(position)
    assert search.log.missed_neighbours == search.programs.missed
    search = NeighbourSearch(choose("cpu"), 2, "float32", 1.0, skin=0.1)
    before = np.array([[0.3, 0.0, 0.0], [1.5, 0.0, 0.0], [1.5, 2.0, 0.0], [1.5, 2.5, 0.0]], "f4")
    listed = search.build(before)
    velocity, after = np.zeros_like(before), before.copy()
    after[1, 0] = 0.5
    bounds = planes([0.5, -np.inf, -np.inf], np.inf, dtype="float32")  # where the second one stands now
    rows, still = AuditedRows(1, 4), np.zeros(2)
    search.programs.audit(after, velocity, still, listed, rows, 1.0, bounds)
    assert search.programs.missed == 0
    search.programs.audit(after, velocity, still, listed, rows, 1.0)
    assert search.programs.missed == 2


def test_an_audit_takes_pairs_at_the_limit_alike_among_all_and_in_the_list():
    """Of 40 particles around each of 40 others, at the audit's limit, none is missing, however they are rounded."""
    random, limit = np.random.default_rng(5), 1 - AUDIT_MARGIN
    search = NeighbourSearch(choose("cpu"), 3, "float32", 1.0, skin=0.1)
    way = random.normal(size=(40, 41, 3))
    way *= limit / np.linalg.norm(way, axis=2, keepdims=True)
    way[:, 0] = 0.0
    before = (way + 4.0 * np.argwhere(np.ones((4, 5, 2)))[:, None]).reshape(-1, 3).astype("float32")
    before = before[search.order(before)]
    velocity, shift = random.normal(size=(2, *before.shape)).astype("float32") * np.float32(0.1)
    step = np.array([0.0, 0.05], dtype="float32")
    listed, rows = search.build(before), AuditedRows(1, len(before))
    shifts = shift, np.ones(1, "float32"), None
    search.programs.audit(before + step[1] * velocity + shift, velocity, step, listed, rows, limit, None, shifts)
    assert search.programs.missed == 0


def test_lists_of_the_default_liquid_are_audited(monkeypatch):
    """Its positions follow from velocities and shifts. A list that is kept too long lacks pairs."""
    scene = rs.Scene(
        dim=2, spacing=0.05, support_radius=0.1, skin=0.05, fluid=(rs.Box(cells=(12, 12, 1)),),
        effects=(rs.WeaklyCompressible(sound_speed=8.0), rs.Gravity(), rs.BoxWalls(lower=(0, 0, 0), upper=(1.5, 1, 0))),
    )  # fmt: skip
    simulation = rs.Simulation(scene, "cpu")
    advanced(simulation, 60)
    assert simulation.search.log.audited_rows > 0
    assert simulation.search.log.missed_neighbours == 0
    monkeypatch.setattr(simulation.search, "allowed_displacement", 20 * simulation.search.allowed_displacement)
    with pytest.raises(rs.RunStopped, match="lacked"):
        advanced(simulation, 200)


# Particles that move together need no new list
@pytest.mark.parametrize("dim", [2, 3])
def test_blocks_compare_all_pairs_that_could_meet(dim):
    """The bounds are not below the ways of two particles within two cells, nor of any two, and not far above."""
    position = cases.cloud(f"blocks {dim}", 300, dim)
    search = NeighbourSearch(CPU, dim, "float64", 0.2, 0.1)
    position = position[search.order(position)]
    search.build(position)
    way = 0.1 * np.random.default_rng(dim).normal(size=position.shape)
    way[:, dim:] = 0
    (found,) = search.programs.relative_displacements(position + way, position, None, None)
    touching, anywhere = (a**2 for a in found)
    difference = ((way[:, None] - way[None]) ** 2).sum(2)
    near = np.linalg.norm(position[:, None] - position[None], axis=2) < 2 * search.reach
    assert difference[near].max() <= touching * (1 + 1e-12) <= anywhere * (1 + 1e-12)
    assert anywhere == pytest.approx(((way.max(0) - way.min(0)) ** 2).sum(), rel=1e-12)


@pair
def every_kind(r, x_ij, mass_i, mass_j, velocity_i, velocity_j, kind_j, radius, factor, extra):
    dx, dy, dz = x_ij
    share = mass_i * mass_j * (radius.support_radius - r) * factor
    if kind_j == 2:
        share = -share
    if extra is not None:
        share += extra.no_such_member
    return share * dx, share * (velocity_j[1] - velocity_i[1]), share * dz, share * dy


@pair
def volume_near(r, volume_j, radius):
    return volume_j * r


@pair
def flow(weight_ij, heat_i, heat_j):
    return weight_ij * (heat_j - heat_i)


def test_what_a_pair_function_takes_and_returns():
    assert [terms(f) for f in (every_kind, volume_near, flow)] == [4, 1, 1]
    assert list(given_to(every_kind, (None,) * 6)) == ["mass", "velocity", "kind", "radius", "factor", "extra"]
    with pytest.raises(TypeError, match="pair function flow takes heat; 2 values are given"):
        given_to(flow, (None, None))


def test_fields_are_packed_in_rows_of_four():
    """A scalar behind each vector, the position first; then scalars together; one that is left, and integers, alone."""
    kinds = {"mass": "scalar", "velocity": "vector", "kind": "integer"}
    assert layout(every_kind, tuple(kinds.values())) == (["", "velocity"], ["mass"], [], ["kind"])

    assert layout(volume_near, (None,)) == ([], [], [], [])

    def many(r, a_j, b_j, c_j, d_j, e_j, f_j, absent_j, radius):
        return a_j

    assert layout(many, ("scalar",) * 3 + (None,) * 4) == ([""], ["a"], [], ["b", "c"])
    assert layout(many, ("scalar",) * 6 + (None,)) == ([""], ["a"], [["b", "c", "d", "e"]], ["f"])


def test_return_statements_write_equally_many_terms():
    def uneven(r, mass_j, radius):
        if mass_j > r:
            return r, r
        return r

    with pytest.raises(TypeError, match="uneven: its return statements write different numbers of terms"):
        terms(uneven)
