"""What functions of the host code give, by the lines of recorded_calls.toml: expressions in the names of a module."""

import importlib
import pathlib
import tomllib
import zlib
from types import SimpleNamespace

import numpy as np
import pytest

import refsim as rs
from refsim.core.effect import Discretisation
from refsim.core.errors import RefsimError

CALLS = tomllib.loads(pathlib.Path(__file__).with_name("recorded_calls.toml").read_text(encoding="utf-8"))
GRID = {"dim": 3, "dtype": "float64", "spacing": 0.1, "support_radius": 0.21, "count": 3}
SHARED = {
    "rs": rs, "np": np, "Some": SimpleNamespace, "grid": lambda **given: Discretisation(**GRID | given),
    "effects": lambda *made: {effect.name: effect for effect in made}, "code": lambda text: zlib.crc32(text.encode()),
}  # fmt: skip


@pytest.mark.parametrize("module", CALLS)
def test_calls_give_what_they_ever_gave(module, recorded):
    made = importlib.import_module(module)
    names = vars(made) | SHARED

    def given(line):
        try:
            return eval(line, names)
        except RefsimError as error:
            return type(error).__name__, str(error).replace(str(pathlib.Path(rs.__file__).parent), "")

    for name, line in CALLS[module].get("with", {}).items():
        names[name] = eval(line, names)
    recorded({line: given(line) for line in CALLS[module]["calls"]})
