"""Readings of panels by SPlisHSPlasH (DFSPH): surge front, drop that was a cube; by PySPH: tank, vortices.

Each function is called as its panel, and gives the reading of a number of a point, on one thread.
"""

import numpy as np

from refsim.study.panels import Point
from refsim.study.panels.observables import FALL, GRAVITY, REYNOLDS, kept
from refsim.study.runs import Reading
from validation.experiments.dam_break.runs import DENSITY, HEIGHT, LID, viscosity
from validation.peers import pysph_flows, splishsplash
from validation.reading import reading

WALLED = 15.0  # column widths: the tank of the front
STEP = 2e-3  # s, the longest of the front, which SPlisHSPlasH shortens by the speed (CFL number 0.5)


def front(point: Point, repeat: int) -> Reading:
    """Mean front over t sqrt(2g/L) from 1 to 3 by DFSPH, with the kinematic viscosity of the experiment `dam_break`."""
    width, columns = 0.5 * HEIGHT, point.setting["columns"]
    peer = splishsplash.run_column(
        {
            "columns": columns, "width": width, "length": WALLED * width, "height": LID, "step": STEP,
            "viscosity": viscosity(width / columns) / DENSITY, "shake": repeat,
            "times": (FALL * np.arange(0.0, 4.625, 0.05)).tolist(),
        },
        1,
    )  # fmt: skip
    if "missing" in peer:
        return reading(failed=f"missing: {peer['missing']}")
    place = np.interp(np.linspace(1.0, 3.0, 41), np.array(peer["time"]) / FALL, np.array(peer["front"]) / width)
    return reading(float(place.mean()), peer["wall"][-1], peer["steps"], peer["particles"])


def droplet(point: Point, repeat: int) -> Reading:
    """Radius variation that a drop keeps under Akinci et al. 2013, and the seconds after which it does."""
    peer = splishsplash.run_drop({**point.setting["settings"], "shake": repeat}, 1)
    if "missing" in peer:
        return reading(failed=f"missing: {peer['missing']}")
    value = kept(np.array(peer["time"]), peer["error"])
    above = [k for k, error in enumerate(peer["error"]) if not error <= value]
    torn = "" if np.isfinite(value) else "torn: no outer surface all around"
    seconds = peer["wall"][above[-1] + 1 if above else 0]
    return reading(value, seconds, peer["steps"], peer["particles"], torn)


def vortex_decay(point: Point, repeat: int) -> Reading:
    """Rate at which the speed of four vortices decays in 1 s, over 8 pi^2/Re."""
    peer = pysph_flows.run("vortices", point.setting["scheme"], point.setting["cells"], [1.0])
    if "missing" in peer:
        return reading(failed=f"missing: {peer['missing']}")
    x, y = 2 * np.pi * peer["position"][-1].T
    first = (np.sin(x) * np.cos(y)) ** 2 + (np.cos(x) * np.sin(y)) ** 2
    decay = -0.5 * np.log((peer["velocity"][-1] ** 2).sum() / first.sum()) / peer["time"][-1]
    return reading(float(decay * REYNOLDS / (8 * np.pi**2)), peer["seconds"], peer["steps"], len(x))


def implicit_pressure(point: Point, repeat: int) -> Reading:
    """Root mean square of p - rho g (H - y) over rho g H farther than h from walls and surface, in places and pressures
    of the mean of samples; the kinematic viscosity is that of refsim's liquid."""
    cells, sound = point.setting["cells"], pysph_flows.SOUND
    reach, end = 2.6 / cells, 5.0 / np.sqrt(GRAVITY)
    times = (end * np.linspace(0.8, 1.0, 61)).tolist()
    peer = pysph_flows.run("tank", point.setting["scheme"], cells, times, viscosity=sound * reach / 200)
    if "missing" in peer:
        return reading(failed=f"missing: {peer['missing']}")
    x, y = peer["position"].mean(0).T
    bulk = (np.minimum(x, 1 - x) > reach) & (np.minimum(y, 1 - y) > reach)
    off = peer["pressure"].mean(0) / (1000.0 * GRAVITY) - (1 - y)
    return reading(float(np.sqrt((off[bulk] ** 2).mean())), peer["seconds"], peer["steps"], len(x))
