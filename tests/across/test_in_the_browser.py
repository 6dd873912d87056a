"""Lessons that compute in the browser: their numbers against refsim's references, by mouse, touch and keyboard."""

import functools
import json
import pathlib
import re

import numpy as np
import pytest

from refsim import Cloud, Scene, Simulation, SurfaceDetection, WeaklyCompressible
from refsim.examples import sph_by_hand
from refsim.smoothing import smoothing
from refsim.smoothing.reference import kernel_value
from refsim.surface_detection import plane_moment
from tests.io.test_exercises import WRITTEN
from tests.render.browser import Browser, chromium
from tests.running import rows

pytestmark = pytest.mark.skipif(chromium() is None, reason="Chromium is not installed")
DOCS = pathlib.Path(__file__).parents[2] / "docs"
SUM, FAN = "0_in_the_browser", "1_in_the_browser"
WIDTHS = (1280, 390)
in_each_width = pytest.mark.parametrize("opened", WIDTHS, indirect=True)
SAID = "document.querySelector('.live .said').textContent"
COUNTED = "document.querySelector('.live .count').textContent"
D, H = 0.01, 0.026  # of the fan scan [m]
EFFECTS = (WeaklyCompressible(sound_speed=10.0, dynamic_viscosity=1.0, density="summation"), SurfaceDetection())


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    """Chromium without a network."""
    made = Browser(tmp_path_factory.mktemp("chromium"), 1280, 900)
    made.call("Network.enable")
    made.call("Network.emulateNetworkConditions", offline=True, latency=0, downloadThroughput=0, uploadThroughput=0)
    yield made
    made.close()


@pytest.fixture
def opened(request, browser, tmp_path):
    """open(NAME): the HTML of that page of the lessons, with the site's style; 1,280 pixels wide by default."""
    width = getattr(request, "param", WIDTHS[0])

    def open_page(name):
        text = (DOCS / "lessons" / f"{name}.md").read_text(encoding="utf-8")
        parts = "".join(re.findall(r"^<.*$", text, re.MULTILINE)).replace("../_static", (DOCS / "_static").as_uri())
        style = f'<link rel="stylesheet" href="{(DOCS / "_static" / "site.css").as_uri()}">'
        page = tmp_path / "page.html"
        page.write_text(f'<!doctype html><meta charset="utf-8">{style}<div class="content">{parts}</div>')
        browser.errors.clear()
        browser.size(width, 900)
        browser.open(page)
        assert browser.value("document.documentElement.scrollWidth") <= width
        assert browser.errors == []
        return browser

    return open_page


def slide(browser, name, steps):
    """Move a slider by arrow keys."""
    browser.value(f"document.getElementById('{name}').focus()")
    browser.press("ArrowRight" if steps > 0 else "ArrowLeft", abs(steps))


def choose_field(browser, value):
    browser.value(f"(() => {{ const field = document.getElementById('field'); field.value = '{value}';"
                  " field.dispatchEvent(new Event('change')); })()")  # fmt: skip


def smoothed(points, d, h, field, x):
    """The sum at (x, 0.5 m), and the number of particles nearer than h, by refsim's reference of the kernel."""
    distance = np.hypot(x - points[:, 0], 0.5 - points[:, 1])
    value = {"ones": np.ones(len(points)), "wave": np.sin(2 * np.pi * points[:, 0])}[field]
    return d**2 * value @ kernel_value(distance, smoothing("wendland_c2", h, 2)), int((distance < h).sum())


def lattice(d):
    places = d * (np.arange(round(1 / d)) + 0.5)
    return np.stack(np.meshgrid(places, places), -1).reshape(-1, 2)


def numbers(text):
    return [float(found) for found in re.findall(r"-?\d+\.?\d*", text.replace("−", "-"))]


def test_the_smoothed_sum_is_that_of_the_reference_while_the_sliders_move(opened):
    browser = opened(SUM)
    moves = ("x", -50), ("h", 6), ("d", 2), ("jitter", 5), ("field", "wave"), ("x", 27), ("h", -9)
    for name, steps in ((None, 0), *moves):
        if name == "field":
            choose_field(browser, steps)
        elif name:
            slide(browser, name, steps)
        state = browser.value("SmoothedSum.state")
        points = np.array(browser.value("SmoothedSum.particles()"))
        off = np.abs(points - lattice(state["d"])).max() / state["d"]
        assert 0.9 * state["jitter"] - 1e-12 <= off <= state["jitter"] + 1e-12
        total, near = smoothed(points, state["d"], state["h"], state["field"], state["x"])
        x, shown, field, error, count, _ = numbers(browser.value(SAID))
        exact = 1.0 if state["field"] == "ones" else np.sin(2 * np.pi * state["x"])
        assert (x, count) == (pytest.approx(state["x"]), near)
        assert (shown, field, error) == pytest.approx((total, exact, total - exact), abs=6e-6)
    assert state == {"h": 0.1, "d": 0.025, "jitter": 0.25, "field": "wave", "x": pytest.approx(0.27)}


