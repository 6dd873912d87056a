"""The reconstruction of a surface: its samples and its fit, conservation by its force, limits, references."""

import numpy as np
import pytest
from scipy.linalg import lstsq

from refsim import Cloud, MpmLiquid, Scene, Simulation, SurfaceEnergy
from refsim.backends.arrays import Backend
from refsim.core.errors import InputError, RunStopped
from refsim.sparse_grid.reference import node_table
from refsim.surface_energy import Tension, operations
from refsim.surface_energy.reconstruction import Reconstruction
from tests.running import advanced, rows

CPU = Backend("cpu")
H = 1 / 32


def ball(radius, radii=(1.0, 1.0, 1.0), dim=3):
    """A jittered lattice, 2^dim particles to a cell, cut by a sphere or ellipsoid of `radius` cells, in units of h."""
    half = int(2 * radius * max(radii)) + 2
    axis = 0.5 * np.arange(-half, half) + 0.25
    place = np.stack(np.meshgrid(*[axis] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    place = place + np.random.default_rng(0).uniform(-0.25, 0.25, place.shape)
    inside = np.linalg.norm(place / np.array(radii[:dim]), axis=1) < radius
    return np.pad(place[inside], ((0, 0), (0, 3 - dim)))


def reconstructed(place, dim=3, **parameters):
    """(reconstruction, surface) of particles at `place` in units of H."""
    made = Reconstruction(CPU, dim, "float64", H, Tension(surface_tension=2.0, **parameters))
    return made, made.surface(H * place)


@pytest.mark.parametrize("dim", [2, 3])
def test_poisson_disk_samples_keep_their_distance_and_leave_no_gap(dim):
    made, surface = reconstructed(ball(5, dim=dim), dim, quadrature="poisson", inset=-1.0)
    place = surface.samples.position / H
    distance = np.linalg.norm(place[:, None] - place[None], axis=-1) + 9 * np.eye(len(place))
    assert distance.min() >= 0.5
    assert distance.min(1).max() < 1.1  # in a wider gap another disk would fit
    _, exact = reconstructed(ball(5, dim=dim), dim, inset=-1.0)
    assert surface.samples.area.sum() == pytest.approx(exact.samples.area.sum(), rel=1e-5)
    assert np.ptp(surface.samples.area) == 0
    again = made.surface((H * ball(5, dim=dim)), step=1)
    assert not np.array_equal(again.samples.position[:20], surface.samples.position[:20])
    redrawn = made.surface((H * ball(5, dim=dim)), step=0)
    assert np.array_equal(redrawn.samples.position, surface.samples.position)


# The fit
def fit_matrix(made, surface):
    """(B, dense, on its active columns; b; points [m]; active nodes) of a surface's fit."""
    offset = made.term.offset * made.term.cell_size * surface.offset_direction
    points = np.vstack([surface.sample_place, surface.sample_place + offset])
    row, node, weight = operations.matrix(points, surface.blocks, made.term)
    active, column = np.unique(node[weight > 0], return_inverse=True)
    matrix = np.zeros((len(points), len(active)))
    matrix[row[weight > 0], column] = weight[weight > 0]
    return matrix, np.repeat([0.0, made.term.offset], len(points) // 2), points, active


def test_fit_goes_to_least_squares_and_its_residual_never_grows():
    """Many samples with bumpy directions: no spline passes through all of them; SciPy's least squares is the limit."""
    made, surface = reconstructed(ball(4, dim=2), 2, quadrature="poisson", disk_radius=0.1, inset=-1.0)
    matrix, goal, points, active = fit_matrix(made, surface)
    solution = lstsq(matrix, goal)[0]
    best = np.linalg.norm(goal - matrix @ solution)
    assert best > 0.02 * np.linalg.norm(goal)
    lengths = []
    for sweeps in (1, 2, 3, 5, 10, 30, 100, 1000, 10000):
        made.term = made.term._replace(iterations=np.int32(sweeps))
        found = made._fit(surface.blocks, points)[active]
        lengths.append(np.linalg.norm(goal - matrix @ found))
    assert (np.diff(lengths) < 0).all()
    assert best * (1 - 1e-9) < lengths[-1] < 1.05 * best
    assert np.abs(matrix @ (found - solution)).max() < 0.05 * goal.max()


# The force
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(
    "parameters", [{}, {"inset": -1.0}, {"quadrature": "poisson"}], ids=["inset", "at r", "poisson"]
)
def test_force_has_no_sum_no_torque_and_the_virial_of_its_area(dim, parameters):
    made, surface = reconstructed(ball(4, radii=(1.3, 1.0, 0.8), dim=dim), dim, **parameters)
    force = made.force(surface.samples, surface.blocks)
    place = H * node_table(surface.blocks)
    size = np.abs(force).sum()
    assert np.abs(force.sum(0)).max() < 1e-13 * size
    assert np.abs(np.cross(place, force).sum(0)).max() < 1e-13 * size
    area = surface.samples.area.sum()
    assert -(force * place).sum() == pytest.approx((dim - 1) * 2.0 * area, rel=1e-10)
    printed, _ = reconstructed(ball(1), dim, literal=("M1",), **parameters)
    assert np.array_equal(printed.force(surface.samples, surface.blocks), -force)


def test_force_is_the_slope_of_the_surface_energy():
    """Work on a smooth motion of the nodes against the change of k times the area of the facets that move with it."""
    made, surface = reconstructed(ball(9), inset=-1.0)
    true = surface.facet_normal  # of the very mesh whose area is measured
    force = made.force(surface.samples._replace(normal=true), surface.blocks)

    def motion(x):
        return np.stack([np.sin(5 * x[:, 1]), x[:, 0] * x[:, 2] + x[:, 1], np.cos(4 * x[:, 0]) + 2 * x[:, 2]], axis=1)

    def area(vertices):
        a, b, c = (vertices[surface.mesh.facets[:, k]] for k in range(3))
        return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()

    step = 1e-6
    vertices = surface.mesh.vertices
    slope = (area(vertices + step * motion(vertices)) - area(vertices - step * motion(vertices))) / (2 * step)
    work = (force * motion(H * node_table(surface.blocks))).sum()
    assert work == pytest.approx(-2.0 * slope, rel=2e-3)


@pytest.mark.parametrize(("parameters", "words"), rows(__file__, "bad_parameters"))
def test_bad_parameters_are_told(parameters, words):
    with pytest.raises(InputError, match=words):
        Reconstruction(CPU, 3, "float32", H, Tension(**{"surface_tension": 1.0, **parameters}))


def shaken_block(dim, **parameters):
    """64 shaken particles of an MPM liquid under tension."""
    cells = (8, 8) if dim == 2 else (4, 4, 4)
    lattice = np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in cells), indexing="ij"), axis=-1).reshape(-1, dim)
    place = 0.1 * lattice + np.random.default_rng(3).uniform(-0.01, 0.01, lattice.shape)
    return Scene(
        dim=dim, spacing=0.1, support_radius=0.21, step=2e-4,
        fluid=(Cloud(position=np.pad(place, ((0, 0), (0, 3 - dim)))),),
        effects=(MpmLiquid(bulk_modulus=1e3), SurfaceEnergy(surface_tension=50.0, **parameters)),
    )  # fmt: skip


