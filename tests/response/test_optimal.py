"""Peaks and optimal curves of models with a free damper, against full response curves and finite differences."""

import csv
from dataclasses import replace

import h5py
import numpy as np
import pytest

import bdamper as bd
from bdamper.analyses.robust_optimum import SteadyPeak
from bdamper.harmonic_balance.equations import Equations, Maximum, Plane
from bdamper.harmonic_balance.parameters import vary
from bdamper.response import highest_peak, optimal_curve, sensitivity
from bdamper.response.events import ContinuationOptions
from bdamper.response.highest_peak import AtPreload, Highest, found_at
from bdamper.response.linear_limits import free_and_stuck, resonance_interval
from bdamper.response.peak import amplitude_at, find_peak, slope_along
from bdamper.response.response_curve import without_points
from bdamper.response.scalar_search import CORNER
from bdamper.response.sensitivity import PARAMETERS, setting_family, setting_value
from bdamper.util.errors import SettingError
from bdamper.util.progress import Cost
from tests.following import follow_peak
from tests.plain import plain_study

INTERVAL = (250.0, 400.0)


@pytest.fixture(scope="module")
def study():
    model = bd.reference_model(contact_points=9)
    return plain_study(
        model, excitation=bd.Excitation("tip"), engine_order=5, friction_coefficient=0.3
    )


@pytest.fixture(scope="module")
def result(study):
    return study.optimal_curve((150.0, 20e3), 14, frequency=INTERVAL, check=False)


@pytest.fixture(scope="module")
def peak(study):
    return study.peak(1000.0, INTERVAL)


@pytest.mark.slow
def test_no_optimum_says_why(study):
    """Within this band the response only rises."""
    curve = study.optimal_curve([1000.0, 2000.0], frequency=(250.0, 270.0), check=False)
    assert curve.status_text[0].startswith("incomplete: highest at an end")
    assert curve._headline().endswith(f"; at 1 kN {curve.status_text[0]}")


class TestOptimalCurve:
    @pytest.mark.slow
    def test_agrees_with_tracking_curves(self, study, result):
        assert result.complete
        for p, a, f in zip(result.preload, result.amplitude, result.frequency):
            curve = study.frequency_response(
                p, INTERVAL, options=bd.ContinuationOptions(tolerance=1e-10)
            )
            assert curve.complete
            assert a == pytest.approx(curve.peak.amplitude, rel=1e-6)
            assert f == pytest.approx(curve.peak.frequency, rel=1e-6)

    @pytest.mark.slow
    def test_every_point_solves_the_equations(self, study, result):
        for p, u, f in zip(result.preload, result.unknowns, result.frequency):
            system = study.problem.system(p)
            r, _, _ = system.evaluate(u, 2 * np.pi * f)
            assert np.abs(r * system.row_scale).max() < 1e-9
        assert np.all(result.residual <= 1e-10)

    def test_limits(self, study, result):
        for limit, curve in (
            (result.free, study.free(INTERVAL)),
            (result.stuck, study.stuck(INTERVAL)),
        ):
            assert limit.amplitude == pytest.approx(curve.peak.amplitude, rel=1e-8)
            assert limit.frequency == pytest.approx(curve.peak.frequency, rel=1e-7)
        high = study.peak(1e6, INTERVAL)
        assert high.amplitude == pytest.approx(result.stuck.amplitude, rel=1e-6)
        assert result.stuck_shift_percent == pytest.approx(
            100 * (result.stuck.frequency / result.free.frequency - 1)
        )
        assert np.all(result.shift_percent < result.stuck_shift_percent + 1e-6)

    @pytest.mark.slow
    def test_optimum_of_a_smooth_curve(self, study):
        """Direct evaluation on both sides of the optimum is higher, by the square of the distance."""
        small = study.optimal_curve((25.0, 60.0), 5, frequency=INTERVAL, check=False)
        o = small.optimum
        assert (o.kind, o.status) == ("smooth", "complete")
        assert o.kind == "smooth" and o.ok
        at = study.peak(o.preload, INTERVAL)
        assert at.amplitude == pytest.approx(o.amplitude, rel=1e-8)
        rise = []
        for h in (1e-3, 2e-3):
            both = [
                follow_peak(study.problem.system, at, [o.preload * (1 + s)]).peaks[0].amplitude
                for s in (h, -h)
            ]
            assert min(both) > o.amplitude
            rise.append(sum(both) - 2 * o.amplitude)
        assert rise[1] / rise[0] == pytest.approx(4.0, rel=0.05)

    def test_optimum_at_the_end_of_the_range_is_named_so(self, result):
        assert result.optimum.kind == "end"
        assert result.optimum.preload == result.preload[0]
        assert result.ratio == result.stuck.amplitude / result.amplitude[0]


