"""`refsim study`: what accuracy costs in a scene, and what each of its effects costs."""

import argparse
import math
from pathlib import Path

from refsim import study
from refsim.commands import CommandResult, command, kept_in, results_folder, takes
from refsim.core.checked import suggestion
from refsim.core.errors import InputError
from refsim.core.terminal import say
from refsim.core.writing import write_file, writing
from refsim.scene.refine import RATIO
from refsim.scene.scene import Scene
from refsim.scene.shapes import Cloud
from refsim.study import KNOBS
from refsim.study.convergence import Reference
from refsim.study.panels import Panel, abouts, panel
from refsim.study.panels import measured as measuring
from refsim.study.panels.scenes import packaged

DESCRIPTION = """Run a scene at several spacings, and with every other setting changed alone, and say how accurate the
observable is, where its error comes from, and which setting is the cheapest for an error. Each run's result is kept in
the study's folder, so that the same command goes on where it was stopped. The name of a panel (refsim advise lists
them) stands for its packaged scene and observable; --points measures the panel's settings anew, beside those on
file. Panels whose particles are not a box or a ball, or of one spacing, are measured so without --points."""
FAILED = 3
GIVEN = ("levels", "finer", "ratio", "error", "reaches", "backend", "threads")  # as `study` takes them


@command("study", "say what accuracy costs in a scene", DESCRIPTION)
@takes("scene", help="scene file (TOML), or the name of a panel")
@takes("--observable", metavar="WHAT",
       help="front (front:-y), kinetic_energy, field:NAME@X,Y,Z (or @mean, @max, @min), gauge:NAME, or"
            " FILE.py:function")  # fmt: skip
@takes("--reaches", type=float, metavar="VALUE", help="study the time at which the observable has this value")
@takes("--levels", type=int, default=3, metavar="N", help="number of spacings (3)")
@takes("--finer", type=int, metavar="N", help="how many of them are finer than the scene's (half of them)")
@takes("--ratio", type=float, default=RATIO, help=f"of two spacings, about ({RATIO:g})")
@takes("--knobs", default=",".join(KNOBS), metavar="LIST", help=f"what to change ({','.join(KNOBS)})")
@takes("--error", type=float, default=0.01, metavar="E", help="relative error to reach (0.01)")
@takes("--with-spacing", default="", metavar="LIST", help="parameters in proportion to the spacing, by name")
@takes("--exact", type=float, metavar="VALUE", help="hold the observable against this value")
@takes("--points", nargs="*", metavar="KEY", help="of a panel: measure these settings, all by default")
@takes("--backend", default="cpu", help="cpu, cuda or numpy (cpu)")
@takes("--threads", type=int, default=1, metavar="N", help="CPU threads of a run (1)")
@takes("--output", metavar="DIR", help="folder of the study (NAME_study for NAME.toml)")
@takes("--quiet", action="store_true", help="no progress")
def execute(options: argparse.Namespace) -> CommandResult:
    """Study a scene file or a panel; table and picture are written into the study's folder."""
    scene: Scene | str = options.scene
    reference = None
    if options.scene in abouts() and not Path(options.scene).is_file():
        of = panel(options.scene)
        scene = packaged(of.name)
        spacings = {point.knobs.get("spacing") for point in of.points.values()}
        if options.points is not None or len(spacings) == 1 or any(isinstance(part, Cloud) for part in scene.fluid):
            return _points(options, of)
        options.observable = options.observable or f"panel:{of.name}"
        options.reaches = of.about.reaches if options.reaches is None else options.reaches
        options.with_spacing = options.with_spacing or ",".join(of.about.with_spacing)
        reference = of.reference()
    elif options.points is not None:
        raise InputError(f"study: --points is for panels; {suggestion(options.scene, abouts())}")
    elif not Path(options.scene).exists():
        raise InputError(f"study: there is no file or panel {options.scene!r}; {suggestion(options.scene, abouts())}")
    if options.observable is None:
        raise InputError("study: give what is to be studied: --observable WHAT.")
    if options.exact is not None:
        if not options.exact or not math.isfinite(options.exact):
            raise InputError(f"study: --exact {options.exact:g} is not possible; give a finite number other than 0.")
        reference = Reference(options.exact, abs(options.exact), 0.0, "the exact value")
    folder = results_folder(options.output, options.scene, "study")
    with kept_in(folder):
        given = {name: getattr(options, name) for name in GIVEN}
        for name in ("knobs", "with_spacing"):
            given[name] = [word for word in getattr(options, name).split(",") if word]
        tell = (lambda text: None) if options.quiet else say
        outcome = study(scene, options.observable, reference=reference, folder=folder, say=tell, **given)
    with writing("study", folder, "its runs are kept"):
        folder.mkdir(parents=True, exist_ok=True)
    write_file(folder / "study.txt", outcome.text() + "\n", "study", "its runs are kept")
    write_file(folder / "study.png", outcome.png(), "study", "its runs are kept")
    text = f"{outcome.text()}\n{folder / 'study.txt'}, {folder / 'study.png'}"
    return CommandResult(outcome.data() | {"folder": str(folder)}, text, 0 if outcome.convergence else FAILED)


def _points(options: argparse.Namespace, of: Panel) -> CommandResult:
    """Measure the panel's settings."""
    tell = (lambda text: None) if options.quiet else say
    measured_panel = measuring.measured(of, options.points or (), backend=options.backend, say=tell)
    given = of.reference()
    data = {
        "panel": of.name, "observable": of.about.observed, "reference": given.value, "uncertainty": given.uncertainty,
        "source": given.words, "points": measuring.rows(of, measured_panel),
    }  # fmt: skip
    failed = all(point.failed for point in measured_panel.points.values())
    return CommandResult(data, measuring.text(of, measured_panel), FAILED if failed else 0)
