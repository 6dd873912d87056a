"""The tutorial of docs/first_scene.md: after each edit the scene is planned, and the last one runs and is drawn."""

import pathlib
import re

from refsim.__main__ import main

PAGE = (pathlib.Path(__file__).parents[2] / "docs" / "first_scene.md").read_text(encoding="utf-8")


def test_each_edit_is_planned_and_the_scene_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    scene = pathlib.Path("pool.toml")
    scene.touch()
    codes = [main(["plan", "pool.toml"])]
    assert "'spacing'" in capsys.readouterr().err  # the first key that a scene must have
    for kind, text in re.findall(r"^```(toml|text)\n(.*?)^```$", PAGE, re.M | re.S):
        if kind == "text":
            pathlib.Path("column.obj").write_text(text)
            continue
        with scene.open("a") as file:
            file.write(f"{text}\n")
        codes.append(main(["plan", "pool.toml"]))
    assert codes == [2, 0, 0, 0, 0, 0, 0, 0]
    said = capsys.readouterr().out
    assert "640 particles" in said
    assert "Note: weakly_compressible: a flow" not in said
    assert main(["run", "pool.toml", "--backend", "numpy", "--until", "1e-3", "--every", "1e-3", "--quiet"]) == 0
    assert capsys.readouterr().out.endswith("next: refsim view pool_run\n")
    assert main(["render", "pool_run", "--gauges"]) == 0
    assert pathlib.Path("pool_run_gauges.png").stat().st_size > 5000
    assert main(["view", "pool_run", "--html", "pool.html"]) == 0
