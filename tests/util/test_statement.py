"""Printed statements: width of the lines, columns, and the same content in a notebook."""

import html
import re
from dataclasses import replace

import pytest

from bdamper.util.statement import WIDTH, Row, Statement

LONG = "70.1 to 74 µm in time, 75.3 µm by harmonic balance, and many more words that need a second line"


@pytest.fixture
def statement():
    return Statement(
        verdict=[
            "Lowest amplitude at 104 N: engine order 5, 1 N of excitation",
            "Not for design: why",
        ],
        rows=[
            Row("Preload", "104 N", LONG),
            Row("", "", "a second remark"),
            Row("Half range", "75 µm"),
        ],
        checks=[Row("Optimum within the range", "pass", LONG)],
        remarks=["Remedy: use harmonics=5", ""][:1],
    )


def test_no_line_is_wider_than_a_page_and_no_number_loses_its_unit(statement):
    lines = statement.text.split("\n")
    assert max(map(len, lines)) <= WIDTH
    assert not any(re.search(r"\d$", line) for line in lines if "µm" in line)


def test_no_number_loses_its_unit_wherever_a_line_ends():
    for length in range(60, WIDTH + 5):
        text = f"{'x' * length} 70.1 µm, 0.7 rad/s and 1.5 kN more words"
        lines = Statement([text]).text.split("\n")
        assert not any(re.search(r"\d$", line) for line in lines), lines


def test_remarks_stay_in_their_column(statement):
    lines = statement.text.split("\n")
    first = next(i for i, line in enumerate(lines) if line.startswith("Preload"))
    column = lines[first].index("70.1")
    assert lines[first + 1].startswith(" " * column + lines[first + 1][column])
    assert lines[first + 2] == " " * column + "a second remark"


def test_parts_are_separated_by_empty_lines_and_empty_parts_are_left_out(statement):
    verdict, rows, checks, remarks = statement.text.split("\n\n")
    assert verdict.split("\n") == list(statement.verdict)
    assert (
        rows.startswith("Preload")
        and re.match(r"Optimum within the range +pass +70.1 to", checks)
        and remarks == statement.remarks[0]
    )
    assert Statement(["No optimum: why"]).text == "No optimum: why"


def test_checks_with_a_time_have_a_column_for_it(statement):
    """Before the findings, whose length varies; a table without times has no such column."""
    checks = [Row("Time integration", "pass", LONG), Row("More harmonics", "not run", "call")]
    timed = replace(statement, checks=checks, times=["24 s", ""])
    header, first, *_, last = timed.full_text.split("\n\n")[2].split("\n")
    assert header.split() == ["Check", "Result", "Time", "Finding"]
    assert first.index("24 s") == header.index("Time")
    assert first.index("70.1") == header.index("Finding") == last.index("call")
    assert "(24 s)" in timed.text and "(24 s)" in timed.html
    assert "Time" not in statement.full_text
    both = replace(timed, checks=[checks[0], Row("Search", "pass", "complete")])
    assert "2 checks passed (time integration 24 s)" in both.text


def test_a_notebook_shows_the_same_texts(statement):
    shown = html.unescape(re.sub(r"<[^>]+>", " ", statement.html))
    for text in (
        *statement.verdict,
        *statement.remarks,
        *(cell for row in statement.rows for cell in row),
    ):
        assert text in shown
    assert "<td" not in Statement(["<td"]).html


def test_a_text_of_the_result_cannot_add_markup():
    assert "<script>" not in Statement(["<script>"], [Row("<script>", "1", "<script>")]).html
