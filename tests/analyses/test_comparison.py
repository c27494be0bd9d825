"""Several designs on the same axes."""

from dataclasses import replace

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest

import bdamper as bd
from bdamper.analyses.sweep import _failed
from bdamper.importers import Measurement
from bdamper.plot import plot_together
from bdamper.util.formatting import amount
from tests.plain import plain_study

INTERVAL = (350.0, 358.0)
DESIGNS = {"smooth": {"friction_coefficient": 0.2}, "heavier": {"damper_inertia_factor": 1.5}}


def ask(study):
    return study.frequency_response(4000.0, INTERVAL)


@pytest.fixture(scope="module")
def study():
    model = bd.reference_model("bladed_disk", 9)
    return plain_study(model, bd.Excitation("tip"), engine_order=5, friction_coefficient=0.4)


@pytest.fixture(scope="module")
def found(study):
    return bd.compare({"as it is": study, **DESIGNS}, ask)


def test_each_design_has_its_own_curve(study, found, tmp_path):
    assert found.names == ("as it is", "smooth", "heavier")
    alone = study.replace(friction_coefficient=0.2).frequency_response(4000.0, INTERVAL)
    assert found.results["smooth"].peak.amplitude == pytest.approx(alone.peak.amplitude, rel=1e-9)
    assert found.differences["smooth"].settings[0] == ("friction_coefficient.left", 0.4, 0.2)
    assert [name for name, *_ in found.differences["heavier"].settings] == ["model"]
    assert found.columns()["name"].values.tolist().count("smooth") == len(alone)
    text = found.summary().splitlines()
    (row,) = [line for line in text if line.startswith("  smooth")]
    assert amount(alone.peak.amplitude, "m") in row and row.endswith("complete")
    found.save(tmp_path / "designs.h5")
    assert str(bd.load(tmp_path / "designs.h5")) == str(found)


def test_on_the_same_axes(study, found):
    measured = Measurement("rig", np.array([352.0, 354.0]), np.array([0.5, 0.7j]), unit="mm")
    ax = found.plot(measured=[measured]).axes[0]
    names = [text.get_text() for text in ax.get_legend().get_texts()]
    assert {"as it is", "smooth", "heavier", "rig"} <= set(names)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("Frequency (Hz)", "Tip amplitude (µm)")
    losses = plot_together(
        {name: study.dissipation(curve) for name, curve in list(found.results.items())[:1]}
    )
    assert losses.get_ylabel() == "Equivalent damping ratio (%)"
    loops = plot_together(
        {"a": study.hysteresis(found.curves[0]), "b": study.hysteresis(found.curves[0], 0)}
    )
    assert (
        loops.get_ylabel() == "Equivalent force of\nall contacts (N)"
        and len(loops.get_lines()) == 2
    )
    assert loops.get_xlabel() == "Response (µm)"
    mass = bd.lumped(
        1.0, 0.02, 1.0, contacts=[bd.Contact(0, kt=1.0, mu=1.0, preload=1.0)], forces={0: 1.0}
    )
    far = plot_together({"a mass": mass.hysteresis(mass.peak(0.0, (0.1, 0.3)))})
    assert (
        far.get_xlabel() == "Response (m)" and np.abs(far.get_lines()[0].get_xdata()).max() < 10.0
    )
    plt.close("all")


def test_optimal_curves(study):
    curve = study.optimal_curve((6e3, 8e3), 2, frequency=(340.0, 370.0), check=False)
    found = bd.compare({"rough": study, "smooth": {"friction_coefficient": 0.39}}, lambda _: curve)
    assert found.names == ("rough", "smooth") and not found.curves and len(found.optimal) == 2
    failures = [
        f"'{name}': {_failed(curve)[0]}" for name, curve in found.results.items() if _failed(curve)
    ]
    assert (
        failures
        and f"Not for design: {failures[0]}" in found._headline()
        and failures[0].split(": ")[1] in " ".join(str(found).split())
    )
    ax = found.plot(quantity="shift").axes[0]
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("Preload (N)", "Frequency shift (%)")
    assert found.plot().axes[0].get_ylabel() == "Resonance amplitude (µm)"
    plt.close("all")


def test_interrupted_work_keeps_what_there_is(study, found):
    answers = iter([found.curves[0], replace(found.curves[1], status="interrupted"), None])
    stopped = bd.compare({"as it is": study, **DESIGNS}, lambda _: next(answers))
    assert stopped.names == ("as it is", "smooth") and stopped.results["smooth"].interrupted


@pytest.mark.parametrize(
    ("designs", "message"),
    [
        ({}, "studies: expected a mapping of one or more names to studies or settings"),
        ([], "studies: expected a mapping of one or more names to studies or settings"),
        ({"as it is": {"friction_coefficient": 0.2}}, "study: expected a Study"),
        ({"as it is": bd.Study, "a": 3}, "study: expected a Study"),
        (
            {"a": 3},
            "study 'a': expected a mapping of one or more names to studies or settings, found 3",
        ),
        ({"a": {"frictoin": 3}}, "frictoin"),
    ],
)
def test_what_does_not_fit_is_refused_before_any_work(study, designs, message):
    given = (
        {"now": study, **designs} if designs and "a" in designs and len(designs) == 1 else designs
    )
    with pytest.raises(bd.SettingError, match=message):
        bd.compare(given, None)


def test_answers_are_curves_of_one_kind(study, found):
    optimal = study.optimal_curve((6e3, 8e3), 2, frequency=(340.0, 370.0), check=False)
    answers = iter([found.curves[0], optimal])
    with pytest.raises(
        bd.SettingError, match="answer: expected the same kind of result from every study"
    ):
        bd.compare({"a": study, "b": study}, lambda _: next(answers))
    with pytest.raises(
        bd.SettingError, match="answer: expected a ResponseCurve or an OptimalCurve, found 3"
    ):
        bd.compare({"a": study}, lambda _: 3)


def test_changes_are_those_from_the_first(found):
    first, smooth = (found.results[name].peak for name in ("as it is", "smooth"))
    assert found.change("smooth") == pytest.approx(smooth.amplitude / first.amplitude - 1.0)
    assert found.change("as it is") == 0.0
    (row,) = [row for row in found._rows() if row[0] == "smooth"]
    assert f"{100.0 * found.change('smooth'):+.2g} %" in row
    lowest = min(found.names, key=lambda name: found.results[name].peak.amplitude)
    assert found._headline().startswith(f"Lowest with '{lowest}': ")


def test_results_of_several_kinds_are_refused(study, found):
    with pytest.raises(
        bd.SettingError, match="results: expected response curves, optimal curves or hysteresis"
    ):
        plot_together({"a": found.curves[0], "b": study.dissipation(found.curves[0])})
    with pytest.raises(
        bd.SettingError, match=r"quantity: expected one of \('amplitude',\), found 'shift'"
    ):
        found.plot(quantity="shift")
