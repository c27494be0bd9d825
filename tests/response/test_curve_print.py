"""Print of the derivatives of a curve, and the sense of a negative residual flexibility."""

import numpy as np
import pytest

import bdamper as bd
from bdamper.contact.stiffness import unit_traction
from bdamper.response.sensitivity import CurveSensitivity


def test_derivatives_of_a_curve_print_at_most_ten_lines():
    n = np.arange(200.0)
    found = CurveSensitivity("preload", 100.0, 1e-3 * n, 1e-6j * n, np.ones((200, 2)))
    lines = str(found).split("\n")
    assert len(lines) <= 10 and lines[0] == "Largest change for +1 % of preload: 199 µm"
    assert "array" not in repr(found) and "\n" not in repr(found)


def test_a_negative_residual_flexibility_means_modes_that_are_too_flexible():
    """Springs in series: the modes have the flexibility 3, the full model 2; the residual is their difference."""
    residual = (2.0 - 3.0) * np.eye(3)
    with pytest.raises(
        bd.ModelError,
        match=r"along t1: .*at most -1 m³/N: the retained modes are more flexible than",
    ):
        unit_traction(residual, np.ones(1))
