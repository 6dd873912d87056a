"""Patent P1: closest points of triangles, keys of blocks, signs, and trilinear values of a field."""

import numpy as np

from refsim.sparse_grid.reference import Lookup

CORNERS = np.array([[c & 1, c >> 1 & 1, c >> 2] for c in range(8)])  # of a cell


def dot(a, b):
    """a.b = sum_c a_c b_c of vectors (3, ...), [m^2] for lengths."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def segment_offset(p, a, b):
    """(p - c (3, ...) [m], t) for the closest point c = a + t (b - a), t in [0, 1], of segments."""
    along, w = b - a, p - a
    length = dot(along, along)
    t = np.divide(dot(w, along), length, out=np.zeros(np.broadcast(w[0], length).shape), where=length > 0)
    t = np.clip(t, 0.0, 1.0)
    return w - t * along, t


def face_offset(w, u, v):
    """w - s u - t v (3, ...) [m] of least length, w = p - a; infinite where s, t or 1 - s - t is not > 0."""
    uu, uv, vv, wu, wv = dot(u, u), dot(u, v), dot(v, v), dot(w, u), dot(w, v)
    det = uu * vv - uv * uv
    with np.errstate(invalid="ignore", divide="ignore"):
        s, t = (vv * wu - uv * wv) / det, (uu * wv - uv * wu) / det
        offset = w - s * u - t * v
        ou, ov = dot(offset, u), dot(offset, v)  # 0 but for the rounding of a slender triangle's det
        offset -= (vv * ou - uv * ov) / det * u + (uu * ov - uv * ou) / det * v
    return np.where((det > 0) & (s > 0) & (t > 0) & (s + t < 1), offset, np.inf)


def triangle_offset(p, corner):
    """(p - c (..., 3) [m], feature) for the closest point c = a + s (b - a) + t (c - a) of triangles (..., 3, 3).

    Points and triangles, of equally many axes, are broadcast against each other. Features: 0 face, 1 to 3 edges ab, bc,
    ca, 4 to 6 corners a, b, c.
    """
    a, b, c = np.moveaxis(corner, (-2, -1), (0, 1))
    p = np.moveaxis(p, -1, 0)
    offset = face_offset(p - a, b - a, c - a)
    over, feature = np.isfinite(offset[0]), np.zeros(offset[0].shape, int)
    for k, (start, end) in enumerate(((a, b), (b, c), (c, a))):
        to_edge, place = segment_offset(p, start, end)
        nearer = ~over & (dot(to_edge, to_edge) < dot(offset, offset))
        offset = np.where(nearer, to_edge, offset)
        part = np.where(place <= 0, 4 + k, np.where(place >= 1, 4 + (k + 1) % 3, 1 + k))
        feature = np.where(nearer, part, feature)
    return np.moveaxis(offset, 0, -1), feature


def block_key(block):
    """key = (bz + 2^20) 2^42 + (by + 2^20) 2^21 + bx + 2^20 of blocks (k, 3), dimensionless."""
    x, y, z = (block + 2**20).T
    return (z * 2**21 + y) * 2**21 + x


def inside(offset, n):
    """P1 with E26: phi = -|phi| where (x - c).n < 0 (flag), n the closest feature's angle-weighted pseudonormal."""
    return (offset * n).sum(1) < 0


def enclosed(w):
    """P1 with E26, where that feature is unclear: phi = -|phi| where the winding number w > 1/2 (flag)."""
    return w > 0.5


def side_before(line, known):
    """E26: phi = -band inside and +band outside of the band, the sign of the last node in it before; dimensionless."""
    last = np.maximum.accumulate(np.where(known, np.arange(line.shape[1]), -1), axis=1)
    return np.where((last >= 0) & (np.take_along_axis(line, np.maximum(last, 0), axis=1) < 0), -1, 1)


class Sampled:
    """Distances phi [m] and slopes between the nodes of a narrow band, which are `h` [m] apart.

    At nodes of no block +-band, the side of the last block before in the same row along x.
    """

    def __init__(self, field, h):
        self.h, self.band, self.node = h, float(field.band), Lookup(field)
        self.origin = np.array([field.origin_x, field.origin_y, field.origin_z], dtype=float)
        self.value, self.after = np.asarray(field.distance, dtype=float), np.asarray(field.inside_after) != 0
        self.block = self.node.coordinates[::64] // 4

    def beyond(self, j):
        value = np.full(len(j), self.band)
        for k, (x, y, z) in enumerate(j // 4):
            row = (self.block[:, 1] == y) & (self.block[:, 2] == z) & (self.block[:, 0] < x)
            if row.any():
                last = np.flatnonzero(row)[self.block[row, 0].argmax()]
                value[k] = -self.band if self.after[last] else self.band
        return value

    def nodes(self, j):
        n = self.node(j)
        value = np.append(self.value, 0.0)[n]
        value[n < 0] = self.beyond(j[n < 0])
        return value

    def __call__(self, x, everywhere=False):
        """phi = `trilinear` (n,) [m] and d phi/dx (n, 3) at points (n, 3) [m].

        Where the lowest corner is in no block, phi is +-band, unless values are sought `everywhere`.
        """
        local = (np.asarray(x, dtype=float) - self.origin) / self.h
        j = np.clip(np.floor(np.nan_to_num(local, nan=-(2.0**20))), -(2**20), 2**20).astype(np.int64)
        phi, slope = np.zeros(len(j)), np.zeros((len(j), 3))
        unmarked = (self.node(j) < 0) & (not everywhere)
        phi[unmarked] = self.beyond(j[unmarked])
        corner = [self.nodes(j[~unmarked] + step) for step in CORNERS]
        phi[~unmarked], slope[~unmarked] = trilinear(corner, (local - np.floor(local))[~unmarked], self.h)
        return phi, slope


def trilinear(corner, u, h):
    """phi = sum_c w_c phi_c (n,) [m] at u (n, 3) in cells with values phi_c (8, n), and d phi/dx (n, 3)."""
    phi, slope = np.zeros(len(u)), np.zeros((len(u), 3))
    for step, value in zip(CORNERS, corner, strict=True):
        weight = np.where(step == 1, u, 1 - u)
        phi += weight.prod(1) * value
        for a in range(3):
            slope[:, a] += (2 * step[a] - 1) * np.delete(weight, a, axis=1).prod(1) * value / h
    return phi, slope


def walk(x, near, corners, across, least=np.inf, best=None):
    """|x - c| = min over triangles `near`, then over neighbours as long as one is nearer, for one point x (3,) [m].

    Neighbours share an edge, or the corner c. (x - c (3,) [m], triangle, feature); `best` was at distance `least` [m].
    """
    offset, feature = triangle_offset(x[None], corners[near])
    distance = np.linalg.norm(offset, axis=1)
    k = distance.argmin()
    if not distance[k] < least:
        return best
    t = near[k]
    met = corners[t, feature[k] - 4] if feature[k] >= 4 else np.inf
    near = np.concatenate([across[t], np.flatnonzero((corners == met).all(2).any(1))])
    return walk(x, near, corners, across, distance[k], (offset[k], t, feature[k]))
