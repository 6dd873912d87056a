"""Hard cases of weakly compressible liquid, its walls, neighbour list and files; its largest stable step."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from refsim import (
    Ball,
    Box,
    BoxWalls,
    Cloud,
    Gravity,
    JiangZhu2023,
    Scene,
    Simulation,
    SurfaceDetection,
    WeaklyCompressible,
)
from refsim.boundary.akinci_2012 import calibrated_factor, wall_kernel_sums
from refsim.core.errors import RunStopped
from refsim.core.walls import WallParticles
from refsim.engine.driver import simulate
from refsim.io.checkpoint import read_checkpoint, write_checkpoint
from refsim.neighbours.reference import pair_blocks
from refsim.scene.files import scene_to_toml
from refsim.scene.plan import Plan, make_plan
from validation.results import Result
from validation.running import Context, momenta
from validation.trials import Cell, StabilityMap, Trial, largest_stable, silent_up_to

SPACING, SUPPORT = 0.01, 0.026  # [m]
SOUND, DENSITY = 20.0, 1000.0  # [m/s], [kg/m^3]
GRAVITY = 9.81


def liquid(
    fluid: Any,
    *effects: Any,
    viscosity: float = 0.5,
    kernels: str = "wendland",
    state: str = "tait",
    **changes: Any,
) -> Scene:
    """Water-like liquid of the given parts, without gravity and tension unless `effects` bring them."""
    parts = fluid if isinstance(fluid, tuple) else (fluid,)
    own = WeaklyCompressible(
        rest_density=DENSITY, sound_speed=SOUND, dynamic_viscosity=viscosity, kernels=kernels, state=state
    )
    return Scene(
        **{"spacing": SPACING, "support_radius": SUPPORT, "fluid": parts, "effects": (own, *effects), **changes}
    )


def tank(columns: int = 16, **changes: Any) -> Scene:
    """A column of columns x 2 columns particles in 2D that collapses in a tank four times as long.

    Its numerical viscosity stands to the spacing as in the dam break.
    """
    size = columns * SPACING
    changes = {"viscosity": 320.0 * SPACING, **changes}
    walls = BoxWalls(lower=(0.0, 0.0, 0.0), upper=(4 * size, 4 * size, 0.0))
    return liquid(
        Box(cells=(columns, 2 * columns, 1)), Gravity(acceleration=(0.0, -GRAVITY, 0.0)), walls, dim=2, **changes
    )


def tension(**changes: Any) -> JiangZhu2023:
    """Tension whose internal pressure is 3 % of rho0 c^2, as in the droplet."""
    return JiangZhu2023(**{"surface_tension": 0.03 * DENSITY * SOUND**2 * SUPPORT / 7.8, **changes})


# Few particles, and particles at one place


def coincident_start(context: Context, backend: str) -> Result:
    """Two particles at one place in the scene are refused, by number."""
    trial = Trial(context, backend)
    points = _block(4)
    points[17] = points[5]
    with trial.ending():
        trial.start(liquid(Cloud(position=points)))
    trial.check("the sentence names both", "5 and 17" in trial.message, equals=1)
    return trial.result()


def coincident_later(context: Context, backend: str) -> Result:
    """Particles that come to one place in the middle of a run: a checkpoint is edited, so that two coincide."""
    trial = Trial(context, backend)
    with trial.ending(), tempfile.TemporaryDirectory() as folder:
        simulation = trial.start(liquid(Box(cells=(6, 6, 6)), tension()))
        trial.advance(simulation, steps=5)
        path = Path(folder) / "edited.h5"
        simulation.checkpoint(path)
        saved = read_checkpoint(path)
        x = saved.arrays["field.position"]
        j = int(np.argsort(np.linalg.norm(x - x[100], axis=1))[1])
        x[j] = x[100]
        saved.arrays["build_position"][j] = x[100]
        saved.arrays["field.velocity"][j] = saved.arrays["field.velocity"][100]
        write_checkpoint(path, saved.arrays, saved.attributes)
        edited = Simulation.resume(path, backend)
        context.started.append((0.0, edited))
        before = momenta(edited)["momentum"]
        trial.advance(edited, steps=200)
        after = momenta(edited)
        drift = float(np.linalg.norm(after["momentum"] - before)) / after["momentum_scale"]
        trial.check("momentum gained over sum of m |v|", drift, at_most=32 * 1.2e-7)
        trial.check("greatest speed over c", _speed(edited) / SOUND, at_most=0.5)
        near = _nearest(edited.field("position"))
        trial.show("least distance at the end [d]", float(near.min()) / SPACING)
    return trial.result()


def few(context: Context, backend: str, count: int) -> Result:
    """One to four particles fall freely, with tension and detection switched on, although neighbours are missing."""
    trial = Trial(context, backend)
    points = SPACING * np.array([[0.0, 0, 0], [0.4, 0, 0], [0.2, 0.5, 0], [0.1, 0.2, 0.6]])[:count]
    scene = liquid(Cloud(position=points), Gravity(), tension(), SurfaceDetection(each_step=True), dtype="float32")
    with trial.ending():
        simulation = trial.start(scene)
        trial.advance(simulation, steps=300)
        simulation.evaluate()
        mean = simulation.field("velocity")[:, 2].astype(float).mean()
        half = simulation.last.length / 2  # velocities are half a step behind
        fall = abs(mean / (-GRAVITY * (simulation.time - half)) - 1)
        trial.check("mean velocity against g t, relative", fall, at_most=1e-4)
        trial.check("flagged as surface", int(simulation.field("surface").sum()), equals=count)
        centre = simulation.field("position").astype(float).mean(0) - points.mean(0)
        trial.check("sideways drift [d]", float(np.abs(centre[:2]).max()) / SPACING, at_most=1e-3)
        if count > 1:
            trial.show("extent at the end [h]", float(np.ptp(simulation.field("position"), axis=0).max()) / SUPPORT)
    return trial.result()


def almost_one(context: Context, backend: str, dtype: str, gap: float = 1e-12) -> Result:
    """Two particles 1e-12 spacings apart, alone and in a block. In float32 they are one place, which is refused."""
    trial = Trial(context, backend)
    points = _block(4)
    points = np.vstack([points, points[21] + [gap * SPACING, 0.0, 0.0], [[1.0, 0, 0]], [[1.0 + gap * SPACING, 0, 0]]])
    with trial.ending():
        simulation = trial.start(liquid(Cloud(position=points), tension(), dtype=dtype))
        trial.advance(simulation, steps=100)
        trial.account(simulation, isolated=True)
        trial.check("greatest speed over c", _speed(simulation) / SOUND, at_most=0.5)
        pair = simulation.field("position")[-2:].astype(float)
        trial.show("lone pair at the end [d]", float(np.linalg.norm(pair[0] - pair[1])) / SPACING)
    return trial.result()


def empty(context: Context, backend: str, how: str) -> Result:
    """A scene without particles is refused: no parts at all, or a cloud of none."""
    trial = Trial(context, backend)
    with trial.ending():
        trial.start(liquid(() if how == "no parts" else Cloud(position=np.zeros((0, 3)))))
    trial.check("the sentence says what to add", "add a fluid" in trial.message, equals=1)
    return trial.result()


def mass_ratio(context: Context, backend: str, how: str) -> Result:
    """Masses of 1000:1 in one block: one heavy particle, or a heavy half beside a light one.

    J(7) sums m_j W_ij, so that every neighbour of the heavy particle is hundreds of times too dense; Tait's seventh
    power makes that a pressure without measure.
    """
    trial = Trial(context, backend)
    points = _block(8)
    mass = np.full(len(points), DENSITY * SPACING**3)
    if how == "one":
        mass[219] *= 1000
    else:
        mass[points[:, 0] > points[:, 0].mean()] /= 1000
    with trial.ending():
        simulation = trial.start(liquid(Cloud(position=points, mass=mass)))
        trial.advance(simulation, until=0.05)
        trial.account(simulation, isolated=True)
        energy = 0.5 * float(mass.sum()) * SOUND**2
        trial.check("kinetic energy over m c^2/2", momenta(simulation)["kinetic_energy"] / energy, at_most=0.1)
    return trial.result()


# Nothing, and too much


def nothing_acts(context: Context, backend: str) -> Result:
    """Tension, viscosity and gravity of zero: a block at rest stays at rest to the last bit, a moving one keeps its
    velocity and shape."""
    trial = Trial(context, backend)
    moving = (0.3, -0.2, 0.1)
    for velocity in ((0.0, 0.0, 0.0), moving):
        with trial.ending():
            block = Box(cells=(6, 6, 6), velocity=velocity)
            none = (Gravity(acceleration=(0.0, 0.0, 0.0)), JiangZhu2023(surface_tension=0.0))
            simulation = trial.start(liquid(block, *none, viscosity=0.0))
            start = simulation.field("position").astype(float)
            trial.advance(simulation, steps=100)
            change = float(np.abs(simulation.field("velocity") - np.array(velocity, dtype=np.float32)).max())
            displacement = simulation.field("position").astype(float) - start - np.array(velocity) * simulation.time
            if velocity == moving:
                trial.check("change of velocity over c, moving", change / SOUND, at_most=1e-5)
                trial.check("change of shape, moving [d]", float(np.abs(displacement).max()) / SPACING, at_most=1e-3)
            else:
                trial.check("change of velocity at rest", change, equals=0)
                trial.check("change of place at rest", float(np.abs(displacement).max()), equals=0)
    return trial.result()


def collapse(
    context: Context, backend: str, factor: float = 0.0, viscosity: float = 320.0 * SPACING, columns: int = 16
) -> Result:
    """A collapsing column with a fixed step of `factor` times the first stable one; 0: the runner's own steps."""
    trial = Trial(context, backend)
    with trial.ending():
        scene = tank(columns, viscosity=viscosity)
        step = factor * trial.start(scene).step().length if factor else 0.0
        simulation = trial.start(msgspec.structs.replace(scene, step=step))
        height = 2 * columns * SPACING
        energy, potential = _Energy(simulation), GRAVITY * 0.5 * height
        trial.advance(simulation, until=4 * math.sqrt(height / GRAVITY), watch=energy, every=4)
        share = energy.rise / (DENSITY * 2 * (columns * SPACING) ** 2 * potential)
        trial.check_unless_noted(
            simulation, "viscosity", "rise of kinetic + potential energy over the start's", share, at_most=0.01
        )
        trial.check("particles outside the tank", _outside(simulation), equals=0)
        trial.show("stopped at walls", simulation.stopped_at_walls)
    return trial.result()


