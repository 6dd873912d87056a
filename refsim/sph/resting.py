"""A column of weakly compressible liquid at rest under gravity: exact solutions of dp/ds = rho g, s the depth.

With x = rho/rho0 and p = rho0 c^2 (x^k - 1)/k the density is x = exp(g s/c^2) of the linear state (k = 1), and
x^(k - 1) = 1 + (k - 1) g s/c^2 of Tait's. An incompressible liquid has p = rho0 g s, and H^2 rho0 g/2 on a side.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from refsim.core.effect import Others
from refsim.sph import acceleration_of, liquid_of


class RestingColumn(NamedTuple):
    """Liquid of a given mass over an area of its floor."""

    load: Any  # that mass [kg/m^2; kg/m in 2D]; of `height` an array of them, too
    pull: float  # acceleration of gravity [m/s^2]
    density: float  # rho0 [kg/m^dim]
    sound_speed: float  # c [m/s]
    exponent: int = 1  # k of its state

    def height(self) -> Any:
        """H [m], of its surface above the floor."""
        k, scale = self.exponent, self.sound_speed**2 / self.pull
        grown = np.log1p(k * self._weight()) / k  # log x at the floor, whose pressure is the weight
        return scale * grown if k == 1 else scale * np.expm1((k - 1) * grown) / (k - 1)

    def pressure(self, height: np.ndarray) -> np.ndarray:
        """Pressure [Pa] at heights [m] above the floor; 0 above the surface."""
        k, stiffness = self.exponent, self.density * self.sound_speed**2
        head = self.pull * np.clip(self.height() - height, 0.0, None) / self.sound_speed**2
        logarithm = head if k == 1 else np.log1p((k - 1) * head) / (k - 1)
        return stiffness / k * np.expm1(k * logarithm)

    def side_force(self) -> float:
        """Force on a side [N/m along it; N in 2D], and energy above the floor [J/m^2; J/m in 2D]: the integral of p."""
        k, lift = self.exponent, self.density * self.sound_speed**4 / self.pull
        x = (1 + k * self._weight()) ** (1 / k)
        if k == 1:
            return lift * (self._weight() - math.log1p(self._weight()))
        return lift / k * ((x ** (2 * k - 1) - 1) / (2 * k - 1) - (x ** (k - 1) - 1) / (k - 1))

    def _weight(self) -> Any:
        """Pressure on the floor over rho0 c^2."""
        return self.load * self.pull / (self.density * self.sound_speed**2)


def column_of(effects: Others, load: float) -> RestingColumn:
    """The column of a scene's liquid, of `load` [kg/m^2; kg/m in 2D] over its floor."""
    liquid, pull = liquid_of(effects), math.hypot(*acceleration_of(effects))
    exponent = 7 if liquid.state == "tait" else 1
    return RestingColumn(load, pull, liquid.rest_density, liquid.sound_speed, exponent)
