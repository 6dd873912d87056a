"""A C library under the contract, by ctypes: `refsim contract c_library.py`. Compile it first, for each precision:

cc -O2 -shared -fPIC -DREAL=float  sph.c -o sph_float32.so -lm
cc -O2 -shared -fPIC -DREAL=double sph.c -o sph_float64.so -lm
"""

import ctypes
from pathlib import Path

import numpy as np

from refsim.contract import Programs

SCALARS = ("support_radius", "inverse_radius", "value_scale", "slope_scale", "laplacian_scale")


class List(ctypes.Structure):
    """Rows of neighbours."""

    _fields_ = [(name, ctypes.c_void_p) for name in ("start", "count", "entries")]


def called(name, real, *values):
    """Call a function of the library for the dtype `real`: arrays as pointers, named tuples as structures."""
    library = ctypes.CDLL(str(Path(__file__).with_name(f"sph_{real}.so")))
    number = np.ctypeslib.as_ctypes_type(real)
    fields = [(scalar, number) for scalar in SCALARS]
    smoothing = type("Smoothing", (ctypes.Structure,), {"_fields_": fields})

    def converted(value):
        if isinstance(value, np.ndarray):
            return ctypes.c_void_p(value.ctypes.data)
        if hasattr(value, "entries"):
            return List(*(part.ctypes.data for part in (value.start, value.count, value.entries)))
        if hasattr(value, "support_radius"):
            return smoothing(*(getattr(value, scalar) for scalar in SCALARS))
        return ctypes.c_int64(value) if isinstance(value, int) else number(value)

    getattr(library, name)(*map(converted, values))


def density(position, mass, neighbours, smoothing, density):
    called("density", mass.dtype, len(mass), position, mass, neighbours, smoothing, density)


def momentum(position, velocity, mass, density, pressure, neighbours, smoothing, fluid, viscosity, acceleration):
    coefficient = mass.dtype.type(0) if viscosity is None else viscosity.coefficient
    called(
        "momentum", mass.dtype, len(mass), position, velocity, mass, density, pressure, neighbours, smoothing,
        fluid.gradient_share, coefficient, acceleration,
    )  # fmt: skip


def cohesion(position, mass, neighbours, smoothing, attraction, acceleration):
    called(
        "cohesion", mass.dtype, len(mass), position, mass, neighbours, smoothing, attraction.strength,
        attraction.least_q, acceleration,
    )  # fmt: skip


PROGRAMS = Programs(
    {"sph.density": density, "sph.momentum": momentum, "becker_teschner_2007.cohesion": cohesion},
    kernels=("wendland_c2",), walls=False, without=("number_density", "asymmetry", "period"),
)  # fmt: skip
