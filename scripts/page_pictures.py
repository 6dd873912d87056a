"""Draw the pictures of pages about use: `python scripts/page_pictures.py [NAME ...]` writes figures/pages/NAME.

They are made of the packaged examples, of the contract's outcomes, and of verdicts and tables on file. Needs
`pip install "refsim[view]"`; takes two minutes on two cores. Exit code: 0, 2 for a name that is no picture.
"""

from __future__ import annotations

import argparse
import collections
import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import refsim  # noqa: E402
from refsim import contract  # noqa: E402
from refsim.__main__ import main as refsim_command  # noqa: E402
from refsim.core import cases  # noqa: E402
from refsim.core.errors import InputError  # noqa: E402
from refsim.core.operation import REGISTRY  # noqa: E402
from validation.drawing import BLUE, GREEN, GREY, ORANGE, SKY, save_picture, style  # noqa: E402
from validation.experiment import chosen  # noqa: E402
from validation.perform import EXIT_FINE  # noqa: E402

FOLDER = ROOT / "figures" / "pages"


def _run(name: str) -> Any:
    """The run of a packaged example, in the current folder; made by the commands of the page where it is not there."""
    folder = Path(f"{name}_run")
    if not folder.exists():
        for words in (("example", name), ("run", f"{name}.toml", "--quiet")):
            code = refsim_command(list(words))
            if code:
                raise SystemExit(code)
    return refsim.open_run(folder)


def styles() -> Any:
    """One frame of liquid on a pebble in the three styles of `refsim render`."""
    import matplotlib.pyplot as plt
    from PIL import Image

    _run("mesh_boundary")
    figure, axes = plt.subplots(1, 3, figsize=(9.6, 3.0))
    for place, name in zip(axes, ("paper", "water", "particles")):
        words = [
            "render",
            "mesh_boundary_run",
            "--frames",
            "45",
            "--style",
            name,
            "--size",
            "480x420",
            "-o",
            f"{name}.png",
        ]
        refsim_command(words)
        place.imshow(Image.open(f"{name}.png"))
        place.set_title(f"--style {name}")
        place.axis("off")
    return figure


def dam_break() -> Any:
    """The dam break of the scene file at four times, coloured by speed."""
    import matplotlib.pyplot as plt

    run = _run("dam_break_2d")
    figure, axes = plt.subplots(1, 4, figsize=(9.6, 2.7), sharey=True)
    for place, time in zip(axes, (0.0, 0.12, 0.25, 0.45)):
        frame = run.at(time)
        speed = np.linalg.norm(frame["velocity"], axis=1)
        dots = place.scatter(*frame.position[:, :2].T, c=speed, s=2.2, cmap="viridis", vmin=0.0, vmax=2.0)
        place.set(aspect="equal", xlim=(0, 0.4), ylim=(0, 0.4), xlabel="x [m]")
        place.set_title(f"{frame.time:.2f} s")
    axes[0].set_ylabel("y [m]")
    figure.colorbar(dots, ax=axes, label="speed [m/s]", shrink=0.85)
    return figure


def height_of_the_centre() -> Any:
    """What the frames of a run give: the height of the centre of mass, and the front, over time."""
    import matplotlib.pyplot as plt

    run = _run("dam_break_2d")
    figure, (left, right) = plt.subplots(1, 2, figsize=(7.6, 2.7))
    left.plot(run.times, [frame.position[:, 1].mean() for frame in run], color=BLUE)
    left.set(xlabel="time [s]", ylabel="height of the centre [m]", title="frame.position[:, 1].mean()")
    right.plot(run.times, [frame.position[:, 0].max() for frame in run], color=ORANGE)
    right.set(xlabel="time [s]", ylabel="front [m]", title="frame.position[:, 0].max()")
    for axes in (left, right):
        axes.grid(True)
    return figure


def sweep_of_tension() -> Any:
    """The sweep of the page at more values: kinetic energy of the droplet over tension, for two spacings."""
    import matplotlib.pyplot as plt

    from refsim.sweep import sweep

    tensions, spacings = (0.03, 0.04, 0.05, 0.06, 0.07), (0.001, 0.0008)
    refsim_command(["example", "droplet"])
    Path("drops.toml").write_text(
        'scene = "droplet.toml"\nobservable = "kinetic_energy"\nbackend = "cpu"\n[grid]\n'
        f'"effects.jiang_zhu_2023.surface_tension" = {list(tensions)}\nspacing = {list(spacings)}\n',
        encoding="utf-8",
    )
    rows = sweep("drops.toml", folder="drops_sweep").rows()
    figure, axes = plt.subplots(figsize=(5.2, 2.9))
    for spacing, color in zip(spacings, (BLUE, ORANGE)):
        values = [row["value"] for row in rows if row["spacing"] == spacing]
        axes.plot(tensions, values, "o-", color=color, label=f"spacing {spacing} m")
    axes.set(xlabel="surface tension [N/m]", ylabel="kinetic energy [J]", title="Ten runs of one scene", yscale="log")
    axes.grid(True)
    axes.legend()
    return figure


