"""Rules of printed results: header of the checks, last remark, rounding."""

import pytest

from bdamper.util.display import ALL_VALUES
from bdamper.util.formatting import counted, percent, without_rounding
from bdamper.util.statement import Row, Statement
from tests.every_result import RESULTS, result


def test_checks_have_a_header_and_the_effects_not_covered_are_last():
    statement = Statement(["Verdict"], checks=[Row("Equilibrium", "pass", "residual 0")],
                          remarks=["Remedy: none", "Not covered: wear"])  # fmt: skip
    lines = statement.with_remark(ALL_VALUES).text.split("\n")
    assert [line.split()[0] for line in lines if line] == [
        "Verdict",
        "Check",
        "Equilibrium",
        "Remedy:",
        "All",
        "Not",
    ]
    assert "Finding" in statement.html and not Statement(["Verdict"]).text.count("Check")


@pytest.mark.slow
@pytest.mark.parametrize("name", RESULTS)
def test_a_failed_check_has_a_remedy_and_a_verdict_that_says_so(name):
    statement = result(name)._statement()
    if any(check.value == "FAIL" for check in statement.checks):
        assert statement.verdict[0].startswith("Not")
        assert any(remark.startswith("Remedy: ") for remark in statement.remarks)
    closing = [remark for remark in statement.remarks if remark.startswith("Not covered")]
    assert not closing or statement.remarks[-1] == closing[-1]


def test_rounding_is_printed_as_zero():
    assert percent(-1.5e-13, True) == "0 %" and percent(-2e-6, True) == "-0.0002 %"
    assert without_rounding(-9.4e-18, 3e-3) == 0.0 and without_rounding(1e-9, 1.0) == 1e-9
    assert " -" not in str(result("dissipation")), "no loss is negative"


def test_plurals():
    assert [counted(n, what) for n, what in ((2, "mass"), (1, "mass"), (3, "frequency"), (0, "point"))] == [
        "2 masses", "1 mass", "3 frequencies", "no point"
    ]  # fmt: skip
