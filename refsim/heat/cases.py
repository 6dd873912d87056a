"""Inputs, hard cases and closed forms of heat conduction."""

import math

import numpy as np

from refsim.core import cases
from refsim.core.cases import VARIATIONS, Case, Exact, Variation, closed_form, groups, particles, takes
from refsim.heat import HeatConduction
from refsim.heat.shapes import MUELLER, POLY6, SPIKY, Conduction, conduction_group

cases.example(
    HeatConduction(temperature=50.0, melting_point=0.0),
    brings="conductivity heat_capacity temperature temperature_range volume compensation_x compensation_rest",
)

SLOW = 1.0  # k dt/(rho c d^2) of the common cases, on average
STORED = cases.REST_DENSITY * 1000.0  # rho c [J/(m^3 K)] of the common cases, about


particles(
    # whole degrees around the melting points, so that some stand exactly on one
    temperature=lambda case, random: random.integers(-4, 8, case.count).astype(float),
    # whole kJ/kg around the latent heats, so that some stand exactly on one
    enthalpy=lambda case, random: 1000.0 * random.integers(-2, 6, case.count),
    melting_point=lambda case, random: random.integers(0, 3, case.count).astype(float),
    latent_heat=lambda case, random: 1000.0 * random.integers(0, 3, case.count),
    heat_capacity=lambda case, random: random.uniform(500.0, 4000.0, case.count),
)


@particles("conductivity")
def _conductivity(case, random):
    """Such that one step of the case carries heat across about a spacing; one particle in eight does not conduct."""
    stored = 1.0 if case.literal else STORED  # with Shao & Song M11 k is a diffusivity
    values = SLOW * 100 * stored * case.spacing * random.uniform(0.1, 1.0, case.count)
    values[3::8] = 0
    if case.name == "steep_conductivities":
        values[::2] *= 1e-3
    return values


@particles("volume")
def _volume(case, random):
    low, high = (0.1, 10.0) if case.name == "steep_volumes" else (0.7, 1.3)
    return case.spacing**case.dim * np.exp(random.uniform(math.log(low), math.log(high), case.count))


# A of one particle in eight is below, of another one above, what a pair's factor may be
def _size(case, random):
    size = random.uniform(0.5, 1.5, (case.count, 1))
    size[1::8], size[5::8] = 0.02, 25.0
    return size


particles(
    compensation_x=lambda case, random: _size(case, random) * np.array([1.0, 0.25, -0.125]),
    compensation_rest=lambda case, random: _size(case, random) * np.array([0.75, 0.25, 1.25]),
    reservoir=lambda case, random: (random.random(case.count) < 0.15).astype(np.uint8),
    exchange_rate=lambda case, random: random.uniform(0.0, 5.0, case.count),
)


# a range that some of the temperatures have left, upwards or downwards
groups(temperature_range=lambda case, grid: np.array([-1.5, 6.25] if case.count % 2 else [-3.75, 4.5], grid.dtype))


@groups("conduction")
def _conduction(case, grid):
    literal = ("M8", "M9", "M11") * case.literal + ("M6",) * (case.literal or case.kernels == "mueller")
    effect = HeatConduction(literal=literal, mean="arithmetic" if case.clamp else "harmonic")
    return {"conduction": effect.conduction(grid)}


def planned(case, grid):
    """The number of passes is found on the GPU, not on the host."""
    passes = 0 if case.name.startswith("dense_cluster") else 64  # more than a table holds; then they only damp
    return HeatConduction().conduction(grid)._replace(planned_passes=passes)


def _conduction_follows(group, inputs, kernel):
    """What is made of the support radius and of the spacing d of the case.

    If the conductivity becomes a diffusivity (Shao & Song M11), or a diffusivity a conductivity, it is divided or
    multiplied by rho c: s_i would be a million times the case's, beyond what a GPU's table of passes is made for and
    unstable for RKL1 with latent heat, whose answer one rounding would then change completely.
    """
    case, factor, members = inputs.case, float(group.factor), {}
    if group.unit_capacity != case.literal:
        factor *= STORED if case.literal else 1 / STORED
        members["factor"] = factor
    grid = Case("", int(group.dim), case.position, case.spacing, float(group.support_radius)).grid("float64")
    made = conduction_group(grid, laplacian=int(group.laplacian), factor=factor)._asdict()
    return members | {name: made[name] for name in ("inverse_radius", "inverse_volume", "scale")}


