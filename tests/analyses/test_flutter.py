"""Limit cycles beside closed forms, and peaks from a mode beside those that are searched for."""

import numpy as np
import pytest
from scipy.optimize import brentq

import bdamper as bd
from bdamper.analyses.flutter import Flutter
from tests.analyses import jenkins, wedge
from tests.analyses.test_mode import oscillator
from tests.printed import row

TWO_PI = 2.0 * np.pi
EXCITES = -0.1


def closed_cycles():
    """The amplitudes at which the closed form has this damping: it rises, then falls."""
    gap = lambda a: jenkins.closed_form(a)[1] + EXCITES
    return brentq(gap, 1.01, 2.5, xtol=1e-14), brentq(gap, 2.7, 20.0, xtol=1e-14)


def test_limit_cycles_are_those_of_the_closed_form(tmp_path):
    """One of friction that rises, stable, and one of friction that falls, beyond which the motion grows."""
    found = oscillator(1).flutter(0.0, EXCITES, amplitude=(0.01, 30.0))
    assert found.amplitude == pytest.approx([0.0, *closed_cycles()], rel=1e-9)
    assert TWO_PI * found.frequency[1:] == pytest.approx(
        [jenkins.closed_form(a)[0] for a in closed_cycles()], rel=1e-9
    )
    assert found.stable.tolist() == [False, True, False]
    assert found.safe == pytest.approx(closed_cycles()[1], rel=1e-9)
    assert found._headline().startswith(f"Flutter above {closed_cycles()[1]:.3g} m")
    assert found._headline().endswith(
        f"; limit cycles of up to {closed_cycles()[0]:.3g} m from rest"
    )
    # with amplitudes below the second cycle the first one bounds the motion
    below = oscillator(1).flutter(0.0, EXCITES, amplitude=(0.01, 2.5))
    assert below._headline().startswith("Bounded flutter: limit cycles of up to")
    quiet = oscillator(1).flutter(0.0, -0.005, amplitude=(0.01, 30.0))
    assert quiet.stable.tolist() == [True] and np.isinf(quiet.safe).all()
    assert quiet._headline().startswith("No flutter: ")
    lost = oscillator(1).flutter(0.0, -0.2, amplitude=(0.01, 30.0))
    assert lost.stable.tolist() == [False] and (lost.safe == 0.0).all()
    ax = found.plot().axes[0]
    assert ax.get_yscale() == "log"
    # the state at rest lies below every number of the axis
    ax.figure.canvas.draw()
    low, _ = ax.get_ylim()
    strip = low * (found.amplitude[1] / low) ** 0.1
    assert min(ax.get_yticks()) > strip and "at rest" in [text.get_text() for text in ax.texts]
    assert not len(quiet.plot().axes[0].get_yticks()), "without a limit cycle no amplitudes"
    found.save(tmp_path / "flutter.h5")
    assert bd.load(tmp_path / "flutter.h5").summary() == found.summary()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cycle", "ends"), [(1, (1, 1)), pytest.param(2, (1, np.inf), marks=pytest.mark.slow)]
)
def test_motions_go_to_stable_cycles_and_away_from_unstable_ones(cycle, ends):
    """One mass: from 0.9 and 1.1 of each cycle."""
    found = oscillator((1, 3, 5, 7)).flutter(0.0, EXCITES, amplitude=(0.1, 30.0))
    a, omega = found.amplitude[cycle], TWO_PI * found.frequency[cycle]
    one = np.ones((1, 1))
    matrices = np.ones(1), np.array([0.02 + 2.0 * omega * EXCITES]), one
    for factor, end in zip((0.9, 1.1), ends):
        start = np.array([factor * a])
        contacts = one, 0.0 * one, 1.0, 0.0, 1.0, 1.0
        height = jenkins.integrated(
            matrices, contacts, np.zeros(1), omega, start, np.zeros(1), start - 1.0, 40
        )
        if end == cycle:
            assert height[-5:] == pytest.approx(a, rel=0.01)
        elif np.isinf(end):
            assert height[-1] > 1.5 * a
        else:
            assert height[-1] < 0.6 * a