def closed_box(columns: int = 16, mach: float = 0.075, **changes: Any) -> Scene:
    """A block that fills half of a closed 2D box and moves towards its other half, without gravity."""
    size = 2 * columns * SPACING
    block = Box(cells=(columns, 2 * columns, 1), velocity=(mach * SOUND, 0.0, 0.0))
    return liquid(block, BoxWalls(lower=(0.0, 0.0, 0.0), upper=(size, size, 0.0)), dim=2, **changes)


def thrown_about(context: Context, backend: str, until: float = 1.0) -> Result:
    """A block between the walls of a closed box: no gravity, no viscosity, nothing that could bring energy."""
    trial = Trial(context, backend)
    with trial.ending():
        simulation = trial.start(closed_box(viscosity=0.0))
        energy = [momenta(simulation)["kinetic_energy"]]

        def watch(simulation: Simulation) -> None:
            energy.append(momenta(simulation)["kinetic_energy"])

        trial.advance(simulation, until=until, watch=watch, every=4)
        trial.check_unless_noted(
            simulation, "viscosity", "kinetic energy over the start's", max(energy) / energy[0], at_most=1.01
        )
        trial.check("particles outside the box", _outside(simulation), equals=0)
    return trial.result()


def impact(context: Context, backend: str, what: str, mach: float = 0.3) -> Result:
    """A cube hits a wall, or two cubes hit each other, at 0.3 of the sound speed."""
    trial = Trial(context, backend)
    n, speed = 10, mach * SOUND
    size = n * SPACING
    room = BoxWalls(lower=(-2 * size, -2 * size, 0.0), upper=(3 * size, 3 * size, 8 * size))
    if what == "wall":
        fluid: Any = Box(lower=(0.0, 0.0, 1.5 * SPACING), cells=(n, n, n), velocity=(0.0, 0.0, -speed))
        effects: tuple = (room,)
    else:
        above = Box(lower=(0.3 * SPACING, 0.2 * SPACING, size + SPACING), cells=(n, n, n), velocity=(0, 0, -speed))
        fluid, effects = (Box(cells=(n, n, n), velocity=(0.0, 0.0, speed)), above), ()
    with trial.ending():
        simulation = trial.start(liquid(fluid, *effects, viscosity=1.0))
        before = momenta(simulation)
        peak = []

        def watch(simulation: Simulation) -> None:
            peak.append(momenta(simulation)["kinetic_energy"])

        trial.advance(simulation, until=3 * size / speed, watch=watch, every=4)
        trial.check("kinetic energy over the start's", max(peak) / before["kinetic_energy"], at_most=1.01)
        trial.check("greatest speed over the impact's", _speed(simulation) / speed, at_most=3.0)
        near = _nearest(simulation.field("position"))
        trial.check("least distance [d]", float(near.min()) / SPACING, at_least=0.1)
        if what == "wall":
            trial.check("particles outside the box", _outside(simulation), equals=0)
            trial.show("stopped at walls", simulation.stopped_at_walls)
        else:
            after = momenta(simulation)["momentum"]
            drift = float(np.linalg.norm(after - before["momentum"])) / before["momentum_scale"]
            trial.check("momentum gained over sum of m |v|", drift, at_most=32 * 1.2e-7)
    return trial.result()


