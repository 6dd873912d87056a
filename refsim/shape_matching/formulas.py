"""Scalar formulas of lattice shape matching: Shao & Song 2017, section 2, after Rivers & James 2007.

A slot of a node's table stands for the lattice cell at an offset from the node's own: direct neighbours at
(a + 1) 9 + (b + 1) 3 + (e + 1), members of a region of half-width w at (a + w) n^2 + (b + w) n + (e + w), n = 2 w + 1.
"""

import math

from refsim.backends.compile import formula
from refsim.backends.tuples import added, cross, difference, dot, outer, over, scaled, symmetric, times

PRECISION = 1e-17  # of the eigensolver of `best_rotation` in float64


@formula
def slot_offset(slot, half_width):
    """(a, b, e): offset [cells] of a slot, slot = (a + w) n^2 + (b + w) n + (e + w)."""
    n = 2 * half_width + 1
    return slot // (n * n) - half_width, slot // n % n - half_width, slot % n - half_width


@formula
def match_term(share, x, g):
    """Terms of a region's sums, m = m_k/cnt_k [kg]: m, m x, m g and m x g^T, x [m] and g [cells] from its node."""
    moment = scaled(x, share)
    return share, *moment, *scaled(g, share), *outer(moment, g)


@formula
def motion_term(share, r, u):
    """Terms of P = sum m v, L = sum m r x v and sum m r r^T (xx, xy, xz, yy, yz, zz), r [m] from the center."""
    momentum, (xx, xy, xz, _, yy, yz, _, _, zz) = scaled(u, share), outer(scaled(r, share), r)
    return *momentum, *cross(r, momentum), xx, xy, xz, yy, yz, zz


@formula
def goal_term(rotation, anchor, g, spacing):
    """Where a region takes a member, from node r [m]: goal = R (x0_i - x0_r) + [R (x0_r - c0_r) + c_r - x_r].

    The bracket is the anchor; g = x0_r - x0_i in cells.
    """
    return added((anchor[0], anchor[1], anchor[2]), turned(rotation, scaled(g, -spacing)))


@formula
def rigid_term(velocity, spin, r):
    """Velocity of a region's rigid motion [m/s]: v = v_c + omega x r, r [m] from its center."""
    return (
        velocity[0] + spin[1] * r[2] - spin[2] * r[1],
        velocity[1] + spin[2] * r[0] - spin[0] * r[2],
        velocity[2] + spin[0] * r[1] - spin[1] * r[0],
    )


@formula
def turned(q, v):
    """R(q) v [unit of the vector] for the quaternion q = (w, i, j, k): v + 2 u x (u x v + w v)."""
    x, y, z = v
    real = type(x)
    tx, ty, tz = real(2) * (q[2] * z - q[3] * y), real(2) * (q[3] * x - q[1] * z), real(2) * (q[1] * y - q[2] * x)
    return (
        x + q[0] * tx + q[2] * tz - q[3] * ty,
        y + q[0] * ty + q[3] * tx - q[1] * tz,
        z + q[0] * tz + q[1] * ty - q[2] * tx,
    )


