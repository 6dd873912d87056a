"""The worked examples of docs/study.md: runs each study, draws its picture into figures/ and writes its table.

    python scripts/study_examples.py            # all of them, a few minutes; results on file are used again
    python scripts/study_examples.py dam_front

Seconds are those of the machine that runs it.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from refsim import study  # noqa: E402
from refsim.__main__ import make_parser  # noqa: E402
from refsim.commands import discover  # noqa: E402
from validation.drawing import save_picture  # noqa: E402

PAGE = ROOT / "docs" / "study.md"
EXAMPLES = {
    "dam_front": "refsim study docs/examples/study/dam_front.toml --observable front --levels 4 --finer 2",
    "rounding_droplet": "refsim study docs/examples/study/rounding_droplet.toml"
    " --observable docs/examples/study/observables.py:radius_variation --error 0.05",
    "melting_block": "refsim study docs/examples/study/melting_block.toml"
    " --observable docs/examples/study/observables.py:molten --reaches 0.9 --levels 4 --finer 2 --error 0.05",
}


def main() -> None:
    """Perform the examples named, all by default."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="EXAMPLE", help=f"some of {', '.join(EXAMPLES)}; all by default")
    names = parser.parse_args().names
    unknown = sorted(set(names) - set(EXAMPLES))
    if unknown:
        parser.error(f"there is no example {', '.join(unknown)}; choose from {', '.join(EXAMPLES)}.")
    discover()
    for name in names or EXAMPLES:
        given = make_parser().parse_args(shlex.split(EXAMPLES[name])[1:])
        path, _, function = given.observable.rpartition(":")
        found = study(
            ROOT / given.scene,
            f"{ROOT / path}:{function}" if path else given.observable,
            levels=given.levels,
            finer=given.finer,
            error=given.error,
            reaches=given.reaches,
            folder=ROOT / "results" / "study" / name,
            say=lambda text: print(text, file=sys.stderr, flush=True),
            command=EXAMPLES[name],
        )
        save_picture(found.plot(), ROOT / "figures" / f"study_{name}.png")
        write(name, f"```sh\n{EXAMPLES[name]}\n```\n\n```\n{found.text()}\n```")


def write(name: str, text: str) -> None:
    """Put a text between the marks of an example on the page."""
    page = PAGE.read_text()
    begin, end = f"<!-- {name} -->\n", f"\n<!-- end of {name} -->"
    head, _, rest = page.partition(begin)
    _, _, tail = rest.partition(end)
    PAGE.write_text(f"{head}{begin}{text}{end}{tail}")


if __name__ == "__main__":
    main()
