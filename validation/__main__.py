"""The papers' experiments: `python -m validation COMMAND`.

Every command prints its own help and touches nothing with `--help`. Exit codes: 0 well, 2 bad input, 3 a run stopped,
4 a check failed.
"""

import argparse
import datetime
import importlib.util
import json
import os
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

if not __package__:
    print("Run this from the folder of the clone, as `python -m validation`.", file=sys.stderr)
    sys.exit(2)

from refsim.core.errors import InputError, RefsimError
from refsim.core.stopping import handling_signals
from refsim.core.streams import any_letter
from refsim.core.writing import write_file
from refsim.study.advice import READINGS
from refsim.study.panels import abouts
from validation import accuracy, accuracy_page, judging, own_choices, page, times
from validation.checks import CLAIM, HARD_CASE, KINDS, VALUE, VERDICT
from validation.experiment import Options, Picture, chosen, discover
from validation.measure import command
from validation.perform import EXIT_FAILED, EXIT_FINE, EXIT_STOPPED, INTERRUPTED, Performed, exit_code, perform, redraw
from validation.report import as_json, report
from validation.results import finite


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

    performed = {"check": [VERDICT, CLAIM, HARD_CASE], "run": [VERDICT], "claims": [CLAIM], "stability": [HARD_CASE]}
    for name, about in (
        ("check", "performs checks, and says whether what they give keeps what is on file, with tables and pictures"),
        ("run", "the same for the verdicts alone: runs experiments and holds what they give against its bars"),
        ("claims", "the same for the claims alone: measures what the papers claim"),
        ("stability", "the same for the hard cases and the maps of what is stable alone"),
    ):
        part = add(name, about)
        part.add_argument("names", nargs="*", metavar="NAME", help="experiments, checks, maps, sources; all by default")
        add_options(part, in_folders=True)
        if name == "check":
            part.add_argument("--kind", nargs="+", choices=performed[name], help="all by default")
        if CLAIM in performed[name]:
            about = "write what was measured of claims into expected.toml and onto the pages"
            part.add_argument("--write", action="store_true", help=about)
        part.set_defaults(perform=check, kind=performed[name], write=False)

    part = add("accuracy", "measures panels of error against time, and shows them beside their stored points")
    part.add_argument("names", nargs="*", metavar="PANEL", help="all by default")
    part.add_argument("--backend", default="cpu", help="cpu or cuda (cpu)")
    part.add_argument("--readings", type=int, default=READINGS, metavar="N", help=f"of a setting ({READINGS})")
    part.add_argument("--peers", action="store_true", help="the settings of other programs instead")
    part.add_argument("--write", action="store_true", help="store what was measured and renew docs/study.md")
    part.add_argument("--draw", action="store_true", help="page and pictures from the stored points; measures nothing")
    part.set_defaults(perform=panels)

    part = add("draw", "draws pictures anew from their data files; nothing is simulated")
    part.add_argument("names", nargs="*", metavar="PICTURE", help="every one that has data by default")
    part.add_argument("--quick", action="store_true", help="those of the quick sizes, in figures/quick")
    part.set_defaults(perform=drawn)

    part = add("own", "measures what each paper's own choices give beside refsim's, in a minute, and writes the table")
    part.set_defaults(perform=measure_own_choices)

    part = add("times", "stores times that benchmarks gave, and makes the pages of effects and of the device's limits")
    part.add_argument("files", nargs="*", type=Path, metavar="FILE", help="of pytest --benchmark-json")
    part.set_defaults(perform=timed)

    part = add("verify", "computes some published numbers anew and compares them, in a minute")
    part.add_argument("names", nargs="*", metavar="NUMBER", help="all by default")
    part.add_argument("--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="processes; one a core")
    part.add_argument("--threads", type=int, help="CPU threads of a single process; all by default")
    part.add_argument("--json", action="store_true", help="one JSON object on standard output")
    part.add_argument("--draw", type=int, metavar="N", help="N claims drawn at random, instead of those of the file")
    part.add_argument("--seed", type=int, help="of the draw; by default today's date")
    part.set_defaults(perform=verified)

    command.add_commands(add("measure", "measures the drops behind packaged tables, and writes the tables"))
    laws = add("laws", "holds scenes that are drawn at random to laws, and prints the smallest scene that breaks one")
    attack = add("attack", "attacks the command line for some minutes and counts how it ends")
    for part, module in ((laws, "laws.command"), (attack, "attack")):
        if importlib.util.find_spec("hypothesis"):
            importlib.import_module(f"validation.{module}").add_options(part)
        else:
            part.set_defaults(perform=without_hypothesis)
    return made


def without_hypothesis(given: argparse.Namespace) -> int:
    """Raises InputError: scenes and attacks are drawn by Hypothesis, which the main job does without."""
    raise InputError(f'{given.command}: Hypothesis is not installed; install it with: pip install -e ".[test]".')


def add_options(made: argparse.ArgumentParser, in_folders: bool = False) -> None:
    """What the commands that compute and scripts/reproduce.py have in common; `in_folders` what the former add."""
    size = made.add_mutually_exclusive_group()
    size.add_argument("--quick", action="store_true", help="small sizes: minutes in all")
    size.add_argument("--full", action="store_true", help="the published sizes (the default)")
    made.add_argument("--backend", default="cpu", help="numpy, cpu (default) or cuda")
    made.add_argument("--threads", type=int, help="CPU threads; all by default")
    made.add_argument("--peers", action="store_true", help="also time other programs on the same work")
    made.add_argument("--fresh", action="store_true", help="compute anew what is stored")
    made.add_argument("--json", action="store_true", help="one JSON object on standard output")
    if not in_folders:
        return
    made.add_argument("--results", type=Path, default=Path("results"), help="where results are kept and reused")
    made.add_argument("--figures", type=Path, help="where pictures go; figures, with --quick figures/quick")
    made.add_argument("--only", nargs="+", default=[], metavar="RUN", help="runs whose names start like one of these")
    where = made.add_mutually_exclusive_group()
    where.add_argument("--jobs", type=int, default=1, metavar="N", help="processes for all runs that are not timed")
    where.add_argument("--scheduler", metavar="ADDRESS", help="the same on the workers of a Dask scheduler")


def options_of(given: argparse.Namespace, root: Path = Path()) -> Options:
    """The options of a parsed command line; folders lie under `root` unless they are given."""
    return Options(
        quick=given.quick, backend=given.backend, peers=given.peers, fresh=given.fresh, threads=given.threads,
        results=root / getattr(given, "results", "results"),
        figures=getattr(given, "figures", None) or root / ("figures/quick" if given.quick else "figures"),
        only=tuple(getattr(given, "only", ())), scheduler=getattr(given, "scheduler", None),
    )  # fmt: skip


def listed(given: argparse.Namespace) -> int:
    """What there is: a line for each experiment; of those that are named, everything."""
    known = discover()
    kinds = [name for name in given.names if name in KINDS]
    some = chosen([name for name in given.names if name not in KINDS], known, "experiment or kind")
    for experiment in some:
        parts = judging.contents(experiment, [VERDICT, CLAIM, HARD_CASE, VALUE])
        if not given.names:
            numbers = Counter(kind for kind, _ in parts.values())
            counts = ", ".join(f"{n} {COUNTED[kind]}{'s' * (n > 1)}" for kind, n in numbers.items())
            print(f"{experiment.name:22}  {experiment.title} ({counts})")
            continue
        for name, (kind, about) in parts.items():
            if kind in (kinds or KINDS):
                print(f"{experiment.name:22}  {kind:9}  {name:32}  {about}")
    return EXIT_FINE


COUNTED = dict(zip(KINDS, ("bar", "claim", "hard case", "value")))


def every_picture() -> dict[str, Picture]:
    """All pictures by name: of experiments, of their hard cases and maps."""
    options, known = Options(), discover()
    parts = [part for e in known.values() for part in (e.part(options), judging.trial_part(e, options))]
    return {picture.name: picture for part in parts for picture in part.pictures}


def drawn(given: argparse.Namespace) -> int:
    """Draw pictures from their data."""
    folder, known = Path("figures/quick" if given.quick else "figures"), every_picture()
    names = given.names or [name for name in known if any(folder.glob(f"{name}.json*"))]
    for picture in chosen(names, known, "picture") if names else ():
        print(redraw(picture, folder))
    return EXIT_FINE


def check(given: argparse.Namespace) -> int:
    """Perform checks."""
    if given.write and given.quick:
        raise InputError(f"{given.command}: --write takes the published sizes; leave --quick out.")
    options = options_of(given)
    performed = perform(judging.parts(given.names, given.kind, options), options, given.jobs)
    if CLAIM in given.kind:
        page.keep(performed, options.figures)
    if given.write:
        page.write(judging.claims_of(performed))
    return report_outcome(performed, given.json, written=given.write)


def measure_own_choices(given: argparse.Namespace) -> int:
    """Measure `literal = "paper"` of every system."""
    print(own_choices.write())
    write_file(accuracy_page.PAGE, accuracy_page.page())
    print(accuracy_page.PAGE)
    return EXIT_FINE


def panels(given: argparse.Namespace) -> int:
    """Measure error against time, or draw what is stored."""
    if given.draw:
        print(*accuracy_page.write(), sep="\n")
        return EXIT_FINE
    chosen(given.names, dict(abouts()), "panel")  # names that there are
    return accuracy.perform(given.names, given.backend, given.readings, given.peers, given.write)


def timed(given: argparse.Namespace) -> int:
    """Store times, and make their pages."""
    print(*times.perform(given.files), sep="\n")
    return EXIT_FINE


def verified(given: argparse.Namespace) -> int:
    """Compute published numbers anew."""
    if given.draw is None:
        entries = judging.selected(given.names)
    elif given.names:
        raise InputError("verify: --draw takes no names; leave them out.")
    else:
        seed = int(datetime.date.today().strftime("%Y%m%d")) if given.seed is None else given.seed
        entries = judging.drawn(given.draw, seed)
        print(f"seed {seed}: {', '.join(entry.name for entry in entries)}", file=sys.stderr)
    verdicts = judging.verify(entries, given.jobs, given.threads)
    if given.json:
        named = {e.name: {"published": judging.published(e), "now": c and (c.values or [c.value]), "why": why}
                 for e, c, why in verdicts}  # fmt: skip
        print(json.dumps(finite(named), indent=1, allow_nan=False))
    else:
        print(judging.verified_table(verdicts))
    deviating = [why for _, _, why in verdicts if why]
    print(*deviating, sep="\n", end="\n" if deviating else "", file=sys.stderr)
    return EXIT_FAILED if deviating else EXIT_FINE


def report_outcome(performed: Sequence[Performed], as_object: bool, written: bool = False) -> int:
    """Report, and the exit code; a claim whose verdict has been `written` is on file, and fails no more."""
    report(performed, sys.stderr if as_object else sys.stdout)
    if as_object:
        print(as_json(performed))
    return exit_code([each for each in performed if not (written and each.part.kind == CLAIM)])


@any_letter()
def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns its exit code."""
    try:
        with handling_signals(last=arguments is None):
            given = parser().parse_args(sys.argv[1:] if arguments is None else arguments)
            return given.perform(given)
    except RefsimError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print(INTERRUPTED, file=sys.stderr)
        return EXIT_STOPPED
    except BrokenPipeError:  # the reader of standard output, `head` say, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_FINE


if __name__ == "__main__":
    sys.exit(main())
