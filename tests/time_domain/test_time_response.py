"""What a blade keeps: levels of a curve, the walk to the fall of one mass, the reference disk."""

from dataclasses import replace
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from tests.time_domain.test_march import structure
from tests.time_domain.test_time_sweep import F0, W0, one_mass

import bdamper as bd
from bdamper.response.events import ContinuationOptions
from bdamper.time_domain import steady_amplitude as room
from bdamper.time_domain.steady_amplitude import CurveAmplitudes
from bdamper.util.progress import Cost
from tests.each import each
from tests.marches import fails_after


@pytest.fixture(scope="module")
def bent():
    """A spring that is pressed on opens at large amplitudes: the resonance bends to lower frequencies and folds."""
    study = one_mass(normal=0, kn=0.5 * W0**2, preload=5.0)
    return study, study.replace(harmonics=5).frequency_response(0.0, (9.0, 14.0))


@pytest.fixture(scope="module")
def walked(bent):
    study, curve = bent
    return study.replace(harmonics=5).time_response(curve)


def test_levels_and_sides_of_a_curve(bent):
    _, curve = bent
    levels, (low, high) = CurveAmplitudes(curve), sorted(curve.frequency[curve.folds])
    assert len(levels.at(0.5 * (low + high))) == 3 and len(levels.at(high + 0.1)) == 1
    middle = levels.at(0.5 * (low + high))
    assert list(middle) == sorted(middle, reverse=True)
    assert levels.lower(0.5 * (low + high), middle[0]) == middle[1] and levels.lower(high + 0.1, 1.0) < 1.0
    width, start = levels.side(1.0)
    assert (
        width > 0.0
        and start > high
        and levels.at(curve.peak.frequency + width)[0] == pytest.approx(curve.peak.amplitude / np.sqrt(2.0), rel=0.05)
    )
    assert np.isnan(levels.side(-1.0)[1]), "to the other side the branch ends at its fold"


def test_one_mass_keeps_its_branch_to_the_fold(bent, walked):
    """Its motion is periodic: what is kept is the branch of five harmonics, and it falls at the fold of that."""
    _, curve = bent
    assert walked.status == "complete" and walked.direction == "down" and walked.diameters == (0,)
    low = curve.frequency[curve.folds].min()
    assert low - 0.15 < walked.fall < walked.frequency and walked.frequency == pytest.approx(low, abs=0.25)
    on = CurveAmplitudes(curve).at(walked.frequency)
    assert walked.mean == pytest.approx(on[0], rel=0.02) and walked.highest < 1.01 * walked.mean
    assert walked.balance == curve.peak.amplitude and 0.9 < walked.factor <= 1.01
    said = walked._headline()
    assert "The motion jumps to a lower amplitude at" in said and f"in time the highest blade has {walked.text}" in said
    assert said.split(";")[0] in str(walked)
    doubtful = replace(walked, status="incomplete: some steps failed")._headline()
    assert "(incomplete: some steps failed). The motion jumps" in doubtful and "complete" not in said
    assert walked.summary().count("diameters") == walked.summary().count("mean") == 1


def test_a_kept_motion_marks_a_picture(bent, walked):
    ax = walked.mark(bent[1].plot())
    assert "highest blade in time, and range" in ax.get_legend_handles_labels()[1]
    plt.close("all")


def test_a_peak_whose_contacts_stay_closed_is_integrated_too():
    study = one_mass(tangential=0, kt=1e-3, mu=0.3, preload=1e3)
    found = study.time_response(study.frequency_response(0.0, (9.5, 10.5)))
    assert found.periods > 0 and found.factor == pytest.approx(1.0, rel=0.01)


@pytest.mark.slow
def test_one_harmonic_may_be_wrong_where_contacts_stay_closed():
    """Without folds and separation it has a sixth more than the motion in time."""
    turbine = bd.Study(
        bd.reference_model("turbine_blade", 9), bd.Excitation("tip", direction="tangential"), 5, harmonics=1,
        friction_coefficient=0.3, contact_stiffness="unit_traction", blade_modes=5,
    )  # fmt: skip
    curve = turbine.frequency_response(125.0, (610.0, 710.0))
    assert not len(curve.folds) and not curve.shares[:, 2].any()
    walked = turbine.time_response(curve)
    assert walked.mean < 0.9 * curve.peak.amplitude
    assert walked.mean == pytest.approx(turbine.settle(curve, walked.frequency).mean, rel=0.02)


