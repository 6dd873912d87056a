"""Studies of scenes with exact answers: what `refsim study` says against the answer and against a finer run.

`python -m validation measure studies` studies each scene of docs/examples/study/solved at four spacings, holds its
extrapolated value against the exact one, continues it to a finer spacing, and runs that one, too; --write puts the
table on docs/study.md. Results are kept in results/study.
"""

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import brentq
from scipy.special import erf

import refsim
from refsim import InputError, make_plan
from refsim.core.writing import write_file
from refsim.scene.refine import fitting, refined
from refsim.scene.surface_mesh import load_mesh, signed_volume
from refsim.study.observables import observable_of
from refsim.study.result import Study, percent
from refsim.study.runs import Reading, Setting, measure
from validation.filling import replaced
from validation.metrics import solutions as scene
from validation.metrics.heat import stefan_root

ROOT = Path(__file__).resolve().parents[2]
SCENES = ROOT / "docs" / "examples" / "study" / "solved"
PAGE = ROOT / "docs" / "study.md"
FURTHER = 1.5  # the bound of the finest level over that for which the study is continued


def slab(x: float, time: float, length: float, hot: float, diffusivity: float, terms: int = 400) -> float:
    """Temperature [degrees C] at x [m] of an insulated slab whose first half had `hot`, its other half 0."""
    n = np.arange(1, terms + 1) * np.pi
    decay = np.exp(-diffusivity * (n / length) ** 2 * time)
    return float(hot * (0.5 + (2 / n * np.sin(n / 2) * np.cos(n * x / length) * decay).sum()))


def melted(
    time: float, wall: float, cold: float, conductivity: float, heat_capacity: float, density: float, latent: float
) -> float:
    """Heat [J/m^2] that a wall has given to ice, by Neumann's solution.

    Wall and ice begin `wall` above and `cold` below the melting point [K].
    """
    root = stefan_root(wall, -cold, latent / heat_capacity)
    return 2 * wall * math.sqrt(conductivity * density * heat_capacity * time / math.pi) / float(erf(root))


def sloshed(time: float, length: float, depth: float, push: float, rate: float, modes: int = 99) -> float:
    """Mean horizontal displacement [m] of water in a tank, seen from there, whose acceleration is push sin(rate t).

    Each odd mode of the level is an oscillator of frequency sqrt(g k tanh(k H)) (Faltinsen & Timokha 2009, chapter 5).
    """
    n = np.arange(1, modes + 1, 2)
    k = n * np.pi / length
    square = 9.81 * k * np.tanh(k * depth)
    share = square * 8 * length**2 / (9.81 * depth * (n * np.pi) ** 4)
    swung = np.sin(np.sqrt(square) * time) / np.sqrt(square) - np.sin(rate * time) / rate
    return float((share * push * rate / (square - rate**2) * swung).sum())


def falling_rod(time: float, height: float, width: float, density: float, sound: float, pull: float) -> float:
    """Kinetic energy [J/m] of a rod suddenly under its weight, until a wave from its foot has come to its top.

    Above the wave it falls freely, below it has the velocity with which the wave passed.
    """
    reached = sound * time
    return 0.5 * density * width * (pull * time) ** 2 * (height - reached + reached / 3)


def poured(volume: float, wide: float, mesh: Path, sound: float) -> float:
    """Height [m] of the centre of mass of a liquid at rest over a torus about z, in a box `wide` m wide.

    volume  at rest density [m^3]; at rest the density is exp(g (top - z)/c^2) times as large. mesh: of the torus; its
            tube is taken as round and as large as the mesh
    """
    made = load_mesh(mesh)
    wider, _, thick = np.ptp(made.vertices, axis=0)
    ring = 0.5 * (wider - thick)
    tube = math.sqrt(signed_volume(made.vertices[made.faces]) / (2 * math.pi**2 * ring))

    def moments(top: float) -> np.ndarray:
        z = np.linspace(0.0, top, 20001)
        solid = 4 * math.pi * ring * np.sqrt(np.maximum(tube**2 - (z - made.origin[2]) ** 2, 0.0))
        density = (wide**2 - solid) * np.exp(9.81 * (top - z) / sound**2)
        return np.trapezoid([density, z * density], z)

    amount, moment = moments(brentq(lambda top: moments(top)[0] - volume, 0.0, 2 * volume / wide**2))
    return float(moment / amount)


@dataclass(frozen=True)
class Solved:
    """A scene with an exact answer, and how it is studied."""

    observable: str
    answer: Callable[[], float]
    ratio: float = 1.5
    finer: int = 2
    with_spacing: tuple[str, ...] = ()

    def study(self, name: str, **more: object) -> Study:
        """What `refsim study` finds."""
        given = {"levels": 4, "finer": self.finer, "ratio": self.ratio, "knobs": ("spacing", "support", "step")}
        given["with_spacing"] = self.with_spacing
        return refsim.study(SCENES / f"{name}.toml", self.observable, **(given | more))  # type: ignore[arg-type]


