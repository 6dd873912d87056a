"""Make the films of the site: an example of each of the five systems, run and rendered into docs/_site/films.

    python scripts/films.py              # all, some ten minutes on two cores
    python scripts/films.py melting      # one of them

Needs `pip install "refsim[view]"`. Exit code: 0, 2 for a name that is no film, else that of the command that failed.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "docs" / "_site" / "films"
sys.path.insert(0, str(ROOT))

from refsim.core.errors import InputError  # noqa: E402
from refsim.core.streams import any_letter  # noqa: E402
from validation.experiment import chosen  # noqa: E402

SECONDS, PER_SECOND = 10, 15  # of a film


class Film(NamedTuple):
    """An example, the paper, thesis or patent of its method, what is seen, end [s], options of `refsim render`."""

    name: str
    source: str
    shows: str
    until: float
    options: str

    def commands(self) -> tuple[str, str, str]:
        """The three commands that make the film."""
        every = self.until / (SECONDS * PER_SECOND - 1)
        drawn = f"--film {self.name}.mp4 {self.options} --size 1280x720 --per-second {PER_SECOND}"
        return (
            f"refsim example {self.name}", f"refsim run {self.name}.toml --until {self.until:g} --every {every:.4g}",
            f"refsim render {self.name}_run {drawn}",
        )  # fmt: skip


MADE = (
    Film("dam_break_2d", "Jiang & Zhu 2023", "A column of liquid collapses in a tank, coloured by speed.", 0.35,
         "--color velocity"),
    Film("cohesion", "Dong, Zhang & Chen 2016", "A cube of liquid becomes a drop by cohesion.", 0.04, "--style water"),
    Film("mpm_droplet", "a thesis on surface tension in MPM", "A box of liquid becomes a drop by surface energy.", 0.25,
         "--style paper"),
    Film("melting", "Shao & Song 2017", "A ball of ice falls into warm water and melts.", 2.0, "--style water"),
    Film("mesh_boundary", "patent CN104318598A", "A column of liquid falls on a pebble, a triangle mesh.", 0.4,
         "--style water"),
)  # fmt: skip
FILMS = {film.name: film for film in MADE}


def make(film: Film) -> int:
    """Run and render a film; exit code of the command that failed, or 0."""
    with tempfile.TemporaryDirectory() as folder:
        for command in film.commands():
            print(command, flush=True)
            done = subprocess.run([sys.executable, "-m", *command.split()], cwd=folder, stdout=subprocess.DEVNULL)
            if done.returncode:
                return done.returncode
        FOLDER.mkdir(parents=True, exist_ok=True)
        shutil.move(Path(folder, f"{film.name}.mp4"), FOLDER / f"{film.name}.mp4")
    return 0


@any_letter()
def main(words: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="films.py", description="Make the films of the site.")
    parser.add_argument("film", nargs="*", metavar="FILM", help=f"some of {', '.join(FILMS)}; all by default")
    given = parser.parse_args(words)
    try:
        films = chosen(given.film, FILMS, "film")
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    return next((code for code in map(make, films) if code), 0)


if __name__ == "__main__":
    sys.exit(main())
