"""Whether tests notice errors in host code: every sign, factor, condition, operand and index is altered once.

A slip that no test notices is a gap, unless it changes nothing: those stand in host_slips.HARMLESS, with reasons.
"""

import importlib.util
import json
import os
import pathlib
import subprocess
import sys

import pytest

SLIPS = pathlib.Path(__file__).with_name("host_slips.py")
spec = importlib.util.spec_from_file_location("host_slips", SLIPS)
host_slips = sys.modules.setdefault(spec.name, importlib.util.module_from_spec(spec))
spec.loader.exec_module(host_slips)
QUICK = ("reports", "ledgers")


def verdict(group):
    environment = dict(os.environ, NUMBA_DISABLE_JIT="1")
    done = subprocess.run([sys.executable, SLIPS, group], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)[group]
    assert sum(found["caught"].values()) > 10
    gaps = [slip for slip in found["survived"] if host_slips.harmless(slip) is None]
    assert not gaps, "not noticed:\n" + "\n".join(gaps)
    return found


@pytest.mark.parametrize("group", QUICK)
def test_slips_in_reports_and_ledgers_are_noticed(group):
    verdict(group)


@pytest.mark.slow
@pytest.mark.parametrize("group", [group for group in host_slips.GROUPS if group not in QUICK])
def test_slips_in_host_code_are_noticed(group):
    verdict(group)


@pytest.mark.slow
def test_the_published_numbers_are_those_of_these_sources():
    """As many slips in each group as the record says; renew it with `python tests/ladder/host_slips.py --publish`."""
    record = json.loads(host_slips.RECORD.read_text())["groups"]
    assert list(record) == list(host_slips.GROUPS)
    for group, places in host_slips.GROUPS.items():
        functions = [host_slips.parsed(host_slips.found(place)) for place in places]
        assert sum(record[group]["planted"].values()) == sum(len(list(host_slips.sites(tree))) for tree in functions)


def test_the_page_shows_the_record():
    record = json.loads(host_slips.RECORD.read_text())
    assert host_slips.table(record) in host_slips.PAGE.read_text()


def test_what_is_harmless_is_still_there():
    """Every slip that is said to change nothing is one that can be made."""
    for place, lines in host_slips.HARMLESS.items():
        function = host_slips.found(place)
        made = [host_slips.altered(function, *site[1:])[1] for site in host_slips.sites(host_slips.parsed(function))]
        for start, _ in lines:
            assert any(words.startswith(start) for words in made), f"{place}: {start}"
