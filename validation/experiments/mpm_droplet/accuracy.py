"""What accuracy costs in MPM drops: the pressure of a disc at rest over cells, step, quadrature, normals, dtype and
backend."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from validation.checks import Checks
from validation.experiment import Band, Options, Panel, Run
from validation.experiments.mpm_droplet import accuracy_runs, frequency_runs
from validation.work_precision import REPEATS

BASE = 11.0
RADII = (5.5, 8.0, 11.0, 16.0)
ON_GPU = (5.5, 11.0)
BEST = {"normals": "gradient", "offset": 0.25, "iterations": 1}


def settings(options: Options) -> dict[str, dict[str, Any]]:
    """The default at several cell sizes, and what differs from it in one thing."""
    made: dict[str, dict[str, Any]] = {}

    def add(key: str, words: str, radius: float = BASE, step: float = 1.0, dtype: str = "float32", shown: bool = True,
            **tension: Any) -> None:  # fmt: skip
        knobs = {"spacing": 1.0 / radius, "step": step, "dtype": dtype, "backend": options.backend}
        knobs |= {"quadrature": tension.get("quadrature", "facets"), "normals": tension.get("normals", "mls")}
        knobs["way"] = f"{knobs['quadrature']}, {options.backend}"
        probes = "inset" in tension  # a surface at r presses too hard: it may end in a stop
        made[key] = {
            "words": words,
            "knobs": knobs,
            "radius": radius,
            "tension": tension,
            "shown": shown,
            "probes": probes,
        }

    for radius in RADII[:2] if options.quick else ON_GPU if options.backend == "cuda" else RADII:
        add(f"r{radius:g}", f"R = {radius:g} h", radius)
    base = f"R = {BASE:g} h, "
    if not options.quick and options.backend != "cuda":
        add("step1.4", base + "1.4 stable steps", step=1.4)
        add("step0.5", base + "half the step", step=0.5)
        add("float64", base + "float64", dtype="float64")
        for radius in RADII[1:3]:
            key = "poisson" if radius == BASE else f"poisson_{radius:g}"
            add(key, f"R = {radius:g} h, Poisson-disk samples", radius, quadrature="poisson")
        add("gradient", base + "gradient, epsilon h/4, 1 sweep", **BEST)
        add("enclosing", base + "inset by volume", enclose_volume=True)
        add("at_r", base + "surface left at r (thesis M31)", inset=-1.0)
        add("bare", base + "nothing embedded", embedding="none")
    return made


def runs(options: Options) -> list[Run]:
    """One run, in which all settings take turns."""
    parameters = {
        "settings": settings(options), "backend": options.backend, "threads": options.threads,
        "repeats": 2 if options.quick else REPEATS,
    }  # fmt: skip
    return [Run("pressures", accuracy_runs.pressures, parameters, estimate=10.0 if options.quick else 240.0)]


def frequency_settings(options: Options) -> dict[str, dict[str, Any]]:
    """Swinging discs of several cell sizes, and what differs from R = 11 h in one thing."""
    made: dict[str, dict[str, Any]] = {}

    def add(key: str, words: str, radius: float = BASE, step: float = 1.0, dtype: str = "float32",
            quadrature: str = "facets") -> None:  # fmt: skip
        knobs = {"spacing": 1.0 / radius, "step": step, "dtype": dtype, "backend": options.backend}
        knobs |= {"quadrature": quadrature, "way": f"{quadrature}, {options.backend}"}
        made[key] = {"words": words, "knobs": knobs, "radius": radius, "tension": {"quadrature": quadrature}}

    for radius in RADII[:1] if options.quick else RADII:
        add(f"r{radius:g}", f"R = {radius:g} h", radius)
    if not options.quick and options.backend != "cuda":
        base = f"R = {BASE:g} h, "
        add("step0.5", base + "half the step", step=0.5)
        add("float64", base + "float64", dtype="float64")
        add("poisson", base + "Poisson-disk samples", quadrature="poisson")
        add("poisson_8", "R = 8 h, Poisson-disk samples", 8.0, quadrature="poisson")
    return made


def frequency_runs_of(options: Options) -> list[Run]:
    """One run, in which all settings take turns."""
    parameters = {
        "settings": frequency_settings(options), "backend": options.backend, "threads": options.threads,
        "repeats": 1 if options.quick else REPEATS,
    }  # fmt: skip
    return [Run("frequencies", frequency_runs.frequencies, parameters, estimate=5.0 if options.quick else 300.0)]


def checks(report: Mapping[str, Any], check: Checks) -> None:
    """The default at R = 11 h is judged, the rest and all times are shown."""
    for key, point in report["points"].items():
        if not point["stopped"]:
            rule = "default_error" if key == f"r{BASE:g}" else "error"
            check(rule, point["error"], key, point["words"])
            check("time", point["seconds"], key, point["words"])


PANELS = (
    Panel(
        name="mpm_pressure",
        title="Pressure of a disc at rest, MPM with a reconstructed surface",
        observable="mean pressure over k/R, less one",
        reference="Laplace's pressure k/R of the disc of the same volume",
        stated=0.01,
        runs=runs,
        space=tuple(f"r{radius:g}" for radius in RADII),
        space_theory=1.0,
        time=("step1.4", f"r{BASE:g}", "step0.5"),
        time_theory=1.0,
        arithmetic=(f"r{BASE:g}", "float64"),
        tolerance="sweeps of the fit are no tolerance: more of them fit the bumps of the union of spheres",
        group="way",
        lines=(
            ("facets, finer h", [f"r{radius:g}" for radius in RADII]),
            ("Poisson disks, finer h", ["poisson_8", "poisson"]),
            ("GPU, finer h", [f"cuda_r{radius:g}" for radius in ON_GPU]),
        ),
        effects=(
            ("inset by volume", f"r{BASE:g}", "enclosing"),
            ("embedded points", "bare", f"r{BASE:g}"),
            ("Poisson-disk samples for facets", f"r{BASE:g}", "poisson"),
            ("float64 for float32", f"r{BASE:g}", "float64"),
        ),
        checks=checks,
        omissions=lambda options: [
            "backend numpy: the references compare all pairs and are for small runs",
        ],
    ),
    Panel(
        name="mpm_frequency",
        title="Frequency of a disc that swings, MPM with a reconstructed surface",
        observable="frequency of mode 2 over Rayleigh's, distance from 1",
        reference="Rayleigh's frequency of the disc of the same volume",
        stated=0.02,
        runs=frequency_runs_of,
        space=tuple(f"r{radius:g}" for radius in RADII),
        space_theory=1.0,
        time=(f"r{BASE:g}", "step0.5"),
        time_theory=1.0,
        arithmetic=(f"r{BASE:g}", "float64"),
        tolerance="sweeps of the fit are no tolerance: more of them fit the bumps of the union of spheres",
        band=lambda points: Band(0.003, "amplitude of 5 % and compressibility lower the frequency by so much"),
        group="way",
        lines=(
            ("facets, finer h", [f"r{radius:g}" for radius in RADII]),
            ("Poisson disks, finer h", ["poisson_8", "poisson"]),
            ("GPU, finer h", [f"cuda_r{radius:g}" for radius in RADII]),
        ),
        effects=(("Poisson-disk samples for facets", f"r{BASE:g}", "poisson"),),
    ),
)
