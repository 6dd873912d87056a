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
from validation.__main__ import every_picture  # noqa: E402
from validation.experiment import chosen  # noqa: E402
from validation.perform import redraw  # noqa: E402


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code: 2 where a picture's name or data is missing."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("picture", nargs="*", help="names of pictures; every one that has data by default")
    parser.add_argument("--quick", action="store_true", help="those of the quick sizes, in figures/quick")
    given = parser.parse_args(arguments)
    folder = ROOT / ("figures/quick" if given.quick else "figures")
    pictures = every_picture()
    names = given.picture or [name for name in pictures if any(folder.glob(f"{name}.json*"))]
    try:
        for picture in chosen(names, pictures, "picture") if names else ():
            print(redraw(picture, folder))
    except InputError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
