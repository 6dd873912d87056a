"""`refsim view`: a run in the browser."""

import argparse
import tempfile
import webbrowser
from pathlib import Path

from refsim.commands import CommandResult, command, in_bytes, takes
from refsim.core.writing import output_path

DESCRIPTION = (
    "Show a run in the browser: turn, play, colour by any field, clip. With --html the page is written to a file, which"
    " opens without a server and without a network."
)


@command("view", "show a run in the browser", DESCRIPTION)
@takes("run", metavar="RUN", help="folder that `refsim run` has written")
@takes("--html", metavar="FILE", help="write the page to this file, and open no browser")
@takes("--frames", metavar="LIST", help="such as 0:100:2 (all)")
@takes("--fields", metavar="LIST", help="to colour by, such as pressure,velocity.x (the eight that matter most)")
def execute(options: argparse.Namespace) -> CommandResult:
    """Write the page, and open it unless --html names a file."""
    from refsim.render.view import view

    fields = None if options.fields is None else [name.strip() for name in options.fields.split(",") if name.strip()]
    given = None if options.html is None else output_path(options.html, "page")
    page = view(options.run, options.frames, fields)
    path = given or Path(tempfile.mkdtemp(prefix="refsim_")) / "view.html"
    page.save(path)
    size = len(page.html.encode())
    line = f"{path}  {in_bytes(size)}"
    if page.left_out:
        line += f"\nfields left out: {', '.join(page.left_out)}; --fields selects others"
    if options.html is None and not webbrowser.open(path.absolute().as_uri()):
        line += "\nno browser was found: open the file in one"
    return CommandResult({"file": str(path), "bytes": size, "left_out": list(page.left_out)}, line)
