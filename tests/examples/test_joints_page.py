"""The tutorial of docs/joints.md runs from the shipped model to an optimum over both loads."""

import re
from pathlib import Path

import numpy as np
import pytest

PAGE = Path(__file__).resolve().parents[2] / "docs" / "joints.md"


@pytest.mark.slow
def test_an_optimum_over_both_loads():
    section = PAGE.read_text().split("## An optimum over both loads")[1].split("\n## ")[0]
    (block,) = re.findall(r"```python\n(.*?)```", section, re.S)
    space = {}
    exec(compile(block, str(PAGE), "exec"), space)
    heights = {load: curve.amplitude for load, curve in space["curves"].items()}
    assert set(heights) == {50.0, 200.0} and all(np.isfinite(a).all() and (a > 0.0).all() for a in heights.values())
    lowest = {load: a.min() for load, a in heights.items()}
    assert lowest[space["best"]] == min(lowest.values()) and lowest[50.0] != lowest[200.0]
    left = space["own"].static(4.0).normal_force["shroud"]
    assert 0.0 <= left < 4.0, "the dampers take load off the shroud"
