"""What the site has beside the pages of the repository: navigation, gallery, the pages above `docs/`, and the API."""

import inspect
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
ABOVE = {"CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md", "README.md": "index.md"}
LINK = re.compile(r"(?<!!)\[([^\]]*)\]\(([^)\s]+)\)")
LESSON = re.compile(r"^- \[.*?\]\(lessons/(\w+)\.md\).*$", re.MULTILINE)  # in the list of lessons
IN_THE_BROWSER = "_in_the_browser"  # a lesson that computes itself, by a script of `_static/`
UNIT = re.compile(r"(?<=\d) (?=(?:[munk]?s|[KMG]iB|degrees|d|h|m|mm)\b|%)")
CODE = re.compile(r"^(```.*?^```[^\n]*$)", re.MULTILINE | re.DOTALL)
NAVIGATION = {
    "Begin": (
        "first_scene", "lessons", "cookbook", "which_method", "sph_by_hand", "mpm_by_hand", "scene_files", "results",
        "study", "sweep", "gallery",
    ),
    "Liquids and walls": ("sph", "liquid", "iisph", "walls", "motions", "meshes", "gauges"),
    "Surface tension": ("surface_detection", "jiang_zhu_2023", "dong_2016", "models"),
    "Solids, heat, melting": ("shape_matching", "heat", "melting"),
    "Particles and a grid": ("mpm", "surface_energy"),
    "The five papers": (
        "errata", "paper_jiang_zhu", "paper_dong", "paper_mpm_thesis", "paper_shao_song", "paper_patent",
    ),
    "Evidence": (
        "equations", "checks", "solutions", "laws", "stability",
    ),
    "Contract": ("contract", "vectors"),
    "Contributing": ("contributing", "api", "changelog"),
    "Guarantees": ("guarantees", "public_names"),
}  # fmt: skip

MOVED = {  # pages of old names, and where what they said stands
    "accuracy_cost": "study.html#cheapest-setting-for-an-error", "effects_cost": "study.html#each-effect",
    "claims": "checks.html",
}  # fmt: skip

SEARCHED = {  # words for which the search has a page first, though it says them less often than others
    "first_scene": "!tutorial, !own scene", "scene_files": "!restart, !resume, !units", "guarantees": "!GPU, !CUDA",
    "index": "!install", "results": "!film",
}  # fmt: skip

PAPERS = {  # addresses, for the first mention on a page
    "Jiang & Zhu 2023": "10.3969/j.issn.1003-5060.2023.03.023", "Akinci et al. 2012": "10.1145/2185520.2185558",
    "Dong, Zhang & Chen 2016": "10.11996/JG.j.2095-302X.2016030302",
    "Shao & Song 2017": "10.16182/j.issn1004731x.joss.201703005",
    "Akinci, Akinci & Teschner 2013": "10.1145/2508363.2508395", "Adami, Hu & Adams 2012": "10.1016/j.jcp.2012.05.005",
    "Tartakovsky & Meakin 2005": "10.1103/PhysRevE.72.026301", "Ihmsen et al. 2014": "10.1109/TVCG.2013.105",
    "Sun et al. 2017": "10.1016/j.cma.2016.10.028", "Colagrossi & Landrini 2003": "10.1016/S0021-9991(03)00324-3",
    "Molteni & Colagrossi 2009": "10.1016/j.cpc.2008.12.004", "Morris, Fox & Zhu 1997": "10.1006/jcph.1997.5776",
    "Zhu & Bridson 2005": "10.1145/1073204.1073298", "Lorensen & Cline 1987": "10.1145/37402.37422",
}  # fmt: skip
NAMED = re.compile(
    r"(^[#<].*$|\[[^\]]*\]\([^)]*\)|`[^`]*`|\$[^$]*\$)|\bDOI\s+(10\.\d+/[^\s)]*[^\s).,;])|"
    + "|".join(map(re.escape, PAPERS)), re.MULTILINE,
)  # fmt: skip


def moved(app: Any, failure: Exception | None) -> None:
    """Sphinx's event `build-finished`: a page of an old name leads to its new place."""
    for name, place in MOVED.items() if failure is None and app.builder.format == "html" else ():
        lead = f'<meta http-equiv="refresh" content="0; url={place}">'
        words = f'<!doctype html><title>Moved</title>{lead}<a href="{place}">This page has moved.</a>\n'
        (Path(app.outdir) / f"{name}.html").write_text(words, encoding="utf-8")


