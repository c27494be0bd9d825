"""The code of docs/results.md runs, and makes the pictures of the page."""

import re
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.mark.slow
def test_the_page_makes_its_pictures(tmp_path, monkeypatch):
    page = (DOCS / "results.md").read_text()
    monkeypatch.chdir(tmp_path)
    space = {}
    for block in re.findall(r"```python\n(.*?)```", page, re.S):
        exec(compile(block, "results.md", "exec"), space)
    shown = set(re.findall(r"\(images/(\w+\.png)\)", page))
    assert shown == {path.name for path in tmp_path.glob("*.png")} and len(shown) == 6
    assert all((DOCS / "images" / name).is_file() for name in shown)
    assert abs(space["cycle"].imbalance) < 1e-9 and space["cycle"].lost > 0.5 * space["cycle"].excitation
    plain = space["study"].replace(contact_stiffness="unit_traction")  # the same elasticity without residual modes
    other = plain.hysteresis(plain.peak(500.0, (330.0, 362.0)))
    assert space["cycle"].stiffness == pytest.approx(other.stiffness, rel=0.1)
    assert space["cycle"].damping_ratio == pytest.approx(other.damping_ratio, rel=0.1)
