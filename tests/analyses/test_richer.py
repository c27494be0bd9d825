"""One question asked of two problems: what counts as an answer, and what changes."""

import numpy as np
import pytest

import bdamper as bd
from bdamper.analyses.error_estimates import evaluate_peak, whole_curve
from bdamper.response.followed_peak import highest_peak
from bdamper.response.highest_peak import found_at
from bdamper.response.linear_limits import resonance_interval
from bdamper.response.response_curve import frequency_response
from tests.models import wedge_model
from tests.plain import plain_study

BAND = (0.1, 0.35)


@pytest.fixture(scope="module")
def study():
    return bd.lumped(
        [[1.0]],
        [[0.05]],
        [[1.0]],
        contacts=[bd.Contact(normal=0, kn=0.5, gap=1.0)],
        forces={0: 0.1},
        harmonics=3,
    )


def test_a_failure_is_an_answer(study):
    def fails(problem):
        raise bd.BdamperError("nothing there")

    found = evaluate_peak(study.problem, fails)
    assert found.reason == "nothing there" and found.result is None and found.seconds >= 0.0
    assert np.isnan([found.amplitude, found.frequency]).all()


def test_curve_peak_and_numbers_are_read_alike(study):
    curve = evaluate_peak(study.problem, lambda p: frequency_response(p, 0.0, BAND))
    peak = evaluate_peak(study.problem, lambda p: highest_peak(p, 0.0, BAND))
    assert curve.reason == peak.reason == ""
    assert curve.amplitude == curve.result.peak.amplitude == pytest.approx(peak.amplitude, rel=1e-6)
    assert evaluate_peak(study.problem, lambda p: (peak.amplitude, peak.frequency))[:3] == peak[:3]
    # an end of the interval is no peak, and says so
    assert (
        "highest at an end"
        in evaluate_peak(study.problem, lambda p: highest_peak(p, 0.0, (0.1, 0.12))).reason
    )
    with pytest.raises(
        bd.BdamperError, match=r"no peak at 0 N between 0\.1 and 0\.12 Hz: the response"
    ):
        whole_curve(study.problem, 0.0, (0.1, 0.12))
    assert len(whole_curve(study.problem, 0.0, (0.1, 0.12), at_end=True))


def test_a_maximum_counts_where_an_end_is_higher():
    """As for the search for peaks: that end is a flank of the next mode."""
    study = plain_study(wedge_model(0), bd.Excitation("tip"), 2, friction_coefficient=0.4)
    band = resonance_interval(study.problem.at(1.0))[0], 1610.0
    found = evaluate_peak(study.problem, lambda p: whole_curve(p, 30e3, band))
    assert found.result.peak_at_end and found.reason == ""
    top = found_at(study.problem, 30e3, band).top.peak
    assert found.amplitude == pytest.approx(top.amplitude, rel=1e-8) != found.result.peak.amplitude
    assert study.peak(30e3, band).lower_bound == pytest.approx(
        found.result.peak.amplitude, rel=1e-8
    )


def test_a_list_of_two_numbers_is_an_answer_and_others_are_named(study):
    assert evaluate_peak(study.problem, lambda p: [0.1, np.float64(0.2)])[:3] == (0.1, 0.2, "")
    for wrong in ([0.1], "ab", None, [0.1, "x"]):
        found = evaluate_peak(study.problem, lambda p, answer=wrong: answer)
        assert (
            "expected a ResponseCurve, a Peak, or amplitude (m) and frequency (Hz), found"
            in found.reason
        )
