"""The command line: `refsim doctor | list | plan | run | schema | contract` and other modules of `refsim.commands`.

Exit codes: 0 all well, 2 bad input, 3 the run stopped with a named reason, 4 a verdict failed. With --json one
object goes to standard output and everything else to standard error.
"""

import argparse
import dataclasses
import json
import os
import re
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, NoReturn

from refsim.backends.threads import check_number
from refsim.commands import COMMANDS, CommandResult, discover, plain
from refsim.core.checked import suggestion
from refsim.core.clock import PROCESS, Seconds
from refsim.core.errors import InputError, RefsimError, RunStopped, refused
from refsim.core.stopping import handling_signals
from refsim.core.streams import any_letter
from refsim.core.tables import columns, fitted
from refsim.core.terminal import Bar, say
from refsim.core.versions import version


class _Parser(argparse.ArgumentParser):
    """Errors in one sentence, as for all other bad input; "-90,8" is a value, not an option."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        self._negative_number_matcher = re.compile(r"-[\d.][\d.,e+-]*$")

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message}; see {self.prog} --help.")


def make_parser() -> argparse.ArgumentParser:
    """The parser with every command that there is."""
    parser = _Parser(prog="refsim", description="Reference implementations of published particle-fluid methods.")
    parser.add_argument("--version", action="store_true", help="print the version and stop")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", title="commands")
    for name, command in COMMANDS.items():
        sub = subparsers.add_parser(name, help=command.summary, description=command.description or command.summary)
        sub.add_argument("--json", action="store_true", help="one JSON object on standard output, the rest elsewhere")
        command.configure(sub)
    return parser


@any_letter()
def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    whole = arguments is None  # the process ends with the command
    began = PROCESS if whole else Seconds.now()
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    as_json = "--json" in arguments
    try:
        with handling_signals(last=whole):
            outcome = _execute(arguments, began)
            if as_json:
                _tell(json.dumps(plain(outcome.data), indent=1, allow_nan=False))
            elif outcome.text:
                text = outcome.text.rstrip("\n")
                _tell(text if outcome.verbatim else fitted(text, columns()))
        return outcome.code
    except RefsimError as error:
        return _failed(error, as_json)
    except KeyboardInterrupt:
        return _failed(RunStopped("interrupted", "Interrupted; what was written before is whole."), as_json)
    except MemoryError:
        return _failed(RunStopped("out_of_memory", "No memory is left; take fewer particles."), as_json)
    except BrokenPipeError:  # the reader has closed standard output, as in `refsim list | head`
        _leave_output()
        return 0
    except OSError as error:
        return _failed(refused(error), as_json)


def _tell(text: str, end: str = "\n") -> None:
    """Text for standard output. Raises RunStopped("disk_full") or InputError where it cannot be written."""
    try:
        print(text, end=end, flush=True)
    except BrokenPipeError:
        raise
    except OSError as error:
        _leave_output()
        raise refused(error, "standard output, after all else was done") from error


def _leave_output() -> None:
    """Write nothing more to standard output, so that what is still to be written there is lost without words."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _execute(arguments: Sequence[str], began: Seconds) -> CommandResult:
    check_number()
    discover()
    parser = make_parser()
    word = next((a for a in arguments if not a.startswith("-")), None)
    if word is not None and word not in COMMANDS:
        raise InputError(f"there is no command {word!r}; {suggestion(word, COMMANDS)}")
    try:
        options, unknown = parser.parse_known_args(arguments)
    except SystemExit:  # after --help
        _tell("", end="")
        raise
    if hasattr(options, "names") and isinstance(options.names, list):  # names may stand behind options, too
        options.names += [word for word in unknown if not word.startswith("-")]
        unknown = [word for word in unknown if word.startswith("-")]
    if unknown:
        command = f"{parser.prog} {options.command}" if options.command else parser.prog
        raise InputError(f"unrecognized arguments: {' '.join(unknown)}; see {command} --help.")
    if options.version:
        return CommandResult({"version": version()}, f"refsim {version()}")
    if options.command is None:
        return CommandResult({"commands": {name: c.summary for name, c in COMMANDS.items()}}, parser.format_help())
    options.began = began
    return COMMANDS[options.command].execute(options)


def _failed(error: RefsimError, as_json: bool) -> int:
    sentence = " ".join(str(error).split())
    sentence += "" if sentence.endswith((".", "?", "!")) else "."
    reason = getattr(error, "reason", None)
    Bar.end_line()
    with suppress(OSError):  # of a terminal that has closed
        say(f"refsim: {sentence}" + (f" [{reason}]" if reason else ""), "red")
        for line in getattr(error, "advice", ()):
            print(f"  {line}", file=sys.stderr)
    if as_json:
        failure: dict[str, Any] = {"error": sentence, "reason": reason or "bad_input", "exit_code": error.exit_code}
        report = getattr(error, "report", None)
        if report is not None:
            failure["report"] = plain(dataclasses.asdict(report))
        with suppress(OSError, RefsimError):
            _tell(json.dumps(failure, indent=1, allow_nan=False))
    return error.exit_code


if __name__ == "__main__":
    sys.exit(main())
