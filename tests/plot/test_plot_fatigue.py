"""Pictures of stress and margins show what the results hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bdamper.fatigue import AISI_1050, MarginCurve, Margins, StressCycle
from bdamper.fatigue.margin import Rule
from bdamper.model.structure import StressSet
from bdamper.plot import plot_margin
from bdamper.util.errors import SettingError
from tests.models import wedge_model

SOLUTION = {"frequency": 300.0, "preload": 200.0, "speed": 400.0}


@pytest.fixture(scope="module")
def margins():
    amplitude, mean = np.array([50e6, 90e6, 120e6]), np.array([200e6, 150e6, 10e6])
    factor = AISI_1050.factor(amplitude, mean)
    seen = np.array([True, True, False])
    return Margins(
        amplitude, mean, factor, 3.0 * factor, AISI_1050, Rule(), points=np.eye(3) * 0.01,
        names=("root 1", "root 2", "root 3"), counted=seen, spread=np.full(3, 0.1), **SOLUTION,
    )  # fmt: skip


def test_haigh_diagram_has_the_lines_and_every_point(margins):
    (axes,) = margins.plot().axes
    lines = {line.get_label(): line for line in axes.lines}
    assert {"Goodman", "Gerber", "Soderberg", "points", "next to contact", "critical"} <= set(lines)
    assert_allclose(lines["points"].get_xdata(), [200.0, 150.0])
    assert_allclose(lines["critical"].get_data(), ([150.0], [90.0]))
    assert lines["Goodman"].get_linewidth() > lines["Gerber"].get_linewidth()


def test_stress_over_the_cycle_is_drawn_at_the_critical_point():
    coefficients = np.zeros((2, 6, 2), complex)
    coefficients[:, 1, 0], coefficients[:, 1, 1] = 100e6, [20e6, 50e6]
    seen = np.ones(2, bool)
    at = {
        "points": np.zeros((2, 3)),
        "names": ("a 1", "a 2"),
        "counted": seen,
        "spread": np.zeros(2),
    }
    cycle = StressCycle(coefficients, **at, **SOLUTION)
    (axes,) = cycle.plot().axes
    whole = next(line for line in axes.lines if line.get_label() == "von Mises")
    assert whole.get_ydata().max() == pytest.approx(150.0) and "a 2" in axes.get_title()


def test_curves_in_the_same_axes_differ_by_line_and_marker(margins):
    single = ("amplitude", "mean", "factor", "frequency", "preload", "speed", "critical")
    columns = {name: np.array([getattr(margins, name)] * 2) for name in single}
    both = {name: getattr(margins, name) for name in ("names", "material", "rule")}
    mass, least = np.array([0.05, 0.1]), np.full(2, margins.least)
    curve = MarginCurve(
        over="damper mass",
        unit="kg",
        values=mass,
        margin=least,
        response=np.array([1e-4, 2e-4]),
        **both,
        **columns,
    )
    axes = curve.plot().axes[0]
    assert axes.get_xlabel() == "Damper mass (kg)" and len(axes.figure.axes) == 2
    axes = plot_margin(curve, label="one")
    plot_margin(curve, axes, label="two")
    drawn = [line for line in axes.lines if line.get_gid() == "margin"]
    assert len(drawn) == 2 and drawn[0].get_marker() != drawn[1].get_marker()


def test_the_critical_location_is_drawn_on_its_body(margins):
    model = wedge_model()
    points, rows = margins.points, {0: np.zeros((3, 6, 5))}
    meshes = {"blade": replace(next(iter(model.meshes.values())))}
    model = replace(model, meshes=meshes, stress={"root": StressSet("root", "blade", points, rows)})
    axes = margins.plot_critical(model).axes[0]
    assert len(axes.collections) == 3  # surface, points, the critical one
    with pytest.raises(SettingError, match="expected a mesh of"):
        margins.plot_critical(replace(model, meshes={}))
