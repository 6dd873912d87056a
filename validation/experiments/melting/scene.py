"""Scenes of Shao & Song 2017, figures 4 to 6, with the printed values; what the paper leaves open is chosen here.

The print gives conductivities of 10 to 70 under the figures and of 0.1 to 0.8 in table 1. These agree if the numbers
under the figures are hundredths: K = 30 is 0.30 m^2/s. That is the default, `SCALE`; `scale = 1` takes the
figures' numbers as they stand. Tanks, heights, streams, sound speed and half-width w are not printed."""

import dataclasses
import tempfile
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

import refsim
from refsim.backends.arrays import Backend
from refsim.core.effect import Discretisation
from refsim.core.writing import write_file
from refsim.isosurface import extract
from refsim.scene.solids import body_cells

SPACING, SUPPORT, STEP = 0.2, 0.5, 0.005  # [m], [m], [s]: table 1
SCALE = 0.01  # [m^2/s] of a printed K of 1; the claims on heat read K alike
SOUND = 35.0  # [m/s]: 0.4 h/(c + v) = 5 ms up to v = 5 m/s
VISCOSITY = 50.0  # [Pa s]
HALF_WIDTH = 2


LIQUID = refsim.WeaklyCompressible(
    sound_speed=SOUND, dynamic_viscosity=VISCOSITY, state="tait", kernels="cubic_spline", density="summation"
)
RED, GREEN, BLUE, YELLOW = "red", "green", "blue", "yellow"


@dataclasses.dataclass(frozen=True)
class Setting:
    """A figure's scene before it is one: lengths in spacings.

    tank    cells of the tank's inside along x, y and z
    waters  (lower corner, cells, velocity [m/s]) of each block of water
    bodies  (colour, density [kg/m^3], printed K, the solid)
    """

    tank: tuple[int, int, int]
    waters: tuple[tuple[tuple[int, int, int], tuple[int, int, int], tuple[float, float, float]], ...]
    bodies: tuple[tuple[str, float, float, Any], ...]
    solid_temperature: float
    water_temperature: float
    bookkeeping: str
    water_conductivity: float = 30.0  # not printed: that of ice, figure 4
    step: float = STEP  # [s]


def metres(*cells: float) -> tuple[float, ...]:
    """Lengths in spacings as metres."""
    return tuple(round(SPACING * c, 9) for c in cells)


def cube(center: tuple[float, float, float], edges: tuple[int, int, int], **more: Any) -> refsim.SolidBox:
    """A box of so many cells."""
    low = [c - e / 2 for c, e in zip(center, edges)]
    return refsim.SolidBox(lower=metres(*low), upper=metres(*(a + e for a, e in zip(low, edges))), **more)


def figure_4(size: float = 1.0) -> Setting:
    """One ice cube falls into warm water: 34,992 particles of water and 4,913 of ice at size 1."""
    edge, wide, deep = _cells(size, 17, 36, 27)
    middle = wide / 2 + (edge % 2) / 2
    body = cube((middle, middle, deep + 2 + edge / 2), (edge, edge, edge))
    water = ((0, 0, 0), (wide, wide, deep), (0.0, 0.0, 0.0))
    return Setting((wide, wide, deep + edge + 12), (water,), ((BLUE, 917.0, 30.0, body),), -10.0, 40.0, "water")


def figure_5(size: float = 1.0) -> Setting:
    """Cube, ball, ring and slab of equal conductivity: 48,576 particles of water and about 12,000 solid at size 1."""
    long, wide, deep, edge = _cells(size, 48, 46, 22, 14)
    x, y, up = (0.25 * long, 0.75 * long), (0.25 * wide, 0.75 * wide), deep + 2
    radius, ring, tube = size * 9.0, size * 7.2, size * 4.6
    slab = _cells(size, 20, 15, 10)
    torus = refsim.SolidTorus(center=metres(x[0], y[1], up + tube), radius=SPACING * ring, tube_radius=SPACING * tube)
    bodies = (
        (RED, 10000.0, 50.0, cube((round(x[0]), round(y[0]), up + edge / 2), (edge, edge, edge))),
        (GREEN, 200.0, 50.0, refsim.SolidBall(center=metres(x[1], y[0], up + radius), radius=SPACING * radius)),
        (BLUE, 300.0, 50.0, torus),
        (YELLOW, 8000.0, 50.0, cube((round(x[1]), round(y[1]), up + slab[2] / 2), slab)),
    )
    water = ((0, 0, 0), (long, wide, deep), (0.0, 0.0, 0.0))
    return Setting((long, wide, deep + edge + 20), (water,), bodies, -20.0, 80.0, "immiscible")


