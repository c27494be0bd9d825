"""A whole study as a file: every setting comes back, with the model or by its hash, and a result leads to its study."""

import h5py
import numpy as np
import pytest
from numpy.testing import assert_array_equal

import bdamper as bd
from bdamper.response.sensitivity import setting_value
from bdamper.util.errors import SettingError
from tests.each import each
from tests.models import wedge_model
from tests.turning import turning_disk

TIP = bd.Excitation("tip", (1.0, 0.2, 0.0), 2.0, 0.3)
FACES = ("left", "right", "front", "back")


@pytest.fixture(scope="module")
def model():
    return wedge_model()


@pytest.mark.slow
@each(
    "settings",
    [
        {},
        {
            "friction_coefficient": {name: 0.1 * (k + 1) for k, name in enumerate(FACES)},
            "harmonics": (1, 3),
        },
        {"contact_stiffness": bd.PerArea((1e12, 1e12, 2e12)), "contact_forces": bd.AFT(64, False)},
        {
            "contact_stiffness": bd.ResidualModes(8, 0.4, False),
            "response": bd.Response("tip", "axial"),
        },
        {
            "contact_stiffness": {
                name: np.full((3 if name in FACES[2:] else 4, 3), 1e7 / 3.0) for name in FACES
            }
        },
        {
            "contact_stiffness": 1e7 / 3.0,
            "contact_stiffness_factor": 1.1,
            "load_history": (1.5, 1.0),
            "contact_points": 2,
        },
        {
            "gap": {"left": np.array([0.0, 1e-7, 2e-7, 3e-7])},
            "damping_ratio": 0.01,
            "damper_drag": 0.2,
            "bias": False,
        },
        {
            "rigid_modes": ("TY", "RZ"),
            "friction_law": "coupled",
            "contact_forces": bd.AFT(128),
            "stability": True,
        },
        {
            "fundamental_modes_only": True,
            "constraint_planes": False,
            "separation": False,
            "damper_modes": 1,
            "blade_modes": 3,
        },
    ],
)
def test_every_setting_comes_back(model, settings, tmp_path):
    study = bd.Study(model, TIP, 2, **settings)
    study.save(tmp_path / "study.h5")
    back = bd.load_study(tmp_path / "study.h5")
    assert back.problem.record() == study.problem.record() and not study.diff(back)
    assert (back.settings.contact_stiffness is None) == (study.settings.contact_stiffness is None)
    assert_array_equal(back.static(5.0).force, study.static(5.0).force)
    assert type(bd.load(tmp_path / "study.h5")) is bd.Study


def test_one_friction_coefficient_stays_one_number(model, tmp_path):
    """A file has it by interface; derivatives by it need one."""
    bd.Study(model, TIP, 2, friction_coefficient=0.25).save(tmp_path / "study.h5")
    back = bd.load_study(tmp_path / "study.h5")
    assert setting_value(back.problem, "friction_coefficient") == 0.25
    two = back.replace(friction_coefficient={name: 0.1 * (k + 1) for k, name in enumerate(FACES)})
    with pytest.raises(SettingError, match="expected a scalar setting"):
        setting_value(two.problem, "friction_coefficient")


def test_the_model_may_be_left_to_its_hash(model, tmp_path):
    path = tmp_path / "study.h5"
    bd.Study(model, TIP, 2).save(path, include_model=False)
    assert path.stat().st_size < 20000
    assert bd.load_study(path, model).model is model
    other = wedge_model(seed=1)
    missing = f"study.h5: the file contains no model; give the one with hash {model.hash}"
    different = f"study.h5: expected the model with hash {model.hash}, found {other.hash}"
    for given, message in ((None, missing), (other, different)):
        with pytest.raises(bd.BdamperError, match=message):
            bd.load_study(path, given)


def test_a_result_leads_to_its_study(model, tmp_path):
    study = bd.Study(model, TIP, 2, 0.25, harmonics=2)
    study.frequency_response(20.0, (250.0, 400.0)).save(tmp_path / "curve.h5")
    back = bd.load_study(tmp_path / "curve.h5", model)
    assert back.problem.record() == study.problem.record()
    bd.save_model(model, tmp_path / "model.h5")
    with pytest.raises(bd.BdamperError, match=r"model\.h5: expected a study or its result"):
        bd.load_study(tmp_path / "model.h5")


def test_a_study_at_a_rotor_speed(tmp_path):
    rest = turning_disk((0, 5), spin=True)
    study = bd.Study(rest, TIP, 5, harmonics=1, contact_stiffness=1e7).at_speed(300.0)
    study.save(tmp_path / "whole.h5")
    study.save(tmp_path / "hash.h5", include_model=False)
    for back in (bd.load_study(tmp_path / "whole.h5"), bd.load_study(tmp_path / "hash.h5", rest)):
        assert back.problem.record() == study.problem.record() and back.preload == study.preload


def test_masses_come_back(tmp_path):
    study = bd.lumped(
        1.0, 0.1, 1.0, contacts=[bd.Contact(0, kt=1.0, mu=0.5, preload=1.0)], forces={0: 1.0j}
    )
    study.save(tmp_path / "masses.h5")
    back = bd.load_study(tmp_path / "masses.h5")
    assert back.peak(0.0, (0.1, 0.3)).amplitude == study.peak(0.0, (0.1, 0.3)).amplitude


def test_a_damaged_model_in_a_study_is_refused(model, tmp_path):
    path = tmp_path / "study.h5"
    bd.Study(model, TIP, 2).save(path)
    with h5py.File(path, "a") as file:
        file["model/bodies/blade/nd000/omega2"][0] = -1.0
    with pytest.raises(bd.ModelError, match=r"study\.h5: /model: .*omega2"):
        bd.load_study(path)
    with pytest.raises(bd.BdamperError, match="expected an existing folder"):
        bd.Study(model, TIP, 2).save(tmp_path / "nowhere" / "study.h5")


def test_friction_axes_that_are_gone_are_refused():
    from bdamper.harmonic_balance.settings import settings_of

    with pytest.raises(bd.SettingError, match='friction_axes: expected "contact"'):
        settings_of({"friction_axes": "major"})
