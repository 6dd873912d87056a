"""The material point method: what its transfers keep, a square that becomes a disc, and its speed beside Taichi."""

from __future__ import annotations

from typing import Any

from refsim.mpm import READINGS
from validation.cases.mpm_droplet import pictures, runs
from validation.harness import Case, Options, Picture, Results, Run
from validation.results import real
from validation.tables import Table
from validation.verdicts import Bounds, Measurement

COLUMNS = {
    "grid_mass": "mass on the grid", "grid_momentum": "momentum on the grid", "momentum": "momentum there and back",
    "velocity": "v", "gradient": "A at the surface", "power": "power balance",
}  # fmt: skip


def planned(options: Options) -> list[Run]:
    """The runs under the options."""
    reason = "takes minutes with the others; run without --quick" if options.quick else ""
    made = [Run("transfers", runs.transfers, {}, estimate=5.0)]
    for dim in (2, 3):
        made.append(Run(f"free_fall_{dim}d", runs.free_fall, {"backend": options.backend, "dim": dim}, estimate=3.0))
    for name in READINGS:
        parameters = {
            "backend": options.backend,
            "embedding": name,
            "cells": 20,
            "until": 0.2 if options.quick else 0.6,
        }
        made.append(Run(f"square_{name}", runs.square, parameters, 40.0, reason if name != "cluster" else ""))
    peer: dict[str, Any] = {"cells": 24 if options.quick else 40, "steps": 10, "rounds": 3 if options.quick else 5}
    peer |= {"threads": options.threads or 2, "backend": options.backend}
    asked = "" if options.peers else "asked for with --peers"
    made.append(Run("peer_taichi", runs.against_taichi, peer, estimate=60.0, skip=asked))
    return made


def judge(results: Results) -> list[Measurement]:
    """The cluster's errors and ledgers are judged, the printed readings' shown."""
    bounds, made = Bounds("mpm_droplet"), []
    if "transfers" in results:
        values = results["transfers"].values
        for name in COLUMNS:
            value = values["readings"]["cluster"][name]
            made.append(bounds.judge(f"cluster_{name}", abs(value - 1) if name == "power" else value))
        for reading in ("thesis", "gradient_corrected"):
            made.append(bounds.judge("reading_gradient", values["readings"][reading]["gradient"], reading))
        made.append(bounds.judge("rotation", values["rotation"]))
    for dim in (2, 3):
        if f"free_fall_{dim}d" in results:
            made.append(bounds.judge("free_fall", results[f"free_fall_{dim}d"].values["error"], f"{dim}d"))
    for reading in READINGS:
        if f"square_{reading}" in results:
            values = results[f"square_{reading}"].values
            rule = "square" if reading == "cluster" else "reading"
            for name in ("momentum", "angular", "centre", "least_ratio", "energy_rise"):
                made.append(bounds.judge(f"{rule}_{name}", real(values[name]), reading))
    if "peer_taichi" in results and not results["peer_taichi"].values["missing"]:
        values = results["peer_taichi"].values
        made.append(bounds.judge("peer_ratio", values["ratio"], "taichi", "Taichi"))
        made.append(bounds.judge("peer_difference", values["difference"], "taichi", "Taichi"))
    return made


def tables(results: Results) -> list[Table]:
    """Section 11.3 of the restatement, the ledgers of the square, and the other program."""
    made = []
    if "transfers" in results:
        found = results["transfers"].values["readings"]
        rows: list[list[Any]] = [[name, *(f"{found[name][c]:.2g}" for c in COLUMNS)] for name in READINGS]
        note = "Relative errors of an affine field of a ball of particles with samples; the power balance is to be 1."
        made.append(Table("What the readings of the embedding keep", ["reading", *COLUMNS.values()], rows, note))
    rows = []
    for name in READINGS:
        if f"square_{name}" in results:
            values = results[f"square_{name}"].values
            series = values["series"]
            cells = [f"{values[c]:.1e}" for c in ("momentum", "angular", "centre")]
            shape = [f"{series['perimeter'][-1]:.3f}", f"{values['least_ratio']:.3f}", f"{values['energy_rise']:+.1e}"]
            rows.append([name, values["stopped"] or "to the end", *cells, *shape])
    if rows:
        heading = ["reading", "ran", "momentum", "angular momentum", "centre, cells", "perimeter", "least J", "energy"]
        note = "Perimeter over that of the disc at the end; energy: highest over that at the start, less one."
        made.append(Table("A square of 20 cells becomes a disc", heading, rows, note))
    if "peer_taichi" in results:
        values = results["peer_taichi"].values
        if values["missing"]:
            made.append(Table("Other programs", ["program", "result"], [["Taichi", f"left out: {values['missing']}"]]))
        else:
            n = values["particles"]
            rows = []
            for words, key in ((f"Taichi {values['version']}", "peer"), ("refsim", "own")):
                spent = sorted(1e6 * seconds / n for seconds in values[key])
                rows.append([words, f"{spent[len(spent) // 2]:.4f}", f"{spent[0]:.4f} to {spent[-1]:.4f}"])
            made.append(
                Table(
                    f"Plain MLS-MPM liquid in space, {n:,} particles, float32, {values['threads']} threads, in turns",
                    ["program", "us per particle and step", "range"], rows,
                    f"Ratio {values['ratio']:.2f}; sorting is included here. Greatest difference of the results"
                    f" {values['difference']:.1e}.",
                )
            )  # fmt: skip
    return made


CASE = Case(
    name="mpm_droplet",
    title="transfers of MPM, four readings of the embedding, a square becomes a disc, speed beside Taichi",
    runs=planned,
    judge=judge,
    pictures=(
        Picture("mpm_square", pictures.square_data, pictures.square_picture, ("square_cluster",)),
        Picture("mpm_readings", pictures.readings_data, pictures.readings_picture, ("transfers",)),
    ),
    tables=tables,
)