def as_on_the_site(app: Any, page: str, source: list[str]) -> None:
    """Sphinx's event `source-read`: the text of a page as the site has it."""
    text = source[0]
    if page in ("contributing", "changelog"):
        text = (ROOT / f"{page.upper()}.md").read_text(encoding="utf-8")
        text = LINK.sub(lambda link: f"[{link[1]}]({_from_docs(link[2])})", text)
        text = text.replace("](figures/", "](../figures/")
    if page == "cookbook":
        from scripts.cookbook import page as recipes

        text = text.replace("<!-- cookbook -->", "\n".join(recipes()))
    if page == "gallery":
        from scripts.cookbook import cards

        text = text.replace("<!-- scenes -->", "\n".join(cards()))
    if page == "checks":
        from validation.page import ROWS, table

        text = text.partition(ROWS)[0] + "\n".join(table())
    if page == "equations":
        from refsim.commands import discover, equations

        discover()
        text = equations.page(site=True)
    if page == "api":
        text = text.replace("<!-- api -->", "\n".join(api()))
    if page.startswith("lessons/") and not page.endswith(IN_THE_BROWSER):
        text = lesson(page.removeprefix("lessons/"), app.config.repository)
    pieces = CODE.split(text)
    named: set[str] = set()
    text = "".join(piece if piece.startswith("```") else _cited(_linked(piece), named) for piece in pieces)
    if page in SEARCHED:
        head, rest = text.split("\n", 1)
        text = f"{head}\n\n```{{index}} {SEARCHED[page]}\n```\n{rest}"
    if page == "index":
        text += "\n".join(navigation())
    if page == "lessons":
        text = lessons_with_binder(text, app.config.repository)
        text += "\n```{toctree}\n:hidden:\n:glob:\n\nlessons/*\n```\n"
    source[0] = text


def _from_docs(target: str) -> str:
    """A link of a page above `docs/`, as a page in it has it."""
    if re.match(r"https?://|#", target):
        return target
    return target.removeprefix("docs/") if target.startswith("docs/") else f"../{target}"


def _linked(text: str) -> str:
    """The text with links to pages above `docs/` on their pages here; links to other files become words."""

    def replaced(link: re.Match[str]) -> str:
        words, target = link[1], link[2]
        path, _, anchor = target.partition("#")
        if path.startswith("../") and path[3:] in ABOVE:
            return f"[{words}]({ABOVE[path[3:]]}{'#' + anchor if anchor else ''})"
        if re.match(r"https?://", path) or (path.endswith(".md") and not path.startswith("../")) or not path:
            return link[0]
        return f"{words} (`{path.removeprefix('../') if path.startswith('../') else 'docs/' + path}`)"

    return LINK.sub(replaced, text)


def _cited(text: str, named: set[str]) -> str:
    """The text with each DOI, and the first mention of each of PAPERS that is not in `named`, as a link."""

    def replaced(found: re.Match[str]) -> str:
        words, doi = found[0], found[2] or PAPERS.get(found[0], "")
        if not doi or doi in named:
            return words
        named.add(doi)
        return f"[{words}](<https://doi.org/{doi}>)"

    return NAMED.sub(replaced, text)


def navigation() -> Iterator[str]:
    """The tables of contents that make the sidebar; a page that NAVIGATION does not name stands in one of its own."""
    named = {re.sub(r".*<(.*)>", r"\1", page) for pages in NAVIGATION.values() for page in pages} | {"index", "package"}
    others = tuple(sorted({path.stem for path in (ROOT / "docs").glob("*.md")} - named))
    for title, pages in (NAVIGATION | ({"Other methods": others} if others else {})).items():
        yield f"\n```{{toctree}}\n:hidden:\n:caption: {title}\n"
        yield from pages
        yield "```"


def lessons_with_binder(text: str, repository: str) -> str:
    """The list of lessons, each with a link by which Binder starts its notebook if the repository has an address."""
    from scripts.release import binder

    def started(line: re.Match[str]) -> str:
        return f"{line[0]} [Start it by Binder]({binder(repository, f'docs/lessons/{line[1]}.ipynb')})"

    return LESSON.sub(started, text) if repository else text


