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
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.S)
    assert len(blocks) == 17 and max(len(block.splitlines()) for block in blocks) <= 10
    monkeypatch.chdir(tmp_path)
    seen = []
    space = {"__name__": "__main__"}
    for block in blocks:
        exec(compile(block, str(PAGE), "exec"), space)
        seen.append(dict(space))
    chosen, mass, swept, dask, resumed = seen[1:6]
    assert chosen["best"].verified and chosen["low"] < chosen["best"].preload < chosen["high"]
    assert 0.42 < mass["radius"] < 0.45 and mass["mass"] < mass["damper"].mass
    assert "a damper of 6 g" in mass["change"]
    assert swept["result"].complete and swept["result"].shape == (3, 2)
    assert np.array_equal(dask["again"].array("amplitude"), swept["result"].array("amplitude"))
    assert np.array_equal(resumed["result"].seconds, swept["result"].seconds), "points were computed again"
    assert resumed["optimal"].optimum.preload == pytest.approx(chosen["best"].preload, rel=1e-9)
    assert not bd.load("curve.h5").diff(space["curve"]) and space["model"].hash == space["study"].model.hash
    assert space["designs"].curves[1].peak.amplitude < 0.9 * space["designs"].curves[0].peak.amplitude
    assert not space["short"].complete and space["short"].missing_ranges and space["further"].complete
    assert len(space["motion"].harmonics) == 16
    assert space["strongest"].best_margin >= np.nanmax(space["strongest"].margin) and space["margins"].least > 0.0
    assert space["optimal"].optimum.verified and space["richer"].peaks[-1].harmonics >= 3
    assert {path.suffix for path in tmp_path.iterdir()} >= {".vtu", ".png", ".csv", ".jsonl", ".h5"}
