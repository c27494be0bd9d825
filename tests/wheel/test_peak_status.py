"""A peak counts only if the sweep has solutions in the whole band."""

from dataclasses import replace

import numpy as np
import pytest

from bdamper.wheel import Wheel
from bdamper.wheel import peak as module
from tests.wheel.test_symmetry import PATTERN, study


@pytest.mark.parametrize("hidden", [(181.0, 189.0), (205.0, 300.0)])
def test_a_part_of_the_band_without_solutions_leaves_a_lower_bound(monkeypatch, hidden):
    wheel = Wheel(study(), mistuning=PATTERN)
    band, options = (170.0, 215.0), module.WheelPeakOptions(least=12, most=12, climbs=1)
    whole = wheel.peak(2000.0, band, options=options)
    assert whole.converged and whole.reason.startswith("highest of"), whole.reason
    assert whole.sweep_frequency[0] == pytest.approx(band[0]) and whole.sweep_frequency[-1] == pytest.approx(band[1])

    correct = module.correct

    def lost(system, X, omega, *arguments, **options):
        found = correct(system, X, omega, *arguments, **options)
        inside = hidden[0] < omega / (2.0 * np.pi) < hidden[1]
        return replace(found, converged=False) if inside else found

    monkeypatch.setattr(module, "correct", lost)
    monkeypatch.setattr(module, "follow", lambda *arguments: ("stalled", "here"))
    start = module.start

    def no_start(system, mean, omega, *arguments):
        return None if hidden[0] < omega / (2.0 * np.pi) < hidden[1] else start(system, mean, omega, *arguments)

    monkeypatch.setattr(module, "start", no_start)
    part = wheel.peak(2000.0, band, options=options)
    assert not part.converged and part.status in ("lower bound", "not found")
    low, high = (float(part.reason.split(" Hz")[0].split()[i]) for i in (-3, -1))
    assert low <= hidden[0] and high >= min(hidden[1], band[1]) - 1e-9
    assert "no solution found between" in part.reason
    assert (np.diff(part.sweep_frequency) > 0.0).all()
    left = wheel.optimal_curve([2000.0], options=options)
    assert np.isnan(left.amplitude).all()
