"""Damaged meshes, walls of boxes and cells of solids, drawn by seeds: what is made of them in numbers."""

import pathlib
import random
import types

import numpy as np
import pytest

import refsim
from refsim import BoxWalls, InputError
from refsim.backends.arrays import choose
from refsim.boundary import sampling
from refsim.boundary import signed_distance as distances
from refsim.boundary.akinci_2012 import box_layers, calibrated_factor, lattice_layers, wall_kernel_sums
from refsim.boundary.one_way_coupling.placing import cell_edges, flat_faces, placed_solid
from refsim.boundary.sampling import facet_counts
from refsim.core.effect import Discretisation
from refsim.scene import overlaps, solids
from refsim.scene.surface_mesh import placed_mesh, surface_mesh
from tests.boundary import damaged_meshes
from tests.running import rows

CUBE = pathlib.Path(refsim.__file__).parent / "examples" / "cube.obj"
BOX = (  # corners, and faces wound outwards
    np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)]),
    np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6],
              [0, 6, 4], [1, 5, 7], [1, 7, 3]]),
)  # fmt: skip


def divided(vertices, faces):
    """Each triangle in four."""
    corners = vertices[faces]
    a, b, c = corners.transpose(1, 0, 2)
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    four = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    points, place = np.unique(four.reshape(-1, 3), axis=0, return_inverse=True)
    return points, place.reshape(-1, 3)


