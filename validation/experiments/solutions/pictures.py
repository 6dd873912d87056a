"""The picture of error against spacing, problem by problem."""

from collections.abc import Mapping
from functools import partial
from typing import Any

from validation.drawing import BLUE, GREEN, GREY, VERMILION
from validation.experiment import Picture, Results
from validation.experiments.solutions.runs import _behind

TITLES = {
    "ellipse": ("Ellipse in a central force", {"error": "semi-axis", "period_off": "period"}),
    "disc": ("Spin-down of a disc", {"rate_off": "rate"}),
    "vortex": ("Taylor-Green vortex", {"rate_off": "rate of decay", "error": "velocity"}),
}
PERIODIC = {
    "couette": ("Couette start-up", {"error": "velocity", "steady": "steady"}),
    "poiseuille": ("Poiseuille start-up", {"error": "velocity", "steady": "steady"}),
}
WITH_TENSION = {
    "capillary": ("Capillary wave", {"error": "surface", "crest_off": "first crest"}),
    "meniscus": ("Liquid lifted by a wall", {"lifted_off": "area"}),
}
STYLES = ("-", "--")
COLOURS = {"": BLUE, "laplacian": VERMILION, "central": BLUE, "rests": GREEN, "70": BLUE, "110": VERMILION}
WORDS = {
    "": "", "laplacian": ", J(11)", "central": ", central", "rests": ", that rests",
    "70": ", 70 degrees", "110": ", 110 degrees",
}  # fmt: skip


Titles = Mapping[str, tuple[str, Mapping[str, str]]]


def _collected(results: Results, titles: Titles) -> dict[str, Any]:
    """The relative errors of every run of these problems, by problem and viscosity."""
    series: dict[str, dict[str, list[float]]] = {}
    for key, result in results.items():
        name = key.rpartition("_")[0]
        if name.partition("_")[0] not in titles:
            continue
        one = series.setdefault(name, {"spacing": []})
        for quantity in ("spacing", *titles[name.partition("_")[0]][1]):
            if quantity in result.values:
                one.setdefault(quantity, []).append(result.values[quantity])
    return series


def _drawn(data: Mapping[str, Any], titles: Titles) -> Any:
    """A panel a problem, with the order between the largest and the smallest spacing."""
    import matplotlib.pyplot as plt
    import numpy as np

    shown = [problem for problem in titles if any(name.partition("_")[0] == problem for name in data)]
    figure, panels = plt.subplots(1, len(shown), figsize=(10.0, 3.7), squeeze=False)
    for axes, problem in zip(panels[0], shown):
        title, quantities = titles[problem]
        largest, places = 0.0, np.array([1.0])
        for name, one in data.items():
            if name.partition("_")[0] != problem:
                continue
            form = name.partition("_")[2]
            for (quantity, label), style in zip(quantities.items(), STYLES):
                if quantity in one:
                    places = np.array(one["spacing"])
                    exponent = np.log(one[quantity][0] / one[quantity][-1]) / np.log(places[0] / places[-1])
                    axes.loglog(places, one[quantity], style, marker="o", ms=4, color=COLOURS[form],
                                label=f"{label}{WORDS[form]}: order {round(float(exponent), 1) + 0.0:g}")  # fmt: skip
                    largest = max(largest, one[quantity][0])
        axes.loglog(places, largest * places / places[0], ":", color=GREY, lw=1.0, label="first order")
        across = "spacing [m]" if titles is TITLES else "spacing over length"
        axes.set(title=title, xlabel=across, ylabel="relative error")
        axes.set_xticks(places, [f"{place:.3g}" for place in places])
        axes.xaxis.set_minor_locator(plt.NullLocator())
        axes.grid(True)
        axes.legend(fontsize=7, handlelength=3.5, loc="upper center", bbox_to_anchor=(0.5, -0.2))
    return figure


PICTURES = tuple(
    Picture(name, partial(_collected, titles=titles), partial(_drawn, titles=titles), _behind(titles))
    for name, titles in (
        ("solutions", TITLES), ("solutions_periodic", PERIODIC), ("solutions_tension", WITH_TENSION)
    )
)  # fmt: skip