def sharp_edge(context: Context, backend: str, edge: str) -> Result:
    """A 2D drop falls on the edge of a wedge of 60 degrees, on the end of an upright plate one particle thin, or with
    half of it beyond the end of a level plate. The walls' particles alone hold it: there are no planes."""
    trial = Trial(context, backend)
    with trial.ending():
        plan, inside = _edge_plan(edge)
        simulation = trial.start(plan)
        start = momenta(simulation)["kinetic_energy"] / float(simulation.field("mass").astype(float).sum())
        trial.advance(simulation, until=0.25)
        x = simulation.field("position").astype(float)
        trial.check("particles inside the wall", int(inside(x).sum()), equals=0)
        below = start + GRAVITY * (x[:, 1].max() - x[:, 1].min() + 0.4)
        share = _speed(simulation) / math.sqrt(2 * below)
        trial.check("greatest speed over that of free fall", share, at_most=1.5)
        trial.check("least distance [d]", float(_nearest(x).min()) / SPACING, at_least=0.05)
    return trial.result(position=simulation.field("position"), walls=plan.walls.position)


def _edge_plan(edge: str) -> tuple[Plan, Any]:
    """A drop above an edge at the origin; and a function that says who is inside the wall's body."""
    reach = np.arange(0, 41) * SPACING
    if edge == "wedge":
        slope = math.radians(60)  # of each side
        right = np.stack([reach * math.cos(slope), -reach * math.sin(slope)], axis=1)
        wall = np.vstack([right, right[1:] * [-1.0, 1.0]])

        def inside(x: np.ndarray) -> np.ndarray:
            deep = -x[:, 1] * math.cos(slope) - np.abs(x[:, 0]) * math.sin(slope)
            return (deep > 0) & (x[:, 1] > -0.95 * reach[-1] * math.sin(slope))

    elif edge == "upright plate":
        wall = np.stack([0 * reach, -reach], axis=1)

        def inside(x: np.ndarray) -> np.ndarray:  # on the plate's particles: it has no inside, and is not crossed
            return (np.abs(x[:, 0]) < 0.25 * SPACING) & (x[:, 1] < 0) & (x[:, 1] > -0.95 * reach[-1])

    else:
        wall = np.stack([-reach, 0 * reach], axis=1)

        def inside(x: np.ndarray) -> np.ndarray:  # under the plate, farther from its end than a drop can flow round
            return (x[:, 1] < 0) & (x[:, 0] < -4 * SPACING)

    wall = np.hstack([wall, np.zeros((len(wall), 1))])
    radius = 8.2 * SPACING
    drop = Ball(center=(0.15 * SPACING, radius + 1.2 * SPACING, 0.0), radius=radius, velocity=(0.0, -1.0, 0.0))
    scene = liquid(drop, Gravity(acceleration=(0.0, -GRAVITY, 0.0)), dim=2)
    volume = calibrated_factor("wendland_c2", SUPPORT, SPACING, 2) / wall_kernel_sums(wall, "wendland_c2", SUPPORT, 2)
    return dataclasses.replace(make_plan(scene), walls=WallParticles(wall, volume)), inside