def test_a_contact_without_friction_that_opens_is_marched():
    """Shares of the cycle count points with friction alone: of this one they say nothing."""
    contact = bd.Contact(normal=0, kn=0.5 * W0**2, preload=5.0)
    study = bd.lumped([1.0], [0.2 * W0], [W0**2], contacts=[contact], forces={0: 20.0}, harmonics=3)
    curve = study.frequency_response(0.0, (6.0, 15.0))
    assert not len(curve.folds) and not curve.shares[:, 2].any()
    found = study.time_response(curve)
    assert found.mean == pytest.approx(curve.peak.amplitude, rel=0.02)


def test_long_transients_take_more_periods():
    """With 0.1 % of damping a transient is seen in part within 40 periods, and the motion seemed to fall at once."""
    contact = bd.Contact(normal=0, kn=0.5 * W0**2, preload=5.0)
    study = bd.lumped([1.0], [2e-3 * W0], [W0**2], contacts=[contact], forces={0: 0.05}, harmonics=3)
    curve = study.frequency_response(0.0, (11.0, 13.0))
    assert study.time_response(curve).mean > 0.8 * curve.peak.amplitude
    assert room.CRITERIA.stretched(93.0) == room.CRITERIA and room.CRITERIA.stretched(200.0).window == 80
    assert room.CRITERIA.stretched(1e9).most == 4 * room.CRITERIA.most


def test_what_leaves_the_answer_open_is_its_status(bent, monkeypatch):
    study, curve = bent
    study = study.replace(harmonics=5)
    monkeypatch.setattr(room, "CRITERIA", room.SteadyCriteria(drift=1e-12, steady=0.0, most=160))
    assert study.time_response(curve).status.startswith("incomplete: its mean still changes by ")


@pytest.mark.parametrize("calls", [3, 500])
def test_where_a_march_fails_nothing_is_kept(bent, monkeypatch, calls):
    """At the first place, and after some that stay."""
    study, curve = bent
    fails_after(monkeypatch, calls)
    found = study.replace(harmonics=5).time_response(curve)
    assert found.status.startswith("not found: the time integration fails near ")
    assert found.status.endswith("raise steps_per_period")
    assert all(np.isnan(x) for x in (found.mean, found.lowest, found.highest, found.frequency, found.fall))
    assert found.text == found.status


def test_a_motion_that_leaves_the_balance_at_once_says_so(bent, monkeypatch):
    study, curve = bent
    visit = room.TipSearch.integrate_at
    falls = lambda *given, **asked: visit(*given, **asked)._replace(stays=False)  # noqa: E731
    monkeypatch.setattr(room.TipSearch, "integrate_at", falls)
    found = study.replace(harmonics=5).time_response(curve)
    assert ", but the amplitude in time becomes " in found.status and found.status.endswith("use more harmonics")
    said = "At 0 N the amplitude in time is not known, so nothing confirms the peak of the harmonic balance: at "
    assert found._headline().startswith(said)


def test_a_motion_that_grows_beyond_all_bounds_says_so(bent, monkeypatch):
    """As one does of which unresolved contacts gain energy; it is no motion that a blade keeps."""
    study, curve = bent
    monkeypatch.setattr(room, "CRITERIA", room.SteadyCriteria(grown=0.9))
    status = study.replace(harmonics=5).time_response(curve).status
    assert status.startswith("not found: at ") and "an error of its time steps: use more steps" in status


def test_a_response_so_flat_that_it_has_no_half_width_is_walked_along():
    """Ten per cent lower at the end of the curve, with a lower solution up to 103 Hz: the walk starts where that ends."""
    flat = object.__new__(CurveAmplitudes)
    flat.frequency = np.array([101.0, 106.0, 111.0, 95.0, 103.0])
    flat.amplitude, flat.branch, flat.top = np.array([1.0, 0.95, 0.9, 0.3, 0.5]), np.array([0, 0, 0, 1, 1]), 0
    width, start = flat.side(1.0)
    assert start == pytest.approx(103.0, abs=0.05) and width == pytest.approx(2.0 * (start - 101.0))
    flat.frequency[4] = 101.5
    assert flat.side(1.0)[1] == pytest.approx(101.0 * 1.01), "never nearer than that to the tip"


