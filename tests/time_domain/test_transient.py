"""Steady motions and verdicts: amplitudes of which the end is known, and each rule at its bound."""

import numpy as np
import pytest

import bdamper as bd
from bdamper.contact.laws import LAW_SEPARABLE
from bdamper.time_domain.integration import AllSectors, IntegrationFailed, Motion
from bdamper.time_domain.transient import (
    AGREES,
    CRITERIA,
    DIFFERS,
    UNDECIDED,
    Transient,
    judged,
    outside,
    settle,
)
from tests.each import each
from tests.time_domain.test_integration import ALL_SECTORS, state, structure

TOLERANCE, LOOK = CRITERIA.tolerance, CRITERIA.look
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
    assert first_verdict(0.17 * np.sin(k * np.pi / 50.0), 100.0) == (DIFFERS, 4 * CRITERIA.window)
    assert first_verdict(0.04 * np.sin(k * np.pi / 15.0))[0] == AGREES, (
        "within the tolerance in all periods"
    )


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

    @pytest.mark.parametrize(
        ("change", "expected"), [(0.0015, AGREES), (0.008, UNDECIDED), (0.013, UNDECIDED)]
    )
    def test_a_steady_drift(self, sign, change, expected):
        """Over 80 periods; beside a fold a motion drifts so before it falls, unless it is rounding."""
        assert verdict(sign * change * np.arange(-96.0, 0.0) / 80.0) == expected

    def test_the_drift_is_relative_to_what_there_is(self, sign):
        """Changes of 0.9 % of the solution are 1.5 % of an amplitude of 0.6 times that, 0.6 % of one 1.4 times as high."""
        # a transient of 12 periods, of which 0.92 % lie between the means of the first and the last 16 periods
        off = sign * (0.4 - 0.0165 * np.exp(-np.arange(96.0) / 12.0))
        near = np.append(off[:80], off[80:])
        near[70] = 0.0  # otherwise the motion could simply have left
        assert verdict(near) == (DIFFERS if sign > 0.0 else UNDECIDED)

    @pytest.mark.parametrize(
        ("size", "expected"), [(4e-3, UNDECIDED), (4e-4, UNDECIDED), (4e-6, AGREES)]
    )
    def test_a_drift_that_speeds_up(self, sign, size, expected):
        """By a factor of e every 20 periods, up to less than 1 %; below 0.001 % that is rounding."""
        assert verdict(sign * size * np.exp(np.arange(-95.0, 1.0) / 20.0)) == expected

    def test_a_drift_that_slows_down(self, sign):
        """As fast as a transient does: seven tenths of a percent in all, nearly none of it at the end."""
        assert verdict(sign * 7e-3 * np.exp(-np.arange(96.0) / 20.0)) == AGREES

    @pytest.mark.parametrize(("number", "expected"), [(6, AGREES), (10, DIFFERS)])
    def test_single_periods_far_away(self, sign, number, expected):
        """One of ten may be farther away than twice the tolerance; the mean is that of the solution."""
        off = constant(0.0, 160)
        off[-40 : -40 + number] = sign * 0.12 * (-1.0) ** np.arange(number)
        assert verdict(off) == expected

    @pytest.mark.parametrize(
        ("range_", "growth", "n", "expected"),
        [
            (0.08, 40.0, 96, UNDECIDED),
            (0.08, 1e9, 96, AGREES),
            (0.08, -40.0, 96, AGREES),
            (0.04, 40.0, 96, AGREES),
            (0.12, 1e9, 96, UNDECIDED),
            (0.12, 1e9, 159, UNDECIDED),
            (0.12, 1e9, 160, AGREES),
            (0.12, 40.0, 160, UNDECIDED),
        ],
    )
    def test_a_beat_is_observed_for_longer(self, sign, range_, growth, n, expected):
        """The mean is that of the solution: a range above 5 % must not grow, and above 10 % is observed for 160 periods."""
        period = np.arange(float(n))
        # four periods with a mean of zero, so that the drift decides nothing
        beat = np.cos((period + 0.5) * np.pi / 2.0) * np.exp((period - n + 1.0) / growth)
        assert verdict(sign * range_ * beat / np.ptp(beat[-80:])) == expected

    @pytest.mark.parametrize(("other", "expected"), [(0.08, UNDECIDED), (0.06, AGREES)])
    def test_the_means_of_eighty_and_of_the_last_periods_must_say_the_same(
        self, sign, other, expected
    ):
        """The last are at 4 %, some before them farther away: 5.2 % or 4.6 % in the mean."""
        off = constant(sign * 0.04, 96)
        off[-40:-16] = sign * other
        assert verdict(off) == expected

    @pytest.mark.parametrize(("memory", "expected"), [(SHORT, UNDECIDED), (200.0, UNDECIDED)])
    def test_what_the_slowest_mode_still_adds(self, sign, memory, expected):
        """It is at 4.3 % and goes to 5.5 %, beyond the tolerance, whether its modes or its own rate show that."""
        off = sign * (0.055 - 0.02 * np.exp(-np.arange(96.0) / 200.0))
        assert abs(off).max() < 0.043 and verdict(off, memory) == expected

    def test_what_the_slowest_mode_adds_does_not_matter_to_single_periods_far_away(self, sign):
        off = sign * (0.055 - 0.02 * np.exp(-np.arange(96.0) / 200.0))
        off[-40:-30] += 0.2 * (-1.0) ** np.arange(10)
        assert verdict(off, 200.0) == DIFFERS

    @pytest.mark.parametrize(("memory", "expected"), [(SHORT, UNDECIDED), (200.0, UNDECIDED)])
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
        beats = np.where(self.k < 80.0, 0.12, 0.13) * np.sin(self.k * np.pi / 50.0) - 0.14 * (
            self.k >= 80.0
        )
        found, reason, _ = judged(1.0 + sign * beats[:160], 1.0, TOLERANCE, 1e9)
        assert found == DIFFERS and reason.startswith("wanders, ")


