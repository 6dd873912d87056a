"""The droplet of Jiang & Zhu: the paper's own reading stands beside the default, under its own label."""

import numpy as np

from validation.experiment import Options
from validation.experiments.droplet import pictures
from validation.experiments.droplet.runs import EXPERIMENT as DROPLET
from validation.experiments.timing import pictures as timing_pictures
from validation.experiments.timing import runs as timing
from validation.metrics.shapes import lattice_cube
from validation.results import Result


def test_table_1_has_the_papers_reading_as_a_row():
    """Force on surface particles only, which the paper's words say, and its text's surface set."""
    variants = {run.key: run.parameters.get("variant") for run in timing.EXPERIMENT.runs(Options())}
    assert variants["steady_default"] == "default"
    assert variants["steady_one_sided"] == "one_sided"
    ended = {"wall": 2.0, "steps": 9, "stages": {"sph.momentum": 1.0}, "time": 1.0}
    values = {"steady": ended, "stopped": "", "seconds": 2.0, "particles": 5039}
    about = {"machine": {"processor": "one", "cores": 1}, "date": "2026-11-23"}
    found = {key: Result(values, about=about) for key in ("steady_default", "steady_text", "steady_one_sided")}
    labels = {bar["label"] for bar in timing_pictures.steady_data(found)["bars"]}
    assert any("force on surface particles only" in " ".join(label.split()) for label in labels)
    assert len(labels) == 3


def test_figure_6_has_the_papers_reading_as_a_row():
    position = np.array([lattice_cube(3, 1 / 3)] * 8)
    series = {"time": list(range(8)), "cubic_moment": [-0.1] * 8, "radius_variation": [0.1] * 8}
    values = {"series": series, "radius": 0.6, "spacing": 1 / 3, "particles": 27, "capillary_time": 0.5}
    keys = ("cube_4913", "mode_text", "mode_one_sided")
    assert set(keys) <= {run.key for run in DROPLET.runs(Options())}
    rows = pictures.frame_data({key: Result(values, {"position": position}) for key in keys})["rows"]
    assert [row["start"] for row in rows] == ["cube", *pictures.SURFACE_ONLY.values()]
