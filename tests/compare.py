"""Comparisons of arrays that many tests make."""

import numpy as np


def assert_near(found, expected, tolerance):
    """Compare with an absolute tolerance."""
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance)


def assert_close(found, expected, tolerance):
    """Compare with a tolerance relative to the largest expected number."""
    assert_near(found, expected, tolerance * np.abs(expected).max())
