"""Answers that are multiplied with the excitation are those that a study at that excitation computes."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.harmonic_balance.parameters import vary
from bdamper.plot.explorer_worker import FORCE, Answers, Question
from bdamper.plot.force_scaling import rescaled_curve, rescaled_optimal


def pressed(gap=None, **more):
    """Two masses with a contact that a preload closes, and a guard at a distance."""
    contacts = [bd.Contact((1, 0), normal=1, kt=1.0, kn=1.0, mu=0.5)]
    contacts += [] if gap is None else [bd.Contact(normal=1, kn=1.0, gap=gap)]
    ways = {"contacts": contacts, "forces": {0: 0.1}, "load_per_preload": {1: 1.0}, "harmonics": 1, **more}
    return bd.lumped([1.0, 0.1], [0.02, 0.02], [1.0, 0.1], **ways)


@pytest.mark.parametrize("gap", [None, 1e3])
@pytest.mark.parametrize("factor", [0.5, 3.0])
def test_curves_at_the_same_ratio_of_preload_and_excitation_are_one_curve(factor, gap):
    study, band = pressed(gap), (0.1, 0.3)
    other = vary(study, {FORCE: 0.1 * factor})
    curve = rescaled_curve(other, study.frequency_response(1.0, band), factor)
    direct = other.frequency_response(factor, band)
    assert curve.preload == factor and curve.settings == direct.settings
    assert curve.peak.amplitude == pytest.approx(direct.peak.amplitude, rel=1e-6)
    own = study.frequency_response(1.0, band)
    for i in range(0, len(curve), 7):
        energy = other.hysteresis(curve, i).energy  # which refuses a curve that is no solution
        np.testing.assert_allclose(energy, factor**2 * study.hysteresis(own, i).energy, rtol=1e-6, atol=1e-12)
    best = rescaled_optimal(other, study.optimal_curve((0.5, 5.0), 4, frequency=band, check=False), factor)
    least = other.optimal_curve((0.5 * factor, 5.0 * factor), 4, frequency=band, check=False)
    np.testing.assert_allclose(best.preload, least.preload)
    np.testing.assert_allclose(best.amplitude, least.amplitude, rtol=1e-6)
    assert best.optimum.preload == pytest.approx(least.optimum.preload, rel=1e-4)
    assert best.free.amplitude == pytest.approx(least.free.amplitude)


def test_a_gap_that_closes_is_not_multiplied():
    """The guard touches the mass neither before nor after, only after, or before already."""
    band, other = (0.1, 0.3), {factor: vary(pressed(30.0), {FORCE: 0.1 * factor}) for factor in (1.5, 30.0)}
    curve = pressed(30.0).frequency_response(1.0, band)
    largest = np.abs(curve.unknowns).max()
    assert 1.0 < largest < 30.0
    assert rescaled_curve(other[1.5], curve, 1.5) is not None
    assert rescaled_curve(other[30.0], curve, 30.0) is None
    touching = pressed(0.5).frequency_response(1.0, band)
    assert rescaled_curve(vary(pressed(0.5), {FORCE: 0.05}), touching, 0.5) is None


def test_other_equations_are_not_multiplied():
    contact = bd.Contact(0, kt=1.0, mu=1.0, preload=1.0)  # a load that does not follow the excitation
    held = bd.lumped(1.0, 0.02, 1.0, contacts=[contact], forces={0: 1.0})
    assert rescaled_curve(vary(held, {FORCE: 2.0}), held.frequency_response(0.0, (0.1, 0.3)), 2.0) is None
    study, curve = pressed(), pressed().frequency_response(1.0, (0.1, 0.3))
    assert rescaled_curve(study, replace(curve, status="incomplete", reason="left"), 2.0) is None
    assert rescaled_curve(study.replace(bias=False), curve, 2.0) is None


def test_a_damper_that_drifts_to_its_guard_is_multiplied_about_the_guard():
    """The typical blade: nothing holds the damper along the axis but guards at 0.2 mm on both sides."""
    study, band = bd.Study(bd.reference_model("turbine_blade"), bd.Excitation("tip"), 5, 0.3, harmonics=3), (640.0, 720.0)
    curve, other = study.frequency_response(200.0, band), vary(study, {FORCE: 2.0})
    twice = rescaled_curve(other, curve, 2.0)
    drift = [c.name for c in study.problem.bases[0].coordinates].index("TZ")
    assert np.ptp(curve.unknowns[:, drift]) > 1e-6 and twice is not None
    assert twice.peak.amplitude == pytest.approx(other.frequency_response(400.0, band).peak.amplitude, rel=1e-6)
    for i in range(0, len(twice), 5):
        at = np.append(twice.unknowns[i], 2.0 * np.pi * twice.frequency[i])
        assert other.hysteresis(twice, i).amplitude == pytest.approx(2.0 * curve.amplitude[i]), at
    # a guard that would be reached is one: the motion along the axis is some 60 nm
    assert rescaled_curve(vary(study, {FORCE: 1e5}), curve, 1e5) is None


def test_the_thread_multiplies_what_it_knows(monkeypatch):
    study, queue = pressed(), []
    answers = Answers(study, queue.append, preloads=3)
    first = Question((), 1.0, (0.5, 5.0))
    known = answers.curve(first, None).curve, answers.optimal(first).optimal
    for name in ("frequency_response", "optimal_curve"):
        monkeypatch.setattr(bd.Study, name, lambda *_, **__: pytest.fail("computed again"))
    double = Question(((FORCE, 0.2),), 2.0, (1.0, 10.0))
    np.testing.assert_allclose(answers.curve(double, None).curve.amplitude, 2.0 * known[0].amplitude)
    np.testing.assert_allclose(answers.optimal(double).optimal.amplitude, 2.0 * known[1].amplitude)
    monkeypatch.undo()
    other = answers.curve(replace(double, preload=1.0), None).curve
    np.testing.assert_allclose(
        other.amplitude, vary(study, {FORCE: 0.2}).frequency_response(1.0, answers.band(double)).amplitude
    )
    answers.ask(None)


def test_a_force_beside_another_is_not_multiplied():
    """Twice the first force is not twice all of the excitation."""
    alone = pressed()
    study = alone.replace(excitation=alone.excitation + replace(alone.excitation, amplitude=0.05))
    answers = Answers(study, lambda answer: None)
    answers.curve(Question((), 1.0, None), None)
    double = answers.curve(Question(((FORCE, 0.2),), 2.0, None), None).curve
    band = answers.band(Question((), 1.0, None))
    assert double.peak.amplitude == pytest.approx(
        vary(study, {FORCE: 0.2}).frequency_response(2.0, band).peak.amplitude, rel=1e-6
    )
