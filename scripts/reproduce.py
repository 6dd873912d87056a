"""Reproduce the papers' experiments, judge them, draw their pictures and write one report.

`--quick`, the main job, runs the dam break with surface detection, the cube that becomes a sphere,
and one small scene of each other system. `--full` (the default) runs every experiment at its published size. Runs that
are not timed run side by side, in as many processes as there are cores (or `--threads`); timed ones run alone. Results
are kept in results/ and reused, so that an interrupted run continues where it stopped. Pictures are in figures/ (quick
ones in figures/quick/), every table and verdict is in results/report.md. Exit code: 0 all well, 2 bad input, 3 a run
stopped, 4 a check failed.
"""

import argparse
import dataclasses
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from refsim.core.errors import RefsimError  # noqa: E402
from refsim.core.stopping import handling_signals  # noqa: E402
from refsim.core.streams import any_letter  # noqa: E402
from refsim.core.tables import columns, fitted  # noqa: E402
from validation import judging  # noqa: E402
from validation.__main__ import add_options, options_of  # noqa: E402
from validation.checks import CLAIM, FAIL  # noqa: E402
from validation.experiment import Experiment, Options, Part, discover  # noqa: E402
from validation.perform import EXIT_FAILED, EXIT_STOPPED, INTERRUPTED, exit_code, machine, perform  # noqa: E402
from validation.report import WIDTH, Whole, as_json, summary, write_page  # noqa: E402

# The main job: runs by experiment, in two groups that are performed one after the other. Other experiments follow with
# --full, which runs all runs of each.
MAIN: tuple[dict[str, tuple[str, ...]], ...] = (
    {
        "dam_break": ("detection_2d", "detection_cost_1", "detection_cost_2", "detection_cost_3"),
        "droplet": ("cube_4913",),
    },
    {
        "dong": ("fall_with", "fall_without"), "mpm_droplet": ("square_cluster",), "melting": ("figure_4",),
        "boundary": ("flow_pour_sphere_difference",),
    },
)  # fmt: skip


def planned(experiments: Mapping[str, Experiment], options: Options) -> list[list[Part]]:
    """The parts to perform, in groups: the main job, with --full all of each experiment and then all others."""
    groups: list[list[Part]] = []
    for group in MAIN:
        parts = []
        for name, keys in group.items():
            if name in experiments:
                part = experiments[name].part(options)
                kept = [run for run in part.runs if run.key in keys or not options.quick]
                parts.append(dataclasses.replace(part, runs=kept))
        groups.append(parts)
    if not options.quick:
        main = {name for group in MAIN for name in group}
        groups.append([each.part(options) for name, each in experiments.items() if name not in main])
    return groups


@any_letter()
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    try:
        with handling_signals(last=arguments is None):
            return reproduced(arguments)
    except RefsimError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print(INTERRUPTED, file=sys.stderr)
        return EXIT_STOPPED


def reproduced(arguments: Sequence[str] | None) -> int:
    """Run, judge, draw and report; returns the exit code."""
    began = time.perf_counter()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser)
    given = parser.parse_args(arguments)
    out = sys.stderr if given.json else sys.stdout
    options = options_of(given, ROOT)
    here = machine()
    jobs = 1 if options.backend == "cuda" else options.threads or here["cores"]
    size = "main job" if options.quick else "published sizes"
    begin = f"The {size} on backend {options.backend}, {jobs} at a time; {here['processor']}"
    print(fitted(begin, min(columns(), WIDTH)), file=out, flush=True)
    pictures: list[Path] = []

    def shown(picture: Path) -> None:
        pictures.append(picture)
        if len(pictures) == 1:
            sys.stderr.flush()
            print(f"\nFirst picture after {time.perf_counter() - began:.0f} s: {picture}", file=out, flush=True)

    experiments = discover()
    first, *then = planned(experiments, options)
    performed = perform(first, options, jobs, shown=shown, then=then)
    claims = judging.claims_of(perform(judging.parts((), [CLAIM], options), options, compute=False))
    title = "refsim: the main job" if options.quick else "refsim: the published sizes"
    titles = {name: each.title for name, each in experiments.items()}
    whole = Whole(title, performed, titles, claims, time.perf_counter() - began, here, options.figures)
    page = write_page(whole, options.results / "report.md")
    print(summary(whole, page), file=out)
    if given.json:
        print(as_json(performed))
    return exit_code(performed) or (EXIT_FAILED if any(check and check.verdict == FAIL for _, check in claims) else 0)


if __name__ == "__main__":
    sys.exit(main())
