"""The page of `refsim view`: what it holds, how large it is, and how it looks and plays in Chromium."""

import base64
import gzip
import json
import re
from contextlib import closing

import numpy as np
import pytest

from refsim import Box, Gravity, InputError, Scene, Simulation, WeaklyCompressible
from refsim.__main__ import main
from refsim.io.frames import Frame, ParticleWriter, origin_of
from refsim.io.results import open_run
from refsim.render.view import FIELDS, view
from tests.render.browser import Browser, chromium
from tests.render.test_pictures import differ
from tests.running import rows

needs_chromium = pytest.mark.skipif(chromium() is None, reason="Chromium is not installed")
READY = "document.body && document.body.dataset.ready === 'yes'"
LARGEST = 60e6  # bytes, of 60,000 particles over 50 frames


def head(page):
    return json.loads(re.search(r'<script id="head" type="application/json">(.*?)</script>', page).group(1))


def blob(page, name):
    return gzip.decompress(base64.b64decode(re.search(rf'<script id="{name}"[^>]*>([^<]*)<', page).group(1)))


def places(page):
    """(frames, n, 3) [m], decoded as the page does."""
    found = head(page)
    data = np.frombuffer(blob(page, "places"), np.uint8).astype(int)
    code = data[: len(data) // 2] << 8 | data[len(data) // 2 :]
    change = (code >> 1) ^ -(code & 1)
    grid = np.cumsum(change.reshape(len(found["times"]), -1, 3), axis=0) % 65536
    return np.array(found["low"]) + grid / 65535 * np.array(found["extent"])


def test_the_page_holds_the_run_to_sixteen_bits(in_space):
    page = view(in_space).html
    frames = open_run(in_space)
    found = head(page)
    assert found["times"] == [frame.time for frame in frames]
    assert {field["name"] for field in found["fields"]} >= {"velocity", "pressure", "density"}
    assert found["fields"][0]["label"] == "speed"
    order = [np.argsort(frame["identity"]) for frame in frames]
    exact = np.array([frame.position[o] for frame, o in zip(frames, order)])
    assert np.abs(places(page) - exact).max() <= 0.51 * max(found["extent"]) / 65535
    field = next(k for k, f in enumerate(found["fields"]) if f["name"] == "velocity")
    levels = np.cumsum(np.frombuffer(blob(page, f"field{field}"), np.uint8).reshape(len(frames), -1), axis=0) % 256
    low, high = found["fields"][field]["low"], found["fields"][field]["high"]
    speed = np.array([np.linalg.norm(frame["velocity"][o], axis=1) for frame, o in zip(frames, order)])
    assert np.abs(low + levels / 255 * (high - low) - speed.clip(low, high)).max() <= 0.51 * (high - low) / 255


def test_a_particle_keeps_its_place_and_its_colour_when_the_run_sorts_its_particles(tmp_path):
    """Frames whose particles stand in another order, each with its number as its value, or with its part's colour."""
    parts = Box(cells=(4, 3, 1)), Box(cells=(4, 3, 1), lower=(0.0, 0.0, 0.1))
    scene = Scene(spacing=0.1, support_radius=0.2, fluid=parts, effects=(Gravity(),))
    simulation, random = Simulation(scene), np.random.default_rng(5)
    x = simulation.field("position")
    fields, origin = {"number": (1, "float32"), "identity": (1, "int32")}, origin_of(simulation.plan)
    with closing(ParticleWriter(tmp_path / "particles.pvd", fields, origin=origin)) as writer:
        for frame in range(4):
            order = random.permutation(len(x)).astype("int32")
            told = {"identity": order, "number": order.astype("float32")}
            writer.append([Frame(float(frame), x[order].astype("float32"), told)])
    page = view(tmp_path, fields=["number"]).html
    assert np.abs(places(page) - x).max() < 1e-4
    first, second = head(page)["parts"][:2]
    assert first != second
    levels = np.cumsum(np.frombuffer(blob(page, "field0"), np.uint8).reshape(4, -1), axis=0) % 256
    np.testing.assert_allclose(levels * (len(x) - 1) / 255, np.broadcast_to(np.arange(len(x)), levels.shape), atol=0.15)


def test_a_large_run_makes_a_file_of_at_most_60_megabytes(tmp_path):
    """61,440 particles over 5 frames of 50 take a tenth; values are random, so that nothing compresses them."""
    scene = Scene(
        spacing=0.01, support_radius=0.02, fluid=(Box(cells=(48, 40, 32)),),
        effects=(WeaklyCompressible(sound_speed=20.0, density="summation"), Gravity()),
    )  # fmt: skip
    simulation, random = Simulation(scene), np.random.default_rng(3)
    x = simulation.field("position")
    names = [name for name in simulation.plan.particle_fields if name not in ("position", "identity")]
    names += [f"more_{k}" for k in range(FIELDS + 1 - len(names))]
    fields = dict.fromkeys(names, (1, "float32")) | {"identity": (1, "int32")}
    with closing(ParticleWriter(tmp_path / "particles.pvd", fields, origin=origin_of(simulation.plan))) as writer:
        for frame in range(5):
            values = {name: random.normal(size=len(x)).astype("float32") for name in names}
            place = (x + random.normal(size=x.shape)).astype("float32")
            values["identity"] = np.arange(len(x), dtype="int32")
            writer.append([Frame(float(frame), place, values)])
    page = view(tmp_path)
    assert len(head(page.html)["fields"]) == FIELDS
    assert page.left_out
    assert len(page.html.encode()) < LARGEST / 10


@pytest.mark.parametrize("wrong, words", rows(__file__, "wrong_views"))
def test_wrong_words_are_answered_in_a_sentence(in_plane, wrong, words):
    with pytest.raises(InputError, match=re.escape(words)):
        view(in_plane, **wrong)


def test_the_command_writes_the_file_and_opens_the_browser(in_plane, tmp_path, capsys, monkeypatch):
    page = tmp_path / "run.html"
    assert main(["view", str(in_plane), "--html", str(page), "--fields", "pressure,velocity.x"]) == 0
    assert [field["name"] for field in head(page.read_text())["fields"]] == ["pressure", "velocity.x"]
    assert str(page) in capsys.readouterr().out
    assert main(["view", str(in_plane), "--html", str(tmp_path / "no" / "run.html")]) == 2
    assert "there is no folder" in capsys.readouterr().err
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda url: bool(opened.append(url)))
    assert main(["view", str(in_plane)]) == 0
    assert opened[0].startswith("file://")
    assert "no browser was found" in capsys.readouterr().out


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    found = Browser(tmp_path_factory.mktemp("chromium"))
    yield found
    found.close()


