"""Meshes whose triangles overlap, end, stand twice or do not meet: signs, distances and volume against closed forms."""

import random

import numpy as np
import pytest
import trimesh

from refsim.boundary.sampling import sample
from refsim.boundary.signed_distance import signed_distance
from refsim.core.errors import InputError
from refsim.scene import overlaps
from refsim.scene.surface_mesh import load_mesh, surface_mesh
from tests.boundary import damaged_meshes
from tests.running import python, rows

BOX = trimesh.creation.box((1.0, 1.0, 1.0))
BALL = trimesh.creation.icosphere(3)
UPRIGHT, TURN = np.eye(3), trimesh.transformations.rotation_matrix(0.7, [1.0, 2.0, -0.4])[:3, :3]


def bricks(*corners):
    """Vertices and faces of boxes, each given by two corners."""
    made = [trimesh.creation.box(bounds=c) for c in corners]
    both = trimesh.util.concatenate(made)
    return np.array(both.vertices), np.array(both.faces)


def soup(vertices, faces):
    """The same triangles with corners of their own."""
    corners = np.asarray(vertices)[faces]
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)


def cells_distance(occupied, points):
    """Signed distance [m] of points (n, 3) from the union of the unit cells occupied (i, j, k)."""
    padded = np.pad(occupied, 1)
    distance = np.full(len(points), np.inf)
    for axis in range(3):
        for side in (0, 1):
            bare = padded & ~np.roll(padded, 1 - 2 * side, axis)
            for cell in np.argwhere(bare) - 1:
                low, high = cell.astype(float), cell + 1.0
                low[axis] = high[axis] = cell[axis] + side
                away = np.maximum(np.maximum(low - points, points - high), 0)
                distance = np.minimum(distance, np.linalg.norm(away, axis=1))
    cell = np.clip(np.floor(points).astype(int), -1, np.array(occupied.shape)) + 1
    return np.where(padded[tuple(cell.T)], -distance, distance)


def assert_union(vertices, faces, occupied, turn=UPRIGHT, rounding=1e-6, spacing=0.13, count=2000):
    """The mesh's field, volume and area are those of the union of unit cells, turned."""
    mesh = surface_mesh(vertices @ turn.T, faces)
    padded = np.pad(occupied, 1).astype(int)
    assert mesh.volume == pytest.approx(occupied.sum(), rel=rounding)
    assert mesh.area == pytest.approx(sum(np.abs(np.diff(padded, axis=a)).sum() for a in range(3)), rel=rounding)
    points = np.random.default_rng(5).uniform(-0.6, np.array(occupied.shape) + 0.6, (count, 3))
    known = cells_distance(occupied, points)
    band = signed_distance(mesh, spacing)
    found, _ = band.at(points @ turn.T)
    clear = np.abs(known) > 0.5 * spacing
    assert np.array_equal(found[clear] < 0, known[clear] < 0)
    assert np.abs(found - np.clip(known, -band.band, band.band)).max() < 0.6 * spacing
    return mesh


@pytest.mark.parametrize("seed, turn", list(enumerate((UPRIGHT, TURN, TURN, UPRIGHT))))
def test_boxes_whose_faces_lie_in_one_plane_are_their_union(seed, turn):
    """Boxes with whole corners touch, overlap and share faces and edges; some are divided more finely."""
    random = np.random.default_rng(seed)
    occupied, parts = np.zeros((4, 4, 4), bool), []
    for k in range(4):
        low = random.integers(0, 3, 3)
        high = np.minimum(4, low + random.integers(1, 4, 3))
        occupied[tuple(map(slice, low, high))] = True
        part = trimesh.creation.box(bounds=[low, high])
        parts.append(part.subdivide() if k == 3 else part)
    both = trimesh.util.concatenate(parts)
    assert_union(np.array(both.vertices), np.array(both.faces), occupied, turn)


@pytest.mark.parametrize("noise", [1e-9, 1e-6, 2e-5])
def test_corners_that_differ_by_rounding_make_the_same_union(noise):
    """Two bricks side by side, half a face in contact, all triangles apart, corners moved: joined, with a note."""
    occupied = np.zeros((2, 3, 1), bool)
    occupied[0, :2], occupied[1, 1:] = True, True
    vertices, faces = soup(*bricks([[0, 0, 0], [1, 2, 1]], [[1, 1, 0], [2, 3, 1]]))
    vertices = vertices + np.random.default_rng(2).normal(size=vertices.shape) * noise
    mesh = assert_union(vertices, faces, occupied, TURN, rounding=20 * noise + 1e-9)
    assert mesh.notes[0].startswith("assumed of the mesh: 72 corners of open edges joined, which lay up to ")


def gaps(part):
    """A ball whose triangles are drawn towards their middles by a share of their size."""
    corners = np.asarray(BALL.vertices)[BALL.faces]
    drawn = corners + (corners.mean(1, keepdims=True) - corners) * part
    return drawn.reshape(-1, 3), np.arange(3 * len(drawn)).reshape(-1, 3)


