"""The pages agree with the code: links, code references, examples, and everything that is registered is explained."""

import ast
import contextlib
import functools
import importlib.util
import io
import pathlib
import re
import tomllib

import msgspec
import pytest
from sybil import Sybil
from sybil.parsers.markdown import CodeBlockParser

import refsim
import refsim.commands
from refsim.__main__ import make_parser
from refsim.core.effect import EFFECTS
from refsim.scene.files import parse_scene
from refsim.scene.plan import make_plan
from refsim.sweep import Sweep
from validation.__main__ import every_picture
from validation.__main__ import parser as validation_parser
from validation.drawing import LARGEST_PICTURE
from validation.experiment import discover

ROOT = pathlib.Path(__file__).parents[2]
spec = importlib.util.spec_from_file_location("site_pages", ROOT / "docs" / "site_pages.py")
site_pages = importlib.util.module_from_spec(spec)
spec.loader.exec_module(site_pages)
DOCS = sorted((ROOT / "docs").rglob("*.md"))
PAGES = [*DOCS, *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md"))]
NO_EFFECT = (
    "index.md", "guarantees.md", "scene_files.md", "accuracy_cost.md", "contract.md", "results.md", "effects_cost.md",
    "study.md", "api.md", "gallery.md", "changelog.md", "contributing.md", "solutions.md", "lessons.md", "sweep.md",
    "public_names.md", "refuted.md", "sph_by_hand.md", "mpm_by_hand.md",
)  # fmt: skip
EFFECT_PAGES = [p for p in DOCS if p.name not in NO_EFFECT and p.parent.name != "lessons"]
PUBLISHED = {name: effect for name, effect in EFFECTS.items() if effect.__module__.startswith("refsim.")}

BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s#]+)[^)\s]*\)")
PLACE = re.compile(r"\b([\w/.-]+\.py):(\w+)")
LARGEST_FOLDER = 12_000_000  # bytes of all pictures and their data
PATH = re.compile(r"`((?:refsim|tests|validation|scripts|docs|figures)/[\w/.-]*)`")
DOTTED = re.compile(r"\brefsim((?:\.\w+)+)")
STEMS = (ROOT, ROOT / "refsim", ROOT / "tests")

pages = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
ERRATA = ROOT / "docs" / "errata.md"
SWITCH = re.compile(r'`"(\w+)"` on ((?:`\w+`(?:, )?)+)')


def prose(page):
    """The page without its code blocks."""
    return BLOCK.sub("", page.read_text())


@functools.cache
def drawn():
    """Pictures that the commands of `python -m validation` publish."""
    return {picture.file for picture in every_picture().values()}


def broken_links(page, text):
    """Links to files of the repository that are not there; Sphinx looks at those between pages, with their anchors."""
    for target in LINK.findall(text):
        path = (page.parent / target).resolve()
        there = path.exists() or (path.parent == ROOT / "figures" and path.name in drawn())
        if not re.match(r"https?://", target) and not (there and path.is_relative_to(ROOT)):
            yield target


@functools.cache
def defined(path):
    """Functions, classes, methods and module-level names of a source file."""
    tree = ast.parse(path.read_text())
    names = {node.name for node in ast.walk(tree) if isinstance(node, (ast.FunctionDef, ast.ClassDef))}
    for node in tree.body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        names |= {target.id for target in targets if isinstance(target, ast.Name)}
    return names


def broken_references(text):
    for file, name in PLACE.findall(text):
        found = [stem / file for stem in STEMS if (stem / file).exists()]
        if not found or not any(name in defined(path) for path in found):
            yield f"{file}:{name}"
    made_by_runs = (ROOT / ".gitignore").read_text().splitlines()
    for path in PATH.findall(text):
        if not (ROOT / path).exists() and path not in made_by_runs and "NAME" not in path:
            yield path
    for dotted in DOTTED.findall(text):
        if not resolves(dotted[1:].split(".")):
            yield f"refsim{dotted}"


def resolves(names):
    found, place = refsim, "refsim"
    for name in names:
        place = f"{place}.{name}"
        if not hasattr(found, name):
            try:
                importlib.import_module(place)
            except ImportError:
                return False
        found = getattr(found, name)
    return True


@pages
def test_links_lead_somewhere(page):
    assert not list(broken_links(page, prose(page)))


@pages
def test_references_into_the_code_exist(page):
    text = prose(page)
    if page.name == "CONTRIBUTING.md":  # adds a method that is not there; test_contributing looks after it
        text = re.sub(r"`?refsim[./]velocity_smoothing\S*", "", text)
    assert not list(broken_references(text))


# Nothing that can be switched on goes unexplained


def words(paths):
    return "\n".join(path.read_text() for path in paths)


def switchable(effect):
    """Errata that the effect takes in `literal`."""
    return getattr(effect, "errata", ())


def entries():
    """The rows of the errata, without their heads: number, kind, place, printed, adopted, consequence, switch."""
    rows = [line for line in ERRATA.read_text().splitlines() if re.match(r"\| [A-Z]\d+", line)]
    return [[cell.strip() for cell in row.strip("|").split(" | ")] for row in rows]


@pytest.mark.parametrize("name", [n for n, effect in PUBLISHED.items() if "literal" in effect.__struct_fields__])
def test_printed_readings_are_explained(name):
    """Each that an effect accepts stands in a table row of a page with the effect; numbered ones among the errata."""
    errata = switchable(PUBLISHED[name])
    assert errata or PUBLISHED[name].paper
    text = words(EFFECT_PAGES)
    for erratum in errata:
        rows = [row for row in text.splitlines() if row.startswith("|") and f'`"{erratum}"` on' in row]
        assert any(f"`{name}`" in row for row in rows), f"no row says what {erratum} on {name} does"
        if re.fullmatch(r"[EM]\d+", erratum):
            here = [row for row in entries() if row[0] == erratum and f"`{name}`" in row[-1]]
            assert len(here) == 1, f"{erratum} on {name} has {len(here)} entries in docs/errata.md"
            assert len(here[0]) == 7
            assert all(here[0])


def test_what_the_errata_call_switchable_is():
    told = {(erratum, name) for row in entries() for erratum, names in SWITCH.findall(row[-1])
            for name in re.findall(r"\w+", names)}  # fmt: skip
    numbered = re.compile(r"[EMP]\d+")
    assert told == {
        (e, name) for name, effect in PUBLISHED.items() for e in switchable(effect) if numbered.fullmatch(e)
    }


# Examples work


def planned(example):
    """Evaluator of Sybil: a scene, or the effects of one, becomes a plan; a sweep has a grid."""
    text = example.parsed
    if "observable" in tomllib.loads(text):
        assert msgspec.convert(tomllib.loads(text), Sweep).grid
        return
    if "spacing" not in text:  # effects alone
        text = 'spacing = 0.1\nsupport_radius = 0.26\n[[fluid]]\nshape = "box"\ncells = [4, 4, 4]\n' + text
    assert make_plan(parse_scene(text, example.path)).grid.count > 0


def performed(example):
    """Evaluator of Sybil: a program runs as it stands, after those before it; a long run ends after a few steps.

    What a line prints is what the comment behind it gives.
    """
    text = re.sub(r"(\w+)\.time < [\d.]+", r"\1.steps < 5", example.parsed)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(text, "<a page>", "exec"), example.namespace)
    given = [line for comment in re.findall(r"# gives (.*)", text) for line in comment.split(", then ")]
    assert not given or printed.getvalue().splitlines() == given


