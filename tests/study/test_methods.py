"""What other liquids, walls and tensions buy for a second, of planted values."""

import json
import math

import pytest

import refsim
from refsim import Akinci2013, Box, BoxWalls, Gravity, InputError, RunStopped, Scene, WeaklyCompressible
from refsim.__main__ import main
from refsim.scene.files import scene_to_toml
from refsim.study.convergence import Reference, converge
from refsim.study.methods import METHODS, Line, others

LIQUID = WeaklyCompressible(sound_speed=20.0, dynamic_viscosity=2.0, density="summation")
WALLS = BoxWalls(lower=(0.0, 0.0, 0.0), upper=(0.3, 0.3, 0.0), open_faces=("+y",), model="mirrored")


def tank(*more):
    return Scene(
        dim=2, spacing=0.01, support_radius=0.026, end_time=0.0005, fluid=(Box(cells=(6, 12, 1)),),
        effects=(LIQUID, Gravity(acceleration=(0.0, -9.81, 0.0)), *more),
    )  # fmt: skip


def planted(simulation):
    """5 + a (d/10 mm)^2: a = 1, and 0.1 by an advanced density, whose finest level stops."""
    plan = simulation.plan
    advanced = plan.effects["weakly_compressible"].density == "continuity"
    if advanced and plan.effects["weakly_compressible"].gradient == "corrected" and plan.grid.spacing < 0.008:
        raise RunStopped("diverged", "a particle is gone.")
    return 5 + (0.1 if advanced else 1.0) * (plan.grid.spacing / 0.01) ** 2


def test_liquids_that_need_extrapolated_walls_get_them():
    said = []
    found = others(tank(WALLS), ("liquid", "walls"), said)
    assert list(found) == [
        "gradient corrected, walls extrapolated", "density continuity, walls extrapolated",
        "density continuity, gradient corrected, walls extrapolated", "implicit pressure", "walls extrapolated",
    ]  # fmt: skip
    assert not said
    for label, scene in found.items():
        effects = {effect.name: effect for effect in scene.effects}
        assert effects["box_walls"].model == ("extrapolated" if "extrapolated" in label else "mirrored")
        assert effects["weakly_compressible"].density == ("continuity" if "continuity" in label else "summation")
        assert effects["weakly_compressible"].viscosity == "laplacian"  # as it is
        assert ("iisph" in effects) == (label == "implicit pressure")


def test_a_liquid_as_it_is_by_default_has_other_methods():
    """An advanced density between extrapolated walls; another density keeps the walls."""
    liquid, walls = (
        type(effect)(**{name: getattr(effect, name) for name in names})
        for effect, names in ((LIQUID, ("sound_speed", "dynamic_viscosity")), (WALLS, ("lower", "upper", "open_faces")))
    )
    found = others(tank(walls).with_(effects=(liquid, walls)), ("liquid", "walls"), said := [])
    assert list(found) == ["density summation", "density summation, gradient corrected", "gradient corrected",
                           "implicit pressure"]  # fmt: skip
    assert all(s.effects[1].model == "extrapolated" for s in list(found.values())[:3])
    assert said == [said[0]]
    assert said[0].startswith("walls mirrored left out: weakly_compressible: density = 'continuity'")


def test_models_of_the_tension_have_the_scenes_own():
    said = []
    found = others(tank(Akinci2013(surface_tension=0.07)), ("tension", "heat"), said)
    assert "Akinci 2013" not in found
    assert len(found) + len(said) >= 6
    for scene in found.values():
        (model,) = (e for e in scene.effects if hasattr(e, "surface_tension"))
        assert model.surface_tension == 0.07
    with pytest.raises(InputError, match="no surface_tension that another model could have"):
        others(tank(Akinci2013()), ("tension",), said)
    with pytest.raises(InputError, match=f"there is no kind of methods 'wall'; choose from {', '.join(METHODS)}"):
        others(tank(), ("wall",), said)


def test_what_a_second_buys_by_hand():
    """Errors of 4, 2 and 1 % in 1, 10 and 100 s: 2.83 % in 3.16 s, and 31.6 s to 1.41 %."""
    line = Line("", (3.0, 2.0, 1.0), (0.04, 0.02, 0.01), (1.0, 10.0, 100.0), converge([1.0], [1.0]))
    assert line.error_in(math.sqrt(10)) == pytest.approx(0.02 * math.sqrt(2))
    assert line.seconds_to(0.01 * math.sqrt(2)) == pytest.approx(10 * math.sqrt(10))
    assert (line.error_in(0.5), line.error_in(200.0), line.seconds_to(0.005)) == (None, None, None)
    assert (line.seconds_to(0.05), line.seconds_to(0.01)) == (1.0, pytest.approx(100.0))
    swings = Line("", (3.0, 2.0, 1.0), (0.001, 0.02, 0.01), (1.0, 10.0, 100.0), line.limit)
    assert swings.seconds_to(0.015) > 10