def shown(browser, change=""):
    """The picture of the run, without the controls, after a change of the controls."""
    browser.value(f"(() => {{ {change}; return 1 }})()")
    browser.value("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))")
    return browser.picture()[60:640].astype(int)


def setting(name, value, event):
    return f"const e = document.getElementById('{name}'); e.value = {value!r}; e.dispatchEvent(new Event('{event}'))"


@needs_chromium
@pytest.mark.parametrize("dim", [2, 3])
def test_the_page_shows_plays_colours_and_clips(browser, in_plane, in_space, tmp_path, dim):
    page = view(in_plane if dim == 2 else in_space).save(tmp_path / "run.html")
    browser.errors.clear()
    browser.open(page, READY)
    browser.value("document.getElementById('panel').open = false")
    first = shown(browser)
    coloured = (first.max(2) - first.min(2) > 40).sum()
    assert coloured > 2000  # not blank
    last = shown(browser, setting("slider", 2, "input"))
    assert differ(first, last) > 500
    assert "(3/" in browser.value("document.getElementById('time').textContent")
    by_speed = shown(browser, setting("field", 1, "change"))
    assert differ(last, by_speed) > 500
    clipped = shown(browser, setting("axis", 0, "change"))
    assert (clipped.max(2) - clipped.min(2) > 40).sum() < 0.8 * (by_speed.max(2) - by_speed.min(2) > 40).sum()
    shown(browser, setting("axis", -1, "change"))
    assert differ(shown(browser), by_speed) < 50
    for kind, x in (("Pressed", 300), ("moved", 380), ("Released", 380)):
        kind = f"mouse{kind.capitalize()}"
        browser.call("Input.dispatchMouseEvent", type=kind, x=x, y=330, button="left", buttons=1, clickCount=1)
    assert differ(shown(browser), by_speed) > 500
    browser.value("document.getElementById('play').click()")
    before = browser.value("document.getElementById('slider').value")
    browser.value(
        "new Promise(done => { const look = () => document.getElementById('slider').value !== "
        f"{before!r} ? done(1) : requestAnimationFrame(look); look() }})"
    )
    assert not browser.errors


