"""What accuracy costs: `python -m validation accuracy [PANEL ...]`, error against wall time.

A panel is one observable with a trusted reference. Its points are settings, each measured at least five times: error,
wall time and its parts, or the reason of its failure. An experiment names its panels as `panels`; their bars stand in
its `expected.toml`, as `[accuracy.NAME]`. `--compare OLD.json NEW.json` judges two reports by their noise.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TextIO

from refsim.backends.ahead import cores
from refsim.core.errors import InputError
from validation import answers
from validation.answers import duration, group_of, is_peer, time_to
from validation.checks import ACCURACY, Check, Checks
from validation.experiment import Band, Experiment, Options, Panel, Part, Picture, Points, Results
from validation.gpu_readings import gpu_runs, keep, without_gpu
from validation.perform import Performed, perform
from validation.results import read_json, real
from validation.tables import Table
from validation.work_precision import (
    BETTER,
    NORMAL,
    SURE,
    UNSURE,
    WORSE,
    Order,
    error_verdict,
    instability,
    middle,
    order_from_errors,
    order_from_values,
    pareto,
    time_verdict,
)

SCHEMA = "refsim accuracy and cost, version 1"
MISSING = "missing: "  # how the reason begins why a program that is not installed gave no reading


def panels(experiments: Mapping[str, Experiment]) -> dict[str, tuple[str, Panel]]:
    """(experiment, panel) of every panel, by the panel's name, in alphabetical order."""
    found: dict[str, tuple[str, Panel]] = {}
    for experiment in experiments.values():
        for panel in experiment.panels:
            if panel.name in found:
                raise ValueError(f"two panels are called {panel.name!r}; the second is of {experiment.name}")
            found[panel.name] = experiment.name, panel
    return dict(sorted(found.items()))


def part_of(experiment: str, panel: Panel, options: Options) -> Part:
    """A panel's runs and what is drawn of them."""

    def collect(results: Results) -> dict[str, Any]:
        return make_report(panel, results, options)

    def draw(data: Mapping[str, Any]) -> Any:
        from validation.accuracy_picture import answer_picture  # loads Matplotlib

        return answer_picture(data)

    def checks(results: Results) -> list[Check]:
        check = Checks(experiment, ACCURACY)
        panel.checks(collect(results), check)
        return check.made

    name = f"accuracy_cost_{panel.name}"
    picture = Picture(name, collect, draw)
    runs = [replace(run, rough=options.quick) for run in (*panel.runs(options), *gpu_runs(panel.name, options))]
    return Part(ACCURACY, name, name, runs, checks, (picture,), lambda results: tables(collect(results)))


def perform_panels(
    chosen: Sequence[tuple[str, Panel]], options: Options, stream: TextIO | None = None
) -> list[Performed]:
    """Compute, check and draw the (experiment, panel) pairs; a setting that fails unasked stops its run.

    The quick size runs on all cores side by side, since its times have no statistics.

    What a GPU gave at the published sizes is kept for machines without one (`validation.gpu_readings`).
    """
    jobs = cores() if options.quick and options.backend == "cpu" else 1
    performed = perform([part_of(name, panel, options) for name, panel in chosen], options, jobs, stream=stream)
    for each, (_, panel) in zip(performed, chosen):
        keep(panel.name, each.part.runs, each.results, options)
        for key, result in each.results.items():
            for reading in result.values.get("readings", ()):
                if reading["stopped"] and not reading["expected"]:
                    each.stopped.setdefault(key, f"{reading['words']}: {reading['stopped']}")
    return performed


# The report: plain values, from which the picture is drawn