# Places


def cell_borders(context: Context, backend: str, dtype: str) -> Result:
    """A block whose particles lie exactly on the borders of the list's cells: the list holds every pair, and the run
    is that of the block moved off the borders."""
    trial = Trial(context, backend)
    spacing, support = 2.0**-6, 2.5 * 2.0**-6
    skin = 0.2  # the list reaches to 3 spacings: every third layer lies on a border
    n = 9
    lattice = spacing * np.stack(np.meshgrid(*[np.arange(n) - 4.0] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    with trial.ending():
        found = []
        for shift in (0.0, 0.5 * spacing):
            scene = liquid(
                Cloud(position=lattice + shift),
                tension(),
                spacing=spacing,
                support_radius=support,
                skin=skin,
                dtype=dtype,
            )
            simulation = trial.start(scene)
            simulation.evaluate()
            near = sum(int((r < support).sum()) for _, _, r in pair_blocks(lattice + shift, lattice + shift, None))
            count = simulation.field("density").astype(float)
            found.append((near, count))
            trial.advance(simulation, steps=30)
            trial.account(simulation, isolated=True)
            found[-1] += (simulation.field("position").astype(float) - shift,)
        eps = float(np.finfo(dtype).eps)
        apart = float(np.abs(found[0][1] / found[1][1] - 1).max())
        trial.check("densities on and off the borders, relative", apart, at_most=200 * eps)
        away = float(np.abs(found[0][2] - found[1][2]).max()) / spacing
        trial.check(
            "places after 30 steps on and off the borders [d]", away, at_most=1e-2 if dtype == "float32" else 1e-9
        )
    return trial.result()


def far_away(context: Context, backend: str, dtype: str, spacings: float = 1e6) -> Result:
    """A drop at (-1e6, -1e6, 1e6) spacings moves as the same drop at the origin does."""
    trial = Trial(context, backend)
    place = spacings * SPACING * np.array([-1.0, -1.0, 1.0])
    places, notes = [], []
    with trial.ending():
        for centre in (np.zeros(3), place):
            simulation = trial.start(liquid(Ball(center=tuple(centre), radius=4.2 * SPACING), tension(), dtype=dtype))
            start = simulation.field("position").astype(float)
            trial.advance(simulation, steps=150)
            places.append(simulation.field("position").astype(float) - start)
            notes.append(" ".join(simulation.notes))
        trial.show("said at the origin", notes[0])
        trial.show("said far away", notes[1])
        moved = float(np.abs(places[0]).max()) / SPACING
        trial.show("greatest displacement at the origin [d]", moved)
        apart = float(np.abs(places[1] - places[0]).max()) / SPACING
        trial.check("displacements at the origin and far away differ by [d]", apart, at_most=1e-3)
    return trial.result()


def leaves(context: Context, backend: str, spacings: float = 1e6) -> Result:
    """One particle leaves a block at 9 c and is a million spacings away in the end: no particle is lost, and the others
    move as without it."""
    trial = Trial(context, backend)
    block = Box(cells=(6, 6, 6))
    flung = Cloud(position=[[0.5, 0.0, 0.0]], velocity=(9 * SOUND, 0.0, 0.0))
    with trial.ending():
        step = 0.5 * 0.4 * SUPPORT / (10 * SOUND)
        alone, both = (trial.start(liquid(parts, tension(), step=step)) for parts in ((block,), (block, flung)))
        trial.advance(both, steps=300)
        trial.advance(alone, steps=300)
        far = float(both.field("position")[-1, 0]) / SPACING
        trial.show("distance at the end [d]", far)
        trial.check(
            "velocity kept, relative", abs(float(both.field("velocity")[-1, 0]) / (9 * SOUND) - 1), at_most=1e-6
        )
        apart = float(np.abs(both.field("position")[:-1] - alone.field("position")).max()) / SPACING
        trial.check("places of the others with and without it [d]", apart, at_most=0.02)
    with trial.ending():
        lone = Cloud(position=[[spacings * SPACING, 0.0, 0.0], [-spacings * SPACING, 0.0, 0.0]])
        simulation = trial.start(liquid((block, lone), tension()))
        trial.advance(simulation, steps=50)
        trial.check(
            "list bytes with two particles a million spacings off", simulation.search.log.list_bytes, at_most=1e6
        )
    return trial.result()


def overflow(context: Context, backend: str, count: int) -> Result:
    """A cloud squeezed into a support radius: the list grows to every pair, or the run stops as collapsed."""
    trial = Trial(context, backend)
    points = np.random.default_rng(4).uniform(0.0, 0.5 * SUPPORT, (count, 3))
    with trial.ending():
        simulation = trial.start(liquid(Cloud(position=points, mass=np.full(count, DENSITY * SPACING**3 / count))))
        trial.advance(simulation, steps=3)
        trial.check("neighbours in the list", simulation.search.log.most_neighbours, equals=count - 1)
    return trial.result()


# Files


def killed(context: Context, backend: str, kills: int = 4) -> Result:
    """SIGKILL while checkpoints are written without pause; every time the run is resumed, and it ends bit for bit where
    one that was never killed ends."""
    trial = Trial(context, backend)
    scene = tank(8, end_time=100.0)
    random = np.random.default_rng(7)
    with trial.ending(), tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder) / "tank.toml", Path(folder) / "out"
        path.write_text(scene_to_toml(scene))
        steps, lost = 0, 0
        for k in range(kills):
            command = [str(path)] if k == 0 else ["--resume", str(out)]
            known = _run_and_kill([*command, "--output", str(out), "--backend", backend], out, steps + 10, random)
            steps = Simulation.resume(out, backend).steps
            lost = max(lost, known - steps)
        trial.check("steps lost that a report had promised", lost, at_most=0)
        survivor = Simulation.resume(out, backend)
        straight = trial.start(scene)
        context.started.append((0.0, survivor))
        trial.advance(survivor, steps=20)
        trial.advance(straight, steps=survivor.steps)
        trial.check("bits that differ from the run never killed", _different(survivor, straight), equals=0)
    return trial.result()


def _run_and_kill(arguments: list[str], out: Path, steps: int, random: np.random.Generator) -> int:
    """Start `refsim run`, kill it at a random moment after it has reported `steps`; the steps reported last."""
    root = str(Path(__file__).resolve().parents[3])
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([root, os.environ.get("PYTHONPATH", "")])}
    command = [
        sys.executable,
        "-m",
        "refsim",
        "run",
        *arguments,
        "--checkpoint-every",
        "0",
        "--until",
        "100",
        "--quiet",
    ]
    process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    try:
        ends = time.monotonic() + 300
        while _reported(out) < steps and process.poll() is None and time.monotonic() < ends:
            time.sleep(0.01)
        time.sleep(random.uniform(0.0, 0.05))
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGKILL)
        _, said = process.communicate()
    if process.returncode != -signal.SIGKILL:
        raise RuntimeError(f"refsim run ended by itself: {said.decode()[-500:]}")
    return _reported(out)


