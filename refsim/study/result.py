"""What a study found: its runs, the sources of error, what effects cost, and the cheapest setting for an error."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from refsim.core.tables import in_bytes, in_time, table
from refsim.core.writing import made_by
from refsim.scene.scene import Scene
from refsim.study.convergence import Convergence, Reference
from refsim.study.runs import Reading, Setting

TWICE = {"support": 2.0, "step": 2.0}  # error over change where half the step, or 1.25 support radii, leave half of it


@dataclass(frozen=True)
class Advice:
    """The cheapest setting for an error."""

    error: float
    spacing: float
    dtype: str
    backend: str
    seconds: float
    bytes: float
    measured: bool  # whether exactly this setting was run; seconds and bytes are else continued from the runs

    def words(self) -> str:
        """One sentence."""
        how = "measured" if self.measured else "estimated"
        return (
            f"an error of {percent(self.error)}: spacing {self.spacing:.4g} m, {self.dtype}, {self.backend}:"
            f" {in_time(self.seconds)}, {in_bytes(self.bytes)} ({how})"
        )


@dataclass(frozen=True)
class Study:
    """Result of `refsim.study`; with a reference its scale stands in place of |Q0| and |Q_scene| below."""

    scene: Scene
    observable: str
    unit: str
    runs: tuple[tuple[Setting, Reading], ...]  # every setting that was run, with its reading
    convergence: Convergence | None  # over the spacings; None where no spacing gave a value
    error: float  # relative, for which the cheapest setting is given
    notes: tuple[str, ...] = ()
    machine: str = ""
    threads: int = 1
    left_out: tuple[str, ...] = field(default_factory=tuple)
    reference: Reference | None = None  # what the value is held against

    def of(self, kind: str) -> list[tuple[Setting, Reading]]:
        """The runs of a kind that gave a value."""
        return [(s, r) for s, r in self.runs if s.kind == kind and not r.failed]

    @property
    def base(self) -> Reading | None:
        """The run of the scene as it is; None where it failed."""
        return next((r for s, r in self.of("spacing") if s.factor == 1), None)

    def _relative(self, change: float, to: float) -> float | None:
        """A change relative to the reference's scale, or to a value; None for zero."""
        scale = abs(to) if self.reference is None else self.reference.scale
        return change / scale if scale else None

    def rows(self) -> list[dict[str, Any]]:
        """One row for each run, as plain values.

        mass    of all particles at the start [kg; kg/m in 2D]
        change  of a spacing: (Q - Q0)/|Q0|, its error; of anything else: (Q - Q_scene)/|Q_scene|
        seconds  of the processor, on a GPU of the clock; `wall_seconds` of the clock
        cost    seconds over those of the scene as it is
        unsettled  why the seconds are not to be trusted; "" where they are
        """
        base, made = self.base, list[dict[str, Any]]()
        for setting, reading in self.runs:
            of = self.convergence if setting.kind == "spacing" else base
            row: dict[str, Any] = {"what": setting.kind, "setting": setting.label, "spacing": setting.scene.spacing}
            row |= {name: getattr(reading, name) for name in ("particles", "mass", "steps", "seconds")}
            row |= {"wall_seconds": reading.wall, "unsettled": reading.unsettled, "bytes": reading.bytes}
            row |= {"value": None if reading.failed else reading.value, "change": None, "cost": None}
            row["failed"] = reading.failed
            if of is not None and not reading.failed:
                row["change"] = self._relative(reading.value - of.value, of.value)
            if base is not None and base.seconds and not reading.failed:
                row["cost"] = reading.seconds / base.seconds
            made.append(row)
        return made

    def sources(self) -> dict[str, float]:
        """Relative error of the scene as it is, by what causes it.

        spacing    its grid convergence index, or the range of the finest values where no order was observed
        support    2 |Q(1.25 h) - Q(h)|, for sums whose error falls with the third power of d/h
        step       2 |Q(dt/2) - Q(dt)|, for a method of first order in the step
        precision, tolerance, backend  |Q' - Q|, with the other precision, a tenth of the tolerance, the other backend
        """
        base, errors = self.base, {}
        if base is None:
            return {}
        if self.convergence is not None and math.isfinite(self.convergence.uncertainty):
            errors["spacing"] = self.convergence.bound(base.value)
        for kind in ("support", "step", "precision", "tolerance", "backend"):
            changes = [abs(r.value - base.value) for _, r in self.of(kind)]
            change = self._relative(max(changes), base.value) if changes else None
            if change is not None:
                errors[kind] = TWICE.get(kind, 1.0) * change
        return errors

    def cheapest(self, error: float | None = None) -> Advice | None:
        """The cheapest setting whose error is bounded by `error` (the study's); None where that cannot be said.

        Where no run reaches it, spacing, seconds and memory are continued with the observed orders.
        """
        error = self.error if error is None else error
        limit, base = self.convergence, self.base
        if limit is None or not math.isfinite(limit.uncertainty):
            return None
        sufficient = []
        for setting, reading in self.of("spacing"):
            for k, (of, ratio, share, change) in enumerate(self._alternatives(setting, base)):
                if limit.bound(reading.value) + change <= error:
                    took, known = (reading.seconds * ratio, reading.bytes * share), not k or setting.factor == 1
                    sufficient.append(Advice(error, setting.scene.spacing, of.scene.dtype, of.backend, *took, known))
        if sufficient:
            return min(sufficient, key=lambda advice: (advice.seconds, advice.spacing))
        return self._finer(error)

    def _alternatives(self, own: Setting, base: Reading | None) -> list[tuple[Setting, float, float, float]]:
        """The setting's own precision and backend, and those tried: (setting, seconds, bytes, error) relative to it."""
        limit, rounding, single = self.convergence, self.sources().get("precision", 0.0), self.scene.dtype == "float32"
        made = [(own, 1.0, 1.0, rounding if single else 0.0)]
        if base is None or limit is None or not (base.seconds and base.bytes and (base.value or self.reference)):
            return made
        for setting, r in (*self.of("precision"), *self.of("backend")):
            change = self._relative(abs(r.value - base.value), base.value) or 0.0
            if setting.scene.dtype == "float64" and single:
                if rounding <= limit.relative:  # float32 serves as well
                    continue
                change = 0.0
            made.append((setting, r.seconds / base.seconds, r.bytes / base.bytes, change))
        return made

    def _finer(self, error: float) -> Advice | None:
        limit, levels = self.convergence, sorted(self.of("spacing"), key=lambda pair: pair[0].factor)
        if limit is None or not limit.asymptotic or not error > 0:
            return None
        setting, finest = levels[-1]
        factor = (limit.bound(finest.value) / error) ** (1 / limit.order)
        before, coarser = levels[-2]
        dim = setting.scene.dim
        power = math.log(finest.seconds / coarser.seconds) / math.log(setting.factor / before.factor)
        power = min(max(power, dim), dim + 2)  # particles, and steps up to those of explicit diffusion
        return Advice(
            error, setting.scene.spacing / factor, setting.scene.dtype, setting.backend,
            finest.seconds * factor**power, finest.bytes * factor**dim, False,
        )  # fmt: skip

    def answers(self) -> list[str]:
        """The answers in words, a line each."""
        lines = []
        limit = self.convergence
        if limit is None:
            lines.append("no spacing gave a value")
        else:
            known = math.isfinite(limit.uncertainty)
            band = f" ± {limit.uncertainty:.2g}" if known else ""
            share = f" ({percent(limit.relative)})" if known else ", uncertainty unknown"
            unit = f" {self.unit}" if self.unit else ""
            lines.append(f"{self.observable} = {limit.value:.6g}{band}{unit}{share}; {limit.words}")
        if self.reference is not None and limit is not None:
            given, base = self.reference, self.base
            share = f" (± {percent(given.uncertainty)})" if given.uncertainty else ""
            error = None if base is None else given.error(base.value)
            off = f"the scene as it is has an error of {_above(error, given.uncertainty)}, " if base else ""
            above = _above(given.error(limit.value), given.uncertainty)
            lines.append(f"reference {given.value:.6g}{share}, {given.words}: {off}the value above of {above}")
        sources = self.sources()
        if sources:
            parts = ", ".join(f"{name} {percent(e)}" for name, e in sorted(sources.items(), key=lambda item: -item[1]))
            lines.append(f"error of the scene as it is, by source: {parts}")
        levels = [(limit.bound(r.value), s.scene.spacing) for s, r in self.of("spacing")] if limit else []
        bound, at = min(levels, default=(math.inf, 0.0))
        best = f": the smallest bound is {percent(bound)}, at {at:.4g} m; add finer levels" * (bound < math.inf)
        for error, begin in ((self.error, "cheapest for "), (self.error / 2, "half of it, ")):
            unsaid = f"which setting has an error of {percent(error)} cannot be said from these runs{best}"
            lines.append(begin + advice.words() if (advice := self.cheapest(error)) else unsaid)
        support = sources.get("support", 0.0)
        if support > self.error:
            ratio = self.scene.support_radius / self.scene.spacing
            lines.append(
                f"note: sums over a support of {ratio:.3g} spacings make an error of up to {percent(support)}, which a"
                " finer spacing at the same ratio may not remove; the bounds above leave it out"
            )
        spent, wall = (sum(getattr(r, of) for s, r in self.runs if s.backend != "cuda") for of in ("seconds", "wall"))
        if spent:
            lines.append(
                f"seconds are those of the processor, on {self.threads} thread{'s' * (self.threads > 1)}; by the clock"
                f" the runs took {wall / spent:.2f} times as long"
            )
        doubtful = [f"{s.label}: {r.unsettled}" for s, r in self.runs if r.unsettled]
        if doubtful:
            lines.append(
                f"note: * seconds of {len(doubtful)} of {len(self.runs)} runs have not settled ({doubtful[0]});"
                " measure them on a machine that does nothing else"
            )
        return [*lines, *(f"note: {note}" for note in self.notes)]

    HEAD = ("what", "setting", "value", "error or change", "seconds", "cost", "memory", "particles", "mass", "steps")

    def cells(self) -> list[tuple[str, ...]]:
        """The table of runs that gave a value, as text, without its head (`HEAD`)."""
        made: list[tuple[str, ...]] = []
        limit = self.convergence
        for row in (row for row in self.rows() if not row["failed"]):
            known = limit.relative if limit is not None and row["what"] == "spacing" else 0.0
            seconds = f"{row['seconds']:.3g}" + "*" * bool(row["unsettled"])
            cost = "-" if row["cost"] is None else f"{row['cost']:.2f}"
            change, mass = _above(row["change"], known, signed=True), f"{row['mass']:.4g}"
            what = row["what"], row["setting"], f"{row['value']:.6g}", change, seconds, cost
            made.append((*what, in_bytes(row["bytes"]), f"{row['particles']:,}", mass, f"{row['steps']:,}"))
        return made

    def text(self) -> str:
        """Table and answers for a terminal."""
        runs = table(self.cells(), self.HEAD, range(2, len(self.HEAD)))
        failed = [f"{s.kind}, {s.label}: {r.failed}" for s, r in self.runs if r.failed]
        return "\n".join([runs, *failed, *self.left_out, "", *self.answers()])

    def data(self) -> dict[str, Any]:
        """Everything as plain values."""
        limit = self.convergence
        advised = {"error": self.cheapest(self.error), "half_of_it": self.cheapest(self.error / 2)}
        unknown = {"value": None, "uncertainty": None, "order": None, "asymptotic": False, "words": ""}
        data = {"scene": self.scene.name} | {name: getattr(self, name) for name in ("observable", "unit", "machine")}
        data |= {name: getattr(limit, name, other) for name, other in unknown.items()}
        return data | {
            "reference": None if self.reference is None else vars(self.reference),
            "sources": self.sources(),
            "cheapest": {name: None if setting is None else vars(setting) for name, setting in advised.items()},
            "runs": self.rows(),
            "left_out": list(self.left_out),
            "notes": list(self.notes),
        }

    def plot(self) -> Any:
        """The picture, a Matplotlib figure with four parts."""
        from matplotlib.figure import Figure

        figure = Figure(figsize=(11.0, 7.6), layout="constrained")
        for part, axes in zip((_values, _errors, _sources, _changes), figure.subplots(2, 2).flat):
            part(self, axes)
        figure.suptitle(f"{self.observable} of {self.scene.name}", fontsize=11)
        return figure

    def png(self) -> bytes:
        """The picture as a file."""
        return made_by(self.plot().savefig, format="png", dpi=110)