@pytest.mark.parametrize("part", [1e-10, 1e-8, 1e-6, 1e-4, 2e-3])
def test_triangles_with_gaps_are_joined(part):
    mesh = surface_mesh(*gaps(part))
    assert (mesh.volume, len(mesh.vertices)) == (pytest.approx(BALL.volume, rel=1e-9 + part), len(BALL.vertices))
    distance, _ = signed_distance(mesh, 0.1).at(np.array([[0.0, 0, 0], [0, 0, 0.8], [0, 0, 1.2]]))
    assert distance == pytest.approx([-0.3, -0.2, 0.2], abs=0.01)


def test_bodies_of_a_millimetre_stay_apart_as_those_of_a_metre_do():
    """What counts as meeting is a share of the size."""
    corners, faces = np.asarray(BALL.vertices), np.asarray(BALL.faces)
    two = 1e-3 * np.concatenate([corners, corners + [2.005, 0.0, 0.0]])
    assert surface_mesh(two, np.concatenate([faces, faces + len(corners)])).notes == ()


def test_faces_of_two_boxes_that_single_precision_parts_lie_in_one_plane():
    """One stands on the other, turned, a thousand sizes from the file's origin."""
    two = np.concatenate([BOX.vertices, 0.5 * BOX.vertices + [0.75, 0.1, 0.05]]) @ TURN.T + 1000.0
    faces = np.concatenate([BOX.faces, BOX.faces + 8])
    assert len(surface_mesh(two.astype(np.float32), faces).faces) == len(surface_mesh(two - 1000, faces).faces)


def quad(a, b, c, d):
    return [[a, b, c], [a, c, d]]


def wall_with_a_hole(kind):
    """(vertices, faces) of a wall 3 m x 0.2 m x 3 m with a hole of 1 m x 1 m, whose triangles overlap in two planes."""
    outer, hole = [(0, 0), (3, 0), (3, 3), (0, 3)], [(1, 1), (2, 1), (2, 2), (1, 2)]
    strips = [(0, 0, 1, 3), (2, 0, 3, 3), (0, 0, 3, 1), (0, 2, 3, 3)]
    if kind == "boxes":
        return bricks(*([[x, 0, z], [u, 0.2, w]] for x, z, u, w in strips))
    if kind == "boxes_side_by_side":
        return bricks(*([[x, 0, z], [u, 0.2, w]] for x, z, u, w in [*strips[:2], (1, 0, 2, 1), (1, 2, 2, 3)]))
    if kind in ("fan", "doorway"):  # a polygon, for the wall around the hole, and a fan that leaves the polygon
        ring = [*outer, outer[0], hole[0], *hole[:0:-1], hole[0]]
        if kind == "doorway":  # open at the bottom, so that no edge has four triangles
            ring = [(0, 0), (1, 0), (1, 2), (2, 2), (2, 0), (3, 0), (3, 3), (0, 3)]
        n = len(ring)
        front = [(0, k, k + 1) for k in range(1, n - 1)]
        back = [(n, n + k + 1, n + k) for k in range(1, n - 1)]
        sides = [f for k in range(n) for f in ((k, n + k, (k + 1) % n), ((k + 1) % n, n + k, n + (k + 1) % n))]
        return np.array([(x, y, z) for y in (0, 0.2) for x, z in ring], float), np.array(front + back + sides)
    triangles = []  # sheets: the panels of both planes overlap at the corners, and end there
    for x, z, u, w in strips:
        triangles += quad((x, 0, z), (u, 0, z), (u, 0, w), (x, 0, w))
        triangles += quad((x, 0.2, z), (x, 0.2, w), (u, 0.2, w), (u, 0.2, z))
    for ring, way in ((outer, -1), (hole, 1)):
        for (x, z), (u, w) in zip(ring, [*ring[1:], ring[0]]):
            triangles += quad(*[(x, 0, z), (u, 0, w), (u, 0.2, w), (x, 0.2, z)][::way])
    return soup(np.array(triangles, float).reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))


def wall_distance(points, kind):
    """Signed distance [m] of points (n, 3) from the wall with a hole; inside only the sign is exact at corners."""

    def box(low, high):
        over = np.maximum(low - points, points - high)
        return np.linalg.norm(np.maximum(over, 0), axis=1) + np.minimum(over.max(1), 0)

    parts = [box(np.array([x, 0, z]), np.array([u, 0.2, w])) for x, z, u, w in
             [(0, 0, 1, 3), (2, 0, 3, 3), (0, 2, 3, 3), (0, 0, 3 if kind != "doorway" else 1, 1)]]  # fmt: skip
    return np.min(parts, axis=0)


