"""refsim: reference implementations of published particle-fluid methods.

Every equation stands as a readable NumPy reference, a Numba CPU kernel and a CUDA kernel. Importing this
package loads no Numba and compiles nothing.
"""

from refsim.boundary.akinci_2012 import BoxWalls
from refsim.driver import RunReport, simulate
from refsim.errors import InputError, RunStopped
from refsim.run import Simulation, StepResult
from refsim.scene import Ball, Box, Cloud, Plan, Scene, make_plan
from refsim.scene_file import load_scene
from refsim.sph import Gravity, WeaklyCompressible
from refsim.surface_detection import SurfaceDetection
from refsim.surface_tension.jiang_zhu_2023 import JiangZhu2023

__version__ = "0.1.0"

__all__ = [
    "Ball",
    "Box",
    "BoxWalls",
    "Cloud",
    "Gravity",
    "InputError",
    "JiangZhu2023",
    "Plan",
    "RunReport",
    "RunStopped",
    "Scene",
    "Simulation",
    "StepResult",
    "SurfaceDetection",
    "WeaklyCompressible",
    "__version__",
    "load_scene",
    "make_plan",
    "simulate",
]
