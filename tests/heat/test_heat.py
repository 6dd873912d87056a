"""Heat conduction and melting as a whole: what they keep, what bounds them, and what is said about bad input."""

import numpy as np
import pytest

import refsim as rs
from refsim import Box, Cloud, HeatConduction, InputError, RunStopped, Scene, Simulation, load_scene, make_plan
from refsim.engine import launching
from tests.running import advanced
from validation.metrics import heat as exact

BAR = (Box(cells=(8, 4, 4)), Box(lower=(0.8, 0.0, 0.0), cells=(8, 4, 4)))
NUMBER = 0.1**2 * 1000.0 * 1000.0  # dt [s] of k dt/(rho c d^2) = 1 at k = 1 W/(m K)
ICE = {"melting_point": 0.0, "latent_heat": 3e4}


def bar(number=2.0, **options):
    """A warm half on a cold one, in steps of k dt/(rho c d^2) = `number`."""
    given = {
        "temperature": (50.0, -10.0), "conductivity": 1.0, "heat_capacity": 1000.0, "largest_number": 1e9, **options,
    }  # fmt: skip
    return Scene(
        spacing=0.1, support_radius=0.25, fluid=BAR, effects=(HeatConduction(**given),), step=number * NUMBER,
        dtype="float64",
    )  # fmt: skip


def ran(scene, steps=10, backend="numpy"):
    simulation = Simulation(scene, backend)
    advanced(simulation, steps)
    return simulation


def test_a_temperature_that_a_user_sets_begins_a_new_range():
    simulation = ran(bar(), 1)
    values = simulation.field("temperature")
    simulation.set_field("temperature", values + 500)
    simulation.step()
    simulation.set_field("temperature", values)
    simulation.step()
    low, high = simulation.field("temperature_range")
    assert low < values.min()
    assert values.max() < high < 60
    melting = ran(bar(scheme="implicit", **ICE), 1)
    melting.set_field("enthalpy", melting.field("enthalpy") + 1e6)  # 970 K more
    assert melting.field("temperature").max() > 900
    advanced(melting, 3)
    assert melting.field("temperature").max() > 900


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_a_temperature_that_is_set_is_kept_where_there_is_latent_heat(dtype):
    """And so is what has melted of a particle whose temperature stays."""
    melting = ran(bar(scheme="implicit", temperature=(5.0, -10.0), **ICE).with_(dtype=dtype), 60)
    values, before = melting.field("temperature"), melting.field("enthalpy")
    molten = (before > 0.01 * before.max()) & (values == ICE["melting_point"])
    assert molten.any()
    values[-1] = 60.0
    melting.set_field("temperature", values)
    assert melting.field("temperature")[-1] == 60.0
    after = melting.field("enthalpy")
    assert np.array_equal(after[molten], before[molten])
    assert after[-1] == pytest.approx(1000.0 * 60.0 + 3e4)
    melting.step()
    assert melting.field("enthalpy").astype(float).sum() == pytest.approx(after.astype(float).sum(), rel=1e-5)


def test_the_plan_says_which_sums_limit_the_step_and_reservoirs_are_held():
    places = np.random.default_rng(7).uniform(0, 0.6, (216, 3))  # whose sums s_i exceed the lattice's
    warm = places[:, 0] < 0.25
    parts = tuple(Cloud(position=places[of], mass=np.ones(sum(of))) for of in (warm, ~warm))
    plan = make_plan(bar(0.0, scheme="explicit").with_(fluid=parts))
    assert any("limit 'exchange' shortens the step" in note for note in plan.notes)
    fixed = make_plan(bar(0.25, scheme="explicit"))
    assert any("is not shortened" in note for note in fixed.notes)
    assert not make_plan(bar(0.25)).notes
    values = ran(bar(5.0, held=(1,)), 200).field("temperature")
    assert (values[128:] == -10).all()
    assert abs(values[:128] + 10).max() < 5  # the rest goes there


def test_a_scheme_that_was_removed_names_the_one_to_give(tmp_path):
    with pytest.raises(InputError, match=r"^heat_conduction: scheme = 'nonlinear_jacobi' was removed; give 'implicit'"):
        HeatConduction(scheme="nonlinear_jacobi")
    file = tmp_path / "old.toml"
    file.write_text('spacing = 0.1\nsupport_radius = 0.25\n[effects.heat_conduction]\nscheme = "single_pass"\n')
    with pytest.raises(InputError, match="scheme = 'single_pass' was removed; give 'implicit'"):
        load_scene(file)


