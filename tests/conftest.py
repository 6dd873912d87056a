"""How many processes share the tests."""

import os

MOST = 4


def pytest_xdist_auto_num_workers(config):
    """One for each core, at most four; what is named on the command line runs in this one, for the debugger."""
    named = config.option.keyword or any("::" in path or path.endswith(".py") for path in config.args)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return 0 if named or cores == 1 else min(MOST, cores)