def make_report(panel: Panel, results: Results, options: Options) -> dict[str, Any]:
    """Everything that the figure, the tables and a comparison need."""
    pool = pooled(results)
    points = {key: p for key, p in pool.items() if not p["stopped"].startswith(MISSING)}
    shown = {key: p for key, p in points.items() if p["shown"]}
    for p in shown.values():
        p["to_stated"] = time_to(p, panel.stated)
        p["elsewhere"] = elsewhere(p, points, panel.check_bar)
    alive = [key for key, p in shown.items() if not p["stopped"]]
    own = {key: p for key, p in shown.items() if "reported" not in p["knobs"]}
    front = _front_of([key for key in alive if key in own], shown)
    band = panel.band(points)
    about = [result.about for result in results.values()]
    made: dict[str, Any] = {
        "schema": SCHEMA,
        "panel": panel.name,
        "title": panel.title,
        "observable": panel.observable,
        "reference": panel.reference,
        "stated": panel.stated,
        "quick": options.quick,
        "dates": sorted({str(a.get("date")) for a in about}),
        "where": places(results),
        "band": None if band is None else asdict(band),
        "front": front,
        "front_elsewhere": _front_of([key for key in alive if key not in own], shown),
        "lines": [{"words": words, "keys": [k for k in keys if k in alive]} for words, keys in panel.lines],
        "sources": sources(panel, points, band),
        "headline": headline(panel, shown),
        "effects": effects(panel, points),
        "compile": math.fsum(p["compile"] or 0.0 for p in points.values()),
        "starts": [start for result in results.values() for start in result.values.get("starts", ())],
        "omissions": omissions(panel, pool, options),
    }
    made["advice"] = advice(panel, points, band)
    made["points"] = points  # last, because it is long
    return made


def _front_of(keys: Sequence[str], points: Points) -> list[str]:
    return [keys[k] for k in pareto([points[key] for key in keys])]


def pooled(results: Results) -> dict[str, dict[str, Any]]:
    """Points by key: all repeats of a setting together, with medians, their noise and whether they can be trusted."""
    parts: dict[str, list[Mapping[str, Any]]] = {}
    for result in results.values():
        for reading in result.values.get("readings", ()):
            parts.setdefault(reading["key"], []).append(reading)
    return {key: _point(readings) for key, readings in parts.items()}