VARIATIONS[Conduction] = Variation(
    _conduction_follows,
    {"planned_passes": "capacity of a table on a GPU, which does not change the answer"},
    {"dim": lambda dim: 5 - dim},
    ("support_radius", "factor", "laplacian", "harmonic", "unit_capacity", "dim"),
)
cases.readings(conduction="laplacian harmonic unit_capacity frozen")
PAIRS = "support_radius factor laplacian harmonic unit_capacity dim"
cases.codes(Conduction, laplacian={"spiky": SPIKY, "mueller": MUELLER, "poly6": POLY6})
takes("heat.compensation", conduction="support_radius factor laplacian dim unit_capacity")  # which changes `factor`
takes("heat.one_sided", conduction=f"{PAIRS} frozen sweep_share")
takes("heat.implicit", conduction=f"{PAIRS} tolerance")


# Volumes 100 : 1, and conductivities 1000 : 1
for _name in ("steep_volumes", "steep_conductivities"):
    cases.hard_input(_name, 3, lambda: cases.lattice((5, 5, 5)))


# Closed forms: two particles 1 m apart, h = 2 m, so that L = 3 (15/pi/8) (1/2)^2/2; dt = 0.5 s.

PAIR = cases.pair_case("heat_pair")
VOLUME, CONDUCTIVITY = np.array([2.0, 0.5]), np.array([3.0, 1.0])
MASS, CAPACITY, TEMPERATURE = np.array([4.0, 2.0]), np.array([0.5, 3.0]), np.array([80.0, -20.0])
INVERSE = 1 / (MASS * CAPACITY)
WEIGHT = 0.5 * VOLUME[0] * VOLUME[1] * (2 * 1.5) * 3 * 15 / (64 * math.pi)  # harmonic mean 1.5
APART = TEMPERATURE[1] - TEMPERATURE[0]


def _conduction_of(**options):
    return conduction_group(PAIR.grid("float64"), **options)


SOLVED = _conduction_of(tolerance=1e-14)  # so that Chebyshev's iteration is backward Euler, as M(4) is for a pair


def _given(**more):
    return {
        "mass": MASS, "volume": VOLUME, "heat_capacity": CAPACITY, "conductivity": CONDUCTIVITY,
        "temperature": TEMPERATURE, "timestep": [0.7, 0.5], "reservoir": None, "enthalpy": None, "melting_point": None,
        "latent_heat": None, "compensation_x": None, "compensation_rest": None,
        "conduction": _conduction_of(),
    } | more  # fmt: skip


def _pair(temperature, **more):
    """The pair and both temperatures after the step."""
    return Exact(PAIR, _given(**more), {"temperature": temperature})


def _rates(rate, case=PAIR, **more):
    return Exact(case, _given(**more), {"exchange_rate": rate})


def _moved(heat):
    """Both temperatures after `heat` [J] went to the first particle."""
    return TEMPERATURE + INVERSE * np.array([heat, -heat])


def _alone(weight=WEIGHT):
    """M(4): what goes to the first particle of a lone pair for each kelvin of difference [J/K]."""
    return weight / (1 + weight * INVERSE.sum())


# E = g (T_2 - T_1)
closed_form("heat.explicit", across=5.0, a_pair_forward=lambda: _pair(_moved(WEIGHT * APART)))
closed_form(
    "heat.exchange_rate",  # G/C_i, G = WEIGHT/dt; a reservoir has none
    rates_of_a_pair=lambda: _rates(np.array([WEIGHT / 0.5 * INVERSE[0], 0.0]), reservoir=[0, 1]),
)


