"""Contract of the core's elimination of a wheel: its inputs, and that no answer depends on the call before."""

import numpy as np
import pytest

from bdamper import _core

SHAPE = 4, 3, 3  # sectors, coefficients, two coordinates of a blade and one of a damper


def wheel(**changes):
    rng = np.random.default_rng(0)
    own, following = rng.normal(size=(2, 3, 3)), rng.normal(size=(1, 3, 3))
    arguments = {
        "n_sector": 4, "n_harm": 1, "n_blade": 2, "n_damper": 1, "n_kept": 1, "own": own, "next": following,
        "active": np.ones(3, bool), "pinned": np.zeros(4, bool),
    }  # fmt: skip
    return _core.Wheel(**(arguments | changes))


def matrix(seed=1):
    rng = np.random.default_rng(seed)
    blade = np.tile(4.0 * np.eye(2), (2, 4, 1, 1)) + 0.1 * rng.normal(size=(2, 4, 2, 2))
    return {
        "own": 0.1 * rng.normal(size=(4, 2, 7, 3, 3)),
        "next": 0.1 * rng.normal(size=(4, 1, 7, 3, 3)),
        "blade": blade,
        "damping": 0.1 * rng.normal(size=(2, 4, 2, 2)),
        "damper": 3.0 + rng.random((2, 4, 2, 1)),
        "springs": rng.random((4, 1)),
        "neighbour": 0.1 * rng.normal(size=(2, 1, 1)),
    }


def solution(core, number, seed=2):
    r, x = np.random.default_rng(seed).normal(size=SHAPE), np.full(SHAPE, np.nan)
    core.solve(number, r, x)
    return x


def test_no_solution_before_a_matrix():
    for number in (0, 1, -1):
        with pytest.raises(ValueError, match=rf"^factored: expected .* factored last, 0 \(0 for none\), found {number}$"):
            solution(wheel(), number)


def test_no_solution_with_the_matrix_of_another_object():
    one, other = wheel(), wheel()
    one.factor(**matrix())
    two = [other.factor(**matrix(seed)) for seed in (1, 2)]
    assert two == [1, 2]
    with pytest.raises(ValueError, match=r"^factored: "):
        solution(one, two[1])


def test_the_solution_is_that_of_the_object_whatever_was_done_before():
    fresh, used = wheel(), wheel()
    number = fresh.factor(**matrix())
    expected = solution(fresh, number)
    assert np.isfinite(expected).all() and np.abs(expected).max() > 0.01
    solution(used, used.factor(**matrix(5)), 6)
    singular = {name: np.zeros_like(array) for name, array in matrix().items()}
    assert used.factor(**singular) == 0
    number = used.factor(**matrix())
    solution(used, number, 7)
    np.testing.assert_array_equal(solution(used, number), expected)


def test_a_singular_matrix_has_no_number_and_takes_that_of_the_one_before():
    core = wheel()
    number = core.factor(**matrix())
    assert core.factor(**{name: np.zeros_like(array) for name, array in matrix().items()}) == 0
    with pytest.raises(ValueError, match=r"^factored: "):
        solution(core, number)
    with pytest.raises(ValueError, match=r"^factored: "):
        solution(core, 0)


@pytest.mark.parametrize("name", list(matrix()))
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_every_entry_of_a_matrix_is_finite(name, bad):
    core, arrays = wheel(), matrix()
    number = core.factor(**arrays)
    expected = solution(core, number)
    arrays[name].flat[-1] = bad
    with pytest.raises(ValueError, match=f"^{name}: expected finite numbers, found {bad} at flat index"):
        core.factor(**arrays)
    np.testing.assert_array_equal(solution(core, number), expected)  # refused before anything was touched


@pytest.mark.parametrize("name", ["own", "next"])
def test_every_row_is_finite(name):
    rows = np.full((2 if name == "own" else 1, 3, 3), np.inf)
    with pytest.raises(ValueError, match=f"^{name}: expected finite numbers"):
        wheel(**{name: rows})


def test_the_right_hand_side_is_finite():
    core = wheel()
    number, r = core.factor(**matrix()), np.zeros(SHAPE)
    r[1, 1, 1] = np.nan
    with pytest.raises(ValueError, match=r"^r: expected finite numbers"):
        core.solve(number, r, np.zeros(SHAPE))
