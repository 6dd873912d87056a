"""`refsim schema`: the JSON schema of scene files, for editors that complete and check TOML."""

from __future__ import annotations

import argparse
import json

from refsim.commands import Command, CommandResult, register
from refsim.scene.files import scene_schema


def configure(parser: argparse.ArgumentParser) -> None:
    """No arguments of its own."""


def execute(options: argparse.Namespace) -> CommandResult:
    """Print the schema."""
    schema = scene_schema()
    return CommandResult(schema, json.dumps(schema, indent=1))


register(Command("schema", "print the JSON schema of scene files", configure, execute))
