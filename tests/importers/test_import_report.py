"""Printed import report: first line, rows, checks, and what the model lacks."""

import numpy as np

import bdamper as bd
from bdamper.importers.build import BuiltModel
from bdamper.importers.fe_body import FEBody
from tests.printed import said

CHECK = "blade: density of the matrices 7850 kg/m3"
FACE = "left: 9 points (3 x 3 along t1 and t2), 432 mm² (100 % of face a)\nmeshes 0 to 0 m apart"
FAILURE = "blade: expected frequencies within 0.1 % of the file, found 3 %"
MISSING = "elastic deformation of the damper (no matrices)"


def report(**texts):
    return BuiltModel(bd.reference_model("turbine_blade"), faces=(FACE,), **texts)


def test_passed_checks_stand_in_the_first_line_and_in_rows():
    built = report(checks=(CHECK,), missing=(MISSING,), sources={"blade": "blade.inp\nnodes: 9"})
    model = built.model
    text = said(built)
    assert text.startswith(
        f"All checks passed: imported model of {model.n_blades} sectors with blade, damper "
        "blade source blade.inp nodes: 9"
    )
    assert "left 9 points (3 x 3 along t1 and t2), 432 mm² (100 % of face a) meshes 0 to" in text
    assert "blade pass density of the matrices 7850 kg/m3" in text
    assert text.endswith(f"Not in this model: {MISSING}")
    for d, basis in model.bodies["blade"].bases.items():
        lowest = np.sqrt(basis.omega2[0]) / (2.0 * np.pi)
        assert f" {d} {basis.n_natural} {lowest:.6g} " in text


def test_a_failed_comparison_stands_first_with_a_remedy():
    built = report(checks=(CHECK,), failed=(FAILURE,))
    text = said(built)
    assert text.startswith(f"Not confirmed by the other program: {FAILURE}")
    assert "blade FAIL expected frequencies within 0.1 % of the file, found 3 %" in text
    assert "All checks passed" not in text and "Remedy: compare element types" in text
    assert said(report()).startswith("Not checked: imported model of")


def test_a_notebook_shows_the_rows_of_the_report():
    page = report(checks=(CHECK,), failed=(FAILURE,))._repr_html_()
    assert page.startswith(f"<div><p><b>Not confirmed by the other program: {FAILURE}</b></p>")
    cells = [">FAIL</td>", ">pass</td>", ">9 points</td>"]
    assert all(cell in page for cell in cells) and "<pre>Import report" not in page


def test_a_body_prints_its_sizes_and_sets():
    body = FEBody(np.arange(1, 5), np.zeros((4, 3)), node_sets={"TIP": np.array([1, 2])})
    assert said(body) == "the given arrays Nodes 4 no solid element Node sets 1 TIP (2)"
    assert body.source_text == (
        "the given arrays\nnodes: 4, no solid element\nnode sets: 1, TIP (2)"
    )
