"""What accuracy costs in a scene: its value with an uncertainty, the sources of error, and the cheapest setting.

Contents: study; the modules observables, convergence (orders and uncertainty), runs, tasks (runs of a sweep in other
processes), cost (seconds of a run from ten steps, memory), result (with its picture), panels and advice.
"""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import msgspec

from refsim.backends.arrays import require_backend, unavailable
from refsim.core.checked import plainly
from refsim.core.errors import InputError
from refsim.core.tables import in_time
from refsim.engine.simulation import Simulation
from refsim.scene.files import load_scene, suggestion
from refsim.scene.plan import Plan, make_plan
from refsim.scene.refine import RATIO, notes, refined, spaced, without
from refsim.scene.scene import Scene
from refsim.study.convergence import converge
from refsim.study.observables import Observable, observable_of
from refsim.study.result import Reference, Study
from refsim.study.runs import Reading, Setting, Watch, kept, kept_or_made, key_of, machine, measure
from refsim.study.tasks import weighed

KNOBS = ("spacing", "support", "step", "precision", "tolerance", "backend", "effects")
TIGHTER = 10.0
WIDER = 1.25  # of the support radius, at the same spacing
Say = Callable[[str], None]


@plainly
def study(
    scene: Scene | str | os.PathLike[str],
    observable: str | Callable[[Simulation], float],
    *,
    levels: int = 3,
    finer: int | None = None,
    ratio: float = RATIO,
    knobs: Iterable[str] = KNOBS,
    with_spacing: Sequence[str] = (),
    error: float = 0.01,
    reference: Reference | None = None,
    reaches: float | None = None,
    backend: str = "cpu",
    threads: int = 1,
    folder: str | os.PathLike[str] | None = None,
    say: Say = lambda text: None,
    progress: Watch | None = None,
) -> Study:
    """Run a scene at several spacings, and with each other setting alone, and say what accuracy costs.

    scene       a scene, or the path of a scene file
    observable  "front", "kinetic_energy", "field:NAME@POINT", "FILE.py:function" (`refsim/study/observables.py`), or a
                function of a simulation; its value at the scene's end_time
    levels      number of spacings
    finer       how many of them are finer than the scene's; half of them, rounded down, by default
    ratio       of neighbouring spacings, about; the boxes' cells must fit
    knobs       which of "spacing", "support", "step", "precision", "tolerance", "backend" and "effects" to change
    with_spacing  parameters in proportion to the spacing, such as effects.weakly_compressible.dynamic_viscosity
    error       relative error for which the cheapest setting is given
    reference   what the value is held against
    reaches     the study is of the first time [s] at which the observable has this value
    folder      where the runs' results are kept: a study that is called again goes on from there; not of a function,
                whose text no key could follow
    threads     of a CPU that a run takes; seconds are those of the processor, of all its threads
    say         is given the lines of progress; `progress` is called after every step

    A run that fails is reported with its reason, and the others are used. Raises InputError for bad input, such as an
    observable that is not there or a scene without other spacings.
    """
    scene = scene if isinstance(scene, Scene) else load_scene(scene)
    plan = make_plan(scene)
    chosen = tuple(knobs)
    for knob in chosen:
        if knob not in KNOBS:
            raise InputError(f"there is no knob {knob!r}; {suggestion(knob, KNOBS)}")
    if not 0 < error < 1:
        raise InputError(f"error = {error:g} is not possible; give a relative error between 0 and 1, such as 0.01.")
    require_backend(backend)
    watched = observable_of(observable, plan)
    if folder is not None and not watched.digest:
        raise InputError("study: runs of a function are not kept; leave folder out, or give FILE.py:function.")
    left_out: list[str] = []
    remarks: list[str] = []  # about damaged results
    factors = spaced(scene, levels, levels // 2 if finer is None else finer, ratio) if "spacing" in chosen else (1.0,)
    settings = _settings(scene, plan, factors, chosen, with_spacing, backend, left_out)
    place = None if folder is None else Path(folder)
    runs = _measured(settings, watched, reaches, threads, place, say, progress, remarks)
    worked = [(s.scene.spacing, r.value) for s, r in runs if s.kind == "spacing" and not r.failed]
    what = (watched.name, watched.unit) if reaches is None else (f"time({watched.name} = {reaches:g})", "s")
    limit = replace(converge(*zip(*worked)), scale=reference.scale if reference else 0.0) if worked else None
    told = (*notes(scene, factors), *remarks)
    return Study(scene, *what, tuple(runs), limit, error, told, machine(), threads, tuple(left_out), reference)


def _settings(
    scene: Scene, plan: Plan, factors: Sequence[float], knobs: Sequence[str], with_spacing: Sequence[str], backend: str,
    left_out: list[str],
) -> list[Setting]:  # fmt: skip
    """All runs of a study; what cannot be changed in this scene is said in `left_out`."""
    levels = {factor: scene if factor == 1 else refined(scene, factor, with_spacing) for factor in factors}
    made = [Setting("spacing", f"spacing {scene.spacing / f:.4g} m", f, at, backend) for f, at in levels.items()]
    changes = _changes(scene, plan, knobs, backend, left_out)
    return made + [Setting(kind, label, 1.0, changed, place) for kind, label, changed, place in changes]


def _changes(
    scene: Scene, plan: Plan, knobs: Sequence[str], backend: str, left_out: list[str]
) -> Iterator[tuple[str, str, Scene, str]]:
    """(kind, label, scene, backend) of the runs at the scene's own spacing in which one setting is another one."""
    changed = msgspec.structs.replace
    if "support" in knobs and plan.list_radius == 0:
        left_out.append("another support radius left out: no effect of this scene sums over neighbours")
    elif "support" in knobs:
        wider = WIDER * scene.support_radius
        yield "support", f"support radius {wider:.4g} m", changed(scene, support_radius=wider), backend
    if "step" in knobs:
        halved = changed(scene, step=scene.step / 2, step_factor=scene.step_factor / (1 if scene.step else 2))
        yield "step", "half the step", halved, backend
    if "precision" in knobs:
        other = "float64" if scene.dtype == "float32" else "float32"
        yield "precision", other, changed(scene, dtype=other), backend
    for k, effect in enumerate(scene.effects) if "tolerance" in knobs else ():
        if isinstance(value := getattr(effect, "tolerance", None), float) and value > 0:
            tighter = value / TIGHTER
            effects = (*scene.effects[:k], changed(effect, tolerance=tighter), *scene.effects[k + 1 :])
            yield "tolerance", f"{effect.name}: tolerance {tighter:g}", changed(scene, effects=effects), backend
    for name in (n for n in ("cpu", "cuda") if "backend" in knobs and n != backend):
        if (reason := unavailable(name)) is None:
            yield "backend", name, scene, name
        else:
            left_out.append(f"backend {name} left out: {reason}")
    for effect in scene.effects if "effects" in knobs else ():
        less = without(scene, effect.name)
        try:  # it is left out where the scene cannot be planned without it, and else the same choices
            make_plan(less)
        except InputError as error:
            left_out.append(f"without {effect.name} left out: {error}")
        else:
            yield "effect", f"without {effect.name}", less, backend


def _measured(
    settings: Sequence[Setting], observable: Observable, reaches: float | None, threads: int,
    folder: Path | None, say: Say, progress: Watch | None, remarks: list[str],
) -> list[tuple[Setting, Reading]]:  # fmt: skip
    """Readings of all settings, the cheapest run first; those that the folder has are not run again."""
    keys = [key_of(setting, observable, reaches, threads) for setting in settings]
    readings = [kept(folder, key, remarks) for key in keys]
    work = {k: weighed(settings[k])[0] for k, reading in enumerate(readings) if reading is None}
    left = sorted(work, key=work.__getitem__)
    if left:
        before = f", {len(settings) - len(left)} are on file" if len(left) < len(settings) else ""
        say(f"{len(left)} runs to do{before}, the cheapest first")
    done, took = 0.0, 0.0
    for count, k in enumerate(left, 1):
        setting = settings[k]
        rest = took * (sum(work.values()) - done) / done if done else 0.0
        say(f"{count} of {len(left)}: {setting.label}" + (f"; about {in_time(rest)} of steps left" if rest else ""))
        how = setting, observable, reaches, threads
        make, read = partial(measure, *how, progress), partial(key_of, *how)
        readings[k] = reading = kept_or_made(folder, keys[k], setting, make, read, keys[k])
        done, took = done + work[k], took + reading.wall
        say(f"  {reading}")
    return [(setting, reading) for setting, reading in zip(settings, readings) if reading is not None]
