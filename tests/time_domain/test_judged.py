"""Verdicts on amplitudes in time: sequences of which the end is known, and each rule at its bound."""

import numpy as np
import pytest

from bdamper.time_domain.march import AGREES, DIFFERS, LIMITS, UNDECIDED, judged
from tests.each import each

TOLERANCE, LOOK = LIMITS.tolerance, LIMITS.look
SHORT = 1.0  # memory (periods) of a structure whose transients have gone


def verdict(off, memory=SHORT, tolerance=TOLERANCE):
    """Verdict on amplitudes that differ from the expected one by these relative amounts."""
    return judged(1.0 + np.asarray(off, float), 1.0, tolerance, memory)[0]


def first_verdict(off, memory=SHORT):
    """First decision of looks after every 16 periods, and how many it has taken."""
    found = ((verdict(off[:n], memory), n) for n in range(LOOK, len(off) + 1, LOOK))
    return next((pair for pair in found if pair[0] != UNDECIDED), (UNDECIDED, len(off)))


def constant(value, n):
    return np.full(n, value)


@each("memory", [10.0, 60.0, 200.0])
@each("size", [-0.5, -0.1, 0.1, 0.5])
@each("limit", [-0.3, -0.11, -0.08, -0.06, -0.04, 0.0, 0.04, 0.06, 0.08, 0.11, 0.3])
def test_a_transient_ends_with_the_verdict_on_its_limit(limit, size, memory):
    """It falls to 1/e within the memory; whatever it is on its way, the limit alone counts."""
    found, _ = first_verdict(limit + size * np.exp(-np.arange(1000.0) / memory), memory)
    assert found == (AGREES if abs(limit) <= TOLERANCE else DIFFERS)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("rate", [20.0, 40.0])
def test_a_disturbance_that_grows_does_not_agree(sign, rate):
    """From a thousandth on, to where it stays; at first every period is within the tolerance."""
    off = sign * np.minimum(1e-3 * np.exp(np.arange(1000.0) / rate), 0.4)
    found, periods = first_verdict(off)
    assert found == DIFFERS and abs(off[3 * LOOK - 1]) < 2.0 * TOLERANCE and periods >= 6 * LOOK


def test_a_decaying_beat_agrees_and_a_lasting_one_does_not():
    """Of 30 and 100 periods.  The first decays as the slowest mode does, so it is no sign of another motion."""
    k = np.arange(1000.0)
    assert first_verdict(0.9 * np.exp(-k / 100.0) * np.cos(k * np.pi / 15.0), 100.0)[0] == AGREES
    assert first_verdict(0.17 * np.sin(k * np.pi / 50.0), 100.0) == (DIFFERS, 2 * LIMITS.settled)
    assert first_verdict(0.04 * np.sin(k * np.pi / 15.0))[0] == AGREES, "within the tolerance in all periods"


def test_the_scale_is_that_of_the_solution():
    x = constant(1.04, 96)
    assert judged(2.0**-20 * x, 2.0**-20, TOLERANCE, SHORT) == judged(x, 1.0, TOLERANCE, SHORT)
    assert judged(x, 0.5, TOLERANCE, SHORT)[0] == judged(x, 2.0, TOLERANCE, SHORT)[0] == DIFFERS
    assert judged(x, 0.0, TOLERANCE, SHORT)[0] == DIFFERS, "no solution of amplitude 0 is kept"