@pytest.mark.parametrize("reference", [None, Reference(5.0, 5.0, 0.0, "known")])
def test_a_study_compares_methods(reference):
    found = refsim.study(
        tank(WALLS), planted, backend="numpy", knobs=("spacing",), methods=("liquid",), reference=reference, error=0.01
    )
    assert found.convergence.value == pytest.approx(5.0)
    rows = {row["method"]: row for row in found.bought()}
    known = 0.0 if reference else 1.25 * 0.02 / 1.5**2
    assert rows["as it is"]["error"] == pytest.approx(0.2 / 1.5**2)
    assert rows["density continuity, walls extrapolated"]["error"] == pytest.approx(max(0.02 / 1.5**2, known))
    assert rows["density continuity, walls extrapolated"]["order"] == pytest.approx(2.0)
    corrected = rows["density continuity, gradient corrected, walls extrapolated"]
    assert corrected["error"] == pytest.approx(0.02)
    assert "a particle is gone" in corrected["failed"][0]
    assert (rows["as it is"]["to_error"], corrected["to_error"]) == (None, None)
    text = found.text()
    assert (
        "methods against " + ("known, 5" if reference else "the limit of density continuity, walls extrapolated, 5")
        in text
    )
    assert "corrected, walls extrapolated, spacing 0.006667 m: observable planted" in text
    assert not [row for row in found.cells() if row[0] == "method"]
    drawn = found.plot().axes[1]
    assert [line.get_label() for line in drawn.lines if not line.get_label().startswith("_")] == [
        name + " (some stopped)" * bool(row["failed"]) for name, row in rows.items()
    ]


def test_limits_that_differ_are_the_uncertainty():
    """Two methods that converge to 5.0 and 5.1: neither is known better than that."""

    def value(simulation):
        advanced = simulation.plan.effects["weakly_compressible"].density == "continuity"
        return (5.1 if advanced else 5.0) + 1e-3 * (simulation.plan.grid.spacing / 0.01) ** 2

    found = refsim.study(tank(WALLS), value, backend="numpy", knobs=("spacing",), methods=("liquid",))
    assert found.compared()[0].uncertainty == pytest.approx(0.02, rel=0.03)
    assert "% from the farthest limit" in found.text()


def test_no_value_no_comparison():
    def never(simulation):
        raise RunStopped("diverged", "gone.")

    found = refsim.study(tank(), never, backend="numpy", knobs=("spacing",), methods=("liquid",), levels=1)
    assert found.compared() is None
    assert found.bought() == []


def test_the_command_compares_methods(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tank.toml").write_text(scene_to_toml(tank(WALLS)))
    given = ["study", "tank.toml", "--observable", "kinetic_energy", "--backend", "numpy", "--knobs", "spacing"]
    assert main([*given, "--method", "walls", "--exact", "0.01", "--quiet", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [row["method"] for row in found["methods"]] == ["as it is", "walls extrapolated"]
    assert found["reference"]["value"] == 0.01
    assert "methods against the exact value, 0.01" in (tmp_path / "tank_study" / "study.html").read_text()
    assert main([*given, "--method", "wall"]) == 2
    assert "there is no kind of methods 'wall'" in capsys.readouterr().err


def test_a_table_says_nothing_below_its_judge_s_uncertainty():
    """Values that jump from level to level: known to 6 %, whatever the methods' distances from the finest are."""

    def value(simulation):
        advanced = simulation.plan.effects["weakly_compressible"].density == "continuity"
        return 5.0 + 0.1 * (-1) ** round(0.02 / simulation.plan.grid.spacing) * (1 + advanced)

    found = refsim.study(tank(WALLS), value, backend="numpy", knobs=("spacing",), methods=("liquid",), error=0.01)
    judge, _ = found.compared()
    assert judge.uncertainty > 0.05
    for row in found.bought():
        assert row["error"] >= judge.uncertainty
        assert row["in_seconds"] is None or row["in_seconds"] >= judge.uncertainty
        assert row["to_error"] is None
        assert math.isnan(row["order"])
    text = found.text().split("methods against")[1]
    assert text.count("< ") >= len(found.bought())
    assert " 0 %" not in text
    assert all(cells[3].startswith("< ") for cells in found.cells())
    known = refsim.study(
        tank(WALLS), value, backend="numpy", knobs=(), methods=("liquid",), reference=Reference(5.0, 5.0, 0.1, "known")
    )
    assert "the scene as it is has an error of < 10 %" in known.text()