def figure_6(size: float = 1.0) -> Setting:
    """Two rabbits and two ducks between two streams: 40,656 particles of water, about 20,000 solid at size 1.

    The meshes lie in a temporary folder while they become cells of the lattice.
    """
    long, wide, tall, reach = _cells(size, 110, 44, 33, 14)
    lengths = {"rabbit": 34.6 * size, "duck": 36.2 * size}  # longest edges
    x, y = (reach + 0.55 * lengths["rabbit"], long - reach - 0.55 * lengths["duck"]), (0.255 * wide, 0.745 * wide)
    with tempfile.TemporaryDirectory() as folder:
        files = {animal: write_mesh(animal, folder) for animal in lengths}

        def body(animal: str, i: int, j: int) -> refsim.SolidCells:
            file, height = files[animal]
            length = lengths[animal]
            middle = metres(x[i], y[j], 0.5 * height * length)
            turn = (0.0, 0.0, 180.0 * (i == 0))  # faces the nearer stream
            mesh = refsim.SolidMesh(file=file, center=middle, size=SPACING * length, rotation=turn)
            return refsim.SolidCells(cells=body_cells(mesh, animal, Discretisation(3, "float32", SPACING, 0.0, 0)))

        bodies = (
            (RED, 9000.0, 50.0, body("rabbit", 0, 0)), (GREEN, 250.0, 70.0, body("rabbit", 1, 1)),
            (BLUE, 280.0, 10.0, body("duck", 0, 1)), (YELLOW, 8500.0, 30.0, body("duck", 1, 0)),
        )  # fmt: skip
    waters = (
        ((0, 0, 0), (reach, wide, tall), (4.0, 0.0, 0.0)),
        ((long - reach, 0, 0), (reach, wide, tall), (-4.0, 0.0, 0.0)),
    )
    # the step is not the printed 5 ms: melt is thrown out at 38 m/s (docs/melting.md)
    return Setting((long, wide, tall + round(24 * size)), waters, bodies, -10.0, 100.0, "immiscible", step=0.002)


def shared_tank(figure: str, size: float, share: float) -> Setting:
    """A still tank with as many particles as figure 6 has, a share of it solid: one slab, at least a layer."""
    wide, tall, long = _cells(size, 40, 39, 39)  # 60,840 at size 1
    thick = max(1, round(share * long))
    low = (long - thick) // 2
    still = (0.0, 0.0, 0.0)
    waters = ((0, 0, 0), (low, wide, tall), still), ((low + thick, 0, 0), (long - low - thick, wide, tall), still)
    slab = refsim.SolidBox(lower=metres(low, 0, 0), upper=metres(low + thick, wide, tall))
    return Setting((long, wide, tall + 10), waters, ((BLUE, 1000.0, 30.0, slab),), -10.0, 40.0, "immiscible")


def _cells(size: float, *counts: int) -> tuple[int, ...]:
    """Counts of cells of a scene of this size."""
    return tuple(max(1, round(size * c)) for c in counts)


FIGURES = {"figure_4": figure_4, "figure_5": figure_5, "figure_6": figure_6}


def scene_of(figure: str, size: float = 1.0, **options: Any) -> refsim.Scene:
    """A figure's scene; `options` as for `made`."""
    return make_scene(FIGURES[figure](size), figure, **options)


def make_scene(
    setting: Setting,
    name: str = "melting",
    scale: float = SCALE,
    half_width: int = HALF_WIDTH,
    scheme: str = "implicit",
    summation: str = "fast",
    dtype: str = "float32",
    melting: bool = True,
    largest_number: float = 0.2,  # reached: 0.0875; a GPU allocates the passes that it takes
    weighted: bool = True,
    **more: Any,
) -> refsim.Scene:
    """The scene of a setting; `weighted`: substances that stay apart push each other by one pressure a pair."""
    solid = tuple(msgspec.structs.replace(body, density=density) for _, density, _, body in setting.bodies)
    fluid = tuple(refsim.Box(lower=metres(*low), cells=cells, velocity=v) for low, cells, v in setting.waters)
    heat = refsim.HeatConduction(
        temperature=(setting.solid_temperature,) * len(solid) + (setting.water_temperature,) * len(fluid),
        conductivity=(*(scale * k for _, _, k, _ in setting.bodies),
                      *(scale * setting.water_conductivity,) * len(fluid)),
        melting_point=0.0, scheme=scheme, mean="arithmetic", largest_number=largest_number, literal=("M11", "M26"),
    )  # fmt: skip
    effects = (
        LIQUID, refsim.Gravity(), refsim.BoxWalls(lower=(0.0, 0.0, 0.0), upper=metres(*setting.tank)),
        refsim.ShapeMatching(half_width=half_width, summation=summation),
        refsim.TwoWayCoupling(density_weighted=setting.bookkeeping == "immiscible" and weighted), heat,
        *((refsim.Melting(bookkeeping=setting.bookkeeping),) if melting else ()),
    )  # fmt: skip
    given = {"spacing": SPACING, "support_radius": SUPPORT, "step": setting.step, "dtype": dtype, "name": name, **more}
    return refsim.Scene(solid=solid, fluid=fluid, effects=effects, **given)


