"""Pieces of a response curve."""

from types import SimpleNamespace

import numpy as np
import pytest

import bdamper as bd
from bdamper.harmonic_balance.equations import OK, Correction
from bdamper.response.branches import NO_SOLUTION, Coverage, LeftOut, Piece
from bdamper.response.events import Path
from bdamper.response.response_curve_result import ResponseCurve


def test_a_piece_that_is_not_the_first_is_dropped_where_the_last_one_arrives():
    def piece(start, end, branch):
        ends = (np.array([0.1, 0.2, w]) for w in (start, end))
        points = tuple(Correction(OK, y, y, np.ones(3), 1, 0.0, 0) for y in ends)
        return Piece(Path(points, "complete", "", 1, 0), True, branch, False)

    search = object.__new__(Coverage)
    search.pieces = [piece(1.0, 2.0, 0), piece(4.0, 5.0, 1), piece(3.0, 4.0, 2)]
    search.drop_repeated()
    assert [p.branch for p in search.pieces] == [0, 1] and search.pieces[1].path.points[0].y[
        -1
    ] == 3.0


@pytest.mark.slow
def test_a_branch_that_comes_back_on_the_way_out_of_the_interval_ends_there():
    """It turns above 761 Hz and comes back at the limit, which its path leaves at once."""
    study = bd.Study(bd.reference_model("turbine_blade"), bd.Excitation("tip"), 5, 0.3, harmonics=3)
    curve = study.frequency_response(10.0, (556.0, 761.0))
    assert curve.complete and curve.frequency.max() == 761.0


@pytest.mark.parametrize(
    ("why", "at_end"), [(NO_SOLUTION, True), ("a closed branch was not followed", False)]
)
def test_the_highest_point_beside_a_gap_is_no_peak(why, at_end):
    """The response may rise further in the gap."""
    frequency = np.array([300.0, 310.0, 320.0, 330.0])
    curve = SimpleNamespace(frequency=frequency, peak_index=1, kind="response", point_kind=["point"] * 4,
                            missing_ranges=(LeftOut(310.0, 320.0, why),))  # fmt: skip
    assert ResponseCurve.peak_at_end.fget(curve) == at_end
