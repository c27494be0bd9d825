"""A peak counts only if the sweep has solutions in the whole band."""

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
    assert whole.converged and whole.reason == "2 peaks climbed from 12 of 12 points", whole.reason
    assert whole.sweep_frequency[0] == pytest.approx(band[0]) and whole.sweep_frequency[-1] == pytest.approx(band[1])

    at = module.Solver.at

    def lost(self, omega, *arguments):
        return None if hidden[0] < omega / (2.0 * np.pi) < hidden[1] else at(self, omega, *arguments)

    monkeypatch.setattr(module.Solver, "at", lost)
    part = wheel.peak(2000.0, band, options=options)
    assert not part.converged and part.status in ("lower bound", "not found")
    low, high = (float(part.reason.split(" Hz")[0].split()[i]) for i in (-3, -1))
    step = whole.sweep_frequency[1] - whole.sweep_frequency[0]
    assert hidden[0] < low < hidden[0] + step and min(hidden[1], band[1] + 1e-9) - step < high < hidden[1]
    assert "no solution found between" in part.reason
    assert (np.diff(part.sweep_frequency) > 0.0).all()
    ends = module.band(wheel, 2000.0)
    hidden = ends[0] + 0.3 * (ends[1] - ends[0]), ends[0] + 0.6 * (ends[1] - ends[0])
    left = wheel.optimal_curve([2000.0], options=options)
    assert left.status == ("lower bound",) or left.status == ("not found",)
    assert np.isnan(left.amplitude).all()
