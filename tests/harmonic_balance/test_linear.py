"""Linear curves: which of their points are maxima."""

from __future__ import annotations

import numpy as np
import pytest

import bdamper as bd
from bdamper.response.linear_limits import linear_peak
from tests.plain import plain_study


@pytest.fixture(scope="module")
def study():
    return plain_study(
        bd.reference_model("bladed_disk", 9), excitation=bd.Excitation("tip"), engine_order=5
    )


def marked(curve):
    return [i for i, kind in enumerate(curve.point_kind) if kind == "maximum"]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["free", "stuck"])
def test_every_resonance_is_a_maximum(study, kind):
    """Those that a uniform grid of 0.2 Hz sees, and no others."""
    curve = getattr(study, kind)((200.0, 2100.0))
    at = marked(curve)
    assert len(at) > 2
    system = study.problem.system(curve.preload)
    springs = None if kind == "free" else study.problem.at(curve.preload).stuck_springs()
    grid = np.arange(200.0, 2100.0, 0.2)
    a = np.array(
        [
            abs(system.structure.linear.response(2 * np.pi * f, springs) @ system.response_rows[1])
            for f in grid
        ]
    )
    tops = np.flatnonzero((a[1:-1] > a[:-2]) & (a[1:-1] > a[2:])) + 1
    assert len(at) == len(tops)
    np.testing.assert_allclose(curve.frequency[at], grid[tops], atol=0.2)
    for i in at:  # stationary, and lower on both sides
        w, h = 2 * np.pi * curve.frequency[i], 1e-5 * 2 * np.pi * curve.frequency[i]
        low, high = (
            abs(system.structure.linear.response(w + d, springs) @ system.response_rows[1])
            for d in (-h, h)
        )
        assert max(low, high) < curve.amplitude[i]
        assert abs(high - low) < 1e-2 * (2.0 * curve.amplitude[i] - high - low)
    assert linear_peak(
        study.problem.at(curve.preload), (200.0, 2100.0), stuck=kind == "stuck"
    ).frequency == pytest.approx(curve.peak.frequency, rel=1e-7)


def test_the_end_of_an_interval_is_no_maximum(study):
    top = study.free((200.0, 400.0)).peak.frequency
    for interval in ((top - 30.0, top - 1.0), (top + 1.0, top + 30.0)):
        curve = study.free(interval)
        assert curve.amplitude.argmax() in (0, len(curve) - 1)
        assert not marked(curve)
    for beyond in (1e-3, 1e-6):  # the pole lies outside, the maximum within
        assert len(marked(study.free((top - 30.0, top + beyond)))) == 1
        peak = linear_peak(study.problem.at(0.0), (top - 30.0, top + beyond), stuck=False)
        assert peak.frequency == pytest.approx(top, rel=1e-7)
    assert np.isnan(
        linear_peak(study.problem.at(0.0), (top - 30.0, top - 1e-3), stuck=False).frequency
    )
