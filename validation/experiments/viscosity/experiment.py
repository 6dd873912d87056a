"""Spin and damping of free drops with either form of the viscosity, against rigid rotation and Lamb."""

from __future__ import annotations

from typing import Any

from validation.checks import Checks
from validation.experiment import Experiment, Options, Picture, Results, Run
from validation.experiments.viscosity import pictures, runs

RADII = {2: (8.0, 16.0, 32.0), 3: (5.0, 7.0, 10.0)}  # in spacings
KICKED = {2: 16.0, 3: 7.0}
OHNESORGE = (0.02, 0.05, 0.1)
SEED = 2


def planned(options: Options) -> list[Run]:
    """Three sizes in 2D and in 3D, and one that oscillates; with --quick the smallest in 2D."""
    if options.quick:
        return [_spin(2, RADII[2][0])]
    made = [_spin(dim, radius) for dim, radii in RADII.items() for radius in radii]
    for dim, radius in KICKED.items():
        drop: dict[str, Any] = {"dim": dim, "radius": radius, "seed": SEED, "ohnesorge": OHNESORGE}
        made.append(Run(f"swing_{dim}d", runs.swing, drop, estimate=30.0))
    return made


def _spin(dim: int, radius: float) -> Run:
    drop = {"dim": dim, "radius": radius, "seed": SEED}
    return Run(f"spin_{dim}d_{radius:g}", runs.spin, drop, estimate=0.02 * radius**dim)


def checks(results: Results, check: Checks) -> None:
    """Angular momentum, its braking, and the damping of n = 2; the rates are judged on the largest drops."""
    for key, result in results.items():
        row = result.values
        words = f"{row['dim']}D, R = {row['radius']:g} d"
        if key.startswith("swing"):
            for form in runs.FORMS:
                for number in row["ohnesorge"]:
                    name = f"{form}.{number:g}"
                    words_of_row = f"{form}, {words}, Oh = {number:g}"
                    check("seen", row[f"seen.{name}"], f"{key}.{name}", words_of_row)
            continue
        check("kept", row["change.central"], key, words)
        check("braking", row["braking.laplacian"], key, words)
        for form in runs.FORMS:
            check("damping", row[f"damping.{form}"], f"{key}.{form}", f"{form}, {words}")
        if row["radius"] == RADII[row["dim"]][-1]:
            check("braking_off", abs(row["braking.laplacian"] - 1), key, words)
            check("damping_off", abs(row["damping.central"] - 1), key, words)


EXPERIMENT = Experiment(
    name="viscosity",
    title="spin-down and damping (n = 2) of free drops with either form of the viscosity",
    runs=planned,
    checks=checks,
    pictures=(Picture("viscosity", pictures.data, pictures.picture),),
)
