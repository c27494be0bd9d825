"""The one definition of the highest point of a curve: what counts, what is named, and that all who ask get the same."""

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import bdamper as bd
from bdamper.plot import plot_response_map
from bdamper.response import highest_peak
from bdamper.response.branches import LeftOut
from bdamper.response.highest_peak import AT_END, _tops, highest_of_curve, maxima
from bdamper.response.linear_limits import resonance_interval
from bdamper.response.peak import coarse_options
from bdamper.response.verification import TimeResponse
from bdamper.util.errors import Ending
from bdamper.util.formatting import amount, peak_text
from tests.models import wedge_model
from tests.plain import plain_study
from tests.printed import value

INTERVAL = (250.0, 400.0)


@pytest.fixture(scope="module")
def study():
    return plain_study(
        bd.reference_model(contact_points=9), bd.Excitation("tip"), 5, friction_coefficient=0.3
    )


@pytest.fixture(scope="module")
def curve(study):
    return study.frequency_response(1000.0, INTERVAL, options=coarse_options())


def test_tops_are_found_on_each_branch_and_plateaus_count_once():
    amplitude = np.array([1.0, 3.0, 2.0, 4.0, 4.0 * (1 + 1e-7), 1.0, 2.0, 5.0])
    kinds = ("end", "maximum", "regular", "regular", "drift", "end", "end", "end")
    assert _tops(amplitude, kinds, np.array([0] * 6 + [1] * 2)) == [7, 4, 1]
    assert _tops(amplitude[::-1].copy(), kinds[::-1], np.array([1] * 2 + [0] * 6)) == [0, 3, 6]


def test_a_coarse_curve_is_refined_to_what_a_fine_one_has(study, curve):
    found = highest_of_curve(study.problem.system(1000.0), curve)
    fine = study.frequency_response(
        1000.0, INTERVAL, options=bd.ContinuationOptions(tolerance=1e-10)
    ).peak
    assert found.kind == "peak" and found.exact and not found.peak.corner
    assert found.peak.amplitude == pytest.approx(fine.amplitude, rel=1e-9)
    assert found.peak.frequency == pytest.approx(fine.frequency, rel=1e-7)
    assert abs(found.peak.slope) < 1e-7
    assert maxima(study.problem.system(1000.0), curve)[0].amplitude == pytest.approx(
        fine.amplitude, rel=1e-9
    )


@pytest.mark.slow
def test_every_analysis_takes_the_peak_of_a_curve(study):
    """With the same answer as for the peak of the study, which is corrected to 1e-10."""
    curve, peak = study.frequency_response(1000.0, INTERVAL), study.peak(1000.0, INTERVAL)
    top = curve.peak
    assert (top.y[:-1] == curve.unknowns[curve.peak_index]).all() and top.settings[
        "frequency"
    ] == pytest.approx(INTERVAL)
    ask = {
        "sensitivities": lambda p: [
            f for s in study.peak_sensitivities(p).values() for f in (s.amplitude, s.frequency)
        ],
        "harmonics": lambda p: study.harmonic_convergence(p, harmonics=(3,)).peaks[-1].amplitude,
        "errors": lambda p: study.estimate_errors(p, sources=["harmonics"]).amplitude,
        "hysteresis": lambda p: study.hysteresis(p).excitation,
        "dissipation": lambda p: study.dissipation(p).damping,
        "response": lambda p: study.response_at(p, "tip"),
    }
    for name, of in ask.items():
        assert of(top) == pytest.approx(of(peak), rel=2e-5), name
    assert top.plot().axes[0].get_title().replace("\n", " ") == top._headline()
    for refused in (
        study.stuck(INTERVAL).peak,
        study.free((INTERVAL[0], 300.0)).peak,
        replace(top, corner=True),
    ):
        with pytest.raises(
            bd.SettingError,
            match=r"expected a (converged one|result of this study|smooth peak), found",
        ):
            study.peak_sensitivities(refused)


