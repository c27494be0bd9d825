"""The code of docs/accuracy.md runs, and its errors of contact points are those of measured.md."""

import re
from pathlib import Path

import pytest

import bdamper as bd

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.fixture(scope="module")
def blocks():
    return re.findall(r"```python\n(.*?)```", (DOCS / "accuracy.md").read_text(), re.S)


@pytest.mark.slow
def test_code_of_the_page(blocks, capsys):
    """Without time integration, which the first block shows, and without the effects of the last one."""
    space = {"bd": bd}
    assert len(blocks) == 5
    for block in blocks[1:4]:
        exec(compile(block, "accuracy.md", "exec"), space)
    found = capsys.readouterr().out
    assert "Estimated error" in found and "For 5 %: " in found
    assert space["result"].tolerance == 0.05 and space["curve"].complete


@pytest.mark.slow
def test_effects_of_the_page(blocks):
    space = {"bd": bd}
    exec(compile(blocks[4], "accuracy.md", "exec"), space)
    row = re.compile(r"^ *(translation X|contact points beyond 4|separation) +(\S+)", re.M)
    shown, found = (dict(row.findall(text)) for text in ((DOCS / "accuracy.md").read_text(), space["advice"].summary()))
    assert len(shown) == 3
    assert [float(found[name]) for name in shown] == pytest.approx([float(v) for v in shown.values()], rel=0.02)


def test_errors_of_contact_points_are_those_measured():
    page, measured = (DOCS / "accuracy.md").read_text(), (DOCS / "evidence" / "measured.md").read_text()
    rows = {"contact_points": "unit tractions", "contact_points_residual": "six residual modes, points united"}
    for name, row in rows.items():
        table = re.search(rf"<!-- {name} -->.*?<!-- end -->", measured, re.S)[0]
        errors = {n: 100 * float(e) for n, e in re.findall(r"^\| (\d+) \| (\d\S+) \|", table, re.M)}
        shown = re.search(rf"^\| {row} \|.*192 points \| (.*) \|$", page, re.M)[1].split(" | ")
        assert [float(e) for e in shown] == pytest.approx([errors[n] for n in ("9", "24", "48", "96")], rel=0.01)
