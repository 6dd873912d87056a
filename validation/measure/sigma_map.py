"""The measured drops (`data/drops.json`) condensed into the sigma map that `refsim.calibrate` reads.

`python -m validation measure sigma_map` writes it anew from the rows that `measure drops` measured. The experiments
`laplace` and `oscillation` show it, and measure a few of its drops again.
"""

import hashlib
import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from refsim.core.writing import write_file
from refsim.surface_tension.calibration import MAP as PACKAGED
from validation.experiment import RunSpec
from validation.measure import drops
from validation.measure.drops import FITTED_FROM, MODELS, SEEDED, Point, fit_laplace, measure
from validation.results import Result, finite
from validation.running import Context

ROWS = Path(__file__).resolve().parent.parent / "data" / "drops.json"
AXES = ("model", "dim", "support", "stiffness", "kernels", "liquid")
WORST_MISFIT = 0.35  # of the oscillation's fit: beyond it no frequency is read


def read_rows(path: Path = ROWS) -> list[dict[str, Any]]:
    """The measured drops, free or on a plane; null becomes NaN, and the pressure gets the part of the random motion.

    Irving & Kirkwood's pressure is virial and motion together: P = virial + rho <v^2>/dim. The rows hold the virial
    and the rms speed at rest over sqrt(sigma/(rho R)).
    """
    rows = json.loads(path.read_text(encoding="utf-8")).values() if path.exists() else []
    made = [{name: math.nan if value is None else value for name, value in row.items()} for row in rows]
    return [with_motion(row) if "spurious" in row and not row["stopped"] else row for row in made]


