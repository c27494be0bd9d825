"""Rows 4 and 17, and the curve-level promises on folds: location, both branches, nothing stepped over."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

import bdamper as bd
from bdamper.harmonic_balance.equations import OK
from bdamper.response.continuation import follow
from bdamper.response.events import ContinuationOptions, turns_twice
from tests.hard.random_studies import random_study, tracked_curve
from tests.oscillators import oscillator
from tests.plain import plain_study


def two_oscillators(n_harm, **settings):
    """Anchor A7: tangential x and normal y, coupled, with one contact point that separates."""
    return oscillator(
        1.0, 0.05, [[1.0, 0.3], [0.3, 2.0]], [[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]], [0.1, 0.12], [0.0, 1.0], n_harm,
        kt=0.6, kn=6.0, mu=0.4, n0=0.35, **settings,
    )  # fmt: skip


def followed(system, low, high, springs, **options):
    start = np.append(
        system.layout.pack(np.zeros(system.n_mean), system.structure.linear.response(low, springs)),
        low,
    )
    return follow(system, start, (low, high), options=ContinuationOptions(**options))


STUCK = np.array([[0.6, 0.0, 6.0]])


def test_case_04_fold_beside_lift_off_is_passed_on_both_branches():
    path = followed(two_oscillators(13), 1.0, 3.5, STUCK)
    assert path.status == "complete"
    folds = [p.y[-1] for p in path.points if p.kind == "fold"]
    # published values of two independent programs
    np.testing.assert_allclose(sorted(folds), [1.962464, 2.441122], atol=2e-6)
    # lift-off is beside the upper fold, and is passed between the last closed point and the first that opens
    first = next(i for i, p in enumerate(path.points) if p.shares[2] > 0.0)
    closed, opened = path.points[first - 1], path.points[first]
    system = two_oscillators(13)

    def least_load(omega):
        """Of the cycle, from the motion alone: the contact has no say in where it opens."""
        c = system.correct_at(closed.y[:-1], omega, closed.scale, 1e-12, 30)
        assert c.status == OK
        v = system.contact(c.y[:-1])[0][0, 2]
        theta = np.linspace(0.0, 2.0 * np.pi, 4001)
        l = np.arange(1, 14)
        return (
            0.35
            + 6.0
            * (
                v[0] + np.cos(np.outer(theta, l)) @ v[1::2] + np.sin(np.outer(theta, l)) @ v[2::2]
            ).min()
        )

    lift_off = brentq(least_load, closed.y[-1], opened.y[-1], xtol=1e-9)
    assert all(p.y[-1] < lift_off for p in path.points[:first])
    np.testing.assert_allclose(max(folds) - lift_off, 0.026725, atol=2e-6)
    senses = {np.sign(p.tangent[-1]) for p in path.points if p.kind == "regular"}
    assert senses == {1.0, -1.0}


@pytest.mark.parametrize(
    ("n_harm", "expected"), [(1, (1.934680, 2.435580)), (13, (1.962464, 2.441122))]
)
def test_smooth_folds_are_located_to_1e_minus_10(n_harm, expected):
    system = two_oscillators(n_harm)
    path = followed(system, 1.0, 3.5, STUCK, tolerance=1e-12)
    other = followed(system, 1.0, 3.5, STUCK, tolerance=1e-12, max_step=0.07, step=0.03)
    for omega in expected:
        a, b = (
            min((p.y[-1] for p in q.points if p.kind == "fold"), key=lambda w: abs(w - omega))
            for q in (path, other)
        )
        assert abs(a - omega) < 2e-6
        assert abs(a - b) < 1e-10 * omega  # two different paths agree on it


@pytest.mark.parametrize("ratio", [1e-3, 1e-4, 1e-5])
def test_case_17_fully_stuck_peak_is_not_stepped_over(ratio):
    # two modes: the sharp one is hardly excited, so that nothing but its phase tells of it from afar
    k = np.array([[1.0, -0.005], [-0.005, 2.0]])
    system = oscillator(
        1.0, 2.0 * ratio, k, [[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]], [0.0, 1e-3], [1.0, 0.0], 1,
        kt=0.6, kn=6.0, mu=0.4, n0=10.0,
    )  # fmt: skip
    omega = np.sqrt(np.linalg.eigvalsh(k + np.diag([0.6, 6.0])))[0]
    around = omega * (1.0 + ratio * np.linspace(-3, 3, 601))
    exact = max(
        abs(system.structure.linear.response(w, STUCK) @ system.response_rows[1]) for w in around
    )

    def peak(path):
        assert path.status == "complete"
        return max(
            abs(system.response(p.y[:-1])[1]) for p in path.points if abs(p.y[-1] - omega) < 0.05
        )

    system = replace(system, watched=system.structure.linear.resonances((None, STUCK), 0.8, 2.5))
    assert abs(peak(followed(system, 0.8, 2.5, STUCK, max_step=0.4)) / exact - 1.0) < 1e-3
    # with long steps and nothing to watch it is stepped over: what the test guards against
    system = replace(system, watched=())
    assert peak(followed(system, 0.8, 2.5, STUCK, max_step=0.4)) < 0.5 * exact


def test_turning_twice_is_seen_in_the_cubic_through_both_ends():
    """Cubics with the extrema where they are put, against their own slopes and rises."""
    rng = np.random.default_rng(3)
    seen = [0, 0]
    for _ in range(400):
        ends, size = (
            np.sort(rng.uniform(-1.5, 2.5, 2)),
            rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-6, 6),
        )
        slope = np.polynomial.Polynomial.fromroots(ends) * size
        first, last, rise = slope(0.0), slope(1.0), slope.integ()(1.0)
        twice = (
            ends[0] > 0.0
            and ends[1] < 1.0
            and abs(slope(ends.mean())) > 0.02 * max(abs(first), abs(last))
        )
        assert turns_twice(first, last, rise) == twice
        seen[int(twice)] += 1
    assert min(seen) > 10
    assert not turns_twice(1.0, -1.0, 0.3)  # one extremum, which the signs show


@pytest.mark.slow
@pytest.mark.parametrize(("case", "folds", "step"), [("reference", 4, 0.05), ("random", 16, 0.01)])
def test_a_pair_of_folds_in_one_step_is_not_stepped_over(case, folds, step):
    """0.04 Hz apart at 344.2 Hz on the reference disk, 0.01 Hz at 345.4 Hz on a random one: as with small steps."""
    if case == "reference":
        disk = bd.reference_model("bladed_disk", 9)
        tip = bd.Excitation("tip", "tangential", 1.0)
        study = plain_study(disk, tip, engine_order=5, harmonics=5, friction_coefficient=0.4)
        preload, interval = 500.0, (335.0, 355.0)
    else:
        study, preload, interval = random_study(28)
    usual = tracked_curve(study, preload, interval)
    fine = tracked_curve(
        study, preload, interval, options=ContinuationOptions(step=step, max_step=step)
    )
    assert usual.complete
    assert len(fine.folds) == folds
    np.testing.assert_allclose(usual.frequency[usual.folds], fine.frequency[fine.folds], rtol=1e-8)
