"""Stored panels of figures/ as the measured points that `refsim study` and `refsim advise` read; run once."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from validation.accuracy import panels  # noqa: E402
from validation.answers import OBSERVABLES, report, time_to  # noqa: E402
from validation.experiment import Options, discover  # noqa: E402
from validation.results import finite, real  # noqa: E402

TO = Path("refsim/study/panels")
BARS = sorted({0.1, 0.05, 0.01, 0.005, 0.001, *(round(float(10**e), 4) for e in np.arange(-3, -0.3, 0.05))}, reverse=True)


def extras(panel: Any) -> dict[str, dict[str, Any]]:
    """What each setting takes beside its words and knobs, by key."""
    found: dict[str, dict[str, Any]] = {}
    for backend, before in (("cpu", ""), ("cuda", "cuda_")):
        for run in panel.runs(Options(backend=backend)):
            p = run.parameters
            several = [p.get("settings"), p.get("peers")]
            if any(isinstance(each, dict) and all(isinstance(v, dict) for v in each.values()) for each in several):
                for each in several:
                    for key, setting in (each or {}).items():
                        found.setdefault(before + key, setting)
            elif "key" in p:
                found.setdefault(before + p["key"], p)
    drop = ("key", "words", "knobs", "shown", "expected", "backend", "threads", "repeats", "repeat")
    return {key: {n: v for n, v in s.items() if n not in drop} for key, s in found.items()}


def point(key: str, p: dict[str, Any], setting: dict[str, Any] | None, place: int, scale: float) -> dict[str, Any]:
    knobs = {n: v for n, v in p["knobs"].items() if n not in ("reported", "checks")}
    made = {"key": key, "words": p["words"], "program": knobs.pop("program", "refsim"), "knobs": knobs,
            "setting": setting or {}, "place": place}
    if p["knobs"].get("checks"):
        made["speaks_against"] = p["knobs"]["checks"]
    if not p["shown"]:
        made["shown"] = False
    if p["stopped"]:
        return made | {"failed": p["stopped"], "spent": p["spent"], "particles": p["particles"]}
    made |= {"value": p["value"], "value_mad": p["value_mad"], "error": real(p["error"]) / scale,
             "error_mad": real(p["error_mad"]) / scale, "seconds": p["starts"], "steps": p["steps"],
             "step_seconds": p["per_step"], "particles": p["particles"]}
    if p["all_seconds"] != p["starts"]:
        made["noise"] = p["all_seconds"]
    if p["bytes"] is not None:
        made |= {"bytes": p["bytes"] * p["particles"], "launches": p["launches"]}
    if p["joules"] is not None:
        made["joules"] = p["joules"]
    if p["scene"]:
        made["scene"] = p["scene"]
    if len(p["parts"]) > 1:
        made["parts"] = {n: v["median"] for n, v in p["parts"].items()}
    if p["beside"]:
        made["beside"] = {n: v["median"] for n, v in p["beside"].items()}
    if p["distribution"]:
        made["distribution"] = p["distribution"]
    if p.get("elsewhere"):
        made["against"] = p["elsewhere"]
    if p["curves"]:
        made["reached"] = [[bar / scale, found["seconds"]] for bar in BARS if (found := time_to(p, bar)) is not None]
    return made


def convert(name: str, panel: Any) -> None:
    data = report(name)
    settings = extras(panel)
    where, places = data["where"], []
    for w in where:
        device = w["device"] or {}
        places.append({
            "machine": w["processor"], "threads": w["threads"], "cores": w["cores"], "device": device.get("name", ""),
            "driver": device.get("driver_version", ""), "date": w.get("date") or data["dates"][-1],
            "commit": w["source"]["commit"], "load": w["load"], "versions": w["versions"],
        })
    gpu = next((k for k, w in enumerate(where) if w["device"]), 0)
    peer = next((k for k, w in enumerate(where) if w["backend"] == "peer"), 0)
    rows = []
    for key, p in data["points"].items():
        place = gpu if "reported" in p["knobs"] else peer if p["knobs"].get("program", "refsim") != "refsim" else 0
        rows.append(point(key, p, settings.get(key), place, OBSERVABLES[name].scale))
        if key not in settings:
            print(name, "no setting for", key)
    starts = {s["words"]: [s["cold"], s["warm"]] for s in data["starts"]}
    lines = ",\n".join(json.dumps(finite(row), allow_nan=False) for row in rows)
    head = json.dumps({"schema": "refsim panel, version 1", "name": name, "places": places} |
                      ({"starts": starts} if starts else {}))
    text = head[:-1] + ', "points": [\n' + lines + "\n]}\n"
    json.loads(text)
    (TO / f"{name}.json").write_text(text)


if __name__ == "__main__":
    known = panels(discover())
    for name in OBSERVABLES:
        convert(name, known[name][1])