def test_a_closed_branch_is_named_and_never_counted(study, curve):
    """The points around the peak as a branch of their own: left alone it counts, closed it is detached."""
    system, top = study.problem.system(1000.0), curve.peak_index
    around = np.abs(np.arange(len(curve)) - top) < 4
    parted = replace(curve, branch=np.where(around, 1, np.where(np.arange(len(curve)) < top, 0, 2)))
    counted = highest_of_curve(system, parted)
    assert counted.peak.amplitude == pytest.approx(curve.peak.amplitude, rel=1e-3)
    apart = replace(parted, closed=(1,))
    found = highest_of_curve(system, apart)
    assert (
        found.peak.amplitude <= 1.01 * curve.amplitude[~around].max() < 0.99 * curve.peak.amplitude
    )
    assert apart.peak.amplitude == curve.amplitude[~around].max() and apart.detached.tolist() == [
        top
    ]
    assert f"detached: {amount(curve.peak.amplitude, 'm', 6)} at" in apart.summary()
    with pytest.raises(bd.BdamperError, match="no branch of the response curve reaches an end"):
        highest_of_curve(system, replace(parted, closed=(0, 1, 2)))
    assert replace(curve, closed=(0,)).peak_index == top  # nothing else is there


def test_an_end_of_the_interval_counts_where_there_is_no_maximum_and_is_named(study):
    peak = study.peak(1000.0, (250.0, 270.0))
    curve = study.frequency_response(1000.0, (250.0, 270.0))
    assert (
        curve.peak_at_end
        and peak.corner
        and peak.search_status == "incomplete"
        and peak.search_reason == f"{AT_END}, without a maximum in it"
    )
    assert peak.frequency == pytest.approx(270.0, rel=1e-12)
    assert peak.lower_bound == pytest.approx(curve.peak.amplitude, rel=1e-8) and np.isnan(
        peak.amplitude
    )
    assert not peak.ok and peak.status_text == f"incomplete: {AT_END}, without a maximum in it"
    assert peak._headline().startswith(
        "No peak: incomplete: highest at an end"
    ) and "Resonance" not in str(peak)
    assert "amplitude" not in [fact.name for fact in peak._facts()]
    with pytest.raises(
        bd.SettingError,
        match="expected a converged one, found status 'incomplete: highest at an end",
    ):
        study.peak_sensitivities(peak, ["preload"])
    with pytest.raises(bd.SettingError, match="incomplete"):
        study.hysteresis(peak)
    swept = bd.sweep(study, {"preload": [1000.0]}, bd.PeakTask(frequency=(250.0, 270.0)))
    assert (
        np.isnan(swept.array("amplitude")).all()
        and AT_END in swept.warnings[0]
        and "270" not in swept._headline()
    )
    compared = bd.compare(
        {"as it is": study, "smooth": {"friction_coefficient": 0.2}},
        lambda s: s.frequency_response(1000.0, (250.0, 270.0)),
    )
    assert compared._headline().startswith(
        "No peak of 'as it is' to compare with: complete, no peak: highest "
    )
    assert all("no peak: highest" in line for line in compared.summary().splitlines()[-2:])


@pytest.mark.slow
def test_an_end_that_is_higher_than_the_maximum_makes_the_peak_incomplete():
    """The flank of the next mode is no resonance of the mode, whose peak is 3.5 µm, but the blade vibrates with it."""
    study = plain_study(wedge_model(0), bd.Excitation("tip"), 2, friction_coefficient=0.4)
    low, high = resonance_interval(study.problem.at(1.0))[0], 1610.0
    peak, curve = study.peak(30e3, (low, high)), study.frequency_response(30e3, (low, high))
    assert curve.peak_at_end and np.isnan(peak.amplitude)
    # the bound is the highest known point, at the end, not the maximum of the mode
    assert peak.lower_bound == pytest.approx(curve.peak.amplitude, rel=1e-8)
    assert peak.frequency == pytest.approx(high, rel=1e-9)
    inner = study.frequency_response(30e3, (low, 0.9 * high)).peak
    assert inner.ok and inner.frequency < 0.9 * high
    assert peak.lower_bound > 1.5 * inner.amplitude
    told = f"higher at an end of the interval: {peak_text(curve.peak.amplitude, high, 4)}"
    assert peak.status == peak.search_status == "incomplete"
    assert peak.reason == peak.search_reason == told and told in peak.summary()
    result = study.optimal_curve((10.0, 30e3), 3, frequency=(low, high), check=False)
    assert np.isnan(result.amplitude[-1]), "the flank is higher, so the maximum is no answer"
    assert result.lower_bound[-1] == pytest.approx(peak.lower_bound, rel=1e-9)
    assert result.status_text[-1] == peak.status_text and any(
        told in text for text in result.warnings
    )


