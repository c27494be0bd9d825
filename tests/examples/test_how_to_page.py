"""The recipes of docs/how-to.md run and do what the page says."""

import re
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import numpy as np
import pytest

import bdamper as bd

PAGE = Path(__file__).resolve().parents[2] / "docs" / "how-to.md"


@pytest.mark.slow
def test_recipes(tmp_path, monkeypatch):
    page = PAGE.read_text()
    blocks = re.findall(r"```python\n(.*?)```", page, re.S)
    assert len(blocks) == 10 and max(len(block.splitlines()) for block in blocks) <= 10
    monkeypatch.chdir(tmp_path)
    seen = []
    space = {"__name__": "__main__"}
    for block in blocks:
        exec(compile(block, str(PAGE), "exec"), space)
        seen.append(dict(space))
    chosen, mass, compared, swept, resumed = seen[1:6]
    assert chosen["best"].verified and chosen["low"] < chosen["best"].preload < chosen["high"]
    assert 0.42 < mass["radius"] < 0.45 and mass["mass"] < mass["damper"].mass
    assert "a damper of 6 g" in mass["change"]
    assert compared["designs"].curves[1].peak.amplitude < 0.9 * compared["designs"].curves[0].peak.amplitude
    assert swept["result"].complete and swept["result"].shape == (3, 2)
    assert np.array_equal(resumed["result"].seconds, swept["result"].seconds), "points were computed again"
    assert not bd.load("curve.h5").diff(space["curve"])
    cycle = space["cycle"]
    assert abs(cycle.imbalance) < 1e-9 and cycle.lost > 0.5 * cycle.excitation
    assert {path.suffix for path in tmp_path.iterdir()} >= {".png", ".csv", ".jsonl", ".h5"}
    shown = set(re.findall(r"\(images/(\w+\.png)\)", page)) - {"designs.png", "explorer.png"}
    assert len(shown) == 3 and shown <= {path.name for path in tmp_path.glob("*.png")}
