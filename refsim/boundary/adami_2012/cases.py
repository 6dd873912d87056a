"""Inputs and closed forms of walls after Adami, Hu & Adams 2012."""

import math

import numpy as np

from refsim.boundary.akinci_2012 import BoxWalls
from refsim.core.cases import Exact, at, closed_form, example, groups, takes
from refsim.core.effect import int32
from refsim.core.walls import Holding, WallMotion, WallParticles
from refsim.smoothing.cases import for_each_kernel
from refsim.sph import Fluid, WallFrameGravity

takes("adami_2012.strain", fluid="rest_density")
takes("adami_2012.extrapolation", fluid="rest_density clamp internal_pressure")
takes("adami_2012.wall_force", fluid="clamp internal_pressure")
takes("adami_2012.hold", smoothing="support_radius dim")
example(BoxWalls(lower=(-0.03, -0.03, -0.5), upper=(0.8, 0.8, 0.8)))


groups(holding=lambda case, grid: Holding(grid.real(0.7), int32(3)))
groups(lean=lambda case, grid: WallFrameGravity(*map(grid.real, (2.0, -9.0, 1.5 if case.dim == 3 else 0.0))))


@groups("wall_pressure")
def _wall_pressure(case, grid):
    """Of either sign."""
    count = len(case.wall_position)
    return {"wall_pressure": (4e4 * case.random("wall_pressure").uniform(-0.5, 1.0, count)).astype(grid.dtype)}


@groups("wall_strain")
def _wall_strain(case, grid):
    """Of either sign, some volumes times the rate of a flow of 1 m/s."""
    volume = case.spacing**case.dim
    strain = volume**2 / case.spacing * case.random("wall_strain").uniform(-1.0, 1.0, len(case.wall_position))
    return {"wall_strain": strain.astype(grid.dtype)}


@groups("wall_normal")
def _wall_normal(case, grid):
    """Of every direction, and 0 at edges."""
    n = case.random("wall_normal").normal(size=(len(case.wall_position), 3)) * (1, 1, case.dim == 3)
    n[::3] = 0
    return {"wall_normal": (n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-9)).astype(grid.dtype)}


