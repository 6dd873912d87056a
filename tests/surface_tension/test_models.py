"""Surface-tension models beside Jiang & Zhu's: shapes of their forces, momenta, internal pressure, printed readings."""

import numpy as np
import pytest

import refsim as rs
from refsim import make_plan
from refsim.core.effect import Discretisation
from refsim.study.panels.drops import pair_virials
from tests.running import rows

COHESIVE = (rs.JiangZhu2023, rs.Akinci2013, rs.Dong2016, rs.BeckerTeschner2007, rs.TartakovskyMeakin2005)


def notes_with(plan, words):
    """Notes of a plan that contain the words."""
    return [note for note in plan.notes if words in note]


def test_what_a_model_does_to_drops_is_noted():
    """Each note appears with the setting that it warns of, and not without."""

    def notes(*effects, viscosity=1.0, h=2.6, form="laplacian"):
        fluid = rs.WeaklyCompressible(
            rest_density=1.0, sound_speed=10.0, dynamic_viscosity=viscosity, kernels="mueller", viscosity=form,
            density="summation",
        )  # fmt: skip
        box = rs.Box(cells=(2, 2, 2))
        return make_plan(rs.Scene(spacing=1.0, support_radius=h, fluid=(box,), effects=(fluid, *effects)))

    turning, akinci = "does not act along the pair", rs.Akinci2013(surface_tension=1.0)
    for effect, without in (
        (akinci, rs.Akinci2013(surface_tension=1.0, area_acceleration=0.0)),
        (akinci, rs.Akinci2013(surface_tension=1.0, area_direction="axial")),
        (rs.Dong2016(surface_tension=1.0), rs.Dong2016(surface_tension=1.0, correction=0.0)),
        (rs.JiangZhu2023(surface_tension=1.0), rs.JiangZhu2023(surface_tension=1.0, area_direction="axial")),
        (rs.JiangZhu2023(surface_tension=1.0), rs.JiangZhu2023(surface_tension=1.0, area_term="none")),
    ):
        assert len(notes_with(notes(effect, viscosity=0.0), turning)) == 1
        assert notes_with(notes(effect), turning) == notes_with(notes(without, viscosity=0.0), turning) == []
        assert len(notes_with(notes(effect, form="central"), turning)) == 1
        assert notes_with(notes(without, form="central"), turning) == []
    pairs_of_two = rs.JiangZhu2023(surface_tension=1.0, pair_mode="either", area_ratio=0.0)
    assert notes_with(notes(pairs_of_two), "boil or fall apart")
    assert notes_with(notes(akinci, rs.ImplicitPressure()), "tremble at rest")
    assert notes_with(notes(akinci), "tremble") == []
    dong = rs.Dong2016(surface_tension=1.0)
    assert notes_with(notes(dong, h=1.7), "freeze in the shape")
    assert notes_with(notes(dong, h=1.8), "freeze in the shape") == []
    assert notes_with(notes(rs.BeckerTeschner2007(surface_tension=1.0, clamp_distance=False)), "pile up")
    assert notes_with(notes(rs.BeckerTeschner2007(surface_tension=1.0)), "pile up") == []
    for effect, without in (
        (rs.He2014(kappa=1e-3), rs.He2014(air_pressure=1e-3)),
        (rs.CsfWang2019(surface_tension=1e-3), rs.CsfWang2019(surface_tension=0.0)),
    ):
        assert notes_with(notes(effect), "gather in pairs")
        assert [note for note in notes(without).notes if "brakes free rotation" not in note] == []


@pytest.mark.parametrize(("name", "parameters", "words"), rows(__file__, "bad_models"))
def test_bad_parameters_get_one_sentence(name, parameters, words):
    model = getattr(rs, name)
    fluid = rs.WeaklyCompressible(rest_density=1.0, sound_speed=100.0, density="summation")
    box = rs.Box(cells=(3, 3, 3))
    with pytest.raises(rs.InputError) as error:
        make_plan(rs.Scene(spacing=1.0, support_radius=2.7, fluid=(box,), effects=(fluid, model(**parameters))))
    assert words in str(error.value)
    assert str(error.value).startswith(f"{model.name}: ")


def beside_akinci(fluid):
    """27 particles of this liquid under Akinci's tension."""
    effects = (fluid, rs.Akinci2013(surface_tension=1.0))
    return rs.Scene(spacing=1.0, support_radius=2.6, fluid=(rs.Box(cells=(3, 3, 3)),), effects=effects)


