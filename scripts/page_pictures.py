"""Draw the pictures of pages about use: `python scripts/page_pictures.py [NAME ...]` writes figures/pages/NAME.

They are made of packaged examples and of verdicts on file. Needs `pip install "refsim[view]"`; takes a minute.
Exit code: 0, 2 for a name that is no picture.
"""

import collections
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import refsim  # noqa: E402
from refsim.__main__ import main as refsim_command  # noqa: E402
from scripts.pictures import command  # noqa: E402
from validation import checks  # noqa: E402
from validation.drawing import BLUE, GREEN, GREY, ORANGE, PURPLE, SKY  # noqa: E402
from validation.page import SYSTEMS  # noqa: E402

FOLDER = ROOT / "figures" / "pages"


def _run(name: str) -> Any:
    """The run of a packaged example, in the current folder; made by the commands of the page where it is not there."""
    folder = Path(f"{name}_run")
    if not folder.exists():
        for arguments in (("example", name), ("run", f"{name}.toml", "--quiet")):
            code = refsim_command(list(arguments))
            if code:
                raise SystemExit(code)
    return refsim.open_run(folder)


def styles() -> Any:
    """One frame of liquid on a pebble in the three styles of `refsim render`."""
    import matplotlib.pyplot as plt
    from PIL import Image

    _run("mesh_boundary")
    figure, axes = plt.subplots(1, 3, figsize=(9.6, 2.6))
    for place, name in zip(axes, ("paper", "water", "particles")):
        refsim_command(f"render mesh_boundary_run --frames 45 --style {name} --size 480x420 -o {name}.png".split())
        image = Image.open(f"{name}.png")  # without time and scale bar, whose words would be too small here
        place.imshow(image.crop((0, 0.07 * image.height, image.width, 0.9 * image.height)))
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


VERDICTS = {
    "confirmed": GREEN, "mixed": SKY, "refuted": ORANGE, "not testable": GREY, "own reading": BLUE,
    "not claimed": PURPLE,
}  # fmt: skip


def verdicts() -> Any:
    """The verdicts on the claims of each source, and how many readings are not the source's own."""
    import matplotlib.pyplot as plt

    counted = collections.Counter((claim.system, claim.word) for claim in checks.read_all(checks.CLAIM))
    systems = list(SYSTEMS)[::-1]
    figure, axes = plt.subplots(figsize=(7.6, 0.9 + 0.32 * len(systems)))
    left = np.zeros(len(systems))
    for verdict, color in VERDICTS.items():
        count = np.array([counted[system, verdict] for system in systems])
        axes.barh(range(len(systems)), count, left=left, color=color, label=f"{verdict} ({count.sum()})")
        ink = "white" if color in (GREY, BLUE) else "black"  # a contrast of 4.5 and more
        for k in np.flatnonzero(count):
            axes.text(left[k] + count[k] / 2, k, str(count[k]), ha="center", va="center", color=ink, fontsize=8)
        left += count
    axes.set(yticks=range(len(systems)), yticklabels=[SYSTEMS[s] for s in systems], xlabel="claims")
    axes.legend(loc="lower right")
    return figure


PICTURES: dict[str, Callable[[], Any]] = {"styles.webp": styles, "dam_break.png": dam_break, "verdicts.png": verdicts}


if __name__ == "__main__":
    sys.exit(command(__doc__, PICTURES, FOLDER))