def test_the_walk_ends_beyond_the_tip_where_there_is_nothing_to_fall_to():
    """One branch that falls from 1 to 0.6 between 101 and 111 Hz, beside which another lies from 106 to 107 Hz or later."""
    levels = object.__new__(CurveAmplitudes)
    levels.frequency = np.array([101.0, 106.0, 111.0, 106.0, 107.0])
    levels.amplitude, levels.branch, levels.top = np.array([1.0, 0.8, 0.6, 0.3, 0.3]), np.array([0, 0, 0, 1, 1]), 0
    on = room.SteadyPoint(105.0, np.full(80, 0.84), True, None)
    assert not levels.alone(on, 0.1), "another level comes before it is a tenth lower"
    assert not levels.alone(on._replace(frequency=106.5, amplitude=np.full(80, 0.78)), 0.1), "and is there already"
    assert levels.alone(on, -0.1), "to the other side there is none"
    levels.frequency[3:] += 3.0
    assert levels.alone(on, 0.1) and not levels.alone(on._replace(amplitude=np.full(80, 1.2)), 0.1), "off its branch"


def test_nodal_diameters_that_a_model_does_not_carry_are_said(bent, monkeypatch):
    study, curve = bent
    ring = SimpleNamespace(nodal_diameters=(0, 5), n=13, cost=Cost())
    monkeypatch.setattr(room, "ring_of", lambda *_: ring)
    for name in ("approach", "from_tip"):
        monkeypatch.setattr(room.TipSearch, name, lambda *_: None)
    monkeypatch.setattr(room.TipSearch, "highest", lambda _: room.SteadyPoint(11.0, np.ones(80), True, None))
    monkeypatch.setattr(room.TipSearch, "verify", lambda *_: None)
    monkeypatch.setattr(room.TipSearch, "open_question", lambda *_: "")
    found = study.replace(harmonics=5).time_response(curve)
    assert found.status == "complete: 2 of 7 nodal diameters were marched" and found.mean == 1.0


def test_a_motion_that_stays_in_long_steps_alone_says_so(bent, monkeypatch):
    study, curve = bent
    monkeypatch.setattr(room.TipSearch, "highest", lambda _: None)
    status = study.replace(harmonics=5).time_response(curve).status
    assert status == "not found: no motion stays in steps of half the length: use more steps_per_period"


def test_shorter_steps_are_taken_wherever_they_could_find_more(monkeypatch):
    """The highest in long steps loses a tenth in short ones, the second falls; a fourth cannot be higher than the third."""
    search, asked, short = room.TipSearch(None, _Amplitudes(), 4), [], {101.0: 9.0, 102.0: np.nan, 103.0: 9.7, 104.0: 9.3}
    motion = room.Motion(*[None] * len(room.Motion._fields))
    search.places = [room.SteadyPoint(f, np.array([m]), True, motion) for f, m in zip(short, (10.0, 9.9, 9.8, 9.4))]

    def visit(frequency, start, own, finer):
        asked.append(frequency)
        return room.SteadyPoint(frequency, np.array([short[frequency]]), bool(np.isfinite(short[frequency])), motion)

    monkeypatch.setattr(search, "integrate_at", visit)
    search.fall = 99.0
    assert search.highest().frequency == 103.0 and asked == [101.0, 102.0, 103.0]
    assert search.answers == {"8 steps": 9.7}
    assert search.fall == 99.0, "what fell lies before it"
    search.places.reverse()
    assert search.highest().frequency == 103.0 and search.fall == 102.0


def test_the_way_from_one_frequency_to_the_next_is_a_sweep(bent, monkeypatch):
    """A jump of the frequency would throw off motions that a slow sweep keeps."""
    swept, sweep = [], room.March.sweep
    monkeypatch.setattr(room.March, "sweep", lambda march, ends, *rest: swept.append(ends) or sweep(march, ends, *rest))
    search = room.TipSearch(room.ring_of(bent[0].replace(harmonics=5).problem, 0.0), CurveAmplitudes(bent[1]), 64)
    f = search.balance.frequency[search.balance.top] + 1.5
    first = search.integrate_at(f, search.balance.start(f), search.balance.at(f)[0])
    periods = search.periods
    search.follow(first, f - 0.2)
    assert swept == [pytest.approx((2.0 * np.pi * f, 2.0 * np.pi * (f - 0.2)))] and search.periods > periods + 40


