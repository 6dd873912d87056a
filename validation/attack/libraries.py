"""Libraries that break what judges them, for `refsim contract`: each has the ending that the command must give it.

Beside the broken program each library has a sound one, which must hold.
"""

from __future__ import annotations

import json
import random
import re
import subprocess
from pathlib import Path
from typing import Any

from validation.attack.commands import apart, ill, last_lines, verdict

SOUND = "def gravity(field, acceleration):\n    acceleration += field\n"
PROGRAMS = "PROGRAMS = {'sph.state': broken, 'sph.gravity': gravity}\n"
STATE = "density, fluid, pressure"
LIMIT = "3"

# name: (what stands at the head of the module, body of the program for sph.state, code, words)
AT_IMPORT = {
    "exit 0": ("import sys; sys.exit(0)", "SystemExit"),
    "exit text": ("raise SystemExit('all is well')", "SystemExit: all is well"),
    "os._exit 0": ("import os; os._exit(0)", "ended its process .exit code 0."),
    "os._exit 3": ("import os; os._exit(3)", "ended its process .exit code 3."),
    "segfault": ("import ctypes; ctypes.string_at(0)", "signal SIGSEGV"),
    "abort": ("import os; os.abort()", "signal SIGABRT"),
    "endless loop": ("while True: pass", "its import did not end"),
    "sleep": ("import time; time.sleep(1000)", "its import did not end"),
    "endless loop in C": ("import ctypes; ctypes.PyDLL(None).pause()", "its import did not end"),
    "reads standard input": ("input()", "EOFError"),
    "KeyboardInterrupt": ("raise KeyboardInterrupt", "KeyboardInterrupt"),
    "an exception of no class": ("class E(BaseException): pass\nraise E", "cannot be imported: E"),
    "an exception without words": (
        "class E(Exception):\n    def __str__(self): return 1 / 0\nraise E",
        "E: no message",
    ),
    "an exception of a megabyte": ("raise ValueError('x' * 1000000)", "ValueError"),
    "surrogates in an exception": ("raise ValueError('\\udcff\\x1b[2J')", "ValueError"),
    "syntax": ("def def", "SyntaxError"),
    "nul bytes": ("\0", "SyntaxError|null bytes"),
    "recursion": ("def f(): f()\nf()", "RecursionError"),
    "kills itself": ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "signal SIGKILL"),
    "stops itself": ("import os, signal; os.kill(os.getpid(), signal.SIGSTOP)", "its import did not end"),
}
IN_A_PROGRAM = {
    "sys.exit": ("import sys; sys.exit(0)", "it raised SystemExit"),
    "os._exit": ("import os; os._exit(0)", "ended its process .exit code 0."),
    "segfault": ("import ctypes; ctypes.string_at(0)", "signal SIGSEGV"),
    "abort": ("import os; os.abort()", "signal SIGABRT"),
    "endless loop": ("while True: pass", "did not return within"),
    "stops itself": ("import os, signal; os.kill(os.getpid(), signal.SIGSTOP)", "did not return within"),
    "raises": ("raise ValueError('no')", "it raised ValueError: no"),
    "KeyboardInterrupt": ("raise KeyboardInterrupt", "KeyboardInterrupt"),
    "recursion": ("return broken(density, fluid, pressure)", "RecursionError"),
    "no memory": ("import numpy; numpy.ones(10**14)", "Memory"),
    "shape": ("return pressure[:1].repeat(7)", "of shape .7,."),
    "dtype": ("return pressure.astype('f2')", "as float16"),
    "byte order": ("return pressure.astype(pressure.dtype.newbyteorder())", "wanted is"),
    "a list": ("return pressure.tolist()", "as list"),
    "a generator": ("yield 1", "as generator"),
    "a mapping that raises": (
        "import collections.abc as c\n"
        "    class M(c.Mapping):\n"
        "        def __getitem__(self, k): return 1 / 0\n"
        "        def __iter__(self): return 1 / 0\n"
        "        def __len__(self): return 1 / 0\n"
        "    return M()",
        "its answer raised ZeroDivisionError",
    ),
    "input destroyed": ("density[...] = -1", "it changed its input density|no trial"),
    "behind the end": (
        "import ctypes; ctypes.memset(pressure.ctypes.data + pressure.nbytes, 0, 64)",
        "it wrote behind the end of pressure",
    ),
    "before the start": (
        "import ctypes; ctypes.memset(pressure.ctypes.data - 64, 0, 64)",
        "before the start of pressure",
    ),
    "nothing": ("pass", ""),
    "NaN": ("pressure[...] = float('nan')", ""),
    "closes every descriptor": ("import os; os.closerange(3, 100)", "ended its process|closed the pipe|ended its step"),
    "writes into every descriptor": (
        "import os\n    for k in range(3, 60):\n        try: os.write(k, b'xxxx' * 5)\n        except OSError: pass",
        "ended its process|disturbed|closed the pipe",
    ),
    "breaks NumPy": ("import numpy; numpy.zeros = numpy.full = None", "ended its step by|raised"),
}
HARMLESS = {
    "prints": ("print('x' * 100000)", ""),
    "changes the error state": ("import numpy; numpy.seterr(all='raise')", ""),
    "changes warnings": ("import warnings; warnings.simplefilter('error')", ""),
    "forks": ("import os\n    if os.fork() == 0: import time; time.sleep(10)", ""),
    "copies the process": ("import os; os.fork()", ""),
    "leaves threads": ("import threading, time; threading.Thread(target=time.sleep, args=(10,)).start()", ""),
    "changes the folder": ("import os; os.chdir('/')", ""),
    "closes standard output": ("import sys; sys.stdout.close()", ""),
    "an exit handler": ("import atexit, time; atexit.register(time.sleep, 10)", ""),
}
TABLES = {
    "no mapping": ("PROGRAMS = 3\n", "give a mapping"),
    "a mapping of numbers": ("PROGRAMS = {3: gravity}\n", "is not an operation"),
    "no function": ("PROGRAMS = {'sph.gravity': 3}\n", "give a function"),
    "a parameter too many": ("PROGRAMS = {'sph.gravity': lambda field, weight: 1}\n", "takes weight"),
    "an endless mapping": (
        "import collections.abc as c, itertools\n"
        "class M(c.Mapping):\n"
        "    def __getitem__(self, k): return gravity\n"
        "    def __iter__(self): return map(str, itertools.count())\n"
        "    def __len__(self): return 1\n"
        "PROGRAMS = M()\n",
        "did not end|no operation",
    ),
    "strange dtypes": (
        "from refsim.contract import Programs\nPROGRAMS = Programs({'sph.gravity': gravity}, dtypes=3)\n",
        "is no sequence; give a tuple",
    ),
}