@pytest.mark.slow
def test_jumps_at_low_preload_are_found():
    """Down to 10 N the highest peak changes three times; every complete response curve has the same highest peak."""
    model = bd.reference_model(contact_points=24)
    study = plain_study(
        model, excitation=bd.Excitation("tip"), engine_order=5, friction_coefficient=0.3
    )
    curve = study.optimal_curve((15.0, 100.0), 12, frequency=INTERVAL, check=False)
    checked = 0
    for p, a in zip(curve.preload, curve.amplitude):
        frequency_response = study.frequency_response(p, INTERVAL)
        if frequency_response.complete:
            checked += 1
            assert a == pytest.approx(frequency_response.peak.amplitude, rel=1e-6), p
    assert checked >= 9
    assert not curve.goes_on[1:].all()


class TestSensitivities:
    @pytest.mark.slow
    @pytest.mark.parametrize("name", PARAMETERS)
    def test_against_finite_differences(self, study, peak, name):
        found = study.peak_sensitivities(peak, [name])[name]
        if name == "preload":
            family, value = study.problem.system, peak.parameter
        else:
            family, value = (
                setting_family(study.problem, name, peak.parameter),
                setting_value(study.problem, name),
            )
        h = 1e-4 * value
        start = replace(peak, parameter=value)
        high, low = (follow_peak(family, start, [value + s]).peaks[0] for s in (h, -h))
        assert found.amplitude != 0.0
        assert found.amplitude == pytest.approx(
            (high.amplitude - low.amplitude) / (2 * h), rel=1e-5
        )
        assert found.frequency == pytest.approx(
            (high.frequency - low.frequency) / (2 * h), rel=1e-5
        )

    def test_unconverged_peak_is_refused(self, study, peak):
        with pytest.raises(bd.SettingError, match="converged"):
            study.peak_sensitivities(replace(peak, status="lost"), ["preload"])


class TestFindPeak:
    def test_no_solution_near_the_guess_is_a_status(self, study, peak):
        system = study.problem.system(1000.0)
        y = peak.y.copy()
        y[:-1] *= 1e6
        found = find_peak(system, y)
        assert not found.ok
        assert found.status == "not found" and found.reason

    def test_from_a_point_beside_the_peak(self, study, peak):
        system = study.problem.system(1000.0)
        for s in (-0.3, 0.3):
            c = system.solve(
                peak.y + s * peak.tangent * peak.scale, Plane(peak.tangent), peak.scale, 1e-10, 30
            )
            assert c.status == 0
            found = find_peak(system, c.y, tangent=c.tangent, scale=peak.scale)
            assert found.ok
            assert found.amplitude == pytest.approx(peak.amplitude, rel=1e-9)
            assert found.frequency == pytest.approx(peak.frequency, rel=1e-8)

    def test_no_two_modes_share_a_stuck_resonance(self):
        """The stuck resonance of the hard disk's fifth mode lies above its sixth mode, whose own is higher."""
        study = bd.Study(
            bd.reference_model("bladed_disk"), bd.Excitation("tip"), 5, friction_coefficient=0.4
        )
        free, stuck = free_and_stuck(study.problem.at(1.0), 6)
        assert free[5] < stuck[4] < stuck[5]
        assert resonance_interval(study.problem.at(1.0), 6)[1] > stuck[5]


