"""`refsim advise`: the cheapest setting for an error of a panel's observable."""

import argparse
import math
from pathlib import Path

from refsim.commands import CommandResult, command, table, takes, write_new
from refsim.core.checked import suggestion
from refsim.core.errors import InputError
from refsim.scene.files import scene_to_toml
from refsim.study import advice
from refsim.study.panels import abouts, panel
from refsim.study.panels.scenes import scene_of

DESCRIPTION = """The cheapest measured setting for a relative error of an observable, and what it took; its scene is
written, and the command that gives the value is printed (refsim plan SCENE --time: what it takes here). Without an
observable, list them. For another scene: refsim study."""


@command("advise", "the cheapest setting for an accuracy", DESCRIPTION)
@takes("observable", nargs="?", help="one of the panels; none lists them")
@takes("--error", type=float, default=0.01, metavar="E", help="relative error to reach (0.01)")
@takes("--seconds", type=float, metavar="S", help="instead: the least error within so many measured seconds")
@takes("--gpu", action="store_true", help="the setting for a GPU")
@takes("--output", metavar="FILE", help="where the scene is written (OBSERVABLE.toml)")
@takes("--overwrite", action="store_true", help="replace a file that is there")
def execute(options: argparse.Namespace) -> CommandResult:
    """Advise on an observable, or list what there is."""
    name, error, kind = options.observable, options.error, "gpu" if options.gpu else "cpu"
    if name is None:
        listed = {each: about.words for each, about in abouts().items()}
        return CommandResult({"observables": listed}, table(list(listed.items()), ("observable", "")))
    if name not in abouts():
        raise InputError(f"advise: there is no observable {name!r}; {suggestion(name, abouts())}")
    if not 0 < error < 1:
        raise InputError(f"advise: an error of {error:g} is not possible; give a share between 0 and 1, 0.01 for 1 %.")
    if options.seconds is not None and not 0 < options.seconds < math.inf:
        raise InputError(f"advise: {options.seconds:g} seconds are not possible; give a positive number.")
    of = panel(name)
    if options.seconds is None:
        advised = advice.cheapest(of, error, kind)
    else:
        advised = advice.least(of, kind, options.seconds)
        if advised is None:
            raise InputError(f"advise: no measured setting of {name} takes {options.seconds:g} s or less; give more.")
        error = advised[0]
    text, data = advice.text_of(of, error, kind, advised), advice.data_of(of, error, kind, advised)
    if advised is None:
        return CommandResult(data, text)
    point, path = advised[1], Path(options.output or f"{name}.toml")
    scene = scene_to_toml(scene_of(of, point, 0))
    write_new({path: scene.encode()}, "file (--output)", options.overwrite, "scene", "nothing was written")
    value = f"refsim run {path} --observable panel:{name}" + " --backend cuda" * options.gpu
    if of.about.reaches is not None:
        value = f"refsim study {name} --points {point.key}" + " --backend cuda" * options.gpu
    return CommandResult(data | {"scene": str(path), "command": value}, f"{text}\nwrote {path}\n{value}")
