"""A thin insulated body conducts along itself as its material does, and heat is kept."""

import math

import numpy as np
import pytest

from refsim import Cloud, HeatConduction, Scene, Simulation
from tests.running import advanced

CELLS = 16


def bar(x, dim, support, options, backend="numpy", period=(0.0, 0.0, 0.0)):
    """Half a cosine along x, spacing 1 m and k = rho = c = 1, in steps of 0.1 s."""
    wave = math.pi / CELLS
    heat = HeatConduction(
        temperature=tuple(50 + 50 * np.cos(wave * x[:, 0])), conductivity=1.0, heat_capacity=1.0, density=1.0,
        **options,
    )  # fmt: skip
    scene = Scene(
        dim=dim, dtype="float64", spacing=1.0, support_radius=support, step=0.1, fluid=(Cloud(position=x),),
        effects=(heat,), period=period,
    )  # fmt: skip
    return Simulation(scene, backend)


def lattice(*across):
    """A bar of so many rows (2D), or of so many by so many (3D)."""
    axes = [np.arange(n) + 0.5 for n in (CELLS, *across)]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
    return np.pad(x, ((0, 0), (0, 3 - len(axes))))


def test_a_thin_bar_conducts_as_a_wide_one_where_the_support_is_wide():
    x = lattice(2)
    run = advanced(bar(x, 2, 3.21, {"laplacian": "mueller"}), 4)
    wave = np.cos(math.pi / CELLS * x[:, 0])
    left = (wave * (run.field("temperature") - 50)).sum() / (50 * (wave**2).sum())
    assert left ** (-1 / 4) - 1 == pytest.approx(0.1 * (2 * math.sin(math.pi / 2 / CELLS)) ** 2, rel=0.01)


@pytest.mark.parametrize(
    "laplacian, h, told", [("mueller", 2.62, True), ("mueller", 2.3, False), ("spiky", 3.2, False)]
)
def test_a_plan_tells_of_rods_that_conduct_too_strongly(laplacian, h, told):
    notes = bar(lattice(2, 2), 3, h, {"laplacian": laplacian}).plan.notes
    assert any("conduct up to 21 %" in note for note in notes) == told
