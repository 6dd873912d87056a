"""Draw the schematics of the methods: `python scripts/schematics.py [NAME ...]` writes figures/schematics/NAME.

Regions, surfaces, samples and cells come from the formulas and references of refsim.
"""

import itertools
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from refsim import smoothing  # noqa: E402
from refsim.backends.arrays import Backend  # noqa: E402
from refsim.core.effect import Lattice  # noqa: E402
from refsim.isosurface.table import edges, facets  # noqa: E402
from refsim.shape_matching import operations  # noqa: E402
from refsim.shape_matching import reference as matching  # noqa: E402
from refsim.surface_detection import FanScan  # noqa: E402
from refsim.surface_detection import operations as detection  # noqa: E402
from refsim.surface_detection.formulas import in_scan_region  # noqa: E402
from refsim.surface_energy import Tension  # noqa: E402
from refsim.surface_energy.formulas import spline_weight  # noqa: E402
from refsim.surface_energy.reconstruction import Reconstruction  # noqa: E402
from refsim.surface_normal import NormalTerm  # noqa: E402
from refsim.surface_normal import operations as normals  # noqa: E402
from scripts.pictures import command  # noqa: E402
from validation.drawing import BLUE, GREEN, GREY, INTERIOR_BLUE, ORANGE, SKY, SURFACE_RED  # noqa: E402

FOLDER = ROOT / "figures" / "schematics"
PALE = "#dbe6f1"
Array = NDArray[np.float64]


def _bare(axes: Any, title: str) -> None:
    axes.set(aspect="equal", xticks=[], yticks=[])
    axes.set_title(title)
    for side in axes.spines.values():
        side.set_visible(False)


def _wave() -> Array:
    """Positions (n, 2) of a liquid with a curved surface, in layers, slightly disordered; spacing 1."""
    random = np.random.default_rng(3)
    x, depth = np.meshgrid(np.arange(-11, 12), np.arange(9), indexing="ij")
    place = np.stack([x, 1.1 * np.cos(0.4 * x) - depth], axis=-1).reshape(-1, 2)
    return place + random.uniform(-0.1, 0.1, place.shape)


def fan_scan() -> Any:
    """Jiang & Zhu figure 1: the fans of a surface particle and of an interior one, by J(13)."""
    import matplotlib.pyplot as plt
    from matplotlib.patches import Circle

    place = _wave()
    h = 3.0
    group = smoothing.smoothing("wendland_c2", h, 2)
    position = np.column_stack([place, np.zeros(len(place))])
    one = np.ones(len(place))
    normal = normals.color_gradient(position, one, one, None, None, group, NormalTerm(1.0, 0))["surface_normal"].value
    scan = FanScan(radius=h / 2, support_radius=h, smallest_normal=1e-6, printed=0)
    surface = detection.fan_scan(position, normal, None, None, scan, None)["surface"].holds

    top = int(np.argmin(np.hypot(place[:, 0] - 3.0, place[:, 1] - 0.4)))
    deep = int(np.argmin(np.hypot(place[:, 0] + 3.0, place[:, 1] + 1.6)))
    figure, axes = plt.subplots(figsize=(6.4, 4.4))
    x, y = np.meshgrid(np.linspace(-6.8, 7.2, 900), np.linspace(-4.5, 5, 600))
    for i, color in ((top, ORANGE), (deep, GREY)):
        axis = -normal[i, :2] / np.linalg.norm(normal[i])  # outward
        dx, dy = x - place[i, 0], y - place[i, 1]
        squared, along = dx**2 + dy**2, dx * axis[0] + dy * axis[1]
        region = np.zeros(x.shape)
        for at in zip(*np.nonzero(squared < (1.2 * h) ** 2), strict=True):
            region[at] = in_scan_region(squared[at], along[at], scan)
        axes.contourf(x, y, region, [0.5, 1.5], colors=[color], alpha=0.30, zorder=1)
        axes.contour(x, y, region, [0.5], colors=[color], linewidths=1.6, zorder=2)
        axes.add_patch(Circle(tuple(place[i]), h, fill=False, color=color, lw=1.0, ls=(0, (4, 3)), zorder=2))
        arrow = {"arrowstyle": "-|>", "color": "black", "lw": 1.6}
        axes.annotate("", place[i] + 2.0 * axis, place[i], arrowprops=arrow, zorder=6)
    axes.scatter(*place[~surface].T, s=46, color=INTERIOR_BLUE, zorder=3, label="interior")
    axes.scatter(*place[surface].T, s=46, color=SURFACE_RED, zorder=4, label="surface")
    for i in (top, deep):
        axes.scatter(*place[i], s=120, facecolor="none", edgecolor="black", lw=1.8, zorder=5)
    axes.text(place[top, 0] + 0.9, place[top, 1] + 3.3, "empty: surface", color="#9a6a00", va="bottom", ha="center")
    axes.text(place[deep, 0], place[deep, 1] + 3.3, "others inside: interior", color="#444444", ha="center")
    axes.plot([place[top, 0], place[top, 0] + h], [place[top, 1]] * 2, color=ORANGE, lw=1.0, zorder=2)
    axes.text(place[top, 0] + h + 0.15, place[top, 1], "h", style="italic", va="center")
    axes.legend(loc="upper left", handletextpad=0.2)
    axes.set(xlim=(-7.4, 7.6), ylim=(-4.6, 5.0))
    _bare(axes, "A particle is on the surface if no other lies in the fan along its normal")
    return figure


