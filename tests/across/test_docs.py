"""The pages agree with the code: links, examples, commands, and everything that is registered is explained."""

import configparser
import contextlib
import functools
import io
import itertools
import json
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
from scripts.page_numbers import WRITTEN, counted
from scripts.page_numbers import pages as numbered_pages
from validation.__main__ import every_picture, options_of
from validation.__main__ import parser as validation_parser
from validation.drawing import LARGEST_PICTURE
from validation.experiment import discover
from validation.judging import parts

ROOT = pathlib.Path(__file__).parents[2]
DOCS = sorted((ROOT / "docs").rglob("*.md"))
PAGES = [*DOCS, *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md"))]
PUBLISHED = {name: effect for name, effect in EFFECTS.items() if effect.__module__.startswith("refsim.")}

BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s#]+)[^)\s]*\)")
LARGEST_FOLDER = 12_000_000  # bytes of all pictures and their data
pages = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
PAPERS = sorted((ROOT / "docs").glob("paper_*.md"))
QUESTIONS = tomllib.loads((pathlib.Path(__file__).parent / "questions.toml").read_text(encoding="utf-8"))
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


@pages
def test_links_lead_somewhere(page):
    assert not list(broken_links(page, prose(page)))


# Nothing that can be switched on goes unexplained
def words(paths):
    return "\n".join(path.read_text() for path in paths)


def switchable(effect):
    """Errata that the effect takes in `literal`."""
    return getattr(effect, "errata", ())


def entries():
    """The rows of the errata, without their heads: number, kind, place, printed, adopted, consequence, switch."""
    rows = [line for line in words(PAPERS).splitlines() if re.match(r"\| [A-Z]\d+", line)]
    return [[cell.strip() for cell in row.strip("|").split(" | ")] for row in rows]


@pytest.mark.parametrize("name", [n for n, effect in PUBLISHED.items() if "literal" in effect.__struct_fields__])
def test_printed_readings_are_explained(name):
    """Each that an effect accepts stands in a table row of a page with the effect; numbered ones among the errata."""
    errata = switchable(PUBLISHED[name])
    assert errata or PUBLISHED[name].paper
    text = words(DOCS)
    for erratum in errata:
        rows = [row for row in text.splitlines() if row.startswith("|") and f'`"{erratum}"` on' in row]
        assert any(f"`{name}`" in row for row in rows), f"no row says what {erratum} on {name} does"
        if re.fullmatch(r"[EM]\d+", erratum):
            here = [row for row in entries() if row[0] == erratum and f"`{name}`" in row[-1]]
            assert len(here) == 1, f"{erratum} on {name} has {len(here)} entries on docs/paper_*.md"
            assert len(here[0]) == 7
            assert all(here[0])


def test_what_literal_paper_takes_is_a_choice_or_a_gap_and_no_misprint():
    kinds = {(row[0], name): row[1] for row in entries() for names in re.findall(SWITCH, row[-1])
             for name in re.findall(r"\w+", names[1])}  # fmt: skip
    assert set(kinds.values()) == {"misprint", "gap", "own choice"}
    for name, effect in PUBLISHED.items():
        taken = {(erratum, name) for erratum in getattr(effect, "improvements", ())} & set(kinds)
        assert {kinds[each] for each in taken} <= {"own choice", "gap"}, name
        left = {each for each in kinds if each[1] == name} - taken
        assert {kinds[each] for each in left} <= {"misprint", "gap"}, name


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


EXAMPLE_PAGES = [  # first_scene.md grows one file by all its blocks: test_cookbook.py
    page for page in PAGES if re.search("```(toml|python)", page.read_text()) and page.name != "first_scene.md"
]


@pytest.mark.parametrize("page", EXAMPLE_PAGES, ids=lambda page: page.name)
def test_examples_on_the_pages_work(page, tmp_path, monkeypatch):
    if page.name == "CONTRIBUTING.md":
        pytest.skip("test_contributing.py cuts its files out")
    monkeypatch.chdir(tmp_path)
    for example in EXAMPLES.parse(page):
        example.evaluate()


def commands(text):
    """Words of every command line in code, but for those that only stand for one (capitals, brackets, dots)."""
    fenced = [line for name, block in BLOCK.findall(text) if name == "sh" for line in block.splitlines()]
    for line in [*fenced, *re.findall(r"`([^`]+)`", BLOCK.sub("", text))]:
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
        needed = {"run": ["--quiet"], "plan": ["scene"], "contract": ["cpu"]}
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
    if words[0] != "refsim" and words[3] in ("check", "claims", "stability"):
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(ROOT)
            return bool(parts(given.names, given.kind, options_of(given)))
    return words[0] == "refsim" or words[2] == "validation"


@pages
def test_commands_on_the_pages_are_understood(page):
    assert [" ".join(words) for words in commands(page.read_text()) if not understood(words)] == []


@pages
def test_tests_and_scripts_that_a_page_names_are_there(page):
    text = " ".join(prose(page).split())
    named = re.findall(r"`(?:(?:pytest|python) )?((?:tests|scripts)/[\w/.]+)(?::(\w+))?", text)
    assert [name for name, _ in named if not (ROOT / name).exists()] == []
    inside = [(file, name) for file, name in named if name]
    assert [each for each in inside if not re.search(rf"\b{each[1]}\b", (ROOT / each[0]).read_text())] == []


def test_the_numbers_on_the_pages_have_commands():
    """`python scripts/page_numbers.py --without` shows those that have none."""
    found = [counted(page.read_text(), page.relative_to(ROOT).as_posix() in WRITTEN) for page in numbered_pages()]
    assert sum(having for _, having, _ in found) >= 0.95 * sum(every for every, _, _ in found)


def test_version_and_requirements_are_one():
    version = refsim.__version__
    assert f"version = {version}\n" in (ROOT / "setup.cfg").read_text()
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    described = json.loads((ROOT / "codemeta.json").read_text())
    assert described["version"] == version
    settings = configparser.ConfigParser(interpolation=None)
    settings.read(ROOT / "setup.cfg")
    required = settings["options"]["install_requires"].split()
    assert described["softwareRequirements"] == [re.match(r"[\w-]+", words)[0] for words in required]
    assert re.search(r"^## (\d\S+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)[1] == version


def test_figures_stay_light():
    """Plots are PNG with a palette, shaded pictures WebP, diagrams SVG; long data is compressed."""
    files = [path for path in (ROOT / "figures").rglob("*") if path.is_file() and "quick" not in path.parts]
    sizes = {path.relative_to(ROOT).as_posix(): path.stat().st_size for path in files}
    pictures = {name: size for name, size in sizes.items() if not name.endswith((".json", ".json.gz"))}
    assert {pathlib.Path(name).suffix for name in pictures} == {".png", ".webp", ".svg"}
    assert not {name: size for name, size in pictures.items() if size > LARGEST_PICTURE}
    assert sum(sizes.values()) <= LARGEST_FOLDER


def test_the_night_on_a_server_runs_sessions_that_there_are():
    night = (ROOT / ".github" / "workflows" / "nightly.yml").read_text(encoding="utf-8")
    sessions = (ROOT / "noxfile.py").read_text(encoding="utf-8")
    tasks, environments = (row.split(", ") for row in re.findall(r"session: \[(.*)\]", night))
    assert set(tasks) <= set(re.findall(r'^    "(\w+)": \(', sessions, re.M))
    named = {name.partition("-")[0] for name in environments}
    assert named == {"environments", "lowest", "newest"} <= set(re.findall(r"^def (\w+)\(session", sessions, re.M))


def repeated(texts, length=30):
    """Runs of so many words, without code and tables, that two of the texts have: {run: names}."""
    found = {}
    for name, text in texts.items():
        own = re.findall(r"[\w.%]+", re.sub(r"^\|.*$|\$[^$]*\$", "", BLOCK.sub("", text), flags=re.MULTILINE))
        for k in range(len(own) - length + 1):
            found.setdefault(tuple(own[k : k + length]), set()).add(name)
    return {run: names for run, names in found.items() if len(names) > 1}


def test_no_page_repeats_another():
    part = " ".join(f"word{k}" for k in range(30))
    assert len(repeated({"a": f"One. {part}", "b": f"{part} Two.", "c": part.replace("word9", "other")})) == 1
    assert repeated({page.name: page.read_text() for page in (ROOT / "docs").glob("*.md")}) == {}


MACHINES = re.compile(r"\b(?:H100|H200|EPYC|Xeon)\b")


def mixed_columns(text):
    """Columns of tables whose cells name more than one machine beside times."""
    for rows in re.findall(r"(?:^\|.*\|\n)+", text, re.MULTILINE):
        cells = [[cell.strip() for cell in row.strip("|\n").split("|")] for row in rows.splitlines()]
        for column in itertools.zip_longest(*cells[2:], fillvalue=""):
            timed = [cell for cell in column if re.search(r"\d (?:s|ms|us|ns)\b", cell)]
            if len({name for cell in timed for name in MACHINES.findall(cell)}) > 1:
                yield column


@pages
def test_no_column_of_a_table_has_the_seconds_of_two_machines(page):
    """`test_accuracy.py` holds the tables of stored settings to it, whose records have the machine."""
    assert list(mixed_columns("| a | b |\n| --- | --- |\n| x | 3 ms (H100) |\n| y | 2 ms (H200) |\n"))
    assert list(mixed_columns(page.read_text())) == []


@pytest.mark.parametrize("page", QUESTIONS)
def test_questions_on_a_tutorial_are_answered_on_its_page_and_not_by_the_question(page):
    """The words with the answer stand on the page; the question gives neither the answer nor four words of them."""
    text = " ".join((ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8").split())
    asked = QUESTIONS[page]["questions"]
    assert len({question for question, _, _ in asked}) == 10
    for question, key, words in asked:
        assert " ".join(words.split()) in text, words
        parts = words.lower().split()
        named = [" ".join(parts[k : k + 4]) for k in range(max(1, len(parts) - 3))]
        assert not any(part in question.lower() for part in (key.lower(), *named)), question
