"""The site: built without a network and without a warning, which Sphinx gives for links, pictures and lost pages."""

import importlib.util
import os
import pathlib
import re
import subprocess
import sys
import time

import pytest

from tests.render.browser import Browser, chromium
from tests.running import rows
from validation.drawing import COLUMN

ROOT = pathlib.Path(__file__).parents[2]
NEEDED = ("sphinx", "myst_parser", "furo", "sphinx-mathjax-offline")
MISSING = [name for name in NEEDED if importlib.util.find_spec(name) is None]
pytestmark = [
    pytest.mark.slow, pytest.mark.skipif(bool(MISSING), reason=f"{', '.join(MISSING)} (extra [docs]) is not installed"),
]  # fmt: skip
NO_NETWORK = dict.fromkeys(("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY"), "http://127.0.0.1:9")
PICTURES, BROKEN_CODE, CONTRAST = (  # programs for a page
    pathlib.Path(__file__).with_name(f"{name}.js").read_text() for name in ("pictures", "broken_code", "contrast")
)
WIDTHS = (1280, 390)
MOVED = re.compile(r'http-equiv="refresh" content="0; url=([^"]*)"')
NO_SCRIPT = re.compile("<noscript>.*?</noscript>", re.DOTALL)


FIRST = rows(__file__, "first_found")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The built site; a warning stops the building."""
    folder = tmp_path_factory.mktemp("site")
    words = [sys.executable, "-m", "sphinx", "-W", "-q", "-d", str(folder / "trees"), "-b", "html"]
    done = subprocess.run(
        [*words, "docs", str(folder / "html")], cwd=ROOT, env=os.environ | NO_NETWORK, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return folder / "html"


@pytest.fixture(params=WIDTHS)
def browser(request, tmp_path):
    """Chromium of a width [pixels]."""
    if chromium() is None:
        pytest.skip("Chromium is not installed")
    made = Browser(tmp_path, request.param, 900)
    made.width = request.param
    yield made
    made.close()


wide = pytest.mark.parametrize("browser", WIDTHS[:1], indirect=True)
narrow = pytest.mark.parametrize("browser", WIDTHS[1:], indirect=True)


def test_pages_fit_the_width_and_formulas_are_typeset(site, browser):
    width = browser.width
    for page in ("index", "gallery", "results", "api"):
        browser.open(site / f"{page}.html")
        assert browser.value("document.documentElement.scrollWidth") <= width
        assert browser.value("[...document.images].filter(i => i.complete && !i.naturalWidth).length") == 0
    browser.open(site / "sph_by_hand.html", "document.querySelectorAll('mjx-container').length > 0")
    assert browser.value("document.querySelectorAll('mjx-container merror, mjx-merror').length") == 0
    for page in (site / "lessons").glob("*_in_the_browser.html"):
        browser.open(page, "document.querySelectorAll('.live svg, .live form').length >= 3")
    assert not browser.errors


def test_pictures_fill_their_column_and_words_of_code_stay_whole(site, browser):
    """On every page; up to the picture's own width, with its own shape. Tables scroll in their box.

    A picture that is no scene alone is at least as wide as where `enlarge_words` makes its words legible: at 1,280
    pixels the column is, and on a phone the picture scrolls.
    """
    texts = {page: NO_SCRIPT.sub("", page.read_text()) for page in sorted(site.rglob("*.html"))}
    wrong, seen, width = [], 0, browser.width
    for page in (page for page, text in texts.items() if not MOVED.search(text)):
        browser.open(page)
        for file, own, own_height, available, shown, height, in_card in browser.value(PICTURES):
            seen += 1
            least = 0 if in_card else COLUMN
            if abs(shown - min(own, max(available, least))) > 1 or abs(height - shown * own_height / own) > 1:
                wrong.append(f"{page.name}: {file} of {own} pixels has {shown:g} of {available:g}")
        wrong += [f"{page.name}: {word} is broken" for word in browser.value(BROKEN_CODE)]
        if (wide := browser.value("document.documentElement.scrollWidth")) > width:
            wrong.append(f"{page.name} is {wide} pixels wide")
        wrong += [f"{page.name}: {error}" for error in browser.errors]
        browser.errors.clear()
    assert wrong == []
    assert seen == sum(text.count("<img ") for text in texts.values()) > 100


def test_old_addresses_lead_to_a_place_that_there_is(site):
    led = [found for page in site.glob("*.html") if (found := MOVED.search(page.read_text()))]
    assert len(led) >= 3
    for found in led:
        page, _, anchor = found[1].partition("#")
        assert not anchor or f'id="{anchor}"' in (site / page).read_text(), found[1]


@wide
def test_the_page_of_checks_filters_its_rows(site, browser):
    shown = "[...document.querySelectorAll('#checks tr.check')].filter(row => !row.hidden).length"
    choose = "(() => { const form = document.getElementById('filter'); form.elements.%s.value = '%s';"
    browser.open(site / "checks.html")
    counts = [browser.value(shown)]
    for name, value in (("kind", "claim"), ("verdict", "refuted"), ("words", "no such words")):
        browser.value(choose % (name, value) + " form.dispatchEvent(new Event('input')); return 0; })()")
        counts.append(browser.value(shown))
    assert counts[0] > counts[1] > counts[2] > counts[3] == 0


@wide
def test_the_search_has_pages_first_where_a_word_belongs(site, browser):
    first = "(document.querySelector('#search-results li a') || {href: ''}).href"
    for words, page in FIRST.items():
        browser.call("Page.navigate", url=f"{(site / 'search.html').as_uri()}?q={words.replace(' ', '+')}")
        end = time.monotonic() + 30
        while not (found := browser.value(first)) and time.monotonic() < end:
            time.sleep(0.1)
        assert f"/{page}.html" in found, (words, found)


@narrow
def test_each_card_of_the_gallery_leads_to_its_recipe(site, browser):
    """A recipe shows its picture, a scene file and the command that runs it."""
    links = "[...document.querySelectorAll('.gallery.scenes .card a')].map(link => link.href)"
    browser.open(site / "gallery.html")
    found = [link for link in browser.value(links) if "cookbook.html#" in link]
    assert len(found) == len(set(found)) >= 15
    for link in found:
        browser.call("Page.navigate", url=link)
        place = f"document.getElementById({link.partition('#')[2]!r})"
        end = time.monotonic() + 30
        while not browser.value(f"document.readyState === 'complete' && {place} !== null"):
            assert time.monotonic() < end, link
            time.sleep(0.05)
        recipe = f"{place}.closest('section')"
        assert browser.value(f"Math.min(...['img', 'pre'].map(kind => {recipe}.querySelectorAll(kind).length))") > 0
        assert "refsim run" in browser.value(f"{recipe}.textContent"), link


@wide
def test_words_of_verdicts_are_legible_on_light_and_dark_pages(site, browser):
    for scheme in ("light", "dark"):
        browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        browser.open(site / "checks.html")
        assert min(browser.value(CONTRAST)) >= 4.5, scheme
        assert 21 not in browser.value(CONTRAST)[:1]
