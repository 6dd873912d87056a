"""`refsim example`: list the examples, and write some of them or the lessons into a folder."""

import argparse
import importlib.resources
import os
from pathlib import Path

from refsim.commands import CommandResult, command, table, takes, write_new
from refsim.core.checked import suggestion
from refsim.core.errors import InputError
from refsim.io.exercises import lessons, notebook, title
from refsim.scene.files import parse_scene

DESCRIPTION = (
    "Without a name, list the examples; with names, write their scene files and what these name, or their programs."
    " With --lessons, write the lessons instead, each as a Jupyter notebook."
)


def packaged(ending: str) -> dict[str, str]:
    """The texts of the examples with this ending, by name."""
    folder = importlib.resources.files("refsim") / "examples"
    files = sorted((path for path in folder.iterdir() if path.name.endswith(ending)), key=str)
    return {path.name.removesuffix(ending): path.read_text(encoding="utf-8") for path in files}


def examples() -> dict[str, str]:
    """The example scenes as TOML, by name."""
    return packaged(".toml")


def files_of(name: str, text: str) -> dict[str, bytes]:
    """The files of an example by name: the scene file first, then those that it names."""
    folder = importlib.resources.files("refsim") / "examples"
    scene = parse_scene(text, name)
    named = (getattr(part, "file", None) for part in (*scene.fluid, *scene.solid, *scene.effects))
    return {f"{name}.toml": text.encode()} | {file: (folder / file).read_bytes() for file in named if file}


@command("example", "list example scenes, or write one, or the lessons", DESCRIPTION)
@takes("names", nargs="*", metavar="NAME", help="examples to write; none lists them")
@takes("--output", default=".", metavar="DIR", help="folder to write into (this one)")
@takes("--lessons", metavar="DIR", help="write the lessons into this folder")
@takes("--overwrite", action="store_true", help="replace files that are there")
def execute(options: argparse.Namespace) -> CommandResult:
    """List the examples, or write some of them or the lessons."""
    known, alone = examples(), packaged(".py")  # scenes, and whole methods with NumPy alone
    if options.lessons is not None:
        if options.names:
            raise InputError("--lessons writes no example scenes; leave out the names, or give the command twice.")
        return _with_lessons(Path(options.lessons), options.overwrite)
    if not options.names:
        return _listed(known, alone)
    wanted: dict[str, bytes] = {}
    for name in options.names:
        if name not in known | alone:
            raise InputError(f"there is no example {name!r}; {suggestion(name, known | alone)}")
        wanted |= files_of(name, known[name]) if name in known else {f"{name}.py": alone[name].encode()}
    paths = _written(wanted, Path(options.output), "--output", options.overwrite)
    commands = {".toml": "refsim run", ".py": "python"}
    lines = [f"wrote {path}" for path in paths]
    lines += [f"{commands[end]} {path}" for path in paths if (end := os.path.splitext(path)[1]) in commands]
    return CommandResult({"files": paths}, "\n".join(lines))


def _with_lessons(folder: Path, overwrite: bool) -> CommandResult:
    texts = lessons()
    wanted = {f"{name}.ipynb": notebook(text).encode() for name, text in texts.items()}
    paths = _written(wanted, folder, "--lessons", overwrite)
    lines = table([(str(folder / f"{name}.ipynb"), title(text)) for name, text in texts.items()])
    return CommandResult({"files": paths}, f"{lines}\n\njupyter lab {paths[0]}")


def _written(wanted: dict[str, bytes], folder: Path, option: str, overwrite: bool) -> list[str]:
    """Write files by name into a folder; their paths."""
    files = {folder / name: content for name, content in wanted.items()}
    return write_new(files, f"folder ({option})", overwrite, "example", "files that were written before are whole")


def _listed(known: dict[str, str], alone: dict[str, str]) -> CommandResult:
    summaries = {name: text.partition("\n")[0].strip('# "') for name, text in (known | alone).items()}
    effects = {name: [effect.name for effect in parse_scene(text, name).effects] for name, text in known.items()}
    entries = [{"name": n, "summary": summary, "effects": effects.get(n, [])} for n, summary in summaries.items()]
    how = (
        f"Write one with: refsim example {next(iter(known))}\nWrite the lessons with: refsim example --lessons lessons"
    )
    return CommandResult({"examples": entries}, f"{table(list(summaries.items()))}\n\n{how}")
