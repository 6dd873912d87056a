"""The scenes of Dong, Zhang & Chen 2016: a cube of 0.5 m without gravity, and a block that falls into a room of 1 m.

The paper gives k = lambda = mu = 0.001, h = 1.5 d and dt = 0.005 s. They are the `PRINTED` settings; the others are
this project's. Units are SI.
"""

import math
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from refsim import BoxWalls, Cloud, CsfWang2019, Dong2016, Gravity, Scene, TartakovskyMeakin2005, WeaklyCompressible
from validation.metrics.shapes import lattice_ball, lattice_cube, rotated_box, rotated_lattice_cube

DENSITY, OIL = 1000.0, 900.0  # kg/m^3
SIDE, BLOCK, ROOM = 0.5, 0.25, 1.0  # m
CELLS = (9, 9, 10)  # the block's 810 particles
HEIGHT = 0.2  # m between block and floor; the paper does not say. It lands at frame 40
FRAME = 0.005  # s; the paper's step, taken for the time from one frame to the next
FRAMES = (60, 70, 80, 90)  # figure 4
LATER = (120, 160)  # when the film of the run with tension has broken up
PUDDLE = 3 * BLOCK / CELLS[0]  # m, three layers
# 17 N/m, no number of the paper: with it a puddle at rest that does not wet, 2 sqrt(sigma/(rho0 g)) thick, has the
# three layers of figure 5.
TENSION = DENSITY * 9.81 * PUDDLE**2 / 4
RATIO = {"mueller": 3.20247, "wendland": 2.4392}  # measured over nominal tension, as the sigma map had it then
PRINTED = {"stiffness": 1e-3, "correction": 1e-3}
PRINTED_SUPPORT, PRINTED_STEP, PRINTED_VISCOSITY = 1.5, 0.005, 1e-3
PRINTED_BOUND = 10.0  # of the density: the printed block lands faster than its sound, at up to 4.8 rho0
CUBE_VISCOSITY = 2.0  # Pa s: an Ohnesorge number of 0.03, so that the cube overshoots
CALM = 7.5  # Pa s, with which small drops come to rest
FALL_NOMINAL, FALL_VISCOSITY, FALL_SOUND = 0.5 * TENSION, 7.5, 25.0  # N/m, Pa s (what keeps the energy), m/s
MODELS = {"dong": "Dong 2016", "iif": "plain pair force (Tartakovsky & Meakin 2005)", "csf": "continuum surface force"}


def liquid(density: float = DENSITY, **options: Any) -> WeaklyCompressible:
    """The paper's liquid: pressure after its reference 9, Becker & Teschner's p = rho0 c^2/7 ((rho/rho0)^7 - 1)."""
    return WeaklyCompressible(rest_density=density, state="tait", density="summation", **options)


def tension_of(model: str, nominal: float, **changes: Any) -> Any:
    """The effect of one of MODELS at a nominal tension [N/m]."""
    made = {"dong": Dong2016, "iif": TartakovskyMeakin2005, "csf": CsfWang2019}[model]
    return made(surface_tension=nominal, **changes)


