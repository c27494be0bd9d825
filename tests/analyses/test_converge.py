"""More harmonics at one peak: amplitudes against whole curves, their rate, what ends them, modes met, the branch held."""

import re
import signal
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.analyses import accuracy as room
from bdamper.lumped_masses import Contact, lumped
from bdamper.response import richer_peak
from bdamper.response.peak import sign_of_jacobian
from bdamper.response.richer_peak import Change, RicherPeaks, reach, with_more_harmonics
from bdamper.response.verification import Convergence, HarmonicPeak, Meeting
from bdamper.util.errors import BdamperError
from bdamper.util.formatting import span
from bdamper.util.progress import raise_if_stopped
from tests import models
from tests.plain import plain_study
from tests.printed import said

INTERVAL = (280.0, 370.0)
BAND = (0.1, 0.3)


def jenkins(**settings):
    """A mass with a Jenkins element under a constant normal load, in resonance near 0.18 Hz."""
    return lumped(
        1, 0.02, 1, contacts=[Contact(0, kt=1, mu=1, preload=1)], forces={0: 1.0}, **settings
    )


def with_absorber(ratio):
    """The same with a small mass beside it, whose own resonance is at ``ratio`` times that of the peak."""
    own = 0.01 * (2.0 * np.pi * 0.1763 * ratio) ** 2
    return lumped(
        [1.0, 0.01], [0.02, 1e-4], [[1.0 + own, -own], [-own, own]], contacts=[Contact(0, kt=1, mu=1, preload=1)],
        forces={0: 1.0}, harmonics=1,
    )  # fmt: skip


@pytest.fixture(scope="module")
def study():
    return plain_study(bd.reference_model("bladed_disk", 9), bd.Excitation("tip"), 5)


@pytest.fixture(scope="module")
def blade():
    return bd.Study(
        bd.reference_model("turbine_blade"), bd.Excitation("tip"), 5, friction_coefficient=0.3
    )


@pytest.fixture(scope="module")
def curve(study):
    return study.optimal_curve((3000.0, 5000.0), 2, frequency=INTERVAL, check=False)


def series(*amplitudes, status="complete", reason="", tolerance=0.05, internal_resonances=()):
    """A convergence with 1, 3, 5 ... harmonics."""
    peaks = tuple(HarmonicPeak(2 * i + 1, a, 300.0) for i, a in enumerate(amplitudes))
    return Convergence(100.0, tolerance, peaks, internal_resonances, status=status, reason=reason)