def test_a_coefficient_on_an_advanced_density_is_noted_and_restoring_only_there():
    summed = rs.WeaklyCompressible(sound_speed=10.0, density="summation", restoring=0.3)
    with pytest.raises(
        rs.InputError, match=r"restoring = 0.3 is for an advanced density, and this one is summed; leave"
    ):
        make_plan(beside_akinci(summed))
    for density, restoring, noted in (("continuity", 0.3, 1), (None, 0.003, 0)):
        fluid = rs.WeaklyCompressible(sound_speed=100.0, dynamic_viscosity=10.0, density=density)
        plan = make_plan(beside_akinci(fluid))
        assert plan.effects["weakly_compressible"].restoring == restoring
        assert len(notes_with(plan, "calibrate(..., density = 'continuity')")) == noted


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("model", COHESIVE)
def test_walls_bear_the_weight_and_not_what_balances_cohesion(model, dim):
    """Of liquid that starts at rest: forces and pressures on walls are those without tension, to rounding."""
    pull = (0.0, -9.81, 0.0) if dim == 2 else (0.0, 0.0, -9.81)
    gauges = (
        rs.Gauge(name="walls", kind="force", on="box_walls"),
        rs.Gauge(name="floor", kind="pressure", at=(0, 0, 0)),
    )
    found = []
    for tension in ((), (model(surface_tension=0.072),)):
        simulation = rs.Simulation(
            rs.Scene(
                dim=dim, spacing=1e-3, support_radius=2.6e-3, dtype="float64", gauge=gauges,
                fluid=(rs.Box(cells=(6, 6, 5) if dim == 3 else (6, 5, 1)),),
                effects=(
                    rs.WeaklyCompressible(sound_speed=10.0), rs.Gravity(acceleration=pull),
                    rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(0.006, 0.02 if dim == 2 else 0.006, 0.02)), *tension,
                ),
            ),
            "numpy",
        )  # fmt: skip
        simulation.gauges.begin(simulation)
        found.append(np.concatenate([simulation.gauge(gauge.name).values[0] for gauge in gauges]))
    assert simulation.plan.shared["fluid"].internal_pressure > 10.0  # Pa, of 49 at the floor
    assert found[1] == pytest.approx(found[0], rel=1e-9, abs=1e-12)


TENSIONS = (
    rs.JiangZhu2023(surface_tension=1.0), rs.JiangZhu2023(surface_tension=1.0, pair_mode="soft", area_ratio=0.2),
    rs.Akinci2013(surface_tension=1.0, area_acceleration=20.0), rs.Dong2016(surface_tension=1.0),
    rs.BeckerTeschner2007(surface_tension=1.0), rs.TartakovskyMeakin2005(surface_tension=1.0),
    rs.He2014(surface_tension=1.0, air_pressure=3.0),
)  # fmt: skip


def blob(*effects, dim=3, clamp=True):
    grid = Discretisation(dim, "float64", 0.1, 0.26, 0)
    points = rs.Ball(radius=0.42 if dim == 3 else 0.6).positions(grid)
    points[:, :dim] += np.random.default_rng(2).uniform(-0.02, 0.02, (len(points), dim))
    fluid = rs.WeaklyCompressible(rest_density=1.0, sound_speed=20.0, clamp_pressure=clamp, density="summation")
    return rs.Simulation(
        rs.Scene(
            spacing=0.1, support_radius=0.26, dim=dim, fluid=(rs.Cloud(position=points),), effects=(fluid, *effects)
        ),
        "numpy",
    )


@pytest.mark.parametrize("tension", TENSIONS, ids=lambda effect: effect.name + getattr(effect, "pair_mode", ""))
def test_sum_of_pairs_is_the_sum_of_the_forces(tension):
    """sum_pairs x_ij.F_ij = sum_i x_i.F_i, with the accelerations of the programs."""
    simulation = blob(tension)
    simulation.evaluate()
    x, a, m = (simulation.field(name).astype(float) for name in ("position", "acceleration", "mass"))
    _, _, virial = pair_virials(simulation)
    assert virial.sum() == pytest.approx((m[:, None] * x * a).sum(), abs=2e-6 * np.abs(virial).sum())
    assert abs(virial.sum()) > 1e-3 * np.abs(virial).sum()
