"""A support radius in which a particle of the lattice has no neighbour is refused, one with few of them is noted."""

import pytest

import refsim as rs
from refsim import make_plan
from refsim.scene.checks import checked, summing
from tests import pairs

SUMS = [name for name in pairs.EFFECTS if summing(*checked(pairs.scene(name, name)))]
NEEDS_MORE = ("dong_2016", "surface_detection", "mesh_boundary")  # have a reason of their own, or are sampled for long


def scaled(name, ratio):
    """The pair scene of one effect with another support radius [spacings]."""
    return pairs.scene(name, name).with_(support_radius=ratio * pairs.SPACING)


def of_support(plan):
    return [note for note in plan.notes if note.startswith("support_radius")]


@pytest.mark.parametrize("name", SUMS)
def test_a_support_without_neighbours_is_refused(name):
    for ratio in (1.0, 1.0 + 1e-12, 1.0499):
        with pytest.raises(rs.InputError, match="sums over no neighbour"):
            make_plan(scaled(name, ratio))


@pytest.mark.parametrize("name", [name for name in SUMS if name not in NEEDS_MORE])
def test_a_support_with_few_neighbours_has_a_note(name):
    for ratio, said in ((1.05, 1), (1.49, 1), (1.5, 0), (2.1, 0)):
        assert len(of_support(make_plan(scaled(name, ratio)))) == said, ratio


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("spacing", [1e-6, 0.1, 1 / 3, 7e3])
def test_the_bound_is_that_of_the_lattice_in_all_units(dim, spacing):
    """Lengths are told in spacings; where nothing is summed there is no bound but one spacing."""
    heat = rs.HeatConduction(conductivity=400.0, temperature=20.0, density=8960.0, heat_capacity=385.0)
    fluid = (rs.Box(cells=(3, 3, 3 if dim == 3 else 1)),)

    def made(ratio, *effects):
        return make_plan(
            rs.Scene(spacing=spacing, support_radius=ratio * spacing, dim=dim, fluid=fluid, effects=effects)
        )

    with pytest.raises(rs.InputError, match="heat_conduction sums over no neighbour"):
        made(1.049, heat)
    assert of_support(made(1.2, heat))
    for still in (rs.Gravity(acceleration=(1.0, 0.0, 0.0)), rs.HeatConduction(conductivity=0.0)):  # nothing is summed
        assert not of_support(made(1.0, still))