@pytest.mark.parametrize("budget", [100, 250])
def test_a_part_of_a_curve_gives_a_lower_bound(bent, budget):
    """Its highest point is where the evaluations were used up: nothing says that it is the peak."""
    study = bent[0].replace(harmonics=5)
    curve = study.frequency_response(0.0, (9.0, 14.0), options=ContinuationOptions(budget=budget))
    found = study.time_response(curve)
    assert not curve.complete and found.periods > 0
    assert found.status.startswith("incomplete: ")
    assert found.status.endswith("there may be a higher peak, as the curve is incomplete")


def test_the_end_of_the_curve_is_no_fall(bent):
    search = room.TipSearch(room.ring_of(bent[0].problem, 0.0), CurveAmplitudes(bent[1]), 256)
    place = room.SteadyPoint(11.0, np.ones(80), True, None)
    search.places = [place._replace(frequency=12.0), place]
    assert "widen the interval" in search.open_question(place)
    search.fall = 10.9
    assert not search.open_question(place)


def test_a_curve_that_ends_before_the_branch_is_alone_is_no_start(bent):
    study, _ = bent
    curve = study.replace(harmonics=5).frequency_response(0.0, (9.0, 10.6))
    if curve.peak_at_end:
        with pytest.raises(bd.SettingError, match=r"^curve: expected a curve with a peak"):
            study.replace(harmonics=5).time_response(curve)
    else:
        status = study.replace(harmonics=5).time_response(curve).status
        assert status.startswith("not found: next to the tip there are several solutions")


def test_an_interruption_keeps_the_highest_motion_so_far(bent, monkeypatch):
    study, curve = bent
    visit, calls = room.TipSearch.integrate_at, []

    def stopped(search, *arguments, **options):
        calls.append(1)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return visit(search, *arguments, **options)

    monkeypatch.setattr(room.TipSearch, "integrate_at", stopped)
    found = study.replace(harmonics=5).time_response(curve)
    assert found.status == "interrupted" and found.frequency > F0 and np.isfinite(found.mean)


def test_every_nodal_diameter_that_the_model_carries_is_marched():
    from bdamper.time_domain.integration import every_diameter, ring_of

    study = bd.Study(bd.reference_model("bladed_disk", 9), bd.Excitation("tip"), 5, friction_coefficient=0.4, harmonics=3)
    ring = ring_of(study.problem, 125.0)
    assert ring.n == 13 and ring.nodal_diameters == (0, 5, 10, 15, 20, 25, 30)
    # harmonics 6 and 7 share a diameter, each with residual modes of its own: one set is turned to the other
    wide = ring_of(study.replace(harmonics=8).problem, 125.0)
    assert wide.nodal_diameters == ring.nodal_diameters and wide.n_coordinates == ring.n_coordinates
    for l, basis in enumerate(wide.wide.structure.bases):
        own, reversed_ = wide._family(l)
        G = np.asarray(wide.wide.structure.bases[own].G).reshape(-1, len(basis.omega2))
        mine = np.asarray(basis.G).reshape(G.shape)
        turned = G @ wide._turns[l]
        np.testing.assert_allclose(turned, mine.conj() if reversed_ else mine, atol=1e-6 * np.abs(mine).max())
    assert every_diameter(study.replace(fundamental_modes_only=True).problem).harmonic_numbers == (1, 2, 3)
    assert structure().n_harmonics == 3


@pytest.mark.slow
def test_the_reference_disk_beside_an_independent_march():
    """Unit tractions at 125 N: 97 \u00b5m, and falls between 308 and 312 Hz.

    It beats by 3 % at 314 Hz, and by 7 % at 312 Hz; rounding decides which of the two is higher.
    """
    study = bd.Study(bd.reference_model("bladed_disk", 9), bd.Excitation("tip"), 5, friction_coefficient=0.4,
                     contact_stiffness="unit_traction")  # fmt: skip
    found = study.time_response(study.frequency_response(125.0, (285.0, 380.0)))
    assert found.mean == pytest.approx(97e-6, rel=0.05) and 308.0 < found.fall < 312.0
    assert found.lowest < 0.98 * found.mean < 1.02 * found.mean < found.highest


class _Amplitudes:
    frequency, top, below = np.array([100.0, 110.0]), 1, 0.0

    def at(self, frequency):
        return np.array([1.0])

    def start(self, frequency):
        return np.zeros(2)

    def lower(self, frequency, own):
        return self.below

    def alone(self, here, step):
        return False


