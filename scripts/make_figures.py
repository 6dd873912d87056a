"""Draw the pictures anew from their data files (figures/*.json, *.json.gz); nothing is simulated.

`python scripts/make_figures.py [PICTURE ...] [--quick]`
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from refsim.core.errors import InputError  # noqa: E402
from validation import accuracy_cost, stability  # noqa: E402
from validation.harness import Options, discover, redraw  # noqa: E402


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code: 2 where a picture's name or data is missing."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("picture", nargs="*", help="names of pictures; every one that has data by default")
    parser.add_argument("--quick", action="store_true", help="those of the quick sizes, in figures/quick")
    given = parser.parse_args(arguments)
    folder = ROOT / ("figures/quick" if given.quick else "figures")
    drawers = [*discover().values(), *accuracy_cost.cases(Options()).values()]
    drawers += [stability.as_case(name, found) for name, found in stability.discover().items()]
    pictures = {picture.name: picture for case in drawers for picture in case.pictures}
    names = given.picture or [name for name in pictures if any(folder.glob(f"{name}.json*"))]
    try:
        for name in names:
            if name not in pictures:
                raise InputError(f"There is no picture {name!r}; choose from {', '.join(pictures)}.")
            print(redraw(pictures[name], folder))
    except InputError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