MIDDLE = np.array([5e-4])  # m, half the distance of the plates
SOLVED = {
    "couette": Solved(
        "field:velocity.x@2.5e-4,5e-4", lambda: float(scene.couette(MIDDLE, 0.1, 1e-3, 1.25e-5, 1e-6)[0])
    ),
    "couette_thick": Solved(
        "field:velocity.x@2.5e-4,5e-4", lambda: float(scene.couette(MIDDLE, 0.05, 1e-3, 1.25e-5, 3e-6)[0])
    ),
    "poiseuille": Solved(
        "field:velocity.x@2.5e-4,5e-4", lambda: float(scene.poiseuille(MIDDLE, 0.225, 1e-3, 1e-4, 1e-6)[0])
    ),
    "slab": Solved("field:temperature@0.025,0.025", lambda: slab(0.025, 20.0, 0.1, 100.0, 400.0 / (8960.0 * 385.0))),
    "melting_wall": Solved(  # the wall is a fifth of the particles; the ice is 0.08 m deep
        "field:enthalpy@mean",
        lambda: (
            0.2 * (333e3 + 50.0 * 4186.0)
            + 0.8 * melted(3000.0, 50.0, 0.0, 0.6, 4186.0, 1000.0, 333e3) / (1000.0 * 0.08)
        ),
    ),
    "candle": Solved(  # as deep in spacings; cold wax begins below 0
        "field:enthalpy@mean",
        lambda: (
            0.2 * (200e3 + 90.0 * 2500.0)
            + 0.8 * (melted(600.0, 90.0, 40.0, 0.25, 2500.0, 900.0, 200e3) / (900.0 * 0.04) - 40.0 * 2500.0)
        ),
    ),
    "sloshing": Solved(
        "field:position.x@mean",
        lambda: sloshed(0.7, 1.0, 0.5, 1.2, 4.0),
        ratio=2.0,
        with_spacing=("effects.weakly_compressible.dynamic_viscosity",),
    ),
    "torus": Solved("field:position.z@mean", lambda: poured(0.6**3, 0.8, SCENES / "torus.obj", 40.0), finer=3),
    "column": Solved("kinetic_energy", lambda: falling_rod(0.05, 1.0, 0.4, 1000.0, 10.0, 9.81), ratio=2.0),
}


@dataclass(frozen=True)
class Further:
    """A spacing [m] finer than those of a study: what the study foresees for it, and its run."""

    spacing: float
    value: float
    seconds: float
    run: Reading


def further(finished: Study, solved: Solved, threads: int | None, backend: str = "cpu") -> Further:
    """The spacing that the study advises for two thirds of the error of its finest level, with whole cells."""
    setting, finest = max(finished.of("spacing"), key=lambda pair: pair[0].factor)
    limit = finished.convergence
    advice = None if limit is None else finished.cheapest(limit.bound(finest.value) / FURTHER)
    if limit is None or advice is None or advice.measured:
        raise InputError(f"{finished.scene.name}: its study cannot be continued ({'; '.join(finished.answers()[:1])}).")
    factor = fitting(finished.scene, finished.scene.spacing / advice.spacing)
    scene = refined(finished.scene, factor, solved.with_spacing)
    one = Setting("spacing", f"spacing {scene.spacing:.4g} m", factor, scene, backend)
    run = measure(one, observable_of(solved.observable, make_plan(finished.scene)), None, threads)
    finer = setting.scene.spacing / scene.spacing
    value = limit.value + (finest.value - limit.value) * finer**-limit.order
    power = math.log(advice.seconds / finest.seconds, setting.scene.spacing / advice.spacing)
    return Further(scene.spacing, value, finest.seconds * finer**power, run)


HEAD = (
    "| scene | exact | study | order | off by | sources: spacing, support, step | finer run: foreseen, found |\n"
    "| --- | --- | --- | --- | --- | --- | --- |"
)


def row(name: str, threads: int | None, backend: str = "cpu") -> str:
    """One row of the table; a study whose values do not fall into order is not continued."""
    solved = SOLVED[name]
    result = solved.study(name, threads=threads, backend=backend, folder=ROOT / "results" / "study" / name)
    limit, answer, sources = result.convergence, solved.answer(), result.sources()
    assert limit is not None
    shares = ", ".join(percent(sources[kind]) if kind in sources else "-" for kind in ("spacing", "support", "step"))
    order, later = "-", "-"
    if limit.asymptotic:
        finer = further(result, solved, threads, backend)
        order = f"{limit.order:.2f}"
        later = f"{finer.value:.5g}, {finer.run.value:.5g}"
        print(f"{name}: {finer.spacing:.3g} m, {finer.seconds:.3g} s foreseen, {finer.run.seconds:.3g} s taken")
    return (
        f"| `{name}` | {answer:.5g} {result.unit} | {limit.value:.5g} ± {limit.uncertainty:.2g} | {order}"
        f" | {percent(limit.value / answer - 1, signed=True)} | {shares} | {later} |"
    )


def perform(given: argparse.Namespace) -> None:
    """The command."""
    text = PAGE.read_text(encoding="utf-8")
    lines = {name: next((old for old in text.splitlines() if old.startswith(f"| `{name}` |")), "") for name in SOLVED}
    for name in given.names or SOLVED:
        lines[name] = row(name, given.threads, given.backend)
        print(lines[name], flush=True)
        if given.write:
            write_file(PAGE, replaced(text, "solved", [HEAD, *filter(None, lines.values())], PAGE))
