"""What keeps the answers of a wheel right and was once free to be left out: band, gaps, distances, folds."""

import numpy as np
import pytest

import bdamper as bd
from bdamper.mistuning import BladedDisk, DamperVariation
from bdamper.mistuning.peak_search import band
from bdamper.model.kinematics import Coupling
from bdamper.response.events import ContinuationOptions
from bdamper.util.errors import BdamperWarning, SettingError
from tests.mistuning.lumped import lumped_study
from tests.mistuning.test_symmetry import PATTERN, study

PRELOAD = 300.0


def test_the_band_reaches_as_far_as_the_blades_deviate():
    tuned = BladedDisk(study())
    low, high, width = band(tuned, 2000.0)
    one = np.asarray(PATTERN.deviation).ravel()
    for deviations in (one, 3.0 * np.abs(one), -2.0 * np.abs(one)):
        least, most = deviations.mean() - deviations.std(), deviations.mean() + deviations.std()
        found = band(tuned.replace(mistuning=deviations), 2000.0)
        expected = (
            (low + 2.0 * width) * (1.0 + least) - 2.0 * width,
            (high - 2.0 * width) * (1.0 + most) + 2.0 * width,
        )
        np.testing.assert_allclose(found, (*expected, width), rtol=1e-9)
    assert least < -0.01 and deviations.std() > 0.01


def test_a_gap_of_the_dampers_is_one_of_the_study():
    """It opens: the state is that of the study whose faces are as much further apart."""
    tuned = lumped_study(6, 1, n_c=2, r=2)
    faces = tuned.problem.coupling.model.interfaces
    one, none = np.ones(6), np.zeros(6)
    plain = BladedDisk(tuned).system(PRELOAD).structure.points
    apart = BladedDisk(tuned.replace(gap={name: face.gap + 2e-7 for name, face in faces.items()}))
    varied = BladedDisk(tuned, dampers=DamperVariation(one, one, one, 2e-7 * one, none > 0.0))
    system, expected = varied.system(PRELOAD), apart.system(PRELOAD)
    np.testing.assert_allclose(system.structure.points.n0, expected.structure.points.n0, rtol=1e-12)
    assert (system.structure.points.n0 < plain.n0).all()
    rest = expected.structure.at_rest
    np.testing.assert_allclose(
        system.structure.at_rest, rest, rtol=0.0, atol=1e-6 * np.abs(rest).max()
    )


@pytest.mark.slow
def test_a_curve_has_its_folds_and_no_solution_far_from_the_one_before():
    """Of six blades at 300 N; beyond a fold the frequency turns."""
    curve = BladedDisk(study(), 0.3 * PATTERN.deviation).frequency_response(
        PRELOAD, (150.0, 600.0), options=ContinuationOptions(locate=False, max_points=260, budget=3000)
    )  # fmt: skip
    assert (
        curve.status == "incomplete"
        and curve.missing_ranges
        and np.count_nonzero(np.diff(curve.backward)) > 4
    )
    for number in np.unique(curve.branch):
        on = np.flatnonzero(curve.branch == number)
        x = curve.blades[on, :, 1]
        apart = np.linalg.norm(np.diff(x, axis=0), axis=1) / np.linalg.norm(x[1:], axis=1)
        assert apart.max() < 0.35, "steps are 0.15 of the vibration"


def test_nothing_excites_a_wheel():
    still = lumped_study(3, 1)
    wheel = BladedDisk(still.replace(excitation=bd.Excitation("tip", amplitude=0.0)))
    for ask in (
        lambda: wheel.peak(PRELOAD),
        lambda: wheel.frequency_response(PRELOAD, (150.0, 200.0)),
    ):
        with pytest.raises(
            SettingError, match=r"^excitation: expected a .*force .*, found 0 N at 'tip'"
        ):
            ask()


def test_a_disk_at_a_rotor_speed_is_refused():
    turning = bd.Study(
        bd.reference_model("bladed_disk", 9), bd.Excitation("tip"), 5, harmonics=1
    ).at_speed(400.0)
    with pytest.raises(
        SettingError,
        match=r"^speed: modes of a bladed disk .* only at rest, found 400 rad/s",
    ):
        BladedDisk(turning)


def test_faces_that_rotation_displaces_are_warned_of(monkeypatch):
    BladedDisk(lumped_study(3, 1))
    monkeypatch.setattr(Coupling, "closing_by_rotation", lambda self: np.ones((self.n_points, 3)))
    with pytest.warns(
        BdamperWarning, match="modes and faces at standstill, although rotation displaces the faces"
    ):
        BladedDisk(lumped_study(3, 1))
