"""Frequencies against CalculiX, an independent finite element program, on the same meshes (anchor A9).

CalculiX computes them with its own elements, cyclic ties and eigensolver; nothing but the mesh is shared.
"""

import shutil
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")
if shutil.which("ccx") is None:
    pytest.skip("CalculiX (ccx) is not installed", allow_module_level=True)

from bdamper.fem.generated_models import SectorFE, blade_structure
from bdamper.fem.meshes import ElasticMaterial, Geometry, MeshDensity
from examples.calculix.decks import sector_input
from tests.calculix_runs import clamped_input, free_input, run
from tools.rig import rig_structure

SHIPPED = Path(__file__).resolve().parents[1] / "models" / "bladed_disk_24.h5"


@pytest.fixture(scope="module")
def fe():
    return SectorFE()


def cyclic_frequencies(fe, d, n_modes, folder):
    text = sector_input(fe, d, n_modes)
    pairs = run(text, folder).reshape(-1, 2)
    np.testing.assert_allclose(pairs[:, 0], pairs[:, 1], rtol=1e-8)
    return pairs[:, 0]


@pytest.mark.slow
@pytest.mark.parametrize("d", [0, 32, *(pytest.param(d, marks=pytest.mark.slow) for d in (5, 30))])
def test_sector(fe, d, tmp_path):
    ours = np.sqrt(fe.cyclic(d).modes(8)[0]) / (2 * np.pi)
    np.testing.assert_allclose(cyclic_frequencies(fe, d, 8, tmp_path), ours, rtol=1e-5)


@pytest.mark.slow
def test_free_damper(fe, tmp_path):
    ours = np.sqrt(fe.damper.modes(14)[0]) / (2 * np.pi)
    theirs = run(free_input(fe.damper.body, 14), tmp_path)
    assert np.all(theirs[:6] < 1.0)
    np.testing.assert_allclose(theirs[6:], ours[6:], rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(
    "structure",
    [
        pytest.param(blade_structure, id="blade to ground"),
        pytest.param(rig_structure, id="test rig", marks=pytest.mark.slow),
    ],
)
def test_acyclic_structures(structure, tmp_path):
    body, held = structure(Geometry(), MeshDensity.preset("coarse"), ElasticMaterial())
    ours = np.sqrt(held.modes(8)[0]) / (2 * np.pi)
    theirs = run(clamped_input(body, held.clamped, 8), tmp_path)
    np.testing.assert_allclose(theirs, ours, rtol=1e-5)


@pytest.mark.nightly
@pytest.mark.slow
@pytest.mark.skipif(
    not SHIPPED.exists(), reason=f"the shipped model {SHIPPED.name} has not been made"
)
def test_shipped_reference_model(tmp_path):
    """The frequencies in the shipped file, at nodal diameter 5, from CalculiX on the reference mesh."""
    from bdamper.model.model_file import load_model

    model = load_model(SHIPPED)
    fe = SectorFE(density=MeshDensity.preset("reference"))
    ours = np.sqrt(model.bodies["blade"].bases[5].omega2[:5]) / (2 * np.pi)
    np.testing.assert_allclose(cyclic_frequencies(fe, 5, 5, tmp_path), ours, rtol=1e-4)
    ours = np.sqrt(model.bodies["damper"].bases[0].omega2[6:10]) / (2 * np.pi)
    (tmp_path / "damper").mkdir()
    theirs = run(free_input(fe.damper.body, 10), tmp_path / "damper")
    np.testing.assert_allclose(theirs[6:], ours, rtol=1e-4)