def test_a_preload_without_a_maximum_has_no_value(study):
    result = study.optimal_curve([900.0, 1000.0, 1100.0], frequency=(250.0, 270.0), check=False)
    assert set(result.status_text) == {f"incomplete: {AT_END}, without a maximum in it"} and set(
        result.kind
    ) == {""}
    assert np.isnan(result.amplitude).all() and not result.optimum.ok
    assert result.lower_bound[1] == pytest.approx(
        study.peak(1000.0, (250.0, 270.0)).lower_bound, rel=1e-9
    )


def test_a_coarse_curve_that_is_not_whole_is_followed_again(study, monkeypatch):
    module, asked = sys.modules["bdamper.response.highest_peak"], []
    inner = module.frequency_response

    def coarse_is_lost(*args, options, **_):
        asked.append(options.tolerance)
        found = inner(*args, options=options)
        return replace(found, status="incomplete") if options.tolerance > 1e-8 else found

    monkeypatch.setattr(module, "frequency_response", coarse_is_lost)
    peak = study.peak(1000.0, INTERVAL)
    assert (
        asked == [coarse_options().tolerance, bd.ContinuationOptions().tolerance]
        and peak.search_status == "complete"
    )


@pytest.mark.parametrize(
    ("least", "budget", "curves"), [("coarse", None, 2), ("close", None, 2), ("", 1, 1)]
)
def test_a_curve_given_up_among_folds_is_followed_again(study, monkeypatch, least, budget, curves):
    """The higher one counts, whichever has half the height; not where a given budget is used up."""
    module, asked = sys.modules["bdamper.response.highest_peak"], []
    folds = LeftOut(290.0, 300.0, "many folds: 400 points of folds")
    whole = module.frequency_response(study.problem, 1000.0, INTERVAL)

    def given_up(*args, options, **_):
        asked.append("coarse" if options.tolerance > 1e-8 else "close")
        if asked[-1] == least:
            return replace(whole, harmonics=0.5 * whole.harmonics, missing_ranges=(folds,))
        return replace(whole, missing_ranges=(folds,) if asked[-1] == "coarse" else ())

    monkeypatch.setattr(module, "frequency_response", given_up)
    monkeypatch.setattr(module, "highest_of_curve", lambda system, curve, options: highest(curve))
    found = module.found_at(study.problem, 1000.0, INTERVAL, budget=budget)
    assert len(asked) == curves and found.top.peak.amplitude == whole.amplitude.max()
    told = (
        "the continuation of a branch was stopped among many folds from 290 to 300 Hz, where the "
        "response could be higher"
    )
    end = Ending() if least == "coarse" else Ending("incomplete", told)
    assert found.ending == end


@pytest.mark.slow
def test_an_optimum_whose_curve_was_given_up_is_not_verified(study, monkeypatch):
    """Nor is it for design, even with amplitudes in time."""
    preloads = [30.0, 100.0, 300.0]
    whole = study.optimal_curve(preloads, frequency=INTERVAL, check=False)
    in_time = tuple(TimeResponse(*(1e-5,) * 3, 300.0, p, 1e-5) for p in (30.0, 40.0))
    assert whole.optimum.ok and "search" not in replace(whole, time_response=in_time)._headline()
    optimal = sys.modules["bdamper.response.optimal_curve"]
    with monkeypatch.context() as context:
        plain = optimal.at_preload
        ended = lambda *asked: (
            lambda at: replace(at, top=replace(at.top, note="higher at an end"))
        )(plain(*asked))
        context.setattr(optimal, "at_preload", ended)
        beyond = study.optimal_curve(preloads, frequency=INTERVAL, check=False)
    assert not beyond.optimum.ok and "widen the frequency interval" in beyond.optimum.reason
    doubt = replace(beyond, time_response=in_time)._headline()
    assert doubt.startswith(f"No optimum: {beyond.optimum.status_text}")
    module = sys.modules["bdamper.response.highest_peak"]
    monkeypatch.setattr(
        module, "given_up", lambda curve: "a branch was stopped" if curve.preload == 30.0 else ""
    )
    again = study.optimal_curve(preloads, frequency=INTERVAL, check=False)
    assert np.isnan(again.amplitude[0]) and again.lower_bound[0] == pytest.approx(
        whole.amplitude[0]
    )
    assert (
        again.status_text[0]
        == "incomplete: a branch was stopped, where the response could be higher"
    )
    peak = study.peak(30.0, INTERVAL)
    assert np.isnan(peak.amplitude) and peak.lower_bound == pytest.approx(whole.amplitude[0])
    assert peak.status_text == again.status_text[0]
    lost = replace(whole.curves[0], status="incomplete", reason="no solution")
    at = sys.modules["bdamper.response.optimal_curve"].AtPreload(
        300.0, lost, highest(whole.curves[0]), 0.0, "", whole.cost
    )
    assert at.ending == Ending("incomplete", "no solution")


