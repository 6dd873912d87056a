"""Run the scenes of the printed pictures and draw them: `python scripts/printed_pictures.py [NAME ...]` writes
figures/printed/NAME.webp.

    python scripts/printed_pictures.py                    # all, some minutes a run on two cores
    python scripts/printed_pictures.py pour_sphere        # one of them
    python scripts/printed_pictures.py pour_sphere --draw # from the runs that are there

Runs are kept in build/printed; an interrupted one goes on from its checkpoint. Needs `pip install "refsim[view]"`.
Exit code: 0, 2 for a name that is no picture or a run that is missing.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
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
from refsim.core.errors import InputError  # noqa: E402
from refsim.core.writing import write_file  # noqa: E402
from refsim.io.frames import Frame  # noqa: E402
from refsim.render.pictures import Look, Series  # noqa: E402
from refsim.render.saved_run import SavedRun, open_run  # noqa: E402
from scripts.pictures import command  # noqa: E402
from validation.drawing import BLUE, headline  # noqa: E402
from validation.experiments.dong import scene as dong  # noqa: E402
from validation.experiments.melting.scene import scene_of  # noqa: E402
from validation.metrics.droplet import cubic_moment  # noqa: E402
from validation.metrics.spread import parts  # noqa: E402

FOLDER = ROOT / "figures" / "printed"
RUNS = ROOT / "build" / "printed"
MM = 1e-3  # m
PANEL, SQUARE = (760, 640), (620, 620)  # pixels
ARMS = {"without": "without tension", "with": "with tension"}


def run_of(asked: argparse.Namespace, name: str, scene: Scene, frames: int) -> SavedRun:
    """The run of a scene: made, gone on with from its checkpoint, or as it is there; `frames` without the start.

    asked  what the user gave: resolution over the printed one, folder of the runs, whether to draw what is there
    """
    folder = asked.runs / name
    going_on = (folder / "checkpoint.h5").exists()
    if not asked.draw:
        begun: Any = Simulation.resume(folder, "cpu") if going_on else scene
        if not going_on or begun.time < scene.end_time:
            every = scene.end_time / frames * (1 - 1e-6)  # just short of multiples of a fixed step
            simulate(begun, scene.end_time, output=folder, every=every, checkpoint_every=120.0)
    elif not going_on:
        raise InputError(f"there is no run in {folder}; leave --draw out.")
    return open_run(folder)


def frame_at(run: SavedRun, time: float) -> Frame:
    """The frame of a run that is nearest to a time [s]."""
    return next(iter(run.frames([int(np.argmin(np.abs(np.array(run.times) - time)))])))


def position_of(frame: Frame) -> NDArray[np.float64]:
    """Positions (n, 3) [m] of a frame's particles."""
    return np.asarray(frame.position, dtype=float)


def show(axes: Any, run: SavedRun, frame: Frame, look: Look, seen: tuple[Any, Any], title: str) -> None:
    """A frame as a panel: the box between two corners [m] as `refsim render` shows it."""
    series = Series(run, look, [0])
    series.low, series.high = (np.array(corner, dtype=float) for corner in seen)
    with matplotlib.rc_context({"figure.constrained_layout.use": False}):
        axes.imshow(series.picture(frame), interpolation="antialiased")
    axes.set_axis_off()
    axes.set_title(title, loc="center", weight="normal", fontsize=9.5)


def pieces(run: SavedRun, frame: Frame) -> tuple[int, int]:
    """(connected parts of more than one particle, lone particles) of a frame; particles in the solid are printed."""
    position = position_of(frame)
    if run.mesh is not None:
        inside = int((run.mesh.distance(position) < -0.01 * run.spacing).sum())
        print(f"{run.plan.scene.name}, {frame.time:.4g} s: {inside} particles in the solid")
    sizes = np.bincount(parts(position, run.spacing))
    return int((sizes > 1).sum()), int((sizes == 1).sum())


# Water poured over solids

SPACING = 0.2 * MM  # of the liquid at size 1
TENSION = 0.072  # nominal, of the cohesion alone [N/m]
ADHESION = 10.0  # of the solid, over the cohesion's coefficient, both in m^4/(kg s^2)
SOUND, VISCOSITY = 8.0, 4e-3  # m/s, Pa s


def shape(kind: str, *given: Any, **named: Any) -> Callable[[], Any]:
    """A mesh of `trimesh.creation`, made when it is needed."""

    def made() -> Any:
        import trimesh

        return getattr(trimesh.creation, kind)(*given, **named)

    return made


def funnel() -> Any:
    """Cone from 9 mm down to a spout of 1.8 mm, its wall 0.8 mm thick, its rim at 0."""
    line = np.array([[1.8, -13], [2.6, -13], [2.6, -8.4], [9.8, 0], [9.0, 0], [1.8, -8], [1.8, -13]]) * MM
    made = shape("revolve", line, sections=120)()
    made.fix_normals()
    return made


