"""What accuracy costs in the reconstruction of a surface: normals over sweeps, epsilon, kind and dtype."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from validation.checks import Checks
from validation.experiment import Options, Panel, Run
from validation.experiments.surface_reconstruction.runs import WORDS, normals, peer_normals, words_of
from validation.peers import pysplashsurf
from validation.work_precision import REPEATS

OFFSETS = (0.25, 0.5, 1.0)
SWEEPS = (1, 3, 10, 30, 100)
RADII = (4.5, 9.0, 18.0)
DEFAULT = "mls_0.5_10_float32"
BEST = "gradient_0.25_1_float32"


def settings(options: Options) -> dict[str, dict[str, Any]]:
    """Every kind of normals, and the best one on other radii."""
    made: dict[str, dict[str, Any]] = {}

    def add(key: str, tension: Mapping[str, Any], dtype: str = "float32", **more: Any) -> None:
        words = f"{words_of(tension)}, {dtype}" + (f", radius {more['radius']:g} h" if more else "")
        spacing = 1.0 / more.get("radius", RADII[1])  # a cell, in radii
        knobs = {"normals": WORDS[tension["normals"]], "spacing": spacing, "dtype": dtype, "backend": options.backend}
        knobs |= {name: tension[name] for name in ("offset", "iterations") if name in tension}
        knobs["way"] = WORDS[tension["normals"]] + (", GPU" if options.backend == "cuda" else "")
        made[key] = {"words": words, "knobs": knobs, "tension": dict(tension), **more}

    for kind in ("facets", "offsets"):
        add(kind, {"normals": kind})
    for kind in ("mls", "gradient"):
        for offset in OFFSETS[:2] if options.quick else OFFSETS:
            for sweeps in (1, 10) if options.quick else SWEEPS:
                tension = {"normals": kind, "offset": offset, "iterations": sweeps}
                add(f"{kind}_{offset:g}_{sweeps}_float32", tension)
    add("mls_0.5_10_float64", {"normals": "mls", "offset": 0.5, "iterations": 10}, "float64")
    if not options.quick:
        for radius in (RADII[0], RADII[2]):
            tension = {"normals": "gradient", "offset": 0.25, "iterations": 1}
            add(f"radius_{radius:g}", tension, radius=radius)
    return made


def runs(options: Options) -> list[Run]:
    """One run, in which all settings take turns."""
    parameters = {
        "settings": settings(options), "backend": options.backend, "threads": options.threads,
        "repeats": 2 if options.quick else REPEATS,
    }  # fmt: skip
    made = [Run("normals", normals, parameters, estimate=8.0 if options.quick else 90.0)]
    if options.backend != "cpu" or options.quick:
        return made
    others = {
        f"pysplashsurf_{share:g}_{smoothing}": {
            "words": f"pysplashsurf, cells of {share:g} h, {f'{smoothing} rounds of' if smoothing else 'no'} smoothing",
            "knobs": {"program": "pysplashsurf", "normals": "pysplashsurf", "dtype": "float64", "backend": "cpu",
                      "smoothing": smoothing},
            "share": share, "smoothing": smoothing,
        }
        for share, smoothing in ((0.5, 0), (0.5, 25), (1.0, 0))  # smoothing cells of 1 h shrinks the sphere away
    }  # fmt: skip
    parameters = {"settings": others, "threads": options.threads or 2, "repeats": REPEATS}
    return [*made, Run("pysplashsurf", peer_normals, parameters, 20.0, pysplashsurf.missing())]


def checks(report: Mapping[str, Any], check: Checks) -> None:
    """The best setting's error is judged; the default's, the facets' and all times are shown."""
    for name, key in (("best_error", BEST), ("default_error", DEFAULT), ("facet_error", "facets")):
        if key in report["points"]:
            point = report["points"][key]
            check(name, point["error"], key, point["words"])
            check("normals_time", 1e3 * point["seconds"], key, point["words"])


PANELS = (
    Panel(
        name="surface_normals",
        title="Normals of a particle cloud, sphere of radius 9 h",
        observable="mean angle to the true normal [degrees]",
        reference="the normal of the sphere that cut the cloud, at the nearest point",
        stated=4.0,
        runs=runs,
        space=("radius_4.5", BEST, "radius_18"),
        space_theory=0.0,
        time="nothing is stepped",
        arithmetic=("mls_0.5_10_float32", "mls_0.5_10_float64"),
        tolerance="sweeps are no tolerance: more of them fit the bumps of the union of spheres, and the error grows",
        group="way",
        lines=tuple(
            (
                f"{'MLS' if kind == 'mls' else 'gradient'}, epsilon {offset:g} h",
                [f"{kind}_{offset:g}_{sweeps}_float32" for sweeps in SWEEPS],
            )
            for kind in ("mls", "gradient")
            for offset in OFFSETS
        ),
        effects=(
            ("gradient for MLS", DEFAULT, "gradient_0.5_10_float32"),
            ("float64 for float32", DEFAULT, "mls_0.5_10_float64"),
        ),
        checks=checks,
        omissions=lambda options: [
            "pysplashsurf's seconds contain its mesh, which stands beside refsim's: a part of both that differs",
            "epsilon = 2 h: its second points leave the band of samples, normals flip (see the experiment's tables)",
        ],
    ),
)
