"""The page and the picture of the device's limits, from the newest GPU report: `python -m validation limits`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from validation import scaling
from validation.limits import SIZES, STEP_KERNELS, Work, least
from validation.scaling import NOT_YET, table

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "device_limits.md"
PICTURE = ROOT / "figures" / "device_limits.png"
REPORTS = ROOT / "validation" / "gpu_reports"
Tasks = Mapping[str, Mapping[str, Any]]


def newest(folder: Path = REPORTS) -> tuple[str, Tasks]:
    """(device and date, values of the tasks by name and row) of the newest report that has the limits; ("", {})."""
    found: tuple[str, str, Tasks] = ("", "", {})
    for file in sorted(folder.glob("*.json")):
        tasks = json.loads(file.read_text()).get("whole check", {}).get("tasks", [])
        own = [t for t in tasks if t["task"].split()[0] in ("limits", "timing", "melting") and not t["error"]]
        if not any(t["task"].startswith("limits") for t in own):
            continue
        latest = max((str(t["date"]) for t in own), default="")
        if latest > found[1]:
            device = next((str(r["value"]) for t in tasks for r in t["rows"] if r["name"] == "device"), file.stem)
            found = f"{device}, {latest.split()[0]}", latest, {
                t["task"]: {r["name"]: r["value"] for r in t["rows"]} for t in own
            }  # fmt: skip
    return found[0], found[2]


@dataclass(frozen=True)
class Line:
    """A row of the page's first table.

    task, row  where the reading stands; inverse: whether it is shown as 1/value
    bar, aim   in the unit shown
    size       of the cube, where Warp and the shares of the copy speed belong to it
    """

    words: str
    task: str
    row: str
    unit: str
    bar: float | None = None
    aim: float | None = None
    inverse: bool = False
    size: str = ""

    def value(self, tasks: Tasks) -> float | None:
        """What was measured, in the unit shown."""
        found = tasks.get(self.task, {}).get(self.row)
        return None if found is None else 1 / float(found) if self.inverse else float(found)

    def reached(self, tasks: Tasks) -> str:
        """Whether the bar is reached."""
        value = self.value(tasks)
        if value is None or self.bar is None:
            return ""
        return "yes" if (value >= self.bar if self.inverse else value <= self.bar) else "no"


FAST = "G particle-steps/s"
LINES = (
    Line("Jiang & Zhu cohesion, 59,319 particles", "timing 60k jiang_zhu", "step", "ms a step", 0.1, 0.07, size="60k"),
    Line("the same, 1,000,000", "timing 1M jiang_zhu", "step", "ms a step", size="1M"),
    Line("the same, 8,000,000", "timing 8M jiang_zhu", "step per particle", FAST, 2.5, 3.5, True, "8M"),
    Line("Akinci, 8,000,000", "timing 8M akinci", "step per particle", FAST, 1.6, 2.0, True),
    Line("melting, figure 6, with list builds", "melting figure_6", "step, mean", "ms a step", 0.5, 0.3),
    Line("MPM surface of a million particles", "limits surface", "surface over plain step", "plain steps", 1.5, 1.0),
    Line("new table of MPM blocks, 2,097,152 particles", "limits table", "new table", "ms", 1.0),
)


def shares(tasks: Tasks, size: str, kernel: str) -> tuple[float, float] | None:
    """Shares of the copy speed and of the arithmetic speed that a kernel reaches; None where a reading is missing.

    kernel  of `validation.limits`, or "step": all kernels of a step and its share of a list's build, over refsim's step
            in the turns with Warp
    """
    speed, own, turns = (tasks.get(f"limits {name}") for name in ("speeds", f"kernels {size}", f"warp {size}"))
    if speed is None or own is None or (kernel == "step" and turns is None):
        return None
    given = float(own["particles"]), float(own["neighbours"]), float(own["entries"])
    if kernel == "step":
        assert turns is not None
        parts, built = [least(name, *given) for name in STEP_KERNELS], least("list", *given)
        serves = float(turns["steps a list serves"])
        work = Work(
            *(sum(column) + last / serves for column, last in zip(zip(*parts, strict=True), built, strict=True))
        )
        spent = 1e-3 * float(turns["refsim"])
    else:
        work, spent = least(kernel, *given), 1e-3 * float(own[kernel])
    fast = 1e9 * float(speed["copy speed"]), 1e9 * float(speed["arithmetic speed"])
    return work.bytes / fast[0] / spent, work.operations / fast[1] / spent


def warp_words(tasks: Tasks, size: str) -> str:
    """Warp's best way beside refsim's step in the same turns."""
    found = tasks.get(f"limits warp {size}")
    if found is None:
        return NOT_YET
    best = min(float(value) for name, value in found.items() if name.startswith("Warp, "))
    return f"Warp {best:.3g} ms, refsim {float(found['refsim']):.3g} ms in turns"


def markdown(device: str, tasks: Tasks) -> list[str]:
    """The page's tables of the GPU."""
    rows = []
    for line in LINES:
        value, share = line.value(tasks), shares(tasks, line.size, "step") if line.size else None
        rows.append(
            [
                line.words, NOT_YET if value is None else f"{value:.3g} {line.unit}",
                "" if line.bar is None else f"{line.bar:g}", line.reached(tasks),
                "" if line.aim is None else f"{line.aim:g}", warp_words(tasks, line.size) if line.size else "",
                "" if not line.size else NOT_YET if share is None else f"{100 * share[0]:.2g} %",
            ]
        )  # fmt: skip
    speed, said = tasks.get("limits speeds"), NOT_YET
    if speed is not None:
        said = (
            f"{float(speed['copy speed']) / 1e3:.2f} TB/s copied, bytes read and written;"
            f" {float(speed['arithmetic speed']) / 1e3:.1f} TFLOP/s of multiply-adds, float32"
        )
    lines = table(["work", "measured", "bar", "reached", "aim", "peer", "share of the copy speed"], rows)
    lines += ["", f"Device: {device or NOT_YET}. Its speeds: {said}.", ""]
    rows = []
    for size in SIZES:
        own = tasks.get(f"limits kernels {size}")
        if own is None:
            continue
        given = float(own["particles"]), float(own["neighbours"]), float(own["entries"])
        for name in (*STEP_KERNELS, "list"):
            work, share = least(name, *given), shares(tasks, size, name)
            percent = [NOT_YET] * 2 if share is None else [f"{100 * part:.2g} %" for part in share]
            numbers = (float(own[name]), 1e-6 * work.bytes, 1e-9 * work.operations)
            rows.append([name, f"{int(given[0]):,}", *(f"{float(f'{value:.3g}'):,g}" for value in numbers), *percent])
    heading = ["kernel", "particles", "time [ms]", "least bytes [MB]", "least operations [GFLOP]"]
    heading += ["share of the copy speed", "share of the arithmetic speed"]
    return [*lines, *table(heading, rows)] if rows else [*lines, f"Kernels: {NOT_YET}."]


