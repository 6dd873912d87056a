"""What accuracy costs in the dam break: detectors against the exact surface, and the surge front."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Any

from validation.checks import Checks
from validation.experiment import Band, Options, Panel, Points, Run
from validation.experiments.dam_break import accuracy_runs
from validation.experiments.dam_break.runs import TRUTH_RADIUS
from validation.metrics.dam_break import data_tolerance
from validation.start_up import start_up
from validation.work_precision import REPEATS

PEER = "SPlisHSPlasH"
LAMBDAS = (0.90, 0.92, 0.95, 0.98, 0.99)
DTYPES = ("float32", "float64")
METHODS = {  # words, fields of the effect
    "number_density": ("number density", {"method": "number_density"}),
    "fan_scan": ("fan scan of all", {"method": "fan_scan"}),
    "two_step": ("two-step", {"method": "two_step"}),
    "two_step_printed": ("two-step as printed", {"method": "two_step", "literal": ["E23"]}),
}
QUICK_LAMBDAS = (0.90, 0.98)


def detector_settings(dtype: str, quick: bool = False) -> dict[str, dict[str, Any]]:
    """Every detector with every threshold, scan radius and scan normal that it has."""
    made: dict[str, dict[str, Any]] = {}
    for method, (words, effect) in METHODS.items():
        scans = [("", "")] if method == "number_density" else [(s, n) for s in RADII for n in NORMALS]
        thresholds = [None] if method == "fan_scan" else list(QUICK_LAMBDAS if quick else LAMBDAS)
        for radius, normal in scans[:1] if quick else scans:
            for threshold in thresholds:
                key, said = [method], [words]
                knobs: dict[str, Any] = {"method": words, "dtype": dtype}
                fields = dict(effect)
                if threshold is not None:
                    key.append(f"{threshold:.2f}")
                    said.append(f"lambda {threshold:.2f}")
                    knobs["threshold"] = fields["threshold"] = threshold
                if radius:
                    key += [radius, normal]
                    said += [RADII[radius], NORMALS[normal]]
                    knobs |= {"scan_radius": radius, "scan_normal": normal}
                    fields |= {"scan_radius": radius, "scan_normal": normal}
                key.append(dtype)
                like = ""
                if method == "two_step":
                    like = "_".join(["two_step_printed", *key[1:]])
                made["_".join(key)] = {
                    "words": ", ".join([*said, dtype]), "knobs": knobs, "effect": fields, "like": like,
                }  # fmt: skip
    return made


RADII = {"half": "s = h/2", "full": "s = h"}
NORMALS = {"color": "J(19)", "corrected": "J(20)"}


def detection_runs(options: Options, state: str) -> list[Run]:
    """One run for each dtype (and list radius in 3D, where lists are long); in each, all detectors take turns."""
    made = []
    for dtype in DTYPES[:1] if options.quick else DTYPES:
        settings = detector_settings(dtype, options.quick)
        for radius in ("half", "full"):
            chosen = {
                key: s for key, s in settings.items()
                if s["knobs"].get("scan_radius", "half") == radius
            }  # fmt: skip
            if not chosen:
                continue
            parameters = {"state": state, "settings": chosen, "dtype": dtype, "backend": options.backend,
                          "threads": options.threads, "repeats": 2 if options.quick else REPEATS}  # fmt: skip
            made.append(
                Run(f"{dtype}_{radius}", accuracy_runs.detectors, parameters, estimate=3.0 if options.quick else 12.0)
            )
    if not options.quick and options.backend == "cpu" and state.endswith("2d"):
        scenes = {
            f"detection, {dtype}": {
                "module": "validation.experiments.dam_break.accuracy_runs",
                "function": "detection_scene",
                "parameters": {"state": state, "effect": {"method": "two_step", "each_step": True}, "dtype": dtype},
            }
            for dtype in DTYPES[:1]
        }
        parameters = {"scenes": scenes, "backend": options.backend, "threads": options.threads}
        made.append(Run("start", start_up, parameters, estimate=30.0))
    return made


def detection_checks(report: Mapping[str, Any], check: Checks) -> None:
    """The best F1 of each detector and how long it takes are shown; the bars on detection stand in the dam break."""
    alive = [p for p in report["points"].values() if p["shown"] and not p["stopped"]]
    for words in dict.fromkeys(p["knobs"]["method"] for p in alive):
        best = min((p for p in alive if p["knobs"]["method"] == words), key=lambda p: p["error"])
        name = f"{report['panel']}.{words.replace(' ', '_')}"
        check("best_f1", 1.0 - best["error"], name, best["words"])
        check("detection_time", 1e3 * best["seconds"], name, best["words"])


def _detection_panel(state: str, dim: str, stated: float, cover: str) -> Panel:
    def key(method: str, *parts: str) -> str:
        return "_".join([method, *parts])

    usual = key("two_step", "0.90", "half", "color")
    return Panel(
        name=f"detection_{dim.lower()}",
        title=f"Surface detection on a stored dam break, {dim}",
        observable="1 - F1",
        reference=f"{cover}, radius {TRUTH_RADIUS:g} spacings: which particles a probe of that size can touch",
        stated=stated,
        runs=functools.partial(detection_runs, state=state),
        space="the cloud is given: detection has no spacing of its own",
        time="the cloud is given: nothing is stepped",
        tolerance="no solver iterates",
        arithmetic=(usual + "_float32", usual + "_float64"),
        band=lambda points: None,
        effects=(
            ("asymmetry beside J(12)", key("two_step_printed", "0.90", "half", "color", "float32"), usual + "_float32"),
            ("first step before the scan", key("fan_scan", "half", "color", "float32"), usual + "_float32"),
            ("J(20) for J(19)", usual + "_float32", key("two_step", "0.90", "half", "corrected", "float32")),
            ("s = h for s = h/2", usual + "_float32", key("two_step", "0.90", "full", "color", "float32")),
            ("float64 for float32", usual + "_float32", usual + "_float64"),
        ),
        group="method",
        checks=detection_checks,
        omissions=lambda options: [
            "backend numpy: the references compare all pairs, which no detector's time is about",
            *(["3D, float64, s = h, J(20) and most thresholds: run without --quick"] if options.quick else []),
        ],
    )


# The surge front

SPACINGS = (10, 14, 20, 28, 40)  # columns
STEPS = (0.25, 0.5, 1.0, 1.4, 2.0)  # of the stable step; above 1 fixed steps, of which the scene refuses the longest
MIDDLE = 20
WATER = {"jiang_zhu_2023": {"surface_tension": 0.072}}
DETECTION = {"surface_detection": {"each_step": True}}


def front_settings(options: Options) -> list[dict[str, Any]]:
    """All settings of the front."""
    made: list[dict[str, Any]] = []

    def add(key: str, words: str, columns: int, dtype: str = "float32", step: float = 1.0,
            backend: str = options.backend, effects: Mapping[str, Any] | None = None, **more: Any) -> None:  # fmt: skip
        knobs = {"spacing": 0.5 / columns, "step": step, "dtype": dtype, "backend": backend}
        said = f"d = L/{columns}, {dtype}, {backend}" + (f", {words}" if words else "")
        made.append({"key": key, "words": said, "knobs": {**knobs, **more.pop("knobs", {})}, "columns": columns,
                     "effects": dict(effects or {}), "backend": backend, **more})  # fmt: skip

    for columns in SPACINGS[:3] if options.quick else SPACINGS:
        add(f"d{columns}", "", columns)
    if options.quick:
        return made
    for step in STEPS:
        if step != 1.0:
            add(
                f"step{step:g}",
                f"{step:g} of the stable step" + (", fixed" if step > 1 else ""),
                MIDDLE,
                step=step,
                expected=step > 1.0,
            )
    for columns in (MIDDLE, 28):
        add(f"d{columns}_float64", "", columns, dtype="float64")
    for backend in ("numpy", "cpu") if options.backend == "cpu" else ():
        add(f"d6_{backend}", "", 6, dtype="float64", backend=backend)
    add("detection", "surface detection in every step", MIDDLE, effects=DETECTION)
    add("water", "surface tension of water", MIDDLE, effects=WATER)
    return made


def front_peers() -> dict[str, dict[str, Any]]:
    """SPlisHSPlasH's columns."""
    made = {}
    for columns in SPACINGS[:4]:
        key = f"peer_d{columns}"
        knobs = {"program": PEER, "spacing": 0.5 / columns, "step": 1.0, "dtype": "float32", "backend": "cpu"}
        made[key] = {"key": key, "words": f"{PEER}, DFSPH, d = L/{columns}", "knobs": knobs, "columns": columns}
    return made