@needs_chromium
def test_the_range_of_colours_is_written_by_the_user(browser, in_space, tmp_path):
    browser.open(view(in_space, "2", ["velocity.z"]).save(tmp_path / "run.html"), READY)
    first, low, high = shown(browser), *map(float, browser.value("['low', 'high'].map(e => element(e).value)"))
    assert differ(first, shown(browser, setting("high", low + 10 * (high - low), "change"))) > 500
    assert differ(first, shown(browser, setting("high", high, "change"))) < 250
    assert differ(first, shown(browser, setting("high", low - 1, "change"))) < 250  # no range: as before


@needs_chromium
@pytest.mark.parametrize("width, scheme", [(1000, "light"), (390, "dark")])
def test_the_page_has_a_scale_axes_and_targets_for_fingers(browser, in_plane, tmp_path, width, scheme):
    """The scale bar is as long as it says; on a phone the panel lies beside the picture."""
    browser.size(width, 700)
    browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
    try:
        browser.open(view(in_plane).save(tmp_path / "run.html"), READY)
        image = shown(browser)
        assert (image[-1, -1].mean() > 128) == (scheme == "light")
        assert (
            browser.value("""[...document.querySelectorAll('button, select, input, summary')].map(one =>
            one.getBoundingClientRect()).filter(box => box.width && Math.min(box.width, box.height) < 24).length""")
            == 0
        )
        bottom, top = browser.value("['picture', 'panel'].map((e, k) =>"
                                    " element(e).getBoundingClientRect()[k ? 'top' : 'bottom'])")  # fmt: skip
        assert (top >= bottom) == (width == 390)
        words = browser.value("[...document.querySelectorAll('#measures text')].map(one => one.textContent)")
        assert words[:2] == ["x", "y"]
        metres = float(words[2].split()[0]) / {"m": 1, "cm": 100, "mm": 1000}[words[2].split()[1]]
        length = browser.value("document.querySelector('#measures line:last-of-type').getBoundingClientRect().width")
        tank = np.abs(image[: int(bottom) - 60] - image[5, 5]).max(2) > 40
        walls = np.flatnonzero(tank.sum(0) > 100)  # the tank, 0.4 m wide
        assert (np.ptp(walls) / 0.4) == pytest.approx(length / metres, rel=0.03)
    finally:
        browser.size(900, 700)
        browser.call("Emulation.setEmulatedMedia", features=[])


@needs_chromium
def test_a_damaged_page_says_so(browser, in_plane, tmp_path):
    page = tmp_path / "run.html"
    page.write_text(view(in_plane).html.replace('<script id="places" type="text/plain">', '<script id="places">//'))
    browser.open(page, "document.body && /cannot be shown/.test(document.body.innerText)")
    assert browser.errors
    browser.errors.clear()
