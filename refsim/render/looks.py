"""Cameras, styles and materials."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from refsim.core.errors import InputError

STYLES = ("paper", "water", "particles")
Colour = tuple[float, float, float]

# Liquids, melts and solids by their number in the scene; Okabe & Ito's palette, distinct for every colour vision.
LIQUIDS: tuple[Colour, ...] = (
    (0.16, 0.47, 0.78), (0.90, 0.55, 0.10), (0.10, 0.62, 0.47), (0.80, 0.40, 0.65), (0.95, 0.85, 0.25),
)  # fmt: skip
SOLIDS: tuple[Colour, ...] = (
    (0.83, 0.90, 0.95), (0.82, 0.42, 0.18), (0.45, 0.68, 0.38), (0.78, 0.52, 0.70), (0.85, 0.75, 0.40),
)  # fmt: skip
OBSTACLE: Colour = (0.62, 0.60, 0.57)
PALE = 0.45  # share of white in the colour of a solid's melt
MAP = "viridis"


def liquid_colour(number: int) -> Colour:
    """Colour of a part of the scene's fluid."""
    return LIQUIDS[number % len(LIQUIDS)]


def solid_colour(number: int) -> Colour:
    """Colour of a solid body."""
    return SOLIDS[number % len(SOLIDS)]


def melt_colour(number: int) -> Colour:
    """Colour of what has melted off a solid body."""
    r, g, b = (PALE + (1 - PALE) * c for c in solid_colour(number))
    return r, g, b


@dataclass(frozen=True)
class Camera:
    """A parallel projection."""

    azimuth: float = -60.0  # where the viewer stands [degrees]: about the upward axis,
    elevation: float = 20.0  # and above the ground
    zoom: float = 1.0  # 1 shows all of the run but far strays

    def axes(self, up: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Unit vectors to the right, upwards in the picture, and towards the viewer."""
        east, north = level_axes(up)
        a, e = math.radians(self.azimuth), math.radians(self.elevation)
        towards = math.cos(e) * (math.cos(a) * east + math.sin(a) * north) + math.sin(e) * np.asarray(up)
        right = -math.sin(a) * east + math.cos(a) * north
        return right, np.cross(towards, right), towards


def level_axes(up: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Two unit vectors that are normal to each other and to `up`; x and y if z is up."""
    upward = np.asarray(up, dtype=float)
    first = np.zeros(3)
    first[0 if abs(upward[0]) < 0.9 else 1] = 1.0
    first -= (first @ upward) * upward
    first /= np.linalg.norm(first)
    return first, np.cross(upward, first)


def camera_of(words: str | None) -> Camera:
    """The camera of "azimuth,elevation" or "azimuth,elevation,zoom". Raises InputError for anything else."""
    if words is None:
        return Camera()
    try:
        camera = Camera(*map(float, words.split(",")))
    except (TypeError, ValueError):
        raise InputError(f"--camera {words!r} is no camera; give azimuth,elevation[,zoom], such as -60,20.") from None
    if not (math.isfinite(camera.azimuth) and abs(camera.elevation) <= 90 and 0 < camera.zoom < math.inf):
        raise InputError(f"--camera {words!r} is not possible; give an elevation from -90 to 90 degrees, zoom over 0.")
    return replace(camera, elevation=min(max(camera.elevation, -89.99), 89.99))


@dataclass(frozen=True)
class Cut:
    """A plane normal to an axis; what lies on one side of it is left away."""

    axis: int  # 0, 1 or 2
    place: float  # of the plane along it [m]
    side: int  # 1 leaves away what lies above it, -1 what lies below

    def __call__(self, points: NDArray) -> NDArray[np.float64]:
        """(k,) distances [m] of points (k, 3) [m], positive on the side that is left away."""
        return self.side * (np.asarray(points)[:, self.axis] - self.place)


def cut_of(words: str | None, towards: NDArray, dim: int, origin: Sequence[float] = (0.0, 0.0, 0.0)) -> Cut | None:
    """The cut of "x=0", which leaves away the viewer's side; None without words. Raises InputError for others.

    origin  to which what is cut is relative [m]
    """
    if words is None:
        return None
    axis, equals, place = words.replace(" ", "").partition("=")
    try:
        number = float(place)
    except ValueError:
        number = math.nan
    if axis not in tuple("xyz"[:dim]) or not equals or not math.isfinite(number):
        raise InputError(f"--cut {words!r} is no plane; give for example x=0, in metres.")
    index = "xyz".index(axis)
    return Cut(index, number - origin[index], 1 if towards[index] >= 0 else -1)