def front_estimate(setting: Mapping[str, Any]) -> float:
    """Seconds that a setting may take."""
    if setting["backend"] == "numpy":
        return 4.0
    seconds = 0.02 + 8.0 * (setting["columns"] / 40) ** 3 / setting["knobs"]["step"]
    return seconds * (1.5 if setting["knobs"]["dtype"] == "float64" else 1.0)


def front_runs(options: Options) -> list[Run]:
    """Every setting in turn, the peer among them."""
    own, repeats = front_settings(options), 2 if options.quick else REPEATS
    parameters = {
        "settings": {setting["key"]: setting for setting in own}, "backend": options.backend,
        "peers": front_peers() if options.backend == "cpu" and not options.quick else {},
        "threads": options.threads, "repeats": repeats,
    }  # fmt: skip
    return [Run("fronts", accuracy_runs.fronts, parameters, repeats * sum(map(front_estimate, own)))]


def front_band(points: Points) -> Band:
    """The experiments' own disagreement."""
    return Band(data_tolerance(), "the experiments differ from each other by as much")


def front_checks(report: Mapping[str, Any], check: Checks) -> None:
    """The time into the experiments' spread is shown, and whether the finest spacing lies in it is judged."""
    rows = report["headline"]["rows"]
    if rows and rows[0]["reached"]:
        check("time_to_stated", rows[0]["seconds"], "", "")
    finest = [p for p in report["points"].values() if p["shown"] and not p["stopped"]]
    if finest:
        best = min(finest, key=lambda p: p["knobs"]["spacing"])
        check("deviation", best["error"], "finest", best["words"])