def _point(readings: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    first = readings[0]
    stopped = next((r["stopped"] for r in readings if r["stopped"]), "")
    seconds = [s for r in readings for s in r["seconds"]]
    median, deviation = middle(seconds)
    pace = [s for r in readings for s in r["per_step"]]
    per_step, per_step_mad = middle(pace)
    noise = [median * share for r in readings for share in r.get("noise", ())]
    error, error_mad = middle([real(r["error"]) for r in readings])
    value, value_mad = middle([real(r["value"]) for r in readings])
    typical = min(readings, key=lambda r: abs(middle(r["seconds"])[0] - median) if r["seconds"] else math.inf)

    def split(name: str) -> dict[str, dict[str, float]]:
        found: dict[str, list[float]] = {}
        for r in readings:
            for part, values in r[name].items():
                found.setdefault(part, []).extend(values)
        return {part: dict(zip(("median", "mad"), middle(values))) for part, values in found.items()}

    joules = [j for r in readings for j in r["joules"]]
    return {
        "words": first["words"],
        "knobs": dict(first["knobs"]),
        "shown": first["shown"],
        "error": float("nan") if stopped else error,
        "error_mad": error_mad,
        "value": float("nan") if stopped else value,
        "value_mad": value_mad,
        "seconds": float("nan") if stopped else median,
        "mad": deviation,
        "all_seconds": noise or seconds,
        "starts": seconds,
        "unstable": "" if stopped or not first["shown"] else instability(noise or seconds),
        "parts": split("parts"),
        "beside": split("beside"),
        "per_step": per_step,
        "per_step_mad": per_step_mad,
        "compile": next((r["compile"] for r in readings if r["compile"] is not None), None),
        "stopped": stopped,
        "expected": first["expected"],
        "spent": middle([r["spent"] for r in readings])[0],
        "curve": typical["curve"],
        "curves": [r["curve"] for r in readings if r["curve"]],
        "distribution": first["distribution"],
        "particles": first["particles"],
        "steps": first["steps"],
        "launches": first["launches"],
        "bytes": first["bytes"],
        "joules": middle(joules)[0] if joules else None,
        "scene": first["scene"],
    }


def elsewhere(point: Mapping[str, Any], points: Points, bar: float) -> str:
    """What speaks against a setting although its own error is small: the worst of what checks it; "" for nothing."""
    worst, said = bar, ""
    for p in points.values():
        checked = p["knobs"].get("checks", {})
        if not checked or any(point["knobs"].get(name) != value for name, value in checked.items()):
            continue
        if p["stopped"]:
            return f"{p['words']}: {p['stopped']}"
        if p["error"] > worst:
            worst, said = p["error"], f"{p['words']} it keeps {p['error']:.2g}"
    return said


def places(results: Results) -> list[dict[str, Any]]:
    """The machines and settings in which readings were taken; load and clocks as ranges."""
    found: dict[str, dict[str, Any]] = {}
    for result in results.values():
        where = result.values.get("where")
        if where is None:
            continue
        fixed = {k: v for k, v in where.items() if k not in ("load", "clock_mhz")}
        place = found.setdefault(json.dumps(fixed, sort_keys=True), {**fixed, "load": [], "clock_mhz": []})
        place["load"] += [] if where["load"] is None else [where["load"]]
        place["clock_mhz"] += [] if where["clock_mhz"] is None else list(where["clock_mhz"].values())
    for place in found.values():
        for name in ("load", "clock_mhz"):
            place[name] = [min(place[name]), max(place[name])] if place[name] else None
    return list(found.values())


def sources(panel: Panel, points: Points, band: Band | None) -> list[dict[str, Any]]:
    """The five sources of error apart, each by how much the observable still changes with it."""
    made = []
    for name, keys, knob, theory in (
        ("space", panel.space, "spacing", panel.space_theory),
        ("time", panel.time, "step", panel.time_theory),
        ("solver tolerance", panel.tolerance, "tolerance", 1.0),
        ("arithmetic", panel.arithmetic, "", 0.0),
    ):
        if isinstance(keys, str):
            made.append({"source": name, "size": None, "noise": None, "words": keys})
            continue
        there = [points[key] for key in keys if key in points and not points[key]["stopped"]]
        if len(there) < 2:
            made.append({"source": name, "size": None, "noise": None, "words": "not measured in this run"})
            continue
        last, finest = there[-2], there[-1]
        size = abs(last["value"] - finest["value"])
        entry = {"source": name, "size": size, "noise": math.hypot(last["value_mad"], finest["value_mad"])}
        if name == "arithmetic":
            entry["words"] = f"float32 differs from float64 by {size:.2g}"
        else:
            found = _order(panel, name, knob, theory, there)
            entry |= {"words": found.words, "order": asdict(found)}
        if entry["noise"] and size <= SURE * NORMAL * entry["noise"]:
            entry["words"] += f"; no more than the noise of the repeats ({entry['noise']:.2g})"
        for p in points.values():
            if p["knobs"].get("source") == name:
                entry["words"] += "".join(f"; {what}: {spread_words(d)}" for what, d in p["distribution"].items())
        made.append(entry)
    width = None if band is None else band.width
    words = "the reference has no spread of its own" if band is None else band.words
    made.append({"source": "reference", "size": width, "noise": None, "words": words})
    return made


def spread_words(found: Mapping[str, float]) -> str:
    """A distribution in words."""
    return f"median {found['median']:.1e}, 99 % {found['p99']:.1e}, max {found['max']:.1e}"


def _order(panel: Panel, name: str, knob: str, theory: float | None, there: Sequence[Mapping[str, Any]]) -> Order:
    size = [float(p["knobs"][knob]) for p in there]
    if name == "space" and panel.exact:
        return order_from_errors(size, [p["error"] for p in there], theory)
    return order_from_values(size, [p["value"] for p in there], theory)


def headline(panel: Panel, shown: Points) -> dict[str, Any]:
    """Time to the stated error: the fastest setting of each group, and what the others cost more; then equal numbers.

    A group that never gets there stands with the least error that it keeps.
    """
    groups: dict[str, list[tuple[str, Mapping[str, Any]]]] = {}
    for key, p in shown.items():
        if not p["stopped"]:
            groups.setdefault(group_of(p, panel.group), []).append((key, p))
    rows = []
    for group, members in groups.items():
        there = [(key, p) for key, p in members if p["to_stated"] is not None and not p["elsewhere"]]
        if there:
            key, p = min(there, key=lambda item: item[1]["to_stated"]["seconds"])
            rows.append({"group": group, "key": key, "words": p["words"], "reached": True, **p["to_stated"]})
        else:
            key, p = min(members, key=lambda item: item[1]["error"] if math.isfinite(item[1]["error"]) else math.inf)
            rows.append(
                {
                    "group": group,
                    "key": key,
                    "words": p["words"],
                    "reached": False,
                    "seconds": p["seconds"],
                    "mad": p["mad"],
                }
            )
        rows[-1]["error"] = p["error"]
    rows.sort(key=lambda row: (not row["reached"], row["seconds"]))
    best = rows[0]["seconds"] if rows and rows[0]["reached"] else float("nan")
    for row in rows:
        row["times_the_best"] = row["seconds"] / best if row["reached"] else float("nan")
    return {"stated": panel.stated, "group": panel.group, "rows": rows, "equal_numbers": _equal_numbers(panel, shown)}


def _equal_numbers(panel: Panel, shown: Points) -> list[dict[str, Any]]:
    """Where numbers of particles differ: the fastest of each group at numbers that several groups have (2 %).

    Secondary, because errors differ.
    """
    alive = {key: p for key, p in shown.items() if not p["stopped"]}
    numbers = [p["particles"] for p in alive.values()]
    if not numbers or max(numbers) <= 1.02 * min(numbers):
        return []
    fastest: dict[tuple[str, int], tuple[str, Mapping[str, Any]]] = {}
    for key, p in alive.items():
        place = group_of(p, panel.group), p["particles"]
        if place not in fastest or p["seconds"] < fastest[place][1]["seconds"]:
            fastest[place] = key, p
    rows = []
    for (group, number), (key, p) in fastest.items():
        if any(g != group and abs(n - number) <= 0.02 * number for g, n in fastest):
            rows.append(
                {
                    "key": key,
                    "group": group,
                    "words": p["words"],
                    "particles": number,
                    "seconds": p["seconds"],
                    "error": p["error"],
                }
            )
    return sorted(rows, key=lambda row: (row["particles"], row["seconds"]))


def effects(panel: Panel, points: Points) -> list[dict[str, Any]]:
    """What each effect costs: time and launches of a step, bytes of a particle, and what it does to the error."""
    rows = []
    for words, without, with_it in panel.effects:
        if without not in points or with_it not in points:
            continue
        off, on = points[without], points[with_it]
        row: dict[str, Any] = {"words": words, "without": without, "with": with_it}
        row["seconds"] = on["per_step"] - off["per_step"]
        row["noise"] = math.hypot(on["per_step_mad"], off["per_step_mad"])
        row["share"] = row["seconds"] / off["per_step"] if off["per_step"] else float("nan")
        row["error_without"], row["error_with"] = off["error"], on["error"]
        row["stopped_without"], row["stopped_with"] = off["stopped"], on["stopped"]
        for name in ("launches", "bytes"):
            known = off[name] is not None and on[name] is not None
            row[name] = on[name] - off[name] if known else None
        rows.append(row)
    return rows


def omissions(panel: Panel, points: Points, options: Options) -> list[str]:
    """What is not in the panel, and why."""
    made = [*without_gpu(panel.name, options), *panel.omissions(options)]
    if options.quick:
        made.append("runs stood side by side: times are rough")
    waiting: dict[str, list[str]] = {}
    for run in panel.runs(options):
        if run.skip:
            waiting.setdefault(run.skip, []).append(run.key)
    for key, p in points.items():
        if p["stopped"].startswith(MISSING):
            waiting.setdefault(f"{p['stopped'].removeprefix(MISSING)} (then --fresh)", []).append(key)
    made += [f"{', '.join(keys)}: {why}" for why, keys in waiting.items()]
    if points and all(p["joules"] is None for p in points.values()):
        made.append("energy: this machine counts none that could be read")
    return made


def advice(panel: Panel, points: Points, band: Band | None) -> str:
    """One sentence that says what to choose, by the rules of `validation.answers.choose`."""
    observable = answers.observable_of(panel.name, panel.title, panel.group)
    if not any(p["shown"] and not p["stopped"] and p["error"] is not None for p in points.values()):
        return "No setting came to an end, so that there is nothing to choose."
    found = [c for c in answers.candidates(points, observable) if "reported" not in c.point["knobs"]]
    spread = answers.uncertainty(points, observable, None if band is None else asdict(band))
    own = [c for c in found if not is_peer(c.point)] or found
    error = panel.stated / observable.scale if observable.stated is None else observable.stated
    named = f"{panel.observable} {panel.stated:.3g}"
    if observable.stated is not None:
        named = f"an error of {answers.percent(error)} {observable.relative}"
    choice = answers.choose(own, error, spread)
    if choice.advised is None:
        return (
            "; ".join([f"For {named} nothing is advised: {choice.why.removeprefix('not advised: ')}", *choice.notes])
            + "."
        )
    best = choice.advised
    said = [f"For {named} take {best.point['words']}: {duration(choice.seconds)}", *choice.notes]
    mine = group_of(best.point, panel.group)
    for rival in sorted({group_of(c.point, panel.group) for c in found} - {mine}):
        members = [c for c in found if group_of(c.point, panel.group) == rival]
        reach = [s for c in members if (s := c.seconds(error)) is not None and not c.point["elsewhere"]]
        if reach:
            said.append(f"{rival} takes {min(reach) / choice.seconds:.1f} times as long")
        else:
            near = min(members, key=lambda c: c.error)
            said.append(f"{rival} keeps {near.own:.2g} after {duration(real(near.point['seconds']))}")
    if spread < error:
        better = [
            c for c in own if c.settled and not answers.refused(c, own) and c.error < 0.9 * min(best.error, error)
        ]
        if better:
            finest = min(better, key=lambda c: c.error)
            text = f"{finest.own:.2g} costs {duration(real(finest.point['seconds']))} with {finest.point['words']}"
            if finest.error < spread:
                text += f", which is less than the reference can tell ({spread * observable.scale:.2g})"
            said.append(text)
    return "; ".join(said) + "."


# Tables


def tables(made: Mapping[str, Any]) -> list[Table]:
    """The points, where errors come from, what effects cost and what starting costs, as text."""
    front, found = set(made["front"]), []
    rows: list[list[Any]] = []
    shown = {key: p for key, p in made["points"].items() if p["shown"]}
    for p_key, p in sorted(shown.items(), key=lambda item: (bool(item[1]["stopped"]), item[1]["error"])):
        if p["stopped"]:
            rows.append([p["words"], None, None, None, None, f"failed: {p['stopped']}"])
            continue
        state = "front" if p_key in front else ""
        if "reported" in p["knobs"]:
            state = f"reported on {p['knobs']['reported']}"
        if p["elsewhere"]:
            state += (", " if state else "") + p["elsewhere"]
        if p["unstable"]:
            state += (", " if state else "") + f"unstable: {p['unstable']}"
        reach = p["to_stated"]
        rows.append(
            [
                p["words"],
                f"{p['error']:.3g}",
                duration(p["seconds"]),
                duration(p["mad"]),
                None if reach is None else duration(reach["seconds"]),
                state,
            ]
        )
    heading = ["setting", "error", "time", "MAD", f"time to {made['stated']:.3g}", ""]
    found.append(Table(f"{made['title']}: {made['observable']}", heading, rows, made["advice"]))
    found += headline_tables(made["headline"])
    rows = [[s["source"], None if s["size"] is None else f"{s['size']:.2g}", s["words"]] for s in made["sources"]]
    found.append(Table("Where the error comes from", ["source", "size", ""], rows, f"Reference: {made['reference']}."))
    if made["effects"]:
        rows = []
        for e in made["effects"]:
            after = e["stopped_with"] or f"{e['error_with']:.3g}"
            before = e["stopped_without"] or f"{e['error_without']:.3g}"
            rows.append(
                [
                    e["words"],
                    f"{1e3 * e['seconds']:+.3f}",
                    f"{1e3 * e['noise']:.3f}",
                    f"{100 * e['share']:+.0f} %",
                    before,
                    after,
                    signed(e["launches"]),
                    signed(e["bytes"]),
                ]
            )
        found.append(
            Table(
                "Cost of each effect",
                ["switched on", "ms a step", "noise", "share", "error off", "error on", "launches", "bytes a particle"],
                rows,
                "Off is free: launches and bytes are those of the plan, and what is off has none.",
            )
        )
    if made["starts"]:
        rows = [[s["words"], f"{s['cold']:.1f}", f"{s['warm']:.1f}"] for s in made["starts"]]
        found.append(
            Table(
                "Starting a process, to the end of its first steps [s]",
                ["scene", "nothing compiled before", "all compiled before"],
                rows,
            )
        )
    found.append(
        Table(
            "Apart from all times above",
            ["what", "seconds"],
            [["starting and first calls in these processes: compiling, or loading what was compiled", made["compile"]]],
        )
    )
    if made["omissions"]:
        found.append(Table("Left out", ["what, and why"], [[line] for line in made["omissions"]]))
    return found


def headline_tables(headline: Mapping[str, Any]) -> list[Table]:
    """Time to the stated error by group, and beside it the times at equal numbers of particles."""
    rows: list[list[Any]] = []
    for row in headline["rows"]:
        if row["reached"]:
            rows.append([row["group"], duration(row["seconds"]), f"{row['times_the_best']:.1f}", row["words"]])
        else:
            kept = f"never: keeps {row['error']:.2g} after {duration(row['seconds'])}"
            rows.append([row["group"], kept, None, row["words"]])
    heading = [headline["group"], f"time to {headline['stated']:.3g}", "times the best", "with"]
    found = [Table("Headline: time to the stated error", heading, rows)]
    if headline["equal_numbers"]:
        rows = [
            [f"{row['particles']:,}", row["group"], duration(row["seconds"]), f"{row['error']:.3g}", row["words"]]
            for row in headline["equal_numbers"]
        ]
        found.append(
            Table(
                "Secondary: time at equal numbers of particles",
                ["particles", headline["group"], "time", "its error", "with"],
                rows,
                "Errors differ, so that this is no comparison of programs.",
            )
        )
    return found


def signed(value: int | None) -> str | None:
    """A difference of whole numbers, with its sign."""
    return None if value is None else f"{value:+d}"


# Comparing two reports


@dataclass(frozen=True)
class Comparison:
    """Two reports of one panel: lines to print, and whether anything got worse."""

    lines: tuple[str, ...]
    worse: tuple[str, ...]


def read_report(path: str | Path) -> dict[str, Any]:
    """A report from its file; numbers that were not finite are NaN again. Raises InputError for another file."""
    try:
        made = read_json(Path(path))
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read as a report ({error}); give figures/accuracy_cost_*.json.") from None
    if not isinstance(made, dict) or made.get("schema") != SCHEMA:
        found = made.get("schema") if isinstance(made, dict) else type(made).__name__
        raise InputError(
            f"{path} is no report of schema {SCHEMA!r} (it says {found!r}); draw it anew with this refsim."
        )
    for p in made["points"].values():
        for name in ("error", "error_mad", "seconds", "mad"):
            p[name] = real(p[name])
    return made


def compare(old: Mapping[str, Any], new: Mapping[str, Any]) -> Comparison:
    """Judge every setting that both reports have. Times are compared on one machine with equal threads only.

    Raises InputError for reports of different panels.
    """
    if old["panel"] != new["panel"]:
        raise InputError(
            f"The reports are of panels {old['panel']!r} and {new['panel']!r}; give two reports of one panel."
        )

    def machine(made: Mapping[str, Any]) -> list[tuple[Any, ...]]:
        return sorted({(p["processor"], p["cores"], p["threads"], str(p["device"])) for p in made["where"]})

    same_machine = machine(old) == machine(new)
    before = {key: p for key, p in old["points"].items() if p["shown"]}
    after = {key: p for key, p in new["points"].items() if p["shown"]}
    rows, worse = [], []
    for key in before:
        if key not in after:
            continue
        a, b = before[key], after[key]
        error = error_verdict(a, b)
        time = time_verdict(a, b) if same_machine and not a["stopped"] and not b["stopped"] else UNSURE
        if a["stopped"] or b["stopped"]:
            shown = [p["stopped"] or f"{p['error']:.3g}" for p in (a, b)]
        else:
            shown = [f"{p['error']:.3g} in {duration(p['seconds'])}" for p in (a, b)]
        ratio = b["seconds"] / a["seconds"] if same_machine and a["seconds"] else float("nan")
        rows.append([a["words"], *shown, None if math.isnan(ratio) else f"{ratio:.2f}", error, time])
        worse += [f"{key}: {what}" for what, verdict in (("error", error), ("time", time)) if verdict == WORSE]
    lines = [str(Table(f"Panel {old['panel']}", ["setting", "old", "new", "time ratio", "error", "time"], rows))]
    for title, keys in (
        ("only in the old report", before.keys() - after.keys()),
        ("only in the new report", after.keys() - before.keys()),
    ):
        if keys:
            lines.append(f"{title}: {', '.join(sorted(keys))}")
    if not same_machine:
        lines.append("The machines or threads differ, so that times are not compared.")
    counts = {verdict: sum(row[5] == verdict for row in rows) for verdict in (BETTER, WORSE, UNSURE)}
    lines.append(
        f"{len(rows)} settings: {counts[BETTER]} faster, {counts[WORSE]} slower, {counts[UNSURE]} times cannot be told."
        " A time differs where it changes by more than three standard deviations of its noise and by 5 %."
    )
    lines.append("Verdict: " + (f"worse ({'; '.join(worse)})" if worse else "nothing got worse"))
    return Comparison(tuple(lines), tuple(worse))
