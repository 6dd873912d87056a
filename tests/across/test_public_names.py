"""What docs/public_names.md promises, name by name; `scene.schema.json` holds the keys of scene files.

Run as a program, this file writes `public_names.txt` anew. CHANGELOG.md then names what changed.
"""

import argparse
import difflib
import inspect
import pathlib
import re

import msgspec

import refsim
from refsim.__main__ import make_parser
from refsim.commands import discover
from refsim.core import errors

STORED = pathlib.Path(__file__).with_name("public_names.txt")


def call(name, function):
    """The name with its arguments and defaults. Types are left out: their text differs between versions of Python."""
    signature = inspect.signature(function)
    arguments = [argument.replace(annotation=inspect.Parameter.empty) for argument in signature.parameters.values()]
    shown = f"{name}{signature.replace(parameters=arguments, return_annotation=inspect.Signature.empty)}"
    return re.sub(r"<function <lambda> at \w+>", "...", shown)


def python_names():
    for name in refsim.__all__:
        thing = getattr(refsim, name)
        if inspect.ismodule(thing) or not callable(thing):
            yield name
            continue
        raised = inspect.isclass(thing) and issubclass(thing, Exception)  # refsim raises them
        yield name if raised else call(name, thing)
        settings = inspect.isclass(thing) and issubclass(thing, msgspec.Struct)  # its attributes are its arguments
        bases = thing.__mro__ if inspect.isclass(thing) and not settings else ()
        own = {part for base in bases if base.__module__.startswith("refsim") for part in vars(base)}
        for part in sorted(own):
            value = getattr(thing, part, None)
            if not part.startswith("_"):
                yield call(f"  .{part}", value) if inspect.isfunction(value) else f"  .{part}"


def command_line():
    discover()
    for action in make_parser()._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, command in sorted(action.choices.items()):
                yield f"refsim {name}"
                for option in command._actions:
                    yield "  " + (", ".join(option.option_strings) or option.dest)


def listing():
    return "\n".join((*python_names(), "", *command_line(), "", "why a run stops", *sorted(errors.REASONS), ""))


def test_public_names_are_those_that_are_stored():
    stored, found = STORED.read_text(encoding="utf-8").splitlines(), listing().splitlines()
    changed = list(difflib.unified_diff(stored, found, "public_names.txt", "refsim", lineterm="", n=0))
    assert not changed, "what docs/public_names.md promises has changed:\n" + "\n".join(changed)


if __name__ == "__main__":
    STORED.write_text(listing(), encoding="utf-8")