def _reported(out: Path) -> int:
    try:
        return int(json.loads((out / "report.json").read_text())["steps"])
    except (OSError, ValueError):
        return 0


def disk_full(context: Context, backend: str) -> Result:
    """The disk is full when a checkpoint is due: it stops by name, the last checkpoint is whole, and the run goes
    on from it bit for bit."""
    trial = Trial(context, backend)
    scene = tank(8, end_time=100.0)
    with tempfile.TemporaryDirectory() as folder:
        with trial.ending():
            simulation = trial.start(scene)
            with _room() as shrink:

                def progress(simulation: Simulation) -> None:
                    if simulation.steps == 12:
                        shrink(4096)

                simulate(simulation, output=folder, checkpoint_every=0.0, every=50.0, progress=progress)
        stop = trial.ended
        with trial.ending():
            resumed = Simulation.resume(folder, backend)
            trial.check("steps of the last whole checkpoint", resumed.steps, at_least=11)
            trial.advance(resumed, steps=20)
            straight = trial.start(scene)
            trial.advance(straight, steps=resumed.steps)
            trial.check("bits that differ from an undisturbed run", _different(resumed, straight), equals=0)
        trial.ended = stop
    return trial.result()


@contextmanager
def _room() -> Iterator[Any]:
    """A function that limits the size of files that this process can write; lifted at the end."""
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, handler)


