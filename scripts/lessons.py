"""Run the lessons of `refsim example --lessons`: every code cell, the folded answers' code too, each lesson by itself.

    python scripts/lessons.py                          # all lessons, held to what the site's notebooks print
    python scripts/lessons.py 1_surface_particles      # one of them
    python scripts/lessons.py --pictures figures/lessons   # and write the pictures that the site shows
    python scripts/lessons.py --notebooks docs/lessons     # and write the notebooks that the site offers, with what
                                                           # the cells print
    python scripts/lessons.py --warm                       # each twice; the second run may take 60 s

A picture of a folded answer is drawn and not written. Exit code: 0 if every lesson ran to its end and its judges took
the worked answers, 2 for a name that is no lesson, 4 if one failed.
"""

import argparse
import io
import json
import re
import sys
import time
import traceback
from collections.abc import Sequence
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from refsim.core.errors import InputError  # noqa: E402
from refsim.core.streams import any_letter  # noqa: E402
from refsim.core.writing import made_by, write_file  # noqa: E402
from refsim.io.exercises import cells, judges, lessons, notebook  # noqa: E402
from validation.experiment import chosen  # noqa: E402
from validation.perform import EXIT_FAILED, EXIT_FINE  # noqa: E402

DPI = 128
NUMBER = re.compile(r"[-+]?[\d.,]+(?:e[-+]?\d+)?|\binf\b|\bnan\b")
WIDTH = re.compile(r"[ -]+")  # blanks of a column, and the line below its head
UNSETTLED = re.compile(r"^note: \* .*\n|(?<=\d)\*", re.MULTILINE)  # marks seconds, and says why
MOST_SECONDS = 60.0  # of a lesson whose kernels are compiled


def run_lesson(name: str, text: str, pictures: Path | None = None, printed: list[str] | None = None) -> dict[str, Any]:
    """Execute the cells of a lesson in a fresh namespace and return it.

    pictures  folder for NAME_1.png, NAME_2.png, ...: one for each `plt.show()` outside of the answers
    printed   takes what each cell of code prints

    Raises ValueError where a judge does not take the worked answer.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot
    from PIL import Image

    shown, drawn, inside = pyplot.show, 0, ""

    def show() -> None:
        nonlocal drawn
        for number in pyplot.get_fignums():
            figure = pyplot.figure(number)
            figure.canvas.draw()
            if inside == "code":
                drawn += 1
                if pictures is not None:
                    made = made_by(figure.savefig, format="png", dpi=DPI, bbox_inches="tight")
                    palette = Image.open(io.BytesIO(made)).convert("RGB").quantize()
                    write_file(pictures / f"{name}_{drawn}.png", made_by(palette.save, format="PNG", optimize=True))
        pyplot.close("all")

    namespace: dict[str, Any] = {"__name__": name}
    pyplot.show = show
    try:
        for number, (kind, code) in enumerate(cells(text), 1):
            if kind == "markdown":
                continue
            inside = kind
            with redirect_stdout(io.StringIO()) as said:
                exec(compile(code, f"{name}, cell {number} ({kind})", "exec"), namespace)
            if printed is not None:
                printed.append(said.getvalue())
    finally:
        pyplot.show = shown
        pyplot.close("all")
    for exercise in judges(text):
        if not namespace["check"].verdicts[exercise].right:
            raise ValueError(f"exercise {exercise} of {name}: {namespace['check'].verdicts[exercise].words}")
    return namespace


def hold_to_stored(name: str, printed: Sequence[str]) -> None:
    """Raise ValueError where a cell prints other words than in the notebook of the site.

    Numbers may differ, and with them the width of a table's columns; on a busy machine seconds do not settle.
    """

    def words(text: str) -> str:
        return WIDTH.sub("", NUMBER.sub("#", UNSETTLED.sub("", text)))

    made = json.loads((ROOT / "docs" / "lessons" / f"{name}.ipynb").read_text(encoding="utf-8"))
    cells_of_code = (cell for cell in made["cells"] if cell["cell_type"] == "code")
    stored = ["".join(output["text"] for output in cell["outputs"]) for cell in cells_of_code]
    for number, (now, then) in enumerate(zip(printed, stored, strict=True)):
        if words(now) != words(then):
            raise ValueError(f"{name}: cell {number} printed {then!r} and prints {now!r}: write the notebooks anew")


@any_letter()
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="LESSON", help="these; all by default")
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="folder to write the pictures into")
    parser.add_argument("--notebooks", type=Path, metavar="DIR", help="write the notebooks into this folder")
    parser.add_argument("--warm", action="store_true", help=f"run each twice; the second may take {MOST_SECONDS:g} s")
    given = parser.parse_args(arguments)
    known = lessons()
    try:
        chosen(given.names, known, "lesson")
    except InputError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    for folder in filter(None, (given.pictures, given.notebooks)):
        folder.mkdir(parents=True, exist_ok=True)
    failed = []
    for name in given.names or known:
        try:
            for _ in range(1 + given.warm):
                began, printed = time.monotonic(), [""]  # of the cell that installs refsim
                run_lesson(name, known[name], given.pictures, printed)
            if given.notebooks is None:
                hold_to_stored(name, printed)
            else:
                write_file(given.notebooks / f"{name}.ipynb", notebook(known[name], printed))
            if given.warm and time.monotonic() - began > MOST_SECONDS:
                raise TimeoutError(f"{name} took more than {MOST_SECONDS:g} s")
        except Exception:
            traceback.print_exc()
            failed.append(name)
        print(f"{name}: {'failed' if name in failed else 'ran'}, {time.monotonic() - began:.1f} s", flush=True)
    return EXIT_FAILED if failed else EXIT_FINE


if __name__ == "__main__":
    sys.exit(main())
