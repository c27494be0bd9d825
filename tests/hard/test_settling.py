"""What a marched structure comes to: periodic, subharmonic and irregular responses, beside an integrator of its own."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

import bdamper as bd
from bdamper.response.branches import NO_SOLUTION, LeftOut
from bdamper.time_domain.integration import Ring
from bdamper.time_domain.march import repeats_after, to_come
from bdamper.time_domain.transients import FEWEST
from tests.hard.test_time_domain import rig
from tests.marches import march_until_settled
from tests.oscillators import oscillator

DAMPING = 0.04


def bilinear(stop):
    """A mass on a spring that meets a second spring at rest (Shaw and Holmes 1983, zero clearance)."""
    return oscillator(
        1.0, DAMPING, [[1.0]], [[0.0], [0.0], [1.0]], [1.0], [1.0], 3, kt=0.0, kn=stop, mu=0.0, n0=0.0
    )  # fmt: skip


def marched(stop, omega, periods, steps=200):
    system = bilinear(stop)
    start = np.full(system.n_unknowns, 0.01)
    return march_until_settled(system, omega, 1, 0, start, preload=0.0, periods=periods, steps_per_period=steps)


@pytest.mark.parametrize(("stop", "omega", "repeats"), [
    (3.0, 1.5, 1),
    pytest.param(8.0, 3.0, 2, marks=pytest.mark.slow),
    pytest.param(80.0, 4.7, None, marks=pytest.mark.slow),
])  # fmt: skip
def test_kind_of_response(stop, omega, repeats):
    """Twice the frequency of a bilinear oscillator is its resonance of every second period."""
    found = marched(stop, omega, 160 if repeats == 1 else 300)
    assert found.repeats_after == repeats
    low, high = found.lowest, found.highest
    assert low <= found.mean <= high
    assert (high > 1.02 * low) == (repeats != 1)
    assert {1: "periodic", 2: "2-periodic", None: "irregular"}[repeats] in found.summary()


@pytest.mark.slow
def test_periods_beside_another_integrator():
    found = marched(8.0, 3.0, 240, 400)

    def rate(t, y):
        return [y[1], np.cos(3.0 * t) - DAMPING * y[1] - y[0] - 8.0 * max(y[0], 0.0)]

    period = 2.0 * np.pi / 3.0
    long = solve_ivp(rate, (0.0, 300 * period), (0.0, 0.0), rtol=1e-9, atol=1e-11)
    theta = 2.0 * np.pi * np.arange(400) / 400
    amplitudes = []
    y = long.y[:, -1]
    for _ in range(2):
        one = solve_ivp(rate, (0.0, period), y, t_eval=np.append(theta / 3.0, period), rtol=1e-9, atol=1e-11)
        amplitudes.append(abs(np.exp(-1j * theta) @ one.y[0, :-1]) / 200.0)
        y = one.y[:, -1]
    np.testing.assert_allclose(sorted(found.amplitude[-2:]), sorted(amplitudes), rtol=5e-3)


def test_linear_motion_settles_at_its_closed_form():
    """Off the stop's side: a load holds the mass against it, and it vibrates about there on both springs."""
    system = oscillator(
        1.0, 0.3, [[1.0]], [[0.0], [0.0], [1.0]], [0.1], [1.0], 2, kt=0.0, kn=3.0, mu=0.0, n0=5.0
    )  # fmt: skip
    for omega in (1.7, 2.4):
        found = march_until_settled(
            system, omega, 1, 0, np.zeros(system.n_unknowns), preload=1.0, periods=40, steps_per_period=300
        )
        assert (found.repeats_after, found.status) == (1, "complete")
        exact = 0.1 / (4.0 - omega**2 + 0.3j * omega)
        assert found.harmonics[-1, 1] == pytest.approx(exact, rel=1e-3)