class _Ring:
    """A motion is whatever it was, without disturbances."""

    def start(self, u, *_):
        return u

    def seeded(self, motion, *_):
        return motion

    def departure(self, blades):
        return np.full(len(blades), 1e-4)


class _March:
    """A march of which every period is known before, without a transient."""

    motion, omega, memory, ring = None, 2.0 * np.pi, 50.0, _Ring()

    def __init__(self, of_period):
        self.of_period, self.harmonics = of_period, []

    def run(self, periods):
        self.harmonics = list(range(periods))

    @property
    def amplitude(self):
        return np.array([self.of_period(n) for n in self.harmonics])

    @property
    def blades(self):
        return self.amplitude[:, None] * [1.0, 0.9j]


@each(
    ("of_period", "alone", "periods", "stays"),
    [
        (lambda n: 1.0, True, 20, True),  # neither scatter nor drift
        (lambda n: 1.0 + 0.02 * (-1) ** n, True, 80, True),  # two windows of 40 show that it has settled
        (lambda n: 1.0 + 0.02 * (-1) ** n, False, 80, True),  # long visits alone are given longer to fall
        (lambda n: 1.0 - 1e-3 * n, False, 400, True),  # falls by 4 % from window to window to the end, to 0.62
        (lambda n: 0.6 + 4e-3 * min(n, 100), False, 120, True),  # rises up to period 100
        (lambda n: np.exp(-n / 50.0), False, 60, False),  # from period 35 on it is below one half, and falls
        (lambda n: 1.0 if n % 2 else 0.2 if 60 <= n < 90 else 1.1, False, 170, True),  # dips, and has come back
        (lambda n: 0.45, True, 20, False),
        (lambda n: 4.1, True, 20, False),
    ],
)
def test_a_motion_is_marched_until_it_stays_or_has_gone(of_period, alone, periods, stays):
    """Of a level of 1 m, below 0.5 m of which it has fallen."""
    march = _March(of_period)
    place = room.integrate_until_steady(march, 1.0, 0.5, alone)
    assert (len(march.harmonics), place.stays) == (periods, stays)
    steady = np.ptp(march.amplitude[-20:]) < 1e-3 or march.amplitude[-20:].max() < 0.5
    np.testing.assert_array_equal(place.amplitude, march.amplitude[-20 if steady else -40 :])
    march = _March(of_period)
    place = room.integrate_until_steady(march, 1.0, 0.5, alone, long=True)
    steady = np.ptp(march.amplitude[-20:]) < 1e-3
    np.testing.assert_array_equal(place.amplitude, march.amplitude[-20 if steady else -80 :])


@pytest.mark.parametrize(("below", "limit"), [(0.0, 1.4), (0.6, 1.4), (1.6, 1.8)])
def test_a_motion_has_fallen_nearer_to_the_next_lower_solution_or_by_three_tenths(monkeypatch, below, limit):
    """Of a level of 2 m; with twice the steps, too, of which twice the periods are shown."""
    search, marched, asked = room.TipSearch(None, _Amplitudes(), 64), [], []
    search.balance.below = below
    monkeypatch.setattr(room, "March", lambda *given: marched.append(given) or SimpleNamespace(harmonics=[0] * 90))
    monkeypatch.setattr(room, "integrate_until_steady", lambda march, *given: asked.append(given))
    search.integrate_at(100.0, None, 2.0)
    search.integrate_at(100.0, None, 2.0, finer=2)
    assert [given[1:] for given in marched] == [(200.0 * np.pi, None, steps) for steps in (64, 128)]
    assert asked == [(2.0, pytest.approx(limit), not below, long) for long in (False, True)] and search.periods == 180


@pytest.mark.parametrize("falls", [103.1, 103.4, 103.6, 103.9])
def test_the_fall_is_found_within_a_quarter_of_a_step(monkeypatch, falls):
    """Halved twice; the motion grows on its way down in frequency, so that the last place is the highest."""
    search = room.TipSearch(_Ring(), _Amplitudes(), 4)
    came = lambda f: room.SteadyPoint(f, np.array([1.0 + 0.1 * (108.0 - f)]), f > falls, None)  # noqa: E731
    monkeypatch.setattr(search, "integrate_at", lambda frequency, *_: came(frequency))
    monkeypatch.setattr(search, "follow", lambda last, frequency: came(frequency))
    search.approach(108.0, -1.0)
    found = [place.frequency for place in search.places]
    assert found[:5] == [108.0, 107.0, 106.0, 105.0, 104.0] and found == sorted(found, reverse=True)
    assert search.fall < falls < found[-1] == search.fall + 0.25


