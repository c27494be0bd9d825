"""The code of docs/lumped.md: at most ten lines an example, and the answers that are known."""

import re
from pathlib import Path

import numpy as np
import pytest

PAGE = Path(__file__).resolve().parents[2] / "docs" / "lumped.md"


@pytest.fixture(scope="module")
def page():
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.S)
    assert len(blocks) == 8
    assert max(len(block.splitlines()) for block in blocks) <= 10
    space = {}
    for block in blocks:
        exec(compile(block, str(PAGE), "exec"), space)
    return space


@pytest.mark.slow
def test_one_mass(page):
    assert page["peak"].amplitude == pytest.approx(3.53659833, abs=6e-9)
    assert 2 * np.pi * page["peak"].frequency == pytest.approx(1.1086214, abs=6e-8)


@pytest.mark.slow
def test_blade_on_the_ground(page):
    """Known from two independent programs."""
    curve = page["ground_curve"]
    assert curve.complete
    assert 2 * np.pi * curve.frequency[curve.folds] == pytest.approx([2.441122, 1.962464], abs=6e-7)
    assert curve.peak.amplitude == pytest.approx(1.2703, abs=6e-5)


@pytest.mark.slow
def test_wedges(page):
    """Outward sliding everywhere: N = P/(2 (sin + mu cos)); a symmetric wedge is two halves."""
    normal = 1.0 / (2.0 * (np.sin(np.pi / 4) + 0.3 * np.cos(np.pi / 4)))
    for study, load in ((page["half"], 0.5), (page["wedge"], 1.0)):
        force = study.static(load).force
        assert force == pytest.approx(
            np.tile([0.3 * normal, 0.0, normal], (len(force), 1)), rel=1e-12
        )
    half, whole = page["half_peak"], page["wedge_peak"]
    assert half.ok and whole.ok
    assert whole.amplitude == pytest.approx(half.amplitude, rel=1e-9)
    assert whole.frequency == pytest.approx(half.frequency, rel=1e-9)


def test_shaken_base(page):
    """The relative motion of a sticking contact is that of one mass on two springs."""
    curve = page["shaken_curve"]
    w = 2.0 * np.pi * curve.frequency
    relative = 0.5 / np.abs(2.0 - w**2 + 0.02j * w)
    shown = np.abs(page["shaken"].response_at(curve, "x0")[:, 1])
    assert shown == pytest.approx(relative, rel=1e-7)
    # the motion in space adds that of the base, -0.5/w^2
    absolute = np.abs(-0.5 / (2.0 - w**2 + 0.02j * w) - 0.5 / w**2)
    assert curve.amplitude == pytest.approx(absolute, rel=1e-7)


def test_two_blades(page):
    assert page["two_peak"].amplitude == pytest.approx(3.53659833, abs=6e-9)


def test_chain(page):
    assert page["chain_curve"].complete
    _, force, _ = page["chain"].problem.system(0.0).contact(page["chain_curve"].peak.y[:-1])
    assert np.abs(force[0, 2]).max() > 0.01, "it meets the stop"
    assert np.abs(force[1, 0]).max() > 0.01, "the cubic spring is strained"