def rounding_of_density() -> Any:
    """The contract's outcomes for the CPU's density in single precision: error of each trial over its bound."""
    import matplotlib.pyplot as plt

    cases.discover()
    outcomes = contract.climb(contract.Target(REGISTRY["sph.density"], "cpu", "float32"))
    steps = sorted({outcome.step for outcome in outcomes}, key=lambda step: int(step[1:]))
    figure, axes = plt.subplots(figsize=(6.4, 2.9))
    for k, step in enumerate(steps):
        errors = np.array([outcome.error for outcome in outcomes if outcome.step == step])
        axes.plot(
            np.full(len(errors), k) + np.linspace(-0.28, 0.28, len(errors)), np.maximum(errors, 1e-5), ".", color=BLUE
        )
    axes.axhline(1.0, color=ORANGE)
    axes.text(0.5, 1.1e-5, "exact", color=GREY)
    axes.text(len(steps) - 0.5, 1.3, "bound", color=ORANGE, ha="right")
    axes.set(yscale="log", ylim=(5e-6, 5), xticks=range(len(steps)), xticklabels=steps, xlabel="step")
    axes.set(
        ylabel="error / bound", title=f"sph.density in single precision: {len(outcomes)} trials, all below the bound"
    )
    return figure


SOURCES = {
    "jiang_zhu_2023": "Jiang & Zhu 2023",
    "dong_2016": "Dong, Zhang & Chen 2016",
    "mpm": "thesis: particles and grid",
    "surface_energy": "thesis: surface and tension",
    "heat": "Shao & Song 2017: heat",
    "melting": "Shao & Song 2017: melting",
    "one_way_coupling": "patent CN104318598A",
}
VERDICTS = {"confirmed": GREEN, "mixed": SKY, "refuted": ORANGE, "not testable": GREY}


def verdicts() -> Any:
    """How many claims of each source were confirmed, mixed, refuted, or cannot be tested."""
    import matplotlib.pyplot as plt

    from validation import checks

    found = collections.Counter((claim.system, claim.verdict) for claim in checks.read_all(checks.CLAIM))
    systems = list(SOURCES)[::-1]
    figure, axes = plt.subplots(figsize=(7.6, 0.9 + 0.32 * len(systems)))
    left = np.zeros(len(systems))
    for verdict, color in VERDICTS.items():
        count = np.array([found[system, verdict] for system in systems])
        axes.barh(range(len(systems)), count, left=left, color=color, label=f"{verdict} ({count.sum()})")
        for k in np.flatnonzero(count):
            axes.text(left[k] + count[k] / 2, k, str(count[k]), ha="center", va="center", color="white", fontsize=8)
        left += count
    axes.set(yticks=range(len(systems)), yticklabels=[SOURCES[s] for s in systems], xlabel="claims")
    axes.legend(loc="lower right")
    return figure


def main_job() -> Any:
    """Processor seconds of the main job by system, before and after, from the table of docs/waiting_time.md."""
    import matplotlib.pyplot as plt

    page = (ROOT / "docs" / "waiting_time.md").read_text(encoding="utf-8")
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in page.splitlines() if line.count("|") == 8]
    header, table = rows[0], [row for row in rows[2:] if row[0] != "all"]
    assert header[2:4] == ["running, s", "compiling, s"] == header[5:7]
    figure, panels = plt.subplots(1, 2, figsize=(8.4, 2.8), sharey=True, sharex=True)
    for axes, first, title in zip(panels, (2, 5), ("before", "after")):
        running, compiling = (np.array([float(row[k]) for row in table]) for k in (first, first + 1))
        axes.barh(range(len(table)), running, color=BLUE, label="running")
        axes.barh(range(len(table)), compiling, left=running, color=SKY, label="compiling")
        axes.set_title(f"{title}: {running.sum() + compiling.sum():.0f} s")
        axes.set(yticks=range(len(table)), yticklabels=[row[0] for row in table], xlabel="processor time [s]")
    panels[0].invert_yaxis()
    panels[0].legend(loc="upper right")
    return figure


PALE, FINE, WARM = "#dbe6f1", "#d6efe6", "#fdebc8"
LINE = 2.0  # height of a line of words on a canvas
FRAME = {PALE: BLUE, FINE: GREEN, WARM: ORANGE, "white": GREY}


def _box(axes: Any, place: tuple[float, float], size: tuple[float, float], words: Sequence[str], fill: str) -> None:
    """A box with its lower left corner at `place`, and lines of words in its middle, the first of them bold."""
    from matplotlib.patches import FancyBboxPatch

    axes.add_patch(
        FancyBboxPatch(place, *size, boxstyle="round,pad=0,rounding_size=0.8", lw=1.2, fc=fill, ec=FRAME[fill])
    )
    top = place[1] + size[1] / 2 + LINE * (len(words) - 1) / 2
    for k, line in enumerate(words):
        axes.text(place[0] + 1.2, top - LINE * k, line, va="center", size=8.5, weight="normal" if k else "bold")


