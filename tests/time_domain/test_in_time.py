"""Stability from the motion in time: labels of curves against integrations from single points."""

import re

import numpy as np
import pytest

import bdamper as bd
from bdamper.time_domain import floquet
from bdamper.time_domain.floquet import rests
from bdamper.time_domain.transient import AGREES, DIFFERS
from tests.models import wedge_model
from tests.plain import plain_study


@pytest.fixture(scope="module")
def disk():
    model = bd.reference_model("bladed_disk", 9)
    study = plain_study(model, bd.Excitation("tip"), engine_order=5, friction_coefficient=0.4)
    return study, study.frequency_response(2000.0, (346.0, 358.0))


def at(curve, frequency, highest):
    """Index of the point of the highest, or of a middle or lower, branch at a frequency."""
    crossing = np.flatnonzero(np.diff(np.sign(curve.frequency - frequency)))
    return int(crossing[np.argsort(curve.amplitude[crossing])[highest]])


@pytest.mark.slow
def test_a_motion_that_leaves_the_solution_of_one_harmonic(disk):
    """At 351.1 and 352.8 Hz det J > 0 leaves it open; 0.82 to 0.88 of the amplitude are left in time."""
    study, curve = disk
    by_harmonic = study.with_stability(curve)
    i = at(curve, 352.3, -1)
    assert (
        not by_harmonic.unstable[i]
        and by_harmonic.labels[i] == "undecided (det J >= 0) with 1 harmonic"
    )
    found = study.motion_in_time(curve, i)
    assert found.verdict == DIFFERS and 0.8 < found.amplitude[-80:].mean() / found.balance < 0.93
    # a damper with damping of its own stays; one harmonic has 9 % more than five and than time, which has all diameters
    damped = study.replace(harmonics=5, damper_drag=8800.0 * study.model.bodies["damper"].mass)
    curve = damped.frequency_response(2000.0, (346.0, 358.0))
    i = at(curve, 352.3, -1)
    found = damped.motion_in_time(curve, i)
    assert found.verdict == AGREES and found.amplitude[-80:].mean() == pytest.approx(
        found.balance, rel=0.02
    )


@pytest.mark.slow
def test_labels_of_a_few_masses():
    """Without sectors, a mass that meets a stop: between the folds the motion leaves."""
    study = bd.lumped(
        [[1.0]],
        [[0.05]],
        [[1.0]],
        contacts=[bd.Contact(normal=0, kn=2.0, gap=1.0)],
        forces={0: 0.2},
        harmonics=5,
    )
    curve = study.frequency_response(0.0, (0.1, 0.35))
    judged = study.with_stability(curve, in_time=True)
    assert "points integrated" in judged.stability_note and "in_time" in judged.columns()
    assert len(curve.folds) and (judged.labels == "stable").mean() > 0.3
    assert (judged.labels[curve.backward] == "unstable").mean() > 0.8
    assert study.with_stability(curve).in_time is None


def test_points_at_rest_between_two_resonances_need_no_integration(monkeypatch):
    """The stop is met at both resonances alone; what the motion comes to there says nothing of the points between."""
    study = bd.lumped(
        np.eye(2), 0.05 * np.eye(2), [[1.5, -1.0], [-1.0, 1.5]], contacts=[bd.Contact(normal=0, kn=2.0, gap=1.0)],
        forces={0: 0.3}, harmonics=(1, 3),
    )  # fmt: skip
    curve = study.frequency_response(0.0, (0.07, 0.35))
    monkeypatch.setattr(floquet, "judged_at", lambda ring, u, omega: (AGREES, 0.96))
    judged = study.with_stability(curve, in_time=True)
    rest = np.array([rests(study.problem.system(0.0), u) for u in curve.unknowns])
    assert (np.diff(rest.astype(int)) == 1).sum() == 2
    np.testing.assert_array_equal(judged.in_time, np.where(rest, 1.0, 0.96))
    assert set(judged.labels) == {"stable"}
    assert set(study.with_stability(curve).labels) <= {
        "stable according to 2 harmonics",
        "unstable",
    }