@pytest.mark.parametrize("kind", ["boxes", "boxes_side_by_side", "fan", "doorway", "sheets"])
def test_a_wall_with_a_hole_is_open_in_the_hole_only(kind):
    mesh = surface_mesh(*wall_with_a_hole(kind))
    cut = 1 if kind != "doorway" else 2
    assert (mesh.volume, mesh.area) == (pytest.approx(0.2 * (9 - cut)), pytest.approx(2 * (9 - cut) + 16 * 0.2))
    assert "inside is where the winding number exceeds 1/2" in "".join(mesh.notes)
    place = np.random.default_rng(4).uniform(-0.4, 0.6 + np.array([2.8, 0.0, 2.8]), (4000, 3))
    known = wall_distance(place, kind)
    for backend in ("cpu", "numpy"):
        band = signed_distance(mesh, 0.05 if backend == "cpu" else 0.15, backend=backend)
        found, _ = band.at(place)
        clear = np.abs(known) > 0.5 * band.spacing
        assert np.array_equal((found < 0)[clear], (known < 0)[clear])
        outside = known > 0
        assert np.abs(found - np.minimum(known, band.band))[outside].max() < 0.6 * band.spacing
    made = sample(mesh, 0.05, seed=2)
    assert np.abs(wall_distance(made.position, kind)).max() < 1e-5
    assert len(made.position) == pytest.approx(made.expected, abs=1)


def test_triangles_that_cut_each_other_without_end_are_refused(monkeypatch):
    """Crumpled or flattened, some hundred triangles make millions of pieces, which takes minutes."""
    assert surface_mesh(*wall_with_a_hole("sheets")).notes
    monkeypatch.setattr(overlaps, "PIECES", 10)
    monkeypatch.setattr(overlaps, "PIECES_EACH", 0)
    with pytest.raises(InputError, match="cut each other into more than 10 pieces; unite its bodies"):
        surface_mesh(*wall_with_a_hole("sheets"))


PLY = rows(__file__, "ply")


@pytest.mark.parametrize("texture", ["none.png", "broken.png", "."])
def test_a_texture_is_not_looked_for(tmp_path, texture, caplog, capfd):
    (tmp_path / "broken.png").write_bytes(b"no picture")
    (tmp_path / "a.ply").write_text(PLY.format(texture=texture))
    assert load_mesh(tmp_path / "a.ply").volume == pytest.approx(1 / 6)
    (tmp_path / "a.obj").write_text(BOX.export(file_type="obj") + f"\nmtllib none.mtl\nusemtl {texture}\n")
    assert load_mesh(tmp_path / "a.obj").volume == pytest.approx(1.0)
    assert not caplog.text
    assert capfd.readouterr() == ("", "")


def test_comments_in_latin_1_and_bytes_after_the_last_triangle_are_taken(tmp_path):
    """Also an STL whose head begins with solid; one that is cut off, and text in UTF-16, are refused for that."""
    remark = "würfel, größe 1 m".encode("latin-1")
    stl, text = BOX.export(file_type="stl"), BOX.export(file_type="stl_ascii").encode()
    obj, off = BOX.export(file_type="obj").encode(), BOX.export(file_type="off").encode()
    ply = [BOX.export(file_type="ply", encoding=how).split(b"\n", 2) for how in ("ascii", "binary")]
    files = {
        "a.obj": b"# " + remark + b"\no " + remark + b"\n" + obj, "b.off": b"# " + remark + b"\n" + off,
        "c.stl": stl + b"\0more", "d.stl": b"solid " + remark + stl[6 + len(remark) :] + b"\0\0",
        "e.stl": text.replace(b"solid", b"solid " + remark, 1),
        **{f"{k}.ply": b"\n".join([*rows[:2], b"comment " + remark, rows[2]]) for k, rows in enumerate(ply)},
    }  # fmt: skip
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
        assert load_mesh(tmp_path / name).volume == pytest.approx(1.0), name
    for name, data, words in (
        ("cut.stl", stl[:-60], "is cut off: it counts 12 triangles and holds 10"), ("head.stl", stl[:50], "is cut off"),
        ("wide.obj", obj.decode().encode("utf-16"), "neither binary nor text of one byte a letter"),
    ):  # fmt: skip
        (tmp_path / name).write_bytes(data)
        with pytest.raises(InputError, match=words):
            load_mesh(tmp_path / name)


WINDS = rows(__file__, "winds")


def test_faces_are_wound_alike_without_packages_that_nothing_requires():
    """One face, three, all or six of a box, alone and beside a whole one, where networkx cannot be imported."""
    python("-c", WINDS, seconds=120)


def test_a_campaign_of_damaged_meshes_tells_what_went_wrong(monkeypatch, capsys):
    """The least of it; a reader that raises, refuses a whole body or takes another volume is found."""
    assert damaged_meshes.campaign(12, seed=1) == 0
    assert "12 meshes, seed 1:" in capsys.readouterr().out
    drawn = [damaged_meshes.drawn(random.Random(f"1 {k}")) for k in range(12)]
    kept = next(k for k, (_, _, _, volume) in enumerate(drawn) if volume is not None)
    ball = surface_mesh(BALL.vertices * 9, BALL.faces)
    for answer, words in (
        (lambda path: 1 / 0, "ZeroDivisionError"), (lambda path: ball, "and the body has"),
        (lambda path: load_mesh("none.stl"), "the whole body is refused"),
    ):  # fmt: skip
        monkeypatch.setattr(damaged_meshes, "load_mesh", answer)
        assert damaged_meshes.campaign(12, seed=1, only=kept) == 1
        assert words in capsys.readouterr().out
