"""The contact element of the core against the NumPy oracle and finite differences."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.random import default_rng

from bdamper import _core
from tests import oracle
from tests.cases import (
    EXACT,
    OPEN,
    PLAIN,
    SAMPLED,
    Point,
    difference,
    evaluate,
    far_from_events,
    random_motion,
    random_point,
)
from tests.compare import assert_close, assert_near
from tests.each import each

HARMONICS = (1, 2, 3, 5, 7)


@pytest.mark.parametrize("n_harm", HARMONICS)
def test_force_is_that_of_the_oracle(n_harm):
    rng = default_rng(n_harm)
    slipped = opened = 0
    for _ in range(20 if n_harm < 5 else 10):
        point, x = random_point(rng), random_motion(rng, n_harm)
        result = evaluate(x, point)
        expected = oracle.contact(x, *point.arguments)
        assert_near(result.force, expected, 1e-10 * (1 + np.abs(expected).max()))
        slipped += result.shares[1] > 0
        opened += result.shares[4] > 0
    assert slipped > 3
    assert opened > 3


DELTAS = [0.0, np.pi / 2, np.pi, 1.0]


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("delta", DELTAS)
@pytest.mark.parametrize(
    ("axis", "wave", "kn", "n0"),
    [(2, [0.0, 0.0, -1.0, -1.0, 0.0], 1.0, 0.0), (0, [0.0, 0.0, -1.0, 0.0, 0.5], 0.0, 0.6)],
)
def test_double_roots(axis, wave, kn, n0, delta, sign):
    """A contact that only touches: n0 + kn v = ±(2 s + 1)(s - 1), s = sin(theta - delta), also on a sample of the
    bracketing grid; a slip that only pauses: u' touches zero without changing its sign, also at the end of the period.
    """
    x = np.zeros((3, 5))
    x[0] = [0.0, 0.4, 0.3, 0.0, 0.2]
    x[axis] = sign * oracle.shift(np.array(wave), -delta)
    point = Point(np.ones(2), kn, 0.5, n0, np.zeros(2))
    assert_near(
        evaluate(x, point).force, oracle.contact_sampled(x, *point.arguments, 1 << 14, True), 1e-6
    )


@pytest.mark.parametrize("delta", DELTAS)
def test_a_contact_that_only_just_stays_closed(delta):
    """n0 + kn v = (1 - c)(2 + s): never negative, zero once."""
    x = np.zeros((3, 5))
    x[2] = oracle.shift(np.array([0.0, -2.0, 1.0, 0.0, -0.5]), -delta)
    result = evaluate(x, Point(np.ones(2), 1.0, 0.5, 2.0, np.zeros(2)))
    assert_near(result.force[2], [2.0, *x[2, 1:]], 1e-12)
    assert result.shares[4] < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("n_harm", HARMONICS)
def test_events_that_coincide(n_harm):
    """Coefficients in halves: roots on samples of the bracketing grid, at each other's place, and touching."""
    rng = default_rng(600 + n_harm)
    for _ in range(120):
        x = np.round(2 * rng.normal(size=(3, 2 * n_harm + 1))) / 2
        kt, w = rng.integers(1, 7, 2) / 2, rng.integers(-2, 3, 2) / 2
        point = Point(
            kt, rng.integers(1, 7) / 2, rng.integers(1, 5) / 4, rng.integers(-3, 7) / 2, w
        )
        exact, sampled = evaluate(x, point), evaluate(x, point, SAMPLED, 4096)
        size = max(np.abs(sampled.force).max(), 0.02)
        assert_near(exact.force, sampled.force, 1e-3 * size)


