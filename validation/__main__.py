"""The papers' experiments: `python -m validation COMMAND`.

Every command prints its own help and touches nothing with `--help`. Exit codes: 0 well, 2 bad input, 3 a run stopped,
4 a check failed.
"""

from __future__ import annotations

import argparse
import datetime
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

if not __package__:
    print("Run this from the folder of the clone, as `python -m validation`.", file=sys.stderr)
    sys.exit(2)

from refsim.core.errors import InputError, RefsimError
from validation import (
    accuracy,
    answers_page,
    claims,
    own_choices,
    stability,
    stability_page,
    times,
    verify,
)
from validation.attack import campaign
from validation.checks import ACCURACY, CLAIM, HARD_CASE, KINDS, VERDICT, bars
from validation.experiment import Experiment, Options, Picture, chosen, discover
from validation.measure import command
from validation.perform import EXIT_FAILED, EXIT_FINE, Performed, exit_code, perform
from validation.report import as_json, report


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one sentence."""

    def error(self, message: str) -> NoReturn:
        """Raises InputError."""
        raise InputError(f"{self.prog}: {message}; --help says more.")


def parser() -> argparse.ArgumentParser:
    """The command line."""
    made = Parser(
        prog="python -m validation", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = made.add_subparsers(dest="command", metavar="COMMAND", required=True, parser_class=Parser)

    def add(name: str, words: str) -> argparse.ArgumentParser:
        return commands.add_parser(name, help=words, description=f"{words[0].upper()}{words[1:]}.")

    part = add("list", "names the experiments, or what some of them hold")
    part.add_argument(
        "names", nargs="*", metavar="EXPERIMENT | KIND", help=f"experiments, or one of {', '.join(KINDS)}"
    )
    part.set_defaults(perform=listed)

    part = add("run", "runs experiments and checks what they give against its bars, with tables and pictures")
    part.add_argument("names", nargs="*", metavar="EXPERIMENT", help="all by default")
    add_options(part, "--only", "--jobs")
    part.set_defaults(perform=run)

    part = add("claims", "measures what the papers claim, and says whether the written verdicts hold")
    part.add_argument("names", nargs="*", metavar="CLAIM | SYSTEM", help="all by default")
    add_options(part, "--jobs")
    part.add_argument(
        "--write", action="store_true", help="write what was measured into expected.toml and docs/claims.md"
    )
    part.set_defaults(perform=measure_claims)

    part = add("stability", "runs hard cases, whose outcomes are on file, and measures maps of what is stable")
    part.add_argument("names", nargs="*", metavar="EXPERIMENT | CASE | MAP", help="all by default")
    add_options(part, "--jobs")
    part.add_argument("--markdown", action="store_true", help="print the page's rows from the outcomes on file")
    part.add_argument("--write", action="store_true", help="renew docs/stability.md from the outcomes on file")
    part.set_defaults(perform=hard_cases)

    part = add("accuracy", "measures error against wall time")
    part.add_argument("names", nargs="*", metavar="PANEL", help="all by default")
    add_options(part, "--only")
    part.add_argument("--compare", nargs=2, metavar=("OLD", "NEW"), help="judge two reports; measures nothing")
    part.add_argument("--write", action="store_true", help="renew docs/accuracy_cost.md and what refsim advise knows")
    part.set_defaults(perform=panels)

    part = add("own", "measures what each paper's own choices give beside refsim's, in a minute, and writes the table")
    part.set_defaults(perform=own)

    part = add("times", "stores times that benchmarks gave, and makes the pages of effects and of the device's limits")
    part.add_argument("files", nargs="*", type=Path, metavar="FILE", help="of pytest --benchmark-json")
    part.set_defaults(perform=timed)

    part = add("verify", "computes some published numbers anew and compares them, in a minute")
    part.add_argument("names", nargs="*", metavar="NUMBER", help="all of validation/verify.toml by default")
    part.add_argument("--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="processes; one a core")
    part.add_argument("--threads", type=int, help="CPU threads of a single process; all by default")
    part.add_argument("--json", action="store_true", help="one JSON object on standard output")
    part.add_argument(
        "--draw", type=int, metavar="N", help="N other claims, drawn at random, instead of those of the file"
    )
    part.add_argument("--seed", type=int, help="of the draw; by default today's date")
    part.set_defaults(perform=verified)

    command.add_commands(add("measure", "measures the drops behind packaged tables, and writes the tables"))
    campaign.add_options(add("attack", "attacks the command line for some minutes and counts how it ends"))
    return made


def add_options(made: argparse.ArgumentParser, *more: str) -> None:
    """What the commands that compute and scripts/reproduce.py have in common; `more` of --only and --jobs."""
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
    if not more:
        return
    made.add_argument("--results", type=Path, default=Path("results"), help="where results are kept and reused")
    made.add_argument("--figures", type=Path, help="where pictures go; figures, with --quick figures/quick")
    if "--only" in more:
        made.add_argument(
            "--only", nargs="+", default=[], metavar="RUN", help="runs whose names start like one of these"
        )
    if "--jobs" in more:
        where = made.add_mutually_exclusive_group()
        where.add_argument("--jobs", type=int, default=1, metavar="N", help="processes for all runs that are not timed")
        where.add_argument("--scheduler", metavar="ADDRESS", help="the same on the workers of a Dask scheduler")


def options_of(given: argparse.Namespace, root: Path = Path()) -> Options:
    """The options of a parsed command line; folders lie under `root` unless they are given."""
    return Options(
        quick=given.quick,
        backend=given.backend,
        peers=given.peers,
        fresh=given.fresh,
        threads=given.threads,
        results=root / getattr(given, "results", "results"),
        figures=getattr(given, "figures", None) or root / ("figures/quick" if given.quick else "figures"),
        only=tuple(getattr(given, "only", ())),
        scheduler=getattr(given, "scheduler", None),
    )


def listed(given: argparse.Namespace) -> int:
    """What there is: a line for each experiment; of those that are named, everything."""
    known = discover()
    kinds = [name for name in given.names if name in KINDS]
    some = chosen([name for name in given.names if name not in KINDS], known, "experiment or kind")
    for experiment in some:
        parts = contents(experiment)
        if not given.names:
            numbers = {kind: len(parts[kind]) for kind in KINDS if parts[kind]}
            counts = ", ".join(f"{n} {COUNTED[kind]}{'s' * (n > 1)}" for kind, n in numbers.items())
            print(f"{experiment.name:22}  {experiment.title} ({counts})")
            continue
        for kind in kinds or KINDS:
            for name, words in parts[kind].items():
                print(f"{experiment.name:22}  {kind:9}  {name:32}  {words}")
    return EXIT_FINE


COUNTED = dict(zip(KINDS, ("bar", "claim", "hard case", "panel")))


def contents(experiment: Experiment) -> dict[str, dict[str, str]]:
    """Names and words of an experiment's checks, by kind."""
    own = [claim for claim in claims.read_claims().values() if claim.experiment == experiment.name]
    hard = {case.name: case.hard for case in experiment.hard_cases}
    return {
        VERDICT: {name: bar["what"] for name, bar in bars(experiment.name).items()},
        CLAIM: {claim.name: f"{claim.verdict}: {claim.what or claim.says}" for claim in own},
        HARD_CASE: hard | {m.name: m.title for m in experiment.maps},
        ACCURACY: {panel.name: panel.title for panel in experiment.panels},
    }


