"""Contract of the core's equations of a wheel: what they refuse."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from bdamper import _core
from tests.core.test_conformance import wheel_arrays
from tests.each import each


def arrays(**changes):
    return wheel_arrays(np.random.default_rng(0)) | changes


@each("name", [k for k, v in arrays().items() if np.ndim(v) and v.dtype.kind in "fc" and k != "w"])
@each("bad", [np.nan, np.inf])
def test_every_number_is_finite(name, bad):
    wrong = arrays()[name].copy()
    wrong.flat[-1] = bad
    with pytest.raises(ValueError, match=f"^{name}: expected "):
        _core.Wheel(**arrays(**{name: wrong}))


@each(
    ("changes", "why"),
    [
        ({"n_sector": 2}, "3 to 10000 sectors"),
        ({"n_kept": 2}, "n_kept <= n_root"),
        ({"n_root": 3}, "n_kept <= n_root <= n_blade"),
        ({"active": np.array([True, True, False])}, "cosine and sine of a harmonic together"),
        ({"active": np.zeros(3, bool)}, "at least one coefficient"),
        ({"law": np.full(6, 3, np.intc)}, "law"),
        ({"rows": np.zeros((2, 3, 4))}, "^rows: expected"),
        ({"n_harm": 0}, "number of harmonics"),
        (
            {"n_blade": 2**31 - 1, "n_damper": 2**31 - 1},
            "^n_sector, .* at most 268435456 numbers in an array$",
        ),
        ({"n_root": 2, "n_kept": 2**31 - 1, "n_damper": 2}, "n_kept <= n_root"),
        ({"n_blade": 600, "n_damper": 600}, "at most 1000 coordinates"),
        (
            {"n_sector": 10000, "n_point": 100000},
            "^n_sector, .* at most 268435456 numbers in an array$",
        ),
    ],
)
def test_sizes_fit_together(changes, why):
    with pytest.raises(ValueError, match=why):
        _core.Wheel(**arrays(**changes))


def test_a_wheel_keeps_what_it_was_given():
    given = arrays()
    core, y = _core.Wheel(**given), np.append(0.1 * np.arange(27.0), 0.5)
    r, again = np.empty(27), np.empty(27)
    core.evaluate(y, r)
    for value in given.values():
        if np.ndim(value):
            value[...] = 0
    core.evaluate(y, again)
    assert_array_equal(again, r)