@pytest.mark.slow
def test_closing_where_a_bound_of_the_slider_is_extreme():
    """u' = ± (mu kn/kt) v' at the closing of one harmonic, give or take rounding: slip begins at once, or after no time."""
    rng = default_rng(49)
    slipped = 0
    for _ in range(25):
        mu, kn, size = rng.uniform(0.2, 0.8), rng.uniform(0.5, 2.0), rng.uniform(0.5, 2.0)
        level = rng.choice([0.0, rng.uniform(-0.9, 0.9)])
        of_v, of_u = rng.uniform(0.0, 2.0 * np.pi, 2)
        closing = of_v - np.arccos(-level)
        slope = -size * np.sin(closing - of_v)  # slope of v where it rises
        amplitude = rng.choice([-1.0, 1.0]) * mu * kn * slope / -np.sin(closing - of_u)
        point = Point(np.ones(2), kn, mu, kn * size * level, np.zeros(2))
        for off in 1e-15 * rng.normal(size=8):
            x = np.zeros((3, 3))
            x[0, 1:] = amplitude * np.cos(of_u + off), amplitude * np.sin(of_u + off)
            x[2, 1:] = size * np.cos(of_v), size * np.sin(of_v)
            result, expected = evaluate(x, point), oracle.contact(x, *point.arguments)
            assert_close(result.force, expected, 1e-12)
            slipped += result.shares[1] > 0.0
    assert slipped > 100


numbers = st.floats(-4.0, 4.0).map(lambda v: round(v, 3))


@settings(max_examples=80, deadline=None, derandomize=True)
@given(
    x=st.integers(1, 3).flatmap(lambda h: arrays(float, (3, 2 * h + 1), elements=numbers)),
    kt=arrays(float, 2, elements=st.floats(0.0, 5.0)),
    kn=st.floats(0.0, 5.0),
    mu=st.floats(0.0, 2.0),
    n0=st.floats(-4.0, 4.0),
    w=arrays(float, 2, elements=numbers),
)
def test_any_input_gives_the_force_in_time(x, kt, kn, mu, n0, w):
    """Zeros, equal numbers, contacts that never close: compared with the law on a fine grid."""
    kt, kn, mu, n0 = np.round(kt, 2), round(kn, 2), round(mu, 2), round(n0, 2)
    result = evaluate(x, Point(kt, kn, mu, n0, w))
    assert np.isfinite(result.force).all()
    assert np.isfinite(result.tangent).all()
    n_time = 4096
    in_time = oracle.contact_sampled(x, kt, kn, mu, n0, w, n_time, True)
    size = (kt.max() + kn * (1 + mu)) * np.abs(x).max() + abs(n0) * (1 + mu)
    # a contact of a few samples may be missed in time: its impulse is below size * its share of the period
    assert_near(result.force, in_time, 2e-4 * size + 1e-14)


@pytest.mark.slow
@each("evaluation", [EXACT, SAMPLED, PLAIN])
@each("n_harm", HARMONICS)
def test_tangent_is_the_derivative(n_harm, evaluation):
    """To 1e-7 where no event is near; the sampled laws are piecewise linear, so almost everywhere."""
    rng = default_rng(100 + n_harm)
    n_time = 0 if evaluation == EXACT else 16 * n_harm + 48
    compared = with_slip = with_opening = 0
    for _ in range(400):
        point, x = random_point(rng), random_motion(rng, n_harm)
        result = evaluate(x, point, evaluation, n_time)
        if not result.shares[1] + result.shares[3] > 0.0 or not far_from_events(x, point, rng):
            continue
        h = 1e-5 if evaluation == EXACT else 1e-7
        numeric = difference(lambda z: evaluate(z, point, evaluation, n_time).force, x, h)
        if evaluation != EXACT:
            # a sample may change its state within the step: then the two one-sided differences disagree
            other = difference(lambda z: evaluate(z, point, evaluation, n_time).force, x, 3e-7)
            if np.abs(numeric - other).max() > 1e-6:
                continue
        assert np.abs(result.tangent).max() > 0.1
        assert not np.array_equal(result.tangent, numeric)
        tolerance = (1e-7 if evaluation == EXACT else 1e-6) * np.abs(result.tangent).max()
        assert_near(result.tangent, numeric, tolerance)
        compared += 1
        with_slip += result.shares[1] > 0
        with_opening += result.shares[4] > 0
        if compared == 12:
            break
    assert compared >= 8
    assert with_slip >= 3
    assert with_opening >= 2