def _drops() -> Array:
    """Positions (n, 3) of liquid in the plane, cells of 1: a large drop that a small one touches."""
    random = np.random.default_rng(5)
    x, y = np.meshgrid(np.arange(-6, 9, 0.5), np.arange(-5, 6, 0.5), indexing="ij")
    place = np.stack([x.ravel(), y.ravel()], axis=1) + random.uniform(-0.09, 0.09, (x.size, 2))
    large = np.hypot(place[:, 0], place[:, 1]) < 3.0
    small = np.hypot(place[:, 0] - 4.6, place[:, 1] - 0.6) < 1.3
    place = place[large | small] + 0.23
    return np.column_stack([place, np.zeros(len(place))])


def _surface() -> tuple[Array, Any]:
    place = _drops()
    tension = Tension(surface_tension=1.0, normals="mls", inset=-1.0)
    return place, Reconstruction(Backend("numpy"), 2, "float64", 1.0, tension).surface(place)


def _grid(axes: Any, lower: Array, upper: Array) -> None:
    for k in range(int(lower[0]), int(upper[0]) + 1):
        axes.plot([k, k], [lower[1], upper[1]], color="#d0d0d0", lw=0.7, zorder=0)
    for k in range(int(lower[1]), int(upper[1]) + 1):
        axes.plot([lower[0], upper[0]], [k, k], color="#d0d0d0", lw=0.7, zorder=0)


def _frame(place: Array) -> tuple[Array, Array]:
    return np.floor(place[:, :2].min(0) - 2), np.ceil(place[:, :2].max(0) + 2)


def level_set() -> Any:
    """Thesis figure 3.1: the union of the spheres around the particles, r = sqrt(2) h in the plane."""
    import matplotlib.pyplot as plt
    from matplotlib.patches import Circle

    place = _drops()
    r = Tension(surface_tension=1.0).radius(2)
    lower, upper = _frame(place)
    x, y = np.meshgrid(np.linspace(lower[0], upper[0], 700), np.linspace(lower[1], upper[1], 700))
    points = np.stack([x, y], axis=-1)
    distance = np.min([np.hypot(*(points - p[:2]).transpose(2, 0, 1)) for p in place], axis=0)
    figure, axes = plt.subplots(figsize=(6.0, 4.6))
    _grid(axes, lower, upper)
    axes.contourf(x, y, distance, [0, r], colors=[PALE], zorder=1)
    contour = axes.contour(x, y, distance, [r], colors=[SURFACE_RED], linewidths=2.2, zorder=4)
    outline = np.concatenate(contour.allsegs[0])
    outer = sorted({int(np.hypot(*(place[:, :2] - point).T).argmin()) for point in outline})
    for centre in place[outer, :2]:
        axes.add_patch(Circle(tuple(centre), r, fill=False, color=SKY, lw=0.8, zorder=2))
    axes.scatter(*place[:, :2].T, s=14, color=BLUE, zorder=5)
    left = place[place[:, 0].argmin(), :2]
    end = left - (r, 0)
    axes.annotate("", end, left, arrowprops={"arrowstyle": "<|-|>", "lw": 1.3, "shrinkA": 0, "shrinkB": 0}, zorder=6)
    axes.text(left[0] - r / 2, left[1] + 0.2, "r", ha="center", va="bottom", size=11, style="italic", zorder=6)
    axes.plot([lower[0] + 0.0, lower[0] + 1], [lower[1]] * 2, color="black", lw=2)
    axes.text(lower[0] + 0.5, lower[1] + 0.15, "h", ha="center", va="bottom", style="italic", size=11)
    axes.set(xlim=(lower[0] - 0.1, upper[0] + 0.1), ylim=(lower[1] - 0.1, upper[1] + 0.1))
    _bare(axes, r"The surface is the outline of spheres of radius $r=\sqrt{2}\,h$")
    return figure


