"""Scenes of panels: NAME.toml beside this module has that of the panel's base setting, and others follow from it.

Where no box or ball gives the particles, a function of `making` gives the scene of every setting, or NAME.zip holds it:
of drops that were stirred for seconds.
"""

import io
import math
import zipfile
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from functools import partial
from typing import Any

import msgspec
import numpy as np

from refsim.boundary.akinci_2012 import BoxWalls
from refsim.boundary.one_way_coupling import MeshBoundary
from refsim.heat import HeatConduction
from refsim.mpm import MpmLiquid
from refsim.particle_shifting import ParticleShifting
from refsim.scene.files import parse_scene, scene_from_dict, scene_to_dict, set_parameter, tables_of
from refsim.scene.plan import make_plan
from refsim.scene.refine import refined
from refsim.scene.scene import Scene
from refsim.scene.shapes import Box, Cloud
from refsim.sph import Gravity, WeaklyCompressible
from refsim.sph.iisph import ImplicitPressure
from refsim.study.panels import FOLDER, Panel, Point, panel
from refsim.surface_detection import SurfaceDetection
from refsim.surface_energy.effect import SurfaceEnergy

PACKED = frozenset(file.name.removesuffix(".zip") for file in FOLDER.iterdir() if file.name.endswith(".zip"))


def packaged(name: str) -> Scene:
    """The scene of a panel's base setting."""
    of = panel(name)
    return scene_of(of, of.points[of.about.base])


def written(of: Panel, point: Point) -> Scene:
    """The scene of a setting as its first reading was measured."""
    return scene_of(of, point, 0 if of.about.shaken else None)


def scene_of(of: Panel, point: Point, reading: int | None = None) -> Scene:
    """The scene of a setting of refsim's.

    reading  its number, where starts differ: of panels that are `shaken`, and of some of `MADE`

    Against the base the spacing is refined, steps are shortened in proportion to the knob `step`, and `point.setting`
    holds other parameters of the scene file by name, as in sweeps.
    """
    if of.name in PACKED:
        with zipfile.ZipFile(io.BytesIO((FOLDER / f"{of.name}.zip").read_bytes())) as scenes:
            return parse_scene(scenes.read(packed(point)).decode(), packed(point))
    if of.name in SCENE_FACTORIES:
        made = SCENE_FACTORIES[of.name]({**point.knobs, **point.setting}, reading or 0)
        return msgspec.structs.replace(made, name=of.name)
    tables = tables_of((FOLDER / f"{of.name}.toml").read_text(encoding="utf-8"), f"{of.name}.toml")
    scene = scene_from_dict({key: value for key, value in tables.items() if key != "panel"}, f"{of.name}.toml")
    base, knobs = of.points[of.about.base].knobs, point.knobs
    step = knobs.get("step", 1.0) / base.get("step", 1.0)
    if "spacing" in knobs:
        factor = Fraction(base["spacing"] / knobs["spacing"]).limit_denominator(100)
        scene = refined(scene, float(factor), of.about.with_spacing)
    name = "step" if scene.step > 0 else "step_factor"
    scene = msgspec.structs.replace(scene, dtype=knobs["dtype"], **{name: step * getattr(scene, name)})
    scene = changed(scene, tuple(point.setting.items()))
    return jittered(scene, reading) if of.about.shaken and reading is not None else scene


def packed(point: Point) -> str:
    """Name of a setting's scene in NAME.zip, whatever it ran on."""
    return f"{point.key.removeprefix('cuda_')}.toml"


def jittered(scene: Scene, seed: int, share: float = 0.01) -> Scene:
    """The scene with its liquid displaced at random along its axes, by `share` of the spacing (rms).

    From an exact lattice only rounding breaks the symmetry, later in float64 than in float32.
    """
    position = make_plan(scene).state.position.astype(float)
    moved = np.random.default_rng(seed).normal(0.0, share * scene.spacing, position.shape)
    cloud = Cloud(position=position + np.where(np.ptp(position, axis=0) > 0.0, moved, 0.0))
    return msgspec.structs.replace(scene, fluid=(cloud,))