PANELS: Sequence[Panel] = (
    _detection_panel("dam_break_2d", "2D", 0.1, "exact arc cover of the particles' circles"),
    _detection_panel("dam_break_3d", "3D", 0.15, "exact cap cover of the particles' spheres"),
    Panel(
        name="front",
        title="Surge front of a 2D dam break",
        observable="largest deviation of the front",
        reference="Martin & Moyce 1952, n^2 = 2, a = 2.25 in, after one fitted time offset",
        stated=data_tolerance(),
        runs=front_runs,
        space=[f"d{columns}" for columns in SPACINGS],
        time=["step1.4", f"d{MIDDLE}", "step0.5", "step0.25"],
        tolerance="no solver iterates: the equation of state is explicit",
        arithmetic=(f"d{MIDDLE}", f"d{MIDDLE}_float64"),
        exact=False,
        space_theory=1.0,  # the artificial viscosity is in proportion to the spacing
        time_theory=2.0,
        band=front_band,
        effects=(
            ("surface detection in every step", f"d{MIDDLE}", "detection"),
            ("surface tension of water", f"d{MIDDLE}", "water"),
            ("float64 for float32", f"d{MIDDLE}", f"d{MIDDLE}_float64"),
        ),
        checks=front_checks,
        omissions=lambda options: ["3D: the 2D front stands in the literature's data"],
    ),
)