# One state of each class of cells that rotations and exchange of inside and outside map to each other
CASES = (0, 1, 3, 6, 24, 7, 22, 25, 15, 23, 27, 29, 30, 60, 105)


def marching_cases() -> Any:
    """Thesis figure 3.4: the cases of marching cubes with refsim's facets."""
    import matplotlib.pyplot as plt
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    ends = edges(3)
    corner = np.array([[c & 1, c >> 1 & 1, c >> 2] for c in range(8)], float)
    middle = np.array([(corner[c] + corner[c | 1 << a]) / 2 for c, a in ends])
    figure, panels = plt.subplots(3, 5, figsize=(6.6, 4.3), subplot_kw={"projection": "3d"})
    for axes, state in zip(panels.ravel(), CASES, strict=True):
        axes.set_axis_off()
        axes.view_init(elev=12, azim=-25)
        axes.computed_zorder = False
        for c, a in ends:
            axes.plot(*np.stack([corner[c], corner[c | 1 << a]]).T, color="#999999", lw=0.8)
        triangles = [middle[list(facet)] for facet in facets(state, 3)]
        if triangles:
            axes.add_collection3d(Poly3DCollection(triangles, facecolor=SKY, edgecolor=BLUE, lw=0.6, alpha=0.85))
        inside = [c for c in range(8) if state >> c & 1]
        axes.scatter(*corner[inside].T, s=26, color=SURFACE_RED, depthshade=False, zorder=9)
        axes.set(xlim=(0, 1), ylim=(0, 1), zlim=(0, 1), box_aspect=(1, 1, 1))
        axes.set_proj_type("ortho")
    title = f"Marching cubes cuts a cell in {len(CASES)} ways (red: corners inside the liquid)"
    figure.suptitle(title, weight="bold", size=10.5)
    return figure


def surface_samples() -> Any:
    """Thesis figures 3.2 and 4.2: the mesh on the grid, its samples and their normals."""
    import matplotlib.pyplot as plt

    place, surface = _surface()
    lower, upper = _frame(place)
    figure, axes = plt.subplots(figsize=(6.0, 4.6))
    _grid(axes, lower, upper)
    ticks = (np.arange(a, b + 1) for a, b in zip(lower, upper))
    nodes = np.stack(np.meshgrid(*ticks, indexing="ij"), -1).reshape(-1, 2)
    r = Tension(surface_tension=1.0).radius(2)
    inside = np.array([(np.hypot(*(place[:, :2] - n).T) < r).any() for n in nodes])
    axes.scatter(*nodes[inside].T, s=16, marker="s", color=ORANGE, zorder=2, label="node within r of a particle")
    vertices = np.asarray(surface.mesh.vertices)[:, :2]
    for facet in np.asarray(surface.mesh.facets):
        axes.plot(*vertices[facet].T, color=SURFACE_RED, lw=2.0, zorder=3)
    at, normal = surface.samples.position[:, :2], surface.samples.normal[:, :2]
    axes.scatter(*place[:, :2].T, s=9, color="#9db8d6", zorder=1, label="particle")
    axes.scatter(*at.T, s=22, color=GREEN, zorder=5, label="sample of the surface, with its normal")
    axes.quiver(*at.T, *normal.T, color=GREEN, scale=1.2, scale_units="xy", angles="xy", width=0.004, zorder=4)
    axes.set(xlim=(lower[0] - 0.1, upper[0] + 0.1), ylim=(lower[1] - 1.6, upper[1] + 0.1))
    axes.legend(loc="lower center", ncol=3, handletextpad=0.1, columnspacing=0.9, fontsize=8)
    _bare(axes, "Each segment of the surface has a sample with a fitted normal")
    return figure


def cut_body(side: tuple[int, int, int], melted: set[tuple[int, int]]) -> tuple[Array, Any, Any, Any]:
    """(cells (S, 3), direct neighbours (S, 27), regions (S, 125), phases (S,)) of a block without melted columns."""
    cell = np.array(list(itertools.product(*map(range, side))))
    phase = np.array([matching.FLUID if (a, b) in melted else matching.SURFACE for a, b, _ in cell.tolist()])
    grid = Lattice(cell.astype(np.int32), np.arange(len(cell)), np.zeros(len(cell), np.int32), np.array([0, len(cell)]))
    row = np.arange(len(cell))
    direct = operations.direct_neighbours(phase, row, grid)["direct"][0]
    count = np.zeros(len(cell), int)
    empty = np.full((len(cell), 125), matching.EMPTY)
    region = operations.regions(direct, None, grid, empty, count)["region"][0]
    return cell, direct, region, operations.classify(row, direct, grid, phase)["phase"][0]