def _arrow(axes: Any, *corners: tuple[float, float]) -> None:
    """A line through the corners with an arrow at its end."""
    axes.plot(*zip(*corners[:-1], strict=True), color=GREY, lw=1.4)
    look = {"arrowstyle": "-|>", "lw": 1.4, "color": GREY, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", corners[-1], corners[-2], arrowprops=look)


def _canvas(width: float, height: float) -> tuple[Any, Any]:
    """A figure of this many characters by half lines, without axes."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(0.08 * width, 0.085 * height))
    axes.set(xlim=(-0.5, width + 0.5), ylim=(-0.5, height + 0.5))
    axes.axis("off")
    return figure, axes


# What a command makes of a scene, and what then makes something of its run.
OF_A_SCENE = {
    "refsim plan": "fields, bytes, step limits",
    "refsim run": "frames, report, checkpoint",
    "refsim study": "error and cost of a value",
    "refsim sweep": "a value over parameters",
}
OF_A_RUN = {
    "refsim view": "a page in the browser",
    "refsim render": "pictures, a film",
    "refsim.open_run": "arrays in Python",
    "ParaView": "particles.vtkhdf",
}


def commands() -> Any:
    """What the installed commands read and write."""
    figure, axes = _canvas(98, 37)
    _box(axes, (0, 20.5), (24, 7), ("a scene file", "of refsim example, or yours"), "white")
    for k, (name, words) in enumerate(OF_A_SCENE.items()):
        y = 31.5 - 6.5 * k
        _box(axes, (33, y), (27, 5), (name, words), PALE)
        _arrow(axes, (24, 24), (28.5, 24), (28.5, y + 2.5), (33, y + 2.5))
    for k, (name, words) in enumerate(OF_A_RUN.items()):
        y = 31.5 - 6.5 * k
        _box(axes, (69, y), (29, 5), (name, words), FINE)
        _arrow(axes, (60, 27.5), (64.5, 27.5), (64.5, y + 2.5), (69, y + 2.5))
    _box(axes, (0, 1), (24, 5), ("your own program", "Python, C, Warp, Taichi"), WARM)
    _box(axes, (33, 1), (27, 5), ("refsim contract", "compares with a reference"), PALE)
    _box(axes, (69, 1), (29, 5), ("verdict", "each trial against its bound"), FINE)
    _arrow(axes, (24, 3.5), (33, 3.5))
    _arrow(axes, (60, 3.5), (69, 3.5))
    return figure


PUBLIC = {
    "Python": "names, arguments, attributes, units",
    "scene files": "keys, units, defaults",
    "test vectors": "schema, names of arrays",
    "checkpoints": "that a run goes on from one",
    "particle files": "VTKHDF, with a digest in front",
    "command line": "commands, options, keys of --json",
    "exit codes": "0, 2, 3, 4; why a run stops",
    "operations": "names, arguments, bounds",
}
PRIVATE = ("modules that no", "page names", "", "layout of fields", "in a simulation", "", "validation/", "scripts/")


def public() -> Any:
    """The parts that are public, those of the table of docs/public_names.md; and what is not."""
    page = (ROOT / "docs" / "public_names.md").read_text(encoding="utf-8")
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in page.splitlines() if line.count("|") == 4]
    assert rows[0][0] == "part"
    assert [row[0] for row in rows[2:]] == list(PUBLIC), "the table of docs/public_names.md has other parts"
    figure, axes = _canvas(98, 32)
    _box(axes, (0, 0), (98, 32), (), "white")
    axes.text(81, 26.8, "not public", size=8.5, weight="bold")
    for k, words in enumerate(PRIVATE):
        axes.text(81, 23.6 - LINE * k, words, size=8.5)
    _box(axes, (1.5, 1.5), (77, 29), (), FINE)
    axes.text(3, 27.5, "public: after a renaming the old name works for one more minor version at least", size=8.5)
    for k, entry in enumerate(PUBLIC.items()):
        _box(axes, (3 + 37.5 * (k % 2), 21 - 6 * (k // 2)), (36.5, 5), entry, PALE)
    return figure


PICTURES: dict[str, Callable[[], Any]] = {
    "styles.webp": styles,
    "dam_break.png": dam_break,
    "height_of_the_centre.png": height_of_the_centre,
    "sweep_of_tension.png": sweep_of_tension,
    "rounding_of_density.png": rounding_of_density,
    "verdicts.png": verdicts,
    "main_job.png": main_job,
    "commands.png": commands,
    "public.png": public,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"{', '.join(PICTURES)}; all by default")
    parser.add_argument("--folder", type=Path, default=FOLDER, help="to write the pictures into")
    given = parser.parse_args(arguments)
    try:
        chosen(given.names, PICTURES, "picture")
    except InputError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    folder = given.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    import matplotlib.pyplot as plt

    before = Path.cwd()
    with tempfile.TemporaryDirectory() as made, style():
        os.chdir(made)
        try:
            for name in given.names or PICTURES:
                figure = PICTURES[name]()
                save_picture(figure, folder / name)
                plt.close(figure)
                print(folder / name)
        finally:
            os.chdir(before)
    return EXIT_FINE


if __name__ == "__main__":
    sys.exit(main())
