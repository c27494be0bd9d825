"""Frequencies of a rotating sector against CalculiX: a static step with centrifugal load, then a perturbation step."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")
if shutil.which("ccx") is None:
    pytest.skip("CalculiX (ccx) is not installed", allow_module_level=True)

from bdamper.fem.generated_models import SectorFE, bladed_disk
from bdamper.importers import over_speed, read_frd
from examples.calculix.decks import run_job, sector_input
from tests.calculix_runs import run
from tests.fe_bodies import contacts, sector_and_damper
from tests.imports import build

D, LEFT_OUT, TOP = 5, 450.0, 600.0


@pytest.fixture(scope="module")
def fe():
    return SectorFE()


def deck(fe, omega, n_modes=6, d=D):
    return sector_input(fe, d, n_modes, omega=omega)


@pytest.mark.slow
def test_model_at_a_speed_that_it_does_not_know(fe, tmp_path):
    model = bladed_disk(
        4, n_modes=12, n_damper_modes=6, nodal_diameters=(D,), rotation=fe.rotation(), fe=fe
    )
    ours = np.sqrt(np.sort(model.at_speed(LEFT_OUT).bodies["blade"].bases[D].omega2)[:6]) / (
        2.0 * np.pi
    )
    theirs = run(deck(fe, LEFT_OUT), tmp_path).reshape(-1, 2)[:, 0]
    assert ours == pytest.approx(theirs, rel=3e-4)
    assert ours[0] == pytest.approx(theirs[0], rel=3e-5)


@pytest.mark.slow
def test_modes_of_two_perturbation_steps(fe, tmp_path):
    """The cyclic result files of two speeds make a model that knows the frequencies between them."""
    blade, damper = sector_and_damper(fe)
    bodies = {}
    for omega in (0.0, TOP):
        modes = []
        for d in (0, D):
            run_job(deck(fe, omega, 8, d), tmp_path, f"job{omega:.0f}_{d}")
            modes += read_frd(tmp_path / f"job{omega:.0f}_{d}.frd").modes
        modes = tuple(replace(m, numbers=m.numbers + blade.numbers[0] - 1) for m in modes)
        bodies[omega] = replace(blade, stiffness=None, mass=None, modes=modes)
    settings = {
        "faces": ("LOW", "HIGH"),
        "contacts": contacts(4),
        "n_modes": 8,
        "n_damper_modes": 6,
    }
    built = build(over_speed(bodies), damper, n_blades=65, nodal_diameters=(D,), **settings)
    found = np.sqrt(np.sort(built.model.at_speed(LEFT_OUT).bodies["blade"].bases[D].omega2)[:6]) / (
        2.0 * np.pi
    )
    assert found == pytest.approx(run(deck(fe, LEFT_OUT), tmp_path).reshape(-1, 2)[:, 0], rel=1e-4)