class TestPeaks:
    @pytest.mark.slow
    def test_are_those_of_studies_with_so_many_harmonics(self, study):
        found = study.harmonic_convergence(study.peak(5000.0, INTERVAL), harmonics=(3, 5, 7))
        assert [p.harmonics for p in found.peaks] == [1, 3, 5, 7] and found.status == "complete"
        for p in found.peaks:
            own = study.replace(harmonics=p.harmonics).peak(5000.0, INTERVAL)
            assert (p.amplitude, p.frequency) == pytest.approx(
                (own.amplitude, own.frequency), rel=1e-6
            )
        assert found.cost.iterations > 0
        assert all(p.seconds > 0.0 for p in found.peaks[1:]) and found.cost.processor > 0.0

    def test_converge_at_the_rate_of_a_force_with_corners(self):
        """A Jenkins element has a force with corners: its harmonics fall with l^-2 and those of the motion with l^-4, so
        that H harmonics leave an error of the order of the amplitude times H^-4."""
        study, asked = jenkins(harmonics=1), (3, 5, 7, 9, 11, 13, 17, 21, 25, 33, 63)
        found = study.harmonic_convergence(study.peak(0.0, BAND), harmonics=asked, tolerance=1e-12)
        amplitude, harmonics = np.array([(p.amplitude, p.harmonics) for p in found.peaks]).T
        error = np.abs(amplitude[:-1] / amplitude[-1] - 1.0) * harmonics[:-1] ** 4
        assert len(error) == 11 and error.max() < 1.0 and error[-3:].max() > 0.05

    def test_only_odd_harmonics_where_even_ones_vanish(self, study):
        study = study.replace(variable_normal_load=False, separation=False)
        found = study.harmonic_convergence(study.peak(5000.0, INTERVAL), harmonics=(5, 8))
        last = study.replace(harmonics=8).peak(5000.0, INTERVAL)
        assert [p.harmonics for p in found.peaks] == [1, 5, 7]
        assert found.peaks[-1].amplitude == pytest.approx(last.amplitude, rel=1e-6)

    def test_keep_the_sign_of_det_j(self, study, monkeypatch):
        """By the determinant itself, at every peak; a solution of the other sign is refused."""
        seen, to = [], room.richer_peaks

        def recorded(problem, richer, *rest):
            found = to(problem, richer, *rest)
            seen.append((richer, found.peaks[0]))
            return found

        monkeypatch.setattr(room, "richer_peaks", recorded)
        peak = study.peak(5000.0, INTERVAL)
        study.harmonic_convergence(peak, harmonics=(3, 5))
        signs = [
            np.linalg.slogdet(at.system(5000.0).evaluate(top.y[:-1], top.y[-1])[1])[0]
            for at, top in seen
        ]
        system = study.problem.system(5000.0)
        own = np.linalg.slogdet(system.evaluate(peak.y[:-1], peak.y[-1])[1])[0]
        assert len(seen) == 2 and set(signs) == {own} and sign_of_jacobian(system, peak.y) == own
        richer = with_more_harmonics(study.problem)
        assert reach(study.problem, richer, 5000.0, peak).peak is not None

        def of_another_part(equations, y):
            sign = sign_of_jacobian(equations, y)
            return -sign if equations is system else sign

        monkeypatch.setattr(richer_peak, "sign_of_jacobian", of_another_part)
        refused = reach(study.problem, richer, 5000.0, peak)
        assert refused.peak is None and not refused.known and refused.iterations > 0

    def test_half_of_the_harmonics_first_where_newton_fails(self, study, monkeypatch):
        """It fails here by more than two harmonics at once."""
        to, asked = room.richer_peaks, []

        def near_only(problem, richer, *rest):
            top = richer.harmonic_numbers[-1]
            n_new = top - problem.harmonic_numbers[-1]
            asked.append((top, n_new))
            return RicherPeaks(Change(how="too far")) if n_new > 2 else to(problem, richer, *rest)

        monkeypatch.setattr(room, "richer_peaks", near_only)
        found = study.harmonic_convergence(study.peak(5000.0, INTERVAL), harmonics=(6,))
        assert found.status == "complete" and found.peaks[-1].harmonics == 6
        assert [n for n, _ in asked][:2] == [6, 3] and max(n for _, n in asked[1:]) <= 3

    def test_the_curve_near_the_peak_where_newton_fails(self, study, monkeypatch):
        """It gives the same peak; Newton's method failed so on a blade of nickel alloy, whose convergence then ended."""
        peak = study.peak(5000.0, INTERVAL)
        by_newton = study.harmonic_convergence(peak, harmonics=(5,)).peaks[-1]
        too_far = RicherPeaks(Change(how="too far"))
        monkeypatch.setattr(room, "richer_peaks", lambda *_: too_far)
        found = study.harmonic_convergence(peak, harmonics=(5,))
        assert found.status == "complete" and found.peaks[-1].harmonics == 5
        assert found.peaks[-1].amplitude == pytest.approx(by_newton.amplitude, rel=1e-6)
        monkeypatch.setattr(room, "NEARBY_BUDGET", 20)
        broken = study.harmonic_convergence(peak, harmonics=(6,))
        start = "no peak was found near this one with 6 harmonics (too far; the response curve near it is "
        assert broken.status == "incomplete" and broken.reason.startswith(f"{start}incomplete:")
        assert (
            len(broken.peaks) == 1
            and not broken.ok
            and "not known with more harmonics" in broken.note
        )

    def test_after_ctrl_c_with_what_is_known(self, study, monkeypatch):
        to = room.richer_peaks

        def stops(problem, richer, *rest):
            if richer.harmonic_numbers[-1] == 5:
                raise KeyboardInterrupt
            return to(problem, richer, *rest)

        monkeypatch.setattr(room, "richer_peaks", stops)
        found = study.harmonic_convergence(study.peak(5000.0, INTERVAL), harmonics=(3, 5))
        assert found.status == "interrupted" and [p.harmonics for p in found.peaks] == [1, 3]

    def test_what_is_refused(self, study):
        peak = study.peak(5000.0, INTERVAL)
        for wrong, what in (
            ({"harmonics": (5, 3)}, "harmonics"), ({"harmonics": (65,)}, "harmonics"), ({"tolerance": 5.0}, "tolerance"),
        ):  # fmt: skip
            with pytest.raises(bd.SettingError, match=f"^{what}: expected"):
                study.harmonic_convergence(peak, **wrong)
        with pytest.raises(bd.SettingError, match=r"^peak: expected a converged one"):
            study.harmonic_convergence(replace(peak, status="not found", reason="why"))
        with pytest.raises(bd.SettingError, match=r"^peak: expected a result of this study"):
            study.replace(friction_coefficient=0.1).harmonic_convergence(peak)
        with pytest.raises(bd.SettingError, match=r"^peak: expected a Peak"):
            study.harmonic_convergence(study.frequency_response(5000.0, INTERVAL))


