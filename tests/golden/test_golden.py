"""Stored answers of an earlier state of the package come out again, to 1e-9 (:mod:`tests.golden.record`).

They are no proof of being right, which other tests give: they show that a change of the engine changed nothing else.
"""

import json

import numpy as np
import pytest

from tests.golden.record import FILE
from tests.golden.scenes import SCENES, SLOW

ANSWERS = json.loads(FILE.read_text())
FREQUENCY = ("maxima at", "optimum at", "peak at", "frequency", "speed")
"""Places of stationary values, which are found less sharply than these."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name in SLOW else ()) for name in SCENES]
)
def test_answer(name):
    expected = ANSWERS[name]["values"]
    values, _ = SCENES[name]()
    assert set(values) == set(expected)
    for key, value in expected.items():
        if isinstance(value, (str, int)):
            assert values[key] == value, key
            continue
        found, want = np.asarray(values[key], float), np.asarray(value, float)
        assert found.shape == want.shape, (key, values[key], value)
        tolerance = 1e-6 if key in FREQUENCY else 1e-9
        size = np.nanmax(np.abs(want), initial=0.0)
        np.testing.assert_allclose(found, want, rtol=tolerance, atol=tolerance * size, err_msg=key)
