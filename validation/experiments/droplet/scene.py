"""The droplet scene: every parameter of the default model stands here and nowhere else."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim import Cloud, JiangZhu2023, Scene, SurfaceDetection, WeaklyCompressible
from validation.metrics.shapes import lattice_cube, rotated_box, rotated_lattice_cube

END_TIME = 2.2  # s


def droplet_scene(
    position: NDArray, spacing: float, *, support: float = 2.6, sound_speed: float = 40.0, viscosity: float = 0.1,
    kernels: str = "mueller", tension: Mapping[str, Any] | None = None, surface_tension: float = 1.0,
    literal: tuple[str, ...] = (), detection: bool = False, effects: tuple | None = None, dtype: str = "float32",
    step_factor: float = 1.0, skin: float = 0.1, spin: float = 0.0, density: Any = "summation",
) -> Scene:  # fmt: skip
    """Liquid of the given particles, without gravity; SI units.

    The cube has a side of 1 m, rho0 = 1 kg/m^3 and sigma = 1 N/m, so that everything is of order one; a capillary time
    sqrt(rho0 R^3/sigma) is 0.49 s. The Ohnesorge number mu/sqrt(rho0 sigma R) of the default is 0.13.

    support          support radius h in spacings
    sound_speed      [m/s]; viscosity [Pa s]
    tension          parameters of JiangZhu2023 that differ from the default model
    literal          printed readings of the equation of motion
    detection        detect the surface in every step although no other effect needs it
    effects          in place of the tension (an empty tuple: none)
    spin             angular velocity at the start about z [rad/s]
    """
    if effects is None:
        effects = (JiangZhu2023(surface_tension=surface_tension, **{"area_ratio": 0.012, **(tension or {})}),)
    if detection:
        effects = (*effects, SurfaceDetection(each_step=True))
    liquid = WeaklyCompressible(
        rest_density=1.0, sound_speed=sound_speed, dynamic_viscosity=viscosity, kernels=kernels, literal=literal,
        density=density,
    )  # fmt: skip
    return Scene(
        name="droplet", spacing=spacing, support_radius=support * spacing, dtype=dtype, skin=skin,
        step_factor=step_factor, end_time=END_TIME, effects=(liquid, *effects),
        fluid=(Cloud(position=position, velocity=np.cross([0.0, 0.0, spin], position)),),
    )  # fmt: skip


@dataclass(frozen=True)
class Variant:
    """A model of the droplet: what it changes in `droplet_scene`, and what it is called."""

    words: str
    changes: Mapping[str, Any]


# Each reading at the best settings found for it.
_SOFT = {"support": 2.7, "kernels": "wendland", "viscosity": 0.2}
_TEXT = {"support": 2.0, "sound_speed": 60.0, "viscosity": 0.2}
VARIANTS: dict[str, Variant] = {
    "default": Variant("all pairs, cohesion balanced (default)", {}),
    "all": Variant("all pairs, cohesion not balanced", {"tension": {"balance_pressure": False}, "sound_speed": 60.0}),
    **{
        mode: Variant(label, {**_SOFT, "tension": {"pair_mode": mode, "area_ratio": 0.01}})
        for mode, label in {
            "soft": "soft surface weight", "one_sided": "force on surface particles only",
            "either": "one of a pair on the surface", "both": "both of a pair on the surface",
        }.items()
    },
    "text": Variant("the paper's text: surface set, corrected density", {**_TEXT, "tension": {"pair_mode": "either"}}),
    "printed": Variant(
        "the paper's text with every printed sign",
        {**_TEXT, "literal": ("all",), "tension": {"pair_mode": "either", "literal": ("all",)}},
    ),
}  # fmt: skip


def particles(shape: str, count: int, seed: int = 1) -> tuple[NDArray, float, NDArray]:
    """(positions (n, 3) [m], spacing [m], axes (3, 3) as columns) of a start with the volume of a 1 m cube.

    shape  "cube" (lattice cube of about `count`), "cut" (exactly `count`, cut from a turned lattice), "box" (turned
    box of about 1.3 : 1 : 0.8)
    seed   of the rotation of a cut or a box
    """
    side = round(count ** (1.0 / 3.0))
    if shape == "cube":
        return lattice_cube(side, 1.0 / side), 1.0 / side, np.eye(3)
    if shape == "cut":
        cut = rotated_lattice_cube(count, seed)
        return cut.position / cut.side, 1.0 / cut.side, np.eye(3)
    box = rotated_box(count, (1.3, 1.0, 0.8), seed=seed, spacing=1.0 / side)
    return box.position, 1.0 / side, box.rotation