def other_backend(context: Context, backend: str, through: tuple[str, ...] = ("numpy",)) -> Result:
    """A run handed from one backend to the next and back by checkpoints goes on from the same state and says so."""
    trial = Trial(context, backend)
    scene = tank(6)
    with trial.ending(), tempfile.TemporaryDirectory() as folder:
        straight, handed = trial.start(scene), trial.start(scene)
        trial.advance(handed, steps=20)
        said = []
        for k, name in enumerate((*through, backend)):
            path = Path(folder) / f"{k}.h5"
            handed.checkpoint(path)
            before = handed
            handed = Simulation.resume(path, name)
            context.started.append((0.0, handed))
            same = max(float(np.abs(handed.field(f) - before.field(f)).max()) for f in ("position", "velocity", "mass"))
            trial.check("change of the state in the hand-over", same, equals=0)
            said.append(any("not bit for bit" in note for note in handed.notes))
            trial.advance(handed, steps=10)
        trial.check("hand-overs that said so", sum(said), equals=len(said))
        trial.advance(straight, steps=handed.steps)
        apart = float(np.abs(handed.field("position") - straight.field("position")).max()) / SPACING
        trial.check("places against a run on one backend [d]", apart, at_most=1e-3)
        trial.check("time against a run on one backend, relative", abs(handed.time / straight.time - 1), at_most=1e-5)
    return trial.result()