class TestNewtonToThePeak:
    """The quick way to a peak against the search along the curve, which shares nothing but the corrector."""

    @pytest.mark.parametrize("away", [(0.02, 0.0), (-0.02, 0.0), (0.0, 1e-4), (0.01, -1e-4)])
    def test_same_peak_as_the_search(self, study, peak, away):
        system = study.problem.system(1000.0)
        rng = np.random.default_rng(3)
        side = rng.standard_normal(len(peak.y))
        side -= (side @ peak.tangent) * peak.tangent
        guess = (
            peak.y + (away[0] * peak.tangent + away[1] * side / np.linalg.norm(side)) * peak.scale
        )
        c = system.solve(
            guess, Maximum(peak.tangent, 2.0 * peak.curvature, 1e-8, 0.2), peak.scale, 1e-10, 15
        )
        assert c.status == 0
        assert c.residual <= 1e-10
        assert abs(c.slope / c.curvature) <= 1e-8
        assert np.abs((c.y - peak.y) / peak.scale).max() < 1e-7
        slopes = []
        for h in (1e-3, -1e-3):
            b = system.solve(
                c.y + h * c.tangent * peak.scale, Plane(c.tangent), peak.scale, 1e-12, 20
            )
            slopes.append(slope_along(system, b.y, b.tangent, peak.scale))
        assert c.curvature == pytest.approx((slopes[0] - slopes[1]) / 2e-3, rel=1e-2)
        # the tangent spans the null space of the Jacobian
        _, J, r_omega = system.evaluate_at(c.y)
        t = c.tangent * peak.scale
        assert np.linalg.norm(J @ t[:-1] + r_omega * t[-1]) < 1e-9 * np.linalg.norm(r_omega * t[-1])

    def test_slope_is_the_derivative_of_the_logarithm(self, study, peak):
        system = study.problem.system(1000.0)
        c = system.solve(
            peak.y + 0.1 * peak.tangent * peak.scale, Plane(peak.tangent), peak.scale, 1e-12, 20
        )
        guesses = [c.y + h * c.tangent * peak.scale for h in (1e-4, -1e-4)]
        ends = [system.solve(y, Plane(c.tangent), peak.scale, 1e-12, 20).y for y in guesses]
        difference = np.diff([np.log(abs(system.response(y[:-1])[1])) for y in ends])[0] / -2e-4
        assert slope_along(system, c.y, c.tangent, peak.scale) == pytest.approx(
            difference, rel=1e-6
        )


class TestVary:
    @pytest.mark.parametrize(
        "settings",
        [
            {"friction_coefficient": 0.2},
            {"excitation.amplitude": 3.0},
            {"damping_ratio": 0.004},
            {"friction_coefficient": 0.2, "excitation.amplitude": 3.0},
            {"contact_stiffness_factor": 1.5, "friction_coefficient": 0.4},
        ],
    )
    def test_kept_parts_do_not_change_the_equations(self, study, peak, settings):
        """A varied study gives the equations of one that is made from nothing."""
        study.problem.system(500.0)
        fast = vary(study, settings).problem.system(500.0)
        plain = {k: v for k, v in settings.items() if "." not in k and not k.endswith("_factor")}
        fresh = plain_study(
            study.model, excitation=study.excitation, engine_order=5, friction_coefficient=0.3
        )
        fresh = fresh.replace(**plain)
        if "excitation.amplitude" in settings:
            fresh = fresh.replace(
                excitation=replace(study.excitation, amplitude=settings["excitation.amplitude"])
            )
        if "contact_stiffness_factor" in settings:
            given = {
                k: settings["contact_stiffness_factor"] * v.stiffness
                for k, v in fresh.problem.stiffness.items()
            }
            fresh = fresh.replace(contact_stiffness=given)
        slow = fresh.problem.system(500.0)
        for a, b in zip(fast.evaluate(peak.y[:-1], 2000.0), slow.evaluate(peak.y[:-1], 2000.0)):
            assert a == pytest.approx(b, rel=1e-12)

    @pytest.mark.parametrize("method", ["residual_modes", "cigeroglu2009", "unit_traction"])
    def test_a_varied_coefficient_of_friction_makes_the_contact_stiffness_anew(self, study, method):
        study = study.replace(contact_stiffness=method)
        assert study.problem.stiffness.keys() == study.model.interfaces.keys()
        varied, fresh = (
            vary(study, {"friction_coefficient": 0.05}),
            study.replace(friction_coefficient=0.05),
        )
        for name, contact in fresh.problem.stiffness.items():
            assert varied.problem.stiffness[name].stiffness == pytest.approx(
                contact.stiffness, rel=1e-9
            )

    def test_the_factor_acts_on_residual_modes_too(self, study):
        """Twice the factor, half the flexibility of the whole contact: what is at the points and what the modes carry."""
        study = study.replace(contact_stiffness="residual_modes")
        flexibility = []
        for factor in (1.0, 2.0):
            varied = vary(study, {"contact_stiffness_factor": factor})
            basis = varied.problem.bases[1]
            residual = np.array([c.body == "residual" for c in basis.coordinates])
            assert residual.any()
            G = basis.G[..., residual].reshape(-1, int(residual.sum()))
            k = varied.problem.point_stiffness.ravel()
            point = np.diag(np.where(k > 0.0, 1.0 / np.where(k > 0.0, k, 1.0), 0.0))
            flexibility.append(point + (G / basis.omega2[residual]) @ G.conj().T)
        assert flexibility[1] == pytest.approx(
            0.5 * flexibility[0], rel=1e-12, abs=1e-12 * np.abs(flexibility[0]).max()
        )


