"""Names and normalisations of the smoothing kernels; computed on the host in float64."""

import math
from typing import Any, NamedTuple

import numpy as np

from refsim.core.effect import int32
from refsim.core.errors import InputError

NAMES = "poly6 spiky cubic_spline wendland_c2 wendland_c4 wendland_c6 quintic_spline gaussian"
SHAPES = {name: number for number, name in enumerate(NAMES.split())}
POLY6, SPIKY, CUBIC_SPLINE, WENDLAND_C2, WENDLAND_C4, WENDLAND_C6, QUINTIC_SPLINE, GAUSSIAN = SHAPES.values()

# Coefficient of 1/h^dim for which the integral of W is one, by dimension.
NORMALISATION = {
    POLY6: {2: 4 / math.pi, 3: 315 / (64 * math.pi)},
    SPIKY: {2: 10 / math.pi, 3: 15 / math.pi},
    CUBIC_SPLINE: {2: 40 / (7 * math.pi), 3: 8 / math.pi},
    WENDLAND_C2: {2: 7 / math.pi, 3: 21 / (2 * math.pi)},
    WENDLAND_C4: {2: 9 / math.pi, 3: 495 / (32 * math.pi)},
    WENDLAND_C6: {2: 78 / (7 * math.pi), 3: 1365 / (64 * math.pi)},
    QUINTIC_SPLINE: {2: 15309 / (478 * math.pi), 3: 2187 / (40 * math.pi)},
    GAUSSIAN: {
        2: 9 / (math.pi * (1 - 10 * math.exp(-9))),
        3: 27 / (math.pi**1.5 * math.erf(3) - 42 * math.pi * math.exp(-9)),
    },
}
# Coefficient of (h - r)/h^(dim+3): exact on quadratic fields.
VISCOSITY_LAPLACIAN = {2: 40 / math.pi, 3: 45 / math.pi}


class Smoothing(NamedTuple):
    """Parameters of a smoothing kernel in kernels; all but `shape` and `dim` in the run's dtype."""

    support_radius: float  # h [m]
    inverse_radius: float  # 1/h [1/m]
    value_scale: float  # W = value_scale s(q), q = r/h and s the kernel's shape [1/m^dim]
    slope_scale: float  # dW/dr = slope_scale ds/dq [1/m^(dim+1)]
    laplacian_scale: float  # the viscosity Laplacian is laplacian_scale (1 - q) for every shape [1/m^(dim+2)]
    shape: Any  # its number; a tuple of that length where it is `fixed`
    dim: int

    def fixed(self) -> "Smoothing":
        """The same with a shape that the compiler knows: loops over neighbours have no branches and vectorise."""
        return self._replace(shape=(np.int32(0),) * int(self.shape))

    def numbered(self) -> "Smoothing":
        """The same with the number of its shape, also of a `fixed` one."""
        return self._replace(shape=int32(len(self.shape))) if isinstance(self.shape, tuple) else self


def lattice(reach: int, dim: int) -> np.ndarray:
    """Points (k, dim) of the lattice of spacing 1, up to `reach` along each axis; the last axis varies fastest."""
    return np.moveaxis(np.indices((2 * reach + 1,) * dim, dtype=float), 0, -1).reshape(-1, dim) - reach


def lattice_neighbours(support_radius: float, spacing: float, dim: int) -> tuple[np.ndarray, np.ndarray]:
    """(places (k, dim), distances (k,)) [m] of a particle's neighbours on the lattice within the support radius."""
    steps = spacing * lattice(math.ceil(support_radius / spacing), dim)
    distance = np.sqrt((steps**2).sum(1))
    near = (distance > 0) & (distance < support_radius)
    return steps[near], distance[near]


def smoothing(shape: str, support_radius: float, dim: int, dtype: str = "float64") -> Smoothing:
    """Smoothing kernel `shape` of support `support_radius` [m] in `dim` dimensions.

    Raises InputError for an unknown shape, a dimension other than 2 or 3, a radius that is not positive, or one whose
    powers leave the range of the dtype.
    """
    if shape not in SHAPES:
        raise InputError(f"Smoothing kernel {shape!r} is unknown: choose one of {', '.join(SHAPES)}.")
    if dim not in (2, 3):
        raise InputError(f"dim = {dim} is not possible: choose 2 or 3.")
    if not (support_radius > 0 and math.isfinite(support_radius)):
        raise InputError(f"support_radius = {support_radius} must be a positive length in metres.")
    real = np.dtype(dtype).type
    h = float(support_radius)
    if (dim + 2) * abs(math.log10(h)) > -math.log10(np.finfo(real).tiny) - 2:
        size = "small" if h < 1 else "large"
        raise InputError(
            f"support_radius = {h} m is too {size} for smoothing kernels in {np.dtype(dtype).name}, whose scale is"
            f" 1/h^{dim + 2}; check the unit (metres), or take float64."
        )
    norm = NORMALISATION[SHAPES[shape]][dim] / h**dim
    laplacian = VISCOSITY_LAPLACIAN[dim] / h ** (dim + 2)
    return Smoothing(
        real(h), real(1 / h), real(norm), real(norm / h), real(laplacian), int32(SHAPES[shape]), int32(dim)
    )