# Rabbit and duck: closed meshes made of ellipsoids, generated here and free for any use.


# Ellipsoids: center, half axes, turn about y [degrees]; x is forward, z is up, and pairs lie at both sides of y = 0.
RABBIT = (
    ((0.00, 0.00, 0.00), (0.62, 0.46, 0.52), -12),  # trunk
    ((-0.38, 0.00, -0.12), (0.42, 0.48, 0.46), 0),  # haunches
    ((0.52, 0.00, 0.46), (0.36, 0.31, 0.32), 0),  # head
    ((0.76, 0.00, 0.38), (0.17, 0.17, 0.15), 0),  # muzzle
    ((0.28, 0.15, 1.02), (0.14, 0.11, 0.50), 24),  # ears
    ((0.28, -0.15, 1.02), (0.14, 0.11, 0.50), 24),
    ((0.34, 0.27, -0.46), (0.34, 0.15, 0.15), 0),  # paws
    ((0.34, -0.27, -0.46), (0.34, 0.15, 0.15), 0),
    ((-0.26, 0.36, -0.48), (0.42, 0.17, 0.15), 0),
    ((-0.26, -0.36, -0.48), (0.42, 0.17, 0.15), 0),
    ((-0.84, 0.00, -0.06), (0.19, 0.18, 0.18), 0),  # tail
)
DUCK = (
    ((0.00, 0.00, 0.00), (0.80, 0.52, 0.44), 0),  # trunk
    ((0.30, 0.00, 0.10), (0.46, 0.44, 0.42), 0),  # breast
    ((0.48, 0.00, 0.46), (0.22, 0.22, 0.38), 10),  # neck
    ((0.54, 0.00, 0.82), (0.33, 0.30, 0.30), 0),  # head
    ((0.90, 0.00, 0.76), (0.24, 0.20, 0.09), 0),  # bill
    ((-0.74, 0.00, 0.26), (0.36, 0.26, 0.15), 38),  # tail
    ((-0.10, 0.46, 0.08), (0.46, 0.16, 0.26), 8),  # wings
    ((-0.10, -0.46, 0.08), (0.46, 0.16, 0.26), 8),
)
ANIMALS = {"rabbit": RABBIT, "duck": DUCK}


def field(parts: tuple, points: NDArray) -> NDArray[np.float64]:
    """Negative inside the union of ellipsoids, positive outside: smallest of (|u| - 1), u in half axes."""
    value = np.full(len(points), np.inf)
    for center, axes, turn in parts:
        c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
        away = points - np.array(center)
        x, z = c * away[:, 0] + s * away[:, 2], c * away[:, 2] - s * away[:, 0]
        u = np.stack([x, away[:, 1], z], axis=1) / np.array(axes)
        value = np.minimum(value, np.linalg.norm(u, axis=1) - 1)
    return value


def mesh(animal: str, cell: float = 0.05) -> tuple[NDArray, NDArray]:
    """(vertices, triangles) of an animal about 2 units long, by marching cubes."""
    count = int(np.ceil(1.7 / cell))
    axis = np.arange(-count, count + 1)
    coordinates = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    shift = cell * np.array([0.317, 0.211, 0.407])  # no node on the surface, where triangles would have no area
    surface = extract(Backend("cpu"), coordinates, field(ANIMALS[animal], cell * coordinates + shift), cell, 3)
    return np.asarray(surface.vertices), np.asarray(surface.facets)


def write_mesh(animal: str, folder: str | Path) -> tuple[str, float]:
    """Write an animal as an STL file into a folder; its path, and its height over its longest edge."""
    import trimesh

    path = Path(folder) / f"{animal}.stl"
    vertices, facets = mesh(animal)
    write_file(path, trimesh.Trimesh(vertices, facets).export(file_type="stl"))
    edges = np.ptp(vertices, axis=0)
    return str(path), float(edges[2] / edges.max())
