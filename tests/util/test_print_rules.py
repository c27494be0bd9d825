"""Rules of printed results: checks, calls to make, rounding."""

import pytest

from bdamper.util.display import ALL_VALUES
from bdamper.util.formatting import counted, percent, without_rounding
from bdamper.util.statement import Row, Statement
from tests.every_result import RESULTS, result

CHECKS = [
    Row("Equilibrium", "pass", "residual 0"),
    Row("Search", "pass", "complete"),
    Row("Harmonics", "uncertain", "5 %"),
    Row("Time integration", "not run", "study.time_response(peak)"),
]


def test_passed_checks_are_one_line_and_those_not_run_are_calls_to_make():
    statement = Statement(
        ["Verdict"], checks=CHECKS, remarks=["Not covered: wear", "Remedy: none"]
    ).with_next(ALL_VALUES)
    assert statement.text.split("\n") == [
        "Verdict",
        "",
        "2 checks passed, 1 uncertain",
        "Harmonics    uncertain  5 %",
        "",
        "Remedy: none",
        "",
        "Not covered  wear",
        "Next         time integration: study.time_response(peak)",
        "             all values: result.summary()",
    ]
    for shown in (statement.full_text, statement.html):
        assert all(text in shown for text in ("Harmonics", "Remedy: none", "wear"))
    assert all(cell in statement.full_text for check in CHECKS for cell in check)
    assert not Statement(["Verdict"]).text.count("check")


def test_a_check_that_passed_alone_keeps_its_finding():
    statement = Statement(["Verdict"], checks=CHECKS[:1])
    assert statement.text == "Verdict\n\nEquilibrium  pass  residual 0"


def test_a_result_has_all_of_its_checks():
    (check,) = checks = result("static").checks
    assert check[:2] == ("Equilibrium", "pass") and str(checks) == "  ".join(check)


@pytest.mark.slow
@pytest.mark.parametrize("name", RESULTS)
def test_a_failed_check_has_a_remedy_and_a_verdict_that_says_so(name):
    statement = result(name)._statement()
    if any(check.value == "FAIL" for check in statement.checks):
        assert statement.verdict[0].startswith("Not")
        assert any(remark.startswith("Remedy: ") for remark in statement.remarks)


def test_rounding_is_printed_as_zero():
    assert percent(-1.5e-13, True) == "0 %" and percent(-2e-6, True) == "-0.0002 %"
    assert without_rounding(-9.4e-18, 3e-3) == 0.0 and without_rounding(1e-9, 1.0) == 1e-9
    assert " -" not in str(result("dissipation")), "no loss is negative"


def test_plurals():
    assert [counted(n, what) for n, what in ((2, "mass"), (1, "mass"), (3, "frequency"), (0, "point"))] == [
        "2 masses", "1 mass", "3 frequencies", "no point"
    ]  # fmt: skip