def jet(radius: float, length: float, start: tuple[float, float, float], spacing: float) -> NDArray[np.float64]:
    """(n, 3) positions [m] of an upright cylinder of liquid on a lattice."""
    n, layers = math.ceil(radius / spacing), max(1, round(length / spacing))
    across, up = (np.arange(-n, n) + 0.5) * spacing, (np.arange(layers) + 0.5) * spacing
    place = np.stack(np.meshgrid(up, across, across, indexing="ij")[::-1], axis=-1).reshape(-1, 3)
    return place[(place[:, :2] ** 2).sum(1) <= radius**2] + np.array(start)


@dataclass(frozen=True)
class Pour:
    """Water falls as a jet on a solid over a basin.

    solid    makes the mesh; jet: radius, length and lowest point of its axis above the middle [mm]
    floor    height of the basin's floor, and half of its width [mm]
    speed    of the jet at the start, downwards [m/s]; sound: speed of sound [m/s]
    times    that are drawn [s]
    seen     lower and upper corner of what the picture shows [mm]
    camera   as `refsim render` takes it; cut: a plane, or None
    """

    solid: Callable[[], Any]
    jet: tuple[float, float, float]
    floor: tuple[float, float]
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
        write_file(file, self.solid().export(file_type="obj"))
        radius, length, low = (MM * value for value in self.jet)
        floor, half = (MM * value for value in self.floor)
        cohesion = Akinci2013(surface_tension=TENSION, area_acceleration=0.0)
        liquid = WeaklyCompressible(sound_speed=self.sound, dynamic_viscosity=VISCOSITY / size, density="summation")
        beyond = {"open_faces": ("-x", "+x", "-y", "+y", "+z")}
        basin = BoxWalls(lower=(-half, -half, floor), upper=(half, half, low + 2 * length), **beyond)
        effects: tuple[Any, ...] = (liquid, Gravity(), basin)
        adhesion = 0.0
        if arm == "with":
            plan = make_plan(Scene(spacing=d, support_radius=2.7 * d, fluid=(Cloud(position=np.zeros((1, 3))),),
                                   effects=(liquid, cohesion)))  # fmt: skip
            adhesion = ADHESION * cohesion.coefficient(plan.grid, plan.effects)
            effects = (*effects, cohesion)
        return Scene(
            name=f"pour_{arm}", spacing=d, support_radius=2.7 * d, end_time=self.times[-1],
            fluid=(Cloud(position=jet(radius, length, (0.0, 0.0, low), d), velocity=(0.0, 0.0, -self.speed)),),
            effects=(*effects, MeshBoundary(file=str(file), viscosity=VISCOSITY / size, adhesion=adhesion)),
        )  # fmt: skip


POURS = {
    "pour_sphere": Pour(
        shape("icosphere", subdivisions=5, radius=5 * MM), (3.2, 25.2, 5.4), (-6, 24), 0.5, (0.018, 0.03),
        ((-11, -11, -6), (11, 11, 17)), "-60,18,1.25",
    ),
    "pour_funnel": Pour(
        funnel, (4.0, 16.0, -3.4), (-19, 18), 0.35, (0.02, 0.045), ((-14, -9, -19), (14, 9, 9)), "-90,12,1.25", "y=0",
        6.0,
    ),
    "pour_plate": Pour(
        shape("box", (14 * MM, 14 * MM, 0.8 * MM)), (3.2, 25.2, 0.8), (-8, 24), 0.9, (0.01, 0.018),
        ((-13, -13, -8), (13, 13, 14)), "-60,18,1.25",
    ),
}  # fmt: skip


def pour_picture(name: str, asked: argparse.Namespace) -> Any:
    """Without and with tension, a row each, at the times of the picture."""
    import matplotlib.pyplot as plt

    pour = POURS[name]
    figure, panels = plt.subplots(2, len(pour.times), figsize=(4.6 * len(pour.times), 8.0), squeeze=False)
    look = Look("water", camera=pour.camera, cut=pour.cut, size=PANEL)
    corners = MM * np.array(pour.seen)
    for row, (arm, arm_title) in zip(panels, ARMS.items()):
        key = f"{name}_{arm}"
        run = run_of(asked, key, pour.scene(arm, asked.size, asked.runs / key), 10)
        for axes, time in zip(row, pour.times):
            frame = frame_at(run, time)
            show(axes, run, frame, look, corners, f"{arm_title}: {pieces(run, frame)[1]:,} lone particles")
    solid = name.removeprefix("pour_")
    headline(figure, f"{len(frame.position):,} particles poured {'into' if solid == 'funnel' else 'on'} a {solid}")
    return figure


