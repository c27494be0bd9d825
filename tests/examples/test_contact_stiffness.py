"""The examples on contact stiffness run and show what they are for."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def example(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def test_split_between_diagonal_and_residual_modes():
    module = example("contact_stiffness_split")
    rows = module.split_study(9, (10000.0,), module.CHOICES[-2:])
    assert [r.status for r in rows] == ["complete", "complete"]
    assert rows[0].amplitude == pytest.approx(rows[1].amplitude, rel=0.02)


@pytest.mark.slow
def test_microslip():
    module = example("contact_stiffness_split")
    curves = module.microslip_study(9, module.MICROSLIP_CHOICES[-2:])
    fewer, whole = (np.interp((150.0, 270.0), *module.loading(c)) for c in curves.values())
    np.testing.assert_allclose(fewer, whole, rtol=3e-3)


@pytest.mark.nightly
@pytest.mark.slow
def test_contact_points():
    """On the coarse mesh: frequencies of the reduced model and of the full one agree, whatever the number of points."""
    pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")
    rows = list(example("contact_point_convergence").convergence((9, 24), "coarse"))
    for row in rows:
        assert row.reduced == pytest.approx(row.bonded, rel=1e-5)
    assert rows[0].bonded != rows[1].bonded
    assert rows[0].peak == pytest.approx(rows[1].peak, rel=0.05)