# Measures


def _block(n: int) -> np.ndarray:
    return Box(cells=(n, n, n)).positions(make_plan(liquid(Box(cells=(1, 1, 1)))).grid)


def _nearest(position: np.ndarray) -> np.ndarray:
    from validation.metrics.droplet import nearest_neighbour_distance

    return nearest_neighbour_distance(position.astype(float))


def _speed(simulation: Simulation) -> float:
    return float(np.linalg.norm(simulation.field("velocity").astype(float), axis=1).max())


def _outside(simulation: Simulation) -> int:
    from refsim.engine.stock import stock

    return stock(simulation)["outside_walls"]


def _different(first: Simulation, second: Simulation) -> int:
    """Arrays that outlive a step and are not equal bit for bit."""
    a, b = first.snapshot(), second.snapshot()
    return sum(array.tobytes() != b.arrays[name].tobytes() for name, array in a.arrays.items()) + (
        first.time != second.time
    )


class _Energy:
    """Kinetic and potential energy over a run; `rise` is how far it ever came above the start's [J; J/m in 2D]."""

    def __init__(self, simulation: Simulation, gravity: float = GRAVITY) -> None:
        self.gravity = gravity
        self.start, self.rise = self.of(simulation), 0.0

    def of(self, simulation: Simulation) -> float:
        mass, height = (simulation.field(name).astype(float) for name in ("mass", "position"))
        return momenta(simulation)["kinetic_energy"] + self.gravity * float(mass @ height[:, 1])

    def __call__(self, simulation: Simulation) -> None:
        self.rise = max(self.rise, self.of(simulation) - self.start)


# The map


