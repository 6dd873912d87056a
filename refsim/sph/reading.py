"""How a kernel reads the place and the mass of a neighbour: from two arrays, or on a GPU from one, in one read."""

from __future__ import annotations

from typing import Any

from numba import types
from numba.extending import overload

from refsim.backends.compile import FORMULA_OPTIONS, formula


def place_of(position, mass, j):  # noqa: ANN001, ANN201  (types are Numba's)
    """(x, y, z [m], what `mass_of` takes) of particle j; without `mass`, `position` is (n, 4), the mass [kg] last."""
    return position[j, 0], position[j, 1], position[j, 2], position[j, 3] if mass is None else j


def _place_of(position, mass, j):  # noqa: ANN001, ANN202
    if not isinstance(mass, types.NoneType):
        return lambda position, mass, j: (position[j, 0], position[j, 1], position[j, 2], j)
    four_of = _four_of()
    return lambda position, mass, j: four_of(position, j)


def _four_of() -> Any:
    from refsim.backends.primitives import four_of  # loads numba.cuda, which a CPU does without

    return four_of


overload(place_of, jit_options=FORMULA_OPTIONS)(_place_of)


def mass_of(found, mass):  # noqa: ANN001, ANN201
    """Mass [kg] of the particle for which `place_of` gave `found`."""
    return found if mass is None else mass[found]


def _mass_of(found, mass):  # noqa: ANN001, ANN202
    if isinstance(mass, types.NoneType):
        return lambda found, mass: found
    return lambda found, mass: mass[found]


overload(mass_of, jit_options=FORMULA_OPTIONS)(_mass_of)


@formula
def own_mass(i, position, mass):  # noqa: ANN001, ANN201
    """Mass [kg] of particle i."""
    return position[i, 3] if mass is None else mass[i]
