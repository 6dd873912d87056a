"""`refsim reproduce`: the papers' experiments, which are in the repository and not in the installed package."""

import argparse
import json
import subprocess
import sys
from pathlib import Path

from refsim.commands import CommandResult, command, takes
from refsim.core.errors import InputError
from refsim.core.versions import VERSION

SCRIPT = Path("scripts") / "reproduce.py"
DESCRIPTION = (
    f"Run {SCRIPT.as_posix()} of the repository: the papers' experiments, their verdicts and pictures. It is looked for"
    " beside the package and in the current folder; started by itself, it has further options."
)


def repository() -> Path | None:
    """Folder of the repository: the one of this package, else the current one; None if neither is."""
    for folder in (Path(__file__).resolve().parents[2], Path.cwd()):
        if (folder / SCRIPT).is_file() and (folder / "validation").is_dir():
            return folder
    return None


@command("reproduce", "run the papers' experiments (in the repository)", DESCRIPTION)
@takes("--quick", action="store_true", help="the main job: small sizes, minutes in all", group="size")
@takes("--full", action="store_true", help="the published sizes, hours in all (the default)", group="size")
def execute(options: argparse.Namespace) -> CommandResult:
    """Run the script; its exit code. Raises InputError where there is no repository."""
    folder = repository()
    if folder is None:
        raise InputError(
            "reproduce needs the repository, which the installed package does not contain; unpack the source"
            f" distribution refsim-{VERSION}.tar.gz and run `python {SCRIPT.as_posix()} --quick` in its folder."
        )
    chosen = [f"--{name}" for name in ("quick", "full", "json") if getattr(options, name)]
    done = subprocess.run(
        [sys.executable, str(folder / SCRIPT), *chosen], stdout=subprocess.PIPE if options.json else None, text=True
    )
    return CommandResult(json.loads(done.stdout) if options.json and done.stdout else {}, "", done.returncode)