@pytest.mark.parametrize("sign", [1.0, -1.0])
class TestLeft:
    """Farther away than twice the tolerance for 32 periods, without a way back: decided from 48 periods on."""

    @each(("n", "size", "expected"), [
        (47, 0.3, UNDECIDED), (48, 0.3, DIFFERS), (48, 0.101, DIFFERS), (48, 0.099, UNDECIDED), (95, 0.099, UNDECIDED),
    ])  # fmt: skip
    def test_when_it_is_decided(self, sign, n, size, expected):
        assert verdict(constant(sign * size, n)) == expected

    def test_the_first_periods_do_not_count(self, sign):
        assert verdict(sign * np.append(constant(0.0, 16), constant(0.3, 32))) == DIFFERS
        assert verdict(sign * np.append(constant(0.0, 17), constant(0.3, 31))) == UNDECIDED

    @pytest.mark.parametrize("at", [16, 31, 47])
    def test_one_period_that_is_near_leaves_it_open(self, sign, at):
        off = constant(sign * 0.3, 48)
        off[at] = sign * 0.09
        assert verdict(off) == UNDECIDED

    def test_a_way_back_leaves_it_open(self, sign):
        nearer, farther = constant(0.30, 16), constant(0.31, 16)
        assert verdict(sign * np.concatenate([farther, farther, nearer])) == UNDECIDED
        assert verdict(sign * np.concatenate([nearer, nearer, farther])) == DIFFERS

    def test_it_may_pass_the_solution(self, sign):
        """From one side of the solution to the other; a distance is one on either."""
        off = sign * np.concatenate([constant(0.0, 16), constant(0.2, 16), constant(-0.3, 16)])
        assert verdict(off) == DIFFERS
        assert verdict(off[::-1] + 0.0) == UNDECIDED, "it ends at the solution"

    def test_twice_a_given_tolerance(self, sign):
        assert verdict(constant(sign * 0.3, 48), tolerance=0.2) == UNDECIDED
        assert verdict(constant(sign * 0.3, 48), tolerance=0.1) == DIFFERS


@pytest.mark.parametrize("sign", [1.0, -1.0])
class TestSettled:
    """Means of 16 periods that change by less than 1 % within 80, and no faster at the end: decided from 96 periods on."""

    @each(("n", "size", "expected"), [
        (95, 0.0, UNDECIDED), (96, 0.0, AGREES), (96, 0.049, AGREES), (96, 0.051, DIFFERS), (96, 0.099, DIFFERS),
    ])  # fmt: skip
    def test_when_it_is_decided(self, sign, n, size, expected):
        assert verdict(constant(sign * size, n)) == expected

    def test_a_given_tolerance(self, sign):
        assert verdict(constant(sign * 0.15, 96), tolerance=0.2) == AGREES
        assert verdict(constant(sign * 0.015, 96), tolerance=0.01) == DIFFERS

    @pytest.mark.parametrize(("change", "expected"), [(0.008, AGREES), (0.013, UNDECIDED)])
    def test_a_steady_drift(self, sign, change, expected):
        """Over 80 periods; of a transient that is too slow to be one of the structure."""
        assert verdict(sign * change * np.arange(-96.0, 0.0) / 80.0) == expected

    def test_the_drift_is_relative_to_what_there_is(self, sign):
        """Changes of 0.9 % of the solution are 1.5 % of an amplitude of 0.6 times that, 0.6 % of one 1.4 times as high."""
        off = sign * 0.4 + sign * 0.009 * np.arange(-95.0, 1.0) / 80.0
        near = np.append(off[:80], off[80:])
        near[70] = 0.0  # so that it has not simply left
        assert verdict(near) == (DIFFERS if sign > 0.0 else UNDECIDED)

    @pytest.mark.parametrize(("size", "expected"), [(4e-3, UNDECIDED), (4e-4, AGREES)])
    def test_a_drift_that_speeds_up(self, sign, size, expected):
        """By a factor of e every 20 periods, up to less than 1 %; below 0.1 % that is rounding."""
        assert verdict(sign * size * np.exp(np.arange(-95.0, 1.0) / 20.0)) == expected

    def test_a_drift_that_slows_down(self, sign):
        """As fast as a transient does: seven tenths of a percent in all, nearly none of it at the end."""
        assert verdict(sign * 7e-3 * np.exp(-np.arange(96.0) / 20.0)) == AGREES

    @pytest.mark.parametrize(("number", "expected"), [(6, AGREES), (10, DIFFERS)])
    def test_single_periods_far_away(self, sign, number, expected):
        """One of ten may be farther away than twice the tolerance; the mean is that of the solution."""
        off = constant(0.0, 96)
        off[-40 : -40 + number] = sign * 0.12 * (-1.0) ** np.arange(number)
        assert verdict(off) == expected

    @pytest.mark.parametrize(("other", "expected"), [(0.08, UNDECIDED), (0.06, AGREES)])
    def test_the_means_of_eighty_and_of_the_last_periods_must_say_the_same(self, sign, other, expected):
        """The last are at 4 %, some before them farther away: 5.2 % or 4.6 % in the mean."""
        off = constant(sign * 0.04, 96)
        off[-40:-16] = sign * other
        assert verdict(off) == expected

    @pytest.mark.parametrize(("memory", "expected"), [(SHORT, AGREES), (200.0, UNDECIDED)])
    def test_what_the_slowest_mode_still_adds(self, sign, memory, expected):
        """It is at 4.3 % and goes to 5.5 %: within the tolerance only if nothing is to come."""
        off = sign * (0.055 - 0.02 * np.exp(-np.arange(96.0) / 200.0))
        assert abs(off).max() < 0.043 and verdict(off, memory) == expected

    def test_what_the_slowest_mode_adds_does_not_matter_to_single_periods_far_away(self, sign):
        off = sign * (0.055 - 0.02 * np.exp(-np.arange(96.0) / 200.0))
        off[-40:-30] += 0.2 * (-1.0) ** np.arange(10)
        assert verdict(off, 200.0) == DIFFERS

    @pytest.mark.parametrize(("memory", "expected"), [(SHORT, DIFFERS), (200.0, UNDECIDED)])
    def test_what_the_slowest_mode_takes_away(self, sign, memory, expected):
        """It is at 5.7 % and goes to 4.5 %."""
        off = sign * (0.045 + 0.02 * np.exp(-np.arange(96.0) / 200.0))
        assert abs(off).min() > 0.057 and verdict(off, memory) == expected


