"""`refsim schema`: the JSON schema of scene files, for editors that complete and check TOML."""

import argparse
import json

from refsim.commands import CommandResult, command
from refsim.scene.files import scene_schema


@command("schema", "print the JSON schema of scene files")
def execute(options: argparse.Namespace) -> CommandResult:
    """Print the schema."""
    schema = scene_schema()
    return CommandResult(schema, json.dumps(schema, indent=1))
