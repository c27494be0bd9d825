"""Contact stiffness and friction of loops, against sliders added up one by one."""

import numpy as np
import pytest

import bdamper as bd
from bdamper.design.loop import read_loop, sliding_force

KT, MU, NORMAL = 4e7, 0.45, 100.0


def loop(spread, swing, n=200, sliders=400):
    """A loop by Masing's rule from the curve of first loading of many sliders, without a history."""
    t = 2.0 * np.pi * np.arange(n) / n
    x = swing * np.cos(t)
    limits = MU * NORMAL / KT * (1.0 + spread * np.linspace(-1.0, 1.0, sliders))

    def first(way):
        return KT * np.minimum(way[:, None], limits).mean(axis=1)

    top = first(np.array([swing]))[0]
    down = top - 2.0 * first((swing - x) / 2.0)
    up = -top + 2.0 * first((x + swing) / 2.0)
    return x, np.where(t < np.pi, down, up)


@pytest.mark.parametrize("spread", [0.0, 0.6])
def test_sliders_follow_masing(spread):
    x, force = loop(spread, 3.0 * MU * NORMAL / KT)
    limits = MU * NORMAL / 400 * (1.0 + spread * np.linspace(-1.0, 1.0, 400))
    assert np.abs(sliding_force(x, KT, limits) - force).max() < 1e-9 * force.max()


@pytest.mark.parametrize("slip", [1.3, 3.0])
def test_spread_sliders_are_found_again(slip):
    x, force = loop(0.6, slip * MU * NORMAL / KT)
    noise = np.random.default_rng(0).standard_normal(len(x)) * 0.02 * MU * NORMAL
    found = bd.fit_loop(x, force + noise + 3.0, normal=NORMAL)
    assert found.kt == pytest.approx(KT, rel=0.02) and found.mu == pytest.approx(MU, rel=0.02)
    assert found.spread == pytest.approx(0.6, abs=0.1)
    assert abs(found.mu - MU) < 4.0 * found.deviation[1] and abs(found.kt - KT) < 4.0 * found.deviation[0]
    alone = bd.fit_loop(x, force + noise, normal=NORMAL, sliders=1)
    assert alone.kt < 0.97 * KT and alone.misfit > 1.5 * found.misfit  # one slider makes the contact too soft


def test_from_a_file(tmp_path):
    x, force = loop(0.3, 2.0 * MU * NORMAL / KT)
    path = tmp_path / "loop.csv"
    rows = "\n".join(f"{1e6 * a:.9g},{b:.9g}" for a, b in zip(x, force))
    path.write_text(f"# synthetic\ndisplacement (um),force (N)\n{rows}\n")
    found = bd.fit_loop(*read_loop(path), normal=NORMAL)
    assert [found.kt, found.mu, found.spread] == pytest.approx([KT, MU, 0.3], rel=0.02)
    assert "friction coefficient 0.45" in str(found).replace("\n", " ")
    path.write_text("displacement (um),force (lbf)\n1,2\n")
    with pytest.raises(bd.BdamperError, match=r"column 'force': expected its unit .* \['N', 'kN'\], .* 'lbf'"):
        read_loop(path)


def test_a_loop_that_sticks_is_refused():
    x = 1e-7 * np.cos(np.linspace(0.0, 2.0 * np.pi, 50))
    with pytest.raises(bd.SettingError, match=r"sticks|slip"):
        bd.fit_loop(x, KT * x, normal=NORMAL)
