"""NumPy oracle of lattice shape matching: sets of nodes, float64.

Tables have a row for each node of a solid, in the particles' first order; the particle of node s stands in row place[s]
of the particle arrays. region (S, n^3), n = 2 w + 1: numbers of the members, -1 in empty slots.
"""

import numpy as np

from refsim.core.operation import Program, operations

operation = operations(paper="Shao & Song 2017")
_AFTER = "Shao & Song 2017, after Rivers & James 2007"
_COLLAPSED = "members_in_a_point members_on_a_line members_on_a_short_line members_on_a_plane members_on_a_small_plane"


def _sums(tolerance):
    """Further algorithms for sums over regions: threads that share a region (Shao & Song 2017, 3.2), boxes of cells."""
    fast = {
        "tolerance": 2 * tolerance,
        "reason": "as the sum over members; terms are relative to one point of the body",
        "work": ("boxes.first", "boxes.second"),
    }
    return {
        "cuda:reduction": "parallel_reduction_cuda",
        "cpu:fast": Program("fast_summation", **fast),
        "cuda:fast": Program("fast_summation_cuda", **fast),
    }


FLUID, SURFACE, INTERIOR = 0, 1, 2
EMPTY = -1


def _certain(value):
    value = np.asarray(value)
    return value, np.full(value.shape, np.inf)