def highest(curve):
    peak = SimpleNamespace(amplitude=curve.amplitude.max(), iterations=0)
    return SimpleNamespace(peak=peak, exact=True, kind="peak", note="", ending=Ending())


@pytest.mark.slow
def test_where_rounding_keeps_newton_from_the_tolerance_the_peak_is_that_of_the_curve():
    """Once "higher at a maximum without a smooth peak": the residual stays at 3e-10, three times the tolerance."""
    study = bd.Study(
        bd.reference_model("paper_disk"), bd.Excitation("tip"), 5, contact_stiffness="residual_modes",
        fundamental_modes_only=True,
        harmonics=5, friction_coefficient=0.6,
    )  # fmt: skip
    peak, curve = study.peak(950.0), study.frequency_response(950.0, (290.0, 330.0))
    assert peak.search_status == "complete" and curve.complete
    assert peak.amplitude == pytest.approx(curve.peak.amplitude, rel=1e-8)
    assert peak.frequency == pytest.approx(curve.peak.frequency, rel=1e-6)


@pytest.mark.nightly
@pytest.mark.slow
def test_among_folds_a_search_does_not_leave_the_curve():
    """Uphill from a lower maximum Newton's method meets a branch 4 % higher that breaks off on both sides."""
    study = bd.Study(
        bd.reference_model("bladed_disk", 24), bd.Excitation("tip", "tangential"), 10, harmonics=2, friction_coefficient=0.6
    )  # fmt: skip
    peak, curve = study.peak(65.6), study.frequency_response(65.6, (231.1673, 412.9133))
    if peak.search_reason.startswith("no steady periodic response is expected"):
        # the contacts are open for most of the cycle: no amplitude is stated
        assert np.isnan(peak.amplitude)
        return
    complete = peak.search_status == "complete"
    assert complete or peak.search_reason.startswith(
        "the continuation of a branch was stopped among many folds from"
    )
    assert (peak.amplitude if complete else peak.lower_bound) == pytest.approx(
        curve.peak.amplitude, rel=1e-7
    )


@pytest.mark.slow
def test_a_response_map_shows_ridge_optimum_and_several_solutions(tmp_path):
    """Along a curve with folds the same frequency is met three times between them."""
    import matplotlib as mpl

    mpl.use("Agg")
    study = plain_study(
        bd.reference_model(contact_points=9), bd.Excitation("tip"), 5, friction_coefficient=0.3
    )
    result = study.optimal_curve((30.0, 300.0), 5, frequency=INTERVAL, check=False)
    ax = plot_response_map(result)
    labels = ax.get_legend_handles_labels()[1]
    assert {"highest", "optimum"} <= set(labels) and ax.get_yscale() == "log"
    assert ("several solutions" in labels) == any(len(c.folds) for c in result.curves)
    ax.figure.savefig(tmp_path / "map.png")
    with pytest.raises(bd.SettingError, match="two or more curves, found 0"):
        plot_response_map(replace(result, curves=()))


def test_a_drift_at_an_end_of_the_interval_is_no_resonance(study, curve):
    """The mean position moves at the first frequency, where the amplitude is highest: the rest of the curve only falls."""
    system, top = study.problem.system(1000.0), curve.peak_index
    y = np.column_stack([curve.unknowns, 2.0 * np.pi * curve.frequency])[top:]
    y = np.concatenate([[y[0]] * 3, y])
    y[:2, 0] += [2e-6, 1e-6]
    kinds = ("end", "drift", "drift", *["regular"] * (len(y) - 4), "end")
    drifts = replace(
        curve, frequency=y[:, -1] / (2.0 * np.pi), unknowns=y[:, :-1], harmonics=system.response(y[:, :-1]),
        point_kind=kinds, branch=np.zeros(len(y), int), shares=curve.shares[:1].repeat(len(y), axis=0),
    )  # fmt: skip
    found = highest_of_curve(system, drifts)
    assert found.kind == "end" and found.peak.frequency == pytest.approx(
        curve.frequency[top], rel=1e-6
    )
    assert drifts.peak_at_end and drifts._headline().startswith("No peak; ")
    inside = replace(curve, point_kind=("regular",) * len(curve))
    assert (
        curve.frequency.min() < inside.peak.frequency < curve.frequency.max()
        and not inside.peak_at_end
    )