def changed(scene: Scene, values: Sequence[tuple[str, object]]) -> Scene:
    """The scene with other values of parameters, by name."""
    if not values:
        return scene
    tables = scene_to_dict(scene)
    for name, value in values:
        set_parameter(tables, name, value, scene.name)
        if name.endswith(".cells"):  # which give the edges, then
            set_parameter(tables, name.replace(".cells", ".size"), None, scene.name)
    return scene_from_dict(tables, scene.name)


# Scenes whose particles no box or ball gives: one function for each panel, called as it is


Given = Mapping[str, Any]
GRAVITY, DENSITY = 9.81, 1000.0  # m/s^2; kg/m^3, in the plane kg/m^2
SHARE = 0.02  # kinematic viscosity of a tank over c h: calms the start
LATENT, WARM, COLD = 100.0, 50.0, -10.0  # of the ball of ice [J/kg], [deg C]
CLOUDS = {"detection_2d": (60, 1), "detection_3d": (16, 16)}  # particles along and across the column
REYNOLDS = 100.0  # of the vortices
MODULUS, CELL = 1000.0, 1 / 64  # of MPM discs [N/m], and of one of 11 cells [m]


def compressed(rest: np.ndarray, total: float, pull: float, sound: float) -> tuple[np.ndarray, float]:
    """(heights [m] of equal masses in hydrostatic balance, height of the surface).

    rest, total  heights [m] of the masses and of the surface at rest density; pull  acceleration downwards [m/s^2].
    rho = rho0 exp(pull (H - y)/c^2). A disc in the force -pull x has r^2/2 in place of y.
    """
    scale = sound**2 / pull
    top = scale * math.log1p(total / scale)
    return top - scale * np.log(np.exp(top / scale) - rest / scale), top


def lattice(*axes: np.ndarray) -> np.ndarray:
    """All points of the axes (n, 3), with z = 0 of two."""
    place = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
    return np.pad(place, ((0, 0), (0, 3 - len(axes))))


def calm(sound: float, reach: float) -> WeaklyCompressible:
    """Water of a summed density that comes to rest: a kinematic viscosity of SHARE c h."""
    return WeaklyCompressible(density="summation", sound_speed=sound, dynamic_viscosity=DENSITY * SHARE * sound * reach)


def rests(sound: float, reach: float) -> WeaklyCompressible:
    """Water of an advanced density with corrected gradients: a kinematic viscosity of SHARE c h/4."""
    viscosity = 0.25 * DENSITY * SHARE * sound * reach
    return WeaklyCompressible(
        density="continuity", sound_speed=sound, dynamic_viscosity=viscosity, gradient="corrected"
    )


def implicit_pressure(given: Given, seed: int = 0) -> Scene:
    """Water of 1 m x 1 m in the plane, in hydrostatic balance between walls.

    Its density is advanced with corrected gradients; with a `tolerance` it is summed and the pressure implicit.
    """
    d, tolerance, support = 1.0 / given["cells"], given.get("tolerance", 0.0), 2.6
    sound = 10 * math.sqrt(GRAVITY)
    liquid = calm(sound, support * d) if tolerance else rests(sound, support * d)
    walls = BoxWalls(lower=(0.0, 0.0, 0.0), upper=(1.0, 2.0, 0.0), open_faces=("+y",))
    solver = (ImplicitPressure(tolerance=tolerance),) if tolerance else ()
    step = {"step": 0.04 * given["step"] * d} if tolerance else {"step_factor": given["step"]}
    return Scene(
        dim=2, spacing=d, support_radius=support * d, dtype=given["dtype"], end_time=5.0 / math.sqrt(GRAVITY),
        fluid=(Box(cells=(given["cells"], given["cells"], 1)),),
        effects=(liquid, *solver, Gravity(acceleration=(0.0, -GRAVITY, 0.0)), walls), **step,
    )  # fmt: skip


