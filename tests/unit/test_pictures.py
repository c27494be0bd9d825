"""Pictures in 3-D: they are written, and bad requests are named."""

import matplotlib

matplotlib.use("Agg")

import numpy as np
import pytest
from PIL import Image

import bdamper as bd
from bdamper.plotting import plot_surfaces


def assert_picture(path):
    with Image.open(path) as picture:
        grey = np.asarray(picture.convert("L"))
    assert 0.005 < np.mean(grey < 240) < 0.9


@pytest.mark.parametrize("name", ["bladed_disk", "blade_to_ground", "test_rig"])
def test_models_have_pictures(tmp_path, name):
    model = bd.reference_model(name)
    model.plot(tmp_path / "model.png", backend="matplotlib")
    model.plot_mode(2, tmp_path / "mode.png", backend="matplotlib")
    assert_picture(tmp_path / "model.png")
    assert_picture(tmp_path / "mode.png")


def test_pyvista(tmp_path):
    pytest.importorskip("pyvista")
    bd.reference_model("bladed_disk").plot_mode(1, tmp_path / "mode.png", backend="pyvista")
    assert_picture(tmp_path / "mode.png")


def test_bad_requests_are_named():
    model = bd.reference_model("bladed_disk")
    with pytest.raises(bd.SettingError, match=r"found mode 11 of nodal diameter 5"):
        model.plot_mode(11)
    with pytest.raises(bd.SettingError, match="expected a body with mode shapes"):
        model.plot_mode(1, body="damper")
    with pytest.raises(bd.SettingError, match='expected "pyvista" or "matplotlib"'):
        plot_surfaces([], backend="paper")
