"""The command line that the scripts of pictures share: names of pictures, a folder to write them into."""

import argparse
import os
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from refsim.core.errors import InputError  # noqa: E402
from refsim.core.streams import any_letter  # noqa: E402
from validation.drawing import save_picture, style  # noqa: E402
from validation.experiment import chosen  # noqa: E402


@any_letter()
def command(
    document: str | None,
    pictures: Mapping[str, Callable[[], Any]],
    folder: Path,
    arguments: Sequence[str] | None = None,
) -> int:
    """Draw the pictures named, all by default; returns the exit code, 2 for a name that is no picture.

    pictures  what makes the figure of a file, called in an empty folder
    """
    parser = argparse.ArgumentParser(description=document, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"{', '.join(pictures)}; all by default")
    parser.add_argument("--folder", type=Path, default=folder, help="to write the pictures into")
    given = parser.parse_args(arguments)
    import matplotlib.pyplot as plt

    folder, before = given.folder.resolve(), Path.cwd()
    try:
        chosen(given.names, pictures, "picture")
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory() as made, style():
            os.chdir(made)
            try:
                for name in given.names or pictures:
                    figure = pictures[name]()
                    save_picture(figure, folder / name)
                    plt.close(figure)
                    print(folder / name)
            finally:
                os.chdir(before)
    except InputError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0
