"""Stability from the motion in time: shooting against exact multipliers, marches against known solutions."""

import numpy as np
import pytest

import bdamper as bd
from bdamper.contact.laws import LAW_BONDED
from bdamper.stability import in_time
from bdamper.stability.floquet import multipliers
from bdamper.stability.in_time import InTime, SectorMap, disturbed, judge_in_time, marched
from bdamper.stability.march import AGREES, DIFFERS
from bdamper.stability.time_integration import Ring
from bdamper.stability.wave import rests
from tests.hard.test_case_04_17_folds_and_peaks import STUCK, followed, two_oscillators
from tests.plain import plain_study
from tests.stability import plain_march
from tests.stability.test_march import structure


@pytest.fixture(scope="module")
def path():
    return followed(two_oscillators(15), 1.0, 3.5, STUCK)


@pytest.fixture(scope="module")
def disk():
    model = bd.reference_model("bladed_disk", 9)
    study = plain_study(model, bd.Excitation("tip"), engine_order=5, friction_coefficient=0.4)
    return study, study.track(2000.0, (346.0, 358.0))


def at(curve, frequency, highest):
    """Index of the point of the highest, or of a middle or lower, branch at a frequency."""
    crossing = np.flatnonzero(np.diff(np.sign(curve.frequency - frequency)))
    return int(crossing[np.argsort(curve.amplitude[crossing])[highest]])


def moving(system, u):
    return system.contact(u)[2][:, [0, 2]] < 1.0 - 1e-12


def test_the_map_of_a_sector_taken_once_for_each_is_the_march_over_a_period(disk):
    study, curve = disk
    u, omega = curve.unknowns[-1], 2 * np.pi * curve.frequency[-1]
    sector = SectorMap(Ring(study.system(2000.0), 65, 5), omega)
    motion = disturbed(sector.ring, sector.ring.start(u, omega, sector.steps), 7)
    assert sector.ring.n == 13
    mapped = motion
    for _ in range(13):
        mapped = sector(mapped)
    marched_on = sector.ring.march(motion, omega, sector.steps).motion
    # 13 turns by s sectors are a whole number of turns of the ring
    for one, other in zip(mapped[:3], marched_on[:3]):
        np.testing.assert_allclose(one, other, atol=3e-4 * np.abs(other).max())
    assert np.abs(sector(motion).q - motion.q).max() > 1e-3 * np.abs(motion.q).max()  # the disturbance is no such wave


def test_shooting_finds_the_exact_multipliers(path):
    """Of the motion with 15 harmonics, whose events it knows; where it separates that is no exact motion."""
    system, found = two_oscillators(15), set()
    for p in [p for p in path.points if p.shares[0] < 0.45][::28]:
        u, omega = p.y[:-1], p.y[-1]
        expected = multipliers(system, u, omega)[0]
        errors = []
        for steps in (512, 2048):
            sector = SectorMap(Ring(system, 1, 0, radius=1.0), omega, steps)
            motion, values = sector.periodic(sector.ring.start(u, omega, sector.steps), moving(system, u))
            errors.append(np.abs(values - expected).min())
            assert sector.amplitude(motion) == pytest.approx(np.abs(system.response(u[None])[0, 1]), rel=2e-3)
        assert errors[1] < 0.015 if p.shares[2] else errors[1] < 0.3 * errors[0] < 5e-4
        found.add(bool(np.abs(expected) > 1.0))
        assert (np.abs(values[0]) > 1.0) == (np.abs(expected) > 1.0)
    assert found == {True, False}


@pytest.mark.slow
def test_a_motion_that_leaves_the_solution_of_one_harmonic(disk):
    """At 351.1 and 352.8 Hz exponents of one harmonic say stable; 0.82 to 0.88 of the amplitude are left in time."""
    study, curve = disk
    by_harmonic = study.with_stability(curve)
    i = at(curve, 352.3, -1)
    assert by_harmonic.stable[i] and by_harmonic.labels[i] == "det J > 0 with 1 harmonic"
    found = judge_in_time(study.system(2000.0), curve.unknowns[i], 2 * np.pi * curve.frequency[i], 65, 5)
    assert found.verdict == DIFFERS and 0.8 < found.ratio < 0.93
    # a damper with damping of its own stays
    damped = study.with_(damper_drag=8800.0 * study.model.bodies["damper"].mass)
    curve = damped.track(2000.0, (346.0, 358.0))
    i = at(curve, 352.3, -1)
    found = judge_in_time(damped.system(2000.0), curve.unknowns[i], 2 * np.pi * curve.frequency[i], 65, 5)
    assert found.verdict == AGREES and found.ratio == pytest.approx(1.0, abs=0.02)


