"""How round, how evenly filled and how smooth a drop of particles is.

All measures refer to the centre of mass of equal particles and are independent of the unit of length, except
where a unit is named.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter
from scipy.spatial import cKDTree
from scipy.special import erfinv

from validation.metrics.shapes import lattice_ball, lattice_cube


class RadiusVariationScale(NamedTuple):
    """``radius_variation`` of the two shapes a value is read against: lattice cube and lattice ball."""

    cube: float
    ball: float


def fibonacci_directions(count: int = 200) -> NDArray[np.float64]:
    """Unit vectors (count, 3), evenly spread: z = 1 - 2 (i + 1/2) / count, azimuth (i + 1/2) pi (1 + sqrt 5).

    Source: the golden spiral lattice, Gonzalez 2010, Math. Geosci. 42:49.
    """
    step = np.arange(count) + 0.5
    z = 1.0 - 2.0 * step / count
    azimuth = np.pi * (1.0 + np.sqrt(5.0)) * step
    ring = np.sqrt(1.0 - z * z)
    return np.stack((ring * np.cos(azimuth), ring * np.sin(azimuth), z), axis=1)


def radius_variation(position: ArrayLike, *, directions: int = 200, cone: float = 10.0) -> float:
    """Roughness of a drop: std/mean over Fibonacci directions of the greatest |x - c| in a cone about each.

    position: (n, 3) [m]; c is the centre of mass. directions: how many. cone: half opening [degrees].
    Returns the dimensionless ratio, or NaN when some cone holds no particle (too few particles, or a torn
    drop). Read it against ``radius_variation_scale``: the lattice leaves 0.0094 in a ball of 4,913 particles.
    The directions are fixed in space, so a rotated drop differs by a few per cent of the value.
    """
    offset = _centred(position)
    radius = np.linalg.norm(offset, axis=1)
    axis = fibonacci_directions(directions)
    bound = np.cos(np.radians(cone))
    outermost = np.full(directions, -np.inf)
    for begin in range(0, len(offset), 20_000):
        part = slice(begin, begin + 20_000)
        within = offset[part] @ axis.T > bound * radius[part, None]
        outermost = np.maximum(outermost, np.where(within, radius[part, None], -np.inf).max(axis=0))
    if not np.isfinite(outermost).all():
        return float("nan")
    return float(outermost.std() / outermost.mean())


def radius_variation_scale(count: int) -> RadiusVariationScale:
    """``radius_variation`` of the lattice cube of about ``count`` particles and of a lattice ball of count.

    0.148 and 0.0094 for 4,913.
    """
    side = max(1, round(count ** (1.0 / 3.0)))
    return RadiusVariationScale(radius_variation(lattice_cube(side)), radius_variation(lattice_ball(count)))


def nearest_neighbour_distance(position: ArrayLike) -> NDArray[np.float64]:
    """Distance (n,) [m] of every particle of position (n, dim) [m] to the nearest other one.

    A single particle has inf.
    """
    points = np.asarray(position, dtype=np.float64)
    return cKDTree(points).query(points, k=[2])[0][:, 0] if len(points) else np.zeros(0)


def cubic_moment(position: ArrayLike, axes: ArrayLike | None = None) -> float:
    """q4 = <x^4 + y^4 + z^4 - 3/5 r^4> / <r^4>: cube -0.127, ball 0, octahedron above 0.

    It shows the n = 4 oscillation of a cube that becomes a drop.
    position: (n, 3) [m]. axes: (3, 3), columns are the axes x, y, z to refer to; the coordinate axes when
    left out.
    """
    offset = _centred(position)
    if axes is not None:
        offset = offset @ np.asarray(axes, dtype=np.float64)
    offset = offset / np.abs(offset).max()
    fourth = np.sum(offset**2, axis=1) ** 2
    return float((np.sum(offset**4, axis=1) - 0.6 * fourth).mean() / fourth.mean())


def inertia_anisotropy(position: ArrayLike) -> float:
    """(largest - least) / mean eigenvalue of the second moments <x_a x_b> of position (n, 3) [m].

    0 for cube and ball; 3 (a^2 - c^2) / (a^2 + b^2 + c^2) for a box of sides a >= b >= c. Independent of
    rotation.
    """
    offset = _centred(position)
    offset = offset / np.abs(offset).max()
    moment = np.linalg.eigvalsh(offset.T @ offset)
    return float((moment[-1] - moment[0]) / moment.mean())


def surface_mesh(
    position: ArrayLike, spacing: float, *, smoothing: float = 1.0, cell: float = 0.5, level: float = 0.5,
    max_nodes: int = 16_000_000,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:  # fmt: skip
    """Smooth closed surface of a particle liquid: vertices (v, 3) [m], faces (f, 3) with outward normals.

    The particles' volume fraction, smoothed by a Gaussian, is ``level`` on the surface. Before contouring,
    the fraction F is turned into the distance sqrt(2) s erfinv(2 F - 1) that a flat surface with this
    fraction has: it is nearly linear where marching cubes interpolates, so neither the grid nor the particles
    leave facets. The Gaussian damps the lattice by exp(-2 pi^2 smoothing^2) and shifts a surface of mean
    curvature 1/R inwards by about (smoothing spacing)^2 / R.

    position: (n, 3) [m]. spacing: particle spacing d [m]; a particle fills d^3.
    smoothing: standard deviation of the Gaussian / d. cell: grid cell / d.
    level: volume fraction on the surface, 0 to 1. max_nodes: largest grid allowed.
    A feature thinner than about 1.3 d (a single particle, a filament) stays below the level: no surface.
    Raises ValueError for no surface at this level, or a grid beyond ``max_nodes`` (a particle flung far away: leave it
    out).
    Source: Mueller et al. 2003 (colour field).
    """
    points = np.asarray(position, dtype=np.float64)
    edge = cell * spacing
    margin = int(np.ceil(4.0 * smoothing / cell)) + 2
    low = points.min(axis=0)
    shape = np.floor((points.max(axis=0) - low) / edge) + 2 * margin + 2
    if np.prod(shape) > max_nodes:
        raise ValueError(
            f"the grid would need {np.prod(shape):.3g} nodes, more than {max_nodes}: is a particle far away?"
        )
    origin = low - margin * edge

    # A quadratic B-spline spreads every particle with the same variance (1/4 cell^2) wherever it lies in its
    # cell, so the grid leaves no trace in the Gaussian's width.
    fraction = _deposit((points - origin) / edge, tuple(int(nodes) for nodes in shape)) / cell**3
    width = np.sqrt((smoothing / cell) ** 2 - 0.25)
    fraction = gaussian_filter(fraction, width, mode="constant", truncate=5.0)
    distance = smoothing * np.sqrt(2.0) * erfinv(np.clip(2.0 * fraction - 1.0, -0.9999, 0.9999))
    height = smoothing * np.sqrt(2.0) * erfinv(2.0 * level - 1.0)
    if not distance.max() > height:
        raise ValueError("no surface: nowhere does the smoothed volume fraction reach the level")
    vertices, faces = contour(height - distance)
    return vertices * edge + origin, faces


def contour(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Mesh of the surface on which values at the nodes (nx, ny, nz) of a grid are 0; values inside are below it.

    vertices (v, 3) in grid cells, faces (f, 3) with outward normals. Without a zero there are none.
    """
    from refsim import isosurface
    from refsim.backends.arrays import Backend

    inside = values < 0
    nodes = np.argwhere(maximum_filter(inside, 3) != minimum_filter(inside, 3))  # of the cells that the surface crosses
    if not len(nodes):
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    mesh = isosurface.extract(Backend("cpu"), nodes, values[tuple(nodes.T)], 1.0, 3)
    return np.asarray(mesh.vertices), np.asarray(mesh.facets).astype(np.int64)


