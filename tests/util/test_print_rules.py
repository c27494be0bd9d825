"""Rules of printed results: checks, calls to make, rounding."""

from dataclasses import replace

import numpy as np
import pytest

from bdamper.util.formatting import counted, percent, spaced, without_rounding
from bdamper.util.statement import Row, Statement
from tests.every_result import BAND, RESULTS, VARIANTS, result
from tests.golden.scenes import turning
from tests.printed import said

CHECKS = [
    Row("Equilibrium", "pass", "residual 0"),
    Row("Search", "pass", "complete"),
    Row("Harmonics", "uncertain", "5 %"),
    Row("Time integration", "not run", "study.time_response(peak)"),
    Row("Energy", "not run", "study.time_response(peak)"),
]


def test_passed_checks_are_one_line_and_those_not_run_are_calls_to_make():
    statement = Statement(
        ["Verdict"], checks=CHECKS, remarks=["Not covered: wear", "Remedy: none"]
    ).with_next("all values: result.summary()")
    assert statement.text.split("\n") == [
        "Verdict",
        "",
        "2 checks passed, 1 uncertain",
        "Harmonics    uncertain  5 %",
        "",
        "Remedy: none",
        "",
        "Not covered  wear",
        "Next         time integration and energy, by one call: study.time_response(peak)",
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


def test_an_incomplete_fit_says_so_first():
    within_noise = replace(result("fit"), residual=np.full((2, 2), 0.5))
    assert within_noise._headline().startswith("Fitted with a misfit of ")
    stopped = replace(within_noise, status="incomplete", reason="20 steps did not converge")
    assert stopped._headline().startswith("Incomplete fit: 20 steps did not converge; misfit ")
    assert "Fitted" not in said(stopped)


@pytest.mark.slow
def test_a_crossing_that_failed_has_a_remark():
    found = turning().resonance_crossings((400.0, 500.0), [5], damper_mass_factor=(0.8, 1.2))
    values = found.values.copy()
    values["amplitude"][0] = np.nan
    for kind, remark in ((None, "failed"), ("none", "no crossing"), ("end", "end")):
        values["kind"][0] = kind
        lost = replace(found, values=values, status=("failed", "complete"), reason=("why", ""))
        _, first, _ = lost._crossing_table()
        assert first[-1] == remark
        assert "None" not in str(lost)


def test_sensitivities_of_a_curve_are_those_of_its_peak():
    """Along the curve its highest amplitude is stationary, so that only the move across it counts."""
    study, curve = VARIANTS["now"], result("frequency_response")
    found = study.curve_sensitivities(curve)
    table = {row[0]: row[2] for row in found._statement().table[1:]}
    of_peak = study.peak_sensitivities(study.peak(2.0, BAND)).changes()
    assert len(table) == len(of_peak) == 5
    for name, (amplitude, _) in of_peak.items():
        assert table[spaced(name)] == percent(amplitude, sign=True)
    assert str(found).startswith("Change for +1 % of a parameter: ")


def test_optimum_and_time_integrations_print_tables():
    curve = result("optimal_curve")
    assert said(curve.optimum).startswith("Preload 500 mN Amplitude 804 mm ")
    assert said(curve.time_response).startswith("no time integration")
    integrated = replace(curve, time_response=(result("time_response"),))
    head, row = str(integrated.time_response).split("\n")
    assert head.startswith("Preload  Time integration") and row.startswith("2 N  ")
    # the amplitude of the optimum stays a value of the summary
    assert "optimum amplitude 803.6" in said(curve.summary())