class TestEnd:
    def test_of_the_structure(self, study):
        """Without residual modes there are the five modes that the study retains, at each harmonic's own diameter."""
        study = study.replace(blade_modes=5)
        peak = study.peak(5000.0, INTERVAL)
        bases = study.model.bodies["blade"].bases
        diameter = {l: study.model.folded_nodal_diameter(5 * l)[0] for l in range(2, 27)}
        top = {l: np.sqrt(bases[d].omega2[4]) / (2.0 * np.pi) for l, d in diameter.items()}
        first = min(l for l in top if l * peak.frequency > top[l])
        found = study.harmonic_convergence(peak, harmonics=(3, 26))
        assert 4 < first < 26 and [p.harmonics for p in found.peaks] == [1, 3, first - 1]
        end = f"{1e-3 * top[first]:.3g} kHz"
        assert (
            f"the equations have no modes above {end}, harmonic {int(top[first] / peak.frequency)}"
            in found.note
        )

    def test_of_the_nodal_diameters(self):
        model = models.wedge_model(0, n_blades=24, engine_order=2, harmonics=3)
        study = plain_study(model, bd.Excitation("tip"), 2)
        found = study.harmonic_convergence(study.peak(5.0), harmonics=(3, 5))
        assert [p.harmonics for p in found.peaks] == [1, 3]
        assert found.highest_harmonic == "the model has no modes of harmonic 4, nodal diameter 8"

    def test_of_the_samples(self, study):
        sampled = study.replace(contact_forces=bd.AFT(24))
        found = sampled.harmonic_convergence(sampled.peak(5000.0, INTERVAL), harmonics=(3, 5, 7))
        assert [p.harmonics for p in found.peaks] == [1, 3, 5]
        assert found.highest_harmonic.startswith(
            "7 harmonics are not possible with the same settings (contact_forces: "
        )

    def test_early_where_no_later_harmonic_meets_a_mode(self):
        study = jenkins(harmonics=1)
        found = study.harmonic_convergence(study.peak(0.0, BAND))
        assert (
            found.ok
            and found.highest_harmonic == "no later harmonic is near a mode"
            and found.internal_resonances == ()
        )
        assert found.peaks[-1].harmonics < 26

    def test_not_before_a_mode_that_is_met_later(self):
        study = with_absorber(19.0)
        found = study.harmonic_convergence(study.peak(0.0, BAND))
        assert found.peaks[-1].harmonics >= 20


class TestMeetings:
    @pytest.mark.parametrize("ratio", [3, 7])
    def test_name_a_mode_that_is_placed_on_purpose(self, ratio):
        study = with_absorber(ratio)
        peak = study.peak(0.0, BAND)
        found = study.harmonic_convergence(peak, harmonics=(2, 3, 5, 7, 9))
        (met,) = (m for m in found.internal_resonances if m.harmonic == ratio)
        K = np.array([[2.0, 0.0], [0.0, 0.0]]) + 0.01 * (
            2.0 * np.pi * 0.1763 * ratio
        ) ** 2 * np.array([[1, -1], [-1, 1]])
        modes = np.sqrt(np.linalg.eigvals(np.diag([1.0, 100.0]) @ K)) / (2.0 * np.pi)
        assert (met.mode, met.nodal_diameter) == (2, -1) and met.frequency == pytest.approx(
            modes.max(), rel=1e-9
        )
        assert met.distance == pytest.approx(ratio * peak.frequency / modes.max() - 1.0, rel=1e-9)
        assert re.match(
            rf"harmonic {ratio} is within .* % of mode 2 of the stuck structure \(", str(met)
        )

    @pytest.mark.slow
    def test_at_the_nodal_diameter_of_the_harmonic(self, blade):
        """Harmonic 16 of engine order 5 has nodal diameter 20 of 60 sectors."""
        found = list(room._meetings(blade.replace(harmonics=16).problem, blade.peak(103.6)))
        met = {m.harmonic: m for m in found}
        assert (
            met[16].nodal_diameter == 20
            and met[16].mode == 7
            and met[16].distance == pytest.approx(0.016, abs=2e-3)
        )
        assert all(abs(m.distance) <= room.NEAR_MODE for m in found) and 14 not in met