def answered(browser, number, text, by_keyboard):
    """What the page says to an answer of its question."""
    field = f"#answer{number}"
    browser.click(field)
    browser.value(f"document.querySelector('{field}').value = ''")
    browser.write(text)
    browser.press("Enter") if by_keyboard else browser.click(f"form:has({field}) button")
    return browser.value(f"document.querySelector('form:has({field}) output').textContent")


SUMS = (  # by refsim: what each question of lesson 0 asks for
    lambda: np.divide(*kernel_value(np.array([0.5, 0.0]), smoothing("wendland_c2", 1.0, 2))),
    lambda: smoothed(lattice(0.05), 0.05, 0.13, "ones", 0.0)[0],
    lambda: smoothed(lattice(0.025), 0.025, 0.13, "ones", 0.5)[1],
    lambda: 0.12,
)


def told_apart(browser, questions, exact):
    """Right answers are praised, wrong ones told apart, by mouse and keyboard in turns; others get the hint."""
    for number, (one, value) in enumerate(zip(questions, exact, strict=True), 1):
        assert answered(browser, number, f"{value:.9f}", number % 2).startswith("Right. ")
        wrong = [answered(browser, number, str(least), number % 2) for least, _, _ in one["wrong"]]
        assert wrong == [f"Not yet. {says}" for _, _, says in one["wrong"]]
        assert answered(browser, number, "-777", False) == f"Not yet. {one['hint']}"


@pytest.mark.parametrize(
    "page, name, exact", [(SUM, "SmoothedSum", SUMS), (FAN, "FanScan", (lambda: 26, lambda: 90, lambda: lifted()))]
)
def test_right_answers_are_praised_and_wrong_ones_told_apart(opened, page, name, exact):
    browser = opened(page)
    told_apart(browser, browser.value(f"{name}.QUESTIONS"), [value() for value in exact])
    for text in ("many", "4x"):
        assert answered(browser, 1, text, True).startswith("Write one number, such as 0.5 or 3/16")
    if page == SUM:
        assert all(answered(browser, 1, text, True).startswith("Right") for text in ("3/16", "0,1875", " 18.75 % "))
        assert all(answered(browser, 4, text, True).startswith("Right") for text in ("12 cm", "0.12 m", "60 mm"))
        assert answered(browser, 4, "0.12 cm", True).startswith("Not yet")


def test_a_written_number_is_read_as_in_the_notebooks(opened):
    browser = opened(SUM)
    for text, unit, value in WRITTEN:
        found = browser.value(f"(n => Number.isFinite(n) ? n : null)(Live.number({json.dumps(text)}, '{unit}'))")
        assert found == (value if value is None else pytest.approx(value)), text


@functools.cache
def limits():
    grid = Simulation(detection(block()), backend="numpy").plan.grid
    return EFFECTS[0].rest_number_density(grid), plane_moment(EFFECTS[0], grid)


def block():
    """The undisturbed block (54, 2) [m], rows from below."""
    return D * (np.stack(np.meshgrid(np.arange(9) + 2.5, np.arange(6) + 1.5), -1).reshape(-1, 2))


def detection(points):
    return Scene(dim=2, spacing=D, support_radius=H, dtype="float64", fluid=(Cloud(position=points),), effects=EFFECTS)


def lifted():
    """Spacings above its old place at which particle 50 leaves the fan of particle 49."""
    for lift in np.arange(10, 40) / 10:
        points = block()
        points[49, 1] += lift * D
        if Simulation(detection(points), backend="numpy").field("surface")[48] == 1:
            return lift
    return None