EXAMPLES = Sybil([CodeBlockParser("toml", planned), CodeBlockParser("python", performed)], path=str(ROOT))


@pytest.mark.parametrize("page", [p for p in PAGES if "```toml" in p.read_text() or "```python" in p.read_text()],
                         ids=lambda page: page.name)  # fmt: skip
def test_examples_on_the_pages_work(page, tmp_path, monkeypatch):
    if page.name == "CONTRIBUTING.md":
        pytest.skip("test_contributing.py cuts its files out")
    monkeypatch.chdir(tmp_path)
    for example in EXAMPLES.parse(page):
        example.evaluate()


def commands(text):
    """Words of every command line in code, but for those that only stand for one (capitals, brackets, dots)."""
    fenced = [line for name, block in BLOCK.findall(text) if name == "sh" for line in block.splitlines()]
    for line in [*fenced, *re.findall(r"`([^`\n]+)`", BLOCK.sub("", text))]:
        for command in re.split(r"&&|;|\||>", line.partition("#")[0]):
            words = command.split()
            ours = words[:1] == ["refsim"] or (words[:2] == ["python", "-m"] and words[2].startswith("validation"))
            if ours and not re.search(r"[\[\]]|\.\.\.|(?<!\S)[A-Z]+(?!\S)", command):
                yield words


def understood(words):
    """Whether the command's own parser takes the line; scenes, programs and files need not be there."""
    if words[0] == "refsim":
        refsim.commands.discover()
        if len(words) > 1 and not words[1].startswith("-") and words[1] not in refsim.commands.COMMANDS:
            return False
        needed = {"run": ["--quiet"], "plan": ["scene"], "sample": ["mesh", "--radius", "1"], "contract": ["cpu"]}
        needed |= {"study": ["scene", "--observable", "front"], "view": ["run"]}
        alone = needed.get(words[1], []) if len(words) == 2 else []
        parser, arguments = make_parser(), [*words[1:], *alone]
    else:
        parser, arguments = validation_parser(), words[3:]
    if arguments == [] and words[2:] == ["validation"]:
        return True  # the whole of its commands
    try:
        given = parser.parse_args(arguments)
    except (SystemExit, refsim.InputError):
        return False
    if words[2:4] == ["validation", "run"]:
        return set(given.names) <= set(discover())
    return words[0] == "refsim" or words[2] == "validation"


@pages
def test_commands_on_the_pages_are_understood(page):
    assert [" ".join(words) for words in commands(page.read_text()) if not understood(words)] == []


def missing_files(text):
    """Files below a folder of the repository that a command line names and that are not there."""
    folders = {path.name for path in ROOT.iterdir() if path.is_dir()}
    named = {word.partition(":")[0] for words in commands(text) for word in words}
    return sorted(name for name in named if name.split("/")[0] in folders and not (ROOT / name).exists())


@pages
def test_files_of_the_repository_in_commands_are_there(page):
    assert missing_files(page.read_text()) == []


def test_the_version_is_one():
    version = refsim.__version__
    assert f"version = {version}\n" in (ROOT / "setup.cfg").read_text()
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    assert re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)[1] == version


def test_figures_stay_light():
    """Plots are PNG with a palette, shaded pictures WebP, diagrams SVG; long data is compressed."""
    files = [path for path in (ROOT / "figures").rglob("*") if path.is_file() and "quick" not in path.parts]
    sizes = {path.relative_to(ROOT).as_posix(): path.stat().st_size for path in files}
    pictures = {name: size for name, size in sizes.items() if not name.endswith((".json", ".json.gz"))}
    assert {pathlib.Path(name).suffix for name in pictures} == {".png", ".webp", ".svg"}
    assert not {name: size for name, size in pictures.items() if size > LARGEST_PICTURE}
    assert sum(sizes.values()) <= LARGEST_FOLDER