@formula
def davenport(a, matrix):
    """Davenport's symmetric K(A): q^T K q = tr(R(q)^T A); dimensionless, A after its largest entry."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = a
    matrix[0, 0], matrix[0, 1], matrix[0, 2], matrix[0, 3] = xx + yy + zz, zy - yz, xz - zx, yx - xy
    matrix[1, 1], matrix[1, 2], matrix[1, 3] = xx - yy - zz, xy + yx, xz + zx
    matrix[2, 2], matrix[2, 3] = yy - xx - zz, yz + zy
    matrix[3, 3] = zz - xx - yy
    for p in range(4):
        for q in range(p):
            matrix[p, q] = matrix[q, p]


@formula
def diagonalised(matrix, basis, precision):
    """Cyclic Jacobi, at most 8 sweeps: matrix <- B^T matrix B, basis <- basis B; dimensionless.

    Stops where the next sweep, which squares what stands beside the diagonal, changes no digit. Returns the place of
    the largest eigenvalue.
    """
    real = matrix.dtype.type
    for _ in range(8):
        beside, whole = real(0), real(0)
        for p in range(4):
            for q in range(4):
                square = matrix[p, q] * matrix[p, q]
                whole += square
                if p != q:
                    beside += square
        if not beside > precision * precision * whole:
            break
        for p in range(3):
            for q in range(p + 1, 4):
                if matrix[p, q] != real(0):
                    apart, twice = matrix[q, q] - matrix[p, p], real(2) * matrix[p, q]
                    t = twice / (abs(apart) + math.sqrt(apart * apart + twice * twice))
                    if apart < real(0):
                        t = -t
                    c = real(1) / math.sqrt(real(1) + t * t)
                    s = t * c
                    for k in range(4):
                        first, second = matrix[k, p], matrix[k, q]
                        matrix[k, p], matrix[k, q] = c * first - s * second, s * first + c * second
                    for k in range(4):
                        first, second = matrix[p, k], matrix[q, k]
                        matrix[p, k], matrix[q, k] = c * first - s * second, s * first + c * second
                        first, second = basis[k, p], basis[k, q]
                        basis[k, p], basis[k, q] = c * first - s * second, s * first + c * second
                    matrix[p, q] = real(0)
                    matrix[q, p] = real(0)
    best = 0
    for k in range(1, 4):
        if matrix[k, k] > matrix[best, best]:
            best = k
    return best


@formula
def nearby_rotation(first, second, third, before, precision):
    """The best rotation by Newton's steps from the one before: (whether it is near and determined, q); dimensionless.

    first, second, third: columns of A after its largest entry. With B = R^T A and S = (B + B^T)/2 a turn w brings
    tr(R^T A) g . w - w . H w/2, H = tr(S) 1 - S. Where H is positive definite and g = 0 no proper rotation is better.
    """
    real = type(first[0])
    least = real(0.05)  # pivot of H below which the rotation counts as undetermined
    q = (before[0], before[1], before[2], before[3])
    converged = False
    for _ in range(8):
        one = turned(q, (real(1), real(0), real(0)))
        two = turned(q, (real(0), real(1), real(0)))
        three = turned(q, (real(0), real(0), real(1)))
        xx, yy, zz = dot(one, first), dot(two, second), dot(three, third)
        xy, yx, xz, zx = dot(one, second), dot(two, first), dot(one, third), dot(three, first)
        yz, zy = dot(two, third), dot(three, second)
        a, b, c = -real(0.5) * (xy + yx), -real(0.5) * (xz + zx), -real(0.5) * (yz + zy)
        pivot = yy + zz
        if not pivot > least:
            break
        over = real(1) / pivot
        second_pivot, beside = xx + zz - a * a * over, c - a * b * over
        if not second_pivot > least:
            break
        below = real(1) / second_pivot
        third_pivot = xx + yy - b * b * over - beside * beside * below
        if not third_pivot > least:
            break
        g1, g2, g3 = zy - yz, xz - zx, yx - xy
        g2 -= a * over * g1
        g3 -= b * over * g1 + beside * below * g2
        w3 = g3 / third_pivot
        w2 = below * (g2 - beside * w3)
        w1 = over * (g1 - a * w2 - b * w3)
        size = w1 * w1 + w2 * w2 + w3 * w3
        if not size < real(0.25):
            break
        shrink = real(1) / math.sqrt(real(1) + real(0.25) * size)
        half = real(0.5)
        w1, w2, w3 = half * w1, half * w2, half * w3
        w, i, j, k = q
        q = (
            shrink * (w - i * w1 - j * w2 - k * w3),
            shrink * (i + w * w1 + j * w3 - k * w2),
            shrink * (j + w * w2 + k * w1 - i * w3),
            shrink * (k + w * w3 + i * w2 - j * w1),
        )
        if size < real(2) * precision:  # the next step would be smaller than any digit
            converged = True
            break
    if converged:
        size = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
        q = (q[0] / size, q[1] / size, q[2] / size, q[3] / size)
    return converged, q


@formula
def centred(moments):
    """A = sum m x g^T - (sum m x)(sum m g)^T/M after its largest entry, row by row, and that entry [kg m]; 0 for none.

    moments: m, m x, m g, m x g^T summed over a region.
    """
    a = difference(moments[7:16], over(outer(moments[1:4], moments[4:7]), moments[0]))
    xx, xy, xz, yx, yy, yz, zx, zy, zz = a
    most = max(max(max(abs(xx), abs(xy)), max(abs(xz), abs(yx))), max(max(abs(yy), abs(yz)), max(abs(zx), abs(zy))))
    most = max(most, abs(zz))
    zero = type(most)(0)
    return (over(a, most), most) if most > zero else (a, zero)


@formula
def quick_rotation(moments, before, least, precision):
    """q = argmax tr(R(q)^T A) [dimensionless], and whether it is near the one before and max|A| > least [kg m]."""
    near, best = True, (before[0], before[1], before[2], before[3])
    if moments[0] > type(moments[0])(0):
        a, most = centred(moments)
        near = False
        if most > least:
            near, q = nearby_rotation((a[0], a[3], a[6]), (a[1], a[4], a[7]), (a[2], a[5], a[8]), before, precision)
            if near:
                best = q
    return near, best


@formula
def best_rotation(moments, before, floor, lost, precision, matrix, basis):
    """q = argmax tr(R(q)^T A) [dimensionless], A = sum m x g^T - (sum m x)(sum m g)^T/M; `before` where max|A| <= lost.

    The largest eigenvector of K(A/max|A|) + f p p^T, p first the rotation before and then the answer so far: an
    undetermined twist stays what it was, and a determined one is not held back. `lost` [kg m] is what rounding may make
    of an entry of A; f = 16 lost/max|A| where that is more than `floor`: an entry of K has up to four such errors.
    """
    real = type(moments[0])
    best = (before[0], before[1], before[2], before[3])
    a, most = centred(moments)
    if most > lost:
        weight = max(floor, real(16) * lost / most)
        davenport(a, matrix)
        for p in range(4):
            for q in range(4):
                matrix[p, q] += weight * before[p] * before[q]
                basis[p, q] = real(p == q)
        top = diagonalised(matrix, basis, precision)
        for p in range(4):  # p of the previous rotation is replaced by the answer, in the answer's basis
            along_p = basis_part(basis, p, before)
            for q in range(4):
                matrix[p, q] -= weight * along_p * basis_part(basis, q, before)
        matrix[top, top] += weight
        top = diagonalised(matrix, basis, precision)
        w, i, j, k = basis[0, top], basis[1, top], basis[2, top], basis[3, top]
        size = math.sqrt(w * w + i * i + j * j + k * k)
        if w * before[0] + i * before[1] + j * before[2] + k * before[3] < real(0):
            size = -size
        best = (w / size, i / size, j / size, k / size)
    return best


@formula
def basis_part(basis, column, q):
    """p = b . q of a basis' column and a quaternion; dimensionless."""
    return basis[0, column] * q[0] + basis[1, column] * q[1] + basis[2, column] * q[2] + basis[3, column] * q[3]