def test_static_states_scale_with_the_load(study):
    """Without gaps at the friction points the static state is proportional; a fresh analysis gives the same."""
    first = study.static(500.0)
    scaled = study.static(1250.0)
    fresh = plain_study(study.model, excitation=study.excitation, engine_order=5).static(1250.0)
    assert scaled.ok
    assert scaled.residual < 1e-10
    for name in ("q", "slider", "force", "closing"):
        a, b = getattr(scaled, name), getattr(fresh, name)
        assert a == pytest.approx(b, rel=1e-9, abs=1e-9 * np.abs(b).max()), name
    assert np.array_equal(scaled.status, fresh.status)
    assert scaled.force == pytest.approx(2.5 * first.force, rel=1e-9)
    # a gap that closes under the larger load stops the proportion
    face = study.model.interfaces["left"]
    gap = np.zeros(face.n_points)
    gap[0] = 1e-9 + 1.2 * abs(float(first.closing[0]))
    model = replace(
        study.model, interfaces=dict(study.model.interfaces) | {"left": replace(face, gap=gap)}
    )
    gapped = plain_study(model, excitation=study.excitation, engine_order=5)
    low, high = gapped.static(5.0), gapped.static(5e4)
    fresh = plain_study(model, excitation=study.excitation, engine_order=5).static(5e4)
    assert high.force == pytest.approx(fresh.force, rel=1e-9, abs=1e-9 * np.abs(fresh.force).max())
    assert np.any(high.status[0] != low.status[0])


@pytest.mark.slow
def test_peaks_are_found_on_the_rippled_curves_of_sampled_friction():
    """Slopes jump where an event passes a sample; the top is bracketed all the same, and has no derivative."""
    study = plain_study(
        bd.reference_model("bladed_disk", contact_points=9),
        bd.Excitation("tip"),
        engine_order=5,
        friction_coefficient=0.4,
        friction_law="coupled",
        contact_forces=bd.AFT(128),
    )
    interval = (270.0, 380.0)
    for friction in (0.38, 0.42):
        s = study.replace(friction_coefficient=friction)
        peak, curve = s.peak(500.0, interval), s.frequency_response(500.0, interval)
        assert peak.ok
        assert peak.amplitude == pytest.approx(curve.peak.amplitude, rel=5e-4)
        assert amplitude_at(s.problem.system(500.0), peak.y) == pytest.approx(
            peak.amplitude, rel=1e-12
        )
    with pytest.raises(SettingError, match="contact_forces"):
        s.peak_sensitivities(peak)


def test_a_peak_without_a_derivative_says_so(study, peak, monkeypatch):
    n = len(peak.y)
    for value, reason in ((0.0, "flat one at"), (np.nan, "finite")):
        gradient = np.full(n, value), np.zeros(n - 1)
        monkeypatch.setattr(Equations, "slope_gradient", lambda *args, gradient=gradient: gradient)
        found = sensitivity.sensitivities(peak, {"preload": (study.problem.system, 1000.0)})[
            "preload"
        ]
        assert (
            np.isnan([found.amplitude, found.frequency, *found.y]).all() and reason in found.reason
        )


@pytest.fixture(scope="module")
def left(study):
    return study.optimal_curve(
        np.geomspace(200.0, 8000.0, 8), frequency=(335.0, 400.0), check=False
    )