# The case
def test_closed_forms_against_the_anchors():
    """lambda of one-phase Stefan problems (Alexiades & Solomon)."""
    known = {0.01: 0.070593276561, 0.1: 0.220016272743, 0.5: 0.464785920646, 2.0: 0.800601362806}
    for number, root in known.items():
        assert exact.stefan_root(number, 0.0, 1.0) == pytest.approx(root, rel=1e-9)


# The total of the heat
@pytest.mark.parametrize("number", [5e5, 5e4, 5e3])
def test_runge_kutta_legendre_keeps_heat_in_float32(number):
    """A poor conductor beside a good one: thousands of stages, whose mean no flow pulls back."""
    scene = Scene(
        dim=2, spacing=0.01, support_radius=0.026, step=50.0, dtype="float32",
        fluid=(Box(cells=(10, 10, 1)), Box(cells=(10, 10, 1), lower=(0.1, 0.0, 0.0))),
        effects=(HeatConduction(temperature=(0.0, 100.0), conductivity=(1.0, 2 * number), heat_capacity=1000.0,
                                scheme="runge_kutta_legendre", largest_number=1e9),),
    )  # fmt: skip
    simulation = ran(scene, 20, "cpu")  # whose rounding it is
    assert simulation.field("temperature").mean(dtype=float) == pytest.approx(50.0, abs=2e-4)
    assert not any("heat has changed" in note for note in simulation.notes)


def lossy(monkeypatch, share):
    """A scheme that cools every particle by a share of its temperature in each step."""
    real = launching.launch

    def launch(state, only=None):
        yield from real(state, only)
        state.fields["temperature"] *= 1 - share

    monkeypatch.setattr(launching, "launch", launch)


def test_heat_that_drifts_beyond_rounding_is_a_note_and_above_one_percent_a_reason_to_stop(monkeypatch):
    lossy(monkeypatch, 1e-4)
    simulation = ran(bar(), 5)
    (note,) = (n for n in simulation.notes if "the heat has changed" in n)
    assert "rounding explains" in note
    with pytest.raises(RunStopped, match="take another scheme") as stop:
        advanced(simulation, 200)
    assert stop.value.reason == "heat_lost"
    assert simulation.steps in (64, 128)


def test_rounding_of_one_temperature_ends_no_run(monkeypatch):
    lossy(monkeypatch, 3e-14)
    assert any("the heat has changed" in note for note in ran(bar(temperature=50.0), 2).notes)


@pytest.mark.parametrize(
    "options", [{"held": (0,)}, {"largest_drift": 0.0}, {"conductivity": 0.0}], ids=["held", "allowed", "none"]
)
def test_heat_that_may_change_ends_no_run(options, monkeypatch):
    lossy(monkeypatch, 1e-3)
    assert ran(bar(**options), 40).steps == 40


def test_one_sided_exchange_stops_unless_its_loss_is_allowed():
    with pytest.raises(RunStopped, match="largest_drift") as stop:
        ran(bar(2.0, scheme="one_sided", conductivity=(1.0, 3.0)), 40)
    assert stop.value.reason == "heat_lost"


MELT = rs.WeaklyCompressible(sound_speed=40.0, dynamic_viscosity=50.0, state="tait", density="summation")
BODY = rs.SolidBox(lower=(0.4, 0.4, 0.8), upper=(1.4, 1.4, 1.8), density=917.0)


@pytest.mark.parametrize(("bookkeeping", "change"), [("immiscible", 0.0), ("water", 83.0)])
def test_mass_and_rest_density_of_the_melt(bookkeeping, change):
    """Kept, or those of the liquid: the density of 125 particles of ice increases by 83 kg/m^3."""
    effects = (
        MELT, rs.Gravity(), rs.BoxWalls(lower=(0, 0, 0), upper=(1.8, 1.8, 3)), rs.ShapeMatching(summation="gather"),
        rs.TwoWayCoupling(), rs.Melting(bookkeeping=bookkeeping),
        rs.HeatConduction(temperature=5.0, conductivity=0.0, melting_point=0.0, scheme="explicit"),
    )  # fmt: skip
    scene = rs.Scene(
        spacing=0.2, support_radius=0.5, step=0.004, dtype="float64", fluid=(rs.Box(cells=(9, 9, 4)),),
        solid=(BODY,), effects=effects,
    )  # fmt: skip
    simulation = rs.Simulation(scene, "numpy")
    volume = 1 / simulation.plan.effects["weakly_compressible"].rest_number_density(simulation.plan.grid)
    before = simulation.field("mass").sum()
    advanced(simulation, 4)
    assert simulation.field("mass").sum() - before == pytest.approx(125 * change * volume, abs=1e-9 * before)
    assert (simulation.field("rest_density")[:125] == (1000.0 if change else 917.0)).all()
