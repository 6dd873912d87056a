"""Stored times and their pages: `python -m validation times [FILE ...]`.

FILE is what `pytest tests/times/bench_*.py --benchmark-json FILE` wrote. Its readings go into `times.json`, and the
tables and the picture of docs/study.md are made of what is stored there; without a file
nothing but the page is renewed. A kernel's benchmark stands on no page.
"""

import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from refsim.core.errors import InputError
from refsim.core.writing import write_file
from refsim.study.advice import scattered
from validation import timed
from validation.filling import replaced
from validation.limits import STEP_KERNELS, Work, least
from validation.timed import ladders

ROOT = Path(__file__).resolve().parent.parent
STORED = ROOT / "validation" / "times.json"
DOCS, FIGURES = ROOT / "docs", ROOT / "figures"
SIZES = ("60k", "1M", "8M")
NOT_YET = "not measured yet"
Times = Mapping[str, Mapping[str, Any]]  # by page and backend: {"machine", "readings": {name: {"seconds", ...}}}


# The store


def stored() -> dict[str, Any]:
    """What is on file, by page and backend."""
    return json.loads(STORED.read_text(encoding="utf-8")) if STORED.exists() else {}  # type: ignore[no-any-return]


def read(file: Path) -> dict[str, Any]:
    """The readings of a file of pytest-benchmark, as they are stored. Raises InputError for another file."""
    try:
        whole = json.loads(file.read_text(encoding="utf-8"))
        where, commit = whole["machine_info"], whole["commit_info"]
        about = {"date": whole["datetime"][:10], "commit": commit["id"][:10] + "+" * bool(commit.get("dirty"))}
        by_key: dict[str, Any] = {}
        for bench in whole["benchmarks"]:
            extra = dict(bench["extra_info"])
            page, backend, name = extra.pop("page"), extra.pop("backend"), extra.pop("name")
            machine = where["processor"] if backend != "cuda" else (where["device"] or {"name": "simulator"})["name"]
            row = by_key.setdefault(f"{page} {backend}", {"machine": machine, "cores": where["cores"], "readings": {}})
            row["readings"][name] = {"seconds": bench["stats"]["data"], **extra, **about}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"times: {file} holds no benchmarks of tests/times ({error}); write it with --benchmark-json."
        ) from error
    return {key: part for key, part in by_key.items() if not key.startswith("kernels ")}


def merged(before: Times, newer: Times) -> dict[str, Any]:
    """The store with new readings. Raises InputError where another machine measured a part of a table only."""
    made = {key: dict(part) for key, part in before.items()}
    for key, part in newer.items():
        kept = made.get(key, {"readings": {}})
        missing = set(kept["readings"]) - set(part["readings"])
        if missing and kept["machine"] != part["machine"]:
            raise InputError(
                f"times: {key} was measured on {kept['machine']}, and here {len(missing)} of its readings are missing;"
                " measure them all."
            )
        made[key] = {**part, "readings": {**kept["readings"], **part["readings"]}}
    return made


def readings(times: Times, key: str) -> dict[str, Any]:
    """Readings of a page on a backend by name."""
    return dict(times[key]["readings"]) if key in times else {}


def where(times: Times, key: str, more: str = "") -> str:
    """Machine and dates of readings."""
    dates = sorted({reading["date"] for reading in readings(times, key).values()})
    return f"{times[key]['machine']}{more}, {' to '.join(dict.fromkeys((dates[0], dates[-1])))}" if dates else NOT_YET


def median(reading: Mapping[str, Any]) -> float:
    """Median seconds of one call, of as many as a reading holds."""
    return float(np.median(reading["seconds"])) / reading.get("calls", 1) / reading.get("steps", 1)