class TestAnEndOfTheInterval:
    """Where the resonance lies beyond the interval, the response at its end is a lower bound of the peak, and no value."""

    @pytest.mark.slow
    def test_values_are_those_of_whole_curves(self, study, left):
        whole = study.optimal_curve(left.preload, frequency=INTERVAL, check=False)
        whole_rows = np.isin(whole.preload, left.preload)
        within = whole.frequency[whole_rows] >= 335.0
        assert within[left.requested].tolist() == [False, False, True, True, True, True, True, True]
        assert np.isfinite(left.amplitude).tolist() == within.tolist()
        assert [bool(kind) for kind in left.kind] == within.tolist()
        np.testing.assert_allclose(
            left.amplitude[within], whole.amplitude[whole_rows][within], rtol=1e-8
        )
        for k in np.flatnonzero(~within):
            end = study.frequency_response(left.preload[k], (335.0, 400.0)).peak
            assert left.lower_bound[k] == pytest.approx(end.amplitude, rel=1e-7)
            assert end.frequency == pytest.approx(335.0, rel=1e-12)
            assert (
                left.status_text[k]
                == "incomplete: highest at an end of the interval, without a maximum in it"
            )
        assert not left.complete and "highest at an end" in left.warnings[0]


@pytest.fixture(scope="module")
def smooth(study):
    return study.replace(friction_coefficient=0.0)


@pytest.fixture(scope="module")
def found(smooth):
    peak = smooth.peak(300.0)
    return peak, smooth.peak_sensitivities(peak)


class TestNoFriction:
    """A coefficient of friction of zero, with a damper that slides freely along its faces."""

    @pytest.mark.slow
    def test_that_to_friction_is_the_derivative_to_the_right(self, smooth, found):
        """Extrapolated from two steps upward, since the forces are of first order in the coefficient."""
        peak, sensitivity = found
        # the damper opens for two thirds of the cycle, so that the verdict gives no peak as an answer
        rubbing = [smooth.replace(friction_coefficient=mu) for mu in (1e-4, 2e-4)]
        one, two = (found_at(s.problem, 300.0, (250.0, 320.0)).top.peak for s in rubbing)
        assert one.ok and two.ok
        for name in ("amplitude", "frequency"):
            a, b, c = (getattr(p, name) for p in (peak, one, two))
            slope = (4.0 * (b - a) - (c - a)) / 2e-4
            assert getattr(sensitivity["friction_coefficient"], name) == pytest.approx(
                slope, rel=5e-3
            )


@pytest.mark.slow
def test_a_scan_that_ends_among_folds_is_made_again_from_the_ends():
    """At 100 N with three harmonics the curve through the solution found first ends among folds before its peak."""
    study = plain_study(
        bd.reference_model("bladed_disk", 9),
        bd.Excitation("tip"),
        engine_order=5,
        friction_coefficient=0.4,
        harmonics=3,
    )
    curve = study.optimal_curve((100.0, 150.0), 2, frequency=(270.0, 380.0), check=False)
    assert curve.status[0] == "complete"
    assert curve.amplitude[0] == pytest.approx(
        study.frequency_response(100.0, (270.0, 380.0)).peak.amplitude, rel=1e-4
    )


@pytest.mark.slow
def test_a_picture_marks_what_is_not_known(result):
    import matplotlib as mpl

    mpl.use("Agg")
    gap = np.isin(np.arange(len(result)), [1, 5])
    amplitude, bound = (
        np.where(gap, np.nan, result.amplitude),
        np.where(np.arange(len(result)) == 1, 1e-4, np.nan),
    )
    onward = np.append(False, np.isfinite(amplitude[1:] + amplitude[:-1]))
    curve = replace(result, amplitude=amplitude, lower_bound=bound, goes_on=onward)
    for shown, mark in (
        (curve, "k"),
        (replace(curve, optimum=replace(curve.optimum, status="incomplete", reason="lost")), "w"),
    ):
        ax = shown.plot().axes[0]
        labels = ax.get_legend_handles_labels()[1]
        assert {"no value: no peak found", "no value: curve incomplete", "lower bound"} <= set(
            labels
        )
        assert sum(patch.get_hatch() is not None for patch in ax.patches) == 2
        star = next(line for line in ax.lines if line.get_marker() == "*")
        assert (star.get_markerfacecolor() == "w") == (mark == "w")
        names = " ".join(" ".join(text.get_text().split()) for text in ax.texts)
        assert ("not verified" in names) == (mark == "w")