def every_picture() -> dict[str, Picture]:
    """All pictures by name: of experiments, of their hard cases and maps, and of panels."""
    options, known = Options(), discover()
    parts = [part for e in known.values() for part in (e.part(options), stability.part_of(e, options))]
    parts += [accuracy.part_of(name, panel, options) for name, panel in accuracy.panels(known).values()]
    return {picture.name: picture for part in parts for picture in part.pictures}


def run(given: argparse.Namespace) -> int:
    """Run experiments."""
    options = options_of(given)
    some = chosen(given.names, discover(), "experiment")
    return told(perform([experiment.part(options) for experiment in some], options, given.jobs), given.json)


def own(given: argparse.Namespace) -> int:
    """Measure `literal = "paper"` of every system."""
    print(*own_choices.write(), sep="\n")
    return EXIT_FINE


def hard_cases(given: argparse.Namespace) -> int:
    """Run hard cases and maps."""
    options = options_of(given)
    if given.markdown:
        for experiment in discover().values():
            print("\n".join([f"\n{experiment.name}: {experiment.title}", *stability.markdown(experiment)]))
        return EXIT_FINE
    if given.write:
        print(*stability_page.write(discover()), sep="\n")
        return EXIT_FINE
    return told(perform(stability.parts(given.names, discover(), options), options, given.jobs), given.json)


