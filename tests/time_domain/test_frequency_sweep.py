"""Slow sweeps in time of one mass: a linear one beside its closed form, one that separates beside its folds."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.time_domain import frequency_sweep
from bdamper.time_domain.integration import IntegrationFailed, TimeSpent
from bdamper.time_domain.transient import CRITERIA
from tests.integrations import fails_after, interrupted_at, spent_at

F0, ZETA = 10.0, 0.01
W0 = 2.0 * np.pi * F0
BAND = 9.5, 10.5


def one_mass(**contact):
    return bd.lumped(
        [[1.0]],
        [[2.0 * ZETA * W0]],
        [[W0**2]],
        contacts=[bd.Contact(**contact)] if contact else [],
        forces={0: 1.0},
    )


@pytest.fixture(scope="module")
def linear():
    return one_mass(tangential=0, kt=1e-3, mu=0.3, preload=1e3)


@pytest.fixture(scope="module")
def separating():
    """A spring that is pressed on with 5 N opens at large amplitudes: the resonance bends to lower frequencies."""
    return one_mass(normal=0, kn=0.5 * W0**2, preload=5.0)


def closed_form(f):
    return 1.0 / np.abs(W0**2 - (2.0 * np.pi * f) ** 2 + 2j * ZETA * W0 * 2.0 * np.pi * f)


def usual(factor):
    """Rate that goes so many half bandwidths within the memory."""
    return factor * 2.0 * np.pi * (ZETA * F0) ** 2


@pytest.mark.slow
@pytest.mark.parametrize("up", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_a_linear_sweep_lags_behind_its_closed_form_by_what_twice_the_rate_changes(linear, up):
    errors, sweeps = [], []
    for factor in (0.05, 0.1):
        found = linear.frequency_sweep(0.0, BAND, up=up, rate=usual(factor), steps_per_period=384)
        exact = closed_form(found.frequency)
        errors.append(np.abs(found.amplitude / exact - 1.0).max())
        sweeps.append(found)
        assert found.complete and not found.jumps and found.up is up
        late = (
            found.highest[0] - F0 if up else F0 - found.highest[0]
        )  # a' + (1 + i x) a = 1 with x' = factor: 2 factor
        assert late == pytest.approx(2.0 * factor * ZETA * F0, rel=0.2)
    slow, fast = (sweep if up else replace(sweep, frequency=sweep.frequency[::-1], harmonics=sweep.harmonics[::-1])
                  for sweep in sweeps)  # fmt: skip
    apart = np.interp(fast.frequency, slow.frequency, slow.amplitude) / fast.amplitude - 1.0
    assert errors[0] == pytest.approx(np.abs(apart).max(), rel=0.15)
    assert 1.7 < errors[1] / errors[0] < 2.3, "of first order in the rate"
    assert found.highest[1] == pytest.approx(exact.max(), rel=0.01)


def test_the_usual_rate_follows_from_the_damping(linear):
    found = linear.frequency_sweep(0.0, (9.9, 10.1))
    assert found.memory == pytest.approx(1.0 / (ZETA * W0))
    assert found.rate == pytest.approx(usual(frequency_sweep.RATE))


@pytest.mark.slow
@pytest.mark.parametrize("up", [True, False])
def test_a_sweep_keeps_its_branch_up_to_the_fold(separating, up):
    curve = separating.replace(harmonics=5).frequency_response(0.0, (11.0, 12.2), stability=True)
    folds = curve.folds[np.argsort(curve.frequency[curve.folds])]
    upper, lower = curve.frequency[folds]  # where the upper branch begins, the lower one ends
    assert curve.amplitude[folds[0]] > 3.0 * curve.amplitude[folds[1]]
    found, faster = (
        separating.frequency_sweep(0.0, (11.2, 12.0), up=up, rate=usual(factor))
        for factor in (0.05, 0.1)
    )
    (jump,) = found.jumps
    ends, other = (lower, upper) if up else (upper, lower)
    late, later = (abs(sweep.jumps[0].frequency - ends) for sweep in (found, faster))
    assert late < later < 0.7 * ZETA * F0 < 0.2 * abs(jump.frequency - other)
    assert (jump.frequency > ends) == up
    assert jump.after / jump.before > 1.8 if up else jump.before / jump.after > 3.0
    # Before it the amplitudes are those of the stable branch
    stable = ~curve.unstable & ((curve.amplitude < 1.01 * curve.amplitude[folds[1]]) == up)
    order = np.argsort(curve.frequency[stable])
    f = found.frequency
    calm = f < jump.frequency - 0.05 if up else f > jump.frequency + 0.05
    expected = np.interp(f, curve.frequency[stable][order], curve.amplitude[stable][order])
    np.testing.assert_allclose(found.amplitude[calm], expected[calm], rtol=0.03)


@pytest.mark.slow
def test_periods_before_an_interruption_are_the_result(linear, monkeypatch):
    whole = linear.frequency_sweep(0.0, BAND)
    settling = -(-round(frequency_sweep.SETTLING * whole.memory * BAND[0]) // CRITERIA.look)
    interrupted_at(monkeypatch, settling + 3)
    found = linear.frequency_sweep(0.0, BAND)
    assert (found.status, len(found)) == ("interrupted", 3 * CRITERIA.look)
    assert f"{len(found)} of {len(whole)} turns" in found.summary()
    np.testing.assert_array_equal(found.harmonics, whole.harmonics[: len(found)])
    np.testing.assert_array_equal(found.frequency, whole.frequency[: len(found)])
    monkeypatch.undo()
    interrupted_at(monkeypatch, 1)
    with pytest.raises(KeyboardInterrupt):
        linear.frequency_sweep(0.0, BAND)


@pytest.mark.slow
def test_periods_before_the_processor_time_is_spent_are_the_result(linear, monkeypatch):
    whole = linear.frequency_sweep(0.0, BAND)
    settling = -(-round(frequency_sweep.SETTLING * whole.memory * BAND[0]) // CRITERIA.look)
    spent_at(monkeypatch, settling + 3)
    found = linear.frequency_sweep(0.0, BAND, seconds=1000.0)
    monkeypatch.undo()
    assert (found.status, len(found)) == ("incomplete", 3 * CRITERIA.look)
    turns = f"after {len(found)} of {len(whole)} turns"
    spent = "the 1000 s of processor time have been used"
    assert found.reason == f"{spent} {turns}; raise seconds, 1000 now"
    np.testing.assert_array_equal(found.harmonics, whole.harmonics[: len(found)])

    spent_at(monkeypatch, 1)
    with pytest.raises(TimeSpent, match=f"{spent} before the sweep began; raise seconds, 1000 now"):
        linear.frequency_sweep(0.0, BAND, seconds=1000.0)


def test_an_integration_that_fails_is_no_sweep(linear, monkeypatch):
    fails_after(monkeypatch, 4)
    with pytest.raises(IntegrationFailed, match="the time integration fails near "):
        linear.frequency_sweep(0.0, BAND, rate=usual(1.0))


def test_it_is_drawn_written_and_read(linear, tmp_path):
    found = linear.frequency_sweep(0.0, BAND, rate=usual(1.0))
    curve = linear.frequency_response(0.0, BAND)
    (ax,) = curve.plot().axes
    assert found.plot(ax=ax.figure) is ax.figure and len(ax.get_legend().get_texts()) == 2
    found.to_csv(tmp_path / "sweep.csv")
    assert (tmp_path / "sweep.csv").read_text().count("\n") > len(found)
    found.save(tmp_path / "sweep.h5")
    read = bd.load(tmp_path / "sweep.h5")
    assert str(read) == str(found) and read.settings == found.settings
    np.testing.assert_array_equal(read.harmonics, found.harmonics)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"frequency": (10.5, 9.5)}, "frequency"),
        ({"up": 1}, "up"),
        ({"rate": 0.0}, "rate"),
        ({"steps_per_period": 2}, "steps_per_period"),
    ],
)
def test_what_does_not_fit_is_refused(linear, options, named):
    with pytest.raises(bd.SettingError, match=named):
        linear.frequency_sweep(0.0, **{"frequency": BAND} | options)


def test_without_damping_there_is_no_usual_rate():
    study = bd.lumped([[1.0]], [[0.0]], [[W0**2]], contacts=[bd.Contact(tangential=0, kt=1e-3, mu=0.3, preload=1e3)],
        forces={0: 1.0})  # fmt: skip
    with pytest.raises(bd.SettingError, match="every mode of the structure needs damping"):
        study.frequency_sweep(0.0, (9.0, 9.5))


def test_scatter_is_no_jump(separating):
    """An amplitude that scatters by a third from turn to turn stays on its level; one that drops for good does not."""
    found = separating.frequency_sweep(0.0, (11.2, 12.0), up=False, rate=usual(0.2))
    n, scatter = len(found), np.random.default_rng(1).uniform(0.7, 1.0, len(found))
    level = np.where(np.arange(n) < n // 2, 2.0, 1.0)
    steady, falls = (
        replace(found, harmonics=np.column_stack([0.0 * a, a]).astype(complex))
        for a in (scatter, level * scatter)
    )
    assert not steady.jumps
    (jump,) = falls.jumps
    assert jump.before / jump.after == pytest.approx(2.0, rel=0.1)