def test_a_picture_is_dotted_from_one_peak_to_another_alone(result):
    """At preload 8 another peak is the highest."""
    import matplotlib as mpl

    mpl.use("Agg")
    places = np.arange(len(result))
    curve = replace(result, goes_on=~np.isin(places, [0, 8]))
    for ax in curve.plot().axes:
        dotted = [list(line.get_xdata()) for line in ax.lines if line.get_linestyle() == ":"]
        assert [x for x in dotted if x and x[0] > 1.0] == [
            result.preload[7:9].tolist()
        ]  # others start at 0: limits


def test_preloads_within_an_amplitude(result):
    """Of amplitudes that rise with the preload, and with its inverse, in proportion; the last one is not known."""
    preload = np.geomspace(10.0, 1000.0, 9)
    best = replace(result.optimum, preload=100.0, amplitude=1e-4)
    amplitude = 1e-4 * np.maximum(preload / 100.0, 100.0 / preload)
    amplitude[-1] = np.nan
    curve = replace(result, preload=preload, amplitude=amplitude, optimum=best, curves=())
    assert curve.preloads_within(2e-4) == pytest.approx((50.0, 200.0), rel=1e-12)
    assert curve.preloads_within(2e-3) == pytest.approx((10.0, preload[-2]), rel=1e-12)
    assert curve.preloads_within(1e-4) == (100.0, 100.0)
    with pytest.raises(bd.BdamperError, match="amplitude: expected"):
        curve.preloads_within(0.9e-4)


@pytest.mark.slow
def test_a_robust_optimum_follows_peaks_to_its_lowest_preload(study):
    """As the single peak there does, while a preload within the range takes its own curve."""
    single = study.peak(25.0, INTERVAL)
    assert "followed from" in single.reason
    lowest = SteadyPeak(frequency=INTERVAL, lowest=25.0)(study, 25.0)
    assert not lowest["known"] and lowest["search_status"] == single.status
    assert lowest["amplitude"] == pytest.approx(single.lower_bound, rel=1e-8)
    within = SteadyPeak(frequency=INTERVAL, lowest=20.0)(study, 25.0)
    assert within["known"] and within["amplitude"] < 0.5 * lowest["amplitude"]


@pytest.mark.slow
def test_draws_of_a_robust_optimum_are_unknown_at_its_lowest_preload(study):
    """Both draws are the study itself, whose peak at 25 N is a lower bound."""
    assert np.isnan(study.peak(25.0, INTERVAL).amplitude)
    mu = float(study.settings.friction_coefficient)
    found = bd.robust_optimum(
        study, {"friction_coefficient": [mu, mu]}, (25.0, 60.0), n=5, tolerance=0.9,
        frequency=INTERVAL,
    )  # fmt: skip
    assert found.warnings == 2 and 25.0 < found.preload < 60.0


