"""Damaged meshes, drawn by a seed: is each taken with its body's volume, or refused in one sentence?

`python tests/boundary/damaged_meshes.py --count 5000` needs no package but those that refsim requires. Bodies are
drawn, damaged as geometry, written in a format, and damaged as bytes. Prints what went wrong with the trial's number,
which `--only NUMBER` repeats; exit code 4 if there is any.
"""

import argparse
import collections
import contextlib
import io
import pathlib
import random
import re
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable

import numpy as np
import trimesh

from refsim.core.errors import InputError
from refsim.scene.surface_mesh import load_mesh

LONGEST = 30.0  # s that one mesh may take
FORMATS = ("stl", "stl_ascii", "obj", "ply", "off")
Triangles = tuple[np.ndarray, np.ndarray]
Damage = Callable[[random.Random, np.ndarray, np.ndarray], Triangles]


def body(draw: random.Random) -> Triangles:
    """A closed body near the origin, in a few hundred triangles, turned."""
    made = draw.choice([
        lambda: trimesh.creation.box((1.0, draw.uniform(0.1, 2.0), 1.0)),
        lambda: trimesh.creation.icosphere(draw.choice((1, 2))),
        lambda: trimesh.creation.cylinder(0.5, draw.uniform(0.1, 3.0), sections=draw.choice((3, 12, 24))),
        lambda: trimesh.creation.torus(1.0, draw.uniform(0.1, 0.6), 12, 8),
        lambda: trimesh.creation.box((1.0, 1.0, 1.0)).subdivide(),
    ])()  # fmt: skip
    turn = trimesh.transformations.rotation_matrix(draw.uniform(0, 6), [draw.uniform(-1, 1) for _ in range(3)])
    return np.asarray(made.vertices) @ turn[:3, :3].T + draw.uniform(-2, 2), np.array(made.faces)


def some(draw: random.Random, count: int, most: int = 6) -> list[int]:
    return draw.sample(range(count), draw.randint(1, min(most, count)))


def moved(draw: random.Random, v: np.ndarray, f: np.ndarray) -> Triangles:
    """Corners elsewhere: triangles cross."""
    chosen = some(draw, len(v))
    v[chosen] += np.random.default_rng(draw.randrange(2**32)).normal(size=(len(chosen), 3)) * 10 ** draw.uniform(-7, 1)
    return v, f


def disordered(draw: random.Random, v: np.ndarray, f: np.ndarray) -> Triangles:
    """Triangles, their corners and the vertices in another order, with vertices that no triangle has."""
    place = np.array(draw.sample(range(len(v) + 3), len(v)))
    other = np.full((len(v) + 3, 3), v.mean(0))
    other[place] = v
    return other, np.roll(place[f][draw.sample(range(len(f)), len(f))], draw.randrange(3), axis=1)


def put(array: np.ndarray, value: object, place: object) -> np.ndarray:
    array[place] = value
    return array


def confused(draw: random.Random, v: np.ndarray, f: np.ndarray) -> Triangles:
    """Triangles between any corners."""
    for k in some(draw, len(f), len(f)):
        f[k, draw.randrange(3)] = draw.randrange(len(v))
    return v, f


def crossed(draw: random.Random, v: np.ndarray, f: np.ndarray) -> Triangles:
    """With another body, which may lie across."""
    w, g = body(draw)
    return np.concatenate([v, w]), np.concatenate([f, g + len(v)])


