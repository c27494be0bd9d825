"""The data of docs/fit.md fitted with the harmonics of the model that made them."""

import re
from pathlib import Path

import numpy as np
import pytest

import bdamper as bd
from tests.hard.random_studies import FULL

PAGE = Path(__file__).resolve().parents[2] / "docs" / "fit.md"


@pytest.mark.skipif(not FULL, reason="three minutes: make hard")
def test_a_fit_leaves_a_local_minimum(tmp_path, monkeypatch):
    """From the initial values the least squares end at a misfit of 5.8; a fit without one test leads out of there."""
    monkeypatch.chdir(tmp_path)
    space = {}
    for block in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.S)[:2]:
        exec(compile(block, str(PAGE), "exec"), space)
    found, free = space["found"], bd.importers.read_response("free.csv")
    richer = bd.fit(
        space["study"].replace(harmonics=5),
        space["runs"],
        space["ranges"],
        free=free,
        intervals="linear",
    )
    truth = np.array([1.0, 1.0, 1.05, 0.42, 0.8])  # in the order of the names
    assert richer.status == "complete" and richer.misfit < 1.1
    assert ((richer.low < truth) & (truth < richer.high)).all()
    both = found.widen(richer)
    assert ((both.low < truth) & (truth < both.high)).all()
