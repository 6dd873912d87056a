"""`refsim advise`: the cheapest setting for an error of a panel's observable."""

import argparse
from pathlib import Path

from refsim.commands import CommandResult, command, table, takes, write_new
from refsim.core.errors import InputError
from refsim.study import advice
from refsim.study.panels import abouts

DESCRIPTION = """The cheapest measured setting for a relative error of an observable, and what it took; the setting's
scene is written where it has one (refsim plan SCENE --time: what it takes here). Without an observable, list them. For
another scene: refsim study."""


@command("advise", "the cheapest setting for an accuracy", DESCRIPTION)
@takes("observable", nargs="?", help="one of the panels; none lists them")
@takes("--error", type=float, default=0.01, metavar="E", help="relative error to reach (0.01)")
@takes("--seconds", type=float, metavar="S", help="instead: the least error within so many measured seconds")
@takes("--gpu", action="store_true", help="the setting for a GPU")
@takes("--output", metavar="FILE", help="where the scene is written (OBSERVABLE.toml)")
@takes("--overwrite", action="store_true", help="replace a file that is there")
def execute(options: argparse.Namespace) -> CommandResult:
    """Advise on an observable, or list what there is."""
    if options.observable is None:
        listed = {name: about.words for name, about in abouts().items()}
        return CommandResult({"observables": listed}, table(list(listed.items()), ("observable", "")))
    kind = "gpu" if options.gpu else "cpu"
    if options.seconds is None:
        found = advice.find(options.observable, options.error, kind)
    else:
        found = advice.within(options.observable, options.seconds, kind)
    path = Path(options.output or f"{options.observable}.toml")
    if options.output and not found.toml:
        raise InputError(f"advise: this setting of {options.observable} has no scene; leave --output out.")
    if found.toml:
        write_new({path: found.toml.encode()}, "file (--output)", options.overwrite, "scene", "nothing was written")
    text, data = advice.text_of(found), advice.data_of(found)
    if found.toml:
        data["scene"] = str(path)
        backend = " --backend cuda" if options.gpu else ""
        text += f"\nwrote {path}\n{_measures(found, path)}{backend}"
    return CommandResult(data, text)


def _measures(found: advice.Advice, path: Path) -> str:
    """The command that gives the value."""
    name, choice = found.panel.name, found.choice
    if found.panel.about.reaches is None or choice is None or choice.named is None:
        return f"refsim run {path} --observable panel:{name}"
    return f"refsim study {name} --points {choice.named.point.key}"