@pytest.mark.slow
def test_one_table_has_all_preloads_that_were_computed(study, tmp_path):
    """The preloads of the search are rows like the requested ones, and each row agrees with its own response curve."""
    asked = np.geomspace(25.0, 60.0, 5)
    curve = study.optimal_curve(asked, frequency=INTERVAL, check=False)
    o = curve.optimum
    assert curve.preload[curve.requested].tolist() == asked.tolist() and not curve.requested.all()
    assert (
        [response.preload for response in curve.curves]
        == curve.preload.tolist()
        == sorted(curve.preload)
    )
    single = [study.peak(p, INTERVAL) for p in curve.preload]
    assert curve.amplitude == pytest.approx(
        [peak.amplitude for peak in single], rel=1e-8, nan_ok=True
    )
    # at the lowest preload a peak from below the range is higher, as at a single preload
    assert "followed from" in single[0].reason
    assert curve.status_text[0] == single[0].status_text
    assert curve.amplitude[1:] == pytest.approx(
        [response.amplitude.max() for response in curve.curves[1:]], rel=0.01
    )
    (row,) = np.flatnonzero(curve.preload == o.preload)
    assert (
        o.kind == "smooth"
        and not curve.requested[row]
        and curve.amplitude[row] == o.amplitude == np.nanmin(curve.amplitude)
    )
    # above the optimum the range ends where the amplitude is 20 % higher, below it at the last known preload
    below, above = curve.preloads_within(1.2 * o.amplitude)
    assert below == curve.preload[1]
    assert study.peak(above, INTERVAL).amplitude == pytest.approx(1.2 * o.amplitude, rel=0.005)
    curve.to_csv(tmp_path / "curve.csv")
    head, *rows = csv.reader(
        line for line in (tmp_path / "curve.csv").read_text().splitlines() if line[0] != "#"
    )
    assert [row[head.index("requested")] for row in rows] == [
        str(x) for x in curve.requested.tolist()
    ]
    curve.save(tmp_path / "curve.h5")
    again = bd.load(tmp_path / "curve.h5")
    assert again.requested.tolist() == curve.requested.tolist() and len(again.curves) == len(again)
    with h5py.File(tmp_path / "curve.h5", "r+") as file:
        del file["requested"]
    assert bd.load(tmp_path / "curve.h5").requested.all(), (
        "older files have the requested preloads alone"
    )


@pytest.mark.slow
@pytest.mark.parametrize("slope", [1.0, np.nan])
def test_the_least_just_above_the_preloads_that_rattle_is_found(study, monkeypatch, slope):
    """The amplitude falls with the preload until steady responses end at 70 N, between two preloads of the range."""
    peak = study.peak(500.0, INTERVAL)

    def given(problem, preload, *_):
        curve = replace(
            without_points(problem, preload, "", ContinuationOptions(), Cost()), status="complete"
        )
        top = Highest(replace(peak, amplitude=1e-6 * preload, parameter=preload), "peak", 0)
        return AtPreload(preload, curve, top, slope, "it rattles" * (preload < 70.0), Cost())

    monkeypatch.setattr(optimal_curve, "at_preload", given)
    curve = study.optimal_curve((10.0, 1000.0), 9, check=False)
    assert 70.0 < curve.optimum.preload < 70.0 * np.exp(CORNER) and curve.optimum.kind == "edge"
    assert curve.optimum.status == "complete" and curve.lowest_steady_preload < 70.0
    followed = [response for response in curve.curves if response.reason != "no curve was followed"]
    assert len(curve.curves) == len(curve) > len(followed)
    assert len(followed) <= 7 + (
        10 if np.isnan(slope) else 5
    )  # down to two that rattle, then halved


@pytest.mark.slow
def test_a_curve_that_uses_up_its_first_budget_is_followed_again(study, monkeypatch):
    """So that no value is missing where study.peak has one; but not where the damper rattles."""
    monkeypatch.setattr(optimal_curve, "BUDGET", 100)
    curve = study.optimal_curve([500.0, 1000.0, 2000.0], frequency=INTERVAL, check=False)
    assert curve.amplitude == pytest.approx(
        [study.peak(p, INTERVAL).amplitude for p in curve.preload], rel=1e-9
    )
    used = [c.cost.evaluations for c in curve.curves]
    assert min(used) > 200 and curve.cost.evaluations >= sum(used) + 100 * len(used), (
        "both budgets count"
    )
    monkeypatch.setattr(highest_peak, "rattles", lambda curve, at_rest: "it rattles")
    there = optimal_curve.at_preload(study.problem, 1000.0, INTERVAL, budget=100)
    assert not there.known and there.cost.evaluations < 200


@pytest.mark.slow
@pytest.mark.parametrize("n", [2, 3, 4, 6])
def test_few_preloads_lead_to_the_same_optimum_as_many(n):
    """Beside the lowest of two to four preloads is another minimum, 17 % higher, which whole response curves agree with."""
    study = bd.Study(
        bd.reference_model(), bd.Excitation("tip", "tangential"), 5, friction_coefficient=0.4, harmonics=1,
        contact_stiffness="residual_modes",
    )  # fmt: skip
    best = study.optimal_curve((60.0, 20e3), n, check=False).optimum
    assert best.ok
    assert (best.preload, best.amplitude) == pytest.approx((191.2543, 1.398973e-4), rel=1e-5)