def test_reasons_name_the_distance():
    told = {
        "+30 %, not approaching the solution within 16 periods": constant(0.3, 48),
        "mean amplitude over 16 periods -30 % from the solution; too few periods": constant(
            -0.3, 16
        ),
        "+4 % so far; 96 periods show whether it has settled": constant(0.04, 48),
        "mean of 80 periods +4 %": constant(0.04, 96),
    }
    for reason, off in told.items():
        assert judged(1.0 + off, 1.0, TOLERANCE, SHORT)[1] == reason
    spread = judged(1.0 + 0.04 * (-1.0) ** np.arange(96), 1.0, TOLERANCE, SHORT)[1]
    assert spread.startswith("mean of 80 periods ") and spread.endswith(", -4 to +4 %")
    drifts = judged(1.0 + 2e-4 * np.arange(96), 1.0, TOLERANCE, 20.0)[1]
    assert (
        "changed by +1.6 % within 80 periods; a transient takes 20 periods to fall to 1/e" in drifts
    )


def test_what_is_not_a_number_decides_nothing():
    assert judged(np.full(200, np.nan), 1.0, TOLERANCE, SHORT)[0] == UNDECIDED


# ---- steady motions ----


class Known:
    """A transient of which the amplitude (m) of every period is known, and the part outside the wave of the excitation."""

    def __init__(self, amplitude, memory=20.0, away=lambda k: 0.0 * k):
        self.of_period, self.memory, self.harmonics, self.sectors, self.away = (
            amplitude,
            memory,
            [],
            self,
            away,
        )

    def advance(self, periods):
        self.harmonics.extend(range(len(self.harmonics), len(self.harmonics) + periods))

    @property
    def amplitude(self):
        return self.of_period(np.array(self.harmonics, float)) + np.zeros(len(self.harmonics))

    @property
    def blades(self):
        return np.array(self.harmonics, float)

    def departure(self, blades):
        return self.away(blades)


