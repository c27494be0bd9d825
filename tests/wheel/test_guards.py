"""What keeps the answers of a wheel right and was once free to be left out: band, gaps, distances, folds, open optima."""

from types import SimpleNamespace

import numpy as np
import pytest

import bdamper as bd
from bdamper.util.cost import Cost
from bdamper.util.errors import SettingError
from bdamper.wheel import DamperVariation, Wheel, track
from bdamper.wheel.optimal import WheelOptimalCurve
from bdamper.wheel.peak import band
from bdamper.wheel.system import PLAIN
from tests.wheel.lumped import lumped_study
from tests.wheel.test_symmetry import PATTERN, study

PRELOAD = 300.0


def test_the_band_reaches_as_far_as_the_blades_deviate():
    tuned = Wheel(study())
    low, high, width = band(tuned, 2000.0)
    one = np.asarray(PATTERN.deviation).ravel()
    for deviations in (one, 3.0 * np.abs(one), -2.0 * np.abs(one)):
        least, most = min(0.0, deviations.min()), max(0.0, deviations.max())
        found = band(tuned.with_(mistuning=deviations), 2000.0)
        expected = (low + 2.0 * width) * (1.0 + least) - 2.0 * width, (high - 2.0 * width) * (1.0 + most) + 2.0 * width
        np.testing.assert_allclose(found, (*expected, width), rtol=1e-9)
    assert least < -0.01 < 0.01 < 3.0 * np.abs(one).max()


def test_a_gap_of_the_dampers_is_one_of_the_study():
    """It opens: the state is that of the study whose faces are as much further apart."""
    tuned = lumped_study(6, 1, n_c=2, r=2)
    faces = tuned.coupling.model.interfaces
    one, none = np.ones(6), np.zeros(6)
    plain = Wheel(tuned).system(PRELOAD)[0].contact.points
    apart = Wheel(tuned.with_(gap={name: face.gap + 2e-7 for name, face in faces.items()}))
    varied = Wheel(tuned, dampers=DamperVariation(one, one, one, 2e-7 * one, none > 0.0))
    (system, mean), (expected, rest) = varied.system(PRELOAD), apart.system(PRELOAD)
    np.testing.assert_allclose(system.contact.points.n0, expected.contact.points.n0, rtol=1e-12)
    assert (system.contact.points.n0 < plain.n0).all()
    np.testing.assert_allclose(mean, rest, rtol=0.0, atol=1e-6 * np.abs(rest).max())


class Line:
    """A path whose points are where they are put."""

    def __init__(self, omega):
        self.system, self.limits, self.ease = None, (0.0, 10.0), PLAIN
        self.points, self.failed, self.left = [(np.zeros((1, 3, 1)), omega[0])], 0, list(omega[1:])

    def scale(self):
        return 1.0, 1.0

    def predicted(self, step, unit, unit_omega):
        return np.zeros((1, 3, 1)), self.left[0], None

    def distance(self, a, b, unit, unit_omega):
        return float(np.hypot(np.linalg.norm(a[0] - b[0]), a[1] - b[1]))

    def add(self, X, omega, unit, unit_omega):
        self.points.append((X, omega))
        self.left.pop(0)


@pytest.fixture
def kinds(monkeypatch):
    """Kinds of the points that are kept on a line through these frequencies, and how the run ends."""

    def run(omega, beside=0.0):
        def correct(system, X, omega, plane=None, **options):
            return SimpleNamespace(converged=True, X=X + beside, omega=omega, iterations=2, inverse=None)

        monkeypatch.setattr(track, "correct", correct)
        monkeypatch.setattr(track, "_walk_on", lambda path, step: None)
        found, path = [], Line(omega)
        status, _ = track.follow(path, lambda at, kind: found.append(kind), True, len(omega) + 50, 0.15)
        return found, status, path.failed

    return run


def test_folds_of_a_curve_are_where_the_frequency_turns(kinds):
    found, status, failed = kinds([1.0, 2.0, 3.0, 2.5, 2.0, 2.2, 5.0, 9.9, 11.0])
    assert found == ["regular", "regular", "fold", "regular", "fold", "regular", "regular", "end"]
    assert (status, failed) == ("complete", 0)


def test_a_solution_far_from_its_prediction_is_not_on_the_curve(kinds):
    found, status, failed = kinds([1.0, 2.0, 3.0, 4.0], beside=1.0)
    assert found == [] and status == "stalled" and failed > 10


def optimal(amplitude, error, status=None):
    n, a = len(amplitude), np.asarray(amplitude, float)
    return WheelOptimalCurve(
        preload=100.0 * np.arange(1, n + 1), frequency=np.full(n, 200.0), amplitude=a, blade=np.arange(n),
        tuned_amplitude=np.ones(n), status=status or tuple("held" if e else "converged" for e in error), reason=("",) * n,
        residual=np.zeros(n), springs=np.asarray(error, float), error=np.asarray(error, float),
        deviation=np.zeros((3, 1)), cost=Cost(), settings={}, model_hash="",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("amplitude", "error", "candidates"),
    [
        ([3.0, 2.0, 4.0], [0.0, 0.0, 0.0], [1]),
        ([3.0, 2.0, 4.0], [0.0, 0.2, 0.0], [1]),  # at most 2.4
        ([3.0, 2.9, 4.0], [0.0, 0.2, 0.0], [0, 1]),  # 2.32 to 3.48
        ([3.0, 2.9, 4.0], [0.0, 0.01, 0.3], [1, 2]),  # 2.8 to 5.2
        ([np.nan, 2.9, 4.0], [np.nan, 0.1, 0.0], [1]),
        ([np.nan, np.nan], [np.nan, np.nan], []),
    ],
)
def test_the_best_preload_is_open_where_held_dampers_leave_it_so(amplitude, error, candidates):
    curve = optimal(amplitude, error)
    assert curve.candidates.tolist() == candidates
    assert curve.best == (candidates[0] if len(candidates) == 1 else None)
    fact = curve.facts()[1]
    assert fact.name == "best preload computed"
    if curve.best is not None:
        assert fact.value == 100.0 * (curve.best + 1)
    elif candidates:
        assert fact.text == "open between " + ", ".join(f"{100 * (k + 1)}" for k in sorted(candidates)) + " N"
    else:
        assert fact.text == "not found"


def test_nothing_excites_a_wheel():
    still = lumped_study(3, 1)
    for wrong in (np.zeros(3), np.full(3, np.nan), np.array([1.0, np.inf, 0.0]), 0, "x", np.ones(4)):
        with pytest.raises(SettingError, match=r"^forces: expected 3 finite complex numbers, not all zero, found"):
            Wheel(still, forces=wrong)
    wheel = Wheel(still.with_(excitation=bd.Excitation("tip", amplitude=0.0)))
    asked = [
        lambda: wheel.peak(PRELOAD), lambda: wheel.track(PRELOAD, (150.0, 200.0)), lambda: wheel.optimal_curve([PRELOAD]),
    ]  # fmt: skip
    for ask in asked:
        with pytest.raises(SettingError, match=r"^excitation: expected a .*force .*, found 0 N at 'tip'"):
            ask()
