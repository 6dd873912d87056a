"""The case that sets the models side by side: every model runs through it, pictures and tables come from results."""

import numpy as np
import pytest

from validation.experiment import discover
from validation.experiments.models import pictures, runs
from validation.perform import write_data
from validation.running import Context


@pytest.fixture(scope="module")
def small():
    """Small cubes under two models, one of which holds together."""
    return {f"cube_{name}": runs.relax(Context(), name, "cube", 125, "cpu") for name in ("akinci", "becker_teschner")}


def test_rest_is_told_by_one_criterion(small):
    values = small["cube_akinci"].values
    energy = np.array(values["series"]["kinetic_energy"])
    rest = values["rest"]
    if rest is None:
        assert energy[-1] > 1e-3 * energy.max()
    else:
        first = values["series"]["time"].index(rest["time"])
        assert (energy[first:] <= 1e-3 * energy.max()).all()
        assert energy[first - 1] > 1e-3 * energy.max()


def test_pictures_have_their_data(small, tmp_path):
    assert len(pictures.panel_data(small)["rows"]) == 2
    curves = pictures.curve_data({})["force_over_sigma_d"]
    assert set(curves) == set(pictures.CURVES)
    becker = curves["Becker & Teschner 2007"]
    assert (becker <= 0).all()  # no repulsion, whatever is said of it (Jiang & Zhu E15)
    assert all((curves[name][0] > 0) for name in curves if name != "Becker & Teschner 2007")
    assert write_data(discover()["models"].pictures[0], {}, tmp_path).exists()