def percent(share: float | None, signed: bool = False) -> str:
    """A share as text in percent."""
    if share is None or not math.isfinite(share):
        return "-"
    digits = ".0f" if abs(share) >= 0.1 else ".2g"
    return f"{100 * share:{'+' if signed else ''}{digits}} %"


def _above(error: float | None, known: float, signed: bool = False) -> str:
    """An error as text; where it is within what is `known` of its judge, that."""
    if error is None or not abs(error) <= known:
        return percent(error, signed)
    return f"< {percent(known)}"


# The picture of a study

BLUE, VERMILION, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#666666"  # Okabe & Ito's palette


def _values(study: Any, axes: Any) -> None:
    from matplotlib.ticker import MaxNLocator

    levels = study.of("spacing")
    spacing = [s.scene.spacing for s, _ in levels]
    axes.plot(spacing, [r.value for _, r in levels], "o-", color=BLUE)
    stopped = [s.scene.spacing for s, r in study.runs if s.kind == "spacing" and r.failed]
    if stopped:
        height = [0.04] * len(stopped)
        axes.plot(stopped, height, "x", color=VERMILION, ms=9, transform=axes.get_xaxis_transform(), label="stopped")
        axes.legend(fontsize=9)
    limit, widest = study.convergence, max(spacing, default=0.0)
    if limit is not None and math.isfinite(limit.uncertainty):
        low, high = limit.value - limit.uncertainty, limit.value + limit.uncertainty
        axes.fill_between([0, 1.05 * widest], low, high, color=BLUE, alpha=0.15)
        title = "not in the asymptotic range"
        if limit.asymptotic:
            at, finest = np.linspace(0, widest, 60), levels[np.argmin(spacing)][1].value
            curve = limit.value + (finest - limit.value) * (at / min(spacing)) ** limit.order
            axes.plot(at, curve, "--", color=GREY, lw=1)
            title = f"order {limit.order:.2f}, ± {100 * limit.relative:.2g} %"
        axes.set_title(title, fontsize=9)
    axes.set_xlim(left=0)
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.set(xlabel="spacing [m]", ylabel=f"{study.observable} [{study.unit}]" if study.unit else study.observable)


