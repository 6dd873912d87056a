"""Words and values of a wrong answer: what is recognised, what no message says, and one trial run again."""

import functools
import json
import pathlib
import sys
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from refsim import contract
from refsim.__main__ import main
from tests.contract import faulty

KERNEL = "wendland_c2"


def pairs(position, smoothing):
    """(separations, distances, W, W'/r) of all pairs."""
    d = (position[:, None] - position[None]).astype(float)
    r = np.sqrt((d * d).sum(2))
    h = float(smoothing.support_radius)
    q = np.minimum(r / h, 1)
    slope = float(smoothing.slope_scale) * -20 * q * (1 - q) ** 3
    return d, r, float(smoothing.value_scale) * (1 - q) ** 4 * (1 + 4 * q), slope / np.where(r > 0, r, 1)


def density_with(change):
    """sph.density from the terms m_j W_ij (n, n), changed by a function of (terms, mass, W, r)."""

    def density(position, mass, smoothing, density):
        _, r, w, _ = pairs(position, smoothing)
        density[:] = change(mass[None] * w, mass, w, r).sum(1)

    return density


def momentum_with(change):
    """sph.momentum from -(m_j/rho_j) (p_i + p_j)/rho_i W'/r x_ij, whose factor a function changes."""

    def momentum(position, mass, density, pressure, smoothing, fluid, acceleration):
        d, _, _, f = pairs(position, smoothing)
        m, rho, p = (np.asarray(v, dtype=float) for v in (mass, density, pressure))
        acceleration += float(fluid.gradient_share) * ((change(m, rho, p) * f)[..., None] * d).sum(1)

    return momentum


def right(m, rho, p):
    return -(m / rho)[None] * (p[:, None] + p[None]) / rho[:, None]


def last_missing(terms, mass, w, r):
    terms = terms.copy()
    for i, near in enumerate(w > 0):
        others = [j for j in np.flatnonzero(near) if j != i]
        if others:
            terms[i, others[-1]] = 0
    return terms


def twice_itself(terms, mass, w, r):
    return terms + np.diag(np.diag(terms))


CAUSES = {
    "m_i for m_j": ("sph.density", density_with(lambda t, m, w, r: m[:, None] * w), "m_i in place of m_j"),
    "off by one": ("sph.density", density_with(last_missing), "in each wrong row one neighbour is missing"),
    "constant of the plane": (
        "sph.density", density_with(lambda t, m, w, r: 2 / 3 * t), "normalisation has the constant for 2 dimensions",
    ),
    "self twice": ("sph.density", density_with(twice_itself), "counts the particle itself twice"),
    "mass for volume": (
        "sph.momentum", momentum_with(lambda m, rho, p: rho[None] * right(m, rho, p)), "m_j in place of m_j/rho_j",
    ),
    "p_i for p_j": (
        "sph.momentum", momentum_with(lambda m, rho, p: -2 * (m / rho)[None] * (p / rho)[:, None]),
        "p_i in place of p_j",
    ),
    "sign": ("sph.momentum", momentum_with(lambda m, rho, p: -right(m, rho, p)), "the opposite sign"),
    "factor": ("sph.momentum", momentum_with(lambda m, rho, p: 0.5 * right(m, rho, p)), "gives 0.5 times the right"),
}  # fmt: skip


def judged(operation, program, steps=("T2",), dims=(3,)):
    programs = contract.Programs({operation: program}, dtypes=("float64",), kernels=(KERNEL,), dims=dims, name="own")
    return [o for o in contract.trials(programs, operation, variants=(0,), steps=steps) if not o.not_judged]


@pytest.mark.parametrize("name", CAUSES)
def test_a_cause_is_recognised(name):
    operation, program, words = CAUSES[name]
    failed = [o for o in judged(operation, program) if not o.passed]
    assert any(words in o.words for o in failed), [str(o) for o in failed]


def test_the_right_programs_hold():
    for operation, program in (
        ("sph.density", density_with(lambda terms, *_: terms)), ("sph.momentum", momentum_with(right)),
    ):  # fmt: skip
        assert not [str(o) for o in judged(operation, program, ("T1", "T2", "T7"), (2, 3)) if not o.passed]


@pytest.mark.slow
def test_an_index_of_16_bits_is_noticed():
    """Among 70,000 particles, with lists; a program over all pairs that takes too long for them says so."""

    def density(position, mass, neighbours, smoothing, density, bits=np.uint16):
        own = np.repeat(np.arange(len(mass)), neighbours.count)
        place = np.arange(len(own)) + np.repeat(neighbours.start - np.cumsum(neighbours.count), neighbours.count)
        index = neighbours.entries[place + np.repeat(neighbours.count, neighbours.count)].astype(bits)
        q = np.minimum(np.sqrt(((position[own] - position[index]) ** 2).sum(1)) / float(smoothing.support_radius), 1)
        terms = mass[index] * float(smoothing.value_scale) * (1 - q) ** 4 * (1 + 4 * q)
        density[:] = mass * float(smoothing.value_scale) + np.bincount(own, terms, len(mass))

    for bits, passed in ((np.uint16, False), (np.uint32, True)):
        outcomes = judged("sph.density", functools.partial(density, bits=bits), ("T3",))
        (many,) = (o for o in outcomes if o.trial == "many_particles")
        assert many.passed == passed, str(many)
        assert passed or "is an index held in 16 bits?" in many.words