def body(draw):
    """A turned brick, a finely divided one, or a round body."""
    vertices, faces = BOX
    for _ in range(draw.choice((0, 0, 1))):
        vertices, faces = divided(vertices, faces)
    if draw.random() < 0.4:
        away = vertices - 0.5
        vertices = 0.5 + away / np.linalg.norm(away, axis=1, keepdims=True)
    vertices = vertices * [1.0, draw.uniform(0.3, 2.0), 1.0]
    turn, _ = np.linalg.qr(np.random.default_rng(draw.randrange(2**16)).normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    return vertices @ turn.T + draw.uniform(-2, 2), faces.copy()


def integrals(corners):
    """Of triangles (t, 3, 3) the area, and the integrals of x, x x^T and the normal over them: however they are cut."""
    area, middle = overlaps.areas(corners), corners.mean(1)
    second = np.einsum("tci,tcj->tij", corners, corners) / 12 + 0.75 * middle[:, :, None] * middle[:, None]
    volume = np.einsum("tc,tc->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    return [area.sum(), (area[:, None] * middle).sum(0), *(area[:, None, None] * second).sum(0), volume]


def told(vertices, faces, pieces=True):
    """A mesh made of triangles with what a signed distance needs of it, or why there is none; whatever its order."""
    try:
        with np.errstate(all="ignore"):
            mesh = surface_mesh(vertices, faces)
    except InputError as error:
        return str(error)
    assert mesh.volume == pytest.approx(integrals(mesh.corners)[-1])
    assert mesh.area == pytest.approx(integrals(mesh.corners)[0])
    found = [mesh.origin, mesh.extent, mesh.volume]
    if not pieces:
        return found
    found += integrals(mesh.corners)
    if not len(mesh.meeting):  # else it depends on rounding how pieces in one plane are cut
        table, unclear = distances.triangle_table(mesh, "float64"), distances.unclear_features(mesh)
        found += [len(mesh.vertices), len(mesh.faces), mesh.notes]
        found += [(table.normal**3).sum(0).reshape(7, 3), (table.normal**2 * np.tile(table.corner[:, :3], 7)).sum(0)]
        found += [np.sort(np.unique(column, return_counts=True)[1]) for column in table.owner.T]
        found.append(0 if unclear is None else unclear.sum(0))
    return found


@pytest.mark.parametrize("seed", range(8))
def test_damaged_bodies_become_meshes_as_ever(seed, recorded, monkeypatch):
    monkeypatch.setattr(damaged_meshes, "body", body)
    draw, found = random.Random(f"recorded {seed}"), {}
    damages = [d for name, d in damaged_meshes.DAMAGES.items() if name != "scaled"]  # of a float's whole range
    for number in range(12):
        vertices, faces = body(draw)
        for damage in draw.choices(damages, k=draw.choice((0, 1, 1, 2, 3))):
            vertices, faces = damage(draw, vertices.copy(), faces.copy())
        found[str(number)] = told(vertices, faces)
    recorded(found)


def bricks(random, count):
    """Bricks at whole places, which touch, share faces and lie in each other; some are turned inside out."""
    made = []
    for _ in range(count):
        low, size = random.integers(0, 4, 3), random.integers(1, 4, 3)
        flipped = BOX[1][:, ::-1] if random.random() < 0.2 else BOX[1]
        made.append((low + size * BOX[0] + (random.random() < 0.3) * 0.31, flipped))
    first = np.cumsum([0, *(len(v) for v, _ in made)])
    return np.concatenate([v for v, _ in made]), np.concatenate([f + k for (_, f), k in zip(made, first)])


@pytest.mark.parametrize("seed", range(6))
def test_bricks_become_one_body_as_ever(seed, recorded):
    drawn, found = np.random.default_rng(seed), {}
    for number in range(5):
        vertices, faces = bricks(drawn, 2 + number)
        found[f"{number}"] = told(vertices, faces, pieces=False)
        turned = vertices @ [[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]]
        found[f"{number} turned"] = again = told(turned, faces, pieces=False)
        assert again[-1] == pytest.approx(found[f"{number}"][-1]), "its volume"
        meet = overlaps.meetings(vertices, faces, 1e-6, 1e-4)
        lengths = np.linalg.norm(np.diff(meet.ends, axis=1), axis=2)[~meet.flat]
        found[f"{number} meetings"] = meet.pairs, meet.flat, meet.apart, lengths.sum()
    recorded(found)


def test_polygons_and_triangles_are_cut_and_measured_as_ever(recorded):
    drawn, found = np.random.default_rng(4), {}
    for k in range(20):
        corner = drawn.normal(size=(3, 3))
        weights = drawn.uniform(-0.5, 1.2, (6, 2, 3))
        weights /= weights.sum(2, keepdims=True) + 0.1
        pieces = overlaps._cut(corner, weights @ corner, 1e-9, 40)
        fans = [np.stack([np.broadcast_to(p[0], p[2:].shape), p[1:-1], p[2:]], axis=1) for p in pieces]
        area = sum(overlaps.areas(fan).sum() for fan in fans)
        assert area == pytest.approx(overlaps.areas(corner[None])[0], rel=1e-9)
        found[f"pieces {k}"] = len(pieces), [overlaps._width(p) for p in pieces]
        points = drawn.uniform(-0.3, 1.0, (30, 2)) @ (corner[1:] - corner[0]) + corner[0]
        found[f"on {k}"] = [overlaps._lies_on(p, corner[None], tolerance) for p in points for tolerance in (0.0, 0.2)]
    one, other = drawn.normal(size=(2, 40, 3, 3))
    normal = overlaps.unit_normals(one)
    flat = other - ((other - one[:, :1]) * normal[:, None]).sum(2)[..., None] * normal[:, None]
    found["overlap"] = overlaps._overlap(one, flat, normal)
    found["near"] = [np.sort(p, axis=None) for p in overlaps._near_pairs(one * 0.3, 0.05)]
    _, faces = bricks(drawn, 4)
    edge, direction, ends = overlaps.edge_numbers(faces)
    found["edges"] = edge, direction, ends, overlaps.across_edges(edge, np.arange(len(ends)) % 3 > 0)
    square = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    assert overlaps._width(square) == pytest.approx(2.0)  # twice the area over the longest side
    recorded(found)


# Solids
def test_faces_and_cells_of_solids_are_as_ever(recorded):
    drawn, found = np.random.default_rng(6), {}
    for k in range(12):
        vertices, faces = bricks(drawn, 1 + k % 3)
        found[f"faces {k}"] = flat_faces(vertices[faces], (0.2, 0.7, 1.5)[k % 3])
        planes = np.sort(drawn.uniform(0, 3, 1 + k % 3))
        edges = cell_edges(planes, -0.7, 3.3, 0.2)
        found[f"edges {k}"] = edges
        assert edges[0] <= -0.6
        assert edges[-1] >= 3.2
        assert np.abs(edges[:, None] - planes).min(0).max() < 1e-12
    made = placed_solid(str(CUBE), (1.0, 2.0, 3.0), 0.6, (0.0, 0.0, 0.0), 0.0, 0.05, 0, 0, 0.3)
    share, centre = made.cells(0.13, 2)
    points = drawn.uniform([0.6, 1.6, 2.6], [1.4, 2.4, 3.4], (60, 3))
    found |= {"cells": (share, centre), "filled": made.filled(points, 0.1), "distance": made.distance(points)}
    found["band"] = (made.band.spacing, made.band.band, made.band.project(points[:20]))
    turned = placed_mesh(str(CUBE), None, 0.0, (10.0, 20.0, 30.0))
    sized = placed_mesh(str(CUBE), (1.0, 2.0, 3.0), 0.4, (0.0, 0.0, 0.0))
    found["turned"] = turned.vertices, turned.origin, sized.vertices
    area = drawn.uniform(0, 0.2, 50)
    found["counts"] = facet_counts(area, 0.9, 0.2), facet_counts(area, 0.9, 0.2, separately=True)
    recorded(found)


@pytest.mark.parametrize("spacing, band", [
    (0.0, None), (1.0, None), (0.1, 0.19), (1e-7, None), (2e-3, None), (4e-3, 0.1),
])  # fmt: skip
def test_signed_distances_that_are_not_possible_say_so_in_numbers(spacing, band, recorded, monkeypatch):
    """With 8 MiB of memory a band of 40 bytes a node is bounded."""
    monkeypatch.setattr(solids, "host_memory", lambda: {"total": 2**23})
    mesh = surface_mesh(*BOX)
    with pytest.raises(InputError) as caught:
        distances.signed_distance(mesh, spacing, band)
    recorded({"words": str(caught.value)})


@pytest.mark.parametrize("radius", [0.01, 1.0, 20.0])
def test_corners_that_the_isosurface_lacks_are_counted_in_radii(radius):
    away = np.array([0.5, 1.7, 1.9, 5.0]) * radius
    vertices = np.stack([away, 0 * away, 0 * away], axis=1)
    band = types.SimpleNamespace(
        backend=choose("numpy"), mesh=types.SimpleNamespace(vertices=vertices), spacing=1e-9,
        field=types.SimpleNamespace(distance=np.zeros(1)), local=types.SimpleNamespace(at=lambda v: (away, None)),
    )  # fmt: skip
    assert sampling._corners_cut_off(band, np.zeros((1, 3)), radius) == 2


# Walls of boxes
GRIDS = [
    Discretisation(dim, "float64", 0.1, 0.26 + 0.04 * (k % 2), 0, 0.0, None, period, (-0.2, 0.1, 0.0))
    for k, (dim, period) in enumerate([
        (2, (0.0, 0.0, 0.0)), (3, (0.0, 0.0, 0.0)), (2, (0.7, 0.0, 0.0)), (3, (0.0, 0.55, 0.0)), (3, (0.7, 0.5, 0.0)),
    ])
]  # fmt: skip


@pytest.mark.parametrize("number", range(len(GRIDS)))
def test_layers_of_walls_are_as_ever(number, recorded):
    grid, found = GRIDS[number], {}
    for count in (1, 3):
        for opened in ((), ("+y",), ("-x", "+x", "-z")):
            layer = box_layers((0.0, 0.1, -0.2), (0.9, 0.83, 0.4), 0.1, grid.dim, count, opened, grid.period)
            found[f"{count} {opened}"] = layer
            if count == 1:
                found[f"sums {opened}"] = wall_kernel_sums(layer, "wendland_c2", 0.26, grid.dim, grid.period)
    for shape in ("wendland_c2", "cubic_spline"):
        found[shape] = lattice_layers(shape, 0.26, 0.1, grid.dim), calibrated_factor(shape, 0.26, 0.1, grid.dim)
    assert len(box_layers((0.0,) * 3, (0.1, 0.3, 0.0), 0.1, 2, period=(0.1, 0.0, 0.0))) == 2  # a floor and a lid
    recorded(found)


@pytest.mark.parametrize("changes", rows(__file__, "boxes"))
def test_boxes_are_refused_or_taken_with_their_numbers(changes, recorded, monkeypatch):
    monkeypatch.setattr(solids, "host_memory", lambda: {"total": 2**23})
    found = {}
    for grid in GRIDS[:2]:
        box = BoxWalls(**{"lower": (0.0, 0.0, 0.0), "upper": (1.0, 1.0, 1.0)} | changes)
        try:
            box.check(grid, {})
            shared = {name: tuple(group) for name, group in box.shares(grid, {}).items()}
            found[str(grid.dim)] = shared, box.wall_speed()
        except InputError as error:
            found[str(grid.dim)] = str(error)
    recorded(found)
