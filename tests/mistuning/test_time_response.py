"""A wheel as one structure in time: its equations are those of the harmonic balance, and which are integrated in time."""

import re
from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.mistuning import BladedDisk, DamperVariation, DiskPeakOptions, Mistuning, bladed_disk
from bdamper.mistuning.bladed_disk import OneStructure
from bdamper.time_domain.transient import Transient, second_half, settle
from tests.integrations import fails_after
from tests.mistuning.lumped import lumped_study, size, solution
from tests.mistuning.test_symmetry import N, solved, study

OMEGA = 2.0 * np.pi * 190.0
DAMPERS = DamperVariation.of(N, mass=1.0 + 0.1 * np.arange(N), missing=[3])


@pytest.mark.parametrize(("deviation", "tolerance"), [(0.0, 1e-9), (0.03, 3e-4)])
def test_the_one_structure_has_the_solutions_of_the_wheel(deviation, tolerance):
    """To rounding where blades are equal; where they differ the damping that couples modes is left out."""
    X, system = solved(
        BladedDisk(study(harmonics=2), Mistuning.random(N, deviation, seed=1), DAMPERS), OMEGA
    )
    u = system.structure.flat(X)
    for blade in (0, 4):
        one = OneStructure(system, blade)
        v, sector = one.start(u), one.sectors.system
        np.testing.assert_allclose(
            sector.response(v), system.structure.responses(u)[blade], rtol=1e-9
        )
        here, away = (size(sector, sector.residual(np.append(at, OMEGA))) for at in (v, 1.01 * v))
        assert here < tolerance * away


def test_amplitudes_of_all_blades_are_those_of_the_response():
    X, system = solved(BladedDisk(study(), Mistuning.random(N, 0.03, seed=1), DAMPERS), OMEGA)
    u, found = system.structure.flat(X), []
    for blade in (2, 4):
        one = OneStructure(system, blade)
        transient = Transient(one.sectors, OMEGA, one.start(u), 64, blade)
        transient.run(3)
        np.testing.assert_array_equal(transient.amplitude, np.abs(transient.blades[:, blade]))
        found.append(transient.blades)
    np.testing.assert_allclose(found[0], found[1], rtol=1e-9)
    at = one.sectors.rows @ one.sectors.state(one.start(u), OMEGA, 0.0)[0]
    np.testing.assert_allclose(at, system.structure.responses(u).sum(axis=1).real, rtol=1e-9)


def test_a_blade_keeps_a_peak_without_folds():
    """Long steps will do to see that it stays: one harmonic is a tenth too high.  In time, too, this blade is the highest,
    by 2.5 %."""
    wheel = BladedDisk(study(), Mistuning.random(N, 0.03, seed=3))
    peak = wheel.peak(2000.0, options=DiskPeakOptions(least=12, most=12, climbs=2))
    kept = wheel.time_response(peak, steps_per_period=64)
    assert kept.status == "complete" and kept.blade == peak.blade and kept.periods
    assert kept.mean == pytest.approx(peak.amplitude, rel=0.15)
    np.testing.assert_allclose(kept.blades.mean(axis=0), peak.amplitudes, rtol=0.15)
    assert re.search(rf"blade +{peak.blade}\n", kept.summary())
    assert "vibrate alike" not in kept.summary()


def test_a_mean_that_changes_widens_the_range(monkeypatch):
    """The mean is that of the highest blade in time."""
    wheel = BladedDisk(study(), Mistuning.random(N, 0.03, seed=0))
    peak = wheel.peak(2000.0, options=DiskPeakOptions(least=12, most=12, climbs=2))
    changes = iter((0.002, -0.06))
    monkeypatch.setattr(
        bladed_disk, "settle", lambda *asked: settle(*asked)._replace(change=next(changes))
    )
    monkeypatch.setattr(bladed_disk, "step_error", lambda transient: "")  # 32 steps lose energy
    found = wheel.time_response(peak, steps_per_period=32)
    assert found.reason.endswith("its mean is uncertain by 6 %")
    assert found.lowest == pytest.approx(0.94 * min(found.answers.values()))
    assert found.highest == pytest.approx(1.06 * max(found.answers.values()))
    assert found.mean == pytest.approx(second_half(found.blades).mean(axis=0).max(), rel=1e-9)


@pytest.mark.slow
def test_time_steps_that_are_too_long_have_no_amplitude(monkeypatch):
    """With four times the steps the amplitude would count; the second time not even with these."""
    wheel = BladedDisk(study(), Mistuning.random(N, 0.03, seed=0))
    peak = wheel.peak(2000.0, options=DiskPeakOptions(least=12, most=12, climbs=2))
    monkeypatch.setattr(bladed_disk, "step_error", lambda t: "too long" if t.steps < 128 else "")
    found = wheel.time_response(peak, steps_per_period=32)
    assert list(found.answers) == ["128 steps", "256 steps"] and np.isfinite(found.mean)
    monkeypatch.setattr(bladed_disk, "step_error", lambda t: "too long")
    found = wheel.time_response(peak, steps_per_period=32)
    assert (
        found.status_text == "not found: too long" and np.isnan(found.highest) and not found.answers
    )


@pytest.mark.slow
def test_what_is_not_kept_has_no_amplitude(monkeypatch):
    """A peak said to be of half its preload falls to what the wheel has under this one, within what a harmonic is off; and
    a time integration that fails."""
    wheel = BladedDisk(study(), Mistuning.random(N, 0.03, seed=0))
    peak = wheel.peak(2000.0, options=DiskPeakOptions(least=12, most=12, climbs=2))
    fallen = wheel.time_response(replace(peak, preload=1000.0), steps_per_period=32)
    assert fallen.status_text.startswith("not found: the largest amplitude is ") and np.isnan(
        fallen.mean
    )
    system = wheel.system(1000.0)
    balance = np.abs(
        system.structure.responses(solution(system, 2.0 * np.pi * peak.frequency).y[:-1])[:, 1]
    )
    assert balance[peak.blade] < 0.85 * peak.amplitude
    np.testing.assert_allclose(fallen.blades.mean(axis=0), balance, atol=0.15 * balance.max())
    assert "fall " not in fallen.summary() and "diameters" not in fallen.summary()
    bars = fallen.plot().axes[0].patches
    assert [b.get_height() for b in bars] == list(fallen.blades.mean(axis=0))
    fails_after(monkeypatch, 3)
    failed = wheel.time_response(peak, steps_per_period=32)
    assert failed.status_text.startswith(
        "not found: the time integration fails near "
    ) and np.isnan(failed.highest)
    assert (
        np.isnan(failed.blades).all()
        and failed.blades.shape == (1, N)
        and failed.plot().axes[0].patches
    )


def test_what_cannot_be_integrated_is_refused():
    wheel = BladedDisk(study(), Mistuning.random(N, 0.03, seed=0))
    peak = wheel.peak(2000.0, options=DiskPeakOptions(least=12, most=12, climbs=2))
    with pytest.raises(bd.SettingError, match="peak of this bladed disk"):
        wheel.replace(mistuning=None).time_response(peak)
    lost = replace(
        peak,
        status="not found",
        frequency=np.nan,
        amplitude=np.nan,
        blade=-1,
        unknowns=np.zeros((0, 0, 0)),
    )
    with pytest.raises(bd.SettingError, match="found one with the status 'not found'"):
        wheel.time_response(lost)
    many = BladedDisk(lumped_study(14, 1, n_c=2, r=2))
    with pytest.raises(bd.SettingError, match=r"at most 13 blades.*found 14"):
        many.time_response(peak)