@pytest.mark.parametrize("dtype, close", [("float32", 1e-5), pytest.param("float64", 1e-12, marks=pytest.mark.slow)])
@pytest.mark.parametrize("dim, parameters", rows(__file__, "settings"), ids=str)
def test_run_of_the_references_is_the_cpus(dim, parameters, dtype, close):
    """The whole reconstruction by the references, step after step: surface, fit, samples, and what they move.

    Rounding in float64 is 2e-16 of each term, sums have a hundred terms, and five steps repeat them: 1e-12 of the
    largest; in float32 it is 1e-7, and 1e-6 were found. A particle, a sample or a facet more or less would be 1e-2.
    """
    scene = shaken_block(dim, **parameters).with_(dtype=dtype)
    runs = [Simulation(scene, backend) for backend in ("numpy", "cpu")]
    for simulation in runs:
        advanced(simulation, 5 if dim == 2 else 2)
    oracle, own = (simulation.shared["surface"].latest for simulation in runs)
    assert len(oracle.samples.area) > 10
    assert np.array_equal(oracle.mesh.facets, own.mesh.facets)
    order = runs[1].host("identity")  # the CPU sorts its particles
    assert np.array_equal(oracle.samples.nearest, order[own.samples.nearest])
    assert np.array_equal(oracle.component_size[order], own.component_size)
    compared = [(oracle.mesh.vertices, own.mesh.vertices), (oracle.inset_mesh.vertices, own.inset_mesh.vertices)]
    compared += list(zip(oracle.samples[:3], own.samples[:3], strict=True))
    names = ("position", "velocity", "affine", "volume_ratio", "greatest_crowding")
    compared += [tuple(simulation.field(name) for simulation in runs) for name in names]
    for value, other in compared:
        assert value.shape == other.shape
        assert np.abs(value - other).max() < close * np.abs(value).max()
    assert np.abs(runs[0].field("velocity")).max() > 1e-4  # m/s: the tension moves it


def test_references_stop_where_the_grid_ends():
    made = Reconstruction(Backend("numpy"), 2, "float64", H, Tension(surface_tension=2.0))
    with pytest.raises(RunStopped, match="left the background grid, which ends"):
        made.surface(np.array([[0.0, 0.0, 0.0], [1e9, 0.0, 0.0]]))