def with_motion(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row whose `pressure` and `laplace` hold the part of the random motion."""
    dim, radius = row["dim"], row["effective_radius"]
    moving = row["spurious"] ** 2 / radius / dim
    return {**row, "pressure": row["pressure"] + moving, "laplace": row["laplace"] + moving * radius / (dim - 1)}


def condensed(rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """One entry for each setting, sorted.

    laplace, laplace_error, intercept  fit of P = (dim - 1) sigma/R + P0 over the radii, sigma over the nominal one
    flat_laplace                       limit for R to infinity of the drops' R P/(dim - 1) by a line in 1/R
    rayleigh, rayleigh_spread          mean and standard deviation over the drops whose oscillation could be fitted
    drops_by_radius                    of each radius [d] whose frequency was read: both tensions of the drops
                                       themselves, R P/(dim - 1) and Rayleigh's, means and deviations over the seeds
    radii                              in spacings, of the drops that lasted
    stopped                            how many drops ended otherwise, by reason
    """
    groups: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    for row in rows:
        if row["dim"] == 2 or row["radius"] not in drops.SWINGING:
            groups.setdefault(setting_of(row, AXES), []).append(row)
    return [_entry(dict(key), groups[key]) for key in sorted(groups, key=lambda key: str([value for _, value in key]))]


def setting_of(row: Mapping[str, Any], axes: Sequence[str]) -> tuple[tuple[str, Any], ...]:
    """Name and value of each axis of a row; that of the density where it is not summed."""
    return tuple((name, row[name]) for name in axes if name != "liquid" or not drops.summed(row))


def _entry(entry: dict[str, Any], rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    lasting = [row for row in rows if not row["stopped"]]
    slope, error, intercept = fit_laplace(lasting)
    waves = [r["rayleigh"] for r in lasting if _read(r) and r["radius"] >= SEEDED[r["dim"]]]
    large = [r for r in lasting if r["radius"] >= FITTED_FROM * r["support"]]
    entry |= {
        "laplace": slope,
        "laplace_error": error,
        "intercept": intercept,
        "flat_laplace": _flat(large),
        "rayleigh": float(np.mean(waves)) if waves else math.nan,
        "rayleigh_spread": float(np.std(waves)) if len(waves) > 1 else math.nan,
        "drops_by_radius": [
            _of_radius(lasting, radius)
            for radius in sorted({r["radius"] for r in lasting if _read(r)})
            if radius >= SEEDED[entry["dim"]]
        ],
        "radii": sorted({r["radius"] for r in lasting}),
        "drops": len(rows),
        "stopped": dict(Counter(r["stopped"] for r in rows if r["stopped"])),
        "spurious": max((r["spurious"] for r in lasting), default=math.nan),
    }
    return entry


def _flat(rows: Sequence[Mapping[str, Any]]) -> float:
    """What the jump's tension of drops becomes where curvature is gone (Tolman 1949); NaN below three radii."""
    if len({r["radius"] for r in rows}) < 3:
        return math.nan
    return float(np.polyfit([1 / r["effective_radius"] for r in rows], [r["laplace"] for r in rows], 1)[1])


def _read(row: Mapping[str, Any]) -> bool:
    return row.get("misfit", math.nan) <= WORST_MISFIT


def _of_radius(rows: Sequence[Mapping[str, Any]], radius: float) -> dict[str, Any]:
    valid = [r for r in rows if r["radius"] == radius and _read(r)]
    row: dict[str, Any] = {"radius": radius, "seeds": len(valid)}
    for name in ("laplace", "rayleigh"):
        values = [r[name] for r in valid]
        row |= {
            name: float(np.mean(values)),
            f"{name}_spread": float(np.std(values, ddof=1)) if len(valid) > 1 else None,
        }
    return row


def at_base(entry: Mapping[str, Any]) -> bool:
    """Whether a row or setting of the map stands where the axes of its model cross."""
    return drops.at_base(entry["model"], entry)


# What the experiments have in common


def published(context: Context, rows: str) -> Result:
    """The rows and settings on file; `rows` is the file's digest."""
    stored = read_rows()
    return Result({"settings": condensed(stored), "rows": stored})


def drop(context: Context, **point: Any) -> Result:
    """One drop measured now, as `measure drops` does, with its part of the random motion."""
    row = measure(Point(**point))
    return Result(row if row["stopped"] else with_motion(row))


def digest_of(file: Path) -> str:
    """Sixteen digits that change with the file."""
    return hashlib.sha256(file.read_bytes()).hexdigest()[:16]


def map_run() -> RunSpec:
    """The run that reads the published map."""
    return RunSpec("map", published, {"rows": digest_of(ROWS)}, estimate=1.0)


def drop_run(model: str, dim: int, radius: float, seed: int = 1) -> RunSpec:
    """One drop at the map's base, which is not kicked."""
    point = {"model": model, "dim": dim, "radius": radius, "seed": seed, "kicked": False}
    return RunSpec(f"{model}_{dim}d_R{radius:g}_{seed}", drop, point, 0.4e-3 * radius ** (dim + 1.5))


def words_of(row: Mapping[str, Any]) -> str:
    """Model and dimension in words."""
    return f"{MODELS[row['model']][0]}, {row['dim']}D"


def write(rows: Iterable[Mapping[str, Any]], path: Path = PACKAGED) -> int:
    """Write the map; returns how many settings it has."""
    return write_settings([rounded(entry) for entry in condensed(rows)], path)


def write_settings(settings: Sequence[Any], path: Path) -> int:
    """Write one setting a line; returns how many there are."""
    entries = [json.dumps(finite(entry), allow_nan=False) for entry in settings]
    write_file(path, '{"settings": [\n' + ",\n".join(entries) + "\n]}\n")
    return len(entries)


def rounded(value: Any) -> Any:
    """Five digits are more than any drop gives."""
    if isinstance(value, Mapping):
        return {name: rounded(each) for name, each in value.items()}
    if isinstance(value, list):
        return [rounded(each) if isinstance(each, Mapping) else each for each in value]
    return float(f"{value:.5g}") if isinstance(value, float) and math.isfinite(value) else value