def tank_pressure(given: Given, seed: int = 0) -> Scene:
    """A cube of 0.1 m of water in a cup that is a mesh."""
    height, cells, support = 0.1, given["cells"], 2.6
    d = height / cells
    return Scene(
        spacing=d, support_radius=support * d, dtype=given["dtype"], end_time=3.0 * math.sqrt(height / GRAVITY),
        fluid=(Box(cells=(cells, cells, cells)),),
        effects=(
            rests(10 * math.sqrt(2 * GRAVITY * height), support * d), Gravity(),
            MeshBoundary(file=str(FOLDER / "cup.obj")),
        ),
    )  # fmt: skip


def vortex_decay(given: Given, seed: int = 0) -> Scene:
    """Four Taylor-Green vortices of 1 m/s in a periodic box of 1 m at a Reynolds number of 100."""
    cells, support = given["cells"], given["support"]
    d, k = 1.0 / cells, 2 * math.pi
    axis = (np.arange(cells) + 0.5) * d
    place = lattice(axis, axis)
    x, y = k * place[:, 0], k * place[:, 1]
    velocity = np.column_stack([np.sin(x) * np.cos(y), -np.cos(x) * np.sin(y), np.zeros(len(place))])
    liquid = WeaklyCompressible(sound_speed=10.0, dynamic_viscosity=DENSITY / REYNOLDS)
    return Scene(
        dim=2, spacing=d, support_radius=support * d, dtype=given["dtype"], end_time=1.0, period=(1.0, 1.0, 0.0),
        fluid=(Cloud(position=place, velocity=velocity),), effects=(liquid, ParticleShifting(surface="none")),
    )  # fmt: skip


def detection(state: str, given: Given, seed: int = 0) -> Scene:
    """A moment of a dam break in a closed tank four column widths long, with a detector.

    NAME.npz beside this module holds it: positions [m], masses, and which particles are of the exact surface.
    """
    with np.load(str(FOLDER / f"{state}.npz")) as stored:
        position, mass = stored["position"], stored["mass"]
    columns, depth = CLOUDS[state]
    d, sound = 0.5 / columns, 10 * math.sqrt(GRAVITY)
    liquid = WeaklyCompressible(density="summation", sound_speed=sound, dynamic_viscosity=320.0 * d, state="tait")
    walls = BoxWalls(lower=(0.0, 0.0, 0.0), upper=(2.0, 4.0, depth * d))
    effect: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value for name, value in given["effect"].items()
    }
    return Scene(
        dim=2 if depth == 1 else 3, spacing=d, support_radius=2.6 * d, skin=0.3, dtype=given["dtype"], step=1e-6,
        end_time=1e-6, fluid=(Cloud(position=position, mass=mass),),
        effects=(liquid, Gravity(acceleration=(0.0, -GRAVITY, 0.0)), walls, SurfaceDetection(**effect)),
    )  # fmt: skip


def heat(given: Given, seed: int = 0) -> Scene:
    """Half a cosine of temperature in an insulated slab of 4 m and 20 layers, periodic across; k = rho = c = 1."""
    d, layers, wide = given["spacing"], 20, 10
    conduction = HeatConduction(
        temperature=tuple(50 + 50 * math.cos(math.pi * (k + 0.5) / layers) for k in range(layers)), conductivity=1.0,
        scheme=given.get("effects.heat_conduction.scheme", "runge_kutta_legendre"), heat_capacity=1.0, density=1.0,
        largest_number=1e9, largest_drift=0.0,
    )  # fmt: skip
    return Scene(
        spacing=d, support_radius=2.5 * d, dtype=given["dtype"], step=given["step"] * d**2, end_time=1.6,
        period=(0.0, wide * d, wide * d), effects=(conduction,),
        fluid=tuple(Box(lower=(k * d, 0.0, 0.0), cells=(1, wide, wide)) for k in range(layers)),
    )  # fmt: skip


