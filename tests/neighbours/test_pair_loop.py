"""What a pair function may say, and how its fields are packed; tests/ladder holds the loop with every operation."""

import pytest

from refsim.neighbours.pair_functions import given_to, layout, terms
from refsim.neighbours.pairs import pair


@pair
def every_kind(r, x_ij, mass_i, mass_j, velocity_i, velocity_j, kind_j, radius, factor, extra):
    dx, dy, dz = x_ij
    share = mass_i * mass_j * (radius.support_radius - r) * factor
    if kind_j == 2:
        share = -share
    if extra is not None:
        share += extra.no_such_member
    return share * dx, share * (velocity_j[1] - velocity_i[1]), share * dz, share * dy


@pair
def volume_near(r, volume_j, radius):
    return volume_j * r


@pair
def flow(weight_ij, heat_i, heat_j):
    return weight_ij * (heat_j - heat_i)


def test_what_a_pair_function_takes_and_returns():
    assert [terms(f) for f in (every_kind, volume_near, flow)] == [4, 1, 1]
    assert list(given_to(every_kind, (None,) * 6)) == ["mass", "velocity", "kind", "radius", "factor", "extra"]
    with pytest.raises(TypeError, match="pair function flow takes heat; 2 values are given"):
        given_to(flow, (None, None))


def test_fields_are_packed_in_rows_of_four():
    """A scalar behind each vector, the position first; then scalars together; one that is left, and integers, alone."""
    kinds = {"mass": "scalar", "velocity": "vector", "kind": "integer"}
    assert layout(every_kind, tuple(kinds.values())) == (["", "velocity"], ["mass"], [], ["kind"])

    assert layout(volume_near, (None,)) == ([], [], [], [])

    def many(r, a_j, b_j, c_j, d_j, e_j, f_j, absent_j, radius):
        return a_j

    assert layout(many, ("scalar",) * 3 + (None,) * 4) == ([""], ["a"], [["b", "c"]], [])
    assert layout(many, ("scalar",) * 6 + (None,)) == ([""], ["a"], [["b", "c", "d", "e"]], ["f"])


def test_return_statements_write_equally_many_terms():
    def uneven(r, mass_j, radius):
        if mass_j > r:
            return r, r
        return r

    with pytest.raises(TypeError, match="uneven: its return statements write different numbers of terms"):
        terms(uneven)
