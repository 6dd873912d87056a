"""Other methods for the same scene: how its liquid is advanced, its walls push, its surface pulls, its heat flows."""

import itertools
import math
import typing
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from refsim.core.effect import Effect
from refsim.core.errors import InputError
from refsim.scene.plan import make_plan
from refsim.scene.scene import Scene
from refsim.sph.iisph import ImplicitPressure
from refsim.study.convergence import Convergence, Reference, converge
from refsim.study.runs import Reading, Setting

PARAMETERS = {"liquid": ("density", "gradient"), "walls": ("model",), "heat": ("scheme",)}
OWN = "as it is"  # the scene's own method
Runs = Sequence[tuple[Setting, Reading]]
METHODS = (*PARAMETERS, "tension")
MODELS = ("akinci", "dong", "he", "jiang_zhu", "becker_teschner", "tartakovsky_meakin", "csf", "akinci_iisph")


def others(scene: Scene, kinds: Sequence[str], left_out: list[str]) -> dict[str, Scene]:
    """The scene by each other method of these `METHODS`, by its label; why one cannot be planned is said.

    A liquid that needs extrapolated walls gets them.
    """
    found = {}
    for kind in kinds:
        if kind not in METHODS:
            raise InputError(f"study: there is no kind of methods {kind!r}; choose from {', '.join(METHODS)}.")
        for label, effects in _tensions(scene) if kind == "tension" else _choices(scene, kind):
            walls = tuple(_with(effect, model="extrapolated") for effect in effects)
            why = _planned(scene, effects)
            if why and kind == "liquid" and not _planned(scene, walls):
                label, effects, why = f"{label}, walls extrapolated", walls, ""
            if why:
                left_out.append(f"{label} left out: {why}")
            else:
                found[label] = msgspec.structs.replace(scene, effects=effects)
    return found


def _planned(scene: Scene, effects: tuple[Effect, ...]) -> str:
    """Why the scene cannot be planned with these effects; "" where it can."""
    try:
        make_plan(msgspec.structs.replace(scene, effects=effects))
    except InputError as error:
        return str(error)
    return ""


def _with(effect: Effect, **values: object) -> Effect:
    """The effect with other values of its parameters, if it has them all."""
    return msgspec.structs.replace(effect, **values) if all(hasattr(effect, name) for name in values) else effect


def _choices(scene: Scene, kind: str) -> Iterator[tuple[str, tuple[Effect, ...]]]:
    """Effects with other values of the parameters of a kind, all that have them alike; a liquid's implicit pressure."""
    names, effects = PARAMETERS[kind], _resolved(scene)
    having = [effect for effect in effects if all(hasattr(effect, name) for name in names)]
    if not having:
        return
    known = typing.get_type_hints(type(having[0]))
    own = tuple(getattr(having[0], name) for name in names)
    for chosen in itertools.product(*(_literals(known[name]) for name in names)):
        if chosen != own:
            other = (f"{name} {value}" for name, value, before in zip(names, chosen, own) if value != before)
            label = f"walls {chosen[0]}" if kind == "walls" else ", ".join(other)
            yield label, tuple(_with(effect, **dict(zip(names, chosen))) for effect in effects)
    if kind == "liquid" and not any(isinstance(effect, ImplicitPressure) for effect in effects):
        plain = (_with(_with(effect, density="summation", gradient="plain"), model="mirrored") for effect in effects)
        yield "implicit pressure", (*plain, ImplicitPressure())


def _resolved(scene: Scene) -> tuple[Effect, ...]:
    """The scene's effects with the values that parameters of `PARAMETERS` and the viscosity have by default."""
    planned, names = make_plan(scene).effects, itertools.chain(*PARAMETERS.values(), ("viscosity",))
    for name in names:
        effects = (_with(e, **{name: getattr(planned[e.name], name, None)}) for e in scene.effects)
        scene = msgspec.structs.replace(scene, effects=tuple(effects))
    return scene.effects


def _literals(known: Any) -> tuple[str, ...]:
    """The values of a parameter, without None."""
    inside = typing.get_args(known)
    return inside if all(isinstance(value, str) for value in inside) else _literals(inside[0])