@pytest.mark.slow
def test_shooting_between_two_folds(disk):
    """The middle branch has one multiplier outside the unit circle, a real one; the lower branch has none."""
    study, curve = disk
    system = study.system(2000.0)
    for highest, outside in ((1, True), (0, False)):
        i = at(curve, 352.3, highest)
        u, omega = curve.unknowns[i], 2 * np.pi * curve.frequency[i]
        sector = SectorMap(Ring(system, 65, 5), omega)
        motion, values = sector.periodic(sector.ring.start(u, omega, sector.steps), moving(system, u))
        assert sector.amplitude(motion) == pytest.approx(curve.amplitude[i], rel=0.01)
        assert (np.abs(values[0]) > 1.01) == outside and np.abs(values[1]) < 1.0
        assert not outside or abs(values[0].imag) < 1e-6


@pytest.mark.slow
def test_labels_of_a_curve(disk):
    study, curve = disk
    judged = study.with_stability(curve, in_time=True)
    labels, ratio = judged.labels, judged.in_time
    assert "points judged" in judged.stability_note and "in_time" in judged.columns()
    assert labels[at(curve, 352.3, 0)] == "stable" and ratio[at(curve, 352.3, 0)] == pytest.approx(1.0, abs=1e-3)
    assert labels[at(curve, 352.3, 1)] == labels[at(curve, 352.3, 2)] == "unstable"
    assert labels[at(curve, 356.5, 0)] == "stable"
    decided = np.isfinite(ratio)
    np.testing.assert_array_equal(judged.stable[decided], labels[decided] == "stable")
    # every point for itself: the same
    some = np.arange(0, len(curve), 9)
    for i in some:
        sector = SectorMap(Ring(study.system(2000.0), 65, 5), 2 * np.pi * curve.frequency[i])
        start = disturbed(sector.ring, sector.ring.start(curve.unknowns[i], sector.omega, sector.steps), 99)
        if decided[i]:
            assert (marched(sector, start, curve.amplitude[i]).verdict == AGREES) == judged.stable[i]


def test_labels_of_a_few_masses():
    """Without sectors, a mass that meets a stop: between the folds the motion leaves."""
    study = bd.lumped(
        [[1.0]], [[0.05]], [[1.0]], contacts=[bd.Contact(normal=0, kn=2.0, gap=1.0)], forces={0: 0.2}, harmonics=5
    )
    curve = study.track(0.0, (0.1, 0.35))
    judged = study.with_stability(curve, in_time=True)
    assert len(curve.folds) and (judged.labels == "stable").mean() > 0.3
    assert (judged.labels[curve.backward] == "unstable").mean() > 0.8
    assert study.with_stability(curve).in_time is None


@pytest.mark.parametrize(("largest", "periods"), [(1.012, 521), (1.05, None), (1.005, None)])
def test_slow_growth_asks_for_a_longer_march(monkeypatch, path, largest, periods):
    """A five-thousandth of the motion comes to a tenth of it in 521 periods at 1.2 % a period, in 127 at 5 %, at 0.5 % in
    more than the longest march has."""
    system, p, asked = two_oscillators(15), path.points[0], []

    def march(sector, motion, expected, fewest=240):
        asked.append(fewest)
        return InTime(AGREES if fewest == 240 else DIFFERS, 1.0, 0.0, fewest)

    monkeypatch.setattr(in_time, "marched", march)
    monkeypatch.setattr(SectorMap, "periodic", lambda self, start, moving: (start, np.array([largest, 0.9])))
    found = judge_in_time(system, p.y[:-1], p.y[-1], 1, 0)
    assert asked == ([240] if periods is None else [240, periods]) and found.largest == largest
    assert found.verdict == (AGREES if periods is None else DIFFERS)


