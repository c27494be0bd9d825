"""Verdict on the highest response at a preload: every analysis gives the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import bdamper as bd
from bdamper.response.response_curve_result import NO_STEADY

MODELS = Path(__file__).parents[1] / "models"
FOLLOWED = "higher on the peak followed from"


def verdict(status: str, reason: str) -> str:
    """Return the verdict in one word: complete, incomplete, followed, not steady, or unbounded."""
    if reason.startswith(NO_STEADY):
        return "not steady"
    if FOLLOWED in reason:
        return "followed"
    if reason.startswith("unbounded"):
        return "unbounded"
    return status


def verdicts(
    study: bd.Study, preload: float, interval: tuple[float, float], in_time: bool = False
) -> dict[str, str]:
    """Return the verdict of every analysis at a preload (N) and in an interval (Hz)."""
    peak = study.peak(preload, interval)
    curve = study.frequency_response(preload, interval)
    single = bd.sweep(study, {"friction_factor": [1.0]}, bd.PeakTask(preload, interval))
    around = [0.5 * preload, preload, 2.0 * preload]
    swept = bd.sweep(study, {"preload": around}, frequency=interval)
    optimal = study.optimal_curve(around, frequency=interval, check=False)
    compared = bd.compare({"study": study}, lambda _: curve)
    row = int(np.flatnonzero(optimal.preload == preload)[0])
    found = {
        "peak": verdict(peak.status, peak.reason),
        "peak of the curve": verdict(curve.peak.status, curve.peak.reason),
        "sweep": verdict(single.status[0], single.reason[0]),
        "sweep over the preload": verdict(swept.status[1], swept.reason[1]),
        "optimal curve": verdict(optimal.status[row], optimal.reason[row]),
    }
    # amplitudes are stated if the verdict is complete, and never otherwise
    stated = [
        peak.amplitude,
        single.array("amplitude")[0],
        swept.array("amplitude")[1],
        optimal.amplitude[row],
        compared.curves[0].peak.amplitude if curve.peak.ok else np.nan,
    ]
    if peak.ok:
        assert stated == pytest.approx([peak.amplitude] * len(stated), rel=1e-3)
    else:
        assert not np.isfinite(stated).any()
    if in_time:
        assert study.time_response(curve).ok == peak.ok
    return found


def test_a_branch_that_only_lower_preloads_show():
    """An independent integration keeps 84.9 mm for 600 periods, the curve reaches 32.8 mm."""
    study = bd.load_study(MODELS / "study_followed.h5")
    preload = 0.09145101144214342
    interval = (0.06405198871972549, 0.8958762237234519)
    found = verdicts(study, preload, interval, in_time=True)
    assert set(found.values()) == {"followed"}, found
    curve = study.frequency_response(preload, interval)
    assert curve.amplitude.max() == pytest.approx(0.0328, rel=1e-2)
    assert study.peak(preload, interval).lower_bound == pytest.approx(0.084906, rel=1e-3)
    assert curve.status == "incomplete" and FOLLOWED in curve.reason
    assert "Lower bound" in str(curve) and "followed from" in str(curve)