class TestWanders:
    """Farther away than twice the tolerance in the last 80 periods, over a range that no decay of the 80 before leaves."""

    k = np.arange(400.0)

    def test_when_it_is_decided(self):
        beats = 0.17 * np.sin(self.k * np.pi / 50.0)
        assert verdict(beats[:159], 20.0) == UNDECIDED and verdict(beats[:160], 20.0) == DIFFERS

    @pytest.mark.parametrize(("memory", "expected"), [(60.0, DIFFERS), (100.0, UNDECIDED)])
    def test_a_beat_that_decays_is_compared_with_the_slowest_mode(self, memory, expected):
        """By a factor of e within 100 periods: slower than a structure of a memory of 60 allows."""
        beats = 0.5 * np.exp(-self.k / 100.0) * np.sin(self.k * np.pi / 50.0 + 0.3)
        assert verdict(beats[:160], memory) == expected

    def test_a_beat_within_twice_the_tolerance_does_not_wander(self):
        assert verdict(0.095 * np.sin(self.k * np.pi / 50.0)[:160], 20.0) == UNDECIDED

    def test_a_long_memory_leaves_at_most_what_there_was(self):
        """Without an end to the transients a beat of constant size could be one; one that grows is none."""
        for rate in (300.0, 1500.0):
            growing = 0.15 * np.exp(self.k / rate) * np.sin(self.k * np.pi / 50.0)
            assert verdict(growing[:160], 1e9) == DIFFERS

    @pytest.mark.parametrize("sign", [1.0, -1.0])
    def test_either_side_of_the_solution_counts(self, sign):
        """A beat of somewhat larger range that moves away to one side, while it comes nearer on the other."""
        beats = np.where(self.k < 80.0, 0.12, 0.13) * np.sin(self.k * np.pi / 50.0) - 0.14 * (self.k >= 80.0)
        found, reason = judged(1.0 + sign * beats[:160], 1.0, TOLERANCE, 1e9)
        assert found == DIFFERS and reason.startswith("wanders, ")


def test_reasons_name_the_distance():
    told = {
        "+30 %, and no way back within 16 periods": constant(0.3, 48),
        "-30 % in the mean of 16 periods; at least 48 decide": constant(-0.3, 16),
        "+4 % so far; 96 periods show whether it has settled": constant(0.04, 48),
        "+4 % in the mean of 80 periods": constant(0.04, 96),
    }
    for reason, off in told.items():
        assert judged(1.0 + off, 1.0, TOLERANCE, SHORT)[1] == reason
    spread = judged(1.0 + 0.04 * (-1.0) ** np.arange(96), 1.0, TOLERANCE, SHORT)[1]
    assert spread.endswith("in the mean of 80 periods, -4 to +4 %")
    drifts = judged(1.0 + 2e-4 * np.arange(96), 1.0, TOLERANCE, 20.0)[1]
    assert "changed by +1.6 % within 80 periods; a transient takes 20 periods to fall to 1/e" in drifts


def test_what_is_not_a_number_decides_nothing():
    assert judged(np.full(200, np.nan), 1.0, TOLERANCE, SHORT)[0] == UNDECIDED
