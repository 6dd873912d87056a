"""What accuracy costs on meshes: evenness of particles over iterations, the distance over spacing and bytes."""

from __future__ import annotations

from typing import Any

from validation.experiment import Options, Panel, Run
from validation.experiments.boundary import sampling_runs, tank_runs
from validation.peers import libigl, splishsplash_sampling
from validation.work_precision import REPEATS

ITERATIONS = (1, 3, 10, 20, 30, 1000)
SPACINGS = (0.16, 0.08, 0.04, 0.02)
COUNT = 5000
TANKS = (6, 10, 14, 20)  # particles along an edge


def quality_runs(options: Options) -> list[Run]:
    """One run, in which all settings take turns."""
    settings: dict[str, dict[str, Any]] = {}

    def add(key: str, words: str, iterations: int, dtype: str = "float32", count: int = COUNT) -> None:
        knobs = {"dtype": dtype, "backend": options.backend, "particles": count}
        settings[key] = {"words": f"{words}, {dtype}", "knobs": knobs, "iterations": iterations, "count": count}

    for number in ITERATIONS[::2] if options.quick else ITERATIONS:
        add(f"k{number}", f"{number} iterations" if number < 1000 else "until they rest", number)
    if not options.quick:
        add("k1000_float64", "until they rest", 1000, "float64")
        add("k1000_half", f"until they rest, {COUNT // 2:,} particles", 1000, count=COUNT // 2)
    parameters = {"settings": settings, "backend": options.backend, "threads": options.threads,
                  "repeats": 2 if options.quick else REPEATS}  # fmt: skip
    made = [Run("quality", sampling_runs.quality, parameters, estimate=30.0)]
    if options.backend != "cpu" or options.quick:
        return made
    knobs = {"program": "SPlisHSPlasH", "dtype": "float32", "backend": "cpu"}
    other = {"key": "splishsplash", "words": "SPlisHSPlasH's surface sampling", "knobs": knobs, "count": COUNT,
             "threads": options.threads or 2, "repeats": REPEATS}  # fmt: skip
    return [*made, Run("peer", sampling_runs.quality_by_splishsplash, other, 20.0, splishsplash_sampling.missing())]


def distance_runs(options: Options) -> list[Run]:
    """One run, in which all settings take turns."""
    settings: dict[str, dict[str, Any]] = {}
    for spacing in SPACINGS[:2] if options.quick else SPACINGS:
        knobs = {"spacing": spacing, "dtype": "float32", "backend": options.backend}
        settings[f"h{spacing:g}"] = {"words": f"h = {spacing:g} m, float32", "knobs": knobs}
    knobs = {"spacing": SPACINGS[1], "dtype": "float64", "backend": options.backend}
    settings[f"h{SPACINGS[1]:g}_float64"] = {"words": f"h = {SPACINGS[1]:g} m, float64", "knobs": knobs}
    parameters = {"settings": settings, "backend": options.backend, "threads": options.threads,
                  "repeats": 2 if options.quick else REPEATS}  # fmt: skip
    made = [Run("distance", sampling_runs.distance, parameters, estimate=40.0)]
    if options.backend != "cpu" or options.quick:
        return made
    others = {
        f"libigl_h{spacing:g}": {
            "words": f"libigl, the nodes of h = {spacing:g} m",
            "knobs": {"program": "libigl", "spacing": spacing, "dtype": "float64", "backend": "cpu"},
        }
        for spacing in SPACINGS
    }
    parameters = {"settings": others, "threads": options.threads or 2, "repeats": REPEATS}
    return [*made, Run("libigl", sampling_runs.distance_by_libigl, parameters, 60.0, libigl.missing())]


def tank_runs_of(options: Options) -> list[Run]:
    """One run, in which all settings take turns; with --quick the coarsest, once."""
    settings: dict[str, dict[str, Any]] = {}
    for cells in TANKS[:1] if options.quick else TANKS:
        for dtype in ("float32", "float64") if cells == TANKS[1] else ("float32",):
            knobs = {"spacing": tank_runs.HEIGHT / cells, "dtype": dtype, "backend": options.backend}
            key = f"n{cells}" + ("_float64" if dtype == "float64" else "")
            settings[key] = {"words": f"d = H/{cells}, {dtype}", "knobs": knobs, "cells": cells}
    parameters = {
        "settings": settings, "backend": options.backend, "threads": options.threads,
        "repeats": 1 if options.quick else REPEATS,
    }  # fmt: skip
    return [Run("tanks", tank_runs.tanks, parameters, estimate=3.0 if options.quick else 120.0)]


PANELS = (
    Panel(
        name="boundary_sampling",
        title="Boundary particles on an organic shape",
        observable="variation of the distance to the nearest particle",
        reference="equal distances",
        stated=0.05,
        runs=quality_runs,
        space="more particles are no better spread",
        time="nothing is stepped",
        arithmetic=("k1000", "k1000_float64"),
        tolerance="iterations are the panel's own axis",
        effects=(("float64 for float32", "k1000", "k1000_float64"),),
        exact=False,
    ),
    Panel(
        name="signed_distance",
        title="Signed distance from a ball of 82k triangles",
        observable="rms error of the trilinear distance within 0.02 m of the surface [m]",
        reference="the ball that the mesh was cut from",
        stated=1e-3,
        runs=distance_runs,
        space=tuple(f"h{spacing:g}" for spacing in SPACINGS),
        space_theory=2.0,
        time="nothing is stepped",
        arithmetic=(f"h{SPACINGS[1]:g}", f"h{SPACINGS[1]:g}_float64"),
        tolerance="nothing is iterated",
        omissions=lambda options: ["spacings below the mesh's own edges, 0.017 m"],
    ),
    Panel(
        name="tank_pressure",
        title="Pressure of a tank whose walls are a mesh",
        observable="rms error of the pressure over rho g H",
        reference="hydrostatic pressure of the compressible liquid",
        stated=0.05,
        runs=tank_runs_of,
        space=tuple(f"n{cells}" for cells in TANKS),
        space_theory=1.0,
        time="the stable step alone",
        arithmetic=(f"n{TANKS[1]}", f"n{TANKS[1]}_float64"),
        tolerance="no solver iterates",
    ),
)
