"""Kernels made of pair functions, as Python: they add what is written out here over all pairs."""

import inspect
from typing import Any, NamedTuple

import numpy as np
import pytest

from refsim.neighbours.forces import force, together
from refsim.neighbours.pairs import pair
from refsim.neighbours.rows import NeighbourRows

N = 9


class Spring(NamedTuple):
    support_radius: float
    rate: float


@pair
def pull_pair(r, x_ij, mass_i, mass_j, density_j, pressure_j, smoothing):
    f = mass_i * mass_j * density_j * pressure_j * r
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


@pair
def drag_pair(velocity_i, velocity_j, density_i, density_j, smoothing, extra):
    assert extra is None
    return change(velocity_i, velocity_j, 0), change(velocity_i, velocity_j, 1), change(velocity_i, velocity_j, 2)


def change(first, second, c):
    return second[c] - first[c]


def wall_part(i, lane, position, density, pressure, walls, smoothing, fluid, period):
    return walls * density[i] * pressure[i], fluid, smoothing.rate


RANDOM = np.random.default_rng(3)
GIVEN: dict[str, Any] = {
    "position": RANDOM.random((N, 3)), "velocity": RANDOM.random((N, 3)), "mass": 1 + RANDOM.random(N),
    "density": 1 + RANDOM.random(N), "pressure": 1 + RANDOM.random(N), "smoothing": Spring(9.0, 3.0), "fluid": 4.0,
    "gradient_smoothing": Spring(9.0, 3.0), "period": None, "walls": None,
    "neighbours": NeighbourRows(
        np.arange(N) * (N - 1), np.full(N, N - 1, np.int32),
        np.concatenate([np.delete(np.arange(N, dtype=np.uint32), i) for i in range(N)]),
    ),
}  # fmt: skip


def accelerations(kernel, **more):
    """What the kernel adds to (1, 1, 1) m/s^2."""
    given = GIVEN | more | {"acceleration": np.ones((N, 3))}
    for i in range(N):
        inspect.unwrap(kernel)(i, None, *(given[name] for name in kernel.arguments))
    return given["acceleration"] - 1


def pulls():
    x = GIVEN["position"][:, None] - GIVEN["position"]
    share = GIVEN["mass"][:, None] * GIVEN["mass"] * GIVEN["density"] * GIVEN["pressure"]
    return (share * np.linalg.norm(x, axis=2))[..., None] * x


@pytest.mark.parametrize(("options", "factor"), [
    ({}, np.ones(N)), ({"divided": "density"}, 1 / GIVEN["density"]), ({"times": "smoothing.rate"}, np.full(N, 3.0)),
    ({"divided": "mass", "times": "smoothing.rate", "period": True}, 3 / GIVEN["mass"]),
])  # fmt: skip
def test_the_sum_of_a_pair_function_is_added(options, factor):
    kernel = force(pull_pair, **options)
    assert kernel.__name__ == "pull"
    assert ("period" in kernel.arguments) == ("period" in options)
    assert accelerations(kernel) == pytest.approx(pulls().sum(1) * factor[:, None], rel=1e-13)


def test_walls_are_added_where_there_are_any():
    kernel = force(pull_pair, "with_walls", walled=wall_part)
    assert kernel.arguments[-4:] == ["walls", "smoothing", "fluid", "acceleration"]
    without = accelerations(kernel)
    more = accelerations(kernel, walls=2.0) - without
    assert without == pytest.approx(pulls().sum(1), rel=1e-13)
    assert more[:, 0] == pytest.approx(2 * GIVEN["density"] * GIVEN["pressure"], rel=1e-12)
    assert more[:, 1:] == pytest.approx(np.full((N, 2), [4.0, 3.0]), rel=1e-12)


@pytest.mark.parametrize("per_volume", [False, True])
def test_two_forces_are_summed_in_one_loop(per_volume):
    """The first is per volume, the second per mass or per volume, too."""
    names = {"extra": "None", "smoothing": "gradient_smoothing"}
    both, kernel = together(pull_pair, drag_pair, wall_part, names, per_volume)
    assert not {"smoothing", "extra"} & {*kernel.arguments, *inspect.signature(both).parameters}
    drag, density = GIVEN["velocity"][None] - GIVEN["velocity"][:, None], GIVEN["density"][:, None]
    own = drag.sum(1) / (density if per_volume else 1)
    assert accelerations(kernel) == pytest.approx(pulls().sum(1) / density + own, rel=1e-13)


def test_the_text_of_a_made_kernel_can_be_read():
    text = inspect.getsource(inspect.unwrap(force(pull_pair, "read", times="smoothing.rate", divided="mass")))
    assert text.startswith("def read(i, lane, position, mass, density, pressure, neighbours, smoothing, acceleration):")
    assert "    a = scaled(a, smoothing.rate / mass[i])\n" in text