def kinds() -> list[tuple[str, str]]:
    """(group, name) of every library."""
    groups = {"import": AT_IMPORT, "program": IN_A_PROGRAM, "harmless": HARMLESS, "table": TABLES}
    return [(group, name) for group, members in groups.items() for name in members]


def make(seed: int, number: int) -> dict[str, Any]:
    """The kinds in turn."""
    order = kinds()
    random.Random(f"libraries {seed}").shuffle(order)
    group, name = order[number % len(order)]
    return {"group": group, "name": name}


def perform(trial: dict[str, Any], folder: Path) -> tuple[str, str]:
    """Judge the library by the command, and the command by what it says."""
    group, name = trial["group"], trial["name"]
    body = "pass"
    if group == "import":
        head, words = AT_IMPORT[name]
        text = f"{head}\n{SOUND}PROGRAMS = {{'sph.gravity': gravity}}\n"
    elif group == "table":
        table, words = TABLES[name]
        text = f"{SOUND}{table}"
    else:
        body, words = {**IN_A_PROGRAM, **HARMLESS}[name]
        right = "" if group == "program" else f"    RIGHT({STATE})\n"
        head = "from refsim.core.operation import REGISTRY\nRIGHT = REGISTRY['sph.state'].program('cpu').py_func\n"
        text = f"{head}{SOUND}def broken({STATE}):\n    {body}\n{right}{PROGRAMS}"
    (folder / "library.py").write_text(text)
    options = ("--step", "T1", "--step", "T7", "--dtype", "float64", "--time-limit", LIMIT, "--json")
    process = apart(["contract", str(folder / "library.py"), *options])
    try:
        out, err = process.communicate(timeout=100)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return "hang", "no end within 100 s"
    quiet = "\n".join(line for line in err.splitlines() if line.startswith("refsim: ") or "refsim/" in line)
    outcome, said = verdict(process.returncode, quiet)
    wanted = {"import": "2", "table": "2", "program": "4", "harmless": "0"}[group]
    if outcome != wanted:
        return ill(outcome, "code"), f"{outcome} and not {wanted}: {said} {last_lines(err)}"
    if group in ("import", "table"):
        return (outcome, said) if re.search(words, said) else ("sentence", said)
    operations = json.loads(out)["operations"]
    if not operations["sph.gravity"]["holds"]:
        return "lost", f"the sound program beside it was not judged well: {operations['sph.gravity']}"
    told = " ".join(o["words"] for o in operations["sph.state"]["outcomes"])
    return (outcome, last_lines(told)) if re.search(words, told) else ("sentence", last_lines(told))
