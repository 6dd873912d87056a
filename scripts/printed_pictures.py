"""Run the scenes of the printed pictures and draw them: `python scripts/printed_pictures.py [NAME ...]` writes
figures/printed/NAME.webp, and its numbers into figures/printed/NAME.json.

    python scripts/printed_pictures.py                    # all, some minutes a run on two cores
    python scripts/printed_pictures.py pour_sphere        # one of them
    python scripts/printed_pictures.py pour_sphere --draw # from the runs that are there

Runs are kept in build/printed; an interrupted one goes on from its checkpoint. Needs `pip install "refsim[view]"`.
Exit code: 0, 2 for a name that is no picture or a run that is missing.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from refsim import (  # noqa: E402
    Akinci2013,
    BoxWalls,
    Cloud,
    Gravity,
    MeshBoundary,
    Scene,
    Simulation,
    WeaklyCompressible,
    make_plan,
    simulate,
)
from refsim.backends.arrays import Backend  # noqa: E402
from refsim.core.errors import InputError  # noqa: E402
from refsim.io.frames import Frame  # noqa: E402
from refsim.isosurface import extract  # noqa: E402
from refsim.render.looks import OBSTACLE, Cut, camera_of, cut_of, liquid_colour  # noqa: E402
from refsim.render.saved_run import SavedRun, open_run  # noqa: E402
from refsim.render.space import Body, Stage, bar_length, cut_closed, smoothed  # noqa: E402
from refsim.render.surfaces import surface_around  # noqa: E402
from validation.drawing import BLUE, save_picture, style  # noqa: E402
from validation.experiment import chosen  # noqa: E402
from validation.experiments.dong import scene as dong  # noqa: E402
from validation.experiments.melting.scene import scene_of  # noqa: E402
from validation.metrics.droplet import cubic_moment  # noqa: E402
from validation.metrics.spread import parts  # noqa: E402
from validation.perform import EXIT_FINE  # noqa: E402

FOLDER = ROOT / "figures" / "printed"
RUNS = ROOT / "build" / "printed"
Array = NDArray[np.float64]
MM = 1e-3  # m

# Water poured over solids

SPACING = 0.2 * MM  # of the liquid at size 1
TENSION = 0.072  # nominal, of the cohesion alone [N/m]
ADHESION = 10.0  # of the solid, over the cohesion's coefficient, both in m^4/(kg s^2)
SOUND, VISCOSITY = 8.0, 4e-3  # m/s, Pa s
ARMS = {"without": "without tension", "with": "with tension"}


def sphere() -> Any:
    """Ball of 5 mm."""
    import trimesh

    return trimesh.creation.icosphere(subdivisions=5, radius=5 * MM)


def funnel() -> Any:
    """Cone from 9 mm down to a spout of 1.8 mm, its wall 0.8 mm thick, its rim at 0."""
    import trimesh

    line = np.array([[1.8, -13], [2.6, -13], [2.6, -8.4], [9.8, 0], [9.0, 0], [1.8, -8]]) * MM
    made = trimesh.creation.revolve(np.vstack([line, line[:1]]), sections=120)
    made.fix_normals()
    return made


def plate() -> Any:
    """Lying plate of 14 mm, 0.8 mm thick."""
    import trimesh

    return trimesh.creation.box((14 * MM, 14 * MM, 0.8 * MM))


# Ellipsoids of a standing figure: centre, half axes [mm], turn about y [degrees]; z is up, the base lies at z = -11.
STATUE = (
    ((0.0, 0.0, -1.6), (2.0, 1.6, 3.6), 0),  # gown
    ((0.0, 0.0, -5.6), (3.0, 2.6, 4.2), 0),
    ((0.0, 0.0, 2.4), (2.4, 1.5, 2.2), 0),  # chest
    ((0.0, 0.0, 5.0), (0.8, 0.8, 1.6), 0),  # neck
    ((0.0, 0.0, 7.0), (1.6, 1.5, 1.9), 0),  # head
    ((2.5, 0.2, 2.2), (0.8, 0.8, 2.4), -24),  # arms
    ((-2.5, 0.2, 2.2), (0.8, 0.8, 2.4), 24),
    ((3.2, -0.9, 0.4), (0.65, 1.6, 0.65), 0),
    ((-3.2, -0.9, 0.4), (0.65, 1.6, 0.65), 0),
)
BASE = (4.4, 4.4, 0.8)  # half edges of the block under it [mm], its middle at z = -9.9
BLEND = 0.35  # mm over which parts run into each other


def statue(cell: float = 0.25) -> Any:
    """A figure with arms on a block, 20 mm tall; marching cubes on a grid of `cell` [mm]."""
    import trimesh

    half = np.array([6.0, 5.2, 11.6])
    count = np.ceil(half / cell).astype(int)
    axes = [np.arange(-n, n + 1) for n in count]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    shift = np.array([0.317, 0.211, 0.407])  # no node on the surface
    points = cell * (nodes + shift)
    total = np.zeros(len(points))
    for centre, axes_of, turn in STATUE:
        c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
        away = points - np.array(centre)
        turned = np.stack([c * away[:, 0] - s * away[:, 2], away[:, 1], s * away[:, 0] + c * away[:, 2]], axis=1)
        scaled = np.linalg.norm(turned / np.array(axes_of), axis=1)
        slope = np.linalg.norm(turned / np.array(axes_of) ** 2, axis=1)
        distance = scaled * (scaled - 1) / np.maximum(slope, 1e-9)
        total += np.exp(np.clip(-distance / BLEND, -60, 60))
    blended = -BLEND * np.log(total)
    outside = np.abs(points - np.array([0.0, 0.0, -9.9])) - np.array(BASE)
    block = np.linalg.norm(np.maximum(outside, 0), axis=1) + np.minimum(outside.max(1), 0) - 0.15
    found = extract(Backend("cpu"), nodes, np.minimum(blended, block), cell * MM, 3)
    made = trimesh.Trimesh(np.asarray(found.vertices) + cell * MM * shift, np.asarray(found.facets), process=True)
    trimesh.smoothing.filter_taubin(made, iterations=6)
    return made


@dataclass(frozen=True)
class Pour:
    """Water falls as a jet on a solid over a basin.

    solid    makes the mesh
    jet      radius and length [m]; lowest point of its axis (x, y, z) [m]
    floor    height of the basin's floor [m]; half: of its width [m]
    speed    of the jet at the start, downwards [m/s]
    times    that are drawn [s]
    seen     lower and upper corner of what the picture shows [mm]
    camera   as `refsim render` takes it; cut: a plane, or None; sound: speed of sound [m/s]
    """

    solid: Callable[[], Any]
    jet: tuple[float, float]
    start: tuple[float, float, float]
    floor: float
    half: float
    speed: float
    times: tuple[float, ...]
    seen: tuple[tuple[float, float, float], tuple[float, float, float]]
    camera: str
    cut: str | None = None
    sound: float = SOUND

    def scene(self, arm: str, size: float, folder: Path) -> Scene:
        """The scene of an arm; its mesh is written into the folder."""
        d = SPACING / size
        folder.mkdir(parents=True, exist_ok=True)
        file = folder / "solid.obj"
        self.solid().export(file)
        cohesion = Akinci2013(surface_tension=TENSION, area_acceleration=0.0)
        basin = BoxWalls(
            lower=(-self.half, -self.half, self.floor),
            upper=(self.half, self.half, self.start[2] + 2 * self.jet[1]),
            open_faces=("-x", "+x", "-y", "+y", "+z"),
        )
        effects: list[Any] = [
            WeaklyCompressible(
                rest_density=1000.0, sound_speed=self.sound, dynamic_viscosity=VISCOSITY / size, density="summation"
            ),
            Gravity(),
            basin,
        ]
        adhesion = 0.0
        if arm == "with":
            bare = Scene(spacing=d, support_radius=2.7 * d, fluid=(Cloud(position=np.zeros((1, 3))),),
                         effects=(effects[0], cohesion))  # fmt: skip
            plan = make_plan(bare)
            adhesion = ADHESION * cohesion.coefficient(plan.grid, plan.effects)
            effects.append(cohesion)
        effects.append(MeshBoundary(file=str(file), viscosity=VISCOSITY / size, adhesion=adhesion))
        return Scene(
            name=f"pour_{arm}", spacing=d, support_radius=2.7 * d, end_time=self.times[-1],
            fluid=(Cloud(position=jet(*self.jet, self.start, d), velocity=(0.0, 0.0, -self.speed)),),
            effects=tuple(effects),
        )  # fmt: skip


def jet(radius: float, length: float, start: tuple[float, float, float], spacing: float) -> Array:
    """(n, 3) positions [m] of an upright cylinder of liquid on a lattice."""
    n, layers = math.ceil(radius / spacing), max(1, round(length / spacing))
    across = (np.arange(-n, n) + 0.5) * spacing
    x, y = (a.ravel() for a in np.meshgrid(across, across, indexing="ij"))
    kept = x**2 + y**2 <= radius**2
    z = (np.arange(layers) + 0.5) * spacing
    place = np.stack([np.tile(x[kept], layers), np.tile(y[kept], layers), np.repeat(z, kept.sum())], axis=1)
    return place + np.array(start)


POURS = {
    "pour_sphere": Pour(
        sphere, (3.2 * MM, 25.2 * MM), (0.0, 0.0, 5.4 * MM), -6 * MM, 24 * MM, 0.5, (0.018, 0.03),
        ((-11, -11, -6), (11, 11, 17)), "-60,18"
    ),
    "pour_funnel": Pour(
        funnel, (4.0 * MM, 16.0 * MM), (0.0, 0.0, -3.4 * MM), -19 * MM, 18 * MM, 0.35, (0.02, 0.045),
        ((-14, -9, -19), (14, 9, 9)), "-90,12", "y=0", 6.0
    ),
    "pour_plate": Pour(
        plate, (3.2 * MM, 25.2 * MM), (0.0, 0.0, 0.8 * MM), -8 * MM, 24 * MM, 0.9, (0.01, 0.018),
        ((-13, -13, -8), (13, 13, 14)), "-60,18"
    ),
    "pour_statue": Pour(
        statue, (3.2 * MM, 25.2 * MM), (0.0, 0.0, 9.4 * MM), -11 * MM, 24 * MM, 0.9, (0.0132, 0.022),
        ((-11, -11, -11), (11, 11, 18)), "-70,14"
    ),
}  # fmt: skip


def performed(scene: Scene, folder: Path, frames: int, draw: bool) -> SavedRun:
    """The run of a scene in a folder: made, gone on with from its checkpoint, or as it is there.

    frames  that are written, without the start; draw: take what is there
    """
    going_on = (folder / "checkpoint.h5").exists()
    if not draw:
        begun: Any = Simulation.resume(folder, "cpu") if going_on else scene
        if not going_on or begun.time < scene.end_time:
            every = scene.end_time / frames * (1 - 1e-6)  # just short of multiples of a fixed step
            simulate(begun, scene.end_time, output=folder, every=every, checkpoint_every=120.0)
    elif not going_on:
        raise InputError(f"there is no run in {folder}; leave --draw out.")
    return open_run(folder)


def at(run: SavedRun, time: float) -> Frame:
    """The frame of a run that is nearest to a time [s]."""
    number = int(np.argmin(np.abs(np.array(run.times) - time)))
    return next(iter(run.frames([number])))


def water(
    points: Array, run: SavedRun, cut: Cut | None = None, colour: Any = None, seen: tuple[Array, Array] | None = None
) -> Body:
    """The smooth surface of liquid at points (n, 3) [m], which lies on the run's walls and solid and ends at the cut.

    seen  corners [m] of a box; liquid farther than a quarter of its edges outside of it is left away
    """
    wall, far = run.wall_distance(), 4 * run.spacing
    if seen is not None:
        margin = 0.25 * (seen[1] - seen[0])
        points = points[((points > seen[0] - margin) & (points < seen[1] + margin)).all(1)]
    if cut is not None:
        points = points[cut(points) < far]

    def distance(places: Array) -> Array:
        found = np.full(len(places), np.inf) if wall is None else wall(places)
        return found if cut is None else np.minimum(found, -cut(places))

    mesh = surface_around(points, run.spacing, wall=distance)
    vertices = smoothed(mesh.vertices, mesh.facets)
    return Body(
        vertices, mesh.facets, liquid_colour(0) if colour is None else colour, water=True, edges=cut is not None
    )


def staged(
    seen: tuple[Any, Any], camera: str, ground: float, pixels: tuple[int, int], unit: float = 1.0,
    softness: float = 0.03,
) -> Stage:  # fmt: skip
    """A stage on which the box from one corner to the other (in `unit` metres) fills the picture."""
    low, high = (unit * np.array(corner, dtype=float) for corner in seen)
    view, up = camera_of(camera), np.array([0.0, 0.0, 1.0])
    right, upward, _ = view.axes(up)
    corners = np.array([np.where(pick, high, low) for pick in np.ndindex(2, 2, 2)])
    half = 0.5 * max(float(np.ptp(corners @ upward)), float(np.ptp(corners @ right)) * pixels[1] / pixels[0])
    return Stage(low, high, up, view, pixels, ground=ground, softness=softness * float(np.linalg.norm(high - low)),
                 background=PAPER, half_height=1.02 * half)  # fmt: skip


PAPER = "#e9eef2"
PANEL, SQUARE = (760, 640), (620, 620)  # pixels


def show(axes: Any, image: NDArray, stage: Stage, title: str, bar: bool = False) -> None:
    """A picture as a panel; bar: with a scale bar."""
    height, width = image.shape[:2]
    axes.imshow(image, extent=(0, width, 0, height), interpolation="antialiased")
    axes.set_axis_off()
    axes.set_title(title, loc="center", weight="normal", fontsize=9.5)
    if bar:
        metres = stage.metres_a_pixel()
        length = bar_length(width * metres)
        words = f"{length * 1e3:g} mm" if length < 0.01 else f"{length * 1e2:g} cm" if length < 1 else f"{length:g} m"
        x, y = 0.04 * width, 0.05 * height
        axes.plot([x, x + length / metres], [y, y], color="#1f2933", linewidth=2.5, solid_capstyle="butt")
        axes.text(x, y + 0.015 * height, words, color="#1f2933", fontsize=8.5, ha="left", va="bottom")


def counted(position: Array, run: SavedRun) -> dict[str, Any]:
    """Connected parts of the liquid, lone particles, and particles in the solid."""
    sizes = np.bincount(parts(position, run.spacing))
    solid = run.mesh
    inside = 0 if solid is None else int((solid.distance(position) < -0.01 * run.spacing).sum())
    return {
        "parts": int((sizes > 1).sum()), "lone": int((sizes == 1).sum()),
        "largest_share": round(float(sizes[0] / sizes.sum()), 4), "inside_solid": inside,
    }  # fmt: skip


def pour_picture(name: str, size: float, folder: Path, draw: bool) -> tuple[Any, dict[str, Any]]:
    """Without and with tension, a row each, at the times of the picture."""
    import matplotlib.pyplot as plt

    pour = POURS[name]
    figure, panels = plt.subplots(2, len(pour.times), figsize=(4.6 * len(pour.times), 8.0), squeeze=False)
    data: dict[str, Any] = {"spacing_m": SPACING / size, "arms": {}}
    stage = staged(pour.seen, pour.camera, pour.floor, PANEL, MM)
    cut = cut_of(pour.cut, stage.camera.axes(stage.up)[2], 3)
    for row, (arm, words) in zip(panels, ARMS.items()):
        own = folder / f"{name}_{arm}"
        run = performed(pour.scene(arm, size, own), own, 10, draw)
        solid = run.mesh
        assert solid is not None
        vertices, facets = solid.mesh.vertices + solid.mesh.origin, solid.mesh.faces
        if cut is not None:
            vertices, facets = cut_closed(vertices, facets, cut, run.spacing)
        rows = []
        for axes, time in zip(row, pour.times):
            frame = at(run, time)
            x = np.asarray(frame.position, dtype=float)
            image = stage.draw(
                [
                    Body(vertices, facets, OBSTACLE, gloss=0.1, edges=True),
                    water(x, run, cut, seen=(stage.low, stage.high)),
                ]
            )
            numbers = counted(x, run)
            title = f"{words}, {1e3 * frame.time:.0f} ms: {numbers['lone']:,} lone particles"
            show(axes, image, stage, title, axes is panels[0, 0])
            rows.append({"time_s": round(frame.time, 6), **numbers})
        data["arms"][words] = rows
        data["particles"] = len(x)
    solid_name = name.removeprefix("pour_")
    where = "into" if solid_name == "funnel" else "on"
    figure.suptitle(f"{data['particles']:,} particles poured {where} a {solid_name}", fontsize=11, fontweight="bold")
    return figure, data


# Ice in water

ICE = {
    "melting": ("melts, as in figure 4:", {}, 2.4),
    "frozen": ("does not melt:", {"melting": False}, 10.0),
}  # title, options of the scene, end [s]
ICE_TIMES = {"melting": (0.6, 1.3, 1.9), "frozen": (1.3, 4.0, 10.0)}  # s
ICE_COLOUR = (0.90, 0.95, 0.99)


def levels(frame: Frame, run: SavedRun) -> tuple[float, float, float]:
    """Lowest and highest place of the ice, and the water's level [m]; NaN without ice.

    The level is half a spacing over the median of the highest liquid particles of columns two spacings wide.
    """
    x, solid = np.asarray(frame.position, dtype=float), run.solid_body(frame) >= 0
    half = 0.5 * run.spacing
    liquid = x[~solid]
    column = np.unique((liquid[:, :2] // (4 * half)).astype(int), axis=0, return_inverse=True)[1].ravel()
    highest = np.full(column.max() + 1, -np.inf)
    np.maximum.at(highest, column, liquid[:, 2])
    ice = x[solid, 2]
    low, high = (ice.min() - half, ice.max() + half) if len(ice) else (math.nan, math.nan)
    return float(low), float(high), float(np.median(highest) + half)


def ice_picture(name: str, size: float, folder: Path, draw: bool) -> tuple[Any, dict[str, Any]]:
    """The ice cube of melting figure 4, melting and not; below, its top and bottom against the level."""
    import matplotlib.pyplot as plt

    figure = plt.figure(figsize=(10.2, 8.6))
    grid = figure.add_gridspec(3, 6, height_ratios=(1.0, 1.0, 0.75))
    data: dict[str, Any] = {"arms": {}}
    for line, (arm, (words, options, until)) in enumerate(ICE.items()):
        own = folder / f"{name}_{arm}"
        run = performed(scene_of("figure_4", size, end_time=until, **options), own, round(until / 0.1), draw)
        assert run.box is not None
        seen = run.box[0], run.box[1] * np.array([1.0, 1.0, 0.84])
        stage = staged(seen, "-68,14", 0.0, SQUARE)
        whole = int((run.solid_body(at(run, 0.0)) >= 0).sum())
        for k, time in enumerate(ICE_TIMES[arm]):
            frame = at(run, time)
            x, solid = np.asarray(frame.position, dtype=float), run.solid_body(frame) >= 0
            bodies = [water(x[~solid], run, colour=(0.16, 0.47, 0.78))]
            if solid.any():
                mesh = surface_around(x[solid], run.spacing)
                bodies.append(Body(smoothed(mesh.vertices, mesh.facets), mesh.facets, ICE_COLOUR, gloss=0.2))
            axes = figure.add_subplot(grid[line, 2 * k : 2 * k + 2])
            share = 100 * solid.sum() / whole
            title = f"{words if k == 0 else ''} {frame.time:.1f} s, {share:.0f} % ice".strip()
            show(axes, stage.draw(bodies), stage, title, line == k == 0)
        series = []
        for frame in run.frames(range(len(run.times))):
            low, high, level = levels(frame, run)
            series.append(
                [round(v, 4) for v in (frame.time, low, high, level, float((run.solid_body(frame) >= 0).sum()))]
            )
        values = np.array(series)
        axes = figure.add_subplot(grid[2, 3 * line : 3 * line + 3])
        axes.fill_between(values[:, 0], values[:, 1], values[:, 2], color="#b9cfe0", label="ice, bottom to top")
        axes.plot(values[:, 0], values[:, 3], color=BLUE, label="water level")
        axes.set(
            xlabel="time [s]",
            ylabel="height [m]",
            title=f"ice that {words.partition(',')[0].strip(':')}",
            ylim=(0, None),
        )
        axes.grid(True)
        axes.legend(loc="upper right")
        kept = values[np.isfinite(values[:, 2])]
        after = kept[np.argmax(kept[:, 2] < kept[:, 3]) :]  # from when the ice is below the level
        data["arms"][arm] = {
            "particles": len(x), "last_ice_s": float(kept[-1, 0]),
            "deepest_top_m": round(float((after[:, 2] - after[:, 3]).min()), 4),
            "last_top_m": round(float(kept[-1, 2] - kept[-1, 3]), 4),
            "ice_particles": [int(values[0, 4]), int(kept[-1, 4])],
            "floating_top_m": round((1 - 917 / 1000) * float(values[0, 2] - values[0, 1]), 4),
            "time_bottom_top_level_m": [row[:4] for row in series[:: max(1, len(series) // 50)] if row[4]],
        }  # fmt: skip
    last = data["arms"]["frozen"]
    above = "above" if last["last_top_m"] > 0 else "below"
    figure.suptitle(
        f"Ice that does not melt, after {last['last_ice_s']:.0f} s: its top is {abs(last['last_top_m']):.2f} m"
        f" {above} the level (by its weight: {last['floating_top_m']:.2f} m above)", fontsize=11, fontweight="bold",
    )  # fmt: skip
    return figure, data


# Dong, Zhang & Chen 2016, figures 3, 4 and 6, at twice the linear resolution of validation/experiments/dong

FINER = 2
CUBE_END, CUBE_FRAMES = 4.0, 100
ROOM_EVERY = 0.05  # s between stored frames
ROOM_FRAMES = (70, 80, 90, 120)  # of figure 4
MERGING_FRAMES = (120, 160, 240, 320)  # of figure 6


def dong_cube(name: str, size: float, folder: Path, draw: bool) -> tuple[Any, dict[str, Any]]:
    """Figure 3: a cube of 0.5 m without gravity becomes a ball and an octahedron and swings."""
    import matplotlib.pyplot as plt

    side = round(FINER * 17 * size)
    position, spacing = dong.start("cube", side**3)
    scene = dong.cube_scene(position, spacing)
    scene = msgspec.structs.replace(scene, end_time=CUBE_END)
    run = performed(scene, folder / name, CUBE_FRAMES, draw)
    moment = np.array([cubic_moment(np.asarray(f.position, dtype=float)) for f in run.frames(range(len(run.times)))])
    top = next((k for k in range(2, len(moment) - 1) if moment[k] > 0 and moment[k] >= moment[k + 1]), len(moment) // 2)
    ball = int(np.argmin(np.abs(moment[: top + 1])))
    after = next((k for k in range(top, len(moment)) if moment[k] <= 0), len(moment) - 1)
    shown = [0, ball // 2, ball, top, after, len(moment) - 1]
    figure, panels = plt.subplots(2, 3, figsize=(9.6, 6.9))
    half = 0.36
    stage = staged(((-half,) * 3, (half,) * 3), "12,9", -half, SQUARE)
    rows = []
    for k, (axes, number) in enumerate(zip(panels.flat, shown)):
        frame = next(iter(run.frames([number])))
        x = np.asarray(frame.position, dtype=float)
        show(axes, stage.draw([water(x - x.mean(0), run)]), stage,
             f"{frame.time:.2f} s, q4 {moment[number]:+.3f}", k == 0)  # fmt: skip
        rows.append({"time_s": round(frame.time, 4), "q4": round(float(moment[number]), 5)})
    figure.suptitle(
        f"Dong, figure 3: a cube of 0.5 m without gravity, {side**3:,} particles", fontsize=11, fontweight="bold"
    )
    return figure, {"particles": side**3, "spacing_m": spacing, "frames": rows}


def dong_block(tension: bool, until: float, size: float) -> Scene:
    """The block that falls into the room, on a finer lattice; liquid and tension as in `dong.block_scene`."""
    cells = tuple(max(2, round(FINER * size * n)) for n in dong.CELLS)
    spacing = dong.BLOCK / cells[0]
    axes = [(np.arange(n) + 0.5) * spacing - 0.5 * n * spacing * (k < 2) for k, n in enumerate(cells)]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3) + (0.0, 0.0, dong.HEIGHT)
    x += np.random.default_rng(1).uniform(-0.01, 0.01, x.shape) * spacing
    coarse = dong.block_scene(1, tension)
    fluid = (Cloud(position=x),)
    return msgspec.structs.replace(
        coarse, spacing=spacing, support_radius=2.7 * spacing, fluid=fluid, end_time=until, name="dong_block_fine"
    )


def dong_room(panels: NDArray, run: SavedRun, frames: Sequence[int], words: str) -> list[dict[str, Any]]:
    """The room from above at frames of 5 ms, a panel each; what is counted in each."""
    half = 0.5 * dong.ROOM
    stage = staged(((-half, -half, 0.0), (half, half, 0.05)), "-90,89.9", 0.0, SQUARE)
    rows = []
    for axes, number in zip(panels, frames):
        frame = at(run, number * dong.FRAME)
        x = np.asarray(frame.position, dtype=float)
        numbers = counted(x, run)
        title = f"{words}{frame.time:.2f} s: {numbers['parts']} parts, {numbers['lone']} lone"
        show(axes, stage.draw([water(x, run)]), stage, title, axes is panels[0])
        rows.append({"frame": number, "time_s": round(frame.time, 4), **numbers})
    return rows


def dong_splash(name: str, size: float, folder: Path, draw: bool) -> tuple[Any, dict[str, Any]]:
    """Figure 4: the block after its impact, from above, with and without tension."""
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(2, len(ROOM_FRAMES), figsize=(11.2, 6.2))
    data: dict[str, Any] = {"arms": {}}
    until = ROOM_FRAMES[-1] * dong.FRAME
    for line, (arm, words) in enumerate(reversed(ARMS.items())):
        run = performed(
            dong_block(arm == "with", until, size), folder / f"{name}_{arm}", round(until / ROOM_EVERY), draw
        )
        data["arms"][words] = dong_room(panels[line], run, ROOM_FRAMES, f"{arm}, ")
        data["particles"], data["spacing_m"] = len(at(run, 0.0).position), run.spacing
    title = f"Dong, figure 4: with and without tension, from above, {data['particles']:,} particles"
    figure.suptitle(title, fontsize=11, fontweight="bold")
    return figure, data


def dong_merging(name: str, size: float, folder: Path, draw: bool) -> tuple[Any, dict[str, Any]]:
    """Figure 6: droplets on the floor merge, from above; the run of figure 4 with tension goes on."""
    import matplotlib.pyplot as plt

    until = MERGING_FRAMES[-1] * dong.FRAME
    run = performed(dong_block(True, until, size), folder / "dong_figure_4_fine_with", round(until / ROOM_EVERY), draw)
    figure, panels = plt.subplots(1, len(MERGING_FRAMES), figsize=(11.2, 3.4))
    rows = dong_room(panels, run, MERGING_FRAMES, "")
    data = {"particles": len(at(run, 0.0).position), "spacing_m": run.spacing, "frames": rows}
    figure.suptitle(
        f"Dong, figure 6: the liquid merges, {data['particles']:,} particles", fontsize=11, fontweight="bold"
    )
    return figure, data


Maker = Callable[[str, float, Path, bool], tuple[Any, dict[str, Any]]]
PICTURES: dict[str, Maker] = {
    **dict.fromkeys(POURS, pour_picture),
    "ice_floats": ice_picture,
    "dong_figure_3_fine": dong_cube,
    "dong_figure_4_fine": dong_splash,
    "dong_figure_6_fine": dong_merging,
}


def main(words: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", nargs="*", metavar="NAME", help=f"some of {', '.join(PICTURES)}; all by default")
    parser.add_argument("--size", type=float, default=1.0, help="resolution over the printed one (1)")
    parser.add_argument("--draw", action="store_true", help="draw from the runs that are there")
    parser.add_argument("--folder", type=Path, default=FOLDER, help="of pictures and numbers (figures/printed)")
    parser.add_argument("--runs", type=Path, default=RUNS, help="folder of the runs (build/printed)")
    given = parser.parse_args(words)
    try:
        names = chosen(given.name, PICTURES, "picture")
        for name, maker in zip(given.name or PICTURES, names):
            with style():
                figure, data = maker(name, given.size, given.runs, given.draw)
                given.folder.mkdir(parents=True, exist_ok=True)
                path = given.folder / f"{name}.webp"
                save_picture(figure, path)
            lines = [f"{json.dumps(key)}: {json.dumps(value)}" for key, value in data.items()]
            path.with_suffix(".json").write_text("{\n" + ",\n".join(lines) + "\n}\n")
            print(path)
    except InputError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return EXIT_FINE


if __name__ == "__main__":
    sys.exit(main())