def _offsets(slots):
    """(slots, 3) offsets [cells] of the slots of a box."""
    side = round(slots ** (1 / 3))
    return np.stack(np.meshgrid(*[np.arange(side) - side // 2] * 3, indexing="ij"), axis=-1).reshape(-1, 3)


@operation("M figure 2, arrayN, with Shao & Song M18, M19", outputs="direct", exact="direct")
def direct_neighbours(phase, place, lattice):
    """Direct neighbours (S, 27): slot (a + 1) 9 + (b + 1) 3 + (e + 1) = the solid node of one body at g + (a, b, e).

    Dimensionless; a node that is liquid has none and is none.
    """
    cell, body = np.asarray(lattice.cell, dtype=int), np.asarray(lattice.body)
    solid = np.asarray(phase)[np.asarray(place)[: len(cell)]] != FLUID
    direct = np.full((len(cell), 27), EMPTY)
    for s in np.flatnonzero(solid):
        offset = cell - cell[s]
        near = np.flatnonzero((abs(offset) <= 1).all(1) & (body == body[s]) & solid)
        direct[s, (offset[near] + 1) @ [9, 3, 1]] = near
    return {"direct": _certain(direct)}


@operation(
    "M figure 3, arrayR, with Shao & Song M14, M15", outputs="region region_count", exact="region region_count",
    optional="rebuild", programs={"cpu": "region_filling", "cuda": "region_filling_cuda"},
)  # fmt: skip
def regions(direct, rebuild, lattice, region, region_count):
    """Region of a node = nodes at most w steps away over direct neighbours, in their slots; dimensionless.

    Rows where `rebuild` is zero are left as they are; None rebuilds all.
    """
    direct, cell = np.asarray(direct), np.asarray(lattice.cell, dtype=int)
    region = np.array(region)
    width = (round(region.shape[1] ** (1 / 3)) - 1) // 2
    count = np.array(region_count)
    for s in range(len(direct)):
        if rebuild is None or rebuild[s]:
            region[s] = EMPTY
            members = {s} if (direct[s] != EMPTY).any() else set()
            for _ in range(width):
                members |= {int(j) for m in members for j in direct[m] if j != EMPTY}
            found = np.array(sorted(members), int)
            region[s, (cell[found] - cell[s] + width) @ [(2 * width + 1) ** 2, 2 * width + 1, 1]] = found
            count[s] = len(found)
    return {"region": _certain(region), "region_count": _certain(count)}


@operation("M section 2: SBP and IBP", outputs="phase", exact="phase")
def classify(identity, direct, phase):
    """phase = 1 where a node has fewer than 27 direct neighbours, itself among them, 2 with all, else 0 (flag)."""
    count = (np.asarray(direct) != EMPTY).sum(1)
    identity, result = np.asarray(identity), np.array(phase)
    node = identity < len(count)
    own = count[identity[node]]
    result[node] = np.where(own == 0, FLUID, np.where(own < 27, SURFACE, INTERIOR))
    return {"phase": _certain(result)}


@operation("m = m_k/cnt_k", paper=_AFTER, outputs="region_share solid_position", reason="one quotient, and a copy")
def gather(position, mass, place, region_count):
    """Position of each node [m] and its share m = m_k/cnt_k in each of its regions [kg]; none for liquid."""
    rows = np.asarray(place)[: len(region_count)]
    count = np.asarray(region_count)
    share = np.where(count > 0, np.asarray(mass, dtype=float)[rows] / np.maximum(count, 1), 0.0)
    x = np.asarray(position, dtype=float)[rows]
    return {"region_share": (share, share), "solid_position": (x, 0 * x)}


def _members(region, s):
    slots = np.flatnonzero(region[s] != EMPTY)
    return slots, region[s, slots]


def _matrix(q):
    w, i, j, k = q
    return np.array(
        [
            [1 - 2 * (j * j + k * k), 2 * (i * j - w * k), 2 * (i * k + w * j)],
            [2 * (i * j + w * k), 1 - 2 * (i * i + k * k), 2 * (j * k - w * i)],
            [2 * (i * k - w * j), 2 * (j * k + w * i), 1 - 2 * (i * i + j * j)],
        ]
    )


def _homogeneous(q):
    """R(q) as a form of second degree: |q|^2 times the rotation."""
    w, u = q[0], q[1:]
    cross = np.array([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]])
    return (w * w - u @ u) * np.eye(3) + 2 * np.outer(u, u) + 2 * w * cross


MIXED = [[(_homogeneous(p + q) - _homogeneous(p - q)) / 4 for q in np.eye(4)] for p in np.eye(4)]


def _quadratic_form(a):
    """K of tr(R(q)^T A) = q^T K q, by polarisation of the nine entries of R(q)."""
    return np.array([[(mixed * a).sum() for mixed in row] for row in MIXED])


@operation(
    "c, A and argmax tr(R^T A)", paper=_AFTER, outputs="region_center region_anchor rotation", tolerance=16.0,
    reason="products and sums of A, and the sweeps of the eigensolver, over the gap of the eigenvalues",
    cases=_COLLAPSED, programs=_sums(16.0),
)  # fmt: skip
def match(solid_position, region_share, region, matching, rotation):
    """Best rigid motion of every region: c = sum m x/M, A = sum m (x - c)(x0 - c0)^T, R = argmax tr(R^T A), det R = 1.

    m = m_k/cnt_k. From node s: region_center c - x_s [m], region_anchor c + R (x0_s - c0) - x_s [m]. rotation:
    quaternion of R, of the sign of the one before; an undetermined twist is the one before, and so is all of it where
    no entry of A is above what rounding makes of one: n eps sum |terms| of the n terms, and eps w |x_s|_1 sum m of the
    positions. Scales: over the gap to the next eigenvalue.
    """
    x, share = np.asarray(solid_position, dtype=float), np.asarray(region_share, dtype=float)
    region, before = np.asarray(region), np.asarray(rotation, dtype=float)
    spacing, floor = float(matching.spacing), float(matching.twist_floor)
    offset = spacing * _offsets(region.shape[1])
    center, anchor, turned = np.zeros(x.shape), np.zeros(x.shape), np.array(before)
    spread, gaps = np.zeros(x.shape), np.ones(len(x))
    for s in range(len(x)):
        slots, j = _members(region, s)
        m = share[j]
        if not m.sum() > 0:
            continue
        far, rest = x[j] - x[s], offset[slots]
        c, c0 = m @ far / m.sum(), m @ rest / m.sum()
        a = (far - c).T @ (m[:, None] * (rest - c0))
        terms = np.abs(far).T @ (m[:, None] * np.abs(rest)) + np.outer(m @ np.abs(far), m @ np.abs(rest)) / m.sum()
        q, rotated_gap = before[s], 1.0
        cells = round(region.shape[1] ** (1 / 3)) // 2
        summed = 2 * spacing * cells * region.shape[1] * np.finfo(float).eps * (m @ np.abs(far)).sum()
        lost = summed + m.sum() * float(matching.eps) * spacing * cells * np.abs(x[s]).sum()
        if np.abs(a).max() > lost:
            form = _quadratic_form(a / np.abs(a).max())
            weight = max(floor, 16 * lost / np.abs(a).max())
            for _ in range(2):
                values, vectors = np.linalg.eigh(form + weight * np.outer(q, q))
                q = vectors[:, -1]
            q = q if q @ before[s] >= 0 else -q
            rotated_gap = max(values[-1] - values[-2], 1e-300) / (terms.max() / np.abs(a).max())
        center[s] = c
        anchor[s] = center[s] - _matrix(q) @ c0
        turned[s], gaps[s] = q, rotated_gap
        spread[s] = m @ np.abs(far) / m.sum() + np.linalg.norm(c0) * (1 + 1 / rotated_gap)
    return {
        "region_center": (center, spread),
        "region_anchor": (anchor, spread),
        "rotation": (turned, np.broadcast_to((1 + 1 / gaps)[:, None], turned.shape)),
    }


@operation(
    "g_i = sum_r [R_r (x0_i - c0_r) + c_r]/cnt_i, v += alpha (g - x)/dt", paper=_AFTER,
    outputs="acceleration solid_velocity", adds="acceleration", tolerance=8.0,
    reason="a rotation, a sum, and the quotient of a difference", programs=_sums(8.0),
)  # fmt: skip
def pull(
    velocity, solid_position, region, region_count, region_anchor, rotation, place, matching, timestep, acceleration
):  # fmt: skip
    """Goals g_i = (1/cnt_i) sum_r [R_r (x0_i - c0_r) + c_r] over node i's regions r; a_i += alpha (g_i - x_i)/(t dt).

    timestep = (t, dt) [s], t that of the kick v += t a. acceleration [m/s^2]; solid_velocity v + t a after it [m/s].
    """
    region, x = np.asarray(region), np.asarray(solid_position, dtype=float)
    anchor, v = np.asarray(region_anchor, dtype=float), np.asarray(velocity, dtype=float)
    start = np.asarray(acceleration, dtype=float)
    kick, drift = (float(t) for t in timestep)
    offset = float(matching.spacing) * _offsets(region.shape[1])
    turns = [_matrix(q) for q in np.asarray(rotation, dtype=float)]
    rows = np.asarray(place)[: len(x)]
    value, scale = np.zeros(v.shape), np.zeros(v.shape)
    for s in range(len(x)):
        slots, r = _members(region, s)
        if region_count[s] and drift > 0:
            share = float(matching.stiffness) / (region_count[s] * kick * drift)
            turned = np.array([-turns[k] @ offset[t] for t, k in zip(slots, r)])
            value[rows[s]] = share * (x[r] - x[s] + anchor[r] + turned).sum(0)
            terms = np.abs(x[r] - x[s]) + np.abs(anchor[r]) + np.linalg.norm(offset[slots], axis=1)[:, None]
            scale[rows[s]] = abs(share) * terms.sum(0)
    after = v + kick * (start + value)
    return {
        "acceleration": (value, scale),
        "solid_velocity": (after[rows], (np.abs(v) + kick * (np.abs(start) + scale))[rows]),
    }


@operation(
    "v_c = sum m v/M, omega = I^-1 L", paper="standard", outputs="region_velocity region_spin", tolerance=16.0,
    reason="products and sums of I and L, and Cholesky's steps, over the least eigenvalue of I", cases=_COLLAPSED,
    programs=_sums(16.0),
)  # fmt: skip
def region_motion(solid_position, solid_velocity, region_share, region, region_center, matching):
    """Rigid motion of every region: v_c = sum m v/M [m/s]; omega = I^-1 L [1/s], I += e tr(I) 1, 0 where tr(I) = 0.

    I = sum m (r^2 1 - r r^T), L = sum m r x (v - v_s), r = x - x_s - region_center. Solved again for what e left over.
    """
    x, v = np.asarray(solid_position, dtype=float), np.asarray(solid_velocity, dtype=float)
    center, share = np.asarray(region_center, dtype=float), np.asarray(region_share, dtype=float)
    region = np.asarray(region)
    mean, spin = np.array(v), np.zeros(v.shape)
    mean_scale, spin_scale = np.abs(v), np.zeros(v.shape)
    for s in range(len(x)):
        _, j = _members(region, s)
        m, r, u = share[j], x[j] - x[s] - center[s], v[j] - v[s]
        if not m.sum() > 0:
            continue
        mean[s] = v[s] + m @ u / m.sum()
        mean_scale[s] = np.abs(v[s]) + m @ np.abs(v[j] - v[s]) / m.sum()
        inertia = (m * (r**2).sum(1)).sum() * np.eye(3) - r.T @ (m[:, None] * r)
        if np.trace(inertia) > 0:
            held = inertia + float(matching.inertia_floor) * np.trace(inertia) * np.eye(3)
            momentum = m @ np.cross(r, u)
            first = np.linalg.solve(held, momentum)
            spin[s] = first + np.linalg.solve(held, momentum - inertia @ first)
            terms = m @ (np.linalg.norm(r, axis=1) * np.linalg.norm(u, axis=1))
            least = np.linalg.eigvalsh(held)[0]
            spin_scale[s] = terms / least * (1 + np.trace(inertia) / least)
    mean_scale = np.maximum(mean_scale, np.abs(mean))
    return {"region_velocity": (mean, mean_scale), "region_spin": (spin, spin_scale)}


@operation(
    "v_i += (beta/cnt_i) sum_r [v_r + omega_r x (x_i - c_r) - v_i]", paper="standard", adds="acceleration",
    tolerance=8.0, reason="a cross product, a sum and a product", programs=_sums(8.0),
)  # fmt: skip
def damp(
    solid_position, solid_velocity, region, region_count, region_center, region_velocity, region_spin, place, matching,
    timestep, acceleration,
):  # fmt: skip
    """Damping v_i += (beta/cnt_i) sum_r [v_r + omega_r x (x_i - c_r) - v_i] over the kick [m/s^2]."""
    x, v, region = (np.asarray(a) for a in (solid_position, solid_velocity, region))
    x, v = x.astype(float), v.astype(float)
    center, mean, spin = (np.asarray(a, dtype=float) for a in (region_center, region_velocity, region_spin))
    kick = float(timestep[0])
    rows = np.asarray(place)[: len(x)]
    value, scale = (np.zeros(np.asarray(acceleration).shape) for _ in range(2))
    for s in range(len(x)):
        _, r = _members(region, s)
        if region_count[s] and kick > 0:
            share = float(matching.damping) / (region_count[s] * kick)
            arm = x[s] - x[r] - center[r]
            value[rows[s]] = share * (mean[r] + np.cross(spin[r], arm) - v[s]).sum(0)
            arm = np.linalg.norm(arm, axis=1) * np.linalg.norm(spin[r], axis=1)
            scale[rows[s]] = abs(share) * (np.abs(mean[r]) + arm[:, None] + np.abs(v[s])).sum(0)
    return {"acceleration": (value, scale)}
