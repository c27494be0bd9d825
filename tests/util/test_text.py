"""Numbers and names in texts."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bdamper.util.formatting import (
    PREFIXES,
    aligned,
    amount,
    percent,
    same_digits,
    spaced,
    truncate,
)
from tests.each import each


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0123, "1.2 %"),
        (0.994, "99 %"),
        (1.5, "150 %"),
        (1e-5, "0.001 %"),
        (np.nan, "unknown"),
        (-0.5, "-50 %"),
    ],
)
def test_percent(value, text):
    assert percent(value) == text


@pytest.mark.parametrize(
    ("texts", "even"),
    [
        (["2.53 m", "2.5 m", "957 mm"], ["2.53 m", "2.50 m", "957 mm"]),
        (["0.194 Hz", "0.19413 Hz"], ["0.19400 Hz", "0.19413 Hz"]),
        (["1 kN", "2 kN"], ["1 kN", "2 kN"]),
        (["13.9 g", "1234 g", "9 g"], ["13.90 g", "1234 g", "9.000 g"]),
        (["+1.3 %", "-46 %", "0 %"], ["+1.3 %", "-46 %", "0 %"]),
        (["1.4 m", "no peak", ""], ["1.4 m", "no peak", ""]),
        # several units, words, and numbers without a unit remain
        (["2.5 m", "0.19413 Hz"], ["2.5 m", "0.19413 Hz"]),
        (["1", "10"], ["1", "10"]),
    ],
)
def test_amounts_of_one_column_have_equally_many_digits(texts, even):
    assert same_digits(texts) == even


def test_percent_with_a_sign():
    assert percent(0.5, True) == "+50 %"


def test_names_and_tables():
    assert spaced("excitation.amplitude_of") == "excitation amplitude of"
    assert truncate("abcdef", 6) == "abcdef" and truncate("abcdefg", 6) == "abc..."
    assert aligned([("a", "bcd", ""), ("ef", "g", "h")], "- ") == ["- a   bcd", "- ef  g    h"]


class TestAmount:
    """Three digits and the prefix that fits, for a reader; nothing that its number does not say."""

    @each(
        ("value", "unit", "text"),
        [
            (57.12e-6, "m", "57.1 µm"), (1.4449e-3, "m", "1.44 mm"), (999.7e-6, "m", "1 mm"), (-3.2e-9, "m", "-3.2 nm"),
            (0.0, "m", "0 m"), (7e-25, "J", "7e-25 J"), (103.6448, "N", "104 N"), (25e3, "N", "25 kN"),
            (1e-4, "N", "0.0001 N"), (1234.56, "Hz", "1234.6 Hz"), (660.784, "Hz", "660.78 Hz"), (250e3, "Hz", "250000 Hz"),
            (0.0203, "kg", "20.3 g"), (39.2e6, "Pa", "39.2 MPa"), (237e-6, "J per cycle", "237 µJ per cycle"),
            (1.5, "", "1.5"), (33.24, "%", "33.2 %"), (float("nan"), "m", "nan m"), (float("inf"), "N", "inf N"),
            (1.2e7, "N/m", "12 MN/m"),
        ],
    )  # fmt: skip
    def test_three_digits(self, value, unit, text):
        assert amount(value, unit) == text

    def test_more_digits(self):
        assert amount(57.123456e-6, "m", 6) == "57.1235 µm"

    @given(st.floats(1e-9, 1e5), st.sampled_from(["m", "N", "Hz", "Pa", "J", "s", "kg"]))
    def test_is_the_number(self, value, unit):
        number, _, shown = amount(value, unit).partition(" ")
        base = "g" if unit == "kg" else unit
        factor = PREFIXES[shown.removesuffix(base) or " "] * (1e-3 if unit == "kg" else 1.0)
        assert float(number) * factor == pytest.approx(value, rel=5.1e-3)
