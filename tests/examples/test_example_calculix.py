"""The CalculiX example gives the frequencies and the response curve of the model built in memory on the same mesh."""

import importlib.util
import shutil
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")
if shutil.which("ccx") is None:
    pytest.skip("CalculiX (ccx) is not installed", allow_module_level=True)

from bdamper import ContinuationOptions, Excitation, load_model, reference_model
from bdamper.fem import MeshDensity, SectorFE, bladed_disk
from tests.plain import plain_study
from tests.printed import said

PATH = Path(__file__).resolve().parents[2] / "examples" / "calculix" / "bladed_disk.py"


def example(monkeypatch):
    monkeypatch.syspath_prepend(str(PATH.parent))
    spec = importlib.util.spec_from_file_location("calculix_example", PATH)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def frequencies(basis):
    return np.sqrt(basis.omega2[basis.omega2 > 0.0]) / (2.0 * np.pi)


def distance_from(points, line):
    """Largest distance of points (n, 2) from a polyline (m, 2)."""
    start, along = line[:-1], np.diff(line, axis=0)
    t = np.einsum("nmk,mk->nm", points[:, None] - start, along) / np.maximum(
        (along**2).sum(axis=1), 1e-300
    )
    nearest = start + np.clip(t, 0.0, 1.0)[..., None] * along
    return np.linalg.norm(points[:, None] - nearest, axis=2).min(axis=1).max()


def compare_curves(curve, model):
    """The response curve is that of ``model`` within half a percent: every point, both folds, the peak."""
    study = plain_study(
        model, Excitation("tip", amplitude=1.0), engine_order=5, friction_coefficient=0.3
    )
    own = study.frequency_response(
        200.0, (250.0, 400.0), options=ContinuationOptions(step=0.02, max_step=0.02)
    )
    assert own.complete
    assert curve.complete
    a, b = (
        np.column_stack([c.frequency / own.peak.frequency, c.amplitude / own.peak.amplitude])
        for c in (curve, own)
    )
    assert distance_from(a, b) < 5e-3
    assert curve.peak.amplitude == pytest.approx(own.peak.amplitude, rel=5e-3)
    assert curve.peak.frequency == pytest.approx(own.peak.frequency, rel=5e-3)
    assert len(curve.folds) == len(own.folds) > 0
    assert curve.frequency[curve.folds] == pytest.approx(own.frequency[own.folds], rel=5e-3)
    assert curve.amplitude[curve.folds] == pytest.approx(own.amplitude[own.folds], rel=5e-3)


@pytest.mark.nightly
@pytest.mark.slow
def test_frequencies_and_curve_on_the_coarse_mesh(tmp_path, capsys, monkeypatch):
    built, curve = example(monkeypatch).main(tmp_path)
    assert "imported model of" in capsys.readouterr().out
    ours = bladed_disk(9, n_modes=20, engine_order=5, harmonics=3, fe=SectorFE())
    for body, d in (("blade", 0), ("blade", 5), ("blade", 10), ("blade", 15), ("damper", 0)):
        theirs = frequencies(built.model.bodies[body].bases[d])[:10]
        np.testing.assert_allclose(theirs, frequencies(ours.bodies[body].bases[d])[:10], rtol=1e-3)
    compare_curves(curve, ours)
    assert load_model(tmp_path / "bladed_disk.h5").hash == built.model.hash
    text = said(built.summary())
    assert "nodal diameter 5 pass 5 modes are waves of it" in text
    assert "nodal diameter 5 pass frequencies agree" in text


@pytest.mark.nightly
@pytest.mark.slow
def test_shipped_reference_model(tmp_path, monkeypatch):
    """On the mesh of the shipped model: its frequencies to 0.1 %, its response curve to 0.5 %."""
    module = example(monkeypatch)
    fe = SectorFE(density=MeshDensity.preset("reference"))
    module.write_and_run(tmp_path, fe)
    built = module.import_model(tmp_path, fe, n_modes=12)
    shipped = reference_model(contact_points=9)
    for body, d, n in (("blade", 0, 12), ("blade", 5, 12), ("blade", 15, 12), ("damper", 0, 8)):
        theirs, ours = (frequencies(m.bodies[body].bases[d])[:n] for m in (built.model, shipped))
        np.testing.assert_allclose(theirs, ours, rtol=1e-3)
    compare_curves(module.tracking_curve(built), shipped)
