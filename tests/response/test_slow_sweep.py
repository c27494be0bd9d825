"""Slow sweeps of frequency along a curve with two folds."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import bdamper as bd
from bdamper.response.response_curve import sweep_of
from bdamper.util.errors import SettingError
from bdamper.util.formatting import amount
from tests.plain import plain_study
from tests.printed import said


@pytest.fixture(scope="module")
def study():
    excitation = bd.Excitation("tip", "tangential")
    return plain_study(bd.reference_model(), excitation, engine_order=5, friction_coefficient=0.4)


@pytest.fixture(scope="module")
def curve(study):
    return study.frequency_response(125.0, (250.0, 400.0))


def test_a_sweep_keeps_its_branch_until_the_fold(curve):
    upper, lower = curve.frequency[curve.folds]
    up, down = sweep_of(curve, "up"), sweep_of(curve, "down")
    assert (np.diff(up.frequency) >= 0.0).all() and (np.diff(down.frequency) <= 0.0).all()
    assert (up.frequency[0], up.frequency[-1]) == (down.frequency[-1], down.frequency[0])
    assert [jump.frequency for jump in up.jumps] == [upper] and [
        jump.frequency for jump in down.jumps
    ] == [lower]
    assert (
        up.jumps[0].after > up.jumps[0].before and down.jumps[0].after < 0.1 * down.jumps[0].before
    )
    assert (
        down.amplitude.max() == curve.peak.amplitude
        and up.amplitude.max() < 0.51 * curve.peak.amplitude
    )
    # outside of the folds both show the same, between them each its branch
    np.testing.assert_array_equal(
        up.amplitude[up.frequency < 300.0], down.amplitude[down.frequency < 300.0][::-1]
    )
    largest = max((*up.jumps, *down.jumps), key=lambda jump: abs(jump.after - jump.before))
    size = amount(abs(largest.after - largest.before), "m")
    place = f"largest jump of a slow sweep, at {amount(largest.frequency, 'Hz')}"
    assert f"Jump {size} {place}" in said(curve)


def test_a_sweep_leaves_a_branch_where_stability_is_lost_and_ends_where_nothing_is_stable(curve):
    stable = ~curve.backward
    stable[(curve.frequency > 310.0) & (curve.amplitude > 1.25e-4)] = False
    judged = replace(curve, unstable=~stable)
    down = sweep_of(judged, "down")
    assert down.jumps[0].frequency == pytest.approx(319.6, abs=1.0)
    assert down.jumps[0].after < down.jumps[0].before < 1.25e-4
    stable[curve.frequency < 330.0] = False
    judged = replace(curve, unstable=~stable)
    down = sweep_of(judged, "down")
    assert len(down.jumps) == 1 and np.isnan(down.jumps[0].after)
    assert 330.0 <= down.frequency[-1] < 335.0
    assert not len(sweep_of(judged, "up").frequency)


def branches(*parts):
    """A curve of parts (frequency, amplitude, stable), its branches, with folds where the frequency turns."""
    frequency, height, stable, fold = [], [], [], []
    for f, a, s in parts:
        f = np.asarray(f, float)
        frequency.append(f)
        height.append(np.asarray(a, float))
        stable.append(np.broadcast_to(s, f.shape))
        fold.append(np.concatenate([[False], np.diff(f)[1:] * np.diff(f)[:-1] < 0.0, [False]]))
    branch = np.repeat(np.arange(len(parts)), [len(f) for f in frequency])
    kind = tuple("fold" if turns else "regular" for turns in np.concatenate(fold))
    columns = {
        "frequency": np.concatenate(frequency),
        "amplitude": np.concatenate(height),
        "branch": branch,
    }
    return SimpleNamespace(
        **columns, unstable=~np.concatenate(stable).astype(bool), point_kind=kind
    )


def test_a_jump_goes_to_the_nearest_lower_of_several_stable_solutions():
    s_shaped = (
        [0, 2, 5, 4, 2, 6, 9],
        [2.0, 2.2, 2.5, 3.0, 3.5, 5.0, 6.0],
        [True, True, False, False, False, True, True],
    )
    low, lower = ([3, 9], [1.0, 1.6], True), ([4, 9], [0.5, 0.5], True)
    sweep = sweep_of(branches(s_shaped, low, lower), "up")
    (jump,) = sweep.jumps
    assert (jump.frequency, jump.before) == (5.0, 2.5) and jump.after == pytest.approx(1.2)
    assert sweep.frequency[-1] == 9.0 and sweep.amplitude[-1] == 1.6
    (jump,) = sweep_of(
        branches(s_shaped, ([4, 9], [8.0, 8.0], True)), "up"
    ).jumps  # none is lower: the nearest higher one
    assert jump.after == pytest.approx(4.625)


def test_nothing_is_stable_between_two_folds_that_follow_each_other():
    s_shaped = [0, 3, 5, 4, 6, 9], [2.0, 2.2, 2.5, 3.0, 5.0, 6.0], True
    ends = [0, 4.5, 9], [1.0, 1.0, 1.0], [True, True, False]
    (first, second) = sweep_of(branches(s_shaped, ends), "up").jumps
    assert (first.frequency, second.frequency) == (4.5, 5.0)


def test_of_several_stable_solutions_the_lowest_is_that_of_the_beginning(study):
    part = study.frequency_response(125.0, (295.0, 320.0))
    down = sweep_of(part, "down")
    there = part.amplitude[(part.frequency == part.frequency.max()) & ~part.backward]
    assert len(there) == 2 and down.amplitude[0] == there.min() and not down.jumps


def test_what_comes_back_from_a_fold_outside_is_labelled_as_on_the_wide_curve(study, curve):
    """The branch runs back up to its fold in the interval, and forward beyond."""
    for band in ((295.0, 320.0), (300.0, 400.0), (310.0, 330.0)):
        narrow = study.frequency_response(125.0, band)
        for f, a, backward, kind in zip(
            narrow.frequency, narrow.amplitude, narrow.backward, narrow.point_kind
        ):
            if kind in ("regular", "maximum"):
                near = np.argmin(
                    np.hypot(curve.frequency / f - 1.0, 0.1 * np.log(curve.amplitude / a))
                )
                if (
                    "regular" in curve.point_kind[near]
                    and abs(f - 303.6) > 1.0
                    and abs(f - 325.0) > 3.0
                ):
                    assert backward == curve.backward[near]


def test_directions_are_up_and_down(curve):
    with pytest.raises(SettingError, match="direction"):
        sweep_of(curve, "left")