@each(("amplitude", "memory", "periods", "stays"), [
    (lambda k: 1.0, 20.0, 20, True),
    (lambda k: 1.0 + 0.3 * (-1.0) ** k, 20.0, 40, True),
    (lambda k: 1.0 - 1e-3 * k, 20.0, 240, True),  # never steady, and never fallen: 24 % in all
    (lambda k: np.where((k > 14.0) & (k < 20.0), 0.5, 1.0), 20.0, 80, True),  # a dip
    (lambda k: np.where(k < 12.0, 1.0, 0.2), 20.0, 20, False),
    (lambda k: np.where(k < 200.0, 1.0 - 1e-3 * k, 0.2), 20.0, 240, False),  # at the end the last quarter decides
    (lambda k: 0.69, 20.0, 20, False), (lambda k: 0.71, 20.0, 20, True),
    (lambda k: 3.9, 20.0, 20, True), (lambda k: 4.1, 20.0, 20, False),
])  # fmt: skip
def test_a_motion_is_integrated_until_it_is_steady_or_has_left(amplitude, memory, periods, stays):
    """An expected amplitude of 1 m."""
    transient = Known(amplitude, memory)
    point = settle(transient, 1.0)
    assert (len(transient.harmonics), point.stays) == (periods, stays)
    np.testing.assert_array_equal(point.amplitude, transient.amplitude[periods // 2 :])
    assert point.mean == point.amplitude.mean() and point.steady == (
        stays and abs(point.change) <= CRITERIA.drift
    )


@each("memory", [5.0, 20.0, 60.0, 150.0])
@each("size", [-0.2, -0.05, 0.05, 0.2, 0.5])
def test_a_steady_mean_is_the_limit_of_a_transient(memory, size):
    """Within the 1 % that may be to come, or the change that is stated, also if it takes longer than the periods."""
    point = settle(Known(lambda k: 1.0 + size * np.exp(-k / memory), memory), 1.0)
    assert point.stays and point.steady == (memory < 60.0 or (memory < 100.0 and abs(size) < 0.1))
    off = abs(point.mean - 1.0) / (CRITERIA.drift if point.steady else abs(point.change))
    assert off < 1.25


@each("period", [7.3, 13.0, 31.0, 47.0])
@each("size", [0.05, 0.2])
def test_a_steady_mean_is_that_of_many_beats(period, size):
    for phase in np.arange(6.0):
        point = settle(
            Known(lambda k, phase=phase: 1.0 + size * np.sin(2.0 * np.pi * k / period + phase)), 1.0
        )
        assert point.steady and abs(point.mean - 1.0) < 2.0 * CRITERIA.drift


@each(
    ("size", "rate", "periods"),
    [(0.02, 1.025, 240), (0.02, 1.003, 100), (0.02, 0.99, 100), (4e-5, 1.025, 60), (0.02, 0.9, 60)],
)
def test_integration_continues_while_blades_part(size, rate, periods):
    """By a tenth from a quarter to the next, and for a hundred periods, or fewer if the part is below a thousandth."""
    away = {"away": lambda k: size * rate**k}
    assert len(settle(Known(lambda k: 1.0 + 0.0 * k, **away), 1.0).transient.harmonics) == 20
    transient = settle(Known(lambda k: 1.0 + 0.0 * k, **away), 1.0, parting=True).transient
    n = len(transient.harmonics)
    grows, last = outside(transient, n // 4)
    assert n == periods and grows == pytest.approx(
        rate ** (n // 4) if last > 1e-3 else 0.0, rel=1e-9
    )
    assert last == pytest.approx(
        np.sqrt(np.mean(away["away"](np.arange(n - n // 4, n)) ** 2)), rel=1e-9
    )


@each(("memory", "periods"), [(1.0, 60), (8.0, 80), (12.0, 110)])
def test_a_mean_must_be_constant_for_forty_periods(memory, periods):
    """Without other waves the mean of the last three quarters, at least 40 periods, decides."""
    transient = Known(lambda k: 1.0 + 0.3 * np.exp(-k / memory), memory)
    point = settle(transient, 1.0, parting=True)
    n = len(transient.harmonics)
    assert n == periods and point.steady
    quarters = transient.amplitude[n - 3 * (n // 4) :].reshape(3, -1).mean(axis=1)
    assert np.ptp(quarters) <= 2.0 * CRITERIA.drift


# ---- transients of a structure ----


@pytest.fixture
def ring():
    return AllSectors(structure(laws=[LAW_SEPARABLE]), **ALL_SECTORS)


def test_a_sweep_is_one_integration_with_a_changing_frequency(ring):
    """In pieces of 16 periods, each counted; the square of the frequency is linear in the angle."""
    counted, transient = [], Transient(ring, 1.3, state(ring), 64)
    transient.sweep(1.6, 40, lambda: counted.append(1))
    whole = ring.integrate(state(ring), 1.3, 64, 40, omega_end=1.6)
    assert (len(counted), len(transient.harmonics), transient.omega) == (40, 40, 1.6)
    np.testing.assert_allclose(
        transient.harmonics, whole.harmonics, atol=1e-2 * np.abs(whole.harmonics).max()
    )


def test_the_blade_is_the_highest_of_the_second_half(ring):
    transient = Transient(ring, 1.3, state(ring), 64)
    transient.advance(8)
    means = np.abs(transient.blades[4:]).mean(axis=0)
    assert transient.blade == means.argmax() and np.ptp(means) > 0.1 * means.max()
    np.testing.assert_allclose(
        transient.amplitude, np.abs(transient.blades[:, transient.blade]), rtol=1e-12
    )
    other = Transient(ring, 1.3, state(ring), 64, blade=2)
    other.advance(8)
    turned = other.response * np.exp(1j * np.arange(4) * 2.0 * 2.0 * np.pi / ring.n)
    np.testing.assert_allclose(turned, np.array(other.harmonics)[:, 2], atol=1e-12)


def test_it_runs_to_a_number_of_periods_or_to_a_decision(ring):
    transient, asked = Transient(ring, 1.3, state(ring), 64), []
    assert transient.run(20, decided=lambda: bool(asked.append(len(transient.harmonics)))) is False
    assert asked == [16] and len(transient.harmonics) == 20
    assert transient.run(100, decided=lambda: True) is False and len(transient.harmonics) == 32


@each("share", [0.0, 20.0])
def test_a_motion_that_gains_energy_is_an_error(ring, monkeypatch, share):
    own, held = AllSectors.integrate, ring.energy(state(ring))

    def gains(*given, **asked):
        path = own(*given, **asked)
        return path._replace(energy=path.energy + [0.0, 0.0, 0.0, share * held])

    monkeypatch.setattr(AllSectors, "integrate", gains)
    transient = Transient(ring, 1.3, state(ring), 64)
    if not share:
        transient.advance(4)
        return
    with pytest.raises(
        IntegrationFailed, match=r"gains energy near 0.206901 Hz, .* raise steps_per_period, 64 now"
    ):
        transient.advance(4)


def test_a_motion_of_another_structure_is_refused(ring):
    motion = state(ring)
    with pytest.raises(bd.SettingError, match="start: the motion belongs to another study"):
        Transient(ring, 1.3, Motion(motion.q[1:], motion.v[1:], motion.w))
    with pytest.raises(bd.SettingError, match="start: the motion belongs to another study"):
        Transient(ring, 1.3, motion._replace(w=motion.w[1:]))
    with pytest.raises(
        bd.SettingError, match="steps_per_period: expected a whole number >= 16, found 15"
    ):
        Transient(ring, 1.3, motion, 15)
