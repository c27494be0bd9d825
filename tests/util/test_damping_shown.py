"""Modal damping and the mass of the damper, which decide a result, are in every print of study and model."""

import re
from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.__main__ import main
from bdamper.importers.build import BuiltModel
from tests.turning import turning_disk


def with_damping(model, low, high):
    """The model with modal damping ratios of the blade that rise from one mode to the next."""
    blade = model.bodies["blade"]
    bases = {
        d: replace(b, damping_ratio=np.linspace(low, high, b.n_modes))
        for d, b in blade.bases.items()
    }
    return replace(model, bodies=model.bodies | {"blade": replace(blade, bases=bases)})


def row(text, name):
    """Text of a row."""
    return re.search(rf"^ *{name} +(.*)$", text, re.M)[1]


@pytest.fixture(scope="module")
def study():
    return bd.Study(
        bd.reference_model("turbine_blade"),
        bd.Excitation("tip"),
        5,
        harmonics=1,
        friction_coefficient=0.3,
    )


def test_the_damping_ratio_is_the_one_of_the_response(study):
    """The bandwidth at 1/sqrt(2) of the free resonance is 2 zeta f."""
    shown = float(row(str(study), "modal damping ratio"))
    free = study.free((620.0, 650.0))
    f = np.linspace(620.0, 650.0, 300_001)
    wide = f[np.interp(f, free.frequency, free.amplitude) > free.amplitude.max() / np.sqrt(2.0)]
    assert np.ptp(wide) / (2.0 * free.peak.frequency) == pytest.approx(shown, rel=0.02) == 0.002
    assert row(str(study.replace(damping_ratio=0.0037)), "modal damping ratio") == "0.0037"


@pytest.mark.slow
def test_mass_and_radius_are_those_of_the_centrifugal_load():
    """The preload at a speed is m r Omega^2."""
    at = bd.Study(turning_disk((0, 5), spin=True), bd.Excitation("tip"), 5, harmonics=1).at_speed(
        400.0
    )
    mass, radius = re.fullmatch(
        r"(\S+) kg at a radius of (\S+) m", row(str(at), "damper mass")
    ).groups()
    assert float(mass) * float(radius) * 400.0**2 == pytest.approx(at.preload, rel=1e-3)
    assert "radius" not in str(bd.Study(bd.reference_model("test_rig"), bd.Excitation("tip"))), (
        "nothing rotates"
    )


def test_bodies_with_other_damping_are_named():
    model = with_damping(bd.reference_model("turbine_blade"), 0.001, 0.004)
    study = bd.Study(model, bd.Excitation("tip"), 5, harmonics=1)
    assert row(str(study), "modal damping ratio") == "0.001 to 0.004", (
        "the damper has no elastic modes here"
    )
    both = study.replace(damper_modes=2)
    assert row(str(both), "modal damping ratio") == "blade 0.001 to 0.004, damper 0.002"


def test_model_command_and_import_report_show_both(capsys, tmp_path):
    model = with_damping(bd.reference_model("turbine_blade"), 0.001, 0.004)
    bd.save_model(model, tmp_path / "model.h5")
    assert main(["info", str(tmp_path / "model.h5")]) == 0
    damper = model.bodies["damper"]
    radius = float(np.hypot(*damper.centre[:2]))
    for text in (str(model), capsys.readouterr().out):
        assert re.search(r"^  blade: .*, modal damping ratio 0\.001 to 0\.004$", text, re.M)
        assert (
            f"  damper: free, 10 modes, {damper.mass:.4g} kg at a radius of {radius:.4g} m, modal damping"
            in text
        )
    report = str(BuiltModel(model, {}, (), (), (), (), ()))
    report = " ".join(report.split())
    for text in (
        "blade 0.001 to 0.004 modal damping ratio",
        f"damper {damper.mass:.6g} kg mass, at a radius of {radius:.6g} m",
    ):
        assert text in report