def compare(browser):
    """Hold the page's detection to that of refsim's references, particle by particle."""
    points = np.array(browser.value("FanScan.state.points"))
    found = browser.value("FanScan.detected(FanScan.state.points)")
    simulation, (rest, plane) = Simulation(detection(points), backend="numpy"), limits()
    assert browser.value("[FanScan.REST, FanScan.PLANE]") == pytest.approx((rest, plane), rel=1e-12)
    for name, field, unit in (("share", "number_density", rest), ("moment", "asymmetry", plane)):
        exact = simulation.field(field) / unit
        np.testing.assert_allclose([one[name] for one in found], exact, rtol=1e-10, atol=1e-10)
    surface, scanned = simulation.field("surface"), simulation.field("scan_candidates")
    assert [one["surface"] for one in found] == list(surface == 1)
    assert [one["scanned"] for one in found] == list(scanned == 1)
    counts = numbers(browser.value(COUNTED))
    assert counts == [surface.sum(), len(points), scanned.sum()]
    return points


@pytest.mark.parametrize("number", [1, 2, 3])
def test_surface_particles_are_those_of_the_reference(opened, number):
    browser = opened(FAN)
    assert compare(browser) == pytest.approx(block())
    browser.click(f".controls button:nth-child({number})")
    points = compare(browser)
    assert (number == 1) == np.allclose(points, block())


@in_each_width
def test_particles_follow_mouse_finger_and_arrow_keys(opened):
    browser = opened(FAN)
    unit = browser.value("document.querySelector('.live svg').getScreenCTM().a") * 400 / 13  # pixels a spacing
    for number, act in ((50, browser.drag), (23, browser.touch)):
        before = np.array(browser.value("FanScan.state.points"))
        x, y = browser.place(f".live svg circle:nth-of-type({number})")
        act((x, y), (x + 0.2 * unit, y - 0.5 * unit), (x + 0.4 * unit, y - 1.5 * unit))
        moved = (compare(browser) - before) / D
        assert (moved[number - 1], np.count_nonzero(moved.any(1))) == (pytest.approx((0.4, 1.5), abs=0.05), 1)
        assert f"Particle {number}." in browser.value(SAID)
    slide(browser, "chosen", -18)
    browser.press("Tab")
    before = np.array(browser.value("FanScan.state.points"))
    for key in ("ArrowUp", "ArrowLeft"):
        browser.press(key, 3)
    moved = (compare(browser) - before) / D
    assert moved[4] == pytest.approx((-0.3, 0.3))
    assert "Particle 5." in browser.value(SAID)


def test_the_liquid_is_that_of_the_program(opened):
    """200 steps of the hundred lines in Python; the energy never rises while the column collapses for a second."""
    browser = opened("liquid_5_viscosity_in_the_browser")
    times, _, places, energies = sph_by_hand.dam_break(until=200 * sph_by_hand.STEP, report=lambda _: None, every=200)
    browser.value("liquid = Liquid.advance(Liquid.create(), 200), 0")
    time, found, energy = browser.value("[liquid.time, Array.from(liquid.x.slice(0, 400)), Liquid.energy(liquid)]")
    assert (len(times), time) == (200, pytest.approx(times[-1]))
    np.testing.assert_allclose(np.reshape(found, (-1, 2)), places, rtol=0, atol=1e-6)
    np.testing.assert_allclose(energy, energies[-1], rtol=1e-6)
    browser.value("for (let k = 0; k < 150; k++) LiquidPage.advance(10)")
    time, energy = np.array(browser.value("LiquidPage.state.curve")).T
    assert time[-1] > 0.97
    assert np.diff(energy).max() < 0


MEASURED = pathlib.Path(__file__).with_name("measured.js").read_text()
LIQUID = rows(__file__, "liquid")


@pytest.mark.parametrize("page", LIQUID)
def test_answers_about_the_liquid_are_those_that_it_gives(opened, page):
    browser = opened(f"liquid_{1 + list(LIQUID).index(page)}_{page}_in_the_browser")
    exact = browser.value(f"(page => {{ {MEASURED} return [{', '.join(LIQUID[page])}]; }})('{page}')")
    told_apart(browser, browser.value(f"PAGES.{page}.questions"), exact)


def test_the_liquid_does_not_move_by_itself_where_motion_is_not_wanted(opened, browser):
    browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-reduced-motion", "value": "reduce"}])
    try:
        opened("liquid_4_walls_in_the_browser")
        browser.click(".controls button")
        assert browser.value("[LiquidPage.state.running, LiquidPage.state.curve.length]") == [False, 2]
    finally:
        browser.call("Emulation.setEmulatedMedia", features=[])
