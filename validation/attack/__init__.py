"""Attacks on refsim: scenes, damaged files and stores, stops, full disks, libraries; `python -m validation attack`.

A kind of trial is a module of this package with two functions. `make(seed, number)` draws a trial as plain values that
JSON holds; the same two numbers give the same trial. `perform(trial, folder)` carries it out in an empty folder and
returns (outcome, words). Good outcomes are exit codes of the command line in one sentence: "0", "2", "3", and "4" for a
verdict. Every other outcome is a finding: "traceback", "sentence" (an error in more or less than one), "code" (another
exit code than the trial must have), "lost" (a state that was on the disk, or other bits), "silent" (damage without
a message), "hang" and "died" (of the process that performs).
"""

from __future__ import annotations

GOOD = ("0", "2", "3", "4")
BAD = ("traceback", "sentence", "code", "lost", "silent", "hang", "died")
KINDS = {  # name: (trials of a whole campaign, seconds that one may take)
    "scenes": (10_000, 60.0),
    "checkpoints": (4_700, 60.0),
    "caches": (300, 90.0),
    "kills": (200, 120.0),
    "stops": (300, 240.0),
    "stores": (300, 120.0),
    "clusters": (30, 240.0),
    "libraries": (60, 120.0),
    "disk": (60, 120.0),
}
