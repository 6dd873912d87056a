"""Pictures of the pressure jump and of the sigma map."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt

from refsim.surface_tension.calibration import BASE
from validation.drawing import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION
from validation.experiment import Results
from validation.measure.drops import FITTED_FROM, MODELS, SEEDED, base
from validation.measure.sigma_map import at_base
from validation.results import real

COLOURS = dict(zip(MODELS, (BLACK, VERMILION, ORANGE, BLUE, SKY, GREEN, PURPLE, GREY, "#8c6d31", "#bbbbbb", "#d62fae")))
STYLES = {name: "--" if name.endswith(("cohesion", "soft")) else "-" for name in MODELS}


def jump_data(results: Results) -> dict[str, Any]:
    """Jump of each drop at the map's base, the fits, and the drops measured now."""
    values = results["map"].values
    names = ("model", "dim", "effective_radius", "pressure", "seed")
    drops = [{n: row[n] for n in names} for row in values["rows"] if at_base(row) and not row["stopped"]]
    fits = [
        {n: entry[n] for n in ("model", "dim", "laplace", "laplace_error", "intercept")}
        for entry in values["settings"]
        if at_base(entry) and math.isfinite(real(entry["laplace"]))
    ]
    rows = [result.values for key, result in results.items() if key != "map"]
    now = [{n: row[n] for n in names} for row in rows if not row["stopped"]]
    return {"title": "Pressure jump of drops at rest", "drops": drops, "fits": fits, "now": now}


def jump_picture(data: Mapping[str, Any]) -> Any:
    """Above: the jump against the curvature with its fits; below: R jump/(dim - 1) against R, level for a tension."""
    figure, grid = plt.subplots(2, 2, figsize=(9.6, 8.4))
    for dim, (above, below) in zip((2, 3), grid.T):
        least = FITTED_FROM * BASE["support"]  # smaller drops are not fitted: the surface reaches all of them
        for model, colour in COLOURS.items():
            own = sorted(
                (d for d in data["drops"] if d["model"] == model and d["dim"] == dim),
                key=lambda d: d["effective_radius"],
            )
            if not own:
                continue
            radius = [d["effective_radius"] for d in own]
            curvature, jump = [(dim - 1) / r for r in radius], [d["pressure"] for d in own]
            above.plot(curvature, jump, "o", ms=4, color=colour, label=MODELS[model][0])
            below.plot(
                radius, [p / c for p, c in zip(jump, curvature)], STYLES[model], marker="o", ms=4, lw=1.2, color=colour
            )
            for fit in data["fits"]:
                if fit["model"] == model and fit["dim"] == dim:
                    fitted = [c for c, r in zip(curvature, radius) if r > 0.98 * least]
                    ends = [min(fitted), max(fitted)]
                    line = [fit["intercept"] + fit["laplace"] * c for c in ends]
                    above.plot(ends, line, STYLES[model], lw=1.2, color=colour)
        now = [d for d in data.get("now", ()) if d["dim"] == dim]
        if now:
            radius = [d["effective_radius"] for d in now]
            curvature, jump = [(dim - 1) / r for r in radius], [d["pressure"] for d in now]
            ring = {"marker": "o", "ms": 8, "mfc": "none", "mec": "black", "mew": 1.0, "ls": "none"}
            above.plot(curvature, jump, label="Akinci 2013, measured now", **ring)
            below.plot(radius, [p / c for p, c in zip(jump, curvature)], **ring)
        steepest = (dim - 1) / least
        above.axvspan(steepest, 1.0, color="#eeeeee", lw=0)
        above.plot([0, steepest], [0, steepest], color=GREY, lw=0.8, ls=":")
        above.set(xlim=(0, 1.15 * steepest), ylim=(0, 5.2 * steepest), title=f"{dim}D: jump against curvature")
        above.set(xlabel=f"curvature {'2/R' if dim == 3 else '1/R'} [1/d]", ylabel="pressure jump [nominal sigma/d]")
        below.axvspan(0, least, color="#eeeeee", lw=0)
        below.axhline(1, color=GREY, lw=0.8, ls=":")
        below.set(xlim=(4, 26 if dim == 2 else 15), ylim=(0, 8.5), title=f"{dim}D: the same as a tension")
        below.set(xlabel="radius R [d]", ylabel="R jump/(dim - 1) over the nominal tension")
        for axes in (above, below):
            axes.grid(True)
    below_note = (
        "h = 2.6 d (IISPH 2 d), S = 0.01; lines above: fits; grey: R < 3 h, not fitted; dotted: the nominal tension"
    )
    figure.suptitle(below_note, fontsize=9.5)
    handles: dict[str, Any] = {}
    for axes in grid[0]:
        handles |= {label: handle for handle, label in zip(*axes.get_legend_handles_labels())}
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=4, fontsize=8)
    return figure


