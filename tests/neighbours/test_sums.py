"""Sums over the j of each i against loops."""

import numpy as np
import pytest

from refsim.neighbours import sums
from refsim.neighbours.sums import Fields, Pairs, neighbours, wall_particles
from refsim.smoothing import smoothing
from refsim.smoothing.reference import kernel_value


def pull(i, j, ij, k):
    return k * j.mass * (i.mass - j.mass) * ij.W * ij.e


@pytest.fixture
def liquid():
    rng = np.random.default_rng(4)
    return Fields(position=rng.uniform(0, 1, (40, 3)), mass=rng.uniform(1, 2, 40))


@pytest.mark.parametrize("rows", [None, np.array([7, 3])])
@pytest.mark.parametrize("period", [None, (0.0, 1.0, 0.0)])
def test_a_sum_over_neighbours(liquid, rows, period, monkeypatch):
    monkeypatch.setattr(sums, "CHUNK", 13)
    kernel = smoothing("wendland_c2", 0.4, 3)
    value, size = neighbours(liquid, liquid, kernel, period=period, rows=rows)(pull, k=2.0)
    x, m = liquid.position.value, liquid.mass.value
    for n, i in enumerate(range(40) if rows is None else rows):
        terms = []
        for j in range(40):
            apart = x[i] - x[j]
            apart[1] -= 0 if period is None else np.round(apart[1])
            r = np.linalg.norm(apart)
            weight = 2 * m[j] * kernel_value(r, kernel) * apart / (r or 1)
            terms.append((weight * (m[i] - m[j]), np.abs(weight) * (m[i] + m[j])))
        assert value[n] == pytest.approx(sum(t for t, _ in terms), abs=1e-12)
        assert size[n] == pytest.approx(sum(t for _, t in terms), abs=1e-12)


def test_oneself_is_left_out_of_the_others(liquid):
    around = neighbours(liquid, liquid, smoothing("wendland_c2", 1e-9, 3), rows=np.array([5, 2]))
    assert around(lambda i, j, ij: j.mass).value.tolist() == liquid.mass.value[[5, 2]].tolist()
    assert around.others(lambda i, j, ij: j.mass).value.tolist() == [0, 0]


def test_without_walls_their_sums_are_zero(liquid):
    at_walls = neighbours(liquid, wall_particles(None), smoothing("wendland_c2", 0.4, 3))
    assert (liquid.mass + at_walls(pull)).value.tolist() == liquid.mass.value.tolist()


def test_pairs_of_other_things():
    """Three members of two bodies, with a weight of each pair; the second body has none of weight."""
    bodies, members = Fields(scale=[2.0, 3.0, 5.0]), Fields(mass=[1.0, 10.0, 100.0])
    of = Pairs(bodies, 3, members, np.array([0, 0, 2]), np.array([2, 0, 1]), Fields(share=np.array([1.0, -0.5, 1.0])))
    value, size = of(lambda i, j, ij: i.scale * j.mass * ij.share)
    assert (value.tolist(), size.tolist()) == ([199, 0, 50], [201, 0, 50])
    assert of.most(lambda i, j, ij: j.mass).value.tolist() == [100, -np.inf, 10]
    assert of.any(lambda i, j, ij: j.mass > 50).holds.tolist() == [True, False, False]


def test_pairs_in_disorder_are_refused():
    with pytest.raises(ValueError, match="sorted"):
        Pairs(Fields(scale=[2.0, 3.0]), 2, Fields(mass=[1.0]), np.array([1, 0]), np.array([0, 0]))