@formula
def rigid_motion(mass, sums, floor):
    """Rigid motion of a region: v_c = sum m v/M [m/s] and omega = I^-1 L [1/s], I += floor tr(I) 1, 0 where tr(I) = 0.

    I = sum m (r^2 1 - r r^T) [kg m^2], L = sum m r x v [kg m^2/s]; solved once more for the residual L - I omega, so
    that the floor holds back nothing that is determined.
    """
    real = type(mass)
    v, (xx, xy, xz, yy, yz, zz) = over(sums[0:3], mass), sums[6:12]
    spin = (real(0), real(0), real(0))
    trace = real(2) * (xx + yy + zz)
    if trace > real(0):
        inertia, momentum = over((yy + zz, -xy, -xz, xx + zz, -yz, xx + yy), trace), over(sums[3:6], trace)
        first = solved(inertia, momentum, floor)
        spin = added(first, solved(inertia, difference(momentum, times(symmetric(inertia), first)), floor))
    return v, spin


@formula
def solved(a, b, floor):
    """x of (a + floor 1) x = b by Cholesky's a = G G^T, a = (xx, xy, xz, yy, yz, zz); dimensionless matrix."""
    xx, yy, zz = a[0] + floor, a[3] + floor, a[5] + floor
    g11 = math.sqrt(xx)
    g21, g31 = a[1] / g11, a[2] / g11
    g22 = math.sqrt(max(yy - g21 * g21, floor))
    g32 = (a[4] - g21 * g31) / g22
    g33 = math.sqrt(max(zz - g31 * g31 - g32 * g32, floor))
    y1 = b[0] / g11
    y2 = (b[1] - g21 * y1) / g22
    y3 = (b[2] - g31 * y1 - g32 * y2) / g33
    x3 = y3 / g33
    x2 = (y2 - g32 * x3) / g22
    x1 = (y1 - g21 * x2 - g31 * x3) / g11
    return x1, x2, x3


@formula
def pull(displacement, stiffness, timestep):
    """a = alpha (g - x)/(t dt) [m/s^2], so that the kick t = (dt_before + dt)/2 brings v += alpha (g - x)/dt."""
    return stiffness * displacement / (timestep[0] * timestep[1])
