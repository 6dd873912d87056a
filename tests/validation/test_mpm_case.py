"""Measures of the MPM droplet against shapes and motions that are known."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from refsim import Simulation
from validation.experiments.mpm_droplet import runs
from validation.experiments.mpm_droplet.scene import CELLS, drop_scene, ellipsoid, lattice, turned
from validation.metrics import bodies, solutions
from validation.metrics.bodies import Turning


def test_mesh_measures_agree_with_trimesh():
    mesh = trimesh.creation.icosphere(subdivisions=3)
    mesh.apply_scale([1.3, 1.0, 0.8])
    mesh.apply_transform(trimesh.transformations.rotation_matrix(0.7, [1.0, 2.0, 0.5]))
    mesh.apply_translation([5.0, -2.0, 1.0])
    area, volume = bodies.mesh_size(mesh.vertices, mesh.faces, 3)
    inertia = mesh.moment_inertia
    moments = np.linalg.eigvalsh(np.trace(inertia) / 2 * np.eye(3) - inertia)
    assert (area, volume) == pytest.approx((mesh.area, mesh.volume))
    expected = (moments[-1] - moments[0]) / moments.mean()
    assert bodies.body_anisotropy(mesh.vertices, mesh.faces, 3) == pytest.approx(expected)


def test_an_ellipse_in_the_plane():
    """Semi-axes 1.2 and 1: area 1.2 pi, moments in the ratio 1.44 to 1."""
    angle = np.arange(2000) * 2 * math.pi / 2000
    vertices = np.stack([1.2 * np.cos(angle) + 3, np.sin(angle) - 2, 0 * angle], axis=1)
    facets = np.stack([np.arange(2000), (np.arange(2000) + 1) % 2000], axis=1)
    assert bodies.mesh_size(vertices, facets, 2)[1] == pytest.approx(1.2 * math.pi, rel=1e-5)
    assert bodies.body_anisotropy(vertices, facets, 2) == pytest.approx(0.44 / 1.22, rel=1e-6)


def test_even_particles_are_told_from_uneven_ones():
    """A disc pressed together: its density is 1/J, and with a sixteenth of one side's particles gone it is not."""
    place = ellipsoid(9.0, 2)
    run = Simulation(drop_scene(place, 2, balanced=True, liquid={"bulk_modulus": 1000.0}), backend="cpu")
    even = bodies.evenness(run)
    assert even["mean"] == pytest.approx(1.0, abs=2e-3)
    assert even["range"] < 2e-3
    thin = place[(place[:, 0] < 0) | (np.arange(len(place)) % 16 > 0)]
    run = Simulation(drop_scene(thin, 2, balanced=True, liquid={"bulk_modulus": 1000.0}), backend="cpu")
    assert bodies.evenness(run)["range"] == pytest.approx(1 / 16, rel=0.3)


@pytest.mark.parametrize("dim", [2, 3])
def test_contact_angle_of_a_cap(dim):
    """A cap whose centre is cos(theta) R below the floor."""
    points = np.random.default_rng(1).normal(size=(3000, dim))
    points *= 8.0 / np.linalg.norm(points, axis=1, keepdims=True)
    points[:, 1] -= 8.0 * math.cos(math.radians(70))
    found = bodies.contact(points, 0.0, 1.0, dim)
    assert (found["angle"], found["radius"]) == pytest.approx((70.0, 8.0))
    assert found["roughness"] < 1e-12


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("angle", [40.0, 90.0, 130.0])
def test_contact_angle_of_caps_of_particles(dim, angle):
    """Cut from turned lattices at R = 12 cells: the height of their centre of mass tells the angle."""
    below = -12.0 * math.cos(math.radians(angle))
    place = turned(lattice(26.0, dim, (0.1, -0.2, 0.05)), seed=4)
    place = place[(((place - np.eye(dim)[1] * below) ** 2).sum(1) < 144) & (place[:, 1] > 0)]
    assert bodies.angle_of_mass(place[:, 1].mean(), len(place) / 2**dim, dim) == pytest.approx(angle, abs=1.5)


def test_frequency_and_damping_are_found():
    time = np.linspace(0, 2, 400)
    value = 0.2 * np.exp(-0.7 * time) * np.cos(9.0 * time) + 0.01 + 1e-6 * np.random.default_rng(3).normal(size=400)
    found = runs.damped_cosine(time, value, 9.3)
    assert found["frequency"] == pytest.approx(math.hypot(9.0, 0.7), rel=1e-5)
    assert found["damping"] == pytest.approx(0.7, rel=1e-4)


def test_references_go_to_rayleigh():
    """Stiff liquid and small amplitudes; at finite ones the frequency falls with the square of the amplitude."""
    assert solutions.compressible(0.2, 2, 1e9) == pytest.approx(1.0, abs=1e-6)
    assert solutions.compressible(0.2, 3, 1000.0) < 1.0
    small, large = (solutions.swing_of_ideal_drop(amplitude, modes=6) for amplitude in (0.02, 0.04))
    assert 1 - small == pytest.approx(0.75 * 0.02**2, rel=0.1)
    assert (1 - large) / (1 - small) == pytest.approx(4.0, rel=0.1)
    # Tsamopoulos and Brown 1983: 1 - 34409/58800 e^2 for R (1 + e P_2); a spheroid longer by s has e = s to first order
    ratio = solutions.swing_of_ideal_drop(0.04, modes=6, dim=3)
    assert 1 - ratio == pytest.approx(34409 / 58800 * 0.04**2, rel=0.1)


class Spinning:
    """Two particles of 1 kg that stand still and turn about themselves with 3 rad/s, as a run is seen."""

    count, steps = 2, 0
    plan = SimpleNamespace(
        grid=SimpleNamespace(dim=2), effects={"mpm_liquid": SimpleNamespace(cell=lambda grid: CELLS[2])}
    )

    def __init__(self) -> None:
        self.fields = {
            "mass": np.ones(2), "position": np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]),
            "velocity": np.zeros((2, 3)), "affine": np.tile([0.0, -3.0, 0.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0], (2, 1)),
            "inverse_spread": np.tile(np.eye(3)[np.triu_indices(3)], (2, 1)),
        }  # fmt: skip

    def field(self, name):
        return self.fields[name].copy()


def test_angular_momentum_is_told_apart():
    """The spin 3/s of D = (h^2/4) d 1 carries 6 (h^2/4) d: halving 1/d while the spin stays is the surface's doing; a
    velocity of its own that a step gives is the step's."""
    run, turning = Spinning(), Turning()
    unit = CELLS[2] ** 2 / 4
    turning(run)
    assert turning.total == pytest.approx(12 * unit)
    run.steps = 1
    run.fields["inverse_spread"] = 0.5 * run.fields["inverse_spread"]
    turning(run)
    assert (turning.remade, turning.in_steps) == pytest.approx((12 * unit, 0.0))
    run.steps = 2
    run.fields["velocity"] = np.array([[0.0, 0.25, 0.0], [0.0, -0.25, 0.0]])
    turning(run)
    assert (turning.remade, turning.in_steps) == pytest.approx((12 * unit, 0.5))
    assert turning.greatest["in_steps"] == pytest.approx(0.5)