# Ice in water

ICE = {
    "melting": ("melts, as in figure 4", {}, (0.6, 1.3, 1.9), 2.4),
    "frozen": ("does not melt", {"melting": False}, (1.3, 4.0, 10.0), 10.0),
}  # title, options of the scene, times shown, end [s]


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


def ice_picture(name: str, asked: argparse.Namespace) -> Any:
    """The ice cube of melting figure 4, melting and not; below, its top and bottom against the level."""
    import matplotlib.pyplot as plt

    figure = plt.figure(figsize=(10.2, 8.6))
    grid = figure.add_gridspec(3, 6, height_ratios=(1.0, 1.0, 0.75))
    for line, (arm, (arm_title, options, times, until)) in enumerate(ICE.items()):
        scene = scene_of("figure_4", asked.size, end_time=until, **options)
        run = run_of(asked, f"{name}_{arm}", scene, round(until / 0.1))
        assert run.box is not None
        seen = run.box[0], run.box[1] * np.array([1.0, 1.0, 0.84])
        ice = [int((run.solid_body(frame_at(run, time)) >= 0).sum()) for time in (0.0, *times)]
        for k, time in enumerate(times):
            axes = figure.add_subplot(grid[line, 2 * k : 2 * k + 2])
            title = f"{arm_title}: {100 * ice[k + 1] / ice[0]:.0f} % ice"
            show(axes, run, frame_at(run, time), Look("water", camera="-68,14", size=SQUARE), seen, title)
        time, low, high, level = np.array([(f.time, *levels(f, run)) for f in run.frames(range(len(run.times)))]).T
        axes = figure.add_subplot(grid[2, 3 * line : 3 * line + 3])
        axes.fill_between(time, low, high, color="#b9cfe0", label="ice, bottom to top")
        axes.plot(time, level, color=BLUE, label="water level")
        axes.set(
            xlabel="time [s]", ylabel="height [m]", title=f"ice that {arm_title.partition(',')[0]}", ylim=(0, None)
        )
        axes.grid(True)
        axes.legend(loc="upper right")
    above, weight = high[-1] - level[-1], (1 - 917 / 1000) * (high[0] - low[0])
    arm_title = f"Ice that does not melt, after {time[-1]:.0f} s: its top is {abs(above):.2f} m"
    arm_title += f" {'above' if above > 0 else 'below'} the level (by its weight: {weight:.2f} m above)"
    headline(figure, arm_title)
    return figure


# Dong, Zhang & Chen 2016, figure 3, at twice the linear resolution of validation/experiments/dong

FINER = 2


def dong_cube(name: str, asked: argparse.Namespace) -> Any:
    """Figure 3: a cube of 0.5 m without gravity becomes a ball and an octahedron and swings."""
    import matplotlib.pyplot as plt

    side = round(FINER * 17 * asked.size)
    scene = msgspec.structs.replace(dong.cube_scene(*dong.start("cube", side**3)), end_time=4.0)
    run = run_of(asked, name, scene, 100)
    frames = list(run.frames(range(len(run.times))))
    moment = np.array([cubic_moment(position_of(frame)) for frame in frames])
    top = next((k for k in range(2, len(moment) - 1) if moment[k] > 0 and moment[k] >= moment[k + 1]), len(moment) // 2)
    ball = int(np.argmin(np.abs(moment[: top + 1])))
    after = next((k for k in range(top, len(moment)) if moment[k] <= 0), len(moment) - 1)
    figure, panels = plt.subplots(2, 3, figsize=(9.6, 6.9))
    look = Look("water", camera="12,9", size=SQUARE)
    for axes, k in zip(panels.flat, (0, ball // 2, ball, top, after, len(moment) - 1)):
        middle = position_of(frames[k]).mean(0)
        show(axes, run, frames[k], look, (middle - 0.36, middle + 0.36), f"q4 {moment[k]:+.3f}")
    headline(figure, f"Dong, figure 3: a cube of 0.5 m without gravity, {side**3:,} particles")
    return figure


PICTURES: dict[str, Callable[[str, argparse.Namespace], Any]] = {
    **dict.fromkeys(POURS, pour_picture),
    "ice_floats": ice_picture,
    "dong_figure_3_fine": dong_cube,
}


OPTIONS = {
    "--size": {"type": float, "default": 1.0, "help": "resolution over the printed one (1)"},
    "--draw": {"action": "store_true", "help": "draw from the runs that are there"},
    "--runs": {"type": lambda path: Path(path).resolve(), "default": RUNS, "help": "of the runs (build/printed)"},
}


if __name__ == "__main__":
    sys.exit(command(__doc__, PICTURES, FOLDER, suffix=".webp", options=OPTIONS))