def _errors(study: Any, axes: Any) -> None:
    limit = study.convergence
    points = [] if limit is None else [(r.seconds, 100 * limit.bound(r.value)) for _, r in study.of("spacing")]
    points = [(seconds, error) for seconds, error in points if seconds > 0 and 0 < error < math.inf]
    if points:
        axes.loglog(*zip(*points), "o-", color=BLUE, label="spacings")
    for error, colour in ((study.error, VERMILION), (study.error / 2, GREEN)):
        advice = study.cheapest(error)
        if advice is not None and advice.seconds > 0:
            filled = colour if advice.measured else "none"
            axes.loglog(
                [advice.seconds], [100 * error], "D", color=colour, markerfacecolor=filled,
                label=f"{100 * error:g} %: {advice.spacing:.3g} m" + ("" if advice.measured else ", estimated"),
            )  # fmt: skip
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8)
    plain_ticks(axes.xaxis)
    plain_ticks(axes.yaxis)
    axes.axhline(100 * study.error, color=GREY, lw=1)
    axes.set(xlabel="seconds of the processor; on a GPU of the clock", ylabel="bound of the error [%]")
    axes.set_title("what an error costs", fontsize=9)


def plain_ticks(axis: Any, words: Callable[[float], str] = "{:g}".format, few: float = 100, most: Any = "auto") -> None:
    """Numbers, at `most` so many, without powers of ten; between these where a logarithmic axis ends `few` times higher
    than it begins, or below.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    if axis.get_scale() != "log":
        return
    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if 0 < low < high < few * low else (1,), numticks=most))
    axis.set_major_formatter(FuncFormatter(lambda value, _: words(value)))
    axis.set_minor_formatter(NullFormatter())


def _sources(study: Any, axes: Any) -> None:
    """Bars of the error of the scene as it is, by source."""
    sources = sorted(study.sources().items(), key=lambda item: item[1])
    axes.barh([name for name, _ in sources], [100 * error for _, error in sources], 0.6, color=BLUE)
    for k, (_, error) in enumerate(sources):
        axes.annotate(f" {100 * error:.2g} %", (100 * error, k), va="center", fontsize=9)
    axes.axvline(100 * study.error, color=GREY, lw=1)
    if any(error > 0 for _, error in sources):
        axes.set_xscale("log")
        axes.margins(x=0.25)
        plain_ticks(axes.xaxis)
    axes.set_xlabel("error of the scene as it is [%]")
    axes.set_title("where the error comes from", fontsize=9)


def _changes(study: Any, axes: Any) -> None:
    rows = [row for row in study.rows()[::-1] if row["what"] != "spacing" and row["change"] is not None]
    place, changed = np.arange(len(rows)), [100 * row["change"] for row in rows]
    saved = [100 * (1 - row["cost"]) if row["what"] == "effect" else 100 * (row["cost"] - 1) for row in rows]
    axes.barh(place + 0.2, changed, 0.36, color=VERMILION, label="changes the value by [%]")
    axes.barh(place - 0.2, saved, 0.36, color=BLUE, label="costs [% of the seconds]")
    axes.set_yticks(place, [row["setting"] for row in rows], fontsize=8)
    axes.axvline(0, color=GREY, lw=0.8)
    axes.set_xscale("symlog", linthresh=1.0)
    if rows:
        axes.set_ylim(-0.7, len(rows) + 0.8)  # the legend stands above the bars
        axes.legend(fontsize=9, loc="upper right")
    axes.set_title("each change alone; of an effect, what it costs", fontsize=9)
