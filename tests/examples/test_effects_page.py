"""The code of docs/effects.md runs, and its table says what the advice says."""

import re
from pathlib import Path

import pytest

PAGE = Path(__file__).resolve().parents[2] / "docs" / "effects.md"


@pytest.mark.slow
def test_advice_of_the_page(monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "Agg")
    page, space = PAGE.read_text(), {}
    for block in re.findall(r"```python\n(.*?)```", page, re.S):
        exec(compile(block, str(PAGE), "exec"), space)
    advice = space["advice"]
    row = re.compile(r"^ *(translation X|contact points beyond 4|separation) +(\S+)", re.M)
    shown, found = (dict(row.findall(text)) for text in (page, advice.summary()))
    assert len(shown) == 3
    assert [float(found[name]) for name in shown] == pytest.approx([float(v) for v in shown.values()], rel=0.02)
