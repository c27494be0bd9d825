"""Highest points against slow sweeps of frequency in time, by an integration of the test's own (tests/sweeps.py).

``python -m benchmarks reached`` does it for 500 drawn studies.
"""

from dataclasses import replace

import numpy as np
import pytest

from bdamper.util.formatting import amount
from tests.printed import said
from tests.sweeps import Drawn, draw, highest_in_sweeps

RUBS = {"tangential": 0, "normal": 1, "kt": 0.6, "mu": 0.4, "preload": 0.35}
TWO_MASSES = np.eye(2), 0.05 * np.eye(2), np.array([[1.0, 0.3], [0.3, 2.0]])


def rubbing(kn, band):
    """Return the blade that rubs on the ground (docs/lumped.md) with a stiffer contact."""
    return Drawn(*TWO_MASSES, ({**RUBS, "kn": kn},), np.array([0.1, 0.12]), 1, band)


@pytest.mark.slow
def test_a_highest_point_is_reached_by_a_slow_sweep_within_the_interval():
    """Study 476 and the blade that rubs have a branch that enters and leaves at the upper end, 4 and 250 times higher."""
    drawn = [draw(number) for number in (476, 0, 4)] + [rubbing(60.0, (0.15, 0.54))]
    swept = highest_in_sweeps(drawn, periods=1000, steps=64).max(axis=1)
    for one, highest in zip(drawn, swept):
        study = one.study(harmonics=7)
        curve, peak = study.frequency_response(0.0, one.band), study.peak(0.0, one.band)
        # the rubbing blade has its separate branch above a maximum, study 476 above an end
        assert curve.complete == (one is not drawn[-1])
        assert peak.ok == (not curve.peak_at_end and "widen the interval" not in said(curve))
        assert curve.peak.amplitude == pytest.approx(highest, rel=0.05)
        if peak.ok:
            assert peak.amplitude == pytest.approx(curve.peak.amplitude, rel=1e-6)
        else:
            # the highest known point may be on the separate branch
            known = [curve.peak.amplitude, *curve.amplitude[curve.separate]]
            assert peak.lower_bound == pytest.approx(max(known), rel=1e-6)
        assert (
            ("widen the interval" in said(curve))
            == ("widen the interval" in said(peak))
            == (one in (drawn[0], drawn[-1]))
        )
        assert (": study.time_response" in said(curve)) == (not curve.peak_at_end)
        assert (": study.time_response" in said(peak)) == peak.ok


@pytest.mark.slow
def test_a_branch_joined_to_one_end_is_named_and_a_wider_interval_shows_it():
    """A sweep down from 1.5 Hz follows it: there the branch leads from end to end."""
    narrow, wide = rubbing(60.0, (0.15, 0.54)), rubbing(60.0, (0.3, 1.5))
    curve = narrow.study(harmonics=13).frequency_response(0.0, narrow.band)
    whole = wide.study(harmonics=13).frequency_response(0.0, wide.band)
    (separate,) = curve.separate
    amplitude = curve.amplitude[separate]
    assert f"separate: {amount(amplitude, 'm', 6)} at" in curve.summary()
    assert amplitude == pytest.approx(whole.peak.amplitude, rel=1e-8) and not len(whole.separate)
    assert amplitude > 200.0 * curve.peak.amplitude and curve.frequency[curve.apart].max() == 0.54
    assert highest_in_sweeps([wide], periods=1200, steps=64)[0, 1] > 100.0 * curve.peak.amplitude
    assert np.isin(curve.branch[curve.apart], curve.branch[separate]).all()
    broken = replace(
        curve, point_kind=("regular", *curve.point_kind[1:])
    )  # no branch leads through, so every one counts
    assert not len(broken.separate) and broken.peak.amplitude == amplitude
