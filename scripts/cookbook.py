"""Run the recipes of docs/cookbook.md and draw their pictures into figures/cookbook.

    python scripts/cookbook.py             # all, some minutes on two cores
    python scripts/cookbook.py sloshing    # one of them

recipes.json beside the pictures keeps particles, steps and processor seconds of the steps on one thread. Needs
`pip install "refsim[view]"`. Exit code: 0, 2 for a name that is no recipe, else that of the command that failed.
"""

import argparse
import contextlib
import json
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "figures" / "cookbook"
MEASURED = FOLDER / "recipes.json"
sys.path.insert(0, str(ROOT))

from refsim.commands.example import examples  # noqa: E402
from refsim.core.errors import InputError  # noqa: E402
from refsim.core.streams import any_letter  # noqa: E402
from refsim.core.writing import made_by, write_file  # noqa: E402
from validation.experiment import chosen  # noqa: E402

WORDS_ABOVE, WORDS_BELOW = 0.07, 0.13  # shares of a rendered picture with time, scale and colour bar


class Recipe(NamedTuple):
    """A packaged example, how it is drawn, and what is seen.

    options  of `refsim render`
    at       time of the picture [s]
    seen     one sentence, what to look for
    until    where a first run stops that a second one resumes [s]; 0 for one run
    """

    scene: str
    title: str
    options: str
    at: float
    seen: str
    until: float = 0.0

    def commands(self) -> tuple[str, ...]:
        """The commands of the page."""
        run = f"refsim run {self.scene}.toml"
        stopped = (f"{run} --until {self.until:g}", f"refsim run --resume {self.scene}_run")
        return (
            f"refsim example {self.scene}", *(stopped if self.until else (run,)),
            f"refsim render {self.scene}_run {self.options}",
        )  # fmt: skip


MADE = (
    Recipe("u_tube", "U-tube", "--cut y=0.04 --color pressure --camera -90,8",
           0.7, "After half a period the right arm is high."),
    Recipe("sloshing", "Sloshing", "--color velocity", 2.6, "The wave at the left wall grows with every period."),
    Recipe("wave_maker", "Wave maker", "--color velocity", 2.4, "Crests leave both ends; the middle is still at rest."),
    Recipe("dam_obstacle", "Dam break on an obstacle", "--style water", 0.24, "The front goes around the block."),
    Recipe("floating_body", "Floating body", "--style water", 2.0, "Half of the box is under water."),
    Recipe("drop_on_plate", "Drop on a plate", "--camera -60,4", 0.8, "It is as high as a cap of 75 degrees."),
    Recipe("drops_colliding", "Drops that collide", "--camera -90,10", 0.075, "A disc swings into one drop."),
    Recipe("melting", "Ice that melts in water", "--style water", 0.3, "The ice falls in; it has melted after 0.8 s."),
    Recipe("hot_plate", "Hot plate", "--color temperature", 200.0, "Heat has come 1 cm high."),
    Recipe("funnel", "Pouring from a mesh", "--cut y=0", 0.3, "The liquid leaves the funnel through its hole."),
    Recipe("film_on_sphere", "Film on a ball", "", 0.03, "The liquid creeps around the ball and covers it at 0.085 s."),
    Recipe("mpm_droplet", "A drop by the material point method", "", 0.25, "The box has become a ball."),
    Recipe("spinning_solid", "Spinning solid", "", 2.0, "At 2.3 and 6.3 s the middle axis turns over."),
    Recipe("periodic_flow", "Periodic flow", "--color velocity", 10.0, "The velocity is a parabola."),
    Recipe("dam_break_2d", "Stop and go on", "--color velocity", 0.3, "The second run takes up the first, bit for bit.",
           until=0.15),
)  # fmt: skip
RECIPES = {recipe.scene: recipe for recipe in MADE}


def performed(commands: Sequence[str], *of_runs: str) -> int:
    """Perform commands in the current folder, runs with more options; exit code of the one that failed, or 0."""
    from refsim.__main__ import main as command

    for command_line in commands:
        print(command_line, flush=True)
        if code := command([*command_line.split()[1:], *(of_runs if command_line.startswith("refsim run") else ())]):
            return code
    return 0


def make(recipe: Recipe) -> int:
    """Run and draw a recipe in a new folder; exit code of the command that failed, or 0."""
    import refsim

    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        if code := performed(recipe.commands()[:-1], "--quiet", "--threads", "1"):
            return code
        run = refsim.open_run(f"{recipe.scene}_run")
        frame = min(range(len(run)), key=lambda k: abs(run.times[k] - recipe.at))
        if code := performed([f"{recipe.commands()[-1]} --frames {frame} --size 640x480 -o picture.png"]):
            return code
        _keep(recipe, Path("picture.png"), run)
    return 0


def _keep(recipe: Recipe, picture: Path, run: Any) -> None:
    """Write the picture without its words, which the page says, and what was measured."""
    from PIL import Image

    image = Image.open(picture).convert("RGB")
    image = image.crop((0, round(WORDS_ABOVE * image.height), image.width, round((1 - WORDS_BELOW) * image.height)))
    FOLDER.mkdir(parents=True, exist_ok=True)
    write_file(FOLDER / f"{recipe.scene}.webp", made_by(image.save, format="WEBP", quality=85, method=6))
    measured = json.loads(MEASURED.read_text(encoding="utf-8")) if MEASURED.exists() else {}
    report = run.report
    measured[recipe.scene] = {
        "particles": len(run[0].position), "steps": report["steps"],
        "seconds": round(report["seconds.processor.steps"], 1), "at": round(run.at(recipe.at).time, 4),
    }  # fmt: skip
    write_file(MEASURED, json.dumps(measured, indent=1, sort_keys=True) + "\n")


def cards() -> Iterator[str]:
    """The gallery: a card for each recipe, picture, name, and a link to its scene."""
    yield '<div class="gallery scenes">\n'
    for recipe in MADE:
        yield '<div class="card">\n'
        yield f"![{recipe.title}](../figures/cookbook/{recipe.scene}.webp)\n"
        yield f"[{recipe.title}](cookbook.md#{_anchor(recipe)}). {recipe.seen}\n"
        yield "</div>\n"
    yield "</div>\n"


def page() -> Iterator[str]:
    """The cookbook: of each recipe picture, what is seen, commands, seconds, scene file."""
    measured = json.loads(MEASURED.read_text(encoding="utf-8"))
    known = examples()
    for recipe in MADE:
        text, told = known[recipe.scene], measured[recipe.scene]
        head, _, scene = text.partition("\nname =")
        yield f"\n## {recipe.title}\n"
        yield f"![{recipe.title}](../figures/cookbook/{recipe.scene}.webp)\n"
        yield f"*{recipe.seen} t = {told['at']:g} s.*\n"
        commands = "\n".join(recipe.commands())
        yield f"```sh\n{commands}\n```\n"
        yield f"{told['particles']:,} particles, {told['steps']:,} steps, {told['seconds']:g} s on one thread.\n"
        yield f"```toml\n{head}\nname ={scene.rstrip()}\n```\n"


def _anchor(recipe: Recipe) -> str:
    return "".join(c for c in recipe.title.lower().replace(" ", "-") if c.isalnum() or c == "-")


@any_letter()
def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("name", nargs="*", metavar="NAME", help=f"some of {', '.join(RECIPES)}; all by default")
    given = parser.parse_args(arguments)
    try:
        recipes = chosen(given.name, RECIPES, "recipe")
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    return next(filter(None, map(make, recipes)), 0)


if __name__ == "__main__":
    sys.exit(main())