def mesh_area(vertices: ArrayLike, faces: ArrayLike) -> float:
    """Area [m^2] of a triangle mesh, vertices (v, 3) [m], faces (f, 3)."""
    a, b, c = np.asarray(vertices, dtype=np.float64)[np.asarray(faces)].swapaxes(0, 1)
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def mesh_volume(vertices: ArrayLike, faces: ArrayLike) -> float:
    """Volume [m^3] inside a closed triangle mesh, positive when the normals point outwards.

    vertices (v, 3) [m], faces (f, 3). By the divergence theorem.
    Raises ValueError when the mesh is open or its faces are wound unevenly.
    """
    a, b, c = np.asarray(vertices, dtype=np.float64)[np.asarray(faces)].swapaxes(0, 1)
    face = np.asarray(faces)
    count = int(face.max()) + 1 if face.size else 0
    tail, head = face.ravel(), np.roll(face, -1, axis=1).ravel()
    if not np.array_equal(np.sort(tail * count + head), np.sort(head * count + tail)):
        raise ValueError("the mesh is not closed: some edge is not met by an opposite one")
    middle = np.asarray(vertices, dtype=np.float64).mean(axis=0) if len(face) else 0.0
    return float(np.einsum("ij,ij->", a - middle, np.cross(b - middle, c - middle)) / 6.0)