def lesson(name: str, repository: str = "") -> str:
    """A lesson as a page: its text, code and pictures; `scripts/lessons.py --pictures figures/lessons` draws these.

    repository  its address, for the link to Binder
    """
    from refsim.io.exercises import cells, lessons
    from scripts.release import binder

    stored = json.loads((ROOT / "docs" / "lessons" / f"{name}.ipynb").read_text(encoding="utf-8"))
    outputs = iter([cell["outputs"] for cell in stored["cells"] if cell["cell_type"] == "code"][1:])
    parts, drawn = [], 0
    for kind, words in cells(lessons()[name]):
        parts.append(words if kind == "markdown" else f"```python\n{words}```\n")
        for output in next(outputs) if kind != "markdown" else ():
            if not output["text"].startswith("Exercise"):
                parts.append(f"\n```text\n{output['text']}```\n")
        for _ in range(words.count("plt.show()") if kind == "code" else 0):
            drawn += 1
            parts.append(f"\n![What the cell draws](../../figures/lessons/{name}_{drawn}.png)\n")
    live = f"{name.partition('_')[0]}{IN_THE_BROWSER}.md"
    offered = f"{{download}}`Notebook <{name}.ipynb>`"
    if repository:
        offered = f"[Start it by Binder]({binder(repository, f'docs/lessons/{name}.ipynb')}); {offered}"
    if (ROOT / "docs" / "lessons" / live).exists():
        offered = f"[In the browser, without installing]({live}); {offered}"
    parts[0] = parts[0].lstrip().replace("\n\n", f"\n\n{offered}\n\n", 1)
    return re.sub(r"`docs/(\w+)\.md`", r"{doc}`../\1`", "".join(parts))


def api() -> Iterator[str]:
    """Every public name of `refsim`, by kind, and every operation."""
    import refsim
    from refsim.core.operation import REGISTRY

    public = {name: _kind(getattr(refsim, name)) for name in refsim.__all__ if not name.startswith("_")}
    kinds = {"Functions": "autofunction", "Classes": "autoclass", "Errors": "autoexception", "Modules": "automodule"}
    for title, directive in kinds.items():
        names = [name for name, kind in public.items() if kind == directive]
        yield f"\n## {title}\n" if names else ""
        for name in names:
            yield f"```{{eval-rst}}\n.. {directive}:: refsim.{name}\n```\n"
    yield "\n## Operations\n"
    for name, operation in sorted(REGISTRY.items()):
        said = (operation.program("numpy").__doc__ or "").partition("\n")[0]
        yield f"- `{name}`: {operation.paper}, {operation.equation}. {said}"


def _kind(found: Any) -> str:
    if inspect.isclass(found):
        return "autoexception" if issubclass(found, Exception) else "autoclass"
    return "automodule" if inspect.ismodule(found) else "autofunction" if callable(found) else ""


def readable(app: Any, tree: Any) -> None:
    """Sphinx's event `doctree-read`: pictures are links to their files, those of scenes have a class; in tables
    sentences get a width, and a number and its unit stay on one line.
    """
    for node in tree.findall():
        if node.tagname == "image":
            node.setdefault("scale", 100)  # Sphinx links a scaled picture to its file
            node["classes"] += ["scene"] * ("/cookbook/" in node["uri"])
        if node.tagname == "entry" and len(words := node.astext()) > 30 and " " in words:
            node["classes"].append("sentences" if len(words) > 80 else "words")
        if node.tagname == "entry":
            for text in [part for part in node.findall() if part.tagname == "#text"]:
                text.parent.replace(text, type(text)(UNIT.sub("\N{NO-BREAK SPACE}", text)))


def literal_tables(app: Any, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
    """Sphinx's event `autodoc-process-docstring`: tables of arguments keep their columns, formulas their signs."""
    text = "\n".join(lines)
    made: list[str] = []
    for paragraph in re.split(r"\n\s*\n", text.strip()):
        if re.search(r"\S  +\S|^ {2,}\S", paragraph, re.MULTILINE):
            made += [".. code-block:: text", "", *("   " + line for line in paragraph.splitlines()), ""]
        else:
            made += [re.sub(r"([*|_])", r"\\\1", line) if "`" not in line else line for line in paragraph.splitlines()]
            made += [""]
    lines[:] = made


def whole_tables(app: Any, page: str, template: str, context: dict[str, Any], tree: Any) -> None:
    """Sphinx's event `html-page-context`: no column of a scene ends within a table of TOML, long names may end a line
    between two of their parts.
    """

    def marked(found: re.Match[str]) -> str:
        parts = found[2].rstrip("\n").split("\n\n")
        return found[1] + "".join(f'<span class="part">{part}\n\n</span>' for part in parts) + found[3]

    pattern = r'(<div class="highlight-toml[^>]*><div class="highlight"><pre>)(.*?)(</pre>)'
    text = re.sub(pattern, marked, context.get("body", ""), flags=re.DOTALL)
    parts = re.compile(r"(?<=[A-Za-z_][./:])(?=[A-Za-z_])(?!py:)")
    context["body"] = re.sub(
        '(<span class="pre">)([^<]{21,})(</span>)',
        lambda name: name[1] + parts.sub(f"{name[3]}<wbr>{name[1]}", name[2]) + name[3],
        text,
    )
