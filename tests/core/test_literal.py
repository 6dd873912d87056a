"""`literal`: readings of a source by number, its own choices by "paper", every printed text by "all"."""

import json

import msgspec
import pytest

from refsim.__main__ import main
from refsim.core.capabilities import HasErrata
from refsim.scene.files import load_scene
from tests import pairs
from tests.running import answer_of, rows

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
    told = " ".join(answer_of(capsys, ["list", "jiang_zhu_2023"]).out.split())
    assert 'literal = "paper" takes of Jiang & Zhu: E6, E7, E23, pair_mode = "either", balance_pressure = false' in told
    file.write_text(SCENE.format(literal='"papers"'))
    assert main(["plan", str(file)]) == 2
    assert "jiang_zhu_2023: literal has papers; only E4, E5, E6, E7, E10, E23, paper or all" in capsys.readouterr().err
