"""`python -m validation [CASE ...]`: the papers' experiments, with verdicts and pictures.

`python -m validation attack` attacks the command line instead; see `python -m validation attack --help`.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path

if not __package__:
    print("Run this from the folder of the clone, as `python -m validation`.", file=sys.stderr)
    sys.exit(2)

from refsim.core.errors import InputError, RefsimError
from validation.harness import Options, as_json, chosen_cases, discover, exit_code, perform, report


def parser() -> argparse.ArgumentParser:
    """The command line."""
    made = argparse.ArgumentParser(prog="python -m validation", description=__doc__)
    made.add_argument("case", nargs="*", help="cases to run; all by default")
    add_options(made)
    made.add_argument("--results", type=Path, default=Path("results"), help="where results are kept and reused")
    made.add_argument("--figures", type=Path, help="where pictures go; figures, with --quick figures/quick")
    made.add_argument("--only", nargs="+", default=[], metavar="RUN", help="runs whose names start like one of these")
    made.add_argument(
        "--jobs", type=int, default=1, metavar="N", help="processes of one thread each for all runs that are not timed"
    )
    made.add_argument("--list", action="store_true", help="list the cases")
    return made


def add_options(made: argparse.ArgumentParser) -> None:
    """What this command and scripts/reproduce.py have in common."""
    size = made.add_mutually_exclusive_group()
    size.add_argument("--quick", action="store_true", help="small sizes: minutes in all")
    size.add_argument("--full", action="store_true", help="the published sizes (the default)")
    made.add_argument("--backend", default="cpu", help="numpy, cpu (default) or cuda")
    made.add_argument("--threads", type=int, help="CPU threads; all by default")
    made.add_argument("--peers", action="store_true", help="also time other programs on the same work")
    made.add_argument("--fresh", action="store_true", help="compute anew what is stored")
    made.add_argument(
        "--json", action="store_true", help="one JSON object on standard output, the rest on standard error"
    )


def options_of(given: argparse.Namespace, root: Path = Path()) -> Options:
    """The options of a parsed command line; folders lie under `root` unless they are given."""
    quick = given.quick
    figures = getattr(given, "figures", None) or root / ("figures/quick" if quick else "figures")
    return Options(
        quick=quick,
        backend=given.backend,
        peers=given.peers,
        fresh=given.fresh,
        threads=given.threads,
        results=root / getattr(given, "results", "results"),
        figures=figures,
        only=tuple(getattr(given, "only", ())),
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code: 0 well, 2 bad input, 3 a run stopped, 4 a verdict failed."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    if arguments[:1] == ["attack"]:
        from validation.attack.__main__ import main as attack

        return attack(arguments[1:])
    given = parser().parse_args(arguments)
    try:
        cases = discover()
        if given.list:
            for case in cases.values():
                print(f"{case.name:12}  {case.title}")
            return 0
        options, chosen = options_of(given), chosen_cases(given.case, cases)
        if given.jobs < 1:
            raise InputError(f"--jobs = {given.jobs} is not possible; give 1 or more processes.")
        if given.jobs > 1:
            from validation.processes import compute_ahead

            compute_ahead(chosen, options, given.jobs)
            options = dataclasses.replace(options, fresh=False)
        outcomes = perform(chosen, options)
    except RefsimError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    report(outcomes, sys.stderr if given.json else sys.stdout)
    if given.json:
        print(as_json(outcomes))
    return exit_code(outcomes)


if __name__ == "__main__":
    sys.exit(main())