def test_the_walk_goes_over_a_dip_before_the_tip_and_ends_a_tenth_below_the_highest_beyond(monkeypatch):
    search, means = (
        room.TipSearch(_Ring(), _Amplitudes(), 4),
        {108.0: 0.7, 107.0: 0.6, 106.0: 0.8, 105.0: 1.0, 104.0: 0.95, 103.0: 0.89},
    )
    search.balance = SimpleNamespace(
        at=search.balance.at,
        start=search.balance.start,
        alone=search.balance.alone,
        frequency=np.array([100.0, 105.0, 110.0]),
        top=1,
    )
    came = lambda f: room.SteadyPoint(f, np.array([means.get(f, 0.1)]), True, None)  # noqa: E731
    monkeypatch.setattr(search, "integrate_at", lambda frequency, *_: came(frequency))
    monkeypatch.setattr(search, "follow", lambda last, frequency: came(frequency))
    search.approach(108.0, -1.0)
    assert [place.frequency for place in search.places] == list(means) and np.isnan(search.fall)


@pytest.mark.parametrize(("then", "now", "own"), [(1.0, 1.1, 0.99), (1.0, 3.0, 0.9 * 1.25), (3.0, 1.0, 0.9 * 0.8)])
def test_the_next_motion_is_expected_to_change_as_the_curve_does(monkeypatch, then, now, own):
    search, asked = room.TipSearch(None, _Amplitudes(), 4), []
    search.balance.at = lambda f: np.array([now if f == 101.0 else then])
    monkeypatch.setattr(room, "March", lambda _, omega, *given: SimpleNamespace(
        sweep=lambda *_: None, memory=1.0, omega=omega, harmonics=[], motion="swept"))  # fmt: skip
    place = room.SteadyPoint(101.0, np.array([own]), True, None)
    monkeypatch.setattr(search, "integrate_at", lambda *given: asked.append(given) or place)
    search.follow(room.SteadyPoint(100.0, np.array([0.9]), True, None), 101.0)
    assert asked == [(101.0, "swept", pytest.approx(own))]


@pytest.mark.parametrize(
    ("mean", "words"), [(9.0, ("grows to 9 m", "an error", "steps_per_period")), (0.1, ("100 mm", "harmonics"))]
)
def test_a_start_that_goes_astray_says_what_to_use_more_of(monkeypatch, mean, words):
    search = room.TipSearch(_Ring(), _Amplitudes(), 4)
    monkeypatch.setattr(search, "integrate_at", lambda *_: room.SteadyPoint(100.0, np.array([mean]), False, None))
    search.approach(100.0, 1.0)
    assert all(word in search.failure for word in words) and not search.places


def test_places_around_the_highest_are_halved_until_they_are_near(monkeypatch):
    """A smooth top at 103.3 Hz between places one hertz apart, found within the distance of places; disturbed once."""
    search, seeded = room.TipSearch(_Ring(), _Amplitudes(), 4), []
    came = lambda f: room.SteadyPoint(f, np.array([2.0 - (f - 103.3) ** 2]), True, "here")  # noqa: E731
    monkeypatch.setattr(search, "follow", lambda last, frequency: came(frequency))
    monkeypatch.setattr(search.ring, "seeded", lambda motion, *_: seeded.append(motion) or motion, raising=False)
    search.places = [came(f) for f in (105.0, 104.0, 103.0, 102.0)]
    search.refine()
    top = max(search.places, key=lambda p: p.mean)
    assert abs(top.frequency - 103.3) < 103.3 * room.CRITERIA.fine and seeded == ["here"]
    assert len(search.places) < 12
    before = len(search.places)
    monkeypatch.setattr(search, "follow", lambda last, frequency: came(frequency)._replace(stays=False))
    search.places = [came(f) for f in (104.0, 103.0, 102.0)]
    search.refine()
    assert len(search.places) == 3 < before, "what falls on the way to a neighbour is no place, and is not tried again"


