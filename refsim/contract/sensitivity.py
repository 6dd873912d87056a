"""What a verdict on a whole run would have noticed: the least error of each parameter; and what nothing touched."""

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import msgspec

from refsim.contract.whole_runs import AXES, Comparison, run_of
from refsim.core.errors import InputError, RunStopped
from refsim.scene.scene import Scene

LITTLE = 0.01  # share by which a parameter is off in the runs that are compared
SCALED = ("acceleration", "velocity")  # vectors that are multiplied as a whole; others are places


class Sensitivity(NamedTuple):
    """The least error of a parameter, as a share of it, that the measure `by` would have shown; infinite for none."""

    parameter: str
    error: float
    by: str


def sensitivities(scene: Scene, compared: Comparison, backend: str) -> Iterator[Sensitivity]:
    """The least error of each parameter of the scene's effects that the comparison would have noticed.

    One run with each parameter off by a hundredth, of which less, or more, is a multiple.
    """
    for name, altered in off_by_little(scene):
        try:
            run = run_of(altered, None, compared.times, backend)
        except (InputError, RunStopped):
            yield Sensitivity(name, LITTLE, "the run, which stops")
            continue
        shares = {}
        for measure, curve in compared.curves.items():
            moved = max(abs(values[measure] - usual) for values, usual in zip(run, curve))
            shares[measure] = LITTLE * compared.bands[measure] / moved if moved > 0 else math.inf
        by = min(shares, key=lambda measure: shares[measure])
        yield Sensitivity(name, shares[by], by if shares[by] < math.inf else "")


def off_by_little(scene: Scene) -> Iterator[tuple[str, Scene]]:
    """(parameter, scene with it a hundredth larger, or smaller where more is not possible)."""
    for effect in scene.effects:
        for field in msgspec.structs.fields(type(effect)):
            value = getattr(effect, field.name)
            number = isinstance(value, float) and math.isfinite(value) and value != 0
            vector = field.name in SCALED and isinstance(value, tuple) and any(value)
            for share in (1 + LITTLE, 1 - LITTLE) if number or vector else ():
                other: Any = tuple(share * v for v in value) if vector else share * value
                try:
                    yield f"{effect.name}.{field.name}", scene.with_(**{f"{effect.name}__{field.name}": other})
                    break
                except InputError:
                    continue


def untouched(scene: Scene, compared: Comparison, found: Mapping[str, float]) -> list[str]:
    """Faces of walls that no particle came near, gauges whose values stood still, effects without any action.

    found  {parameter: least error}, see `sensitivities`
    """
    told = []
    for effect in scene.effects:
        errors = [error for name, error in found.items() if name.partition(".")[0] == effect.name]
        if errors and min(errors) == math.inf:
            told.append(f"effect {effect.name}")
        places: list[Any] = [getattr(effect, name, None) for name in ("lower", "upper")]
        for axis in range(scene.dim) if all(isinstance(place, tuple) for place in places) else ():
            for sign, word, place in (("-", "smallest", places[0]), ("+", "largest", places[1])):
                curve, face = compared.curves.get(f"{word} {AXES[axis]}", ()), f"{sign}{AXES[axis]}"
                apart = min((abs(value - place[axis]) for value in curve), default=0.0)
                if apart > scene.support_radius and face not in getattr(effect, "open_faces", ()):
                    told.append(f"{effect.name} {face}")
    return told + [f"gauge {name}" for name in compared.still]