def table(heading: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """A Markdown table."""
    rule = "| --- |" + " --: |" * (len(heading) - 1)
    return [f"| {' | '.join(heading)} |", rule, *(f"| {' | '.join(row)} |" for row in rows)]


# Effects


def planned(backend: str) -> dict[str, dict[str, Any]]:
    """What its plan says of each rung of the ladders."""
    rungs = {f"{name}: {rung.words}": rung.scene for name, ladder in ladders().items() for rung in ladder.rungs}
    return {name: timed.planned(scene, backend) for name, scene in rungs.items()}


def span(seconds: Sequence[float]) -> str:
    """Range of readings [us], two digits: more would say that they repeat."""
    return " to ".join(f"{float(f'{1e6 * value:.2g}'):,.0f}" for value in (min(seconds), max(seconds)))


def microseconds(seconds: Sequence[float]) -> str:
    """Median of a step [us]; the range of the readings behind a circle where it has not settled."""
    return f"\u25cb {span(seconds)}" if scattered(seconds) else f"{1e6 * float(np.median(seconds)):,.0f}"


def effects(times: Times) -> list[str]:
    """Table of what each effect costs, a ladder below the other."""
    plan_of = planned("cpu")
    cpu, gpu = readings(times, "effects cpu"), readings(times, "effects cuda")
    heading = ["scene", "operations, CPU", "kernels, GPU", "bytes a particle, CPU", "step [us], 2 CPU threads"]
    heading += ["step [us], GPU"]
    rows = []
    for name, ladder in ladders().items():
        particles = plan_of[f"{name}: {ladder.rungs[0].words}"]["particles"]
        rows.append([f"**{ladder.words}**, {particles:,} particles of liquid", *[""] * (len(heading) - 1)])
        for rung in ladder.rungs:
            key = f"{name}: {rung.words}"
            plan = plan_of[key]
            rows.append([
                rung.words, str(len(plan["operations"])), str(gpu.get(key, {}).get("kernels", "")),
                f"{plan['bytes'] / plan['particles']:.0f}",
                microseconds(cpu[key]["seconds"]) if key in cpu else NOT_YET,
                f"{1e6 * median(gpu[key]):.0f}" if key in gpu else NOT_YET,
            ])  # fmt: skip
    said = f"CPU: {where(times, 'effects cpu', ', 2 threads')}. GPU: {where(times, 'effects cuda')}."
    return [*table(heading, rows), "", said]


# Threads


def scaling(times: Times) -> dict[str, dict[int, Mapping[str, Any]]]:
    """Readings of steps by system and number of threads."""
    by_system: dict[str, dict[int, Mapping[str, Any]]] = {}
    for name, reading in readings(times, "scaling cpu").items():
        by_system.setdefault(name.rpartition(", ")[0], {})[reading["threads"]] = reading
    return by_system


def scaling_table(times: Times) -> list[str]:
    """Milliseconds on one thread, and how many times as fast on more."""
    by_system = scaling(times)
    if not by_system:
        return [f"Scaling with CPU threads: {NOT_YET}."]
    counts = sorted({count for system in by_system.values() for count in system})
    rows = []
    for name, system in by_system.items():
        alone = median(system[counts[0]])
        speeds = [f"{alone / median(system[count]):.2f}" if count in system else "" for count in counts[1:]]
        rows.append([name, f"{system[counts[0]]['particles']:,}", f"{1e3 * alone:,.0f}", *speeds])
    heading = ["system", "particles", "one thread [ms a step]", *(f"{count} threads" for count in counts[1:])]
    return [*table(heading, rows), "", f"CPU: {where(times, 'scaling cpu', f', {max(counts)} cores')}."]


# Limits of the device


@dataclass(frozen=True)
class Line:
    """A row of the page's first table.

    name       of the reading; unit: that is shown, "ms", "plain steps" or particle-steps
    bar        in the unit shown
    """

    words: str
    name: str
    unit: str
    bar: float | None = None

    @property
    def size(self) -> str:
        """Of the cube, where Warp and the shares of the copy speed belong to it."""
        return self.name.split()[0] if "jiang_zhu" in self.name else ""

    def value(self, by_name: Mapping[str, Any]) -> float | None:
        """What was measured, in the unit shown."""
        reading = by_name.get(self.name)
        if reading is None or (self.unit == OVER and PAPERS not in by_name):
            return None
        if self.unit == FAST:
            return 1e-9 * float(reading["particles"]) / median(reading)
        if self.unit == AS_FAST:
            return float(reading.get("beside", median(by_name[FASTEST]))) / median(reading)
        if self.unit == OVER:
            return median(reading) / median(by_name[PAPERS])
        return float(reading["ratio"]) if "ratio" in reading else 1e3 * median(reading)

    def reached(self, value: float | None) -> str:
        """Whether the bar is reached."""
        if value is None or self.bar is None:
            return ""
        return "yes" if (value >= self.bar if self.unit in (FAST, AS_FAST) else value <= self.bar) else "no"


FASTEST = "8M jiang_zhu"  # whose rate others are compared with
FAST, AS_FAST = "G particle-steps/s", "relative"  # to the rate of FASTEST
PAPERS, OVER = "8M papers", "papers' steps"  # without tension and shifting
BESIDE = {  # words of the cubes that must be nearly as fast
    "detection": "with surface detection", "akinci": "Akinci", "dong": "Dong", "he": "He", "csf": "CSF",
    "becker": "Becker & Teschner", "tartakovsky": "Tartakovsky & Meakin", "normal_difference": "normal differences",
    "continuity": "continuity", "shifting": "with shifting",
}  # fmt: skip
LINES = (
    Line("Jiang & Zhu cohesion, 59,319 particles", "60k jiang_zhu", "ms a step", 0.08),
    Line("the same, 1,000,000", "1M jiang_zhu", "ms a step"),
    Line("the same, 8,000,000", "8M jiang_zhu", FAST, 3.0),
    *(Line(label, f"8M {cube}", AS_FAST, 0.6) for cube, label in BESIDE.items()),
    Line("default liquid", "8M shifting", OVER, 1.2),
    Line("melting, figure 6", "melting figure_6", "ms a step", 0.45),
    Line("MPM surface of a million particles", "surface in turns", "plain steps", 1.3),
    Line("table of MPM blocks, 2,097,152 particles", "table", "ms", 1.0),
)


def speeds(by_name: Mapping[str, Any]) -> tuple[float, float] | None:
    """Bytes that the device copies and operations that it does in a second; None where they were not measured."""
    if not {"copy", "arithmetic"} <= set(by_name):
        return None
    copied, counted = by_name["copy"], by_name["arithmetic"]
    return copied["bytes"] / median(copied), counted["operations"] / median(counted)


def least_of(by_name: Mapping[str, Any], size: str, kernel: str) -> tuple[Work, float] | None:
    """Least work of a kernel and its seconds; None where a reading is missing.

    kernel  of `validation.limits`, or "step": all kernels of a step and its share of a list's build, over refsim's step
            in the turns with Warp
    """

    def one(name: str) -> Work:
        reading = by_name[f"{size} {name}"]
        return least(name, reading["particles"], reading["neighbours"], reading["entries"])

    turns = by_name.get(f"{size} warp")
    if f"{size} density" not in by_name or (kernel == "step" and turns is None):
        return None
    if kernel != "step" or turns is None:
        return one(kernel), median(by_name[f"{size} {kernel}"])
    built = one("list")
    columns = zip(*map(one, STEP_KERNELS), strict=True)
    work = Work(*(sum(column) + last / turns["serves"] for column, last in zip(columns, built, strict=True)))
    return work, float(np.median(turns["refsim"]))


def shares(by_name: Mapping[str, Any], size: str, kernel: str) -> list[str]:
    """Shares of the copy speed and of the arithmetic speed that a kernel reaches, in words."""
    fast, amounts = speeds(by_name), least_of(by_name, size, kernel)
    if fast is None or amounts is None:
        return [NOT_YET] * 2
    return [f"{100 * amount / limit / amounts[1]:.2g} %" for amount, limit in zip(amounts[0], fast, strict=True)]


def warp_words(by_name: Mapping[str, Any], size: str) -> str:
    """Warp's best way beside refsim's step in the same turns."""
    turns = by_name.get(f"{size} warp")
    if turns is None:
        return NOT_YET
    best, refsim = min(map(np.median, turns["warp"].values())), np.median(turns["refsim"])
    return f"Warp {1e3 * best:.3g} ms, refsim {1e3 * refsim:.3g} ms in turns"


def limits(times: Times) -> list[str]:
    """Table of the steps on the GPU; its kernels are in the picture."""
    by_name, rows = readings(times, "device cuda"), []
    for line in LINES:
        value = line.value(by_name)
        beside = [warp_words(by_name, line.size), shares(by_name, line.size, "step")[0]] if line.size else ["", ""]
        measured = NOT_YET if value is None else f"{value:.3g} {line.unit}"
        bar = "" if line.bar is None else f"{line.bar:g}"
        rows.append([line.words, measured, bar, line.reached(value), *beside])
    lines = table(
        ["work", "measured", "required on an H200", "reached", "another program", "share of the copy speed"], rows
    )
    said, fast = NOT_YET, speeds(by_name)
    if fast is not None:
        said = (
            f"{1e-12 * fast[0]:.2f} TB/s copied, bytes read and written;"
            f" {1e-12 * fast[1]:.1f} TFLOP/s of multiply-adds, float32"
        )
    return [*lines, "", f"Device: {where(times, 'device cuda')}. Its speeds: {said}."]


def limits_picture(times: Times) -> Any:
    """Left: speed of each kernel over its operations a byte, below the device's two limits. Right: refsim and Warp."""
    import matplotlib.pyplot as plt

    from validation.drawing import BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION

    by_name = readings(times, "device cuda")
    figure, (left, right) = plt.subplots(1, 2, figsize=(11.0, 4.4), gridspec_kw={"width_ratios": (1.4, 1.0)})
    left.set_title("kernels of a step of SPH with cohesion, below the device's limits")
    right.set_title("step of SPH with cohesion, list included")
    fast = speeds(by_name)
    if fast is None:
        left.text(0.5, 0.5, NOT_YET, ha="center", transform=left.transAxes, color=GREY)
    else:
        copied, counted = (1e-9 * limit for limit in fast)
        low, edge, high = 0.05, counted / copied, 100.0
        left.loglog([low, edge, high], [low * copied, counted, counted], color=GREY)
        style = {"color": GREY, "ha": "right", "fontsize": 8}
        left.text(0.9, 1.44 * copied, f"copy speed {copied / 1e3:.2f} TB/s", **style)
        left.text(high, 1.15 * counted, f"arithmetic {counted / 1e3:.1f} TFLOP/s", **style)
        colours = dict(zip((*STEP_KERNELS, "list"), (BLUE, GREY, VERMILION, ORANGE, GREEN, PURPLE), strict=True))
        for size, marker in zip(SIZES, "osD"):
            for name, colour in colours.items():
                reading = least_of(by_name, size, name)
                if reading is not None:
                    at, rate = reading[0].operations / reading[0].bytes, 1e-9 * reading[0].operations / reading[1]
                    left.plot(at, rate, marker, color=colour, ms=6, label=name if size == SIZES[0] else None)
            if f"{size} density" in by_name:
                particles = f"{by_name[f'{size} density']['particles']:,} particles"
                left.plot([], [], marker, color="white", mec=GREY, label=particles)
        left.set(xlabel="least operations for each least byte", ylabel="least operations over time [GFLOP/s]")
        left.legend(fontsize=7, loc="lower right", ncols=2)
    turned = [size for size in SIZES if f"{size} warp" in by_name]
    if not turned:
        right.text(0.5, 0.5, NOT_YET, ha="center", transform=right.transAxes, color=GREY)
        return figure
    for place, size in enumerate(turned):
        turns = by_name[f"{size} warp"]
        bars = {"refsim": np.median(turns["refsim"])}
        for way in ("each step", "with skin"):
            bars[f"Warp, {way}"] = min(np.median(run) for name, run in turns["warp"].items() if name.startswith(way))
        for shift, ((name, value), colour) in enumerate(zip(bars.items(), (BLUE, ORANGE, SKY), strict=True)):
            at = place + 0.27 * (shift - 1)
            right.bar(at, 1e3 * value, 0.25, color=colour, label=name if place == 0 else None)
            right.text(at, 1.05e3 * value, f"{1e3 * value:.3g}", ha="center", fontsize=7)
    right.set(yscale="log", xlabel="particles", ylabel="ms a step")
    right.margins(y=0.15)
    right.set_xticks(range(len(turned)), [f"{by_name[f'{size} warp']['particles']:,}" for size in turned])
    right.legend(fontsize=8)
    return figure


# Goals


def goals(times: Times) -> list[str]:
    """Table of `goals.toml`, whose names in braces are readings."""
    device = readings(times, "device cuda")
    found = {name: f"{1e3 * median(reading):.3g}" for name, reading in device.items()}
    for size in SIZES:
        turns = device[f"{size} warp"]
        found[f"{size} over"] = f"{min(map(np.median, turns['warp'].values())) / np.median(turns['refsim']):.2f}"
    found["default over"] = f"{median(device['8M shifting']) / median(device[PAPERS]):.2f}"
    for name, system in scaling(times).items():
        found |= {f"{name}, {count}": f"{median(system[1]) / median(row):.1f}" for count, row in system.items()}
    found |= {key: where(times, key) for key in times}
    waits = json.loads(STORED.with_name("data").joinpath("waits.json").read_text(encoding="utf-8"))
    found |= {name: f"{float(np.median(taken)):.2g}" for name, taken in waits["seconds"].items()}
    found["waits"] = f"{waits['processor']}, {waits['cores']} cores, {waits['date']}"
    names = ("work", "at 512adce3", "found", "goal", "command", "where and when")
    rows = tomllib.loads(GOALS.read_text(encoding="utf-8"))["row"]
    return table(names, [[row[name].format_map(found) for name in names] for row in rows])


# Pages

GOALS = Path(__file__).with_name("goals.toml")
PAGE = DOCS / "study.md"
PICTURE = FIGURES / "device_limits.png"
EFFECTS = """### Each effect

Measured by `pytest tests/times/bench_effects.py --benchmark-json FILE`: median of 15 repeats of 50 ms or
100 steps of $2\\times10^{-5}$ s, so that the list is built once. ○: range of the repeats,
if their interquartile range is 5 % of the median or more. Bytes are fields, walls, neighbour list and grid.
"""
LIMITS = """
### Limits of a GPU

![Kernels below the limits of the device; refsim beside Warp](../figures/device_limits.png)

Measured by `pytest tests/times/bench_device.py --benchmark-json FILE`. The cube of Jiang & Zhu's liquid has
a side of 1 m, h = 2 d and turns at 1 rad/s, float32; Warp 1.19
(`validation/peers/warp_sph.py`) has the same particles, equations and step. Relative rates are over that of the cube of
8,000,000 particles. The last column is the time in which the device copies the least bytes of a step, over the time of
the step. [Counters](../validation/gpu_reports/nvidia_h200.md#counters-of-kernels) say that sums over neighbours issue
instructions in 75 to 85 % of all cycles, with L1 busy for 56 to 77 %, the memory for 32 to 55 %: four entries in one
read would save 15 % of a density, entries of 2 bytes or tiles nothing. DualSPHysics, published and not run here: a
million particles and more on a GPU of 2011 up to two orders of magnitude faster than on one core (Crespo et al. 2011,
PLoS ONE 6, e20685). Rows of 28 November are relative to the step of then, 2.98 ms.
MPM's surface is 43 launches, 0.362 ms for a plain step of 0.279; the sweeps of its fit wait for each other.
Melting is 33: figure 6 takes 0.32 ms with a kept list, 0.55 with a new one (59 % of steps: fast water flows among
solids), a million particles 3.0 and 5.1 ms (97.5 %; `python -m validation run melting`).
"""
THREADS = """
### Threads of a CPU

Measured by `pytest tests/times/bench_scaling.py --benchmark-json FILE`: one scene of each system, float32,
pinned to as many cores as threads; a list serves three steps at most. The columns of
threads give how many times faster they are than one. A loop of multiply-adds gains 10.7 times
from these 16 cores, whose clocks are slower then, and copying 8.2 times.
"""
ASKED = "\n### Goals of speed\n\nSteps of one thread are in processor time.\n"


def page(times: Times) -> str:
    """docs/study.md with the stored times."""
    lines = [EFFECTS, *effects(times), LIMITS, *limits(times), THREADS, *scaling_table(times), ASKED, *goals(times)]
    return replaced(PAGE.read_text(encoding="utf-8"), "times", lines, PAGE)


def perform(files: Sequence[Path]) -> list[Path]:
    """Store the readings of the files, renew page and pictures; returns the paths of what was written."""
    import matplotlib.pyplot as plt

    from validation.drawing import save_picture, style

    times = stored()
    for file in files:
        times = merged(times, read(file))
    if files:
        write_file(STORED, json.dumps(times, indent=1) + "\n")
    write_file(PAGE, page(times))
    with style():
        figure = limits_picture(times)
        save_picture(figure, PICTURE)
        plt.close(figure)
    return [*([STORED] if files else []), PAGE, PICTURE]