@pytest.mark.parametrize("n_harm", [1, 3])
@pytest.mark.parametrize("evaluation", [SAMPLED, PLAIN])
def test_sampled_force_is_that_of_the_oracle(n_harm, evaluation):
    rng = default_rng(200 + n_harm)
    for n_time in (4 * n_harm + 4, 61, 128):
        for _ in range(15):
            point, x = random_point(rng), random_motion(rng, n_harm)
            expected = oracle.contact_sampled(x, *point.arguments, n_time, evaluation == SAMPLED)
            assert_near(evaluate(x, point, evaluation, n_time).force, expected, 1e-12)


def errors_of_sampling(seed, n_harm, n_times, count, wanted, error):
    """Sums of an error over random states that are wanted, for each number of samples and evaluation."""
    rng, errors, used = default_rng(seed), {e: np.zeros(len(n_times)) for e in (SAMPLED, PLAIN)}, 0
    while used < count:
        state = wanted(random_point(rng), random_motion(rng, n_harm))
        if state is None:
            continue
        used += 1
        point, x, exact = state
        for evaluation, of_n in errors.items():
            of_n += [error(evaluate(x, point, evaluation, n), exact) for n in n_times]
    return {e: -np.polyfit(np.log(n_times), np.log(of_n), 1)[0] for e, of_n in errors.items()}


def test_sampled_tangent_converges_only_with_interpolated_closing():
    """dT/dV under separation: order 1 with the closing interpolated, none without."""

    def wanted(point, x):
        exact = evaluate(x, point)
        closes = any(
            a[2] == OPEN and b[2] == 0
            for parts in exact.parts
            for a, b in zip(parts, parts[1:] + parts[:1])
        )
        return (point, x, exact) if closes else None

    orders = errors_of_sampling(
        400,
        2,
        [128, 512, 2048],
        120,
        wanted,
        lambda found, exact: np.abs((found.tangent - exact.tangent)[:2, :, 2]).mean(),
    )
    assert orders[SAMPLED] > 0.7
    assert abs(orders[PLAIN]) < 0.35


class TestArguments:
    good = {
        "x": np.zeros((3, 3)),
        "kt": np.ones(2),
        "kn": 1.0,
        "mu": 0.3,
        "n0": 1.0,
        "w": np.zeros(2),
        "F": np.zeros((3, 3)),
        "J": np.zeros((3, 3, 3, 3)),
    }

    @each(
        ("name", "value"),
        [
            *((name, value.ravel()[:-1]) for name, value in good.items() if np.ndim(value)),
            *((name, value.astype(np.float32)) for name, value in good.items() if np.ndim(value)),
            *((name, value * np.nan) for name, value in good.items() if name not in ("F", "J")),
            ("x", np.zeros((3, 4))), ("x", [[0.0] * 3] * 3), ("x", np.asfortranarray(np.zeros((3, 3)))),
            ("kt", -np.ones(2)), ("kn", -1.0), ("law", 7), ("law", -1), ("evaluation", 3),
        ],
    )  # fmt: skip
    def test_wrong_ones_are_named(self, name, value):
        with pytest.raises((TypeError, ValueError), match=rf"^{name}:"):
            _core.evaluate_contact(**{**self.good, name: value})

    def test_outputs_must_be_writable(self):
        F = np.zeros((3, 3))
        F.flags.writeable = False
        with pytest.raises(ValueError, match=r"^F: .*writable"):
            _core.evaluate_contact(**{**self.good, "F": F})

    @each(
        ("arguments", "message"),
        [
            ({"n_time": 64}, "^n_time: expected 0 with evaluation 0"),
            ({"evaluation": 1, "n_time": 7}, "^n_time: expected 8 to"),
            *(({"x": np.zeros((3, n)), "F": np.zeros((3, n)), "J": np.zeros((3, n, 3, n))},
               f"number of harmonics: expected 1 to 64, found {n // 2}") for n in (1, 131)),
        ],
    )  # fmt: skip
    def test_numbers_of_samples_and_harmonics(self, arguments, message):
        with pytest.raises(ValueError, match=message):
            _core.evaluate_contact(**{**self.good, **arguments})


def test_the_largest_number_of_harmonics():
    rng = default_rng(500)
    point, x = random_point(rng), random_motion(rng, 64)
    sampled = evaluate(x, point, SAMPLED, 1 << 14).force
    assert_near(evaluate(x, point).force, sampled, 1e-4)