def start(shape: str, count: int, seed: int = 1) -> tuple[NDArray, float]:
    """(positions (n, 3) [m], spacing [m]) of a start with the volume of the 0.5 m cube.

    shape  "cube", "cut" (exactly `count`, from a turned lattice), "box" (1.3 : 1 : 0.8), "rod" (3 : 1 : 1) or "pair"
           (two balls that touch)
    """
    side = round(count ** (1.0 / 3.0))
    spacing = SIDE / side
    if shape == "cube":
        return lattice_cube(side, spacing), spacing
    if shape == "cut":
        cut = rotated_lattice_cube(count, seed)
        return cut.position * (SIDE / cut.side), SIDE / cut.side
    if shape == "pair":
        ball = lattice_ball(count // 2, spacing)
        apart = np.array([np.ptp(ball[:, 0]) / 2 + spacing / 2, 0.0, 0.0])
        return np.concatenate([ball - apart, ball + apart]), spacing
    edges = {"box": (1.3, 1.0, 0.8), "rod": (3.0, 1.0, 1.0)}[shape]
    return rotated_box(count, edges, seed=seed, spacing=spacing).position, spacing


def cube_scene(
    position: NDArray, spacing: float, tension: float = TENSION, viscosity: float = CUBE_VISCOSITY,
    dtype: str = "float32", model: str = "dong", **changes: Any,
) -> Scene:  # fmt: skip
    """Liquid in free space at the map's setting: h = 2.6 d, Mueller kernels, S = sigma/(rho0 c^2 d) = 0.01.

    tension  that is to be measured on the drop [N/m]; Dong's nominal one is RATIO times smaller
    changes  parameters of the tension; those that belong to a tension in N/m leave it out
    """
    nominal = tension / RATIO["mueller"]
    sound_speed = math.sqrt(nominal / (DENSITY * spacing * 0.01))
    effect = tension_of(model, nominal if model == "dong" else tension, **changes)
    water = liquid(sound_speed=sound_speed, dynamic_viscosity=viscosity, kernels="mueller")
    return Scene(
        name="dong_cube", spacing=spacing, support_radius=2.6 * spacing, dtype=dtype,  # type: ignore[arg-type]
        fluid=(Cloud(position=position),), effects=(water, effect),
    )  # fmt: skip


def printed_cube(side: int, cohesion: bool, correction: bool, filtered: bool = True) -> Scene:
    """The 0.5 m cube with every printed number, in float64; each of the two terms can be left out.

    The sound speed is the largest that the printed step allows: 0.2 h/dt, half of the acoustic limit.
    """
    spacing = SIDE / side
    support = PRINTED_SUPPORT * spacing
    effect = Dong2016(
        stiffness=PRINTED["stiffness"] if cohesion else 0.0, correction=PRINTED["correction"] if correction else 0.0,
        filter_density=filtered,
    )  # fmt: skip
    water = liquid(
        sound_speed=0.2 * support / PRINTED_STEP, dynamic_viscosity=PRINTED_VISCOSITY, kernels="mueller",
        density_bound=PRINTED_BOUND,
    )  # fmt: skip
    return Scene(
        name="dong_cube_printed", spacing=spacing, support_radius=support, dtype="float64", step=PRINTED_STEP,
        fluid=(Cloud(position=lattice_cube(side, spacing)),), effects=(water, effect),
    )  # fmt: skip


def block(seed: int = 1) -> tuple[NDArray, float]:
    """(positions (810, 3) [m], spacing [m]) of the block over the middle of the floor, shaken by 0.01 spacings."""
    spacing = BLOCK / CELLS[0]
    lower = (-0.5 * CELLS[0] * spacing, -0.5 * CELLS[1] * spacing, HEIGHT)
    axes = [(np.arange(n) + 0.5) * spacing + low for n, low in zip(CELLS, lower)]
    position = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return position + np.random.default_rng(seed).uniform(-0.01, 0.01, position.shape) * spacing, spacing


def impact_speed() -> float:
    """Of the falling block [m/s]."""
    return math.sqrt(2 * 9.81 * HEIGHT)


def block_scene(
    seed: int = 1, tension: bool = True, filtered: bool = True, dtype: str = "float32",
    solver: Literal["shared", "hu_adams"] = "shared",
) -> Scene:  # fmt: skip
    """The block over the floor of a closed box, calibrated; with the shared liquid or with D(3) to D(5).

    Without tension the solver of D(3) to D(5) keeps the density filter, which is part of it.
    """
    position, spacing = block(seed)
    water = liquid(sound_speed=FALL_SOUND, dynamic_viscosity=FALL_VISCOSITY)
    effect: tuple[Dong2016, ...] = ()
    if tension:
        effect = (Dong2016(surface_tension=FALL_NOMINAL, filter_density=filtered, solver=solver),)
    elif solver == "hu_adams":
        effect = (Dong2016(stiffness=0.0, correction=0.0, filter_density=filtered, solver=solver),)
    return _falling(position, spacing, 2.7, (water, *effect), dtype)


def printed_block(
    seed: int, sound_speed: float, filtered: bool = True, step: float = PRINTED_STEP, tension: bool = True
) -> Scene:
    """The block with every printed number but the sound speed, which the paper does not give."""
    position, spacing = block(seed)
    water = liquid(
        sound_speed=sound_speed, dynamic_viscosity=PRINTED_VISCOSITY, kernels="mueller", density_bound=PRINTED_BOUND
    )
    numbers = PRINTED if tension else dict.fromkeys(PRINTED, 0.0)
    effects = (water, Dong2016(**numbers, filter_density=filtered))
    return _falling(position, spacing, PRINTED_SUPPORT, effects, step=step)


def _falling(
    position: NDArray, spacing: float, support: float, effects: tuple, dtype: str = "float32", step: float = 0.0
) -> Scene:
    half = 0.5 * ROOM
    walls = BoxWalls(lower=(-half, -half, 0.0), upper=(half, half, ROOM))
    return Scene(
        name="dong_block", spacing=spacing, support_radius=support * spacing, dtype=dtype, step=step,  # type: ignore
        fluid=(Cloud(position=position),), effects=(effects[0], Gravity(), walls, *effects[1:]),
    )  # fmt: skip


def oil_drops(number: int = 12, count: int = 500, seed: int = 1) -> tuple[NDArray, float]:
    """(positions (n, 3) [m], spacing [m]) of drops that stand close to each other on a layer of the lattice."""
    spacing = SIDE / 17
    ball = lattice_ball(count, spacing)
    width = np.ptp(ball[:, 0]) + spacing
    columns = math.ceil(math.sqrt(number))
    random = np.random.default_rng(seed)
    drops = []
    for k in range(number):
        place = np.array([k % columns, k // columns, 0.0]) * width
        drops.append(ball + place + random.uniform(-0.05, 0.05, ball.shape) * spacing)
    position = np.concatenate(drops)
    return position - position.mean(0), spacing


MERGING = (60, 120, 160, 240, 320, 480, 800, 1600)  # frames  # of the picture of the block that becomes one part
REST = 1600