def test_multipliers_of_a_linear_ring_are_those_of_its_matrix():
    """Bonded points: a period is the exponential of the dense matrix of all sectors."""
    system, omega = structure(laws=[LAW_BONDED]), 1.3
    residual, jacobian, _ = system.evaluate(np.zeros(len(system.force)), omega)
    u = -np.linalg.solve(jacobian, residual)
    sector = SectorMap(Ring(system, 6, 1, radius=1.0), omega, 3000)
    ring = sector.ring
    A, B = plain_march.matrices(ring)
    springs = np.tile(np.column_stack([system.points.kt, system.points.kn]).ravel(), ring.n)
    kept = np.concatenate([np.ones(ring.n_coordinates, bool), ~ring.real])
    K = (np.diag(np.tile(ring.omega2, 2)) + B @ (springs[:, None] * A))[np.ix_(kept, kept)]
    C = np.diag(np.tile(ring.damping, 2)[kept])
    state = np.block([[np.zeros_like(K), np.eye(len(K))], [-K, -C]])
    expected = np.exp(2.0 * np.pi / omega * np.linalg.eigvals(state))
    _, values = sector.periodic(ring.start(u, omega, sector.steps), np.zeros((system.n_points, 2), bool))
    assert len(values) == len(expected)
    for one, others in ((values, expected), (expected, values)):
        assert np.abs(one[:, None] - others).min(axis=1).max() < 1e-3


def test_points_at_rest_between_two_resonances_need_no_march(monkeypatch):
    """The stop is met at both resonances alone; what a march leaves there says nothing of the points between."""
    study = bd.lumped(
        np.eye(2), 0.05 * np.eye(2), [[1.5, -1.0], [-1.0, 1.5]], contacts=[bd.Contact(normal=0, kn=2.0, gap=1.0)],
        forces={0: 0.3}, harmonics=(1, 3),
    )  # fmt: skip
    curve = study.track(0.0, (0.07, 0.35))
    monkeypatch.setattr("bdamper.stability.in_time.judge_in_time", lambda *_, **__: InTime(AGREES, 0.96, 0.0, 240))
    judged = study.with_stability(curve, in_time=True)
    rest = np.array([rests(study.system(0.0), u) for u in curve.unknowns])
    assert (np.diff(rest.astype(int)) == 1).sum() == 2
    np.testing.assert_array_equal(judged.in_time, np.where(rest, 1.0, 0.96))
    assert set(judged.labels) == {"stable"}
    assert set(study.with_stability(curve).labels) <= {"det J > 0 with 2 harmonics", "unstable"}


def test_interrupted_labels_keep_what_was_judged(monkeypatch):
    study = bd.lumped(
        [[1.0]], [[0.05]], [[1.0]], contacts=[bd.Contact(normal=0, kn=2.0, gap=1.0)], forces={0: 0.2}, harmonics=5
    )
    curve = study.track(0.0, (0.1, 0.35))
    asked = []

    def interrupted(*arguments, **named):
        asked.append(named["seed"])
        if len(asked) == 3:
            raise KeyboardInterrupt
        return judge_in_time(*arguments, **named)

    monkeypatch.setattr("bdamper.stability.in_time.judge_in_time", interrupted)
    judged = study.with_stability(curve, in_time=True)
    assert len(asked) == 3 and "interrupted by the user" in judged.stability_note
    assert judged.labels[asked[:2]].tolist() == ["stable"] * 2 and np.isfinite(judged.in_time[asked[:2]]).all()
    rest = judged.labels[(curve.amplitude > 1.2) & (np.arange(len(curve)) >= asked[2])]
    assert set(rest) == {"stable as far as 5 harmonics tell", "unstable"}


def test_settings_that_are_no_structure_in_time_are_refused_at_once(disk):
    study, _ = disk
    study = study.with_(single_basis=True, harmonics=2)
    curve = study.track(2000.0, (346.0, 347.0))
    with pytest.raises(bd.BdamperError, match="single_basis=False"):
        study.with_stability(curve, in_time=True)
