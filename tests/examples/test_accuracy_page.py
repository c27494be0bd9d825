"""The code of docs/accuracy.md runs, on quick settings, and its errors of contact points are those of measured.md."""

import re
from pathlib import Path

import pytest

import bdamper as bd
from tests.plain import plain_study

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.mark.slow
def test_code_of_the_page(capsys):
    study = plain_study(bd.reference_model("bladed_disk"), bd.Excitation("tip"), engine_order=5, friction_coefficient=0.4)
    space = {"bd": bd, "study": study}
    blocks = re.findall(r"```python\n(.*?)```", (DOCS / "accuracy.md").read_text(), re.S)
    assert len(blocks) == 3
    for block in blocks:  # the optimum of quick settings is higher
        exec(compile(block.replace("preloads_within(9e-5)", "preloads_within(2e-4)"), "accuracy.md", "exec"), space)
    found = capsys.readouterr().out
    assert "Estimated error" in found and "For 5 %: " in found
    assert space["result"].tolerance == 0.05 and space["curve"].complete


def test_errors_of_contact_points_are_those_measured():
    page, measured = (DOCS / "accuracy.md").read_text(), (DOCS / "evidence" / "measured.md").read_text()
    rows = {"contact_points": "unit tractions", "contact_points_residual": "six residual modes, points united"}
    for name, row in rows.items():
        table = re.search(rf"<!-- {name} -->.*?<!-- end -->", measured, re.S)[0]
        errors = {n: 100 * float(e) for n, e in re.findall(r"^\| (\d+) \| (\d\S+) \|", table, re.M)}
        shown = re.search(rf"^\| {row} \|.*192 points \| (.*) \|$", page, re.M)[1].split(" | ")
        assert [float(e) for e in shown] == pytest.approx([errors[n] for n in ("9", "24", "48", "96")], rel=0.01)