def step_cell(context: Context, backend: str, state: str, kernels: str, viscosity: float) -> Result:
    """The largest share of the runner's own step with which the column collapses as it does with half of it."""
    columns = 12
    height = 2 * columns * SPACING
    weight = DENSITY * 2 * (columns * SPACING) ** 2 * GRAVITY * 0.5 * height
    plan = make_plan(tank(columns, viscosity=viscosity, kernels=kernels, state=state))
    limiter: dict[str, int] = {}

    def run(factor: float) -> tuple[str, float]:
        forced = dataclasses.replace(plan, scene=msgspec.structs.replace(plan.scene, step_factor=factor))
        simulation = context.simulation(forced, backend)
        energy = _Energy(simulation)
        try:
            while simulation.time < 4 * math.sqrt(height / GRAVITY):
                simulation.step()
                if simulation.steps % 8 == 0:
                    energy(simulation)
        except RunStopped as stop:
            return f"stopped: {stop.reason}", math.inf
        limiter.update(simulation.limiters)
        return "a particle outside the tank" if _outside(simulation) else "", energy.rise / weight

    _, unavoidable = run(0.5)  # what the viscosity lets pass whatever the step

    def trouble(factor: float) -> str:
        said, rise = run(factor)
        return said or (f"energy rises by {100 * rise:.0f} %" if rise > 1.5 * unavoidable + 0.02 else "")

    found = largest_stable(trouble, 1.0, 0.25, 16.0)
    return found.result(1.0, limiter=max(limiter, key=lambda k: limiter[k]) if limiter else "")


_COLUMNS = {"mu = 3.2 Pa s (acoustic)": 3.2, "mu = 40 Pa s (viscous)": 40.0}
STEP_MAP = StabilityMap(
    name="stability_tank_step",
    title="Largest stable step of a collapsing column (2D, walls)",
    quantity="step over the runner's own",
    criterion="the run ends, no particle leaves, the energy rises by at most 1.5 times that of half the step + 2 %.",
    advice="Keep step_factor at 1; what lies above it is a reserve, not an offer.",
    cells=tuple(
        Cell(f"{state}, {kernels}", column, step_cell, {"state": state, "kernels": kernels, "viscosity": viscosity})
        for state in ("tait", "linear")
        for kernels in ("wendland", "mueller")
        for column, viscosity in _COLUMNS.items()
    ),
)


def viscosity_cell(context: Context, backend: str, scene: str, kernels: str, columns: int) -> Result:
    """The largest c h/nu with which a liquid between walls gains no energy."""

    def made(number: float) -> Scene:
        viscosity = DENSITY * SOUND * SUPPORT / number
        return (tank if scene == "tank" else closed_box)(columns, viscosity=viscosity, kernels=kernels)

    def trouble(number: float) -> str:
        simulation = context.simulation(made(number), backend)
        energy = _Energy(simulation, gravity=GRAVITY if scene == "tank" else 0.0)
        until = 1.0 if scene == "box" else 4 * math.sqrt(2 * columns * SPACING / GRAVITY)
        try:
            while simulation.time < until:
                simulation.step()
                if simulation.steps % 8 == 0:
                    energy(simulation)
        except RunStopped as stop:
            return f"stopped: {stop.reason}"
        finally:
            context.started[:-1] = []
        rise = energy.rise / energy.start
        return f"energy rises by {100 * rise:.0f} %" if rise > 0.01 else ""

    return largest_stable(trouble, 128.0, 8.0, 16384.0, factor=1.2).result(silent_up_to(made, 8.0, 16384.0))


VISCOSITY_MAP = StabilityMap(
    name="stability_viscosity",
    title="Lowest viscosity of liquid between walls (2D)",
    quantity="c h/nu",
    criterion="kinetic and potential energy never rise by 1 % of the start's.",
    advice="Give liquid between walls a viscosity of rho0 c h/250 with Wendland kernels, rho0 c h/80 with others.",
    cells=tuple(
        Cell(
            f"{words}, {columns} wide", kernels, viscosity_cell,
            {"scene": scene, "kernels": kernels, "columns": columns}, seconds=20.0 if columns == 12 else 60.0,
        )
        for scene, words in (("tank", "column in a tank"), ("box", "block in a box"))
        for columns in (12, 24)
        for kernels in ("wendland", "mueller", "cubic_spline")
    ),
)  # fmt: skip

MAPS = (STEP_MAP, VISCOSITY_MAP)