def picture(tasks: Tasks) -> Any:
    """Left: speed of each kernel over its operations a byte, below the device's two limits. Right: refsim and Warp."""
    import matplotlib.pyplot as plt

    from validation.drawing import BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION

    figure, (left, right) = plt.subplots(1, 2, figsize=(11.0, 4.4), gridspec_kw={"width_ratios": (1.4, 1.0)})
    left.set_title("kernels of a step of SPH with cohesion, below the device's limits")
    right.set_title("step of SPH with cohesion, list included")
    speed = tasks.get("limits speeds")
    sizes = [size for size in SIZES if f"limits kernels {size}" in tasks]
    if speed is None or not sizes:
        left.text(0.5, 0.5, NOT_YET, ha="center", transform=left.transAxes, color=GREY)
    else:
        copied, counted = float(speed["copy speed"]), float(speed["arithmetic speed"])
        reach = np.array([0.05, 100.0])
        edge = counted / copied
        left.loglog([reach[0], edge], [reach[0] * copied, counted], color=GREY)
        left.loglog([edge, reach[1]], [counted, counted], color=GREY)
        left.text(0.9, 1.6 * 0.9 * copied, f"copy speed {copied / 1e3:.2f} TB/s", color=GREY, ha="right", fontsize=8)
        left.text(
            reach[1], 1.15 * counted, f"arithmetic {counted / 1e3:.1f} TFLOP/s", color=GREY, ha="right", fontsize=8
        )
        colours = dict(zip((*STEP_KERNELS, "list"), (BLUE, GREY, VERMILION, ORANGE, GREEN, PURPLE), strict=True))
        for size, marker in zip(sizes, "osD", strict=False):
            own = tasks[f"limits kernels {size}"]
            given = float(own["particles"]), float(own["neighbours"]), float(own["entries"])
            for name, colour in colours.items():
                work = least(name, *given)
                rate = 1e-9 * work.operations / (1e-3 * float(own[name]))
                first = size == sizes[-1]
                left.plot(work.operations / work.bytes, rate, marker, color=colour, ms=6, label=name if first else None)
        for size, marker in zip(sizes, "osD", strict=False):
            n = int(float(tasks[f"limits kernels {size}"]["particles"]))
            left.plot([], [], marker, color="white", mec=GREY, label=f"{n:,} particles")
        left.set_xlabel("least operations for each least byte")
        left.set_ylabel("least operations over time [GFLOP/s]")
        left.legend(fontsize=7, loc="lower right", ncols=2)
    turned = [size for size in SIZES if f"limits warp {size}" in tasks]
    if not turned:
        right.text(0.5, 0.5, NOT_YET, ha="center", transform=right.transAxes, color=GREY)
    for place, size in enumerate(turned):
        own = tasks[f"limits warp {size}"]
        ways = ("Warp, each step", "Warp, with skin")
        bars = {"refsim": float(own["refsim"])}
        bars |= {way: min(float(v) for k, v in own.items() if k.startswith(way)) for way in ways}
        for shift, ((name, value), colour) in enumerate(zip(bars.items(), (BLUE, ORANGE, SKY), strict=True)):
            at = place + 0.27 * (shift - 1)
            right.bar(at, value, 0.25, color=colour, label=name if place == 0 else None)
            right.text(at, 1.05 * value, f"{value:.3g}", ha="center", fontsize=7)
    if turned:
        right.set_yscale("log")
        right.margins(y=0.15)
        names = [f"{int(float(tasks[f'limits warp {size}']['particles'])):,}" for size in turned]
        right.set_xticks(range(len(turned)), names)
        right.set_xlabel("particles")
        right.set_ylabel("ms a step")
        right.legend(fontsize=8)
    return figure


def page(text: str) -> str:
    """docs/device_limits.md with its tables renewed."""
    from validation.stability_page import replaced

    text = replaced(text, "device limits", markdown(*newest()), PAGE)
    return replaced(text, "cpu scaling", scaling.markdown(scaling.stored()), PAGE)


def write() -> list[Path]:
    """Renew page and pictures from what is stored; returns their paths."""
    import matplotlib.pyplot as plt

    from validation.drawing import save_picture, style

    PAGE.write_text(page(PAGE.read_text()))
    with style():
        for made, path in ((picture(newest()[1]), PICTURE), (scaling.picture(scaling.stored()), scaling.PICTURE)):
            save_picture(made, path)
            plt.close(made)
    return [PAGE, PICTURE, scaling.PICTURE]
