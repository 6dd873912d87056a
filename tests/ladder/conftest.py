"""Inputs that take seconds are made by one of all test processes."""

import functools
import importlib
import os
import pickle

import pytest
from filelock import FileLock

LONG = {  # functions of a case's name and a dtype, by module
    "refsim.boundary.signed_distance.cases": "band_of",
    "refsim.isosurface.cases": "extraction",
    "refsim.surface_energy.cases": "reconstruction",
}


@pytest.fixture(scope="session", autouse=True)
def made_once(tmp_path_factory):
    """The functions of LONG keep what they make in files that all test processes read."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        for module, name in LONG.items():
            cases = importlib.import_module(module)
            setattr(cases, name, kept(getattr(cases, name), tmp_path_factory.getbasetemp().parent))


def kept(function, folder):
    @functools.cache
    def found(*words):
        file = folder / f"{'_'.join((function.__name__, *words))}.pickle"
        with FileLock(f"{file}.lock"):
            if not file.exists():
                file.write_bytes(pickle.dumps(function(*words)))
            return pickle.loads(file.read_bytes())

    return found