def _beside(wall_position):
    position = np.array([[0.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    return at("beside_walls", position, wall_position)


def _extrapolated(
    phase, wanted, wet=(0.0, 0.0), pressure=(300.0, 500.0), clamp=0, turning=None, borne=None, **cohesion
):  # fmt: skip
    """Wall particles 1 m from both particles and far away."""
    place = np.array([[0.0, 1.0, 0.0], [0.0, 9.0, 0.0]])
    inputs = {
        "density": [1000.0, 500.0], "pressure": [*pressure], "lean": WallFrameGravity(2.0, -9.0, 1.5),
        "walls": WallParticles(place, np.full(2, 0.5)), "period": None, "turning": turning, "borne": borne,
        "phase": phase and np.array(phase, np.int32), "wet": wet and phase and np.array(wet),
        "fluid": Fluid(2000.0, 4e5, 1, clamp, **cohesion),
    }  # fmt: skip
    return Exact(_beside(place), inputs, {"wall_pressure": [wanted, 0.0]})


for_each_kernel(
    "adami_2012.extrapolation",
    # mean of p_1 + rho_1 g.(0, 1, 0) and p_2 - rho_2 g.(0, 1, 0); that of the liquid alone where a solid is as near
    mean_of_two=lambda w: _extrapolated([0, 0], 0.5 * (300.0 + 1000.0 * -9.0 + 500.0 - 500.0 * -9.0)),
    # half and a quarter of it
    of_falling=lambda w: _extrapolated(
        None, 0.5 * (300.0 + 0.5 * 1000.0 * -9.0 + 500.0 - 0.25 * 500.0 * -9.0), borne=[0.5, 0.25]
    ),
    # g - a_w is (-6.75, 0.25, 1.5) m/s^2 where the wall is (-1, 1, -7) m off the axis, with w = 3 and dw/dt = 1/4
    in_a_tank_that_turns=lambda w: _extrapolated(
        None,
        0.5 * (300.0 + 1000.0 * 0.25 + 500.0 - 500.0 * 0.25),
        turning=[0.0, 0.0, 3.0, 0.0, 0.0, 0.25, 1.0, 0.0, 7.0],
    ),
    # without P_int (rho/rho0)^2 of each, 200 Pa (1/4 and 1/16)
    cohesive_liquid=lambda w: _extrapolated(
        None, 0.5 * (250.0 + 1000.0 * -9.0 + 487.5 - 500.0 * -9.0), internal_pressure=200.0
    ),
    beside_a_solid=lambda w: _extrapolated([0, 1], 300.0 + 1000.0 * -9.0),
    beside_a_dry_solid=lambda w: _extrapolated([0, 1], 300.0 + 1000.0 * -9.0, wet=None),
    # pressures below 1 Pa are kept
    clamped_liquid=lambda w: _extrapolated(
        None, 0.5 * (0.5 + 1000.0 * -9.0 + 0.25 - 500.0 * -9.0), pressure=(0.5, 0.25), clamp=1
    ),
    thin_films=lambda w: _extrapolated([1, 2], 0.25 * 0.5 + 0.75 * 0.25, wet=[0.1, 0.3], pressure=(18000.5, -17999.75)),
    # p_1 + rho_1/2 g.(0, 1, 0) of liquid, and with 1/1000 of the weight a film of p_2 - rho0 g.(0, 1, 0)
    beside_a_film=lambda w: _extrapolated(
        [0, 1], (300.0 - 4500.0 + 1e-3 * (500.0 + 18000.0)) / 1.001, wet=[0.0, 1.0], borne=[0.5, 0.25]
    ),
    # mean of p_1 + rho0 g.(0, 1, 0) and p_2 - rho0 g.(0, 1, 0) by their wetness
    film_between_solids=lambda w: _extrapolated(
        [1, 2], 0.25 * (300.0 - 18000.0) + 0.75 * (500.0 + 18000.0), wet=[0.1, 0.3]
    ),
)


@for_each_kernel("adami_2012.strain")
def strained_by_two(w):
    """V_w/2 sum_f V_f (v_f - t).e_f |W'(h/2)|/W(h/2), t = u - n n.u; a solid does not count."""
    place, around = np.array([[0.0, 1.0, 0.0]]), np.array([[0.0, 0.0, 0.0], [0.0, 2.0, 0.0], [1.0, 1.0, 0.0]])
    inputs = {
        "mass": [2.0, 3.0, 5.0], "velocity": [[7.0, 2.0, 0.0], [3.0, 0.0, -5.0], [9.0, 0.0, 0.0]], "period": None,
        "advanced_excess": [100.0, -20.0, 0.0], "walls": WallParticles(place, np.array([0.25])), "phase": [0, 0, 1],
        "fluid": Fluid(1000.0, 4e5, 1, 0), "wall_normal": [[0.0, 0.6, 0.8]],
    }  # fmt: skip
    along = 1.0 - 0.6 * (0.6 * 1.0 - 0.8 * 2.5)  # of u = (5, 1, -2.5)
    strain = 0.25 / 2 * (2 / 1100 * (2 - along) + 3 / 980 * along) * w.slope / (w.share * w.at_zero)
    return Exact(at("around_a_wall", around, place), inputs, {"wall_strain": [strain]})


def _pushed(w, first, second, turned=(0.0, 1.0, 0.0), pressure=(300.0, 500.0), wall=200.0, cohesion=0.0, **changes):
    """a = V_w p |W'(h/2)|/rho_i away from a wall particle on both sides of it, p = `first` and `second` [Pa]."""
    place = np.array([[0.0, 1.0, 0.0]])
    push = 0.25 * np.array([first / 1000.0, second / 500.0]) * w.slope
    inputs = {
        "density": [1000.0, 500.0], "pressure": [*pressure], "walls": WallParticles(place, np.array([0.25])),
        "fluid": Fluid(1000.0, 4e5, 1, 0, internal_pressure=cohesion), "wall_pressure": [wall], "phase": None,
        "suction": None, "film_factor": None, "correction_diagonal": None, "correction_mixed": None,
    } | changes  # fmt: skip
    return Exact(_beside(place), inputs, {"acceleration": [[0.0, -push[0], 0.0], push[1] * np.array(turned)]})


for_each_kernel(
    "adami_2012.wall_force",
    # p_i without P_int (rho/rho0)^2, 200 Pa (1 and 1/4)
    cohesive_liquid_pushed_by_its_wall=lambda w: _pushed(w, 100.0 + 200.0, 450.0 + 200.0, cohesion=200.0),
    # p_i + p_w; B_2 turns the second
    pushed_by_its_wall=lambda w: _pushed(
        w, 300.0 + 200.0, 500.0 + 200.0, (0.5, 3.0, -0.25),
        correction_diagonal=[[9.0, 1.0, 9.0], [9.0, 3.0, 9.0]], correction_mixed=[[0.0, 9.0, 0.0], [0.5, 9.0, -0.25]],
    ),
    # a solid's -80 Pa and a wall's -200 Pa are at least twice -50 Pa, 1.5 times; the liquid's 300 Pa meet -200 Pa
    solid_pushed_by_a_film=lambda w: _pushed(
        w, 300.0 - 200.0, 1.5 * -2 * 50.0, pressure=(300.0, -80.0), wall=-200.0, phase=[0, 1], suction=[0.0, -50.0],
        film_factor=[9.0, 1.5],
    ),
)  # fmt: skip


HELD = np.array([[1.0, -2.0, 0.5]])  # [m/s]


def _held(name, place, volume, moves=False, motion=None):
    """h = 2 m, r = 1 m: lap W = 45/(pi h^6) (h - r), (1 - r/h)^3 = 1/8; a = k V_b lap W/(8 rho) e e.(v_b - v).

    `volume` in 1/4 m^3.
    """
    place = np.array(place)
    apart = np.where(np.reshape(moves, (-1, 1)), motion.velocity if motion else 0.0, 0.0) - HELD
    drag = 3.0 * 0.25 * np.array(volume) * 45 / (math.pi * 64) / 8 / 500.0
    inputs = {
        "walls": WallParticles(place, 0.25 * np.array(volume)), "velocity": HELD, "density": [500.0],
        "holding": Holding(3.0, 3), "wall_motion": motion, "period": None,
    }  # fmt: skip
    pull = (drag * (apart * place).sum(1)) @ place
    return Exact(at(name, [0, 0, 0], place), inputs, {"acceleration": pull[None, :]})


closed_form(
    "adami_2012.hold",
    held_by_its_wall=lambda: _held("held", [[0.0, 0.6, 0.8]], [1]),
    # walls before and beyond planes of each axis; those beyond move, and are twice to seven times as large
    drawn_by_moving_walls=lambda: _held(
        "drawn", [[0.0, 0.6, 0.8], [0.0, 0.6, -0.8], [-1, 0, 0], [0, -1, 0], [0.8, 0, -0.6]], [1, 2, 3, 5, 7],
        [True, True, True, True, False],
        WallMotion(np.array([-0.9, -0.9, -0.7]), np.array([np.inf, np.inf, 0.7]), np.array([3.0, -4.0, -1.0])),
    ),
)  # fmt: skip