def sphericity(vertices: ArrayLike, faces: ArrayLike) -> float:
    """Wadell's sphericity pi^(1/3) (6 V)^(2/3) / A of one closed mesh: 1 for a sphere, 0.806 for a cube.

    vertices (v, 3) [m], faces (f, 3) wound outwards.
    Raises ValueError for an open mesh, or one turned inside out.
    Source: Wadell 1935, J. Geol. 43:250.
    """
    volume = mesh_volume(vertices, faces)
    if not volume > 0:
        raise ValueError(f"the mesh encloses no positive volume: {volume}")
    return float(np.pi ** (1.0 / 3.0) * (6.0 * volume) ** (2.0 / 3.0) / mesh_area(vertices, faces))


def _centred(position: ArrayLike) -> NDArray[np.float64]:
    points = np.asarray(position, dtype=np.float64)
    return points - points.mean(axis=0)


def _deposit(site: NDArray[np.float64], shape: tuple[int, int, int]) -> NDArray[np.float64]:
    """Particles per cell on the nodes of a grid, by quadratic B-splines; site (n, 3) in cells from node 0."""
    base = np.rint(site).astype(np.int64)
    rest = site - base
    weight = np.stack((0.5 * (0.5 - rest) ** 2, 0.75 - rest**2, 0.5 * (0.5 + rest) ** 2))
    total = np.zeros(int(np.prod(shape)))
    for i, j, k in np.ndindex(3, 3, 3):
        node = np.ravel_multi_index((base + (i - 1, j - 1, k - 1)).T, shape)
        np.add.at(total, node, weight[i, :, 0] * weight[j, :, 1] * weight[k, :, 2])
    return total.reshape(shape)


def rayleigh_period(tension: float, radius: float, density: float, mode: int = 4) -> float:
    """Of a drop's mode [s]: omega^2 = n(n-1)(n+2) sigma/(rho0 R^3), without viscosity."""
    return 2 * math.pi / math.sqrt(mode * (mode - 1) * (mode + 2) * tension / (density * radius**3))