# What no message says
def test_a_scale_error_is_called_neither_an_assignment_nor_a_race():
    program = momentum_with(lambda m, rho, p: 1e9 * right(m, rho, p))
    words = [o.words for o in judged("sph.momentum", program, ("T1", "T2", "T7"))]
    assert not [text for text in words if "must add" in text or "race" in text]


def test_a_stub_is_not_called_wrong_in_any_other_way():
    words = {o.words for o in judged("sph.density", lambda density: None, ("T1", "T2", "T7", "T9")) if not o.passed}
    assert words == {"your program does not write density"}


def test_an_answer_that_is_only_small_has_no_recognised_cause():
    """The mass in place of the density: in these units little beside the right value, but not 0 and no missing term."""
    words = {
        o.words for o in judged("sph.density", density_with(lambda t, m, w, r: np.diag(m)), ("T2",)) if not o.passed
    }
    assert not [text for text in words if "self term" in text or "gives 0" in text]


def test_a_right_sum_is_not_said_to_overwrite():
    words = [o.words for o in judged("sph.momentum", CAUSES["factor"][1], ("T2",)) if not o.passed]
    assert not any("overwrites" in text for text in words)


# Values
def test_the_worst_row_has_values_and_the_pair_that_matters():
    def density(position, mass, smoothing, density):
        _, r, w, _ = pairs(position, smoothing)
        terms = mass[None] * w
        density[:] = terms.sum(1)
        if len(mass) == 150:
            near = np.flatnonzero((w[40] > 0) & (r[40] > 0))
            wanted.update(particle=int(near[0]), adds=float(terms[40, near[0]]), r=float(r[40, near[0]]))
            density[40] -= terms[40, near[0]]

    wanted = {}
    (failed,) = (o for o in judged("sph.density", density) if not o.passed and o.trial == "cloud_3d")
    values, pair = failed.values, failed.values["pair"]
    assert (values["output"], values["row"]) == ("density", 40)
    assert values["expected"] - values["got"] == pytest.approx(wanted["adds"])
    assert values["error"] > values["bound"] > 0
    assert (pair["particle"], pair["adds"]) == (wanted["particle"], pytest.approx(wanted["adds"]))
    assert pair["distance"] == pytest.approx(wanted["r"])


LIBRARY = """
import sys
sys.path.insert(0, {root!r})
from tests.contract.faulty import in_numpy
PROGRAMS = in_numpy({fault!r}, "cubic_spline")
"""


@pytest.fixture
def library(tmp_path, monkeypatch):
    """A library in the current folder whose density has no self term."""
    root = str(pathlib.Path(faulty.__file__).parents[2])
    (tmp_path / "own.py").write_text(LIBRARY.format(root=root, fault="self"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    return tmp_path


def test_a_trial_is_run_again_and_its_arrays_are_written(library, capsys):
    quick = ("own.py", "--step", "T1", "--dtype", "float64", "--variant", "0")
    assert main(["contract", *quick, "--junit", "out.xml", "--json"]) == 4
    outcomes = json.loads(capsys.readouterr().out)["operations"]["sph.density"]["outcomes"]
    failed = next(o for o in outcomes if not o["passed"])
    suite = ElementTree.parse(library / "out.xml").getroot().find("testsuite")
    assert int(suite.get("tests")) == len(outcomes)
    assert failed["replay"] in {case.get("name") for case in suite if case.find("failure") is not None}
    assert main(["contract", "own.py", "--replay", failed["replay"]]) == 4
    assert "expected" in capsys.readouterr().out
    with np.load("replay.npz") as arrays:
        assert arrays["got/density"] != pytest.approx(arrays["answer/density"])
        assert np.isnan(arrays["before/density"]).all()
        assert {"position", "mass", "smoothing.shape", "bound/density"} <= set(arrays.files)
    assert main(["contract", "own.py", "--replay", failed["replay"].replace("T1:", "T1:no_")]) == 2
    assert "has no such trial" in capsys.readouterr().err
    assert main(["contract", "own.py", "--replay", "T1"]) == 2


def test_the_guide_is_printed_without_a_page(capsys):
    assert main(["contract", "--guide"]) == 0
    out = capsys.readouterr().out
    for word in ("PROGRAMS", "--template", "--junit", "actions/setup-python", "add_test", "--replay"):
        assert word in out
