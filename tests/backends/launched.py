"""Programs in processes that have loaded no kernel yet: copies of one that has imported Numba, so that they start fast.

No bytecode is written: it goes by a source's size and second, and a test edits faster.
"""

import atexit
import multiprocessing
import os
import pathlib
import sys

from numba.core.registry import cpu_target

CONTEXT = multiprocessing.get_context("forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else None)
if CONTEXT.get_start_method() == "forkserver":
    CONTEXT.set_forkserver_preload(["refsim.backends.compile", "tests.backends.launched"])
cpu_target.typing_context.refresh()  # what Numba otherwise does at the first kernel
cpu_target.target_context.refresh()


def run(program, environment, out, err):
    """What such a process does; its output goes to the files `out` and `err`."""
    os.environ.clear()
    os.environ.update(environment)
    sys.dont_write_bytecode = True
    sys.path[:0] = environment["PYTHONPATH"].split(os.pathsep)
    for number, path in ((1, out), (2, err)):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT), number)
    try:
        exec(compile(program, "<string>", "exec"), {"__name__": "__main__"})
    finally:
        atexit._run_exitfuncs()  # multiprocessing leaves them out


class Launch:
    """A program that has been started."""

    def __init__(self, program, environment, folder):
        number = len(list(folder.glob("*.out")))
        self.out, self.err = folder / f"{number}.out", folder / f"{number}.err"
        self.out.touch()
        self.process = CONTEXT.Process(target=run, args=(program, environment, self.out, self.err))
        self.process.start()

    def ended(self):
        """(exit code, standard output, standard error)."""
        self.process.join()
        return self.process.exitcode, self.out.read_text(), self.err.read_text()


def launch(folder, program, **variables):
    """Start a program in a folder, whose packages it can import, with a compile cache in it."""
    root = pathlib.Path(__file__).parents[2]
    places = [str(folder), str(root), os.environ.get("PYTHONPATH", "")]
    own = {"REFSIM_CACHE_DIR": str(folder / "cache"), "PYTHONPATH": os.pathsep.join(places)}
    return Launch(program, os.environ | own | {"PYTHONDONTWRITEBYTECODE": "1"} | variables, folder)