def _tensions(scene: Scene) -> Iterator[tuple[str, tuple[Effect, ...]]]:
    """Effects with each other model of the surface tension in place of the scene's, of the same tension."""
    from refsim.surface_tension.calibration import BESIDE, SETTINGS  # which a package without these effects lacks

    names = {SETTINGS[name][1](1.0).name for name in MODELS}
    for k, effect in enumerate(scene.effects):
        if effect.name not in names:
            continue
        tension = getattr(effect, "surface_tension", None)
        if tension is None:
            raise InputError(f"study: {effect.name} has no surface_tension that another model could have; give it.")
        for name in MODELS:
            label, make = SETTINGS[name]
            model = make(tension)
            if model.name != effect.name or name in BESIDE:
                yield label, (*scene.effects[:k], model, *scene.effects[k + 1 :], *BESIDE.get(name, ()))


# What they buy


@dataclass(frozen=True)
class Line:
    """One method over the spacings at which it gave a value, the coarsest first; `failed`: why others did not.

    An error is at least the uncertainty of what it is taken from: below it nothing is known.
    """

    label: str
    spacing: tuple[float, ...]
    errors: tuple[float, ...]
    seconds: tuple[float, ...]
    limit: Convergence
    failed: tuple[str, ...] = ()

    def error_in(self, seconds: float) -> float | None:
        """Error that so many seconds buy, between two spacings in proportion; None outside of those that were run."""
        points = sorted(zip(self.seconds, self.errors))
        return _between(points, seconds) if points and points[0][0] <= seconds <= points[-1][0] else None

    def seconds_to(self, error: float) -> float | None:
        """Seconds from which on the error stays below `error`; of the coarsest spacing if all do, None if none does."""
        above = [k for k, found in enumerate(self.errors) if found > error]
        if not above:
            return self.seconds[0] if self.seconds else None
        k = above[-1]
        if k + 1 == len(self.errors):
            return None
        return _between(sorted(zip(self.errors[k : k + 2], self.seconds[k : k + 2])), error)


def _between(points: list[tuple[float, float]], at: float) -> float:
    """On straight lines between the logarithms of points (x, y)."""
    x, y = (np.log(np.maximum(values, 1e-300)) for values in zip(*points))
    return float(np.exp(np.interp(math.log(max(at, 1e-300)), x, y)))


def judge(runs: Runs, reference: Reference | None) -> Reference | None:
    """What methods are held against: the reference, or the extrapolated value of the method that knows it best.

    Its uncertainty is at least the distance of the other methods' limits.
    """
    if reference is not None:
        return reference
    limits = [(label, converge(*values)) for label, values in _values(runs).items()]
    known = [(not c.asymptotic, c.relative, label, c) for label, c in limits if math.isfinite(c.relative) and c.value]
    if not known:
        return None
    coarse, uncertainty, label, best = min(known, key=lambda one: one[:2])
    apart = max((best.error(c.value) for open_, _, _, c in known if not open_), default=0.0)
    words = f"the {'finest value' if coarse else 'limit'} of {label or OWN}"
    if apart > uncertainty:
        words += f", {100 * apart:.2g} % from the farthest limit"
    return Reference(best.value, abs(best.value), max(uncertainty, apart), words)


def lines(runs: Runs, reference: Reference) -> list[Line]:
    """The scene's own method and the others, against a reference."""
    made = []
    for label, (spacing, values) in _values(runs).items():
        own = [(s, r) for s, r in runs if s.method == label and s.kind in ("spacing", "method")]
        order = np.argsort(spacing)[::-1]
        seconds = {s.scene.spacing: r.seconds for s, r in own if not r.failed}
        errors = (max(reference.error(values[k]), reference.uncertainty) for k in order)
        made.append(
            Line(
                label or OWN, tuple(spacing[k] for k in order), tuple(errors),
                tuple(seconds[spacing[k]] for k in order), converge(spacing, values),
                tuple(f"{s.label}: {r.failed}" for s, r in own if r.failed),
            )
        )  # fmt: skip
    return made


def _values(runs: Runs) -> dict[str, tuple[list[float], list[float]]]:
    """Spacings and values of each method that gave one."""
    found: dict[str, tuple[list[float], list[float]]] = {}
    for setting, reading in runs:
        if setting.kind in ("spacing", "method") and not reading.failed:
            spacing, values = found.setdefault(setting.method, ([], []))
            spacing.append(setting.scene.spacing)
            values.append(reading.value)
    return found
