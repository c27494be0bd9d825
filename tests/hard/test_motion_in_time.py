"""One motion in time: periodic, subharmonic and irregular responses, beside an integrator of its own."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import bdamper as bd
from bdamper.response.verification import energy_change, energy_shares
from bdamper.time_domain import time_response
from bdamper.time_domain.integration import IntegrationFailed
from bdamper.time_domain.transient import CRITERIA, repeats_after, to_come
from tests.each import each
from tests.hard.test_time_domain import rig
from tests.integrations import interrupted_at
from tests.printed import said

TAU = 2.0 * np.pi
DAMPING = 0.04


def motion(stop, omega, periods, steps=200):
    """A mass on a spring that meets a second spring at rest (Shaw and Holmes 1983, zero clearance)."""
    study = bd.lumped(
        [1.0],
        [DAMPING],
        [1.0],
        contacts=[bd.Contact(normal=0, kn=stop)],
        forces={0: 1.0},
        harmonics=3,
    )
    f = omega / TAU
    curve = study.frequency_response(0.0, (0.999 * f, 1.001 * f))
    return study.motion_in_time(curve, frequency=f, periods=periods, steps_per_period=steps)


@pytest.mark.parametrize(("stop", "omega", "repeats"), [
    (3.0, 1.5, 1),
    pytest.param(8.0, 3.0, 2, marks=pytest.mark.slow),
    pytest.param(80.0, 4.7, None, marks=pytest.mark.slow),
])  # fmt: skip
def test_kind_of_response(stop, omega, repeats):
    """Twice the frequency of a bilinear oscillator is its resonance of every second period."""
    found = motion(stop, omega, 160 if repeats == 1 else 300)
    assert found.repeats_after == repeats
    assert found.lowest <= found.mean <= found.highest
    assert (found.highest > 1.02 * found.lowest) == (repeats != 1)
    assert {1: "periodic", 2: "2-periodic", None: "irregular"}[repeats] in found.summary()


@pytest.mark.slow
def test_energy_from_the_contacts_is_an_error_of_the_time_steps():
    """A stop returns no more than it stores; with 32 steps it gives most of the energy, and 0.67 m instead of 0.357 m."""
    said = r"the time steps change its energy by \d+ % per period; use steps_per_period=512"
    with pytest.raises(IntegrationFailed, match=said):  # with 32 steps, and with 128
        motion(1000.0, 1.5, 160, 32)
    with pytest.raises(IntegrationFailed, match="use steps_per_period=2048"):
        motion(1000.0, 1.5, 160, 128)
    fine = motion(1000.0, 1.5, 160, 1600)
    assert fine.status == "complete" and abs(fine.numerical_loss) < 1e-2
    shares = re.search("energy of a period *(.*)", fine.summary()).group(1)
    assert (
        all(abs(float(x)) <= 100.0 for x in re.findall(r"(\S+) %", shares))
        and shares.count("%") == 4
    )
    # the repetition with four times the steps is the motion of these steps
    assert motion(3.0, 1.5, 100, 32).harmonics == pytest.approx(
        motion(3.0, 1.5, 100, 128).harmonics
    )


def test_a_doubt_about_a_motion_with_a_verdict_is_in_its_headline():
    found = replace(motion(3.0, 1.5, 160), status="interrupted")
    agrees = replace(found, verdict="agrees", balance=1.0, reason="+1 %")
    assert "Stays at the solution pass +1 %" in said(agrees)
    assert f"The integration is {found.status}" in said(agrees)
    assert "The integration is" not in said(
        replace(agrees, verdict="undecided", status="incomplete")
    )


@pytest.mark.parametrize(("energy", "change"), [
    ((26.2e-6, 42.4e-6, -2.038e-3, 5.8e-6), ""),
    ((-5.1e-4, 1.2e-5, -9.7e-5, -4.3e-4), "its stored energy changes by -82 % of the energy of a period; use more periods"),
    ((1e-3, 0.95e-3, 0.04e-3, 0.0), ""),
    ((0.0, 0.0, 0.0, 0.0), ""),
])  # fmt: skip
def test_shares_of_an_energy_balance(energy, change):
    """The first motion was printed as "damping 162 %, contacts -7780 %, numerical 7696 %" of the work of 26.2 µJ."""
    assert energy_change(energy) == change
    supplied, shares = energy_shares(energy)
    assert np.abs(shares).max() <= 1.0 and shares.sum() * supplied == pytest.approx(energy[0])


def test_a_settled_motion_may_exchange_energy_with_the_loads_at_rest(monkeypatch):
    """55 blades at 1104 Hz agree to 0.05 % with 4,096 steps, while their loads at rest still do -64 % of the work."""
    contact = bd.Contact(normal=0, kn=3.0, preload=5.0)
    study = bd.lumped([1.0], [0.3], [1.0], contacts=[contact], forces={0: 0.1}, harmonics=2)
    curve = study.frequency_response(0.0, (0.29, 0.3))
    monkeypatch.setattr(time_response, "energy_change", lambda energy: "its stored energy changes")
    assert study.motion_in_time(curve, 0, steps_per_period=300).status == "complete"
    found = study.motion_in_time(curve, frequency=0.295, periods=40, steps_per_period=300)
    assert found.status_text == "incomplete: its stored energy changes"


@pytest.mark.slow
def test_periods_beside_another_integrator():
    found = motion(8.0, 3.0, 240, 400)

    def rate(t, y):
        return [y[1], np.cos(3.0 * t) - DAMPING * y[1] - y[0] - 8.0 * max(y[0], 0.0)]

    period = TAU / 3.0
    long = solve_ivp(rate, (0.0, 300 * period), (0.0, 0.0), rtol=1e-9, atol=1e-11)
    theta = TAU * np.arange(400) / 400
    amplitudes = []
    y = long.y[:, -1]
    for _ in range(2):
        one = solve_ivp(
            rate, (0.0, period), y, t_eval=np.append(theta / 3.0, period), rtol=1e-9, atol=1e-11
        )
        amplitudes.append(abs(np.exp(-1j * theta) @ one.y[0, :-1]) / 200.0)
        y = one.y[:, -1]
    np.testing.assert_allclose(sorted(found.amplitude[-2:]), sorted(amplitudes), rtol=5e-3)


@pytest.mark.parametrize("omega", [1.7, 2.4])
def test_linear_motion_settles_at_its_closed_form(omega):
    """A load holds the mass against the stop, and it vibrates on both springs; the start is at another frequency."""
    contact = bd.Contact(normal=0, kn=3.0, preload=5.0)
    study = bd.lumped([1.0], [0.3], [1.0], contacts=[contact], forces={0: 0.1}, harmonics=2)
    curve = study.frequency_response(0.0, (0.29, 0.3))
    found = study.motion_in_time(curve, frequency=omega / TAU, periods=40, steps_per_period=300)
    assert (found.repeats_after, found.status) == (1, "complete")
    assert np.isnan(found.balance) and not found.verdict
    assert found.harmonics[-1, 1] == pytest.approx(0.1 / (4.0 - omega**2 + 0.3j * omega), rel=1e-3)


def test_a_transient_is_not_taken_for_the_end():
    """Lightly damped, at resonance, from a solution beside it: it still grows."""
    contact = bd.Contact(normal=0, kn=3.0, preload=50.0)
    study = bd.lumped([1.0], [2e-4], [1.0], contacts=[contact], forces={0: 1e-3}, harmonics=1)
    curve = study.frequency_response(0.0, (0.25, 0.26))
    found = study.motion_in_time(curve, frequency=1.0 / np.pi, periods=32, steps_per_period=200)
    left = to_come(found.amplitude, 2.0 / (np.pi * 2e-4))
    assert (
        found.status_text
        == f"incomplete: the mean changes by another {100.0 * left:+.2g} % by estimate; use more periods"
    )
    assert found.mean * (1.0 + left) > 2.0 * found.mean


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_is_still_to_come_of_a_response(sign):
    """All that is left of an exponential: with it the mean of the last quarter is where it goes, whatever the mean does."""
    k, memory = np.arange(80.0), 60.0
    amplitude = 2.0 + sign * np.exp(-k / memory)
    left = to_come(amplitude, memory)
    assert amplitude[60:].mean() * (1.0 + left) == pytest.approx(2.0, rel=1e-12)
    assert np.sign(left) == -sign and abs(left) > 0.1
    assert to_come(amplitude, 1.0) == pytest.approx(0.0, abs=1e-9)
    assert to_come(np.ones(40), 1e9) == 0.0


def test_periods_after_which_sequences_repeat():
    one = np.ones((40, 3), complex)
    assert repeats_after(one) == 1
    other = one.copy()
    other[::3, 1] = 2.0
    assert repeats_after(other) == 3
    noisy = one + 0.01 * np.random.default_rng(0).standard_normal((40, 3))
    assert repeats_after(noisy) is None
    mean = one.copy()
    mean[:, 0] = np.arange(40.0)  # the mean of a free body does not count
    assert repeats_after(mean) == 1


@pytest.fixture(scope="module")
def study():
    return rig({}).replace(harmonics=3)


@pytest.fixture(scope="module")
def curve(study):
    return study.frequency_response(50.0, (290.0, 320.0))


def test_a_stable_solution(study, curve):
    found = study.motion_in_time(curve, frequency=float(curve.frequency[3]), periods=30)
    assert found.mean == pytest.approx(curve.amplitude[3], rel=0.01)
    assert (found.preload, found.model_hash) == (50.0, study.model.hash)
    assert (
        "periodic" in said(found)
        and found.blades.shape == (15, 1)
        and len(found.columns()["period"].values) == 30
    )
    assert found.plot().axes[0].get_xlabel() == "Period of the excitation"


@pytest.mark.slow
def test_without_an_index_it_is_the_peak(study, curve):
    found = study.motion_in_time(curve)
    assert (
        found.verdict == "agrees"
        and found.status == "complete"
        and " ".join(found.reason.split()) in said(found)
    )
    assert found.frequency == curve.peak.frequency
    assert found.balance == pytest.approx(curve.peak.amplitude, rel=1e-13)
    assert found.plot().axes[0].get_title().endswith(": agrees")
    last, expected = found.harmonics[-1, 1:], curve.harmonics[curve.peak_index, 1:]
    assert found.distance == pytest.approx(
        np.linalg.norm(last - expected) / np.linalg.norm(expected), rel=1e-6
    )
    few = study.motion_in_time(curve, periods=5, steps_per_period=400)
    assert (few.verdict, few.status, len(few.harmonics)) == (
        "undecided",
        "incomplete",
        5,
    )
    far = study.motion_in_time(curve, periods=96, tolerance=1e-4, steps_per_period=256)
    assert far.verdict == "does not agree" and far.reason in far.summary()


@each("asked", [{"frequency": 300.0, "periods": 100}, {"index": 3, "periods": 100}])
def test_ctrl_c_leaves_the_periods_so_far(study, curve, monkeypatch, asked):
    interrupted_at(monkeypatch, CRITERIA.look + 2)
    found = study.motion_in_time(curve, **asked, steps_per_period=400)
    assert (found.status, len(found.harmonics)) == ("interrupted", CRITERIA.look + 2)
    monkeypatch.undo()
    interrupted_at(monkeypatch, CRITERIA.look - 1 if "frequency" in asked else 0)
    with pytest.raises(KeyboardInterrupt):
        study.motion_in_time(curve, **asked, steps_per_period=400)


@pytest.mark.parametrize(
    ("ask", "name"),
    [
        (lambda s, c: s.motion_in_time("curve"), "curve"),
        (lambda s, c: s.motion_in_time(c, frequency=-1.0), "frequency"),
        (lambda s, c: s.motion_in_time(c, 3, frequency=300.0), "index"),
        (lambda s, c: s.motion_in_time(c, 10**6), "index of a point"),
        (lambda s, c: s.motion_in_time(c, frequency=300.0, periods=3), "periods"),
        (lambda s, c: s.motion_in_time(c, periods=0), "periods"),
        (lambda s, c: s.motion_in_time(c, tolerance=0.0), "tolerance"),
        (
            lambda s, c: s.motion_in_time(c, frequency=300.0, steps_per_period=1.5),
            "steps_per_period",
        ),
        (lambda s, c: s.motion_in_time(c, frequency=300.0, steps_per_period=8), "steps_per_period"),
        (lambda s, c: s.motion_in_time(c, steps_per_period=0), "steps_per_period"),
    ],
)
def test_bad_arguments(study, curve, ask, name):
    with pytest.raises(bd.SettingError, match=f"^{name}: expected .*, found "):
        ask(study, curve)


STUDIES = Path(__file__).resolve().parents[3] / "shared" / "fixtures" / "studies"


@pytest.mark.skipif(
    not STUDIES.exists(), reason="needs the stored studies, which are not in the repository"
)
def test_a_slow_drift_beside_a_fold_does_not_agree():
    """An independent integration has 1.539 m after 100 periods and 0.81 m after 400; harmonic balance has 1.58 m."""
    study = bd.load_study(STUDIES / "study_42.h5")
    curve = study.frequency_response(0.8579590304456608, (0.10280426240243959, 0.4582763145428466))
    found = study.motion_in_time(curve)
    assert found.verdict == "does not agree"


def test_a_highest_motion_that_its_time_steps_feed_has_no_amplitude():
    """Even 128 steps in a period do not resolve a stop a thousand times as stiff as the spring."""
    contacts = [bd.Contact(normal=0, kn=1000.0)]
    study = bd.lumped([1.0], [DAMPING], [1.0], contacts=contacts, forces={0: 1.0}, harmonics=3)
    curve = study.frequency_response(0.0, (0.2, 0.4))
    found = study.time_response(curve, steps_per_period=32)
    assert found.status_text.startswith("not found: the time steps change its energy by ")
    assert (
        found.reason.endswith("use steps_per_period=512")
        and np.isnan(found.highest)
        and not found.answers
    )