def test_two_branches_that_meet_an_end_of_the_interval_apart_by_rounding_are_both_at_it(
    study, curve
):
    """The second starts higher, at a frequency that is not the very lowest."""
    system = study.problem.system(1000.0)
    y = np.column_stack([curve.unknowns, 2.0 * np.pi * curve.frequency])[curve.peak_index + 1 :]
    second = y.copy()
    second[0, -1] *= 1.0 + 4e-16
    y[:, :-1] *= 0.5
    both, branch = np.concatenate([y, second]), np.repeat([0, 1], len(y))
    kinds = ("end", *["regular"] * (len(y) - 2), "end") * 2
    assert both[len(y), -1] != both[:, -1].min()
    twice = replace(
        curve, frequency=both[:, -1] / (2.0 * np.pi), unknowns=both[:, :-1], harmonics=system.response(both[:, :-1]),
        point_kind=kinds, branch=branch, shares=curve.shares[:1].repeat(len(both), axis=0),
    )  # fmt: skip
    assert highest_of_curve(system, twice).kind == "end"


def test_a_peak_of_a_part_of_a_curve_is_incomplete(monkeypatch):
    """Two masses with contacts that stick: a curve that ends before it has reached the higher of both resonances."""
    mass, stiffness = np.diag([1.0, 0.3]), np.array([[2.0, -0.6], [-0.6, 0.6]])
    held = bd.Contact(tangential=1, kt=0.05, mu=0.5, preload=1e4)
    study = bd.lumped(
        [1.0, 0.3],
        0.02 * stiffness,
        stiffness,
        contacts=[held],
        forces={0: 1.0},
        response=1,
        harmonics=1,
    )
    f = np.linspace(0.12, 0.4, 200_001)
    whole = stiffness + np.diag([0.0, held.kt])
    s = 2j * np.pi * f[:, None, None]
    det = np.linalg.det(whole + s**2 * mass + s * 0.02 * stiffness)
    x = np.abs(
        (0.6 + 0.02 * 0.6 * 2j * np.pi * f) / det
    )  # amplitude of the second mass by Cramer's rule
    tops = np.flatnonzero((x[1:-1] > x[:-2]) & (x[1:-1] > x[2:])) + 1
    assert len(tops) == 2
    peak = study.peak(0.0, (0.12, 0.4))
    assert peak.status == peak.search_status == "complete" and peak.amplitude == pytest.approx(
        x.max(), rel=1e-6
    )
    module, options = (
        sys.modules["bdamper.response.highest_peak"],
        bd.ContinuationOptions(budget=60),
    )
    for name in ("coarse_options", "ContinuationOptions"):
        monkeypatch.setattr(module, name, lambda: options)
    part = study.peak(0.0, (0.12, 0.4))
    assert (
        part.status == part.search_status
        and part.status_text.startswith("incomplete: ")
        and part.lower_bound < 0.9 * x.max()
    )
    assert part._headline().startswith("No peak: incomplete: ") and "Lower bound" in str(part)
    assert not part.ok and np.isnan(part.amplitude)


STUDIES = Path(__file__).resolve().parents[3] / "shared" / "fixtures" / "studies"


@pytest.mark.skipif(
    not STUDIES.exists(), reason="needs the stored studies, which are not in the repository"
)
def test_a_peak_below_a_known_branch_is_incomplete():
    """An independent integration keeps 0.4434 m at 0.2238 Hz for 800 periods, on a separate branch."""
    study = bd.load_study(STUDIES / "study_46.h5")
    interval = (0.05732164233226115, 0.2516708845332451)
    peak = study.peak(0.02992052878335502, interval)
    assert peak.status_text.startswith("incomplete: ") and "443.6 mm" in peak.reason
    found = bd.sweep(study, {"preload": [0.02992052878335502]}, frequency=interval)
    assert found.status_text == (peak.status_text,) and not found.complete
    assert np.isnan(found.array("amplitude")[0]) and found.array("search_status")[0] == peak.status
    assert found.array("lower_bound")[0] == peak.lower_bound == pytest.approx(0.4434, rel=1e-3)
    assert peak.frequency == pytest.approx(0.2238, rel=1e-3)
    assert np.isnan(peak.amplitude) and value(peak, "Lower bound") == "444 mm"


