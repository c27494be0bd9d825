"""Error estimates by source, ladders of settings: against solutions of richer studies, and each other."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.accuracy.estimate import SOURCES, change_of_peak, missing_harmonics, richer_study, with_stand_ins
from bdamper.accuracy.ladders import by_sweep, by_tracking, make_ladders, richest, slipping_preload, varied
from bdamper.accuracy.tolerance import SHARE, WORTH, WORTH_IN_ALL, _Choice, richest_study
from bdamper.balance.system import OK
from bdamper.peaks.newton import PeakOptions, find_peak
from bdamper.util.cost import CostMeter
from bdamper.util.errors import SettingError
from tests import accuracy_cases, models


@pytest.fixture(scope="module")
def study():
    return bd.Study(bd.reference_model("bladed_disk", 9), bd.Excitation("tip"), 5, harmonics=2)


@pytest.fixture(scope="module")
def place():
    """Preload and interval of a peak with slip and separation."""
    return 5000.0, (320.0, 365.0)


@pytest.fixture(scope="module")
def peak(study, place):
    return study.peak(*place)


def test_all_sources_of_a_peak(study, place, peak):
    errors = study.estimate_errors(peak)
    assert [s.source for s in errors.sources] == list(SOURCES)
    assert peak.shares[1] + peak.shares[2] > 0.0  # there is something to estimate
    assert all(s.known for s in errors.sources), str(errors)
    assert errors["solver"].size < 1e-8
    assert errors["evaluation"].size < 1e-5
    assert errors.total >= errors.largest.size
    text = str(errors)
    assert all(source in text for source in SOURCES) and len(text.splitlines()) == 1 + len(SOURCES)
    with pytest.raises(KeyError, match="friction"):
        errors["friction"]


@pytest.mark.parametrize("source", ["harmonics", "contact points", "modes", "evaluation"])
def test_estimate_is_the_change_to_the_richer_study(study, place, source):
    changes = {"contact points": {"contact_points": 6}, "evaluation": {"evaluation": bd.Sampled(64)}}.get(source, {})
    own = replace(study, **changes)
    curve = own.track(*place)
    estimated = own.estimate_errors(curve, sources=[source])[source]
    true = richer_study(own, source).study.peak(*place)
    error = np.array([true.amplitude / curve.peak.amplitude - 1.0, true.frequency / curve.peak.frequency - 1.0])
    assert np.abs(error).max() > 1e-6
    size = max(abs(estimated.amplitude), abs(estimated.frequency))
    assert 0.5 < size / np.abs(error).max() < 2.0, (estimated, error)


def test_top_at_an_end_of_the_interval_is_estimated_at_its_frequency(study, place):
    curve = study.track(place[0], (350.0, 354.5))  # the response still rises
    estimated = study.estimate_errors(curve, sources=["harmonics"])["harmonics"]
    true = richer_study(study, "harmonics").study.track(place[0], (350.0, 354.5)).peak
    assert estimated.frequency == 0.0 and "solved at the end" in estimated.against
    assert estimated.amplitude == pytest.approx(true.amplitude / curve.peak.amplitude - 1.0, rel=1e-5)


@pytest.mark.parametrize("number", [1023, 1047, 1070, 1253])
def test_resonance_that_comes_into_the_interval_is_found(number):
    """More modes or points bring another resonance in, or leave a top that is no maximum."""
    compared = accuracy_cases.compare(number)
    assert 0.9 < compared.effectivity < 1.1, compared
    assert np.abs(compared.true).max() > 0.05


def test_solver_error_is_that_of_a_loose_peak(study, place, peak):
    loose = study.peak(*place, options=PeakOptions(tolerance=1e-3, position_tolerance=1e-2))
    moved = replace(peak, y=peak.y * (1.0 + 1e-4), amplitude=peak.amplitude * (1.0 + 1e-4))
    estimated = study.estimate_errors(moved, sources=["solver"])["solver"]
    assert estimated.amplitude == pytest.approx(-1e-4, rel=0.1)
    assert abs(loose.amplitude / peak.amplitude - 1.0) < 1e-2


def test_curve_carries_its_errors(study, place, tmp_path):
    curve = study.track(*place)
    with_errors = study.with_errors(curve, sources=["harmonics", "solver"])
    assert curve.error_estimates is None and "solver" not in str(curve)
    assert with_errors.error_estimates == study.estimate_errors(curve, sources=["harmonics", "solver"])
    assert "harmonics: amplitude" in str(with_errors) and "contact 0." in str(with_errors)
    with_errors.save(tmp_path / "curve.h5")
    assert bd.load(tmp_path / "curve.h5").error_estimates == with_errors.error_estimates


def test_peak_carries_its_cost(peak):
    assert peak.cost is not None
    assert peak.cost.seconds >= peak.cost.core > 0.0 and peak.cost.python > 0.0
    assert peak.cost.evaluations >= peak.cost.iterations > peak.iterations
    assert "contact" in str(peak)


def test_work_is_counted_by_sizes(study, place):
    curve = study.track(*place)
    assert curve.cost.work == study.track(*place).cost.work > 0.0
    system = study.system(place[0])
    n, points = system.n_unknowns, system.n_points
    kinds = 28e3 * 5 * points, 6.0 * points * n**2, n**3 + 700.0 * n**2 + 1e6, 15.0 * n**3  # two harmonics
    np.testing.assert_allclose(system.work, np.array(kinds) / 1e6, rtol=1e-12)
    counts = curve.cost.evaluations, curve.cost.jacobians, curve.cost.factorisations, curve.cost.least_norm
    assert curve.cost.work == pytest.approx(float(np.dot(kinds, counts)) / 1e6, rel=1e-12)
    sampled = replace(study, evaluation=bd.Sampled(64)).system(place[0])
    assert sampled.work[0] == pytest.approx(points * (120e3 + 64 * 1.2e3) / 1e6)
    both = CostMeter(0.0)
    both.add(curve.cost)
    both.watch(system)
    before = system.work_done
    system.evaluate(curve.unknowns[0], 2.0 * np.pi * curve.frequency[0])
    assert both.work - curve.cost.work == pytest.approx(system.work_done - before)
    assert system.work_done - before == pytest.approx(system.work[0] + system.work[1])


def test_corrections_end_at_a_limit_of_work(study, place, peak):
    system = study.system(place[0])
    scale = np.append(np.full(system.n_unknowns, np.abs(peak.y[:-1]).max()), peak.y[-1])
    guess = peak.y[:-1] * 0.2
    free = system.correct_at(guess, peak.y[-1], scale, 1e-10, 40, True)
    assert free.status == OK and free.iterations > 5
    each = float(system.work[:3].sum())
    enough = system.limited(100 * each)
    assert not enough.spent
    np.testing.assert_array_equal(enough.correct_at(guess, peak.y[-1], scale, 1e-10, 40, True).y, free.y)
    few = system.limited(4 * each)
    before = system.work_done
    c = few.correct_at(guess, peak.y[-1], scale, 1e-10, 40, True)
    assert c.status != OK and few.spent
    assert system.work_done - before < 8 * each
    again = few.correct_at(guess, peak.y[-1], scale, 1e-10, 40, True)
    assert again.status != OK and again.iterations == 0
    np.testing.assert_array_equal(again.y[:-1], guess)


def test_what_is_refused(study, place, peak):
    with pytest.raises(SettingError, match="sources"):
        study.estimate_errors(peak, sources=["friction"])
    with pytest.raises(SettingError, match="preload"):
        study.estimate_errors(replace(peak, parameter=np.nan))
    with pytest.raises(SettingError, match="unknowns"):
        replace(study, harmonics=3).estimate_errors(peak)
    with pytest.raises(SettingError, match="converged"):
        study.estimate_errors(replace(peak, status="lost"))
    for wrong in ({"vary": "bearing"}, {"vary": {"model": [1]}}, {"vary": {"harmonics": []}}, {"quantity": "temperature"},
                  {"repeats": 0}, {"tolerance": 2.0}):  # fmt: skip
        with pytest.raises(SettingError):
            bd.accuracy_cost(study, *place, **wrong)


def test_stand_ins_leave_present_modes_alone(study):
    assert missing_harmonics(study, 3) == []
    assert missing_harmonics(study, 15) == []
    small = bd.Study(models.wedge_model(0, n_blades=24, engine_order=2, harmonics=3), bd.Excitation("tip"), 2, harmonics=2)
    assert missing_harmonics(small, 5) == [4, 5]
    wide = with_stand_ins(small, 5)
    assert wide.harmonic_numbers == (1, 2, 3, 4, 5)
    for l in range(1, 4):
        np.testing.assert_array_equal(wide.bases[l].G, small.coupling.basis(l).G)
    for l in (4, 5):
        np.testing.assert_array_equal(wide.bases[l].omega2, small.bases[1].omega2)


def test_change_between_equal_studies_is_nothing(study, place, peak):
    amplitude, frequency, _, _ = change_of_peak(study, replace(study), place[0], peak)
    assert abs(amplitude) < 1e-8 and abs(frequency) < 1e-8


# ---- ladders ----


@pytest.fixture(scope="module")
def result(study, place):
    vary = {"harmonics": [1, 2, 3], "evaluation": [bd.Sampled(64), "exact"], "contact_points": [6, 9]}
    return bd.accuracy_cost(study, *place, quantity="curve", vary=vary, repeats=3, tolerance=0.02)


def test_errors_are_those_of_the_curves(study, place, result):
    assert result.ladders == ("harmonics", "evaluation", "contact_points")
    reference = result.reference("harmonics")
    assert reference.name == "harmonics 6" and np.isfinite(reference.error)
    true = with_stand_ins(study, 6).peak(*place)
    assert reference.amplitude == pytest.approx(true.amplitude, rel=1e-8)
    rung = result.ladder("harmonics")[0]
    own = replace(study, harmonics=1).track(*place).peak
    assert rung.amplitude_error == pytest.approx(own.amplitude / true.amplitude - 1.0, rel=1e-6)
    assert rung.frequency_error == pytest.approx(own.frequency / true.frequency - 1.0, rel=1e-6)
    exact = result.ladder("evaluation")[-1]
    assert exact.name == "exact events" and exact.error < 1e-6
    assert result.ladder("contact_points")[-1].error < 1e-6 < result.ladder("contact_points")[0].error


def test_front_and_recommendation(result):
    for ladder in result.ladders:
        rungs = result.ladder(ladder)
        assert min(r.ratio for r in rungs) == 1.0
        for r in rungs:
            beaten = any(o is not r and o.seconds <= r.seconds and o.error < r.error for o in rungs)
            assert r.pareto != beaten
        front = result.pareto(ladder)
        assert all(a.error > b.error for a, b in zip(front, front[1:]))
        best = result.recommended(0.5 * max(r.error for r in rungs), ladder)
        assert best is None or best.pareto
    assert result.recommended(1e-15, "harmonics") is None


def test_result_prints_plots_and_saves(result, tmp_path):
    text = str(result)
    assert "Pareto" in text and "harmonics 3" in text and "itself good to" in text
    assert result.markdown("harmonics").count("\n") == 6
    ax = result.plot()
    assert ax.get_xscale() == ax.get_yscale() == "log"
    assert len(result.plot(ladders=["harmonics"]).texts) == 3
    result.save(tmp_path / "ladders.h5")
    assert bd.load(tmp_path / "ladders.h5") == result


@pytest.mark.parametrize("name", models.ALL_MODELS)
def test_default_ladders_suit_every_model(name):
    study = bd.Study(models.ALL_MODELS[name](0), bd.Excitation("tip"), 1 if name == "acyclic" else 2)
    ladders = make_ladders(study, None)
    names = dict.fromkeys(s.ladder for s in ladders)
    assert list(names) == ["harmonics", "evaluation", "contact_points", "blade_modes"]
    for ladder in names:
        rungs = [s for s in ladders if s.ladder == ladder]
        changes, text = richest(study, rungs)
        best = varied(study, changes)
        for rung in rungs:
            own = varied(study, rung.changes)
            assert own.system(0.0).n_unknowns <= best.system(0.0).n_unknowns, text


def test_preload_of_a_ladder_is_one_at_which_the_contact_slips(study, place):
    result = bd.accuracy_cost(study, frequency=place[1], vary={"harmonics": [1]}, repeats=1)
    assert result.preload == pytest.approx(slipping_preload(study, place[1]), rel=1e-12)
    shares = study.peak(result.preload, place[1]).shares
    assert 0.02 < shares[1] + shares[2] < 0.98
    twice = replace(study, excitation=replace(study.excitation, amplitude=2.0))
    assert slipping_preload(twice, place[1]) == pytest.approx(2.0 * result.preload, rel=1e-9)
    ground = bd.Study(models.ALL_MODELS["ground"](0), bd.Excitation("tip"), 2)
    assert slipping_preload(ground, (200.0, 450.0)) == 0.0
    with pytest.raises(bd.BdamperError, match="nothing slips"):
        slipping_preload(replace(study, friction_coefficient=0.0), place[1])


def test_combined_ladder_has_one_front(study, place):
    vary = {"harmonics": [1, 2], "contact_points": [6, 9]}
    result = bd.accuracy_cost(study, *place, vary=vary, combine=True, repeats=1)
    assert result.ladders == ("harmonics x contact_points",) and len(result.rungs) == 4
    assert {r.name for r in result.rungs} >= {"harmonics 1, contact points 6", "harmonics 2, contact points 9"}


def test_ways_to_find_a_peak(study, place):
    settings = [
        bd.Setting("method", "tracking", solver=by_tracking),
        bd.Setting("method", "sweep of 40", solver=by_sweep(40)),
        bd.Setting("method", "sweep of 400", solver=by_sweep(400)),
    ]
    result = bd.accuracy_cost(study, *place, vary=settings, repeats=1)
    tracking, coarse, fine = result.rungs
    assert tracking.error < 1e-8 < fine.error < coarse.error
    assert tracking.amplitude_error > fine.amplitude_error  # a grid misses the top


# ---- effectivity ----


@pytest.mark.parametrize("number", [2, 4, 8, 12, 20])
def test_effectivity_on_a_sample(number):
    compared = accuracy_cases.compare(number)
    assert compared is not None
    assert 0.3 < compared.effectivity < 3.0, compared


# ---- a tolerance instead of settings ----


@pytest.mark.parametrize("number", [0, 6, 11, 29, 50])
def test_curve_to_a_tolerance(number):
    tried = accuracy_cases.try_tolerance(number)
    assert tried is not None
    assert tried.error <= tried.tolerance, tried
    assert tried.curves <= 2  # that of one harmonic and, if this is not enough, the one that is returned


@pytest.mark.slow
def test_curve_that_is_highest_elsewhere_than_expected():
    """Its top is so flat that the point at the phase of the poorer one is no measure of where it is."""
    tried = accuracy_cases.try_tolerance(3024)
    assert tried.curves == 3 and tried.chosen == 7
    assert tried.error <= tried.tolerance, tried
    assert tried.ratio <= 3.0


def test_little_is_spent_on_a_decision_that_could_save_little(monkeypatch):
    """The peak is expensive to carry to thirteen harmonics, and the curve with one is good enough."""
    case = accuracy_cases.draw(505)
    one = replace(accuracy_cases.study_of(case), harmonics=1, damper_modes=0)
    place = accuracy_cases.scene(one, case)
    least = one.track(*place).cost.work
    spent = {}
    for worth in (0.1, WORTH, 10.0):
        monkeypatch.setattr("bdamper.accuracy.tolerance.WORTH", worth)
        curve = one.track(*place, tolerance=0.03)
        assert curve.settings["chosen"]["harmonics"] == [1]
        spent[worth] = curve.cost.work / least
        assert spent[worth] < 1.1 + worth
        limited = any("too much work" in line for line in curve.settings["chosen"]["reasons"])
        assert limited == (worth == 0.1)
    assert spent[10.0] > spent[0.1] + 0.1


def test_peak_expected_stands_in_where_all_harmonics_would_take_too_much(monkeypatch):
    case = accuracy_cases.draw(22)
    one = replace(accuracy_cases.study_of(case), harmonics=1, damper_modes=0)
    place = accuracy_cases.scene(one, case)
    monkeypatch.setattr("bdamper.accuracy.tolerance.WORTH", 0.3)
    curve = one.track(*place, tolerance=0.03)
    chosen = curve.settings["chosen"]
    assert chosen["harmonics"] == [1, 2, 3] and chosen["curves"] == 2
    assert any("expected with 1 to 9" in line for line in chosen["reasons"])
    true = richest_study(one).track(*place).peak
    error = max(abs(curve.peak.amplitude / true.amplitude - 1.0), abs(curve.peak.frequency / true.frequency - 1.0))
    assert error <= 0.03
    monkeypatch.setattr("bdamper.accuracy.tolerance.WORTH", 10.0)
    without = one.track(*place, tolerance=0.03)
    assert any("expected with 1 to 13" in line for line in without.settings["chosen"]["reasons"])


def choice_of(number, tolerance=0.01):
    """The choice of settings for a case, before anything is tracked."""
    case = accuracy_cases.draw(number)
    one = replace(accuracy_cases.study_of(case), harmonics=1, damper_modes=0)
    preload, interval = accuracy_cases.scene(one, case)
    return _Choice(richest_study(one), preload, interval, tolerance, None, {})


@pytest.mark.parametrize("number", [1021, 1099])  # the highest at an end of the interval, and a maximum
def test_top_that_newton_loses_is_found_by_a_piece_of_the_richer_curve(number):
    choice = choice_of(number)
    top = choice.tops(1)[0]
    choice.limit = np.inf
    assert choice.carried(top, 3) is None
    found = choice.followed(top, 3)
    work = choice.meter.work
    whole = choice.curve(3)
    assert found.at_end == (number == 1021)
    assert found.amplitude == pytest.approx(whole.peak.amplitude, rel=1e-6)
    assert found.frequency == pytest.approx(whole.peak.frequency, rel=1e-5)
    assert found.difference(top) > 1e-3
    assert work - choice.curve(1).cost.work < 0.5 * whole.cost.work
    choice.limit = choice.meter.work  # nothing left
    assert choice.followed(top, 3) is None


@pytest.mark.parametrize("number", [1050, 1074])
def test_peak_that_is_not_refined_is_about_as_far_as_said(number):
    choice = choice_of(number)
    top = choice.tops(1)[0]
    choice.limit = np.inf
    found = choice.carried(top, 3)
    true = find_peak(choice.variant(3)[1], found.y)
    away = max(abs(true.amplitude / found.amplitude - 1.0), abs(true.frequency / found.frequency - 1.0))
    assert 0.2 * found.missed < away < 2.0 * found.missed <= 2.0 * SHARE * choice.tolerance
    choice.tolerance = 1e-6  # too far for this one
    found = choice.carried(top, 3)
    assert found.missed == 0.0
    assert found.amplitude == pytest.approx(true.amplitude, rel=1e-4)


def test_series_is_too_short_for_the_peak_itself_only():
    """Three harmonics are 0.92 % off the peak; from the point that is carried to all of them, it is 1.01 %."""
    choice = choice_of(7061)
    harmonics, rest = choice.run()
    true = choice.study.track(choice.preload, choice.frequency).peak
    found = choice.curves[harmonics].peak
    assert harmonics == 3 and len(choice.curves) == 2
    assert rest == pytest.approx(abs(found.amplitude / true.amplitude - 1.0), rel=0.02)


def test_peak_carried_out_of_the_interval_is_none():
    choice = choice_of(7075, 0.003)
    top = choice.tops(7)[0]
    choice.limit = np.inf
    assert not top.at_end
    found = choice.carried(top, 9)
    true = choice.curve(9).peak
    assert found.at_end and found.frequency == choice.frequency[1]
    assert found.amplitude == pytest.approx(true.amplitude, rel=1e-6)


def test_point_lost_that_is_no_higher_than_the_tolerance_calls_nothing_in_question():
    choice = choice_of(7109)
    harmonics, rest = choice.run()
    assert harmonics == 5 and len(choice.curves) == 2 and choice.lost
    assert rest < 0.004


@pytest.mark.parametrize("number", [6, 505, 1091, 1099])
def test_work_on_carrying_is_bound_in_all(number):
    choice = choice_of(number)
    harmonics, _ = choice.run()
    carrying = choice.meter.work - sum(curve.cost.work for curve in choice.curves.values())
    assert 0.0 < carrying < 1.05 * WORTH_IN_ALL * choice.curves[harmonics].cost.work


def test_top_where_the_damper_walks_is_carried_along_the_walk():
    """Nothing holds the mean position there: the phase of the response does not tell where on the curve one is."""
    case = accuracy_cases.draw(500)
    one = replace(accuracy_cases.study_of(case), harmonics=1, damper_modes=0)
    preload, interval = accuracy_cases.scene(one, case)
    choice = _Choice(richest_study(one), preload, interval, 0.03, None, {})
    top = choice.tops(2)[0]
    assert top.walk is not None
    curve = choice.curve(4)
    assert "walk" in curve.point_kind[curve.peak.index - 1 : curve.peak.index + 2]
    carried = choice.carried(top, 4)
    assert carried.amplitude == pytest.approx(curve.peak.amplitude, rel=1e-6)
    assert carried.frequency == pytest.approx(curve.peak.frequency, rel=1e-6)
    assert carried.difference(top) > 0.01
    back = choice.carried(choice.lifted(top), 2)
    assert back.difference(top) < 1e-6
    assert choice.carried(replace(top, walk=None), 4) is None


def test_peak_says_that_a_corner_where_the_damper_walks_is_higher():
    case = accuracy_cases.draw(153)
    one = replace(accuracy_cases.study_of(case), harmonics=1, damper_modes=0)
    place = accuracy_cases.scene(one, case)
    for study in (one, varied(one, {"harmonics": 3})):  # the first has no maximum at all
        top = study.track(*place).peak
        note = f"higher where the damper walks, {top.amplitude:.6g} m at {top.frequency:.6g} Hz"
        if study is one:
            with pytest.raises(bd.BdamperError, match=note):
                study.peak(*place)
        else:
            peak = study.peak(*place)
            assert peak.amplitude < top.amplitude
            assert note in peak.scan
            assert "there may be a higher one" in str(peak)


def test_top_at_an_end_of_the_interval_is_compared_at_its_frequency(study, place):
    interval = 350.0, 354.5  # the response still rises
    curve = study.track(place[0], interval, tolerance=0.002)
    chosen = curve.settings["chosen"]
    true = richest_study(study).track(place[0], interval)
    assert curve.peak.frequency == true.peak.frequency == 354.5
    error = abs(true.peak.amplitude / curve.peak.amplitude - 1.0)
    assert error <= 0.002
    assert chosen["rest"] == pytest.approx(error, rel=0.2, abs=1e-6)


def test_tolerance_says_what_it_chose(study, place):
    loose = study.track(*place, tolerance=0.2)
    tight = study.track(*place, tolerance=0.01)
    assert loose.settings["harmonics"] == [1] == loose.settings["chosen"]["harmonics"]
    assert len(tight.settings["harmonics"]) > 2
    for curve, tolerance in ((loose, 0.2), (tight, 0.01)):
        assert 0.0 < curve.settings["chosen"]["rest"] <= tolerance
        assert "chosen for" in str(curve) and "exact events" in str(curve)
    assert tight.cost.seconds > loose.cost.seconds
    with pytest.raises(SettingError, match="tolerance"):
        study.track(*place, tolerance=-1.0)
    with pytest.raises(SettingError, match="tolerance: expected effects"):
        study.peak(*place, tolerance=0.01)


def test_tolerance_leaves_sampling_and_harmonics_of_the_study_behind(study, place):
    sampled = replace(study, evaluation=bd.Sampled(32), harmonics=5)
    one = sampled.track(*place, tolerance=0.1)
    other = study.track(*place, tolerance=0.1)
    assert one.peak.amplitude == pytest.approx(other.peak.amplitude, rel=1e-9)
