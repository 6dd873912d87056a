"""`literal`: readings of a source by number, its own choices by "paper", every printed text by "all"."""

import json

import msgspec
import numpy as np
import pytest

import refsim as rs
from refsim.__main__ import main
from refsim.boundary.mesh import surface_mesh
from refsim.boundary.sampling import sample
from refsim.core.capabilities import HasErrata
from refsim.scene.files import load_scene
from tests import pairs
from tests.running import rows

REQUIRED = {
    type(effect): {f.name: getattr(effect, f.name) for f in msgspec.structs.fields(effect) if f.required}
    for effect in pairs.EFFECTS.values()
    if isinstance(effect, HasErrata)
}
with_errata = pytest.mark.parametrize("effect", REQUIRED, ids=lambda effect: effect.name)


@with_errata
def test_paper_takes_improvements_and_parameters_and_leaves_misprints_corrected(effect):
    made = effect(**REQUIRED[effect], literal="paper")
    assert made == effect(**REQUIRED[effect], literal=("paper",))
    assert made.printed() == set(effect.improvements) <= set(effect.errata)
    plain = effect(**REQUIRED[effect])
    changed = {name for name in effect.__struct_fields__ if getattr(made, name) != getattr(plain, name)}
    assert changed == {"literal", *effect.paper}
    assert all(getattr(made, name) == value for name, value in effect.paper.items())
    assert plain.printed() == frozenset()
    assert effect(**REQUIRED[effect], literal="all").printed() == set(effect.errata)
    again = effect(**REQUIRED[effect], **effect.paper, literal=["paper"])  # what a stored scene says
    assert again == msgspec.structs.replace(made, literal="paper") == made


@pytest.mark.parametrize("make, words", [
    (lambda: rs.SurfaceDetection(literal="Paper").printed(), "literal has Paper; only E5, E6, E10, E23, paper or all"),
    (lambda: rs.ShapeMatching(literal=("M25",)).printed(), "shape_matching: literal has M25; only paper or all can"),
    (lambda: rs.SurfaceDetection(literal=3), "literal = 3 is a whole number; give text or a tuple or a list"),
    (lambda: rs.SurfaceDetection(literal=("paper", 3)), r"literal\[1\] = 3 is a whole number; give text"),
    (lambda: rs.JiangZhu2023(gamma=1.0, literal="paper", pair_mode="both"),
     "jiang_zhu_2023: literal 'paper' sets pair_mode = 'either', but pair_mode = 'both' is given; leave one of"),
    (lambda: rs.HeatConduction(literal=("M5", "paper"), scheme="explicit"), "sets scheme = 'one_sided', but scheme ="),
    (lambda: sample(TETRAHEDRON, 0.1, literal=("papers",)), "sampling: literal has papers; only E24, E25, paper or"),
])  # fmt: skip
def test_wrong_words_get_one_sentence(make, words):
    with pytest.raises(rs.InputError, match=words):
        make()


TETRAHEDRON = surface_mesh(
    np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]), np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
)


SCENE = rows(__file__, "paper")


def test_a_scene_file_takes_a_word_or_a_list_and_plan_and_list_show_it(tmp_path, capsys):
    file = tmp_path / "scene.toml"
    file.write_text(SCENE.format(literal='["paper", "E4"]'))
    assert (load_scene(file).effects[2].literal, main(["plan", str(file), "--json"])) == (("paper", "E4"), 0)
    effects = json.loads(capsys.readouterr().out)["effects"]
    taken = {"source": "Jiang & Zhu", "printed": ["E24"], "parameters": {"clamp_pressure": False}}
    assert effects["weakly_compressible"]["literal"] == taken
    assert effects["jiang_zhu_2023"]["literal"]["printed"] == ["E4", "E6", "E7", "E23"]
    assert effects["jiang_zhu_2023"]["literal"]["parameters"] == {"pair_mode": "either", "balance_pressure": False}
    assert main(["plan", str(file)]) == 0
    words = "As in Jiang & Zhu: jiang_zhu_2023 with E4, E6, E7, E23, pair_mode = 'either', balance_pressure = False"
    assert words in capsys.readouterr().out
    assert main(["list", "jiang_zhu_2023"]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert 'literal = "paper" takes of Jiang & Zhu: E6, E7, E23, pair_mode = "either", balance_pressure = false' in told
    file.write_text(SCENE.format(literal='"papers"'))
    assert main(["plan", str(file)]) == 2
    assert "jiang_zhu_2023: literal has papers; only E4, E5, E6, E7, E10, E23, paper or all" in capsys.readouterr().err
