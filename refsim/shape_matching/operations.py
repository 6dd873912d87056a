"""The operations of lattice shape matching: which equations make each, over sets of nodes, float64.

Tables have a row for each node of a solid, in the particles' first order; the particle of node s stands in row place[s]
of the particle arrays. region (S, n^3), n = 2 w + 1: numbers of the members, -1 in empty slots.
"""

import numpy as np

from refsim.core.operation import Program, operations
from refsim.core.terms import Terms, certain, where
from refsim.neighbours.sums import Fields, Pairs
from refsim.shape_matching import reference as ref
from refsim.shape_matching.reference import EMPTY, FLUID

operation = operations(paper="Shao & Song 2017")
_AFTER = "Shao & Song 2017, after Rivers & James 2007"
_COLLAPSED = "members_in_a_point members_on_a_line members_on_a_short_line members_on_a_plane members_on_a_small_plane"


def _sums(tolerance):
    """A CPU's other algorithm for sums over regions, boxes of cells.

    Threads of a GPU sum up to half-width 2 in less time than it takes to pass over all cells axis by axis.
    """
    reason = "as the sum over members; terms are relative to one point of the body"
    work = ("boxes.first", "boxes.second")
    return {"cpu:fast": Program("fast_summation", tolerance=2 * tolerance, reason=reason, work=work)}


def members(region):
    """(s, k, x0_k - x0_s [cells]) of a node and each member of its region; k is also a region that holds node s."""
    s, slot = np.nonzero(np.asarray(region) != EMPTY)
    side = round(np.shape(region)[1] ** (1 / 3))
    return s, np.asarray(region)[s, slot], np.stack(np.unravel_index(slot, (side,) * 3), axis=-1) - side // 2


def over_members(pairs, s, k, **between):
    """Sums over the members of each node, or over the regions that hold it."""
    return Pairs(s, len(s.row.value), k, pairs[0], pairs[1], Fields(**between))


def apart(pairs, values):
    """v_k - v_s."""
    values = np.asarray(values, dtype=float)
    return values[pairs[1]] - values[pairs[0]]


def held_by(of):
    """Whether a region has mass, and its mass, or 1 kg without."""
    held = of(ref.mass).value > 0
    return held, where(Terms(held), of(ref.mass), 1.0)


def lengths(values):
    return np.linalg.norm(values, axis=-1)


# Neighbours and members


@operation("M figure 2, arrayN, with Shao & Song M18, M19", outputs="direct", exact="direct")
def direct_neighbours(phase, place, lattice):
    """Solid nodes' direct neighbours (S, 27), g + (a, b, e) in slot (a + 1) 9 + (b + 1) 3 + (e + 1); dimensionless."""
    cell = np.asarray(lattice.cell, dtype=int)
    solid = np.asarray(phase)[np.asarray(place)[: len(cell)]] != FLUID
    body, direct = np.asarray(lattice.body), np.full((len(cell), 27), EMPTY)
    for s in np.flatnonzero(solid):
        near = np.flatnonzero(ref.directly_beside(cell - cell[s], body == body[s], solid))
        direct[s, (cell[near] - cell[s] + 1) @ [9, 3, 1]] = near
    return {"direct": certain(direct)}


