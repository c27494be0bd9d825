"""Labels of the difficult disk whose stability one harmonic leaves open, against integrations from single points."""

import numpy as np
import pytest

import bdamper as bd
from bdamper.time_domain.transient import AGREES
from tests.hard.random_studies import FULL
from tests.plain import plain_study
from tests.time_domain.test_in_time import at


@pytest.mark.skipif(not FULL, reason="three minutes: make hard")
def test_labels_of_a_curve():
    model = bd.reference_model("bladed_disk", 9)
    study = plain_study(model, bd.Excitation("tip"), engine_order=5, friction_coefficient=0.4)
    curve = study.frequency_response(2000.0, (346.0, 358.0))
    judged = study.with_stability(curve, in_time=True)
    labels, ratio = judged.labels, judged.in_time
    assert "points integrated" in judged.stability_note and "in_time" in judged.columns()
    assert labels[at(curve, 352.3, 0)] == "stable" and ratio[at(curve, 352.3, 0)] == pytest.approx(
        1.0, abs=1e-3
    )
    assert labels[at(curve, 352.3, 1)] == labels[at(curve, 352.3, 2)] == "unstable"
    assert labels[at(curve, 356.5, 0)] == "stable"
    decided = np.isfinite(ratio)
    np.testing.assert_array_equal(judged.unstable[decided], labels[decided] == "unstable")
    # every point for itself: the same
    for i in range(0, len(curve), 9):
        if decided[i]:
            assert (study.motion_in_time(curve, i).verdict == AGREES) != judged.unstable[i]