def melting(given: Given, seed: int = 0) -> Scene:
    """A ball of ice at -10 degrees Celsius, all beyond held at 50; k = rho = c = 1, L = 100.

    Its outermost particles lie half a spacing within the radius of 1 m.
    """
    cells, support = given["cells"], 2.5
    d, reach = 1.0 / (cells + 0.5), math.ceil(cells + support)
    axis = np.arange(-reach, reach) + 0.5
    place = lattice(axis, axis, axis)
    away = np.linalg.norm(place, axis=1)
    heat = HeatConduction(
        temperature=(WARM, COLD), held=(0,), scheme=given["scheme"], conductivity=1.0, heat_capacity=1.0, density=1.0,
        melting_point=0.0, latent_heat=LATENT, largest_number=1e9, largest_drift=0.0,
    )  # fmt: skip
    warm = (away >= cells) & (away < cells + support)
    return Scene(
        spacing=d, support_radius=support * d, dtype=given["dtype"], step=given["number"] * d**2, end_time=2.0,
        fluid=tuple(Cloud(position=d * place[of]) for of in (warm, away < cells)), effects=(heat,),
    )  # fmt: skip


def disc(given: Given, seed: int, stretch: float, end: float) -> Scene:
    """A disc of 11/64 m or an ellipse longer by `stretch`, with the pressure of a round drop, k = rho = 1.

    Cut from a lattice of four particles to a cell that is moved and turned at random, by `seed`.
    """
    radius = given["radius"]
    h = 11.0 * CELL / radius
    semi = radius * np.array([1.0 + stretch, 1.0 / (1.0 + stretch)])
    n = math.ceil(4 * semi.max()) + 2
    axis = 0.5 * (np.arange(-n, n) + 0.5)
    angle = np.random.default_rng(seed).uniform(0, 2 * math.pi)
    place = lattice(axis, axis)[:, :2] + np.random.default_rng(seed).uniform(-0.25, 0.25, 3)[:2]
    place = place @ np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]).T
    place = place[((place / semi) ** 2).sum(1) < 1]
    ratio = 1 - 1.0 / (h * math.sqrt(len(place) / (4 * math.pi))) / MODULUS
    liquid = MpmLiquid(rest_density=1.0, bulk_modulus=MODULUS, cell_size=h, initial_ratio=ratio)
    made = Scene(
        dim=2, spacing=0.5 * h, support_radius=1.5 * h, dtype=given["dtype"], end_time=end,
        fluid=(Cloud(position=np.pad(h * math.sqrt(ratio) * place, ((0, 0), (0, 1)))),),
        effects=(liquid, SurfaceEnergy(surface_tension=1.0, **given["tension"])),
    )  # fmt: skip
    return msgspec.structs.replace(made, step_factor=given["step"])


def mpm_pressure(given: Given, seed: int = 0) -> Scene:
    """An MPM disc at rest, to 0.12 s."""
    return disc(given, seed, 0.0, 0.12)


def mpm_frequency(given: Given, seed: int = 0) -> Scene:
    """An MPM ellipse, longer by 5 %, that swings for two periods."""
    round_one = disc(given, seed, 0.05, 1.0)
    return msgspec.structs.replace(round_one, end_time=2 * 2 * math.pi / frequency(round_one))


def frequency(scene: Scene) -> float:
    """Rayleigh's frequency of mode 2 of a disc [rad/s], sqrt(6 k/(rho R^3)) (Rayleigh 1879)."""
    return math.sqrt(6 / radius(scene) ** 3)


def radius(scene: Scene) -> float:
    """Radius of the disc of the volume of a scene's particles [m]."""
    cloud: Any = scene.fluid[0]
    return scene.spacing * math.sqrt(len(cloud.position) / math.pi)


SCENE_FACTORIES: Mapping[str, Callable[..., Scene]] = {
    "implicit_pressure": implicit_pressure, "tank_pressure": tank_pressure, "vortex_decay": vortex_decay,
    "heat": heat, "melting": melting, "mpm_pressure": mpm_pressure, "mpm_frequency": mpm_frequency,
    **{state: partial(detection, state) for state in CLOUDS},
}  # fmt: skip