@pytest.mark.slow
def test_cycles_with_a_free_mass_are_those_in_time():
    """A mass between the blade and the ground, held by friction alone; its own mode is damped enough for the flow."""
    mass, damping, flow = np.array([1.0, 0.1]), np.array([0.02, 0.1]), -0.08
    faces = [
        bd.Contact((1, 0), kt=1.0, mu=1.0, preload=1.0),
        bd.Contact(1, kt=2.0, mu=1.0, preload=1.3),
    ]
    study = bd.lumped(
        mass,
        damping,
        [1.0, 0.0],
        contacts=faces,
        forces={0: 1.0},
        harmonics=(1, 3, 5, 7),
        bias=False,
    )
    found = study.flutter(0.0, flow, amplitude=(0.1, 20.0))
    assert found.stable.tolist() == [False, True, False]
    a, omega = found.amplitude[1], TWO_PI * found.frequency[1]
    matrices = mass, damping + 2.0 * omega * flow * mass, np.diag([1.0, 0.0])
    slide = np.array([[-1.0, 1.0], [0.0, 1.0]])
    contacts = slide, np.zeros((2, 2)), np.array([1.0, 2.0]), 0.0, 1.0, np.array([1.0, 1.3])
    for factor in (0.9, 1.1):
        x = factor * a * np.array([1.0, 0.3])
        height = jenkins.integrated(
            matrices, contacts, np.zeros(2), omega, x, np.zeros(2), slide @ x * 0.5, 40
        )
        assert height[-5:] == pytest.approx(a, rel=0.01)


def test_flutter_over_preload_and_nodal_diameter():
    """Without gaps one curve serves all preloads; a shift of the frequency is that of the flow."""
    study = wedge.study(0.5, 3)
    found = study.flutter((60.0, 240.0), {0: -0.02}, mode=3, amplitude=(2e-5, 2e-4), n=3)
    assert sorted(set(found.preload)) == pytest.approx([60.0, 120.0, 240.0])
    alone = study.flutter(60.0, -0.02, mode=3, amplitude=(2e-5, 1e-4))
    own = found.amplitude[(found.preload == 60.0) & (found.amplitude > 0.0)]
    assert own[0] == pytest.approx(alone.amplitude[alone.amplitude > 0.0][0], rel=1e-7)
    shifted = study.flutter(120.0, 0.01 - 0.02j, mode=3, amplitude=(2e-5, 1e-4))
    plain = study.flutter(120.0, -0.02j, mode=3, amplitude=(2e-5, 1e-4))
    assert shifted.frequency[0] / plain.frequency[0] - 1.0 == pytest.approx(0.01, rel=0.1)
    with pytest.raises(bd.SettingError, match="aerodynamic_damping at nodal diameter 0"):
        study.flutter(120.0, float("nan"))


def states(preload, amplitude, stable):
    """Equilibria and limit cycles of nodal diameter 5, one row for each."""
    n = len(preload)
    return Flutter(
        preload=np.array(preload),
        nodal_diameter=np.full(n, 5),
        amplitude=np.array(amplitude),
        frequency=np.ones(n),
        stable=np.array(stable),
        highest=1e-2,
        aerodynamic_damping={"5": [0.0, -0.01]},
        statuses=("complete",) * n,
        settings={},
        model_hash="",
    )


def test_every_preload_that_flutters_is_named():
    at_all = states([200.0, 500.0, 1e3], [0.0] * 3, [False] * 3)
    assert at_all._headline() == (
        "Flutter from rest: all 3 preloads, 200 N to 1 kN; nodal diameter 5"
    )
    at_two = states([200.0, 500.0, 1e3], [0.0] * 3, [False, False, True])
    assert at_two._headline() == (
        "Flutter from rest: 2 of 3 preloads, 200 N and 500 N; nodal diameter 5"
    )
    alone = states([200.0], [0.0], [False])
    assert alone._headline() == "Flutter from rest: preload 200 N; nodal diameter 5"
    # at 500 N only vibration above 2 mm grows
    one_above = states([200.0, 500.0, 500.0], [0.0, 0.0, 2e-3], [False, True, False])
    assert one_above._headline() == ("Flutter from rest: 1 of 2 preloads, 200 N; nodal diameter 5")
    assert row(one_above, "Flutter above") == (
        "Flutter above", "2 mm", "or more: 1 of 2 preloads, 500 N; nodal diameter 5"
    )  # fmt: skip