@operation(
    "M figure 3, arrayR, with Shao & Song M14, M15", outputs="region region_count", exact="region region_count",
    optional="rebuild", programs={"cpu": "region_filling", "cuda": "region_filling_cuda"},
)  # fmt: skip
def regions(direct, rebuild, lattice, region, region_count):
    """Regions of all nodes, or where `rebuild` is not 0: those at most w steps away, in their slots; dimensionless."""
    direct, cell = np.asarray(direct), np.asarray(lattice.cell, dtype=int)
    region, count = np.array(region), np.array(region_count)
    n = round(region.shape[1] ** (1 / 3))
    for s in range(len(direct)):
        if rebuild is None or rebuild[s]:
            members = {s} if (direct[s] != EMPTY).any() else set()
            for _ in range(n // 2):
                members = ref.one_step_farther(members, direct)
            reached = np.array(sorted(members), int)
            region[s], count[s] = EMPTY, len(reached)
            region[s, (cell[reached] - cell[s] + n // 2) @ [n**2, n, 1]] = reached
    return {"region": certain(region), "region_count": certain(count)}


@operation("M section 2: SBP and IBP", outputs="phase", exact="phase")
def classify(identity, direct, lattice, phase):
    """Phases of the nodes' particles; others keep theirs (flag)."""
    count = (np.asarray(direct) != EMPTY).sum(1)
    identity, result = np.asarray(identity), np.array(phase)
    node = identity < len(count)
    result[node] = ref.phase(count[identity[node]], lattice.dim)
    return {"phase": certain(result)}


@operation("m = m_k/cnt_k", paper=_AFTER, outputs="region_share solid_position", reason="one quotient, and a copy")
def gather(position, mass, place, region_count):
    """Position of each node [m] and its share m = m_k/cnt_k in each of its regions [kg]; none for liquid."""
    rows = np.asarray(place)[: len(region_count)]
    x = np.asarray(position, dtype=float)[rows]
    share = ref.share(np.asarray(mass, dtype=float)[rows], np.asarray(region_count))
    return {"region_share": Terms(share), "solid_position": (x, 0 * x)}


# The best rigid motion of a region


@operation(
    "c, A and argmax tr(R^T A)", paper=_AFTER, outputs="region_center region_anchor rotation", tolerance=16.0,
    reason="products and sums of A, and the sweeps of the eigensolver, over the gap of the eigenvalues",
    cases=_COLLAPSED, programs=_sums(16.0),
)  # fmt: skip
def match(solid_position, region_share, region, matching, rotation):
    """c - x_s [m], anchor [m], and R as a quaternion of the sign of the one before.

    An undetermined twist is the one before, and so is all of it where no entry of A is above what rounding makes of
    one: n eps sum |terms| of the n terms, and eps w |x_s|_1 sum m of the positions. Sizes: over the gap of eigenvalues.
    """
    x, before, pairs = np.asarray(solid_position, float), np.asarray(rotation, float), members(region)
    spacing, slots, s = float(matching.spacing), np.shape(region)[1], Fields(row=np.arange(len(x)))
    of = over_members(pairs, s, Fields(mass=region_share), x=apart(pairs, x), rest=spacing * pairs[2])
    held, mass = held_by(of)
    first, c0 = of(ref.moment), of(ref.moment_at_rest) / mass
    c = first / mass
    a = ref.covariance(of(ref.products), mass, c, c0)
    largest, reach = np.abs(a.value).max((1, 2)), spacing * (round(slots ** (1 / 3)) // 2)
    lost = 2 * reach * slots * np.finfo(float).eps * first.size.sum(1)
    lost += mass.value * float(matching.eps) * reach * np.abs(x).sum(1)
    decided = held & (largest > lost)
    scaled = np.where(decided, largest, 1.0)
    form, q = ref.quadratic_form(a.value / scaled[:, None, None]), before
    for _ in range(2):
        q, gap = ref.best_turn(form, q, np.maximum(float(matching.twist_floor), 16 * lost / scaled))
    q = np.where(decided[:, None], np.where((q * before).sum(1)[:, None] >= 0, q, -q), before)
    terms = np.where(decided, a.size.max((1, 2)), 1.0) / scaled
    gap = np.where(decided, np.maximum(gap, 1e-300) / terms, 1.0)
    anchor = ref.anchor(c, Terms(ref.rotation_matrix(q), rank=2), c0)
    spread = c.size + (lengths(c0.value) * (1 + 1 / gap))[:, None]
    return {
        "region_center": where(Terms(held), Terms(c.value, spread, 1), 0.0),
        "region_anchor": where(Terms(held), Terms(anchor.value, spread, 1), 0.0),
        "rotation": (q, np.broadcast_to((1 + 1 / gap)[:, None], q.shape)),
    }


# Goals and damping


@operation(
    "g_i = sum_r [R_r (x0_i - c0_r) + c_r]/cnt_i, v += alpha (g - x)/dt", paper=_AFTER,
    outputs="acceleration solid_velocity", adds="acceleration", tolerance=8.0,
    reason="a rotation, a sum, and the quotient of a difference", programs=_sums(8.0),
)  # fmt: skip
def pull(
    velocity, solid_position, region, region_count, region_anchor, rotation, place, matching, timestep, acceleration
):  # fmt: skip
    """a_i += alpha (g_i - x_i)/(t dt) [m/s^2], and the velocity [m/s] after the kick; timestep = (t, dt) [s]."""
    pairs, (kick, drift) = members(region), (float(t) for t in timestep)
    s = Fields(row=np.arange(len(region)), count=np.maximum(region_count, 1))
    r = Fields(anchor=region_anchor, turn=ref.rotation_matrix(np.asarray(rotation, dtype=float)))
    rest = float(matching.spacing) * pairs[2]
    goal = over_members(pairs, s, r, x=apart(pairs, solid_position), rest=rest)(ref.goal)
    start, rows = Terms(acceleration, rank=1), np.asarray(place)[: len(region)]
    pulled = ref.towards(goal, float(matching.stiffness), kick, drift) if drift > 0 else 0 * goal
    added = at_rows(rows, pulled, len(start.value))
    return {"acceleration": added, "solid_velocity": (Terms(velocity, rank=1) + kick * (start + added)).at(rows)}


def at_rows(rows, vectors, count):
    """The vectors in their rows of `count`, 0 elsewhere."""
    whole = np.zeros((2, count, 3))
    whole[:, rows] = vectors.value, vectors.size
    return Terms(*whole, 1)


@operation(
    "v_c = sum m v/M, omega = I^-1 L", paper="standard", outputs="region_velocity region_spin", tolerance=16.0,
    reason="products and sums of I and L, and Cholesky's steps, over the least eigenvalue of I", cases=_COLLAPSED,
    programs=_sums(16.0),
)  # fmt: skip
def region_motion(solid_position, solid_velocity, region_share, region, region_center, matching):
    """Rigid motion of every region: v_c [m/s]; omega [1/s], I += e tr(I) 1, 0 where tr(I) = 0."""
    pairs, v = members(region), Terms(solid_velocity, rank=1)
    of = over_members(
        pairs, Fields(row=np.arange(len(region))), Fields(mass=region_share), velocity=apart(pairs, solid_velocity),
        arm=apart(pairs, solid_position) - np.asarray(region_center, float)[pairs[0]],
    )  # fmt: skip
    _, mass = held_by(of)
    inertia, momentum = of(ref.inertia).value, of(ref.angular_momentum)
    trace = np.einsum("saa->s", inertia)
    inertia = np.where(trace[:, None, None] > 0, inertia, np.eye(3))
    trace = np.where(trace > 0, trace, 3.0)
    held = inertia + float(matching.inertia_floor) * trace[:, None, None] * np.eye(3)
    least = np.linalg.eigvalsh(held)[:, 0]
    spin = ref.spin(inertia, held, momentum.value)
    bound = np.broadcast_to((lengths(momentum.size) / least * (1 + trace / least))[:, None], spin.shape)
    return {"region_velocity": v + of(ref.momentum) / mass, "region_spin": (spin, bound)}


@operation(
    "v_i += (beta/cnt_i) sum_r [v_r + omega_r x (x_i - c_r) - v_i]", paper="standard", adds="acceleration",
    tolerance=8.0, reason="a cross product, a sum and a product", programs=_sums(8.0),
)  # fmt: skip
def damp(
    solid_position, solid_velocity, region, region_count, region_center, region_velocity, region_spin, place, matching,
    timestep, acceleration,
):  # fmt: skip
    """The damping of v_i over the kick, as an acceleration [m/s^2]."""
    pairs, kick = members(region), float(timestep[0])
    s = Fields(row=np.arange(len(region)), count=np.maximum(region_count, 1), velocity=solid_velocity)
    arm = -apart(pairs, solid_position) - np.asarray(region_center, float)[pairs[1]]
    of = over_members(pairs, s, Fields(velocity=region_velocity, spin=region_spin), arm=arm)
    change = of(ref.damping, beta=matching.damping)
    change = change / kick if kick > 0 else 0 * change
    return {"acceleration": at_rows(np.asarray(place)[: len(region)], change, len(acceleration))}
