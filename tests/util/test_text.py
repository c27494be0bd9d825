"""Numbers and names in texts."""

import numpy as np
import pytest

from bdamper.util.text import aligned, cut, length, newtons, percent, spaced


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0123, "1.2 %"), (0.994, "99 %"), (1.5, "150 %"), (1e-5, "0.001 %"), (np.nan, "unknown"), (-0.5, "-50 %")],
)
def test_percent(value, text):
    assert percent(value) == text


def test_percent_with_a_sign():
    assert percent(0.5, True) == "+50 %"


def test_forces_and_lengths():
    assert [newtons(v) for v in (999.0, 1000.0, 2500.0, 1e6)] == ["999 N", "1 kN", "2.5 kN", "1e+06 N"]
    assert length(np.array([np.nan, -2e-4])) == (1e6, "µm") and length(np.array([0.5]), np.array([0.0])) == (1e3, "mm")
    assert length(np.array([1.0])) == (1.0, "m") and length(np.zeros(0)) == (1e6, "µm")


def test_names_and_tables():
    assert spaced("excitation.amplitude_of") == "excitation amplitude of"
    assert cut("abcdef", 6) == "abcdef" and cut("abcdefg", 6) == "abc..."
    assert aligned([("a", "bcd", ""), ("ef", "g", "h")], "- ") == ["- a   bcd", "- ef  g    h"]
