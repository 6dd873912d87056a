"""Small scenes of two effects each: whole runs in which backends are compared, for every pair that a scene may have.

A scene holds the two effects and those that they need. The particles are shaken, so that no neighbour is exactly as
near as another, and fall against walls where there are any.
"""

import itertools
from typing import NamedTuple

import numpy as np

from refsim import Cloud, Scene, Simulation, SolidBox, make_plan
from refsim.core import cases
from tests.running import advanced, rows

SPACING = 0.1  # m
BOUND = 1e-11  # of a field's largest value; see `compare`
SHEAR = np.array([[0.5, 1.0, 0.0], [-0.4, -0.7, 0.0], [0.0, 0.0, 0.0]])  # 1/s, so that no gradient is a rounding error
OF_SPACING = ("region_anchor", "region_center")  # displacements of nodes, as exact as their positions are
# Depend on which particle stands first, and so on when the list or the grid's blocks were built; what is made of them
# is compared
OF_ORDER = ("place", "cell")
cases.discover()
EFFECTS = {name: example.effect for name, example in cases.EXAMPLES.items()}

NEVER = {(one, other): words for one, other, words in rows(__file__, "never")}  # that no scene has together


class Difference(NamedTuple):
    """A field of two runs of one scene: the largest difference over the largest value, for integers the share."""

    field: str
    error: float
    allowed: float


def scene(first, second, dtype="float64"):
    """The scene of two effects, by their names, with what they need."""
    names, waiting = [], [first, second]
    while waiting:
        name = waiting.pop(0)
        if name not in names:
            names.append(name)
            waiting += EFFECTS[name].needs()
    space = "mesh_boundary" in names or "shape_matching" in names
    cells = (6, 4, 1) if not space else (2, 2, 2) if "surface_energy" in names else (3, 3, 3)
    lattice = np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in cells), indexing="ij"), axis=-1).reshape(-1, 3)
    place = SPACING * (lattice + np.random.default_rng(17).uniform(-0.1, 0.1, lattice.shape))
    solid = ()
    if "shape_matching" in names:
        solid = (SolidBox(
            lower=(0.0, 0.3, 0.0), upper=(0.1999, 0.4999, 0.1999), density=900.0, velocity=(0.0, -0.3, 0.2),
            spin=(1.0, 2.0, 3.0),
        ),)  # fmt: skip
    if not space:
        place[:, 2] = 0
    return Scene(
        name=f"{first}_{second}", dim=3 if space else 2, spacing=SPACING, support_radius=2.1 * SPACING, dtype=dtype,
        step=5e-4, fluid=(Cloud(position=place, velocity=np.array([0.1, -0.3, 0.0]) + place @ SHEAR),), solid=solid,
        effects=tuple(EFFECTS[name] for name in names),
    )  # fmt: skip


def pairs():
    """Every two effects that one scene may have."""
    return (pair for pair in itertools.combinations(EFFECTS, 2) if not refused(*pair))


def refused(first, second):
    """Words of the sentence with which a scene of both effects is refused; empty where it is not."""
    together = {effect.name for effect in scene(first, second).effects}
    return next((reason for never, reason in NEVER.items() if set(never) <= together), "")


def compare(first, second, backend, oracle="numpy", steps=5):
    """Every field of the pair's scene after `steps` steps on two backends, in float64.

    Bound: a sum has up to a hundred terms, each rounded to 1.1e-16, and the pressure, of a density that is off by 1e-2
    of the rest density, has two digits less: 1e-12 of the largest value in a step, and ten times that after five steps.
    Flags and counts are equal: no particle stands where rounding decides.
    """
    made = make_plan(scene(first, second))
    runs = [Simulation(made, name) for name in (oracle, backend)]
    for simulation in runs:
        advanced(simulation, steps)
        simulation.evaluate()
    differences = []
    for name, field in made.fields.items():
        if name in OF_ORDER:
            continue
        true, fast = (simulation.field(name) for simulation in runs)
        if field.numpy_dtype(made.grid.dtype).kind in "iub":
            differences.append(Difference(name, float((true != fast).mean()), 0.0))
            continue
        largest = max(float(np.abs(true).max(initial=0)), SPACING if name in OF_SPACING else 1e-30)
        differences.append(Difference(name, float(np.abs(true - fast).max(initial=0)) / largest, BOUND))
    return differences
