"""Pictures and films: surfaces around particles, cameras and cuts, what is seen in 2D and 3D, and the commands."""

import importlib.util
import re
import sys
from contextlib import closing
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from PIL import Image

import refsim as rs
from refsim import Box, BoxWalls, Gravity, InputError, Scene, Simulation, WeaklyCompressible, simulate
from refsim.__main__ import main
from refsim.io.frames import Frame, ParticleWriter, origin_of
from refsim.render.looks import Camera, liquid_colour, melt_colour, solid_colour
from refsim.render.pictures import Look, Series, moving, write_film, write_pictures
from refsim.render.plane import loops
from refsim.render.saved_run import SavedRun, chosen_frames, open_run
from refsim.render.space import Body, Stage
from refsim.render.surfaces import surface_around
from tests.running import answer_of, python, rows

SMALL = (320, 240)


def missing(name):
    return pytest.mark.skipif(importlib.util.find_spec(name) is None, reason=f"{name} (extra [view]) is not installed")


needs_pyvista, needs_ffmpeg = missing("pyvista"), missing("imageio_ffmpeg")


def lattice(counts, spacing=1.0):
    axes = [(np.arange(n) + 0.5) * spacing for n in counts]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(counts))


def volume(mesh):
    corners = np.asarray(mesh.vertices, dtype=float)[mesh.facets]
    return np.einsum("tc,tc->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6


def is_closed(facets):
    edges = np.concatenate([facets[:, [0, 1]], facets[:, [1, 2]], facets[:, [2, 0]]])
    return {tuple(e) for e in edges.tolist()} == {(b, a) for a, b in edges.tolist()}


def test_a_run_far_away_is_drawn_as_at_the_origin(tmp_path):
    """Also where a cut is: at a place in the scene."""
    pictures = []
    for far in (0.0, 1e4):
        block = Box(lower=(far + 0.02, 0.01, 0.0), cells=(9, 6, 1))
        walls = BoxWalls(lower=(far, 0.0, 0.0), upper=(far + 0.2, 0.1, 0.0))
        liquid = WeaklyCompressible(sound_speed=10.0, dynamic_viscosity=2.0, density="summation")
        scene = Scene(dim=2, spacing=0.01, support_radius=0.026, fluid=(block,), effects=(liquid, walls))
        simulate(scene, until=1e-3, output=tmp_path / f"{far}", backend="numpy")
        look = Look(size=SMALL, cut=f"x={far + 0.065}")
        pictures.append(Image.open(write_pictures(tmp_path / f"{far}", look, None, tmp_path / f"{far}.png")[0]))
    near, away = (np.asarray(picture.convert("RGB")).astype(int) for picture in pictures)
    assert np.ptp(near) > 100
    assert (near != away).mean() < 1e-3


# Surfaces
@pytest.mark.parametrize("there", [pytest.param(True, marks=needs_pyvista), False])
def test_the_surface_of_a_ball_encloses_its_volume(there, monkeypatch):
    """Also without PyVista, which the main job does not need."""
    if not there:
        find = importlib.util.find_spec
        monkeypatch.setattr(importlib.util, "find_spec", lambda name: find(name) if name != "pyvista" else None)
        monkeypatch.setitem(surface_around.__globals__, "pyvista", None)
    x = lattice((24, 24, 24)) - 12
    ball = x[(x**2).sum(1) < 100]
    mesh = surface_around(1e-3 * ball, 1e-3)
    radius = 1e3 * np.linalg.norm(mesh.vertices, axis=1)
    assert is_closed(mesh.facets)
    assert volume(mesh) == pytest.approx(1e-9 * len(ball), rel=0.04)
    assert radius.std() < 0.2


def test_the_surface_reaches_to_a_solid_and_is_flat_up_to_walls():
    x = lattice((10, 10, 6)) + [0.0, 0.0, 0.4]  # the lowest particles are 0.9 off the plane z = 0
    mesh = surface_around(x, 1.0, solid=lambda points: points[:, 2])
    low = mesh.vertices[(np.abs(mesh.vertices[:, :2] - 5) < 3).all(1) & (mesh.vertices[:, 2] < 3)]
    assert np.abs(low[:, 2]).max() < 0.12
    assert surface_around(x, 1.0).vertices[:, 2].min() > 0.2
    off = [surface_around(x + [0.0, 0.0, 1.2], 1.0, solid=solid).vertices for solid in (None, lambda p: p[:, 2])]
    assert np.array_equal(*off)  # of a solid 1.5 spacings away
    box = np.array([0.0, 0.0, -np.inf]), np.full(3, 10.0)
    mesh = surface_around(lattice((10, 10, 6)), 1.0, box=box)
    top = mesh.vertices[mesh.vertices[:, 2] > 4.5]
    assert np.ptp(top[(top[:, :2] > 0.2).all(1) & (top[:, :2] < 9.8).all(1), 2]) < 0.05
    assert np.ptp(mesh.vertices[:, :2], axis=0) == pytest.approx([10.1, 10.1], abs=0.2)


def test_lines_in_the_plane_close():
    x = np.zeros((144, 3))
    x[:, :2] = lattice((12, 12))
    hole = x[((x[:, :2] - 6) ** 2).sum(1) > 6]
    mesh = surface_around(hole, 1.0, dim=2)
    found = loops(mesh.facets)
    assert len(found) == 2
    assert sorted(np.concatenate(found).tolist()) == sorted(mesh.facets[:, 0].tolist())


# Runs read back
class Rows(dict):
    """Arrays of a frame that no file holds."""

    fields = property(lambda self: self)

    def sorted(self):
        return SimpleNamespace(position=self["position"][self["identity"].argsort()])


def test_quantities_have_values_and_units_and_walls_their_distance(in_plane):
    run = open_run(in_plane)
    frame = next(run.frames([3]))
    assert (run.unit("mass"), run.unit("velocity.y"), run.unit("part")) == ("kg/m", "m/s", "")
    assert [run.label(name) for name in ("velocity", "volume_ratio")] == ["speed", "volume ratio"]
    v = frame["velocity"]
    assert np.allclose(run.values(frame, "velocity"), np.linalg.norm(v, axis=1))
    assert (run.values(frame, "velocity.y") == v[:, 1]).all()
    part = run.part(frame)
    assert (np.bincount(part) == [128, 36]).all()
    assert (frame.position[part == 1, 0] > 0.2).all()
    assert (run.solid_body(frame) == -1).all()
    assert np.array_equal(run.up, [0, 1, 0])
    for wrong in ("colour", "identity", "velocity.w", "mass.x"):
        with pytest.raises(InputError):
            run.values(frame, wrong)
    distance = open_run(in_plane).wall_distance()
    found = distance(np.array([[0.1, 0.2, 0.0], [0.39, 0.2, 0.0], [0.2, -0.1, 0.0], [0.2, 9.0, 0.0]]))
    assert np.allclose(found, [0.1, 0.01, -0.1, 0.2])
    found = open_run(in_plane)
    series = Series(found, Look(colour="velocity"), range(4))
    assert series.limits[0] == 0.0
    speeds = [found.values(frame, "velocity").max() for frame in found.frames(range(4))]
    assert 0.8 * max(speeds) < series.limits[1] <= max(speeds)


def test_solids_and_their_melt_have_colours_of_their_own(tmp_path):
    effects = (WeaklyCompressible(sound_speed=20.0, density="summation"), rs.ShapeMatching())
    solid, fluid = rs.SolidBox(lower=(0, 0, 0), upper=(0.04, 0.04, 0.04)), rs.Ball(center=(0.2, 0, 0), radius=0.03)
    scene = rs.make_plan(Scene(spacing=0.01, support_radius=0.026, solid=(solid,), fluid=(fluid,), effects=effects))
    run = SavedRun(None, scene)
    count, solid = len(scene.state.position), scene.state.sizes[0]
    identity, phase = np.arange(count)[::-1], np.zeros(count, int)
    phase[-solid // 2 :] = 1
    frame = Rows(identity=identity, phase=phase)
    series = Series.__new__(Series)
    series.run, series.look = run, Look()
    colours = {tuple(c) for c in series._paint(frame)}
    assert colours == {solid_colour(0), melt_colour(0), liquid_colour(0)}
    assert (run.solid_body(frame) == 0).sum() == (phase > 0).sum()


@pytest.mark.parametrize("place", ["nowhere", "file.txt"])
def test_what_is_no_run_is_refused(tmp_path, place):
    (tmp_path / "file.txt").write_text("no run")
    with pytest.raises(InputError, match="there are no frames of"):
        open_run(tmp_path / place)


# Films
def test_frames_in_which_nothing_moves_are_left_out(in_plane, monkeypatch):
    run = open_run(in_plane)
    first, *others = run.frames(range(4))
    still = first["identity"].argsort()[::-1]  # in another order, which is no motion
    mixed = Rows(position=first.position[still], identity=first["identity"][still])
    for frames, kept in (((first, mixed, others[2], others[2]), [0, 2]), ((first, mixed, mixed, mixed), [0, 3])):
        monkeypatch.setattr(type(run), "frames", lambda *_, frames=frames: iter(frames))
        assert moving(run, range(4)) == kept


# Pictures
def picture(run, number=-1, **look):
    found = open_run(run)
    series = Series(found, Look(size=SMALL, **look), chosen_frames(str(number), len(found.files)))
    return next(iter(series))[1].astype(int)


def blue(image):
    return (image[..., 2] - image[..., 0] > 60).sum()


def differ(first, second):
    return (np.abs(first - second).max(2) > 16).sum()


def test_a_run_in_2d_is_drawn_in_every_style(in_plane):
    paper, particles = picture(in_plane, 0), picture(in_plane, 0, style="particles")
    assert paper.shape == (240, 320, 3)
    assert blue(paper) > 3000
    orange = (paper[..., 0] - paper[..., 2] > 100).sum()  # the second liquid
    assert 0.15 < orange / blue(paper) < 0.45
    assert 0.6 < blue(particles) / blue(paper) < 1.05
    coloured = picture(in_plane, 3, colour="pressure")
    assert differ(coloured, picture(in_plane, 3)) > 1000
    assert blue(picture(in_plane, 0, cut="x=0.04")) < 0.7 * blue(paper)


def strayed(folder, count):
    """A run of one frame: a block of 216 particles, and `count` of them a hundred edges away."""
    scene = Scene(spacing=0.1, support_radius=0.2, fluid=(Box(cells=(6, 6, 6)),), effects=(Gravity(),))
    simulation = Simulation(scene)
    x = simulation.field("position").astype("float32")
    x[:count] += [60.0, 0.0, 0.0]
    origin = origin_of(simulation.plan)
    with closing(ParticleWriter(folder / "particles.pvd", {"identity": (1, "int32")}, origin=origin)) as writer:
        writer.append([Frame(0.0, x, {"identity": np.arange(len(x), dtype="int32")})])
    return folder


@needs_pyvista
def test_a_stray_particle_does_not_shrink_the_liquid(tmp_path):
    pictures = []
    for count in (0, 1):
        (tmp_path / str(count)).mkdir()
        pictures.append(picture(strayed(tmp_path / str(count), count), 0))
    assert blue(pictures[1]) > 0.9 * blue(pictures[0]) > 1000
    run = open_run(tmp_path / "1")
    assert np.ptp(run.bounds([0]), axis=0)[0] > 60
    assert np.ptp(run.bounds([0], strays=False), axis=0) == pytest.approx(0.6)


@needs_pyvista
def test_a_picture_in_space_is_drawn_without_numba(tmp_path):
    """Its 116 MiB would bring a film of 7,200 particles, 1,280 x 960, above 600 MB."""
    words = ["render", str(strayed(tmp_path, 0)), "-o", str(tmp_path / "picture.png"), "--size", "320x240"]
    code = f"import sys; from refsim.__main__ import main; assert main({words}) == 0; assert 'numba' not in sys.modules"
    python("-c", code, folder=tmp_path)
    assert (tmp_path / "picture.png").is_file()


@needs_pyvista
def test_a_run_in_3d_is_drawn_in_every_style(in_space):
    paper = picture(in_space, 0)
    assert blue(paper) > 1500
    assert paper[5:40, 200:].min() > 225
    cube = ((paper.max(2) - paper.min(2) < 12) & (paper.max(2) < 205)).sum()
    assert cube > 300
    water, particles = (picture(in_space, 0, style=style) for style in ("water", "particles"))
    assert differ(paper, water) > 1500
    assert differ(paper, particles) > 1000
    last = picture(in_space, 2)
    assert differ(last, paper) > 500  # the drop has moved
    assert differ(picture(in_space, 2, colour="velocity.z", limits=(-2.0, 0.0)), last) > 1500
    cut = picture(in_space, 0, cut="y=0")
    assert differ(cut, paper) > 300
    assert differ(picture(in_space, 0, camera="30,60,1.5"), paper) > 3000


@needs_pyvista
def test_a_solid_is_seen_through_clear_water():
    """A cube inside a ball; without a background the picture is exact on white."""
    ball, cube = trimesh.creation.icosphere(subdivisions=3, radius=0.8), trimesh.creation.box((0.5, 0.5, 0.5))
    water = Body(ball.vertices, ball.faces, (0.16, 0.47, 0.78), water=True)
    solid = Body(cube.vertices, cube.faces, (0.82, 0.42, 0.18))
    corner = np.ones(3)
    stage = Stage(-corner, corner, np.array([0.0, 0.0, 1.0]), Camera(), (64, 64), half_height=1.0)
    alone, around = (stage.draw(bodies)[32, 32].astype(int) for bodies in ([water], [water, solid]))
    assert alone[2] - alone[0] > 50
    assert around[0] - around[2] > 50 + alone[0] - alone[2]
    clear, on_white = stage.draw_clear([water, solid]), stage.draw([water, solid]) / 255.0
    assert clear[..., :3] * clear[..., 3:] + 1.0 - clear[..., 3:] == pytest.approx(on_white, abs=0.01)
    assert clear[32, 32, 3] == 1.0
    assert 0.2 < clear[12, 32, 3] < 0.8


@needs_pyvista
@pytest.mark.parametrize("edges", [False, True])
def test_the_near_one_of_two_clear_drops_is_drawn_over_the_far_one(edges):
    """In whatever order their facets are given."""
    ball, towards = trimesh.creation.icosphere(subdivisions=2, radius=0.3), Camera().axes(np.array([0.0, 0.0, 1.0]))[2]
    points = np.concatenate([ball.vertices + 0.5 * towards, ball.vertices - 0.5 * towards])
    colours = np.repeat([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]], len(ball.vertices), 0)
    facets, corner = np.concatenate([ball.faces, ball.faces + len(ball.vertices)]), np.ones(3)
    stage = Stage(-corner, corner, np.array([0.0, 0.0, 1.0]), Camera(), (64, 64), half_height=1.0)
    one, other = (
        stage.draw([Body(points, order, colours, water=True, gloss=0.0, edges=edges)]).astype(int)
        for order in (facets, facets[::-1])
    )
    assert np.abs(one - other).max() <= 2
    assert one[32, 32, 2] > one[32, 32, 0] + 30  # white behind both, the near one blue


# Files and commands
def test_the_command_writes_pictures(in_plane, tmp_path, capsys):
    words = ["render", str(in_plane), "--frames", "0,2", "--size", "320x240", "-o", str(tmp_path / "dam.webp")]
    out = answer_of(capsys, words).out
    for name in ("dam_0000.webp", "dam_0002.webp"):
        assert name in out
        with Image.open(tmp_path / name) as written:
            assert written.size == SMALL
    assert sorted(path.name for path in tmp_path.iterdir()) == ["dam_0000.webp", "dam_0002.webp"]


@needs_ffmpeg
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # imageio-ffmpeg leaves its pipes open
def test_the_command_writes_a_film(in_plane, tmp_path, capsys):
    import imageio_ffmpeg

    film = tmp_path / "dam.mp4"
    assert main(["render", str(in_plane), "--film", str(film), "--size", "321x240", "--per-second", "4"]) == 0
    frames = imageio_ffmpeg.read_frames(str(film))
    facts = next(frames)
    pictures = list(frames)
    assert (facts["size"], facts["fps"]) == ((320, 240), 4)
    assert len(pictures) == len(open_run(in_plane).files)
    assert pictures[0] != pictures[-1]


@pytest.mark.parametrize("words, answer", rows(__file__, "wrong_words"))
def test_wrong_words_are_answered_in_a_sentence(in_plane, tmp_path, monkeypatch, capsys, words, answer):
    monkeypatch.chdir(tmp_path)
    err = answer_of(capsys, ["render", str(in_plane), *words], 2).err
    assert answer in err
    assert len(re.findall(r"\n", err)) == 1
    assert not list(tmp_path.iterdir())


def test_an_absent_extra_is_named_in_a_sentence(in_space, in_plane, tmp_path, monkeypatch, capsys):
    for name in ("pyvista", "imageio_ffmpeg"):
        monkeypatch.setitem(sys.modules, name, None)
    cases = [
        (
            in_space, ["--style", "particles", "-o", str(tmp_path / "a.png")],
            "needs the package pyvista, which is not installed",
        ),
        (in_plane, ["--film", str(tmp_path / "a.mp4")], "imageio-ffmpeg, which is not installed"),
    ]  # fmt: skip
    for run, words, answer in cases:
        err = answer_of(capsys, ["render", str(run), *words], 2).err
        assert answer in err
        assert "view" in err
    with pytest.raises(InputError, match="films need"):
        write_film(in_space, Look(), output=tmp_path / "a.mp4")
    assert not list(tmp_path.iterdir())
