"""Printed import report: first line, rows, checks, and what the model lacks."""

import numpy as np
import pytest

import bdamper as bd
from bdamper.importers.build import BuiltModel
from bdamper.importers.fe_body import FEBody
from bdamper.util.formatting import amount, area_text
from bdamper.util.statement import Row
from tests.annulus import small_sector
from tests.fe_bodies import SIX_BLADES, contacts
from tests.imports import build
from tests.printed import said

CHECK = "blade: density of the matrices 7850 kg/m3"
FACE = "left: 9 points (3 x 3 along t1 and t2), 432 mm² (100 % of face a)\nmeshes 0 to 0 m apart"
FAILURE = "blade: expected frequencies within 0.1 % of the file, found 3 %"
MISSING = "elastic deformation of the damper (no matrices)"


@pytest.fixture(scope="module")
def fe():
    return small_sector(6)


def report(**texts):
    return BuiltModel(bd.reference_model("turbine_blade"), faces=(FACE,), **texts)


def test_passed_checks_stand_in_the_first_line_and_in_rows():
    built = report(checks=(CHECK,), missing=(MISSING,), sources={"blade": "blade.inp\nnodes: 9"})
    model = built.model
    text = said(built)
    assert text.startswith(
        f"All checks passed: imported model of {model.n_blades} sectors with blade, damper "
    )
    assert "blade source blade.inp nodes: 9" in text
    assert "left 9 points (3 x 3 along t1 and t2), 432 mm² (100 % of face a) meshes 0 to" in text
    assert "blade pass density of the matrices 7850 kg/m3" in said(built)
    assert f"Not in this model: {MISSING}" in text
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


def test_the_report_begins_with_what_a_user_compares():
    """The number of passed checks follows; the summary has their findings."""
    rows = (
        Row("Damper", "69 g", "at a radius of 236.2 mm"),
        Row("Units", "mm, t, s", "of the files"),
    )
    built = report(checks=(CHECK, CHECK), to_compare=rows)
    compared, frequencies, n_passed = str(built).split("\n\n")[1:4]
    assert said(compared).startswith("Damper 69 g at a radius of 236.2 mm Units mm, t, s")
    assert frequencies.startswith("Nodal diameter") and n_passed == "2 checks passed"
    assert built.summary().count("density of the matrices") == 2


@pytest.mark.slow
def test_an_import_compares_the_quantities_of_the_drawing(bodies):
    """The mass of the matrix, the first frequency, rotor speeds, both faces, units, and shifts."""
    given = SIX_BLADES | {"n_modes": 4, "contacts": contacts(9)}
    built = build(*bodies, **given, engine_order=[1], harmonics=1)
    rows = {name: (value, remark) for name, value, remark in built.to_compare}
    contact_names = ["Contact left", "Contact right"]
    names = ["Damper", "Mode 1", "Engine order 1", *contact_names, "Units", "Bonded faces"]
    assert list(rows) == names
    _, damper = bodies
    # each direction has the whole mass
    assert rows["Damper"][0] == amount(float(damper.mass.sum()) / 3.0, "kg")
    assert rows["Mode 1"] == (
        amount(float(built.frequencies[1][0]), "Hz"),
        "at nodal diameter 1, without contact",
    )
    area = float(built.model.interfaces["left"].area.sum())
    assert rows["Contact left"][0] == area_text(area) == "432 mm²"
    assert rows["Contact left"][1].startswith("100 % of face a")
    assert rows["Contact right"][1].endswith("side b in sector +1")
    assert rows["Units"] == ("m, kg, s", "of the files")
    (check,) = [text for text in built.checks if "bonded faces raise" in text]
    # one revolution per period of the mode
    speeds = ", ".join(f"{60.0 * hertz:.0f}" for hertz in built.frequencies[1][:3])
    met = "meets modes 1, 2 and 3, without contact"
    assert rows["Engine order 1"] == (f"{speeds} rpm", met)
    shifts, of_modes = rows["Bonded faces"]
    assert of_modes == "shift of modes 1, 2 and 3 at nodal diameter 1"
    each_shift = [shift.strip("+ %") for shift in shifts.split(",")]
    assert f"nodal diameter 1 by {', '.join(f'{shift} %' for shift in each_shift)}, " in check


@pytest.mark.slow
def test_an_import_without_engine_order_names_the_call_for_the_speeds(bodies):
    """Its order and range are those of the lowest mode that is excited."""
    given = SIX_BLADES | {"n_modes": 4, "contacts": contacts(9)}
    built = build(*bodies, **given, nodal_diameters=[2])
    rows = {name: (value, remark) for name, value, remark in built.to_compare}
    rpm = 60.0 * float(built.frequencies[2][0]) / 2.0
    call = f"study.campbell(rpm=({0.8 * rpm:.0f}, {1.2 * rpm:.0f}), engine_orders=[2])"
    assert rows["Engine order"] == ("unknown", f"speeds at which one meets the modes: {call}")


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