@pytest.mark.slow
def test_an_error_at_one_preload_leaves_the_others(study, monkeypatch):
    preloads = [30.0, 100.0, 300.0]
    whole = study.optimal_curve(preloads, frequency=INTERVAL, check=False)
    optimal = sys.modules["bdamper.response.optimal_curve"]
    plain = optimal.within_budget

    def fails_at_30(problem, preload, *more, **named):
        if preload == 30.0:
            raise bd.BdamperError("the response curve has no point")
        return plain(problem, preload, *more, **named)

    monkeypatch.setattr(optimal, "within_budget", fails_at_30)
    found = study.optimal_curve(preloads, frequency=INTERVAL, check=False)
    kept = dict(zip(found.preload, zip(found.amplitude, found.reason)))
    assert np.isnan(kept[30.0][0]) and "the response curve has no point" in kept[30.0][1]
    expected = dict(zip(whole.preload, whole.amplitude))
    assert kept[100.0][0] == pytest.approx(expected[100.0], rel=1e-9)


@pytest.mark.slow
def test_a_curve_of_closed_branches_alone_has_no_peak(study, monkeypatch):
    """The peak says so, and a sweep keeps its other points."""
    module = sys.modules["bdamper.response.highest_peak"]
    plain = module.highest_of_curve

    def unreachable(system, curve, *, options=None):
        if curve.preload < 50.0:
            raise bd.BdamperError(
                "no branch of the response curve reaches an end of the frequency interval; widen the interval"
            )
        return plain(system, curve, options=options)

    monkeypatch.setattr(module, "highest_of_curve", unreachable)
    peak = study.peak(30.0, INTERVAL)
    assert peak.status_text.startswith("not found: ") and "reaches an end" in peak.reason
    assert np.isnan(peak.amplitude) and not peak.ok
    found = bd.sweep(study, {"preload": [30.0, 100.0]}, frequency=INTERVAL)
    assert found.status_text[0] == peak.status_text and found.status_text[1] == "complete"
    assert np.isnan(found.array("amplitude")[0]) and np.isfinite(found.array("amplitude")[1])


def test_the_lower_bound_of_a_curve_is_called_so(study):
    """Comparison, headline and picture: of an incomplete curve, and of one with a higher separate branch."""
    whole = study.frequency_response(1000.0, INTERVAL)
    short = replace(whole, status="incomplete", reason="no solution")
    assert whole.may_be_higher == "" and short.may_be_higher == "incomplete, no solution"
    assert short._headline().startswith("Lower bound of the resonance peak ")
    drawn = [curve.plot().axes[0] for curve in (whole, short)]
    assert ["lower bound" in ax.get_legend_handles_labels()[1] for ax in drawn] == [False, True]
    answers = iter((whole, short))
    found = bd.compare({"whole": study, "short": {}}, lambda _: next(answers))
    assert np.isnan(found.change("short"))
    (row,) = [row for row in found._rows() if row[0] == "short"]
    assert row[1] == "" or row[1].strip() in ("-", "nan m", "")
    assert row[-1].startswith("incomplete: lower bound ")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("preload", "share", "ratio", "noted"),
    [
        (100.0, 1e-3, 2.0, True),
        # not far below, not another mode, and a preload that keeps the faces closed
        (100.0, 0.05, 2.0, False),
        (100.0, 1e-3, 1.2, False),
        (2000.0, 1e-3, 2.0, False),
    ],
)
def test_a_peak_far_below_the_free_blade_in_another_mode_is_no_answer(
    preload, share, ratio, noted, monkeypatch
):
    """Faces that the preload does not keep closed may collide."""
    model = bd.reference_model("bladed_disk", 9)
    force = bd.Excitation("tip", amplitude=1000.0)
    study = plain_study(model, force, 5, friction_coefficient=0.3)
    interval = (150.0, 900.0)
    free = study.free(interval).peak
    peak = SimpleNamespace(amplitude=share * free.amplitude, frequency=ratio * free.frequency)
    note = highest_peak._resonance_apart(study.problem.at(preload), interval, peak)
    assert bool(note) == noted
    if not noted:
        return
    assert "the preload is 0.1 times the excitation" in note
    assert peak_text(free.amplitude, free.frequency) in note
    # the note leaves a lower bound of a complete curve
    monkeypatch.setattr(highest_peak, "_resonance_apart", lambda *_: note)
    calm = plain_study(model, bd.Excitation("tip"), 5, friction_coefficient=0.3)
    doubted = calm.peak(1000.0)
    assert doubted.status == "incomplete" and doubted.reason == note
    assert np.isnan(doubted.amplitude) and np.isfinite(doubted.lower_bound)
