"""The search for a root within a bracket."""

import numpy as np
import pytest

from bdamper.response.scalar_search import find_root
from tests.each import each


def counted(function):
    def f(x):
        f.places.append(x)
        return function(x)

    f.places = []
    return f


def solve(function, low, high, tolerance, **options):
    f = counted(function)
    root = find_root(f, (low, function(low)), (high, function(high)), tolerance, **options)
    assert root.trials == len(f.places)
    assert root.at == f.places[-1]
    return root


@pytest.mark.parametrize(
    ("function", "low", "high", "at", "most"),
    [
        (lambda x: x**2 - 2.0, 0.0, 2.0, np.sqrt(2.0), 6),
        (lambda x: 2.0 - x**2, 0.0, 2.0, np.sqrt(2.0), 6),
        (lambda x: np.cos(x) - x, 0.0, 1.0, 0.7390851332151607, 6),
        (lambda x: x**9 - 1e-4, 0.0, 2.0, 1e-4 ** (1.0 / 9.0), 22),
        (lambda x: 3.0 * x - 1.0, 0.0, 1.0, 1.0 / 3.0, 1),
    ],
)
def test_smooth_roots_in_few_trials(function, low, high, at, most):
    root = solve(function, low, high, 1e-10)
    assert root.at == pytest.approx(at, abs=1e-10)
    assert root.step <= 1e-10
    assert root.trials <= most


def test_it_stops_on_the_step_of_the_secant_not_on_the_bracket():
    """A convex function keeps one end of the bracket far away while the secants have long arrived."""
    f = counted(lambda x: np.exp(x) - 2.0)
    root = find_root(f, (0.0, -1.0), (1.0, np.e - 2.0), 1e-9)
    tried = sorted([*f.places, 0.0, 1.0], key=lambda x: abs(x - np.log(2.0)))
    assert abs(root.at - np.log(2.0)) < 1e-9
    assert root.trials <= 6
    below = max(x for x in tried if x < np.log(2.0))
    above = min(x for x in tried if x > np.log(2.0))
    assert above - below > 1e-9


@each("jump", [0.123, 0.5, 0.98765])
@each("heights", [(-1.0, 1.0), (-1e-6, 1.0), (3.0, -1e-4)])
def test_a_jump_through_zero_is_found(jump, heights):
    root = solve(lambda x: heights[0] if x < jump else heights[1], 0.0, 1.0, 1e-8)
    assert root.at == pytest.approx(jump, abs=4e-8)
    assert root.trials <= 80


@pytest.mark.parametrize("small", [1e-3, 1e-7])
def test_a_jump_is_not_taken_for_a_root_beside_it(small):
    """On one side the function is small and falls toward the jump without reaching zero."""
    root = solve(lambda x: -small * (0.7 - x) - 0.1 * small if x < 0.6 else 1.0, 0.0, 1.0, 1e-8)
    assert root.at == pytest.approx(0.6, abs=4e-8)


def test_a_root_that_is_hit_ends_the_search():
    root = solve(lambda x: x - 0.5, 0.0, 1.0, 1e-3)
    assert (root.at, root.value, root.step, root.trials) == (0.5, 0.0, 0.0, 1)


def test_it_gives_up_after_so_many_trials_and_says_how_far_it_was():
    root = solve(lambda x: x**9 - 1e-4, 0.0, 2.0, 1e-12, most_trials=4)
    assert root.trials == 4
    assert root.step > 1e-12


def test_a_root_at_an_end_of_the_bracket():
    root = solve(lambda x: x, 0.0, 1.0, 1e-6)
    assert root.at <= 1e-6


def test_ends_of_one_sign_are_refused():
    with pytest.raises(ValueError, match="different signs"):
        find_root(lambda x: x, (1.0, 1.0), (2.0, 2.0), 1e-6)
