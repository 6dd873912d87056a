"""Small parts of studies, and of what a run says."""

import pytest

from refsim.engine import driver
from refsim.study.panels import measured


@pytest.mark.parametrize("seconds, said", [(0.9, 0), (1.1, 1), (1.9, 1)])
def test_compiling_is_told_of_above_a_second(seconds, said, monkeypatch):
    words = []
    monkeypatch.setattr(driver, "say", words.append)
    monkeypatch.setattr(driver, "Bar", lambda until, time: (until, time))
    run = type("Run", (), {"time": 0.25, "timings": type("T", (), {"account": lambda self: {"compiling": seconds}})()})
    shown = driver.Progress.__new__(driver.Progress)
    shown.until = 2.0
    shown._open(run)
    assert (len(words), shown.time, shown.bar) == (said, 0.25, (2.0, 0.25))


def test_what_is_measured_is_told_of_its_machine(monkeypatch):
    monkeypatch.setattr(measured, "machine", lambda: "a processor, 8 cores")
    found = measured._here("numpy")
    assert (found.machine, found.threads, found.device) == ("a processor", 1, "")