@pytest.mark.slow
def test_interrupted_labels_keep_what_was_judged(monkeypatch):
    study = bd.lumped(
        [[1.0]],
        [[0.05]],
        [[1.0]],
        contacts=[bd.Contact(normal=0, kn=2.0, gap=1.0)],
        forces={0: 0.2},
        harmonics=5,
    )
    curve = study.frequency_response(0.0, (0.1, 0.35))
    asked, own = [], floquet.judged_at

    def interrupted(ring, u, omega):
        asked.append(int(np.abs(curve.unknowns - u).max(axis=1).argmin()))
        if len(asked) == 3:
            raise KeyboardInterrupt
        return own(ring, u, omega)

    monkeypatch.setattr(floquet, "judged_at", interrupted)
    judged = study.with_stability(curve, in_time=True)
    assert len(asked) == 3 and "interrupted by the user" in judged.stability_note
    assert (
        judged.labels[asked[:2]].tolist() == ["stable"] * 2
        and np.isfinite(judged.in_time[asked[:2]]).all()
    )
    rest = judged.labels[(curve.amplitude > 1.2) & (np.arange(len(curve)) >= asked[2])]
    assert set(rest) == {"stable according to 5 harmonics", "unstable"}


def test_settings_that_are_no_structure_in_time_are_refused_at_once(disk):
    study, _ = disk
    study = study.replace(fundamental_modes_only=True, harmonics=2)
    curve = study.frequency_response(2000.0, (346.0, 347.0))
    with pytest.raises(bd.BdamperError, match="fundamental_modes_only=False"):
        study.with_stability(curve, in_time=True)


def test_points_on_a_cubic_spring_do_not_rest():
    """Between the folds of a Duffing oscillator the motion in time leaves the middle branch."""
    study = bd.lumped([[1.0]], [[0.05]], [[1.0]], cubic={0: 1.0}, forces={0: 0.3}, harmonics=(1, 3))
    curve = study.frequency_response(0.0, (0.05, 0.5))
    system = study.problem.system(0.0)
    assert len(curve) and not any(rests(system, u) for u in curve.unknowns)


def test_resting_contacts_on_springs_that_only_resist():
    model = wedge_model(
        0, n_blades=8, engine_order=2, n_points=4, n_blade_modes=2, harmonics=3, n_damper_modes=0
    )
    study = plain_study(
        model, engine_order=2, contact_stiffness=1e5, friction_coefficient=0.3,
        excitation=bd.Excitation("tip", "tangential", 20.0),
    )  # fmt: skip
    curve = study.frequency_response(400.0, (250.0, 400.0))
    system = study.problem.system(400.0)
    still = np.array([rests(system, u) for u in curve.unknowns])
    assert still.any() and not still.all()
    for i, rest in enumerate(still):
        _, _, shares = system.contact(curve.unknowns[i])  # stick and slip of two directions, open
        assert rest == (np.minimum(shares, 1.0 - shares).max() < 1e-12)
    i = int(np.flatnonzero(still)[0])
    system.structure.arrays["damping"] = system.structure.arrays["damping"] - 1.0
    assert not rests(system, curve.unknowns[i])


@pytest.mark.slow
def test_the_verdict_and_the_amplitude_are_of_the_same_periods():
    """The reason gives the mean over its periods relative to the solution, and the result has this mean."""
    study = bd.lumped(
        [[1.0]],
        [[0.05]],
        [[1.0]],
        contacts=[bd.Contact(normal=0, kn=2.0, gap=1.0)],
        forces={0: 0.2},
        harmonics=5,
    )
    curve = study.frequency_response(0.0, (0.1, 0.35))
    middle = np.flatnonzero(curve.backward)
    verdicts = set()
    for i in (int(middle[len(middle) // 2]), curve.peak_index, 0):
        found = study.motion_in_time(curve, i)
        verdicts.add(found.verdict)
        change = float(re.search(r"([+-][0-9.e+-]+) %", found.reason)[1])
        assert change == pytest.approx(
            100.0 * (found.mean / found.balance - 1.0), rel=0.06, abs=1e-3
        ), found.reason
        n = int(re.search(r"(\d+) periods", found.reason)[1])
        assert found.mean == pytest.approx(found.amplitude[-n:].mean(), rel=1e-12)
        assert (found.lowest, found.highest) == (
            found.amplitude[-n:].min(),
            found.amplitude[-n:].max(),
        )
    assert verdicts == {AGREES, DIFFERS}
