"""Loads under which no static state is found: nothing is computed at another load instead, and results say so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
import bdamper.harmonic_balance.problem as problem_module
from bdamper.contact.preload_state import SLIP_MINUS, SLIP_PLUS, STICK
from bdamper.contact.static_state import StaticSystem, _LoadStep
from bdamper.response.linear_limits import linear_peak
from bdamper.util.errors import StaticError
from tests.plain import plain_study

LAST = 500.0
INTERVAL = (250.0, 400.0)


@pytest.fixture
def study(monkeypatch):
    """No static state beyond a load of 500 N, as where a load step fails: the state is the last that was found."""
    found = problem_module.static_state

    def failing(system, load, **options):
        if load <= LAST:
            return found(system, load, **options)
        return replace(
            found(system, LAST, **options), ok=False, reason="no equilibrium beyond 500 N"
        )

    monkeypatch.setattr(problem_module, "static_state", failing)
    monkeypatch.setattr(problem_module, "scaled_state", lambda *args, **options: None)
    return plain_study(
        bd.reference_model("bladed_disk", 9),
        bd.Excitation("tip"),
        engine_order=5,
        friction_coefficient=0.3,
    )


def test_the_equations_are_not_those_of_another_load(study):
    assert study.problem.system(LAST).n_unknowns == study.problem.n_unknowns
    for ask in (
        study.problem.system,
        lambda load: study.stuck(INTERVAL, load),
    ):
        with pytest.raises(StaticError, match="under 800 N: no equilibrium beyond 500 N"):
            ask(800.0)


@pytest.mark.parametrize("options", [{}, {"stability": True}])
def test_a_curve_has_no_start(study, options):
    curve = study.frequency_response(800.0, INTERVAL, **options)
    assert (curve.status, curve.reason, len(curve)) == (
        "not found",
        "static state: no equilibrium beyond 500 N",
        0,
    )
    assert curve.unknowns.shape == (0, study.problem.n_unknowns)
    assert study.frequency_response(LAST, INTERVAL).complete


def test_a_peak_is_not_that_of_another_load(study):
    peak = study.peak(800.0, INTERVAL)
    assert np.isnan([peak.amplitude, peak.frequency, peak.lower_bound]).all() and not peak.ok
    assert (
        peak.status_text.startswith("not found: ")
        and "no equilibrium beyond 500 N" in peak.summary()
    )
    done = bd.sweep(study, {"preload": [400.0, 800.0]}, frequency=INTERVAL)
    assert done.status[0] == "complete"
    assert (
        done.status_text[1].startswith("not found: ")
        and "no equilibrium beyond 500 N" in done.status_text[1]
    )


@pytest.mark.slow
def test_an_optimal_curve_has_no_peak_there(study):
    loads = np.array([200.0, 400.0, 500.0, 600.0, 1000.0])
    curve = study.optimal_curve(loads, frequency=INTERVAL, check=False)
    np.testing.assert_array_equal(np.isfinite(curve.amplitude), loads <= LAST)
    assert all("no equilibrium beyond 500 N" in s for s in curve.reason[3:])
    assert not curve.complete
    assert curve.optimum.preload <= LAST
    assert np.isnan(curve.stuck.amplitude)
    free = study.free((250.0, 350.0)).peak.amplitude
    assert linear_peak(study.problem.at(800.0), (250.0, 350.0), stuck=False).amplitude == free
    with pytest.raises(
        bd.BdamperError, match=r"no peak found at any of 3 preloads .* no equilibrium beyond 500 N"
    ):
        study.optimal_curve(np.array([600.0, 800.0, 1000.0]), frequency=INTERVAL, check=False)


def test_fixed_limits_tell_slip_from_stick_at_one_point():
    """Three independent modes: T = kt f/(k + kt) in stick, and slip where mu N is less."""
    stiffness, kt, kn, friction, normal_force = 1.0, 3.0, 5.0, 0.5, 2.0
    limit = friction * normal_force
    # tangential forces in stick of 1.2 and -1.2 times the limit, and of 0.8 times in the other axis
    in_stick = limit * np.array([[1.2, 0.8], [0.8, -1.2]])
    for sticking, expected in zip(in_stick, [[SLIP_PLUS, STICK], [STICK, SLIP_MINUS]]):
        system = StaticSystem(
            stiffness=np.full(3, stiffness),
            G=np.eye(3)[None],
            kt=np.full((1, 2), kt),
            kn=np.array([kn]),
            mu=np.array([friction]),
            n0=np.array([normal_force]),
            # N at rest balances the preload of the point
            force=np.append(sticking * (stiffness + kt) / kt, normal_force),
            shift=np.zeros((1, 3)),
            constant_force=np.zeros(3),
        )
        step = _LoadStep(system, 1.0, np.zeros((1, 2)), 0.0)
        found = step.at_fixed_limits(np.full((1, 2), STICK))
        np.testing.assert_array_equal(found, [expected])


def test_free_responses_and_peaks_ask_for_no_state_without_load(monkeypatch):
    """A damper without load may be squeezed out, so that the state at 0 N may be missing."""
    study = plain_study(
        bd.reference_model("bladed_disk", 9),
        bd.Excitation("tip"),
        engine_order=5,
        friction_coefficient=0.3,
        harmonics=1,
    )
    found = type(study.problem).static
    asked = []

    def seen(problem, preload, history=None):
        asked.append(preload)
        return found(problem, preload, history)

    monkeypatch.setattr(type(study.problem), "static", seen)
    free = study.free(INTERVAL)
    peak = study.peak(200.0, errors=False)
    assert peak.ok and free.peak.amplitude > 0.0
    assert 0.0 not in asked and 200.0 in asked