def map_data(results: Results) -> dict[str, Any]:
    """The map's settings."""
    return {"title": "Measured over nominal surface tension", "settings": results["map"].values["settings"]}


def map_picture(data: Mapping[str, Any]) -> Any:
    """Left: jump and frequency of each model's drops at the base; right: along the axes h/d and S."""
    figure, grid = plt.subplots(2, 3, figsize=(11.5, 7.8), width_ratios=(1.6, 1, 1))
    for line, dim in zip(grid, (2, 3)):
        own = [e for e in data["settings"] if e["dim"] == dim]
        _models(line[0], [e for e in own if at_base(e)])
        line[0].set_title(f"{dim}D, R = {SEEDED[dim]:g} d, h = 2.6 d, S = 0.01")
        for axes, axis, fixed, label in (
            (line[1], "support", ("stiffness", 0.01), "support radius h/d"),
            (line[2], "stiffness", ("support", 2.6), "stiffness S = sigma/(rho c^2 d)"),
        ):
            _along(axes, [e for e in own if e[fixed[0]] == fixed[1] and e["kernels"] == "mueller"], axis, dim)
            axes.set(xlabel=label, title=f"{dim}D, R = {SEEDED[dim]:g} d")
    handles: dict[str, Any] = {}
    for axes in grid[:, 1:].flat:
        handles |= {label: handle for handle, label in zip(*axes.get_legend_handles_labels())}
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=4, fontsize=8)
    figure.suptitle("Surface tension over the nominal one: by the jump (full) and by the frequency (open)", fontsize=11)
    return figure


def at_radius(entry: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """The drops of the radius at which several seeds are measured."""
    found = [d for d in entry["drops_by_radius"] if d["radius"] == SEEDED[entry["dim"]]]
    return found[0] if found else None


def _models(axes: Any, entries: list[dict[str, Any]]) -> None:
    place = {name: -k for k, name in enumerate(MODELS)}
    for e in entries:
        y, colour, drops = place[e["model"]], COLOURS[e["model"]], at_radius(e)
        for name, marker, shift in (("laplace", "o", 0.14), ("rayleigh", "s", -0.14)):
            if drops is None:
                continue
            bar = drops[f"{name}_spread"] or 0.0
            face = colour if marker == "o" else "white"
            axes.errorbar(drops[name], y + shift, xerr=bar, fmt=marker, ms=6, color=colour, mfc=face, capsize=2, lw=1.2)
        if drops is None:
            reasons = ", ".join(e["stopped"]) or "no frequency"
            axes.text(11.3, y, reasons, ha="right", va="center", fontsize=7.5, color=GREY)
    axes.axvline(1, color=GREY, lw=0.8, ls=":")
    own = {
        name: "" if base(name)["support"] == BASE["support"] else f", h = {base(name)['support']:g} d" for name in place
    }
    axes.set_yticks(list(place.values()), [MODELS[name][0] + own[name] for name in place])
    axes.set(xlim=(0, 11.5), ylim=(-len(place) + 0.4, 0.6))
    axes.grid(True, axis="x")


def _along(axes: Any, entries: list[dict[str, Any]], axis: str, dim: int) -> None:
    drawn: set[float] = set()
    for model, colour in COLOURS.items():
        own = sorted((e for e in entries if e["model"] == model and at_radius(e)), key=lambda e: e[axis])
        if len(own) < 2:
            continue
        x = [e[axis] for e in own]
        drawn |= set(x)
        for name, face, style in (("laplace", colour, "-"), ("rayleigh", "white", "--")):
            drops = [at_radius(e) for e in own]
            values, bars = [d[name] for d in drops if d], [d[f"{name}_spread"] or 0.0 for d in drops if d]
            axes.errorbar(
                x, values, bars, fmt=style, marker="o", ms=5, lw=1.2, color=colour, mfc=face, capsize=2,
                label=MODELS[model][0] if style == "-" else None,
            )  # fmt: skip
    axes.axhline(1, color=GREY, lw=0.8, ls=":")
    axes.set_ylim(0, 9)
    axes.grid(True)
    if drawn:
        axes.set_xticks(sorted(drawn), [f"{value:g}" for value in sorted(drawn)])
    else:
        axes.set_xticks([])
        axes.text(0.5, 0.5, "not measured", transform=axes.transAxes, ha="center", color=GREY)
