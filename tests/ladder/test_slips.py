"""Whether the contract notices errors: every sign, factor, index and condition of every program is altered once.

A slip that no trial notices is a gap in the contract, unless it changes nothing: those stand in HARMLESS, with reasons.
"""

import json
import os
import pathlib
import subprocess
import sys

import pytest

from refsim.core.operation import REGISTRY

SLIPS = pathlib.Path(__file__).with_name("slips.py")

# function -> (start of the altered line, why it changes no answer)
HARMLESS = {
    "kick_drift": [("squared = type(timestep[0])(0)", "only the type is taken")],
    "corrected": [("nx, ny, nz, filled = (real(0)", "zero over anything")],
    "unit": [("zero = type(length)(0)", "a normal without direction is not looked at")],
    "tension": [("nx, ny, nz = (real(0)", "set again where they are used")],
    "pair_sums": [("nx, ny, nz = (real(0)", "set again where they are used")],
    "rigid_motion": [
        ("spin = (real(0)", "set again where it is used"),
        ("trace = real(2) * (sums[6] + sums[7] + sums[8])  ->  trace = real(3)", "both sides are divided by it"),
    ],
    "solved": [
        (
            "xx, yy, zz = (a[0] + floor, a[1] + floor, a[2] + floor)"
            "  ->  xx, yy, zz = (a[0] + floor, a[1] + floor, a[2] - floor)",
            "cut off at the floor; the second solution takes back what it changes",
        )
    ],
    "adhesion_pair": [("q <= real(0.5) or q >= real(1)", "beyond the support no pair is looked at")],
    "squared_gradient": [(f"g{c} += f * d{c}", "only its square is taken") for c in "xyz"],
    "step_node": [("return -1", "any negative number says that there is no node")],
    "base_coordinate": [("return FARTHEST + 1", "any number beyond all nodes does")],
    "mirrored_update": [("range(3)  ->  range(4)", "a node has no fourth image along an axis")],
    "melted_now": [("phase[i] = FLUID", "a zero has no sign")],
    "detach": [("held = 1", "any positive number means that a melted node is in the region")],
    **{name: [("zero = type(", "only the type is taken")] for name in ("damp_sums", "damp_slot", "motion_sums")},
    "goal_sums": [("real = type(", "only the type is taken")],
    "motion_slot": [("return nothing_12(type(", "only the type is taken")],
    "damp_end": [("region_count[s] > 0 and timestep[0] > 0", "of the two lengths of a step both are positive or none")],
    "wall_gradient": [
        ("tiny = real(1e-09) * h", "far below the rounding of a distance"),
        ("f = weight * walls.volume[b]", "what is added to the distance is far below its rounding"),
    ],
    "relaxed_pressure": [("value < real(0)", "a pascal is far below the bound")],
    "tait_pressure": [("pressure < real(0)", "a pascal is far below the bound")],
    "boundary_pressure": [
        ("fluid.clamp and pressure < type(pressure)(0)", "a pascal is far below the bound"),
        ("return type(pressure)(0)", "a pascal is far below the bound"),
    ],
    "row_weights": [
        ("one = real(1)", "only whether a row is idle depends on it"),
        ("weight_i, surface_i = (zero, 0)", "belongs to the mode that is not taken"),
        ("base == zero and slope != zero", "looks for idle rows in vain, or not at all"),
    ],
    "components": [
        (
            "joined = np.flatnonzero(inside & (other >= 0))  ->  joined = np.flatnonzero(inside & (other >= 1))",
            "blocks are in order: the first node is above no other",
        )
    ],
    "component_sizes": [
        (
            "held = np.bincount(label + 1, minlength=1)  ->  held = np.bincount(label + 1, minlength=2)",
            "never looked at",
        )
    ],
    "pair_weight": [("return (real(1), real(0))", "without weights and marks nothing is multiplied with it")],
}


def programs():
    """Names of the operations that share a program, by program."""
    found = {}
    for name, operation in REGISTRY.items():
        found.setdefault((operation.folder, operation.function), []).append(name)
    return list(found.values())


def judged(names):
    path = os.pathsep.join(filter(None, (str(SLIPS.parent.parent), os.environ.get("PYTHONPATH"))))
    environment = dict(os.environ, NUMBA_DISABLE_JIT="1", PYTHONPATH=path)
    done = subprocess.run([sys.executable, SLIPS, *names], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def required(name):
    """Kinds of slips that every equation must have had; a flag has no sign, its condition stands in."""
    operation = REGISTRY[name]
    return {"condition" if operation.exact == operation.outputs else "sign", "factor", "index"}


def verdict(names):
    found = judged(names)
    for name in names:
        missing = required(name) - set(found["noticed"][name])
        assert not missing, f"{name}: no slip of kind {missing} was made and noticed"
    gaps = [
        slip
        for slip in found["survived"]
        if not any(slip.startswith(f"{function}: {line}") for function, lines in HARMLESS.items() for line, _ in lines)
    ]
    assert not gaps, "not noticed:\n" + "\n".join(gaps)


QUICK = {"sph.state", "sph.gravity"}


@pytest.mark.parametrize("names", [n for n in programs() if n[0] in QUICK], ids="+".join)
def test_slips_in_a_short_program_are_noticed(names):
    verdict(names)


@pytest.mark.slow
@pytest.mark.parametrize("names", [n for n in programs() if n[0] not in QUICK], ids="+".join)
def test_slips_are_noticed(names):
    verdict(names)


def test_every_operation_is_tried():
    assert sorted(name for names in programs() for name in names) == sorted(REGISTRY)
