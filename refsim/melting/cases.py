"""Inputs and closed forms of melting."""

import numpy as np

from refsim.core.cases import Exact, at, closed_form, example, groups, lattice
from refsim.melting import Melting, MeltingRule
from refsim.shape_matching.phases import FLUID, INTERIOR, SURFACE

example(Melting(), brings="melted melted_count melting_point rebuild")


@groups("melting", "melted", "melted_count")
def _melting(case, grid):
    from refsim.shape_matching.cases import tables

    count = len(tables(case)[3])
    melted = (case.random("melted").random(count) < 0.3).astype(np.int32)
    real = grid.real
    rule = MeltingRule(np.int32(case.dim == 3), real(1000), real(1000 * grid.spacing**3), real(0.6), real(4186))
    return {"melting": rule, "melted": melted, "melted_count": np.array([melted.sum()], np.int32)}


CHAIN = at("melting_chain", lattice((5, 1, 1), 1.0))


def _chain(**changes):
    """A body of four nodes, its particles in reverse, and a drop: hot everywhere but in node 1."""
    inputs = {
        "identity": [3, 2, 1, 0, 4], "temperature": [5.0, 4.0, 3.9, 4.0, 9.0], "enthalpy": None,
        "phase": [INTERIOR, SURFACE, SURFACE, SURFACE, FLUID], "mass": np.full(5, 9.0),
        "rest_density": np.full(5, 900.0), "melted": np.zeros(4, np.int32), "melting_point": np.full(5, 4.0),
        "latent_heat": None, "melting": MeltingRule(0, 1000.0, 10.0, 0.5, 4000.0),
        "melted_count": np.full(1, 7, np.int32), "conductivity": np.full(5, 2.0), "heat_capacity": np.full(5, 2000.0),
    }  # fmt: skip
    return inputs | changes


@closed_form("melting.melt")
def at_the_melting_point():
    """Surface particles at the melting point melt; interior ones do not at any temperature. Mass and density stay."""
    expected = {
        "melted": [1, 0, 1, 0], "melted_count": [2], "mass": np.full(5, 9.0),
        "rest_density": np.full(5, 900.0), "phase": [INTERIOR, FLUID, SURFACE, FLUID, FLUID],
        "conductivity": np.full(5, 2.0), "heat_capacity": np.full(5, 2000.0),
    }  # fmt: skip
    return Exact(CHAIN, _chain(), expected)


@closed_form("melting.melt")
def with_latent_heat_into_water():
    """With latent heat node 2, which has less than 7 J/kg, stays solid; node 0 takes the water's mass and density."""
    inputs = _chain(enthalpy=[9.0, 6.0, 9.0, 7.0, 9.0], latent_heat=np.full(5, 7.0))
    inputs["melting"] = inputs["melting"]._replace(into_liquid=1)
    expected = {
        "melted": [1, 0, 0, 0], "melted_count": [1], "mass": [9.0, 9.0, 9.0, 10.0, 9.0],
        "rest_density": [900.0, 900.0, 900.0, 1000.0, 900.0], "phase": [INTERIOR, SURFACE, SURFACE, FLUID, FLUID],
        "conductivity": [2.0, 2.0, 2.0, 0.5, 2.0], "heat_capacity": [2000.0, 2000.0, 2000.0, 4000.0, 2000.0],
    }  # fmt: skip
    return Exact(CHAIN, inputs, expected)


@closed_form("melting.detach")
def broken_chain():
    """Node 1 of a chain of four melts; w = 1: only the regions of 0, 1 and 2 held it."""
    direct, region = np.full((4, 27), -1, np.int32), np.full((4, 27), -1, np.int32)
    for s in range(4):
        for k in range(max(s - 1, 0), min(s + 2, 4)):
            direct[s, 13 + k - s] = region[s, 13 + k - s] = k
    expected = direct.copy()
    expected[1], expected[0, 14], expected[2, 12] = -1, -1, -1
    inputs = {
        "melted": [0, 1, 0, 0], "melted_count": np.ones(1, np.int32), "region": region,
        "direct": direct, "rebuild": np.full(4, 7, np.int32),
    }  # fmt: skip
    return Exact(CHAIN, inputs, {"direct": expected, "rebuild": [1, 1, 1, 0]})
