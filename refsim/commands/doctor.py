"""`refsim doctor`: what is installed, which backends run here, and whether their results are right."""

import argparse
import contextlib
import platform
import traceback
from typing import Any

from refsim.backends.arrays import host_memory, simulated, unavailable
from refsim.backends.fast.private import lost
from refsim.backends.threads import cores
from refsim.commands import CommandResult, command, in_bytes, in_time, table
from refsim.contract import run
from refsim.core.errors import RefsimError
from refsim.core.operation import BACKENDS
from refsim.core.versions import versions

TESTED, CASE, DTYPE = "sph.density", "cloud_3d", "float32"


@command("doctor", "check the installation and every backend")
def execute(options: argparse.Namespace) -> CommandResult:
    """Collect versions and hardware, test each backend that can run, and give one verdict."""
    backends = {name: unavailable(name) for name in BACKENDS}
    report: dict[str, Any] = {
        "versions": versions(),
        "system": f"{platform.system()} {platform.machine()}",
        "cores": cores(),
        "memory": host_memory(),
        "cache": _cache(),
        "backends": {name: {"available": reason is None, "reason": reason} for name, reason in backends.items()},
        "gpu": _gpu() if backends["cuda"] is None else None,
        "self_test": {name: _self_test(name) for name, reason in backends.items() if reason is None},
    }
    report["threads"] = _threads()
    report["private_names"] = lost()  # known after the self-test has launched kernels
    tests = report["self_test"]
    stopped = [name for name, test in tests.items() if "why" in test]
    wrong = [name for name, test in tests.items() if test["verdict"] != "pass" and name not in stopped]
    working = [name for name in tests if name not in (*stopped, *wrong)]
    absent = [name for name, reason in backends.items() if reason is not None]
    faults = [f"backend {name} stops with an error in the self-test: {tests[name]['why']}" for name in stopped]
    if wrong:
        faults.append(f"backend {' and '.join(wrong)} computes wrong numbers here; do not use it")
    passed = f"pass: {', '.join(working)} {'work' if len(working) > 1 else 'works'}"
    passed += f"; {' and '.join(absent)} cannot run here" if absent else ""
    report["verdict"] = f"fail: {'; '.join(faults)}" if faults else passed
    return CommandResult(report, _text(report), 4 if faults else 0)


def _self_test(backend: str) -> dict[str, Any]:
    """One operation against its reference: the largest error over the bound of the contract, the verdict."""
    told: dict[str, Any] = {"operation": TESTED, "case": CASE, "dtype": DTYPE}
    try:
        outcome = run(TESTED, backend, DTYPE, CASE)
    except RefsimError as error:
        return told | {"verdict": "fail", "why": str(error).rstrip(".")}
    except Exception as error:  # any error of a broken installation is reported
        last = traceback.extract_tb(error.__traceback__)[-1]
        message = " ".join(f"{type(error).__name__}: {error}".split())
        return told | {"verdict": "fail", "why": f"{message} ({last.filename}, line {last.lineno})"}
    verdict = "pass" if outcome.passed else "fail"
    return told | {"error_over_bound": outcome.error, "verdict": verdict, "seconds": outcome.seconds}


def _threads() -> dict[str, Any]:
    import numba

    from refsim.backends import compile as compiler

    assert compiler  # it chooses the threading layer
    try:
        layer = numba.threading_layer()
    except ValueError:  # no parallel loop has run
        layer = f"{numba.config.THREADING_LAYER} (not started)"
    return {"most": int(numba.config.NUMBA_NUM_THREADS), "layer": layer}


def _cache() -> dict[str, Any]:
    from refsim.backends.cache import cache_root, is_writable

    root = cache_root()
    files = [p for p in root.rglob("*") if p.is_file()] if root.is_dir() else []
    size = 0
    for path in files:
        with contextlib.suppress(OSError):  # another process has just deleted it
            size += path.stat().st_size
    return {"folder": str(root), "bytes": size, "files": len(files), "writable": is_writable()}


def _gpu() -> dict[str, Any]:
    if simulated():
        return {"name": "CUDA simulator"}
    from refsim.backends.compile import cuda

    device = cuda.get_current_device()
    name = device.name.decode() if isinstance(device.name, bytes) else str(device.name)
    free, total = cuda.current_context().get_memory_info()
    driver, capability = (".".join(map(str, v)) for v in (cuda.runtime.get_version(), device.compute_capability))
    told = {"name": name, "compute_capability": capability, "memory": {"total": int(total), "free": int(free)}}
    return told | {"cuda_runtime": driver}


def _free(memory: dict[str, Any]) -> str:
    return f"{in_bytes(memory['free'])} free of {in_bytes(memory['total'])}"


def _text(report: dict[str, Any]) -> str:
    cache, memory, threads = report["cache"], report["memory"], report["threads"]
    lacking = "" if cache["writable"] else "; not writable: kernels are compiled anew in every process"
    rows = [
        *report["versions"].items(),
        ("system", report["system"]),
        ("threads", f"up to {threads['most']} on {report['cores']} cores, layer {threads['layer']}"),
        ("memory", _free(memory) if memory["total"] else "not known here"),
        ("cache", f"{cache['folder']}, {in_bytes(cache['bytes'])}{lacking}"),
    ]
    if report["gpu"]:
        gpu = report["gpu"]
        rows.append(("GPU", ", ".join(f"{k} {v}" if k != "name" else str(v) for k, v in gpu.items() if k != "memory")))
        if "memory" in gpu:
            rows.append(("GPU memory", _free(gpu["memory"])))
    lines = [table(rows), "", "Backends"]
    outcomes = []
    for name, state in report["backends"].items():
        test = report["self_test"].get(name)
        if test is None:
            outcomes.append((name, "not available", state["reason"]))
        elif "why" in test:
            outcomes.append((name, "FAILS", "see the verdict"))
        else:
            share = f"{test['error_over_bound']:.2g} of the largest error that rounding explains"
            note = f"{test['operation']}, case {test['case']}: {share}, {in_time(test['seconds'])}"
            verdict = "works" if test["verdict"] == "pass" else "WRONG"
            outcomes.append((name, verdict, "the reference for the others" if name == "numpy" else note))
    outcomes += [("note", "", sentence) for sentence in report["private_names"].values()]
    return "\n".join([*lines, table(outcomes), "", f"Verdict: {report['verdict']}."])
