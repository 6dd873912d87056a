"""The command line: `refsim doctor | list | plan | run | schema | contract` and other modules of `refsim.commands`.

Exit codes: 0 all well, 2 bad input, 3 the run stopped with a named reason, 4 a verdict failed. With --json one
object goes to standard output and everything else to standard error.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

from refsim.commands import COMMANDS, CommandResult, discover, plain
from refsim.core.checked import suggestion
from refsim.core.errors import InputError, RefsimError, RunStopped


class _Parser(argparse.ArgumentParser):
    """Errors in one sentence, as for all other bad input."""

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


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    as_json = "--json" in arguments
    try:
        outcome = _execute(arguments)
    except RefsimError as error:
        return _failed(error, as_json)
    except KeyboardInterrupt:
        return _failed(RunStopped("interrupted", "Interrupted; what was written before is whole."), as_json)
    except MemoryError:
        return _failed(RunStopped("out_of_memory", "No memory is left; take fewer particles."), as_json)
    except BrokenPipeError:
        return _closed()
    try:
        if as_json:
            print(json.dumps(plain(outcome.data), indent=1, allow_nan=False))
        elif outcome.text:
            print(outcome.text.rstrip("\n"))
        sys.stdout.flush()
    except BrokenPipeError:
        return _closed()
    return outcome.code


def _execute(arguments: Sequence[str]) -> CommandResult:
    discover()
    parser = make_parser()
    word = next((a for a in arguments if not a.startswith("-")), None)
    if word is not None and word not in COMMANDS:
        raise InputError(f"there is no command {word!r}; {suggestion(word, COMMANDS)}")
    options, unknown = parser.parse_known_args(arguments)
    if unknown:
        command = f"{parser.prog} {options.command}" if options.command else parser.prog
        raise InputError(f"unrecognized arguments: {' '.join(unknown)}; see {command} --help.")
    if options.version:
        import refsim

        return CommandResult({"version": refsim.__version__}, f"refsim {refsim.__version__}")
    if options.command is None:
        return CommandResult({"commands": {name: c.summary for name, c in COMMANDS.items()}}, parser.format_help())
    return COMMANDS[options.command].execute(options)


def _failed(error: RefsimError, as_json: bool) -> int:
    sentence = " ".join(str(error).split())
    sentence += "" if sentence.endswith((".", "?", "!")) else "."
    reason = getattr(error, "reason", None)
    print(f"refsim: {sentence}" + (f" [{reason}]" if reason else ""), file=sys.stderr)
    for line in getattr(error, "advice", ()):
        print(f"  {line}", file=sys.stderr)
    if as_json:
        found: dict[str, Any] = {"error": sentence, "reason": reason or "bad_input", "exit_code": error.exit_code}
        report = getattr(error, "report", None)
        if report is not None:
            found["report"] = plain(dataclasses.asdict(report))
        print(json.dumps(found, indent=1, allow_nan=False))
    return error.exit_code


def _closed() -> int:
    """The reader has closed standard output (`refsim list | head`): end without a message."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


if __name__ == "__main__":
    sys.exit(main())