class TestClaims:
    def test_agreement_of_a_few_is_no_convergence(self):
        """Figures of the turbine blade: the same with 3 to 9 harmonics, 6 % less from 14 on."""
        found = series(75.3e-6, 75.0e-6, 75.0e-6, 74.2e-6, 69.4e-6, 70.7e-6, 69.2e-6)
        assert not found.ok and [p.harmonics for p in found.settled] == [9, 11, 13]
        said = "75.3 µm with 1 harmonic, 69.2 to 75 µm with 3 to 13, 69.2 to 70.7 µm from 9 on: not converged with 1"
        assert found.note.startswith(said)

    def test_the_largest_value_is_not_hidden(self):
        """The peaks with more harmonics agree from the fourth on, and the second is higher than all."""
        found = series(92e-6, 97.5e-6, 93e-6, 91.1e-6, 93e-6, 95.2e-6, tolerance=0.045)
        assert [p.harmonics for p in found.settled] == [5, 7, 9, 11] and found.range == (
            91.1e-6,
            97.5e-6,
        )
        assert (
            "91.1 to 97.5 µm with 3 to 11, 91.1 to 95.2 µm from 5 on: not converged with 1"
            in found.note
        )

    def test_meetings_are_named(self):
        found = series(
            1.0,
            1.0,
            0.8,
            0.8,
            internal_resonances=(Meeting(4, 4, 10, 9e3, -0.03), Meeting(5, 4, 10, 9e3, 0.01)),
        )
        where = "harmonic 5 1 % of mode 4 of the stuck structure at nodal diameter 10 (9000 Hz)"
        assert where in said(found)

    def test_all_agree_up_to_the_end(self):
        assert series(1.0, 1.01, 0.99).ok and "converged to 5 %" in series(1.0, 1.01, 0.99).note
        assert not series(1.0, 1.0).ok and "agrees so far" in series(1.0, 1.0).note
        assert not series(1.0, 1.0, 1.0, status="incomplete", reason="why").ok

    def test_nothing_settles(self):
        found = series(1.0, 0.8, 0.6)
        assert (
            found.range == (0.6, 1.0)
            and "600 to 800 mm with 3 to 5: not converged with 1" in found.note
        )


