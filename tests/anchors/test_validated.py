"""The problems of the page "Validated against": every number within its tolerance or known to differ, and on the page."""

from pathlib import Path

import pytest

from tests.validated import NEEDS, PROBLEMS, available

PAGE = Path(__file__).parents[2] / "docs" / "evidence" / "validated.md"
LONG = {
    "Planar wedge",
    "Planar wedge, forced",
    "The paper's four numbers",
    "CalculiX",
    "Limit cycles",
}
LONG |= {"Den Hartog's oscillator", "Goodman and Klumpp's beam", "Finite element models by others"}


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n in LONG else n for n in PROBLEMS]
)
def test_numbers_agree(name):
    if not available(name):
        pytest.skip(f"without {NEEDS[name][0]}")
    problem = PROBLEMS[name]()
    text = PAGE.read_text()
    for row in problem.rows:
        assert row.agrees != bool(row.differs), (row, row.error)
        assert f"| {row.quantity} |" in text, f"{row.quantity}: run make validate"


def test_the_page_has_every_problem_with_a_picture():
    text = PAGE.read_text()
    for name in PROBLEMS:
        assert f"## {name}\n" in text
    pictures = [
        line.split("](")[1].rstrip(")") for line in text.splitlines() if line.startswith("![")
    ]
    assert len(pictures) == len(PROBLEMS)
    assert all((PAGE.parent / picture).is_file() for picture in pictures)
    differing = [line for line in text.splitlines() if "**differs**" in line]
    assert differing and all(not line.rstrip(" |").endswith("**differs**:") for line in differing)