HARMLESS: dict[str, Damage] = {  # the body keeps its volume
    "turned": lambda d, v, f: (v, put(f, f[c := some(d, len(f), len(f) // 3)][:, ::-1], c)),
    "inside_out": lambda d, v, f: (v, f[:, ::-1]),
    "apart": lambda d, v, f: (v[f].reshape(-1, 3), np.arange(f.size).reshape(-1, 3)),
    "doubled": lambda d, v, f: (v, np.concatenate([f, f[some(d, len(f))]])),
    "disordered": disordered,
    "flat": lambda d, v, f: (v, np.concatenate([f, [[a, b, d.choice((a, b))] for a, b, _ in f[some(d, len(f))]]])),
}
DAMAGES: dict[str, Damage] = HARMLESS | {
    "hole": lambda d, v, f: (v, np.delete(f, some(d, len(f)), axis=0)), "moved": moved,
    "not_finite": lambda d, v, f: (
        put(v, d.choice((np.nan, np.inf, 1e38, -1e300, 1e-320)), (d.randrange(len(v)), d.randrange(3))), f,
    ),
    "scaled": lambda d, v, f: (v * 10 ** d.uniform(-30, 30) + 10 ** d.uniform(-20, 20), f),
    "flattened": lambda d, v, f: (put(v, v[:, k := d.randrange(3)] * d.choice((0.0, 1e-9, 1e-4)), (slice(None), k)), f),
    "confused": confused,
    "pinched": lambda d, v, f: (v, np.where(f == (pair := d.sample(range(len(v)), 2))[1], pair[0], f)),
    "crossed": crossed,
}  # fmt: skip


def spoiled(draw: random.Random, data: bytes) -> bytes:
    """The file's bytes with a damage: changed, cut, given twice or with others between."""
    place = draw.randrange(len(data) + 1)
    length = 1 + int(300 * draw.random() ** 3)
    between = draw.choice((b"", bytes(length), draw.randbytes(length), b"nan ", b"-1 ", b"1e999", b"\n", b"\xff\xfe"))
    after = draw.choice((data[place + length :], data[place + len(between) :], data[place:], b"", data))
    return data[:place] + between + after


def drawn(draw: random.Random) -> tuple[str, str, bytes, float | None]:
    """(what was done, suffix, the file's bytes, volume [m^3] that the body has to keep)."""
    vertices, faces = body(draw)
    volume = float(np.linalg.det(vertices[faces] - vertices[0]).sum() / 6)
    damages = draw.choices([*(HARMLESS if draw.random() < 0.3 else DAMAGES)], k=draw.choice((0, 1, 1, 2, 3)))
    with np.errstate(all="ignore"):
        for damage in damages:
            vertices, faces = DAMAGES[damage](draw, vertices.copy(), faces.copy())
        kind = draw.choice(FORMATS)
        made = trimesh.Trimesh(vertices, faces, process=False, validate=False).export(file_type=kind)
    data, spoils = made.encode() if isinstance(made, str) else made, draw.choice((0, 0, 1, 2))
    for _ in range(spoils):
        data = spoiled(draw, data)
    words = [*damages, *["spoiled"] * spoils]
    kept = not spoils and set(damages) <= HARMLESS.keys()
    return f"{kind}: {', '.join(words) or 'whole'}", kind.partition("_")[0], data, volume if kept else None


def outcome(suffix: str, data: bytes, volume: float | None, folder: pathlib.Path) -> str:
    """ "taken" or "refused"; AssertionError for an answer that is neither."""
    path = folder / f"mesh.{suffix}"
    path.write_bytes(data)
    began, said, mesh, refusal = time.process_time(), io.StringIO(), None, ""
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said), warnings.catch_warnings():
            warnings.simplefilter("error")
            mesh = load_mesh(path)
    except InputError as error:
        refusal = str(error)
    took = time.process_time() - began
    assert took < LONGEST, f"{took:.0f} s"
    assert not said.getvalue(), f"printed: {said.getvalue()[:300]}"
    if mesh is None:
        assert volume is None, f"the whole body is refused: {refusal}"
        assert re.fullmatch("[^\n]+; [^\n]+", refusal), f"not one sentence of what to do: {refusal}"
        return "refused"
    assert np.isfinite(mesh.corners).all(), "taken with corners that are not finite"
    assert 0 < mesh.volume < np.inf, f"taken with a volume of {mesh.volume}"
    if volume is not None:
        assert abs(mesh.volume - volume) <= 1e-5 * volume, f"volume {mesh.volume}, and the body has {volume}"
    return "taken"


def campaign(count: int, seed: int, only: int | None = None) -> int:
    """Trials, what they came to, and what went wrong; how many did."""
    outcomes: collections.Counter[str] = collections.Counter()
    wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        for number in range(count) if only is None else [only]:
            words, *mesh = drawn(random.Random(f"{seed} {number}"))
            try:
                outcomes[outcome(*mesh, pathlib.Path(folder))] += 1
            except Exception as error:  # any that a mesh raises is a finding
                wrong += 1
                at = traceback.extract_tb(error.__traceback__)[-1]
                print(f"{number}, {words}: {type(error).__name__}: {error} [{at.name}]", flush=True)
    total = outcomes.total() + wrong
    told = "".join(f" {n} {k}," for k, n in sorted(outcomes.items()))
    print(f"{total} meshes, seed {seed}:{told} {wrong} wrong", flush=True)
    return wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int, help="number of the one trial to repeat")
    given = parser.parse_args()
    return 4 if campaign(given.count, given.seed, given.only) else 0


if __name__ == "__main__":
    sys.exit(main())