def oscillation(time: NDArray, moment: NDArray) -> dict[str, float]:
    """Period and decay of the cubic moment from its first maximum on, by a fit of a damped cosine.

    period  [s]; free: the same without the fitted damping; decay [1/s]; misfit: rms over the first amplitude.
    NaN where there is no maximum, or no two half-swings after it.
    """
    from scipy.optimize import curve_fit

    none = dict.fromkeys(("period", "free", "decay", "misfit"), math.nan)
    turns = [k for k in range(1, len(moment) - 1) if (moment[k] - moment[k - 1]) * (moment[k + 1] - moment[k]) < 0]
    tops = [k for k in turns if moment[k] > 0]
    if not tops or len([k for k in turns if k > tops[0]]) < 2:
        return none
    later = [k for k in turns if k > tops[0]]
    guess = 2 * (time[later[0]] - time[tops[0]])
    window = (time >= time[tops[0]]) & (time <= time[tops[0]] + 2.5 * guess)
    t, q = time[window] - time[tops[0]], moment[window]

    def swing(t: NDArray, a: float, decay: float, omega: float, phase: float, rest: float) -> NDArray:
        return a * np.exp(-decay * t) * np.cos(omega * t + phase) + rest

    try:
        (a, decay, omega, *_), _ = fit = curve_fit(swing, t, q, (q[0], 1 / guess, 2 * math.pi / guess, 0.0, 0.0))
    except RuntimeError:
        return none
    misfit = float(np.sqrt(((swing(t, *fit[0]) - q) ** 2).mean()) / abs(a))
    omega = abs(omega)
    free = 2 * math.pi / math.sqrt(omega**2 + decay**2)
    return {"period": 2 * math.pi / omega, "free": free, "decay": float(decay), "misfit": misfit}


def roundness(position: ArrayLike, spacing: float) -> float:
    """Sphericity of the surface of a drop of particles; NaN where there is no one closed surface."""
    try:
        return sphericity(*surface_mesh(np.asarray(position, dtype=float), spacing))
    except ValueError:  # torn apart
        return math.nan


def reach(away: NDArray, axes: int) -> float:
    """How far the drop reaches along the lattice's axes (1) or its body diagonals (3): mean over all of them [m]."""
    grid = np.array(np.meshgrid(*[(-1, 0, 1)] * 3)).reshape(3, -1).T
    directions = grid[np.abs(grid).sum(1) == axes] / math.sqrt(axes)
    near = away @ directions.T
    across = np.linalg.norm(away[:, None, :] - near[..., None] * directions[None], axis=2)
    width = 0.15 * np.abs(away).max()
    return float(np.where(across < width, near, -np.inf).max(0).mean())


NEAR = 1.6  # radii about the middle: particles beyond are not of the drop


def surface(position: NDArray, spacing: float, radius: float) -> dict[str, Any]:
    """What the surface of a drop is like.

    area    over that of a ball of the same volume (NaN where there is no one closed surface)
    gap     distance from a place on the surface to the nearest particle, 99th percentile, in spacings
    thrown  particles that have left the drop
    """
    x = position.astype(float)
    x = x - np.median(x, axis=0)
    near = np.linalg.norm(x, axis=1) <= NEAR * radius
    drop = x[near]
    measures = {"area": float("nan"), "gap": float("nan"), "thrown": int((~near).sum())}
    try:
        vertices, faces = surface_mesh(drop, spacing)
        measures["area"] = 1 / sphericity(vertices, faces)
        measures["gap"] = float(np.quantile(cKDTree(drop).query(vertices)[0], 0.99) / spacing)
    except ValueError:  # torn apart
        pass
    return measures


def near_of(position: NDArray) -> float:
    """Nearest neighbour, 5th percentile [d]."""
    return float(np.quantile(nearest_neighbour_distance(position), 0.05))


def lost(position: np.ndarray, force: np.ndarray) -> dict[str, float]:
    """Sum of the forces over the sum of |f|, and of the torques over the sum of |x| |f|; position, force (n, 3)."""
    length, torque = np.linalg.norm(force, axis=1), np.cross(position, force)
    return {
        "linear": float(np.linalg.norm(force.sum(0)) / length.sum()),
        "angular": float(np.linalg.norm(torque.sum(0)) / (np.linalg.norm(position, axis=1) * length).sum()),
    }


def left_over(position: NDArray, force: NDArray) -> dict[str, float]:
    """Sum of the forces and of their torques, each over the sum of the moduli; position, force (n, 3)."""
    torque = np.cross(position, force)
    return {
        name: float(np.linalg.norm(each.sum(0)) / np.linalg.norm(each, axis=1).sum())
        for name, each in (("linear", force), ("angular", torque))
    }