def _each_by_itself(weight):
    """T_i + f_i (T_j - T_i), f_i = g/C_i/(1 + g (1/C_1 + 1/C_2)) of half a step, and again from the new ones."""
    f, t = _alone(weight / 2) * INVERSE, TEMPERATURE
    for _ in range(2):
        t = t + f * (t[::-1] - t)
    return t


closed_form("heat.one_sided", across=5.0, a_pair_each_by_itself=lambda: _pair(_each_by_itself(WEIGHT)))


@closed_form("heat.implicit", across=5.0)
def a_pair_by_chebyshev():
    """After n steps the error of the mode 1 + z has shrunk by T_n((1 + s - (1 + z))/s)/T_n((1 + s)/s); s = max(g/C)."""
    z, s = WEIGHT * INVERSE.sum(), (WEIGHT * INVERSE).max()
    sigma = math.exp(-math.acosh((1 + s) / s))
    passes = math.ceil(math.log(0.1 / 2) / math.log(sigma))
    left = math.cos(passes * math.acos((s - z) / s)) / math.cosh(passes * math.acosh((1 + s) / s))
    return _pair(_moved(_alone() * APART * (1 - left)), conduction=_conduction_of(tolerance=0.1))


def _by_legendre(stages, largest_sum):
    """The difference shrinks by 1 - b + b P_s(1 - w z), b = (s^2 + s - 2)/(2 s (s + 1)), z = g (1/C_1 + 1/C_2)."""
    more, b = stages**2 + stages - 2, (stages**2 + stages - 2) / (2 * stages * (stages + 1))
    x = 1 - 4 / more * largest_sum * INVERSE.sum() / INVERSE.max()
    left = 1 - b + b * np.polynomial.Legendre.basis(stages)(x)
    timestep = np.array([0.7, 0.5 * largest_sum / (WEIGHT * INVERSE.max())])
    return _pair(_moved(APART * (1 - left) / INVERSE.sum()), timestep=timestep)


closed_form(  # just below and above what three stages hold, s_max = 2.5
    "heat.runge_kutta_legendre", across=5.0, a_pair_by_three_stages=lambda: _by_legendre(3, 2.48),
    a_pair_by_five_stages=lambda: _by_legendre(5, 2.52),
)  # fmt: skip


SHARE = 3 * 15 / (64 * math.pi)  # L r^2 of the pair [1/m^3]
STARTING = (1.1, 3.3, 1.3, 1.8)  # weights of the rounds of a start


def _compensated(along, over, weights):
    """A of the pair after rounds: along it by S = m f, m_i = V_j L r^2, f = (a_1 + a_2)/2 within 1/10 and 10.

    P is 1.05/(m + 0.05) along the pair and 21 across it, where nothing is summed.
    """
    m = SHARE * VOLUME[::-1]
    p = 1.05 / (m + 0.05)
    for weight in weights:
        f = min(max(along.mean(), 0.1), 10.0)
        along = along + weight * (p * (1 - m * f) - (along - p) / 100)
        over = over + weight * (21.0 - (over - 21.0) / 100)
    return {
        "compensation_x": np.tile([over, 0.0, 0.0], (2, 1)),
        "compensation_rest": np.column_stack((along, np.zeros(2), np.full(2, over))),
    }


def _compensating(**given):
    """Of particles at rest and with A = 0, if nothing else is given."""
    inputs = {name: np.zeros((2, 3)) for name in ("velocity", "compensation_x", "compensation_rest")}
    return inputs | {"volume": VOLUME, "conduction": _conduction_of(), "reservoir": None} | given


@closed_form("heat.compensation", across=5.0)
def compensation_at_the_start():
    """From 0, at rest: P, and four rounds."""
    return Exact(PAIR, _compensating(), _compensated(1.05 / (SHARE * VOLUME[::-1] + 0.05), 21.0, STARTING))