def regions() -> Any:
    """Shao & Song figure 1: direct neighbours, surface and interior, and a region before and after melting."""
    import matplotlib.pyplot as plt

    side, level, node = (9, 7, 7), 3, (4, 3)
    slit = {(5, b) for b in range(1, 7)}
    figure, panels = plt.subplots(1, 2, figsize=(7.4, 3.6))
    for axes, melted, title in ((panels[0], set(), "before"), (panels[1], slit, "after a slit has melted")):
        cell, direct, region, phase = cut_body(side, melted)
        shown = [s for s in range(len(cell)) if cell[s, 2] == level]
        solid = [s for s in shown if phase[s] != matching.FLUID]
        for link in ([s, j] for s in solid for j in direct[s] if j > s and cell[j, 2] == level):
            axes.plot(*cell[link, :2].T, color="#b8b8b8", lw=0.8, zorder=1)
        here = next(s for s in shown if tuple(cell[s, :2]) == node)
        members = [j for j in region[here] if j != matching.EMPTY and cell[j, 2] == level]
        axes.scatter(*cell[members, :2].T, s=330, color="#fbd9a0", zorder=0, label="region of the marked particle")
        kinds = ((matching.SURFACE, SURFACE_RED, "surface"), (matching.INTERIOR, INTERIOR_BLUE, "interior"))
        for kind, color, what in kinds:
            rows = [s for s in shown if phase[s] == kind]
            axes.scatter(*cell[rows, :2].T, s=60, color=color, zorder=3, label=what)
        rows = [s for s in shown if phase[s] == matching.FLUID]
        axes.scatter(*cell[rows, :2].T, s=60, facecolor="white", edgecolor=SKY, lw=1.4, zorder=3, label="liquid")
        axes.scatter(*node, s=150, facecolor="none", edgecolor="black", lw=1.8, zorder=4)
        axes.set(xlim=(-0.7, side[0] - 0.3), ylim=(-0.7, side[1] - 0.3))
        _bare(axes, "")
        axes.set_title(title, loc="center", weight="normal")
    handles, labels = panels[1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncol=4, markerscale=0.8)
    figure.suptitle("A region reaches two links far, and no link crosses what has melted", weight="bold", size=10.5)
    return figure


def spline_nodes() -> Any:
    """Thesis figure 3.6: the nodes whose B-splines reach a point, counted from the lower left one."""
    import matplotlib.pyplot as plt
    from matplotlib.patches import Rectangle

    point = np.array([2.1, 1.95])
    first = np.floor(point - 0.5)
    figure, axes = plt.subplots(figsize=(4.8, 4.0))
    _grid(axes, np.zeros(2), np.array([5.0, 4.0]))
    nodes = np.stack(np.meshgrid(np.arange(6), np.arange(5), indexing="ij"), -1).reshape(-1, 2)
    near = ((nodes >= first) & (nodes <= first + 2)).all(1)
    axes.scatter(*nodes[~near].T, s=40, marker="s", facecolor="white", edgecolor=GREY, zorder=2)
    for node in nodes[near]:
        weight = np.prod([spline_weight(p - j, int(n - j)) for p, j, n in zip(point, first, node)])
        axes.scatter(*node, s=70, marker="s", color=BLUE, zorder=3)
        axes.text(node[0] + 0.1, node[1] + 0.1, f"{weight:.2f}", size=10, color=BLUE, zorder=4)
    axes.add_patch(Rectangle(tuple(point - 1.5), 3, 3, fc=PALE, ec=INTERIOR_BLUE, ls="--", lw=1.2, zorder=0))
    axes.scatter(*point, s=60, color=SURFACE_RED, zorder=5)
    axes.text(point[0] + 0.1, point[1] - 0.12, r"$x$", size=14, color=SURFACE_RED, va="top")
    axes.text(first[0] - 0.1, first[1] - 0.12, r"$x_{i_0j_0}$", size=13, ha="right", va="top")
    axes.set(xlim=(-0.3, 5.3), ylim=(-0.3, 4.3))
    _bare(axes, r"Nine nodes reach $x$; their weights $B_iB_j$ add up to 1")
    return figure


DRAWINGS = (fan_scan, level_set, marching_cases, surface_samples, regions, spline_nodes)
SCHEMATICS: dict[str, Callable[[], Any]] = {f"{drawing.__name__}.png": drawing for drawing in DRAWINGS}


if __name__ == "__main__":
    sys.exit(command(__doc__, SCHEMATICS, FOLDER))
