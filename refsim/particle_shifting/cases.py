"""Inputs and closed forms of particle shifting."""

import numpy as np

from refsim.core.cases import Exact, at, closed_form, example, groups, particles, plain_keeps, takes
from refsim.particle_shifting import ParticleShifting, Shifting
from refsim.smoothing.cases import for_each_kernel

example(ParticleShifting(), brings="concentration_gradient filling_gradient number_density shift velocity_range")

takes("particle_shifting.crowding", shifting="inverse_neighbour")
takes("particle_shifting.shift", shifting="length largest least whole outer within farthest")
plain_keeps("particle_shifting.velocity_range", drawn_body="the output has a row for each body")
PAIR = at("shifted_pair", [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


groups(
    # some of the particles would go beyond the longest shift, and all in the plane; W(d) is about that of a spacing
    shifting=lambda case, grid: Shifting(
        *map(grid.real, (0.02 * case.support_radius, case.spacing**case.dim, 0.04)),
        *map(grid.real, (1 / case.support_radius, 1.02, 0.9, 0.95, 1e-3 if case.dim == 2 else 1e9)),
    )
)


@particles("concentration_gradient")
def _gradients(case, random):
    """Those of a lattice and of a surface."""
    return random.normal(0, 1, (case.count, 3)) / case.support_radius


particles("filling_gradient")(_gradients)


@particles("filling")
def _filling(case, random):
    """Of a surface and of a lattice."""
    return random.uniform(0.6, 1.1, case.count)


# v_max = 3 m/s: half of the diagonal of a box of 4 m/s, 2 m/s and 4 m/s; 1.5 m/s of another body
RANGE = np.array([[1.0, 0.5, 1.25, 3, 1.5, 2.75], [2.0, -1.0, 5.0, 0.0, 2.0, -3.0]])
groups(velocity_range=lambda case, grid: RANGE[: 1 + (case.count > 1)].astype(grid.dtype))
particles("drawn_body")(lambda case, random: np.arange(case.count, dtype=np.int32) % 2)
GIVEN = {
    "mass": [2.0, 3.0], "density": [1000.0, 500.0], "walls": None, "filling": None, "filling_gradient": None,
    "phase": None, "velocity_range": [[1.0, 8.0, 0.0, 5.0, 0.0, 0.0]], "timestep": [0.5, 0.2], "drawn_body": None,
}  # fmt: skip
MOST = 0.5 * 1.0  # A 2 h_s v_max dt [m^2]


@for_each_kernel("particle_shifting.crowding")
def apart(w):
    """The neighbour stands at W(d): sum_j V_j 1.2 W' e_ij."""
    gradient = w.slope * np.array([[0.0, 3.0 / 500.0, 0.0], [0.0, -2.0 / 1000.0, 0.0]])
    inputs = GIVEN | {"shifting": Shifting(0.5, 1 / (w.share * w.at_zero), 1e9), "filling_gradient": np.zeros((2, 3))}
    return Exact(PAIR, inputs, {"concentration_gradient": 1.2 * gradient, "filling_gradient": gradient})


def _shifted(gradient, shift, **more):
    """Down the gradient g: -A v_max dt 2 h_s g, less what a surface and bounds leave out."""
    inputs = GIVEN | {"shifting": Shifting(0.5, 1.0, 1e9), "concentration_gradient": gradient}
    return Exact(PAIR, inputs | more, {"shift": shift})


@closed_form("particle_shifting.velocity_range")
def of_two_bodies():
    """Each particle alone."""
    inputs = {"velocity": [[100.0, 0.0, 50.0], [96.0, 3.0, -45.0]], "drawn_body": np.array([0, 1], np.int32)}
    return Exact(PAIR, inputs, {"velocity_range": [[100.0, 0.0, 50.0, -100.0, 0.0, -50.0], [96, 3, -45, -96, -3, 45]]})


@closed_form("particle_shifting.velocity_range")
def of_one_body():
    """Largest and smallest velocities of both."""
    inputs = {"velocity": [[100.0, 0.0, 50.0], [96.0, 3.0, -45.0]], "drawn_body": None}
    return Exact(PAIR, inputs, {"velocity_range": [[100.0, 3.0, 50.0, -96.0, 0.0, 45.0]]})


@closed_form("particle_shifting.shift")
def along_the_surface():
    """Near the surface only the part across the normal is left, and nothing where the normal has no direction."""
    normal = np.array([[3.0, 4.0, 0.0], [0.0, 0.01, 0.0]])
    along = -MOST * 3.0 * np.array([-0.48, 0.36, 0.0])  # (0, 1) less (0, 1).n n, n = (0.6, 0.8)
    gradient = [[0.0, 3.0, 0.0], [0.0, -2.0, 0.0]]
    fields = {"filling": [0.9, 0.9], "filling_gradient": normal, "shifting": Shifting(0.5, 1.0, 1e9, 0.05)}
    return _shifted(gradient, [along, np.zeros(3)], **fields)


@closed_form("particle_shifting.shift")
def between_surface_and_inside():
    """Half of the normal leaves the gradient at 0.985; all of it, and half of the rest along it, at 0.925."""
    fields = {"filling": [0.985, 0.925], "filling_gradient": [[0.0, 2.0, 0.0]] * 2}
    shift = -MOST * np.array([[1.0, 2.0, 0.0], [1.0, 0.5, 0.0]])
    return _shifted([[1.0, 3.0, 0.0]] * 2, shift, shifting=Shifting(0.5, 1.0, 1e9, 0.05), **fields)


@closed_form("particle_shifting.shift")
def inside_and_solid():
    """Where all is filled the normal does not count; a solid stays."""
    fields = {"filling": [1.0, 1.25], "filling_gradient": np.ones((2, 3)), "phase": [0, 1]}
    return _shifted([[0.0, 3.0, 0.0], [0.0, -2.0, 0.0]], [[0.0, -3 * MOST, 0.0], [0.0, 0.0, 0.0]], **fields)


@closed_form("particle_shifting.shift")
def where_it_would_overshoot():
    """v_max dt = 1 m counts as 0.4 m, also for the bound: the first moves by 0.3 of that."""
    shift = [[0.0, -0.12, 0.0], [0.0, 0.4 * MOST / 4, 0.0]]
    return _shifted([[0.0, 3.0, 0.0], [0.0, -0.25, 0.0]], shift, shifting=Shifting(0.5, 1.0, 0.3, farthest=0.4))