@closed_form("heat.compensation", over=(0.0, 1e-3))
def compensation_later(speed):
    """One round with the weight 3/2 if the second particle moves, none at rest."""
    start, after = (_compensated(np.array([2.0, 4.0]), 3.0, rounds) for rounds in ([], [1.5] * (speed > 0)))
    return Exact(PAIR, _compensating(velocity=np.outer([0.0, speed], [0.0, 0.0, 1.0]), **start), after)


# The Laplacian of poly6 (Shao & Song M5): at q = 1/2 it is 315/(64 pi h^5) (24/4 3/4 - 18 9/16), below 0.

POLY6_WEIGHT = 0.5 * VOLUME[0] * VOLUME[1] * (2 * 1.5) * 315 / (64 * 32 * math.pi) * (4.5 - 10.125)
BY_POLY6 = _conduction_of(laplacian=POLY6, sweep_share=0.5)


closed_form(  # the moduli: |G|/C_i
    "heat.exchange_rate", across=5.0,
    rates_by_poly6=lambda: _rates(np.abs(POLY6_WEIGHT) / 0.5 * INVERSE, conduction=BY_POLY6),
)  # fmt: skip


# Conductivities below 1 W/(m K), a tenth of the pair's: the harmonic mean of 0.3 and 0.1 is 0.15.

POOR = 0.1 * CONDUCTIVITY
closed_form(
    "heat.one_sided", a_poor_conductor_by_itself=lambda: _pair(_each_by_itself(0.1 * WEIGHT), conductivity=POOR)
)


# With latent heat: the first particle at 80 melts nothing, the second stands 60 J/kg below its melting point of 0.
ICE = {"melting_point": [70.0, 0.0], "latent_heat": [2.0, 50.0], "enthalpy": [7.0, -60.0]}


def _molten(heat, **more):
    """The pair with enthalpies and temperatures after `heat` [J] went to the second particle."""
    enthalpy = ICE["enthalpy"] + heat * np.array([-1.0, 1.0]) / MASS
    beyond = np.minimum(enthalpy, 0) + np.maximum(enthalpy - ICE["latent_heat"], 0)
    temperature = ICE["melting_point"] + beyond / CAPACITY
    return Exact(PAIR, _given(**ICE, **more), {"enthalpy": enthalpy, "temperature": temperature})


# H += E/m, E = g (T_2 - T_1), and over 1 + g (1/C_1 + 1/C_2); T(H) is constant from 0 to the latent heat
closed_form("heat.explicit", ice_forward=lambda: _molten(-WEIGHT * APART))
closed_form("heat.implicit", ice_backward=lambda: _molten(-_alone() * APART, conduction=SOLVED))
closed_form(  # RKL1 with one stage, which s_max < 1 allows, is forward Euler
    "heat.runge_kutta_legendre", ice_by_one_stage=lambda: _molten(-WEIGHT / 2 * APART, timestep=np.array([0.7, 0.25]))
)


closed_form(
    "heat.particle_volume",
    volume_of_two=lambda: Exact(PAIR, {"mass": [2.0, 3.0], "density": [1000.0, 500.0]}, {"volume": [0.002, 0.006]}),
)
UNIT = 32 * math.pi / 45  # factor with which g = V_1 V_2 2 k dt/2 for particles 1 m apart


@closed_form("heat.explicit")
def a_pair_of_unit_weight():
    """g = 1 J/K, exactly: all its factors are powers of 2."""
    conduction = _conduction_of(factor=UNIT)
    assert conduction.scale == 1.0
    return _pair(_moved(APART), conductivity=np.ones(2), timestep=[0.7, 1.0], conduction=conduction)


@closed_form("heat.exchange_rate")
def rates_of_a_pair_in_nearly_one_place():
    """q = 1.005e-9 is above 0, so that the pair exchanges: L is (1 - q)^2/(1/10), twenty times that at q = 1/2."""
    near = cases.pair_case("heat_near", 2.01e-9)
    return _rates(20 * (1 - 1.005e-9) ** 2 * WEIGHT / 0.5 * INVERSE, near)
