"""Right programs pass that know no private convention: sums compared by distance, heat as the textbooks have it."""

import math

import msgspec
import numpy as np

from refsim import contract
from refsim.contract.apart import LibraryDescription, Request
from refsim.contract.inputs import shape_acts
from refsim.contract.report import report, text
from refsim.core import cases
from refsim.core.operation import REGISTRY
from refsim.smoothing import SHAPES


def failures(programs, operation, **chosen):
    outcomes = list(contract.trials(programs, operation, **chosen))
    assert len([o for o in outcomes if not o.not_judged]) > 10
    return [str(o) for o in outcomes if not o.passed and not o.not_judged]


# Heat: Brookshaw's Laplacian with the harmonic mean of the conductivities
def heat(position, mass, volume, heat_capacity, conductivity, conduction, timestep, temperature):
    """Forward Euler; -W'(r)/max(r, h/10) with the spiky kernel."""
    h, dim = float(conduction.support_radius), int(conduction.dim)
    apart = position[:, None] - position[None]
    r = np.sqrt((apart.astype(float) ** 2).sum(2))
    slope = 3 * {2: 10 / math.pi, 3: 15 / math.pi}[dim] / h ** (dim + 1) * (1 - r / h) ** 2
    steep = np.where((r < h) & (r > 0), slope / np.maximum(r, h / 10), 0)
    total = conductivity[:, None] + conductivity[None]
    mean = 2 * conductivity[:, None] * conductivity[None] / np.where(total > 0, total, 1)
    rate = volume[:, None] * volume[None] * 2 * mean * steep * float(conduction.factor)
    with np.errstate(invalid="ignore"):
        gain = np.where(steep > 0, rate * (temperature[None] - temperature[:, None]), 0).sum(1)
    temperature += (float(timestep[1]) * gain / (mass * heat_capacity)).astype(temperature.dtype)


STANDARD = contract.Programs(
    {"heat.explicit": heat}, dtypes=("float64",), readings=False, name="heat",
    without=(
        "reservoir", "period", "melting_point", "latent_heat", "enthalpy", "compensation_x", "compensation_rest",
    ),
)  # fmt: skip


def test_a_standard_heat_code_passes():
    assert not failures(STANDARD, "heat.explicit", steps=("T1", "T2", "T5", "T7", "T9", "T10"))


# What was not judged
def cubic(position, mass, smoothing, density):
    h, dim = float(smoothing.support_radius), int(smoothing.dim)
    q = np.minimum(np.sqrt(((position[:, None] - position[None]) ** 2).sum(2)) / h, 1)
    w = np.where(q <= 0.5, 1 - 6 * q * q * (1 - q), 2 * (1 - q) ** 3)
    scale = {2: 40 / (7 * math.pi), 3: 8 / math.pi}[dim] / h**dim
    density[:] = (scale * w * mass[None]).sum(1)


OWN = contract.Programs(
    {"sph.density": cubic}, kernels=("cubic_spline",), dtypes=("float64",), walls=False, name="cubic",
    without=("number_density", "asymmetry", "period"),
)  # fmt: skip


def reported(outcomes, allowed):
    """(verdict's data, text) of these outcomes."""
    declared = {"dtypes": ["float64"], "dims": [3], "kernels": ["cubic_spline"], "left_out": OWN.left_out}
    about, found = LibraryDescription("cubic", "cpu", *[["sph.density"]] * 2, declared), {"sph.density": outcomes}
    data = report(about, Request("cubic", steps=("T3",), variants=(0,), allow_untried=allowed), found, 0.0)
    return data, text(data, found)


def test_what_takes_too_long_is_said_by_number_and_size():
    """And holds where it is declared out, or allowed."""
    limited = {most: msgspec.structs.replace(OWN, dims=(3,), most_particles=most) for most in (None, 3000)}
    made = {most: list(contract.trials(flat, "sph.density", (), (0,), ("T3",))) for most, flat in limited.items()}
    for most, allowed, holds in ((None, False, False), (None, True, True), (3000, False, True)):
        data, words = reported(made[most], allowed)
        assert data["holds"] is holds
        assert ("sph.density is not tried with 70,000 particles (1 trial): a call would take" in words) is (not most)
        assert ("Not judged, as declared (trials or whole variants): above 3,000 particles (1)" in words) is bool(most)


def test_closed_forms_are_there_for_every_kernel():
    """And not for two kernels, which is told, and no gap."""
    cases.discover()
    for name in (name for name in REGISTRY if shape_acts(REGISTRY[name])):
        forms = [form() for form in cases.CLOSED_FORMS[name]]
        shapes = {exact.inputs["smoothing"].shape for exact in forms if "smoothing" in exact.inputs}
        assert shapes == set(SHAPES.values()), name
    name = "csf_wang_2019.normal"
    own = contract.Programs({name: lambda mass: mass}, kernels=("spiky", "poly6"), dtypes=("float64",), name="own")
    told = {o.kernel: o.not_judged for o in contract.trials(own, name, steps=("T1",), variants=(0,))}
    assert told == {"spiky": "", "poly6": "", "spiky poly6": "a closed form, as there is none for the kernel"}


def test_a_force_on_one_particle_tells_nothing():
    assert not contract.run("sph.momentum", "numpy", "float64", "one_particle").telling


# Ranks
def of_a_rank(position, mass, smoothing, density, owned):
    """The density of the particles that a rank owns, over these and the ghosts behind them."""
    whole = np.zeros_like(density)
    cubic(position, mass, smoothing, whole)
    density[:owned] = whole[:owned]


def without_ghosts(position, mass, smoothing, density, owned):
    cubic(position[:owned], mass[:owned], smoothing, density[:owned])


def test_ranks_with_ghosts_give_the_answer_of_one():
    for program, passed in ((of_a_rank, True), (without_ghosts, False)):
        programs = msgspec.structs.replace(OWN, programs={"sph.density": program})
        outcomes = [o for o in contract.trials(programs, "sph.density", steps=("T5",)) if "ranks" in o.trial]
        assert [o.passed for o in outcomes] == [passed] * 4
        assert all(passed or " ranks with ghosts is not that of one" in o.words for o in outcomes)
    assert all("ranks" not in o.trial for o in contract.trials(OWN, "sph.density", steps=("T5",)))
