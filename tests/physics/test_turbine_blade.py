"""The typical blade: what its damper does, and that few harmonics suffice from the optimum on (not below it)."""

from functools import cache

import numpy as np
import pytest

import bdamper as bd

BAND, OPTIMUM = (600.0, 720.0), 103.6


@pytest.fixture(scope="module")
def study():
    model = bd.reference_model("turbine_blade")
    return bd.Study(
        model, bd.Excitation("tip", "tangential", 1.0), engine_order=5, friction_coefficient=0.3
    )


@pytest.fixture(scope="module")
def height(study):
    """Height of the peak for a number of harmonics and a preload, each computed once."""
    return cache(
        lambda harmonics, preload: study.replace(harmonics=harmonics).peak(preload).amplitude
    )


def test_what_the_model_knows(study):
    """All nodal diameters that twelve blades repeat: any harmonic of order 5, time integration, rotor speed and stress."""
    blade, damper = study.model.bodies["blade"], study.model.bodies["damper"]
    assert set(blade.bases) == {0, 5, 10, 15, 20, 25, 30}
    assert damper.mass == pytest.approx(0.0199, abs=1e-4)
    assert all(
        basis.speed is not None and basis.speed.error < 1e-5
        for d, basis in blade.bases.items()
        if d == 5
    )
    assert set(study.model.stress["blade"].modes) == set(blade.bases)
    assert study.model.meshes["blade"].modes[5].shape[-1] == 10


@pytest.mark.nightly
@pytest.mark.slow
def test_limits_and_peaks_at_the_optimum(study, height):
    free, stuck = (curve.peak for curve in (study.free(BAND), study.stuck(BAND)))
    assert free.frequency == pytest.approx(634.52, abs=0.01) and stuck.frequency == pytest.approx(
        683.14, abs=0.01
    )
    peaks = np.array([height(harmonics, OPTIMUM) for harmonics in (3, 5, 7)])
    assert peaks == pytest.approx([75.29e-6, 74.95e-6, 74.96e-6], rel=1e-3)
    assert np.ptp(peaks) < 0.03 * peaks[0]
    assert free.amplitude / peaks[0] == pytest.approx(13.0, abs=0.1)


@pytest.mark.slow
def test_motion_in_time_is_lower(study):
    """Not a success: with the default number of patterns of the contacts' flexibility it settles 5 to 9 % below."""
    seen = study.motion_in_time(
        study.frequency_response(OPTIMUM, (655.0, 668.0)), steps_per_period=512
    )
    assert seen.blades.shape[1] == 12
    assert 0.91 < seen.mean / seen.balance < 0.95


@pytest.mark.slow
def test_the_optimum(study):
    curve = study.optimal_curve((50.0, 500.0), 12, check=False)
    assert curve.optimum.preload == pytest.approx(103.6, rel=0.01)
    assert curve.optimum.amplitude == pytest.approx(75.3e-6, rel=1e-3)


@pytest.mark.nightly
@pytest.mark.slow
def test_three_harmonics_suffice_from_the_optimum_on(height):
    """3, 5 and 7 agree to 3 % up to five times the optimum; one does not, and below the optimum three do not."""
    for factor, spread in ((0.7, 0.10), (1.0, 0.005), (1.5, 0.006), (2.0, 0.03), (5.0, 0.015)):
        peaks = [height(harmonics, factor * OPTIMUM) for harmonics in (3, 5, 7)]
        assert np.ptp(peaks) / peaks[-1] == pytest.approx(spread, abs=0.01), factor
    assert height(1, OPTIMUM) < 0.8 * height(7, OPTIMUM)
    assert height(1, 5 * OPTIMUM) > 1.15 * height(7, 5 * OPTIMUM)