class TestOptimalCurve:
    @pytest.mark.slow
    def test_has_it_at_its_optimum(self, study, curve, tmp_path, capsys, monkeypatch):
        monkeypatch.setattr("bdamper.util.progress.FIRST_LINE", 0.0)
        found = room.with_convergence(study.problem, curve, lambda: curve, progress=True)
        assert "harmonic convergence: 7 harmonics: " in capsys.readouterr().err
        more = found.convergence
        assert [p.harmonics for p in more.peaks][:3] == [1, 5, 7] and max(
            p.harmonics for p in more.peaks
        ) <= 16
        assert more.peaks[0].amplitude == pytest.approx(curve.optimum.amplitude, rel=1e-4)
        assert found.cost.evaluations == curve.cost.evaluations + more.cost.evaluations
        assert more.cost.evaluations > 0 and found.cost.seconds > curve.cost.seconds
        assert f"{span(*more.range, 'm')} with {more.peaks[0].harmonics} to " in said(
            found
        ) and more.note in said(found)
        found.save(tmp_path / "optimal.h5")
        assert bd.load(tmp_path / "optimal.h5").convergence == more

    @pytest.mark.slow
    def test_searches_the_curve_once_and_then_leaves_numbers_out(self, study, curve, monkeypatch):
        """Each search with 9 to 16 harmonics takes longer than the optimal curve of the disk."""
        to, searched = room.richer_peaks, []

        def fails_at(problem, richer, *rest):
            fails = richer.harmonic_numbers[-1] in (4, 5, 8, 9)
            return RicherPeaks(Change(how="stalls")) if fails else to(problem, richer, *rest)

        def counted(problem, *rest, **more):
            searched.append(problem.harmonic_numbers[-1])
            return search(problem, *rest, **more)

        search = room.found_at
        monkeypatch.setattr(room, "richer_peaks", fails_at)
        monkeypatch.setattr(room, "found_at", counted)
        monkeypatch.setattr(room, "CONVERGED_SHARE", 0.0)
        found = room.at_optimum(study.problem, curve)
        assert searched == [5] and found.status == "complete"
        assert [p.harmonics for p in found.peaks] == [1, 5, 7, 12, 16]
        # independent searches with the same modes
        for p in found.peaks[1:3]:
            richer = study.replace(harmonics=p.harmonics, blade_modes=found.blade_modes)
            own = richer.peak(found.preload, INTERVAL)
            assert p.amplitude == pytest.approx(own.amplitude, rel=1e-4)
        monkeypatch.setattr(room, "richer_peaks", lambda *_: RicherPeaks(Change(how="stalls")))
        last = room.at_optimum(study.problem, curve)
        assert last.status == "incomplete" and "with 16 harmonics (stalls)" in last.reason

    @pytest.mark.slow
    def test_has_the_modes_of_the_study_if_none_is_found_with_more(self, study, curve, monkeypatch):
        """A random sector had no answer with 5 harmonics and 40 modes, and one with its own 10."""
        to = room.richer_peaks

        def with_few_modes(problem, richer, *rest):
            few = richer.settings.blade_modes == study.settings.blade_modes
            return to(problem, richer, *rest) if few else RicherPeaks(Change(how="stalls"))

        def nothing(*_, **__):
            raise BdamperError("nothing")

        monkeypatch.setattr(room, "richer_peaks", with_few_modes)
        monkeypatch.setattr(room, "found_at", nothing)
        found = room.at_optimum(study.problem, curve)
        assert found.status == "complete" and found.blade_modes == 0 and len(found.peaks) > 3
        own = study.replace(harmonics=5).peak(found.preload, INTERVAL)
        assert found.peaks[1].amplitude == pytest.approx(own.amplitude, rel=1e-4)

    @pytest.mark.slow
    def test_shows_its_progress_if_the_curve_does(self, study, curve, monkeypatch):
        shown = []
        monkeypatch.setattr(
            room,
            "with_convergence",
            lambda _, plain, work, progress, *__: shown.append(progress) or plain,
        )
        monkeypatch.setattr(
            "bdamper.analyses.robust_optimum.with_other_friction",
            lambda problem, plain, *_: plain,
        )
        for progress in (True, False):
            study.optimal_curve(curve.preload[-2:], frequency=INTERVAL, progress=progress)
        assert shown == [True, False]

    def test_says_why_there_is_none(self, study, curve):
        wrong = replace(
            curve, optimum=replace(curve.optimum, amplitude=0.5 * curve.optimum.amplitude)
        )
        assert room.at_optimum(study.problem, wrong).status_text.startswith(
            "not found: the highest peak there is "
        )
        none = replace(curve, optimum=replace(curve.optimum, preload=np.nan))
        assert room.at_optimum(study.problem, none) is None

    def test_ends_with_the_work_beside_it(self, study, curve, monkeypatch):
        def stops(*_):
            raise KeyboardInterrupt

        monkeypatch.setattr(room, "_converge", stops)
        assert (
            room.with_convergence(study.problem, curve, lambda: curve).convergence.status
            == "interrupted"
        )
        with pytest.raises(KeyboardInterrupt):
            room.with_convergence(study.problem, curve, stops)

    def test_a_finished_curve_survives_an_interrupt_of_the_convergence(
        self, study, curve, monkeypatch
    ):
        """Ctrl-C arrives while the main thread waits for the convergence alone."""
        finished = threading.Event()

        def interrupted(*_):
            finished.wait()
            time.sleep(0.05)
            signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)
            try:
                for _ in range(5000):
                    raise_if_stopped()
                    time.sleep(1e-3)
            except KeyboardInterrupt:
                return series(1.0, status="interrupted")
            return series(1.0)

        def work():
            finished.set()
            return curve

        if threading.current_thread() is not threading.main_thread():
            pytest.skip("signals reach the main thread alone")
        monkeypatch.setattr(room, "at_optimum", interrupted)
        # a shell ignores Ctrl-C in its background processes
        before = signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            with bd.set_workers(2):
                found = room.with_convergence(study.problem, curve, work)
        finally:
            signal.signal(signal.SIGINT, before)
        assert found.convergence.status == "interrupted"
        assert found.preload.tolist() == curve.preload.tolist()


@pytest.mark.slow
def test_the_turbine_blade(blade):
    """Three to nine harmonics agree and are 6 to 8 % above what sixteen and more say; five times the optimum converges."""
    found = blade.harmonic_convergence(blade.peak(103.6))
    amplitude = {p.harmonics: 1e6 * p.amplitude for p in found.peaks}
    expected = {3: 75.29, 5: 74.95, 7: 74.96, 9: 75.16, 12: 74.19, 16: 69.41, 20: 70.67, 26: 69.19}
    assert amplitude == pytest.approx(expected, rel=1e-3) and found.status == "complete"
    assert found.note.startswith(
        "75.3 µm with 3 harmonics, 69.2 to 75.2 µm with 5 to 26, 69.2 to 70.7 µm from 16 on: not"
    )
    far = blade.harmonic_convergence(blade.peak(518.0))
    assert far.ok and far.peaks[-1].amplitude == pytest.approx(188.36e-6, rel=1e-3)
