"""Reproduce the papers' experiments: runs every experiment and every panel of what accuracy costs, draws the pictures,
and ends with one table of checks.

`--quick` takes some ten minutes on two cores, a good part of them compiling; `--full` (the default) runs the published
sizes. Results are kept in results/ and reused, so that a run that was interrupted goes on where it stopped; pictures
go to figures/, quick ones to figures/quick/. Exit code: 0 all well, 2 bad input, 3 a run stopped, 4 a check failed.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from refsim.core.errors import RefsimError  # noqa: E402
from validation.__main__ import add_options, options_of  # noqa: E402
from validation.accuracy import panels, perform_panels  # noqa: E402
from validation.claims import measure, read_claims, table  # noqa: E402
from validation.experiment import discover  # noqa: E402
from validation.perform import EXIT_FAILED, exit_code, machine, perform  # noqa: E402
from validation.report import as_json, report  # noqa: E402


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    began = time.perf_counter()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser)
    given = parser.parse_args(arguments)
    out = sys.stderr if given.json else sys.stdout
    options = options_of(given, ROOT)
    size, here = "quick" if options.quick else "published", machine()
    used = ", ".join(f"{name} {value}" for name, value in here.items() if name not in ("processor", "cores"))
    where = f"{here['processor']}, {here['cores']} cores; {used}"
    print(f"The {size} sizes on backend {options.backend}; {where}", file=out, flush=True)
    try:
        experiments = discover()
        performed = perform([experiment.part(options) for experiment in experiments.values()], options)
        chosen = [(name, panel) for name, panel in panels(experiments).values() if panel.quick or not options.quick]
        performed += perform_panels(chosen, options)
    except RefsimError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    print(f"\nPictures: {options.figures}\nAll of it took {time.perf_counter() - began:.0f} s.", file=out)
    claims = measure(list(read_claims().values()), options, compute=False)
    print(f"\n{table(claims)}\npython -m validation claims measures anew what is not measured here.", file=out)
    report(performed, out)
    if given.json:
        print(as_json(performed))
    return exit_code(performed) or (0 if all(found.holds for found in claims) else EXIT_FAILED)


if __name__ == "__main__":
    sys.exit(main())