def panels(given: argparse.Namespace) -> int:
    """Measure error against time, or compare two reports."""
    if given.compare:
        comparison = accuracy.compare(*map(accuracy.read_report, given.compare))
        print("\n".join(comparison.lines))
        return EXIT_FAILED if comparison.worse else EXIT_FINE
    if given.write:
        print(*answers_page.write(), sep="\n")
        return EXIT_FINE
    some = chosen(given.names, accuracy.panels(discover()), "panel")
    return told(accuracy.perform_panels(some, options_of(given)), given.json)


def timed(given: argparse.Namespace) -> int:
    """Store times, and make their pages."""
    print(*times.perform(given.files), sep="\n")
    return EXIT_FINE


def measure_claims(given: argparse.Namespace) -> int:
    """Measure claims."""
    some = claims.chosen(given.names, claims.read_claims())
    if given.write and given.quick:
        raise InputError("claims: --write takes the published sizes; leave --quick out.")
    options = options_of(given)
    found = claims.measure(some, options, given.jobs)
    claims.write_figures(found, options.figures)
    if given.write:
        claims.write(found)
        now = claims.read_claims()
        found = [claims.Found(now[each.claim.name], each.values, each.missing) for each in found]
    print(claims.table(found), file=sys.stderr if given.json else sys.stdout)
    for why in dict.fromkeys(each.missing for each in found if each.missing):
        names = ", ".join(each.claim.name for each in found if each.missing == why)
        print(f"not measured: {names} ({why})", file=sys.stderr if given.json else sys.stdout)
    if given.json:
        print(claims.as_json(found))
    return EXIT_FINE if all(each.holds for each in found) else EXIT_FAILED


def verified(given: argparse.Namespace) -> int:
    """Compute published numbers anew."""
    names, selection = given.names, None
    if given.draw is not None:
        if names:
            raise InputError("verify: --draw takes no names; leave them out.")
        seed = int(datetime.date.today().strftime("%Y%m%d")) if given.seed is None else given.seed
        selection = verify.drawn(given.draw, seed)
        print(f"seed {seed}: {', '.join(selection.claims)}", file=sys.stderr)
    found = verify.verify(names, given.jobs, given.threads, selection)
    print(verify.as_json(found) if given.json else verify.table(found))
    print(*verify.deviating(found), sep="\n", end="\n" if verify.deviating(found) else "", file=sys.stderr)
    return EXIT_FAILED if verify.deviating(found) else EXIT_FINE


def told(performed: Sequence[Performed], json: bool) -> int:
    """Report, and the exit code."""
    report(performed, sys.stderr if json else sys.stdout)
    if json:
        print(as_json(performed))
    return exit_code(performed)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns its exit code."""
    try:
        given = parser().parse_args(sys.argv[1:] if arguments is None else arguments)
        return given.perform(given)
    except RefsimError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    except BrokenPipeError:  # the reader of standard output, `head` say, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_FINE


if __name__ == "__main__":
    sys.exit(main())