def test_a_transient_is_not_taken_for_the_end():
    """Lightly damped, from rest, at resonance: it still grows."""
    system = oscillator(
        1.0, 2e-4, [[1.0]], [[0.0], [0.0], [1.0]], [1e-3], [1.0], 1, kt=0.0, kn=3.0, mu=0.0, n0=50.0
    )  # fmt: skip
    found = march_until_settled(
        system, 2.0, 1, 0, np.zeros(system.n_unknowns), preload=0.0, periods=32, steps_per_period=200
    )
    assert found.status.startswith("incomplete: still moving")
    memory = 2.0 / (np.pi * 2e-4)
    left = to_come(found.amplitude, memory)
    assert left > 1.0
    more = int(found.status.split("; some ")[1].split(" more")[0])  # until the same exponential leaves 1 %
    left *= np.exp(-more / memory)
    assert 0.0095 < left <= 0.01


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_is_still_to_come_of_a_response(sign):
    """All that is left of an exponential: with it the mean of the last quarter is where it goes, whatever the mean does."""
    k, memory = np.arange(80.0), 60.0
    amplitude = 2.0 + sign * np.exp(-k / memory)
    left = to_come(amplitude, memory)
    assert amplitude[60:].mean() * (1.0 + left) == pytest.approx(2.0, rel=1e-12)
    assert np.sign(left) == -sign and abs(left) > 0.1
    assert to_come(amplitude, 1.0) == pytest.approx(0.0, abs=1e-9)


def test_judgements_of_sequences():
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
    transient = np.exp(-np.arange(200.0) / 300.0)  # all that is left of it in the last quarter is still to come
    left = transient[-50:].mean()
    assert to_come(2.0 + transient, 300.0) == pytest.approx(-left / (2.0 + left), rel=1e-9)
    assert to_come(np.ones(40), 1e9) == 0.0


@pytest.fixture(scope="module")
def study():
    return rig({}).replace(harmonics=3)


@pytest.fixture(scope="module")
def curve(study):
    return study.frequency_response(50.0, (290.0, 320.0))


def test_settles_on_a_stable_solution(study, curve):
    found = study.settle(curve, float(curve.frequency[3]), periods=30)
    assert found.mean == pytest.approx(curve.amplitude[3], rel=0.01)
    assert (found.preload, found.model_hash) == (50.0, study.model.hash)
    assert "periodic" in found._headline() and found.blades.shape == (15, 1)
    ax = found.plot()
    assert ax.get_xlabel() == "Period of the excitation"
    ax = found.mark(found.mark(curve.plot(Figure().add_subplot())))
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert labels.count("highest blade in time, and range") == 1


def test_goes_where_there_is_no_solution(study, curve):
    assert curve.gap is None
    broken = replace(curve, missing_ranges=(LeftOut(301.0, 301.2, NO_SOLUTION), LeftOut(310.0, 312.0, NO_SOLUTION),
                                      LeftOut(290.0, 320.0, "tangle")))  # fmt: skip
    assert broken.gap == (310.0, 312.0)
    assert study.settle(broken, periods=FEWEST, steps_per_period=400).frequency == 311.0


def test_ctrl_c_keeps_what_is_there(study, curve, monkeypatch):
    march, called = Ring.integrate, []

    def pressed(ring, *given, **named):
        called.append(ring)
        if len(called) == FEWEST + 3:
            raise KeyboardInterrupt
        return march(ring, *given, **named)

    monkeypatch.setattr(Ring, "integrate", pressed)
    found = study.settle(curve, 300.0, periods=100, steps_per_period=400)
    assert found.status == "interrupted"
    assert len(found.harmonics) == FEWEST + 2


@pytest.mark.parametrize(
    ("ask", "name"),
    [
        (lambda s, c: s.settle("curve"), "start"),
        (lambda s, c: s.settle(c), "frequency"),
        (lambda s, c: s.settle(c, -1.0), "frequency"),
        (lambda s, c: s.settle(c, 300.0, periods=3), "periods"),
        (lambda s, c: s.settle(c, 300.0, steps_per_period=1.5), "steps_per_period"),
        (lambda s, c: s.settle(c, 300.0, steps_per_period=8), "steps_per_period"),
    ],
)
def test_bad_arguments(study, curve, ask, name):
    with pytest.raises(bd.SettingError, match=f"^{name}: expected .*, found "):
        ask(study, curve)
