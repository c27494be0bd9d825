"""The whole printed text of every kind of result; ``python -m tests.analyses.test_printed_results`` writes it."""

import re
from pathlib import Path

import pytest

from tests.every_result import RESULTS, result

TEXTS = Path(__file__).parents[1] / "golden" / "printed.txt"


def printed():
    """Return all texts, without times and rounding errors, which vary."""
    text = "\n\n".join(f"[{type(one).__name__}]\n{one}" for one in map(result, RESULTS)) + "\n"
    for varies, shown in (
        (r"[-+]?\d[\d.]*e-\d+|[-+]0(?= )", "0"),
        (r"(?<=  )\d[\d.]* m?s(?= )", "time"),
        (r"(?<=, )\d[\d.]* m?s(?=\n)", "time"),
        # the line may end behind an expected time
        (r"(?<=about )\d[\d.]* m?s:\s+", "time: "),
        (r" {2,}", "  "),
    ):
        text = re.sub(varies, shown, text)
    return text


@pytest.mark.slow
def test_every_kind_of_result_prints_what_it_printed():
    assert printed() == TEXTS.read_text(encoding="utf-8")


if __name__ == "__main__":
    TEXTS.write_text(printed(), encoding="utf-8")