@pytest.mark.parametrize(("after", "periods"), [(1.0, 40), (3.0, 400)])
def test_a_long_march_goes_on_while_disturbances_grow(after, periods):
    march = _March(lambda n: 1.0)
    march.ring = SimpleNamespace(departure=lambda blades: 0.02 * after ** (np.arange(len(blades)) >= len(blades) // 2))
    room.integrate_until_steady(march, 1.0, 0.5, True, long=True)
    assert len(march.harmonics) == periods
    assert room.growth(march, 40) == (pytest.approx(after if after > 1.0 else 1.0), pytest.approx(0.02 * after))


@pytest.mark.parametrize(
    ("of_period", "memory", "periods"),
    [
        (lambda n: 1.0, 100.0, 20),
        (lambda n: 0.94, 100.0, 100),
        (lambda n: 1.0 - 1e-4 * n, 100.0, 20),
        (lambda n: 1.0 - 1e-4 * n, 1000.0, 400),  # its transient may take off another 11 %
    ],
)
def test_four_times_the_steps_take_few_periods_where_these_are_steady(monkeypatch, of_period, memory, periods):
    """Not where they are lower by the tolerance, or where the transient of a long memory may still change them by it."""
    march = _March(of_period)
    march.memory = memory
    monkeypatch.setattr(room, "March", lambda *given: march)
    search = room.TipSearch(None, _Amplitudes(), 64)
    best = room.SteadyPoint(100.0, np.ones(20), True, room.Motion(None, None, None, None))
    found = search.with_quarter_steps(best)
    window = {20: 20, 100: 80, 400: 320}[periods]
    assert found == pytest.approx(march.amplitude[-window:].mean()) and search.periods == len(march.harmonics)
    assert len(march.harmonics) == periods


def test_answers_that_differ_are_a_range(bent, monkeypatch):
    study, curve = bent
    finer = room.TipSearch.with_quarter_steps
    monkeypatch.setattr(room.TipSearch, "with_quarter_steps", lambda *given: 1.2 * finer(*given))
    found = study.replace(harmonics=5).time_response(curve)
    low, high = min(found.answers.values()), max(found.answers.values())
    assert high > 1.15 * low and found.status.startswith("incomplete: not settled: ")
    assert found.text == found.status.removeprefix("incomplete: not settled: ") and " to " in found.text
    assert found.highest >= high and found.lowest <= low and found.factor == found.highest / found.balance


def test_every_start_of_one_mass_comes_to_the_same_motion(walked, bent):
    study, curve = bent
    found = study.replace(harmonics=5).time_response(curve, starts=4)
    assert sum(name.startswith("start") for name in found.answers) == 3 and found.elsewhere == 0
    assert "0 of 3 other starts came to another motion." in found._headline()
    assert {"512 steps", "1024 steps"} <= set(walked.answers) and walked.blades.shape[1] == 1 and not walked.parted
    assert abs(walked.numerical_loss) < 5e-3 and walked.energy[0] > 0.0
    assert walked.energy[1] == pytest.approx(walked.energy[0], rel=5e-3), "no friction: damping takes all"
    with pytest.raises(bd.SettingError, match="starts"):
        study.time_response(curve, starts=0)


def test_blades_that_part_are_said_and_drawn(walked, tmp_path):
    n, rng = 80, np.random.default_rng(0)
    blades = 1e-6 * np.array([150.0, 275.0, 275.0]) * (1.0 + 0.01 * rng.standard_normal((n, 3)))
    waves = np.array([[10.0, 188e-6], [-10.0, 131e-6], [30.0, 1e-6]])
    parted = replace(walked, blades=blades, blade=1, waves=waves)
    assert parted.parted and "Blades do not vibrate alike: 150 to 275 \u00b5m." in parted._headline()
    assert "10 forward 188 \u00b5m, 10 backward 131 \u00b5m" in parted.summary()
    beats = np.where(np.arange(n)[:, None] < 40, blades, blades[:, ::-1])
    assert not replace(parted, blades=beats).parted, "other blades are high in the second half"
    assert not replace(parted, blades=np.ones((n, 3))).parted
    parted.save(tmp_path / "parted.h5")
    read = bd.load(tmp_path / "parted.h5")
    np.testing.assert_array_equal(read.blades, blades)
    assert read == parted and read.answers == parted.answers and read.energy == parted.energy
    heights = [bar.get_height() for bar in read.plot().patches]
    np.testing.assert_allclose(heights, blades.mean(axis=0))
    plt.close("all")
    with pytest.raises(bd.BdamperError, match="this result has no motion of blades in time"):
        replace(parted, blades=np.zeros((0, 0))).plot()
