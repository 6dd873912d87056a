"""refsim: reference implementations of published particle-fluid methods.

Every equation stands as a readable NumPy reference and as a kernel's body, of which the loops for CPU (Numba) and GPU
(CUDA) are made. Importing this package loads no Numba and compiles nothing; what runs, reads and studies scenes
(`_LATER`) is loaded when one of its names is first asked for.
"""

from refsim.core import clock as clock  # first: its reading is the beginning of the process
from refsim.core import stopping  # then, so that signals end a command with its exit code from then on

stopping.heed_while_importing()

import importlib
import pathlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

from refsim import isosurface, surface_energy
from refsim.boundary import sampling, signed_distance
from refsim.boundary.akinci_2012 import BoxWalls
from refsim.boundary.one_way_coupling import MeshBoundary
from refsim.boundary.two_way_coupling import TwoWayCoupling
from refsim.core.doors import open_doors
from refsim.core.effect import EFFECTS
from refsim.core.errors import InputError, RunStopped
from refsim.core.versions import VERSION as __version__
from refsim.gauges import Gauge, GaugeSeries
from refsim.heat import HeatConduction
from refsim.melting import Melting
from refsim.motion import Motion
from refsim.mpm import MpmLiquid, MpmWalls
from refsim.particle_shifting import ParticleShifting
from refsim.scene.scene import Scene
from refsim.scene.shapes import Ball, Box, Cloud, FluidMesh
from refsim.scene.solids import SolidBall, SolidBox, SolidCells, SolidMesh, SolidTorus
from refsim.scene.surface_mesh import load_mesh
from refsim.shape_matching import ShapeMatching
from refsim.sph import Gravity, WeaklyCompressible
from refsim.sph.iisph import ImplicitPressure
from refsim.surface_detection import SurfaceDetection
from refsim.surface_energy.effect import SurfaceEnergy
from refsim.surface_tension.akinci_2013 import Akinci2013
from refsim.surface_tension.becker_teschner_2007 import BeckerTeschner2007
from refsim.surface_tension.csf_wang_2019 import CsfWang2019
from refsim.surface_tension.dong_2016 import Dong2016
from refsim.surface_tension.he_2014 import He2014
from refsim.surface_tension.jiang_zhu_2023 import JiangZhu2023
from refsim.surface_tension.normal_difference_2014 import NormalDifference2014
from refsim.surface_tension.tartakovsky_meakin_2005 import TartakovskyMeakin2005

if TYPE_CHECKING:
    from refsim.engine.driver import RunReport, simulate
    from refsim.engine.simulation import Simulation
    from refsim.engine.state import StepResult
    from refsim.io.results import Run, RunFrame, open_run
    from refsim.scene.files import load_scene
    from refsim.scene.plan import Plan, make_plan
    from refsim.study import study
    from refsim.surface_tension.calibration import Calibration, ContactAngle, calibrate, calibrate_contact_angle

_LATER = {
    "engine.driver": ("RunReport", "simulate"), "engine.simulation": ("Simulation",),
    "engine.state": ("StepResult",), "io.results": ("Run", "RunFrame", "open_run"), "scene.files": ("load_scene",),
    "scene.plan": ("Plan", "make_plan"), "study": ("study",),
    "surface_tension.calibration": ("Calibration", "calibrate", "ContactAngle", "calibrate_contact_angle"),
}  # fmt: skip
__all__ = [
    "Akinci2013", "Ball", "BeckerTeschner2007", "Box", "BoxWalls", "Calibration", "Cloud", "ContactAngle",
    "CsfWang2019", "Dong2016", "FluidMesh", "Gauge", "GaugeSeries", "Gravity", "He2014",
    "HeatConduction", "ImplicitPressure", "InputError", "JiangZhu2023", "Melting", "MeshBoundary", "Motion",
    "MpmLiquid", "MpmWalls", "NormalDifference2014", "ParticleShifting", "Plan", "Run", "RunFrame", "RunReport",
    "RunStopped", "Scene", "ShapeMatching", "Simulation", "SolidBall", "SolidBox", "SolidCells", "SolidMesh",
    "SolidTorus", "StepResult", "SurfaceDetection", "SurfaceEnergy", "TartakovskyMeakin2005", "TwoWayCoupling",
    "WeaklyCompressible", "__version__", "calibrate", "calibrate_contact_angle", "isosurface", "load_mesh",
    "load_scene", "make_plan", "open_run", "sampling", "signed_distance", "simulate", "study", "surface_energy",
]  # fmt: skip


class _Package(ModuleType):
    """Loads `_LATER`'s names; `refsim.study` is the function, also where a module of that package is imported."""

    def __setattr__(self, name: str, value: Any) -> None:
        super().__setattr__(name, value.study if name == "study" and isinstance(value, ModuleType) else value)

    def __getattr__(self, name: str) -> Any:
        for module, names in _LATER.items():
            if name in names:
                value = getattr(importlib.import_module(f"refsim.{module}"), name)
                setattr(self, name, value)
                return value
        raise AttributeError(f"module 'refsim' has no attribute {name!r}")

    def __dir__(self) -> list[str]:
        return sorted({*vars(self), *__all__})


sys.modules[__name__].__class__ = _Package
_ROOT = pathlib.Path(__file__).parent
for _file in sorted(path for depth in ("*", "*/*") for path in _ROOT.glob(f"{depth}/operations.py")):
    importlib.import_module(".".join(("refsim", *_file.relative_to(_ROOT).parent.parts, "operations")))
open_doors()
globals().update({effect.__name__: effect for effect in EFFECTS.values()})  # of a new method, too
