"""From newtons per metre and angles to coefficients: `calibrate`, `calibrate_contact_angle`, and their maps."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

import refsim as rs
from refsim import calibrate, calibrate_contact_angle, load_scene, make_plan
from refsim.core.capabilities import with_scene_defaults
from refsim.core.effect import EFFECTS, Discretisation
from refsim.surface_tension.calibration import MAP, SETTINGS, sigma_map
from refsim.surface_tension.cohesion import drops_of, tables_of
from tests.running import rows
from validation.measure import sigma_map as condensing
from validation.measure import tension, wetting
from validation.measure.command import DATA
from validation.measure.drops import points
from validation.measure.sigma_map import read_rows

EXAMPLE = Path(rs.__file__).parent / "examples" / "water_drop.toml"
WATER = {"spacing": 1e-3, "rest_density": 1000.0}


def setting(ratio=2.0, apart=0.0, support=2.6, stiffness=0.01, radii=(10.0, 14.0), model="akinci"):
    """A setting of an artificial map: Laplace and Rayleigh differ from the ratio by `apart`, in opposite directions."""
    each = {"seeds": 3, "laplace": ratio * (1 + apart), "rayleigh": ratio * (1 - apart)}
    each |= {"laplace_spread": 0.02 * ratio, "rayleigh_spread": 0.0}
    place = {"model": model, "dim": 3, "support": support, "stiffness": stiffness, "kernels": "mueller"}
    return {**place, "drops_by_radius": [{"radius": radius, **each} for radius in radii]}


MADE_UP = (
    setting(2.0), setting(3.0, support=3.0), setting(1.0, stiffness=0.003), setting(4.0, stiffness=0.03),
    setting(3.0, apart=0.6, model="dong"), setting(model="he", radii=()),
)  # fmt: skip


def made_up(sigma=0.072, model="akinci", **options):
    return calibrate(sigma, model, **WATER, settings=MADE_UP, **options)


def test_the_nominal_tension_is_the_wanted_one_over_the_measured_ratio():
    found = made_up()
    assert (found.ratio, found.nominal) == (2.0, 0.036)
    grid = Discretisation(3, "float64", 1e-3, 2.6e-3, 0)
    others = {"weakly_compressible": rs.WeaklyCompressible(sound_speed=found.sound_speed, density="summation")}
    nominal = rs.Akinci2013(surface_tension=found.nominal)
    assert found.effect.gamma == pytest.approx(nominal.coefficient(grid, others))
    assert found.effect.surface_tension is None
    assert found.stiffness == pytest.approx(found.nominal / (1000 * found.sound_speed**2 * 1e-3))
    assert found.stiffness == 0.01
    assert found.uncertainty == pytest.approx(0.01)  # two radii with half of 2 % each, of independent seeds: 1 %
    assert found.nominal_error == pytest.approx(0.01 * 0.036)
    assert [made_up(radius=radius).ratio for radius in (0.010, 0.014)] == [2.0, 2.0]
    found = made_up(support_radius=2.8e-3)
    share = math.log(2.8 / 2.6) / math.log(3.0 / 2.6)
    assert found.ratio == pytest.approx(2 + share)
    assert found.uncertainty == pytest.approx(math.hypot(0.01, 0.25 / found.ratio))


@pytest.mark.parametrize("stiffness, ratio", [(0.003, 1.0), (0.01, 2.0), (0.02, 2 + 2 * math.log(2) / math.log(3))])
def test_a_sound_speed_sets_the_stiffness(stiffness, ratio):
    speed = math.sqrt(0.072 / ratio / (stiffness * 1000 * 1e-3))
    found = made_up(sound_speed=speed)
    assert (found.ratio, found.stiffness) == (pytest.approx(ratio, rel=1e-5), pytest.approx(stiffness, rel=1e-5))
    assert found.sound_speed == speed


STANDING = (rs.Gravity(), rs.BoxWalls(lower=(0.0,) * 3, upper=(8.0,) * 3, open_faces=("+z",)))


def share_of(dim, support, stiffness, model=rs.Akinci2013, radius=0.0, standing=False, **given):
    """Measured over nominal tension that a model takes for a tension of this S, in drops of this radius [d]."""
    liquid = rs.WeaklyCompressible(rest_density=1.0, sound_speed=stiffness**-0.5, **({"density": "continuity"} | given))
    beside = () if given.get("density") else (rs.ParticleShifting(),)
    grid = Discretisation(dim, "float64", 1.0, support, 0, drop_radius=radius)
    effects = with_scene_defaults((model(surface_tension=1.0), liquid, *beside, *STANDING * standing))
    return effects[model.name].share_of_nominal(grid, effects)


@pytest.mark.parametrize("standing", [False, True])
def test_a_tension_is_turned_into_a_coefficient_by_measured_drops(standing):
    """At measured settings, between them, at the nearest beyond; nominal summed, without shifting, 2D standing."""
    known = dict(drops_of("akinci_2013", not standing).measured[3])

    def share(*place, **given):
        area = min(max(0.02 / place[-1], 3), 8) if standing and not given else 1  # that of containers over the printed
        return share_of(*place, standing=standing, **given) / area

    assert share(3, 2.6, known[2.6][1][0]) == pytest.approx(known[2.6][1][1])
    middle = math.sqrt(known[2.6][0][0] * known[2.6][1][0])
    assert share(3, 2.6, middle) == pytest.approx((known[2.6][0][1] + known[2.6][1][1]) / 2)
    assert share(3, 2.9, 1e-6) == pytest.approx((known[2.8][0][1] + known[3.0][0][1]) / 2)
    assert share(3, 2.6, 0.01, density="summation") == 1.0
    assert (share_of(2, 2.6, 0.01, standing=standing) == 1.0) == standing
    liquid = rs.WeaklyCompressible(rest_density=1.0, sound_speed=10.0, density="continuity")
    grid, unshifted = Discretisation(3, "float64", 1.0, 2.6, 0), rs.Akinci2013(surface_tension=1.0)
    assert unshifted.share_of_nominal(grid, {"weakly_compressible": liquid}) == 1.0


def test_the_coefficient_follows_the_smallest_body_of_liquid():
    """The share of its radius, those beyond as the nearest; a note where it is smaller than any measured drop."""
    whole, factors = share_of(3, 2.6, 0.005, rs.CsfWang2019), dict(drops_of("csf_wang_2019").by_radius[3])
    for radius, nearest in ((6.0, 6.0), (10.0, 10.0), (20.0, 20.0), (1e3, 20.0), (1.0, 6.0)):
        factor = factors[nearest][0][1][0][1]
        assert share_of(3, 2.6, 0.005, rs.CsfWang2019, radius=radius) == pytest.approx(whole * factor)
    ball, far, beside = rs.Ball(radius=10.0), (50.0, 0.0, 0.0), (10.5, 0.0, 0.0)
    liquid = rs.WeaklyCompressible(rest_density=1.0, sound_speed=15.0, dynamic_viscosity=3.0)
    for parts, radius in (
        ((ball,), 10.0), ((ball, rs.Ball(center=far, radius=4.0)), 4.0),
        ((ball, rs.Box(lower=beside, cells=(1, 1, 1))), 10.0),
    ):  # fmt: skip
        effects = (liquid, rs.CsfWang2019(surface_tension=1.0))
        plan = make_plan(rs.Scene(spacing=1.0, support_radius=2.6, fluid=parts, effects=effects))
        assert plan.grid.drop_radius == pytest.approx(radius, rel=0.02)
        assert any("a radius of 6 to 20" in note for note in plan.notes) == (radius < 5)


RATES = rows(__file__, "rates")


@pytest.mark.parametrize("name", RATES)
def test_the_density_returns_at_the_rate_of_the_measured_drops(name):
    """It follows S = sigma/(rho0 c^2 d) and h/d; one that is given stays, and other liquids and models have theirs."""
    model, given, stiffness, support, standing, rate = RATES[name]
    dim, liquid = given.get("dim", 3), {n: v for n, v in given.items() if n != "dim"}
    fluid = rs.WeaklyCompressible(rest_density=1.0, sound_speed=stiffness**-0.5, dynamic_viscosity=1.0, **liquid)
    effects = (fluid, EFFECTS[model](surface_tension=1.0), *STANDING[2 - standing :])
    block = rs.Box(lower=(0.5,) * dim + (0.0,) * (3 - dim), cells=(4, 4, 4 if dim == 3 else 1))
    plan = make_plan(rs.Scene(spacing=1.0, support_radius=support, dim=dim, fluid=(block,), effects=effects))
    assert plan.effects["weakly_compressible"].restoring == pytest.approx(rate)


def test_the_area_term_of_a_coefficient_is_the_printed_one():
    """0.001 gamma rho0; that of a calibrated tension has another share of its cohesion, in containers by S."""
    grid = Discretisation(3, "float64", 1.0, 2.6, 0)
    for given, share, beside in (
        ({"gamma": 3.0}, 1e-3, ()), ({"gamma": 3.0}, 1e-3, STANDING), ({"surface_tension": 1.0}, 4e-3, ()),
        ({"surface_tension": 0.9}, 8e-3, STANDING), ({"surface_tension": 2.25}, 4e-3, STANDING),
        ({"surface_tension": 9.0}, 3e-3, STANDING),
    ):  # fmt: skip
        for density, wanted in (("summation", 1e-3), ("continuity", share)):
            liquid = rs.WeaklyCompressible(rest_density=2.0, sound_speed=15.0, density=density)
            others = with_scene_defaults((rs.Akinci2013(**given), liquid, rs.ParticleShifting(), *beside))
            model = others["akinci_2013"]
            assert model.area_coefficient(grid, others) == pytest.approx(wanted * 2 * model.coefficient(grid, others))


@pytest.mark.parametrize(("standing", "support", "stiffness", "said"), rows(__file__, "unmeasured_drops"))
def test_what_no_measured_drop_had_is_noted(standing, support, stiffness, said):
    liquid = rs.WeaklyCompressible(sound_speed=10.0, density="continuity")
    beside = {effect.name: effect for effect in STANDING if standing} | {"particle_shifting": rs.ParticleShifting()}
    tension = rs.Akinci2013(surface_tension=stiffness * 1000 * 10.0**2 * 0.01)
    grid = Discretisation(3, "float64", 0.01, 0.01 * support, 0)
    notes = tension.notes(grid, {"weakly_compressible": liquid} | beside)
    found = [note for note in notes if "that of drops measured with" in note]
    assert len(found) == bool(said)
    assert said in "".join(found)


def test_what_a_note_says_of_a_model_s_drops_is_what_was_measured():
    """Rows of `python -m validation measure tension`: least and most by jump and by frequency."""
    stored = [row for row in json.loads((DATA / "tension.json").read_text()).values() if not row["stopped"]]
    for name, model in tension.SPH.items():
        for density, by_dimension in tables_of(model.name).get("nominal", {}).items():
            for dim, said in by_dimension.items():
                of = [row for row in stored if (row["model"], row["liquid"], row["dim"]) == (name, density, int(dim))]
                for words, yardstick in zip(said, ("laplace", "rayleigh"), strict=True):
                    least, most = (0.0, 0.0) if words == "none" else map(float, (words.split(" to ") * 2)[:2])
                    found = [row[yardstick] for row in of if row.get("share") == 1 and row.get(yardstick) is not None]
                    place = (name, density, dim, yardstick)
                    assert [min(found), max(found)] == pytest.approx([least, most], abs=0.05, rel=0.02), place


@pytest.mark.parametrize(("model", "dim", "standing"), sorted(tension.JUDGED))
def test_drops_of_the_default_liquid_have_the_tension_asked_for(model, dim, standing):
    """By jump and by frequency, in the mean over seeds, to 5 %: by other seeds than those of the shares.

    Drops had the coefficient of their row's `share`; the tension is in proportion to it.
    """
    stored, drops, of = json.loads((DATA / "tension.json").read_text()), {}, tension.MODELS[model]
    for point in tension.points((model,), (dim,)):
        if point.liquid == "continuity" and point.standing == standing and point.seed > 3:
            row, place = stored[point.key], (point.support, point.stiffness, point.radius)
            share = share_of(dim, *place[:2], of, radius=point.radius, standing=standing)
            assert row["share"] == pytest.approx(share, rel=0.1), place
            drops.setdefault(place, []).append(np.array([row["laplace"], row["rayleigh"]]) * row["share"] / share)
    small, large, _ = drops_of(of.name, not standing).radii.get(dim) or drops_of(of.name).radii[dim]
    for place, acting in drops.items():
        bar = 0.05 if small <= place[-1] <= large else 0.07  # beyond them a note says by how much
        assert np.mean(acting, axis=0) == pytest.approx([1, 1], abs=bar), place


# The published map
def test_the_published_map_is_that_of_the_published_drops(tmp_path):
    rows = condensing.read_rows()
    assert len(rows) > 60
    wanted = {point.key for point in points()}
    assert {row["key"] for row in rows} <= wanted
    condensing.write(rows, tmp_path / "map.json")
    assert json.loads((tmp_path / "map.json").read_text()) == json.loads(MAP.read_text())
    assert {entry["model"] for entry in sigma_map()} == set(SETTINGS)


# Condensing
def test_the_example_of_the_water_drop_has_the_tension_of_water():
    """In the liquid of the measured drops; that it plans without a note says that it is none beyond them."""
    plan = make_plan(load_scene(EXAMPLE))
    tension, liquid = plan.effects["akinci_2013"], plan.effects["weakly_compressible"]
    assert (tension.surface_tension, liquid.density) == (0.0728, "continuity")
    assert tension.share_of_nominal(plan.grid, plan.effects) > 1.5


def sessile(*drops):
    """An artificial map of drops of (share, angle, angle by a circle)."""
    names = ("share", "angle", "circle")
    drops = [dict(zip(names, drop)) | {"spread": 2.0} for drop in drops]
    return [{"dim": 3, "support": 2.6, "stiffness": 0.01, "kernels": "mueller", "drops": drops}]


NONE = (0.0, None, None)
SESSILE = sessile(NONE, (5.0, 120.0, None), (10.0, 90.0, 96.0), (20.0, 60.0, None), (50.0, None, None))


@pytest.mark.parametrize("dim, radius", [(3, 14.0), (2, 30.0)])
@pytest.mark.parametrize("angle", [30.0, 60.0, 90.0, 120.0, 150.0])
def test_both_ways_read_the_angle_of_a_cap_that_was_cut(dim, radius, angle):
    position = wetting.cap(wetting.Point(5.0, dim, radius=radius, begin=angle))
    height, count = position[:, dim - 1], len(position)
    assert wetting.angle_by_lift(height.mean() / count ** (1 / dim), dim) == pytest.approx(angle, abs=1.0)
    found, residual = wetting.angle_by_circle(height, 1.0, 1, dim)
    assert found == pytest.approx(angle, abs=1.5)
    assert residual < 0.03


def test_the_coefficient_is_interpolated_in_the_cosine_as_a_share_of_the_cohesion():
    """gamma of the effect as it acts: from its own nominal tension, in SI units."""
    found = calibrate_contact_angle(105.0, 0.072, settings=SESSILE, **WATER)
    part = (math.cos(math.radians(105)) + 0.5) / 0.5
    assert found.share == pytest.approx(5 + 5 * part)
    assert found.uncertainty == pytest.approx(math.hypot(2.0, 3.0, 7.5 * 4 * part * (1 - part)))
    assert found.effect.gamma == calibrate(0.072, **WATER).effect.gamma
    assert found.effect.adhesion == found.adhesion
    at = calibrate_contact_angle(60.0, 0.072, settings=SESSILE, **WATER)
    assert (at.share, at.uncertainty) == (pytest.approx(20.0), pytest.approx(math.hypot(2.0, 3.0)))
    found = calibrate_contact_angle(90.0, 0.072, settings=SESSILE, **WATER)
    given = {"rest_density": 1000.0, "sound_speed": found.tension.sound_speed, "density": "summation"}
    effects = (rs.WeaklyCompressible(kernels="mueller", **given), found.effect)
    one = rs.Cloud(position=np.zeros((1, 3)))
    scene = rs.Scene(spacing=1e-3, support_radius=2.6e-3, fluid=(one,), effects=effects)
    gamma = float(make_plan(scene).parameters["akinci_2013"]["spline"].gamma)
    assert found.adhesion / gamma == pytest.approx(10.0, rel=1e-5)


def angled(angle=90.0, sigma=0.072, **given):
    return calibrate_contact_angle(angle, sigma, **{"settings": SESSILE, **WATER} | given)


@pytest.mark.parametrize("call, options, said", [
    *((made_up, *row) for row in rows(__file__, "outside_sigma").values()),
    (angled, {"angle": math.nan}, "angle = nan is not a positive number"),
    (angled, {"sigma": -1.0}, "sigma = -1.0 is not a positive number"),
    (angled, {"angle": 150.0}, "150 degrees is outside the map at h = 2.6 d, which has 60 to 120 degrees"),
    (angled, {"angle": 20.0}, "beyond it drops spread to a film or detach from the plane"),
    (angled, {"dim": 2}, "the map has no sessile drops in 2D with mueller kernels at h = 2.6 d"),
    (angled, {"support_radius": 2.8e-3}, "at h = 2.8 d and density = 'summation'; it has h/d = 2.6."),
    (angled, {"settings": sessile(NONE)}, "no drop at h = 2.6 d came to rest as a cap"),
])  # fmt: skip
def test_outside_its_map_a_call_is_refused_in_one_sentence(call, options, said):
    with pytest.raises(rs.InputError) as refused:
        call(**options)
    assert said in str(refused.value)
    assert str(refused.value).startswith("calibrate: " if call is made_up else "calibrate_contact_angle: ")
    assert str(refused.value).endswith(".")


def test_the_published_map_of_angles_is_that_of_its_drops(tmp_path):
    wetting.write(read_rows(wetting.ROWS), tmp_path / "map.json")
    assert json.loads((tmp_path / "map.json").read_text()) == json.loads(wetting.PACKAGED.read_text())
    assert {row["key"] for row in read_rows(wetting.ROWS)} <= {point.key for point in wetting.points()}
